"""A hull from folders: a log and a starting hull in, a hull file with what the log says out."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from leadline.calibrate.hull_text import fragment
from leadline.calibrate.vehicle import VehicleCalibration, calibrate_vehicle
from leadline.data.errors import InputError
from leadline.data.hull import FOLDER, hulls, read_hull
from leadline.data.vehicle import read_vehicle
from leadline.formats.atomic import new_file
from leadline.formats.folder import read_log
from leadline.formats.solution import read_solution

if TYPE_CHECKING:
    from collections.abc import Callable

DENSITIES = (900.0, 1200.0)  # kg/m^3: of waters


def vehicle_from_folders(
    folder: Path,
    hull: str,
    vehicle_path: Path | None,
    solution_path: Path | None,
    out: Path | None,
    progress: Callable[[float], None],
    *,
    density: float = 1025.0,
) -> tuple[VehicleCalibration, str]:
    """Fit a hull to the log in a folder; returns what was found and the hull file, written to `out` where it is given.

    hull: the name of a hull that comes with Leadline, or the path of a file.  Raises InputError for wrong input.
    """
    if out is not None and out.exists():
        raise InputError(out, "is there already", "name a new file")
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        raise InputError("--density", f"{density:g} kg/m^3 is no water", "about 1000 for a lake, 1025 for the sea")
    start, log = read_hull(hull), read_log(folder)
    vehicle = None if vehicle_path is None else read_vehicle(vehicle_path)
    solution = None if solution_path is None else read_solution(solution_path)
    found = calibrate_vehicle(log, start, vehicle, solution, density=density, progress=progress)
    file = FOLDER / f"{hull}.toml" if hull in hulls() else Path(hull)
    text = fragment(found, tomllib.loads(file.read_text("utf-8")))
    if out is not None:
        with new_file(out) as part:
            part.write_text(text, encoding="utf-8")
    return found, text
