"""What carries transducers and is not the vehicle: beacons that stand still, ships, buoys, other vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from leadline.core.attitude import matrix_from_euler, wrapped
from leadline.core.geodesy import ecef_from_geodetic, from_north_east, geodetic_from_ecef, rotation_en
from leadline.data import records
from leadline.data.errors import InputError
from leadline.sea.water import CALM as CALM_WATER
from leadline.simulate.instrument import ZERO, Instrument, Vector
from leadline.simulate.positions import displaced
from leadline.simulate.trajectory import Trajectory, euler
from leadline.simulate.vectors import turned

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import ArrayLike

    from leadline.data.log import Beacon
    from leadline.data.records import Array
    from leadline.simulate.trajectory import Place

Amplitude = tuple[float, float]  # of a sinusoid, and its period (s)


class Carrier(Protocol):
    """What can say at any time where it is, how it lies, and where its transducer is; the transducer replies after `turnaround` (s)."""

    @property
    def turnaround(self) -> float:
        """Time between a ping that is heard and the reply to it (s)."""
        ...

    @property
    def end(self) -> float:
        """Time (s) up to which it can say so."""
        ...

    def position_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the reference point (m)."""
        ...

    def rotation_eb(self, time: Array) -> Array:
        """Return rotations (times, 3, 3) from body to Earth-fixed axes."""
        ...

    def transducer_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the transducer (m)."""
        ...


def beacon_position_e(beacon: Beacon, place: Place) -> Array:
    """Return the Earth-fixed position (3,) of a beacon; north and east count from `place`, depth from its sea surface."""
    if beacon.latitude is not None and beacon.longitude is not None:
        latitude, longitude = np.asarray(beacon.latitude), np.asarray(beacon.longitude)
    elif beacon.north is not None and beacon.east is not None:
        latitude, longitude = from_north_east(beacon.north, beacon.east, place.latitude, place.longitude)
    else:
        raise InputError("beacon", "has no position", "give latitude and longitude, or north and east")
    return ecef_from_geodetic(latitude, longitude, place.surface_height - beacon.depth)


@dataclass(frozen=True)
class Fixed:
    """A beacon that stands still, level and facing north; its north and east count from `place`, its depth from that sea surface.

    Raises InputError where the beacon has no position.
    """

    beacon: Beacon
    place: Place

    @property
    def turnaround(self) -> float:
        """Time between a ping that is heard and the reply to it (s)."""
        return self.beacon.turnaround

    @property
    def end(self) -> float:
        """Time (s) up to which it is known where it is: for ever."""
        return np.inf

    def position_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) (m)."""
        return np.tile(beacon_position_e(self.beacon, self.place), (len(time), 1))

    def rotation_nb(self, time: Array) -> Array:
        """Return rotations (times, 3, 3) from body to north-east-down."""
        return np.tile(np.eye(3), (len(time), 1, 1))

    def rotation_eb(self, time: Array) -> Array:
        """Return rotations (times, 3, 3) from body to Earth-fixed axes."""
        latitude, longitude, _ = geodetic_from_ecef(self.position_e(time))
        return rotation_en(latitude, longitude)

    def transducer_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the transducer: the beacon itself (m)."""
        return self.position_e(time)


class Track(Protocol):
    """A way over the sea."""

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return metres north and east (along meridian and parallel) of the start, and the heading (rad), at times (s)."""
        ...


@dataclass(frozen=True)
class Steady:
    """A constant velocity over ground (m/s); it heads along its course unless a `heading` (rad) is given, as that of a drifting buoy."""

    velocity_north: float = 0.0
    velocity_east: float = 0.0
    heading: float | None = None

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return metres north and east of the start, and the heading (rad), at times (s)."""
        course = float(np.arctan2(self.velocity_east, self.velocity_north)) if self.heading is None else self.heading
        return self.velocity_north * time, self.velocity_east * time, np.full(len(time), course)


@dataclass(frozen=True)
class Circle:
    """A circle to starboard (radius > 0) or to port (radius < 0), in m and m/s, starting on `heading` (rad)."""

    speed: float
    radius: float
    heading: float = 0.0

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return metres north and east of the start, and the heading (rad), at times (s)."""
        heading = self.heading + self.speed / self.radius * time
        north, east = np.sin(heading) - np.sin(self.heading), np.cos(self.heading) - np.cos(heading)
        return self.radius * north, self.radius * east, heading


@dataclass(frozen=True)
class Waypoints:
    """Straight lines from waypoint to waypoint, passed at given times; beyond the ends the first and last lines go on.

    time: ascending (s); north, east: metres of the start.  Around each corner the velocity changes evenly within `turn_time` (s), so
    that it is cut by |dv| turn_time / 8, and heading follows the course.  Raises InputError where the lists do not fit each other.
    """

    time: tuple[float, ...]
    north: tuple[float, ...]
    east: tuple[float, ...]
    turn_time: float = 20.0

    def __post_init__(self) -> None:
        """Refuse lists that do not fit each other, and turns that overlap."""
        count = len(self.time)
        if count < 2 or len(self.north) != count or len(self.east) != count:
            found = f"has {count} times, {len(self.north)} north, {len(self.east)} east"
            raise InputError("Waypoints", found, "give as many of each, two at least")
        gaps = np.diff(self.time)
        if np.any(gaps <= 0.0) or self.turn_time <= 0.0 or np.any(gaps[1:-1] < self.turn_time):
            raise InputError(
                "Waypoints",
                f"times {_listed(self.time)} s with turns of {self.turn_time:g} s",
                "ascending, with time for the turns between",
            )

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return metres north and east of the start, and the heading (rad), at times (s)."""
        corner, way = np.asarray(self.time), np.column_stack([self.north, self.east])
        velocity = np.diff(way, axis=0) / np.diff(corner)[:, None]
        change = np.diff(velocity, axis=0)
        turned_by = np.clip((time[:, None] - corner[1:-1]) / self.turn_time + 0.5, 0.0, 1.0)  # share of each turn that is done
        past = 0.5 * self.turn_time * turned_by**2 + np.maximum(time[:, None] - corner[1:-1] - 0.5 * self.turn_time, 0.0)
        place = way[0] + (time - corner[0])[:, None] * velocity[0] + past @ change
        going = velocity[0] + turned_by @ change
        return place[:, 0], place[:, 1], np.arctan2(going[:, 1], going[:, 0])


def _listed(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


@dataclass(frozen=True)
class Waves:
    """What waves do to something afloat: amplitude (rad, rad, m) and period (s) of roll, pitch and heave, out of step by 1 rad each."""

    roll: Amplitude = (0.0, 8.0)
    pitch: Amplitude = (0.0, 7.0)
    heave: Amplitude = (0.0, 9.0)

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return roll, pitch (rad) and heave (m, positive down) at times (s)."""
        rows = enumerate((self.roll, self.pitch, self.heave))
        roll, pitch, heave = (amplitude * np.sin(2 * np.pi * time / period + k) for k, (amplitude, period) in rows)
        return roll, pitch, heave


CALM = Waves()


@dataclass(frozen=True, kw_only=True)
class Moving:
    """A ship, a buoy or another vehicle: a track over the sea from `place` on, or a whole trajectory, which has a place of its own.

    The reference point goes along the track at the depth of the place below the surface of the moment, which rises with the tide of its
    water, or, where that is calm, of the vehicle's (`afloat_on`); it is moved by `waves`, and the transducer lies at `lever_arm_b` (m)
    from it.  A trajectory knows no waves.  Raises InputError for a track without a place, and for a trajectory with one or with waves.
    """

    motion: Track | Trajectory
    place: Place | None = None
    waves: Waves = CALM
    lever_arm_b: Vector = ZERO
    turnaround: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what does not fit together."""
        whole = isinstance(self.motion, Trajectory)
        if whole != (self.place is None) or (whole and self.waves != CALM):
            found = "a trajectory with a place or waves" if whole else "a track without a place"
            raise InputError("Moving", found, "give a track with its place, or a trajectory alone")

    @property
    def end(self) -> float:
        """Time (s) up to which it is known where it is."""
        return self.motion.end if isinstance(self.motion, Trajectory) else np.inf

    def afloat_on(self, sea: Place) -> Moving:
        """Return it on the water of another place, where it has a track and no water of its own."""
        if self.place is None or self.place.water is not CALM_WATER or sea.water is CALM_WATER:
            return self
        return replace(self, place=replace(self.place, water=sea.water))

    def surface_height(self, time: Array) -> Array:
        """Return the height (times,) of the sea surface above the ellipsoid at times (s), with its tide (m)."""
        return surface_at(self.motion.place if isinstance(self.motion, Trajectory) else cast("Place", self.place), time)

    def geodetic(self, time: Array) -> tuple[Array, Array, Array]:
        """Return latitude, longitude (rad) and height (m) of the reference point."""
        if isinstance(self.motion, Trajectory):
            return self.motion.at(time).geodetic
        place = cast("Place", self.place)
        north, east, _ = self.motion(time)
        latitude, longitude = from_north_east(north, east, place.latitude, place.longitude)
        return latitude, longitude, self.surface_height(time) - place.depth - self.waves(time)[2]

    def position_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the reference point (m)."""
        return self.motion.at(time).position_e if isinstance(self.motion, Trajectory) else ecef_from_geodetic(*self.geodetic(time))

    def rotation_nb(self, time: Array) -> Array:
        """Return rotations (times, 3, 3) from body to north-east-down at the reference point."""
        if isinstance(self.motion, Trajectory):
            return self.motion.at(time).rotation_nb
        roll, pitch, _ = self.waves(time)
        return matrix_from_euler(roll, pitch, self.motion(time)[2])

    def rotation_eb(self, time: Array) -> Array:
        """Return rotations (times, 3, 3) from body to Earth-fixed axes."""
        latitude, longitude, _ = self.geodetic(time)
        return np.asarray(rotation_en(latitude, longitude) @ self.rotation_nb(time))

    def transducer_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the transducer (m)."""
        return point_e(self, time, self.lever_arm_b)


def surface_at(place: Place, time: Array) -> Array:
    """Return the height (times,) of the sea surface above the ellipsoid at times (s), with its tide, without its waves (m)."""
    return np.asarray(place.surface_height + place.water.level(time))


def point_e(carrier: Carrier, time: Array, lever_arm_b: ArrayLike) -> Array:
    """Return Earth-fixed positions (times, 3) of a point of a carrier, at a lever arm (3,) from its reference point (m)."""
    arm = np.asarray(lever_arm_b, float)
    return carrier.position_e(time) + turned(carrier.rotation_eb(time), np.broadcast_to(arm, (len(time), 3)))


@dataclass(frozen=True, kw_only=True)
class PlatformPose(Instrument[records.Platform]):
    """Where platforms are and how they lie, as they tell: of each a row, at each moment.

    Positions are those of a satellite antenna at `lever_arm_b` (m) from the reference point, with `sigma` (m) north, east and down;
    roll, pitch and heading with `sigma_attitude` (rad) each.  Depth counts from the surface of the vehicle's sea at that moment.
    """

    platforms: Mapping[str, Moving | Fixed] = field(default_factory=dict)
    sigma: float = 0.0
    sigma_attitude: Vector = ZERO

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Platform:
        """Return true poses; raises InputError where there is no platform."""
        if not self.platforms:
            raise InputError("PlatformPose", "has no platform", "give one at least")
        names, sea = sorted(self.platforms), trajectory.place
        known = [one.afloat_on(sea) if isinstance(one, Moving) else one for one in (self.platforms[name] for name in names)]
        position_e = np.stack([point_e(one, time, self.lever_arm_b) for one in known], axis=1).reshape(-1, 3)
        rotation_nb = np.stack([one.rotation_nb(time) for one in known], axis=1).reshape(-1, 3, 3)
        latitude, longitude, height = geodetic_from_ecef(position_e)
        roll, pitch, heading = euler(rotation_nb)
        return records.Platform(
            time=np.repeat(time, len(names)), name=np.tile(names, len(time)), latitude=latitude, longitude=longitude,
            depth=np.repeat(surface_at(sea, time), len(names)) - height, roll=roll, pitch=pitch, heading=heading,
        )  # fmt: skip

    def noisy(self, table: records.Platform, generator: Generator) -> records.Platform:
        """Add white noise."""
        rows = len(table)
        error, turn = generator.standard_normal((2, rows, 3)) * np.array([[[self.sigma] * 3], [self.sigma_attitude]])
        latitude, longitude, depth = (cast("Array", v) for v in (table.latitude, table.longitude, table.depth))
        roll, pitch, heading = (cast("Array", v) for v in (table.roll, table.pitch, table.heading))
        latitude, longitude, height = displaced(latitude, longitude, -depth, error)
        stated: dict[str, Any] = {"sigma": np.full(rows, self.sigma)} if self.sigma > 0 else {}
        if min(self.sigma_attitude) > 0:
            stated["sigma_attitude"] = np.tile(self.sigma_attitude, (rows, 1))
        return replace(
            table, latitude=latitude, longitude=longitude, depth=-height, roll=wrapped(roll + turn[:, 0]),
            pitch=pitch + turn[:, 1], heading=(heading + turn[:, 2]) % (2 * np.pi), **stated,
        )  # fmt: skip
