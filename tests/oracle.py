"""Where a body is, how it moves and what the Earth does to it: plain NumPy from first principles, sharing no line with the package.

A motion is a few entire functions of time that accept complex numbers, so that every derivative is Cauchy's integral: no formula for
Euler rates, for accelerations of lever arms or for transport rates stands here that could be wrong in the same way twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
Function = Callable[[Array], Array]

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84 (NIMA TR8350.2, 2000)
E2 = FLATTENING * (2 - FLATTENING)
EARTH_RATE = np.array([0.0, 0.0, 7.292115e-5])


def turn(axis: int, angle: Array) -> Array:
    """The matrix that turns vectors by `angle` about a coordinate axis, right-handed."""
    angle = np.asarray(angle)
    matrix = np.zeros((*angle.shape, 3, 3), angle.dtype)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix[..., axis, axis] = 1
    matrix[..., j, j] = matrix[..., k, k] = np.cos(angle)
    matrix[..., k, j], matrix[..., j, k] = np.sin(angle), -np.sin(angle)
    return matrix


def attitude(roll: Any, pitch: Any, heading: Any) -> Array:
    """Body (or sensor) to north-east-down (or body): turned by heading about z, then pitch about the new y, then roll about the new x."""
    return turn(2, np.asarray(heading)) @ turn(1, np.asarray(pitch)) @ turn(0, np.asarray(roll))


def angles(matrix: Array) -> tuple[Array, Array, Array]:
    """Roll, pitch, heading in [0, 2 pi): heading and pitch of the forward axis, roll by how far the starboard axis is down."""
    forward, starboard, down = matrix[..., :, 0], matrix[..., :, 1], matrix[..., :, 2]
    pitch = np.arctan2(-forward[..., 2], np.hypot(forward[..., 0], forward[..., 1]))
    return np.arctan2(starboard[..., 2], down[..., 2]), pitch, np.arctan2(forward[..., 1], forward[..., 0]) % (2 * np.pi)


def apply(matrix: Array, vector: Any) -> Array:
    """Matrix times vector, row by row."""
    return np.einsum("...ij,...j->...i", matrix, np.asarray(vector))


def back(matrix: Array, vector: Any) -> Array:
    """Transpose times vector, row by row."""
    return np.einsum("...ji,...j->...i", matrix, np.asarray(vector))


def normal_radius(latitude: Any) -> Array:
    """Radius of curvature across the meridian."""
    return np.asarray(SEMI_MAJOR / np.sqrt(1 - E2 * np.sin(latitude) ** 2))


def meridian_radius(latitude: Any) -> Array:
    """Radius of curvature along the meridian."""
    return normal_radius(latitude) ** 3 * (1 - E2) / SEMI_MAJOR**2


def ecef(latitude: Any, longitude: Any, height: Any) -> Array:
    """Earth-fixed position."""
    n = normal_radius(latitude)
    level = (n + height) * np.cos(latitude)
    return np.stack(np.broadcast_arrays(
        level * np.cos(longitude), level * np.sin(longitude), (n * (1 - E2) + height) * np.sin(latitude)), axis=-1)  # fmt: skip


def geodetic(position_e: Array) -> tuple[Array, Array, Array]:
    """Latitude, longitude, height: fixed point of tan(latitude) = (z + e^2 N sin(latitude)) / p, which gains a factor 150 each round."""
    x, y, z = np.moveaxis(position_e, -1, 0)
    p, latitude = np.hypot(x, y), np.arctan2(z, np.hypot(x, y))
    for _ in range(8):
        latitude = np.arctan2(z + E2 * normal_radius(latitude) * np.sin(latitude), p)
    height = p * np.cos(latitude) + z * np.sin(latitude) - SEMI_MAJOR**2 / normal_radius(latitude)
    return latitude, np.arctan2(y, x), height


def level_axes(latitude: Any, longitude: Any) -> Array:
    """North, east, down as columns, Earth-fixed axes: the derivatives of position with latitude and longitude, and the inward normal."""
    latitude, longitude = np.broadcast_arrays(np.asarray(latitude), np.asarray(longitude))
    sl, cl, so, co = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    north = np.stack([-sl * co, -sl * so, cl], -1)
    east = np.stack([-so, co, 0 * so], -1)
    return np.stack([north, east, np.stack([-cl * co, -cl * so, -sl], -1)], -1)


def meridian_arc(start: float, end: Any) -> Array:
    """Metres along the meridian: the integral of its radius of curvature."""
    x, w = np.polynomial.legendre.leggauss(12)
    end = np.asarray(end)[..., None]
    return np.sum(w * 0.5 * (end - start) * meridian_radius(start + 0.5 * (end - start) * (1 + x)), axis=-1)


def chart(latitude: Array, longitude: Array, origin: tuple[float, float]) -> tuple[Array, Array]:
    """Metres along the meridian and along the point's own parallel from the origin, the short way round."""
    turned = (longitude - origin[1] + np.pi) % (2 * np.pi) - np.pi
    return meridian_arc(origin[0], latitude), normal_radius(latitude) * np.cos(latitude) * turned


def normal_gravity(latitude: Array, height: Array, surface_height: float) -> Array:
    """Somigliana's gravity, second order in height (TR8350.2, 4-1 and 4-3), less twice the pull of the layer overhead.

    The water is that of the standard ocean: 1028.1 kg/m^3 (35 practical salinity, 0 degrees Celsius, EOS-80).
    """
    s2, m = np.sin(latitude) ** 2, 0.00344978650684
    g = 9.7803253359 * (1 + 0.00193185265241 * s2) / np.sqrt(1 - E2 * s2)
    g = g * (1 - 2 / SEMI_MAJOR * (1 + FLATTENING + m - 2 * FLATTENING * s2) * height + 3 * height**2 / SEMI_MAJOR**2)
    return np.asarray(g - 4 * np.pi * 6.6743e-11 * 1028.1 * np.maximum(surface_height - height, 0.0))


def derivative(function: Function, time: Array, order: int = 1, radius: float = 0.2, nodes: int = 24) -> Array:
    """Cauchy's integral over a circle about each time: exact to rounding for entire functions that vary over seconds."""
    around = np.exp(2j * np.pi * np.arange(nodes) / nodes)
    values = function((time[:, None] + radius * around).ravel())
    values = values.reshape(len(time), nodes, *values.shape[1:])
    scale = [1.0, 1.0, 2.0][order] / radius**order / nodes
    return np.asarray(scale * np.einsum("tk...,k->t...", values, around**-order).real)


@dataclass(frozen=True)
class Wave:
    """value + slope t + sum of amplitude sin(2 pi t / period + phase)."""

    value: float = 0.0
    slope: float = 0.0
    parts: tuple[tuple[float, float, float], ...] = ()

    def __call__(self, time: Array) -> Array:
        return np.asarray(self.value + self.slope * time + sum(a * np.sin(2 * np.pi * time / p + q) for a, p, q in self.parts))

    def rate(self, time: Array) -> Array:
        """Its derivative."""
        return np.asarray(self.slope + 0 * time + sum(a * 2 * np.pi / p * np.cos(2 * np.pi * time / p + q) for a, p, q in self.parts))


@dataclass(frozen=True)
class Point:
    """A point of a body at times: Earth-fixed position, velocity and acceleration against the Earth, rotation and rate of the body."""

    time: Array
    surface_height: float
    position_e: Array
    velocity_e: Array
    acceleration_e: Array
    rotation_eb: Array
    rate_b: Array  # against the Earth

    @cached_property
    def geodetic(self) -> tuple[Array, Array, Array]:
        """Latitude, longitude, height."""
        return geodetic(self.position_e)

    @property
    def depth(self) -> Array:
        """Below the mean surface."""
        return self.surface_height - self.geodetic[2]

    @property
    def axes(self) -> Array:
        """North, east, down at the point."""
        return level_axes(*self.geodetic[:2])

    @property
    def rotation_nb(self) -> Array:
        """Body to north-east-down at the point."""
        return np.swapaxes(self.axes, -1, -2) @ self.rotation_eb

    @property
    def velocity_n(self) -> Array:
        """North, east, down."""
        return back(self.axes, self.velocity_e)

    @property
    def gyro_b(self) -> Array:
        """Rate against inertial space."""
        return self.rate_b + back(self.rotation_eb, np.broadcast_to(EARTH_RATE, self.rate_b.shape))

    @property
    def specific_force_b(self) -> Array:
        """Inertial acceleration less gravitation; the centrifugal part of both is the same and is left out of both."""
        latitude, _, height = self.geodetic
        plumb_e = self.axes[..., :, 2] * normal_gravity(latitude, height, self.surface_height)[..., None]
        return back(self.rotation_eb, self.acceleration_e + 2 * np.cross(EARTH_RATE, self.velocity_e) - plumb_e)


@dataclass(frozen=True)
class Motion:
    """A body in the tangent frame at a place: velocity and rotation as entire functions of time, position as a real one."""

    latitude: float
    longitude: float
    depth: float
    surface_height: float
    position_t: Function
    velocity_t: Function
    rotation_tb: Function

    def place_e(self, time: Array, arm: Any = (0.0, 0.0, 0.0)) -> Array:
        """Earth-fixed position of the point of the body at a lever arm."""
        offset = self.position_t(time) + self.rotation_tb(time) @ np.asarray(arm, float)
        return ecef(self.latitude, self.longitude, self.surface_height - self.depth) + offset @ level_axes(self.latitude, self.longitude).T

    def at(self, time: Any, arm: Any = (0.0, 0.0, 0.0)) -> Point:
        """The point of the body at a lever arm."""
        time, arm = np.atleast_1d(np.asarray(time, float)), np.asarray(arm, float)
        frame = level_axes(self.latitude, self.longitude)
        rotation = self.rotation_tb(time)
        turning = np.swapaxes(rotation, 1, 2) @ derivative(self.rotation_tb, time)

        def lever(t: Array) -> Array:
            return self.rotation_tb(t) @ arm

        velocity = self.velocity_t(time) + derivative(lever, time)
        acceleration = derivative(self.velocity_t, time) + derivative(lever, time, 2)
        return Point(
            time, self.surface_height, self.place_e(time, arm), velocity @ frame.T, acceleration @ frame.T, frame @ rotation,
            np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], -1),
        )  # fmt: skip


def along_path(place: tuple[float, float, float, float], north: Wave, east: Wave, down: Wave, roll: Wave, pitch: Wave) -> Motion:
    """A path with the heading of its course."""

    def rotation(time: Array) -> Array:
        n, e = north.rate(time), east.rate(time)
        course, speed = np.zeros((len(time), 3, 3), time.dtype), np.sqrt(n * n + e * e)
        course[:, 0, 0] = course[:, 1, 1] = n / speed
        course[:, 1, 0], course[:, 0, 1], course[:, 2, 2] = e / speed, -e / speed, 1
        return course @ turn(1, pitch(time)) @ turn(0, roll(time))

    waves = (north, east, down)
    return Motion(*place, lambda t: np.stack([w(t) for w in waves], -1), lambda t: np.stack([w.rate(t) for w in waves], -1), rotation)


def driven(place: tuple[float, float, float, float], turns: tuple[Wave, Wave, Wave], speeds: tuple[Wave, Wave, Wave]) -> Motion:
    """Roll, pitch, heading and body speeds are given; position is the integral of velocity, by Gauss on short panels."""

    def rotation(time: Array) -> Array:
        return attitude(*(angle(time) for angle in turns))

    def velocity(time: Array) -> Array:
        return apply(rotation(time), np.stack([speed(time) for speed in speeds], -1))

    def position(time: Array) -> Array:
        panels = int(np.ceil(2 * np.max(time))) + 1
        x, w = np.polynomial.legendre.leggauss(12)
        part = ((np.arange(panels)[:, None] + 0.5 * (1 + x)) / panels).ravel()
        values = velocity((time[:, None] * part).ravel()).reshape(len(time), len(part), 3)
        return time[:, None] * np.einsum("tkc,k->tc", values, np.tile(0.5 * w, panels) / panels)

    return Motion(*place, position, velocity, rotation)
