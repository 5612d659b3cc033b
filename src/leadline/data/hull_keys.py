"""Which keys a hull file may hold, and what is said of a wrong one.

Each table is one entry: its numbers, and either `source = "author, year"` or `estimated = "how"`; one with neither or with both is refused.
Each number ends in its unit; an angle may be given in rad or in what a person prefers, and is turned to rad here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.data.vehicle import si
from leadline.data.vehicle_keys import shown

if TYPE_CHECKING:
    from collections.abc import Mapping

REQUIRED = object()
ROWS = "XYZKMN"
VELOCITIES = "uvwpqr"


@dataclass(frozen=True)
class Numbers:
    """A key with numbers: shape, the range that is allowed, and what stands for one that is not given (REQUIRED: it must be)."""

    shape: tuple[int, ...] = ()
    default: Any = REQUIRED
    above: float = -np.inf  # every number must be above it
    least: float = -np.inf  # every number must be at least it

    def read(self, value: Any, where: str) -> Any:
        """Return the value as a float, or as an array of the shape; raises InputError for anything else."""
        wanted = "a number" if not self.shape else f"{' x '.join(map(str, self.shape))} numbers"
        try:
            array = np.array(value, dtype=float) if _numeric(value) else None
        except ValueError:
            array = None
        if array is None or array.shape != self.shape or not np.all(np.isfinite(array)):
            raise InputError(where, shown(value), wanted)
        if np.any(array <= self.above) or np.any(array < self.least):
            raise InputError(where, shown(value), f"above {self.above:g}" if np.any(array <= self.above) else f"{self.least:g} or more")
        return array if self.shape else float(array)


@dataclass(frozen=True)
class Word:
    """A key with a text; `among` lists what it may say (nothing: any text that is not empty)."""

    default: Any = REQUIRED
    among: tuple[str, ...] = ()

    def read(self, value: Any, where: str) -> str:
        """Return the text; raises InputError for anything else."""
        if not isinstance(value, str) or not value.strip():
            raise InputError(where, shown(value), "a text in quotes")
        if self.among and value not in self.among:
            raise InputError(where, f"'{value}' is not known", suggestion(value, self.among))
        return value


NUMBER, POSITIVE, NOT_NEGATIVE, VECTOR = Numbers(), Numbers(above=0.0), Numbers(least=0.0), Numbers((3,))
SOURCES: Mapping[str, Word] = {"source": Word(default=None), "estimated": Word(default=None)}
Keys = dict[str, "Numbers | Word"]
SIX: Keys = {"diagonal": Numbers((6,), default=None, least=0.0), "matrix": Numbers((6, 6), default=None)}
ONE: Mapping[str, Keys] = {
    "mass": {"value_kg": POSITIVE},
    "volume": {"value_m3": POSITIVE},
    "enclosed_water": {"value_kg": NOT_NEGATIVE},
    "gravity_centre": {"position_m": VECTOR},
    "buoyancy_centre": {"position_m": VECTOR},
    "inertia": {"diagonal_kgm2": Numbers((3,), default=None, above=0.0), "matrix_kgm2": Numbers((3, 3), default=None)},
    "added_mass": SIX,
    "linear_damping": SIX,
    "quadratic_damping": {"diagonal": Numbers((6,), least=0.0)},
    "size": {"length_m": POSITIVE, "height_m": POSITIVE},
}
OPTIONAL = frozenset({"enclosed_water", "linear_damping"})
PROPELLER: Keys = {
    "ahead_n_per_rps2": POSITIVE,
    "astern_n_per_rps2": POSITIVE,
    "decay_n_per_rps_per_mps": NOT_NEGATIVE,
    "torque_nm_per_rps2": NOT_NEGATIVE,
    "lag_s": POSITIVE,
    "dead_band_rps": NOT_NEGATIVE,
    "max_rps": POSITIVE,
    "max_rate_rps_per_s": Numbers(above=0.0, default=np.inf),
}
MANY: Mapping[str, Keys] = {
    "terms": {"force": Word(among=tuple(ROWS)), "of": Word(), "coefficient": NUMBER},
    "thrusters": {"name": Word(), "propeller": Word(), "position_m": VECTOR, "direction": VECTOR, "turns": Numbers(default=1.0)},
    "fins": {
        "name": Word(),
        "kind": Word(among=("rudder", "stern")),
        "position_m": VECTOR,
        "axis": Numbers((3,), default=None),
        "lift_n_per_rad_per_m2ps2": POSITIVE,
        "max_rad": POSITIVE,
        "max_rate_radps": POSITIVE,
        "lag_s": POSITIVE,
    },
}


def check(raw: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a hull file with every entry checked, in SI: `propellers` by name, `terms`, `thrusters` and `fins` as lists."""
    known = {"name", "propellers", *ONE, *MANY}
    for key, value in raw.items():
        if key not in known:
            raise InputError(where, f"unknown key '{key}' ({shown(value)})", suggestion(key, known))
    for key in ("name", "propellers", "thrusters", *ONE):
        if key not in raw and key not in OPTIONAL:
            raise InputError(where, f"has no '{key}'", f"add a table [{key}]" if key in ONE else "give it")
    found: dict[str, Any] = {"name": Word().read(raw["name"], f"{where}: name")}
    found |= {key: entry(raw[key], ONE[key], f"{where}: {key}") for key in ONE if key in raw}
    propellers = _table(raw["propellers"], f"{where}: propellers")
    found["propellers"] = {name: entry(value, PROPELLER, f"{where}: propellers.{name}") for name, value in propellers.items()}
    for key in MANY:
        rows = raw.get(key, [])
        if not isinstance(rows, list):
            raise InputError(f"{where}: {key}", shown(rows), f"tables [[{key}]]")
        found[key] = [entry(row, MANY[key], f"{where}: {key}[{number}]") for number, row in enumerate(rows)]
    return found


def entry(raw: Any, keys: Mapping[str, Numbers | Word], where: str) -> dict[str, Any]:
    """Return one entry by the names of its keys, checked and in SI; raises InputError, one line that names the key."""
    known = {**keys, **SOURCES}
    given = {}
    for key, value in _table(raw, where).items():
        name, value = (key, value) if key in known else _in_radians(key, value)
        if name not in known:
            raise InputError(where, f"unknown key '{key}' ({shown(value)})", suggestion(key, known))
        given[name] = known[name].read(value, f"{where}.{key}")
    if ("source" in given) == ("estimated" in given):
        found = "has both 'source' and 'estimated'" if "source" in given else "does not say where its numbers come from"
        raise InputError(where, found, 'give source = "author, year" or estimated = "how"')
    for name, rule in known.items():
        if name not in given and rule.default is REQUIRED:
            raise InputError(where, f"has no '{name}'", "give it")
    return {**{name: rule.default for name, rule in known.items()}, **given}


def matrix_of(keys: Mapping[str, Any], where: str, unit: str = "") -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the matrix that an entry gives by its diagonal or in full; raises InputError unless it is one of them."""
    diagonal, matrix = keys[f"diagonal{unit}"], keys[f"matrix{unit}"]
    if (diagonal is None) == (matrix is None):
        found = "has neither diagonal nor matrix" if diagonal is None else "has both diagonal and matrix"
        raise InputError(where, found, f"give diagonal{unit} or matrix{unit}")
    return np.asarray(np.diag(diagonal) if matrix is None else matrix, dtype=float)


def factors(text: str, where: str) -> tuple[int, int, bool]:
    """Return of a product such as "uv", "|u|v" or "w|w|" the two velocities, and whether the first counts without its sign."""
    plain = text.replace("|", "")
    forms = {plain: False, f"|{plain[:1]}|{plain[1:]}": True, f"{plain[:1]}|{plain[1:]}|": True}
    if len(plain) != 2 or any(letter not in VELOCITIES for letter in plain) or text not in forms:
        raise InputError(
            where, f"'{text}' is no product of two velocities", "two of u v w p q r, one of them between bars if it has no sign"
        )
    first, second = VELOCITIES.index(plain[0]), VELOCITIES.index(plain[1])
    return (second, first, True) if text.endswith("|") else (first, second, forms[text])


def _in_radians(key: str, value: Any) -> tuple[str, Any]:
    """Return an angle in another unit under the key and with the value that it has in rad."""
    name, inside = si(key, value)
    return (key, value) if name == key else (f"{name}_rad", inside)


def _table(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError(where, shown(value), "a table of keys")
    return value


def _numeric(value: Any) -> bool:
    if isinstance(value, list):
        return all(_numeric(item) for item in value)
    return isinstance(value, int | float) and not isinstance(value, bool)
