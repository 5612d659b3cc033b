"""A log delivered as it arrived: row by row, by `received`, to the navigator that runs aboard; late rows within the window are put right.

States are those that the live navigator comes to once the window has closed: with the rows that came in time, and without those that
came too late.  A run can be broken off, written to a file with all that it knows, and resumed, with the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.estimate.account import innovations_of, looked_at, summary_of
from leadline.estimate.assembly import navigator_for
from leadline.estimate.composition import output_size
from leadline.estimate.events import RANK, Event, Events
from leadline.estimate.inputs import spans_of
from leadline.estimate.output import solution_of
from leadline.estimate.plan import IS_INPUT, IS_OUTPUT, OUT_COV
from leadline.estimate.snapshot import restore, save
from leadline.estimate.solve import clock_steps, inertial_spans, look_at, status_of
from leadline.estimate.stream import DEFAULT_RATE, inputs_of, output_times
from leadline.models.imu import INPUT_SIZE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.solution import Innovations, Solution
    from leadline.data.vehicle import Vehicle
    from leadline.estimate.events import Integers
    from leadline.estimate.navigator import Navigator
    from leadline.estimate.window import Window

WINDOW = 30.0  # s


class Delivery(NamedTuple):
    """Rows of one sensor that arrive one after the other with nothing between them."""

    arrival: float  # of the last
    sensor: str
    rows: Integers


@dataclass
class Ledger:
    """What the navigator lets go of, as it becomes final."""

    navigator: Navigator
    looked: list[Innovations] = field(default_factory=list)
    bounded: list[Array] = field(default_factory=list)
    inputs: list[tuple[Array, Array]] = field(default_factory=list)  # times and rows
    groups: int = 0

    def note(self, window: Window, cut: int) -> None:
        """Take over the first `cut` events of the window."""
        composition = self.navigator.composition
        events = Events(
            time=window.time[:cut].copy(),
            kind=window.kind[:cut].copy(),
            start=window.start[:cut],
            stop=window.stop[:cut],
            data=window.data,
            index=window.index[:cut],
            row=window.row[:cut].copy(),
        )
        own = np.flatnonzero((events.kind == IS_INPUT) & (window.source[:cut] < 0))
        self.inputs.append((events.time[own], window.rows[own, :INPUT_SIZE].copy()))
        measured = np.flatnonzero(events.measured)
        outcome, result = window.outcome[measured].copy(), window.result[measured].copy()
        self.looked.append(looked_at(composition, events, outcome, result, self.groups))
        self.groups += len(measured)
        holds = composition.drift_bounding[events.kind[measured]] if len(measured) else np.zeros(0, bool)
        self.bounded.append(events.time[measured][holds & np.isin(outcome, (Outcome.USED, Outcome.REANCHORED))])


def arrivals(table: Table) -> Array:
    """Return when each row arrived (n,): `received`, and where that is not known the time of validity."""
    if table.received is None:
        return table.time
    return np.where(np.isfinite(table.received), table.received, table.time)


def deliveries(log: Log, names: tuple[str, ...], inertial: tuple[str, ...], after: float, until: float) -> Iterator[Delivery]:
    """Yield the rows of the named tables in the order of arrival, each alone but for inertial rows that follow each other.

    Rows that arrive at one moment come in the order of `names`, and of the file.
    """
    when = [arrivals(log[name]) for name in names]
    source = np.repeat(np.arange(len(names)), [len(w) for w in when])
    row = np.concatenate([np.arange(len(w)) for w in when])
    arrival = np.concatenate(when)
    order = np.lexsort((row, source, arrival))
    order = order[np.isfinite(arrival[order]) & (arrival[order] > after) & (arrival[order] <= until)]
    together = np.isin(source, [i for i, name in enumerate(names) if name in inertial])
    same = (np.diff(source[order]) == 0) & together[order[1:]]
    edges = np.concatenate([[0], np.flatnonzero(~same) + 1, [len(order)]])
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if b > a:
            chosen = order[a:b]
            yield Delivery(float(arrival[chosen[-1]]), names[source[chosen[0]]], row[chosen])


def solve_as_live(
    log: Log,
    vehicle: Vehicle,
    *,
    estimator: str = "ekf",
    process: str | None = None,
    window: float = WINDOW,
    rate: float = DEFAULT_RATE,
    times: Array | None = None,
    end: float | None = None,
    at: str | None = None,
    snapshot: Path | None = None,
    resume: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Solution:
    """Navigate a log as the vehicle would have: rows act when they are valid, and only those that arrived within `window` (s) of that.

    end: deliver what arrived up to then.  snapshot: where to write all that the navigator knows at the end.  resume: such a file; rows
    that had arrived before it are passed over.  All else as `solve`.
    """
    vehicle = vehicle if process is None else vehicle.moved_by(process)
    if vehicle.process.sync is not None:
        raise InputError("process.sync_s", f"{vehicle.process.sync} s, as live", "solve without --as-live: a tick is known only afterwards")
    navigator, begun, _ = navigator_for(log, vehicle, estimator=estimator, window=window)
    look_at(navigator, vehicle, at)
    after = restore(navigator, resume) if resume is not None else -np.inf
    driving = navigator.inputs.names if navigator.inputs is not None else ()
    inertial = tuple(n for n in driving if n in log.tables)
    names = tuple(n for n in vehicle.sensors if n in log.tables and n not in navigator.unmodelled)
    order = list(deliveries(log, names, inertial, after, np.inf if end is None else end))
    if not order:
        found = f"has no row that arrived after {after} s" if np.isfinite(after) else f"has no row that arrived up to {end} s"
        raise InputError(f"{log.path or log.name}", found, "resume with a log that goes on, or deliver more of it")
    ledger, outcome = Ledger(navigator), {name: np.full(len(log[name]), int(Outcome.OUTSIDE_RUN)) for name in names}
    navigator.on_final = ledger.note
    moments = _moments(log, vehicle, navigator, rate, times, end)
    navigator.outputs = np.full((max(1, len(moments)), output_size(navigator.composition.layout)), np.nan)
    first_row = {name: navigator.rows[name] for name in navigator.rows}
    asked = 0
    numbers: dict[str, list[int]] = {name: [] for name in navigator.rows}
    for done, delivery in enumerate(order):
        table = log[delivery.sensor].select(delivery.rows)
        if delivery.sensor in inertial or not inertial:
            newest = np.nanmax(table.time, initial=-np.inf) - navigator.clocks[delivery.sensor].offset
            ahead = max(asked, int(np.searchsorted(moments, newest, side="right")))
            navigator.take(_asked(moments, asked, ahead))
            asked = ahead
        if delivery.sensor not in inertial:
            numbers[delivery.sensor] += delivery.rows.tolist()
        outcome[delivery.sensor][delivery.rows] = navigator.receive(delivery.sensor, table)
        if progress is not None and done % 1000 == 0:
            progress(done / len(order))
    navigator.take(_asked(moments, asked, len(moments)))
    if snapshot is not None:
        save(navigator, snapshot, order[-1].arrival)
    return _named(log, vehicle, navigator, ledger, _Told(estimator, moments, outcome, numbers, first_row), begun)


def _asked(moments: Array, first: int, last: int) -> list[Event]:
    """Events that ask for the states at some of the moments."""
    return [Event(float(moments[i]), RANK[IS_OUTPUT], IS_OUTPUT, row=i) for i in range(first, last)]


@dataclass(frozen=True)
class _Told:
    """What was asked for, and what became of rows as far as they were turned away."""

    estimator: str
    moments: Array
    outcome: dict[str, Integers]
    numbers: dict[str, list[int]]  # by sensor: the row of the log of each row that was delivered
    first: dict[str, int]  # by sensor: how many had been delivered before


def _moments(log: Log, vehicle: Vehicle, navigator: Navigator, rate: float, times: Array | None, end: float | None) -> Array:
    """When states are wanted, as far as inputs can reach."""
    start, covered = navigator.time, inputs_of(log, vehicle, navigator).covered
    last = covered if end is None else min(covered, max(start, end))
    if times is None:
        return output_times(start, last, rate) if last > start else np.array([start])
    wanted = np.sort(np.asarray(times, float))
    inside = wanted[(wanted >= start) & (wanted <= last)]
    if not len(inside):
        raise InputError("times", f"none of {len(wanted)} lies in the run", f"the run is from {start} to {last} s")
    return inside


def _named(log: Log, vehicle: Vehicle, navigator: Navigator, ledger: Ledger, told: _Told, begun: object) -> Solution:
    """Close the window and name what was found."""
    waiting = [(navigator.events.name(i), int(navigator.events.row[i])) for i in range(navigator.done, len(navigator.events))]
    navigator.flush()
    reached = np.isfinite(navigator.outputs[:, OUT_COV])[: len(told.moments)] | (told.moments <= navigator.time)
    assert navigator.reference is not None
    solution = solution_of(
        navigator.reference, navigator.composition, told.moments[reached], navigator.outputs[: len(told.moments)][reached]
    )
    rows = {name: np.array(numbers, np.int64) for name, numbers in told.numbers.items()}
    looked = [_in_log(part, rows, told.first) for part in ledger.looked]
    for name, row in waiting:
        if name and 0 <= row - told.first[name] < len(rows[name]):
            told.outcome[name][rows[name][row - told.first[name]]] = int(Outcome.OUTSIDE_RUN)
    innovations = innovations_of(log, vehicle, looked, told.outcome)
    status = status_of(begun, vehicle, solution, np.concatenate([*ledger.bounded, np.zeros(0)]))  # type: ignore[arg-type]
    summary = summary_of(log, vehicle, told.estimator, solution, innovations, navigator.fed)
    summary |= {"as_live": {"window_s": navigator.window}}
    if navigator.inputs is not None:
        time, data = (np.concatenate(parts) for parts in zip(*ledger.inputs, strict=True))
        spans = spans_of(time, data, navigator.time, (vehicle.process.imu, vehicle.process.standby))
        summary |= inertial_spans([replace(s, start=max(s.start, navigator.start)) for s in spans])
    return replace(solution, innovations=innovations, status=status, summary=summary | clock_steps(navigator.clocks))


def _in_log(part: Innovations, rows: dict[str, Integers], first: dict[str, int]) -> Innovations:
    """Entries with rows numbered as in the log; those of rows that came before a resumed run are left out."""
    row, kept = part.row.copy(), np.ones(len(part), bool)
    for name, numbers in rows.items():
        mine = part.sensor == name
        place = part.row[mine] - first[name]
        known = (place >= 0) & (place < len(numbers))
        row[mine] = np.where(known, numbers[np.clip(place, 0, max(0, len(numbers) - 1))] if len(numbers) else -1, -1)
        kept[mine] = known
    return replace(part, row=row).select(kept)
