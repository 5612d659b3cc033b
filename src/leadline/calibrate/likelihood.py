"""The likelihood of a log's innovations, as a function of the sigmas that its vehicle file states.

    log L = -1/2 sum over rows of (r^T S^-1 r + log det S)          r residual, S its covariance by the filter    (Schweppe, 1965)

A log is put in order once and run as often as it is asked for; a sigma is changed where it stands: in the rows, in the noise factor of a
channel, or among the densities of the process model.  Rows beyond the gate are left out.  A good row is inside with a probability, and
the likelihood is that of rows that are known to be inside: what the gate cuts off shrinks no sigma.
    log L <- log L - sum log F_d(c |S_0|^(1/d) / |S|^(1/d))          F_d chi-square with d degrees of freedom, c and S_0 those of the gate
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.outcome import Outcome
from leadline.estimate import plan as at
from leadline.estimate.assembly import navigator_for
from leadline.estimate.run import Results
from leadline.estimate.stream import stream_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import Vehicle
    from leadline.estimate.composition import Composition
    from leadline.estimate.events import Events, Integers

    Flags = npt.NDArray[np.bool_]

HOPELESS = -1e6
SELDOM = 1e-4  # states per second: none are wanted


@dataclass(frozen=True)
class Change:
    """Where a sigma stands: `array[place]` is what it is by the file, and grows by `amount` times (ratio^2 - 1)."""

    array: Array
    place: Integers
    amount: Array


@dataclass(frozen=True)
class Looked:
    """What a run leaves of each measurement (n,): normalised square, log det S; by component (n, d) residual and sigma; outcome."""

    nis: Array
    log_det: Array
    residual: Array
    sigma: Array
    outcome: Integers


@dataclass(frozen=True)
class Inside:
    """Which measurements (n,) lie inside the gate, and the log det S (n,) with which they were judged."""

    rows: Flags
    log_det: Array


class Recording:
    """A log in order, ready to be run again and again; it belongs to whoever made it, and changes with its sigmas.

    slot, dof, time (n,): channel, components and time of each measurement; limit (n,): of its normalised square.
    """

    def __init__(self, log: Log, vehicle: Vehicle) -> None:
        """Put a log in order; raises InputError for what cannot be run."""
        navigator, _, _ = navigator_for(log, vehicle)
        self.log, self.runner, self.begun = log, navigator.runner, navigator.state.copy()
        self.events: list[Events] = list(stream_of(log, vehicle, navigator, rate=SELDOM))
        self.state = self.begun.copy()
        slots = self.composition.slots
        self.slot = np.concatenate([e.kind[e.measured] for e in self.events])
        self.time = np.concatenate([e.time[e.measured] for e in self.events])
        self.dof = np.array([len(s.channel.components) for s in slots] or [0])[self.slot]
        self._plain_gates()
        gate = self.composition.plan[at.CHANNEL + at.CHANNEL_SIZE * self.slot + at.GATE]
        self.limit = self.composition.params[gate + at.LIMIT]
        count = len(self.slot)
        self.room = Results.room(self.composition, count, 1 + max(int((e.kind == at.IS_OUTPUT).sum()) for e in self.events))
        self.asked = np.full(count, -1), np.full(count, np.nan)
        self.changes: list[list[Change]] = []
        self.kept: list[tuple[Change, Array]] = []

    @property
    def composition(self) -> Composition:
        """What is run."""
        return self.runner.composition

    def _plain_gates(self) -> None:
        """Let each gate be one of fixed probability: it neither widens nor opens the estimate, and outliers do not count less."""
        from scipy.special import gammaincinv

        plan, params = self.composition.plan, self.composition.params
        for i, slot in enumerate(self.composition.slots):
            g = plan[at.CHANNEL + at.CHANNEL_SIZE * i + at.GATE]
            params[g + at.LIMIT] = 2.0 * float(gammaincinv(0.5 * len(slot.channel.components), slot.config.gate.probability))
            params[[g + at.WIDENING, g + at.STUDENT_DOF, g + at.REANCHOR_AFTER]] = 0.0

    def hold(self, changes: list[list[Change]]) -> None:
        """Take in what each sigma changes, and keep what the file says."""
        self.changes = changes
        self.kept = [(change, change.array[change.place]) for own in changes for change in own]

    def widen(self, times: float) -> None:
        """Let gates be so many times as wide in sigma as the file says."""
        gate = self.composition.plan[at.CHANNEL + at.CHANNEL_SIZE * self.slot + at.GATE]
        self.composition.params[gate + at.LIMIT] = self.limit * times**2

    def run(self, ratio: Array) -> Looked:
        """Run with sigmas that are `ratio` (k,) times those of the file."""
        for change, kept in self.kept:
            change.array[change.place] = kept
        for own, factor in zip(self.changes, ratio, strict=True):
            for change in own:
                change.array[change.place] += (factor**2 - 1.0) * change.amount
        self.state[:] = self.begun
        self.room.result[:], self.room.outcome[:] = np.nan, self.asked[0]
        self.room.result[: len(self.slot), at.VERDICT] = self.asked[1]
        first = 0
        for events in self.events:
            last = first + int(events.measured.sum())
            part = Results(self.room.outcome[first:last], self.room.result[first : max(last, first + 1)], self.room.output)
            self.runner.run(self.state, events, part)
            first = last
        most, found = max(1, self.dof.max(initial=1)), self.room.result[: len(self.slot)]
        residual, sigma = (found[:, a : a + most].copy() for a in (at.RESIDUAL, at.SIGMA))
        return Looked(found[:, at.NIS].copy(), found[:, at.LOG_DET].copy(), residual, sigma, self.room.outcome.copy())

    def judge(self, ratio: Array) -> Inside:
        """Let the gates judge at these sigmas; from now on what lies inside is used whatever the sigmas, and what lies outside is not."""
        self.asked = np.full(len(self.slot), -1), np.full(len(self.slot), np.nan)
        found = self.run(ratio)
        inside = (found.outcome == Outcome.USED) & np.isfinite(found.nis)
        self.asked[0][found.outcome == Outcome.GATED] = int(Outcome.OVERRULED)
        self.asked[1][inside] = at.ADMIT
        return Inside(inside, found.log_det)

    def free(self) -> None:
        """Let the gates judge each run anew."""
        self.asked = np.full(len(self.slot), -1), np.full(len(self.slot), np.nan)

    def by_row(self, found: Looked, inside: Inside) -> Array:
        """Log-likelihood (n,) of each measurement; zero outside the gate, and hopeless where a run has broken down."""
        from scipy.special import gammainc

        good = inside.rows & np.isfinite(found.nis)
        value, d = np.where(inside.rows, HOPELESS, 0.0), self.dof[good]
        log_det = found.log_det[good]
        cut = self.limit[good] * np.exp((inside.log_det[good] - log_det) / d)
        value[good] = -0.5 * (found.nis[good] + log_det) - np.log(gammainc(0.5 * d, 0.5 * cut))
        return value
