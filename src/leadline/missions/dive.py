"""A recorded dive from folder to folder: read, solve, assess, write the solution and its report, whole or not at all."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.assess.arrivals import arrivals
from leadline.assess.assessment import Assessment, assess
from leadline.data.errors import InputError
from leadline.data.inspection import inspect
from leadline.data.records import Other
from leadline.data.vehicle import read_vehicle
from leadline.estimate.as_live import WINDOW, solve_as_live
from leadline.estimate.solve import DEFAULT_RATE, solve
from leadline.formats.atomic import check_place, new_folder
from leadline.formats.folder import read_log
from leadline.formats.solution import fill_folder
from leadline.formats.table import read_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from leadline.data.log import Log
    from leadline.data.records import Array, Truth
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle


SNAPSHOT = ".npz"  # an older snapshot is replaced, any other file is somebody's


@dataclass(frozen=True)
class Run:
    """How a dive is solved; times in s, rate in Hz.

    times: a CSV with a column time_s.  at: a named point or sensor.  window, snapshot, resume: of a run as live.  only, without: sensors
    of the vehicle to aid with, or to leave out; the one that drives the process model stays.
    """

    estimator: str = "ekf"
    process: str | None = None
    rate: float = DEFAULT_RATE
    times: Path | None = None
    at: str | None = None
    smooth: bool = False
    as_live: bool = False
    window: float = WINDOW
    until: float | None = None
    snapshot: Path | None = None
    resume: Path | None = None
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    fragments: tuple[Path, ...] = ()  # files whose keys come before those of the vehicle file

    def check(self) -> None:
        """Refuse what does not go together; raises InputError."""
        if self.as_live and self.smooth:
            raise InputError("--smooth", "was given with --as-live", "a smoother looks ahead: give one of them")
        for name in ("snapshot", "resume"):
            if getattr(self, name) is not None and not self.as_live:
                raise InputError(f"--{name}", "was given without --as-live", "only a live run can be broken off and resumed")
        if not 0.0 <= self.window < float("inf"):
            raise InputError("--window", f"{self.window} s", "give a time of zero or more")
        if self.until is not None and not abs(self.until) < float("inf"):
            raise InputError("--until", f"{self.until} s", "give a time of the log in seconds")
        if self.snapshot is not None and self.snapshot.exists() and self.snapshot.suffix != SNAPSHOT:
            raise InputError("--snapshot", f"{self.snapshot} is there already", f"name a new file, or one that ends in {SNAPSHOT}")

    def aboard(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle with the instruments that were asked for; raises InputError where what drives the motion is to be left out."""
        model = self.process or vehicle.process.model
        driving = driving_of(vehicle, model)
        for name in driving:
            if name in self.without:
                right = "leave it in, or take another process model (cruise, planar)"
                raise InputError("--without", f"{name}: it drives the process model '{model}'", right)
        kept = vehicle.only(*(name for name in driving if name in vehicle.sensors), *self.only) if self.only else vehicle
        return kept.without(*self.without) if self.without else kept

    def solve(self, log: Log, vehicle: Vehicle, progress: Callable[[float], None] | None) -> Solution:
        """Solve a log."""
        wanted: dict[str, Any] = {"rate": self.rate, "end": self.until, "at": self.at, "progress": progress}
        wanted |= {"estimator": self.estimator, "process": self.process}
        if self.times is not None:
            wanted["times"] = read_times(self.times)
        if self.as_live:
            return solve_as_live(log, vehicle, window=self.window, snapshot=self.snapshot, resume=self.resume, **wanted)
        return solve(log, vehicle, smooth=self.smooth, **wanted)


def driving_of(vehicle: Vehicle, model: str) -> tuple[str, ...]:
    """Return the instruments without which a process model cannot move a vehicle: inertial units, or thrusters."""
    if model in ("inertial", "body-velocity"):
        return (vehicle.process.imu, *([vehicle.process.standby] if vehicle.process.standby else []))
    figures = vehicle.process.written.get(model, {})
    return (str(figures.get("thrusters", "thrusters")),) if model in ("dynamics", "cruise") and "hull" in figures else ()


def read_times(path: Path) -> Array:
    """Return the column time_s (n,) of a CSV file; raises InputError where it has none, or holds what is no number."""
    table = read_table(path, Other)
    times = np.asarray(table.time, float)
    if not len(times) or not np.isfinite(times).all():
        raise InputError(path, f"has {len(times)} times, {int((~np.isfinite(times)).sum())} of them no numbers", "give a column time_s")
    return times


def solve_dive(
    log_path: Path,
    vehicle_path: Path,
    out: Path,
    run: Run | None = None,
    *,
    csv: bool = False,
    report: bool = True,
    progress: Callable[[float], None] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Solution, Assessment]:
    """Solve the log in a folder with a vehicle file and write the solution folder `out`; returns the solution and its assessment.

    `tell` is called with each problem that an inspection of the log finds; they stand in the summary as well.
    Raises InputError before any work where input is wrong or `out` must not be written.
    """
    run = run or Run()
    run.check()
    check_place(out)
    log, vehicle = read_log(log_path), run.aboard(read_vehicle(vehicle_path, *run.fragments))
    problems = problems_of(log)
    for problem in problems:
        tell(problem)
    solution, assessment = judged(run.solve(log, vehicle, progress), log, problems, at=run.at)
    truth = log.truth if run.at is None else None
    write_result(solution, assessment, out, truth=truth, csv=csv, report=report)
    return solution, assessment


def judged(solution: Solution, log: Log, problems: Sequence[str] = (), *, at: str | None = None) -> tuple[Solution, Assessment]:
    """Return a solution with what was found written into its summary, and its assessment; truth is of the body origin, not of `at`."""
    assessment = assess(solution, log.truth if at is None else None)
    happened = sorted([*assessment.happenings, *arrivals(solution, log)], key=lambda happening: happening.start)
    assessment = replace(assessment, happenings=tuple(happened))
    found = {
        **({} if at is None else {"at": at}),
        "distance_m": assessment.distance,
        "problems": list(problems),
        "verdict": verdict_of(assessment),
    }
    found |= {"happenings": [asdict(happening) for happening in assessment.happenings]}
    return replace(solution, summary={**solution.summary, **found}), assessment


def verdict_of(assessment: Assessment) -> dict[str, Any]:
    """Return the verdict in words, as it stands in summary.json."""
    return {"answer": assessment.verdict.answer.value, "sentence": assessment.verdict.sentence}


def problems_of(log: Log) -> list[str]:
    """Return the problems that an inspection finds in a log, a line each; of empty tables the verdict tells."""
    found = [f for f in inspect(log).findings if f.severity == "problem" and len(log.tables.get(f.table, ()))]
    return [f"inspect: {problem.table}: {problem.sentence}" for problem in found]


def write_result(
    solution: Solution, assessment: Assessment, out: Path, *, truth: Truth | None = None, csv: bool = False, report: bool = True
) -> None:
    """Write a solution folder with its report."""
    from leadline.report.html import write_report

    with new_folder(out) as folder:
        fill_folder(solution, folder, csv=csv)
        if report:
            write_report(
                solution, folder / "report.html", assessment=assessment, truth=truth, log_name=str(solution.summary.get("log", ""))
            )
