"""A solution at any moment between its rows, and distances along it."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.usage import finite
from leadline.core import attitude, geodesy

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array
    from leadline.data.solution import Solution

STRIDE = 2.0  # m, between the corners of a measured path, so that noise does not count as distance


@dataclass(frozen=True)
class States:
    """What `Solution` holds, at n moments: angles in rad, depth and height in m, covariance (n, 9, 9) over `ERROR_NAMES`."""

    latitude: Array
    longitude: Array
    height: Array
    depth: Array
    velocity_n: Array
    quaternion_nb: Array
    covariance: Array


def found(rows: Array, time: Array) -> tuple[npt.NDArray[np.bool_], Array]:
    """Tell for each time whether it lies between the first and the last row, and how far its nearest row is (s).

    Between rows that are far apart nothing is near but the rows themselves: there it is half their distance at least.
    """
    if not len(rows):
        return np.zeros(len(time), bool), np.full(len(time), np.inf)
    before, after, _, interval = _between(rows, time)
    inside = (time >= rows[0]) & (time <= rows[-1])
    nearest = np.minimum(np.abs(time - rows[before]), np.abs(rows[after] - time))
    return inside, np.where(nearest > 1e-6, np.maximum(nearest, 0.5 * interval), nearest)


def states_at(solution: Solution, time: Array) -> States:
    """Return the solution's states at times (n,) between its first and last row.

    Position and attitude are interpolated in the Earth-fixed frame, so that the pole and the date line are ordinary places:
    position by cubic Hermite where the velocities at both ends explain the step to a quarter, linearly elsewhere (a fix that moves
    the track is a step, not a manoeuvre); attitude along the shortest rotation; velocity and covariance linearly.
    """
    before, after, fraction, interval = _between(solution.time, time)
    near, place = np.unique(np.concatenate([before, after]), return_inverse=True)  # of a day's states only those that are asked for
    s, before, after = solution.select(near), place[: len(before)], place[len(before) :]
    turn_en = geodesy.rotation_en(s.latitude, s.longitude)
    position_e = geodesy.ecef_from_geodetic(s.latitude, s.longitude, s.height)
    velocity_e = np.einsum("kij,kj->ki", turn_en, s.velocity_n)
    here_e = _hermite(position_e, velocity_e, before, after, fraction, interval)
    latitude, longitude, height = geodesy.geodetic_from_ecef(here_e)
    depth = _hermite(s.depth[:, None], s.velocity_n[:, 2:], before, after, fraction, interval)[:, 0]
    turn_ne = np.swapaxes(geodesy.rotation_en(latitude, longitude), 1, 2)
    q_eb = attitude.product(attitude.quaternion_from_matrix(turn_en), s.quaternion_nb)
    q_nb = attitude.product(attitude.quaternion_from_matrix(turn_ne), _slerp(q_eb[before], q_eb[after], fraction))
    velocity_n = np.einsum("kij,kj->ki", turn_ne, _linear(velocity_e, before, after, fraction))
    return States(latitude, longitude, height, depth, velocity_n, q_nb, _linear(s.covariance, before, after, fraction))


def _between(rows: Array, time: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Array, Array]:
    """Return the row before, the row after, the fraction of the way, and the interval (s) for each time."""
    before = np.clip(np.searchsorted(rows, time, side="right") - 1, 0, len(rows) - 1)
    after = np.minimum(before + 1, len(rows) - 1)
    interval = rows[after] - rows[before]
    fraction = np.where(interval > 0.0, (time - rows[before]) / np.where(interval > 0.0, interval, 1.0), 0.0)
    return before, after, fraction, interval


def _linear(values: Array, before: npt.NDArray[np.int64], after: npt.NDArray[np.int64], fraction: Array) -> Array:
    part = fraction.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1 - part) * values[before] + part * values[after])


def _hermite(
    value: Array, rate: Array, before: npt.NDArray[np.int64], after: npt.NDArray[np.int64], fraction: Array, interval: Array
) -> Array:
    """Return values (n, d) by cubic Hermite, or linearly where the rates at the ends do not explain the step."""
    u, h = fraction[:, None], interval[:, None]
    step = value[after] - value[before]
    start, end = h * rate[before] - step, h * rate[after] - step
    cubic = u * (1 - u) * ((1 - u) * start - u * end)
    unexplained = np.linalg.norm(0.5 * (start + end), axis=1)
    smooth = unexplained <= 0.25 * np.linalg.norm(0.5 * h * (rate[before] + rate[after]), axis=1)
    return np.asarray(value[before] + u * step + np.where(smooth[:, None], cubic, 0.0))


def _slerp(start: Array, end: Array, fraction: Array) -> Array:
    step = attitude.logarithm(attitude.product(attitude.conjugate(start), end))
    return attitude.product(start, attitude.exponential(fraction[:, None] * step))


def north_turn(latitude: Array, longitude: Array, to_latitude: Array, to_longitude: Array) -> Array:
    """Return by how much (rad) the heading of a fixed direction grows from one point to another: the convergence of meridians.

    tan(turn / 2) = tan(d_longitude / 2) sin(mean latitude) / cos(d_latitude / 2), exact on a sphere; d_longitude sin(latitude) nearby.
    """
    half = 0.5 * attitude.wrapped(to_longitude - longitude)
    level = np.cos(0.5 * (to_latitude - latitude))
    return np.asarray(2 * np.arctan2(np.sin(half) * np.sin(0.5 * (latitude + to_latitude)), np.cos(half) * level))


def travelled(latitude: Array, longitude: Array, stride: float = STRIDE) -> Array:
    """Return the distance (m) along a path up to each of its points (n,); steps shorter than `stride` wait until they add up."""
    points = geodesy.ecef_from_geodetic(latitude, longitude, 0.0)
    usable = np.isfinite(points).all(axis=1)
    total, reached = 0.0, []
    corner: list[float] | None = None
    for point in points[usable].tolist():
        corner = point if corner is None else corner
        step = dist(corner, point)
        reached.append(total + step)
        if step >= stride:
            total, corner = total + step, point
    result = np.full(len(points), np.nan)
    result[usable] = np.maximum.accumulate(reached) if reached else 0.0
    return _filled(result)


def distance(solution: Solution) -> float:
    """Return the distance (m) that a solution travels: the one figure that report, assessment and summary tell."""
    known = finite(solution)
    track = travelled(known.latitude, known.longitude)
    return float(track[-1]) if len(track) else 0.0


def _filled(values: Array) -> Array:
    """Return the values with those that are missing taken from the one before (zero at the start)."""
    return np.maximum.accumulate(np.nan_to_num(values, nan=0.0))
