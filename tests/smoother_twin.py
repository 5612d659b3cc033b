"""Two dense witnesses of the smoother, on the filter's twin (tests/twin.py), written from the textbook alone.

Both work on errors about the trajectory of the filter, e = truth - estimate: metres along n, a rotation vector on the left, the rest by
difference.  A chain of links tells how errors go on: e' = A e + w over a step (A grows where a clone is made and shrinks where one is
forgotten), and e' = e - d where a row moved the estimate by d; tangent spaces before and after are taken for one, as the filter does.

`Backward`: fixed-interval smoothing by Rauch, Tung and Striebel (1965), with the whole covariance at each link.
`Batch`: weighted least squares.  All errors are one linear map of the start's error and of all that drove the chain; the rows that were
used condition these, all at once.  No recursion, so clones are nothing special, and any row can be left out.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from twin import EARTH, Twin

from leadline.estimate.plan import IS_CLONE, IS_DROP, IS_INPUT, IS_OUTPUT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from leadline.estimate.events import Events


@dataclass(frozen=True)
class Link:
    """e' = A e + w: A (m, n), covariance of w (m, m); the covariances before and after."""

    A: np.ndarray
    q: np.ndarray
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True)
class Row:
    """A measurement that was looked at: residual = H e + v, v of covariance R; the estimate was moved by `correction`."""

    number: int
    H: np.ndarray
    residual: np.ndarray
    R: np.ndarray
    correction: np.ndarray
    used: bool


@dataclass(frozen=True)
class Asked:
    """A moment at which the state is wanted: the filter there, and the link that leads there if the moment lies between epochs."""

    twin: Chain
    aside: Link | None


@dataclass(frozen=True)
class Smoothed:
    """A smoothed state: the correction (n,) of the filter's estimate, its covariance, all numbers as `Twin.x`, angular rate of the view."""

    correction: np.ndarray
    covariance: np.ndarray
    x: np.ndarray
    rate_b: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (n,)."""
        return np.sqrt(np.diag(self.covariance))


def smoothed(at: Chain, correction: np.ndarray, covariance: np.ndarray) -> Smoothed:
    """Correct the filter's estimate."""
    twin, n = deepcopy(at), 15 + len(at.names)
    d = correction[:n]
    twin.pose.corrected(d[[0, 1, 2, 6, 7, 8]])
    twin.velocity, twin.gyro_bias, twin.accel_bias = twin.velocity + d[3:6], twin.gyro_bias + d[9:12], twin.accel_bias + d[12:15]
    twin.nuisances = twin.nuisances + d[15:]
    w_in = twin.pose.en.T @ EARTH + twin.pose.turning @ twin.velocity
    rate = twin.input[0:3] - twin.gyro_bias - twin.pose.nb.T @ w_in if twin.input[6] else np.zeros(3)
    return Smoothed(d, covariance[:n, :n], twin.x, rate)


class Chain(Twin):
    """The filter's twin that keeps its chain.

    decided: by number of the measurement whether it is used, where that is not left to the gate; one that is not is not even looked at.
    """

    def run(self, events: Events, decided: Mapping[int, bool] | None = None) -> list[int]:
        """Consume all events; returns the outcome of each measurement, -1 where it was not looked at."""
        self.chain: list[Link | Row | Asked] = []
        self.start, outcomes, decided = self.P.copy(), [], decided or {}
        epochs = set(events.time[events.kind != IS_OUTPUT].tolist())
        for time, kind, first, last in zip(events.time, events.kind, events.start, events.stop, strict=True):
            row = events.data[first:last]
            if kind != IS_OUTPUT or time in epochs:
                self.advance(time)
            if kind == IS_OUTPUT:
                ahead = deepcopy(self)
                ahead.chain = []
                ahead.advance(time)
                self.chain.append(ahead)  # type: ignore[arg-type]
            elif kind == IS_INPUT:
                self.input = row.copy()
            elif kind == IS_CLONE:
                n = len(self.P)
                self._linked(self.clone, np.vstack([np.eye(n), np.eye(n)[[0, 1, 2, 6, 7, 8]]]))
            elif kind == IS_DROP:
                at = 15 + len(self.names) + 6 * [epoch for epoch, _ in self.clones].index(row[0])
                self._linked(partial(self.drop, row[0]), np.delete(np.eye(len(self.P)), np.arange(at, at + 6), axis=0))
            else:
                outcomes.append(self._judged(int(kind), row, len(outcomes), decided))
        self.chain = placed(self.chain)
        return outcomes

    def _judged(self, kind: int, row: np.ndarray, number: int, decided: Mapping[int, bool]) -> int:
        if not decided.get(number, True):
            return -1
        gates = self.gates
        self.gates = [np.inf] * len(gates) if number in decided else gates
        outcome = self.update(kind, row)
        self.gates = gates
        self.chain.append(Row(number, *self.looked, used=outcome == 0))  # type: ignore[call-arg]
        return outcome

    def propagate(self, dt: float) -> None:
        """Propagate, and note the link."""
        before = self.P
        super().propagate(dt)
        self.chain.append(Link(self.transition, self.drive, before, self.P.copy()))

    def _linked(self, change: Callable[[], None], A: np.ndarray) -> None:
        before = self.P
        change()
        self.chain.append(Link(A, np.zeros((len(A), len(A))), before, self.P.copy()))


def placed(chain: list[Any]) -> list[Link | Row | Asked]:
    """Put each moment that is asked for behind the whole steps that lead to it, which are links of the chain as well."""
    found: list[Link | Row | Asked] = []
    waiting: list[tuple[int, Chain]] = []  # how many whole steps are still to come
    for link in [*chain, None]:
        if isinstance(link, Chain):
            waiting.append((len(link.chain) - 1, link))
            continue
        found += [Asked(twin, twin.chain[-1] if twin.chain else None) for left, twin in waiting if left <= 0]
        waiting = [(left - 1, twin) for left, twin in waiting if left > 0]
        if link is not None:
            found.append(link)
    return found


def backward(chain: Chain) -> list[Smoothed]:
    """Smooth by Rauch, Tung and Striebel: G = P A^T P'^-1, d = G d', Ps = P + G (Ps' - P') G^T; no clones.

    As A is regular, G = A^-1 (I - Q P'^-1): what is inverted then weighs no more than Q, which saves the digits that P'^-1 costs.
    """
    d, Ps, found = np.zeros(len(chain.P)), chain.P.copy(), []
    later, d_later, Ps_later = None, d, Ps  # the link ahead, and what is known at its end
    for link in reversed(chain.chain):
        if isinstance(link, Asked):
            if link.aside is None:
                found.append(smoothed(link.twin, d, Ps))
                continue
            assert later is not None
            found.append(smoothed(link.twin, *between(link.aside, later, d_later, Ps_later)))
        elif isinstance(link, Row):
            d = d + link.correction
        else:
            later, d_later, Ps_later = link, d, Ps
            G = np.linalg.solve(link.A, np.eye(len(d)) - link.q @ inverse(link.after))
            d, Ps = G @ d, link.before + G @ (Ps - link.after) @ G.T
            Ps = (Ps + Ps.T) / 2
    return found[::-1]


def between(aside: Link, step: Link, d: np.ndarray, Ps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance within a step, of which part 1 led aside, from those at its end.

    What is left of the step is A_2 = A A_1^-1 and Q_2 = Q - A_2 Q_1 A_2^T; so cov(e, e') = P_1 A_2^T, and G as in `backward`.
    """
    A = step.A @ np.linalg.inv(aside.A)
    Q = step.q - A @ aside.q @ A.T
    G = np.linalg.solve(A, np.eye(len(A)) - Q @ inverse(step.after))
    return G @ d, aside.after + G @ (Ps - step.after) @ G.T


def inverse(P: np.ndarray) -> np.ndarray:
    """Inverse of a covariance, by way of its correlations."""
    unit = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    return np.linalg.inv(P / unit) / unit


class Batch:
    """Weighted least squares over a chain.  u: standard normal, of the start and of what drives the chain; e = M u + c at each link."""

    def __init__(self, chain: Chain) -> None:
        """Follow the chain forward, and keep what e (at outputs) and H e (at rows) are made of: `gram`, the covariance of all of them."""
        self.chain, self.c, self.part, self.step = chain, {}, {}, {}  # by place in the chain
        n = len(chain.start)
        size = n + sum(int((np.diag(link.q) > 0).sum()) for link in chain.chain if isinstance(link, Link))
        M, c, taken, kept, count = np.zeros((n, size)), np.zeros(n), n, [], 0
        M[:, :n] = np.linalg.cholesky(chain.start)
        waiting: list[int] = []  # places of moments within the next step: e at its end says what they are
        for k, link in enumerate(chain.chain):
            if isinstance(link, Asked) and link.aside is not None:
                waiting.append(k)
                continue
            if isinstance(link, Link):
                grown = np.zeros((len(link.A), size))
                grown[:, :taken] = link.A @ M[:, :taken]
                driven = np.flatnonzero(np.diag(link.q) > 0)
                grown[np.ix_(driven, taken + np.arange(len(driven)))] = np.linalg.cholesky(link.q[np.ix_(driven, driven)])
                M, c, taken = grown, link.A @ c, taken + len(driven)
                self.step |= dict.fromkeys(waiting, link)
            H = link.H if isinstance(link, Row) else np.eye(len(M))
            for place in waiting if isinstance(link, Link) else [k]:
                kept.append(H @ M)
                self.c[place], self.part[place] = H @ c, np.arange(count, count + len(H))
                count += len(H)
            if isinstance(link, Link):
                waiting = []
            elif isinstance(link, Row):
                c = c - link.correction
        every = np.vstack(kept)
        self.gram = every @ every.T

    def conditioned(self, wanted: int, without: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of e (or H e) at a place of the chain, given all rows that were used, but for one."""
        rows = [(k, row) for k, row in enumerate(self.chain.chain) if isinstance(row, Row) and row.used and k != without]
        given, part = np.concatenate([self.part[k] for k, _ in rows]), self.part[wanted]
        y = np.concatenate([row.residual - self.c[k] for k, row in rows])
        factor = cho_factor(self.gram[np.ix_(given, given)] + block_diag(*(row.R for _, row in rows)))
        cross = self.gram[np.ix_(part, given)]
        return self.c[wanted] + cross @ cho_solve(factor, y), self.gram[np.ix_(part, part)] - cross @ cho_solve(factor, cross.T)

    def smoothed(self) -> list[Smoothed]:
        """Smoothed states at all outputs."""
        found = []
        for k, link in enumerate(self.chain.chain):
            if isinstance(link, Asked):
                known = self.conditioned(k)
                found.append(smoothed(link.twin, *(known if link.aside is None else between(link.aside, self.step[k], *known))))
        return found

    def against_others(self, k: int) -> float:
        """Normalised squared residual of the row at a place against all other rows that were used."""
        row = self.chain.chain[k]
        assert isinstance(row, Row)
        mean, covariance = self.conditioned(k, without=k)
        gap = row.residual - mean
        return float(gap @ np.linalg.solve(covariance + row.R, gap))
