"""THE loop: propagate, look, correct, record.  It knows no sensor, no process model and no estimator.

Events lie in arrays: `time`, `kind` (a channel, or one of the negative kinds of plan.py), `start` (the row of event e is
data[start[e] : start[e + 1]]) and `index` (which result or output the event fills).
"""

from __future__ import annotations

import math

from leadline.core.compiled import F2, WIDE, F, I, call_points, call_propagate, call_pull, call_sensor, call_update, call_view, i8, kernel
from leadline.estimate.plan import (
    CHANNEL,
    CHANNEL_SIZE,
    IS_CLONE,
    IS_DROP,
    IS_INPUT,
    IS_OUTPUT,
    LONGEST_STEP,
    MOTION_END,
    MOTION_PARAMS,
    OUT_COV,
    OUT_VIEW,
    OUT_X,
    PARAMS,
    PARAMS_END,
    POINTS_AT,
    PROPAGATE_AT,
    PULL_AT,
    SENSOR_AT,
    UPDATE_AT,
    VIEW_AT,
)
from leadline.models.layout import (
    ACTIVE,
    CLONE_ERROR,
    CLONE_NOMINAL,
    CLONE_TIME,
    CLONES,
    COV,
    ERROR,
    INPUT,
    INPUTS,
    LAST_USED,
    MOTION,
    NOMINAL,
    NUISANCES_N,
    TIME,
    X,
)
from leadline.models.view import TANGENT, VIEW_SIZE

USED, NO_CLONE = 0, 10  # of data/outcome.py
POSE = 9  # the first directions of a view's tangent space: position, velocity, attitude


@kernel()
def advance(plan, params, state, time, work, points):
    """Propagate to `time`, in steps no longer than the process model allows."""
    longest = params[plan[LONGEST_STEP]]
    while state[TIME] < time:
        dt = time - state[TIME]
        if dt > longest:
            call_propagate(plan[PROPAGATE_AT], plan, params, state, longest, work, points)
            state[TIME] += longest
        else:
            call_propagate(plan[PROPAGATE_AT], plan, params, state, dt, work, points)
            state[TIME] = time


@kernel()
def pose_jacobian(plan, params, state, view, points):
    """Jacobian of position, velocity and attitude against the motion, in the first rows of `points`."""
    x, u = state[plan[X] : plan[COV]], state[INPUT : INPUT + INPUTS]
    p = params[plan[MOTION_PARAMS] : plan[MOTION_END]]
    call_view(plan[VIEW_AT], x, u, p, view)
    unit = points[POSE : 2 * POSE]
    unit[:, :TANGENT] = 0.0
    for i in range(POSE):
        unit[i, i] = 1.0
    call_pull(plan[PULL_AT], x, u, p, view, unit, points, POSE)
    return points


@kernel()
def clone(plan, params, state, view, points):
    """Put the pose of now into a free clone (else the oldest): x and P grow by it."""
    slot = 0
    for c in range(plan[CLONES]):
        if math.isnan(state[CLONE_TIME + c]):
            slot = c
            break
        if state[CLONE_TIME + c] < state[CLONE_TIME + slot]:
            slot = c
    nm, first = plan[MOTION], plan[MOTION] + plan[NUISANCES_N] + CLONE_ERROR * slot
    state[ACTIVE] = max(state[ACTIVE], first + CLONE_ERROR)
    state[CLONE_TIME + slot] = state[TIME]
    n, P = int(state[ACTIVE]), state[plan[COV] :]
    H = pose_jacobian(plan, params, state, view, points)
    at = plan[X] + plan[NOMINAL] + plan[NUISANCES_N] + CLONE_NOMINAL * slot
    state[at : at + 5] = view[0:5]
    state[at + 5 : at + 9] = view[8:12]
    for k in range(CLONE_ERROR):  # rows: J P, from the rows of the motion alone
        source, i = (k if k < 3 else k + 3), first + k
        for j in range(n):
            s = 0.0
            if j < first or j >= first + CLONE_ERROR:
                for a in range(nm):
                    s += H[source, a] * P[a * WIDE + j]
            P[i * WIDE + j] = P[j * WIDE + i] = s
    for k in range(CLONE_ERROR):  # its own block: (J P) J^T
        for l in range(CLONE_ERROR):
            source, s = (l if l < 3 else l + 3), 0.0
            for a in range(nm):
                s += P[(first + k) * WIDE + a] * H[source, a]
            P[(first + k) * WIDE + first + l] = s


@kernel()
def drop(plan, state, epoch):
    """Forget the clone of an epoch; the state shrinks when no clone beyond it lives."""
    fixed, active = plan[MOTION] + plan[NUISANCES_N], plan[MOTION] + plan[NUISANCES_N]
    P = state[plan[COV] :]
    for c in range(plan[CLONES]):
        first = fixed + CLONE_ERROR * c
        if state[CLONE_TIME + c] == epoch:
            state[CLONE_TIME + c] = math.nan
            for i in range(first, first + CLONE_ERROR):
                for j in range(plan[ERROR]):
                    P[i * WIDE + j] = P[j * WIDE + i] = 0.0
        elif not math.isnan(state[CLONE_TIME + c]):
            active = first + CLONE_ERROR
    state[ACTIVE] = active


@kernel()
def write_output(plan, params, state, view, work, points, out):
    """What leaves the filter at one moment: see plan.py."""
    H = pose_jacobian(plan, params, state, view, points)
    nm, P = plan[MOTION], state[plan[COV] :]
    out[OUT_VIEW : OUT_VIEW + VIEW_SIZE] = view[:VIEW_SIZE]
    k = OUT_COV
    for i in range(POSE):
        row = work[:nm]
        row[:] = 0.0
        for a in range(nm):
            if H[i, a] != 0.0:
                for b in range(nm):
                    row[b] += H[i, a] * P[a * WIDE + b]
        for j in range(i, POSE):
            s = 0.0
            for b in range(nm):
                s += row[b] * H[j, b]
            out[k] = s
            k += 1
    fixed, errors = plan[NOMINAL] + plan[NUISANCES_N], plan[MOTION] + plan[NUISANCES_N]
    out[OUT_X : OUT_X + fixed] = state[plan[X] : plan[X] + fixed]
    for i in range(errors):
        out[OUT_X + fixed + i] = P[i * (WIDE + 1)]


@kernel(i8(I, F, F, F, I, I, F, I, i8, i8, F, F2, F2, F2, F2, F2, F2, F2, F, I, F2, F2))
def run(plan, params, state, time, kind, start, data, index, first, last, work, points, V, N, Z, R, Hv, Hn, scratch, outcome, result, out):
    """Consume events first .. last-1.  Stops at a sensor in plain Python and returns its event; else returns `last`."""
    for e in range(first, last):
        row = data[start[e] : start[e + 1]]
        if kind[e] == IS_OUTPUT:  # on a copy: asking for output changes no estimate
            scratch[:] = state
            advance(plan, params, scratch, time[e], work, points)
            write_output(plan, params, scratch, V[0], work, points, out[index[e]])
            continue
        advance(plan, params, state, time[e], work, points)
        if kind[e] < 0:
            if kind[e] == IS_INPUT:
                state[INPUT : INPUT + row.shape[0]] = row
            elif kind[e] == IS_CLONE:
                clone(plan, params, state, V[0], points)
            elif kind[e] == IS_DROP:
                drop(plan, state, row[0])
            continue
        at = CHANNEL + CHANNEL_SIZE * kind[e]
        if plan[at + SENSOR_AT] == 0:
            return e
        k = call_points(plan[POINTS_AT], plan, params, state, kind[e], row, work, points, V, N)
        Hv[:] = 0.0
        Hn[:] = 0.0
        R[:] = 0.0
        verdict = USED if k > 0 else NO_CLONE
        p = params[plan[at + PARAMS] : plan[at + PARAMS_END]]
        for i in range(k):
            verdict = max(verdict, call_sensor(plan[at + SENSOR_AT], V[i], N[i], row, p, Z[i], R, Hv, Hn))
        if verdict == USED:
            verdict = call_update(plan[UPDATE_AT], plan, params, state, kind[e], row, Z, R, Hv, Hn, work, points, result[index[e]])
        outcome[index[e]] = verdict
        if verdict == USED:
            state[LAST_USED + kind[e]] = state[TIME]
    return last
