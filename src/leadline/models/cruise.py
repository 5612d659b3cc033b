"""Process model `cruise`: constant speed and constant turn in five degrees of freedom; all sensors are corrections.

    p' = R(heading, pitch, roll) v_b     v_b' = white     heading'' = white     pitch'' = white     R = Rz(heading) Ry(pitch) Rx(roll)

With level wings: north' = u ch cp - v sh + w ch sp,  east' = u sh cp + v ch + w sh sp,  down' = -u sp + w cp (c, s: cosine, sine).
v_b is over ground, in body axes; the heading is counted from the first axis of the navigation frame, which never turns about the vertical.
Within a step heading and pitch turn evenly and R is averaged by Simpson's rule: its error is of the fifth order in the step.

Roll is not one of the five: it follows its rate and falls back to level within `roll_s`, with the spread `sigma_roll` where nothing
measures it.  The roll rate is not modelled but for its spread: it keeps a tenth of itself over a step and is drawn anew, so that a gyro
can say what it is, and what it says is forgotten with the next step.  (A tenth and not nothing: so the transition can be inverted.)
Source: Radojevic (2011), 5-DOF constant-speed filter, with sway and heave where they belong (they stand wrong there).

Error (12): position, velocity (body axes), heading, pitch, heading rate, pitch rate, roll, roll rate; all but the position additive.
"""

from __future__ import annotations

import math
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude
from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.core.earth import move
from leadline.core.rotation import cross, exponential, load3, product, store3, store_quaternion, turn, turn_back
from leadline.models.layout import Block, Part
from leadline.models.process import Process
from leadline.models.view import (
    ATTITUDE_T,
    POSITION_T,
    QUATERNION_V,
    RATE,
    RATE_T,
    RATE_V,
    TILTING,
    TURNING,
    VELOCITY,
    VELOCITY_T,
    VELOCITY_V,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.models.process import Pose
    from leadline.models.sensor import Context

PARTS = (
    Part("position", Block.PLACE, 3, "m"),
    Part("velocity", Block.VECTOR, 3, "m/s", "body"),
    Part("heading", Block.VECTOR, 1, "rad", "navigation"),
    Part("pitch", Block.VECTOR, 1, "rad", "navigation"),
    Part("heading_rate", Block.VECTOR, 1, "rad/s", "navigation"),
    Part("pitch_rate", Block.VECTOR, 1, "rad/s", "navigation"),
    Part("roll", Block.VECTOR, 1, "rad", "navigation"),
    Part("roll_rate", Block.VECTOR, 1, "rad/s", "navigation"),
)
# Places in the nominal state, and of the errors of the angles.
HEIGHT, V, HEADING, PITCH, TURN, PITCHING, ROLL, ROLLING = 4, 5, 8, 9, 10, 11, 12, 13
HEADING_E, PITCH_E, TURN_E, PITCHING_E, ROLL_E, ROLLING_E, ERRORS = 6, 7, 8, 9, 10, 11, 12
SURGE_DENSITY, SWAY_DENSITY, HEAVE_DENSITY, TURN_DENSITY, PITCH_DENSITY, ROLL_VARIANCE, ROLLING_VARIANCE, ROLL_RATE = range(8)
# Memory: the mean rotation of a step, and how the mean velocity moves with heading, pitch, their rates, and roll.
C_M, BY_HEADING_M, BY_PITCH_M, BY_TURN_M, BY_PITCHING_M, BY_ROLL_M, LEVELLED_M, MEMORY = 0, 9, 12, 15, 18, 21, 24, 25
KEPT = 0.1  # what is left over a step of an error that is drawn anew
LEAST_ROLL = 1e-6  # rad, rad/s: less would leave the covariance singular
SIMPSON = (1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0)


@kernel()
def rotation_of(h, p, r):
    """Rotation matrix, row by row, of heading, pitch and roll."""
    ch, sh, cp, sp, cr, sr = math.cos(h), math.sin(h), math.cos(p), math.sin(p), math.cos(r), math.sin(r)
    return (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr,
            sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr,
            -sp, cp * sr, cp * cr)  # fmt: skip


@kernel()
def quaternion_of(h, p, r):
    """Quaternion of heading, pitch and roll."""
    return product(product(exponential(0.0, 0.0, h), exponential(0.0, p, 0.0)), exponential(r, 0.0, 0.0))


@kernel()
def rate_of(p, r, dh, dp, dr):
    """Angular rate in body axes of pitch and roll with the rates of heading, pitch and roll."""
    cp, sp, cr, sr = math.cos(p), math.sin(p), math.cos(r), math.sin(r)
    return dr - dh * sp, dp * cr + dh * sr * cp, dh * cr * cp - dp * sr


@kernel()
def axes_of(h, p):
    """The axes (n) about which pitch and roll turn; heading turns about the third."""
    ch, sh, cp, sp = math.cos(h), math.sin(h), math.cos(p), math.sin(p)
    return (-sh, ch, 0.0), (ch * cp, sh * cp, -sp)


@kernel()
def pull_angles(h, p, r, dh, dp, dr, g, k):
    """Derivative of g . (attitude) + k . (rate) by heading, pitch, roll, and by their rates."""
    about_p, about_r = axes_of(h, p)
    cp, sp, cr, sr = math.cos(p), math.sin(p), math.cos(r), math.sin(r)
    _, w1, w2 = rate_of(p, r, dh, dp, dr)
    by_p = g[0] * about_p[0] + g[1] * about_p[1] - dh * (k[0] * cp + k[1] * sr * sp + k[2] * cr * sp)
    by_r = g[0] * about_r[0] + g[1] * about_r[1] + g[2] * about_r[2] + k[1] * w2 - k[2] * w1
    return g[2], by_p, by_r, -k[0] * sp + k[1] * sr * cp + k[2] * cr * cp, k[1] * cr - k[2] * sr, k[0]


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step of even turning with constant velocity in body axes."""
    v = load3(x, V)
    m[:MEMORY] = 0.0
    for node in range(3):
        s, weight = 0.5 * node * dt, SIMPSON[node]
        h, p = x[HEADING] + s * x[TURN], x[PITCH] + s * x[PITCHING]
        c = rotation_of(h, p, x[ROLL])
        n = turn(c, v)
        about_p, about_r = axes_of(h, p)
        by_h, by_p, by_r = cross((0.0, 0.0, 1.0), n), cross(about_p, n), cross(about_r, n)
        for i in range(9):
            m[C_M + i] += weight * c[i]
        for i in range(3):
            m[BY_HEADING_M + i] += weight * by_h[i]
            m[BY_PITCH_M + i] += weight * by_p[i]
            m[BY_TURN_M + i] += weight * s * by_h[i]
            m[BY_PITCHING_M + i] += weight * s * by_p[i]
            m[BY_ROLL_M + i] += weight * by_r[i]
    mean = turn(m, v)
    x[HEIGHT] -= 0.5 * mean[2] * dt
    move(x, 0, mean[0] * dt, mean[1] * dt, 0.5 * mean[2] * dt)  # level, at the height in the middle
    x[HEADING] += x[TURN] * dt
    x[PITCH] += x[PITCHING] * dt
    m[LEVELLED_M] = math.exp(-dt * params[ROLL_RATE])
    x[ROLL] = m[LEVELLED_M] * x[ROLL] + dt * x[ROLLING]
    x[ROLLING] *= KEPT


@kernel(inline=True)
def push_columns(m, dt, B, A, columns):
    """The derivative of `step`; left out is how velocity turns with the place, v / R."""
    W = WIDE
    for i in range(3):
        a0, a1, a2 = m[C_M + 3 * i] * dt, m[C_M + 3 * i + 1] * dt, m[C_M + 3 * i + 2] * dt
        b0, b1, b2 = m[BY_HEADING_M + i] * dt, m[BY_PITCH_M + i] * dt, m[BY_TURN_M + i] * dt
        b3, b4 = m[BY_PITCHING_M + i] * dt, m[BY_ROLL_M + i] * dt
        for j in range(columns):
            A[i * W + j] = (
                B[i * W + j] + a0 * B[3 * W + j] + a1 * B[4 * W + j] + a2 * B[5 * W + j]
                + b0 * B[6 * W + j] + b1 * B[7 * W + j] + b2 * B[8 * W + j] + b3 * B[9 * W + j] + b4 * B[10 * W + j]
            )  # fmt: skip
    for j in range(columns):
        A[3 * W + j], A[4 * W + j], A[5 * W + j] = B[3 * W + j], B[4 * W + j], B[5 * W + j]
        A[6 * W + j], A[7 * W + j] = B[6 * W + j] + dt * B[8 * W + j], B[7 * W + j] + dt * B[9 * W + j]
        A[8 * W + j], A[9 * W + j] = B[8 * W + j], B[9 * W + j]
        A[10 * W + j], A[11 * W + j] = m[LEVELLED_M] * B[10 * W + j] + dt * B[11 * W + j], KEPT * B[11 * W + j]


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B; compiled for the usual widths, as a run-time width keeps the loop from being unrolled."""
    if columns == 16:
        push_columns(m, dt, B, A, 16)
    elif columns == 24:
        push_columns(m, dt, B, A, 24)
    else:
        push_columns(m, dt, B, A, columns)


@kernel()
def add(P, i, j, value):
    """Add to two elements of a symmetric matrix."""
    P[i * WIDE + j] += value
    P[j * WIDE + i] += value


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q, the integral of Phi G q G^T Phi^T over the step: white accelerations on their way into angles and position."""
    W, dt2 = WIDE, dt * dt
    for k in range(3):
        q = params[SURGE_DENSITY + k] * dt
        P[(3 + k) * (W + 1)] += q
        for i in range(3):
            add(P, i, 3 + k, 0.5 * q * dt * m[C_M + 3 * i + k])
            for j in range(3):
                P[i * W + j] += q * dt2 / 3.0 * m[C_M + 3 * i + k] * m[C_M + 3 * j + k]
    for k in range(2):
        q, angle, rate, by = params[TURN_DENSITY + k] * dt, HEADING_E + k, TURN_E + k, m[BY_HEADING_M + 3 * k :]
        P[rate * (W + 1)] += q
        P[angle * (W + 1)] += q * dt2 / 3.0
        add(P, angle, rate, 0.5 * q * dt)
        for i in range(3):
            add(P, i, rate, q * dt2 / 6.0 * by[i])
            add(P, i, angle, q * dt2 * dt / 8.0 * by[i])
            for j in range(3):
                P[i * W + j] += q * dt2 * dt2 / 20.0 * by[i] * by[j]
    P[ROLL_E * (W + 1)] += (1.0 - m[LEVELLED_M] * m[LEVELLED_M]) * params[ROLL_VARIANCE]
    P[ROLLING_E * (W + 1)] += (1.0 - KEPT * KEPT) * params[ROLLING_VARIANCE]


@kernel(VIEW)
def view(x, u, params, out):
    """Place, velocity R v_b, attitude and rate; there is no specific force and no velocity through the water."""
    out[:] = 0.0
    out[:VELOCITY_V] = x[:VELOCITY_V]
    h, p, r = x[HEADING], x[PITCH], x[ROLL]
    store3(out, VELOCITY_V, turn(rotation_of(h, p, r), load3(x, V)))
    store_quaternion(out, QUATERNION_V, quaternion_of(h, p, r))
    store3(out, RATE_V, rate_of(p, r, x[TURN], x[PITCHING], x[ROLLING]))


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """d v_n = R d v_b + d theta x v_n, with d theta and d rate by the three angles and their rates."""
    h, p, r = x[HEADING], x[PITCH], x[ROLL]
    c, n = rotation_of(h, p, r), load3(view, VELOCITY_V)
    for i in range(rows):
        s, a = load3(Hv[i], VELOCITY_T), load3(Hv[i], ATTITUDE_T)
        swung, body = cross(n, s), turn_back(c, s)
        g = (a[0] + swung[0], a[1] + swung[1], a[2] + swung[2])
        by = pull_angles(h, p, r, x[TURN], x[PITCHING], x[ROLLING], g, load3(Hv[i], RATE_T))
        for j in range(3):
            H[i, j] = Hv[i, POSITION_T + j]
            H[i, 3 + j] = body[j]
        H[i, HEADING_E], H[i, PITCH_E], H[i, ROLL_E] = by[0], by[1], by[2]
        H[i, TURN_E], H[i, PITCHING_E], H[i, ROLLING_E] = by[3], by[4], by[5]


def compose(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model `cruise` of a vehicle; with a hull it is the one that its thrusters drive (cruise_driven.py)."""
    figures, _ = vehicle.process.figures("cruise")
    if "hull" in figures:
        driven: Process = import_module("leadline.models.cruise_driven").compose(vehicle, context)
        return driven
    return cruise(figures)


def cruise(figures: Mapping[str, Any]) -> Process:
    """Return the process model `cruise` of its figures (SI, as ProcessConfig.figures gives them)."""
    return Process(
        "cruise", PARTS, parameters_of(figures), step, push, noise, view, pull, frozenset({VELOCITY, RATE, TURNING, TILTING}),
        begin=partial(begin, sigma_rate=figures["sigma_rate"]),
    )  # fmt: skip


def parameters_of(figures: Mapping[str, Any]) -> Array:
    """Return the parameters: densities of speeds, heading and pitch, variances of roll and its rate, how fast roll levels."""
    noises = [figures[f"{name}_noise"] for name in ("surge", "sway", "heave", "turn", "pitch")]
    return np.append(np.square([*noises, max(figures["sigma_roll"], LEAST_ROLL), figures["sigma_rate"]]), 1.0 / figures["roll"])


def begin(pose: Pose, sigma_rate: float) -> tuple[Array, Array]:
    """Return the initial motion (14,) and its covariance (12, 12); sigma_rate: of the rates of the three angles (rad/s)."""
    angles, slope = angles_of(pose.quaternion_nb)
    rates = np.linalg.solve(rate_slope(angles), pose.rate_b)
    back = attitude.matrix_from_quaternion(pose.quaternion_nb).T
    x = np.concatenate([
        pose.quaternion_en, [pose.height], back @ pose.velocity_n, [angles[2], angles[1], rates[2], rates[1], angles[0], rates[0]],
    ])  # fmt: skip
    change = np.zeros((ERRORS, 9))
    change[:3, :3] = np.eye(3)
    change[3:6, 3:6] = back
    change[3:6, 6:9] = back @ np.cross(pose.velocity_n, np.eye(3)).T  # the matrix of v x
    change[[ROLL_E, PITCH_E, HEADING_E], 6:9] = slope
    covariance = change @ pose.covariance @ change.T
    for i in (TURN_E, PITCHING_E, ROLLING_E):
        covariance[i, i] = sigma_rate**2
    return x, covariance


def angles_of(quaternion_nb: Array) -> tuple[Array, Array]:
    """Return roll, pitch and heading (3,) of an attitude, and how they change with a rotation vector on the left (3, 3)."""
    angles = np.array(attitude.euler_from_quaternion(quaternion_nb), float)
    about_pitch, about_roll = axes_of.py_func(angles[2], angles[1])
    return angles, np.linalg.inv(np.stack([about_roll, about_pitch, (0.0, 0.0, 1.0)], axis=1))


def rate_slope(angles: Array) -> Array:
    """Return how the angular rate in body axes changes with the rates of roll, pitch and heading (3, 3)."""
    return np.stack([rate_of.py_func(angles[1], angles[0], *unit) for unit in np.eye(3)[:, ::-1]], axis=1)
