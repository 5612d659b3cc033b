"""The stream of a log: its rows as events in order of time, handed on in stretches so that a day fits into memory."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.records import Imu
from leadline.data.rows import complete
from leadline.estimate import plan as at
from leadline.estimate.clocks import Clock
from leadline.estimate.events import Batch, Screen, agreed, measurements, ordered
from leadline.estimate.inputs import Conditioned, Inputs, Made, Span, spans_of
from leadline.models.imu import INPUT_SIZE, InputStream

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.estimate.events import Events, Integers
    from leadline.estimate.navigator import Navigator

DEFAULT_RATE = 10.0
MOST_STATES = 3_000_000
STRETCH = 60.0  # s of events that are put in order at a time
ALONE = 60.0  # s
NONE_MADE = Made(np.zeros(0), np.zeros((0, INPUT_SIZE)))
LONGEST_INTERVAL = 600.0  # s: an input in force at the start began no longer ago


@dataclass(frozen=True)
class Stream:
    """The events of a log by kind, each in order of time, and for each table the outcome of the rows that gave none (USED: it gave some).

    inputs: of the process model, from `first_input` on.  times: of the outputs.  spans: where the first inertial unit was silent.
    clocks: of the stamps, by sensor, as the whole log leaves them.
    """

    batches: Sequence[Batch]
    inputs: Made | Conditioned
    first_input: float
    outcome: Mapping[str, Integers]
    times: Array
    start: float
    end: float
    spans: tuple[Span, ...] = ()
    clocks: Mapping[str, Clock] = field(default_factory=dict)

    @cached_property
    def events(self) -> Events:
        """All events at once."""
        return self.stretch(-np.inf, np.inf)

    @property
    def edges(self) -> Array:
        """The moments (s) at which one stretch ends and the next begins."""
        count = max(1, int(np.ceil((self.end - self.start) / STRETCH)))
        inner = self.start + STRETCH * np.arange(1, count)
        return np.concatenate([[-np.inf], inner, [np.inf]])

    def stretch(self, first: float, last: float) -> Events:
        """Return the events at first <= time < last; their measurements and outputs are numbered from zero."""
        found = [Batch(at.IS_INPUT, *self.inputs.between(max(first, self.first_input), min(last, self.end)))]
        for batch in self.batches:
            a, b = np.searchsorted(batch.time, [first, last], side="left")
            if b > a:
                found.append(replace(batch, time=batch.time[a:b], data=batch.data[a:b], row=batch.row[a:b]))
        return ordered(found)

    def __iter__(self) -> Iterator[Events]:
        """Iterate over the stretches."""
        return (self.stretch(a, b) for a, b in pairwise(self.edges))


def stream_of(
    log: Log, vehicle: Vehicle, navigator: Navigator, *, rate: float = DEFAULT_RATE, times: Array | None = None, end: float | None = None
) -> Stream:
    """Build the stream of a log for a navigator at its start.

    Raises InputError where the log has no input that covers the run, and where a moment lies outside it.
    """
    start = navigator.start
    inputs, outcome, covered, spans, clocks = inputs_of(log, vehicle, navigator)
    what = "the last row" if navigator.inputs is None else "the last inertial row"
    if end is not None and end > covered:
        raise InputError("end", f"{end} s lies after {what}", f"at most {covered} s")
    last = covered if end is None else end
    if last <= start:
        where = f"{log.path or log.name}: [initial] time_s"
        raise InputError(where, f"{start} lies after {what} at {last}", "start earlier")
    before = inputs.between(start - LONGEST_INTERVAL, start)[0]
    first_input = float(before[-1]) if len(before) else start
    spans = tuple(replace(s, start=max(s.start, start), end=min(s.end, last)) for s in spans if s.end > start and s.start < last)
    batches: list[Batch] = []
    for sensor in navigator.composition.sensors:
        name = sensor.config.name
        screen, slot = Screen(sensor.config.repeats, sensor.config.latency), navigator.composition.first_slot[name]
        clocks[name] = Clock(sensor.config.mend_clock)
        table, aside = clocks[name].take(log[name])
        found, outcome[name] = measurements(sensor, slot, table, screen, start, last)
        outcome[name][aside] = int(Outcome.CLOCK_JUMP)
        batches += found if vehicle.process.sync is None else at_ticks(found, vehicle.process.sync, last, outcome[name])
    moments = output_times(start, last, rate) if times is None else np.sort(np.asarray(times, float))
    if not len(moments) or not (moments[0] >= start and moments[-1] <= last):
        found_times = f"{moments[0]} to {moments[-1]} s" if len(moments) else "none"
        raise InputError("times", found_times, f"the run is from {start} to {last} s")
    batches.append(Batch(at.IS_OUTPUT, moments, np.zeros((len(moments), 0))))
    return Stream([_sorted(batch) for batch in agreed(batches)], inputs, first_input, outcome, moments, start, last, spans, clocks)


def at_ticks(batches: Sequence[Batch], tick: float, last: float, outcome: Integers) -> list[Batch]:
    """Return the events of a sensor with measurements put off to the next multiple of `tick` (s), the newest of each channel alone.

    What is left out is told in `outcome` (n,), of the table's rows.  Raises InputError for rows that look at an earlier pose as well.
    """
    if any(batch.kind == at.IS_CLONE for batch in batches):
        found = f"{tick} s, with a sensor that looks at an earlier pose"
        raise InputError("process.sync_s", found, "leave that sensor out, or take rows at their times")
    moved, used = [], np.zeros(len(outcome), bool)
    for batch in map(_sorted, batches):
        if batch.kind < 0:
            moved.append(batch)
            used[batch.row] = True
            continue
        when = np.ceil(batch.time / tick - 1e-9) * tick
        newest = (np.append(np.diff(when), 1.0) > 0.0) & (when <= last)
        moved.append(replace(batch, time=when[newest], data=batch.data[newest], row=batch.row[newest]))
        used[batch.row[newest]] = True
    outcome[(outcome == Outcome.USED) & ~used] = int(Outcome.DECIMATED)
    return moved


def _sorted(batch: Batch) -> Batch:
    """A batch in order of time."""
    if not len(batch.time) or (np.diff(batch.time) >= 0.0).all():
        return batch
    order = np.argsort(batch.time, kind="stable")
    row = batch.row[order] if len(batch.row) else batch.row
    return replace(batch, time=batch.time[order], data=batch.data[order], row=row)


class Inertial(NamedTuple):
    """The inputs of the inertial units of a log, with the outcome of each of their rows, by unit.

    covered: the time (s) up to which inputs reach; where no unit drives the process model, up to which rows do.  spans: where the first
    unit was silent.  clocks: of their stamps.
    """

    inputs: Made | Conditioned
    outcome: dict[str, Integers]
    covered: float
    spans: tuple[Span, ...]
    clocks: dict[str, Clock]


class UnitRows(NamedTuple):
    """Rows of an inertial unit in order of time, and their places in the table."""

    table: Imu
    order: Integers
    time: Array  # of all rows of the table, put right
    aside: npt.NDArray[np.bool_]  # which rows of the table (n,) its clock sets aside
    clock: Clock

    def placed(self, outcome: Integers) -> Integers:
        """Return outcomes in the order of the table; rows that were left out are invalid."""
        placed = np.where(self.aside, int(Outcome.CLOCK_JUMP), int(Outcome.INVALID))
        placed[self.order] = outcome
        return placed


def inputs_of(log: Log, vehicle: Vehicle, navigator: Navigator) -> Inertial:
    """Return the inputs of the inertial units of a log, where such drive the process model.

    A last row beyond a gap has no neighbour to confirm its time: it is invalid, or one wrong stamp would lead the run astray.
    """
    if navigator.inputs is None:
        return Inertial(NONE_MADE, {}, _reach(log, navigator), (), {})
    imu, standby = vehicle[vehicle.process.imu], vehicle.process.standby
    if standby is not None and standby in log.tables:
        return _of_two(log, vehicle, Inputs.of(imu, vehicle[standby]), vehicle[standby])
    stream = InputStream.of(imu)
    rows = _imu_rows(log, imu, stream.gap)
    inputs = Conditioned(stream, rows.table)
    spans = tuple(Span("gap", imu.name, a, b) for a, b in inputs.gaps)
    return Inertial(inputs, {imu.name: rows.placed(inputs.outcome)}, inputs.covered, spans, {imu.name: rows.clock})


def _reach(log: Log, navigator: Navigator) -> float:
    """The time (s) of the last row of any sensor, as its clock was put right; one that stands alone beyond a gap does not count."""
    times = [np.zeros(0)]
    for sensor in navigator.composition.sensors:
        if sensor.config.name in log.tables:
            table, aside = Clock(sensor.config.mend_clock).take(log[sensor.config.name])
            times.append((table.time - sensor.config.latency)[~aside])
    known = np.concatenate(times)
    known = np.sort(known[np.isfinite(known)])
    while len(known) > 1 and known[-1] - known[-2] > ALONE:
        known = known[:-1]
    if not len(known):
        raise InputError(f"{log.path or log.name}", "has no row of a sensor that the vehicle file names", "give at least one table")
    return float(known[-1])


def _of_two(log: Log, vehicle: Vehicle, inputs: Inputs, standby: SensorConfig) -> Inertial:
    """The inputs of two units, of which the second fills the silences of the first."""
    assert inputs.second is not None
    imu, second, outcome, clocks = inputs.first, inputs.second, {}, {}
    rows = _imu_rows(log, standby, second.gap)
    outcome[standby.name], clocks[standby.name] = rows.placed(inputs.stand_by(rows.table)), rows.clock
    stamps = rows.time - second.latency
    time, data = np.zeros(0), np.zeros((0, INPUT_SIZE))
    try:
        rows = _imu_rows(log, vehicle[imu.name], imu.gap)
    except InputError:  # it never said anything
        outcome[imu.name] = np.full(len(log.tables.get(imu.name, ())), int(Outcome.INVALID))
    else:
        time, data, found, _ = inputs.push(imu.name, rows.table)
        outcome[imu.name], clocks[imu.name] = rows.placed(found), rows.clock
    if inputs.silent:  # the first unit fell silent for good
        more, filled = inputs.fill(imu.covered if np.isfinite(imu.covered) else inputs.begun, second.covered)
        time, data = np.concatenate([time, more]), np.concatenate([data, filled])
    spans = spans_of(time, data, inputs.covered, (imu.name, standby.name))
    taken = np.zeros(len(stamps), bool)
    for span in spans:
        if span.kind == "standby":
            taken |= (stamps > span.start) & (stamps <= span.end)
    known = np.isin(outcome[standby.name], (Outcome.USED, Outcome.STANDBY))
    outcome[standby.name][known] = np.where(taken[known], int(Outcome.USED), int(Outcome.STANDBY))
    return Inertial(Made(time, data), outcome, inputs.covered, spans, clocks)


def _imu_rows(log: Log, config: SensorConfig, gap: float) -> UnitRows:
    """The rows of an inertial unit in order of time without a last one that stands alone beyond a gap, and what its clock sets aside."""
    name = config.name
    where, clock = f"{log.path or log.name}: {name}", Clock(config.mend_clock)
    if not isinstance(log[name], Imu):
        raise InputError(where, f"is a table of kind '{log[name].kind}'", "process.imu needs kind imu")
    table, aside = clock.take(log[name])
    assert isinstance(table, Imu)
    if len(table) < 2:
        raise InputError(where, f"gives no interval to navigate over: it has {len(table)} rows", "at least two valid rows")
    order = np.argsort(table.time, kind="stable")
    order = order[~aside[order]]
    values = [v for v in (table.gyro, table.accel, table.delta_angle, table.delta_velocity, table.interval) if v is not None]
    good = np.logical_and.reduce([complete(v) for v in (table.time, *values)])
    if table.valid is not None:
        good &= np.nan_to_num(table.valid) != 0
    known = order[good[order]]
    if len(known) < 2:
        raise InputError(where, "gives no interval to navigate over", "at least two valid rows")
    time = table.time[known]
    if len(known) > 2 and time[-1] - time[-2] > gap:
        order = order[order != known[-1]]
    ordered = (np.diff(table.time) >= 0.0).all() and len(order) == len(table)
    return UnitRows(table if ordered else table.select(order), order, table.time, aside, clock)  # type: ignore[arg-type]


def output_times(start: float, last: float, rate: float) -> Array:
    """Return the multiples of the output interval inside the run, and both ends."""
    if not 0.0 < rate < np.inf:
        raise InputError("rate", f"{rate} Hz", "give a positive number of states per second")
    if (last - start) * rate > MOST_STATES:
        found = f"{rate} Hz from {start} to {last} s gives {(last - start) * rate:.0f} states"
        raise InputError("rate", found, f"at most {MOST_STATES}: is time_s in seconds? or ask for fewer")
    first, final = int(np.ceil(start * rate - 1e-9)), int(np.floor(last * rate + 1e-9))
    return np.unique(np.clip(np.concatenate([[start], np.arange(first, final + 1) / rate, [last]]), start, last))
