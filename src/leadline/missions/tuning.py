"""Tuning from folders: logs and a vehicle file in, a fragment of a vehicle file out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.calibrate.tune import Tuning, fragment, tune
from leadline.data.errors import InputError
from leadline.data.vehicle import read_vehicle
from leadline.formats.atomic import new_file
from leadline.formats.folder import read_log

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path


def tune_from_folders(
    folders: Sequence[Path],
    vehicle_path: Path,
    sensors: Sequence[str],
    out: Path | None,
    progress: Callable[[float], None],
    *,
    process: bool = False,
) -> tuple[Tuning, str]:
    """Tune a vehicle file by the logs in folders; returns what was found and the fragment, written to `out` where it is given.

    Raises InputError for wrong input.
    """
    if out is not None and out.exists():
        raise InputError(out, "is there already", "name a new file")
    vehicle = read_vehicle(vehicle_path)
    found = tune([read_log(folder) for folder in folders], vehicle, sensors=sensors, process=process, progress=progress)
    text = fragment(found)
    if out is not None:
        with new_file(out) as part:
            part.write_text(text, encoding="utf-8")
    return found, text
