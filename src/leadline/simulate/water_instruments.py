"""What instruments that look at the water itself would have recorded: its level, its current, the speed of sound in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import Digital
from leadline.simulate.surroundings import Surrounding, current_n

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.sea.sound import SoundProfile
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class WaterLevel(Digital[records.WaterLevel]):
    """Height (m) of the water surface without its waves above the datum of the chart, by a gauge; the mean surface is `mean` above that."""

    measured = ("water_level",)
    mean: float = 0.0
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.WaterLevel:
        """Return true levels."""
        return records.WaterLevel(time=time, water_level=self.mean + trajectory.place.water.level(time))

    def noisy(self, table: records.WaterLevel, generator: Generator) -> records.WaterLevel:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, water_level=table.water_level + error)


@dataclass(frozen=True, kw_only=True)
class CurrentMeter(Digital[records.WaterCurrent]):
    """Velocity of the water over ground (m/s), north and east, with `vertical` down as well, at the sensor's point.

    With a `depth` (m, below the surface of the moment) it is that of the water there, above or below the vehicle.  `current` comes on
    top of that of the trajectory's place.  Each component is off by N(0, sigma), which the table states, and by a bias.
    """

    measured = ("current", "current_down")
    depth: float | None = None
    vertical: bool = False
    current: Surrounding | None = None
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.WaterCurrent:
        """Return true currents."""
        state = trajectory.at(time).point(self.lever_arm_b)
        flow, depth = current_n(state, self.current), state.depth
        if self.depth is not None:
            depth = np.full(len(time), self.depth)
            water = trajectory.place.water
            flow = flow - state.water_velocity_n + water.velocity_n(time, *state.north_east, depth - water.level(time))
        return records.WaterCurrent(time=time, current=flow[:, :2], current_down=flow[:, 2] if self.vertical else None, depth=depth)

    def noisy(self, table: records.WaterCurrent, generator: Generator) -> records.WaterCurrent:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 3, generator) + self.sigma * generator.standard_normal((len(table), 3))
        down = None if table.current_down is None else table.current_down + error[:, 2]
        stated = np.full(len(table), self.sigma) if self.sigma > 0 else None
        return replace(table, current=table.current + error[:, :2], current_down=down, sigma=stated)


@dataclass(frozen=True, kw_only=True)
class SoundSpeedMeter(Digital[records.SoundSpeed]):
    """Speed of sound (m/s) in the water at the sensor's point, off by a bias and N(0, sigma), and its depth, off by N(0, sigma_depth)."""

    measured = ("sound_speed",)
    profile: SoundProfile
    sigma: float = 0.0
    sigma_depth: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.SoundSpeed:
        """Return true speeds."""
        depth = trajectory.at(time).point(self.lever_arm_b).depth
        return records.SoundSpeed(time=time, sound_speed=self.profile.speed_at(depth), depth=depth)

    def noisy(self, table: records.SoundSpeed, generator: Generator) -> records.SoundSpeed:
        """Add bias and white noise."""
        return replace(table, **speed_errors(self, table, generator))


@dataclass(frozen=True, kw_only=True)
class SoundProfileCast(Digital[records.SoundSpeedProfile]):
    """Speed of sound (m/s) against depth, by casts from the surface: one at each moment of sampling.

    A cast has a row at each of the `depths` (m), in their order, as it sinks at `fall` (m/s): time = start + depth / fall.
    Speeds are off by a bias and N(0, sigma), depths by N(0, sigma_depth).
    """

    measured = ("sound_speed",)
    profile: SoundProfile
    depths: tuple[float, ...]
    fall: float = 1.0
    sigma: float = 0.0
    sigma_depth: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.SoundSpeedProfile:  # noqa: ARG002  (the profile knows)
        """Return true speeds; raises InputError for a cast that does not sink, or without depths."""
        if not self.depths or self.fall <= 0.0 or any(b <= a for a, b in zip(self.depths, self.depths[1:], strict=False)):
            found = f"sinks at {self.fall} m/s to {len(self.depths)} depths"
            raise InputError("SoundProfileCast", found, "fall above 0, ascending depths")
        depth = np.asarray(self.depths, float)
        moments = (time[:, None] + depth / self.fall).ravel()
        down = np.tile(depth, len(time))
        return records.SoundSpeedProfile(time=moments, depth=down, sound_speed=self.profile.speed_at(down))

    def noisy(self, table: records.SoundSpeedProfile, generator: Generator) -> records.SoundSpeedProfile:
        """Add bias and white noise."""
        return replace(table, **speed_errors(self, table, generator))


def speed_errors(meter: SoundSpeedMeter | SoundProfileCast, table: records.SoundSpeed, generator: Generator) -> dict[str, Any]:
    """Return the columns of a table of sound speeds with errors."""
    error = meter.bias.draw(table.time, 1, generator)[:, 0] + meter.sigma * generator.standard_normal(len(table))
    depth = cast("Array", table.depth) + meter.sigma_depth * generator.standard_normal(len(table))
    return {"sound_speed": table.sound_speed + error, "depth": depth}
