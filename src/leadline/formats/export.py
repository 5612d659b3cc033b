"""A solution for other programs: the format is chosen by name, or by the suffix of the file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from leadline.data.errors import InputError, suggestion
from leadline.formats.atomic import new_file
from leadline.formats.geojson import write_geojson
from leadline.formats.gpx import write_gpx
from leadline.formats.kml import write_kml
from leadline.formats.sbet import write_sbet
from leadline.formats.track import track_of
from leadline.formats.tum import write_tum

if TYPE_CHECKING:
    from leadline.data.solution import Solution

WRITERS = {"geojson": write_geojson, "kml": write_kml, "gpx": write_gpx, "tum": write_tum}
FORMATS = (*WRITERS, "sbet")
SUFFIXES = {f".{name}": name for name in FORMATS} | {".json": "geojson", ".out": "sbet"}
EVERY = {"geojson": 1.0, "kml": 1.0, "gpx": 1.0}  # s between states for a map; the others take all


def format_of(path: str | Path, to: str | None = None) -> str:
    """Return the name of the format that is asked for, or that the file's suffix stands for; raises InputError for an unknown one."""
    if to is not None:
        if to not in FORMATS:
            raise InputError("--to", f"'{to}' is no format", suggestion(to, FORMATS))
        return to
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(path, f"its suffix '{suffix}' stands for no format", f"give --to {'|'.join(FORMATS)}")
    return SUFFIXES[suffix]


def export(solution: Solution, path: str | Path, to: str | None = None, *, every: float | None = None, scale: str = "gps") -> int:
    """Write a solution as GeoJSON, KML, GPX, TUM or SBET, whole or not at all; returns the number of states written.

    every: s between states; left out, 1 s for GeoJSON, KML and GPX, and all states for TUM and SBET; 0: all.  scale: of the times
    of SBET, "gps" or "utc".  Lost states are left out.  Raises InputError for an unknown format, a solution without states, a place
    that cannot be written.
    """
    name = format_of(path, to)
    track = track_of(solution, EVERY.get(name, 0.0) if every is None else every)
    with new_file(path) as part:
        if name == "sbet":
            write_sbet(track, part, scale)
        else:
            WRITERS[name](track, part)
    return len(track)
