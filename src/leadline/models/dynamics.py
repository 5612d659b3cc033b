"""Process model `dynamics`: a hull in six degrees of freedom, driven by the measured speeds of its thrusters and angles of its fins.

    p' = R v + c        R' = R [w]x        [v; w]' = nu'(v, w, R, u)             (models/hull_motion.py)

v (m/s) is the velocity of the body origin through the water and w (rad/s) the rate against the navigation frame, both in body axes; c is
the current, level, given by its parts along true north and east.  An input holds until the next row of the thrusters.  One step is the
midpoint rule, with the rotation of the body exact in the mean rate:

    nu_m = nu + dt/2 nu'(nu, R)      R_m = R exp(dt/2 w)
    nu   + dt nu'(nu_m, R_m)         R exp(dt w_m)         p + dt (R_m v_m + c)

`push` is the exact derivative of that.  The step is chosen so that the fastest mode of the hull at speed turns by less than a half
within it, which is far inside the rule's stability (2).
A hull that emerges from the mean surface loses lift strip by strip, so that it floats and is righted; waves and splashing are noise there.

Error (12 and more): position, velocity through the water (additive), attitude (rotation vector in n, on the left), rate (additive); then,
where the vehicle file has a prior of them: water.current (2, m/s), hull.drag and hull.thrust (shares), hull.buoyancy (N, up).
Left out, as below 1e-6 of what is there: the turning of Earth and navigation frame in the momentum equation (2e-7 rad/s of transport; the
turning Earth moves vehicle and water alike), and the curvature of the Earth in the transition.
Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2021), ch. 6, 7, 10; its use in a filter: Allotta et al.,
Development of a Navigation Algorithm for Autonomous Underwater Vehicles.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.attitude import matrix_from_quaternion
from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.core.earth import curvature, gravity, level_rotation, third_row
from leadline.core.rotation import (
    cross,
    exponential,
    load3,
    load4,
    load_matrix,
    product,
    store3,
    store_quaternion,
    turn,
    turn_back,
)
from leadline.data.hull import BUOYANCY_AT
from leadline.models.driven import (
    BUOYANCY,
    COUNT,
    DRAG,
    EAST,
    ERROR_L,
    HULL,
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
from leadline.models.hull_motion import DOWN_S, DRAG_S, LEVER_S, LIFT_S, SIX, SLOPE, THRUST_S, acceleration, slopes
from leadline.models.layout import INPUTS, Block, Part
from leadline.models.process import Process
from leadline.models.view import (
    ATTITUDE_T,
    FORCE_V,
    POSITION_T,
    QUATERNION_V,
    RATE,
    RATE_T,
    RATE_V,
    RATE_VARIANCE_V,
    TURNING,
    VELOCITY,
    VELOCITY_T,
    VELOCITY_V,
    WATER,
    WATER_T,
    WATER_V,
    north_slope,
    wander,
)

if TYPE_CHECKING:
    from leadline.data.hull import Hull
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.models.process import Pose
    from leadline.models.sensor import Context

MOTION = (
    Part("position", Block.PLACE, 3, "m"),
    Part("velocity_water", Block.VECTOR, 3, "m/s", "body"),
    Part("attitude", Block.ATTITUDE, 3, "rad", "navigation"),
    Part("rate", Block.VECTOR, 3, "rad/s", "body"),
)
# Places in the nominal state, and how many errors there are before the values of models/driven.py.
P, H, V, Q, W, MOVING, MOVING_E = 0, 4, 5, 8, 12, 15, 12
# Memory: state and input at the start of the step, accelerations, both derivatives of them, then the transition (rows of WIDE).
X_M, U_M, ACC_M, SPEED_M, READY_M, SHARE_M, FIRST_M, SECOND_M, PHI_M = 0, 20, 40, 52, 53, 54, 64, 144, 256
DRIVEN = (3, 4, 5, 9, 10, 11)  # errors with noise of their own, and its names in the vehicle file
NOISE_NAMES = ("surge_noise", "sway_noise", "heave_noise", "roll_noise", "pitch_noise", "turn_noise")
SPLASH_HEAVE, SPLASH_ROLL, SPLASH_PITCH = 0.05, 0.05, 0.05  # m/s, rad/s per root of a second: more noise of a hull that emerges
REACH, LONGEST, SHORTEST = 0.5, 0.05, 0.005  # of the fastest mode, and the bounds of a step (s)


@kernel()
def load6(x):
    """Velocity and rate."""
    return x[V], x[V + 1], x[V + 2], x[W], x[W + 1], x[W + 2]


@kernel()
def halfway(x, c, a, at, dt):
    """Velocity and rate, quaternion and height half a step on, with accelerations a[at:]."""
    nu, h = load6(x), 0.5 * dt
    q = product(load4(x, Q), exponential(h * nu[3], h * nu[4], h * nu[5]))
    down = c[6] * nu[0] + c[7] * nu[1] + c[8] * nu[2]
    return (
        (
            nu[0] + h * a[at],
            nu[1] + h * a[at + 1],
            nu[2] + h * a[at + 2],
            nu[3] + h * a[at + 3],
            nu[4] + h * a[at + 4],
            nu[5] + h * a[at + 5],
        ),
        q,
        x[H] - h * down,
    )


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step of the midpoint rule under the input that holds."""
    for i in range(MOVING + int(params[COUNT])):
        m[X_M + i] = x[i]
    for i in range(INPUTS):
        m[U_M + i] = u[i]
    m[READY_M] = 0.0
    axis = third_row(x[P], x[P + 1], x[P + 2], x[P + 3])
    k, g, hull = curvature(axis, x[H]), gravity(axis, x[H], params[SURFACE]), params[HULL:]
    drag, thrust, buoyancy = 1.0 + value_of(x, params, DRAG), 1.0 + value_of(x, params, THRUST), value_of(x, params, BUOYANCY)
    c = load_matrix(x, Q)
    state = afloat(c, x[H], params, g, buoyancy)
    acceleration(load6(x), load3(c, 6), u, hull, drag, thrust, state[0], state[1], state[2], m, ACC_M)
    nu, q, height = halfway(x, c, m, ACC_M, dt)
    store_quaternion(m, ACC_M + 6, q)
    c = load_matrix(m, ACC_M + 6)
    state = afloat(c, height, params, g, buoyancy)
    acceleration(nu, load3(c, 6), u, hull, drag, thrust, state[0], state[1], state[2], m, ACC_M)

    m[SHARE_M] = state[3]
    v, current = turn(c, (nu[0], nu[1], nu[2])), current_of(x, params)
    t0, t1 = level_rotation(axis, k, (v[0] + current[0]) * dt, (v[1] + current[1]) * dt)
    store_quaternion(x, P, product(load4(x, P), exponential(t0, t1, 0.0)))
    x[H] -= v[2] * dt
    store_quaternion(x, Q, product(load4(x, Q), exponential(nu[3] * dt, nu[4] * dt, nu[5] * dt)))
    for i in range(3):
        x[V + i] += dt * m[ACC_M + i]
        x[W + i] += dt * m[ACC_M + 3 + i]
    m[SPEED_M] = math.hypot(v[0] + current[0], v[1] + current[1])
    settle(x, params, m[SPEED_M], dt)


@kernel()
def change(r, a):
    """J a: what a change of the rotation vector r does to exp(r), as a rotation on the left; to the fourth order in r."""
    t = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    first, second = 0.5 - t * (1 / 24 - t / 720), 1 / 6 - t * (1 / 120 - t / 5040)
    once = cross(r, a)
    twice = cross(r, once)
    return (
        a[0] + first * once[0] + second * twice[0],
        a[1] + first * once[1] + second * twice[1],
        a[2] + first * once[2] + second * twice[2],
    )


@kernel()
def sloped(m, at, d, turned, drag, thrust, lifts, out):
    """Put the change of the accelerations at m[out:], of changes of nu (m[d:]), of the plumb line, of drag, thrust, lift and lever."""
    for i in range(6):
        s = at + SLOPE * i
        total = m[s + DOWN_S] * turned[0] + m[s + DOWN_S + 1] * turned[1] + m[s + DOWN_S + 2] * turned[2]
        total += m[s + DRAG_S] * drag + m[s + THRUST_S] * thrust + m[s + LIFT_S] * lifts[0] + m[s + LEVER_S] * lifts[1]
        for j in range(6):
            total += m[s + j] * m[d + j]
        m[out + i] = total


@kernel()
def linearise(m, dt, params):
    """Put the transition of motion and values (rows of WIDE) at m[PHI_M:]: the derivative of `step`, column by column."""
    x, u, hull, h = m[X_M:], m[U_M:], params[HULL:], 0.5 * dt
    axis = third_row(x[P], x[P + 1], x[P + 2], x[P + 3])
    g = gravity(axis, x[H], params[SURFACE])
    drag, thrust, buoyancy = 1.0 + value_of(x, params, DRAG), 1.0 + value_of(x, params, THRUST), value_of(x, params, BUOYANCY)
    c0 = load_matrix(x, Q)
    nu0 = load6(x)
    state0 = afloat(c0, x[H], params, g, buoyancy)
    acceleration(nu0, load3(c0, 6), u, hull, drag, thrust, state0[0], state0[1], state0[2], m, ACC_M)
    slopes(nu0, load3(c0, 6), u, hull, drag, thrust, state0[0], state0[1], state0[2], m, FIRST_M)
    nu, q, height = halfway(x, c0, m, ACC_M, dt)
    store_quaternion(m, ACC_M + 6, q)
    c = load_matrix(m, ACC_M + 6)
    state = afloat(c, height, params, g, buoyancy)
    slopes(nu, load3(c, 6), u, hull, drag, thrust, state[0], state[1], state[2], m, SECOND_M)
    v0, v, centre = turn(c0, (nu0[0], nu0[1], nu0[2])), turn(c, (nu[0], nu[1], nu[2])), load3(hull, BUOYANCY_AT)
    at0, at1 = turn(c0, centre), turn(c, centre)
    angle, stream, slope = wander(x), current_of(x, params), north_slope(x)
    cosine, sine = math.cos(angle), math.sin(angle)
    n = MOVING_E + int(params[COUNT])
    for j in range(n):
        at = PHI_M + WIDE * n + WIDE  # the column's own change: six of nu, then six of the accelerations
        for i in range(12):
            m[at + i] = 0.0
        p = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
        t0 = (1.0 if j == 6 else 0.0, 1.0 if j == 7 else 0.0, 1.0 if j == 8 else 0.0)
        if 3 <= j < 6:
            m[at + j - 3] = 1.0
        elif 9 <= j < 12:
            m[at + j - 6] = 1.0
        north, east = share_of(params, NORTH, j), share_of(params, EAST, j)
        more_drag, more_thrust, more_lift = share_of(params, DRAG, j), share_of(params, THRUST, j), share_of(params, BUOYANCY, j)
        dv0, dw0 = load3(m, at), load3(m, at + 3)
        lifts = lift_changes(state0, more_lift, p[2] + t0[0] * at0[1] - t0[1] * at0[0], t0[0] * c0[3] - t0[1] * c0[0])
        sloped(m, FIRST_M, at, turn_back(c0, (-t0[1], t0[0], 0.0)), more_drag, more_thrust, lifts, at + 6)
        for i in range(6):
            m[at + i] += h * m[at + 6 + i]
        swung, sunk = turn(c0, change((h * nu0[3], h * nu0[4], h * nu0[5]), (h * dw0[0], h * dw0[1], h * dw0[2]))), turn(c0, dv0)
        t = (t0[0] + swung[0], t0[1] + swung[1], t0[2] + swung[2])
        depth = p[2] + h * (sunk[2] + t0[0] * v0[1] - t0[1] * v0[0])
        lifts = lift_changes(state, more_lift, depth + t[0] * at1[1] - t[1] * at1[0], t[0] * c[3] - t[1] * c[0])
        sloped(m, SECOND_M, at, turn_back(c, (-t[1], t[0], 0.0)), more_drag, more_thrust, lifts, at + 6)
        dv, dw, turned = turn(c, load3(m, at)), load3(m, at + 3), cross(t, v)
        north_turns = slope[0] * p[0] + slope[1] * p[1]
        d_current = (cosine * north + sine * east + stream[1] * north_turns, cosine * east - sine * north - stream[0] * north_turns, 0.0)
        swung = turn(c0, change((dt * nu[3], dt * nu[4], dt * nu[5]), (dt * dw[0], dt * dw[1], dt * dw[2])))
        for i in range(3):
            row = PHI_M + j + WIDE * i
            m[row] = p[i] + dt * (dv[i] + turned[i] + d_current[i])
            m[row + 3 * WIDE] = dv0[i] + dt * m[at + 6 + i]
            m[row + 6 * WIDE] = t0[i] + swung[i]
            m[row + 9 * WIDE] = dw0[i] + dt * m[at + 9 + i]
        for i in range(MOVING_E, n):
            m[PHI_M + j + WIDE * i] = 0.0
    settle_errors(m, PHI_M, params, m[SPEED_M], dt)
    m[READY_M] = 1.0


@kernel()
def push_dense(m, at, n, B, A, columns):
    """A = Phi B, with the n rows (of WIDE) of Phi at m[at:]."""
    for i in range(n):
        row, a = at + WIDE * i, WIDE * i
        for j in range(columns):
            A[a + j] = m[row] * B[j]
        for k in range(1, n):
            f, b = m[row + k], WIDE * k
            if f != 0.0:
                for j in range(columns):
                    A[a + j] += f * B[b + j]


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B; Phi is made once for each step."""
    if m[READY_M] == 0.0:
        linearise(m, dt, params)
    push_dense(m, PHI_M, MOVING_E + int(params[COUNT]), B, A, columns)


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q: white accelerations of surge, sway, heave, roll, pitch and turn, and what drives the values."""
    if m[READY_M] == 0.0:
        linearise(m, dt, params)
    splash = 1.0 if m[SHARE_M] < 1.0 else 0.0
    more = (0.0, 0.0, splash * SPLASH_HEAVE**2, splash * SPLASH_ROLL**2, splash * SPLASH_PITCH**2, 0.0)
    stir(m, PHI_M, dt, params, DRIVEN, more, MOVING_E + int(params[COUNT]), m[SPEED_M], P)


@kernel(VIEW)
def view(x, u, params, out):
    """Place, velocity over ground and through the water, attitude, rate; no specific force."""
    for i in range(5):
        out[i] = x[i]
    v, current = turn(load_matrix(x, Q), load3(x, V)), current_of(x, params)
    store3(out, VELOCITY_V, (v[0] + current[0], v[1] + current[1], v[2]))
    for i in range(4):
        out[QUATERNION_V + i] = x[Q + i]
    store3(out, RATE_V, load3(x, W))
    store3(out, FORCE_V, (0.0, 0.0, 0.0))
    store3(out, WATER_V, v)
    out[RATE_VARIANCE_V] = 0.0


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """Over ground and through the water: d(R v) = d theta x (R v) + R dv; the current turns as north does with place."""
    c = load_matrix(x, Q)
    v, stream, slope, angle = turn(c, load3(x, V)), current_of(x, params), north_slope(x), wander(x)
    cosine, sine = math.cos(angle), math.sin(angle)
    for r in range(rows):
        over = (Hv[r, VELOCITY_T], Hv[r, VELOCITY_T + 1], Hv[r, VELOCITY_T + 2])
        both = (over[0] + Hv[r, WATER_T], over[1] + Hv[r, WATER_T + 1], over[2] + Hv[r, WATER_T + 2])
        along, about = turn_back(c, both), cross(v, both)
        turns = over[0] * stream[1] - over[1] * stream[0]
        for i in range(3):
            H[r, i] = Hv[r, POSITION_T + i] + (turns * slope[i] if i < 2 else 0.0)
            H[r, 3 + i] = along[i]
            H[r, 6 + i] = Hv[r, ATTITUDE_T + i] + about[i]
            H[r, 9 + i] = Hv[r, RATE_T + i]
        for i in range(MOVING_E, MOVING_E + int(params[COUNT])):
            H[r, i] = 0.0
        if params[ERROR_L] >= 0.0:
            i = int(params[ERROR_L])
            H[r, i], H[r, i + 1] = cosine * over[0] - sine * over[1], sine * over[0] + cosine * over[1]


def compose(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model `dynamics` of a vehicle.

    Raises InputError where the hull cannot be read or has too many actuators, and where the vehicle has no sensor of its thrusters.
    """
    figures, priors = vehicle.process.figures("dynamics")
    hull = hull_of(vehicle, figures["hull"])
    more, values = values_of(context, priors)
    densities = [figures[name] for name in NOISE_NAMES]
    parameters = parameters_of(values, MOVING, MOVING_E, context.surface, figures["density"], densities, hull)
    return Process(
        "dynamics", (*MOTION, *more), parameters, step, push, noise, view, pull, frozenset({VELOCITY, RATE, WATER, TURNING}),
        begin=partial(begin, parameters=parameters, prior=prior_of(values), sigma_rate=figures["sigma_rate"]),
        feeds=(feed_of(vehicle, figures["thrusters"], hull),), longest_step=longest_step(hull),
    )  # fmt: skip


def begin(pose: Pose, parameters: Array, prior: tuple[Array, Array], sigma_rate: float) -> tuple[Array, Array]:
    """Return the motion at a pose, and its covariance: what is known is over ground, so the current's error is that of the water's way.

    v = R^T (v_n - c),  dv = R^T (dv_n - dc - d theta x (v_n - c));  the values of models/driven.py at their means.
    """
    means, sigmas = prior
    x = np.concatenate([pose.quaternion_en, [pose.height], np.zeros(3), pose.quaternion_nb, pose.rate_b, means])
    rotation, current = matrix_from_quaternion(pose.quaternion_nb), np.array([*current_of(x, parameters), 0.0])
    water = pose.velocity_n - current
    x[V : V + 3] = rotation.T @ water
    n = MOVING_E + len(means)
    known = np.zeros((n, n))
    known[:9, :9] = pose.covariance
    known[9:, 9:] = np.diag(np.square([sigma_rate] * 3 + list(sigmas)))
    through = np.eye(n)
    through[3:6, 3:6] = rotation.T
    through[3:6, 6:9] = rotation.T @ np.array([[0, -water[2], water[1]], [water[2], 0, -water[0]], [-water[1], water[0], 0]])
    if parameters[ERROR_L] >= 0.0:
        i, angle = int(parameters[ERROR_L]), float(wander(x))
        turned = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)], [0.0, 0.0]])
        through[3:6, i : i + 2] = -rotation.T @ turned
    return x, through @ known @ through.T


def longest_step(hull: Hull) -> float:
    """Return the longest step (s) that resolves the fastest mode of a hull at speed, with thrusters and fins at rest."""
    fastest, out = 0.0, np.zeros(SIX * SLOPE)
    weight = hull.mass * 9.8
    for surge, turning in ((0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (3.0, 0.5), (-1.0, 0.5)):
        nu = (surge, 0.1 * surge, 0.1 * surge, turning, turning, turning)
        slopes(nu, (0.0, 0.0, 1.0), np.zeros(INPUTS), hull.parameters, 1.0, 1.0, weight, weight, 0.0, out, 0)
        slope = out.reshape(SIX, SLOPE)
        turns = np.zeros((SIX + 3, SIX + 3))  # and the plumb line, which turns against the body: down' = down x w
        turns[:SIX] = slope[:, : SIX + 3]
        turns[SIX : SIX + 2, 3:5] = [[0.0, -1.0], [1.0, 0.0]]
        fastest = max(fastest, float(np.abs(np.linalg.eigvals(turns)).max()))
    return min(max(REACH / fastest, SHORTEST), LONGEST)
