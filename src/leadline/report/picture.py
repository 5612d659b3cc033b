"""What a picture of a dive shows: tracks, fixes, beacons, soundings and the ground, and the box in which they are drawn."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.report import echoes, tracks
from leadline.report.tracks import FARTHEST, Fixes, Frame, Track

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle
    from leadline.sea.terrain import Chart

MOST_NODES = 150  # of the ground, each way
MARGIN = 0.18  # of the larger side, around what is drawn
SMALLEST = 10.0  # m, that a side has at least
SLIMMEST = 0.45  # of the larger side, that the smaller has at least
FLATTEST = 0.015  # of the larger side, that is drawn of the depth at least
NEAR = 1.5  # sides of the tracks, within which beacons and platforms widen the picture
HIGH, HIGHEST = 0.36, 1.3  # of the larger side: the height that is aimed at, and the most at true scale
EXAGGERATIONS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)


@dataclass(frozen=True)
class Box:
    """The edges of a picture (m, depth positive down) and how many times its vertical scale is that of the horizontal."""

    south: float
    north: float
    west: float
    east: float
    top: float
    bottom: float
    exaggeration: float
    surface: bool  # whether the sea surface is in it

    @property
    def ratio(self) -> tuple[float, float, float]:
        """Lengths of its sides east, north and down as drawn, the larger horizontal one 1."""
        sides = self.east - self.west, self.north - self.south
        return sides[0] / max(sides), sides[1] / max(sides), self.exaggeration * (self.bottom - self.top) / max(sides)


@dataclass(frozen=True, eq=False)
class Ground:
    """Depths of the sea bed (rows to the north, columns to the east) in m at nodes; nan is not known."""

    north: Array
    east: Array
    depth: Array

    def below(self, north: Array, east: Array) -> Array:
        """Return the depth (n,) under places, bilinear between the nodes that are drawn; nan outside."""
        i = np.clip(np.searchsorted(self.north, north, side="right") - 1, 0, len(self.north) - 2)
        j = np.clip(np.searchsorted(self.east, east, side="right") - 1, 0, len(self.east) - 2)
        u = (north - self.north[i]) / (self.north[i + 1] - self.north[i])
        v = (east - self.east[j]) / (self.east[j + 1] - self.east[j])
        d = self.depth
        found = (1 - u) * ((1 - v) * d[i, j] + v * d[i, j + 1]) + u * ((1 - v) * d[i + 1, j] + v * d[i + 1, j + 1])
        return np.asarray(np.where((u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (v <= 1.0), found, np.nan))


@dataclass(frozen=True, eq=False)
class Picture:
    """All that is drawn of a dive, in metres of one frame.

    reference: what is taken for the way of the vehicle (truth, else a solution, another system's output, fixes), or None.  others: what
    else tells it.  remarks: what a person should know of the picture.
    """

    frame: Frame
    reference: Track | None
    others: Sequence[Track] = ()
    platforms: Sequence[Track] = ()
    fixes: Sequence[Fixes] = ()
    beacons: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    cloud: Array = field(default_factory=lambda: np.empty((0, 3)))
    ground: Ground | None = None
    box: Box | None = None
    remarks: Sequence[str] = ()

    @property
    def distance(self) -> float:
        """Distance (m) along the reference; nan without one."""
        from leadline.assess.matching import travelled

        track, origin = self.reference, self.frame.origin
        if track is None or not len(track):
            return float("nan")
        return float(travelled(*geodesy.from_north_east(track.north, track.east, origin.latitude, origin.longitude))[-1])


def picture_of(
    log: Log, solutions: Mapping[str, Solution] | None = None, chart: Chart | None = None, vehicle: Vehicle | None = None
) -> Picture:
    """Return the picture of a log, with the tracks of solutions and the ground of a chart in metres from the log's origin."""
    solutions = solutions or {}
    frame = tracks.frame_of(log, solutions)
    told = [track for track in (tracks.track_of_truth(log, frame), *_solved(solutions, frame), *tracks.other_tracks(log, frame)) if track]
    reference = told[0] if told else _of_fixes(log, frame)
    fixes = [*tracks.position_fixes(log, frame, reference), *echoes.usbl_fixes(log, frame, reference, vehicle)]
    whole = Picture(
        frame,
        reference,
        [track for track in told if track is not reference],
        list(tracks.platform_tracks(log, frame)),
        [fix for fix in fixes if len(fix.track)],
        tracks.beacon_places(log, frame),
        echoes.soundings(log, reference, vehicle),
    )
    return _framed(whole, chart)


def _solved(solutions: Mapping[str, Solution], frame: Frame) -> Iterator[Track]:
    for name, solution in solutions.items():
        track = tracks.track_of_solution(name, solution, frame)
        if len(track):
            yield track


def _of_fixes(log: Log, frame: Frame) -> Track | None:
    """Return the good fixes of the instrument that has most of them, as the best that is known of the way, or None."""
    found = [fix.track.select(~fix.doubtful) for fix in tracks.position_fixes(log, frame, None)]
    return max(found, key=len, default=None) if any(map(len, found)) else None


def _framed(picture: Picture, chart: Chart | None) -> Picture:
    """Return the picture with its box, the ground within it, and remarks on what lies outside."""
    core = _core(picture)
    if not len(core):
        return picture
    level, remarks = _sides(core), []
    near = [np.array([place]) for place in picture.beacons.values()]
    for place in near + [_places(track) for track in picture.platforms]:
        if _within(place, level, NEAR).any():
            core = np.concatenate([core, place[_within(place, level, NEAR)]])
    far = [name for name, place in picture.beacons.items() if not _within(np.array([place]), level, NEAR)[0]]
    if far:
        remarks.append(f"Out of the picture: {', '.join(far)}.")
    level = _sides(core)
    ground = None if chart is None else _ground(chart, level)
    if chart is not None and ground is None:
        remarks.append("The chart does not reach the track and is not drawn.")
    box = _box(level, core, ground)
    if not box.surface:
        remarks.append("The sea surface lies above the picture.")
    return replace(picture, ground=ground, box=box, remarks=remarks)


def _core(picture: Picture) -> Array:
    """Return the places (n, 3) that must be in the picture."""
    whole = [track for track in (picture.reference, *picture.others) if track is not None]
    parts = [_places(track) for track in whole] + [_places(fix.track)[~fix.doubtful] for fix in picture.fixes]
    if not whole:
        parts += [np.reshape(list(picture.beacons.values()), (-1, 3)), *(_places(track) for track in picture.platforms)]
    if len(picture.cloud):
        low, high = np.percentile(picture.cloud, [0.5, 99.5], axis=0)
        parts.append(picture.cloud[((picture.cloud >= low) & (picture.cloud <= high)).all(axis=1)])
    core = np.concatenate(parts) if parts else np.empty((0, 3))
    return core[(np.abs(core) < FARTHEST).all(axis=1)]


def _places(track: Track) -> Array:
    return np.stack([track.north, track.east, track.depth], axis=1)


def _sides(core: Array) -> tuple[float, float, float, float]:
    """Return south, north, west, east of places (n, 3), with a margin, and not too slim."""
    (south, west, _), (north, east, _) = core.min(axis=0), core.max(axis=0)
    larger = max(north - south, east - west, SMALLEST)
    half = [0.5 * max(side + 2.0 * MARGIN * larger, SLIMMEST * (1.0 + 2.0 * MARGIN) * larger) for side in (north - south, east - west)]
    middle = 0.5 * (north + south), 0.5 * (east + west)
    return middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1]


def _within(place: Array, sides: tuple[float, float, float, float], times: float) -> Array:
    """Return which places (n, 3) lie within so many sides of the middle."""
    south, north, west, east = sides
    reach = times * max(north - south, east - west)
    return np.asarray((np.abs(place[:, :2] - [0.5 * (south + north), 0.5 * (west + east)]) < reach).all(axis=1))


def _ground(chart: Chart, sides: tuple[float, float, float, float]) -> Ground | None:
    """Return every k-th node of a chart within the sides, or None where fewer than 2 x 2 lie there or none is known."""
    rows, columns = chart.depth.shape
    north = chart.north + chart.step_north * np.arange(float(rows))
    east = chart.east + chart.step_east * np.arange(float(columns))
    picked = [_window(axis, low, high) for axis, low, high in ((north, *sides[:2]), (east, *sides[2:]))]
    if min(map(len, picked)) < 2 or not np.isfinite(chart.depth[np.ix_(*picked)]).any():
        return None
    return Ground(north[picked[0]], east[picked[1]], chart.depth[np.ix_(*picked)])


def _window(axis: Array, low: float, high: float) -> npt.NDArray[np.int64]:
    """Return indices of the nodes of an axis between two places and one more to either side, evenly thinned."""
    first, last = int(np.searchsorted(axis, low)) - 1, int(np.searchsorted(axis, high))
    index = np.arange(max(first, 0), min(last, len(axis) - 1) + 1)
    step = max(1, -(-len(index) // MOST_NODES))
    return index[(len(index) - 1) % step // 2 :: step]


def _box(sides: tuple[float, float, float, float], core: Array, ground: Ground | None) -> Box:
    """Return the box about sides and places: with the sea surface unless all lies far below it."""
    low, high = float(core[:, 2].min()), float(core[:, 2].max())
    if ground is not None:
        low, high = min(low, float(np.nanmin(ground.depth))), max(high, float(np.nanmax(ground.depth)))
    surface = low <= 2.0 * (high - low) + 1.0
    low = min(low, 0.0) if surface else low
    larger = max(sides[1] - sides[0], sides[3] - sides[2])
    high = max(high, low + FLATTEST * larger)
    pad = 0.04 * (high - low)
    top, bottom = low - pad, high + pad
    height = bottom - top
    fitting = [x for x in EXAGGERATIONS if x * height <= HIGH * larger]
    best = max(fitting, default=EXAGGERATIONS[0])
    if best < 1.0:
        best = 1.0 if height <= HIGHEST * larger else max((x for x in EXAGGERATIONS if x * height <= HIGHEST * larger), default=best)
    return Box(*sides, top, bottom, best, surface)
