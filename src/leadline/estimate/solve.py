"""solve: a log and a vehicle become a Solution.  The engine is the Navigator's; here its stream is run, smoothed if asked, and named."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.data.log import Log
from leadline.data.outcome import Outcome
from leadline.data.solution import Status
from leadline.data.vehicle import Vehicle
from leadline.estimate import plan as at
from leadline.estimate.account import innovations_of, looked_at, summary_of
from leadline.estimate.alignment import still_aligning
from leadline.estimate.assembly import navigator_for
from leadline.estimate.output import Track, solution_of
from leadline.estimate.run import Results
from leadline.estimate.smoother import Smoother
from leadline.estimate.stream import DEFAULT_RATE, Stream, stream_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from leadline.data.records import Array
    from leadline.data.solution import Innovations, Solution
    from leadline.estimate.clocks import Clock
    from leadline.estimate.events import Events, Integers
    from leadline.estimate.inputs import Span
    from leadline.estimate.navigator import Navigator
    from leadline.estimate.start import Start

AIDED_FOR = 10.0  # s
ROUNDS = 2  # the first decides anew which rows to believe, the last abides by it


@dataclass
class Decision:
    """What the rows of a stretch are told beforehand: outcomes (-1: the gate judges), and verdicts (ADMIT: the gate is open)."""

    outcome: Integers
    verdict: Array

    @classmethod
    def none(cls, events: Events) -> Decision:
        """Leave all to the gate."""
        count = int(events.measured.sum())
        return cls(np.full(count, -1), np.full(count, np.nan))

    def same_as(self, other: Decision) -> bool:
        """Tell whether another decision says the same."""
        return bool(np.array_equal(self.outcome, other.outcome) and np.array_equal(self.verdict, other.verdict, equal_nan=True))


@dataclass
class Passage:
    """What a run through all stretches leaves: its states, entries of what was looked at, states of the filter at the stretches' starts."""

    track: Track
    looked: list[Innovations] = field(default_factory=list)
    outcomes: list[Integers] = field(default_factory=list)
    checkpoints: list[Array] = field(default_factory=list)
    bounded: list[Array] = field(default_factory=list)  # when something that bounds the drift was used


def solve(
    log: Log,
    vehicle: Vehicle,
    *,
    estimator: str = "ekf",
    process: str | None = None,
    rate: float = DEFAULT_RATE,
    times: Array | None = None,
    end: float | None = None,
    at: str | None = None,
    smooth: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Solution:
    """Navigate a whole log, every measurement at its time of validity.

    estimator: a name with settings, as "ukf:alpha=0.5" (estimate/estimators.py); process: a process model in place of the vehicle's.
    rate (Hz) or `times` (s, from the log's epoch) say when states are wanted, `at` of which named point or sensor of the vehicle:
    asking for more changes no estimate.  With `smooth` each state is by all data, before and after it, and rows are judged once more,
    each against all others.  `progress` is called with the fraction done.  Raises InputError for what cannot be run: a missing
    position or heading at the start, a process model without its input, a sensor that the process model cannot serve.
    """
    for value, kind, right in ((log, Log, "leadline.read_log(path)"), (vehicle, Vehicle, "leadline.read_vehicle(path)")):
        if not isinstance(value, kind):
            raise InputError("solve", f"was given a {type(value).__name__} for the {kind.__name__.lower()}", f"give {right}")
    vehicle = vehicle if process is None else vehicle.moved_by(process)
    navigator, begun, _ = navigator_for(log, vehicle, estimator=estimator)
    if smooth and not navigator.composition.estimator.smooths:
        raise InputError("smooth", f"'{estimator}' cannot be smoothed", "take a Gaussian estimator (ekf, ukf)")
    look_at(navigator, vehicle, at)
    stream = stream_of(log, vehicle, navigator, rate=rate, times=times, end=end)
    told = progress or (lambda _: None)
    if smooth:
        passage, found = _smoothed(navigator, stream, told)
    else:
        passage, found = _forward(navigator, stream, None, told), {}
    solution = passage.track.solution()
    innovations = innovations_of(log, vehicle, passage.looked, stream.outcome)
    status = status_of(begun, vehicle, solution, np.concatenate(passage.bounded))
    summary = {
        **summary_of(log, vehicle, estimator, solution, innovations, navigator.fed),
        "smoothed": smooth,
        **found,
        **inertial_spans(stream.spans),
    }
    summary |= clock_steps(stream.clocks, stream.end)
    return replace(solution, innovations=innovations, status=status, summary=summary)


def look_at(navigator: Navigator, vehicle: Vehicle, name: str | None) -> None:
    """Have estimates expressed at a named point, or at a sensor."""
    if name is None or navigator.reference is None:
        return
    known = {**{k: v.lever_arm_b for k, v in vehicle.sensors.items()}, **vehicle.points}
    if name not in known:
        raise InputError("at", f"'{name}' is no sensor and no point of the vehicle", suggestion(name, known))
    navigator.reference = replace(navigator.reference, point_b=known[name])


def _forward(
    navigator: Navigator, stream: Stream, decisions: list[Decision] | None, progress: Callable[[float], None], *, named: bool = True
) -> Passage:
    """Run through all stretches; without `named` its states are not wanted."""
    passage, done, total = Passage(Track(stream.times)), 0, len(stream.edges) - 1
    groups = first = 0
    for events in stream:
        decision = Decision.none(events) if decisions is None else decisions[done]
        passage.checkpoints.append(navigator.state.copy())
        results = Results.room(navigator.composition, len(decision.outcome), int((events.kind == at.IS_OUTPUT).sum()))
        results.outcome[:], results.result[: len(decision.verdict), at.VERDICT] = decision.outcome, decision.verdict
        navigator.runner.run(navigator.state, events, results)
        outputs = int((events.kind == at.IS_OUTPUT).sum())
        _account(navigator, stream, events, results, passage, groups)
        if named and outputs:
            passage.track.put(first, _named(navigator, stream.times[first : first + outputs], results))
        groups, first, done = groups + len(decision.outcome), first + outputs, done + 1
        progress(done / total)
    return passage


def _account(navigator: Navigator, stream: Stream, events: Events, results: Results, passage: Passage, groups: int) -> None:
    """Note what became of the measurements of a stretch."""
    measured = np.flatnonzero(events.measured)
    passage.looked.append(looked_at(navigator.composition, events, results.outcome, results.result, groups))
    passage.outcomes.append(results.outcome)
    used = np.isin(results.outcome, (Outcome.USED, Outcome.REANCHORED))
    holds = navigator.composition.drift_bounding[events.kind[measured]] if len(measured) else np.zeros(0, bool)
    passage.bounded.append(events.time[measured][holds & used])


def _named(navigator: Navigator, times: Array, results: Results) -> Solution:
    assert navigator.reference is not None
    return solution_of(navigator.reference, navigator.composition, times, results.output)


def _smoothed(navigator: Navigator, stream: Stream, progress: Callable[[float], None]) -> tuple[Passage, dict[str, Any]]:
    """Run forward and back, and once more where rows are judged otherwise by all others; returns the run, and what was changed."""
    start, decisions, share, told = navigator.state.copy(), None, 1.0 / ROUNDS, {}
    for number in range(ROUNDS):
        navigator.state[:] = start
        passage = _forward(navigator, stream, decisions, partial(_share, progress, number * share, 0.5 * share), named=False)
        before = decisions or [Decision(np.full(len(o), -1), np.full(len(o), np.nan)) for o in passage.outcomes]
        told = {
            "rounds": number + 1,
            "overruled": int(sum((d.outcome == Outcome.OVERRULED).sum() for d in before)),
            "admitted": int(sum((d.verdict == at.ADMIT).sum() for d in before)),
        }
        after = _back(navigator, stream, passage, before, partial(_share, progress, (number + 0.5) * share, 0.5 * share))
        if number == ROUNDS - 1 or all(a.same_as(b) for a, b in zip(after, before, strict=True)):
            break
        decisions = after
        passage.looked.clear()  # a day of them is large, and they are made anew
    progress(1.0)
    return passage, {"judged_again": told}


def _back(
    navigator: Navigator, stream: Stream, passage: Passage, before: list[Decision], progress: Callable[[float], None]
) -> list[Decision]:
    """Go through the stretches of a run from its end: its states become smoothed ones; returns how rows are to be judged by all others."""
    smoother, after, edges = Smoother(navigator.composition), [], stream.edges
    first, stretches = len(stream.times), len(edges) - 1
    for k in range(stretches - 1, -1, -1):
        events = stream.stretch(*edges[k : k + 2])
        others, results = smoother.stretch(passage.checkpoints[k], events, before[k].outcome, before[k].verdict)
        last, first = first, first - int((events.kind == at.IS_OUTPUT).sum())
        if last > first:
            passage.track.put(first, _named(navigator, stream.times[first:last], results))
        after.append(decided(navigator, events, passage.outcomes[k], others, before[k]))
        progress((stretches - k) / stretches)
    return after[::-1]


def _share(progress: Callable[[float], None], base: float, share: float, fraction: float) -> None:
    progress(base + share * fraction)


def decided(navigator: Navigator, events: Events, outcome: Integers, others: Array, before: Decision) -> Decision:
    """Judge each measurement by its residual against all others: what lies outside the gate is overruled, what lies inside admitted."""
    plan, params = navigator.composition.plan, navigator.composition.params
    kind = events.kind[events.measured]
    gate = plan[at.CHANNEL + at.CHANNEL_SIZE * kind + at.GATE] if len(kind) else np.zeros(0, np.int64)
    plain = params[gate + at.STUDENT_DOF] == 0.0
    inside, known = others < params[gate + at.LIMIT], np.isfinite(others) & plain
    used = np.isin(outcome, (Outcome.USED, Outcome.REANCHORED))
    overrule = known & used & ~inside
    admit = known & (((outcome == Outcome.GATED) & inside) | ((before.verdict == at.ADMIT) & used & inside))
    return Decision(
        np.where(overrule | (before.outcome == Outcome.OVERRULED), int(Outcome.OVERRULED), -1),
        np.where(admit & ~overrule, at.ADMIT, np.nan),
    )


def status_of(start: Start, vehicle: Vehicle, solution: Solution, bounded: Array) -> Integers:
    """Return the status (n,) of each state: lost, aligning, aided while what bounds the drift was used within `AIDED_FOR`, or not.

    bounded: when such was used (s).
    """
    last = np.concatenate([[start.time], bounded])
    since = solution.time - last[np.maximum(np.searchsorted(last, solution.time, side="right") - 1, 0)]
    status = np.where(since <= AIDED_FOR, int(Status.AIDED), int(Status.DEAD_RECKONING))
    if start.aligning:
        status[still_aligning(solution.sigma[:, 8], vehicle.process.aligned_sigma_heading)] = int(Status.ALIGNING)
    return np.where(solution.status == Status.LOST, int(Status.LOST), status)


def inertial_spans(spans: Sequence[Span]) -> dict[str, Any]:
    """Return where the first inertial unit was silent, as the summary tells it."""
    told = [{"kind": s.kind, "sensor": s.sensor, "start_s": s.start, "end_s": s.end} for s in spans]
    return {"inertial": told} if told else {}


def clock_steps(clocks: Mapping[str, Clock], end: float = np.inf) -> dict[str, Any]:
    """Return when (of arrival, up to `end`) which clock stepped by how much, and whether stamps were put right, for the summary."""
    told = [
        {"sensor": name, "arrival_s": step.arrival, "step_s": step.size, "mended": clock.mend}
        for name, clock in clocks.items()
        for step in clock.steps
        if step.arrival <= end
    ]
    return {"clock_steps": told} if told else {}


__all__ = ["DEFAULT_RATE", "navigator_for", "solve", "stream_of"]
