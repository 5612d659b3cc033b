"""A solution as a folder (docs/formats.md): what anyone needs to score it, in tables that other programs read."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import euler_from_quaternion, quaternion_from_euler
from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.outcome import Outcome
from leadline.data.solution import ERROR_NAMES, ROTATION, Estimate, Innovations, Solution, Status
from leadline.formats.atomic import new_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from enum import IntEnum

    from leadline.data.records import Array

UPPER = np.triu_indices(len(ERROR_NAMES))
COVARIANCE_COLUMNS = tuple(f"cov_{ERROR_NAMES[a]}__{ERROR_NAMES[b]}" for a, b in zip(*UPPER, strict=True))
VELOCITY_COLUMNS = tuple(f"velocity_{axis}_mps" for axis in ("north", "east", "down"))
QUATERNION_COLUMNS = tuple(f"quaternion_{part}" for part in "wxyz")
BLOCK = 100_000  # rows that are written at a time
INNOVATION_TIMES = {"time": "time_s", "applied": "applied_s"}  # all other columns have the names of the fields


def write_solution(solution: Solution, path: str | Path, *, csv: bool = False) -> None:
    """Write a solution as a folder, whole or not at all; the states as CSV instead of Parquet with `csv`.

    Angles of the states in degrees; covariance.parquet and nuisance states in SI and radians.  Raises InputError where the place
    is taken by something else than a solution, or cannot be written.
    """
    with new_folder(path) as folder:
        fill_folder(solution, folder, csv=csv)


def fill_folder(solution: Solution, folder: Path, *, csv: bool = False) -> None:
    """Write the files of a solution into a folder that is there."""
    states = lambda rows: _state_columns(solution.select(rows))  # noqa: E731
    packed = lambda rows: _covariance_columns(solution.select(rows))  # noqa: E731
    looked = lambda rows: _innovation_columns(solution.innovations.select(rows))  # noqa: E731
    _write_table(states, len(solution), folder / ("solution.csv" if csv else "solution.parquet"))
    _write_table(packed, len(solution), folder / "covariance.parquet")
    _write_table(looked, len(solution.innovations), folder / "innovations.parquet")
    (folder / "states.toml").write_text(_states_toml(solution.nuisances), "utf-8")
    summary = dict(solution.summary) | {"epoch": _epoch_text(solution.epoch), "origin": _origin_keys(solution.origin)}
    (folder / "summary.json").write_text(json.dumps(plain(summary), indent=2, allow_nan=False) + "\n", "utf-8")


def read_solution(path: str | Path) -> Solution:
    """Read a solution that `write_solution` wrote.

    Raises InputError, naming file and column, where the folder is not such a solution.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(folder, "is not a folder", "name the folder of a solution")
    summary = _read_json(folder / "summary.json")
    states = _Columns(folder / "solution.csv" if (folder / "solution.csv").exists() else folder / "solution.parquet")
    covariance = _read_covariance(_Columns(folder / "covariance.parquet"), len(states["time_s"]))
    try:
        epoch, origin = datetime.fromisoformat(summary.pop("epoch")), summary.pop("origin")
        origin = Origin(math.radians(origin["latitude_deg"]), math.radians(origin["longitude_deg"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(folder / "summary.json", f"has no valid epoch and origin ({error})", "write the solution again") from None
    return Solution(
        epoch=epoch,
        origin=origin,
        time=states["time_s"],
        latitude=np.radians(states["latitude_deg"]),
        longitude=np.radians(states["longitude_deg"]),
        **{name: states[f"{name}_m"] for name in ("height", "depth", "north", "east")},
        velocity_n=states.stack(VELOCITY_COLUMNS),
        quaternion_nb=_read_quaternion(states),
        covariance=covariance,
        status=_numbers(Status, states, "status"),
        innovations=_read_innovations(_Columns(folder / "innovations.parquet")),
        nuisances=_read_nuisances(folder / "states.toml", states),
        altitude=states.optional("altitude_m"),
        summary=summary,
    )


def attitude_covariance(covariance: Array, roll: Array, pitch: Array, heading: Array) -> Array:
    """Return the covariance (n, 3, 3) of roll, pitch, heading (rad^2) from that of the rotation vector in n.

    R_true = exp([e]x) R: e = d_heading z_n + d_pitch Rz y + d_roll Rz Ry x, solved for the angles; singular at 90 degrees of pitch.
    """
    sine, cosine, zero = np.sin(heading), np.cos(heading), np.zeros_like(roll)
    level = np.maximum(np.cos(pitch), 1e-9)
    rows = [
        [cosine / level, sine / level, zero],
        [-sine, cosine, zero],
        [cosine * np.sin(pitch) / level, sine * np.sin(pitch) / level, zero + 1.0],
    ]
    jacobian = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2))


def _state_columns(solution: Solution) -> dict[str, Any]:
    angles = euler_from_quaternion(solution.quaternion_nb)
    variance = np.diagonal(attitude_covariance(solution.covariance[:, ROTATION, ROTATION], *angles), axis1=1, axis2=2)
    attitude = np.sqrt(np.maximum(variance, 0.0))
    names = [status.name.lower() for status in Status]
    columns: dict[str, Any] = {"time_s": solution.time}
    columns |= {"latitude_deg": np.degrees(solution.latitude), "longitude_deg": np.degrees(solution.longitude)}
    columns |= {f"{name}_m": getattr(solution, name) for name in ("height", "depth", "north", "east", "altitude")}
    columns |= dict(zip(VELOCITY_COLUMNS, solution.velocity_n.T, strict=True))
    columns |= {f"{name}_deg": np.degrees(angle) for name, angle in zip(("roll", "pitch", "heading"), angles, strict=True)}
    columns["heading_deg"] = columns["heading_deg"] % 360.0
    columns |= dict(zip(("sigma_north_m", "sigma_east_m", "sigma_depth_m"), solution.sigma.T[:3], strict=True))
    columns["cov_north_east_m2"] = solution.covariance[:, 0, 1]
    columns |= dict(zip((f"sigma_{name}" for name in VELOCITY_COLUMNS), solution.sigma.T[3:6], strict=True))
    columns |= dict(zip(("sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg"), np.degrees(attitude.T), strict=True))
    columns["status"] = np.array(names)[solution.status]
    for name, estimate in solution.nuisances.items():
        columns |= {name: estimate.value, f"sigma_{name}": estimate.sigma}
    columns |= dict(zip(QUATERNION_COLUMNS, solution.quaternion_nb.T, strict=True))  # exact, where the angles are singular as well
    return {name: value for name, value in columns.items() if value is not None}


def _covariance_columns(solution: Solution) -> dict[str, Any]:
    packed = solution.covariance[:, UPPER[0], UPPER[1]]
    return {"time_s": solution.time} | dict(zip(COVARIANCE_COLUMNS, packed.T, strict=True))


def _innovation_columns(innovations: Innovations) -> dict[str, Any]:
    columns = {INNOVATION_TIMES.get(name, name): getattr(innovations, name) for name in Innovations.__dataclass_fields__}
    names = np.array([outcome.name.lower() for outcome in Outcome])
    return columns | {"outcome": names[innovations.outcome]}


def _write_table(columns: Callable[[slice], dict[str, Any]], count: int, file: Path) -> None:
    """Write a table in blocks of rows, so that a day's columns need not stand in memory twice."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    def block(first: int) -> Any:
        made = columns(slice(first, first + BLOCK))
        return pa.table({name: pa.array(np.ascontiguousarray(value)) for name, value in made.items()})

    head = block(0)
    if file.suffix == ".csv":
        writer = csv.CSVWriter(file, head.schema)
    else:  # numbers hardly repeat: a dictionary of them takes longer to make, and to store
        words = [column.name for column in head.schema if pa.types.is_string(column.type)]
        writer = parquet.ParquetWriter(file, head.schema, use_dictionary=words)
    with writer as out:
        out.write_table(head)
        for first in range(BLOCK, count, BLOCK):
            out.write_table(block(first).cast(head.schema))


def _states_toml(nuisances: Mapping[str, Estimate]) -> str:
    entries = ((name, estimate.unit, estimate.frame) for name, estimate in nuisances.items())
    keys = ("name", "unit", "frame")
    return "\n".join("[[state]]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in zip(keys, entry, strict=True)) for entry in entries)


def _epoch_text(epoch: datetime) -> str:
    return epoch.astimezone(UTC).isoformat()


def _origin_keys(origin: Origin) -> dict[str, float]:
    return {"latitude_deg": math.degrees(origin.latitude), "longitude_deg": math.degrees(origin.longitude)}


def plain(value: Any) -> Any:
    """Return a value as plain JSON types: arrays as lists, words for enumerations and paths, None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, bool | np.bool_ | str) or value is None:
        return value if isinstance(value, str) or value is None else bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.isoformat() if isinstance(value, datetime) else str(value)


class _Columns:
    """The columns of one file of a solution, by name."""

    def __init__(self, file: Path) -> None:
        """Read the file; raises InputError where it is missing or is no table."""
        import pyarrow as pa
        from pyarrow import csv, parquet

        self.file = file
        if not file.is_file():
            raise InputError(file, "is missing", "a solution is a folder that Leadline wrote")
        try:
            self.table = csv.read_csv(file) if file.suffix == ".csv" else parquet.ParquetFile(file).read()
        except (pa.ArrowInvalid, OSError) as error:
            raise InputError(file, f"cannot be read: {str(error).partition(chr(10))[0]}") from error

    def __contains__(self, name: str) -> bool:
        """Tell whether there is such a column."""
        return name in self.table.column_names

    def __getitem__(self, name: str) -> Any:
        """Return a column as an array; raises InputError where it is missing."""
        if name not in self:
            raise InputError(self.file, f"has no column '{name}'", "write the solution again")
        values = self.table[name].to_numpy()
        return np.array(values, str if any(isinstance(v, str) for v in values[:1]) else float)

    def optional(self, name: str) -> Array | None:
        """Return a column, or None where there is none."""
        return np.asarray(self[name]) if name in self else None

    def stack(self, names: tuple[str, ...]) -> Array:
        """Return columns side by side."""
        return np.stack([self[name].astype(float) for name in names], axis=1)


def _read_json(file: Path) -> dict[str, Any]:
    try:
        summary = json.loads(file.read_text("utf-8"))
    except FileNotFoundError:
        raise InputError(file, "is missing", "a solution is a folder that Leadline wrote") from None
    except (OSError, ValueError) as error:
        raise InputError(file, f"cannot be read: {error}") from error
    if not isinstance(summary, dict):
        raise InputError(file, "is not a summary", "write the solution again")
    return summary


def _read_covariance(columns: _Columns, rows: int) -> Array:
    packed = columns.stack(COVARIANCE_COLUMNS)
    if len(packed) != rows:
        raise InputError(columns.file, f"has {len(packed)} rows", f"the solution has {rows}")
    covariance = np.zeros((rows, len(ERROR_NAMES), len(ERROR_NAMES)))
    covariance[:, UPPER[0], UPPER[1]] = packed
    covariance[:, UPPER[1], UPPER[0]] = packed
    return covariance


def _read_quaternion(states: _Columns) -> Array:
    if QUATERNION_COLUMNS[0] in states:
        return states.stack(QUATERNION_COLUMNS)
    return quaternion_from_euler(*(np.radians(states[f"{name}_deg"]) for name in ("roll", "pitch", "heading")))


def _numbers(kind: type[IntEnum], columns: _Columns, name: str) -> Any:
    """Return the numbers of an enumeration from the words of a column."""
    words, where = np.unique(columns[name].astype(str), return_inverse=True)
    unknown = [word for word in words if word.upper() not in kind.__members__]
    if unknown:
        raise InputError(columns.file, f"column '{name}' holds '{unknown[0]}'", f"known: {', '.join(kind.__members__).lower()}")
    return np.array([kind[word.upper()] for word in words], np.int64)[where]


def _read_innovations(columns: _Columns) -> Innovations:
    kinds = {"sensor": str, "component": str, "row": np.int64, "group": np.int64, "dof": np.int64, "widened": bool}
    names = [name for name in Innovations.__dataclass_fields__ if name != "outcome"]
    values = {name: columns[INNOVATION_TIMES.get(name, name)].astype(kinds.get(name, float)) for name in names}
    return Innovations(**values, outcome=_numbers(Outcome, columns, "outcome"))


def _read_nuisances(file: Path, states: _Columns) -> dict[str, Estimate]:
    try:
        entries = tomllib.loads(file.read_text("utf-8")).get("state", [])
        described = {str(e["name"]): (str(e["unit"]), str(e["frame"])) for e in entries}
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(file, f"cannot be read: {error}", "write the solution again") from error
    return {name: Estimate(states[name], states[f"sigma_{name}"], *words) for name, words in described.items()}
