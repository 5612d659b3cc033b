"""The law of normalised innovations that a gate let through: truncated chi-square, and the factor that it tells of a sigma."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.intervals import Interval

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array

RANGE = (1e-3, 1e3)  # in which a factor is sought


def truncated_moments(dof: ArrayLike, limit: ArrayLike) -> tuple[Array, Array]:
    """Return mean and variance of chi-square with `dof` degrees of freedom, given that it lies below `limit`.

    E[x | x < c] = d F(c; d + 2) / F(c; d) and E[x^2 | x < c] = d (d + 2) F(c; d + 4) / F(c; d), with F the distribution function.
    """
    from scipy.special import gammainc

    d, c = np.asarray(dof, float), np.asarray(limit, float)
    whole, first, second = (gammainc(0.5 * d + k, 0.5 * c) for k in range(3))
    tiny = 0.5 * c < 1e-6  # there the density is a pure power, and the ratios of tiny numbers lose their figures
    safe = np.where(whole > 0.0, whole, 1.0)
    mean = np.where(tiny, c * d / (d + 2), d * first / safe)
    square = np.where(tiny, c**2 * d / (d + 4), d * (d + 2) * second / safe)
    return mean, square - mean**2


@dataclass(frozen=True)
class GatedSum:
    """The sum of `nis` over used groups, as evidence on the factor f by which their sigmas are wrong (true / stated).

    A group's nis is f^2 chi-square, cut off at its gate.  The sum is taken as gamma-distributed with its exact mean and variance
    (exact without a gate; Satterthwaite, 1946), the variance enlarged by count / effective where groups are correlated.
    kinds: distinct (dof, gate) pairs (k, 2) with gate in nis, inf for none; counts (k,) of groups of each.
    """

    total: float
    kinds: Array
    counts: Array
    effective: float

    def moments(self, factor: float) -> tuple[float, float]:
        """Return mean and variance of the sum when sigmas are wrong by `factor`."""
        square = factor**2
        mean, variance = truncated_moments(self.kinds[:, 0], self.kinds[:, 1] / square)
        inflation = float(self.counts.sum()) / self.effective
        return float(square * self.counts @ mean), float(square**2 * self.counts @ variance) * inflation

    def below(self, factor: float) -> float:
        """Return the probability of a sum up to the observed one when sigmas are wrong by `factor`."""
        from scipy.special import gammainc

        mean, variance = self.moments(factor)
        return float(gammainc(mean**2 / variance, self.total * mean / variance))

    @property
    def p(self) -> float:
        """Two-sided probability of a sum as far from its mean, when sigmas are right."""
        below = self.below(1.0)
        return min(1.0, 2.0 * min(below, 1.0 - below))

    def factor(self, level: float) -> Interval:
        """Return the factor with its interval: all factors that a two-sided test at 1 - level does not reject."""
        tail = 0.5 - level / 2
        low = self._solve(lambda f: self.below(f) - (1.0 - tail))
        high = self._solve(lambda f: self.below(f) - tail)
        return Interval(low, high, self._solve(lambda f: 1.0 - self.moments(f)[0] / self.total), level)

    def _solve(self, falling: object) -> float:
        """Return where a function of the factor that falls crosses zero: 0 or inf where it does not within `RANGE`."""
        assert callable(falling)
        if not self.total > 0.0:
            return nan
        if falling(RANGE[0]) <= 0.0:
            return 0.0
        if falling(RANGE[1]) >= 0.0:
            return inf
        low, high = (float(np.log(end)) for end in RANGE)
        while high - low > 1e-7:  # by halves: the function falls
            middle = 0.5 * (low + high)
            low, high = (middle, high) if falling(np.exp(middle)) > 0.0 else (low, middle)
        return float(np.exp(0.5 * (low + high)))


def effective_size(autocorrelation: Array, count: int) -> float:
    """Return the number of independent values that tell as much about the mean as `count` correlated ones: count / tau.

    tau = 1 + 2 sum of the autocorrelations from lag 1 up to the first lag that exceeds 5 tau (Sokal, 1997), at least 1.
    """
    tau = np.maximum(1.0 + 2.0 * np.cumsum(autocorrelation[1:]), 1.0)
    if not len(tau):
        return float(count)
    closed = np.flatnonzero(np.arange(1, len(tau) + 1) >= 5.0 * tau)
    return count / float(tau[closed[0] if len(closed) else -1])


def autocorrelation(values: ArrayLike) -> Array:
    """Return the autocorrelation about zero (n,) of a sequence (n,) or, averaged over the columns, of (n, d); lag 0 first."""
    x = np.asarray(values, float).reshape(len(np.asarray(values)), -1)
    size = 1 << (2 * len(x) - 1).bit_length()
    power = np.abs(np.fft.rfft(x, size, axis=0)) ** 2
    covariance = np.fft.irfft(power.sum(axis=1), size)[: len(x)]
    return np.asarray(covariance / covariance[0]) if covariance[0] > 0.0 else np.eye(1, len(x))[0]
