"""Laws of motion in closed form: given angles and speeds, or a given path."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.attitude import matrix_from_euler
from leadline.data.errors import InputError
from leadline.simulate.profiles import Profile, Ramp
from leadline.simulate.trajectory import Motion
from leadline.simulate.vectors import cross, turned

if TYPE_CHECKING:
    from leadline.data.records import Array

KNOT_STEP, KNOT_MARGIN = 0.05, 200  # s between knots of a driven position; knots before time 0 and after the duration


def turning(angles: Array) -> tuple[Array, Array, Array]:
    """Return rotation, rate and its derivative of Z-Y-X `angles`, as `Motion` holds them."""
    return matrix_from_euler(*angles[0]), *body_rate(angles)


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

    @property
    def begin(self) -> float:
        """Time (s) of the first knot."""
        return float(self.knots[0][0])

    @property
    def end(self) -> float:
        """Time (s) of the last knot."""
        return float(self.knots[0][-1])

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
        velocity, acceleration, angles = self._motion(time)
        return Motion(place, velocity, acceleration, *turning(angles))


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
        return Motion(position, velocity, acceleration, *turning(angles))
