"""What the times of arrival tell of a dive: rows that came late and were used all the same, and clocks that stepped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.happenings import Happening
from leadline.assess.streams import UNSEEN

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.solution import Solution

LATE_FOR = 2.0  # s after they were valid, from which rows count as late: what an acoustic fix from near by takes is none
LEAST_STEP = 0.25  # s; a smaller step of a clock is told by nobody
SPREADS = 2.0  # and in units of the range of the delays before and after it
AROUND = 8  # rows before and after a step, whose delays are compared
MOST = 3  # steps of one clock that are told one by one


def arrivals(solution: Solution, log: Log) -> tuple[Happening, ...]:
    """Return what the times of arrival (`received`) of a log tell of the run that gave a solution, in order of time.

    Kinds: delayed (rows that arrived more than two seconds after they were valid), clock_step (from one row to the next the stamps of a
    regular sensor leap, and its arrivals do not; start is the time of arrival).  Tables that nobody looked at are left out.
    """
    found: list[Happening] = []
    for name, table in log.tables.items():
        if table.received is None or not _looked_at(solution, name):
            continue
        known = np.flatnonzero(np.isfinite(table.time) & np.isfinite(table.received))
        order = known[np.argsort(table.received[known], kind="stable")]
        time, received = table.time[order], table.received[order]
        inside = (received >= solution.time[0]) & (time <= solution.time[-1]) if len(solution) else np.zeros(len(time), bool)
        found += [*_delayed(name, time[inside], received[inside]), *_stepped(name, time[inside], received[inside])]
    return tuple(sorted(found, key=lambda h: (h.start, h.end, h.kind, h.sensor)))


def _looked_at(solution: Solution, name: str) -> bool:
    counts = solution.summary.get("counts")
    told = counts.get(name) if isinstance(counts, Mapping) else None
    return isinstance(told, Mapping) and not set(told) & {outcome.name.lower() for outcome in UNSEEN}


def _delayed(name: str, time: Array, received: Array) -> Iterator[Happening]:
    delay = received - time
    late = delay > LATE_FOR
    count = int(late.sum())
    if not count:
        return
    start, end = float(time[late].min()), float(time[late].max())
    typical, most = float(np.median(delay[late])), float(delay[late].max())
    words = f"{count:,} of {len(time):,} rows arrived more than {LATE_FOR:.0f} s after they were valid, {typical:.1f} s as a rule and"
    yield Happening("delayed", name, start, end, count, f"{name}: {words} at most {most:.1f} s, from {start:.1f} s to {end:.1f} s.")


def _stepped(name: str, time: Array, received: Array) -> Iterator[Happening]:
    steps = clock_steps(time, received)
    if len(steps) > MOST:
        start, end = steps[0][0], steps[-1][0]
        largest = max((size for _, size in steps), key=abs)
        words = f"its clock stepped {len(steps)} times from {start:.1f} s to {end:.1f} s, by {largest:+.2f} s at most"
        yield Happening("clock_step", name, start, end, len(steps), f"{name}: {words}.")
        return
    for moment, size in steps:
        yield Happening("clock_step", name, moment, moment, 1, f"{name}: its clock stepped by {size:+.2f} s at {moment:.1f} s.")


def clock_steps(time: Array, received: Array) -> list[tuple[float, float]]:
    """Return when (s, of arrival) and by how much (s, positive: ahead) a clock stepped, of stamps (n,) in order of arrival (n,).

    A step is a leap of the delay, received - time, from the rows before to those after, that exceeds their range by far; the interval
    between two stamps must show it, and that between the arrivals must not, so that rows held up in a buffer are none.
    """
    if len(time) < 2 * AROUND:
        return []
    delay, by_stamp, by_arrival = received - time, np.diff(time), np.diff(received)
    leap, usual = np.abs(np.diff(delay)), float(np.median(by_arrival))
    shown = (leap > 0.5 * LEAST_STEP) & (np.abs(by_stamp - usual) > 0.5 * leap) & (np.abs(by_arrival - usual) < 0.5 * leap)
    found: list[tuple[float, float]] = []
    for k in np.flatnonzero(shown[AROUND - 1 : len(delay) - AROUND]).tolist():
        before, after = delay[k : k + AROUND], delay[k + AROUND : k + 2 * AROUND]
        step = float(np.median(before) - np.median(after))
        if abs(step) > max(LEAST_STEP, SPREADS * float(np.ptp(before)), SPREADS * float(np.ptp(after))):
            found.append((float(received[k + AROUND]), step))
    return found
