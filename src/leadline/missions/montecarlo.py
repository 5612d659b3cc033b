"""Monte Carlo: one mission navigated many times with noise drawn anew, and whether the errors are those that the filter states.

A run has its own seed, made of the mission's name and the run's number; each instrument draws from a stream of that seed and of its
own name.  So runs are paired: a vehicle that lacks an instrument, or has another, meets the same noise in all that is left; and
the order of runs, and how many processes share them, changes nothing.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from leadline.assess.consistency import (
    FEWEST,
    GateEvidence,
    NeesEvidence,
    Verdict,
    WhitenessEvidence,
    judge,
    nees_evidence,
    nis_evidence,
)
from leadline.assess.errors import BLOCKS, errors_of
from leadline.assess.gated import autocorrelation
from leadline.assess.intervals import Interval, interval_of_fraction, interval_of_rmse_ratio
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.records import Truth
from leadline.data.solution import Innovations
from leadline.estimate.solve import solve
from leadline.missions.bound import bound_of
from leadline.missions.instruments import instruments_of
from leadline.missions.seeds import seed_of
from leadline.simulate.dive import Recorder, StartSigmas

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from typing import Any

    import numpy.typing as npt

    from leadline.assess.consistency import Evidence
    from leadline.assess.errors import Errors
    from leadline.data.records import Array
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle
    from leadline.simulate.instruments import Instrument
    from leadline.simulate.trajectory import Trajectory

JUDGED = ("position", "velocity", "attitude", "all")
LAGS = 10
Task = TypeVar("Task")
Done = TypeVar("Done")


class Groups(NamedTuple):
    """Measurements of one sensor that were looked at, in order of time, one entry per group."""

    nis: Array
    dof: npt.NDArray[np.int64]
    gate_probability: Array
    outcome: npt.NDArray[np.int64]


class Run(NamedTuple):
    """What one run leaves: errors (times, 9), whitened errors by block (times, dof), innovations by sensor."""

    error: Array
    whitened: Mapping[str, Array]
    groups: Mapping[str, Groups]
    correlations: Mapping[tuple[str, str], tuple[int, Array]]  # by sensor and component: how many, autocorrelations (LAGS,)


@dataclass(frozen=True)
class Study:
    """Runs of one mission: errors (runs, times, 9) over `ERROR_NAMES`, whitened errors by block (runs, times, dof), SI and radians.

    bound: the Cramér-Rao bound (times, 9, 9) of the same states.  seeds: of the runs, in their order.
    """

    mission: str
    seeds: tuple[int, ...]
    time: Array
    error: Array
    whitened: Mapping[str, Array]
    bound: Array
    groups: Mapping[str, Groups]
    correlations: Mapping[tuple[str, str], tuple[int, Array]]

    @property
    def rmse(self) -> Array:
        """Root mean square over runs of each error at each time (times, 9)."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def bound_sigma(self) -> Array:
        """Standard deviations of the bound (times, 9)."""
        return np.sqrt(np.diagonal(self.bound, axis1=1, axis2=2))

    def efficiency(self) -> list[Interval]:
        """Return for each of the nine errors RMSE / bound over all runs and times, with its interval."""
        scaled = self.error / self.bound_sigma
        return [interval_of_rmse_ratio(scaled[:, :, axis], np.ones(scaled.shape[:2])) for axis in range(scaled.shape[2])]

    def nees(self, block: str) -> Array:
        """Return the mean over runs of the NEES of a block at each time (times,); nan where it is not defined in any."""
        nees = np.sum(self.whitened[block] ** 2, axis=2)
        known = np.isfinite(nees)
        count = known.sum(axis=0)
        return np.asarray(np.sum(np.where(known, nees, 0.0), axis=0) / np.where(count > 0, count, np.nan))

    def in_band(self, block: str, probability: float = 0.95) -> Interval:
        """Return the fraction of times at which the mean NEES lies in its two-sided band of a probability, with its interval.

        Times that are correlated count as fewer: as many as the NEES of one run is worth.  Times at which it is not defined do not count.
        """
        low, high = self.band(block, probability)
        nees = self.nees(block)
        known = np.isfinite(nees)
        if not known.any():
            return Interval()
        inside = float(np.mean((low[known] <= nees[known]) & (nees[known] <= high[known])))
        effective = max(1, round(min(self.evidence_of(block).effective / len(self.seeds), known.sum())))
        return replace(interval_of_fraction(round(inside * effective), effective), estimate=inside)

    def band(self, block: str, probability: float = 0.95) -> tuple[Array, Array]:
        """Return the two ends (times,) between which the mean NEES of a block lies with a probability where the covariance is right."""
        from scipy.special import gammaincinv

        z = self.whitened[block]
        count, dof = np.maximum(np.isfinite(z).all(axis=2).sum(axis=0), 1), z.shape[2]
        low, high = (2.0 * gammaincinv(0.5 * count * dof, 0.5 + side * probability / 2) / count for side in (-1.0, 1.0))
        return low, high

    def evidence_of(self, block: str) -> NeesEvidence:
        """Return the evidence of the errors of a block over all runs and times.

        Runs are independent, the times of one are not: a constant error seen on legs to and fro changes its sign and not its NEES.
        So the spread of the runs' means says what a run is worth: 2 mean^2 / (dof variance) vectors.  Fewer than 20 runs cannot say it,
        and are taken as `nees_evidence` takes them.
        """
        found = nees_evidence(self.whitened[block], block)
        nees = np.sum(self.whitened[block] ** 2, axis=2)
        means = np.array([run[known].mean() for run in nees if (known := np.isfinite(run)).any()])
        if len(means) < FEWEST:
            return found
        return replace(found, effective=len(means) * 2.0 * found.mean**2 / (found.dof * float(np.var(means, ddof=1))))

    def evidence(self) -> Iterator[Evidence]:
        """Yield the tests of the family: NEES by block; NIS, gate and whiteness by sensor, pooled over runs."""
        for block in JUDGED:
            yield self.evidence_of(block)
        for sensor, groups in self.groups.items():
            used = groups.outcome == Outcome.USED
            yield nis_evidence(sensor, innovations_of_groups(Groups(*(column[used] for column in groups))))
            expected = float(np.mean(1.0 - groups.gate_probability))
            yield GateEvidence(sensor, len(used), int(np.sum(groups.outcome == Outcome.GATED)), expected)
        for (sensor, component), (count, correlation) in self.correlations.items():
            yield WhitenessEvidence(sensor, component, count, correlation)

    def verdicts(self) -> tuple[Verdict, ...]:
        """Judge all tests as one family (Holm at 1 %)."""
        return judge(list(self.evidence()))


def innovations_of_groups(groups: Groups) -> Innovations:
    """Return groups as innovations of which only what the NIS test reads is filled in."""
    count = len(groups.nis)
    none, zero, empty = np.full(count, np.nan), np.zeros(count, np.int64), np.full(count, "", "U1")
    return Innovations(
        sensor=empty, row=zero, group=np.arange(count), time=none, applied=none, component=empty, residual=none, sigma=none,
        nis=groups.nis, dof=groups.dof, gate_probability=groups.gate_probability, widened=np.zeros(count, bool), outcome=groups.outcome,
    )  # fmt: skip


def monte_carlo(
    trajectory: Trajectory,
    vehicle: Vehicle,
    runs: Iterable[int],
    *,
    instruments: Mapping[str, Instrument[Any]] | None = None,
    start: StartSigmas | None = None,
    every: float = 10.0,
    mission: str = "mission",
    processes: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Study:
    """Navigate a trajectory once per number in `runs`, and compare with truth every `every` seconds.

    instruments: by default those of the vehicle file.  start: how far the stated start lies from the truth, drawn anew in each run.
    `progress` is called with the number of runs done.  With more than one process the caller's main module must be importable (a
    script guards its last lines by `if __name__ == "__main__"`).  Raises InputError for no runs, and as `solve`.
    """
    numbers = list(runs)
    if not numbers:
        raise InputError("runs", "there are none", "give at least one number")
    made = dict(instruments) if instruments is not None else instruments_of(vehicle)
    recorder = Recorder(trajectory, made, truth_rate=1.0 / every, start=start or StartSigmas(), name=mission)
    seeds = tuple(seed_of(mission, number) for number in numbers)
    done = []
    _ = recorder.steady, recorder.truth  # evaluated once, before it is handed on
    with ExitStack() as stack:
        for run in spread(partial(run_once, recorder, vehicle), seeds, processes, stack):
            done.append(run)
            if progress is not None:
                progress(len(done))
    limit = bound_of(recorder, vehicle, recorder.truth.time)
    return study_of(mission, seeds, recorder.truth.time, limit, done)


def spread(work: Callable[[Task], Done], tasks: Sequence[Task], processes: int, stack: ExitStack) -> Iterable[Done]:
    """Do the work for each task, here or in processes of their own; results come in the order of the tasks."""
    if processes <= 1:
        return map(work, tasks)
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    pool = stack.enter_context(ProcessPoolExecutor(processes, mp_context=get_context("spawn")))
    return pool.map(work, tasks, chunksize=max(1, min(10, len(tasks) // processes)))


def run_once(recorder: Recorder, vehicle: Vehicle, seed: int) -> Run:
    """Draw, navigate and compare one run."""
    log = recorder.draw(seed)
    truth = log.truth
    assert isinstance(truth, Truth)
    solution = solve(log, vehicle, times=truth.time)
    return run_of(solution, vehicle, compared(solution, truth))


def compared(solution: Solution, truth: Truth) -> Errors:
    """Return the errors at all times of truth; raises InputError where some cannot be compared."""
    errors = errors_of(solution, truth)
    if len(errors) != len(truth):
        raise InputError("truth", f"{len(truth) - len(errors)} of its rows cannot be compared", "a trajectory as long as the log")
    return errors


def run_of(solution: Solution, vehicle: Vehicle, errors: Errors) -> Run:
    """Return what a run leaves; rows that a gate let in because it had widened say nothing of a sigma, and are left out."""
    looked = solution.innovations
    judged = np.isfinite(looked.nis) & (looked.component != "") & ~looked.widened & np.isin(looked.outcome, (Outcome.USED, Outcome.GATED))
    looked = looked.select(judged)
    by_sensor = {name: looked.select(looked.sensor == name) for name in vehicle.sensors}
    groups = {name: _groups(mine) for name, mine in by_sensor.items() if len(mine)}
    correlations = {(name, c): found for name, mine in by_sensor.items() for c, found in _correlations(mine)}
    return Run(errors.error, {block: errors.whitened(block) for block in BLOCKS}, groups, correlations)


def _groups(mine: Innovations) -> Groups:
    first = mine.select(np.sort(np.unique(mine.group, return_index=True)[1]))
    return Groups(first.nis, first.dof, first.gate_probability, first.outcome)


def _correlations(mine: Innovations) -> Iterator[tuple[str, tuple[int, Array]]]:
    """Yield for each component how many residuals were used, and their autocorrelations."""
    for component in np.unique(mine.component):
        used = mine.select((mine.component == component) & (mine.outcome == Outcome.USED))
        if len(used) > LAGS:
            yield str(component), (len(used), autocorrelation(used.residual / used.sigma)[1 : LAGS + 1])


def study_of(mission: str, seeds: tuple[int, ...], time: Array, limit: Array, runs: Sequence[Run]) -> Study:
    """Put runs together."""
    sensors = dict.fromkeys(name for run in runs for name in run.groups)
    components = dict.fromkeys(key for run in runs for key in run.correlations)
    return Study(
        mission,
        seeds,
        time,
        np.stack([run.error for run in runs]),
        {block: np.stack([run.whitened[block] for run in runs]) for block in BLOCKS},
        limit,
        {
            name: Groups(*map(np.concatenate, zip(*(run.groups[name] for run in runs if name in run.groups), strict=True)))
            for name in sensors
        },
        {key: _pooled([run.correlations[key] for run in runs if key in run.correlations]) for key in components},
    )


def _pooled(found: Sequence[tuple[int, Array]]) -> tuple[int, Array]:
    """Count, and mean autocorrelation weighted by count."""
    count = np.array([n for n, _ in found])
    return int(count.sum()), np.average([r for _, r in found], axis=0, weights=count)
