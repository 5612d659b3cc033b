"""Square-root unscented filter: what is carried from step to step is a lower triangular root S of the covariance, P = S S^T.

Sigma points come from S as it stands; a step and a measurement are each one triangularisation of an array whose square is the new
covariance (core/sigma.py: lower), so that P can never lose its definiteness to rounding.  The sums of estimate/unscented.py are squares:
    sum s s^T / g^2 + (beta - alpha^2) mu mu^T = sum t t^T,   t_i = (s_i - a mu) / g,   a = (1 - sqrt(1 + (beta - alpha^2) n / g^2)) g^2 / n
which asks for beta - alpha^2 >= -g^2 / n: settings beyond that are refused.  Source: Van der Merwe and Wan (2001), with the array form of
Kailath, Sayed and Hassibi (2000), section 12.3, in place of downdates.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import COMPONENTS, POINTS, PROPAGATE, SETTLE, UPDATE, WIDE, call_noise, call_step, kernel
from leadline.core.sigma import lower, root, solve_right
from leadline.estimate.adaptive import learn, noise_factor
from leadline.estimate.gate import student_factor
from leadline.estimate.kalman import (
    GATED,
    INVALID,
    REANCHORED,
    add_noise_of_rate,
    decay_of,
    fade,
    judge,
    speed_of,
    verdict_of,
)
from leadline.estimate.plan import (
    ADAPT_Q,
    CHANNEL,
    CHANNEL_SIZE,
    COMPONENTS_N,
    ESTIMATOR,
    FIELDS,
    GATE,
    MOTION_END,
    MOTION_PARAMS,
    NOISE_AT,
    NOISE_FACTOR,
    RESIDUAL,
    STEP_AT,
    STUDENT_DOF,
)
from leadline.estimate.tape import DRIVEN, note_measurement
from leadline.estimate.unscented import (
    AUGMENTED,
    COLUMNS_W,
    MEMORY_W,
    NOISE_W,
    ROOT_W,
    SLOPE_W,
    SPARE_W,
    SQUARE,
    STATE_W,
    excess_of,
    gather,
    moved,
    noise_root,
    place_points,
    push_slope,
    spread_of,
)
from leadline.models.layout import ACTIVE, COV, INPUT, INPUTS, MOTION, NUISANCES_N, X, difference, retract
from leadline.models.view import VIEW_SIZE

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.estimate.beginning import Beginning
    from leadline.estimate.composition import Composition

ARRAY_W = SPARE_W + 10 * WIDE  # an array of WIDE + COMPONENTS rows of LONG numbers
LONG = 5 * WIDE


@kernel()
def shifted_pairs(plan, params, x, u, dt, p, m, first, g, L, count, offset, n, work, array):
    """Send pairs of points through a step: column i of D, and of the array beside it s_i."""
    nm = plan[MOTION]
    D, spare, copy = work[COLUMNS_W:], work[SPARE_W:], work[STATE_W:]
    d, mean, plus, minus = spare[:WIDE], spare[WIDE : 2 * WIDE], spare[2 * WIDE : 3 * WIDE], spare[3 * WIDE : 4 * WIDE]
    for i in range(count):
        moved(plan, x, copy, L, i, g, n, d)
        call_step(plan[STEP_AT], copy, u, dt, p, m)
        difference(plan, copy, first, plus)
        moved(plan, x, copy, L, i, -g, n, d)
        call_step(plan[STEP_AT], copy, u, dt, p, m)
        difference(plan, copy, first, minus)
        for a in range(nm):
            D[a * WIDE + offset + i] = (plus[a] - minus[a]) / (2.0 * g)
            s = 0.5 * (plus[a] + minus[a])
            array[a * LONG + offset + i] = s
            mean[a] += s / (g * g)


@kernel()
def place_noise(plan, params, state, m, dt, p, work, array):
    """Root of the noise of a step, in the first columns of an array."""
    nm, Q, G = plan[MOTION], work[NOISE_W:], work[SLOPE_W:]
    Q[: nm * WIDE] = 0.0
    call_noise(plan[NOISE_AT], m, dt, p, Q)
    root(Q, G, nm)
    scale = math.sqrt(state[plan[X] - 1]) if params[plan[ESTIMATOR] + ADAPT_Q] != 0.0 else 1.0
    for a in range(nm):
        for i in range(a + 1):
            array[a * LONG + i] = scale * G[a * WIDE + i]


@kernel()
def take_root(array, S, n):
    """Take the triangular part of an array as the root."""
    for a in range(n):
        for j in range(a + 1):
            S[a * WIDE + j] = array[a * LONG + j]
        S[a * WIDE + a + 1 : a * WIDE + n] = 0.0


@kernel(PROPAGATE)
def propagate(plan, params, state, dt, work, points, tape):
    """One step of motion, nuisances and root: [D | t | root of Q] over [S_nuisances beta | . | .], brought to triangular form."""
    nm, nc, n = plan[MOTION], plan[NUISANCES_N], int(state[ACTIVE])
    x, S, u = state[plan[X] : plan[COV]], state[plan[COV] :], state[INPUT : INPUT + INPUTS]
    p = params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    D, m, array, spare = work[COLUMNS_W:], work[MEMORY_W:STATE_W], work[ARRAY_W:], work[SPARE_W:]
    mean, before, first = spare[WIDE : 2 * WIDE], spare[4 * WIDE : 6 * WIDE], spare[6 * WIDE : 8 * WIDE]
    size = x.shape[0]
    speed = speed_of(plan, params, state, m[:VIEW_SIZE]) if plan[FIELDS] > 0 else 0.0
    before[:size] = x
    first[:size] = x
    call_step(plan[STEP_AT], first, u, dt, p, m)
    mean[:] = 0.0
    added = noise_root(plan, m, dt, p, work) if params[plan[ESTIMATOR] + AUGMENTED] != 0.0 else 0
    g, square = spread_of(plan, params, n + added)
    scratch, half = work[2 * SQUARE : ROOT_W], array[n + nm + added :]  # `half`: the part of the array for t
    array[: n * LONG] = 0.0
    shifted_pairs(plan, params, before[:size], u, dt, p, scratch, first[:size], g, S, nm, 0, n, work, half)
    if added > 0:
        shifted_pairs(plan, params, before[:size], u, dt, p, scratch, first[:size], g, work[SLOPE_W:], added, nm, nm, work, half)
    # columns of the array: D over the root of what does not move (n), noise (nm + added), t (n + added)
    total = n + added
    share = (1.0 - math.sqrt(max(0.0, 1.0 + excess_of(plan, params) * total / square))) * square / total
    still = n - nm  # columns of points that move nothing: t = - a mu / g
    for a in range(nm):
        for i in range(nm):
            array[a * LONG + i] = D[a * WIDE + i]
        for i in range(added):
            array[a * LONG + n + nm + i] = D[a * WIDE + nm + i]
        for i in range(nm + added):
            half[a * LONG + i] = (half[a * LONG + i] - share * mean[a]) / g
        for i in range(nm + added, nm + added + still):
            half[a * LONG + i] = -share * mean[a] / g
    if added == 0:
        place_noise(plan, params, state, m, dt, p, work, array[n:])
    if tape.shape[0] > 0:
        work[ROOT_W : ROOT_W + n * WIDE] = S[: n * WIDE]
        push_slope(plan, params, dt, speed, n, work, tape)
        for a in range(nm):
            for i in range(nm):
                tape[DRIVEN + a] -= D[a * WIDE + i] * D[a * WIDE + i]
    x[:] = first[:size]
    for i in range(nm, n):
        k = i - nm
        beta, drive = (1.0, 0.0) if k >= nc else decay_of(plan, params, k, speed, dt)
        for j in range(i + 1):
            array[i * LONG + j] = beta * S[i * WIDE + j]
        if drive > 0.0:
            array[i * LONG + 2 * n + nm + 2 * added + k] = math.sqrt(drive)
            if tape.shape[0] > 0:
                tape[DRIVEN + i] += drive
        if k < nc:
            fade(plan, params, x, k, beta)
    lower(array, n, 2 * n + nm + 2 * added + nc, LONG)
    take_root(array, S, n)
    d = spare[:WIDE]
    for a in range(n):
        d[a] = mean[a] if a < nm else 0.0
    retract(plan, x, d, n)
    if tape.shape[0] > 0:
        for a in range(nm):
            for j in range(a + 1):
                tape[DRIVEN + a] += S[a * WIDE + j] * S[a * WIDE + j]


@kernel(POINTS)
def points(plan, params, state, channel, row, work, points, V, N):
    """The estimate, then pairs of sigma points from the root as it stands."""
    n = int(state[ACTIVE])
    L = work[ROOT_W:]
    L[: n * WIDE] = state[plan[COV] : plan[COV] + n * WIDE]
    g, _ = spread_of(plan, params, n)
    return place_points(plan, params, state, channel, row, L, g, work, V, N)


@kernel()
def squared(D, T, c, n):
    """T = D D^T (rows of COMPONENTS)."""
    for a in range(c):
        for b in range(c):
            s = 0.0
            for j in range(n):
                s += D[a * WIDE + j] * D[b * WIDE + j]
            T[a * COMPONENTS + b] = s


@kernel()
def gains(S, D, Y, c, n):
    """Y = D S^T = H P."""
    for a in range(c):
        for i in range(n):
            s = 0.0
            for j in range(i + 1):
                s += D[a * WIDE + j] * S[i * WIDE + j]
            Y[a * WIDE + i] = s


@kernel()
def open_root(S, D, L, Y, y, d, c, n, array):
    """Open the estimate up along the correction that a residual asks for (estimate/gate.py: opened): S S^T <- S S^T + d d^T, and D anew."""
    for j in range(n):
        d[j] = 0.0
        for a in range(c):
            d[j] += Y[a * WIDE + j] * y[a]
    nis = share = 0.0
    for a in range(c):
        nis += y[a] * y[a]
    work = array
    for a in range(c):  # H d = D w with S w = d
        work[a] = 0.0
    w = array[COMPONENTS : COMPONENTS + n]
    for i in range(n):
        s = d[i]
        for j in range(i):
            s -= S[i * WIDE + j] * w[j]
        w[i] = s / S[i * WIDE + i] if S[i * WIDE + i] > 0.0 else 0.0
    for a in range(c):
        for j in range(n):
            work[a] += D[a * WIDE + j] * w[j]
    for a in range(c):
        for k in range(a):
            work[a] -= L[a * COMPONENTS + k] * work[k]
        work[a] /= L[a * COMPONENTS + a]
        share += y[a] * work[a]
    scale = nis / share if share > 1e-12 * nis else 1.0
    H = array[WIDE * 2 : WIDE * 2 + c * WIDE]
    solve_right(D, S, H, c, n)
    block = array[WIDE * (2 + c) :]
    block[: n * LONG] = 0.0
    for i in range(n):
        for j in range(i + 1):
            block[i * LONG + j] = S[i * WIDE + j]
        block[i * LONG + n] = scale * d[i]
    lower(block, n, n + 1, LONG)
    take_root(block, S, n)
    for a in range(c):
        for j in range(n):
            s = 0.0
            for i in range(j, n):
                s += H[a * WIDE + i] * S[i * WIDE + j]
            D[a * WIDE + j] = s


@kernel()
def correct_root(S, D, R, factor, c, n, work, array):
    """[root of R, D; 0, S] brought to triangular form: its lower right block is the new root."""
    rooted, noise = work[NOISE_W:], work[SLOPE_W:]
    for a in range(c):
        for b in range(c):
            noise[a * WIDE + b] = factor * R[a, b]
    root(noise, rooted, c)
    array[: (c + n) * LONG] = 0.0
    for a in range(c):
        for b in range(a + 1):
            array[a * LONG + b] = rooted[a * WIDE + b]
        for j in range(n):
            array[a * LONG + c + j] = D[a * WIDE + j]
    for i in range(n):
        for j in range(i + 1):
            array[(c + i) * LONG + c + j] = S[i * WIDE + j]
    lower(array, c + n, c + n, LONG)
    for i in range(n):
        for j in range(i + 1):
            S[i * WIDE + j] = array[(c + i) * LONG + c + j]


@kernel(UPDATE)
def update(plan, params, state, channel, row, Z, R, Hv, Hn, work, points, tape, result):
    """Judge and use the measurement; the root takes the place of the covariance."""
    n, at = int(state[ACTIVE]), CHANNEL + CHANNEL_SIZE * channel
    S, c, g = state[plan[COV] :], plan[at + COMPONENTS_N], plan[at + GATE]
    r, y, d, T = work[0:8], work[8:16], work[16 : 16 + WIDE], work[64:128]
    L, Y, D, H = work[128:256], work[256 : 256 + COMPONENTS * WIDE], work[COLUMNS_W:], work[SLOPE_W:]
    add_noise_of_rate(plan, params, state, R, Hv, points[points.shape[0] - 1, :VIEW_SIZE], c)
    if not gather(plan, params, state, channel, row, Z, R, D, work):
        return INVALID
    for a in range(c):
        result[RESIDUAL + a] = r[a]
    squared(D, T, c, n)
    gains(S, D, Y, c, n)
    factor = params[g + NOISE_FACTOR] * noise_factor(plan, state, channel)
    if params[g + STUDENT_DOF] > 0.0:
        factor *= student_factor(R, T, r, params[g + STUDENT_DOF], factor, c, work[256 + COMPONENTS * WIDE :])
    nis = judge(R, T, L, Y, r, y, factor, c, n, result)
    if nis != nis:
        return INVALID
    verdict = verdict_of(plan, params, state, channel, nis, result)
    if verdict == REANCHORED:
        open_root(S, D, L, Y, y, d, c, n, work[ARRAY_W:])
        squared(D, T, c, n)
        gains(S, D, Y, c, n)
        if math.isnan(judge(R, T, L, Y, r, y, factor, c, n, result)):
            return INVALID
    learn(plan, params, state, channel, r, T, R, factor, c)
    if tape.shape[0] > 0:
        solve_right(D, S, H, c, n)
        for a in range(c):
            for j in range(n):
                points[a, j] = H[a * WIDE + j]
        note_measurement(plan, channel, verdict, points, Hn, L, Y, y, c, n, tape)
    if verdict == GATED:
        return GATED
    for j in range(n):
        d[j] = 0.0
        for a in range(c):
            d[j] += Y[a * WIDE + j] * y[a]
    correct_root(S, D, R, factor, c, n, work, work[ARRAY_W:])
    retract(plan, state[plan[X] : plan[COV]], d, n)
    return verdict


@kernel(SETTLE)
def settle(plan, params, state, work):
    """P = S S^T in the place of S, on a copy that is to be told."""
    n = int(state[ACTIVE])
    S = state[plan[COV] :]
    for i in range(n - 1, -1, -1):
        for j in range(i, -1, -1):
            s = 0.0
            for k in range(j + 1):
                s += S[i * WIDE + k] * S[j * WIDE + k]
            work[j] = s
        for j in range(i + 1):
            S[i * WIDE + j] = work[j]
    for i in range(n):
        for j in range(i):
            S[j * WIDE + i] = S[i * WIDE + j]


def prepare(composition: Composition, state: Array, beginning: Beginning) -> None:
    """Put the root of the covariance in its place, at the start."""
    n = composition.layout.error
    covariance = state[composition.layout.covariance]
    found = np.zeros_like(covariance)
    root(covariance, found, n)
    covariance[:] = found
