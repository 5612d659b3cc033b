"""What every instrument of the simulator has: when it samples, where it sits, how its rows arrive.

Each instrument has two halves.  `ideal` asks the trajectory and knows no noise: it depends on no seed, so that it is computed once for
many runs.  `noisy` adds the errors, from a generator of the instrument's own.  With all sigmas zero, noisy equals ideal.
Nothing here is shared with the sensor models of the estimator: each is the other's witness.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt

from leadline.core.attitude import matrix_from_euler
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.drift import STEADY
from leadline.simulate.surroundings import Surrounding

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory

Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]
Flags: TypeAlias = npt.NDArray[np.bool_]
T = TypeVar("T", bound=records.Table)
ZERO: Vector = (0.0, 0.0, 0.0)


def frozen(column: Array) -> Array:
    """Return an array of our own, made read-only, so that a table holds it instead of a copy."""
    column.setflags(write=False)
    return column


@dataclass(frozen=True, kw_only=True)
class Instrument(ABC, Generic[T]):
    """When an instrument samples, where it sits, and how its rows arrive.

    It samples at offset + k / rate up to `stop` (s), shifted by N(0, jitter) but less than 0.4 / rate; `time` is the true moment.
    Rows arrive at time + latency + |N(0, latency_jitter)|; a fraction `loss` of them never does.
    The clock of the device is `stamp_offset` (s) + `stamp_drift` (s/s) t ahead and stamps with N(0, `stamp_jitter`); the moment of
    arrival is that of the vehicle's computer, whose clock is right.
    The reference point lies at `lever_arm_b` (m) from the body origin; `mounting_bs` holds roll, pitch and heading (rad) of the
    sensor axes against the body: v_b = R_bs v_s.  Raises InputError for an offset below 0: before its start the dive is not known.
    """

    rate: float
    offset: float = 0.0
    stop: float = np.inf
    jitter: float = 0.0
    latency: float = 0.0
    latency_jitter: float = 0.0
    loss: float = 0.0
    stamp_offset: float = 0.0
    stamp_drift: float = 0.0
    stamp_jitter: float = 0.0
    lever_arm_b: Vector = ZERO
    mounting_bs: Vector = ZERO

    def __post_init__(self) -> None:
        """Refuse to begin before the dive does."""
        if self.offset < 0.0:
            raise InputError(type(self).__name__, f"begins at {self.offset:g} s", "an offset of 0 s or more")

    @property
    def rotation_bs(self) -> Array:
        """Rotation (3, 3) from sensor to body axes."""
        return matrix_from_euler(*self.mounting_bs)

    def sampling(self, duration: float, generator: Generator) -> Array:
        """Return the moments (s) at which the instrument looks."""
        count = int(np.floor((min(self.stop, duration) - self.offset) * self.rate + 1e-6)) + 1
        time = self.offset + np.arange(max(count, 0)) / self.rate
        return np.asarray(time + np.clip(self.jitter * generator.standard_normal(len(time)), -0.4 / self.rate, 0.4 / self.rate))

    def going_on(self, moments: Array) -> Self:  # noqa: ARG002  (most remember nothing)
        """Return the instrument as it goes on after looks at earlier `moments` (s) of the dive, of which it may be shown the next piece."""
        return self

    def among(self, surroundings: Callable[[Surrounding], Surrounding]) -> Self:
        """Return the instrument in the sea of one run: whatever of its surroundings is drawn anew for each seed, is drawn."""
        own: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        moved: dict[str, Any] = {n: surroundings(v) for n, v in own.items() if isinstance(v, Surrounding) and v.drift != STEADY}
        return replace(self, **moved) if moved else self

    @abstractmethod
    def ideal(self, trajectory: Trajectory, time: Array) -> T:
        """Return the table without errors of looks at `time` (s)."""

    @abstractmethod
    def noisy(self, table: T, generator: Generator) -> T:
        """Return the table with errors."""

    def record(self, ideal: T, generator: Generator) -> T:
        """Return the table with errors, as it arrives."""
        errors, delivery = generator.spawn(2)
        table = self.shown(self.noisy(ideal, errors))
        if self.latency or self.latency_jitter:
            late = self.latency + np.abs(self.latency_jitter * self.by_look(table, delivery.standard_normal))
            table = replace(table, received=table.time + late)
        kept = self.by_look(table, delivery.random) >= self.loss if self.loss else None
        table = self.stamped(table, generator)
        return table if kept is None else cast("T", table.select(kept))

    def shown(self, table: T) -> T:
        """Return what the device shows of what it measured: by default all of it."""
        return table

    def by_look(self, table: T, draw: Callable[[int], Array]) -> Array:
        """Return a number (rows,) drawn for each look, of which rows that come together share one; by default each row is a look."""
        return draw(len(table))

    def stamped(self, table: T, generator: Generator) -> T:
        """Return the table with the stamps of the device's clock; what is not late is received at the true moment."""
        if not (self.stamp_offset or self.stamp_drift or self.stamp_jitter):
            return table
        white = self.by_look(table, generator.spawn(1)[0].standard_normal)
        stamp = table.time + self.stamp_offset + self.stamp_drift * table.time + self.stamp_jitter * white
        return replace(table, time=stamp, device_time=stamp, received=table.time if table.received is None else table.received)


@dataclass(frozen=True, kw_only=True)
class Digital(Instrument[T]):
    """An instrument that shows whole multiples of `quantum`, and nothing beyond `limit`, both in the unit of what it measures.

    Beyond its limit an instrument sticks at +-limit, or, one that listens for something (`silent`), shows nothing: nan.
    """

    measured: ClassVar[tuple[str, ...]] = ()  # columns that are
    silent: ClassVar[bool] = False
    quantum: float = 0.0
    limit: float = np.inf

    def shown(self, table: T) -> T:
        """Return what the device shows of what it measured."""
        if not self.quantum and self.limit == np.inf:
            return table
        there = (name for name in self.measured if getattr(table, name) is not None)
        columns: dict[str, Any] = {name: self.digits(getattr(table, name)) for name in there}
        return replace(table, **columns)

    def digits(self, value: Array) -> Array:
        """Return values within the limit, in whole quanta."""
        return digits(value, self.quantum, self.limit, silent=self.silent)


def digits(value: Array, quantum: float, limit: float, *, silent: bool = False) -> Array:
    """Return values in whole multiples of `quantum` (0: as they are) within +-limit: held there, or if `silent` nan beyond."""
    within = np.where(np.abs(value) <= limit, value, np.nan) if silent else np.clip(value, -limit, limit)
    return np.asarray(quantum * np.round(within / quantum) if quantum else within)
