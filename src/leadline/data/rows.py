"""Rows of numbers: which are whole, and times in order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array


def complete(values: Array) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) of numbers (n, ...) are all finite; column by column, as a reduction over few columns is slow."""
    columns = np.isfinite(values.reshape(len(values), -1)) if len(values) else np.zeros((0, 1), bool)
    return np.asarray(np.logical_and.reduce([np.ones(len(values), bool), *(columns[:, j] for j in range(columns.shape[1]))]))


def ascending(times: Array) -> Array:
    """Return distinct times in order, as np.unique does; most tables are in order already."""
    return times if (np.diff(times) > 0.0).all() else np.unique(times)
