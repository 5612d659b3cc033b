"""Textbook sigma-point filters in plain NumPy: the scaled unscented transform with its weights as published, any layout, with clones.

It shares with the package the stream of events, the configuration and, as black boxes, f and h: the `step` and `noise` of a process
model and the `predict` of a sensor.  Retraction and difference, roots, weights, moments, gains, gate and clones are its own.

    W0m = l / (n + l)    W0c = W0m + 1 - alpha^2 + beta    Wi = 1 / 2(n + l)    l = alpha^2 (n + kappa) - n
Source: Wan and van der Merwe (2000), algorithm 3.1; cubature: alpha = 1, beta = kappa = 0.  Where it leaves the book: the mean is taken
once, in the tangent space of the moved mean, and points of the noise stand about the estimate before the step (see the package).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, pi, sqrt

import numpy as np
from scipy.stats import chi2
from twin import Pose, matrix_of

from leadline.core.compiled import COMPONENTS, NUISANCES, WIDE
from leadline.estimate.composition import Composition
from leadline.estimate.events import Events
from leadline.estimate.navigator import Navigator
from leadline.estimate.plan import IS_CLONE, IS_DROP, IS_INPUT, IS_OUTPUT
from leadline.models.layout import INPUTS, NOW_U, Block
from leadline.models.view import QUATERNION_V, RATE_T, RATE_VARIANCE_V, TANGENT, VIEW_SIZE

CLONE_NUMBERS, CLONE_ERRORS = 9, 6


def multiplied(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton's product."""
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def turned(vector: np.ndarray) -> np.ndarray:
    """Quaternion of a rotation vector."""
    half = 0.5 * sqrt(vector @ vector)
    return np.array([np.cos(half), *(0.5 * np.sinc(half / pi) * vector)])


def turning(q: np.ndarray) -> np.ndarray:
    """Rotation vector of a quaternion, the shorter way."""
    q = q if q[0] >= 0.0 else -q
    sine = sqrt(q[1:] @ q[1:])
    return q[1:] * (2.0 * np.arctan2(sine, q[0]) / sine if sine > 1e-9 else 2.0)


def curved(place: np.ndarray) -> np.ndarray:
    """Turning of the navigation frame (its axes 1 and 2) by a level metre, (2, 2), at a place of five numbers."""
    return Pose(matrix_of(place[:4]), float(place[4]), np.eye(3)).turning[:2, :2]


def moved(place: np.ndarray, d: np.ndarray) -> np.ndarray:
    """A place moved by metres along its navigation frame."""
    q = multiplied(place[:4], turned(np.array([*(curved(place) @ d[:2]), 0.0])))
    return np.array([*(q / np.linalg.norm(q)), place[4] - d[2]])


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Metres along the navigation frame of b that lead from it to a."""
    way = turning(multiplied(b[:4] * [1.0, -1.0, -1.0, -1.0], a[:4]))
    return np.array([*np.linalg.solve(curved(b), way[:2]), b[4] - a[4]])


def root_of(P: np.ndarray) -> np.ndarray:
    """Lower triangular root, semidefinite matrices included: a column is zero where nothing is left of a direction."""
    n, rest = len(P), P.copy()
    L = np.zeros((n, n))
    for k in range(n):
        if rest[k, k] > 1e-12 * P[k, k]:
            L[k:, k] = rest[k:, k] / sqrt(rest[k, k])
            rest[k:, k:] -= np.outer(L[k:, k], L[k:, k])
    return L


@dataclass(frozen=True)
class Spread:
    """Settings of a scaled unscented transform; kappa None: 3 - n."""

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float | None = None
    augmented: bool = False
    slopes: bool = False  # move by Jacobians, correct by points

    def weights(self, n: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Distance of points in sigmas, and the weights of means and covariances (2 n + 1,)."""
        scaled = self.alpha**2 * (3.0 if self.kappa is None else n + self.kappa)
        mean = np.full(2 * n + 1, 0.5 / scaled)
        mean[0] = (scaled - n) / scaled
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return sqrt(scaled), mean, covariance


CUBATURE = Spread(1.0, 0.0, 0.0)


class SigmaTwin:
    """The filter: `run` consumes events; x, P and the clones are its state."""

    def __init__(self, navigator: Navigator, spread: Spread, P: np.ndarray | None = None) -> None:
        """Start where the navigator starts; P: the covariance, where the navigator's own is kept as something else."""
        self.composition: Composition = navigator.composition
        self.layout, self.process, self.spread = self.composition.layout, self.composition.process, spread
        n = self.layout.fixed
        values = navigator.state[self.layout.x]
        self.x = values[: self.layout.motion_nominal + len(self.layout.nuisances)].copy()
        self.P = navigator.state[self.layout.covariance].reshape(-1, WIDE)[:n, :n].copy() if P is None else P.copy()
        self.time, self.input, self.memory = navigator.time, np.zeros(INPUTS), np.zeros(WIDE * WIDE)
        self.clones: list[tuple[float, np.ndarray]] = []  # in slots; a free one below a living one has a time that is not a number
        self.gates = [chi2.ppf(s.gate_probability, len(s.channel.components)) for s in self.composition.slots]
        self.nis: list[float] = []

    # The manifold

    def retract(self, x: np.ndarray, d: np.ndarray) -> np.ndarray:
        """X [+] d, clones included."""
        parts, at, e = [], 0, 0
        for part in self.process.parts:
            here, by = x[at : at + part.nominal], d[e : e + part.size]
            parts.append(self._moved(part.block, here, by))
            at, e = at + part.nominal, e + part.size
        k = len(self.layout.nuisances)
        parts.append(x[at : at + k] + d[e : e + k])
        at, e = at + k, e + k
        while at < len(x):
            parts.append(moved(x[at : at + 5], d[e : e + 3]))
            parts.append(multiplied(turned(d[e + 3 : e + 6]), x[at + 5 : at + 9]))
            at, e = at + CLONE_NUMBERS, e + CLONE_ERRORS
        return np.concatenate(parts)

    @staticmethod
    def _moved(block: Block, here: np.ndarray, by: np.ndarray) -> np.ndarray:
        if block is Block.PLACE:
            return moved(here, by)
        return multiplied(turned(by), here) if block is Block.ATTITUDE else here + by

    def difference(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """X [-] y for motion, nuisances and clones."""
        parts, at = [], 0
        for part in self.process.parts:
            a, b = x[at : at + part.nominal], y[at : at + part.nominal]
            if part.block is Block.PLACE:
                parts.append(apart(a, b))
            else:
                parts.append(turning(multiplied(a, b * [1.0, -1.0, -1.0, -1.0])) if part.block is Block.ATTITUDE else a - b)
            at += part.nominal
        k = len(self.layout.nuisances)
        parts.append(x[at : at + k] - y[at : at + k])
        for first in range(at + k, len(x), CLONE_NUMBERS):
            a, b = x[first : first + 9], y[first : first + 9]
            parts += [apart(a[:5], b[:5]), turning(multiplied(a[5:], b[5:] * [1.0, -1.0, -1.0, -1.0]))]
        return np.concatenate(parts)

    @property
    def whole(self) -> np.ndarray:
        """Motion, nuisances and the slots of clones."""
        return np.concatenate([self.x, *(pose for _, pose in self.clones)])

    @whole.setter
    def whole(self, x: np.ndarray) -> None:
        fixed = len(self.x)
        self.x = x[:fixed]
        self.clones = [(time, x[fixed + 9 * k :][:9]) for k, (time, _) in enumerate(self.clones)]

    # Time

    def run(self, events: Events) -> list[int]:
        """Consume all events; returns the outcome of each measurement."""
        outcomes = []
        for time, kind, first, last in zip(events.time, events.kind, events.start, events.stop, strict=True):
            if kind == IS_OUTPUT:
                continue
            row = events.data[first:last]
            self.advance(time)
            if kind == IS_INPUT:
                self.input = np.array([*row[:INPUTS], *np.zeros(INPUTS - len(row[:INPUTS]))])
            elif kind == IS_CLONE:
                self.clone()
            elif kind == IS_DROP:
                self.drop(row[0])
            else:
                outcomes.append(self.update(int(kind), row))
        return outcomes

    def advance(self, time: float) -> None:
        """Propagate, in steps as the process model allows."""
        longest = self.process.longest_step
        while self.time < time:
            dt = min(time - self.time, longest)
            self.propagate(dt)
            self.time = time if dt < longest else self.time + longest

    def moved_on(self, x: np.ndarray, dt: float) -> np.ndarray:
        """What f makes of a point."""
        y, u = x.copy(), self.input.copy()
        u[NOW_U] = self.time
        self.process.step(y, u, dt, self.process.parameters, self.memory)
        first = self.layout.motion_nominal
        for i, nuisance in enumerate(self.layout.nuisances):
            if nuisance.tau < inf:
                y[first + i] = nuisance.value + (x[first + i] - nuisance.value) * exp(-dt / nuisance.tau)
        return y

    def noise(self, dt: float) -> np.ndarray:
        """Q of the motion, of what the last step left."""
        Q = np.zeros(WIDE * WIDE)
        self.process.noise(self.memory, dt, self.process.parameters, Q)
        m = self.layout.motion_error
        return Q.reshape(WIDE, WIDE)[:m, :m]

    def propagate(self, dt: float) -> None:
        """State and covariance over a step."""
        x, n, m = self.whole, len(self.P), self.layout.motion_error
        centre = self.moved_on(x, dt)
        Q, driven = np.zeros((n, n)), self.noise(dt)
        for i, nuisance in enumerate(self.layout.nuisances):
            decayed = nuisance.steady**2 * (1.0 - exp(-2.0 * dt / nuisance.tau)) if nuisance.tau < inf else nuisance.walk**2 * dt
            Q[m + i, m + i] = decayed
        if self.spread.slopes:
            Phi = self.slope(dt)
            Q[:m, :m] += driven
            self.whole, self.P = centre, Phi @ self.P @ Phi.T + Q
            return
        columns = root_of(self.P).T
        if self.spread.augmented:
            own = root_of(driven)
            columns = np.vstack([columns, np.pad(own[:, own.any(axis=0)].T, ((0, 0), (0, n - m)))])
        else:
            Q[:m, :m] += driven
        g, w_mean, w_cov = self.spread.weights(len(columns))
        points = [x, *(self.retract(x, s * g * column) for column in columns for s in (1.0, -1.0))]
        deltas = np.array([self.difference(self.moved_on(point, dt), centre) for point in points])
        mu = w_mean @ deltas
        self.whole = self.retract(centre, mu)
        self.P = (w_cov[:, None] * (deltas - mu)).T @ (deltas - mu) + Q

    def slope(self, dt: float) -> np.ndarray:
        """Analytic transition, as the process model states it, of what the last step left."""
        n, m = len(self.P), self.layout.motion_error
        A = np.zeros(WIDE * WIDE)
        self.process.push(self.memory, dt, self.process.parameters, np.eye(WIDE).ravel(), A, WIDE)
        Phi = np.eye(n)
        Phi[:m, :m] = A.reshape(WIDE, WIDE)[:m, :m]
        for i, nuisance in enumerate(self.layout.nuisances):
            Phi[m + i, m + i] = exp(-dt / nuisance.tau) if nuisance.tau < inf else 1.0
        return Phi

    # Clones

    def clone(self) -> None:
        """Put the pose of now into the first free slot."""
        k = next((k for k, (time, _) in enumerate(self.clones) if np.isnan(time)), len(self.clones))
        place, attitude = self.layout.nominal_of("position"), self.layout.nominal_of("attitude")
        errors = np.r_[self.layout.error_of("position"), self.layout.error_of("attitude")]
        n = max(len(self.P), self.layout.fixed + CLONE_ERRORS * (k + 1))
        first = self.layout.fixed + CLONE_ERRORS * k
        J = np.eye(n, len(self.P))
        J[first : first + 6] = np.eye(len(self.P))[errors]
        self.P = J @ self.P @ J.T
        self.clones[k : k + 1] = [(self.time, np.concatenate([self.x[place], self.x[attitude]]))]

    def drop(self, epoch: float) -> None:
        """Forget a clone: nothing is left of its errors; slots at the end that are free are given up."""
        k = [time for time, _ in self.clones].index(epoch)
        gone = slice(self.layout.fixed + CLONE_ERRORS * k, self.layout.fixed + CLONE_ERRORS * (k + 1))
        self.P[gone], self.P[:, gone] = 0.0, 0.0
        self.clones[k] = (np.nan, self.clones[k][1])
        while self.clones and np.isnan(self.clones[-1][0]):
            self.clones.pop()
            self.P = self.P[:-CLONE_ERRORS, :-CLONE_ERRORS]

    # Measurements

    def predicted(self, x: np.ndarray, kind: int, row: np.ndarray) -> tuple[int, np.ndarray, np.ndarray]:
        """Outcome, value (c,) and covariance (c, c) that a sensor gives at a point."""
        channel = self.composition.slots[kind].channel
        views, nuisance, z = np.zeros(2 * VIEW_SIZE), np.zeros(NUISANCES), np.zeros(COMPONENTS)
        u = self.input.copy()
        u[NOW_U] = self.time
        self.process.view(x, u, self.process.parameters, views[:VIEW_SIZE])
        if channel.epochs == 2:
            k = [time for time, _ in self.clones].index(row[-1])
            pose = x[len(self.x) + CLONE_NUMBERS * k :][:CLONE_NUMBERS]
            views[VIEW_SIZE : VIEW_SIZE + 5], views[VIEW_SIZE + QUATERNION_V :][:4] = pose[:5], pose[5:]
        names = [n.name for n in self.layout.nuisances]
        for i, n in enumerate(channel.nuisances):
            nuisance[i] = x[self.layout.motion_nominal + names.index(n.name)] if n.name in names else n.value
        R, Hv, Hn = np.zeros((COMPONENTS, COMPONENTS)), np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
        parameters = np.array([*channel.parameters, 0.0])
        outcome = channel.predict(views, nuisance, np.ascontiguousarray(row), parameters, z, R, Hv, Hn)
        c = len(channel.components)
        J = Hv[:c, RATE_T : RATE_T + 3]
        return outcome, z[:c].copy(), R[:c, :c] + views[RATE_VARIANCE_V] * J @ J.T

    def wrapped(self, kind: int, values: np.ndarray) -> np.ndarray:
        """Bring components that are angles to within half a turn."""
        angles = self.composition.slots[kind].channel.angles
        which = np.array([*angles, *[False] * (values.shape[-1] - len(angles))])
        return np.where(which, (values + pi) % (2 * pi) - pi, values)

    def update(self, kind: int, row: np.ndarray) -> int:
        """Moments of what the points predict, gate, correction."""
        x, columns = self.whole, root_of(self.P).T
        g, w_mean, w_cov = self.spread.weights(len(columns))
        steps = np.array([np.zeros(len(self.P)), *(s * g * column for column in columns for s in (1.0, -1.0))])
        found = [self.predicted(self.retract(x, d) if d.any() else x, kind, row) for d in steps]
        if any(outcome for outcome, _, _ in found):
            return 2
        centre, R = found[0][1], found[0][2]
        values = self.wrapped(kind, np.array([z for _, z, _ in found]) - centre)
        mu = w_mean @ values
        residual = self.wrapped(kind, row[: len(centre)] - centre - mu)
        S = (w_cov[:, None] * (values - mu)).T @ (values - mu) + R
        cross = (w_cov[:, None] * steps).T @ (values - mu)
        self.nis.append(float(residual @ np.linalg.solve(S, residual)))
        if self.nis[-1] >= self.gates[kind]:
            return 1
        K = np.linalg.solve(S, cross.T).T
        self.whole, self.P = self.retract(x, K @ residual), self.P - K @ S @ K.T
        return 0
