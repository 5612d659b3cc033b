"""What logs of speed through the water would have recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from leadline.data import records
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import Digital
from leadline.simulate.surroundings import STILL, Surrounding, through_water

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Speed(Digital[records.Speed]):
    """Speed through the water along the sensor's x axis, at the sensor's point: (1 + scale) measured = speed + bias (m/s).

    The water moves as that of the trajectory's place does, and as `current` on top.
    """

    measured = ("speed",)
    current: Surrounding | None = STILL
    scale: float = 0.0
    sigma_scale: float = 0.0
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Speed:
        """Return true speeds."""
        state = trajectory.at(time).point(self.lever_arm_b)
        return records.Speed(time=time, speed=through_water(state, self.current) @ self.rotation_bs[:, 0])

    def noisy(self, table: records.Speed, generator: Generator) -> records.Speed:
        """Add bias, scale and white noise."""
        factor = 1 + self.scale + self.sigma_scale * generator.standard_normal()
        bias = self.bias.draw(table.time, 1, generator)[:, 0]
        return replace(table, speed=(table.speed + bias) / factor + self.sigma * generator.standard_normal(len(table)))
