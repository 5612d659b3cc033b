"""What a measurement does to particles: it weighs them, or where it is too sharp for that, and Gaussian, it moves them.

    weigh   w_i <- w_i p(z | x_i)
    move    x_i <- x_i [+] P_xz S^-1 (z + e_i - z_i),   S = T + R,   e_i ~ N(0, R)           the ensemble's own Kalman gain (Evensen, 1994)
with z_i what particle i predicts and T the covariance of that.  Weights decide where they leave `threshold` of the particles effective.
Where they would not, and the particles and their predictions are related as a Gaussian's would be, the move is as right and costs no
particle: no number of them would do for a gyro that knows a rate a hundred times better than they do.  Else weights decide.
"""

from __future__ import annotations

import math

from leadline.core.compiled import COMPONENTS, WIDE, kernel
from leadline.core.gaussian import cholesky, wrapped
from leadline.core.random import fill_normal
from leadline.core.sigma import root
from leadline.estimate.plan import ANGLES, CHANNEL, CHANNEL_SIZE, ESTIMATOR, OWN_E
from leadline.models.layout import COV, ERROR, NOMINAL, NUISANCES_N, X, difference, retract

COUNT_E, THRESHOLD_E, JITTER_E, SEED_E = range(OWN_E, OWN_E + 4)
KEY, COUNTER, SETTLED, WEIGHTS = range(4)  # places behind the covariance
SQUARE = WIDE * WIDE
NOISE_W, ROOT_W, MEMORY_W, STATE_W, SPARE_W, CROSS_W = (k * SQUARE for k in (3, 4, 5, 7, 8, 9))
BENT = 0.1  # of a variance: what a linear law may leave, and what the square of a prediction may explain of that


@kernel()
def cloud_of(plan, params, state):
    """What lies behind the covariance: head, logarithms of weights (N,), particles (N, size)."""
    count, size = int(params[plan[ESTIMATOR] + COUNT_E]), plan[NOMINAL] + plan[NUISANCES_N]
    behind = state[plan[COV] + plan[ERROR] * WIDE :]
    logs = behind[WEIGHTS : WEIGHTS + count]
    rows = behind[WEIGHTS + count : WEIGHTS + count + count * size].reshape(count, size)
    return behind, logs, rows


@kernel()
def residual(plan, channel, row, Z, i, c, out):
    """Residual of a row against what one particle predicts; false where it predicts nothing."""
    at = CHANNEL + CHANNEL_SIZE * channel
    if math.isnan(Z[1 + i, 0]):
        return False
    for a in range(c):
        out[a] = row[a] - Z[1 + i, a]
        if (plan[at + ANGLES] >> a) & 1:
            out[a] = wrapped(out[a])
    return True


@kernel()
def whitened_square(L, r, y, c):
    """|L^-1 r|^2."""
    square = 0.0
    for a in range(c):
        s = r[a]
        for b in range(a):
            s -= L[a * COMPONENTS + b] * y[b]
        y[a] = s / L[a * COMPONENTS + a]
        square += y[a] * y[a]
    return square


@kernel()
def weigh(plan, channel, row, Z, R, logs, dof, c, work):
    """Multiply the weight of each particle by the likelihood of the row."""
    A, L, r, y = work[SPARE_W:], work[SPARE_W + 64 :], work[SPARE_W + 128 :], work[SPARE_W + 136 :]
    for a in range(c):
        for b in range(c):
            A[a * COMPONENTS + b] = R[a, b]
    cholesky(A, L, c)
    for i in range(len(logs)):
        if not residual(plan, channel, row, Z, i, c, r):
            logs[i] = -math.inf
            continue
        square = whitened_square(L, r, y, c)
        logs[i] -= 0.5 * (dof + c) * math.log1p(square / dof) if dof > 0.0 else 0.5 * square


@kernel()
def nearest(plan, channel, row, Z, R, logs, c, work):
    """The smallest square of a residual against one particle, in units of the noise R alone."""
    A, L, r, y = work[SPARE_W:], work[SPARE_W + 64 :], work[SPARE_W + 128 :], work[SPARE_W + 136 :]
    for a in range(c):
        for b in range(c):
            A[a * COMPONENTS + b] = R[a, b]
    if not cholesky(A, L, c):
        return math.nan
    best = math.inf
    for i in range(len(logs)):
        if logs[i] > -math.inf and residual(plan, channel, row, Z, i, c, r):
            best = min(best, whitened_square(L, r, y, c))
    return best


@kernel()
def solved(S, L, r, y, c):
    """Y <- S^-1 r, with S = L L^T."""
    whitened_square(L, r, y, c)
    for a in range(c - 1, -1, -1):
        s = y[a]
        for b in range(a + 1, c):
            s -= L[b * COMPONENTS + a] * y[b]
        y[a] = s / L[a * COMPONENTS + a]


@kernel()
def cross_covariance(plan, params, state, channel, row, Z, c, work):
    """Covariance of the state's errors (rows of COMPONENTS) with what the particles predict."""
    _, logs, rows = cloud_of(plan, params, state)
    n, x = plan[ERROR], state[plan[X] : plan[COV]]
    cross, d, mean, r = work[CROSS_W:], work[MEMORY_W:STATE_W], work[SPARE_W + 300 :], work[SPARE_W + 256 :]
    cross[: n * COMPONENTS] = 0.0
    mean[:c] = 0.0
    for i in range(len(logs)):
        w = math.exp(logs[i])
        if w > 0.0 and residual(plan, channel, row, Z, i, c, r):
            for a in range(c):
                mean[a] += w * r[a]
    for i in range(len(logs)):
        w = math.exp(logs[i])
        if w > 0.0 and residual(plan, channel, row, Z, i, c, r):
            difference(plan, rows[i], x, d)
            for j in range(n):
                for a in range(c):
                    cross[j * COMPONENTS + a] -= w * d[j] * (r[a] - mean[a])


@kernel()
def straight(plan, params, state, channel, row, Z, T, c, work):
    """Tell whether particles and what they predict are related as a Gaussian's would be.

    Of each prediction a linear law of the state explains nearly all, and of no state is what is left beside a linear law of the predictions
    related to their squares: an arc or a ring fails the one or the other.
    """
    _, logs, rows = cloud_of(plan, params, state)
    n, x = plan[ERROR], state[plan[X] : plan[COV]]
    L, cross, d, r, y = work[ROOT_W:], work[CROSS_W:], work[MEMORY_W:STATE_W], work[SPARE_W + 256 :], work[SPARE_W + 264 :]
    root(state[plan[COV] :], L, n)
    for a in range(c):
        explained = 0.0
        for i in range(n):
            d[i] = 0.0
            if L[i * WIDE + i] > 0.0:
                t = cross[i * COMPONENTS + a]
                for j in range(i):
                    t -= L[i * WIDE + j] * d[j]
                d[i] = t / L[i * WIDE + i]
                explained += d[i] * d[i]
        if explained < (1.0 - BENT) * T[a * COMPONENTS + a]:
            return False
    S, Ls = work[SPARE_W + 128 :], work[SPARE_W + 192 :]
    for a in range(c):
        for b in range(c):
            S[a * COMPONENTS + b] = T[a * COMPONENTS + b] * (1.0 + 1e-9 if a == b else 1.0)
    if not cholesky(S, Ls, c):
        return True  # what they predict is the same, or nearly: there is nothing to bend
    mean, sums = work[SPARE_W + 300 :], work[STATE_W:]  # sums: by component of q and q^2, by state of e^2, then of e q
    sums[: 2 * COMPONENTS + n * (1 + COMPONENTS)] = 0.0
    for i in range(len(logs)):
        w = math.exp(logs[i])
        if w > 0.0 and residual(plan, channel, row, Z, i, c, r):
            difference(plan, rows[i], x, d)
            for a in range(c):
                r[a] = mean[a] - r[a]  # the deviation of what is predicted
            solved(S, Ls, r, y, c)
            for a in range(c):
                q = r[a] * r[a] - T[a * COMPONENTS + a]
                sums[a] += w * q
                sums[COMPONENTS + a] += w * q * q
            for j in range(n):
                e = d[j]
                for a in range(c):
                    e -= cross[j * COMPONENTS + a] * y[a]
                at = 2 * COMPONENTS + j * (1 + COMPONENTS)
                sums[at] += w * e * e
                for a in range(c):
                    sums[at + 1 + a] += w * e * (r[a] * r[a] - T[a * COMPONENTS + a])
    for a in range(c):
        spread = sums[COMPONENTS + a] - sums[a] * sums[a]
        for j in range(n):
            at = 2 * COMPONENTS + j * (1 + COMPONENTS)
            if sums[at + 1 + a] * sums[at + 1 + a] > BENT * spread * sums[at]:
                return False
    return True


@kernel()
def effective_with(plan, channel, row, Z, R, logs, c, work):
    """How many particles weights alone would leave effective."""
    A, L, r, y = work[SPARE_W:], work[SPARE_W + 64 :], work[SPARE_W + 256 :], work[SPARE_W + 264 :]
    for a in range(c):
        for b in range(c):
            A[a * COMPONENTS + b] = R[a, b]
    if not cholesky(A, L, c):
        return math.inf
    best, total, squares = -math.inf, 0.0, 0.0
    for i in range(len(logs)):
        if not residual(plan, channel, row, Z, i, c, r):
            continue
        w = logs[i] - 0.5 * whitened_square(L, r, y, c)
        if w > best:
            total *= math.exp(best - w)
            squares *= math.exp(2.0 * (best - w))
            best = w
        if w > -math.inf:
            total += math.exp(w - best)
            squares += math.exp(2.0 * (w - best))
    return total * total / squares if squares > 0.0 else 0.0


@kernel()
def move_all(plan, params, state, channel, row, Z, R, T, c, work):
    """Move every particle by the ensemble's gain; where one predicts nothing it has no weight any more."""
    behind, logs, rows = cloud_of(plan, params, state)
    n, cross, d = plan[ERROR], work[CROSS_W:], work[MEMORY_W:STATE_W]
    A, Lr, S, Ls = work[SPARE_W:], work[SPARE_W + 64 :], work[SPARE_W + 128 :], work[SPARE_W + 192 :]
    r, y, e = work[SPARE_W + 256 :], work[SPARE_W + 264 :], work[SPARE_W + 280 :]
    for a in range(c):
        for b in range(c):
            A[a * COMPONENTS + b] = R[a, b]
            S[a * COMPONENTS + b] = T[a * COMPONENTS + b] + R[a, b]
    if not (cholesky(A, Lr, c) and cholesky(S, Ls, c)):
        return
    for i in range(len(logs)):
        if not residual(plan, channel, row, Z, i, c, r):
            logs[i] = -math.inf
            continue
        fill_normal(behind[KEY], behind[COUNTER], i, e, c)
        for a in range(c):
            for b in range(a + 1):
                r[a] += Lr[a * COMPONENTS + b] * e[b]
        solved(S, Ls, r, y, c)
        for j in range(n):
            d[j] = 0.0
            for a in range(c):
                d[j] += cross[j * COMPONENTS + a] * y[a]
        retract(plan, rows[i], d, n)


@kernel()
def take(plan, params, state, channel, row, Z, R, T, dof, c, work):
    """Take a measurement: by weights, or by a move."""
    _, logs, _ = cloud_of(plan, params, state)
    enough = params[plan[ESTIMATOR] + THRESHOLD_E] * len(logs)
    if not dof > 0.0 and effective_with(plan, channel, row, Z, R, logs, c, work) < enough:
        cross_covariance(plan, params, state, channel, row, Z, c, work)
        if straight(plan, params, state, channel, row, Z, T, c, work):
            move_all(plan, params, state, channel, row, Z, R, T, c, work)
            return
    weigh(plan, channel, row, Z, R, logs, dof, c, work)
