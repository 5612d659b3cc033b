"""One log through several configurations, side by side: how far off each is, whether it says so, what it costs."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

from leadline.assess.comparison import Score, score_of
from leadline.data.errors import InputError
from leadline.estimate.solve import DEFAULT_RATE
from leadline.formats.atomic import check_place, new_folder
from leadline.formats.folder import read_log
from leadline.formats.solution import plain
from leadline.missions.configuration import configurations_of
from leadline.missions.dive import judged, problems_of, verdict_of, write_result

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from leadline.assess.assessment import Assessment
    from leadline.data.log import Log
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle
    from leadline.missions.configuration import Configuration

COMPARISON = "compare.json"
PAGE = "compare.html"
MICRO = 1e6


@dataclass(frozen=True)
class Compared:
    """One configuration and what came of it: a solution with its assessment and score, or a refusal in a sentence.

    cost: microseconds of solving per second of the log.
    """

    configuration: Configuration
    solution: Solution | None = None
    assessment: Assessment | None = None
    score: Score = field(default_factory=Score)
    cost: float = float("nan")
    refusal: str = ""

    @property
    def name(self) -> str:
        """The name of the configuration."""
        return self.configuration.name

    def to_dict(self) -> dict[str, Any]:
        """Return what is told of it as plain types, SI and radians."""
        one = self.configuration
        how = {"name": one.name, "estimator": one.estimator, "process": one.process, "smooth": one.smooth, "as_live": one.as_live}
        if self.assessment is None:
            return {**how, "refused": self.refusal}
        found = {"verdict": verdict_of(self.assessment), "cost_us_per_s": self.cost, **asdict(self.score)}
        return {**how, "refused": None, **found}


@dataclass(frozen=True)
class Comparison:
    """A log and all that was made of it; differences are from `reference`, the first configuration that was not refused."""

    log: Log
    runs: tuple[Compared, ...]

    @property
    def solved(self) -> tuple[Compared, ...]:
        """The runs that were not refused."""
        return tuple(run for run in self.runs if run.solution is not None)

    @property
    def reference(self) -> str:
        """The name of the run from which differences are counted; empty where all were refused."""
        return next((run.name for run in self.solved), "")

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain types that JSON knows, None for what is not a number."""
        runs = [run.to_dict() for run in self.runs]
        found: dict[str, Any] = plain(
            {"log": self.log.name, "truth": self.log.truth is not None, "reference": self.reference, "runs": runs}
        )
        return found


def compare(
    log: Log,
    vehicle: Path | Vehicle | None,
    configurations: Sequence[str | Configuration],
    *,
    rate: float = DEFAULT_RATE,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Solve a log by each configuration, one after the other, and score what comes of it; rate of the states in Hz.

    vehicle: for configurations that name none of their own.  configurations: as `configurations_of` takes them.  A configuration that is
    refused is told among the others; raises InputError where there are no configurations, or two of one name.
    """
    wanted, told = configurations_of(configurations), progress or (lambda _: None)
    problems, done = problems_of(log), list[Compared]()
    for number, configuration in enumerate(wanted):
        first = next((run.solution for run in done if run.solution is not None), None)
        share = partial(_share, told, number / len(wanted), 1.0 / len(wanted))
        done.append(compared_with(first, log, vehicle, configuration, rate, problems, share))
    return Comparison(log, tuple(done))


def compared_with(
    first: Solution | None,
    log: Log,
    given: Path | Vehicle | None,
    configuration: Configuration,
    rate: float,
    problems: Sequence[str],
    progress: Callable[[float], None],
) -> Compared:
    """Solve, time and score one configuration; what compiles, compiles before the time is taken."""
    try:
        vehicle = configuration.aboard(given)
        configuration.warm(log, vehicle)
        begun = perf_counter()
        solution = configuration.solve(log, vehicle, rate=rate, progress=progress)
    except InputError as error:
        return Compared(configuration, refusal=str(error))
    elapsed = perf_counter() - begun
    span = float(solution.time[-1] - solution.time[0]) if len(solution) > 1 else float("nan")
    solution, assessment = judged(solution, log, problems)
    return Compared(configuration, solution, assessment, score_of(solution, assessment, first), MICRO * elapsed / span)


def _share(progress: Callable[[float], None], base: float, share: float, fraction: float) -> None:
    progress(base + share * fraction)


def compare_folder(
    log_path: Path,
    vehicle: Path | None,
    runs: Sequence[str],
    out: Path | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Compare on the log in a folder, and write `out`: a page, its numbers as JSON, and the folder of each solution, or nothing.

    `tell` is called with each problem that an inspection of the log finds.  Raises InputError before any work where input is wrong or
    `out` must not be written, and after it where every configuration was refused.
    """
    configurations = configurations_of(runs)
    if out is not None:
        check_new(out)
    log = read_log(log_path)
    for problem in problems_of(log):
        tell(problem)
    found = compare(log, vehicle, configurations, progress=progress)
    if not found.solved:
        first = found.runs[0]
        raise InputError(f"run '{first.name}'", f"was refused, as were all: {first.refusal}")
    if out is not None:
        write_comparison(found, out)
    return found


def check_new(out: Path) -> None:
    """Raise InputError where a folder is there already and holds something, or may not be written."""
    if out.is_dir() and any(out.iterdir()):
        raise InputError(out, "is there already", "name a new folder")
    check_place(out, COMPARISON)


def write_comparison(found: Comparison, out: Path) -> None:
    """Write the folder of a comparison, whole or not at all."""
    from leadline.report.compare import comparison_page

    check_new(out)
    with new_folder(out, COMPARISON) as folder:
        for run in found.solved:
            assert run.solution is not None
            assert run.assessment is not None
            write_result(run.solution, run.assessment, folder / run.configuration.folder, truth=found.log.truth)
        (folder / COMPARISON).write_text(json.dumps(found.to_dict(), indent=2, allow_nan=False), "utf-8")
        (folder / PAGE).write_text(comparison_page(found), "utf-8")
