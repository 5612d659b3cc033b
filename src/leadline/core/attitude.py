"""Rotations of many rows at once (NumPy): quaternions, matrices, Z-Y-X angles, rotation vectors.

A quaternion is Hamilton, scalar first, and turns body coordinates into navigation coordinates: v_n = R(q) v_b.
Arrays have shape (..., 4), (..., 3, 3) or (..., 3).  The compiled counterparts for single rotations are in core/rotation.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array


def quaternion_from_euler(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """Return the quaternion (..., 4) of Z-Y-X angles (rad): R = Rz(heading) Ry(pitch) Rx(roll)."""
    r, p, h = (0.5 * np.asarray(a, float) for a in (roll, pitch, heading))
    cr, sr, cp, sp, ch, sh = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(h), np.sin(h)
    return np.stack(
        [cr * cp * ch + sr * sp * sh, sr * cp * ch - cr * sp * sh, cr * sp * ch + sr * cp * sh, cr * cp * sh - sr * sp * ch], axis=-1
    )


def euler_from_quaternion(quaternion: ArrayLike) -> tuple[Array, Array, Array]:
    """Return roll, pitch, heading (rad) of quaternions (..., 4); roll and heading in (-pi, pi]."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0))
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, heading


def matrix_from_quaternion(quaternion: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_matrix(matrix: ArrayLike) -> Array:
    """Return unit quaternions (..., 4), scalar part not negative, of rotation matrices (..., 3, 3).

    Of the four algebraically equal formulas the one with the largest divisor is taken (Shepperd, 1978).
    """
    m = np.asarray(matrix, float)
    a, b, c = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    x, y, z = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    candidates = np.stack(
        [
            np.stack([1 + a + b + c, x, y, z], axis=-1),
            np.stack([x, 1 + a - b - c, xy, xz], axis=-1),
            np.stack([y, xy, 1 - a + b - c, yz], axis=-1),
            np.stack([z, xz, yz, 1 - a - b + c], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(candidates, axis1=-2, axis2=-1), axis=-1)
    quaternion = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return np.asarray(quaternion * np.where(quaternion[..., :1] < 0.0, -1.0, 1.0))


def matrix_from_euler(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of Z-Y-X angles (rad)."""
    return matrix_from_quaternion(quaternion_from_euler(roll, pitch, heading))


def product(p: ArrayLike, q: ArrayLike) -> Array:
    """Return the Hamilton product p q of quaternions (..., 4)."""
    p0, p1, p2, p3 = np.moveaxis(np.asarray(p, float), -1, 0)
    q0, q1, q2, q3 = np.moveaxis(np.asarray(q, float), -1, 0)
    return np.stack(
        [
            p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3,
            p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2,
            p0 * q2 - p1 * q3 + p2 * q0 + p3 * q1,
            p0 * q3 + p1 * q2 - p2 * q1 + p3 * q0,
        ],
        axis=-1,
    )


def conjugate(quaternion: ArrayLike) -> Array:
    """Return the inverse of unit quaternions (..., 4)."""
    return np.asarray(np.asarray(quaternion, float) * np.array([1.0, -1.0, -1.0, -1.0]))


def exponential(vector: ArrayLike) -> Array:
    """Return the quaternions (..., 4) of rotation vectors (..., 3), rad."""
    v = np.asarray(vector, float)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], axis=-1)


def logarithm(quaternion: ArrayLike) -> Array:
    """Return the rotation vectors (..., 3), rad, at most pi long, of quaternions (..., 4)."""
    q = np.asarray(quaternion, float)
    q = q * np.where(q[..., :1] < 0.0, -1.0, 1.0)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    small = length < 1e-8
    scale = np.where(small, 2.0, 2.0 * np.arctan2(length, q[..., :1]) / np.where(small, 1.0, length))
    return np.asarray(scale * q[..., 1:])


def wrapped(angle: ArrayLike) -> Array:
    """Return angles (rad) brought into [-pi, pi)."""
    return np.asarray((np.asarray(angle, float) + np.pi) % (2 * np.pi) - np.pi)
