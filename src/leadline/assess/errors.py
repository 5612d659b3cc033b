"""Errors of a solution against truth, and misclosures at fixes where there is none.

error = true - estimate, in metres, metres per second, and as a rotation vector with R_true = exp([error]x) R_estimate, all in
north-east-down at the truth's point.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.matching import States, found, north_turn, states_at, travelled
from leadline.core import attitude, geodesy
from leadline.data.outcome import Outcome
from leadline.data.solution import POSITION, ROTATION, VELOCITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from leadline.data.records import Array, Truth
    from leadline.data.solution import Innovations, Solution

BLOCKS: Mapping[str, slice] = {
    "horizontal": slice(0, 2), "position": POSITION, "velocity": VELOCITY, "attitude": ROTATION, "all": slice(0, 9),
}  # fmt: skip
MOST_ROWS = 100_000  # of truth that are compared; a longer one is thinned evenly, as each row carries a 9 x 9 covariance
SPARSE = 10.0  # s between rows of truth, beyond which the path length is taken from the solution


@dataclass(frozen=True)
class Spread:
    """Statistics of the size of an error over `count` moments; `end` is the last one's, `p95` the 95th percentile."""

    count: int
    rms: float
    median: float
    p95: float
    maximum: float
    end: float


NEAR = 0.06  # s: half an output interval at the default rate, and a little


@dataclass(frozen=True)
class Errors:
    """Errors (m, 9) at m moments of truth over `ERROR_NAMES`, nan where truth is silent, with their covariance (m, 9, 9).

    The covariance is the solution's, turned to the truth's north, plus the truth's own; `track` (m,) is the distance travelled
    up to each moment; `left_out` counts the rows of truth that were not compared, by reason.
    """

    time: Array
    error: Array
    covariance: Array
    track: Array
    left_out: Mapping[str, int] = field(default_factory=dict)
    away: Array | None = None  # (m,) how far the nearest row of the solution is (s): interpolation adds errors that P does not know

    def __len__(self) -> int:
        """Return the number of moments."""
        return len(self.time)

    @property
    def sigma(self) -> Array:
        """Standard deviations (m, 9)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))

    @property
    def horizontal(self) -> Array:
        """Horizontal radial error (m,)."""
        return np.hypot(self.error[:, 0], self.error[:, 1])

    @property
    def distance(self) -> float:
        """Distance travelled (m) between the first and the last moment."""
        return float(self.track[-1] - self.track[0]) if len(self) else 0.0

    @property
    def percent_of_distance(self) -> float:
        """Horizontal error at the end in per cent of the distance travelled."""
        end = self.statistics()["horizontal"].end
        return 100.0 * end / self.distance if self.distance > 0.0 else float("nan")

    def statistics(self) -> dict[str, Spread]:
        """Return the spread of each error: `median` of horizontal is CEP50, `p95` is R95; heading is the rotation about down."""
        e = self.error
        sizes = {
            "horizontal": self.horizontal, "north": e[:, 0], "east": e[:, 1], "down": e[:, 2],
            "velocity": np.linalg.norm(e[:, VELOCITY], axis=1), "tilt": np.hypot(e[:, 6], e[:, 7]), "heading": e[:, 8],
        }  # fmt: skip
        return {name: spread(size) for name, size in sizes.items()}

    def drift(self, leg: float = 1000.0) -> Array:
        """Return the change of the horizontal error over each leg of track, in metres per kilometre (legs,).

        A leg ends at the first moment at or beyond its length; one that truth sees only after half a leg more is left out.
        """
        seen = np.isfinite(self.horizontal)
        track, error = self.track[seen], self.error[seen, :2]
        if not len(track):
            return np.empty(0)
        ends = np.searchsorted(track, np.arange(track[0], track[-1] + 1e-6 * leg, leg) - 1e-9 * leg)
        length = np.diff(track[ends])
        change = np.linalg.norm(np.diff(error[ends], axis=0), axis=1)
        fits = (length > 0.5 * leg) & (length < 1.5 * leg)
        return np.asarray(1000.0 * change[fits] / length[fits])

    def whitened(self, block: str) -> Array:
        """Return P^-1/2 error (m, dof) of one of `BLOCKS`: unit normal where the covariance is right; nan where it is not defined.

        Moments further than `NEAR` from a row of the solution are not defined.  The symmetric root is taken, as it follows slow
        changes of the covariance continuously.
        """
        part = BLOCKS[block]
        sigma = self.sigma[:, part]
        unit = np.where(sigma > 0.0, sigma, np.nan)
        correlation = self.covariance[:, part, part] / (unit[:, :, None] * unit[:, None, :])
        scaled = self.error[:, part] / unit
        good = np.isfinite(scaled).all(axis=1) & np.isfinite(correlation).all(axis=(1, 2))
        if self.away is not None:
            good &= self.away <= NEAR
        values, vectors = np.linalg.eigh(correlation[good])
        root = np.sqrt(np.where(values > 1e-12, values, np.nan))
        result = np.full(scaled.shape, np.nan)
        result[good] = np.einsum("kij,kj,klj,kl->ki", vectors, 1.0 / root, vectors, scaled[good], optimize=True)
        return result

    def nees(self, block: str) -> Array:
        """Return error^T P^-1 error (m,) of one of `BLOCKS`."""
        return np.asarray(np.sum(self.whitened(block) ** 2, axis=1))


def spread(size: Array) -> Spread:
    """Return the statistics of the finite sizes of an error."""
    known = np.abs(size[np.isfinite(size)])
    if not len(known):
        return Spread(0, *(float("nan"),) * 5)
    rms = float(np.sqrt(np.mean(known**2)))
    return Spread(len(known), rms, float(np.median(known)), float(np.percentile(known, 95)), float(known.max()), float(known[-1]))


def errors_of(solution: Solution, truth: Truth, *, gap: float = 2.0) -> Errors:
    """Return the errors of a solution at the times of truth.

    The solution is interpolated to the truth's times and never extrapolated.  Rows of truth are left out that are marked as
    outliers, say nothing, lie outside the solution, or lie more than `gap` seconds from its nearest row.
    """
    index, left_out = _chosen(solution, truth, gap)
    time = truth.time[index]
    if not len(index):
        return Errors(time, np.empty((0, 9)), np.empty((0, 9, 9)), np.empty(0), left_out)
    estimate = states_at(solution, time)
    latitude, longitude = (v[index] for v in horizontal_of(solution, truth))
    known = np.isfinite(latitude)
    here = (np.where(known, latitude, estimate.latitude), np.where(known, longitude, estimate.longitude))
    turn = north_turn(estimate.latitude, estimate.longitude, *here)
    level = _level_error(estimate, *here)
    level[~known] = np.nan
    down = _down_error(estimate, truth, index)
    velocity = _velocity_error(estimate, truth, index, turn)
    rotation = _rotation_error(estimate, truth, index, turn)
    error = np.concatenate([level, down[:, None], velocity, rotation], axis=1)
    covariance = _turned(estimate.covariance, turn) + _own_covariance(truth, index)
    return Errors(time, error, covariance, _track(solution, time, latitude, longitude), left_out, found(solution.time, time)[1])


def _chosen(solution: Solution, truth: Truth, gap: float) -> tuple[npt.NDArray[np.int64], dict[str, int]]:
    """Return the rows of truth to compare, in order of time, and how many are left out for which reason."""
    order = np.argsort(truth.time, kind="stable")
    time = truth.time[order]
    inside, distance = found(solution.time, time)
    reasons = {
        "outlier": np.zeros(len(time), bool) if truth.outlier is None else truth.outlier[order] > 0.0,
        "empty": ~_says_something(truth)[order],
        "outside": ~inside,
        "gap": inside & (distance > gap),
    }
    bad = np.zeros(len(time), bool)
    left_out = {}
    for reason, mask in reasons.items():
        left_out[reason] = int(np.sum(mask & ~bad))
        bad |= mask
    kept = order[~bad]
    step = -(-len(kept) // MOST_ROWS) if len(kept) else 1
    thinned = kept[::-1][::step][::-1]  # from the end, so that the last row stays
    return thinned, left_out | {"thinned": len(kept) - len(thinned)}


def _says_something(truth: Truth) -> npt.NDArray[np.bool_]:
    columns = (truth.latitude, truth.north, truth.depth, truth.height, truth.heading, truth.velocity)
    said = [np.isfinite(c).reshape(len(truth), -1).any(axis=1) for c in columns if c is not None]
    return np.any(said, axis=0) if said else np.zeros(len(truth), bool)


def horizontal_of(solution: Solution, truth: Truth) -> tuple[Array, Array]:
    """Return latitude and longitude of truth (rad), from its metres north and east of the solution's origin where it has no angles."""
    nothing = np.full(len(truth), np.nan)
    latitude = nothing if truth.latitude is None else truth.latitude
    longitude = nothing if truth.longitude is None else truth.longitude
    if truth.north is None or truth.east is None:
        return np.where(np.isfinite(longitude), latitude, np.nan), longitude
    lat, lon = geodesy.from_north_east(truth.north, truth.east, solution.origin.latitude, solution.origin.longitude)
    given = np.isfinite(latitude) & np.isfinite(longitude)
    return np.where(given, latitude, lat), np.where(given, longitude, lon)


def _level_error(estimate: States, latitude: Array, longitude: Array) -> Array:
    """Return north and east (m, 2) of the truth from the estimate, both taken at the estimate's height, at the truth's point."""
    height = np.nan_to_num(estimate.height)
    true_e = geodesy.ecef_from_geodetic(latitude, longitude, height)
    apart_e = true_e - geodesy.ecef_from_geodetic(estimate.latitude, estimate.longitude, height)
    return np.asarray(np.einsum("kji,kj->ki", geodesy.rotation_en(latitude, longitude), apart_e)[:, :2])


def _down_error(estimate: States, truth: Truth, index: npt.NDArray[np.int64]) -> Array:
    nothing = np.full(len(index), np.nan)
    by_depth = nothing if truth.depth is None else truth.depth[index] - estimate.depth
    by_height = nothing if truth.height is None else estimate.height - truth.height[index]
    return np.where(np.isfinite(by_depth), by_depth, by_height)


def _velocity_error(estimate: States, truth: Truth, index: npt.NDArray[np.int64], turn: Array) -> Array:
    if truth.velocity is None:
        return np.full((len(index), 3), np.nan)
    return np.asarray(truth.velocity[index] - np.einsum("kij,kj->ki", _about_down(turn), estimate.velocity_n))


def _rotation_error(estimate: States, truth: Truth, index: npt.NDArray[np.int64], turn: Array) -> Array:
    """Return the rotation vectors (m, 3); where truth has a heading alone, the tilt is taken from the estimate and its error is nan."""
    if truth.heading is None:
        return np.full((len(index), 3), np.nan)
    turned = attitude.product(attitude.exponential(np.stack([0 * turn, 0 * turn, turn], axis=1)), estimate.quaternion_nb)
    roll, pitch, _ = attitude.euler_from_quaternion(turned)
    nothing = np.full(len(index), np.nan)
    true_roll = nothing if truth.roll is None else truth.roll[index]
    true_pitch = nothing if truth.pitch is None else truth.pitch[index]
    level = np.isfinite(true_roll) & np.isfinite(true_pitch)
    true = attitude.quaternion_from_euler(np.where(level, true_roll, roll), np.where(level, true_pitch, pitch), truth.heading[index])
    error = attitude.logarithm(attitude.product(true, attitude.conjugate(turned)))
    error[~level, :2] = np.nan
    return error


def _about_down(turn: Array) -> Array:
    return attitude.matrix_from_quaternion(attitude.exponential(np.stack([0 * turn, 0 * turn, turn], axis=1)))


def _turned(covariance: Array, turn: Array) -> Array:
    """Return covariances over `ERROR_NAMES` with each vector turned about down."""
    whole = np.zeros((len(turn), 9, 9))
    for part in (POSITION, VELOCITY, ROTATION):
        whole[:, part, part] = _about_down(turn)
    return whole @ covariance @ np.swapaxes(whole, 1, 2)


def _own_covariance(truth: Truth, index: npt.NDArray[np.int64]) -> Array:
    """Return the covariance (m, 9, 9) that the truth itself declares, of its position."""
    sigma = np.zeros((len(index), 3))
    if truth.sigma is not None:
        sigma = np.repeat(truth.sigma[index, None], 3, axis=1)
    if truth.sigma_axes is not None:
        sigma = np.where(np.isfinite(truth.sigma_axes[index]), truth.sigma_axes[index], sigma)
    whole = np.zeros((len(index), 9, 9))
    for axis in range(3):
        whole[:, axis, axis] = np.nan_to_num(sigma[:, axis]) ** 2
    return whole


def _track(solution: Solution, time: Array, latitude: Array, longitude: Array) -> Array:
    """Return the distance travelled up to each time: along truth, or along the solution where truth is sparse."""
    seen = np.isfinite(latitude)
    if seen.sum() >= 2 and np.median(np.diff(time[seen])) <= SPARSE:
        return np.interp(time, time[seen], travelled(latitude[seen], longitude[seen]))
    return np.interp(time, solution.time, travelled(solution.latitude, solution.longitude))


@dataclass(frozen=True)
class Misclosure:
    """Residual of a position fix at its first use after a gap: what dead reckoning had gathered by then.

    `north`, `east`, `down` in m (fix - prediction; down is nan where the fix has none), `sigma` the predicted standard deviation of
    the horizontal part, `since` the seconds and `distance` the metres since the fix before, or since the start.
    """

    sensor: str
    row: int
    time: float
    north: float
    east: float
    down: float
    sigma: float
    since: float
    distance: float

    @property
    def horizontal(self) -> float:
        """Horizontal size (m)."""
        return float(np.hypot(self.north, self.east))

    @property
    def percent_of_distance(self) -> float:
        """Horizontal size in per cent of the distance travelled since the fix before."""
        return 100.0 * self.horizontal / self.distance if self.distance > 0.0 else float("nan")


def misclosures(solution: Solution, *, gap: float = 60.0) -> tuple[Misclosure, ...]:
    """Return the residuals of used fixes that come more than `gap` seconds after the fix before, of whatever sensor."""
    table = solution.innovations
    north, east, down = _used_fixes(table)
    if not len(north) or not len(solution):
        return ()
    track = travelled(solution.latitude, solution.longitude)
    before = np.concatenate([[solution.time[0]], table.time[north][:-1]])
    since = table.time[north] - before
    distance = np.interp(table.time[north], solution.time, track) - np.interp(before, solution.time, track)
    return tuple(
        _misclosure(table, (int(north[k]), int(east[k]), int(down[k])), float(since[k]), float(distance[k]))
        for k in np.flatnonzero(since > gap)
    )


def _used_fixes(table: Innovations) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the entries of north, east and down (-1: none) of the used groups that hold north and east, in order of time."""
    _, sensor = np.unique(table.sensor, return_inverse=True)
    key = sensor.ravel() * (table.group.max(initial=0) + 1) + table.group
    used = table.outcome == Outcome.USED
    entries = [np.flatnonzero(used & (table.component == name)) for name in ("north", "east", "down")]
    _, at_north, at_east = np.intersect1d(key[entries[0]], key[entries[1]], return_indices=True)
    north, east, down = entries[0][at_north], entries[1][at_east], np.full(len(at_north), -1)
    _, has, at_down = np.intersect1d(key[north], key[entries[2]], return_indices=True)
    down[has] = entries[2][at_down]
    order = np.argsort(table.time[north], kind="stable")
    return north[order], east[order], down[order]


def _misclosure(table: Innovations, entries: tuple[int, int, int], since: float, distance: float) -> Misclosure:
    """Return the misclosure of a fix that stands in the entries of its north, east and down."""
    at_north, at_east, at_down = entries
    north, east = float(table.residual[at_north]), float(table.residual[at_east])
    down = float(table.residual[at_down]) if at_down >= 0 else float("nan")
    sigma = float(np.hypot(table.sigma[at_north], table.sigma[at_east]))
    place = (str(table.sensor[at_north]), int(table.row[at_north]), float(table.time[at_north]))
    return Misclosure(*place, north, east, down, sigma, since, distance)
