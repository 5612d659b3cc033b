"""One table of a log as a CSV or Parquet file: column names end in their unit, degrees stand only there (docs/formats.md)."""

from __future__ import annotations

import csv
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError
from leadline.data.records import UNITLESS, UNITS, Other, Table, expand

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from leadline.data.records import Array, Text

NOT_MEASURED = ["", "nan", "NaN", "NAN", "-nan"]


def read_table(file: Path, record: type[Table], **options: Any) -> Table:
    """Read a table of the given kind; `options` are fields that are no columns, such as the sample of an IMU.

    Raises InputError, naming file, column and line, where names, units or cells are not those of the kind.
    """
    columns = (_read_parquet if file.suffix.lower() == ".parquet" else _read_csv)(file, record)
    try:
        return record(**_fields(record, columns, file), **options)
    except InputError as error:  # of the record, which does not know its file
        raise InputError(file, error.found, error.right) if error.where == record.kind else error from None


def write_table(table: Table, file: Path) -> None:
    """Write a table in file units, as CSV or Parquet by the suffix of `file`."""
    import pyarrow as pa
    from pyarrow import csv as arrow
    from pyarrow import parquet

    columns = pa.table({name: pa.array(np.ascontiguousarray(value)) for name, value in file_columns(table).items()})
    if file.suffix == ".parquet":  # numbers hardly repeat: a dictionary of them takes longer to make, and to store
        words = [column.name for column in columns.schema if pa.types.is_string(column.type)]
        parquet.write_table(columns, file, use_dictionary=words)
        return
    with file.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out, lineterminator="\n").writerow(columns.column_names)
    with file.open("ab") as out:
        arrow.write_csv(columns, out, arrow.WriteOptions(include_header=False))


def file_columns(table: Table) -> dict[str, Array | Text]:
    """Return the columns of a table as they stand in a file: named with their units, in these units."""
    columns: dict[str, Array | Text] = {}
    for item in table.columns():
        value, pattern = getattr(table, item.name), item.metadata["pattern"]
        if value is not None:
            parts = value.T if value.ndim > 1 else [value]
            names = [pattern.replace("{i}", str(i + 1)) for i in range(len(parts))] if "{i}" in pattern else expand(pattern, [])
            columns |= {name: outside(name, part) for name, part in zip(names, parts, strict=True)}
    return columns | dict(table.extra)


def outside(name: str, values: Any) -> Any:
    """Return values in SI and radians as they stand in the named file column."""
    factor = UNITS.get(unit(name), 1.0)
    return values if factor == 1.0 else values / factor


def _roles(record: type[Table], names: Iterable[str]) -> dict[str, tuple[str, bool]]:
    """Return for each column that the kind can have, given those present: the field it belongs to, and whether it is text."""
    present = list(names)
    return {column: (item.name, item.metadata["text"]) for item in record.columns() for column in expand(item.metadata["pattern"], present)}


def unit(column: str) -> str:
    """Return what a column name ends in: its unit, if it has one."""
    return column.rpartition("_")[2]


def check_names(record: type[Table], names: list[str], file: Path) -> None:
    """Raise InputError where a column stands twice, or has a unit that is unknown or not that of its quantity."""
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(file, f"has column '{twice[0]}' {len(twice)} times", "give each column a name of its own")
    if record is Other:
        return
    roles = _roles(record, names)
    for name in (n for n in names if n not in roles):
        right = _right_name(record, name, names)
        if right:
            raise InputError(file, f"column '{name}' is not in the unit that kind '{record.kind}' has", f"convert it to '{right}'")
        if unit(name) not in UNITS and unit(name) not in UNITLESS:
            raise InputError(file, f"column '{name}' has an unknown unit suffix", f"end it in one of _{' _'.join(UNITS)}")


def _right_name(record: type[Table], name: str, names: list[str]) -> str:
    """Return the column of the kind that is missing and is of the quantity that `name` says, or ''."""
    number = re.search(r"\d+", name)
    known = _roles(record, [item.metadata["pattern"].replace("{i}", number[0] if number else "1") for item in record.columns()])
    words = (name.lower(), name.lower().rpartition("_")[0])
    missing = (k for k in known if k not in names and unit(k) in UNITS)
    return next((k for k in missing if k.removesuffix("_" + unit(k)) in words or k == words[0]), "")


def _fields(record: type[Table], columns: Mapping[str, Array | Text], file: Path) -> dict[str, Any]:
    """Return the arguments of a record from file columns: converted, stacked, and what is left as `extra`."""
    values = {}
    for item in record.columns():
        names = expand(item.metadata["pattern"], list(columns))
        _check_group(record, item.name, item.metadata, names, columns, file)
        if any(name in columns for name in names):
            blank = np.full(len(next(iter(columns.values()))), np.nan)
            parts = [inside(name, columns.get(name, blank)) for name in names]
            made = np.stack(parts, axis=1) if "{" in item.metadata["pattern"] else parts[0]
            if made.base is None:
                made.setflags(write=False)  # nobody else holds it: the record need not copy it
            values[item.name] = made
    known = _roles(record, columns)
    return values | {"extra": {name: value for name, value in columns.items() if name not in known}}


def _check_group(record: type[Table], name: str, declared: Any, names: list[str], columns: Mapping[str, Any], file: Path) -> None:
    """Raise InputError where columns that belong together are incomplete; in an optional group the missing ones are "not measured"."""
    pattern = declared["pattern"]
    if "{i}" in pattern and names != [pattern.replace("{i}", str(i + 1)) for i in range(len(names))]:
        raise InputError(file, f"has columns {', '.join(names)}", f"number {pattern} from 1 without a gap")
    missing = [n for n in names if n not in columns]
    needed = declared["required"] or any(name in group for group in record.alternatives)
    if needed and missing and len(missing) < len(names):
        raise InputError(file, f"has no column {' and '.join(missing)}", f'give all of {pattern}; an empty cell is "not measured"')


def inside(name: str, values: Any) -> Any:
    """Return the values of a file column in SI and radians."""
    factor = UNITS.get(unit(name), 1.0)
    return values if factor == 1.0 else values * factor


def _nothing(record: type[Table]) -> dict[str, Array | Text]:
    """Return the columns that the kind cannot do without, with no rows: what a file of no bytes holds."""
    needed = {item.name for item in record.columns() if item.metadata["required"]} | set(*record.alternatives[:1])
    patterns = [item.metadata["pattern"].replace("{i}", "1") for item in record.columns() if item.name in needed]
    return {name: np.empty(0) for pattern in patterns for name in expand(pattern, [])}


def _read_csv(file: Path, record: type[Table]) -> dict[str, Array | Text]:
    import pyarrow as pa

    names = _header(file)
    if not names:
        return _nothing(record)
    check_names(record, names, file)
    roles = _roles(record, names)
    numeric = {n for n in names if (not roles[n][1] if n in roles else record is not Other and unit(n) in UNITS)}
    types = {n: pa.float64() for n in numeric} | {n: pa.string() for n, (_, text) in roles.items() if text}
    try:
        table = _parse(file, names, types)
        odd = [n for n in names if not _plain(table[n].type)]  # dates and the like, in columns that nobody declared
        table = _parse(file, names, types | dict.fromkeys(odd, pa.string())) if odd else table
    except pa.ArrowInvalid:
        return _read_slowly(file, names, numeric)
    return {name: _array(table[name]) for name in names}


def _header(file: Path) -> list[str]:
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            names = [name.strip() for name in next(csv.reader(lines), [])]
    except UnicodeDecodeError as error:
        raise InputError(f"{file}, line 1", "is not UTF-8", "save it as CSV UTF-8") from error
    except OSError as error:
        raise InputError(file, f"cannot be read: {error.strerror}") from error
    if len(names) == 1 and re.search(r"[;\t]", names[0]):
        raise InputError(f"{file}, line 1", "has no commas", "separate the columns by commas")
    if "" in names:
        raise InputError(f"{file}, line 1", f"column {names.index('') + 1} has no name", "name it, or leave it out")
    return names


def _parse(file: Path, names: list[str], types: Mapping[str, Any]) -> Any:
    import pyarrow as pa
    from pyarrow import csv as arrow

    convert = arrow.ConvertOptions(column_types=dict(types), null_values=NOT_MEASURED, strings_can_be_null=False)
    try:
        return arrow.read_csv(file, arrow.ReadOptions(column_names=names, skip_rows=1), convert_options=convert)
    except pa.ArrowInvalid as error:
        if "Empty CSV" not in str(error):
            raise
    return pa.table({name: pa.array([], types.get(name, pa.float64())) for name in names})


def _read_slowly(file: Path, names: list[str], numeric: set[str]) -> dict[str, Array | Text]:
    """Read cell by cell what the fast reader refused: accept what Python calls a number, or raise InputError with the line."""
    columns: dict[str, list[Any]] = {name: [] for name in names}
    with file.open(encoding="utf-8-sig", newline="") as lines:
        reader = csv.reader(lines)
        next(reader)
        try:
            for cells in reader:
                _append(columns, cells, numeric, f"{file}, line {reader.line_num}")
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(f"{file}, line {reader.line_num + 1}", "cannot be read as UTF-8 text", "save it as CSV UTF-8") from error
    return {name: np.array(values, float if name in numeric else str) for name, values in columns.items()}


def _append(columns: dict[str, list[Any]], cells: list[str], numeric: set[str], where: str) -> None:
    if not cells:
        return
    if len(cells) != len(columns):
        raise InputError(where, f"has {len(cells)} cells", f"the header names {len(columns)} columns")
    for (name, values), cell in zip(columns.items(), map(str.strip, cells), strict=True):
        values.append(_number(cell, f"{where}, column '{name}'") if name in numeric else cell)


def _number(cell: str, where: str) -> float:
    if cell in NOT_MEASURED:
        return math.nan
    try:
        return float(cell.replace("_", "?"))
    except ValueError:
        words = "0 or 1" if cell.lower() in ("true", "false") else 'a number, or an empty cell for "not measured"'
        raise InputError(where, f"'{cell}' is not a number", f"give {words}") from None


def _read_parquet(file: Path, record: type[Table]) -> dict[str, Array | Text]:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(file) as source:
            table = source.read()
    except (pa.ArrowInvalid, OSError) as error:
        raise InputError(file, f"is not Parquet: {str(error).partition(chr(10))[0]}") from error
    names = list(table.column_names)
    check_names(record, names, file)
    roles = _roles(record, names)
    for name in names:
        declared = roles.get(name)
        text = not pa.types.is_null(table[name].type) and not _numeric(table[name].type)
        if declared and text != declared[1] and not pa.types.is_null(table[name].type):
            right = "text" if declared[1] else "numbers (a time: seconds from the epoch)"
            raise InputError(file, f"column '{name}' holds {table[name].type}", f"give {right}")
    return {name: _array(table[name], text=roles.get(name, ("", False))[1]) for name in names}


def _numeric(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind))


def _plain(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_null(kind) or types.is_string(kind) or types.is_integer(kind) or types.is_floating(kind))


def _array(column: Any, *, text: bool = False) -> Array | Text:
    """Return an Arrow column as float64 (null: nan) or as text (null: empty), spaces around it removed."""
    import pyarrow as pa
    from pyarrow import compute

    if not text and (_numeric(column.type) or pa.types.is_null(column.type)):
        return np.asarray(compute.cast(column, pa.float64(), safe=False).to_numpy(), float)
    words = compute.utf8_trim_whitespace(compute.fill_null(compute.cast(column, pa.string()), ""))
    return np.array(words.to_numpy(), dtype=np.str_)
