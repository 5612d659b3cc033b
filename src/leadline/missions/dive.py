"""A recorded dive from folder to folder: read, solve, assess, write the solution and its report, whole or not at all."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from leadline.assess.assessment import Assessment, assess
from leadline.data.inspection import inspect
from leadline.data.vehicle import read_vehicle
from leadline.estimate.solve import DEFAULT_RATE, solve
from leadline.formats.atomic import check_place, new_folder
from leadline.formats.folder import read_log
from leadline.formats.solution import fill_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from leadline.data.log import Log
    from leadline.data.records import Truth
    from leadline.data.solution import Solution


def solve_dive(
    log_path: Path,
    vehicle_path: Path,
    out: Path,
    *,
    estimator: str = "ekf",
    rate: float = DEFAULT_RATE,
    only: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    csv: bool = False,
    report: bool = True,
    progress: Callable[[float], None] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[Solution, Assessment]:
    """Solve the log in a folder with a vehicle file and write the solution folder `out`; returns the solution and its assessment.

    `only` and `without` name sensors of the vehicle to aid with, or to leave out; the one that drives the process model stays.
    `tell` is called with each problem that an inspection of the log finds; they stand in the summary as well.
    Raises InputError before any work where input is wrong or `out` must not be written.
    """
    check_place(out)
    log, vehicle = read_log(log_path), read_vehicle(vehicle_path)
    if only:
        vehicle = vehicle.only(vehicle.process.imu, *only)
    if without:
        vehicle = vehicle.without(*without)
    problems = problems_of(log)
    for problem in problems:
        tell(problem)
    solution = solve(log, vehicle, estimator=estimator, rate=rate, progress=progress)
    assessment = assess(solution, log.truth)
    found = {"distance_m": assessment.distance, "problems": problems, "verdict": verdict_of(assessment)}
    solution = replace(solution, summary={**solution.summary, **found})
    write_result(solution, assessment, out, truth=log.truth, csv=csv, report=report)
    return solution, assessment


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
