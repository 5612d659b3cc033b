"""What the studies of papers share: moments of errors over runs with their intervals, verdicts, tables."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leadline.assess.intervals import Interval, interval_of_mean, interval_of_rmse_ratio
from leadline.data.records import Truth
from leadline.missions.bound import bound_of
from leadline.missions.montecarlo import compared
from leadline.simulate.instruments import PositionFix
from leadline.simulate.usbl import ShortBaseline

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.missions.cell_maker import Case
    from leadline.missions.configuration import Configuration
    from leadline.simulate.dive import Recorder

ROOT = Path(__file__).resolve().parents[2]
AS_PUBLISHED = Path(__file__).resolve().parent / "as_published"
PLANAR = [0, 1, 3, 4, 8]  # north, east, velocity north and east, heading, of the nine errors
UNGATED = "gate_probability = 1.0"  # the papers have no gate

if str(AS_PUBLISHED) not in sys.path:
    sys.path.append(str(AS_PUBLISHED))


@dataclass(frozen=True, kw_only=True)
class Fixes(PositionFix):
    """Fixes at intervals U(`interval_min`, `interval_max`) (s) that are drawn anew after each, and for each seed.

    pattern: a number in place of the seed's draw, for a bound of given moments.
    """

    rate: float = 1.0  # not used: intervals are drawn
    jitter: float = 1.0  # not zero, so that the moments of each seed are its own
    interval_min: float = 0.1
    interval_max: float = 2.0
    pattern: int | None = None

    def sampling(self, duration: float, generator: Generator) -> Array:
        """Return the moments (s) of the fixes."""
        own = generator if self.pattern is None else np.random.default_rng(self.pattern)
        drawn = ShortBaseline(interval_min=self.interval_min, interval_max=self.interval_max, offset=self.offset)
        return drawn.sampling(duration, own)


def mean_bound(recorder: Recorder, vehicle: Vehicle, times: Array, patterns: int) -> Array:
    """Return the mean over patterns of the fixes of the Cramér-Rao bound (times, 9, 9); one where nothing is drawn anew."""
    drawn = [name for name, one in recorder.instruments.items() if isinstance(one, Fixes) and name in vehicle.sensors]
    found = []
    for pattern in range(patterns if drawn else 1):
        fixed = {name: replace(recorder.instruments[name], pattern=pattern) for name in drawn}
        found.append(bound_of(replace(recorder, instruments={**recorder.instruments, **fixed}), vehicle, times))
    return np.asarray(np.mean(found, axis=0))


def mse(error: Array) -> list[Interval]:
    """Return the mean square over runs and times of each axis of errors (runs, times, axes), with its 99 % interval."""
    return [interval_of_mean(np.mean(error[:, :, axis] ** 2, axis=1)) for axis in range(error.shape[2])]


def over_bound(error: Array, bound: Array) -> list[Interval]:
    """Return RMSE over bound of each axis of errors (runs, times, axes); bound (times, axes, axes)."""
    sigma = np.sqrt(np.diagonal(bound, axis1=1, axis2=2))
    return [interval_of_rmse_ratio(error[:, :, axis] / sigma[:, axis], np.ones(error.shape[:2])) for axis in range(error.shape[2])]


def scaled(interval: Interval, factor: float) -> Interval:
    """Return an interval times a factor."""
    return Interval(interval.low * factor, interval.high * factor, interval.estimate * factor, interval.level)


class Solved(NamedTuple):
    """Errors (runs, times, 9) and their covariances (runs, times, 9, 9)."""

    time: Array
    error: Array
    covariance: Array


def solved(case: Case, configuration: Configuration, runs: Iterable[int], every: float) -> Solved:
    """Solve runs of a case and keep whole covariances, which a study does not."""
    ready, vehicle = case.ready(every), configuration.aboard(case.vehicle)
    errors = []
    for number in runs:
        log = ready.log(number)
        assert isinstance(log.truth, Truth)
        errors.append(compared(configuration.solve(log, vehicle, times=log.truth.time), log.truth))
    return Solved(errors[0].time, np.stack([e.error for e in errors]), np.stack([e.covariance for e in errors]))


def nees(found: Solved, columns: Sequence[int]) -> Array:
    """Return the NEES (runs, times) of some of the nine errors."""
    return np.asarray(np.sum(whitened(found, columns) ** 2, axis=2))


def whitened(found: Solved, columns: Sequence[int]) -> Array:
    """Return L^-1 error (runs, times, dof) of some of the nine errors, with L L^T their covariance."""
    which = list(columns)
    root = np.linalg.cholesky(found.covariance[:, :, which][..., which])
    return np.asarray(np.linalg.solve(root, found.error[:, :, which][..., None])[..., 0])


class Verdict(NamedTuple):
    """A bar and whether the 99 % interval of its statistic reaches it."""

    bar: str
    value: Interval
    held: bool

    def __str__(self) -> str:
        """Write it in a line."""
        return f"{'held  ' if self.held else 'MISSED'} {self.bar}: {self.value.estimate:.4g} ({self.value})"


def judged(bar: str, value: Interval, at_most: float = np.inf, at_least: float = -np.inf) -> Verdict:
    """Hold a statistic against its limits."""
    return Verdict(bar, value, value.reaches(at_most, at_least=at_least))


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write rows under a head, the first column to the left and the others to the right."""
    width = [max(len(str(line[k])) for line in (head, *rows)) for k in range(len(head))]
    lines = [[head, *rows][k] for k in range(len(rows) + 1)]
    return "\n".join("  ".join(str(c).ljust(w) if k == 0 else str(c).rjust(w) for k, (c, w) in enumerate(zip(line, width, strict=True)))
                     for line in lines)  # fmt: skip


def plain(interval: Interval) -> dict[str, Any]:
    """Return an interval as JSON knows it."""
    return {"estimate": interval.estimate, "low": interval.low, "high": interval.high}
