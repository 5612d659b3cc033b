"""The page of a mission from folder to file: a log, the chart and the mission file beside it, solutions, a vehicle file."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError
from leadline.formats.folder import read_log
from leadline.formats.solution import read_solution
from leadline.report.mission import write_mission_report
from leadline.report.tracks import frame_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from leadline.data.log import Log
    from leadline.data.solution import Solution
    from leadline.sea.terrain import Chart

CHART, MISSION = "chart.asc", "mission.toml"  # names in the folder of a log


def report_folder(
    log_path: Path,
    out: Path,
    *,
    solutions: Sequence[Path] = (),
    chart: Path | None = None,
    positive: str = "down",
    vehicle: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Log:
    """Write the page of the log in a folder to the file `out`, which must be new; returns the log.

    chart: else chart.asc in the folder, where there is one.  positive: whether the values of a chart grow "down" or "up".  Faults are
    those of mission.toml in the folder, where there is one.
    Raises InputError before anything is written where input is wrong, or `out` is there already.
    """
    if out.exists():
        raise InputError(out, "is there already", "name a new file")
    log = read_log(log_path)
    solved = {name: _solution_of(log, path) for name, path in named(solutions).items()}
    beside = log_path / CHART
    found = chart if chart is not None else beside if beside.is_file() else None
    ground = None if found is None else chart_of(found, log, solved, positive)
    if progress is not None:
        progress(0.3)
    aboard = None
    if vehicle is not None:
        from leadline.data.vehicle import read_vehicle

        aboard = read_vehicle(vehicle)
    told = (lambda part: progress(0.3 + 0.7 * part)) if progress is not None else None
    faults = faults_beside(log_path / MISSION)
    write_mission_report(log, out, solutions=solved, chart=ground, vehicle=aboard, faults=faults, progress=told)
    return log


def named(paths: Sequence[Path]) -> dict[str, Path]:
    """Return paths by their last names, or whole where two have the same."""
    last = [path.resolve().name for path in paths]
    return {name if last.count(name) == 1 else str(path): path for name, path in zip(last, paths, strict=True)}


def _solution_of(log: Log, path: Path) -> Solution:
    """Read a solution; raises InputError where no state of it lies in the time of the log."""
    solution = read_solution(path)
    later = (solution.epoch - log.epoch).total_seconds()
    time = np.concatenate([table.time[np.isfinite(table.time)] for table in log.tables.values()])
    own = solution.time[np.isfinite(solution.time)] + later
    if len(own) and len(time) and (own.min() > time.max() or own.max() < time.min()):
        found = f"is from {own.min():.0f} to {own.max():.0f} s of the log, which lasts from {time.min():.0f} to {time.max():.0f} s"
        raise InputError(path, found, "give a solution of this log")
    return solution


def chart_of(path: Path, log: Log, solutions: Mapping[str, Solution], positive: str = "down") -> Chart:
    """Read a chart in metres from the log's origin; one in degrees is laid out from there.  Raises InputError where it is no chart."""
    from leadline.formats.chart import read_chart

    try:
        return read_chart(path, positive=positive)
    except InputError as error:
        if error.found != "is in degrees":
            raise
    origin = frame_of(log, solutions).origin
    return read_chart(path, (origin.latitude, origin.longitude), positive=positive)


def faults_beside(path: Path) -> list[dict[str, Any]]:
    """Return the faults of a mission file as it has them; none where there is no file, or no faults in it."""
    try:
        given = tomllib.loads(path.read_text("utf-8")).get("faults", [])
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return []
    return [fault for fault in given if isinstance(fault, dict)] if isinstance(given, list) else []
