"""Plain particle filter: the posterior as weighted points, for small states and laws that no Gaussian fits.

    propagate   x_i <- f(x_i) [+] q_i, q_i ~ N(0, Q)         nuisances likewise by their own law
    update      w_i <- w_i p(z | x_i)                        p Gaussian, or Student's t where the sensor asks for it
A measurement that would leave too few effective moves them instead where that is right (estimate/sharp.py).
Where fewer than `threshold` of the particles are effective they are drawn anew (core/particles.py).  What nothing drives, a bias, would be
left with a few values: so nuisances b are moved by b_i <- m + sqrt(1 - h^2) (b_i - m) + h L e,  e ~ N(0, I), with which their mean m and
covariance L L^T stay (Liu and West, 2001).  The motion has noise of its own.

Behind the covariance lie a key, a counter, logarithms of the weights and the particles: all random numbers are functions of key and
counter (core/random.py), so that a checkpoint is a copy and a replay has the same bits.  x and P hold mean and covariance wherever they are
looked at (`settle`); the gate judges with them, and turns away what no single particle explains either.
Gordon, Salmond and Smith (1993); Doucet and Johansen (2011), section 3.5.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import COMPONENTS, POINTS, PROPAGATE, SETTLE, UPDATE, WIDE, call_noise, call_step, kernel
from leadline.core.gaussian import wrapped
from leadline.core.particles import normalise, resample
from leadline.core.random import fill_normal, uniform
from leadline.core.sigma import root
from leadline.estimate.adaptive import learn, noise_factor
from leadline.estimate.kalman import (
    GATED,
    INVALID,
    REANCHORED,
    USED,
    add_noise_of_rate,
    decay_of,
    fade,
    judge,
    look_from,
    speed_of,
    verdict_of,
)
from leadline.estimate.plan import (
    ADAPT_Q,
    ANGLES,
    CHANNEL,
    CHANNEL_SIZE,
    COMPONENTS_N,
    ESTIMATOR,
    FIELDS,
    GATE,
    LIMIT,
    MOTION_END,
    MOTION_PARAMS,
    NOISE_AT,
    NOISE_FACTOR,
    RESIDUAL,
    STEP_AT,
    STUDENT_DOF,
    WIDENED,
)
from leadline.estimate.sharp import (
    COUNTER,
    JITTER_E,
    KEY,
    MEMORY_W,
    NOISE_W,
    ROOT_W,
    SEED_E,
    SETTLED,
    SPARE_W,
    SQUARE,
    STATE_W,
    THRESHOLD_E,
    WEIGHTS,
    cloud_of,
    nearest,
    take,
)
from leadline.models.layout import COV, ERROR, INPUT, INPUTS, MOTION, NUISANCES_N, X, difference, retract
from leadline.models.view import VIEW_SIZE

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.estimate.beginning import Beginning
    from leadline.estimate.composition import Composition
    from leadline.models.layout import Layout


@kernel()
def gather_moments(plan, params, state, work):
    """X and P <- mean and covariance of the particles, on the manifold: twice around a point of reference."""
    behind, logs, rows = cloud_of(plan, params, state)
    if behind[SETTLED] != 0.0:
        return
    n, size = plan[ERROR], rows.shape[1]
    x, P = state[plan[X] : plan[COV]], state[plan[COV] :]
    mean, d = work[SPARE_W : SPARE_W + WIDE], work[SPARE_W + WIDE : SPARE_W + 2 * WIDE]
    best = 0
    for i in range(len(logs)):
        if logs[i] > logs[best]:
            best = i
    x[:size] = rows[best]
    for _ in range(2):
        mean[:n] = 0.0
        for i in range(len(logs)):
            w = math.exp(logs[i])
            if w > 0.0:
                difference(plan, rows[i], x, d)
                for a in range(n):
                    mean[a] += w * d[a]
        retract(plan, x, mean, n)
    P[: n * WIDE] = 0.0
    for i in range(len(logs)):
        w = math.exp(logs[i])
        if w > 0.0:
            difference(plan, rows[i], x, d)
            for a in range(n):
                for b in range(a + 1):
                    P[a * WIDE + b] += w * d[a] * d[b]
    for a in range(n):
        for b in range(a):
            P[b * WIDE + a] = P[a * WIDE + b]
    behind[SETTLED] = 1.0


@kernel(SETTLE)
def settle(plan, params, state, work):
    """Mean and covariance in their places."""
    gather_moments(plan, params, state, work)


@kernel(PROPAGATE)
def propagate(plan, params, state, dt, work, points, tape):
    """One step of every particle, each with noise of its own."""
    nm, nc, n = plan[MOTION], plan[NUISANCES_N], plan[ERROR]
    u, p = state[INPUT : INPUT + INPUTS], params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    behind, logs, rows = cloud_of(plan, params, state)
    Q, G, m, spare = work[NOISE_W:], work[ROOT_W:], work[MEMORY_W:STATE_W], work[SPARE_W:]
    d, e = spare[:WIDE], spare[WIDE : 3 * WIDE]
    scale = math.sqrt(state[plan[X] - 1]) if params[plan[ESTIMATOR] + ADAPT_Q] != 0.0 else 1.0
    speed = 0.0
    if plan[FIELDS] > 0:
        gather_moments(plan, params, state, work)
        speed = speed_of(plan, params, state, m[:VIEW_SIZE])
    d[:n] = 0.0
    for i in range(len(logs)):
        call_step(plan[STEP_AT], rows[i], u, dt, p, m)
        if i == 0:  # the noise is that of one particle for all
            Q[: nm * WIDE] = 0.0
            call_noise(plan[NOISE_AT], m, dt, p, Q)
            root(Q, G, nm)
        fill_normal(behind[KEY], behind[COUNTER], i, e, n)
        for a in range(nm):
            s = 0.0
            for b in range(a + 1):
                s += G[a * WIDE + b] * e[b]
            d[a] = scale * s
        for k in range(nc):
            beta, drive = decay_of(plan, params, k, speed, dt)
            fade(plan, params, rows[i], k, beta)
            d[nm + k] = math.sqrt(drive) * e[nm + k]
        retract(plan, rows[i], d, n)
    behind[COUNTER] += 1.0
    behind[SETTLED] = 0.0


@kernel(POINTS)
def points(plan, params, state, channel, row, work, points, V, N):
    """The mean, then every particle."""
    gather_moments(plan, params, state, work)
    if not look_from(plan, params, state, channel, row, V[0], N[0]):
        return 0
    _, logs, rows = cloud_of(plan, params, state)
    copy, head = work[STATE_W:], plan[COV]
    copy[:head] = state[:head]
    for i in range(len(logs)):
        copy[plan[X] : plan[X] + rows.shape[1]] = rows[i]
        look_from(plan, params, copy, channel, row, V[1 + i], N[1 + i])
    return 1 + len(logs)


@kernel()
def predicted_spread(plan, channel, row, Z, logs, c, mean, T, r):
    """Mean residual and covariance T (rows of COMPONENTS) of what the particles predict; angles about what the mean predicts."""
    at = CHANNEL + CHANNEL_SIZE * channel
    mean[:c] = 0.0
    T[: COMPONENTS * COMPONENTS] = 0.0
    total = 0.0
    for i in range(len(logs)):
        w = math.exp(logs[i])
        if w > 0.0 and not math.isnan(Z[1 + i, 0]):
            total += w
            for a in range(c):
                r[a] = Z[1 + i, a] - Z[0, a]
                if (plan[at + ANGLES] >> a) & 1:
                    r[a] = wrapped(r[a])
                mean[a] += w * r[a]
            for a in range(c):
                for b in range(c):
                    T[a * COMPONENTS + b] += w * r[a] * r[b]
    if total == 0.0:
        return False
    for a in range(c):
        mean[a] /= total
    for a in range(c):
        for b in range(c):
            T[a * COMPONENTS + b] = T[a * COMPONENTS + b] / total - mean[a] * mean[b]
    for a in range(c):
        r[a] = row[a] - Z[0, a] - mean[a]
        if (plan[at + ANGLES] >> a) & 1:
            r[a] = wrapped(r[a])
    return True


@kernel()
def renew(plan, params, state, work):
    """Draw the particles anew, and move each a little towards the mean and about it."""
    gather_moments(plan, params, state, work)
    behind, logs, rows = cloud_of(plan, params, state)
    n, h = plan[ERROR], params[plan[ESTIMATOR] + JITTER_E]
    resample(logs, rows, uniform(behind[KEY], behind[COUNTER], 0))
    behind[COUNTER] += 1.0
    first = plan[MOTION]
    if h > 0.0 and n > first:
        L, P, spare = work[ROOT_W:], work[NOISE_W:], work[SPARE_W:]
        d, e, x = spare[:WIDE], spare[WIDE : 3 * WIDE], state[plan[X] : plan[COV]]
        for a in range(n - first):
            for b in range(n - first):
                P[a * WIDE + b] = state[plan[COV] + (first + a) * WIDE + first + b]
        root(P, L, n - first)
        near = math.sqrt(1.0 - h * h)
        for i in range(len(logs)):
            difference(plan, rows[i], x, d)
            fill_normal(behind[KEY], behind[COUNTER], i, e, n - first)
            for a in range(first):
                d[a] = 0.0
            for a in range(n - first):
                s = 0.0
                for b in range(a + 1):
                    s += L[a * WIDE + b] * e[b]
                d[first + a] = (near - 1.0) * d[first + a] + h * s
            retract(plan, rows[i], d, n)
        behind[COUNTER] += 1.0
    behind[SETTLED] = 0.0


@kernel(UPDATE)
def update(plan, params, state, channel, row, Z, R, Hv, Hn, work, points, tape, result):
    """Judge by mean and covariance of what the particles predict, then weigh each."""
    at = CHANNEL + CHANNEL_SIZE * channel
    c, g = plan[at + COMPONENTS_N], plan[at + GATE]
    r, y, mean, T = work[0:8], work[8:16], work[16:24], work[64:128]
    L, Y = work[128:256], work[256 : 256 + COMPONENTS * WIDE]
    behind, logs, _ = cloud_of(plan, params, state)
    add_noise_of_rate(plan, params, state, R, Hv, points[points.shape[0] - 1, :VIEW_SIZE], c)
    if not predicted_spread(plan, channel, row, Z, logs, c, mean, T, r):
        return INVALID
    for a in range(c):
        result[RESIDUAL + a] = r[a]
    factor = params[g + NOISE_FACTOR] * noise_factor(plan, state, channel)
    nis = judge(R, T, L, Y, r, y, factor, c, 0, result)
    if nis != nis:
        return INVALID
    verdict = verdict_of(plan, params, state, channel, nis, result)
    learn(plan, params, state, channel, r, T, R, factor, c)
    dof = params[g + STUDENT_DOF]
    for a in range(c):
        for b in range(c):
            R[a, b] *= factor
    if verdict in (GATED, REANCHORED) and not dof > 0.0:  # particles cannot be opened up along a residual
        if not nearest(plan, channel, row, Z, R, logs, c, work) < params[g + LIMIT]:
            return GATED
        verdict, result[WIDENED] = USED, 1.0
    take(plan, params, state, channel, row, Z, R, T, dof, c, work)
    effective = normalise(logs)
    behind[COUNTER] += 1.0
    behind[SETTLED] = 0.0
    if effective < params[plan[ESTIMATOR] + THRESHOLD_E] * len(logs):
        renew(plan, params, state, work)
    return verdict


@kernel()
def scatter(plan, params, state, work):
    """Draw the particles about the start."""
    behind, logs, rows = cloud_of(plan, params, state)
    n, size = plan[ERROR], rows.shape[1]
    L, spare = work[ROOT_W:], work[SPARE_W:]
    d, e = spare[:WIDE], spare[WIDE : 3 * WIDE]
    root(state[plan[COV] :], L, n)
    for i in range(len(logs)):
        fill_normal(behind[KEY], behind[COUNTER], i, e, n)
        for a in range(n):
            d[a] = 0.0
            for b in range(a + 1):
                d[a] += L[a * WIDE + b] * e[b]
        rows[i] = state[plan[X] : plan[X] + size]
        retract(plan, rows[i], d, n)
    logs[:] = -math.log(len(logs))
    behind[COUNTER] += 1.0


def prepare(composition: Composition, state: Array, beginning: Beginning) -> None:
    """Draw the particles at the start, from a stream of the seed: nuisances by their priors, the motion by the poses that may be."""
    layout, plan, params = composition.layout, composition.plan, composition.params
    behind, seed = state[layout.covariance.stop :], params[plan[ESTIMATOR] + SEED_E]
    behind[KEY], behind[COUNTER], behind[SETTLED] = seed, 0.0, 0.0
    scatter(plan, params, state, np.zeros((SPARE_W // SQUARE + 2) * SQUARE))
    generator = np.random.default_rng(int(seed))
    _, _, rows = cloud_of(plan, params, state)
    for row in rows:
        row[: layout.motion_nominal] = beginning.drawn(generator)


def room(count: int, layout: Layout) -> int:
    """Return how many numbers the particles take."""
    return WEIGHTS + count * (1 + layout.motion_nominal + len(layout.nuisances))
