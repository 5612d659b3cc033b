"""Calibration from folders: logs and a vehicle file in, a fragment of a vehicle file out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.calibrate.dvl import DvlCalibration, calibrate_dvl, fragment
from leadline.data.errors import InputError
from leadline.data.records import Gnss
from leadline.data.vehicle import read_vehicle
from leadline.formats.atomic import new_file
from leadline.formats.folder import read_log
from leadline.formats.table import read_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from leadline.data.records import Table

WORDS = ("fixes", "truth", "ends")


def dvl_from_folders(
    folders: Sequence[Path], vehicle_path: Path, sensor: str, reference: str, out: Path | None, progress: Callable[[float], None]
) -> tuple[DvlCalibration, str]:
    """Calibrate a Doppler log from the logs in folders; returns what was found and the fragment, written to `out` where it is given.

    reference: one of `WORDS`, or the path of a table of satellite fixes inside each log's folder.  Raises InputError for wrong input.
    """
    if out is not None and out.exists():
        raise InputError(out, "is there already", "name a new file")
    vehicle, logs = read_vehicle(vehicle_path), [read_log(folder) for folder in folders]
    fixes: list[Table | None] = []
    if reference not in WORDS:
        for folder in folders:
            file = folder / reference
            if not file.is_file():
                raise InputError("--reference", f"'{reference}' is none of {', '.join(WORDS)}, and {file} is no file", "give one of them")
            fixes.append(read_table(file, Gnss))
    found = calibrate_dvl(logs, vehicle, sensor=sensor, reference=reference, fixes=fixes, progress=progress)
    text = fragment(found, vehicle)
    if out is not None:
        with new_file(out) as part:
            part.write_text(text, encoding="utf-8")
    return found, text
