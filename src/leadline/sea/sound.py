"""The speed of sound in the sea against depth, and the rays along which sound travels in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.core.water import surface_gravity
from leadline.data.errors import InputError
from leadline.sea.rays import speeds, trace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from leadline.data.records import Array, SoundSpeedProfile

FAR = 1e7  # m beyond the ends of a profile: nothing is there
SLOWEST, FASTEST = 1000.0, 2500.0  # m/s: no water is beyond


class Rays(NamedTuple):
    """Rays from a to b: time (s), length (m), and at both ends the elevation (rad) of the way from a to b, positive down.

    Seen from a, the other end appears at elevation `angle_a` below the horizon; seen from b, at -`angle_b`.
    """

    time: Array
    length: Array
    angle_a: Array
    angle_b: Array


@dataclass(frozen=True, eq=False)
class SoundProfile:
    """Speed of sound (m/s) at ascending depths (m), linear in between and constant beyond the ends.

    Raises InputError where depths do not ascend, or where a speed is not one of water.
    """

    depth: Array
    speed: Array

    def __post_init__(self) -> None:
        """Copy, freeze and check the arrays."""
        depth, speed = np.array(self.depth, float).ravel(), np.array(self.speed, float).ravel()
        if len(depth) != len(speed) or not len(depth):
            raise InputError("sound profile", f"has {len(depth)} depths and {len(speed)} speeds", "give one speed for each depth")
        if not np.all(np.isfinite(depth)) or np.any(np.diff(depth) <= 0.0) or np.max(np.abs(depth)) >= FAR:
            raise InputError("sound profile", "depths do not ascend", "give each depth once, from the surface down")
        wrong = ~((speed >= SLOWEST) & (speed <= FASTEST))
        if np.any(wrong):
            raise InputError("sound profile", f"the speed is {speed[wrong][0]} m/s at {depth[wrong][0]} m", "give metres per second")
        for name, array in (("depth", depth), ("speed", speed)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    def uniform(cls, speed: float) -> SoundProfile:
        """Return water of one speed of sound (m/s): rays are straight."""
        return cls(np.zeros(1), np.array([speed]))

    @classmethod
    def from_table(cls, table: SoundSpeedProfile) -> SoundProfile:
        """Return the profile of a table's valid rows, whatever their times; equal depths are averaged.

        Raises InputError where the table has no depths, or no valid row.
        """
        if table.depth is None:
            raise InputError(table.kind, "has no depth", "give depth_m")
        good = np.isfinite(table.depth) & np.isfinite(table.sound_speed)
        if table.valid is not None:
            good &= table.valid != 0
        depth, place, count = np.unique(table.depth[good], return_inverse=True, return_counts=True)
        return cls(depth, np.bincount(place, table.sound_speed[good], len(depth)) / count)

    @classmethod
    def from_ctd(cls, depth: ArrayLike, temperature: ArrayLike, salinity: ArrayLike, latitude: float) -> SoundProfile:
        """Return the profile of a cast: depths (m), degrees Celsius, practical salinity, at a latitude (rad).

        Speed by Chen and Millero (1977), pressure by the standard ocean (Fofonoff and Millard, 1983).
        """
        z, t, s = (np.ascontiguousarray(v, float) for v in np.broadcast_arrays(*map(np.atleast_1d, (depth, temperature, salinity))))
        result = np.empty(len(z))
        speeds(z, t, s, float(surface_gravity(float(np.sin(latitude)) ** 2)), result)
        return cls(z, result)

    def speed_at(self, depth: ArrayLike) -> Array:
        """Return the speed of sound (m/s) at depths (m)."""
        return np.asarray(np.interp(np.asarray(depth, float), self.depth, self.speed))

    @cached_property
    def layers(self) -> tuple[Array, Array]:
        """Depths and speeds with a layer of constant speed beyond each end."""
        depth = np.concatenate([[-FAR], self.depth, [FAR]])
        return depth, np.concatenate([self.speed[:1], self.speed, self.speed[-1:]])

    def travel_time(self, horizontal: ArrayLike, depth_a: ArrayLike, depth_b: ArrayLike) -> Rays:
        """Return the fastest direct rays over horizontal distances (m) between two depths (m); nan where there is none.

        Direct is a ray that meets neither surface nor sea bed and turns at most once.  It has neither sense nor frequency: a and b
        can be exchanged, and sound that is diffracted into a shadow zone is not heard.  Arguments are broadcast against each other.
        Layers are level and flat.  Source: Jensen et al., Computational Ocean Acoustics (2011), chapter 3.
        """
        arguments = np.broadcast_arrays(horizontal, depth_a, depth_b)
        x, a, b = (np.ascontiguousarray(v, float).ravel() for v in arguments)
        rays = np.empty((len(x), 4))
        trace(*self.layers, x, a, b, rays)
        return Rays(*(column.reshape(arguments[0].shape) for column in rays.T))
