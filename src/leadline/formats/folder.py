"""A log as a folder: `log.toml` and one CSV or Parquet table per sensor instance (docs/formats.md)."""

from __future__ import annotations

import json
import math
import re
import tomllib
from dataclasses import MISSING, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from leadline.data.errors import InputError, suggestion
from leadline.data.log import Beacon, Datum, Initial, Log, Origin
from leadline.data.records import KINDS, Imu, Other
from leadline.formats.atomic import new_folder
from leadline.formats.table import check_names, file_columns, inside, outside, read_table, write_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from leadline.data.records import Table

Section = TypeVar("Section", Origin, Datum, Initial, Beacon)

MANIFEST = "log.toml"
KEYS = ("name", "epoch", "vehicle", "origin", "tables", "clocks", "datum", "initial", "beacons")
CLOCKS = ("device", "host", "pps")
SAMPLES = ("mean", "instant", "increment")
SURFACES = ("surface", "msl", "lat", "ellipsoid")

# Units of the keys of log.toml, by field; all others are metres.
KEY_UNITS = dict.fromkeys(("latitude", "longitude", "roll", "pitch", "heading", "sigma_tilt", "sigma_heading"), "deg") | dict.fromkeys(
    ("velocity_north", "velocity_east", "velocity_down", "sigma_velocity"), "mps"
)
KEY_UNITS |= {"time": "s", "turnaround": "s"}


def read_log(path: str | Path) -> Log:
    """Read the log in a folder; SI and radians inside, rows in the order of the files.

    Raises InputError, naming file, column and line, where the folder does not follow docs/formats.md.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(folder, "is not a folder", f"name the folder that holds {MANIFEST}")
    where = folder / MANIFEST
    given = _manifest(where)
    files = _table_files(folder)
    declared = _named_sections(given, "tables", where, ("kind", "sample"), files)
    tables = {name: _table(file, name, declared.get(name, {}), where) for name, file in files.items()}
    if not any(len(table) for table in tables.values()):
        raise InputError(folder, "empty log: no table has a row", "log at least one row")
    clocks = _named_sections(given, "clocks", where, ("source",), files)
    return Log(
        name=_value(given, "name", where) or folder.resolve().name,
        tables=tables,
        epoch=_epoch(given.get("epoch"), where),
        origin=_section(Origin, given["origin"], where, "origin") if "origin" in given else None,
        vehicle=_value(given, "vehicle", where),
        clocks={name: _choice(clock, "source", CLOCKS, where, f"clocks.{name}") for name, clock in clocks.items()},
        datum=_section(Datum, given.get("datum", {}), where, "datum"),
        initial=_section(Initial, given.get("initial", {}), where, "initial"),
        beacons={name: _beacon(value, where, f"beacons.{name}") for name, value in _dict(given, "beacons", where).items()},
        path=folder,
    )


def write_log(
    log: Log, path: str | Path, *, parquet: bool = False, beside: Callable[[Path], None] | None = None, marker: str = MANIFEST
) -> None:
    """Write a log as a folder: whole or not at all; `beside` is called with the folder, to write what else belongs there.

    A folder that is there is replaced only where it holds the file `marker` and nothing but files of Leadline's own kinds.
    Raises InputError where a name is none that `read_log` takes, or the place is taken by something that is not a log.
    """
    names = [name for name in log.tables if not re.fullmatch(r"[^./\\\0][^/\\\0]*", name)]
    if names:
        raise InputError(path, f"'{names[0]}' cannot be the name of a table", "a table's name is the name of its file")
    for name, table in log.tables.items():
        check_names(type(table), list(file_columns(table)), Path(path) / name)
    with new_folder(path, marker=marker) as folder:
        for name, table in log.tables.items():
            write_table(table, folder / f"{name}.{'parquet' if parquet else 'csv'}")
        (folder / MANIFEST).write_text("\n".join(_lines(log)) + "\n", "utf-8")
        if beside is not None:
            beside(folder)


def _manifest(where: Path) -> dict[str, Any]:
    try:
        given = tomllib.loads(where.read_text("utf-8-sig"))
    except FileNotFoundError:
        raise InputError(where, "is missing", "a log is a folder with log.toml and one table per sensor") from None
    except OSError as error:
        raise InputError(where, f"cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(where, f"is not TOML: {error}") from error
    _known(given, KEYS, where, "")
    return given


def _table_files(folder: Path) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in (".csv", ".parquet") or file.name.startswith(".") or not file.is_file():
            continue
        if file.stem in files:
            raise InputError(folder, f"holds both {files[file.stem].name} and {file.name}", "keep one table of each name")
        files[file.stem] = file
    if not files:
        raise InputError(folder, "holds no table", "add one CSV or Parquet table per sensor, such as imu.csv")
    return files


def _table(file: Path, name: str, declared: Mapping[str, Any], manifest: Path) -> Table:
    kind = _value(declared, "kind", manifest, f"tables.{name}.") or name
    record = KINDS.get(kind, Other)
    sample = _choice(declared, "sample", SAMPLES, manifest, f"tables.{name}") if "sample" in declared else None
    if sample and record is not Imu:
        raise InputError(manifest, f"[tables.{name}] has 'sample'", "only a table of kind imu has it")
    table = read_table(file, record, **({"sample": sample} if sample else {}))
    if sample == "increment" and isinstance(table, Imu) and table.delta_angle is None:
        raise InputError(file, "has no increments, but log.toml says sample = 'increment'", f"give {Imu.patterns(Imu.alternatives[1])}")
    return table


def _section(kind: type[Section], given: Any, where: Path, name: str) -> Section:
    """Return a section of log.toml as its value, in SI and radians."""
    keys = {_key(item.name): item for item in fields(kind)}
    _known(_as_dict(given, where, name), keys, where, f"[{name}] ")
    missing = [key for key, item in keys.items() if item.default is MISSING and key not in given]
    if missing:
        raise InputError(where, f"[{name}] has no {' and no '.join(missing)}", "give it")
    if "map" in given:
        _choice(given, "map", SURFACES, where, name)
    values: dict[str, Any] = {keys[k].name: v if k == "map" else _quantity(k, v, where, name) for k, v in given.items()}
    return kind(**values)


def _key(name: str) -> str:
    """Return the key of a field in log.toml: its name with the unit."""
    return name if name == "map" else f"{name}_{KEY_UNITS.get(name, 'm')}"


def _quantity(key: str, value: Any, where: Path, section: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(where, f"[{section}] {key} = {value!r} is not a number", "give a finite number, or leave the key out")
    if key == "latitude_deg" and abs(value) > 90.0:
        raise InputError(where, f"[{section}] latitude_deg = {value} lies outside -90 to 90", "is it the longitude?")
    return float(inside(key, value))


def _beacon(given: Any, where: Path, name: str) -> Beacon:
    """Return a fixed beacon; `sigma_m` is short for the three sigmas."""
    rest = dict(_as_dict(given, where, name))
    if "sigma_m" in rest:
        sigma = rest.pop("sigma_m")
        rest = dict.fromkeys(("sigma_north_m", "sigma_east_m", "sigma_depth_m"), sigma) | rest
    beacon = _section(Beacon, rest, where, name)
    if None in (beacon.latitude, beacon.longitude) and None in (beacon.north, beacon.east):
        raise InputError(where, f"[{name}] has no position", "give latitude_deg and longitude_deg, or north_m and east_m")
    return beacon


def _epoch(value: Any, where: Path) -> datetime:
    right = "write it as 2022-06-08T09:00:00Z"
    if value is None:
        return Log.epoch
    if not isinstance(value, datetime):
        raise InputError(where, f"epoch = {value!s} is not a date and time", f"{right}, without quotes")
    if value.tzinfo is None:
        raise InputError(where, f"epoch = {value.isoformat()} has no time zone", right)
    return value.astimezone(UTC)


def _known(given: Mapping[str, Any], keys: Iterable[str], where: Path, section: str) -> None:
    for key in given:
        if key not in keys:
            raise InputError(where, f"{section}has an unknown key '{key}'", suggestion(key, keys))


def _named_sections(given: Mapping[str, Any], name: str, where: Path, keys: tuple[str, ...], files: Iterable[str]) -> dict[str, Any]:
    """Return the sub-sections of [tables] or [clocks], which belong to tables that exist."""
    sections = _dict(given, name, where)
    for key, value in sections.items():
        if key not in files:
            raise InputError(where, f"[{name}.{key}] has no table {key}.csv or {key}.parquet", suggestion(key, files))
        _known(_as_dict(value, where, f"{name}.{key}"), keys, where, f"[{name}.{key}] ")
    return sections


def _dict(given: Mapping[str, Any], name: str, where: Path) -> dict[str, Any]:
    return _as_dict(given.get(name, {}), where, name)


def _as_dict(value: Any, where: Path, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(where, f"{name} = {value!r} is not a section", f"write [{name}] and its keys below")
    return value


def _value(given: Mapping[str, Any], key: str, where: Path, section: str = "") -> str | None:
    value = given.get(key)
    if value is not None and not isinstance(value, str):
        raise InputError(where, f"{section}{key} = {value!r} is not text", "put it in quotes")
    return value


def _choice(given: Mapping[str, Any], key: str, words: tuple[str, ...], where: Path, section: str) -> str:
    value = given.get(key)
    if value not in words:
        raise InputError(where, f"[{section}] {key} = {value!r}", f"give one of {', '.join(words)}")
    return str(value)


def _lines(log: Log) -> Iterable[str]:
    """Yield the lines of log.toml."""
    yield f"name = {_toml(log.name)}"
    yield f"epoch = {log.epoch.astimezone(UTC).isoformat().replace('+00:00', 'Z')}"
    if log.vehicle is not None:
        yield f"vehicle = {_toml(log.vehicle)}"
    for name, table in log.tables.items():
        yield from _lines_of(f"tables.{_toml_key(name)}", {"kind": table.kind, "sample": getattr(table, "sample", None)})
    for name, source in log.clocks.items():
        if name in log.tables:
            yield from _lines_of(f"clocks.{_toml_key(name)}", {"source": source})
    yield from _lines_of("origin", _keys(log.origin))
    yield from _lines_of("datum", _keys(log.datum))
    yield from _lines_of("initial", _keys(log.initial))
    for name, beacon in log.beacons.items():
        yield from _lines_of(f"beacons.{_toml_key(name)}", _keys(beacon))


def _keys(value: Origin | Datum | Initial | Beacon | None) -> dict[str, Any]:
    """Return what differs from "nothing said", by the keys of log.toml and in their units."""
    items = [] if value is None else [(f, getattr(value, f.name)) for f in fields(value)]
    return {_key(f.name): outside(_key(f.name), v) for f, v in items if v is not None and v != f.default}


def _lines_of(name: str, values: Mapping[str, Any]) -> Iterable[str]:
    if values:
        yield f"\n[{name}]"
        yield from (f"{key} = {_toml(value)}" for key, value in values.items() if value is not None)


def _toml_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: str | float) -> str:
    """Return a value in TOML; a JSON string is a TOML string but for DEL."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f") if isinstance(value, str) else repr(float(value))
