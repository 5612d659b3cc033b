"""A hull: the vehicle as a rigid body in water, as data (after Fossen, 2021), with thrusters and fins.

A hull is read from a TOML file; those in the folder `hulls` are known by name.  Where each number comes from is said beside it.
For the kernels of dynamics.py all of it lies in one flat array, `Hull.parameters`; its layout is below, and nowhere else.
Body axes: forward, starboard, down, from the body origin; generalised velocity nu = (u, v, w, p, q, r).
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.data.hull_keys import ROWS, check, factors, matrix_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.records import Array

FOLDER = Path(__file__).parent / "hulls"
WATER = 1025.0  # kg/m^3: what enclosed water weighs, which is neutral in any sea

# The flat array: a place for each value, then rows of terms, thrusters and fins.
MASS = 0  #         kg, without enclosed water
VOLUME = 1  #       m^3 displaced
ENCLOSED = 2  #     kg of water that moves along
GRAVITY_AT = 3  #   3, m: centre of gravity
BUOYANCY_AT = 6  #  3, m: centre of buoyancy
HEIGHT = 9  #       m over which buoyancy is lost as the hull emerges
LENGTH = 10  #      m over which buoyancy is spread along the hull
THRUSTERS = 11  #   how many thrusters
FINS = 12  #        how many fins
TERMS = 13  #       how many terms
RIGID = 14  #       6 x 6, M_RB
ADDED = 50  #       6 x 6, M_A
INVERSE = 86  #     6 x 6, (M_RB + M_A)^-1
LINEAR = 122  #     6 x 6, linear damping
QUADRATIC = 158  #  6, quadratic damping of each velocity by itself
ROWS_AT = 164  #    thrusters, fins, terms, one after the other
THRUSTER_ROW = 17  # position 3, direction 3, position x direction 3, ahead, astern, decay, torque, 1 / lag, dead band, max, max rate
FIN_ROW = 13  #      position 3, axis 3, position x axis 3, lift, 1 / lag, max, max rate
TERM_ROW = 5  #      force, first velocity, second velocity, 1.0: first without its sign, coefficient
AXIS: Mapping[str, tuple[float, float, float]] = {"rudder": (0.0, 1.0, 0.0), "stern": (0.0, 0.0, -1.0)}


@dataclass(frozen=True, eq=False)
class Thruster:
    """A thruster: T = k n |n| - decay |n| u_a along `direction` (unit, body), with k = ahead or astern (N per rps^2), n in rps.

    u_a (m/s) is the speed of its place through the water along `direction`; `torque` (N m per rps^2) acts on the hull about
    `direction`, with its sign.  Its speed follows the command with the lag (s), up to `most` (rps) and `quickest` (rps/s); a command
    below `dead_band` (rps) is none.
    """

    name: str
    position_b: Array
    direction_b: Array
    ahead: float
    astern: float
    decay: float
    torque: float
    lag: float
    dead_band: float
    most: float
    quickest: float

    @property
    def row(self) -> list[float]:
        """Numbers of the flat array."""
        arm = np.cross(self.position_b, self.direction_b)
        law = (self.ahead, self.astern, self.decay, self.torque, 1.0 / self.lag, self.dead_band, self.most, self.quickest)
        return [*self.position_b, *self.direction_b, *arm, *law]


@dataclass(frozen=True, eq=False)
class Fin:
    """A fin: its angle a (rad) gives the force lift u |u| a (N) along `axis` (unit, body), u being the inflow (m/s) at its place.

    A positive rudder pushes the stern to starboard, a positive stern plane pushes it up (as Prestero, 2001).  The lift that a fin has
    at angle zero belongs to the terms of the hull.  Its angle follows the command with the lag (s), up to `most` and `quickest`.
    """

    name: str
    kind: str
    position_b: Array
    axis_b: Array
    lift: float
    lag: float
    most: float
    quickest: float

    @property
    def row(self) -> list[float]:
        """Numbers of the flat array."""
        arm = np.cross(self.position_b, self.axis_b)
        return [*self.position_b, *self.axis_b, *arm, self.lift, 1.0 / self.lag, self.most, self.quickest]


@dataclass(frozen=True)
class Term:
    """A force or moment (0 to 5: X Y Z K M N) of `coefficient` times two velocities through the water; `bare`: |first| times second."""

    force: int
    first: int
    second: int
    bare: bool
    coefficient: float

    @property
    def row(self) -> list[float]:
        """Numbers of the flat array."""
        return [self.force, self.first, self.second, float(self.bare), self.coefficient]


@dataclass(frozen=True, eq=False)
class Hull:
    """A rigid body in water, SI units, body axes and body origin.

    mass (kg) without `enclosed` (kg), the water in flooded spaces, which moves along, has inertia and no weight; volume (m^3) displaced;
    inertia_b (3, 3) about the body origin, enclosed water included; added_mass, linear_damping (6, 6) and quadratic_damping (6,)
    against forces and moments with positive sign; `height` (m) over which buoyancy is lost at the surface; origins: where the numbers
    come from, by entry.  Raises InputError where a mass matrix or the damping is impossible.
    """

    name: str
    mass: float
    volume: float
    gravity_centre_b: Array
    buoyancy_centre_b: Array
    inertia_b: Array
    added_mass: Array
    linear_damping: Array
    quadratic_damping: Array
    length: float
    height: float
    thrusters: tuple[Thruster, ...] = ()
    fins: tuple[Fin, ...] = ()
    terms: tuple[Term, ...] = ()
    enclosed: float = 0.0
    origins: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what no body can have."""
        for key, matrix in (("inertia", self.inertia_b), ("added_mass", self.added_mass)):
            if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12 * np.abs(matrix).max()):
                raise InputError(f"{self.name}: {key}", "is not symmetric", "a symmetric matrix")
        damping = 0.5 * (self.linear_damping + self.linear_damping.T)
        signs = (
            ("mass and inertia", self.rigid_mass, True),
            ("added_mass", self.added_mass, False),
            ("mass, inertia and added_mass", self.rigid_mass + self.added_mass, True),
            ("linear_damping", damping, False),
        )
        for key, matrix, strictly in signs:
            lowest, scale = np.linalg.eigvalsh(matrix)[0], np.abs(matrix).max()
            if lowest <= 0 if strictly else lowest < -1e-12 * scale:
                right = "one that is positive definite" if strictly else "one without negative eigenvalues"
                raise InputError(f"{self.name}: {key}", f"its matrix has the eigenvalue {lowest:.4g}", right)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of thrusters and fins, in the order in which they stand in commands and in the state."""
        return (*(thruster.name for thruster in self.thrusters), *(fin.name for fin in self.fins))

    @property
    def states(self) -> int:
        """Length of the state: position_t 3, quaternion_tb 4, nu 6, one for each actuator."""
        return 13 + len(self.thrusters) + len(self.fins)

    @cached_property
    def rigid_mass(self) -> Array:
        """M_RB (6, 6) about the body origin, enclosed water included (Fossen, 2021, eq. 3.26)."""
        moment = self.mass * self.gravity_centre_b + self.enclosed * self.buoyancy_centre_b
        off = np.array([[0, -moment[2], moment[1]], [moment[2], 0, -moment[0]], [-moment[1], moment[0], 0]])
        return np.block([[(self.mass + self.enclosed) * np.eye(3), -off], [off, self.inertia_b]])

    @cached_property
    def parameters(self) -> Array:
        """All that the kernels read, as one flat array."""
        head = [self.mass, self.volume, self.enclosed, *self.gravity_centre_b, *self.buoyancy_centre_b, self.height, self.length]
        counts = [len(self.thrusters), len(self.fins), len(self.terms)]
        inverse = np.linalg.inv(self.rigid_mass + self.added_mass)
        matrices = [m.ravel() for m in (self.rigid_mass, self.added_mass, inverse, self.linear_damping, self.quadratic_damping)]
        rows = [*(t.row for t in self.thrusters), *(fin.row for fin in self.fins), *(term.row for term in self.terms)]
        return np.concatenate([np.array([*head, *counts], float), *matrices, *(np.array(row, float) for row in rows)])


def hulls() -> tuple[str, ...]:
    """Return the names of the hulls that come with Leadline."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def read_hull(name: str | Path) -> Hull:
    """Read a hull by its name, or from the path of a TOML file.

    Raises InputError, one line, for an unknown name, wrong TOML, an unknown, missing or impossible value, and an entry that does not say
    where its numbers come from.
    """
    path = FOLDER / f"{name}.toml" if str(name) in hulls() else Path(name)
    try:
        return hull_from_toml(path.read_text(encoding="utf-8"), str(name))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(name, "is no hull that can be read", suggestion(str(name), hulls()) + ", or give the path of a file") from error


def hull_from_toml(text: str, where: str = "hull") -> Hull:
    """Make a hull of the text of a hull file; raises as `read_hull`."""
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(where, f"is not TOML: {error}") from error
    keys = check(raw, where)
    free = {"diagonal": np.zeros(6), "matrix": None}
    return Hull(
        name=keys["name"],
        mass=keys["mass"]["value_kg"],
        volume=keys["volume"]["value_m3"],
        enclosed=keys.get("enclosed_water", {"value_kg": 0.0})["value_kg"],
        gravity_centre_b=keys["gravity_centre"]["position_m"],
        buoyancy_centre_b=keys["buoyancy_centre"]["position_m"],
        inertia_b=matrix_of(keys["inertia"], f"{where}: inertia", "_kgm2"),
        added_mass=matrix_of(keys["added_mass"], f"{where}: added_mass"),
        linear_damping=matrix_of(keys.get("linear_damping", free), f"{where}: linear_damping"),
        quadratic_damping=keys["quadratic_damping"]["diagonal"],
        length=keys["size"]["length_m"],
        height=keys["size"]["height_m"],
        terms=tuple(_term(row, f"{where}: terms[{number}]") for number, row in enumerate(keys["terms"])),
        thrusters=tuple(_thruster(row, keys["propellers"], f"{where}: thrusters[{n}]") for n, row in enumerate(keys["thrusters"])),
        fins=tuple(_fin(row, f"{where}: fins[{number}]") for number, row in enumerate(keys["fins"])),
        origins=_origins(keys),
    )


def _origins(keys: Mapping[str, Any]) -> dict[str, str]:
    """Return where each entry comes from, as a sentence for a person."""
    found = {}
    for key, value in keys.items():
        entries = value if isinstance(value, dict) and key == "propellers" else {"": value}
        if isinstance(value, list):
            entries = {str(row.get("name", number)): row for number, row in enumerate(value)}
        for name, row in entries.items():
            if isinstance(row, dict):
                place = f"{key}.{name}" if name else key
                found[place] = row["source"] or f"estimated: {row['estimated']}"
    return found


def _term(row: Mapping[str, Any], where: str) -> Term:
    first, second, bare = factors(row["of"], f"{where}.of")
    return Term(ROWS.index(row["force"]), first, second, bare, row["coefficient"])


def _thruster(row: Mapping[str, Any], propellers: Mapping[str, Any], where: str) -> Thruster:
    if row["propeller"] not in propellers:
        raise InputError(f"{where}.propeller", f"'{row['propeller']}' is not known", suggestion(row["propeller"], propellers))
    law = propellers[row["propeller"]]
    if abs(row["turns"]) != 1.0:
        raise InputError(f"{where}.turns", f"{row['turns']:g}", "1, or -1 for one that turns the other way")
    return Thruster(
        name=row["name"],
        position_b=row["position_m"],
        direction_b=_unit(row["direction"], f"{where}.direction"),
        ahead=law["ahead_n_per_rps2"],
        astern=law["astern_n_per_rps2"],
        decay=law["decay_n_per_rps_per_mps"],
        torque=-row["turns"] * law["torque_nm_per_rps2"],
        lag=law["lag_s"],
        dead_band=law["dead_band_rps"],
        most=law["max_rps"],
        quickest=law["max_rate_rps_per_s"],
    )


def _fin(row: Mapping[str, Any], where: str) -> Fin:
    axis = np.array(AXIS[row["kind"]]) if row["axis"] is None else row["axis"]
    return Fin(
        name=row["name"],
        kind=row["kind"],
        position_b=row["position_m"],
        axis_b=_unit(axis, f"{where}.axis"),
        lift=row["lift_n_per_rad_per_m2ps2"],
        lag=row["lag_s"],
        most=row["max_rad"],
        quickest=row["max_rate_radps"],
    )


def _unit(vector: Array, where: str) -> Array:
    """Return a direction of length one; as it is written it may be short of that by rounding."""
    length = float(np.linalg.norm(vector))
    if abs(length - 1.0) > 2e-3:
        raise InputError(where, f"has the length {length:.4g}", "a direction of length 1")
    return vector / length
