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

from leadline.core.attitude import matrix_from_euler
from leadline.core.geodesy import (
    EARTH_RATE,
    ECCENTRICITY_2,
    FLATTENING,
    SEMI_MAJOR_AXIS,
    ecef_from_geodetic,
    geodetic_from_ecef,
    rotation_en,
)
from leadline.data.errors import InputError
from leadline.data.records import Truth

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array

GRAVITY_EQUATOR, GRAVITY_POLE = 9.7803253359, 9.8321849378  # m/s^2 on the ellipsoid, NIMA TR8350.2 (2000), table 3.4
GRAVITY_RATIO = 0.00344978650684  # omega^2 a^2 b / GM, the same
GRAVITATIONAL_CONSTANT, SEA_DENSITY = 6.6743e-11, 1028.0  # m^3/(kg s^2), CODATA 2018; kg/m^3
KNOT_STEP, KNOT_MARGIN = 0.05, 200  # s between knots of a driven position; knots before time 0 and after the duration


def free_air_gravity(latitude: ArrayLike, height: ArrayLike) -> Array:
    """Return normal gravity (m/s^2) at latitudes (rad) and ellipsoidal heights (m), outside all masses.

    Somigliana on the ellipsoid, second order in height: NIMA TR8350.2 (2000), equations 4-1 and 4-3.
    """
    sine_2, h = np.sin(np.asarray(latitude, float)) ** 2, np.asarray(height, float)
    growth = (1 - FLATTENING) * GRAVITY_POLE / GRAVITY_EQUATOR - 1
    surface = GRAVITY_EQUATOR * (1 + growth * sine_2) / np.sqrt(1 - ECCENTRICITY_2 * sine_2)
    slope = 2 / SEMI_MAJOR_AXIS * (1 + FLATTENING + GRAVITY_RATIO - 2 * FLATTENING * sine_2)
    return np.asarray(surface * (1 - slope * h + 3 / SEMI_MAJOR_AXIS**2 * h * h))


def gravity(latitude: ArrayLike, height: ArrayLike, surface_height: float = 0.0) -> Array:
    """Return plumb gravity (m/s^2) in air and in the sea, whose surface lies at `surface_height` (m above the ellipsoid).

    g = free_air(height) - 4 pi G rho depth below the surface: the water above no longer pulls down (its layer counts twice,
    Dahlen, 1982), so that gravity grows by 2.2e-6 per metre of depth where free air alone would give 3.1e-6.
    """
    depth = np.maximum(surface_height - np.asarray(height, float), 0.0)
    return np.asarray(free_air_gravity(latitude, height) - 4 * np.pi * GRAVITATIONAL_CONSTANT * SEA_DENSITY * depth)


class Profile(Protocol):
    """A smooth scalar function of time."""

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times), orders at most 4."""
        ...


@dataclass(frozen=True)
class Ramp:
    """value + slope * time."""

    value: float = 0.0
    slope: float = 0.0

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        result = np.zeros((orders, len(time)))
        result[0] = self.value + self.slope * time
        result[1:2] = self.slope
        return result


@dataclass(frozen=True)
class Sinusoid:
    """amplitude * sin(2 pi time / period + phase)."""

    amplitude: float
    period: float
    phase: float = 0.0

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        omega = 2 * np.pi / self.period
        sine, cosine = np.sin(omega * time + self.phase), np.cos(omega * time + self.phase)
        return np.stack([self.amplitude * omega**k * (sine, cosine, -sine, -cosine)[k] for k in range(orders)])


@dataclass(frozen=True)
class Steps:
    """A staircase: values[0], then from start[i], within length[i], smoothly to values[i + 1].

    The step is the polynomial of degree 9 in x = (time - start) / length whose first four derivatives vanish at both ends:
    s' = 630 x^4 (1 - x)^4.
    """

    start: tuple[float, ...]
    length: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse steps that overlap."""
        if np.any(np.array(self.start[:-1]) + self.length[:-1] > np.array(self.start[1:]) + 1e-9):
            raise InputError("Steps", f"steps overlap: start {self.start}, length {self.length}", "let one end before the next")

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        index = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        values, length = np.asarray(self.values), np.asarray(self.length)[index]
        x = np.clip((time - np.asarray(self.start)[index]) / length, 0.0, 1.0)
        q, slope = x * (1 - x), 1 - 2 * x
        q_2, x_4 = q * q, x * x * x * x
        shape = (
            lambda: x_4 * x * (126 + x * (-420 + x * (540 + x * (-315 + 70 * x)))),
            lambda: 630 * q_2 * q_2 / length,
            lambda: 2520 * q_2 * q * slope / length**2,
            lambda: 2520 * q_2 * (3 * slope * slope - 2 * q) / length**3,
        )
        result = np.stack([shape[k]() for k in range(orders)]) * np.diff(values)[index]
        result[0] += values[index]
        return result


@dataclass(frozen=True)
class Sum:
    """The sum of several profiles."""

    parts: tuple[Profile, ...]

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        return np.asarray(np.sum([part(time, orders) for part in self.parts], axis=0))


class Motion(NamedTuple):
    """Position, velocity, acceleration (times, 3) in t, and the angles (orders 3, roll-pitch-heading 3, times) against t."""

    position_t: Array
    velocity_t: Array
    acceleration_t: Array
    angles: Array


class Law(Protocol):
    """What moves the vehicle."""

    def __call__(self, time: Array) -> Motion:
        """Return the motion at times (s)."""
        ...


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


def body_rate(angles: Array) -> tuple[Array, Array]:
    """Return angular rate and its derivative (times, 3), body axes, of Z-Y-X `angles` (value, first, second; 3; times)."""
    (roll, pitch, _), (d_roll, d_pitch, d_heading), (dd_roll, dd_pitch, dd_heading) = angles
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    rate = [d_roll - d_heading * sp, d_pitch * cr + d_heading * sr * cp, -d_pitch * sr + d_heading * cr * cp]
    growth = [
        dd_roll - dd_heading * sp - d_heading * d_pitch * cp,
        dd_pitch * cr + dd_heading * sr * cp + d_roll * rate[2] - d_heading * d_pitch * sr * sp,
        -dd_pitch * sr + dd_heading * cr * cp - d_roll * rate[1] - d_heading * d_pitch * cr * sp,
    ]
    return np.stack(rate, axis=-1), np.stack(growth, axis=-1)


@dataclass(frozen=True)
class Driven:
    """Angles and body speeds are given; position is their integral, to 1e-9 m.

    velocity_t = R_tb u_b is integrated by Gauss-Legendre quadrature (4 points) between knots 0.05 s apart; between knots the quintic
    that meets position, velocity and acceleration at both (error h^6 / 46080 of the sixth derivative: 1e-11 m for a vehicle).
    """

    roll: Profile
    pitch: Profile
    heading: Profile
    forward: Profile
    starboard: Profile
    down: Profile
    duration: float

    def _motion(self, time: Array) -> tuple[Array, Array, Array]:
        angles = np.stack([profile(time, 3) for profile in (self.roll, self.pitch, self.heading)], axis=1)
        speeds = np.stack([profile(time, 2) for profile in (self.forward, self.starboard, self.down)], axis=-1)
        rotation, (rate, _) = matrix_from_euler(*angles[0]), body_rate(angles)
        return turned(rotation, speeds[0]), turned(rotation, speeds[1] + cross(rate, speeds[0])), angles

    @cached_property
    def knots(self) -> tuple[Array, Array, Array, Array]:
        """Times (knots,), and position, velocity, acceleration (knots, 3) in t."""
        count = int(np.ceil(self.duration / KNOT_STEP)) + 2 * KNOT_MARGIN + 1
        time = np.asarray(KNOT_STEP * (np.arange(count) - KNOT_MARGIN), float)
        nodes, weights = np.polynomial.legendre.leggauss(4)
        inside = time[:-1, None] + 0.5 * KNOT_STEP * (1 + nodes)
        moved = 0.5 * KNOT_STEP * np.einsum("kjc,j->kc", self._motion(inside.ravel())[0].reshape(*inside.shape, 3), weights)
        position = np.concatenate([np.zeros((1, 3)), np.cumsum(moved, axis=0)])
        velocity, acceleration, _ = self._motion(time)
        return time, position - position[KNOT_MARGIN], velocity, acceleration

    def __call__(self, time: Array) -> Motion:
        """Return the motion at times (s) between -10 s and the duration + 10 s; raises InputError outside."""
        knots, position, velocity, acceleration = self.knots
        if len(time) and not (knots[0] <= np.min(time) and np.max(time) <= knots[-1]):
            raise InputError("trajectory", f"is asked for times {np.min(time)} to {np.max(time)} s", f"it lasts {self.duration} s")
        k = np.clip(((time - knots[0]) / KNOT_STEP).astype(int), 0, len(knots) - 2)
        h, x = KNOT_STEP, ((time - knots[k]) / KNOT_STEP)[:, None]
        velocity_0, acceleration_0 = h * velocity[k], 0.5 * h * h * acceleration[k]
        p = position[k + 1] - position[k] - velocity_0 - acceleration_0
        v = h * velocity[k + 1] - velocity_0 - 2 * acceleration_0
        a = 0.5 * h * h * acceleration[k + 1] - acceleration_0
        quintic = (10 * p - 4 * v + a) + x * ((-15 * p + 7 * v - 2 * a) + x * (6 * p - 3 * v + a))
        place = position[k] + x * (velocity_0 + x * (acceleration_0 + x * quintic))
        return Motion(place, *self._motion(time))


@dataclass(frozen=True)
class Path:
    """The path in t is given in closed form, and heading is the course along it; the path must never stop."""

    north: Profile
    east: Profile
    down: Profile
    roll: Profile = field(default_factory=Ramp)
    pitch: Profile = field(default_factory=Ramp)

    def __call__(self, time: Array) -> Motion:
        """Return the motion at times (s)."""
        (_, n1, n2, n3), (_, e1, e2, e3), _ = path = [p(time, 4) for p in (self.north, self.east, self.down)]
        square = n1 * n1 + e1 * e1
        turn = (n1 * e2 - e1 * n2) / square
        turn_rate = (n1 * e3 - e1 * n3 - 2 * turn * (n1 * n2 + e1 * e2)) / square
        heading = np.stack([np.arctan2(e1, n1), turn, turn_rate])
        angles = np.stack([self.roll(time, 3), self.pitch(time, 3), heading], axis=1)
        position, velocity, acceleration, _ = np.stack(path, axis=-1)
        return Motion(position, velocity, acceleration, angles)


@dataclass(frozen=True)
class Place:
    """Where a trajectory starts: latitude, longitude (rad), depth (m) under a sea surface `surface_height` (m) above the ellipsoid."""

    latitude: float
    longitude: float
    depth: float = 0.0
    surface_height: float = 0.0

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
        return geodetic_from_ecef(self.position_e)

    @property
    def depth(self) -> Array:
        """Depth below the sea surface (m)."""
        return np.asarray(self.place.surface_height - self.geodetic[2])

    @property
    def rotation_nb(self) -> Array:
        """Rotation from body to north-east-down at the point itself."""
        rotation_et = self.place.rotation_et
        return np.asarray(np.swapaxes(rotation_en(*self.geodetic[:2]), -1, -2) @ rotation_et @ self.rotation_tb)

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

    def at(self, time: ArrayLike) -> Kinematics:
        """Return the kinematics of the body origin at times (s), in any order."""
        when = np.atleast_1d(np.asarray(time, float))
        position, velocity, acceleration, angles = self.law(when)
        return Kinematics(when, self.place, position, velocity, acceleration, matrix_from_euler(*angles[0]), *body_rate(angles))

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


@dataclass(frozen=True)
class Weave:
    """The gentle motion on top of a plan: amplitude and period (s) of each angle (rad) and each body speed (m/s)."""

    roll: tuple[float, float] = (0.0, 6.1)
    pitch: tuple[float, float] = (0.0, 7.3)
    heading: tuple[float, float] = (0.0, 23.0)
    forward: tuple[float, float] = (0.0, 31.0)
    starboard: tuple[float, float] = (0.0, 11.0)
    down: tuple[float, float] = (0.0, 8.9)


GENTLE = Weave((0.03, 6.1), (0.015, 7.3), (0.02, 23.0), (0.05, 31.0), (0.04, 11.0), (0.03, 8.9))


def driven(
    place: Place, duration: float, *, forward: Profile, heading: Profile, pitch: Profile, roll: Profile | None = None, weave: Weave
) -> Trajectory:
    """Return the trajectory of planned speed and angles with a weave on top."""
    plan = {"roll": roll or Ramp(), "pitch": pitch, "heading": heading, "forward": forward, "starboard": Ramp(), "down": Ramp()}
    woven: dict[str, Profile] = {}
    for k, (name, profile) in enumerate(plan.items()):
        amplitude, period = getattr(weave, name)
        woven[name] = Sum((profile, Sinusoid(amplitude, period, float(k)))) if amplitude else profile
    return Trajectory(place, Driven(**woven, duration=duration), duration)


def still(place: Place, duration: float, *, heading: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Trajectory:
    """Return a vehicle at rest on the Earth."""
    return driven(place, duration, forward=Ramp(), heading=Ramp(heading), pitch=Ramp(pitch), roll=Ramp(roll), weave=Weave())


def straight(place: Place, duration: float, *, speed: float, heading: float = 0.0, weave: Weave = GENTLE) -> Trajectory:
    """Return a straight line of the tangent frame (it rises from the ellipsoid by s^2 / 2R: 8 cm at 1 km)."""
    return driven(place, duration, forward=Ramp(speed), heading=Ramp(heading), pitch=Ramp(), weave=weave)


def circle(place: Place, duration: float, *, speed: float, radius: float, heading: float = 0.0, weave: Weave = GENTLE) -> Trajectory:
    """Return a circle to starboard (radius > 0) or to port (radius < 0), starting on `heading`."""
    return driven(place, duration, forward=Ramp(speed), heading=Ramp(heading, speed / radius), pitch=Ramp(), weave=weave)


def figure_eight(
    place: Place, duration: float, *, speed: float, length: float, width: float, weave: Weave = GENTLE, heave: float = 0.5
) -> Trajectory:
    """Return a figure of eight in closed form: north length/2 sin(wt), east width/2 sin(2wt), at a mean of `speed` (m/s)."""
    phase = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    circuit = 2 * np.pi * np.mean(np.hypot(0.5 * length * np.cos(phase), width * np.cos(2 * phase)))
    period = float(circuit / speed)
    bob = Sum((Ramp(heave), Sinusoid(-heave, period / 3, np.pi / 2)))  # starts at rest, then goes down and comes back
    law = Path(Sinusoid(length / 2, period), Sinusoid(width / 2, period / 2), bob, Sinusoid(*weave.roll), Sinusoid(*weave.pitch))
    return Trajectory(place, law, duration)


@dataclass(frozen=True)
class Lawnmower:
    """A plan of parallel legs: lengths in m, times in s, angles in rad."""

    legs: int = 6
    length: float = 250.0
    spacing: float = 40.0  # between neighbouring legs; the first turn goes to starboard
    speed: float = 1.5
    heading: float = 0.0  # of the first leg
    surface_time: float = 60.0  # before the dive and along the first heading
    dive: float = 20.0  # metres down before the first leg
    dive_pitch: float = 0.3
    ascend: bool = False  # to the surface again after the last leg

    @property
    def turn_time(self) -> float:
        """Duration of the half turn that moves the vehicle sideways by one spacing."""
        return self.spacing / (self.speed * _step_mean(np.pi))

    def dive_times(self) -> tuple[float, float]:
        """Return the durations of one pitch manoeuvre and of the stretch at constant pitch between two."""
        manoeuvre = 10.0
        lost = 2 * manoeuvre * self.speed * _step_mean(self.dive_pitch)
        if lost > self.dive:
            raise InputError("Lawnmower", f"dives {self.dive} m, less than two pitch manoeuvres take ({lost:.1f} m)", "pitch less")
        return manoeuvre, (self.dive - lost) / (self.speed * np.sin(self.dive_pitch))


def _step_mean(angle: float) -> float:
    """Return the mean over one smooth step from 0 to `angle` of the sine."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    step = Steps((0.0,), (1.0,), (0.0, 1.0))(0.5 * (1 + nodes), 1)[0]
    return float(0.5 * weights @ np.sin(angle * step))


def survey(place: Place, plan: Lawnmower | None = None, *, duration: float | None = None, weave: Weave = GENTLE) -> Trajectory:
    """Return a lawnmower survey: surface, dive, legs joined by smooth half turns, and after the last leg straight on.

    `duration` (s) is by default that of the plan.
    """
    plan = plan or Lawnmower()
    manoeuvre, slope = plan.dive_times()
    leg, turn, down = plan.length / plan.speed, plan.turn_time, 2 * manoeuvre + slope
    first = plan.surface_time + down
    turns = tuple(first + leg + k * (leg + turn) for k in range(plan.legs - 1))
    last = first + plan.legs * leg + (plan.legs - 1) * turn
    headings = tuple(plan.heading + np.pi * (k % 2) for k in range(plan.legs))
    heading = Steps(turns, (turn,) * len(turns), headings) if turns else Ramp(plan.heading)
    dives = [(plan.surface_time, -plan.dive_pitch)] + ([(last, plan.dive_pitch)] if plan.ascend else [])
    starts = tuple(t for start, _ in dives for t in (start, start + manoeuvre + slope))
    pitches = (0.0, *(p for _, pitch in dives for p in (pitch, 0.0)))
    pitch = Steps(starts, (manoeuvre,) * len(starts), pitches)
    end = duration if duration is not None else last + (down if plan.ascend else 0.0)
    return driven(place, float(end), forward=Ramp(plan.speed), heading=heading, pitch=pitch, weave=weave)
