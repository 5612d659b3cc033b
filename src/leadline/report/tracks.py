"""Where things were on a dive, in metres north and east of one origin: the vehicle by whoever tells, platforms, fixes, beacons.

Rows are in order of time; those without a place are left out.  Angles in rad.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude, geodesy
from leadline.data.log import Origin
from leadline.data.records import Depth, Gnss, Navigation, Platform, PositionFix

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    import numpy.typing as npt

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.solution import Solution

    Flags = npt.NDArray[np.bool_]

FAR = 5.0  # sigma from the reference, beyond which a fix is marked
RAYLEIGH = 1.1774  # median of the distance over the sigma of each of two axes
FARTHEST = 1e8  # m, from the origin: what lies beyond is no place
LONGEST_GAP = 10.0  # usual intervals, or seconds where that is more, over which no line is drawn


@dataclass(frozen=True, eq=False)
class Frame:
    """Where north and east are counted from, how high the sea surface lies above the ellipsoid (m), and the epoch of all times."""

    origin: Origin
    undulation: float
    epoch: datetime

    def level(self, what: Any) -> tuple[Array, Array]:
        """Return north and east (n,) in m of a table or beacon with latitude and longitude (rad), or north and east; nan without."""
        latitude, longitude, north, east = (column_of(what, name) for name in ("latitude", "longitude", "north", "east"))
        by_angle = geodesy.north_east(latitude, longitude, self.origin.latitude, self.origin.longitude)
        known = np.isfinite(by_angle[0]) & np.isfinite(by_angle[1])
        return np.where(known, by_angle[0], north), np.where(known, by_angle[1], east)

    def depth(self, table: Table) -> Array:
        """Return depths (n,) in m by the depth of a table, else by its height; nan where it has neither."""
        depth = column_of(table, "depth")
        return np.where(np.isfinite(depth), depth, self.undulation - column_of(table, "height"))


@dataclass(frozen=True, eq=False)
class Track:
    """Places (n,) of one thing over time (m, depth positive down), with its attitude (n, 4), body to north-east-down, where it is known."""

    name: str
    time: Array
    north: Array
    east: Array
    depth: Array
    quaternion_nb: Array | None = None
    measured: bool = False  # single fixes, not a path

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.time)

    def select(self, index: Any) -> Track:
        """Return the places that `index` (mask, slice or indices) selects."""
        names = ("time", "north", "east", "depth", "quaternion_nb")
        return replace(self, **{n: v[index] for n in names if (v := getattr(self, n)) is not None})

    def at(self, time: Array) -> Array:
        """Return north, east and depth (n, 3) at times (s), on straight lines; nan before the first and after the last."""
        return np.stack([np.interp(time, self.time, v, left=np.nan, right=np.nan) for v in (self.north, self.east, self.depth)], axis=1)

    def rotation_at(self, time: Array) -> Array:
        """Return rotations (n, 3, 3) from body to north-east-down, on chords between the attitudes."""
        assert self.quaternion_nb is not None
        q = self.quaternion_nb
        turned = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
        q = q * np.concatenate([[1.0], turned])[:, None]
        between = np.stack([np.interp(time, self.time, column) for column in q.T], axis=1)
        return attitude.matrix_from_quaternion(between / np.linalg.norm(between, axis=1, keepdims=True))

    @property
    def pieces(self) -> npt.NDArray[np.int64]:
        """A number (n,) that counts up at each gap."""
        steps = np.diff(self.time, prepend=self.time[:1])
        longest = max(LONGEST_GAP * float(np.median(steps[1:])), LONGEST_GAP) if len(steps) > 1 else np.inf
        return np.cumsum(steps > longest)


@dataclass(frozen=True, eq=False)
class Fixes:
    """Positions (n,) measured by one instrument, which of them are doubtful, and why these are."""

    track: Track
    doubtful: Flags
    why: str = ""

    @property
    def name(self) -> str:
        """The name of the instrument."""
        return self.track.name


def frame_of(log: Log, solutions: Mapping[str, Solution]) -> Frame:
    """Return the frame of a log: its own origin, else that of a solution, else the first place that it tells in angles."""
    origin = log.origin or next((s.origin for s in solutions.values()), None) or _first_place(log)
    return Frame(origin, log.datum.geoid_undulation, log.epoch)


def _first_place(log: Log) -> Origin:
    angles = [(b.latitude, b.longitude) for b in log.beacons.values() if b.latitude is not None and b.longitude is not None]
    for table in log.tables.values():
        latitude, longitude = getattr(table, "latitude", None), getattr(table, "longitude", None)
        if latitude is not None and longitude is not None:
            known = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))[:1]
            angles += zip(latitude[known].tolist(), longitude[known].tolist(), strict=True)
    return Origin(*angles[-1]) if angles else Origin(0.0, 0.0)


def track_of_table(name: str, table: Table, frame: Frame, depth: Array) -> Track:
    """Return the way that a table with positions tells; `depth` (n,) stands in where it has none."""
    north, east = frame.level(table)
    own = frame.depth(table)
    roll, pitch, heading = (column_of(table, angle) for angle in ("roll", "pitch", "heading"))
    quaternion = attitude.quaternion_from_euler(roll, pitch, heading)
    return in_order(Track(name, table.time, north, east, np.where(np.isfinite(own), own, depth), quaternion))


def in_order(track: Track) -> Track:
    """Return the places of a track that are numbers, in order of time; attitudes are dropped where they are not all known."""
    track = track.select(_usable(track))
    if track.quaternion_nb is not None and not np.isfinite(track.quaternion_nb).all():
        track = replace(track, quaternion_nb=None)
    return track if (np.diff(track.time) >= 0.0).all() else track.select(np.argsort(track.time, kind="stable"))


def _usable(track: Track) -> Flags:
    """Return which places are numbers, and such as lie on this planet."""
    near = [np.abs(column) < FARTHEST for column in (track.north, track.east, track.depth)]
    return np.asarray(np.logical_and.reduce([np.isfinite(track.time), *near]))


def track_of_solution(name: str, solution: Solution, frame: Frame) -> Track:
    """Return the way of a solution, in the frame and the time of the log."""
    north, east = geodesy.north_east(solution.latitude, solution.longitude, frame.origin.latitude, frame.origin.longitude)
    later = (solution.epoch.astimezone(UTC) - frame.epoch.astimezone(UTC)).total_seconds()
    return in_order(Track(name, solution.time + later, north, east, solution.depth, solution.quaternion_nb))


def track_of_truth(log: Log, frame: Frame) -> Track | None:
    """Return the way that truth tells, without its outliers, or None where it tells of no place."""
    truth = log.truth
    if truth is None:
        return None
    track = track_of_table("truth", truth, frame, depth_at(log, truth.time))
    if truth.outlier is not None:
        bad = truth.time[np.nan_to_num(truth.outlier) > 0.0]
        track = track.select(~np.isin(track.time, bad))  # by its time: rows are in another order now
    return track if len(track) else None


def depth_at(log: Log, time: Array) -> Array:
    """Return the depth (n,) that the log's first depth sensor tells at times (s), zero where there is none."""
    for table in log.tables.values():
        if isinstance(table, Depth):
            good = np.isfinite(table.time) & np.isfinite(table.depth)
            order = np.flatnonzero(good)[np.argsort(table.time[good], kind="stable")]
            if len(order):
                return np.interp(time, table.time[order], table.depth[order])
    return np.zeros(len(time))


def other_tracks(log: Log, frame: Frame) -> Iterator[Track]:
    """Yield what other navigation systems aboard tell."""
    for name, table in log.tables.items():
        if isinstance(table, Navigation):
            track = track_of_table(name, table, frame, depth_at(log, table.time))
            if len(track):
                yield track


def platform_tracks(log: Log, frame: Frame) -> Iterator[Track]:
    """Yield the way of each platform: ships, buoys and other vehicles."""
    for table in log.tables.values():
        if isinstance(table, Platform):
            for name in dict.fromkeys(table.name.tolist()):
                mine = table.select(table.name == name)
                track = track_of_table(str(name), mine, frame, np.zeros(len(mine)))
                if len(track):
                    yield track


def position_fixes(log: Log, frame: Frame, reference: Track | None) -> Iterator[Fixes]:
    """Yield the positions of each instrument that measures them: satellites at the surface, the others at their depth or the vehicle's."""
    for name, table in log.tables.items():
        if isinstance(table, Gnss | PositionFix):
            yield fixes_of(table, _fix_track(name, table, log, frame, reference), reference)


def _fix_track(name: str, table: Gnss | PositionFix, log: Log, frame: Frame, reference: Track | None) -> Track:
    north, east = frame.level(table)
    depth = np.zeros(len(table))
    if isinstance(table, PositionFix):
        deep = depth_at(log, table.time) if reference is None else reference.at(table.time)[:, 2]
        own = column_of(table, "depth")
        depth = np.where(np.isfinite(own), own, np.nan_to_num(deep))
    return Track(name, table.time, north, east, depth, measured=True)


def fixes_of(table: Table, track: Track, reference: Track | None) -> Fixes:
    """Return fixes, doubtful where the log marks them, where the sensor does, or where they lie far from the reference."""
    marked = np.zeros(len(table), bool)
    reasons: list[str] = []
    for bad, why in (
        (extra_of(table, "outlier") > 0.0, "marked as outliers in the log"),
        (column_of(table, "valid") == 0.0, "invalid by the sensor's own word"),
        (_far(table, track, reference), f"more than {FAR:g} σ off {'' if reference is None else reference.name}"),
    ):
        if (bad & ~marked).any():
            marked, reasons = marked | bad, [*reasons, why]
    good = np.flatnonzero(_usable(track))
    good = good[np.argsort(track.time[good], kind="stable")]
    return Fixes(track.select(good), marked[good], "; ".join(reasons))


def _far(table: Table, track: Track, reference: Track | None) -> Flags:
    """Return which fixes are farther from the reference than `FAR` of their stated sigma, or of that of all of them if that is more."""
    if reference is None or reference.measured:
        return np.zeros(len(track), bool)
    apart = np.hypot(*(reference.at(track.time)[:, :2] - np.stack([track.north, track.east], axis=1)).T)
    if not np.isfinite(apart).any():
        return np.zeros(len(track), bool)
    axes = getattr(table, "sigma_axes", None)
    stated = column_of(table, "sigma") if axes is None else np.max(axes[:, :2], axis=1)
    return np.asarray(apart > FAR * np.fmax(stated, np.nanmedian(apart) / RAYLEIGH))


def beacon_places(log: Log, frame: Frame) -> dict[str, tuple[float, float, float]]:
    """Return north, east and depth (m) of each beacon that stands still."""
    found = {}
    for name, beacon in log.beacons.items():
        north, east = frame.level(beacon)
        found[name] = (float(north[0]), float(east[0]), beacon.depth)
    return found


def column_of(what: Any, name: str) -> Array:
    """Return a column (n,) of a table, or one number of a beacon; nan where it lacks that."""
    value = getattr(what, name, None)
    rows = len(what.time) if hasattr(what, "time") else 1
    column: Array = np.full(rows, np.nan if value is None else value)
    return column


def extra_of(table: Table, name: str) -> Array:
    """Return a further column (n,) of a table, zero where it lacks that."""
    return np.asarray(np.nan_to_num(np.asarray(table.extra.get(name, np.zeros(len(table))), float)))
