"""Charts of the sea bed from the files in which surveys hand them over: ESRI ASCII grids, lists of points, GeoTIFF.

Rows of a grid file run from north to south, those of a `Chart` to the north.  Depths below the datum positive down; heights above it are
turned by `positive="up"`.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from leadline.core.geodesy import from_north_east, north_east
from leadline.data.errors import InputError
from leadline.formats.atomic import new_file
from leadline.sea.terrain import Chart

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array

ABSENT = -9999.0  # what an ESRI grid holds where nothing is known, unless it says otherwise
LARGEST = 200_000_000  # nodes
NORTH, EAST = ("north", "northing", "y", "lat", "latitude"), ("east", "easting", "x", "lon", "long", "longitude")
DEPTH, HEIGHT = ("depth", "z", "down", "value"), ("elevation", "height", "altitude", "up")


@dataclass(frozen=True)
class Sheet:
    """A grid as a file has it: node [0, 0] at `y`, `x`, rows along y, in metres or degrees; `value` nan where nothing is known."""

    y: float
    x: float
    step_y: float
    step_x: float
    value: Array

    @property
    def looks_geographic(self) -> bool:
        """Whether the numbers could be degrees, with cells too small to be metres."""
        rows, columns = self.value.shape
        far_y, far_x = self.y + (rows - 1) * self.step_y, self.x + (columns - 1) * self.step_x
        return max(self.step_y, self.step_x) < 0.1 and max(abs(self.y), abs(far_y)) <= 90.0 and max(abs(self.x), abs(far_x)) <= 180.0

    @property
    def turned(self) -> Sheet:
        """The same with y for x."""
        return Sheet(self.x, self.y, self.step_x, self.step_y, self.value.T)


def read_chart(
    path: str | Path, origin: tuple[float, float] | None = None, *, positive: str = "down", geographic: bool | None = None
) -> Chart:
    """Read a chart by the suffix of its file: .asc (ESRI ASCII grid), .xyz, .txt or .csv (points of a grid), .tif (GeoTIFF).

    Of a file in metres, `origin` is the northing and easting (m) that become 0, 0; by default those of the file stay.  A file in degrees
    needs `origin` as latitude and longitude (rad); its cells, which are no rectangles in metres, are interpolated anew at nodes as far
    apart as its own in the middle.  Files in degrees are told by their numbers, unless `geographic` says it.  `positive` is "down" where
    values are depths and "up" where they are heights.
    Points are three columns by space, comma or semicolon, '#' starts a comment; a line of names may stand first (x, east, lon, ...;
    y, north, lat, ...; depth, z, height, ...).  Without it they are north, east, depth in metres, or longitude, latitude, depth in degrees.
    Raises InputError in one line, naming file, line and value, where the file is no such grid.
    """
    file = Path(path)
    if positive not in ("down", "up"):
        raise InputError("read_chart", f"positive is '{positive}'", "'down' for depths, 'up' for heights")
    readers = {
        ".asc": _read_esri,
        ".xyz": _read_points,
        ".txt": _read_points,
        ".csv": _read_points,
        ".tif": _read_tiff,
        ".tiff": _read_tiff,
    }
    if file.suffix.lower() not in readers:
        raise InputError(file, f"has the suffix '{file.suffix}'", f"known: {', '.join(readers)}")
    if not file.is_file():
        raise InputError(file, "is not there" if not file.exists() else "is no file", "name a file with a chart")
    sheet, degrees = readers[file.suffix.lower()](file, positive, geographic)
    if np.all(np.isnan(sheet.value)):
        raise InputError(file, "knows no depth", "every value is missing")
    sheet = sheet if positive == "down" else replace(sheet, value=-sheet.value)
    if degrees:
        if origin is None:
            raise InputError(file, "is in degrees", "give the origin as latitude and longitude, or geographic=False where it is in metres")
        return _in_metres(sheet, *origin)
    north, east = origin or (0.0, 0.0)
    return Chart(sheet.y - north, sheet.x - east, sheet.step_y, sheet.step_x, sheet.value)


def write_chart(chart: Chart, path: str | Path) -> None:
    """Write a chart as ESRI ASCII grid in metres from its origin, depths positive down to the micrometre; whole or not at all."""
    rows, columns = chart.depth.shape
    square = chart.step_north == chart.step_east
    steps = f"cellsize {chart.step_north!r}\n" if square else f"dx {chart.step_east!r}\ndy {chart.step_north!r}\n"
    head = f"ncols {columns}\nnrows {rows}\nxllcenter {chart.east!r}\nyllcenter {chart.north!r}\n{steps}NODATA_value {ABSENT:.0f}\n"
    values = np.where(np.isnan(chart.depth), ABSENT, chart.depth)[::-1]
    with new_file(path) as part, part.open("w", encoding="ascii", newline="\n") as out:
        out.write(head)
        np.savetxt(out, values, fmt="%.6f")


def _in_metres(sheet: Sheet, latitude: float, longitude: float) -> Chart:
    """Return a chart of metres from an origin (rad), interpolated between the nodes of a sheet in degrees."""
    rows, columns = sheet.value.shape
    step_y, step_x = np.radians([sheet.step_y, sheet.step_x])
    lat, lon = np.radians([sheet.y, sheet.x])
    middle, edge = lat + 0.5 * (rows - 1) * step_y, lon + (columns - 1) * step_x
    corners = north_east([lat, lat, lat + (rows - 1) * step_y] * 2, [lon] * 3 + [edge] * 3, latitude, longitude)
    north = north_east(middle + np.array([-0.5, 0.5]) * step_y, longitude, latitude, longitude)[0]
    east = north_east(middle, longitude + np.array([-0.5, 0.5]) * step_x, latitude, longitude)[1]
    steps = float(np.diff(north)[0]), float(np.diff(east)[0])
    south, west = (float(np.min(corner)) for corner in corners)
    count = [int(np.floor((np.max(c) - s) / d + 1e-9)) + 1 for c, s, d in zip(corners, (south, west), steps, strict=True)]
    source = Chart(lat, lon, step_y, step_x, sheet.value)  # of radians: bilinear is bilinear
    depth, offsets, width = np.empty(count), west + steps[1] * np.arange(count[1]), edge - lon
    for i in range(count[0]):
        at, along = from_north_east(south + steps[0] * i, offsets, latitude, longitude)
        turn = (along - lon + 1e-12) % (2 * np.pi) - 1e-12
        turn[np.abs(turn) < 1e-12], turn[np.abs(turn - width) < 1e-12] = 0.0, width  # nodes on the edge, but for rounding
        inside = np.where(turn <= width, np.minimum(lon + turn, source.extent[3]), np.nan)
        depth[i] = source.depth_at(np.clip(at, lat, source.extent[1]), inside)
    return Chart(south, west, *steps, depth)


class Text(NamedTuple):
    """A text file by its lines."""

    file: Path
    lines: list[str]

    def refuse(self, index: int, found: str, right: str) -> NoReturn:
        """Raise InputError at a line, counted from 0."""
        raise InputError(f"{self.file}:{index + 1}", found, right)


def _text(file: Path) -> Text:
    try:
        return Text(file, file.read_text("utf-8-sig").splitlines())
    except (UnicodeDecodeError, OSError) as error:
        raise InputError(file, "cannot be read as text", "is it of another format?") from error


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read_esri(file: Path, positive: str, geographic: bool | None) -> tuple[Sheet, bool]:  # noqa: ARG001
    text = _text(file)
    head, start = _esri_head(text)
    rows, columns = int(head["nrows"]), int(head["ncols"])
    value = _numbers(text, start)
    if len(value) != rows * columns:
        raise InputError(file, f"has {len(value)} values", f"nrows {rows} x ncols {columns} is {rows * columns}")
    absent = head.get("nodata_value", ABSENT)
    value[np.abs(value - absent) <= 1e-6 * abs(absent)] = np.nan
    step_x, step_y = head.get("dx", head.get("cellsize", 0.0)), head.get("dy", head.get("cellsize", 0.0))
    x, y = (head[f"{n}llcenter"] if f"{n}llcenter" in head else head[f"{n}llcorner"] + 0.5 * s for n, s in (("x", step_x), ("y", step_y)))
    sheet = Sheet(y, x, step_y, step_x, value.reshape(rows, columns)[::-1])
    return sheet, sheet.looks_geographic if geographic is None else geographic


def _esri_head(text: Text) -> tuple[dict[str, float], int]:
    """Return the keys of an ESRI grid, checked, and the index of the first line of values."""
    head: dict[str, float] = {}
    start = 0
    for start, line in enumerate(text.lines):
        words = line.split()
        if words and _is_number(words[0]):
            break
        if words and (len(words) != 2 or not _is_number(words[1])):
            text.refuse(start, f"'{line.strip()[:40]}' is no line of a header", "a key and a number, such as 'ncols 200'")
        if words:
            head[words[0].lower()] = float(words[1])
    else:
        start = len(text.lines)
    for keys in (("ncols",), ("nrows",), ("cellsize", "dx"), ("cellsize", "dy"), ("xllcenter", "xllcorner"), ("yllcenter", "yllcorner")):
        if not any(key in head for key in keys):
            raise InputError(text.file, f"has no {' or '.join(keys)} in its header", "an ESRI ASCII grid starts with it")
    for key in ("ncols", "nrows"):
        if not (2 <= head[key] <= LARGEST and head[key] == int(head[key])):
            raise InputError(text.file, f"{key} is {head[key]:g}", "a whole number, at least 2")
    if not all(np.isfinite(v) and v > 0.0 for k, v in head.items() if k in ("cellsize", "dx", "dy")):
        raise InputError(text.file, f"cellsize is {head.get('cellsize', head.get('dx')):g}", "a number above zero")
    return head, start


def _numbers(text: Text, start: int) -> Array:
    """Return all numbers from a line on, however they are broken into lines."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy only warns of what it cannot read
        try:
            return np.fromstring(" ".join(text.lines[start:]), sep=" ")
        except (DeprecationWarning, ValueError):
            pass
    for index in range(start, len(text.lines)):
        for word in text.lines[index].split():
            if not _is_number(word):
                text.refuse(index, f"'{word[:40]}' is no number", "values are numbers, separated by spaces")
    return np.array(" ".join(text.lines[start:]).split(), float)


def _read_points(file: Path, positive: str, geographic: bool | None) -> tuple[Sheet, bool]:
    text = _text(file)
    plain = [line.partition("#")[0].strip() for line in text.lines]
    where = np.flatnonzero([bool(line) for line in plain])
    if not len(where):
        raise InputError(file, "holds no points", "three columns: north, east, depth")
    mark = next((m for m in (",", ";") if m in plain[where[0]]), None)
    first = _words(plain[where[0]], mark)
    names = [re.split(r"[ (\[]|_m$|_deg$", word.lower())[0] for word in first]
    named = not _is_number(first[0])
    where = where[1:] if named else where
    table = _columns(text, plain, where, mark)
    order = _order(text, names, positive) if named else (0, 1, 2)
    if max(order) >= table.shape[1]:
        text.refuse(int(where[0]), f"has {table.shape[1]} columns", "three: north, east, depth")
    sheet = _gridded(text, where, *(table[:, k] for k in order))
    seen = sheet if named else sheet.turned  # degrees without names: longitude first
    degrees = seen.looks_geographic if geographic is None else geographic
    return seen if degrees else sheet, degrees


def _words(line: str, mark: str | None) -> list[str]:
    return [word.strip() for word in line.split(mark)]


def _columns(text: Text, plain: list[str], where: npt.NDArray[np.int64], mark: str | None) -> Array:
    """Return the numbers of all lines that hold some (rows, columns)."""
    try:
        if not len(where):
            raise InputError(text.file, "holds no points", "three columns: north, east, depth")
        return np.loadtxt([plain[k] for k in where], delimiter=mark, ndmin=2)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
    width = len(_words(plain[where[0]], mark))
    for k in where:
        words = _words(plain[k], mark)
        wrong = [word for word in words if not _is_number(word)]
        if wrong:
            text.refuse(int(k), f"'{wrong[0][:40]}' is no number", "three numbers: north, east, depth")
        if len(words) != width:
            text.refuse(int(k), f"has {len(words)} columns", f"{width}, as the lines before it")
    raise InputError(text.file, "cannot be read", "three columns of numbers")


def _order(text: Text, names: list[str], positive: str) -> tuple[int, int, int]:
    """Return the columns of north, east and value by the names in the first line."""
    found = [next((k for k, name in enumerate(names) if name in known), None) for known in (NORTH, EAST, (*DEPTH, *HEIGHT))]
    north, east, value = found
    if north is None or east is None or value is None:
        raise InputError(text.file, f"has the columns {', '.join(names)}", "name three north, east, depth, or lat, lon, depth")
    if names[value] in HEIGHT and positive == "down":
        raise InputError(text.file, f"has a column '{names[value]}', and positive is 'down'", "give positive='up'")
    return north, east, value


def _gridded(text: Text, where: npt.NDArray[np.int64], y: Array, x: Array, value: Array) -> Sheet:
    """Return the grid whose nodes points (n,) are; nodes without a point are nan."""
    (row, start_y, step_y), (column, start_x, step_x) = (_axis(text, where, *axis) for axis in (("north", y), ("east", x)))
    shape = int(row.max()) + 1, int(column.max()) + 1
    if shape[0] * shape[1] > LARGEST:
        raise InputError(text.file, f"its points make a grid of {shape[0]} x {shape[1]} nodes", "points of a regular grid, not soundings")
    grid = np.full(shape, np.nan)
    grid[row, column] = value
    clash = np.flatnonzero((grid[row, column] != value) & ~np.isnan(value))
    if len(clash):
        k = int(clash[0])
        text.refuse(int(where[k]), f"a second depth {value[k]:g} at north {y[k]:g}, east {x[k]:g}", "one depth for each node of a grid")
    return Sheet(start_y, start_x, step_y, step_x, grid)


def _axis(text: Text, where: npt.NDArray[np.int64], name: str, place: Array) -> tuple[npt.NDArray[np.int64], float, float]:
    """Return the index of each coordinate on the regular axis that they make, and the axis' start and step."""
    if not np.all(np.isfinite(place)):
        text.refuse(int(where[np.flatnonzero(~np.isfinite(place))[0]]), f"{name} is no finite number", "a place in m, or in degrees")
    nodes = np.unique(place)
    gaps = np.diff(nodes)
    gaps = gaps[gaps > 1e-3 * np.median(gaps)] if len(gaps) else gaps  # smaller ones: the same node, rounded otherwise
    if not len(gaps):
        raise InputError(text.file, f"all its points have one {name}", "points of a grid of at least 2 x 2 nodes")
    count = np.sum(np.round(gaps / np.min(gaps)))  # gap by gap, so that the rounding of one does not add up
    step = float((nodes[-1] - nodes[0]) / count)
    index = np.round((place - nodes[0]) / step)
    off = np.abs(place - nodes[0] - index * step)
    k = int(np.argmax(off))
    if off[k] > 0.05 * step:
        text.refuse(int(where[k]), f"{name} {place[k]:.10g} lies between the nodes of a grid with a step of {step:g}", "a regular grid")
    return index.astype(np.int64), float(nodes[0]), step


def _read_tiff(file: Path, positive: str, geographic: bool | None) -> tuple[Sheet, bool]:  # noqa: ARG001
    try:
        import rasterio
    except ImportError as error:
        raise InputError(file, "needs the package rasterio", "pip install rasterio, or convert it: gdal_translate -of AAIGrid") from error
    try:
        with rasterio.open(file) as data:
            value: Any = data.read(1, masked=True).astype(float).filled(np.nan)
            place, crs = data.transform, data.crs
    except rasterio.errors.RasterioError as error:
        raise InputError(file, "cannot be read as GeoTIFF", str(error).partition("\n")[0]) from error
    if place.b or place.d or place.a <= 0.0 or place.e >= 0.0:
        raise InputError(file, "is turned against north", "warp it to a grid with north up: gdalwarp")
    sheet = Sheet(place.f + (len(value) - 0.5) * place.e, place.c + 0.5 * place.a, -place.e, place.a, value[::-1])
    known = crs.is_geographic if crs else sheet.looks_geographic
    return sheet, known if geographic is None else geographic
