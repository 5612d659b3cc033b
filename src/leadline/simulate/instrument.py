"""What every instrument of the simulator has: when it samples, where it sits, how its rows arrive, and errors that wander.

Each instrument has two halves.  `ideal` asks the trajectory and knows no noise: it depends on no seed, so that it is computed once for
many runs.  `noisy` adds the errors, from a generator of the instrument's own.  With all sigmas zero, noisy equals ideal.
Nothing here is shared with the sensor models of the estimator: each is the other's witness.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt

from leadline.core.attitude import matrix_from_euler
from leadline.data import records

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory

Vector: TypeAlias = tuple[float, float, float]
Flags: TypeAlias = npt.NDArray[np.bool_]
T = TypeVar("T", bound=records.Table)
ZERO: Vector = (0.0, 0.0, 0.0)


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


@dataclass(frozen=True, kw_only=True)
class Instrument(ABC, Generic[T]):
    """When an instrument samples, where it sits, and how its rows arrive.

    It samples at offset + k / rate up to `stop` (s), shifted by N(0, jitter) but less than 0.4 / rate; `time` is the true moment.
    Rows arrive at time + latency + |N(0, latency_jitter)|; a fraction `loss` of them never does.
    The reference point lies at `lever_arm_b` (m) from the body origin; `mounting_bs` holds roll, pitch and heading (rad) of the
    sensor axes against the body: v_b = R_bs v_s.
    """

    rate: float
    offset: float = 0.0
    stop: float = np.inf
    jitter: float = 0.0
    latency: float = 0.0
    latency_jitter: float = 0.0
    loss: float = 0.0
    lever_arm_b: Vector = ZERO
    mounting_bs: Vector = ZERO

    @property
    def rotation_bs(self) -> Array:
        """Rotation (3, 3) from sensor to body axes."""
        return matrix_from_euler(*self.mounting_bs)

    def sampling(self, duration: float, generator: Generator) -> Array:
        """Return the moments (s) at which the instrument looks."""
        count = int(np.floor((min(self.stop, duration) - self.offset) * self.rate + 1e-6)) + 1
        time = self.offset + np.arange(max(count, 0)) / self.rate
        return np.asarray(time + np.clip(self.jitter * generator.standard_normal(len(time)), -0.4 / self.rate, 0.4 / self.rate))

    @abstractmethod
    def ideal(self, trajectory: Trajectory, time: Array) -> T:
        """Return the table without errors of looks at `time` (s)."""

    @abstractmethod
    def noisy(self, table: T, generator: Generator) -> T:
        """Return the table with errors."""

    def record(self, ideal: T, generator: Generator) -> T:
        """Return the table with errors, as it arrives."""
        errors, delivery = generator.spawn(2)
        table = self.noisy(ideal, errors)
        if self.latency or self.latency_jitter:
            late = self.latency + np.abs(self.latency_jitter * delivery.standard_normal(len(table)))
            table = replace(table, received=table.time + late)
        return cast("T", table.select(delivery.random(len(table)) >= self.loss)) if self.loss else table
