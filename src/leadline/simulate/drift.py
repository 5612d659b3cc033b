"""Errors that wander: constant, drawn at turn-on, Gauss-Markov, random walk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array


@dataclass(frozen=True)
class Drift:
    """A slowly varying error: constant + drawn at turn-on + first-order Gauss-Markov + random walk, each axis alone.

    Sigmas in the unit of the value; `tau` in s; `walk` in the unit per sqrt(s).  The Gauss-Markov part starts in its steady state:
    x(t + dt) = exp(-dt / tau) x(t) + w,  var(w) = steady^2 (1 - exp(-2 dt / tau)).
    """

    constant: float | tuple[float, ...] = 0.0
    turn_on: float = 0.0
    steady: float = 0.0
    tau: float = 300.0
    walk: float = 0.0

    def draw(self, time: Array, axes: int, generator: Generator) -> Array:
        """Return the error (times, axes) at ascending times (s); the numbers drawn do not depend on the sigmas."""
        fixed = np.asarray(self.constant, float) + self.turn_on * generator.standard_normal(axes)
        markov = self.steady * gauss_markov(time / self.tau, generator.standard_normal((len(time), axes)))
        steps = np.sqrt(np.diff(time, prepend=time[:1]))[:, None] * generator.standard_normal((len(time), axes))
        return np.asarray(fixed + markov + self.walk * np.cumsum(steps, axis=0))


STEADY = Drift()  # no error at all


def gauss_markov(time: Array, normal: Array) -> Array:
    """Return the unit Gauss-Markov process (times, axes) of time constant 1, driven by `normal` of the same shape.

    x_k = e_k (x_0 + sum_j s_j w_j / e_j) with e = exp(-(time - time_0)), summed within blocks of 20 time constants, since e underflows.
    """
    result, first = np.empty_like(normal), 0
    driven = np.sqrt(-np.expm1(-2 * np.diff(time, prepend=-np.inf)))[:, None] * normal
    while first < len(time):
        last = max(first + 1, int(np.searchsorted(time, time[first] + 20.0)))
        decay = np.exp(time[first] - time[first:last])[:, None]
        block = np.cumsum(driven[first:last] / decay, axis=0)
        if first:
            block += result[first - 1] * np.exp(time[first - 1] - time[first])
        result[first:last] = decay * block
        first = last
    return result
