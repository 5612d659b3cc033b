"""NavigationView: what a sensor model sees of the vehicle at one moment.  It never sees a state vector.

A view is a flat array, so that kernels pass it on at no cost; `NavigationView` gives its parts their names for sensors written in
plain Python.  It holds for the process model's reference point (the IMU for `inertial`); lever arms reach sensors counted from it.

A rate that comes from an input and not from the state brings the variance of its noise along (per axis): what a sensor makes of that
rate is as uncertain, and the estimator adds it to the sensor's own noise.

Its tangent space (what Jacobians are taken against) has 18 directions: position (m along the navigation frame), velocity,
attitude (rotation vector in the navigation frame, on the left), rate, specific force, velocity through the water.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import attitude, geodesy
from leadline.core.compiled import kernel
from leadline.core.earth import level_angle, move, third_row, wander_slope
from leadline.core.rotation import exponential, load4, product, store_quaternion

if TYPE_CHECKING:
    from leadline.data.records import Array

# Places in a view ...
PLACE_V, HEIGHT_V, VELOCITY_V, QUATERNION_V, RATE_V, FORCE_V, WATER_V, RATE_VARIANCE_V, VIEW_SIZE = 0, 4, 5, 8, 12, 15, 18, 21, 22
# ... and in its tangent space.
POSITION_T, VELOCITY_T, ATTITUDE_T, RATE_T, FORCE_T, WATER_T, TANGENT = 0, 3, 6, 9, 12, 15, 18

# What a process model can define and a sensor can require; position and attitude are always there.
VELOCITY, RATE, FORCE, WATER = "velocity over ground", "angular rate", "specific force", "velocity through the water"
TILTING = "roll and pitch as states that last"  # so that accelerometers can level them
TURNING = "angular rate as a state"  # and not as an input, so that a gyro can correct it


@kernel()
def retract_view(view, d):
    """View <- view [+] d, with d in the tangent space."""
    move(view, PLACE_V, d[0], d[1], d[2])
    q = product(exponential(d[ATTITUDE_T], d[ATTITUDE_T + 1], d[ATTITUDE_T + 2]), load4(view, QUATERNION_V))
    store_quaternion(view, QUATERNION_V, q)
    for i in range(3):
        view[VELOCITY_V + i] += d[VELOCITY_T + i]
        view[RATE_V + i] += d[RATE_T + i]
        view[FORCE_V + i] += d[FORCE_T + i]
        view[WATER_V + i] += d[WATER_T + i]


@kernel()
def heading_of(view):
    """Heading of the body clockwise from true north (rad)."""
    w, x, y, z = load4(view, QUATERNION_V)
    axis = third_row(view[0], view[1], view[2], view[3])
    return level_angle(axis, 1 - 2 * (y * y + z * z), 2 * (x * y + w * z))


@kernel()
def north_slope(view):
    """How the direction of north turns in the navigation frame with a level move (rad/m), seen as a change of heading."""
    return wander_slope(third_row(view[0], view[1], view[2], view[3]), view[HEIGHT_V])


@kernel()
def wander(view):
    """Angle of the navigation frame's first axis clockwise from true north (rad)."""
    axis = third_row(view[0], view[1], view[2], view[3])
    return math.atan2(-axis[1], axis[0])


@dataclass(frozen=True)
class NavigationView:
    """A view with names, for sensors in plain Python; SI units and radians, vectors (3,), matrices (3, 3)."""

    array: Array

    @cached_property
    def rotation_en(self) -> Array:
        """Rotation from the navigation frame to the Earth-fixed frame."""
        return attitude.matrix_from_quaternion(self.array[PLACE_V:HEIGHT_V])

    @cached_property
    def rotation_nb(self) -> Array:
        """Rotation from the body to the navigation frame."""
        return attitude.matrix_from_quaternion(self.array[QUATERNION_V:RATE_V])

    @property
    def latitude(self) -> float:
        """Geodetic latitude (rad)."""
        return math.asin(max(-1.0, min(1.0, -float(self.rotation_en[2, 2]))))

    @property
    def longitude(self) -> float:
        """Longitude (rad)."""
        return math.atan2(-float(self.rotation_en[1, 2]), -float(self.rotation_en[0, 2]))

    @property
    def height(self) -> float:
        """Height above the ellipsoid (m)."""
        return float(self.array[HEIGHT_V])

    @property
    def position_e(self) -> Array:
        """Earth-fixed position (m)."""
        return geodesy.ecef_from_geodetic(self.latitude, self.longitude, self.height)

    @property
    def wander(self) -> float:
        """Angle of the navigation frame's first axis clockwise from true north (rad)."""
        return math.atan2(-float(self.rotation_en[2, 1]), float(self.rotation_en[2, 0]))

    @property
    def heading(self) -> float:
        """Heading of the body clockwise from true north (rad)."""
        return math.atan2(float(self.rotation_nb[1, 0]), float(self.rotation_nb[0, 0])) + self.wander

    @property
    def velocity_n(self) -> Array:
        """Velocity over ground, navigation frame (m/s)."""
        return self.array[VELOCITY_V:QUATERNION_V]

    @property
    def velocity_water_n(self) -> Array:
        """Velocity through the water, navigation frame (m/s)."""
        return self.array[WATER_V:RATE_VARIANCE_V]

    @property
    def rate_b(self) -> Array:
        """Angular rate of the body against the navigation frame, body axes (rad/s)."""
        return self.array[RATE_V:FORCE_V]

    @property
    def specific_force_b(self) -> Array:
        """Specific force, body axes (m/s^2)."""
        return self.array[FORCE_V:WATER_V]


def view_of(
    latitude: float, longitude: float, height: float, quaternion_nb: Array, velocity_n: Array, rate_b: Array | None = None
) -> Array:
    """Make the view (VIEW_SIZE,) of a pose in north-east-down; what is not given is zero."""
    view = np.zeros(VIEW_SIZE)
    view[PLACE_V:HEIGHT_V] = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, longitude))
    view[HEIGHT_V] = height
    view[VELOCITY_V:QUATERNION_V] = velocity_n
    view[QUATERNION_V:RATE_V] = quaternion_nb
    if rate_b is not None:
        view[RATE_V:FORCE_V] = rate_b
    return view
