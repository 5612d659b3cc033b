"""What the times of arrival tell of a dive: rows that came late and were used all the same, and clocks that stepped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.assess.happenings import Happening
from leadline.assess.streams import UNSEEN

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.solution import Solution

LATE_FOR = 2.0  # s after they were valid, from which rows count as late: what an acoustic fix from near by takes is none
MOST = 3  # steps of one clock that are told one by one


def arrivals(solution: Solution, log: Log) -> tuple[Happening, ...]:
    """Return what the times of arrival (`received`) of a log tell of the run that gave a solution, in order of time.

    Kinds: delayed (rows that arrived more than two seconds after they were valid), clock_step (as the run found it, estimate/clocks.py;
    start is the time of arrival).  Tables that nobody looked at are left out.
    """
    found: list[Happening] = []
    steps = solution.summary.get("clock_steps", [])
    for name, table in log.tables.items():
        if table.received is None or not _looked_at(solution, name):
            continue
        known = np.flatnonzero(np.isfinite(table.time) & np.isfinite(table.received))
        order = known[np.argsort(table.received[known], kind="stable")]
        time, received = table.time[order], table.received[order]
        inside = (received >= solution.time[0]) & (time <= solution.time[-1]) if len(solution) else np.zeros(len(time), bool)
        time, received = time[inside], received[inside]
        of_run = [step for step in steps if step["sensor"] == name and received.min(initial=np.inf) <= step["arrival_s"]]
        of_run = [step for step in of_run if step["arrival_s"] <= received.max(initial=-np.inf)]
        found += [*_delayed(name, time, received), *_stepped(name, of_run)]
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


def _stepped(name: str, steps: list[dict[str, Any]]) -> Iterator[Happening]:
    if not steps:
        return
    then = "the stamps after it were put right" if steps[0]["mended"] else "its stamps were left as they are (mend_clock)"
    if len(steps) > MOST:
        start, end = steps[0]["arrival_s"], steps[-1]["arrival_s"]
        largest = max((step["step_s"] for step in steps), key=abs)
        words = f"its clock stepped {len(steps)} times from {start:.1f} s to {end:.1f} s, by {largest:+.2f} s at most"
        yield Happening("clock_step", name, start, end, len(steps), f"{name}: {words}; {then}.")
        return
    for step in steps:
        moment, words = step["arrival_s"], f"its clock stepped by {step['step_s']:+.2f} s at {step['arrival_s']:.1f} s"
        yield Happening("clock_step", name, moment, moment, 1, f"{name}: {words}; {then}.")
