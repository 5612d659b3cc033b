"""Process model of Wang and Pang (2014), eq. 7, as it is printed: body speeds grow by the acceleration alone.

    p' = R v_b        v_b' = a        R' = R [w]x         a = f + R^T g

The term -w x v_b is missing; with it this is the model `body-velocity`, whose state, error, view and start it has.  The paper does not
say how its accelerations were freed of gravity: here by the attitude at hand, of which the transition, as printed, knows nothing.
Its process noise is that of the accelerations of table II, at 10 Hz, and of the gyros of the vehicle file.
A vehicle file names it by `process.model = "published_motion.py:compose"`.
"""

from __future__ import annotations

from dataclasses import replace

from leadline.core.compiled import NOISE, PUSH, STEP, WIDE, kernel
from leadline.core.earth import gravity, move, third_row
from leadline.core.rotation import exponential, load3, load4, load_matrix, product, store3, store_quaternion, turn
from leadline.models import body_velocity
from leadline.models.inertial import FORCE_U, GYRO_DENSITY, PRESENT_U, RATE_U, SURFACE

PLACE, HEIGHT, V, Q = 0, 4, 5, 8
C_M, VELOCITY_M = 0, 9
ACCEL_DENSITY = (1.73e-5, 1.39e-5, 3.9e-5)  # (m/s^2)^2 / Hz, ahead, sideways, down


@kernel(STEP)
def step(x, u, dt, params, m):
    """p += R v dt, v += a dt, R <- R exp(w dt)."""
    c, v = load_matrix(x, Q), load3(x, V)
    g = gravity(third_row(x[0], x[1], x[2], x[3]), x[HEIGHT], params[SURFACE]) if u[PRESENT_U] != 0.0 else 0.0
    n = turn(c, v)
    for i in range(3):
        x[V + i] += (u[FORCE_U + i] + c[6 + i] * g) * dt
    store_quaternion(x, Q, product(load4(x, Q), exponential(u[RATE_U] * dt, u[RATE_U + 1] * dt, u[RATE_U + 2] * dt)))
    move(x, PLACE, n[0] * dt, n[1] * dt, n[2] * dt)
    for i in range(9):
        m[C_M + i] = c[i]
    store3(m, VELOCITY_M, n)


@kernel(PUSH)
def push(m, dt, params, B, A, columns):
    """dp' = dp + (R dv + dtheta x R v) dt, dv' = dv, dtheta' = dtheta."""
    W, n0, n1, n2 = WIDE, m[VELOCITY_M], m[VELOCITY_M + 1], m[VELOCITY_M + 2]
    for j in range(columns):
        b0, b1, b2 = B[3 * W + j], B[4 * W + j], B[5 * W + j]
        t0, t1, t2 = B[6 * W + j], B[7 * W + j], B[8 * W + j]
        A[j] = B[j] + dt * (m[0] * b0 + m[1] * b1 + m[2] * b2 + t1 * n2 - t2 * n1)
        A[W + j] = B[W + j] + dt * (m[3] * b0 + m[4] * b1 + m[5] * b2 + t2 * n0 - t0 * n2)
        A[2 * W + j] = B[2 * W + j] + dt * (m[6] * b0 + m[7] * b1 + m[8] * b2 + t0 * n1 - t1 * n0)
        for i in range(3, 9):
            A[i * W + j] = B[i * W + j]


@kernel(NOISE)
def noise(m, dt, params, P):
    """White noise of accelerometers and gyros."""
    for i in range(3):
        P[(3 + i) * (WIDE + 1)] += ACCEL_DENSITY[i] * dt
        P[(6 + i) * (WIDE + 1)] += params[GYRO_DENSITY] * dt


def compose(vehicle, context):
    """Return `body-velocity` with the motion as printed."""
    return replace(body_velocity.compose(vehicle, context), name="as published", step=step, push=push, noise=noise)
