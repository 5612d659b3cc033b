"""Process model `planar`: constant acceleration and constant turn rate in the plane; depth and tilt are supplied, not estimated.

    p'' = a,  a' = white  (north- and east-like, navigation frame)          heading'' = white

A depth sensor and, where there is one, an attitude sensor drive it: their rows are input (`feeds`).  What is supplied stands in the
state all the same, so that lever arms, mountings and slant ranges see it with its uncertainty: depth, roll, pitch, the velocity downward
and the rates of roll and pitch each keep a tenth of what a correction did to them over a step, and are drawn anew about what is supplied.
(A tenth and not nothing: so the transition can be inverted.)  Between rows the depth goes on with the velocity downward, which is the
difference of successive rows, smoothed over SMOOTHING.  Heading of the attitude sensor is a correction: its rows are both.
Source: the fusion filter of Teixeira et al. (2017), whose measurement matrix holds ones alone (theirs predicts a step ahead).

Error (17): position (its third is supplied), velocity 2, acceleration 2, heading, heading rate; supplied: roll, pitch, velocity downward,
roll rate, pitch rate; then three numbers without error that `step` remembers: smoothed velocity downward, depth and time of the last row.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core.attitude import euler_from_quaternion
from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.core.earth import move
from leadline.core.rotation import load3, store3, store_quaternion
from leadline.data.errors import InputError
from leadline.models.cruise import KEPT, LEAST_ROLL, add, angles_of, pull_angles, quaternion_of, rate_of, rate_slope
from leadline.models.layout import INPUTS, NOW_U, Block, Part
from leadline.models.process import Feed, Process
from leadline.models.sensor import sigmas, usable
from leadline.models.sensors.attitude import measured_quaternion
from leadline.models.sensors.pressure import depth_of_pressures
from leadline.models.view import ATTITUDE_T, POSITION_T, QUATERNION_V, RATE, RATE_T, RATE_V, TURNING, VELOCITY, VELOCITY_T, VELOCITY_V

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.records import Array, Table
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.process import Pose
    from leadline.models.sensor import Context

PARTS = (
    Part("position", Block.PLACE, 3, "m"),
    Part("velocity", Block.VECTOR, 2, "m/s", "navigation"),
    Part("acceleration", Block.VECTOR, 2, "m/s^2", "navigation"),
    Part("heading", Block.VECTOR, 1, "rad", "navigation"),
    Part("heading_rate", Block.VECTOR, 1, "rad/s", "navigation"),
    Part("roll", Block.VECTOR, 1, "rad", "navigation"),
    Part("pitch", Block.VECTOR, 1, "rad", "navigation"),
    Part("velocity_down", Block.VECTOR, 1, "m/s", "navigation"),
    Part("roll_rate", Block.VECTOR, 1, "rad/s", "navigation"),
    Part("pitch_rate", Block.VECTOR, 1, "rad/s", "navigation"),
    Part("supplied", Block.VECTOR, 3),
)
# Places in the nominal state; an error beyond the position stands two before its number.
HEIGHT, V, ACCEL, HEADING, TURN, ROLL, PITCH, DOWN, ROLLING, PITCHING, SMOOTHED, DEPTH, ROW_TIME, NOMINAL = (
    4, 5, 7, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19,
)  # fmt: skip
ERRORS, SHIFT = 17, 2
# Input: of the depth sensor, then of the attitude sensor; a variance that is not above zero says that no row has been there yet.
DEPTH_U, DEPTH_TIME_U, DEPTH_VARIANCE_U, ROLL_U, PITCH_U, TILT_TIME_U, ROLL_VARIANCE_U, PITCH_VARIANCE_U = range(8)
LEVER, SURFACE, ACCEL_DENSITY, TURN_DENSITY, TILT_VARIANCE, RATE_VARIANCE, DOWN_VARIANCE, HAS_ATTITUDE = 0, 3, 4, 5, 6, 7, 8, 9
# Memory: what is kept of the errors of depth and tilt, and the variances that are drawn anew.
KEEP_DEPTH_M, KEEP_TILT_M, HEIGHT_M, DOWN_M, ROLL_M, PITCH_M = range(6)
SMOOTHING = 2.0  # s
APART = 10.0  # s: rows further apart say nothing of the velocity between them
SAME = 1e-4  # s: times that differ by less are those of one row
LONG_BEFORE = 1e3  # s: the time of a row that never was, before the start


@kernel()
def tilt_of(u, x):
    """Roll and pitch as supplied, else as in the state."""
    if u[ROLL_VARIANCE_U] > 0.0:
        return u[ROLL_U], u[PITCH_U]
    return x[ROLL], x[PITCH]


@kernel()
def take_depth(x, u, params, roll, pitch):
    """Remember a row of the depth sensor that was not there in the step before: depth of the reference point, smoothed velocity."""
    interval = u[DEPTH_TIME_U] - x[ROW_TIME]
    if not interval > SAME:
        return
    l = load3(params, LEVER)
    arm = (l[1] * math.sin(roll) + l[2] * math.cos(roll)) * math.cos(pitch) - l[0] * math.sin(pitch)
    depth = u[DEPTH_U] - arm
    if interval < APART:
        x[SMOOTHED] += (1.0 - math.exp(-interval / SMOOTHING)) * ((depth - x[DEPTH]) / interval - x[SMOOTHED])
    x[DEPTH], x[ROW_TIME] = depth, u[DEPTH_TIME_U]


@kernel()
def supply_depth(x, u, dt, params, m):
    """Height and velocity downward after the step, about what is supplied; before the first row they go on as they were."""
    down = params[DOWN_VARIANCE]
    if not u[DEPTH_VARIANCE_U] > 0.0:
        x[HEIGHT] -= x[SMOOTHED] * dt
        m[KEEP_DEPTH_M], m[HEIGHT_M], m[DOWN_M] = 1.0, down * dt, 0.0
        return
    age = max(u[NOW_U] - x[ROW_TIME], 0.0)
    start = params[SURFACE] - x[DEPTH] - x[SMOOTHED] * age
    x[HEIGHT] = start - x[SMOOTHED] * dt + KEPT * (x[HEIGHT] - start)
    x[DOWN] = x[SMOOTHED] + KEPT * (x[DOWN] - x[SMOOTHED])
    fresh = 1.0 - KEPT * KEPT
    down += u[DEPTH_VARIANCE_U] / (SMOOTHING * SMOOTHING)
    m[KEEP_DEPTH_M], m[HEIGHT_M], m[DOWN_M] = KEPT, fresh * (u[DEPTH_VARIANCE_U] + down * (age + dt) ** 2), fresh * down


@kernel()
def supply_tilt(x, u, dt, params, m):
    """Roll and pitch after the step, about what is supplied (level without an attitude sensor); before its first row they stay."""
    if u[ROLL_VARIANCE_U] > 0.0:
        turned = params[RATE_VARIANCE] * (max(u[NOW_U] - u[TILT_TIME_U], 0.0) + dt) ** 2
        keep, a, b, va, vb = KEPT, u[ROLL_U], u[PITCH_U], u[ROLL_VARIANCE_U] + turned, u[PITCH_VARIANCE_U] + turned
    elif params[HAS_ATTITUDE] > 0.0:
        keep, a, b, va, vb = 1.0, 0.0, 0.0, 0.0, 0.0
    else:
        keep, a, b, va, vb = KEPT, 0.0, 0.0, params[TILT_VARIANCE], params[TILT_VARIANCE]
    x[ROLL], x[PITCH] = a + keep * (x[ROLL] - a), b + keep * (x[PITCH] - b)
    x[ROLLING] *= KEPT
    x[PITCHING] *= KEPT
    m[KEEP_TILT_M], m[ROLL_M], m[PITCH_M] = keep, (1.0 - keep * keep) * va, (1.0 - keep * keep) * vb


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step of constant acceleration and turn rate; depth and tilt as supplied."""
    half = 0.5 * dt * dt
    move(x, 0, x[V] * dt + x[ACCEL] * half, x[V + 1] * dt + x[ACCEL + 1] * half, 0.0)
    x[V] += x[ACCEL] * dt
    x[V + 1] += x[ACCEL + 1] * dt
    x[HEADING] += x[TURN] * dt
    if u[DEPTH_VARIANCE_U] > 0.0:
        roll, pitch = tilt_of(u, x)
        take_depth(x, u, params, roll, pitch)
    supply_depth(x, u, dt, params, m)
    supply_tilt(x, u, dt, params, m)


@kernel(inline=True)
def push_columns(m, dt, B, A, columns):
    """The derivative of `step`; left out is how velocity turns with the place, v / R."""
    W, half, depth, tilt = WIDE, 0.5 * dt * dt, m[KEEP_DEPTH_M], m[KEEP_TILT_M]
    for j in range(columns):
        A[j] = B[j] + dt * B[3 * W + j] + half * B[5 * W + j]
        A[W + j] = B[W + j] + dt * B[4 * W + j] + half * B[6 * W + j]
        A[2 * W + j] = depth * B[2 * W + j]
        A[3 * W + j], A[4 * W + j] = B[3 * W + j] + dt * B[5 * W + j], B[4 * W + j] + dt * B[6 * W + j]
        A[5 * W + j], A[6 * W + j] = B[5 * W + j], B[6 * W + j]
        A[7 * W + j], A[8 * W + j] = B[7 * W + j] + dt * B[8 * W + j], B[8 * W + j]
        A[9 * W + j], A[10 * W + j] = tilt * B[9 * W + j], tilt * B[10 * W + j]
        A[11 * W + j] = depth * B[11 * W + j]
    for i in range(12, ERRORS):
        for j in range(columns):
            A[i * W + j] = KEPT * B[i * W + j]


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B; compiled for the usual widths, as a run-time width keeps the loop from being unrolled."""
    if columns == 24:
        push_columns(m, dt, B, A, 24)
    elif columns == 32:
        push_columns(m, dt, B, A, 32)
    else:
        push_columns(m, dt, B, A, columns)


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q: white jerk on its way into velocity and position, white turning into the heading, and what is drawn anew."""
    W, dt2 = WIDE, dt * dt
    q, t = params[ACCEL_DENSITY] * dt, params[TURN_DENSITY] * dt
    for i in range(2):
        P[i * (W + 1)] += q * dt2 * dt2 / 20.0
        P[(3 + i) * (W + 1)] += q * dt2 / 3.0
        P[(5 + i) * (W + 1)] += q
        add(P, i, 3 + i, q * dt2 * dt / 8.0)
        add(P, i, 5 + i, q * dt2 / 6.0)
        add(P, 3 + i, 5 + i, q * dt / 2.0)
        P[(12 + i) * (W + 1)] += (1.0 - KEPT * KEPT) * params[RATE_VARIANCE]
    P[7 * (W + 1)] += t * dt2 / 3.0
    P[8 * (W + 1)] += t
    add(P, 7, 8, t * dt / 2.0)
    P[2 * (W + 1)] += m[HEIGHT_M]
    P[9 * (W + 1)] += m[ROLL_M]
    P[10 * (W + 1)] += m[PITCH_M]
    P[11 * (W + 1)] += m[DOWN_M]


@kernel(VIEW)
def view(x, u, params, out):
    """Place, velocity, attitude and rate; there is no specific force and no velocity through the water."""
    out[:] = 0.0
    out[:VELOCITY_V] = x[:VELOCITY_V]
    store3(out, VELOCITY_V, (x[V], x[V + 1], x[DOWN]))
    store_quaternion(out, QUATERNION_V, quaternion_of(x[HEADING], x[PITCH], x[ROLL]))
    store3(out, RATE_V, rate_of(x[PITCH], x[ROLL], x[TURN], x[PITCHING], x[ROLLING]))


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """Position and velocity are states; attitude and rate by the three angles and their rates."""
    for i in range(rows):
        g, k = load3(Hv[i], ATTITUDE_T), load3(Hv[i], RATE_T)
        by = pull_angles(x[HEADING], x[PITCH], x[ROLL], x[TURN], x[PITCHING], x[ROLLING], g, k)
        for j in range(3):
            H[i, j] = Hv[i, POSITION_T + j]
        H[i, V - SHIFT], H[i, V - SHIFT + 1], H[i, DOWN - SHIFT] = Hv[i, VELOCITY_T], Hv[i, VELOCITY_T + 1], Hv[i, VELOCITY_T + 2]
        H[i, ACCEL - SHIFT] = H[i, ACCEL - SHIFT + 1] = 0.0
        H[i, HEADING - SHIFT], H[i, PITCH - SHIFT], H[i, ROLL - SHIFT] = by[0], by[1], by[2]
        H[i, TURN - SHIFT], H[i, PITCHING - SHIFT], H[i, ROLLING - SHIFT] = by[3], by[4], by[5]
        for j in range(SMOOTHED - SHIFT, ERRORS):
            H[i, j] = 0.0


def compose(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model `planar` of a vehicle; raises InputError where nothing measures the depth that it must be supplied with."""
    figures, _ = vehicle.process.figures("planar")
    depth = _named(vehicle, figures.get("depth"), "depth", ("depth", "pressure"))
    tilt = _named(vehicle, figures.get("attitude"), "attitude", ("attitude",))
    if depth is None:
        raise InputError("process.planar", "has no sensor of kind depth or pressure", "add one: its rows supply the depth")
    feeds = [Feed(depth.name, partial(depth_rows, config=depth, context=context))]
    if tilt is not None:
        feeds.append(Feed(tilt.name, partial(tilt_rows, config=tilt, context=context), also_corrects=True))
    return Process(
        "planar", PARTS, parameters_of(figures, depth.lever_arm_b, context.surface, tilt is not None), step, push, noise, view, pull,
        frozenset({VELOCITY, RATE, TURNING}), begin=partial(begin, figures=figures, surface=context.surface),
        feeds=tuple(feeds), linear=True,
    )  # fmt: skip


def _named(vehicle: Vehicle, name: str | None, key: str, kinds: tuple[str, ...]) -> SensorConfig | None:
    """Return the sensor of a name, else the first of the first of the kinds that the vehicle has and that stands in for no other."""
    if name is not None:
        config = vehicle[name]
        if config.kind not in kinds or config.model is not None:
            raise InputError(f"process.planar.{key}", f"'{name}' is of kind '{config.kind}'", f"a sensor of kind {' or '.join(kinds)}")
        return config
    own = [config for config in vehicle.sensors.values() if config.model is None and config.standby_for is None]
    return next((config for kind in kinds for config in own if config.kind == kind), None)


def parameters_of(figures: Mapping[str, Any], lever_arm_b: Array, surface: float, has_attitude: bool) -> Array:
    """Return the parameters, in the order of the places LEVER to HAS_ATTITUDE."""
    noises = (figures["accel_noise"], figures["turn_noise"], max(figures["sigma_tilt"], LEAST_ROLL), figures["sigma_rate"])
    return np.array([*lever_arm_b, surface, *np.square([*noises, SMOOTHING * figures["sigma_accel"]]), float(has_attitude)])


def depth_rows(table: Any, config: SensorConfig, context: Context) -> Array:
    """Return the inputs (n, INPUTS) of rows of a depth or pressure sensor: depth of the sensor, moment, variance."""
    if config.kind == "pressure":
        depth, sigma = depth_of_pressures(config, table, context)
    else:
        depth, sigma = np.array(table.depth, float), np.full(len(table), config.value("sigma"))
    datum = config.nuisance.get("datum")
    if datum is not None:
        depth, sigma = depth - float(datum.value[0]), np.hypot(sigma, float(datum.sigma[0]))
    return _inputs(table, config, {DEPTH_U: depth, DEPTH_TIME_U: table.time - config.latency, DEPTH_VARIANCE_U: sigma**2})


def tilt_rows(table: Any, config: SensorConfig, context: Context) -> Array:
    """Return the inputs (n, INPUTS) of rows of an attitude sensor: roll and pitch of the body, moment, variances."""
    roll, pitch, _ = euler_from_quaternion(measured_quaternion(config, table, context))
    bias, stated = config.nuisance.get("bias"), config.value("sigma_tilt")
    unknown = np.zeros(2) if bias is None else np.asarray(bias.sigma[:2], float)
    found = [sigmas(None if table.sigma is None else table.sigma[:, i], stated, len(table)) ** 2 + unknown[i] ** 2 for i in range(2)]
    places = {ROLL_U: roll, PITCH_U: pitch, TILT_TIME_U: table.time - config.latency, ROLL_VARIANCE_U: found[0], PITCH_VARIANCE_U: found[1]}
    return _inputs(table, config, places)


def _inputs(table: Table, config: SensorConfig, places: Mapping[int, Array]) -> Array:
    """Return inputs with columns at their places, nan elsewhere, and nan throughout where a row lacks one or calls itself invalid."""
    made = np.full((len(table), INPUTS), np.nan)
    for place, column in places.items():
        made[:, place] = column
    made[~(np.isfinite(made[:, list(places)]).all(axis=1) & usable(table))] = np.nan
    return made


def begin(pose: Pose, figures: Mapping[str, Any], surface: float) -> tuple[Array, Array]:
    """Return the initial motion (19,) and its covariance (17, 17): that of the pose, with sigma_accel and sigma_rate of the figures."""
    angles, slope = angles_of(pose.quaternion_nb)
    rates = np.linalg.solve(rate_slope(angles), pose.rate_b)
    v = pose.velocity_n
    supplied = [angles[0], angles[1], v[2], rates[0], rates[1], v[2], surface - pose.height, pose.time - LONG_BEFORE]
    x = np.concatenate([pose.quaternion_en, [pose.height], v[:2], np.zeros(2), [angles[2], rates[2]], supplied])
    change = np.zeros((ERRORS, 9))
    change[:3, :3] = np.eye(3)
    change[[V - SHIFT, V - SHIFT + 1, DOWN - SHIFT], 3:6] = np.eye(3)
    change[[ROLL - SHIFT, PITCH - SHIFT, HEADING - SHIFT], 6:9] = slope
    covariance = change @ pose.covariance @ change.T
    for i, sigma in ((ACCEL, "accel"), (ACCEL + 1, "accel"), (TURN, "rate"), (ROLLING, "rate"), (PITCHING, "rate")):
        covariance[i - SHIFT, i - SHIFT] = figures[f"sigma_{sigma}"] ** 2
    return x, covariance
