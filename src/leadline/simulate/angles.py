"""What instruments of attitude and heading would have recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from leadline.core.attitude import wrapped
from leadline.data import records
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import ZERO, Instrument, Vector
from leadline.simulate.trajectory import euler

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Attitude(Instrument[records.Attitude]):
    """Roll, pitch and true heading (rad) of the sensor axes against north-east-down; errors add to the three angles."""

    sigma: Vector = ZERO
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Attitude:
        """Return true angles of the sensor axes."""
        roll, pitch, heading = euler(trajectory.at(time).rotation_nb @ self.rotation_bs)
        return records.Attitude(time=time, roll=roll, pitch=pitch, heading=heading)

    def noisy(self, table: records.Attitude, generator: Generator) -> records.Attitude:
        """Add biases and white noise."""
        error = self.bias.draw(table.time, 3, generator) + np.asarray(self.sigma) * generator.standard_normal((len(table), 3))
        roll, pitch, heading = cast("Array", table.roll), cast("Array", table.pitch), cast("Array", table.heading)
        return replace(table, roll=wrapped(roll + error[:, 0]), pitch=pitch + error[:, 1], heading=(heading + error[:, 2]) % (2 * np.pi))


@dataclass(frozen=True, kw_only=True)
class Heading(Instrument[records.Heading]):
    """True heading of the body's forward axis (rad, in [0, 2 pi)), off by the deviation of a compass.

    What it shows is m = heading + bias + A sin m + B cos m + C sin 2m + D cos 2m, with `swing` A, B, C, D (rad), and noise on top.
    """

    sigma: float = 0.0
    bias: Drift = STEADY
    swing: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    sigma_swing: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # of each, drawn at turn-on

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Heading:
        """Return true headings."""
        return records.Heading(time=time, heading=euler(trajectory.at(time).rotation_nb)[2])

    def noisy(self, table: records.Heading, generator: Generator) -> records.Heading:
        """Add bias, deviation and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        shown = table.heading + error
        if any(self.swing) or any(self.sigma_swing):
            swing = np.asarray(self.swing) + np.asarray(self.sigma_swing) * generator.standard_normal(4)
            for _ in range(60):  # a contraction as long as the needle does not stick
                shown = table.heading + error + deviation(swing, shown)
        return replace(table, heading=shown % (2 * np.pi))


def deviation(swing: Array, shown: Array) -> Array:
    """Return the deviation (rad) of headings that a compass of given swing (4,) shows."""
    a, b, c, d = swing
    return np.asarray(a * np.sin(shown) + b * np.cos(shown) + c * np.sin(2 * shown) + d * np.cos(2 * shown))
