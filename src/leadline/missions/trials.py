"""Trials: one mission under one trouble after another, many times each, and whether the navigator says so and stays inside its sigmas.

The runs of a condition have the seeds of `montecarlo.seed_of`, whatever the condition; so runs are paired, and what a trouble costs is
the ratio of two errors that meet the same noise.
"""

from __future__ import annotations

from collections import defaultdict
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.assess.arrivals import arrivals
from leadline.assess.consistency import Answer, consistency
from leadline.assess.happenings import happenings
from leadline.assess.intervals import LEVEL, Interval, interval_of_fraction, interval_of_mean, interval_of_rmse_ratio
from leadline.data.errors import InputError
from leadline.data.records import Imu, Truth
from leadline.estimate import as_live
from leadline.estimate.output import solution_of
from leadline.estimate.solve import navigator_for, solve
from leadline.missions.montecarlo import Run, Study, compared, run_of, spread, study_of
from leadline.missions.seeds import seed_of
from leadline.simulate.faults import troubled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from leadline.assess.errors import Errors
    from leadline.assess.happenings import Happening
    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle
    from leadline.simulate.dive import Recorder
    from leadline.simulate.faults import Fault

SIGMAS = 3.0
STANDARD_ERROR = 0.6827  # level of an interval of one standard error to either side
FILTERED, SMOOTHED, AT_ONCE = "filtered", "smoothed", "at once"


@dataclass(frozen=True)
class Condition:
    """What is tried: the dive, the vehicle that navigates it, and the faults that befall it.

    named: (kind, sensor) of the happenings that must be told.  at_once: judge as well what is known at each moment, by what has arrived.
    """

    name: str
    recorder: Recorder
    vehicle: Vehicle
    faults: tuple[Fault, ...] = ()
    named: tuple[tuple[str, str], ...] = ()
    at_once: bool = False


class Trial(NamedTuple):
    """One run: what Monte Carlo keeps of it and shares of times inside 3 sigma (9,), by estimate; its verdict; what happened.

    spared: sensors that a fault, by chance, left as they were.
    """

    runs: Mapping[str, Run]
    inside: Mapping[str, Array]
    verdict: str
    answer: Answer
    happened: tuple[Happening, ...]
    spared: frozenset[str]


@dataclass(frozen=True)
class Trials:
    """All runs of a condition: a study and the shares of times inside 3 sigma (runs, 9), over `ERROR_NAMES`, by estimate.

    Estimates: "filtered", "smoothed", and where it was asked for "at once".  A study's bound is nan; innovations are of the filtered.
    """

    condition: Condition
    studies: Mapping[str, Study]
    inside: Mapping[str, Array]
    verdicts: tuple[str, ...]
    answers: tuple[Answer, ...]
    happened: tuple[tuple[Happening, ...], ...]
    spared: tuple[frozenset[str], ...]

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the runs, in their order."""
        return self.studies[FILTERED].seeds

    def within(self, estimate: str = FILTERED) -> list[Interval]:
        """Return for each of nine errors the share of times inside 3 sigma; runs are independent, the times of one are not."""
        return [interval_of_mean(share) for share in self.inside[estimate].T]

    def smoothing(self) -> list[Interval]:
        """Return for each of nine errors RMSE smoothed / filtered, with one standard error to either side."""
        return ratios(self.studies[SMOOTHED].error, self.studies[FILTERED].error, STANDARD_ERROR)

    def cost(self, other: Trials, estimate: str = FILTERED) -> list[Interval]:
        """Return for each of nine errors the RMSE of an estimate over that of another condition, run by run with the same seed."""
        if self.seeds != other.seeds:
            raise InputError("trials", f"{self.condition.name} and {other.condition.name} have other seeds", "the same mission and runs")
        return ratios(self.studies[estimate].error, other.studies[estimate].error)

    def rmse(self, estimate: str = FILTERED) -> Array:
        """Return the root mean square (9,) of each error over all runs and times."""
        return np.asarray(np.sqrt(np.mean(self.studies[estimate].error ** 2, axis=(0, 1))))

    def telling(self, kind: str, sensor: str) -> Interval:
        """Return the share of runs in which a happening of a kind and a sensor is told, of those in which the sensor was not spared."""
        struck = [run for run, spared in zip(self.happened, self.spared, strict=True) if sensor not in spared]
        told = sum(any((h.kind, h.sensor) == (kind, sensor) for h in run) for run in struck)
        return interval_of_fraction(told, len(struck))

    def untold(self) -> list[tuple[str, str]]:
        """Return what must be told and is not told in every run, or in no run could be."""
        return [(kind, sensor) for kind, sensor in self.condition.named if self.telling(kind, sensor).estimate != 1.0]  # nan: never struck

    def answered(self, answer: Answer = Answer.CONSISTENT) -> Interval:
        """Return the share of runs whose own verdict is this."""
        return interval_of_fraction(sum(a == answer for a in self.answers), len(self.answers))

    def found_wrong(self) -> list[str]:
        """Return the sentences of what the verdicts on all runs together, one on each estimate, hold against the vehicle file."""
        judged = [(name, verdict) for name, study in self.studies.items() for verdict in study.verdicts()]
        return [f"{name}, {verdict.sentence}" for name, verdict in judged if verdict.answer == Answer.INCONSISTENT]


def ratios(errors: Array, reference: Array, level: float = LEVEL) -> list[Interval]:
    """Return for each of nine errors (runs, times, 9) the interval of its RMSE over that of a reference, run by run."""
    return [interval_of_rmse_ratio(errors[:, :, k], reference[:, :, k], level) for k in range(errors.shape[2])]


def trials(
    conditions: Sequence[Condition],
    runs: Iterable[int],
    *,
    mission: str = "mission",
    processes: int = 1,
    progress: Callable[[int], None] | None = None,
) -> dict[str, Trials]:
    """Try each condition once per number in `runs`; returns by name.  Processes and progress as in `monte_carlo`.

    Raises InputError for no runs, for names that are not distinct, and as `solve`.
    """
    seeds, by_name = tuple(seed_of(mission, number) for number in runs), {condition.name: condition for condition in conditions}
    if not seeds or len(by_name) != len(conditions):
        raise InputError("trials", f"{len(seeds)} runs of {list(by_name)}", "at least one run, and a name of its own for each condition")
    tasks = [(name, seed) for name in by_name for seed in seeds]
    found: dict[str, list[Trial]] = defaultdict(list)
    for condition in conditions:
        _ = condition.recorder.steady, condition.recorder.truth  # evaluated once, before it is handed on
    with ExitStack() as stack:
        done = spread(partial(_task, by_name), tasks, processes, stack)
        for count, ((name, _), trial) in enumerate(zip(tasks, done, strict=True), 1):
            found[name].append(trial)
            if progress is not None:
                progress(count)
    return {name: trials_of(by_name[name], mission, seeds, found[name]) for name in by_name}


def _task(conditions: Mapping[str, Condition], task: tuple[str, int]) -> Trial:
    name, seed = task
    return try_once(conditions[name], seed)


def try_once(condition: Condition, seed: int) -> Trial:
    """Draw, trouble, navigate, smooth and judge one run."""
    healthy = condition.recorder.draw(seed)
    known = [name for name in healthy.tables if name not in condition.vehicle.sensors and name != "truth"]
    log, vehicle, truth = troubled(healthy.without(*known), condition.faults, seed), condition.vehicle, healthy.truth
    assert isinstance(truth, Truth)
    solution = solve(log, vehicle, times=truth.time)
    errors = {FILTERED: compared(solution, truth), SMOOTHED: compared(solve(log, vehicle, times=truth.time, smooth=True), truth)}
    if condition.at_once:
        errors[AT_ONCE] = compared(known_at_once(log, vehicle, truth.time), truth)
    judged = consistency(solution, errors[FILTERED]).verdict
    inside = {name: inside_of(e) for name, e in errors.items()}
    seen = {name: run_of(solution, vehicle, e) for name, e in errors.items()}
    runs = {name: run if name == FILTERED else run._replace(groups={}, correlations={}) for name, run in seen.items()}
    return Trial(
        runs, inside, judged.sentence, judged.answer, (*happenings(solution), *arrivals(solution, log)), spared(healthy, log, condition)
    )


def spared(healthy: Log, log: Log, condition: Condition) -> frozenset[str]:
    """Return the sensors of a condition's faults whose rows are what they were."""
    return frozenset(fault.sensor for fault in condition.faults if _alike(healthy[fault.sensor], log[fault.sensor]))


def _alike(one: Table, other: Table) -> bool:
    columns = [(getattr(one, c.name), getattr(other, c.name), c.metadata["text"]) for c in one.columns()]
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b, equal_nan=not text)) for a, b, text in columns)


def inside_of(errors: Errors) -> Array:
    """Return for each of nine errors the share of times at which it is at most three sigma."""
    return np.asarray(np.mean(np.abs(errors.error) <= SIGMAS * errors.sigma, axis=0))


def trials_of(condition: Condition, mission: str, seeds: tuple[int, ...], done: Sequence[Trial]) -> Trials:
    """Put the runs of a condition together."""
    time = condition.recorder.truth.time
    unknown = np.full((len(time), 9, 9), np.nan)
    return Trials(
        condition,
        {name: study_of(mission, seeds, time, unknown, [trial.runs[name] for trial in done]) for name in done[0].runs},
        {name: np.stack([trial.inside[name] for trial in done]) for name in done[0].inside},
        tuple(trial.verdict for trial in done),
        tuple(trial.answer for trial in done),
        tuple(trial.happened for trial in done),
        tuple(trial.spared for trial in done),
    )


def known_at_once(log: Log, vehicle: Vehicle, times: Array) -> Solution:
    """Return what the live navigator says at each of `times` (s, ascending), of the rows that had arrived by then."""
    navigator, _, _ = navigator_for(log, vehicle)
    names = sorted((n for n in vehicle.sensors if n in log.tables), key=lambda n: isinstance(log[n], Imu))  # inputs after all else
    arrival = {name: as_live.arrivals(log[name]) for name in names}
    order = {name: np.argsort(arrival[name], kind="stable") for name in names}
    found, before = [], dict.fromkeys(names, 0)
    for moment in times.tolist():
        for name in names:
            last = int(np.searchsorted(arrival[name][order[name]], moment, side="right"))
            if last > before[name]:
                navigator.receive(name, log[name].select(order[name][before[name] : last]))
            before[name] = last
        found.append(navigator.output(moment))
    assert navigator.reference is not None
    return solution_of(navigator.reference, navigator.composition, times, np.stack(found))
