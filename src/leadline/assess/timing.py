"""Stamps against truth: a heading whose error goes with the turning is right, but at another time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.assess.happenings import Happening
from leadline.core import attitude

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.assess.errors import Errors
    from leadline.data.records import Truth
    from leadline.data.solution import Solution

LONGEST, DENSE = 2.0, 0.5  # s between rows of truth that are compared, and between states that tell a rate of turn
LEAST = 1e-3  # s; less is nobody's trouble
SIGMAS, SHARE = 6.0, 0.1  # how certain, and how much of the heading error's changes it must explain
FEWEST = 30  # changes


class Lead(NamedTuple):
    """How far (s) the estimated heading is ahead of truth, its sigma, and the share of the heading error's changes that it explains."""

    ahead: float
    sigma: float
    share: float


def heading_lead(errors: Errors, solution: Solution, truth: Truth) -> Lead | None:
    """Return how far the estimated heading is ahead of truth in time; None where truth or states are too few.

    A heading that is d seconds ahead is off by -d times the rate of turn.  Changes of both from row to row of truth are compared, so
    that a constant error, and one that grows slowly, play no part.  The rate is the estimate's, which is dense; but what a correction
    does to it is error as well, so the rate between rows of truth serves as instrument: d = -(z . e) / (z . r).
    """
    if min(len(errors), len(solution)) < FEWEST or truth.heading is None:
        return None
    time, heading = solution.time, np.unwrap(attitude.euler_from_quaternion(solution.quaternion_nb)[2])
    spacing = np.interp(errors.time, time[1:], np.diff(time))
    rate = np.where(spacing <= DENSE, np.interp(errors.time, time, np.gradient(heading, time)), np.nan)
    known = np.flatnonzero(np.isfinite(truth.heading) & np.isin(truth.time, errors.time))
    moments, first = np.unique(truth.time[known], return_index=True)
    if len(moments) < FEWEST:
        return None
    true = np.gradient(np.unwrap(truth.heading[known[first]]), moments)
    instrument = np.interp(errors.time, moments, true)
    e, r, z = np.diff(errors.error[:, 8]), np.diff(rate), np.diff(instrument)
    good = (np.diff(errors.time) <= LONGEST) & np.isfinite(e) & np.isfinite(r)
    e, r, z = e[good], r[good], z[good]
    together, size, total = float(np.sum(z * r)), float(np.sum(z**2)), float(np.sum(e**2))
    if len(e) < FEWEST or not together > 0.0 or not total > 0.0:
        return None
    along = float(np.sum(z * e))
    ahead = -along / together
    left = float(np.sum((e + ahead * r) ** 2))
    return Lead(ahead, float(np.sqrt(left / (len(e) - 1) * size)) / together, along**2 / (size * total))


def timing(errors: Errors, solution: Solution, truth: Truth) -> Iterator[Happening]:
    """Yield what the stamps are found to be off by (kind: timing)."""
    found = heading_lead(errors, solution, truth)
    if found is None or abs(found.ahead) < max(LEAST, SIGMAS * found.sigma) or found.share < SHARE:
        return
    way = "ahead of" if found.ahead > 0.0 else "behind"
    sentence = (
        f"heading runs {way} truth by {abs(1e3 * found.ahead):.1f} ms of turning (sigma {1e3 * found.sigma:.1f}): the stamps of the"
        f" inertial unit, or those of truth, are off by that; for the unit add {-found.ahead:+.4f} to its latency_s."
    )
    yield Happening("timing", "truth", float(errors.time[0]), float(errors.time[-1]), 0, sentence)
