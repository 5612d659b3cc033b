"""What instruments of attitude and heading would have recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np

from leadline.core.attitude import exponential, matrix_from_quaternion, wrapped
from leadline.data import records
from leadline.sea.magnetic import declination, field_n
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.first_order import lagging
from leadline.simulate.instrument import ZERO, Digital, Vector
from leadline.simulate.trajectory import euler
from leadline.simulate.vectors import turned

if TYPE_CHECKING:
    from datetime import datetime

    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory

T = TypeVar("T", bound=records.Table)


@dataclass(frozen=True, kw_only=True)
class Levelled(Digital[T]):
    """An instrument that takes the specific force for the vertical, after a while, and may take the magnetic field for north.

    What it holds for down leans, in navigation axes, by the specific force f_n at its point, low-passed with the time constant `tilt_tau`
    (s) as by a complementary filter with gyros:  e_n = tilt_gain (-f_E, f_N) / -f_D,  R_held = exp([e_n]x) R_nb  (to first order).
    A turn whose period is short against tilt_tau so averages out.  It starts level; with tilt_gain 0 there is no such error.
    With a `date` it shows angles from magnetic north, by the World Magnetic Model at the place where the trajectory starts: less the
    declination D; and a lean turns its heading by (e_N cos D + e_E sin D) tan(I), where the field dips by I: the northerly turning error.
    """

    tilt_gain: float = 0.0
    tilt_tau: float = 30.0
    date: datetime | None = None

    def held_angles(self, trajectory: Trajectory, time: Array, rotation_bs: Array | None = None) -> tuple[Array, Array, Array]:
        """Return roll, pitch and heading (rad) that it holds for those of the body, or of axes turned against it, without noise."""
        rotation = trajectory.at(time).rotation_nb
        field = self.field_n(trajectory)
        if self.tilt_gain:
            lean = self.lean_n(trajectory, time)
            if field is not None:
                lean[:, 2] = lean[:, :2] @ field[:2] * field[2] / (field[0] ** 2 + field[1] ** 2)
            rotation = matrix_from_quaternion(exponential(lean)) @ rotation
        roll, pitch, heading = euler(rotation if rotation_bs is None else rotation @ rotation_bs)
        return roll, pitch, heading if field is None else (heading - np.arctan2(field[1], field[0])) % (2 * np.pi)

    def field_n(self, trajectory: Trajectory) -> Array | None:
        """Return the magnetic field (3,), north, east, down (T); None where north is true."""
        if self.date is None:
            return None
        place, where = trajectory.place, type(self).__name__
        at = (place.latitude, place.longitude, place.surface_height - place.depth, self.date, where)
        declination(*at)  # refuses the magnetic poles
        return field_n(*at)

    def lean_n(self, trajectory: Trajectory, time: Array) -> Array:
        """Return by which rotation vectors (times, 3), rad, what it holds for the attitude is off, without a turn of the heading."""

        def force_n(moments: Array) -> Array:
            state = trajectory.at(moments).point(self.lever_arm_b)
            return turned(state.rotation_nb, state.specific_force_b)

        start = force_n(time[:1])[0] * (0.0, 0.0, 1.0) if len(time) else None
        north, east, down = lagging(time, force_n, self.tilt_tau, start).T
        return np.asarray(self.tilt_gain * np.stack([east / down, -north / down, 0.0 * down], axis=1))


@dataclass(frozen=True, kw_only=True)
class Attitude(Levelled[records.Attitude]):
    """Roll, pitch and heading (rad) of the sensor axes against north-east-down; errors add to the three angles."""

    measured = ("roll", "pitch", "heading")
    sigma: Vector = ZERO
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Attitude:
        """Return the angles of the sensor axes that it holds for true."""
        roll, pitch, heading = self.held_angles(trajectory, time, self.rotation_bs)
        return records.Attitude(time=time, roll=roll, pitch=pitch, heading=heading)

    def noisy(self, table: records.Attitude, generator: Generator) -> records.Attitude:
        """Add biases and white noise."""
        error = self.bias.draw(table.time, 3, generator) + np.asarray(self.sigma) * generator.standard_normal((len(table), 3))
        roll, pitch, heading = cast("Array", table.roll), cast("Array", table.pitch), cast("Array", table.heading)
        return replace(table, roll=wrapped(roll + error[:, 0]), pitch=pitch + error[:, 1], heading=(heading + error[:, 2]) % (2 * np.pi))

    def shown(self, table: records.Attitude) -> records.Attitude:
        """Return what it shows; a heading that rounding completes to a full turn is 0."""
        table = super().shown(table)
        return replace(table, heading=cast("Array", table.heading) % (2 * np.pi)) if self.quantum else table


@dataclass(frozen=True, kw_only=True)
class Heading(Levelled[records.Heading]):
    """Heading of the body's forward axis (rad, in [0, 2 pi)), off by the deviation of a compass.

    What it shows is m = heading + bias + drift_rate t + A sin m + B cos m + C sin 2m + D cos 2m, with `swing` A, B, C, D (rad), and noise
    on top.  The drift_rate (rad/s) is that of a gyro whose rate is added up to a heading.
    """

    measured = ("heading",)
    sigma: float = 0.0
    bias: Drift = STEADY
    swing: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    sigma_swing: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # of each, drawn at turn-on
    drift_rate: float = 0.0
    sigma_drift_rate: float = 0.0  # drawn at turn-on

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Heading:
        """Return the headings that it holds for true."""
        return records.Heading(time=time, heading=self.held_angles(trajectory, time)[2])

    def noisy(self, table: records.Heading, generator: Generator) -> records.Heading:
        """Add bias, deviation and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        drawn = self.sigma_drift_rate * float(generator.spawn(1)[0].standard_normal()) if self.sigma_drift_rate else 0.0
        error += (self.drift_rate + drawn) * table.time
        shown = table.heading + error
        if any(self.swing) or any(self.sigma_swing):
            swing = np.asarray(self.swing) + np.asarray(self.sigma_swing) * generator.standard_normal(4)
            for _ in range(60):  # a contraction as long as the needle does not stick
                shown = table.heading + error + deviation(swing, shown)
        return replace(table, heading=shown % (2 * np.pi))

    def shown(self, table: records.Heading) -> records.Heading:
        """Return what it shows; a heading that rounding completes to a full turn is 0."""
        table = super().shown(table)
        return replace(table, heading=table.heading % (2 * np.pi)) if self.quantum else table


def deviation(swing: Array, shown: Array) -> Array:
    """Return the deviation (rad) of headings that a compass of given swing (4,) shows."""
    a, b, c, d = swing
    return np.asarray(a * np.sin(shown) + b * np.cos(shown) + c * np.sin(2 * shown) + d * np.cos(2 * shown))
