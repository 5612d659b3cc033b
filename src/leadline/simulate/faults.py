"""What goes wrong at sea: faults as values that turn the log of a healthy vehicle into that of a troubled one.

`apply(log, generator)` makes new tables and leaves the caller's alone; what is drawn comes from the generator only, so that a seed and a
fault make one log.  `troubled` applies several, each from a stream of its own.  Here stand the faults of rows: that they are lost, late,
empty, twice, stamped wrongly; faults of what is measured are in faults_of_values.py, those of sound in faults_of_echoes.py.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.dive import stream
from leadline.simulate.positions import displaced

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy.typing as npt
    from numpy.random import Generator

    from leadline.data.log import Log
    from leadline.data.records import Array, Table

    Flags = npt.NDArray[np.bool_]

STAMPS = frozenset({"time", "received", "device_time", "sequence", "valid", "transmit", "ping"})


class Fault(Protocol):
    """Anything that changes a log, reproducibly."""

    @property
    def sensor(self) -> str:
        """The sensor instance that it befalls."""
        ...

    def apply(self, log: Log, generator: Generator) -> Log:
        """Return the log as the fault leaves it; the caller's log stays as it is."""
        ...


def troubled(log: Log, faults: Iterable[Fault], seed: int) -> Log:
    """Return a log after all `faults`, in their order; each draws from the stream of its kind, its sensor, and its number among such."""
    seen: Counter[str] = Counter()
    for fault in faults:
        name = f"fault/{type(fault).__name__}/{fault.sensor}"
        log = fault.apply(log, stream(seed, f"{name}/{seen[name]}"))
        seen[name] += 1
    return log


@dataclass(frozen=True, kw_only=True)
class OfSensor(ABC):
    """A fault of one table.  Raises InputError where the log has no such table, or where its kind cannot have the fault."""

    sensor: str

    def apply(self, log: Log, generator: Generator) -> Log:
        """Return the log with another table in the place of the sensor's."""
        return replace(log, tables={**log.tables, self.sensor: self.changed(log[self.sensor], generator)})

    @abstractmethod
    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table as the fault leaves it."""

    def refused(self, found: str, right: str) -> InputError:
        """Return the error that names this fault."""
        return InputError(f"{type(self).__name__}({self.sensor})", found, right)


@dataclass(frozen=True, kw_only=True)
class OfSpan(OfSensor):
    """A fault that lasts from `begin` up to, not including, `end` (s, times of validity); for ever unless told."""

    begin: float = -np.inf
    end: float = np.inf

    def __post_init__(self) -> None:
        """Refuse a span that ends before it begins."""
        if not self.begin < self.end:
            raise self.refused(f"lasts from {self.begin} to {self.end} s", "an end after the beginning")

    def inside(self, time: Array) -> Flags:
        """Return which times lie in the span."""
        return np.asarray((self.begin <= time) & (time < self.end))


@dataclass(frozen=True, kw_only=True)
class OfSome(OfSpan):
    """A fault that befalls each row of its span with probability `fraction`, independently."""

    fraction: float

    def __post_init__(self) -> None:
        """Refuse what is no probability."""
        super().__post_init__()
        if not 0.0 <= self.fraction <= 1.0:
            raise self.refused(f"befalls {self.fraction} of the rows", "a fraction from 0 to 1")

    def chosen(self, table: Table, generator: Generator) -> Flags:
        """Return which rows it befalls."""
        return np.asarray((generator.random(len(table)) < self.fraction) & self.inside(table.time))


@dataclass(frozen=True, kw_only=True)
class LateDelivery(OfSpan):
    """Rows arrive later than they are valid: received = time + U(low, high) (s).  Equal bounds delay all alike, so that none overtakes."""

    low: float = 2.0
    high: float = 8.0

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with later arrivals; rows outside the span keep theirs, or arrive when they are valid."""
        if not 0.0 <= self.low <= self.high:
            raise self.refused(f"delays by {self.low} to {self.high} s", "0 <= low <= high")
        delay = generator.uniform(self.low, self.high, len(table))
        return replace(table, received=np.where(self.inside(table.time), table.time + delay, arrival(table)))


@dataclass(frozen=True, kw_only=True)
class WildFixes(OfSome):
    """Positions that are off by U(low, high) m in any level direction, beside the noise that they have; column `outlier` marks them.

    `outlier` is for assessment: no estimator reads it.
    """

    low: float
    high: float

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with some positions displaced."""
        if not isinstance(table, records.PositionFix | records.Gnss):
            raise self.refused(f"its table is of kind {table.kind}", "a sensor of kind position_fix or gnss")
        wild = self.chosen(table, generator)
        size, bearing = generator.uniform(self.low, self.high, len(table)) * wild, generator.uniform(0.0, 2 * np.pi, len(table))
        error = np.stack([size * np.cos(bearing), size * np.sin(bearing), 0.0 * size], axis=1)
        return replace(table, **moved(table, error), extra=marked(table, wild))


def marked(table: Table, wrong: Flags) -> dict[str, Any]:
    """Return the further columns of a table with `outlier` set for the rows that are wrong, beside those that it marks already."""
    before = table.extra.get("outlier")
    return {**table.extra, "outlier": wrong.astype(float) if before is None else np.maximum(wrong, cast("Array", before))}


def moved(table: records.PositionFix | records.Gnss, error: Array) -> dict[str, Any]:
    """Return the position columns of a table moved by `error` (rows, 3) m, north-east-down."""
    if table.latitude is not None and table.longitude is not None:
        latitude, longitude, _ = displaced(table.latitude, table.longitude, np.zeros(len(table)), error)
        off = np.any(error != 0.0, axis=1)  # the others keep their bits
        return {"latitude": np.where(off, latitude, table.latitude), "longitude": np.where(off, longitude, table.longitude)}
    assert isinstance(table, records.PositionFix)
    return {"north": cast("Array", table.north) + error[:, 0], "east": cast("Array", table.east) + error[:, 1]}


@dataclass(frozen=True, kw_only=True)
class Outage(OfSpan):
    """A sensor that measures nothing for a while.  `rows`: "invalid" (they come, valid = 0 and empty) or "absent" (they do not come).

    With no `end` it died for good.
    """

    rows: str = "invalid"

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with the outage in it."""
        lost = self.inside(table.time)
        if self.rows == "absent":
            return table.select(~lost)
        if self.rows != "invalid":
            raise self.refused(f"has rows '{self.rows}'", "invalid or absent")
        valid = np.ones(len(table)) if table.valid is None else table.valid
        return replace(emptied(table, lost), valid=np.where(lost, 0.0, valid))


@dataclass(frozen=True, kw_only=True)
class EmptyRows(OfSome):
    """Rows that hold nan, without a word of the sensor that they are not valid."""

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with nan in some rows."""
        return emptied(table, self.chosen(table, generator))


def emptied(table: Table, rows: Flags) -> Table:
    """Return a table with nan in all that it measured in some rows; when they came and whether they are valid it still says."""
    columns: dict[str, Any] = {}
    for name in (c.name for c in table.columns() if c.name not in STAMPS and not c.metadata["text"]):
        values = getattr(table, name)
        if values is not None:
            columns[name] = np.where(rows.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)
    return replace(table, **columns)


@dataclass(frozen=True, kw_only=True)
class Loss(OfSome):
    """Rows that never arrive."""

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table without some rows."""
        return table.select(~self.chosen(table, generator))


@dataclass(frozen=True, kw_only=True)
class Repeats(OfSome):
    """Rows that are written twice, each beside its twin and equal in all columns."""

    def changed(self, table: Table, generator: Generator) -> Table:
        """Return the table with some rows twice."""
        return table.select(np.repeat(np.arange(len(table)), 1 + self.chosen(table, generator)))


@dataclass(frozen=True, kw_only=True)
class BeamsFailing(OfSensor):
    """Beams of a Doppler log that fail one after the other: beam k is not valid and empty from times[k] (s) on; inf: it lives.

    The row is not valid once no beam is left.  A log of three and more velocities along beams is needed: a solved vector knows no beam.
    """

    times: tuple[float, ...]

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with dead beams."""
        if not isinstance(table, records.Dvl) or table.beam is None or table.velocity is not None:
            raise self.refused(f"its table is of kind {table.kind}, or has velocities", "a Doppler log with beams alone")
        count = table.beam.shape[1]
        if len(self.times) != count:
            raise self.refused(f"has {len(self.times)} times", f"one for each of {count} beams")
        alive = table.time[:, None] < np.asarray(self.times)
        heard = np.ones(alive.shape) if table.beam_valid is None else table.beam_valid
        heard = np.where(alive, heard, 0.0)
        valid = np.ones(len(table)) if table.valid is None else table.valid
        return replace(
            table, beam=np.where(alive, table.beam, np.nan), beam_valid=heard, valid=np.where(np.any(heard > 0, axis=1), valid, 0.0)
        )


@dataclass(frozen=True, kw_only=True)
class CompassSwinging(OfSpan):
    """A heading that is off and swings to and fro: + step + amplitude sin(2 pi (t - begin) / period), rad, while the fault lasts."""

    amplitude: float = 0.0
    period: float = 60.0
    step: float = 0.0

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with headings off."""
        if not isinstance(table, records.Heading | records.Attitude) or table.heading is None:
            raise self.refused(f"its table is of kind {table.kind}", "a sensor with headings")
        if self.amplitude and not np.isfinite(self.begin):
            raise self.refused("swings since ever", "give begin")
        if not (self.period > 0.0 and np.isfinite(self.step)):
            raise self.refused(f"steps by {self.step} rad and swings in {self.period} s", "a finite step, and a period above 0")
        rows = self.inside(table.time)
        since = table.time[rows] - self.begin if self.amplitude else np.zeros(np.count_nonzero(rows))
        swing = self.step + self.amplitude * np.sin(2 * np.pi / self.period * since)
        heading = np.array(table.heading)
        heading[rows] = (heading[rows] + swing) % (2 * np.pi)
        return replace(table, heading=heading)


@dataclass(frozen=True, kw_only=True)
class ClockJump(OfSpan):
    """A device clock that is off by `step` (s; negative: set back) from `begin` on, until somebody sets it right at `end`, if ever.

    Begin and end are true times.  The stamps `time` (and `device_time`, where there is one) of what is measured meanwhile are wrong; what
    was measured, `sequence`, and `received` by the vehicle's own clock go on.  So in the order of arrival a clock that is set back steps
    back at once, one that is set ahead does when it is set right.  Rows keep their order; `sequence` is counted where there is none.
    """

    step: float

    def changed(self, table: Table, generator: Generator) -> Table:  # noqa: ARG002  (draws nothing)
        """Return the table with wrong stamps."""
        if not np.isfinite(self.step):
            raise self.refused(f"steps by {self.step} s", "a finite step")
        off = self.inside(table.time) * self.step
        came = arrival(table)
        count = np.argsort(np.argsort(came, kind="stable"), kind="stable").astype(float)
        sequence = count if table.sequence is None else table.sequence
        device = None if table.device_time is None else table.device_time + off
        return replace(table, time=table.time + off, received=came, sequence=sequence, device_time=device)


def arrival(table: Table) -> Array:
    """Return when each row arrived (rows,): `received`, or where nobody noted it, at the moment at which it is valid."""
    return table.time if table.received is None else np.where(np.isfinite(table.received), table.received, table.time)
