"""Process model `body-velocity`: nine states driven by an inertial unit, with the velocity over ground in body axes.

    v_b' = f + R^T g - (w + R^T w_ie) x v_b          w: measured rate, f: measured specific force, R: body -> navigation frame

The term w x v_b is what a turning body does to a velocity that stays where it was: without it a vehicle that turns at the rate r with
the speed u gains a sway of -r u each second that is not there.  It is the change of variables v_n = R v_b of models/inertial.py, whose
`step` moves the nominal state, gaps included: so both are one mechanisation.  There are no biases in the state: what they do within
`bias_s` counts as noise.
Source: Wang and Pang (2014), eq. 7, with the terms that it lacks (w x v, gravity, the turning Earth); Groves (2013), ch. 5.

Error (9): position, velocity (body axes, additive), attitude (rotation vector in n, on the left):
    d v_n = R d v_b + d theta x v_n
so the transition is that of `inertial` between two such changes of variables, to first order in the step, and leaves out what that does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import attitude
from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.core.earth import curvature, third_row
from leadline.core.rotation import cross, load3, load_matrix, store3, turn, turn_back
from leadline.data.errors import InputError
from leadline.models.inertial import (
    ACCEL_DENSITY,
    BG_RATE,
    C_M,
    CORIOLIS_M,
    CURVE_M,
    FORCE_M,
    FORCE_U,
    GAP_ACCEL,
    GAP_RATE,
    GRADIENT_M,
    GYRO_DENSITY,
    INTERVAL_U,
    PRESENT_M,
    PRESENT_U,
    RATE_U,
    W_IN_M,
    navigation_rate,
    parameters_of,
)
from leadline.models.inertial import step as step_of_inertial
from leadline.models.layout import Block, Part
from leadline.models.process import Process
from leadline.models.view import ATTITUDE_T, FORCE, POSITION_T, RATE, RATE_T, RATE_VARIANCE_V, VELOCITY, VELOCITY_T

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.process import Pose
    from leadline.models.sensor import Context

PARTS = (
    Part("position", Block.PLACE, 3, "m"),
    Part("velocity", Block.VECTOR, 3, "m/s", "body"),
    Part("attitude", Block.ATTITUDE, 3, "rad", "navigation"),
)
HEIGHT, V, Q, NOMINAL = 4, 5, 8, 12
# The memory, beyond what `inertial` leaves there: attitude after the step, velocities before and after it (n), its own nominal state.
AFTER_M, BEFORE_V_M, AFTER_V_M, COPY_M, COPY_SIZE = 32, 41, 44, 64, 18
LONGEST_STEP = 0.02  # s: the transition is of first order, and a unit may give ten rows a second


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step of `inertial` with v_n = R v_b and without biases."""
    y = m[COPY_M : COPY_M + COPY_SIZE]
    y[:NOMINAL] = x[:NOMINAL]
    y[NOMINAL:] = 0.0
    before = turn(load_matrix(x, Q), load3(x, V))
    store3(y, V, before)
    step_of_inertial(y, u, dt, params, m)
    after, c = load3(y, V), load_matrix(y, Q)
    x[:NOMINAL] = y[:NOMINAL]
    store3(x, V, turn_back(c, after))
    store3(m, BEFORE_V_M, before)
    store3(m, AFTER_V_M, after)
    for i in range(9):
        m[AFTER_M + i] = c[i]


@kernel(inline=True)
def push_columns(m, dt, B, A, columns):
    """The error equations of `inertial` between d v_n = R d v_b + d theta x v_n before the step and its inverse after it."""
    W = WIDE
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = (m[C_M], m[C_M + 1], m[C_M + 2], m[C_M + 3], m[C_M + 4], m[C_M + 5],
                                                   m[C_M + 6], m[C_M + 7], m[C_M + 8])  # fmt: skip
    e00, e01, e02, e10, e11, e12, e20, e21, e22 = (m[AFTER_M], m[AFTER_M + 1], m[AFTER_M + 2], m[AFTER_M + 3], m[AFTER_M + 4],
                                                   m[AFTER_M + 5], m[AFTER_M + 6], m[AFTER_M + 7], m[AFTER_M + 8])  # fmt: skip
    x0, x1, x2 = m[BEFORE_V_M], m[BEFORE_V_M + 1], m[BEFORE_V_M + 2]
    y0, y1, y2 = m[AFTER_V_M], m[AFTER_V_M + 1], m[AFTER_V_M + 2]
    n0, n1, n2 = m[FORCE_M] * dt, m[FORCE_M + 1] * dt, m[FORCE_M + 2] * dt
    i0, i1, i2 = m[W_IN_M] * dt, m[W_IN_M + 1] * dt, m[W_IN_M + 2] * dt
    o0, o1, o2 = m[CORIOLIS_M] * dt, m[CORIOLIS_M + 1] * dt, m[CORIOLIS_M + 2] * dt
    k00, k01, k11 = m[CURVE_M] * dt, m[CURVE_M + 1] * dt, m[CURVE_M + 2] * dt
    gradient = m[GRADIENT_M] * dt
    for j in range(columns):
        p2 = B[2 * W + j]
        b0, b1, b2 = B[3 * W + j], B[4 * W + j], B[5 * W + j]
        t0, t1, t2 = B[6 * W + j], B[7 * W + j], B[8 * W + j]
        v0 = c00 * b0 + c01 * b1 + c02 * b2 + t1 * x2 - t2 * x1
        v1 = c10 * b0 + c11 * b1 + c12 * b2 + t2 * x0 - t0 * x2
        v2 = c20 * b0 + c21 * b1 + c22 * b2 + t0 * x1 - t1 * x0
        s0 = t0 + i2 * t1 - i1 * t2 - k01 * v0 - k11 * v1
        s1 = t1 + i0 * t2 - i2 * t0 + k00 * v0 + k01 * v1
        s2 = t2 + i1 * t0 - i0 * t1
        w0 = v0 + o2 * v1 - o1 * v2 + n2 * t1 - n1 * t2 - (s1 * y2 - s2 * y1)
        w1 = v1 + o0 * v2 - o2 * v0 + n0 * t2 - n2 * t0 - (s2 * y0 - s0 * y2)
        w2 = v2 + o1 * v0 - o0 * v1 + n1 * t0 - n0 * t1 - (s0 * y1 - s1 * y0) + gradient * p2
        A[j] = B[j] + dt * v0
        A[W + j] = B[W + j] + dt * v1
        A[2 * W + j] = p2 + dt * v2
        A[3 * W + j] = e00 * w0 + e10 * w1 + e20 * w2
        A[4 * W + j] = e01 * w0 + e11 * w1 + e21 * w2
        A[5 * W + j] = e02 * w0 + e12 * w1 + e22 * w2
        A[6 * W + j], A[7 * W + j], A[8 * W + j] = s0, s1, s2


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B; compiled for the usual widths, as a run-time width keeps the loop from being unrolled."""
    if columns == 16:
        push_columns(m, dt, B, A, 16)
    elif columns == 24:
        push_columns(m, dt, B, A, 24)
    else:
        push_columns(m, dt, B, A, columns)


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q: that of `inertial` in body axes: d v_b = R^T (d v_n + v_n x d theta) brings the gyro's noise into the velocity."""
    present = m[PRESENT_M] != 0.0
    accel = (params[ACCEL_DENSITY] if present else params[GAP_ACCEL]) * dt
    gyro = (params[GYRO_DENSITY] if present else params[GAP_RATE]) * dt
    c, W = m[AFTER_M : AFTER_M + 9], WIDE
    v = load3(m, AFTER_V_M)
    b = turn_back(c, v)
    square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    half, third = 0.0 if present else 0.5 * accel * dt, 0.0 if present else accel * dt * dt / 3.0
    for i in range(3):
        P[i * (W + 1)] += third
        P[(3 + i) * (W + 1)] += accel + gyro * square
        P[(6 + i) * (W + 1)] += gyro
        for j in range(3):
            P[(3 + i) * W + 3 + j] -= gyro * b[i] * b[j]
            P[i * W + 3 + j] += half * c[3 * i + j]
            P[(3 + j) * W + i] += half * c[3 * i + j]
        # cov(d v_b, d theta) = gyro R^T [v x]: row i is (column i of R) x v
        r = cross((c[i], c[3 + i], c[6 + i]), v)
        for j in range(3):
            P[(3 + i) * W + 6 + j] += gyro * r[j]
            P[(6 + j) * W + 3 + i] += gyro * r[j]


@kernel(VIEW)
def view(x, u, params, out):
    """Place, velocity R v_b, attitude; rate = gyro - R^T w_in with the gyro's noise, force = accelerometer; in a gap as `inertial`."""
    c = load_matrix(x, Q)
    v = turn(c, load3(x, V))
    out[:NOMINAL] = x[:NOMINAL]
    store3(out, V, v)
    axis = third_row(x[0], x[1], x[2], x[3])
    transport, earth = navigation_rate(axis, curvature(axis, x[HEIGHT]), v)
    w = turn_back(c, (earth[0] + transport[0], earth[1] + transport[1], earth[2]))
    present = u[PRESENT_U] != 0.0
    for i in range(3):
        out[12 + i] = u[RATE_U + i] - w[i] if present else 0.0
        out[15 + i] = u[FORCE_U + i] if present else 0.0
        out[18 + i] = 0.0
    out[RATE_VARIANCE_V] = params[GYRO_DENSITY] / u[INTERVAL_U] if present else params[GAP_RATE]


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """d v_n = R d v_b + d theta x v_n, d rate = -R^T (w_in x d theta) (none in a gap, where the rate is zero), d force = 0."""
    c, v = load_matrix(x, Q), load3(view, V)
    axis = third_row(x[0], x[1], x[2], x[3])
    transport, earth = navigation_rate(axis, curvature(axis, x[HEIGHT]), v)
    on = 1.0 if u[PRESENT_U] != 0.0 else 0.0
    w = ((earth[0] + transport[0]) * on, (earth[1] + transport[1]) * on, earth[2] * on)
    for r in range(rows):
        s = load3(Hv[r], VELOCITY_T)
        body, swung = turn_back(c, s), cross(v, s)
        turned = cross(turn(c, load3(Hv[r], RATE_T)), w)
        for i in range(3):
            H[r, i] = Hv[r, POSITION_T + i]
            H[r, 3 + i] = body[i]
            H[r, 6 + i] = Hv[r, ATTITUDE_T + i] + swung[i] - turned[i]


def compose(vehicle: Vehicle, context: Context) -> Process:
    """Return the process model `body-velocity` of a vehicle; raises InputError where a second inertial unit is to stand in."""
    figures, _ = vehicle.process.figures("body-velocity")
    if vehicle.process.standby is not None:
        found = f"is '{vehicle.process.standby}', and the process model 'body-velocity' knows one inertial unit"
        raise InputError("process.standby", found, "take it out, or use the process model 'inertial'")
    return body_velocity(vehicle[vehicle.process.imu], context.surface, figures["bias"])


def body_velocity(imu: SensorConfig, surface: float, bias_time: float = 0.0) -> Process:
    """Return the process model `body-velocity` of an IMU, for water whose surface is at the height `surface` (m).

    bias_time (s): an unknown bias b counts as white noise of density b^2 x that, which moves the velocity as far within that time.
    """
    parameters = parameters_of(imu, surface)
    parameters[ACCEL_DENSITY] += imu.value("accel_bias") ** 2 * bias_time
    parameters[GYRO_DENSITY] += imu.value("gyro_bias") ** 2 * bias_time
    parameters[BG_RATE:GAP_ACCEL] = 0.0  # there are no biases that could wander
    return Process(
        "body-velocity", PARTS, parameters, step, push, noise, view, pull, frozenset({VELOCITY, RATE, FORCE}),
        begin=begin, consumes="imu", reference_b=imu.lever_arm_b, longest_step=LONGEST_STEP,
    )  # fmt: skip


def begin(pose: Pose) -> tuple[Array, Array]:
    """Return the initial motion (12,) and its covariance (9, 9), with d v_b = R^T (d v_n + v_n x d theta)."""
    back = attitude.matrix_from_quaternion(pose.quaternion_nb).T
    change = np.eye(9)
    change[3:6, 3:6] = back
    change[3:6, 6:9] = back @ crossed(pose.velocity_n)
    x = np.concatenate([pose.quaternion_en, [pose.height], back @ pose.velocity_n, pose.quaternion_nb])
    return x, change @ pose.covariance @ change.T


def crossed(v: Array) -> Array:
    """Return the matrix (3, 3) of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
