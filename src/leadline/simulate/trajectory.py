"""Truth as analytic functions of time, made in Earth-fixed coordinates: never by a navigation integrator.

A vehicle moves in a tangent frame t that is fixed to the Earth: north-east-down at the place where it starts.  Its angles and its
speeds (or its path) against t are smooth functions of time with exact derivatives, so that any instrument, at any point of the body,
can be asked at any moment.  What navigators struggle with (Earth rate, transport rate, meridians that meet) enters by one fixed
rotation and one fixed origin alone; so a wrong sign in a navigator cannot cancel here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from leadline.core.geodesy import EARTH_RATE, ecef_from_geodetic, north_east, rotation_en
from leadline.data.records import Truth
from leadline.sea.water import CALM, Water
from leadline.simulate.gravity import gravity
from leadline.simulate.places import geodetic_of, local
from leadline.simulate.vectors import cross, turned, turned_back

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array


KEPT = 1_000_000  # most moments whose kinematics are kept for the next who asks


class Motion(NamedTuple):
    """Position, velocity, acceleration (times, 3) in t; rotation (times, 3, 3) body to t; rate against t and its derivative, body axes."""

    position_t: Array
    velocity_t: Array
    acceleration_t: Array
    rotation_tb: Array
    rate_b: Array
    angular_acceleration_b: Array


class Law(Protocol):
    """What moves the vehicle."""

    def __call__(self, time: Array) -> Motion:
        """Return the motion at times (s)."""
        ...


@dataclass(frozen=True)
class Place:
    """Where the frame t lies: latitude, longitude (rad), depth (m) under a mean sea surface `surface_height` (m) above the ellipsoid.

    water: how the sea moves there; its tide lifts the surface from which depths count.
    """

    latitude: float
    longitude: float
    depth: float = 0.0
    surface_height: float = 0.0
    water: Water = CALM

    @cached_property
    def position_e(self) -> Array:
        """Earth-fixed position (3,) of the origin of t (m)."""
        return ecef_from_geodetic(self.latitude, self.longitude, self.surface_height - self.depth)

    @cached_property
    def rotation_et(self) -> Array:
        """Rotation (3, 3) from t to the Earth-fixed frame."""
        return rotation_en(self.latitude, self.longitude)


@dataclass(frozen=True, eq=False)
class Kinematics:
    """All that can be known of one point of the body at `time` (times,); vectors (times, 3), rotations (times, 3, 3), SI and rad."""

    time: Array
    place: Place
    position_t: Array
    velocity_t: Array
    acceleration_t: Array
    rotation_tb: Array
    rate_eb_b: Array  # of the body against the Earth
    angular_acceleration_b: Array  # the derivative of rate_eb_b

    def point(self, lever_arm_b: ArrayLike) -> Kinematics:
        """Return the kinematics of the point at `lever_arm_b` (3,) from this one: r + R l, v + R (w x l), a + R (w' x l + w x (w x l))."""
        arm = np.asarray(lever_arm_b, float)
        if not np.any(arm):
            return self
        swing = cross(self.rate_eb_b, np.broadcast_to(arm, self.rate_eb_b.shape))
        pull = cross(self.angular_acceleration_b, np.broadcast_to(arm, swing.shape)) + cross(self.rate_eb_b, swing)
        return replace(
            self,
            position_t=self.position_t + self.rotation_tb @ arm,
            velocity_t=self.velocity_t + turned(self.rotation_tb, swing),
            acceleration_t=self.acceleration_t + turned(self.rotation_tb, pull),
        )

    @property
    def position_e(self) -> Array:
        """Earth-fixed position (m)."""
        return self.place.position_e + self.position_t @ self.place.rotation_et.T

    @property
    def velocity_e(self) -> Array:
        """Velocity against the Earth, Earth-fixed axes (m/s)."""
        return self.velocity_t @ self.place.rotation_et.T

    @property
    def acceleration_e(self) -> Array:
        """Second derivative of position_e (m/s^2)."""
        return self.acceleration_t @ self.place.rotation_et.T

    @property
    def rotation_eb(self) -> Array:
        """Rotation from body to Earth-fixed axes."""
        return np.asarray(self.place.rotation_et @ self.rotation_tb)

    @cached_property
    def geodetic(self) -> tuple[Array, Array, Array]:
        """Latitude, longitude (rad) and height above the ellipsoid (m)."""
        return geodetic_of(self.position_e)

    @property
    def depth(self) -> Array:
        """Depth below the sea surface of that moment, without its waves (m)."""
        return np.asarray(self.chart_depth + self.place.water.level(self.time))

    @property
    def chart_depth(self) -> Array:
        """Depth below the mean sea surface (m), from which the depths of a chart count."""
        return np.asarray(self.place.surface_height - self.geodetic[2])

    @cached_property
    def north_east(self) -> tuple[Array, Array]:
        """Metres north and east of the place, along meridian and parallel."""
        return north_east(*self.geodetic[:2], self.place.latitude, self.place.longitude)

    @property
    def water_velocity_n(self) -> Array:
        """Velocity of the water at the point, north, east, down (m/s)."""
        north, east = self.north_east
        return self.place.water.velocity_n(self.time, north, east, self.chart_depth)

    @cached_property
    def rotation_nb(self) -> Array:
        """Rotation from body to north-east-down at the point itself."""
        return local(*self.geodetic[:2], self.rotation_eb)

    @property
    def velocity_n(self) -> Array:
        """Velocity over ground, north-east-down at the point itself (m/s)."""
        return turned_back(rotation_en(*self.geodetic[:2]), self.velocity_e)

    @property
    def velocity_b(self) -> Array:
        """Velocity over ground, body axes (m/s)."""
        return turned_back(self.rotation_tb, self.velocity_t)

    @property
    def rate_ib_b(self) -> Array:
        """Angular rate of the body against inertial space, body axes: what a gyro feels (rad/s)."""
        return np.asarray(self.rate_eb_b + turned_back(self.rotation_tb, EARTH_RATE * self.place.rotation_et[2]))

    @property
    def specific_force_b(self) -> Array:
        """Specific force, body axes: what an accelerometer feels, f = R_be (a_e + 2 W x v_e - g_e) (m/s^2)."""
        latitude, longitude, height = self.geodetic
        level = np.cos(latitude)
        up_e = np.stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)], axis=-1)
        lift = gravity(latitude, height, self.place.surface_height)[:, None] * (up_e @ self.place.rotation_et)
        coriolis = cross(np.broadcast_to(2 * EARTH_RATE * self.place.rotation_et[2], lift.shape), self.velocity_t)
        return turned_back(self.rotation_tb, self.acceleration_t + coriolis + lift)


@dataclass(frozen=True)
class Trajectory:
    """The truth of a vehicle that starts at `place` at time 0 and moves by `law` for `duration` seconds."""

    place: Place
    law: Law
    duration: float
    last: list[Kinematics] = field(default_factory=list, compare=False, repr=False)  # asked for by several instruments of one rate

    @property
    def begin(self) -> float:
        """Time (s) from which on its motion is known: before time 0, or -inf."""
        return float(getattr(self.law, "begin", -np.inf))

    @property
    def end(self) -> float:
        """Time (s) up to which its motion is known: after `duration`, or inf."""
        return float(getattr(self.law, "end", np.inf))

    def at(self, time: ArrayLike) -> Kinematics:
        """Return the kinematics of the body origin at times (s), in any order."""
        when = np.atleast_1d(np.asarray(time, float))
        if self.last and np.array_equal(self.last[0].time, when):
            return self.last[0]
        found = Kinematics(when.copy(), self.place, *self.law(when))
        if len(when) <= KEPT:
            self.last[:] = [found]
        return found

    def truth(self, time: ArrayLike) -> Truth:
        """Return the table of truth at times (s): position, depth, height, angles and velocity over ground."""
        state = self.at(time)
        latitude, longitude, height = state.geodetic
        roll, pitch, heading = euler(state.rotation_nb)
        return Truth(
            time=state.time, latitude=latitude, longitude=longitude, height=height, depth=state.depth,
            roll=roll, pitch=pitch, heading=heading, velocity=state.velocity_n,
        )  # fmt: skip


def euler(rotation_nb: Array) -> tuple[Array, Array, Array]:
    """Return roll, pitch, and heading in [0, 2 pi) (rad), of rotations (..., 3, 3)."""
    r = rotation_nb
    pitch = np.arctan2(-r[..., 2, 0], np.hypot(r[..., 0, 0], r[..., 1, 0]))
    return np.arctan2(r[..., 2, 1], r[..., 2, 2]), pitch, np.arctan2(r[..., 1, 0], r[..., 0, 0]) % (2 * np.pi)
