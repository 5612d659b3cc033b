"""THE loop: propagate, look, correct, record.  It knows no sensor, no process model and no estimator.

Events lie in arrays: `time`, `kind` (a channel, or one of the negative kinds of plan.py), `start` and `stop` (the row of event e is
data[start[e] : stop[e]]) and `index` (which result or output the event fills).
"""

from __future__ import annotations

import math

from leadline.core.compiled import (
    F2,
    WIDE,
    F,
    I,
    call_points,
    call_propagate,
    call_pull,
    call_sensor,
    call_settle,
    call_update,
    call_view,
    i8,
    kernel,
)
from leadline.estimate.plan import (
    CHANNEL,
    CHANNEL_SIZE,
    EVERY,
    GATE,
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
    ROOT,
    SENSOR_AT,
    SETTLE_AT,
    STANDBY_AFTER,
    STANDBY_END,
    STANDBY_FIRST,
    UPDATE_AT,
    VIEW_AT,
)
from leadline.estimate.tape import EVENT, lay_aside, note_clone, note_drop, note_output
from leadline.models.layout import (
    ACTIVE,
    CHANNELS_N,
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
    NOW_U,
    NUISANCES_N,
    TIME,
    X,
)
from leadline.models.view import TANGENT, VIEW_SIZE

USED, GATED, NO_CLONE, REANCHORED, STANDBY, DECIMATED, OVERRULED = 0, 1, 10, 13, 14, 15, 16  # of data/outcome.py
POSE = 9  # the first directions of a view's tangent space: position, velocity, attitude


@kernel()
def advance(plan, params, state, time, work, points, tape):
    """Propagate to `time`, in steps no longer than the process model allows."""
    longest = params[plan[LONGEST_STEP]]
    while state[TIME] < time:
        dt = time - state[TIME]
        state[INPUT + NOW_U] = state[TIME]
        if dt > longest:
            call_propagate(plan[PROPAGATE_AT], plan, params, state, longest, work, points, tape)
            state[TIME] += longest
        else:
            call_propagate(plan[PROPAGATE_AT], plan, params, state, dt, work, points, tape)
            state[TIME] = time
    state[INPUT + NOW_U] = state[TIME]


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
def clone(plan, params, state, view, points, tape):
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
    if tape.shape[0] > 0:
        note_clone(plan, first, H, n, tape)
    at = plan[X] + plan[NOMINAL] + plan[NUISANCES_N] + CLONE_NOMINAL * slot
    state[at : at + 5] = view[0:5]
    state[at + 5 : at + 9] = view[8:12]
    if plan[ROOT] != 0:
        clone_root(plan, H, P, first)
        return
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
def clone_root(plan, H, S, first):
    """The rows of a new clone in a root of the covariance: J S; nothing of their own."""
    for k in range(CLONE_ERROR):
        source, i = (k if k < 3 else k + 3), first + k
        S[i * WIDE : (i + 1) * WIDE] = 0.0
        for j in range(first):
            for a in range(plan[MOTION]):
                S[i * WIDE + j] += H[source, a] * S[a * WIDE + j]


@kernel()
def drop(plan, state, epoch, tape):
    """Forget the clone of an epoch; the state shrinks when no clone beyond it lives."""
    fixed, active = plan[MOTION] + plan[NUISANCES_N], plan[MOTION] + plan[NUISANCES_N]
    P = state[plan[COV] :]
    for c in range(plan[CLONES]):
        first = fixed + CLONE_ERROR * c
        if state[CLONE_TIME + c] == epoch:
            state[CLONE_TIME + c] = math.nan
            if tape.shape[0] > 0:
                note_drop(first, int(state[ACTIVE]), tape)
            for i in range(first, first + CLONE_ERROR):
                for j in range(plan[ERROR]):
                    P[i * WIDE + j] = 0.0
                    if plan[ROOT] == 0:
                        P[j * WIDE + i] = 0.0
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


@kernel()
def withheld(plan, params, state, channel):
    """Say why a measurement of a channel is not even looked at: it comes too soon, or the sensor that it stands in for is at work."""
    at = CHANNEL + CHANNEL_SIZE * channel
    g = plan[at + GATE]
    if params[g + EVERY] > 0.0 and state[TIME] - state[LAST_USED + channel] < params[g + EVERY] * (1.0 - 1e-6):
        return DECIMATED
    if plan[at + STANDBY_END] > 0:
        newest = -math.inf
        for i in range(plan[at + STANDBY_FIRST], plan[at + STANDBY_END]):
            newest = max(newest, state[LAST_USED + i])
        if state[TIME] - newest < params[g + STANDBY_AFTER]:
            return STANDBY
    return USED


@kernel()
def remember(plan, state, channel, verdict):
    """Remember when a channel was last used, and how often in a row it has been turned away."""
    rejected = LAST_USED + plan[CHANNELS_N] + channel
    if verdict in (USED, REANCHORED):
        state[LAST_USED + channel], state[rejected] = state[TIME], 0.0
    elif verdict == GATED:
        state[rejected] += 1.0


@kernel()
def look(plan, params, state, channel, row, work, points, V, N, Z, R, Hv, Hn, tape, result):
    """Ask the sensor at the estimator's points, and update; returns the outcome."""
    verdict = withheld(plan, params, state, channel)
    if verdict != USED:
        return verdict
    at = CHANNEL + CHANNEL_SIZE * channel
    k = call_points(plan[POINTS_AT], plan, params, state, channel, row, work, points, V, N)
    verdict = USED if k > 0 else NO_CLONE
    p = params[plan[at + PARAMS] : plan[at + PARAMS_END]]
    for i in range(k - 1, -1, -1):  # the estimate itself comes last: Jacobians and noise are those at it
        Hv[:] = 0.0
        Hn[:] = 0.0
        R[:] = 0.0
        verdict = call_sensor(plan[at + SENSOR_AT], V[i], N[i], row, p, Z[i], R, Hv, Hn)
        if verdict != USED:
            Z[i, 0] = math.nan
    if verdict == USED:
        verdict = call_update(plan[UPDATE_AT], plan, params, state, channel, row, Z, R, Hv, Hn, work, points, tape, result)
    remember(plan, state, channel, verdict)
    return verdict


@kernel()
def put_out(plan, params, state, time, index, scratch, view, work, points, tape, out):
    """Write an output, on a copy: asking for output changes no estimate."""
    n = int(state[ACTIVE])
    if tape.shape[0] > 0:
        lay_aside(n, tape)
    scratch[:] = state
    advance(plan, params, scratch, time, work, points, tape)
    if plan[SETTLE_AT] != 0:
        call_settle(plan[SETTLE_AT], plan, params, scratch, work)
    write_output(plan, params, scratch, view, work, points, out)
    if tape.shape[0] > 0:
        note_output(index, n, scratch, tape)


@kernel(i8(I, F, F, F, I, I, I, F, I, i8, i8, F, F2, F2, F2, F2, F2, F2, F2, F, F, I, F2, F2))
def run(
    plan, params, state, time, kind, start, stop, data, index, first, last, work, points, V, N, Z, R, Hv, Hn,
    scratch, tape, outcome, result, out,
):  # fmt: skip
    """Consume events first .. last-1.  Stops at a sensor in plain Python and returns its event; else returns `last`.

    An event whose outcome is OVERRULED beforehand is passed over.
    """
    for e in range(first, last):
        row = data[start[e] : stop[e]]
        if kind[e] == IS_OUTPUT:
            put_out(plan, params, state, time[e], index[e], scratch, V[0], work, points, tape, out[index[e]])
            continue
        advance(plan, params, state, time[e], work, points, tape)
        if kind[e] == IS_INPUT:
            for i in range(row.shape[0]):
                if row[i] == row[i]:  # what is no number leaves its place as it is
                    state[INPUT + i] = row[i]
        elif kind[e] == IS_CLONE:
            if plan[CLONES] > 0:
                clone(plan, params, state, V[0], points, tape)
        elif kind[e] == IS_DROP:
            drop(plan, state, row[0], tape)
        elif outcome[index[e]] != OVERRULED:
            if plan[CHANNEL + CHANNEL_SIZE * kind[e] + SENSOR_AT] == 0:
                return e
            if tape.shape[0] > 0:
                tape[EVENT] = index[e]
            outcome[index[e]] = look(plan, params, state, kind[e], row, work, points, V, N, Z, R, Hv, Hn, tape, result[index[e]])
    return last
