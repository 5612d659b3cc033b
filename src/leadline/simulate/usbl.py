"""What heads with a short and an ultra-short baseline would have recorded: direction and distance at once, or positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from leadline.core.attitude import matrix_from_euler
from leadline.core.geodesy import ecef_from_geodetic, geodetic_from_ecef, north_east, rotation_en
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.acoustics import Acoustic, AcousticRange, Turns
from leadline.simulate.instrument import ZERO, Instrument, Vector
from leadline.simulate.platforms import point_e, surface_at
from leadline.simulate.trajectory import euler
from leadline.simulate.vectors import cross, turned, turned_back

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.log import Beacon
    from leadline.data.records import Array
    from leadline.sea.sound import SoundProfile
    from leadline.simulate.acoustics import Exchange
    from leadline.simulate.platforms import Moving
    from leadline.simulate.trajectory import Trajectory

T = TypeVar("T", bound=records.Table)
FLAT = 1e-9  # smallest eigenvalue of the normal matrix of unit vectors with which a position can be solved


def angles(direction: Array) -> tuple[Array, Array]:
    """Return azimuth (from x towards y) and elevation (from the xy plane, positive towards z), rad, of vectors (rows, 3)."""
    x, y, z = direction.T
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))


def direction(azimuth: Array, elevation: Array) -> Array:
    """Return unit vectors (rows, 3): the inverse of `angles`."""
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def tilted(vector: Array, sigma: float, generator: Generator) -> Array:
    """Return vectors (rows, 3) of the same length, turned by N(0, sigma) rad about each of two axes across them."""
    push = sigma * generator.standard_normal(vector.shape)
    unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    across = push - np.sum(push * unit, axis=1, keepdims=True) * unit
    angle = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(vector, axis=1, keepdims=True) * (np.cos(angle) * unit + np.sinc(angle / np.pi) * across))


@dataclass(frozen=True, kw_only=True)
class Head(Acoustic[T]):
    """A head that hears from where sound comes: on the vehicle, asking `beacons` and `platforms` in turn, or on a `ship`, asking it.

    The head lies at `lever_arm_b` (m) from the reference point of vehicle or ship, turned against it by `mounting_bs`.  On a ship, its
    log is one of the vehicle's transponder, called `transponder`, at `transponder_b` (m), which replies after `turnaround` (s); the
    head is called `receiver`.  `path`: two_way, the head asks; one_way, the other one sends by the clock.
    """

    ship: Moving | None = None
    receiver: str = ""
    transponder: str = "vehicle"
    transponder_b: Vector = ZERO
    turnaround: float = 0.0
    sigma_angle: float = 0.0

    def parties(self, trajectory: Trajectory, rows: int) -> Turns:
        """Return who is heard in each row; raises InputError where there is nobody, or a path that is unknown."""
        where = type(self).__name__
        if self.path not in ("one_way", "two_way") or self.output not in ("travel_time", "range"):
            raise InputError(where, f"path '{self.path}', output '{self.output}'", "one_way or two_way, travel_time or range")
        heard = bool(self.beacons or self.platforms)
        if heard == (self.ship is not None):
            raise InputError(where, f"{len(self.beacons) + len(self.platforms)} beacons and platforms", "some, or a ship: one of the two")
        if self.ship is None:
            return self.turns(trajectory.place, rows)
        return Turns((self.transponder,), (Vehicle(trajectory, self.transponder_b, self.turnaround),), np.zeros(rows, int))

    def head_e(self, trajectory: Trajectory, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the head (m)."""
        if self.ship is None:
            return trajectory.at(time).point(self.lever_arm_b).position_e
        return point_e(self.ship.afloat_on(trajectory.place), time, self.lever_arm_b)

    def ping(self, trajectory: Trajectory, time: Array) -> tuple[Turns, Exchange]:
        """Return who was asked at times (s), and what came of it."""
        turns = self.parties(trajectory, len(time))
        end = trajectory.end if self.ship is None else self.ship.end
        return turns, self.exchange(time, lambda t: self.head_e(trajectory, t), turns, trajectory.place.surface_height, end)

    def arriving_n(self, head_e: Array, place_e: Array, surface_height: float) -> Array:
        """Return unit vectors (rows, 3), north-east-down at the head, to where sound comes from: along the ray, where it is bent."""
        latitude, longitude, _ = geodetic_from_ecef(head_e)
        azimuth, elevation = angles(turned_back(rotation_en(latitude, longitude), place_e - head_e))
        if self.profile is not None:
            rays, level, down = self.rays(head_e, place_e, surface_height)
            elevation = elevation + rays.angle_a - np.arctan2(down, level)  # the chord lies above its flat picture by the Earth's curve
        return direction(azimuth, elevation)


@dataclass(frozen=True)
class Vehicle:
    """The vehicle as one that replies."""

    trajectory: Trajectory
    lever_arm_b: Vector
    turnaround: float

    @property
    def end(self) -> float:
        """Time (s) up to which it is known where it is."""
        return self.trajectory.end

    def position_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the body origin (m)."""
        return self.trajectory.at(time).position_e

    def rotation_eb(self, time: Array) -> Array:
        """Return rotations (times, 3, 3) from body to Earth-fixed axes."""
        return self.trajectory.at(time).rotation_eb

    def transducer_e(self, time: Array) -> Array:
        """Return Earth-fixed positions (times, 3) of the transponder (m)."""
        return self.trajectory.at(time).point(self.lever_arm_b).position_e


@dataclass(frozen=True, kw_only=True)
class Usbl(Head[records.Usbl]):
    """Direction of the arriving ray and distance of each ping; times, turn-around and columns are those of AcousticRange.

    `frame` "sensor": angles in the axes of the head; "level": in those of its carrier with roll and pitch taken out, x horizontally
    over the bow (the mounting is taken out as well).  The direction is off by N(0, `sigma_angle`) (rad) about each of two axes across
    it, so that azimuth has sigma_angle / cos(elevation); `sigma` is that of the time (s), of the range (m) where `output` is "range".
    """

    frame: str = "sensor"

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Usbl:
        """Return true angles and times; raises InputError for a frame that is unknown."""
        if self.frame not in ("sensor", "level"):
            raise InputError("Usbl", f"frame '{self.frame}'", "sensor or level")
        turns, pings = self.ping(trajectory, time)
        surface = trajectory.place.surface_height
        known = np.where(np.isfinite(pings.arrival), pings.arrival, time)
        head_e = self.head_e(trajectory, known)
        azimuth, elevation = angles(turned_back(self._axes(trajectory, known, head_e), self.arriving_n(head_e, pings.place_e, surface)))
        columns: dict[str, Any] = {"turnaround": turns.turnaround} if self.path == "two_way" else {}
        if self.receiver:
            columns["receiver"] = np.full(len(time), self.receiver)
        table = records.Usbl(
            time=pings.arrival, transmit=time, travel_time=pings.arrival - time, azimuth=azimuth, elevation=elevation,
            transmitter=turns.transmitter, path=np.full(len(time), self.path), frame=np.full(len(time), self.frame),
            **columns, **self.told(turns, pings.replied, pings.place_e, trajectory.place),
        )  # fmt: skip
        return cast("records.Usbl", table.select(np.isfinite(pings.arrival)))

    def _axes(self, trajectory: Trajectory, time: Array, head_e: Array) -> Array:
        """Rotations (rows, 3, 3) to north-east-down at the head from the axes that angles are in."""
        latitude, longitude, _ = geodetic_from_ecef(head_e)
        rotation_eb = trajectory.at(time).rotation_eb if self.ship is None else self.ship.rotation_eb(time)
        rotation_nb = np.swapaxes(rotation_en(latitude, longitude), -1, -2) @ rotation_eb
        if self.frame == "level":
            flat = np.zeros(len(time))
            return matrix_from_euler(flat, flat, euler(rotation_nb)[2])
        return np.asarray(rotation_nb @ self.rotation_bs)

    def noisy(self, table: records.Usbl, generator: Generator) -> records.Usbl:
        """Add noise of directions and times, and losses."""
        losses, pointing, timing, turning, stated = generator.spawn(5)
        rows, heard = len(table), self.kept(self.distance(table), losses)
        ways = 1.0 if table.turnaround is None else 2.0
        error = self.sigma * timing.standard_normal(rows) * (ways / self.sound_speed if self.output == "range" else 1.0)
        if table.turnaround is not None:
            error = error + self.sigma_turnaround * turning.standard_normal(rows)
        told = self.timed(self.told_wrong(table, stated), error)
        if self.sigma_angle:
            true = direction(cast("Array", table.azimuth), cast("Array", table.elevation))
            azimuth, elevation = angles(tilted(true, self.sigma_angle, pointing))
            told = replace(told, azimuth=azimuth, elevation=elevation)
        return told if np.all(heard) else cast("records.Usbl", told.select(heard))


@dataclass(frozen=True, kw_only=True)
class UsblFix(Head[records.PositionFix]):
    """Positions of the vehicle's transponder, solved by a ship from its USBL, its satellite antenna and its attitude.

    `time` is the transponder's event (its reply), whose surface depths count from; what `latency` adds counts from there.
    The ship knows its reference point to `sigma_position` (m; north, east, down), its roll, pitch and heading to `sigma_attitude` (rad);
    bent rays it accounts for, but for a part `sigma_scale` of the distance, drawn at turn-on; directions and distances are off as those
    of Usbl.  Its sigmas are stated.
    """

    sigma_position: Vector = ZERO
    sigma_attitude: Vector = ZERO
    sigma_scale: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.PositionFix:
        """Return true positions of the transponder; raises InputError where there is no ship."""
        if self.ship is None:
            raise InputError("UsblFix", "has no ship", "give one")
        _, pings = self.ping(trajectory, time)
        there = np.isfinite(pings.arrival)
        latitude, longitude, height = geodetic_from_ecef(pings.place_e[there])
        replied = pings.replied[there]
        depth = surface_at(trajectory.place, replied) - height
        return records.PositionFix(time=replied, latitude=latitude, longitude=longitude, depth=depth, source=np.full(len(replied), "usbl"))

    def noisy(self, table: records.PositionFix, generator: Generator) -> records.PositionFix:
        """Add the errors of direction, distance, attitude and position of the ship, and losses."""
        ship, rows = cast("Moving", self.ship), len(table)
        losses, pointing, ranging, attitude, position = generator.spawn(5)
        surface = ship.surface_height(table.time)
        place_e = ecef_from_geodetic(cast("Array", table.latitude), cast("Array", table.longitude), surface - cast("Array", table.depth))
        rotation = rotation_en(*ship.geodetic(table.time)[:2])
        rotation_nb, arm = ship.rotation_nb(table.time), np.asarray(self.lever_arm_b, float)
        gap_n = turned_back(rotation, place_e - point_e(ship, table.time, arm))
        distance = np.linalg.norm(gap_n, axis=1)
        heard = self.kept(distance, losses)
        longer = 1.0 + self.sigma_scale * ranging.standard_normal() + self._sigma_range() * ranging.standard_normal(rows) / distance
        seen_b = arm + turned_back(rotation_nb, tilted(gap_n, self.sigma_angle, pointing) * longer[:, None])
        wrong = np.asarray(self.sigma_attitude) * attitude.standard_normal((rows, 3))
        believed = matrix_from_euler(*(angle + error for angle, error in zip(euler(rotation_nb), wrong.T, strict=True)))
        off = turned(believed, seen_b) - gap_n - rotation_nb @ arm
        off = off + np.asarray(self.sigma_position) * position.standard_normal((rows, 3))
        latitude, longitude, height = geodetic_from_ecef(place_e + turned(rotation, off))
        stated = _stated(self._covariance(gap_n, rotation_nb))
        result = replace(table, latitude=latitude, longitude=longitude, depth=surface - height, **stated)
        return result if np.all(heard) else cast("records.PositionFix", result.select(heard))

    def _sigma_range(self) -> float:
        """Sigma of a distance, white (m)."""
        if self.output == "range":
            return self.sigma
        return self.sound_speed * (0.5 * float(np.hypot(self.sigma, self.sigma_turnaround)) if self.path == "two_way" else self.sigma)

    def _covariance(self, gap_n: Array, rotation_nb: Array) -> Array:
        """Covariances (rows, 3, 3) of the fixes, north-east-down (m^2), to first order."""
        distance = np.linalg.norm(gap_n, axis=1)[:, None, None]
        along = gap_n[:, :, None] * gap_n[:, None, :] / distance**2
        heading = euler(rotation_nb)[2]
        zero, one = np.zeros_like(heading), np.ones_like(heading)
        arm_n = gap_n + rotation_nb @ np.asarray(self.lever_arm_b, float)
        axes = (rotation_nb[:, :, 0], np.stack([-np.sin(heading), np.cos(heading), zero], axis=1), np.stack([zero, zero, one], axis=1))
        swings = [sigma * cross(axis, arm_n) for sigma, axis in zip(self.sigma_attitude, axes, strict=True)]
        total = np.diag(np.square(self.sigma_position)) + sum(swing[:, :, None] * swing[:, None, :] for swing in swings)
        across = distance**2 * self.sigma_angle**2 * (np.eye(3) - along)
        return np.asarray(total + across + (self._sigma_range() ** 2 + (self.sigma_scale * distance) ** 2) * along)


def _stated(covariance: Array) -> dict[str, Any]:
    """The columns of sigmas of a fix; none where it is exact."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    if not len(sigma) or np.min(sigma) <= 0.0:
        return {}
    return {"sigma_axes": sigma, "cov_north_east": covariance[:, 0, 1]}


@dataclass(frozen=True, kw_only=True)
class ShortBaseline(Instrument[records.AcousticRange | records.PositionFix]):
    """Three or more transducers at known places, and the vehicle among or below them; after each fix the next interval is drawn anew.

    Intervals are U(`interval_min`, `interval_max`) (s); they are drawn for each seed.  `output` "range": a one-way row of AcousticRange
    for each transducer, in seconds; "fix": the position (metres north and east of the start, depth) by least squares of the distances,
    whose errors have `sigma` (s) times `sound_speed` each, to first order, with the sigmas that follow from the places; no row where the
    vehicle lies in one plane with all transducers.  Each fix is lost with `dropout`, each range too.
    """

    rate: float = 1.0  # not used: intervals are drawn
    jitter: float = 1.0  # not zero, so that the moments of each seed are its own
    transducers: Mapping[str, Beacon] = field(default_factory=dict)
    interval_min: float = 0.1
    interval_max: float = 2.0
    sound_speed: float = 1500.0
    profile: SoundProfile | None = None
    sigma: float = 0.0
    dropout: float = 0.0
    output: str = "fix"

    def sampling(self, duration: float, generator: Generator) -> Array:
        """Return the moments (s) of the pings; raises InputError where the bounds of the interval are not in order."""
        if not 0.0 < self.interval_min <= self.interval_max:
            raise InputError("ShortBaseline", f"intervals of {self.interval_min:g} to {self.interval_max:g} s", "above 0, in order")
        end = min(self.stop, duration)
        count = int(max(end - self.offset, 0.0) / self.interval_min) + 1
        time = self.offset + np.concatenate([[0.0], np.cumsum(generator.uniform(self.interval_min, self.interval_max, count))])
        return time[time <= end]

    @property
    def ranges(self) -> AcousticRange:
        """The same transducers, each as a beacon that sends one way."""
        return AcousticRange(
            rate=self.rate, beacons=self.transducers, path="one_way", sound_speed=self.sound_speed, profile=self.profile,
            sigma=self.sigma, dropout=self.dropout, lever_arm_b=self.lever_arm_b,
        )  # fmt: skip

    def ideal(self, trajectory: Trajectory, time: Array) -> records.AcousticRange | records.PositionFix:
        """Return true travel times, or positions of the vehicle's pinger; raises InputError for fewer than three transducers."""
        if len(self.transducers) < 3 or self.output not in ("fix", "range"):
            raise InputError(
                "ShortBaseline", f"{len(self.transducers)} transducers, output '{self.output}'", "three at least; fix or range"
            )
        if self.output == "range":
            return self.ranges.ideal(trajectory, np.repeat(time, len(self.transducers)))
        state, place = trajectory.at(time).point(self.lever_arm_b), trajectory.place
        north, east = north_east(*state.geodetic[:2], place.latitude, place.longitude)
        table = records.PositionFix(time=time, north=north, east=east, depth=state.depth, source=np.full(len(time), "sbl"))
        solvable = np.linalg.eigvalsh(self._normal(table)[1])[:, 0] > FLAT
        return table if np.all(solvable) else cast("records.PositionFix", table.select(solvable))

    def _normal(self, table: records.PositionFix) -> tuple[Array, Array]:
        """Unit vectors (rows, transducers, 3) from each transducer to the vehicle, and their normal matrices (rows, 3, 3)."""
        where = np.stack([cast("Array", table.north), cast("Array", table.east), cast("Array", table.depth)], axis=1)
        gap = where[:, None, :] - np.array([_local(name, beacon) for name, beacon in sorted(self.transducers.items())])
        unit = gap / np.linalg.norm(gap, axis=2, keepdims=True)
        return unit, np.swapaxes(unit, 1, 2) @ unit

    def noisy(
        self, table: records.AcousticRange | records.PositionFix, generator: Generator
    ) -> records.AcousticRange | records.PositionFix:
        """Add what noise of the distances does, and losses."""
        if isinstance(table, records.AcousticRange):
            return self.ranges.noisy(table, generator)
        losses, noise = generator.spawn(2)
        unit, normal = self._normal(table)
        sigma, inverse = self.sound_speed * self.sigma, np.asarray(np.linalg.inv(normal), np.float64)
        distances = sigma * noise.standard_normal(unit.shape[:2])
        error = turned(inverse, turned_back(unit, distances))
        north, east, depth = (cast("Array", v) + e for v, e in zip((table.north, table.east, table.depth), error.T, strict=True))
        result = replace(table, north=north, east=east, depth=depth, **_stated(sigma**2 * inverse))
        heard = losses.random(len(table)) >= self.dropout
        return result if np.all(heard) else cast("records.PositionFix", result.select(heard))


def _local(name: str, beacon: Beacon) -> tuple[float, float, float]:
    if beacon.north is None or beacon.east is None:
        raise InputError("ShortBaseline", f"transducer '{name}' has no north and east", "give its place in metres from the start")
    return beacon.north, beacon.east, beacon.depth
