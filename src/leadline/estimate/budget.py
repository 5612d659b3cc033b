"""Error budget: whose error is how much of the error at the end, with the gains as the filter has taken them.

With fixed gains the error at the end is linear in every source: the start, what drives the states, the noise of each measurement, and
what the filter takes for known though it is not (priors with `estimate = false`).  Rows a (of position, velocity, attitude at the end)
go backward on the tape of the run (estimate/tape.py):
    measurement   a <- a - H^T g,  g = Y a      its noise adds g^T (I - H Y^T) g,  an unknown constant with Jacobian J adds g^T J to its sum
    transition    a <- Phi^T a                  noise q of an error adds q times the mean of a^2 before and after
    start                                       a block of the first covariance adds a^T P a
A constant's sum squared times its variance is its share: it is the same in all measurements.  Source: Gelb (1974), section 7.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import COMPONENTS, NUISANCES, WIDE, kernel
from leadline.data.errors import InputError
from leadline.estimate.assembly import navigator_for
from leadline.estimate.loop import POSE, REANCHORED, USED, pose_jacobian
from leadline.estimate.run import Results, Runner
from leadline.estimate.smoother import room_for
from leadline.estimate.stream import stream_of
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
    RECORDS,
    VALUES_M,
    VERDICT_M,
    close,
    rewind,
)
from leadline.models.layout import ACTIVE, CLONE_ERROR, MOTION

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.estimate.composition import Composition
    from leadline.estimate.navigator import Navigator

GROUPS = {"horizontal position": (0, 1), "depth": (2,), "horizontal velocity": (3, 4), "tilt": (6, 7), "heading": (8,)}


@kernel()
def back_over_measurement(tape, at, n, A, slot, by_noise, by_constant):
    """Take a measurement into the rows A, and add what its noise and its constants bring."""
    c, k = int(tape[at + COMPONENTS_M]), int(tape[at + VALUES_M])
    h = at + MATRICES_M
    q = h + c * n
    v = q + c * n + c
    g = np.zeros(COMPONENTS)
    for r in range(A.shape[0]):
        for a in range(c):
            s = 0.0
            for j in range(n):
                s += tape[q + a * n + j] * A[r, j]
            g[a] = s
        for a in range(c):
            for b in range(c):
                s = 1.0 if a == b else 0.0
                for j in range(n):
                    s -= tape[h + a * n + j] * tape[q + b * n + j]
                by_noise[r, slot] += g[a] * s * g[b]
            for p in range(k):
                by_constant[r, slot * NUISANCES + p] += g[a] * tape[v + a * k + p]
            for j in range(n):
                A[r, j] -= tape[h + a * n + j] * g[a]


@kernel()
def back_over_transition(tape, at, n, A, by_drive):
    """Take a transition into the rows A, and add what drove the states."""
    before = np.zeros(WIDE)
    for r in range(A.shape[0]):
        before[:n] = 0.0
        for i in range(n):
            for j in range(n):
                before[j] += tape[at + i * n + j] * A[r, i]
        for i in range(n):
            by_drive[r, i] += 0.5 * tape[at + n * n + i] * (before[i] * before[i] + A[r, i] * A[r, i])
            A[r, i] = before[i]


@kernel()
def back_over_clone(plan, tape, at, A):
    """Before the clone was made its errors were the pose's."""
    nm, first = plan[MOTION], int(tape[at])
    for r in range(A.shape[0]):
        for k in range(CLONE_ERROR):
            for a in range(nm):
                A[r, a] += A[r, first + k] * tape[at + 1 + k * nm + a]
            A[r, first + k] = 0.0


@kernel()
def trace(plan, tape, starts, slots, A, by_noise, by_constant, by_drive):
    """Go through a tape from its end."""
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
            if tape[at + VERDICT_M] in (USED, REANCHORED):
                back_over_measurement(tape, at, n, A, slots[int(tape[start + INDEX_T])], by_noise, by_constant)
        elif kind == CLONED:
            back_over_clone(plan, tape, at, A)
        elif kind == DROPPED:
            first = int(tape[at])
            A[:, first : first + CLONE_ERROR] = 0.0
        if moved:
            back_over_transition(tape, start + HEAD, n, A, by_drive)


@dataclass(frozen=True)
class Share:
    """What one source brings: its kind (start, drive, noise, constant), and by group of `GROUPS` the variance (SI)."""

    source: str
    kind: str
    variance: dict[str, float]


@dataclass(frozen=True)
class Budget:
    """Shares of the variance at a time (s): `stated` by the filter, `total` with the constants that it takes for known; by group (SI).

    left: what no source explains, as a part of what is stated: correlations of the start, an estimate that was opened up.
    """

    time: float
    shares: tuple[Share, ...]
    stated: dict[str, float]
    total: dict[str, float]
    left: dict[str, float]


def budget(
    log: Log, vehicle: Vehicle, *, until: float | None = None, estimator: str = "ekf", progress: Callable[[float], None] | None = None
) -> Budget:
    """Return the error budget of a log at its end, or at `until` (s).  Raises InputError as `solve`."""
    navigator, _, _ = navigator_for(log, vehicle, estimator=estimator)
    if not navigator.composition.estimator.smooths:
        raise InputError("budget", f"'{estimator}' leaves no gains to go back over", "take a Gaussian estimator (ekf, ukf)")
    if navigator.composition.process.consumes != "imu":
        asked = f"is asked of the process model '{navigator.composition.process.name}'"
        raise InputError("budget", asked, "solve with inertial or body-velocity: noise that several states share is not told apart")
    stream = stream_of(log, vehicle, navigator, times=None if until is None else np.array([until]), rate=0.01, end=until)
    if any(
        channel.epochs == 2 and n.considered for s in navigator.composition.slots for channel in (s.channel,) for n in channel.nuisances
    ):
        raise InputError("budget", "has a constant of a sensor that looks at two epochs", "estimate it, or give it no sigma")
    if any(n.considered for s in navigator.composition.slots for part in s.channel.displacing.values() for n in part):
        raise InputError("budget", "has a lever arm, time offset or clock that is not estimated", "estimate it, or give it no sigma")
    composition, told = navigator.composition, progress or (lambda _: None)
    first = _settled(navigator)
    checkpoints = []
    for k, events in enumerate(stream):
        checkpoints.append(navigator.state.copy())
        outputs = len(events.index)
        navigator.runner.run(navigator.state, events, Results.room(composition, int(events.measured.sum()), outputs))
        told(0.3 * (k + 1) / (len(stream.edges) - 1))
    A, stated = _end(navigator)
    found = _Found.nothing(composition)
    runner = Runner(composition)
    for k in range(len(checkpoints) - 1, -1, -1):
        events = stream.stretch(*stream.edges[k : k + 2])
        room, most = room_for(composition, events)
        if len(runner.workspace.tape) < room:
            runner.workspace.tape = np.empty(room)
        rewind(runner.workspace.tape)
        runner.run(checkpoints[k], events, Results.room(composition, int(events.measured.sum()), len(events.index)))
        close(int(checkpoints[k][ACTIVE]), runner.workspace.tape)
        starts, slots = np.zeros(most, np.int64), events.kind[events.measured]
        trace(composition.plan, runner.workspace.tape, starts, slots, A, found.by_noise, found.by_constant, found.by_drive)
        told(1.0 - 0.7 * k / len(checkpoints))
    return _told(composition, stream.end, found, A, first, stated)


@dataclass(frozen=True)
class _Found:
    """Sums so far, by row of the adjoint."""

    by_noise: Array  # (POSE, channels)
    by_constant: Array  # (POSE, channels x NUISANCES)
    by_drive: Array  # (POSE, WIDE)

    @classmethod
    def nothing(cls, composition: Composition) -> _Found:
        """Return sums of nothing."""
        count = len(composition.slots)
        return cls(np.zeros((POSE, count)), np.zeros((POSE, count * NUISANCES)), np.zeros((POSE, WIDE)))


def _settled(navigator: Navigator) -> Array:
    """A copy of the state with its covariance in its place, where an estimator carries another form of it."""
    composition, state = navigator.composition, navigator.state.copy()
    if composition.estimator.settle is not None:
        composition.estimator.settle(composition.plan, composition.params, state, navigator.runner.workspace.work)
    return state


def _end(navigator: Navigator) -> tuple[Array, Array]:
    """Jacobian of position, velocity and attitude against the state at the end (POSE, WIDE), and their variances (POSE,)."""
    composition, work = navigator.composition, navigator.runner.workspace
    layout = composition.layout
    H = pose_jacobian(composition.plan, composition.params, navigator.state, work.V[0], work.points)
    A = np.zeros((POSE, WIDE))
    A[:, : layout.motion_error] = H[:POSE, : layout.motion_error]
    P = _settled(navigator)[layout.covariance].reshape(layout.error, WIDE)[:, : layout.error]
    rows = A[:, : layout.error]
    return A, np.einsum("ri,ij,rj->r", rows, P, rows)


def _told(composition: Composition, time: float, found: _Found, A: Array, first: Array, stated: Array) -> Budget:
    """Name the sources."""
    layout = composition.layout
    P = first[layout.covariance].reshape(layout.error, WIDE)[:, : layout.error]
    shares: list[tuple[str, str, Array]] = []
    blocks = [(part.name, layout.error_of(part.name)) for part in layout.motion]
    blocks += [(n.name, slice(layout.nuisance_error(n.name), layout.nuisance_error(n.name) + 1)) for n in layout.nuisances]
    for name, block in blocks:
        rows = A[:, block]
        shares.append((name, "start", np.einsum("ri,ij,rj->r", rows, P[block, block], rows)))
        shares.append((name, "drive", found.by_drive[:, block].sum(axis=1)))
    shares += [(part.sensor, "noise", found.by_noise[:, slot]) for slot, part in enumerate(composition.slots)]
    sums: dict[str, tuple[float, Array]] = {}
    for slot, part in enumerate(composition.slots):
        for k, nuisance in enumerate(part.channel.nuisances):
            if nuisance.considered:
                _, known = sums.get(nuisance.name, (0.0, np.zeros(POSE)))
                sums[nuisance.name] = (nuisance.considered, known + found.by_constant[:, slot * NUISANCES + k])
    constants = [(name, "constant", (sigma * total) ** 2) for name, (sigma, total) in sums.items()]
    merged: dict[tuple[str, str], Array] = {}
    for name, kind, variance in (*shares, *constants):
        merged[name, kind] = merged.get((name, kind), np.zeros(POSE)) + variance
    explained = sum((v for (_, kind), v in merged.items() if kind != "constant"), np.zeros(POSE))
    more = sum((v for (_, kind), v in merged.items() if kind == "constant"), np.zeros(POSE))
    return Budget(
        time,
        tuple(Share(name, kind, grouped(v)) for (name, kind), v in merged.items() if np.any(v > 0.0)),
        grouped(stated),
        grouped(stated + more),
        {name: float(1.0 - e / s) for (name, e), s in zip(grouped(explained).items(), grouped(stated).values(), strict=True)},
    )


def grouped(variance: Array) -> dict[str, float]:
    """Return the sums of variances (POSE,) over `GROUPS`."""
    return {name: float(sum(variance[i] for i in rows)) for name, rows in GROUPS.items()}
