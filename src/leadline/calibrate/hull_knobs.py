"""What of a hull a log can tell: each number that is fitted, with what is known of it before, as one dimensionless value.

x = 0 is the starting hull, x = 1 one sigma away from it: value = start + spread x.  The law is straight, as forces are in their
coefficients: of drag, thrust and its loss with speed a steady run shows the balance alone, and along such a ridge a curved law would lose
the way.
Mass, inertia, added mass and the geometry of thrusters are those of the starting hull, and so is every coefficient that is zero there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.hull_keys import ROWS, VELOCITIES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.data.hull import Hull, Term, Thruster
    from leadline.data.records import Array

SHARE = 0.7  # sigma of a drag, a thrust, a lift or a term, of itself
ALIKE = 0.15  # sigma between thrusters of one make, of their thrust
AFLOAT = 0.02  # sigma of the buoyancy less the weight, of the weight
CENTRE = (0.005, 0.002, 0.01)  # sigma of the place of the centre of gravity, of the length of the hull
CURRENT = 0.3  # m/s: sigma of the current, north and east
MOST, LEFT = 12.0, 0.05  # sigmas from the start that a value may go; what must be left of one that cannot be negative
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
UNITS = {"linear": ("N/(m/s)", "N m/(rad/s)"), "quadratic": ("N/(m/s)^2", "N m/(rad/s)^2")}


@dataclass(frozen=True)
class Knob:
    """One number: part and index say where in the hull it stands, start is its value there, spread its sigma before the log (SI)."""

    name: str
    part: str  # linear, quadratic, term, ahead, astern, decay, torque, lift, buoyancy, gravity, current
    index: int
    unit: str
    start: float
    spread: float

    @property
    def least(self) -> float:
        """The least x."""
        signed = self.part in ("term", "buoyancy", "gravity", "current")
        return -MOST if signed else -(1 - LEFT) * self.start / self.spread

    def value(self, x: float) -> float:
        """Return the number at x."""
        return float(self.start + self.spread * x)


def makes(hull: Hull) -> list[tuple[int, ...]]:
    """Return the thrusters of each make, by number: those that the starting hull gives the same figures."""
    found: dict[tuple[float, ...], list[int]] = {}
    for number, t in enumerate(hull.thrusters):
        law = (t.ahead, t.astern, t.decay, abs(t.torque), t.lag, t.dead_band, t.most, t.quickest)
        found.setdefault(law, []).append(number)
    return [tuple(numbers) for numbers in found.values()]


def knobs_of(hull: Hull, density: float, gravity: float, *, current: bool) -> tuple[Knob, ...]:
    """Return what is fitted of a hull in water of a density (kg/m^3) under gravity (m/s^2); current: and that of the water."""
    found = _drags(hull) + _terms(hull) + _thrusters(hull)
    found += [Knob(f"lift of {f.name}", "lift", k, "N/rad/(m/s)^2", f.lift, SHARE * f.lift) for k, f in enumerate(hull.fins)]
    afloat = (density * hull.volume - hull.mass) * gravity
    found.append(Knob("buoyancy less weight", "buoyancy", 0, "N", afloat, AFLOAT * hull.mass * gravity))
    for k, (axis, share) in enumerate(zip(("forward", "starboard", "down"), CENTRE, strict=True)):
        found.append(Knob(f"centre of gravity, {axis}", "gravity", k, "m", float(hull.gravity_centre_b[k]), share * hull.length))
    if current:
        found += [Knob(f"current, {way}", "current", k, "m/s", 0.0, CURRENT) for k, way in enumerate(("north", "east"))]
    return tuple(found)


def _drags(hull: Hull) -> list[Knob]:
    found = []
    for part, numbers in (("linear", np.diag(hull.linear_damping)), ("quadratic", hull.quadratic_damping)):
        for k, number in enumerate(numbers):
            if number > 0.0:
                found.append(Knob(f"{part} drag in {AXES[k]}", part, k, UNITS[part][k // 3], float(number), SHARE * float(number)))
    return found


def _terms(hull: Hull) -> list[Knob]:
    found = []
    for k, term in enumerate(hull.terms):
        name = f"{ROWS[term.force]} of {_product(term)}"
        if term.coefficient != 0.0:
            found.append(Knob(name, "term", k, "SI", term.coefficient, SHARE * abs(term.coefficient)))
    return found


def _product(term: Term) -> str:
    """Return the product of a term as hull files write it."""
    first, second = VELOCITIES[term.first], VELOCITIES[term.second]
    if not term.bare:
        return first + second
    return f"{second}|{first}|" if first == second else f"|{first}|{second}"


def _thrusters(hull: Hull) -> list[Knob]:
    wide = float(np.hypot(SHARE, ALIKE))
    found = []
    for way in ("ahead", "astern"):
        found += [Knob(f"{t.name} {way}", way, k, "N/rps^2", s, wide * s) for k, t in enumerate(hull.thrusters) if (s := getattr(t, way))]
    for k, make in enumerate(makes(hull)):
        one = hull.thrusters[make[0]]
        names = one.name if len(make) == 1 else f"{one.name} and its like"
        if one.decay > 0.0:
            found.append(Knob(f"loss of thrust with speed of {names}", "decay", k, "N/rps/(m/s)", one.decay, SHARE * one.decay))
        if one.torque != 0.0:
            found.append(Knob(f"torque of {names}", "torque", k, "N m/rps^2", abs(one.torque), SHARE * abs(one.torque)))
    return found


def prior_information(hull: Hull, knobs: Sequence[Knob]) -> Array:
    """Return the inverse of the covariance of x before the log: one, but for thrusters of one make, which are much alike."""
    covariance = np.eye(len(knobs))
    alike = SHARE**2 / (SHARE**2 + ALIKE**2)
    make_of = {number: k for k, make in enumerate(makes(hull)) for number in make}
    for i, a in enumerate(knobs):
        for j, b in enumerate(knobs):
            if i != j and a.part == b.part and a.part in ("ahead", "astern") and make_of[a.index] == make_of[b.index]:
                covariance[i, j] = alike
    return np.asarray(np.linalg.inv(covariance))


def current_of(knobs: Sequence[Knob], x: Array) -> Array:
    """Return the current, north and east (2,), m/s: zero where it is not fitted."""
    return np.array([sum(k.value(v) for k, v in zip(knobs, x, strict=True) if k.part == "current" and k.index == i) for i in (0, 1)])


def hull_with(hull: Hull, knobs: Sequence[Knob], x: Array, density: float, gravity: float) -> Hull:
    """Return the hull with the numbers at x."""
    values = {(k.part, k.index): k.value(v) for k, v in zip(knobs, x, strict=True)}
    root = np.sqrt([values.get(("linear", k), d) / d if d > 0 else 1.0 for k, d in enumerate(np.diag(hull.linear_damping))])
    quadratic = np.array([values.get(("quadratic", k), d) for k, d in enumerate(hull.quadratic_damping)])
    make_of = {number: k for k, make in enumerate(makes(hull)) for number in make}
    afloat = values.get(("buoyancy", 0))
    return replace(
        hull,
        linear_damping=hull.linear_damping * np.outer(root, root),
        quadratic_damping=quadratic,
        terms=tuple(replace(t, coefficient=values.get(("term", k), t.coefficient)) for k, t in enumerate(hull.terms)),
        thrusters=tuple(_thruster_with(t, k, make_of[k], values) for k, t in enumerate(hull.thrusters)),
        fins=tuple(replace(f, lift=values.get(("lift", k), f.lift)) for k, f in enumerate(hull.fins)),
        volume=hull.volume if afloat is None else (hull.mass + afloat / gravity) / density,
        gravity_centre_b=np.array([values.get(("gravity", k), v) for k, v in enumerate(hull.gravity_centre_b)]),
    )


def _thruster_with(thruster: Thruster, number: int, make: int, values: dict[Any, float]) -> Thruster:
    torque = float(np.copysign(values.get(("torque", make), abs(thruster.torque)), thruster.torque))
    ways = {way: values.get((way, number), getattr(thruster, way)) for way in ("ahead", "astern")}
    return replace(thruster, **ways, decay=values.get(("decay", make), thruster.decay), torque=torque)
