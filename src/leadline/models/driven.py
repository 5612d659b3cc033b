"""What the process models have in common that thrusters drive: the hull, the rows that are their input, the water, and unknown scales.

Five values drive the motion beside the input: the current along true north and east, shares by which drag and thrust are larger, and
buoyancy (N, up) that the hull file does not know.  Each is a state where the vehicle file has a prior of it that is to be estimated, and
else a constant: zero, or the prior's value.  States come behind the motion in this order, and follow the laws of nuisances.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.compiled import WIDE, kernel
from leadline.data.errors import InputError
from leadline.data.hull import BUOYANCY_AT, HEIGHT, LENGTH, MASS, VOLUME, hulls, read_hull
from leadline.models.layout import INPUTS, NOW_U, Block, Part
from leadline.models.process import Feed
from leadline.models.sensor import nuisances_of
from leadline.models.view import wander

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from leadline.data.hull import Hull
    from leadline.data.records import Array, Thruster
    from leadline.data.vehicle import Prior, Vehicle
    from leadline.models.nuisance import Nuisance
    from leadline.models.sensor import Context

CURRENT = "water.current"
OWN: Mapping[str, str] = {"drag": "1", "thrust": "1", "buoyancy": "N"}
# The head of the parameters: of each value its place in the nominal state and in the error (-1: a constant), its mean (or what it is), its
# decay and the density of what drives it, per second and per metre; then the water, six densities of noise, how many values are states.
NORTH, EAST, DRAG, THRUST, BUOYANCY, VALUES = range(6)
NOMINAL_L, ERROR_L, MEAN_L, RATE_L, DENSITY_L, METRE_RATE_L, METRE_DENSITY_L, LAW = range(8)
SURFACE = VALUES * LAW
WATER, NOISES, COUNT, HULL = SURFACE + 1, SURFACE + 2, SURFACE + 8, SURFACE + 9
STRIPS, LEAST_WET = 7, 0.5  # that the hull is cut into where it can emerge, and what of its lift each keeps at least


@kernel()
def value_of(x, params, k):
    """One of the five values: a state, or a constant."""
    at = LAW * k
    return x[int(params[at + NOMINAL_L])] if params[at + NOMINAL_L] >= 0.0 else params[at + MEAN_L]


@kernel()
def share_of(params, k, error):
    """One where an error of the state is that of value k, else zero."""
    return 1.0 if params[LAW * k + ERROR_L] == error else 0.0


@kernel()
def current_of(x, params):
    """Current along the first two axes of the navigation frame; x begins with a place."""
    angle, north, east = wander(x), value_of(x, params, NORTH), value_of(x, params, EAST)
    c, s = math.cos(angle), math.sin(angle)
    return c * north + s * east, c * east - s * north


@kernel()
def afloat(c, height, params, g, buoyancy):
    """Weight, lift (N), its lever along the hull (N m); both per newton of buoyancy; and sums of slopes of lift against depth (N/m).

    The hull is cut into strips along its length, and each loses lift as it emerges from the mean surface: linearly over the hull's
    height, and half of it at most, so that an estimate that hangs above the sea, or a tide that nobody tells of, falls slowly.  The sums
    are of the slope itself, times the strip's place, and times its square.
    """
    weight = params[HULL + MASS] * g
    whole = params[WATER] * params[HULL + VOLUME] * g + buoyancy
    centre = c[6] * params[HULL + BUOYANCY_AT] + c[7] * params[HULL + BUOYANCY_AT + 1] + c[8] * params[HULL + BUOYANCY_AT + 2]
    depth, tall, length = params[SURFACE] - height + centre, params[HULL + HEIGHT], params[HULL + LENGTH]
    if depth > 0.5 * (length + tall):
        return weight, whole, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0
    share, lever, s0, s1, s2 = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(STRIPS):
        at = length * ((k + 0.5) / STRIPS - 0.5)
        wet = (depth + c[6] * at) / tall + 0.5
        if LEAST_WET < wet < 1.0:
            slope = whole / (STRIPS * tall)
            s0, s1, s2 = s0 + slope, s1 + slope * at, s2 + slope * at * at
        wet = min(max(wet, LEAST_WET), 1.0) / STRIPS
        share, lever = share + wet, lever + wet * at
    return weight, whole * share, whole * lever, share, lever, s0, s1, s2


@kernel()
def lift_changes(state, more, depth, tilt):
    """Change of lift and of its lever, with that of buoyancy (N), of the depth of the centre (m) and of the tilt c[6]; state: of afloat."""
    return (
        state[3] * more + state[5] * depth + state[6] * tilt,
        state[4] * more + state[6] * depth + state[7] * tilt,
    )


@kernel()
def left(params, k, speed, dt):
    """What is left of a value's distance from its mean after a step at a speed over ground."""
    return math.exp(-dt * (params[LAW * k + RATE_L] + speed * params[LAW * k + METRE_RATE_L]))


@kernel()
def settle(x, params, speed, dt):
    """Move the values that are states towards their means, in place."""
    for k in range(VALUES):
        if params[LAW * k + NOMINAL_L] >= 0.0:
            i, mean = int(params[LAW * k + NOMINAL_L]), params[LAW * k + MEAN_L]
            x[i] = mean + (x[i] - mean) * left(params, k, speed, dt)


@kernel()
def settle_errors(transition, at, params, speed, dt):
    """Write what is left of each value on the diagonal of a transition, whose rows of WIDE begin at transition[at]."""
    for k in range(VALUES):
        if params[LAW * k + ERROR_L] >= 0.0:
            transition[at + (WIDE + 1) * int(params[LAW * k + ERROR_L])] = left(params, k, speed, dt)


@kernel()
def stir(m, at, dt, params, driven, more, n, speed, P):
    """P += what white noise makes in a step: on errors `driven` (`more` than the parameters say), and on values that are states.

    By Simpson's rule, with half a step as the mean of none and a whole one, of a transition whose n rows of WIDE begin at m[at]: exact
    for what the noise moves straight on, as a velocity moves a position.
    """
    drivers = len(driven)
    for s in range(drivers + VALUES):
        if s < drivers:
            column, density = driven[s], params[NOISES + s] + more[s]
        else:
            law = LAW * (s - drivers)
            column, density = int(params[law + ERROR_L]), params[law + DENSITY_L] + speed * params[law + METRE_DENSITY_L]
        if column < 0 or density == 0.0:
            continue
        for i in range(n):
            a0, a = 1.0 if i == column else 0.0, m[at + WIDE * i + column]
            for j in range(n):
                b0, b = 1.0 if j == column else 0.0, m[at + WIDE * j + column]
                P[WIDE * i + j] += density * dt / 6.0 * (a0 * b0 + (a0 + a) * (b0 + b) + a * b)


def hull_of(vehicle: Vehicle, name: str) -> Hull:
    """Return the hull of a name, or of a file that lies beside the vehicle file; raises InputError where it has too many actuators."""
    beside = name.endswith(".toml") and name not in hulls() and vehicle.path is not None and not Path(name).is_absolute()
    hull = read_hull(str(Path(vehicle.path).parent / name) if beside and vehicle.path is not None else name)
    if len(hull.actuators) > NOW_U:
        found = f"'{hull.name}' has {len(hull.thrusters)} thrusters and {len(hull.fins)} fins"
        raise InputError(f"process.{vehicle.process.model}.hull", found, f"at most {NOW_U} of them")
    return hull


def feed_of(vehicle: Vehicle, sensor: str, hull: Hull) -> Feed:
    """Return the feed of the sensor whose rows drive a hull; raises InputError where the vehicle lacks it, or it is of another kind."""
    config = vehicle[sensor]
    if config.kind != "thruster":
        others = [name for name, other in vehicle.sensors.items() if other.kind == "thruster"]
        right = f"one of {', '.join(others)}" if others else "add a sensor of kind thruster"
        raise InputError(f"process.{vehicle.process.model}.thrusters", f"'{sensor}' is of kind {config.kind}", right)

    def rows(table: Any) -> Array:
        return inputs_of(table, sensor, hull)

    return Feed(sensor, rows)


def inputs_of(table: Thruster, sensor: str, hull: Hull) -> Array:
    """Return the inputs (n, INPUTS) of a table: speeds of the thrusters (rps), then angles of the fins (rad), in the order of the hull.

    Raises InputError where the table has another number of thrusters than the hull, or lacks the angle of its fins.
    """
    count = len(hull.thrusters)
    found = np.shape(table.thruster)[1] if np.ndim(table.thruster) == 2 else 0
    if found != count:
        raise InputError(sensor, f"has {found} thrusters, and the hull '{hull.name}' has {count}", "a table and a hull of one vehicle")
    inputs = np.full((len(table), INPUTS), np.nan)
    inputs[:, :count] = table.thruster
    for i, fin in enumerate(hull.fins):
        angle = table.rudder if fin.kind == "rudder" else table.stern
        if angle is None:
            raise InputError(sensor, f"has no angle of the {fin.kind}, and the hull '{hull.name}' has one", f"a column of the {fin.kind}")
        inputs[:, count + i] = angle
    return inputs


def values_of(context: Context, priors: Mapping[str, Prior]) -> tuple[tuple[Part, ...], tuple[Nuisance, ...]]:
    """Return the parts of the motion that the five values make, and the values themselves."""
    current = nuisances_of(context.shared.get(CURRENT), CURRENT, 2, "m/s", "north-east")
    own = {name: nuisances_of(priors.get(name), f"hull.{name}", 1, unit)[0] for name, unit in OWN.items()}
    parts = [Part(CURRENT, Block.VECTOR, 2, "m/s", "navigation")] if any(c.sigma > 0.0 for c in current) else []
    parts += [Part(value.name, Block.VECTOR, 1, value.unit) for value in own.values() if value.sigma > 0.0]
    return tuple(parts), (*current, *own.values())


def parameters_of(
    values: Sequence[Nuisance], nominal: int, error: int, surface: float, density: float, noise: Sequence[float], hull: Hull
) -> Array:
    """Return the parameters of a driven model whose values begin at a place of the nominal state and of the error."""
    head = np.zeros(HULL)
    estimated = _estimated(values)
    for k, value in enumerate(values):
        at = nominal + sum(estimated[:k]), error + sum(estimated[:k])
        law = (value.rate, value.density, value.per_metre, value.density_per_metre)
        head[LAW * k : LAW * (k + 1)] = (*at, value.value, *law) if estimated[k] else (-1.0, -1.0, value.value, 0.0, 0.0, 0.0, 0.0)
    head[SURFACE], head[WATER], head[COUNT] = surface, density, sum(estimated)
    head[NOISES : NOISES + len(noise)] = np.square(noise)
    return np.concatenate([head, hull.parameters])


def prior_of(values: Sequence[Nuisance]) -> tuple[Array, Array]:
    """Return means and sigmas (count,) of the values that are states."""
    chosen = [value for value, state in zip(values, _estimated(values), strict=True) if state]
    return np.array([v.value for v in chosen], float), np.array([v.sigma for v in chosen], float)


def _estimated(values: Sequence[Nuisance]) -> list[bool]:
    """Return which values are states; the two of a current are so together."""
    current = any(value.sigma > 0.0 for value in values[:DRAG])
    return [current, current, *(value.sigma > 0.0 for value in values[DRAG:])]
