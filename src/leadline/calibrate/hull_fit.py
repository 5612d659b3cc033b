"""Fitting a hull to a log by output error: stretches of the log are run again (replay.py), and what instruments would have said is held
against what they said.

Unknown are the numbers x of the hull (hull_knobs.py) and of each stretch its start b: velocity, rates, attitude and depth.  Minimised is

    sum rho(r / sigma) + x^T P0^-1 x / 2 + sum (b - b0)^T B0^-1 (b - b0) / 2

with Huber's rho, by Gauss and Newton with the damping of Levenberg and Marquardt; the starts are eliminated stretch by stretch.  No
noisy velocity stands in a regressor, so that noise does not pull drag towards zero, as it does a regression (Jategaonkar, 2015,
chapters 4 and 6).  Short stretches come first: from a wrong hull a long one would end far from where the vehicle went.
Sigmas are those of the residuals, widened where these are correlated in time, and once more where the scores of whole stretches scatter
more than the information says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.calibrate.hull_knobs import MOST, current_of, prior_information
from leadline.calibrate.hull_problem import BEGIN, BEGIN_SIGMA, between, problem_of
from leadline.core.attitude import conjugate, exponential, logarithm, product

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.calibrate.hull_knobs import Knob
    from leadline.calibrate.hull_problem import Index, Problem
    from leadline.calibrate.motion_data import Recorded
    from leadline.data.hull import Hull
    from leadline.data.records import Array

LENGTHS = (2.0, 4.0, 8.0)  # s of a stretch: short ones first
STRAY = 0.01  # m/s of residual below which velocities do not count as straying
MOVES = 0.3  # of the change of an angle within stretches that the fit must explain for its damping to be shown
HUBER = 3.0  # sigmas beyond which a residual counts less
ROUNDS, TRIALS = 15, 6
ENOUGH, NEARLY = 0.02, 0.6  # sigmas: a step that ends the search, and that over short stretches


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found: x, its covariance, the starts, sigma of each group of residuals, and data information about x."""

    problem: Problem
    x: Array
    covariance: Array
    information: Array
    begin: Array
    sigma: Array
    widened: float  # factor by which sigmas were widened for the scatter of whole stretches
    stray: float  # the same for velocities that stray from the motion run again for longer than their noise does
    rounds: int
    converged: bool
    pinned: tuple[Knob, ...] = ()  # numbers that ended at a bound, and were left out


def fit(data: Recorded, hull: Hull, knobs: tuple[Knob, ...], density: float, progress: Callable[[float], None] = lambda _: None) -> Fit:
    """Find the numbers of a hull; `progress` is told the fraction done, roughly.  Raises InputError for a log that is too short."""
    problems = [problem_of(data, hull, knobs, density, length) for length in reversed(LENGTHS)][::-1]
    share = 1 / len(problems)
    found = settle(problems[0], np.zeros(len(knobs)), problems[0].guess, _part(progress, 0.0, share), final=False)
    for k, problem in enumerate(problems[1:], 1):
        tell = _part(progress, k * share, share)
        found = settle(problem, found.x, handed_on(found, problem), tell, final=problem is problems[-1])
    return without_pinned(found, progress)


def without_pinned(found: Fit, progress: Callable[[float], None]) -> Fit:
    """Fit once more without the numbers that the log does not show, which stay those of the starting hull.

    Those are the ones that ended at a bound, and the damping of a rotation that hardly takes place: there free starts follow the noise,
    and the less damping the better they do.
    """
    problem = found.problem
    still = [3 + axis for axis, share in enumerate(explained(found, "attitude")) if share < MOVES]
    loose = np.array([
        knob.least + 1e-6 < v and not (knob.part in ("linear", "quadratic") and knob.index in still)
        for knob, v in zip(problem.knobs, found.x, strict=True)
    ])  # fmt: skip
    if np.all(loose) or not np.any(loose):
        return found
    pinned = tuple(knob for knob, free in zip(problem.knobs, loose, strict=True) if not free)
    rest = replace(problem, knobs=tuple(knob for knob, free in zip(problem.knobs, loose, strict=True) if free))
    again = settle(rest, found.x[loose], found.begin, _part(progress, 0.8, 0.2))
    more = without_pinned(again, progress)
    return replace(more, pinned=pinned + more.pinned)


def explained(found: Fit, quantity: str) -> list[float]:
    """Return what share of the change within stretches the fit explains, for each component of the first channel of a quantity."""
    problem = found.problem
    rows = next(rows for rows in problem.rows if rows.channel.quantity == quantity)
    states, current = problem.states(found.x, found.begin), current_of(problem.knobs, found.x)
    resting = np.broadcast_to(states.mean(axis=1, keepdims=True), states.shape)
    left, still = (np.mean(rows.channel.residual(rows.index, *between(s, rows), current) ** 2, axis=0) for s in (states, resting))
    return [float(1 - a / max(b, 1e-300)) for a, b in zip(left, still, strict=True)]


def _part(progress: Callable[[float], None], done: float, share: float) -> Callable[[float], None]:
    return lambda part: progress(done + share * part)


def handed_on(found: Fit, problem: Problem) -> Array:
    """Return first guesses of starts (stretches, BEGIN): what shorter stretches that began at the same time were found to begin with."""
    begin = problem.guess.copy()
    same = np.minimum(np.searchsorted(found.problem.begins, problem.begins - 1e-6), len(found.begin) - 1)
    for s in np.flatnonzero(np.abs(found.problem.begins[same] - problem.begins) < 1e-6):
        old = found.problem.reference[same[s]]
        turn = product(conjugate(problem.reference[s]), product(old, exponential(found.begin[same[s], 6:9])))
        begin[s] = found.begin[same[s]]
        begin[s, 6:9] = logarithm(turn)
    return begin


def settle(problem: Problem, x: Array, begin: Array, progress: Callable[[float], None], *, final: bool = True) -> Fit:
    """Find the numbers from first guesses of them and of the starts; final: to the end, and with the correlation of residuals."""
    prior = prior_information(problem.hull, problem.knobs)
    damping, moved, colour, rounds = 1e-2, np.inf, np.ones(len(problem.floor)), 0
    for again in range(2 if final else 1):  # once more with the sigmas that correlation leaves
        for _ in range(ROUNDS):
            base = problem.residuals(x, begin)
            system = System(problem, prior, spread_of(problem, base) * np.sqrt(colour), x, begin, base)
            x, begin, damping, moved = _descend(system, damping)
            rounds += 1
            progress(0.5 * again + 0.5 - 0.5 * 0.7**rounds if final else 1 - 0.7**rounds)
            if moved < (ENOUGH if final else NEARLY):
                break
        if final:
            colour = colours(problem, problem.residuals(x, begin))
    base = problem.residuals(x, begin)
    sigma = spread_of(problem, base) * np.sqrt(colour)
    system = System(problem, prior, sigma, x, begin, base)
    stray = unrest(problem, base)
    covariance, widened = system.covariance(stray)
    return Fit(problem, x, covariance, system.data, begin, sigma, widened, stray, rounds, moved < ENOUGH)


def _descend(system: System, damping: float) -> tuple[Array, Array, float, float]:
    """Return x and starts after a step that lowers the cost, the damping, and the length of the step in sigmas (0: none was found)."""
    cost = system.cost(system.x, system.begin, system.base)
    least = np.array([knob.least for knob in system.problem.knobs])
    for _ in range(TRIALS):
        dx, db = system.step(damping)
        x = np.clip(system.x + dx, least, MOST)
        begin = system.begin + db
        if system.cost(x, begin, system.problem.residuals(x, begin)) < cost:
            spread = np.sqrt(np.diag(np.linalg.inv(system.data + system.prior)))
            return x, begin, max(damping / 8, 1e-9), float(np.max(np.abs(dx) / spread))
        damping = max(damping, 1e-4) * 10
    return system.x, system.begin, damping, 0.0


def spread_of(problem: Problem, residual: Array) -> Array:
    """Return the sigma of each group of residuals: from the median of their sizes, so that outliers do not count."""
    group = problem.group
    used = len(problem.knobs) + BEGIN * len(problem.begins)
    share = np.sqrt(len(residual) / max(len(residual) - used, 1))
    sizes = [1.4826 * np.median(np.abs(residual[group == g])) if np.any(group == g) else 1.0 for g in range(len(problem.floor))]
    return np.asarray(np.maximum(share * np.array(sizes), problem.floor))


def unrest(problem: Problem, residual: Array) -> float:
    """Return by how much velocities stray from the motion run again, of their noise from row to row: about 1 in quiet water."""
    found, at = 1.0, 0
    stretch = np.concatenate([np.repeat(rows.stretch, rows.channel.width) for rows in problem.rows])
    for rows in problem.rows:
        for group in range(at, at + rows.channel.width):
            r, s = residual[problem.group == group], stretch[problem.group == group]
            if rows.channel.quantity == "velocity" and len(r) > 1:
                steps = np.diff(r)[s[1:] == s[:-1]]
                size, noise = (1.4826 * float(np.median(np.abs(v))) for v in (r, steps / np.sqrt(2)))
                found = max(found, size / noise) if size > STRAY else found
        at += rows.channel.width
    return found


def colours(problem: Problem, residual: Array) -> Array:
    """Return by how much the correlation in time lowers the worth of the rows of each group: 1 + 2 sum of autocorrelations, at least 1."""
    stretch = np.concatenate([np.repeat(rows.stretch, rows.channel.width) for rows in problem.rows])
    return np.array([_colour(residual[m], stretch[m]) for m in (problem.group == g for g in range(len(problem.floor)))])


def _colour(residual: Array, stretch: Index) -> float:
    size = 1.4826 * float(np.median(np.abs(residual))) if len(residual) else 0.0
    if size == 0.0:
        return 1.0
    r = np.clip(residual / size, -HUBER, HUBER)
    total, lags = 1.0, int(len(r) / max(len(np.unique(stretch)), 1) / 4)
    for lag in range(1, lags + 1):
        same = stretch[lag:] == stretch[:-lag]
        rho = float(np.mean((r[lag:] * r[:-lag])[same]) / np.mean(r * r))
        if rho < 0.05:
            break
        total += 2 * rho
    return total


class System:
    """The normal equations at one point."""

    def __init__(self, problem: Problem, prior: Array, sigma: Array, x: Array, begin: Array, base: Array) -> None:
        """Linearise; residuals beyond `HUBER` sigmas count less."""
        self.problem, self.prior, self.sigma, self.x, self.begin, self.base = problem, prior, sigma, x, begin, base
        order, self.bounds = problem.order
        scale = sigma[problem.group]
        root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(base / scale), 1e-12))) / scale
        by_knob, by_begin = problem.jacobians(x, begin, base)
        self.a, self.b = (by_knob * root[:, None])[order], (by_begin * root[:, None])[order]
        self.r = (base * root)[order]
        self.data, self.slope, self.scores, self.parts = self.reduced(0.0)

    def reduced(self, damping: float) -> tuple[Array, Array, Array, list[tuple[Array, Array, Array]]]:
        """Return information and slope of x with the starts eliminated, the slope of each stretch, and what gives the starts back."""
        size = len(self.x)
        data, scores, parts = np.zeros((size, size)), np.zeros((len(self.begin), size)), []
        offset = (self.begin - self.problem.guess) / BEGIN_SIGMA
        for s in range(len(self.begin)):
            rows = slice(self.bounds[s], self.bounds[s + 1])
            a, b, r = self.a[rows], self.b[rows], self.r[rows]
            own = b.T @ b + np.eye(BEGIN)
            own[np.diag_indices(BEGIN)] *= 1 + damping
            mixed, slope = b.T @ a, b.T @ r + offset[s]
            back = np.linalg.solve(own, np.column_stack([mixed, slope]))
            data += a.T @ a - mixed.T @ back[:, :-1]
            scores[s] = a.T @ r - mixed.T @ back[:, -1]
            parts.append((back[:, :-1], back[:, -1], own))
        return data, scores.sum(axis=0), scores, parts

    def step(self, damping: float) -> tuple[Array, Array]:
        """Return the step of x and of the starts."""
        data, slope, _, parts = self.reduced(damping)
        whole = data + self.prior
        whole[np.diag_indices(len(self.x))] *= 1 + damping
        dx = np.asarray(-np.linalg.solve(whole, slope + self.prior @ self.x), dtype=float)
        db = np.array([-(level + mixed @ dx) for mixed, level, _ in parts]) * BEGIN_SIGMA
        return dx, np.asarray(db, dtype=float)

    def cost(self, x: Array, begin: Array, residual: Array) -> float:
        """Return what is minimised."""
        size = np.abs(residual / self.sigma[self.problem.group])
        rho = np.where(size < HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))
        offset = (begin - self.problem.guess) / BEGIN_SIGMA
        return float(np.sum(rho) + 0.5 * x @ self.prior @ x + 0.5 * np.sum(offset**2))

    def covariance(self, stray: float) -> tuple[Array, float]:
        """Return the covariance of x, and the factor by which sigmas are widened for stretches that scatter more than they should.

        stray: how far velocities stray, of their noise; what moves them so moves them for seconds on end, and sigmas grow by as much.
        """
        root = np.linalg.cholesky(np.linalg.inv(self.prior))
        values, vectors = np.linalg.eigh(root.T @ self.data @ root)
        told = values > 1.0
        turned_scores = (self.scores - self.scores.mean(axis=0)) @ root @ vectors[:, told]
        ratio = np.sum(turned_scores**2, axis=0) / values[told] if np.any(told) else np.ones(1)
        wide = max(float(np.mean(ratio)), 1.0)
        inverse = np.linalg.inv(self.data + self.prior)
        return inverse @ (wide * stray**2 * self.data + self.prior) @ inverse, float(np.sqrt(wide))
