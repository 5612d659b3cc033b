"""Process model `cruise` with a hull: five degrees of freedom as in cruise.py, whose accelerations are those of the hull's equation.

    v_w = v_b - R^T c          w = (-h' sin p, p', h' cos p)          [v_w; w]' = nu'(v_w, w, R, u)        (models/hull_motion.py)
    v_b' = v_w' - w x R^T c    p'' = w_y'       h'' = (w_z' + h' p' sin p) / cos p        position' = R v_b       R = Rz(h) Ry(p)

v_b is over ground and c the current, so that what is not known of the current reaches the motion through the water and the forces there.
Roll is zero to the hull: what a free hull would roll is left out, and what holds it upright (cruise.py says how roll reaches sensors).
One step is the midpoint rule, and `push` its exact derivative; where the hull stands on end, cos p is taken as no less than 0.05.

Error (12 and more): that of cruise.py, then water.current (2) where the vehicle file has a prior of it.
Source: as models/dynamics.py and models/cruise.py.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.core.earth import gravity, move, third_row
from leadline.core.rotation import cross, load3, store3, turn, turn_back
from leadline.data.hull import BUOYANCY_AT
from leadline.models import cruise
from leadline.models.cruise import (
    ERRORS,
    HEADING,
    HEADING_E,
    KEPT,
    LEAST_ROLL,
    PARTS,
    PITCH,
    PITCH_E,
    PITCHING,
    PITCHING_E,
    ROLL,
    ROLL_E,
    ROLLING,
    ROLLING_E,
    TURN,
    TURN_E,
    V,
    axes_of,
    pull_angles,
    rotation_of,
)
from leadline.models.cruise import pull as cruise_pull
from leadline.models.cruise import view as cruise_view
from leadline.models.driven import (
    BUOYANCY,
    COUNT,
    DRAG,
    EAST,
    ERROR_L,
    HULL,
    NOISES,
    NORTH,
    SURFACE,
    THRUST,
    afloat,
    current_of,
    feed_of,
    hull_of,
    lift_changes,
    parameters_of,
    prior_of,
    settle,
    settle_errors,
    share_of,
    stir,
    value_of,
    values_of,
)
from leadline.models.dynamics import longest_step, push_dense, sloped
from leadline.models.hull_motion import acceleration, slopes
from leadline.models.layout import INPUTS
from leadline.models.process import Process
from leadline.models.view import RATE, TILTING, TURNING, VELOCITY, VELOCITY_V, WATER, WATER_T, WATER_V, north_slope, wander

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.models.process import Pose
    from leadline.models.sensor import Context

MOVING = 14  # numbers of the nominal state before the values of models/driven.py
# Memory: state and input at the start of the step, accelerations, both derivatives of them, then the transition (rows of WIDE).
X_M, U_M, ACC_M, SPEED_M, READY_M, FIRST_M, SECOND_M, PHI_M = 0, 20, 40, 52, 53, 64, 144, 256
DRIVEN = (3, 4, 5, TURN_E, PITCHING_E)  # errors with noise of their own, and its names in the vehicle file
NOISE_NAMES = ("surge_noise", "sway_noise", "heave_noise", "turn_noise", "pitch_noise")
LEAST_COSINE = 0.05


@kernel()
def upright(cp):
    """Cosine of the pitch, or the least that is divided by."""
    return max(cp, LEAST_COSINE) if cp >= 0.0 else min(cp, -LEAST_COSINE)


@kernel()
def through(y, current):
    """Velocity through the water and rate (6), rotation, plumb line, of a motion y (velocity, heading, pitch, and their rates)."""
    c = rotation_of(y[3], y[4], 0.0)
    stream, sp, cp = turn_back(c, (current[0], current[1], 0.0)), math.sin(y[4]), math.cos(y[4])
    nu = (y[0] - stream[0], y[1] - stream[1], y[2] - stream[2], -y[5] * sp, y[6], y[5] * cp)
    return nu, c, (-sp, 0.0, cp)


@kernel()
def accelerate(y, height, u, current, g, drag, thrust, buoyancy, params, m, at):
    """Return the rates of change of a motion y (7); m[at:] is room for six numbers."""
    nu, c, down = through(y, current)
    state = afloat(c, height, params, g, buoyancy)
    acceleration(nu, down, u, params[HULL:], drag, thrust, state[0], state[1], state[2], m, at)
    swung = cross((nu[3], nu[4], nu[5]), turn_back(c, (current[0], current[1], 0.0)))
    turning = (m[at + 5] + y[5] * y[6] * math.sin(y[4])) / upright(math.cos(y[4]))
    return m[at] - swung[0], m[at + 1] - swung[1], m[at + 2] - swung[2], y[5], y[6], turning, m[at + 4]


@kernel()
def moved(y, f, h):
    """Y + h f."""
    return (y[0] + h * f[0], y[1] + h * f[1], y[2] + h * f[2], y[3] + h * f[3], y[4] + h * f[4], y[5] + h * f[5], y[6] + h * f[6])


@kernel()
def motion_of(x):
    """Velocity, heading, pitch, and the rates of these two."""
    return x[V], x[V + 1], x[V + 2], x[HEADING], x[PITCH], x[TURN], x[PITCHING]


@kernel()
def halfway(x, u, dt, params, m):
    """Return the motion, its rates of change and the motion and height half a step on; the arguments are those of `step`."""
    axis = third_row(x[0], x[1], x[2], x[3])
    g, current = gravity(axis, x[4], params[SURFACE]), current_of(x, params)
    drag, thrust, buoyancy = 1.0 + value_of(x, params, DRAG), 1.0 + value_of(x, params, THRUST), value_of(x, params, BUOYANCY)
    y = motion_of(x)
    f = accelerate(y, x[4], u, current, g, drag, thrust, buoyancy, params, m, ACC_M)
    sunk = turn(rotation_of(y[3], y[4], 0.0), (y[0], y[1], y[2]))
    return y, f, moved(y, f, 0.5 * dt), x[4] - 0.5 * dt * sunk[2]


@kernel()
def levelled(params, dt):
    """What is left of a roll after a step (cruise.py)."""
    return math.exp(-dt * params[len(params) - 1])


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step of the midpoint rule under the input that holds."""
    for i in range(MOVING + int(params[COUNT])):
        m[X_M + i] = x[i]
    for i in range(INPUTS):
        m[U_M + i] = u[i]
    m[READY_M] = 0.0
    axis = third_row(x[0], x[1], x[2], x[3])
    g, current = gravity(axis, x[4], params[SURFACE]), current_of(x, params)
    drag, thrust, buoyancy = 1.0 + value_of(x, params, DRAG), 1.0 + value_of(x, params, THRUST), value_of(x, params, BUOYANCY)
    y, _, half, height = halfway(x, u, dt, params, m)
    f = accelerate(half, height, u, current, g, drag, thrust, buoyancy, params, m, ACC_M)
    way = turn(rotation_of(half[3], half[4], 0.0), (half[0], half[1], half[2]))
    move(x, 0, way[0] * dt, way[1] * dt, way[2] * dt)
    y = moved(y, f, dt)
    store3(x, V, (y[0], y[1], y[2]))
    x[HEADING], x[PITCH], x[TURN], x[PITCHING] = y[3], y[4], y[5], y[6]
    x[ROLL] = levelled(params, dt) * x[ROLL] + dt * x[ROLLING]
    x[ROLLING] *= KEPT
    m[SPEED_M] = math.hypot(way[0], way[1])
    settle(x, params, m[SPEED_M], dt)


@kernel()
def change(y, f, d, current, d_current, depth, more, state, params, m, slope, out):
    """Return how the rates of change f of a motion y change with d (7), the current, the depth, and drag, thrust and buoyancy (`more`).

    state: of `afloat`; m[slope:] the derivatives of the hull's equation, m[out:] room for twelve numbers.
    """
    nu, c, _ = through(y, current)
    sp, cp = math.sin(y[4]), math.cos(y[4])
    about, _ = axes_of(y[3], y[4])
    n = (current[0], current[1], 0.0)
    stream = turn_back(c, n)
    across, over = cross((0.0, 0.0, 1.0), n), cross(about, n)
    d_stream = turn_back(c, (d_current[0] - across[0] * d[3] - over[0] * d[4], d_current[1] - across[1] * d[3] - over[1] * d[4],
                             -across[2] * d[3] - over[2] * d[4]))  # fmt: skip
    dw = (-d[5] * sp - y[5] * cp * d[4], d[6], d[5] * cp - y[5] * sp * d[4])
    for i in range(3):
        m[out + i] = d[i] - d_stream[i]
        m[out + 3 + i] = dw[i]
    hull = params[HULL:]
    centre = -cp * hull[BUOYANCY_AT] - sp * hull[BUOYANCY_AT + 2]
    lifts = lift_changes(state, more[2], depth + centre * d[4], -cp * d[4])
    sloped(m, slope, out, (-cp * d[4], 0.0, -sp * d[4]), more[0], more[1], lifts, out + 6)
    first, second = cross(dw, stream), cross((nu[3], nu[4], nu[5]), d_stream)
    least = upright(cp)
    turning = (m[out + 11] + (d[5] * y[6] + y[5] * d[6]) * sp + y[5] * y[6] * cp * d[4]) / least
    if least == cp:
        turning += f[5] * sp / cp * d[4]
    return (m[out + 6] - first[0] - second[0], m[out + 7] - first[1] - second[1], m[out + 8] - first[2] - second[2], d[5], d[6], turning,
            m[out + 10])  # fmt: skip


@kernel()
def linearise(m, dt, params):
    """Put the transition of motion and values (rows of WIDE) at m[PHI_M:]: the derivative of `step`, column by column."""
    x, u, hull, n = m[X_M:], m[U_M:], params[HULL:], ERRORS + int(params[COUNT])
    axis = third_row(x[0], x[1], x[2], x[3])
    g, current = gravity(axis, x[4], params[SURFACE]), current_of(x, params)
    drag, thrust, buoyancy = 1.0 + value_of(x, params, DRAG), 1.0 + value_of(x, params, THRUST), value_of(x, params, BUOYANCY)
    y, f, half, height = halfway(x, u, dt, params, m)
    nu, c0, down = through(y, current)
    state = afloat(c0, x[4], params, g, buoyancy)
    slopes(nu, down, u, hull, drag, thrust, state[0], state[1], state[2], m, FIRST_M)
    nu, c, down = through(half, current)
    half_state = afloat(c, height, params, g, buoyancy)
    slopes(nu, down, u, hull, drag, thrust, half_state[0], half_state[1], half_state[2], m, SECOND_M)
    g_half = accelerate(half, height, u, current, g, drag, thrust, buoyancy, params, m, ACC_M)
    angle, slope = wander(x), north_slope(x)
    cosine, sine = math.cos(angle), math.sin(angle)
    v0, v = turn(c0, (y[0], y[1], y[2])), turn(c, (half[0], half[1], half[2]))
    about0, about = axes_of(y[3], y[4])[0], axes_of(half[3], half[4])[0]
    room = PHI_M + WIDE * (n + 1)
    for j in range(n):
        p = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
        d = (1.0 if j == 3 else 0.0, 1.0 if j == 4 else 0.0, 1.0 if j == 5 else 0.0, 1.0 if j == HEADING_E else 0.0,
             1.0 if j == PITCH_E else 0.0, 1.0 if j == TURN_E else 0.0, 1.0 if j == PITCHING_E else 0.0)  # fmt: skip
        north, east, turns = share_of(params, NORTH, j), share_of(params, EAST, j), slope[0] * p[0] + slope[1] * p[1]
        d_current = (cosine * north + sine * east + current[1] * turns, cosine * east - sine * north - current[0] * turns)
        more = (share_of(params, DRAG, j), share_of(params, THRUST, j), share_of(params, BUOYANCY, j))
        df = change(y, f, d, current, d_current, p[2], more, state, params, m, FIRST_M, room)
        way = _way(c0, v0, about0, d)
        d_half = moved(d, df, 0.5 * dt)
        df = change(half, g_half, d_half, current, d_current, p[2] + 0.5 * dt * way[2], more, half_state, params, m, SECOND_M, room)
        way = _way(c, v, about, d_half)
        end = moved(d, df, dt)
        for i in range(3):
            m[PHI_M + WIDE * i + j] = p[i] + dt * way[i]
        for i in range(7):
            m[PHI_M + WIDE * (3 + i) + j] = end[i]
        for i in range(ROLL_E, n):
            m[PHI_M + WIDE * i + j] = 0.0
    m[PHI_M + (WIDE + 1) * ROLL_E], m[PHI_M + (WIDE + 1) * ROLLING_E] = levelled(params, dt), KEPT
    m[PHI_M + WIDE * ROLL_E + ROLLING_E] = dt
    settle_errors(m, PHI_M, params, m[SPEED_M], dt)
    m[READY_M] = 1.0


@kernel()
def _way(c, v, about, d):
    """Change of R v_b, which is v, with a change d of the motion; pitch turns about `about`."""
    along, across, over = turn(c, (d[0], d[1], d[2])), cross((0.0, 0.0, 1.0), v), cross(about, v)
    return (
        along[0] + across[0] * d[3] + over[0] * d[4],
        along[1] + across[1] * d[3] + over[1] * d[4],
        along[2] + across[2] * d[3] + over[2] * d[4],
    )


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B; Phi is made once for each step."""
    if m[READY_M] == 0.0:
        linearise(m, dt, params)
    push_dense(m, PHI_M, ERRORS + int(params[COUNT]), B, A, columns)


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q: white accelerations of surge, sway, heave, turn and pitch, what drives the values, and roll and its rate."""
    if m[READY_M] == 0.0:
        linearise(m, dt, params)
    stir(m, PHI_M, dt, params, DRIVEN, (0.0, 0.0, 0.0, 0.0, 0.0), ERRORS + int(params[COUNT]), m[SPEED_M], P)
    left = levelled(params, dt)
    P[ROLL_E * (WIDE + 1)] += (1.0 - left * left) * params[NOISES + 5]
    P[ROLLING_E * (WIDE + 1)] += (1.0 - KEPT * KEPT) * params[len(params) - 2]


@kernel(VIEW)
def view(x, u, params, out):
    """As cruise.py, and the velocity through the water."""
    cruise_view(x, u, params, out)
    current = current_of(x, params)
    store3(out, WATER_V, (out[VELOCITY_V] - current[0], out[VELOCITY_V + 1] - current[1], out[VELOCITY_V + 2]))


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """As cruise.py, and of the velocity through the water d(R v_b) - dc."""
    cruise_pull(x, u, params, view, Hv, H, rows)
    h, p, r = x[HEADING], x[PITCH], x[ROLL]
    c, n, angle, slope, stream = rotation_of(h, p, r), load3(view, VELOCITY_V), wander(x), north_slope(x), current_of(x, params)
    cosine, sine = math.cos(angle), math.sin(angle)
    for i in range(rows):
        s = load3(Hv[i], WATER_T)
        body = turn_back(c, s)
        by = pull_angles(h, p, r, 0.0, 0.0, 0.0, cross(n, s), (0.0, 0.0, 0.0))
        turns = s[0] * stream[1] - s[1] * stream[0]
        for j in range(3):
            H[i, 3 + j] += body[j]
            H[i, j] -= turns * slope[j] if j < 2 else 0.0
        H[i, HEADING_E] += by[0]
        H[i, PITCH_E] += by[1]
        H[i, ROLL_E] += by[2]
        for j in range(ERRORS, ERRORS + int(params[COUNT])):
            H[i, j] = 0.0
        if params[ERROR_L] >= 0.0:
            j = int(params[ERROR_L])
            H[i, j], H[i, j + 1] = sine * s[1] - cosine * s[0], -sine * s[0] - cosine * s[1]


def compose(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model `cruise` of a vehicle with a hull; raises InputError as that of `dynamics`."""
    figures, priors = vehicle.process.figures("cruise")
    hull = hull_of(vehicle, figures["hull"])
    more, values = values_of(context, priors)
    noises = [*(figures[name] for name in NOISE_NAMES), max(figures["sigma_roll"], LEAST_ROLL)]
    parameters = parameters_of(values, MOVING, ERRORS, context.surface, figures["density"], noises, hull)
    more_parameters = [figures["sigma_rate"] ** 2, 1.0 / figures["roll"]]
    return Process(
        "cruise", (*PARTS, *more), np.append(parameters, more_parameters), step, push, noise, view, pull,
        frozenset({VELOCITY, RATE, WATER, TURNING, TILTING}),
        begin=partial(begin, prior=prior_of(values), sigma_rate=figures["sigma_rate"]),
        feeds=(feed_of(vehicle, figures["thrusters"], hull),), longest_step=longest_step(hull),
    )  # fmt: skip


def begin(pose: Pose, prior: tuple[Array, Array], sigma_rate: float) -> tuple[Array, Array]:
    """Return the motion at a pose as cruise.py does, and the values of models/driven.py at their means."""
    x, known = cruise.begin(pose, sigma_rate)
    covariance = np.diag(np.concatenate([np.zeros(len(known)), np.square(prior[1])]))
    covariance[: len(known), : len(known)] = known
    return np.concatenate([x, prior[0]]), covariance
