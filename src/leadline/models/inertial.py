"""Process model `inertial`: strapdown navigation on WGS 84, driven by gyros and accelerometers.

    R_en' = R_en [w_en]x            v' = R_nb f + g - (2 w_ie + w_en) x v
    h'    = -v_down                 R_nb' = R_nb [w_ib]x - [w_in]x R_nb           w_in = w_ie + w_en

The navigation frame is level with wandering azimuth: w_en has no vertical component (core/earth.py).  An input holds over its
interval as constant rate and force with coning and sculling already in it (`models/imu.py`), so a measurement may split the
interval without changing what the two halves compose to.  Second order in the step; the rotation of the body is exact.
Source: Savage, Strapdown Analytics (2000), ch. 7; Groves (2013), ch. 5.

Error (15): position, velocity, attitude (rotation vector in n, on the left), gyro bias, accelerometer bias:
    dp' = dv        dv' = [R f] x-fed attitude, Coriolis, gravity gradient, -R dba        dtheta' = -w_in x dtheta - w_en(dv) - R dbg
Left out, as below 1e-6 of what is there: the change of w_ie with position and of curvature with height, of the transport rate in
the Coriolis term (v/R against 2 w_ie: 5e-7 per second) and in `pull` (1/R per m/s of error).
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import NOISE, PULL, PUSH, STEP, VIEW, WIDE, kernel
from leadline.core.earth import WATER_GRADIENT, curvature, gravity, level_rotation, third_row
from leadline.core.geodesy import EARTH_RATE
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
from leadline.models.layout import Block, Part
from leadline.models.process import Process
from leadline.models.view import ATTITUDE_T, FORCE, FORCE_T, POSITION_T, RATE, RATE_T, RATE_VARIANCE_V, VELOCITY, VELOCITY_T

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig
    from leadline.models.process import Pose

PARTS = (
    Part("position", Block.PLACE, 3, "m"),
    Part("velocity", Block.VECTOR, 3, "m/s", "navigation"),
    Part("attitude", Block.ATTITUDE, 3, "rad", "navigation"),
    Part("gyro_bias", Block.VECTOR, 3, "rad/s", "body"),
    Part("accel_bias", Block.VECTOR, 3, "m/s^2", "body"),
)
# Places in the nominal state, the input, the parameters and the memory that `step` leaves for `push` and `noise`.
P, H, V, Q, BG, BA = 0, 4, 5, 8, 12, 15
RATE_U, FORCE_U, PRESENT_U, INTERVAL_U, DEVICE_U = 0, 3, 6, 7, 8
SURFACE, ACCEL_DENSITY, GYRO_DENSITY, BG_RATE, BG_DENSITY, BA_RATE, BA_DENSITY, GAP_ACCEL, GAP_RATE, PARAMETERS = range(10)
C_M, FORCE_M, W_IN_M, CORIOLIS_M, CURVE_M, GRADIENT_M, PRESENT_M, DECAY_M = 0, 9, 12, 15, 18, 21, 22, 23


@kernel()
def navigation_rate(axis, k, v):
    """Rates of the navigation frame: against Earth (level, two numbers), and Earth's own (three)."""
    return level_rotation(axis, k, v[0], v[1]), (EARTH_RATE * axis[0], EARTH_RATE * axis[1], EARTH_RATE * axis[2])


@kernel(STEP)
def step(x, u, dt, params, m):
    """One step with constant rate and force; without input (a gap) velocity and attitude are held against the Earth."""
    axis = third_row(x[P], x[P + 1], x[P + 2], x[P + 3])
    height = x[H]
    k = curvature(axis, height)
    c = load_matrix(x, Q)
    v = load3(x, V)
    present = u[PRESENT_U] != 0.0
    g = gravity(axis, height, params[SURFACE])
    transport, earth = navigation_rate(axis, k, v)

    # velocity: rotate the force over the step (body turning, then the navigation frame), Coriolis at the middle
    a = ((u[RATE_U] - x[BG]) * dt, (u[RATE_U + 1] - x[BG + 1]) * dt, (u[RATE_U + 2] - x[BG + 2]) * dt)
    f = ((u[FORCE_U] - x[BA]) * dt, (u[FORCE_U + 1] - x[BA + 1]) * dt, (u[FORCE_U + 2] - x[BA + 2]) * dt)
    af = cross(a, f)
    aaf = cross(a, af)
    s = turn(c, (f[0] + 0.5 * af[0] + aaf[0] * (1 / 6), f[1] + 0.5 * af[1] + aaf[1] * (1 / 6), f[2] + 0.5 * af[2] + aaf[2] * (1 / 6)))
    w_in = (earth[0] + transport[0], earth[1] + transport[1], earth[2])
    ws = cross(w_in, s)
    dv = (s[0] - 0.5 * dt * ws[0], s[1] - 0.5 * dt * ws[1], s[2] - 0.5 * dt * ws[2] + g * dt)
    middle = (v[0] + 0.5 * dv[0], v[1] + 0.5 * dv[1], v[2] + 0.5 * dv[2])
    transport, _ = navigation_rate(axis, k, middle)
    w_coriolis = (2.0 * earth[0] + transport[0], 2.0 * earth[1] + transport[1], 2.0 * earth[2])
    wv = cross(w_coriolis, middle)
    new = (v[0] + dv[0] - wv[0] * dt, v[1] + dv[1] - wv[1] * dt, v[2] + dv[2] - wv[2] * dt) if present else v

    # attitude: the body's turn on the right, the navigation frame's on the left
    w_in = (earth[0] + transport[0], earth[1] + transport[1], earth[2])
    if present:
        q = product(load4(x, Q), exponential(a[0], a[1], a[2]))
        q = product(exponential(-w_in[0] * dt, -w_in[1] * dt, -w_in[2] * dt), q)
        store_quaternion(x, Q, q)

    # place: the mean velocity over the step
    mean = (0.5 * (v[0] + new[0]), 0.5 * (v[1] + new[1]), 0.5 * (v[2] + new[2]))
    t0, t1 = level_rotation(axis, k, mean[0] * dt, mean[1] * dt)
    store_quaternion(x, P, product(load4(x, P), exponential(t0, t1, 0.0)))
    x[H] = height - mean[2] * dt
    store3(x, V, new)

    on = 1.0 if present else 0.0  # in a gap nothing turns and nothing accelerates: position follows velocity, and that is all
    for i in range(9):
        m[C_M + i] = c[i]
    store3(m, FORCE_M, (s[0] * on / dt, s[1] * on / dt, s[2] * on / dt))
    store3(m, W_IN_M, (w_in[0] * on, w_in[1] * on, w_in[2] * on))
    store3(m, CORIOLIS_M, (w_coriolis[0] * on, w_coriolis[1] * on, w_coriolis[2] * on))
    k01 = k[1] * axis[0] * axis[1] * on
    store3(m, CURVE_M, ((k[0] + k[1] * axis[0] * axis[0]) * on, k01, (k[0] + k[1] * axis[1] * axis[1]) * on))
    m[GRADIENT_M] = (2.0 * g * k[0] - (WATER_GRADIENT if height < params[SURFACE] else 0.0)) * on
    m[PRESENT_M] = on
    m[DECAY_M] = math.exp(-dt * params[BG_RATE]) if params[BG_RATE] > 0.0 else 1.0
    m[DECAY_M + 1] = math.exp(-dt * params[BA_RATE]) if params[BA_RATE] > 0.0 else 1.0
    for i in range(3):
        x[BG + i] *= m[DECAY_M]
        x[BA + i] *= m[DECAY_M + 1]


@kernel(inline=True)
def push_columns(m, dt, params, B, A, columns):
    """The error equations above, to first order in dt, on `columns` columns."""
    W = WIDE
    decay_g, decay_a = m[DECAY_M], m[DECAY_M + 1]
    n0, n1, n2 = m[FORCE_M] * dt, m[FORCE_M + 1] * dt, m[FORCE_M + 2] * dt
    i0, i1, i2 = m[W_IN_M] * dt, m[W_IN_M + 1] * dt, m[W_IN_M + 2] * dt
    o0, o1, o2 = m[CORIOLIS_M] * dt, m[CORIOLIS_M + 1] * dt, m[CORIOLIS_M + 2] * dt
    k00, k01, k11 = m[CURVE_M] * dt, m[CURVE_M + 1] * dt, m[CURVE_M + 2] * dt
    gradient = m[GRADIENT_M] * dt
    on = m[PRESENT_M] * dt
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = (m[0] * on, m[1] * on, m[2] * on, m[3] * on, m[4] * on, m[5] * on,
                                                   m[6] * on, m[7] * on, m[8] * on)  # fmt: skip
    for j in range(columns):
        v0, v1, v2 = B[3 * W + j], B[4 * W + j], B[5 * W + j]
        t0, t1, t2 = B[6 * W + j], B[7 * W + j], B[8 * W + j]
        g0, g1, g2 = B[9 * W + j], B[10 * W + j], B[11 * W + j]
        a0, a1, a2 = B[12 * W + j], B[13 * W + j], B[14 * W + j]
        p2 = B[2 * W + j]
        A[j] = B[j] + dt * v0
        A[W + j] = B[W + j] + dt * v1
        A[2 * W + j] = p2 + dt * v2
        A[3 * W + j] = v0 + o2 * v1 - o1 * v2 + n2 * t1 - n1 * t2 - c00 * a0 - c01 * a1 - c02 * a2
        A[4 * W + j] = v1 + o0 * v2 - o2 * v0 + n0 * t2 - n2 * t0 - c10 * a0 - c11 * a1 - c12 * a2
        A[5 * W + j] = v2 + o1 * v0 - o0 * v1 + n1 * t0 - n0 * t1 - c20 * a0 - c21 * a1 - c22 * a2 + gradient * p2
        A[6 * W + j] = t0 + i2 * t1 - i1 * t2 - k01 * v0 - k11 * v1 - c00 * g0 - c01 * g1 - c02 * g2
        A[7 * W + j] = t1 + i0 * t2 - i2 * t0 + k00 * v0 + k01 * v1 - c10 * g0 - c11 * g1 - c12 * g2
        A[8 * W + j] = t2 + i1 * t0 - i0 * t1 - c20 * g0 - c21 * g1 - c22 * g2
        A[9 * W + j], A[10 * W + j], A[11 * W + j] = decay_g * g0, decay_g * g1, decay_g * g2
        A[12 * W + j], A[13 * W + j], A[14 * W + j] = decay_a * a0, decay_a * a1, decay_a * a2


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """A = Phi B; compiled for the usual widths, as a run-time width keeps the loop from being unrolled."""
    if columns == 16:
        push_columns(m, dt, params, B, A, 16)
    elif columns == 24:
        push_columns(m, dt, params, B, A, 24)
    else:
        push_columns(m, dt, params, B, A, columns)


@kernel(NOISE)
def noise(m, dt, params, P):
    """P += Q: white noise of accelerometers and gyros (or, in a gap, of the unknown motion), and what drives the biases."""
    present = m[PRESENT_M] != 0.0
    accel = params[ACCEL_DENSITY] if present else params[GAP_ACCEL]
    gyro = params[GYRO_DENSITY] if present else params[GAP_RATE]
    if not present:  # steps are long there: what shakes the velocity moves the position within the step
        half, third = 0.5 * accel * dt * dt, accel * dt * dt * dt / 3.0
        for i in range(3):
            P[i * (WIDE + 1)] += third
            P[i * WIDE + 3 + i] += half
            P[(3 + i) * WIDE + i] += half
    for i in range(3):
        P[(3 + i) * (WIDE + 1)] += accel * dt
        P[(6 + i) * (WIDE + 1)] += gyro * dt
        P[(9 + i) * (WIDE + 1)] += params[BG_DENSITY] * dt
        P[(12 + i) * (WIDE + 1)] += params[BA_DENSITY] * dt


@kernel(VIEW)
def view(x, u, params, out):
    """Place, velocity, attitude; rate = gyro - bias - R^T w_in, force = accelerometer - bias.

    The rate brings the gyro's noise over the interval along; in a gap, where it is taken as zero, that of the unknown motion.
    """
    for i in range(12):
        out[i] = x[i]
    axis = third_row(x[P], x[P + 1], x[P + 2], x[P + 3])
    transport, earth = navigation_rate(axis, curvature(axis, x[H]), load3(x, V))
    w = turn_back(load_matrix(x, Q), (earth[0] + transport[0], earth[1] + transport[1], earth[2]))
    present = u[PRESENT_U] != 0.0
    for i in range(3):
        out[12 + i] = u[RATE_U + i] - x[BG + i] - w[i] if present else 0.0
        out[15 + i] = u[FORCE_U + i] - x[BA + i] if present else 0.0
        out[18 + i] = 0.0
    out[RATE_VARIANCE_V] = params[GYRO_DENSITY] / u[INTERVAL_U] if present else params[GAP_RATE]


@kernel(PULL)
def pull(x, u, params, view, Hv, H, rows):
    """Position, velocity and attitude are states; d rate = -d gyro_bias - R^T (w_in x d theta), d force = -d accel_bias."""
    c = load_matrix(x, Q)
    axis = third_row(x[P], x[P + 1], x[P + 2], x[P + 3])
    transport, earth = navigation_rate(axis, curvature(axis, x[4]), load3(x, V))
    w = (earth[0] + transport[0], earth[1] + transport[1], earth[2])
    for r in range(rows):
        for i in range(3):
            H[r, i] = Hv[r, POSITION_T + i]
            H[r, 3 + i] = Hv[r, VELOCITY_T + i]
            H[r, 9 + i] = -Hv[r, RATE_T + i]
            H[r, 12 + i] = -Hv[r, FORCE_T + i]
        back = turn(c, (Hv[r, RATE_T], Hv[r, RATE_T + 1], Hv[r, RATE_T + 2]))
        turned = cross(back, w)
        for i in range(3):
            H[r, 6 + i] = Hv[r, ATTITUDE_T + i] - turned[i]


def inertial(imu: SensorConfig, surface: float) -> Process:
    """Return the process model `inertial` of an IMU, for water whose surface is at the height `surface` (m)."""
    defines = frozenset({VELOCITY, RATE, FORCE})
    bias = np.array([imu.value("gyro_bias")] * 3 + [imu.value("accel_bias")] * 3)
    return Process(
        "inertial", PARTS, parameters_of(imu, surface), step, push, noise, view, pull, defines,
        begin=partial(begin_with, values=np.zeros(6), sigmas=bias), consumes="imu", reference_b=imu.lever_arm_b,
    )  # fmt: skip


def begin_with(pose: Pose, values: Array, sigmas: Array) -> tuple[Array, Array]:
    """Return the initial motion and its covariance: those of the pose, then values with their sigmas."""
    x = np.concatenate([pose.quaternion_en, [pose.height], pose.velocity_n, pose.quaternion_nb, values])
    covariance = np.diag(np.concatenate([np.zeros(9), np.square(sigmas)]))
    covariance[:9, :9] = pose.covariance
    return x, covariance


def parameters_of(imu: SensorConfig, surface: float) -> Array:
    """Return the parameters (PARAMETERS,) of an IMU."""
    parameters = np.zeros(PARAMETERS)
    parameters[SURFACE] = surface
    parameters[ACCEL_DENSITY], parameters[GYRO_DENSITY] = imu.value("accel_noise") ** 2, imu.value("gyro_noise") ** 2
    parameters[BG_RATE], parameters[BG_DENSITY] = _wander(imu, "gyro_bias")
    parameters[BA_RATE], parameters[BA_DENSITY] = _wander(imu, "accel_bias")
    parameters[GAP_ACCEL], parameters[GAP_RATE] = imu.value("gap_accel") ** 2, imu.value("gap_rate") ** 2
    return parameters


def _wander(imu: SensorConfig, bias: str) -> tuple[float, float]:
    """Decay rate and noise density of a bias: a random walk by its instability in tau, or a stationary process of its sigma and tau.

    As a random walk the turn-on bias is a constant that does not decay, so the wandering part must not pull the whole bias to zero.
    """
    tau = imu.value(f"{bias}_tau")
    if imu.value(f"{bias}_process", "random_walk") == "gauss_markov":
        return 1.0 / tau, 2.0 * imu.value(bias) ** 2 / tau
    return 0.0, imu.value(f"{bias}_instability") ** 2 / tau
