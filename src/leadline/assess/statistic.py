"""Statistics of many runs, each with its confidence interval: sizes of errors, against the bound, and of one way against another."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, nan
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.intervals import LEVEL, Interval, interval_of_rmse_ratio

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.records import Array

QUANTITIES: Mapping[str, tuple[int, ...]] = {
    "horizontal": (0, 1), "depth": (2,), "velocity": (3, 4, 5), "tilt": (6, 7), "heading": (8,),
}  # of the nine errors over `ERROR_NAMES`  # fmt: skip


def size_of(error: Array, quantity: str) -> Array:
    """Return the size (runs, times) of a quantity of errors (runs, times, 9), at the times at which it is known in every run."""
    size = np.linalg.norm(error[:, :, list(QUANTITIES[quantity])], axis=2)
    return np.asarray(size[:, np.isfinite(size).all(axis=0)])


def rmse_of(error: Array, quantity: str, level: float = LEVEL) -> Interval:
    """Return the root mean square of a quantity over all runs and times; runs are independent, the times of one are not."""
    return _ratio(size_of(error, quantity), None, level)


def over_bound(error: Array, sigma: Array, quantity: str, level: float = LEVEL) -> Interval:
    """Return RMSE over bound: the root mean square of each component over its own bound `sigma` (times, 9) at each time."""
    columns = list(QUANTITIES[quantity])
    scaled = error[:, :, columns] / np.where(sigma[:, columns] > 0.0, sigma[:, columns], np.nan)
    good = np.isfinite(scaled).all(axis=(0, 2))
    return _ratio(scaled[:, good], None, level)


@dataclass(frozen=True)
class Paired:
    """The RMSE of one way over that of another on the same runs: the ratio, and the probability of one as far from 1 by chance."""

    ratio: Interval
    p: float = nan
    runs: int = 0


def paired(error: Array, reference: Array, quantity: str, level: float = LEVEL) -> Paired:
    """Compare two ways run by run; errors (runs, times, 9) of both over the same runs and times.

    The logarithm of the ratio over its standard error follows Student's t (`interval_of_rmse_ratio`), two-sided.
    """
    from scipy.special import stdtr, stdtrit

    columns = list(QUANTITIES[quantity])
    good = np.isfinite(error[:, :, columns]).all(axis=(0, 2)) & np.isfinite(reference[:, :, columns]).all(axis=(0, 2))
    runs = len(error)
    ratio = _ratio(size_of(error[:, good], quantity), size_of(reference[:, good], quantity), level)
    if runs < 2 or not np.isfinite(ratio.high) or not ratio.low > 0.0:
        return Paired(ratio, nan, runs)
    spread = 0.5 * (log(ratio.high) - log(ratio.low)) / float(stdtrit(runs - 1, 0.5 + level / 2))
    away = abs(log(ratio.estimate))
    p = 2.0 * float(stdtr(runs - 1, -away / spread)) if spread > 0.0 else float(away == 0.0)
    return Paired(ratio, p, runs)


def _ratio(size: Array, reference: Array | None, level: float) -> Interval:
    """Return the interval of RMSE over that of a reference, or over one; unknown where nothing is known, or the reference is zero."""
    below = np.ones_like(size) if reference is None else reference
    if not size.size or not np.any(below):
        return Interval(level=level)
    if not np.any(size):
        return Interval(0.0, 0.0, 0.0, level)
    return interval_of_rmse_ratio(size, below, level)
