"""Sigmas of greatest likelihood, with their intervals: scoring, gates that are judged anew, and a variance that errors in time cannot fool.

The parameters are logarithms of sigma / sigma in the file.  A step of scoring is A^-1 s, with s the score by central differences and
    A = sum over rows and components of 1/2 (d log S_aa)^2 + (d r_a)^2 / S_aa
(Gauss-Newton: the expected information, with the components taken alone).  A weak prior, of a factor `PRIOR`, holds what no row determines.
The variance is that of the inverse Hessian, larger where the scores of rows near in time agree: means over batches of growing length
(Flegal and Jones, 2010) are held against rows taken alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from leadline.calibrate.knobs import Knob
    from leadline.calibrate.likelihood import Inside, Looked, Recording
    from leadline.data.records import Array
    from leadline.estimate.events import Integers

PRIOR = np.log(10.0)  # sigma of the weak prior of each logarithm
STEP = 0.02  # of the logarithms, in differences: 1e-4 of the estimate's own scale
LONGEST = 1.0  # step of scoring
FARTHEST = np.log(100.0)
GATES = (8.0, 4.0, 2.0, 1.0)  # times the gates of the file, in sigma, while the start is sought
ROUNDS = 4  # of the gates being judged anew
CLOSE = 0.02  # steps that matter no more, in sigmas of the estimate
FEWEST_BATCHES = 20
SIGNIFICANT = 2.0  # sigmas by which agreement in time must show


@dataclass
class Fit:
    """Logarithms (k,) of the ratios to the file, their covariance (k, k), and by how much (k,) correlation in time enlarged sigma.

    inside: by log, the rows that were used.  scores: of rows that were used (n, k), in order of time within each log.
    """

    recordings: Sequence[Recording]
    knobs: Sequence[Knob]
    told: Callable[[], None] = lambda: None
    theta: Array = field(default_factory=lambda: np.zeros(0))
    inside: list[Inside] = field(default_factory=list)
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    enlarged: Array = field(default_factory=lambda: np.zeros(0))

    def fit(self) -> Fit:
        """Find a start that outliers do not move, then maximise with what lies inside the gates until that stays; returns itself."""
        self.theta = np.zeros(len(self.knobs))
        self._start()
        for _ in range(ROUNDS):
            before = [inside.rows for inside in self.inside]
            self.judge()
            if before and all((b == i.rows).all() for b, i in zip(before, self.inside, strict=True)):
                break
            self.theta, moved = self.maximise(self.theta)
            if moved < CLOSE:
                break
        self.theta, _ = self.maximise(self.theta)
        self._spread()
        return self

    def looked(self, theta: Array) -> list[Looked]:
        """Run all logs."""
        found = [recording.run(np.exp(theta)) for recording in self.recordings]
        self.told()
        return found

    def judge(self) -> None:
        """Let the gates of the file say which rows are inside at the sigmas found so far."""
        self.inside = [recording.judge(np.exp(self.theta)) for recording in self.recordings]
        self.told()

    def value(self, theta: Array) -> float:
        """Log-likelihood with the weak prior."""
        return float(sum(part.sum() for part in self._by_row(self.looked(theta))) - 0.5 * np.sum((theta / PRIOR) ** 2))

    def _by_row(self, found: list[Looked]) -> list[Array]:
        return [r.by_row(f, i) for r, f, i in zip(self.recordings, found, self.inside, strict=True)]

    def _start(self) -> None:
        """Move sigmas to where the median of what is looked at is as large as it should be, with gates that narrow."""
        from scipy.special import gammaincinv

        for times in GATES:
            for recording in self.recordings:
                recording.free()
                recording.widen(times)
            found = self.looked(self.theta)
            for k, knob in enumerate(self.knobs):
                if knob.process:
                    continue
                parts = [
                    f.nis[mine] / (2.0 * gammaincinv(0.5 * r.dof[mine], 0.5))
                    for r, f in zip(self.recordings, found, strict=True)
                    if (mine := np.isin(r.slot, knob.slots) & np.isfinite(f.nis)).any()
                ]
                if parts and (middle := float(np.median(np.concatenate(parts)))) > 0.0:
                    self.theta[k] = np.clip(self.theta[k] + 0.5 * np.log(middle), -FARTHEST, FARTHEST)

    def maximise(self, theta: Array, held: int | None = None) -> tuple[Array, float]:
        """Return where the likelihood is greatest (one parameter may be held), and how far that was, in sigmas."""
        free = np.array([k for k in range(len(theta)) if k != held], int)
        start, best, value = theta, theta.copy(), self.value(theta)
        information = np.eye(len(free))
        for _ in range(12):
            scores, information = self._scored(best, free)
            step = np.linalg.solve(information, scores)
            if np.sqrt(step @ information @ step) < CLOSE:
                break
            step *= min(1.0, LONGEST / np.abs(step).max())
            for _ in range(6):
                tried = best.copy()
                tried[free] = np.clip(best[free] + step, -FARTHEST, FARTHEST)
                if (found := self.value(tried)) >= value:
                    break
                step *= 0.3
            else:
                break
            best, value = tried, found
        moved = (best - start)[free]
        return best, float(np.sqrt(moved @ information @ moved))

    def _scored(self, theta: Array, free: Integers) -> tuple[Array, Array]:
        """Score (k,) and Gauss-Newton information (k, k) at theta, of the free parameters."""
        score, slopes = -theta[free] / PRIOR**2, []
        for i, k in enumerate(free):
            high, low = (self.looked(self._moved(theta, (k, side))) for side in (STEP, -STEP))
            score[i] += sum((a - b).sum() for a, b in zip(self._by_row(high), self._by_row(low), strict=True)) / (2.0 * STEP)
            slopes.append(np.concatenate([self._slope(*of) for of in zip(high, low, self.inside, strict=True)]))
        along = np.array(slopes)
        return score, along @ along.T + np.eye(len(free)) / PRIOR**2

    @staticmethod
    def _slope(high: Looked, low: Looked, inside: Inside) -> Array:
        """Of each component inside, the change of log S over root 2, then that of the residual over root S."""
        up, down = high.sigma[inside.rows], low.sigma[inside.rows]
        spread = np.sqrt(2.0) * np.log(up / down)
        moved = (high.residual[inside.rows] - low.residual[inside.rows]) / np.sqrt(up * down)
        return np.asarray(np.nan_to_num(np.concatenate([spread, moved])).ravel() / (2.0 * STEP))

    @staticmethod
    def _moved(theta: Array, *steps: tuple[int, float]) -> Array:
        moved = theta.copy()
        for k, by in steps:
            moved[k] += by
        return moved

    def _spread(self) -> None:
        """Covariance at the estimate: inverse Hessian, enlarged where the influences of rows near in time agree."""
        count, theta = len(self.theta), self.theta
        middle, sides, scores = self.value(theta), np.zeros((count, 2)), []
        for k in range(count):
            found = [self._by_row(self.looked(self._moved(theta, (k, side)))) for side in (STEP, -STEP)]
            sides[k] = [sum(part.sum() for part in f) - 0.5 * np.sum((self._moved(theta, (k, s)) / PRIOR) ** 2) for f, s in
                        zip(found, (STEP, -STEP), strict=True)]  # fmt: skip
            scores.append([(a - b) / (2.0 * STEP) for a, b in zip(*found, strict=True)])
        hessian = np.diag((2.0 * middle - sides.sum(axis=1)) / STEP**2)
        for i in range(count):
            for j in range(i):
                both = sum(self.value(self._moved(theta, (i, side), (j, side))) for side in (STEP, -STEP))
                hessian[i, j] = hessian[j, i] = -(both - sides[i].sum() - sides[j].sum() + 2.0 * middle) / (2.0 * STEP**2)
        if not (np.linalg.eigvalsh(hessian) > 0.0).all():
            _, hessian = self._scored(theta, np.arange(count))
        inverse = np.linalg.inv(hessian)
        influences = [np.array([s[log] for s in scores]).T[inside.rows] @ inverse for log, inside in enumerate(self.inside)]
        own = np.diag(inverse)
        self.enlarged = np.sqrt([max(1.0, _of_time([f[:, k] for f in influences], own[k])) for k in range(count)])
        self.covariance = inverse * np.outer(self.enlarged, self.enlarged)


def _of_time(influences: Sequence[Array], own: float) -> float:
    """Variance of a sum of influences (n,), a sequence per log, over `own`: the largest that batches of growing length show for certain."""
    largest, length = 0.0, 1
    while True:
        sums = np.concatenate([_batches(part, length) for part in influences])
        if len(sums) < FEWEST_BATCHES:
            return largest
        square = sums**2
        total = square.sum() * sum(len(part) for part in influences) / (length * len(sums))
        doubt = np.sqrt(max(0.0, (square**2).sum() - square.sum() ** 2 / len(sums))) / max(square.sum(), 1e-300)
        if total / own > 1.0 + SIGNIFICANT * doubt:
            largest = max(largest, total / own)
        length *= 2


def _batches(values: Array, length: int) -> Array:
    """Sums of so many values in a row; what is left over is left out."""
    whole = len(values) // length * length
    return np.asarray(values[:whole].reshape(-1, length).sum(axis=1))
