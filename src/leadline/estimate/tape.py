"""The tape: what a forward run did, written down so that it can be gone through backward (smoother, error budget).

A tape is a flat array; an empty one records nothing and costs nothing.  Its head holds where the next record goes, the event at hand,
whether anything moved since the last record, and what was gathered since then: the transition Phi, and the noise that drove each error.
A record is
    kind, length, index, active errors n, moved, [Phi n x n, driving variances n, when moved], payload
    MEASURED   verdict, components c, nuisance values k, L^-1 H (c x n), Y (c x n), y (c), L^-1 Hn (c x k)      see estimate/kalman.py
    CLONED     first error of the clone, Jacobian of place and attitude against the motion (6 x motion)
    DROPPED    first error of the clone that is forgotten
    OUTPUT     whether the copy has moved since the last record, its transition since then (n x n), the advanced state; what is gathered
               goes on, so that an output changes nothing that is recorded beside it
    END        nothing: what was gathered up to the end of the run
"""

from __future__ import annotations

import math

from leadline.core.compiled import COMPONENTS, WIDE, call_push, kernel
from leadline.estimate.plan import (
    CHANNEL,
    CHANNEL_SIZE,
    DECAY,
    DECAY_PARAMS,
    DECAY_PER_METRE,
    DECAY_SIZE,
    MOTION_END,
    MOTION_PARAMS,
    PUSH_AT,
    VALUES_N,
)
from leadline.models.layout import MOTION, NUISANCES_N

CURSOR, EVENT, MOVED, PHI = 0, 1, 2, 4
SCRATCH, DRIVEN, RECORDS = PHI + WIDE * WIDE, PHI + 2 * WIDE * WIDE, PHI + 2 * WIDE * WIDE + WIDE
KIND_T, LENGTH_T, INDEX_T, ACTIVE_T, MOVED_T, HEAD = 0, 1, 2, 3, 4, 5
MEASURED, CLONED, DROPPED, OUTPUT, END = 1, 2, 3, 4, 5
VERDICT_M, COMPONENTS_M, VALUES_M, MATRICES_M = 0, 1, 2, 3


@kernel()
def identity(matrix):
    """Make a flat matrix with rows of WIDE numbers the identity."""
    matrix[: WIDE * WIDE] = 0.0
    for i in range(WIDE):
        matrix[i * (WIDE + 1)] = 1.0


@kernel()
def rewind(tape):
    """Make a tape empty."""
    tape[CURSOR], tape[EVENT], tape[MOVED] = RECORDS, -1.0, 0.0
    identity(tape[PHI:])
    tape[DRIVEN : DRIVEN + WIDE] = 0.0


@kernel()
def decay_rows(plan, params, nm, nc, dt, speed, columns, phi):
    """Let the rows of nuisances decay."""
    for k in range(nc):
        at = plan[DECAY_PARAMS] + DECAY_SIZE * k
        rate = params[at + DECAY] + speed * params[at + DECAY_PER_METRE]
        if rate != 0.0:
            beta = math.exp(-rate * dt)
            for j in range(columns):
                phi[(nm + k) * WIDE + j] *= beta


@kernel()
def push_transition(plan, params, m, dt, speed, n, tape):
    """Phi <- Phi_step Phi, with the memory that the process model's step has left."""
    nm, nc = plan[MOTION], plan[NUISANCES_N]
    phi, moved = tape[PHI:], tape[SCRATCH:]
    w = 16 if n <= 16 else (24 if n <= 24 else (32 if n <= 32 else WIDE))
    call_push(plan[PUSH_AT], m, dt, params[plan[MOTION_PARAMS] : plan[MOTION_END]], phi, moved, w)
    for i in range(nm):
        for j in range(w):
            phi[i * WIDE + j] = moved[i * WIDE + j]
    decay_rows(plan, params, nm, nc, dt, speed, w, phi)
    tape[MOVED] = 1.0


@kernel()
def decay_transition(plan, params, slope, dt, speed, n, tape):
    """Phi <- Phi_step Phi, with the motion's transition given (rows of WIDE numbers)."""
    nm, nc = plan[MOTION], plan[NUISANCES_N]
    phi, moved = tape[PHI:], tape[SCRATCH:]
    for i in range(nm):
        for j in range(n):
            s = 0.0
            for k in range(nm):
                s += slope[i * WIDE + k] * phi[k * WIDE + j]
            moved[i * WIDE + j] = s
    for i in range(nm):
        for j in range(n):
            phi[i * WIDE + j] = moved[i * WIDE + j]
    decay_rows(plan, params, nm, nc, dt, speed, n, phi)
    tape[MOVED] = 1.0


@kernel()
def begin(kind, index, n, tape):
    """Begin a record: its head, and the transition since the record before; returns where its payload goes."""
    at = int(tape[CURSOR])
    tape[at + KIND_T], tape[at + INDEX_T], tape[at + ACTIVE_T], tape[at + MOVED_T] = kind, index, n, tape[MOVED]
    end = at + HEAD
    if tape[MOVED] != 0.0:
        end = store_transition(n, end, tape)
    return end


@kernel()
def store_transition(n, at, tape):
    """Write Phi (n x n) and the driving variances (n) at a place and begin anew; returns the place behind them."""
    for i in range(n):
        for j in range(n):
            tape[at + i * n + j] = tape[PHI + i * WIDE + j]
    for i in range(n):
        tape[at + n * n + i] = tape[DRIVEN + i]
    identity(tape[PHI:])
    tape[DRIVEN : DRIVEN + WIDE] = 0.0
    tape[MOVED] = 0.0
    return at + n * n + n


@kernel()
def end(at, tape):
    """End a record whose payload reaches up to `at`."""
    start = int(tape[CURSOR])
    tape[start + LENGTH_T] = at - start
    tape[CURSOR] = at


@kernel()
def note_measurement(plan, channel, verdict, H, Hn, L, Y, y, c, n, tape):
    """Write down a measurement that was used or turned away."""
    k = plan[CHANNEL + CHANNEL_SIZE * channel + VALUES_N]
    at = begin(MEASURED, tape[EVENT], n, tape)
    tape[at + VERDICT_M], tape[at + COMPONENTS_M], tape[at + VALUES_M] = verdict, c, k
    h = at + MATRICES_M
    q = h + c * n
    r = q + c * n
    v = r + c
    for a in range(c):
        for j in range(n):
            tape[h + a * n + j], tape[q + a * n + j] = H[a, j], Y[a * WIDE + j]
        for j in range(k):
            tape[v + a * k + j] = Hn[a, j]
        tape[r + a] = y[a]
        for b in range(a):
            l = L[a * COMPONENTS + b]
            for j in range(n):
                tape[h + a * n + j] -= l * tape[h + b * n + j]
            for j in range(k):
                tape[v + a * k + j] -= l * tape[v + b * k + j]
        l = 1.0 / L[a * COMPONENTS + a]
        for j in range(n):
            tape[h + a * n + j] *= l
        for j in range(k):
            tape[v + a * k + j] *= l
    end(v + c * k, tape)


@kernel()
def note_clone(plan, first, jacobian, n, tape):
    """Write down that the pose was cloned to the errors from `first` on; jacobian: position, velocity and attitude against the motion."""
    nm = plan[MOTION]
    at = begin(CLONED, -1.0, n, tape)
    tape[at] = first
    for k in range(6):
        source = k if k < 3 else k + 3
        for a in range(nm):
            tape[at + 1 + k * nm + a] = jacobian[source, a]
    end(at + 1 + 6 * nm, tape)


@kernel()
def note_drop(first, n, tape):
    """Write down that a clone was forgotten."""
    at = begin(DROPPED, -1.0, n, tape)
    tape[at] = first
    end(at + 1, tape)


@kernel()
def close(n, tape):
    """Write down what was gathered up to the end of the run."""
    end(begin(END, -1.0, n, tape), tape)


@kernel()
def lay_aside(n, tape):
    """Begin an output: keep Phi and the driving variances, which its copy will push further, where its payload will be."""
    at = int(tape[CURSOR])
    tape[at + MOVED_T], tape[at + ACTIVE_T], tape[at + KIND_T] = 0.0, n, OUTPUT
    keep = at + HEAD + 1
    for i in range(n):
        for j in range(n):
            tape[keep + i * n + j] = tape[PHI + i * WIDE + j]
        tape[keep + n * n + i] = tape[DRIVEN + i]
    tape[keep + n * n + n] = tape[MOVED]


@kernel()
def note_output(index, n, state, tape):
    """Write down an output, whose copy has been advanced to `state`, and take up again what was laid aside."""
    at = int(tape[CURSOR])
    tape[at + INDEX_T], tape[at + HEAD] = index, tape[MOVED]
    keep = at + HEAD + 1
    tape[MOVED] = tape[keep + n * n + n]
    for i in range(n):
        for j in range(n):
            k = keep + i * n + j
            tape[k], tape[PHI + i * WIDE + j] = tape[PHI + i * WIDE + j], tape[k]
        tape[DRIVEN + i] = tape[keep + n * n + i]
    where = keep + n * n
    tape[where : where + state.shape[0]] = state
    end(where + state.shape[0], tape)
