"""Error-state extended Kalman filter: one point, analytic Jacobians, any layout.

propagate   x <- f(x)      P <- [Phi 0; 0 beta] P [Phi 0; 0 beta]^T + Q        (clones stand still: beta = 1, Q = 0)
update      S = H P H^T + R = L L^T,  Y = L^-1 H P,  y = L^-1 (z - h);  gate on |y|^2;  x <- x [+] Y^T y,  P <- P - Y^T Y

A nuisance with decay rate r (per second, and by speed / length) has beta = exp(-r dt) and driving variance s^2 (1 - beta^2).
What is done is noted on a tape where there is one (estimate/tape.py), for the smoother.
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
from leadline.estimate.adaptive import learn, noise_factor
from leadline.estimate.displacement import displace, lever_of, offset_of, pull_back
from leadline.estimate.gate import limit_of, opened, student_factor
from leadline.estimate.plan import (
    ADAPT_Q,
    ADMIT,
    ANGLES,
    CHANNEL,
    CHANNEL_SIZE,
    COMPONENTS_N,
    DECAY,
    DECAY_PARAMS,
    DECAY_PER_METRE,
    DECAY_SIZE,
    DENSITY,
    DENSITY_PER_METRE,
    DISPLACED,
    EPOCHS,
    ESTIMATOR,
    FIELDS,
    GATE,
    LIMIT,
    LOG_DET,
    MEAN,
    MOTION_END,
    MOTION_PARAMS,
    NIS,
    NOISE_AT,
    NOISE_FACTOR,
    PULL_AT,
    PUSH_AT,
    REANCHOR_AFTER,
    RESIDUAL,
    SIGMA,
    STEP_AT,
    STUDENT_DOF,
    VALUES,
    VALUES_N,
    VERDICT,
    VIEW_AT,
    WIDENED,
)
from leadline.estimate.tape import DRIVEN, note_measurement, push_transition
from leadline.models.layout import (
    ACTIVE,
    BEGUN,
    CHANNELS_N,
    CLONE_ERROR,
    CLONE_NOMINAL,
    CLONE_TIME,
    CLONES,
    COV,
    INPUT,
    INPUTS,
    LAST_USED,
    MOTION,
    NOMINAL,
    NUISANCES_N,
    TIME,
    X,
    retract,
)
from leadline.models.view import (
    ATTITUDE_T,
    POSITION_T,
    RATE_T,
    RATE_VARIANCE_V,
    TANGENT,
    VELOCITY_V,
    VIEW_SIZE,
)

USED, GATED, INVALID, REANCHORED = 0, 1, 2, 13  # of data/outcome.py
SYMMETRISE = 0.1  # times a second: asymmetry grows by rounding alone, to 1e-9 of a sigma in a day if nothing is done


@kernel()
def speed_of(plan, params, state, view):
    """Level speed over ground (m/s)."""
    call_view(
        plan[VIEW_AT], state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS], params[plan[MOTION_PARAMS] : plan[MOTION_END]], view
    )
    return math.hypot(view[VELOCITY_V], view[VELOCITY_V + 1])


@kernel()
def width_of(n):
    """The width at which columns are pushed: one of those that kernels are compiled for."""
    return 16 if n <= 16 else (24 if n <= 24 else (32 if n <= 32 else WIDE))


@kernel()
def decay_of(plan, params, k, speed, dt):
    """What is left of nuisance k after a step, and the variance that drives it meanwhile."""
    at = plan[DECAY_PARAMS] + DECAY_SIZE * k
    rate = params[at + DECAY] + speed * params[at + DECAY_PER_METRE]
    density = params[at + DENSITY] + speed * params[at + DENSITY_PER_METRE]
    if rate == 0.0:
        return 1.0, density * dt
    beta = math.exp(-rate * dt)
    return beta, density / (2.0 * rate) * (1.0 - beta * beta)


@kernel()
def fade(plan, params, x, k, beta):
    """Let nuisance k decay towards its mean."""
    if beta != 1.0:
        mean = params[plan[DECAY_PARAMS] + DECAY_SIZE * k + MEAN]
        x[plan[NOMINAL] + k] = mean + (x[plan[NOMINAL] + k] - mean) * beta


@kernel()
def drift_nuisances(plan, params, x, P, A, speed, dt, n, tape):
    """One step of nuisances, and of their covariances with the motion: P_mc = (A = Phi P)_mc beta; clones stand still."""
    nm, nc = plan[MOTION], plan[NUISANCES_N]
    for i in range(nm, n):
        k = i - nm
        beta, drive = (1.0, 0.0) if k >= nc else decay_of(plan, params, k, speed, dt)
        for j in range(nm):
            P[j * WIDE + i] = P[i * WIDE + j] = A[j * WIDE + i] * beta
        if k < nc:
            fade(plan, params, x, k, beta)
            if beta != 1.0:
                for j in range(nm, n):
                    P[i * WIDE + j] *= beta
                    P[j * WIDE + i] *= beta
            P[i * WIDE + i] += drive
            if tape.shape[0] > 0:
                tape[DRIVEN + i] += drive


@kernel()
def add_noise(plan, params, state, m, dt, p, P, Q):
    """P <- P + q Q, with q the factor by which the noise of the motion has been found larger (1 unless it is learnt)."""
    if params[plan[ESTIMATOR] + ADAPT_Q] == 0.0:
        call_noise(plan[NOISE_AT], m, dt, p, P)
        return
    nm, q = plan[MOTION], state[plan[X] - 1]
    Q[: nm * WIDE] = 0.0
    call_noise(plan[NOISE_AT], m, dt, p, Q)
    for i in range(nm):
        for j in range(nm):
            P[i * WIDE + j] += q * Q[i * WIDE + j]


@kernel()
def symmetrise_at_times(state, P, dt, n):
    """Make P symmetric again, `SYMMETRISE` times a second at moments that do not depend on how steps are cut."""
    if math.floor(state[TIME] * SYMMETRISE) != math.floor((state[TIME] + dt) * SYMMETRISE):
        symmetrise(P, n)


@kernel(PROPAGATE)
def propagate(plan, params, state, dt, work, points, tape):
    """One step of motion, nuisances and covariance."""
    nm, n = plan[MOTION], int(state[ACTIVE])
    w = width_of(n)
    x, P, u = state[plan[X] : plan[COV]], state[plan[COV] :], state[INPUT : INPUT + INPUTS]
    p = params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    A, B, m = work[: WIDE * WIDE], work[WIDE * WIDE : 2 * WIDE * WIDE], work[2 * WIDE * WIDE :]
    speed = speed_of(plan, params, state, m[:VIEW_SIZE]) if plan[FIELDS] > 0 else 0.0
    call_step(plan[STEP_AT], x, u, dt, p, m)
    call_push(plan[PUSH_AT], m, dt, p, P, A, w)  # A = Phi P, all columns
    transpose(A, B, (nm + 3) // 4 * 4)
    call_push(plan[PUSH_AT], m, dt, p, B, P, 16 if nm <= 16 else w)  # P_mm = Phi (Phi P_mm)^T
    drift_nuisances(plan, params, x, P, A, speed, dt, n, tape)
    if tape.shape[0] > 0:
        push_transition(plan, params, m, dt, speed, n, tape)
        for i in range(nm):
            tape[DRIVEN + i] -= P[i * (WIDE + 1)]
    add_noise(plan, params, state, m, dt, p, P, B)
    if tape.shape[0] > 0:
        for i in range(nm):
            tape[DRIVEN + i] += P[i * (WIDE + 1)]
    symmetrise_at_times(state, P, dt, n)


@kernel()
def find_clone(plan, state, epoch):
    """Which clone holds the pose at `epoch`; -1: none."""
    for c in range(plan[CLONES]):
        if state[CLONE_TIME + c] == epoch:
            return c
    return -1


@kernel()
def look_from(plan, params, state, channel, row, view, nuisance):
    """Fill in the view(s) and the complete nuisances at a state; false if the pose at the earlier epoch is not held.

    The earlier epoch is the last number of a row whose channel has two.
    """
    x, u = state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS]
    call_view(plan[VIEW_AT], x, u, params[plan[MOTION_PARAMS] : plan[MOTION_END]], view[:VIEW_SIZE])
    at = CHANNEL + CHANNEL_SIZE * channel
    if plan[at + DISPLACED] != 0:
        displace(view[:VIEW_SIZE], -offset_of(plan, params, state, channel), lever_of(plan, params, state, channel))
    if plan[at + EPOCHS] == 2:
        clone = find_clone(plan, state, row[len(row) - 1])
        if clone < 0:
            return False
        start = plan[NOMINAL] + plan[NUISANCES_N] + CLONE_NOMINAL * clone
        view[VIEW_SIZE : 2 * VIEW_SIZE] = 0.0
        view[VIEW_SIZE : VIEW_SIZE + 5] = x[start : start + 5]
        view[VIEW_SIZE + 8 : VIEW_SIZE + 12] = x[start + 5 : start + 9]
    for k in range(plan[at + VALUES_N]):
        i = plan[at + SLOT_NUISANCE + k]
        nuisance[k] = x[plan[NOMINAL] + i - plan[MOTION]] if i >= 0 else params[plan[at + VALUES] + k]
    return True


@kernel(POINTS)
def points(plan, params, state, channel, row, work, points, V, N):
    """One point: the estimate."""
    return 1 if look_from(plan, params, state, channel, row, V[0], N[0]) else 0


@kernel()
def fill_jacobian(plan, params, state, channel, row, Hv, Hn, view, H):
    """H over the composed state: nuisances that are states, what displaces the view, motion by the process model's `pull`, the clone."""
    nm, n = plan[MOTION], int(state[ACTIVE])
    x, u = state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS]
    at = CHANNEL + CHANNEL_SIZE * channel
    c = plan[at + COMPONENTS_N]
    for a in range(c):
        H[a, nm:n] = 0.0
        for k in range(plan[at + VALUES_N]):
            i = plan[at + SLOT_NUISANCE + k]
            if i >= 0:
                H[a, i] += Hn[a, k]
    if plan[at + DISPLACED] != 0:
        lever = lever_of(plan, params, state, channel)
        pull_back(plan, channel, state[TIME], view, -offset_of(plan, params, state, channel), lever, Hv, H, c)
    call_pull(plan[PULL_AT], x, u, params[plan[MOTION_PARAMS] : plan[MOTION_END]], view, Hv, H, c)
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


@kernel()
def add_noise_of_rate(plan, params, state, R, Hv, view, c):
    """Add to R what the noise of a rate that is an input does to the measurement."""
    call_view(
        plan[VIEW_AT], state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS], params[plan[MOTION_PARAMS] : plan[MOTION_END]], view
    )
    add_rate_noise(R, Hv, view[RATE_VARIANCE_V], c)


@kernel()
def project(P, H, Y, T, c, n):
    """Y = H P and T = H P H^T."""
    w = (n + 7) // 8 * 8
    for a in range(c):
        for j in range(w):
            Y[a * WIDE + j] = 0.0
        for i in range(n):
            h = H[a, i]
            if h != 0.0:
                for j in range(w):
                    Y[a * WIDE + j] += h * P[i * WIDE + j]
    for a in range(c):
        for b in range(c):
            s = 0.0
            for j in range(n):
                s += Y[a * WIDE + j] * H[b, j]
            T[a * COMPONENTS + b] = s


@kernel()
def judge(R, T, L, Y, r, y, factor, c, n, result):
    """Whiten with S = T + factor R; returns the normalised innovation squared, and leaves what is known of the residual in `result`."""
    S = L[COMPONENTS * COMPONENTS :]
    for a in range(c):
        y[a] = r[a]
        for b in range(c):
            S[a * COMPONENTS + b] = T[a * COMPONENTS + b] + factor * R[a, b]
        result[SIGMA + a] = math.sqrt(S[a * COMPONENTS + a])
    nis = whiten(S, L, Y, y, c, n)
    det = 0.0
    for a in range(c):
        det += math.log(L[a * COMPONENTS + a])
    result[NIS], result[LOG_DET] = nis, 2.0 * det
    return nis


@kernel()
def verdict_of(plan, params, state, channel, nis, result):
    """What the gate says of a normalised innovation squared, and in `result` whether it let pass what a plain gate would not."""
    g = plan[CHANNEL + CHANNEL_SIZE * channel + GATE]
    result[WIDENED] = 1.0 if params[g + STUDENT_DOF] > 0.0 else 0.0
    if nis < params[g + LIMIT] or result[VERDICT] == ADMIT:
        return USED
    result[WIDENED] = 1.0
    if nis < limit_of(params, g, state[TIME] - max(state[BEGUN], state[LAST_USED + channel])):
        return USED
    run = params[g + REANCHOR_AFTER]
    if run > 0.0 and state[LAST_USED + plan[CHANNELS_N] + channel] + 1.0 >= run:
        return REANCHORED
    result[WIDENED] = 0.0
    return GATED


@kernel()
def conclude(plan, params, state, channel, R, H, Hn, work, tape, result):
    """Judge the whole measurement against the gate, then use it; after a run of rejections open the estimate up and use it then.

    The residual stands at the beginning of `work`, H is over all active errors.
    """
    n, at = int(state[ACTIVE]), CHANNEL + CHANNEL_SIZE * channel
    P, c, g = state[plan[COV] :], plan[at + COMPONENTS_N], plan[at + GATE]
    r, y, d, T = work[0:8], work[8:16], work[16 : 16 + WIDE], work[64:128]
    L, Y = work[128:256], work[256 : 256 + COMPONENTS * WIDE]
    for a in range(c):
        result[RESIDUAL + a] = r[a]
    project(P, H, Y, T, c, n)
    factor = params[g + NOISE_FACTOR] * noise_factor(plan, state, channel)
    if params[g + STUDENT_DOF] > 0.0:
        factor *= student_factor(R, T, r, params[g + STUDENT_DOF], factor, c, work[256 + COMPONENTS * WIDE :])
    nis = judge(R, T, L, Y, r, y, factor, c, n, result)
    if nis != nis:
        return INVALID
    verdict = verdict_of(plan, params, state, channel, nis, result)
    if verdict == REANCHORED:
        opened(P, H, L, Y, y, nis, d, c, n, work[256 + COMPONENTS * WIDE :])
        project(P, H, Y, T, c, n)
        nis = judge(R, T, L, Y, r, y, factor, c, n, result)
        if nis != nis:
            return INVALID
    learn(plan, params, state, channel, r, T, R, factor, c)
    if tape.shape[0] > 0:
        note_measurement(plan, channel, verdict, H, Hn, L, Y, y, c, n, tape)
    if verdict == GATED:
        return GATED
    correct(P, Y, y, d, c, n)  # keeps symmetry to the bit
    retract(plan, state[plan[X] : plan[COV]], d, n)
    return verdict


@kernel(UPDATE)
def update(plan, params, state, channel, row, Z, R, Hv, Hn, work, points, tape, result):
    """Linearise at the estimate, then judge and use the measurement."""
    at = CHANNEL + CHANNEL_SIZE * channel
    c, r, H, view = plan[at + COMPONENTS_N], work[0:8], points, points[points.shape[0] - 1, :VIEW_SIZE]
    call_view(
        plan[VIEW_AT], state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS], params[plan[MOTION_PARAMS] : plan[MOTION_END]], view
    )
    fill_jacobian(plan, params, state, channel, row, Hv, Hn, view, H)
    add_rate_noise(R, Hv, view[RATE_VARIANCE_V], c)
    for a in range(c):
        r[a] = row[a] - Z[0, a]
        if (plan[at + ANGLES] >> a) & 1:
            r[a] = wrapped(r[a])
    return conclude(plan, params, state, channel, R, H, Hn, work, tape, result)
