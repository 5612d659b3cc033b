"""Unscented Kalman filter on the manifold: sigma points in the tangent space, means and residuals by retraction and difference.

Points lie at x [+] (+- g L_i), P = L L^T over all active errors; core/sigma.py says what is made of the values there, and why a sensor's
slope H = D L^-1 and what the covariance holds beside it go the same way as a Jacobian and its noise (estimate/kalman.py: conclude).  Only
columns of L that move the motion pass through the process model; only those that move what a sensor sees are shown to it.
    propagate   delta_i = f(x_i) [-] f(x)          x <- f(x) [+] mu       P_mm = sum D D^T + ... + Q       P_mc = sum D_i L_ci^T beta
    update      residual z - (h(x) + mu)           S = D D^T + (R + what is beside)
Process noise is added after the step, or (`augmented`) has points of its own, x [+] +- g q_j with Q = sum q_j q_j^T, which pass through the
step like the others.
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
    call_step,
    kernel,
)
from leadline.core.gaussian import wrapped
from leadline.core.sigma import root, solve_right
from leadline.estimate.kalman import (
    INVALID,
    add_noise,
    add_noise_of_rate,
    conclude,
    drift_nuisances,
    find_clone,
    look_from,
    speed_of,
    symmetrise_at_times,
)
from leadline.estimate.plan import (
    ANGLES,
    CHANNEL,
    CHANNEL_SIZE,
    COMPONENTS_N,
    DISPLACED,
    DRIFT_S,
    EPOCHS,
    ESTIMATOR,
    FIELDS,
    LEVER_S,
    MOTION_END,
    MOTION_PARAMS,
    NOISE_AT,
    OFFSET_S,
    OWN_E,
    STEP_AT,
    TIME_S,
    VALUES_N,
)
from leadline.estimate.tape import DRIVEN, decay_transition
from leadline.models.layout import (
    ACTIVE,
    CLONE_ERROR,
    COV,
    INPUT,
    INPUTS,
    MOTION,
    NUISANCES_N,
    X,
    difference,
    retract,
)
from leadline.models.view import VIEW_SIZE

ALPHA, BETA, KAPPA, AUGMENTED, OWN_SIZE = range(OWN_E, OWN_E + 5)
# Places in `work`, in matrices of WIDE x WIDE: root, columns D, memory of the step, a state that is moved, sums, noise and its root, slope.
SQUARE = WIDE * WIDE + 88  # no multiple of a page apart: a store would hold up loads of another matrix at the same place of a page
ROOT_W, COLUMNS_W, MEMORY_W, STATE_W, SUMS_W, NOISE_W, SLOPE_W, SPARE_W = (k * SQUARE for k in (3, 4, 5, 7, 8, 9, 10, 11))


@kernel()
def spread_of(plan, params, n):
    """g and g^2 of n dimensions; without kappa it is 3 - n, which makes g the root of three times alpha."""
    own = plan[ESTIMATOR]
    kappa = params[own + KAPPA]
    square = params[own + ALPHA] * params[own + ALPHA] * (3.0 if math.isnan(kappa) else n + kappa)
    return math.sqrt(square), square


@kernel()
def excess_of(plan, params):
    """Weight beta - alpha^2 of the shifted mean in a covariance."""
    own = plan[ESTIMATOR]
    return params[own + BETA] - params[own + ALPHA] * params[own + ALPHA]


@kernel()
def moved(plan, x, copy, L, i, g, n, d):
    """Copy <- x [+] g L_i."""
    copy[: x.shape[0]] = x
    for k in range(n):
        d[k] = g * L[k * WIDE + i]
    retract(plan, copy, d, n)


@kernel()
def pair(columns, mean, sums, plus, minus, g, i, nm):
    """Take the differences of a pair of points: column i of D, mu <- mu + s / g^2, sums <- sums + s s^T / g^2."""
    square = g * g
    for a in range(nm):
        columns[a * WIDE + i] = (plus[a] - minus[a]) / (2.0 * g)
        plus[a] = 0.5 * (plus[a] + minus[a])
        mean[a] += plus[a] / square
    for a in range(nm):
        s = plus[a] / square
        for b in range(a + 1):
            sums[a * WIDE + b] += s * plus[b]


@kernel()
def pass_points(plan, params, x, u, dt, p, m, first, g, L, count, offset, n, work):
    """Send pairs of points, along the columns of L that move the motion, through a step; x has moved to `first` already.

    Their columns of D begin at `offset`.
    """
    nm = plan[MOTION]
    columns, sums, spare = work[COLUMNS_W:], work[SUMS_W:], work[SPARE_W:]
    copy, d = work[STATE_W:], spare[:WIDE]
    mean, plus, minus = spare[WIDE : 2 * WIDE], spare[2 * WIDE : 3 * WIDE], spare[3 * WIDE : 4 * WIDE]
    for i in range(count):
        moved(plan, x, copy, L, i, g, n, d)
        call_step(plan[STEP_AT], copy, u, dt, p, m)
        difference(plan, copy, first, plus)
        moved(plan, x, copy, L, i, -g, n, d)
        call_step(plan[STEP_AT], copy, u, dt, p, m)
        difference(plan, copy, first, minus)
        pair(columns, mean, sums, plus, minus, g, offset + i, nm)


@kernel()
def noise_root(plan, m, dt, p, work):
    """Root of the noise of a step, its columns that are not zero first; returns how many there are."""
    nm, Q, G = plan[MOTION], work[NOISE_W:], work[SLOPE_W:]
    Q[: nm * WIDE] = 0.0
    call_noise(plan[NOISE_AT], m, dt, p, Q)
    root(Q, G, nm)
    count = 0
    for j in range(nm):
        if G[j * WIDE + j] > 0.0:
            for i in range(nm):
                G[i * WIDE + count] = G[i * WIDE + j]
            count += 1
    return count


@kernel()
def transfer(plan, params, state, dt, n, work):
    """Move the nominal motion by a step with its points: D in columns, mu and the sums beside it; returns g^2 and how many columns D has.

    What was left in the memory of the step at the mean stays there.
    """
    nm = plan[MOTION]
    x, u = state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS]
    p = params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    L, m, sums, spare = work[ROOT_W:], work[MEMORY_W:STATE_W], work[SUMS_W:], work[SPARE_W:]
    before, first = spare[4 * WIDE : 6 * WIDE], spare[6 * WIDE : 8 * WIDE]
    size = x.shape[0]
    before[:size] = x
    first[:size] = x
    call_step(plan[STEP_AT], first, u, dt, p, m)
    spare[WIDE : 2 * WIDE] = 0.0
    sums[: nm * WIDE] = 0.0
    added = 0
    if params[plan[ESTIMATOR] + AUGMENTED] != 0.0:
        added = noise_root(plan, m, dt, p, work)
    g, square = spread_of(plan, params, n + added)
    scratch = work[2 * SQUARE : ROOT_W]  # of steps at the points: the memory of the one at the mean is kept
    pass_points(plan, params, before[:size], u, dt, p, scratch, first[:size], g, L, nm, 0, n, work)
    if added > 0:
        pass_points(plan, params, before[:size], u, dt, p, scratch, first[:size], g, work[SLOPE_W:], added, nm, nm, work)
    x[:] = first[:size]
    d = spare[:WIDE]
    for a in range(n):
        d[a] = spare[WIDE + a] if a < nm else 0.0
    retract(plan, x, d, n)
    return square, nm + added


@kernel()
def push_slope(plan, params, dt, speed, n, work, tape):
    """Phi <- Phi_step Phi, with the slope D L^-1 of the step."""
    nm = plan[MOTION]
    H = work[SLOPE_W:]
    solve_right(work[COLUMNS_W:], work[ROOT_W:], H, nm, nm)
    decay_transition(plan, params, H, dt, speed, n, tape)


@kernel(PROPAGATE)
def propagate(plan, params, state, dt, work, points, tape):
    """One step of motion, nuisances and covariance."""
    nm, n = plan[MOTION], int(state[ACTIVE])
    x, P = state[plan[X] : plan[COV]], state[plan[COV] :]
    p = params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    A, L, D, sums, m = work[:SQUARE], work[ROOT_W:], work[COLUMNS_W:], work[SUMS_W:], work[MEMORY_W:STATE_W]
    mean = work[SPARE_W + WIDE : SPARE_W + 2 * WIDE]
    speed = speed_of(plan, params, state, m[:VIEW_SIZE]) if plan[FIELDS] > 0 else 0.0
    root(P, L, n)
    _, columns = transfer(plan, params, state, dt, n, work)
    excess = excess_of(plan, params)
    for a in range(nm):
        for c in range(nm, n):  # covariance with what does not move
            s = 0.0
            for i in range(nm):
                s += D[a * WIDE + i] * L[c * WIDE + i]
            A[a * WIDE + c] = s
    drift_nuisances(plan, params, x, P, A, speed, dt, n, tape)
    if tape.shape[0] > 0:
        push_slope(plan, params, dt, speed, n, work, tape)
        for a in range(nm):
            for i in range(nm):
                tape[DRIVEN + a] -= D[a * WIDE + i] * D[a * WIDE + i]
    for a in range(nm):
        for b in range(a + 1):
            s = sums[a * WIDE + b] + excess * mean[a] * mean[b]
            for i in range(columns):
                s += D[a * WIDE + i] * D[b * WIDE + i]
            P[a * WIDE + b] = P[b * WIDE + a] = s
    if params[plan[ESTIMATOR] + AUGMENTED] == 0.0:
        add_noise(plan, params, state, m, dt, p, P, work[NOISE_W:])
    if tape.shape[0] > 0:
        for a in range(nm):
            tape[DRIVEN + a] += P[a * (WIDE + 1)]
    symmetrise_at_times(state, P, dt, n)


@kernel()
def last_seen(plan, state, channel, row):
    """One more than the last error that a channel can see."""
    at = CHANNEL + CHANNEL_SIZE * channel
    last = plan[MOTION]
    for k in range(plan[at + VALUES_N]):
        last = max(last, plan[at + SLOT_NUISANCE + k] + 1)
    if plan[at + DISPLACED] != 0:
        last = max(last, plan[at + TIME_S] + 1, plan[at + OFFSET_S] + 1)
        last = max(last, plan[at + DRIFT_S] + 1, plan[at + LEVER_S] + 3 if plan[at + LEVER_S] >= 0 else 0)
    if plan[at + EPOCHS] == 2:
        last = max(last, plan[MOTION] + plan[NUISANCES_N] + CLONE_ERROR * (find_clone(plan, state, row[len(row) - 1]) + 1))
    return last


@kernel()
def place_points(plan, params, state, channel, row, L, g, work, V, N):
    """The views at the estimate and at pairs of points along the columns of L that the channel can see; returns how many."""
    if not look_from(plan, params, state, channel, row, V[0], N[0]):
        return 0
    n, seen = int(state[ACTIVE]), last_seen(plan, state, channel, row)
    copy, d = work[STATE_W:], work[SPARE_W:]
    head = plan[COV]
    copy[:head] = state[:head]
    x = state[plan[X] : plan[COV]]
    for i in range(seen):
        for sign in range(2):
            moved(plan, x, copy[plan[X] : plan[COV]], L, i, g if sign == 0 else -g, n, d)
            look_from(plan, params, copy, channel, row, V[1 + 2 * i + sign], N[1 + 2 * i + sign])
    return 1 + 2 * seen


@kernel(POINTS)
def points(plan, params, state, channel, row, work, points, V, N):
    """The estimate, then pairs of sigma points."""
    n, L = int(state[ACTIVE]), work[ROOT_W:]
    root(state[plan[COV] :], L, n)
    g, _ = spread_of(plan, params, n)
    return place_points(plan, params, state, channel, row, L, g, work, V, N)


@kernel()
def gather(plan, params, state, channel, row, Z, R, D, work):
    """The residual, the columns of D, and R with what the values at the points hold beside; false where a point is none."""
    n, at = int(state[ACTIVE]), CHANNEL + CHANNEL_SIZE * channel
    c, r, seen = plan[at + COMPONENTS_N], work[0:8], last_seen(plan, state, channel, row)
    g, square = spread_of(plan, params, n)
    mean = work[SPARE_W : SPARE_W + COMPONENTS]
    mean[:c] = 0.0
    s = work[SPARE_W + COMPONENTS : SPARE_W + 2 * COMPONENTS]
    for i in range(seen):
        if math.isnan(Z[1 + 2 * i, 0]) or math.isnan(Z[2 + 2 * i, 0]):
            return False
        for a in range(c):
            plus, minus = Z[1 + 2 * i, a] - Z[0, a], Z[2 + 2 * i, a] - Z[0, a]
            if (plan[at + ANGLES] >> a) & 1:
                plus, minus = wrapped(plus), wrapped(minus)
            D[a * WIDE + i] = (plus - minus) / (2.0 * g)
            s[a] = 0.5 * (plus + minus)
            mean[a] += s[a] / square
        for a in range(c):
            for b in range(c):
                R[a, b] += s[a] * s[b] / square
    excess = excess_of(plan, params)
    for a in range(c):
        D[a * WIDE + seen : a * WIDE + n] = 0.0
        for b in range(c):
            R[a, b] += excess * mean[a] * mean[b]
        r[a] = row[a] - Z[0, a] - mean[a]
        if (plan[at + ANGLES] >> a) & 1:
            r[a] = wrapped(r[a])
    return True


@kernel(UPDATE)
def update(plan, params, state, channel, row, Z, R, Hv, Hn, work, points, tape, result):
    """Linearise by the values at the points, then judge and use the measurement."""
    n, c = int(state[ACTIVE]), plan[CHANNEL + CHANNEL_SIZE * channel + COMPONENTS_N]
    D, H = work[COLUMNS_W:], work[SLOPE_W:]
    add_noise_of_rate(plan, params, state, R, Hv, points[points.shape[0] - 1, :VIEW_SIZE], c)
    if not gather(plan, params, state, channel, row, Z, R, D, work):
        return INVALID
    solve_right(D, work[ROOT_W:], H, c, n)
    for a in range(c):
        for j in range(n):
            points[a, j] = H[a * WIDE + j]
    return conclude(plan, params, state, channel, R, points, Hn, work, tape, result)
