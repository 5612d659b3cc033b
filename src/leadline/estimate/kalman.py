"""Error-state extended Kalman filter: one point, analytic Jacobians, any layout.

propagate   x <- f(x)      P <- [Phi 0; 0 beta] P [Phi 0; 0 beta]^T + Q        (clones stand still: beta = 1, Q = 0)
update      S = H P H^T + R = L L^T,  Y = L^-1 H P,  y = L^-1 (z - h);  gate on |y|^2;  x <- x [+] Y^T y,  P <- P - Y^T Y
"""

from __future__ import annotations

import math

from leadline.core.compiled import (
    COMPONENTS,
    POINTS,
    PROPAGATE,
    SLOT_NUISANCE,
    UPDATE,
    WIDE,
    call_noise,
    call_pull,
    call_push,
    call_step,
    call_view,
    kernel,
)
from leadline.core.gaussian import correct, symmetrise, transpose, whiten, wrapped
from leadline.estimate.plan import (
    ANGLES,
    CHANNEL,
    CHANNEL_SIZE,
    COMPONENTS_N,
    DECAY_PARAMS,
    EPOCHS,
    GATE,
    MOTION_END,
    MOTION_PARAMS,
    NIS,
    NOISE_AT,
    PULL_AT,
    PUSH_AT,
    RESIDUAL,
    SIGMA,
    STEP_AT,
    VALUES,
    VALUES_N,
    VIEW_AT,
)
from leadline.models.layout import (
    ACTIVE,
    CLONE_ERROR,
    CLONE_NOMINAL,
    CLONE_TIME,
    CLONES,
    COV,
    INPUT,
    INPUTS,
    MOTION,
    NOMINAL,
    NUISANCES_N,
    TIME,
    X,
    retract,
)
from leadline.models.view import ATTITUDE_T, POSITION_T, RATE_T, RATE_VARIANCE_V, TANGENT, VIEW_SIZE

USED, GATED, INVALID = 0, 1, 2  # of data/outcome.py
SYMMETRISE = 0.1  # times a second: asymmetry grows by rounding alone, to 1e-9 of a sigma in a day if nothing is done


@kernel(PROPAGATE)
def propagate(plan, params, state, dt, work, points):
    """One step of motion, nuisances and covariance."""
    nm, nc, n = plan[MOTION], plan[NUISANCES_N], int(state[ACTIVE])
    w = 16 if n <= 16 else (24 if n <= 24 else WIDE)
    x, P, u = state[plan[X] : plan[COV]], state[plan[COV] :], state[INPUT : INPUT + INPUTS]
    p = params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    A, B, m = work[: WIDE * WIDE], work[WIDE * WIDE : 2 * WIDE * WIDE], work[2 * WIDE * WIDE :]
    call_step(plan[STEP_AT], x, u, dt, p, m)
    call_push(plan[PUSH_AT], m, dt, p, P, A, w)  # A = Phi P, all columns
    transpose(A, B, (nm + 3) // 4 * 4)
    call_push(plan[PUSH_AT], m, dt, p, B, P, 16 if nm <= 16 else w)  # P_mm = Phi (Phi P_mm)^T
    at = plan[DECAY_PARAMS]
    for i in range(nm, n):
        k = i - nm
        beta = params[at + 2 * k] if k < nc else 0.0
        beta = 1.0 if beta == 0.0 else math.exp(-beta * dt)
        for j in range(nm):
            P[j * WIDE + i] = P[i * WIDE + j] = A[j * WIDE + i] * beta  # P_mc = Phi P_mc beta
        if k < nc:
            x[plan[NOMINAL] + k] *= beta
            if beta != 1.0:
                for j in range(nm, n):
                    P[i * WIDE + j] *= beta
                    P[j * WIDE + i] *= beta
            P[i * WIDE + i] += dt * params[at + 2 * k + 1]
    call_noise(plan[NOISE_AT], m, dt, p, P)
    if math.floor(state[TIME] * SYMMETRISE) != math.floor((state[TIME] + dt) * SYMMETRISE):
        symmetrise(P, n)


@kernel()
def find_clone(plan, state, epoch):
    """Which clone holds the pose at `epoch`; -1: none."""
    for c in range(plan[CLONES]):
        if state[CLONE_TIME + c] == epoch:
            return c
    return -1


@kernel(POINTS)
def points(plan, params, state, channel, row, work, points, V, N):
    """Fill in the views and the complete nuisances at the estimate; 0 if the pose at the earlier epoch is not held.

    The earlier epoch is the last number of a row whose channel has two.
    """
    x, u = state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS]
    call_view(plan[VIEW_AT], x, u, params[plan[MOTION_PARAMS] : plan[MOTION_END]], V[0, :VIEW_SIZE])
    at = CHANNEL + CHANNEL_SIZE * channel
    if plan[at + EPOCHS] == 2:
        clone = find_clone(plan, state, row[len(row) - 1])
        if clone < 0:
            return 0
        start = plan[NOMINAL] + plan[NUISANCES_N] + CLONE_NOMINAL * clone
        V[0, VIEW_SIZE : 2 * VIEW_SIZE] = 0.0
        V[0, VIEW_SIZE : VIEW_SIZE + 5] = x[start : start + 5]
        V[0, VIEW_SIZE + 8 : VIEW_SIZE + 12] = x[start + 5 : start + 9]
    for k in range(plan[at + VALUES_N]):
        i = plan[at + SLOT_NUISANCE + k]
        N[0, k] = x[plan[NOMINAL] + i - plan[MOTION]] if i >= 0 else params[plan[at + VALUES] + k]
    return 1


@kernel()
def fill_jacobian(plan, params, state, channel, row, Hv, Hn, view, H):
    """H over the composed state: motion by the process model's `pull`, nuisances that are states, and the clone."""
    nm, n = plan[MOTION], int(state[ACTIVE])
    x, u = state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS]
    at = CHANNEL + CHANNEL_SIZE * channel
    c = plan[at + COMPONENTS_N]
    call_pull(plan[PULL_AT], x, u, params[plan[MOTION_PARAMS] : plan[MOTION_END]], view, Hv, H, c)
    for a in range(c):
        H[a, nm:n] = 0.0
        for k in range(plan[at + VALUES_N]):
            i = plan[at + SLOT_NUISANCE + k]
            if i >= 0:
                H[a, i] += Hn[a, k]
    if plan[at + EPOCHS] == 2:
        i = nm + plan[NUISANCES_N] + CLONE_ERROR * find_clone(plan, state, row[len(row) - 1])
        for a in range(c):
            H[a, i : i + 3] = Hv[a, TANGENT + POSITION_T : TANGENT + POSITION_T + 3]
            H[a, i + 3 : i + 6] = Hv[a, TANGENT + ATTITUDE_T : TANGENT + ATTITUDE_T + 3]


@kernel()
def add_rate_noise(R, Hv, variance, c):
    """R <- R + J J^T variance, with J the Jacobian against the rate: a lever arm turns the noise of the gyro into velocity."""
    if variance > 0.0:
        for a in range(c):
            for b in range(c):
                for k in range(RATE_T, RATE_T + 3):
                    R[a, b] += variance * Hv[a, k] * Hv[b, k]


@kernel(UPDATE)
def update(plan, params, state, channel, row, Z, R, Hv, Hn, work, points, result):
    """Judge the whole measurement against the gate, then use it."""
    n, at = int(state[ACTIVE]), CHANNEL + CHANNEL_SIZE * channel
    P, c = state[plan[COV] :], plan[at + COMPONENTS_N]
    y, d, S, L, Y = work[0:8], work[8 : 8 + WIDE], work[64:128], work[128:192], work[192 : 192 + COMPONENTS * WIDE]
    H, view = points, points[points.shape[0] - 1, :VIEW_SIZE]
    call_view(
        plan[VIEW_AT], state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS], params[plan[MOTION_PARAMS] : plan[MOTION_END]], view
    )
    fill_jacobian(plan, params, state, channel, row, Hv, Hn, view, H)
    add_rate_noise(R, Hv, view[RATE_VARIANCE_V], c)
    w = (n + 7) // 8 * 8
    for a in range(c):
        y[a] = row[a] - Z[0, a]
        if (plan[at + ANGLES] >> a) & 1:
            y[a] = wrapped(y[a])
        result[RESIDUAL + a] = y[a]
        for j in range(w):
            Y[a * WIDE + j] = 0.0
        for i in range(n):
            h = H[a, i]
            if h != 0.0:
                for j in range(w):
                    Y[a * WIDE + j] += h * P[i * WIDE + j]  # Y = H P
    for a in range(c):
        for b in range(c):
            s = R[a, b]
            for j in range(n):
                s += Y[a * WIDE + j] * H[b, j]
            S[a * COMPONENTS + b] = s
        result[SIGMA + a] = math.sqrt(S[a * COMPONENTS + a])
    nis = whiten(S, L, Y, y, c, n)
    result[NIS] = nis
    if not nis < params[plan[at + GATE]]:
        return GATED if nis == nis else INVALID
    correct(P, Y, y, d, c, n)  # keeps symmetry to the bit
    retract(plan, state[plan[X] : plan[COV]], d, n)
    return USED
