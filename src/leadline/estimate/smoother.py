"""Smoothing: every state by all data, those that came after it as well.

The forward run is gone through backward on its tape (estimate/tape.py) with an adjoint (l, L), which holds what the later
measurements say (Bierman, 1973: the modified Bryson-Frazier form; it inverts no covariance, so clones and constants are no trouble):
    x_smoothed = x [+] (-P l)                                       P_smoothed = P - P L P
    measurement      l <- l - H^T (y + Y l)                         L <- H^T H + C^T L C,   C = I - Y^T H
    transition       l <- Phi^T l                                   L <- Phi^T L Phi
with H, y, Y = H P whitened by the innovation covariance.  A measurement that was turned away leaves l and L as they are.

Leave one out: the residual of a measurement against the smoothed estimate of all others, normalised, is for one that was used
    e^T (I - 2 H P H^T + Y L Y^T)^-1 e,   e = y + Y l              and for one that was not   e^T (I - Y L Y^T)^-1 e.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import COMPONENTS, WIDE, kernel
from leadline.core.gaussian import cholesky, symmetrise
from leadline.core.linear import congruent, inverse
from leadline.estimate.loop import REANCHORED, USED, write_output
from leadline.estimate.plan import IS_INPUT, IS_OUTPUT, VERDICT
from leadline.estimate.run import Results, Runner
from leadline.estimate.tape import (
    ACTIVE_T,
    CLONED,
    COMPONENTS_M,
    CURSOR,
    DROPPED,
    HEAD,
    INDEX_T,
    KIND_T,
    LENGTH_T,
    MATRICES_M,
    MEASURED,
    MOVED_T,
    OUTPUT,
    RECORDS,
    VERDICT_M,
    close,
    rewind,
)
from leadline.models.layout import ACTIVE, CLONE_ERROR, COV, MOTION, X, retract

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array
    from leadline.estimate.composition import Composition
    from leadline.estimate.events import Events


@kernel()
def normalised(E, e, c, work):
    """The square of e (c,) in the metric of E (c x c, rows of COMPONENTS); nan where E is not positive definite."""
    if not cholesky(E, work, c):
        return math.nan
    total = 0.0
    for a in range(c):
        s = e[a]
        for b in range(a):
            s -= work[a * COMPONENTS + b] * work[COMPONENTS * COMPONENTS + b]
        s /= work[a * COMPONENTS + a]
        work[COMPONENTS * COMPONENTS + a] = s
        total += s * s
    return total


@kernel()
def residual(tape, r, q, c, n, l, e):
    """E = y + Y l."""
    for a in range(c):
        e[a] = tape[r + a]
        for j in range(n):
            e[a] += tape[q + a * n + j] * l[j]


@kernel()
def turned(tape, q, c, n, L, G):
    """G = L Y^T, a row for each component."""
    for a in range(c):
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += L[i * WIDE + j] * tape[q + a * n + j]
            G[a * WIDE + i] = s


@kernel()
def back_over_measurement(tape, at, n, l, L, work):
    """Take a measurement into the adjoint; returns its normalised residual against all others."""
    used, c = tape[at + VERDICT_M] in (USED, REANCHORED), int(tape[at + COMPONENTS_M])
    h = at + MATRICES_M
    q = h + c * n
    r = q + c * n
    e, E, G = work[:COMPONENTS], work[8 : 8 + 64], work[256 : 256 + COMPONENTS * WIDE]
    residual(tape, r, q, c, n, l, e)
    if used:
        for a in range(c):
            for j in range(n):
                l[j] -= tape[h + a * n + j] * e[a]
        # L <- L - H^T G^T - G H + H^T (M + I) H with G = L Y^T, M = Y G
        turned(tape, q, c, n, L, G)
        for a in range(c):
            for b in range(c):
                s = 1.0 if a == b else 0.0
                for j in range(n):
                    s += tape[q + a * n + j] * G[b * WIDE + j]
                E[a * COMPONENTS + b] = s
        for a in range(c):
            for i in range(n):
                half = -G[a * WIDE + i]
                for b in range(c):
                    half += 0.5 * E[a * COMPONENTS + b] * tape[h + b * n + i]
                for j in range(n):
                    L[i * WIDE + j] += half * tape[h + a * n + j]
                    L[j * WIDE + i] += half * tape[h + a * n + j]
        residual(tape, r, q, c, n, l, e)  # against the estimate before the measurement
    turned(tape, q, c, n, L, G)
    for a in range(c):
        for b in range(c):
            s, t = 0.0, 0.0
            for j in range(n):
                s += tape[q + a * n + j] * G[b * WIDE + j]
                t += tape[h + a * n + j] * tape[q + b * n + j]
            one = 1.0 if a == b else 0.0
            E[a * COMPONENTS + b] = one - 2.0 * t + s if used else one - s
    return normalised(E, e, c, work[128:])


@kernel()
def back_over_clone(plan, tape, at, n, l, L):
    """Before the clone was made its errors were the pose's: (l, L) <- F^T (l, L F) with F = [I; J]."""
    nm, first, J = plan[MOTION], int(tape[at]), at + 1
    for k in range(CLONE_ERROR):
        for a in range(nm):
            l[a] += tape[J + k * nm + a] * l[first + k]
    for i in range(n):  # columns
        for k in range(CLONE_ERROR):
            for a in range(nm):
                L[i * WIDE + a] += L[i * WIDE + first + k] * tape[J + k * nm + a]
    for k in range(CLONE_ERROR):  # rows
        for a in range(nm):
            for j in range(n):
                L[a * WIDE + j] += tape[J + k * nm + a] * L[(first + k) * WIDE + j]
    forget(first, l, L)


@kernel()
def forget(first, l, L):
    """Nothing is said of a clone's errors any more."""
    for k in range(first, first + CLONE_ERROR):
        l[k] = 0.0
        for j in range(WIDE):
            L[k * WIDE + j] = L[j * WIDE + k] = 0.0


@kernel()
def smooth_output(plan, params, tape, at, n, l, L, work, points, view, scratch, out):
    """Write an output of the smoothed state: that of the advanced copy, corrected by the adjoint brought from the last record to it."""
    ahead, dx, M, lo, Lo = tape[at] != 0.0, work[:WIDE], work[WIDE * WIDE :], work[WIDE : 2 * WIDE], work[2 * WIDE * WIDE :]
    scratch[:] = tape[at + 1 + n * n : at + 1 + n * n + scratch.shape[0]]
    P = scratch[plan[COV] :]
    for i in range(n):
        lo[i] = l[i]
        for j in range(n):
            Lo[i * WIDE + j] = L[i * WIDE + j]
    if ahead:  # l at the later moment: Phi^-T l, and L: Phi^-T L Phi^-1
        F, G = work[3 * WIDE * WIDE :], work[4 * WIDE * WIDE :]
        for i in range(n):
            for j in range(n):
                M[i * WIDE + j] = tape[at + 1 + i * n + j]
        inverse(M, F, n, WIDE)
        for i in range(n):
            for j in range(n):
                G[i * n + j] = F[i * WIDE + j]
        for j in range(n):
            s = 0.0
            for i in range(n):
                s += G[i * n + j] * l[i]
            lo[j] = s
        congruent(G, L, Lo, n, plan[MOTION], WIDE, M)
    for i in range(n):
        s = 0.0
        for j in range(n):
            s -= P[i * WIDE + j] * lo[j]
        dx[i] = s
    retract(plan, scratch[plan[X] : plan[COV]], dx, n)
    for i in range(n):  # M = P L
        for j in range(n):
            M[i * WIDE + j] = 0.0
        for k in range(n):
            p = P[i * WIDE + k]
            for j in range(n):
                M[i * WIDE + j] += p * Lo[k * WIDE + j]
    F = work[3 * WIDE * WIDE :]
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                s += M[i * WIDE + k] * P[k * WIDE + j]
            F[i * WIDE + j] = s
    for i in range(n):
        for j in range(i + 1):
            P[i * WIDE + j] -= F[i * WIDE + j]
            P[j * WIDE + i] = P[i * WIDE + j]
    write_output(plan, params, scratch, view, work, points, out)


@kernel()
def backward(plan, params, tape, starts, l, L, work, points, view, scratch, others, out):
    """Go through a tape from its end; fills in `others` (normalised residual against all others, by measurement) and outputs."""
    count, at = 0, RECORDS
    while at < tape[CURSOR]:
        starts[count] = at
        count += 1
        at += int(tape[at + LENGTH_T])
    for record in range(count - 1, -1, -1):
        start = starts[record]
        n, moved, kind = int(tape[start + ACTIVE_T]), tape[start + MOVED_T] != 0.0, tape[start + KIND_T]
        at = start + HEAD + (n * n + n if moved else 0)
        if kind == MEASURED:
            others[int(tape[start + INDEX_T])] = back_over_measurement(tape, at, n, l, L, work)
        elif kind == CLONED:
            back_over_clone(plan, tape, at, n, l, L)
        elif kind == DROPPED:
            forget(int(tape[at]), l, L)
        elif kind == OUTPUT:
            smooth_output(plan, params, tape, at, n, l, L, work, points, view, scratch, out[int(tape[start + INDEX_T])])
        if moved:
            F, moved_l = tape[start + HEAD :], work[:WIDE]
            for j in range(n):
                moved_l[j] = 0.0
            for i in range(n):
                for j in range(n):
                    moved_l[j] += F[i * n + j] * l[i]
            l[:n] = moved_l[:n]
            congruent(F, L, L, n, plan[MOTION], WIDE, work)
            symmetrise(L, n)  # what is not symmetric in L would grow: by e in an hour
    return count


@dataclass
class Adjoint:
    """What the later measurements say: l (WIDE,), L (WIDE, WIDE) flat; at the end of a run nothing."""

    l: Array
    L: Array

    @classmethod
    def at_the_end(cls) -> Adjoint:
        """Return the adjoint of no measurement."""
        return cls(np.zeros(WIDE), np.zeros(WIDE * WIDE))


class Smoother:
    """Goes through the stretches of a run backward, each run forward once more from its checkpoint with a tape behind it."""

    def __init__(self, composition: Composition) -> None:
        """Allocate for a composition."""
        self.composition, self.runner, self.adjoint = composition, Runner(composition), Adjoint.at_the_end()
        self.work = np.zeros(5 * WIDE * WIDE)

    def stretch(self, state: Array, events: Events, outcome: npt.NDArray[np.int64], verdict: Array) -> tuple[Array, Results]:
        """Smooth a stretch that began with `state`; `outcome` and `verdict` are what the rows were told beforehand.

        Returns the normalised residual of each measurement against all others (nan: not looked at), and the results, of which the
        outputs are smoothed.
        """
        composition, outputs = self.composition, int((events.kind == IS_OUTPUT).sum())
        results = Results.room(composition, len(outcome), outputs)
        results.outcome[:], results.result[: len(verdict), VERDICT] = outcome, verdict
        room, most = room_for(composition, events)
        if len(self.runner.workspace.tape) < room:
            self.runner.workspace.tape = np.empty(room)
        tape, workspace = self.runner.workspace.tape, self.runner.workspace
        rewind(tape)
        moved = state.copy()
        self.runner.run(moved, events, results)
        close(int(moved[ACTIVE]), tape)
        others = np.full(max(1, len(outcome)), np.nan)
        starts = np.zeros(most, np.int64)
        backward(
            composition.plan, composition.params, tape, starts, self.adjoint.l, self.adjoint.L, self.work, workspace.points,
            workspace.V[0], workspace.scratch, others, results.output,
        )  # fmt: skip
        return others[: len(outcome)], results


def room_for(composition: Composition, events: Events) -> tuple[int, int]:
    """Return how many numbers the tape of a stretch can need, and how many records."""
    layout, slots = composition.layout, composition.slots
    n = layout.error
    head = HEAD + n * n + n
    kinds, counts = np.unique(events.kind, return_counts=True)
    total = RECORDS + 2 * head
    for kind, count in zip(kinds.tolist(), counts.tolist(), strict=True):
        if kind >= 0:
            c, k = len(slots[kind].channel.components), len(slots[kind].channel.nuisances)
            total += count * (head + MATRICES_M + c * (2 * n + 1 + k))
        elif kind == IS_OUTPUT:
            total += count * (head + 1 + n * n + n + layout.size)
        elif kind != IS_INPUT:
            total += count * (head + 1 + CLONE_ERROR * layout.motion_error)
    return total, int(counts[kinds != IS_INPUT].sum()) + 2
