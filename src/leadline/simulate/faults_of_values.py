"""Faults of what is measured: biases and scales that jump, values that drift, stick, are drawn away or noisy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.core.attitude import wrapped
from leadline.data import records
from leadline.simulate.faults import STAMPS, OfSpan, marked, moved
from leadline.simulate.faults_of_echoes import lengthened, times

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.random import Generator

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.simulate.faults import Flags

PASCALS_PER_METRE = 1025.0 * 9.81  # of sea water, for the pressure that a metre of depth makes

# What noise can be added to: columns by quantity and kind of table; of acoustic ranges and positions no column is named.
COLUMNS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "distance": {
        "depth": ("depth",), "altimeter": ("range",), "dvl": ("altitude", "range"), "water_velocity": ("altitude", "range"),
        "acoustic_range": (), "usbl": (), "gnss": (), "position_fix": (),
    },
    "speed": {"dvl": ("velocity", "beam"), "water_velocity": ("velocity", "beam"), "speed": ("speed",)},
    "angle": {
        "heading": ("heading",), "attitude": ("roll", "pitch", "heading"), "usbl": ("azimuth", "elevation"),
        "acoustic_bearing": ("azimuth", "elevation"),
    },
    "rate": {"imu": ("gyro", "delta_angle"), "yaw_rate": ("yaw_rate",)},
    "force": {"imu": ("accel", "delta_velocity")},
    "pressure": {"pressure": ("pressure",)},
}  # fmt: skip
INCREMENTS = frozenset({"delta_angle", "delta_velocity"})


@dataclass(frozen=True, kw_only=True)
class OfAxis(OfSpan):
    """A bias of one axis (0, 1, 2: x, y, z of the sensor) that appears; of increments it is times their interval."""

    size: float
    axis: int = 2

    def pushed(self, table: records.Imu, mean: str, increment: str) -> records.Imu:
        """Return an inertial table with the bias in two of its columns, where it has them."""
        if self.axis not in (0, 1, 2):
            raise self.refused(f"has axis {self.axis}", "0, 1 or 2")
        push = np.zeros((len(table), 3))
        push[self.inside(table.time), self.axis] = self.size
        columns: dict[str, Any] = {}
        for name, bias in ((mean, push), (increment, None if table.interval is None else push * table.interval[:, None])):
            values = getattr(table, name)
            if values is not None and bias is not None:
                columns[name] = values + bias
        return replace(table, **columns)


@dataclass(frozen=True, kw_only=True)
class GyroBiasJump(OfAxis):
    """A gyro whose bias jumps by `size` (rad/s): of an inertial unit about one axis, or of a single gyro, whose axis is z."""

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with biased rates."""
        if isinstance(table, records.Imu):
            return self.pushed(table, "gyro", "delta_angle")
        if not isinstance(table, records.YawRate) or self.axis != 2:
            raise self.refused(f"its table is of kind {table.kind}, its axis is {self.axis}", "an inertial unit, or a yaw_rate about z (2)")
        return replace(table, yaw_rate=table.yaw_rate + self.size * self.inside(table.time))


@dataclass(frozen=True, kw_only=True)
class AccelBiasJump(OfAxis):
    """An accelerometer of an inertial unit whose bias jumps by `size` (m/s^2)."""

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with biased specific forces."""
        if not isinstance(table, records.Imu):
            raise self.refused(f"its table is of kind {table.kind}", "an inertial unit")
        return self.pushed(table, "accel", "delta_velocity")


@dataclass(frozen=True, kw_only=True)
class DepthDrift(OfSpan):
    """A depth or pressure sensor that reads deeper by step + rate (t - begin), m and m/s, while the fault lasts.

    Pressures (Pa) are off by 1025 kg/m^3 times 9.81 m/s^2 times that.
    """

    step: float = 0.0
    rate: float = 0.0

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with readings off."""
        if self.rate and not np.isfinite(self.begin):
            raise self.refused("drifts since ever", "give begin")
        if not isinstance(table, records.Depth | records.Pressure):
            raise self.refused(f"its table is of kind {table.kind}", "a sensor of kind depth or pressure")
        rows = self.inside(table.time)
        off = np.zeros(len(table))
        off[rows] = self.step + (self.rate * (table.time[rows] - self.begin) if self.rate else 0.0)
        if isinstance(table, records.Depth):
            return replace(table, depth=table.depth + off)
        return replace(table, pressure=table.pressure + PASCALS_PER_METRE * off)


@dataclass(frozen=True, kw_only=True)
class TideJump(OfSpan):
    """A sea surface that stands `size` (m) higher for a while: all depths and pressures of the log grow, altitudes and heights do not.

    `sensor` is one of those that it befalls, and names it.
    """

    size: float

    def apply(self, log: Log, generator: Generator) -> Log:
        """Return the log with the tables of all depth and pressure sensors changed."""
        tables = {**log.tables, self.sensor: self.changed(log[self.sensor], generator)}
        others = [n for n, t in log.tables.items() if isinstance(t, records.Depth | records.Pressure) and n != self.sensor]
        return replace(log, tables=tables | {name: self.changed(log[name], generator) for name in others})

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table of one sensor with readings off."""
        return DepthDrift(sensor=self.sensor, begin=self.begin, end=self.end, step=self.size).changed(table, generator)


@dataclass(frozen=True, kw_only=True)
class FixJump(OfSpan):
    """Positions that are all off by jump_n + drag_n (t - begin): a reflected signal, or one that somebody sends to lead the vehicle astray.

    jump_n (m) and drag_n (m/s) are north and east.  Column `outlier` marks them, for assessment.
    """

    jump_n: tuple[float, float] = (0.0, 0.0)
    drag_n: tuple[float, float] = (0.0, 0.0)

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with positions displaced."""
        if not isinstance(table, records.PositionFix | records.Gnss):
            raise self.refused(f"its table is of kind {table.kind}", "a sensor of kind position_fix or gnss")
        if any(self.drag_n) and not np.isfinite(self.begin):
            raise self.refused("drags since ever", "give begin")
        rows = self.inside(table.time)
        error = np.zeros((len(table), 3))
        error[rows, :2] = self.jump_n
        if any(self.drag_n):
            error[rows, :2] += (table.time[rows] - self.begin)[:, None] * np.asarray(self.drag_n)
        return replace(table, **moved(table, error), extra=marked(table, rows))


@dataclass(frozen=True, kw_only=True)
class ScaleJump(OfSpan):
    """A Doppler log, or a log of speed, whose velocities become (1 + scale) times what they were; ranges and altitudes do not."""

    scale: float

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with scaled velocities."""
        if table.kind not in COLUMNS["speed"]:
            raise self.refused(f"its table is of kind {table.kind}", f"a sensor of kind {', '.join(COLUMNS['speed'])}")
        rows = self.inside(table.time)
        columns: dict[str, Any] = {name: times(getattr(table, name), rows, 1.0 + self.scale) for name in COLUMNS["speed"][table.kind]}
        return replace(table, **columns)


@dataclass(frozen=True, kw_only=True)
class StuckValue(OfSpan):
    """A sensor that repeats the last good row before the fault, or where there is none the first one in it; only its stamps go on.

    Good is a row that is valid and not empty.  Of several beacons, platforms or beams in one table each repeats its own.
    """

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with rows that hold what others held."""
        columns = [
            c.name for c in table.columns() if c.name not in (STAMPS - {"valid"}) | {"interval"} and getattr(table, c.name) is not None
        ]
        index, good = np.arange(len(table)), filled(table)
        for rows in sources(table):
            known = rows[good[rows]]
            before = known[table.time[known] < self.begin]
            held = before[-1:] if len(before) else known[self.inside(table.time[known])][:1]
            if len(held):
                stuck = rows[self.inside(table.time[rows]) & (table.time[rows] >= table.time[held])]
                index[stuck] = held
        held_columns: dict[str, Any] = {name: getattr(table, name)[index] for name in columns}
        return replace(table, **held_columns, extra={name: values[index] for name, values in table.extra.items()})


def filled(table: Table) -> Flags:
    """Return which rows are valid and hold a number at all."""
    good = np.ones(len(table), np.bool_) if table.valid is None else table.valid != 0.0
    names = [c.name for c in table.columns() if c.name not in STAMPS and not c.metadata["text"]]
    values = [v for name in names if (v := getattr(table, name)) is not None]
    values += [cast("Array", v) for v in table.extra.values() if v.dtype.kind == "f"]
    return np.asarray(good & np.any([np.isfinite(v).any(axis=tuple(range(1, v.ndim))) for v in values], axis=0))


def sources(table: Table) -> Iterator[Any]:
    """Yield the rows of each beacon, platform or beam of a table, or all of it, in order of time."""
    order = np.argsort(table.time, kind="stable")
    names = ("transmitter", "receiver", "name", "source", "peak", *(() if isinstance(table, records.Dvl) else ("beam",)))
    labels = [v for name in names if (v := getattr(table, name, None)) is not None]
    if not labels:
        yield order
        return
    key = np.zeros(len(table), np.intp)
    for label in labels:
        own = np.unique(label, return_inverse=True)[1]
        key = key * (len(table) + 1) + own
        key = np.unique(key, return_inverse=True)[1]
    for source in np.unique(key):
        yield order[key[order] == source]


@dataclass(frozen=True, kw_only=True)
class NoiseBurst(OfSpan):
    """A sensor with white noise of `sigma` on top of what it has, on each number of a `quantity` that it measures.

    quantity: distance (m), speed (m/s), angle (rad), rate (rad/s), force (m/s^2), pressure (Pa).  Increments get sigma times their
    interval; positions north and east each; acoustic ranges with the moments at which they arrive.
    """

    sigma: float
    quantity: str
    sound_speed: float = 1500.0

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with more noise."""
        if self.quantity not in COLUMNS or table.kind not in COLUMNS[self.quantity]:
            known = [name for name, kinds in COLUMNS.items() if table.kind in kinds]
            raise self.refused(f"has a table of kind {table.kind} without a {self.quantity}", f"it has: {', '.join(known) or 'none'}")
        if not 0.0 <= self.sigma < np.inf:
            raise self.refused(f"has sigma {self.sigma}", "0 or more")
        rows = self.inside(table.time)
        if self.quantity == "distance" and isinstance(table, records.AcousticRange):
            return replace(table, **lengthened(table, self.drawn((len(table),), rows, generator), self.sound_speed))
        if self.quantity == "distance" and isinstance(table, records.Gnss | records.PositionFix):
            return replace(table, **moved(table, self.drawn((len(table), 3), rows, generator) * (1.0, 1.0, 0.0)))
        columns: dict[str, Any] = {}
        for name in COLUMNS[self.quantity][table.kind]:
            values: Array | None = getattr(table, name)
            interval: Array | None = getattr(table, "interval", None)
            if values is None or (name in INCREMENTS and interval is None):
                continue
            error = self.drawn(values.shape, rows, generator)
            if name in INCREMENTS:
                error = error * cast("Array", interval)[:, None]
            columns[name] = turned_by(name, values, error) if self.quantity == "angle" else values + error
        return replace(table, **columns)

    def drawn(self, shape: tuple[int, ...], rows: Flags, generator: Generator) -> Array:
        """Return noise in some rows, and zeros; what is drawn does not depend on which."""
        return np.asarray(self.sigma * generator.standard_normal(shape) * rows.reshape(-1, *[1] * (len(shape) - 1)))


def turned_by(name: str, angle: Array, error: Array) -> Array:
    """Return angles (rad) of a column with an error: headings in [0, 2 pi), roll and azimuth in [-pi, pi); without one they keep bits."""
    off = angle + error
    if name == "heading":
        off = off % (2 * np.pi)
    elif name in ("roll", "azimuth"):
        off = wrapped(off)
    return np.where(error == 0.0, angle, off)
