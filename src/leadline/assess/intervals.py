"""Confidence intervals of statistics over runs, and the sense in which a bar holds: the interval reaches the limit."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log, nan, sqrt
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

LEVEL = 0.99
SMALL = 0.001  # of a factor


def factor_text(value: float) -> str:
    """Write a factor to three figures; what is below a thousandth is not a zero."""
    return f"<{SMALL:g}" if value < SMALL else f"{value:.3g}"


@dataclass(frozen=True)
class Interval:
    """An estimate between the ends of its confidence interval; `high` may be infinite where the data set no upper end."""

    low: float = nan
    high: float = nan
    estimate: float = nan
    level: float = LEVEL

    def reaches(self, at_most: float = inf, *, at_least: float = -inf) -> bool:
        """Tell whether a bar holds: some value of the interval is at most `at_most` and at least `at_least`."""
        return self.low <= at_most and self.high >= at_least

    def __str__(self) -> str:
        """Write the interval as two numbers with the level."""
        if np.isinf(self.high):
            return f"{self.low:.3g} or more"
        return f"{self.low:.3g} to {self.high:.3g}"

    @property
    def as_factor(self) -> str:
        """Write the interval of a factor: what is below a thousandth is not a zero."""
        if self.high < SMALL:
            return f"<{SMALL:g}"
        return str(self) if self.low >= SMALL or np.isinf(self.high) else f"<{SMALL:g} to {self.high:.3g}"


def interval_of_mean(values: ArrayLike, level: float = LEVEL) -> Interval:
    """Return the interval of the mean of independent values (runs,), by Student's t."""
    from scipy.special import stdtrit

    x = np.asarray(values, float).ravel()
    mean = float(x.mean())
    if len(x) < 2:
        return Interval(-inf, inf, mean, level)
    half = float(stdtrit(len(x) - 1, 0.5 + level / 2)) * float(x.std(ddof=1)) / sqrt(len(x))
    return Interval(mean - half, mean + half, mean, level)


def interval_of_rmse_ratio(errors: ArrayLike, reference: ArrayLike, level: float = LEVEL) -> Interval:
    """Return the interval of RMSE(errors) / RMSE(reference) over paired runs.

    The logarithm of the ratio is linearised in the runs' mean squares a_r and b_r: its standard error is that of the mean of
    (a_r / a - b_r / b) / 2, taken with Student's t (the delta method; Casella and Berger, 2002, section 5.5.4).
    errors, reference: (runs,) or (runs, ...); what follows the first axis is averaged within its run.
    """
    from scipy.special import stdtrit

    a, b = (np.mean(np.reshape(np.asarray(e, float) ** 2, (len(np.asarray(e)), -1)), axis=1) for e in (errors, reference))
    ratio = 0.5 * log(float(a.mean()) / float(b.mean()))
    influence = 0.5 * (a / a.mean() - b / b.mean())
    if len(a) < 2:
        return Interval(0.0, inf, exp(ratio), level)
    half = float(stdtrit(len(a) - 1, 0.5 + level / 2)) * float(influence.std(ddof=1)) / sqrt(len(a))
    return Interval(exp(ratio - half), exp(ratio + half), exp(ratio), level)


def interval_of_anees(anees: float, runs: float, dof: int, level: float = LEVEL) -> Interval:
    """Return the interval of the expected NEES, from its mean over independent runs of `dof` components each.

    runs * anees / E(nees) * dof follows chi-square with runs * dof degrees of freedom (Bar-Shalom, Li and Kirubarajan, 2001, 5.4.2).
    """
    from scipy.special import gammaincinv

    total = runs * dof
    low, high = (float(total * anees / (2.0 * gammaincinv(0.5 * total, q))) for q in (0.5 + level / 2, 0.5 - level / 2))
    return Interval(low, high, anees, level)


def interval_of_fraction(count: int, total: int, level: float = LEVEL) -> Interval:
    """Return the exact interval of a probability of which `count` of `total` were seen (Clopper and Pearson, 1934)."""
    from scipy.special import betaincinv

    tail = 0.5 - level / 2
    low = float(betaincinv(count, total - count + 1, tail)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, total - count, 1 - tail)) if count < total else 1.0
    return Interval(low, high, count / total if total else nan, level)
