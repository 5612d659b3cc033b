"""Events: tables become one stream in order of time, offline all at once and live row by row, with the same result.

At one instant the order is: measurements, clones, outputs, the next input; within it by channel, then by content, never by arrival.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import blake2b
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.records import after
from leadline.estimate.plan import IS_CLONE, IS_DROP, IS_INPUT, IS_OUTPUT
from leadline.models.sensor import Reading, Rows

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from leadline.data.records import Array, Table
    from leadline.models.sensor import Sensor

Integers = npt.NDArray[np.int64]
RECENT = 10  # rows that a time is held against
REMEMBERED, DIGEST = 10_000, 16  # rows that a row is held against, and bytes kept of each
RANK = {IS_CLONE: 1, IS_DROP: 2, IS_OUTPUT: 3, IS_INPUT: 4}  # measurements: 0


class Event(NamedTuple):
    """One event of the live stream; its order is the order of the stream.  Rows that are equal in all else are interchangeable."""

    time: float
    rank: int
    kind: int
    data: tuple[float, ...] = ()
    sensor: str = ""
    row: int = -1


@dataclass(frozen=True)
class Batch:
    """Events of one kind: time (k,), data (k, row_length), and the table rows that they come from (k,)."""

    kind: int
    time: Array
    data: Array
    sensor: str = ""
    row: Integers = field(default_factory=lambda: np.zeros(0, np.int64))

    def __iter__(self) -> Iterator[Event]:
        """Iterate over the single events."""
        rank = RANK.get(self.kind, 0)
        rows = self.row if len(self.row) else np.full(len(self.time), -1)
        for time, data, row in zip(self.time, self.data, rows, strict=True):
            yield Event(float(time), rank, self.kind, tuple(data.tolist()), self.sensor, int(row))


@dataclass(frozen=True)
class Events:
    """A stream in the form that the loop consumes; `row` says which row of its table a measurement comes from."""

    time: Array
    kind: Integers
    start: Integers
    stop: Integers
    data: Array
    index: Integers  # of the result or the output that the event fills
    row: Integers

    def __len__(self) -> int:
        """Return the number of events."""
        return len(self.time)

    @property
    def measured(self) -> npt.NDArray[np.bool_]:
        """Which events are measurements."""
        return self.kind >= 0


def ordered(batches: Sequence[Batch]) -> Events:
    """Put batches into one stream."""
    batches = [batch for batch in batches if len(batch.time)]
    if not batches:
        nothing = np.zeros(0, np.int64)
        return Events(np.zeros(0), nothing, nothing, nothing, np.zeros(0), nothing, nothing)
    length = [batch.data.shape[1] for batch in batches]
    count = [len(batch.time) for batch in batches]
    time = np.concatenate([batch.time for batch in batches])
    kind = np.repeat([batch.kind for batch in batches], count)
    rank = np.repeat([RANK.get(batch.kind, 0) for batch in batches], count)
    source = np.repeat(np.arange(len(batches)), count)
    local = np.concatenate([np.arange(c) for c in count])
    order = np.lexsort((kind, rank, time))
    _break_ties(order, time, rank, kind, lambda e: tuple(batches[source[e]].data[local[e]].tolist()))
    source, local, kind = source[order], local[order], kind[order]
    sizes = np.asarray(length)[source]
    start = np.concatenate([[0], np.cumsum(sizes)])
    data = np.empty(start[-1])
    for i, batch in enumerate(batches):
        mine = np.flatnonzero(source == i)
        data[start[mine][:, None] + np.arange(length[i])] = batch.data[local[mine]]
    row = np.full(len(order), -1)
    for i, batch in enumerate(batches):
        if len(batch.row):
            mine = source == i
            row[mine] = batch.row[local[mine]]
    return Events(time[order], kind, start[:-1], start[1:], data, _indices(kind), row)


def _indices(kind: Integers) -> Integers:
    """Number measurements and outputs, each from zero."""
    index = np.full(len(kind), -1)
    for chosen in (kind >= 0, kind == IS_OUTPUT):
        index[chosen] = np.arange(int(chosen.sum()))
    return index


def _break_ties(order: Integers, time: Array, rank: Integers, kind: Integers, content: object) -> None:
    """Order what is equal in time, rank and kind by content, in place."""
    t, r, k = time[order], rank[order], kind[order]
    same = (np.diff(t) == 0) & (np.diff(r) == 0) & (np.diff(k) == 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    for first, last in edges.reshape(-1, 2):
        order[first : last + 1] = sorted(order[first : last + 1], key=content)  # type: ignore[call-overload]


@dataclass
class Screen:
    """Judges the rows of one sensor by what they say themselves: duplicates, held values, clock jumps.  It remembers earlier rows."""

    repeats: str = "new"
    latency: float = 0.0
    live: bool = False  # more rows may come: any of them can equal one of these
    seen: dict[bytes, None] = field(default_factory=dict)  # digests of rows, in order of arrival
    recent: Array = field(default_factory=lambda: np.full(RECENT, -np.inf))  # times, in order of arrival
    value: bytes = b""

    def judge(self, table: Table) -> Integers:
        """Return the outcome (n,) of each row: USED where nothing speaks against it."""
        outcome = np.full(len(table), int(Outcome.USED))
        if not len(table):
            return outcome
        outcome[self._repeated(table)] = Outcome.DUPLICATE
        outcome[self._jumps(table) & (outcome == Outcome.USED)] = Outcome.CLOCK_JUMP
        if self.repeats == "held":
            outcome[self._held(table) & (outcome == Outcome.USED)] = Outcome.HELD
        return outcome

    def _repeated(self, table: Table) -> npt.NDArray[np.bool_]:
        """Rows that equal an earlier one in all columns; only rows of equal time can."""
        alike = np.ones(len(table), bool) if self.live else _shared(table.time)
        index = np.flatnonzero(alike)
        content = (
            [blake2b(row, digest_size=DIGEST).digest() for row in _row_bytes(table.select(index), with_time=True)] if len(index) else []
        )
        repeated = np.zeros(len(table), bool)
        for i, key in zip(index, content, strict=True):
            repeated[i] = key in self.seen
            self.seen[key] = None
        for key in list(islice(self.seen, max(0, len(self.seen) - REMEMBERED))):
            del self.seen[key]
        return repeated

    def _jumps(self, table: Table) -> npt.NDArray[np.bool_]:
        """Rows that step back in time, in order of arrival, by more than the sensor's latency.

        They are held against the last few rows alone: one stamp far ahead must not condemn all that comes after it.
        """
        arrival = table.received if table.received is not None else table.sequence
        if arrival is None:
            return np.zeros(len(table), bool)
        order = np.argsort(arrival, kind="stable") if len(np.unique(arrival)) == len(arrival) else np.arange(len(arrival))  # or it wraps
        order = order[np.isfinite(arrival[order])]
        if not len(order):
            return np.zeros(len(table), bool)
        time = np.where(np.isfinite(table.time), table.time, -np.inf)[order]
        known = np.concatenate([self.recent, time])
        self.recent = known[-RECENT:]
        newest = sliding_window_view(known[:-1], RECENT).max(axis=1)
        jumped = np.zeros(len(table), bool)
        jumped[order] = time < newest - max(self.latency, 1e-6)
        return jumped

    def _held(self, table: Table) -> npt.NDArray[np.bool_]:
        """Rows whose values equal those of the row before, in order of time."""
        order = np.argsort(table.time, kind="stable")
        values = [bytes(row) for row in _row_bytes(table, with_time=False)[order]]
        held = np.zeros(len(table), bool)
        held[order] = [value == before for value, before in zip(values, [self.value, *values[:-1]], strict=True)]
        self.value = values[-1]
        return held


def _shared(time: Array) -> npt.NDArray[np.bool_]:
    """Which rows share their time with another row."""
    order = np.argsort(time, kind="stable")
    same = np.diff(time[order]) == 0
    shared = np.zeros(len(time), bool)
    shared[order[:-1][same]] = shared[order[1:][same]] = True
    return shared


def _row_bytes(table: Table, *, with_time: bool) -> npt.NDArray[np.void]:
    """Each row's content as bytes (n,), times only if asked for."""
    times = {"time", "received", "device_time", "sequence", "transmit"}
    parts = [getattr(table, c.name) for c in table.columns() if with_time or c.name not in times]
    parts = [part.reshape(len(table), -1) for part in (*parts, *(table.extra.values() if with_time else ())) if part is not None]
    numbers = [part if part.dtype.kind == "U" else part + 0.0 for part in parts]  # -0.0 is 0.0
    joined = np.concatenate([np.ascontiguousarray(part).view(np.uint8).reshape(len(table), -1) for part in numbers], axis=1)
    return joined.view(np.dtype((np.void, joined.shape[1]))).ravel()


def measurements(
    sensor: Sensor,
    first_slot: int,
    table: Table,
    screen: Screen,
    start: float,
    end: float = np.inf,
    oldest: float = -np.inf,
    known: Table | None = None,
) -> tuple[list[Batch], Integers]:
    """Return a sensor's events, and for each table row the outcome of those that give none; rows valid before `oldest` are late.

    known: rows that came before, for a sensor that makes of a row and of those before it what it measures.

    A row of a channel with two epochs brings the clone of its earlier epoch, and the moment at which that is forgotten; the
    earlier epoch becomes the last number of the row.
    """
    outcome = screen.judge(table)
    read = sensor.read(table) if known is None else _last(sensor.read(after(known, table)), len(known))
    latency = sensor.config.latency
    outcome = np.where(outcome == Outcome.USED, read.outcome, outcome)
    time = table.time - latency
    outcome[(outcome == Outcome.USED) & ~np.isfinite(time)] = Outcome.INVALID
    outcome[(outcome == Outcome.USED) & ((time < start) | (time > end))] = Outcome.OUTSIDE_RUN
    outcome[(outcome == Outcome.USED) & (time < oldest)] = Outcome.LATE
    batches: list[Batch] = []
    for rows in read.rows:
        asked, found = sensor.channels[rows.channel].row_length, rows.data.shape[1]
        if found != asked:  # a kernel would read on into the next row
            raise InputError(f"sensors.{sensor.config.name}", f"makes rows of {found} numbers", f"its channel has row_length {asked}")
        keep = outcome[rows.row] == Outcome.USED
        index, data = rows.row[keep], rows.data[keep]
        if rows.earlier is not None and len(index):
            earlier = rows.earlier[keep] - latency
            batches += _clones(earlier, time[index], sensor.flight, start)
            data = np.column_stack([data, earlier])
        batches.append(Batch(first_slot + rows.channel, time[index], data, sensor.config.name, index))
    if sensor.feed is not None:
        batches.append(_fed(sensor, table, time, outcome, start))
    return batches, outcome


def _fed(sensor: Sensor, table: Table, time: Array, outcome: Integers, start: float) -> Batch:
    """The rows of a sensor that are input; one from before the start acts until the next, and where it is input alone it is used."""
    assert sensor.feed is not None
    data = np.asarray(sensor.feed(table), float)
    before = (outcome == Outcome.OUTSIDE_RUN) & (time < start)
    index = np.flatnonzero(np.isfinite(data).any(axis=1) & ((outcome == Outcome.USED) | before))
    if not sensor.channels:
        outcome[before] = Outcome.USED
    return Batch(IS_INPUT, time[index], np.ascontiguousarray(data[index]), sensor.config.name, index)


def _last(read: Reading, first: int) -> Reading:
    """What a reading says of the rows from `first` on, numbered from zero."""
    parts = []
    for rows in read.rows:
        keep = rows.row >= first
        earlier = None if rows.earlier is None else rows.earlier[keep]
        parts.append(Rows(rows.channel, rows.row[keep] - first, rows.data[keep], earlier))
    return Reading(tuple(parts), read.outcome[first:])


def agreed(batches: Sequence[Batch]) -> list[Batch]:
    """Agree the clones that several sensors ask for: one per epoch, forgotten after the last row of any that looks at it."""
    drops = [batch for batch in batches if batch.kind == IS_DROP]
    others = [batch for batch in batches if batch.kind not in (IS_CLONE, IS_DROP)]
    if not drops:
        return others
    epochs, which = np.unique(np.concatenate([batch.data[:, 0] for batch in drops]), return_inverse=True)
    last = np.full(len(epochs), -np.inf)
    np.maximum.at(last, which, np.concatenate([batch.time for batch in drops]))
    return [*others, Batch(IS_CLONE, epochs, np.zeros((len(epochs), 0))), Batch(IS_DROP, last, epochs[:, None])]


def _clones(earlier: Array, time: Array, flight: float, start: float) -> list[Batch]:
    """Events that make the clone of each distinct earlier epoch, and forget it once the last row that looks at it is through.

    An epoch before the start cannot be had, one that lies longer back than a flight is not awaited: such a row finds no clone.
    """
    had = (earlier >= start) & (time - earlier <= flight) & (earlier < time)
    epochs, which = np.unique(earlier[had], return_inverse=True)
    last = np.full(len(epochs), -np.inf)
    np.maximum.at(last, which, time[had])
    return [Batch(IS_CLONE, epochs, np.zeros((len(epochs), 0))), Batch(IS_DROP, last, epochs[:, None])]
