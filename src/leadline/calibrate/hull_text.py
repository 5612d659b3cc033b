"""A hull file as text: the numbers of a starting hull with those that a log gave in their place, each with where it comes from."""

from __future__ import annotations

import copy
import json
import re
from typing import TYPE_CHECKING, Any

from leadline.calibrate.hull_knobs import AXES, makes
from leadline.calibrate.vehicle import Quantity, VehicleCalibration, changed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from leadline.data.hull import Thruster

Entry = dict[str, Any]
KEYS = {"ahead": "ahead_n_per_rps2", "astern": "astern_n_per_rps2", "decay": "decay_n_per_rps_per_mps", "torque": "torque_nm_per_rps2"}


def fragment(found: VehicleCalibration, raw: Mapping[str, Any]) -> str:
    """Return the hull file with what was fitted; `raw`: the starting hull file as TOML reads it.  Each entry says where it comes from."""
    return written(rewritten(found, raw), f"{found.start.name}, fitted to the log {found.log}: {found.seconds:.0f} s of it")


def rewritten(found: VehicleCalibration, raw: Mapping[str, Any]) -> Entry:
    """Return a hull file as TOML reads it with what was fitted; every thruster has a propeller of its own."""
    made: Entry = copy.deepcopy(dict(raw))
    _damping(found, made)
    _propellers(found, made)
    for part, table, key in (("term", "terms", "coefficient"), ("lift", "fins", "lift_n_per_rad_per_m2ps2")):
        for one in _of(found, part):
            made[table][one.index][key] = rounded(one.value)
            _say(made[table][one.index], found, [one])
    if afloat := _of(found, "buoyancy"):
        made["volume"]["value_m3"] = rounded(found.hull.volume, 8)
        _say(made["volume"], found, afloat)
    if centre := _of(found, "gravity"):
        made["gravity_centre"]["position_m"] = [rounded(float(v)) for v in found.hull.gravity_centre_b]
        _say(made["gravity_centre"], found, centre)
    return made


def _of(found: VehicleCalibration, part: str) -> list[Quantity]:
    return [one for one in found.quantities if one.part == part and changed(one)]


def _damping(found: VehicleCalibration, made: Entry) -> None:
    """Put the fitted coefficients of each axis; a full matrix of linear damping keeps its shape."""
    if linear := _of(found, "linear"):
        entry, matrix = made["linear_damping"], found.hull.linear_damping
        if "diagonal" in entry:
            entry["diagonal"] = [rounded(float(v)) for v in matrix.diagonal()]
        else:
            entry["matrix"] = [[rounded(float(v)) for v in row] for row in matrix]
        _say(entry, found, linear)
    if quadratic := _of(found, "quadratic"):
        made["quadratic_damping"]["diagonal"] = [rounded(float(v)) for v in found.hull.quadratic_damping]
        _say(made["quadratic_damping"], found, quadratic)


def _propellers(found: VehicleCalibration, made: Entry) -> None:
    """Give each thruster its own propeller."""
    laws, taken = made["propellers"], {}
    for number, (thruster, row) in enumerate(zip(found.hull.thrusters, made["thrusters"], strict=True)):
        make = next(k for k, numbers in enumerate(makes(found.start)) if number in numbers)
        own = [one for part in ("ahead", "astern") for one in _of(found, part) if one.index == number]
        own += [one for part in ("decay", "torque") for one in _of(found, part) if one.index == make]
        name = f"{_slug(thruster)}-{number + 1}"
        law = copy.deepcopy(laws[row["propeller"]])
        law |= {KEYS[one.part]: rounded(abs(float(getattr(thruster, one.part)))) for one in own}
        if own:
            _say(law, found, own)
        taken[name], row["propeller"] = law, name
    made["propellers"] = taken


def _slug(thruster: Thruster) -> str:
    return re.sub(r"[^a-z0-9]+", "-", thruster.name.lower()).strip("-") or "thruster"


def _say(entry: Entry, found: VehicleCalibration, fitted: list[Quantity]) -> None:
    """Say of an entry what was fitted, with sigmas, and where the rest comes from."""
    before = " ".join((entry.pop("source", None) or entry.pop("estimated", "")).split())
    entry.pop("estimated", None)
    parts = [f"{_short(one)} ({one.verdict}{f' {one.partner}' if one.partner else ''})" for one in fitted]
    entry["estimated"] = f"fitted to {found.log}, {found.seconds:.0f} s: {'; '.join(parts)}; before, and what is not named: {before}"


def _short(one: Quantity) -> str:
    axis = AXES[one.index] if one.part in ("linear", "quadratic") else one.name
    return f"{axis} {one.value:.4g}, sigma {one.sigma:.2g} {one.unit}"


def rounded(value: float, digits: int = 6) -> float:
    """Return a number with so many significant digits."""
    return float(f"{value:.{digits}g}")


def written(entries: Mapping[str, Any], remark: str) -> str:
    """Return a hull file as TOML, under a remark."""
    lines = [f"# {' '.join(remark.split())}"]
    lines += [f"{key} = {_toml(value)}" for key, value in entries.items() if not isinstance(value, dict | list)]
    for key, value in entries.items():
        lines += _tables(key, value)
    return "\n".join(lines) + "\n"


def _tables(key: str, value: Any) -> Iterator[str]:
    """Yield the lines of a table, of a table of tables, or of a list of tables."""
    if isinstance(value, list):
        for row in value:
            yield from ("", f"[[{key}]]", *_lines(row))
    elif isinstance(value, dict) and all(isinstance(inner, dict) for inner in value.values()):
        for name, inner in value.items():
            yield from ("", f"[{key}.{_name(name)}]", *_lines(inner))
    elif isinstance(value, dict):
        yield from ("", f"[{key}]", *_lines(value))


def _lines(row: Mapping[str, Any]) -> list[str]:
    return [f"{_name(key)} = {_toml(value)}" for key, value in row.items()]


def _name(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)


def _toml(value: Any) -> str:
    """Return a value in TOML; a JSON string is a TOML string but for DEL."""
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value).lower() if isinstance(value, bool) else repr(value)
