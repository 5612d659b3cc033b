"""Errors that wander: constant, drawn at turn-on, Gauss-Markov, random walk, and with the spectrum 1/f."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.simulate.first_order import flicker

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array

BLOCK = 1 << 16  # numbers that are drawn at a time where they are not needed


@dataclass(frozen=True)
class Drift:
    """A slowly varying error: constant + drawn at turn-on + first-order Gauss-Markov + random walk + flicker, each axis alone.

    Sigmas in the unit of the value; `tau` in s; `walk` in the unit per sqrt(s).  The Gauss-Markov part starts in its steady state:
    x(t + dt) = exp(-dt / tau) x(t) + w,  var(w) = steady^2 (1 - exp(-2 dt / tau)).  `flicker` is the bias instability, in the unit of
    the value: noise of the spectrum 1/f, whose Allan deviation is flat at 0.664 flicker.  That of the walk is walk sqrt(T / 3).
    """

    constant: float | tuple[float, ...] = 0.0
    turn_on: float = 0.0
    steady: float = 0.0
    tau: float = 300.0
    walk: float = 0.0
    flicker: float = 0.0

    def draw(self, time: Array, axes: int, generator: Generator) -> Array:
        """Return the error (times, axes) at ascending times (s); the numbers drawn do not depend on the sigmas."""
        error = np.empty((len(time), axes))
        error[:] = np.asarray(self.constant, float) + self.turn_on * generator.standard_normal(axes)
        if self.steady:
            markov = gauss_markov(time / self.tau, generator.standard_normal(error.shape))
            markov *= self.steady  # in place, here and below: of a day they are large
            error += markov
            del markov
        else:
            _pass_over(error.size, generator)
        if self.walk:
            steps = generator.standard_normal(error.shape)
            steps *= np.sqrt(np.diff(time, prepend=time[:1]))[:, None]
            np.cumsum(steps, axis=0, out=steps)
            steps *= self.walk
            error += steps
            del steps
        else:
            _pass_over(error.size, generator)
        if self.flicker:  # from a stream of its own
            error += self.flicker * flicker(time, axes, generator.spawn(1)[0])
        return error


STEADY = Drift()  # no error at all


def _pass_over(count: int, generator: Generator) -> None:
    """Draw normal numbers that nobody needs, so that those behind them stay the same."""
    for first in range(0, count, BLOCK):
        generator.standard_normal(min(BLOCK, count - first))


def gauss_markov(time: Array, normal: Array) -> Array:
    """Return the unit Gauss-Markov process (times, axes) of time constant 1, driven by `normal` of the same shape.

    x_k = e_k (x_0 + sum_j s_j w_j / e_j) with e = exp(-(time - time_0)), summed within blocks of 20 time constants, since e underflows.
    """
    result, first = np.empty_like(normal), 0
    driving = np.sqrt(-np.expm1(-2 * np.diff(time, prepend=-np.inf)))[:, None]
    while first < len(time):
        last = max(first + 1, int(np.searchsorted(time, time[first] + 20.0)))
        decay = np.exp(time[first] - time[first:last])[:, None]
        block = np.cumsum(driving[first:last] * normal[first:last] / decay, axis=0)
        if first:
            block += result[first - 1] * np.exp(time[first - 1] - time[first])
        result[first:last] = decay * block
        first = last
    return result
