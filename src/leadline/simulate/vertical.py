"""What instruments that look up and down would have recorded: depth, pressure, distance to the sea bed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.water import ATMOSPHERE, pressure_of_depth, surface_gravity
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import Instrument

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.surroundings import Surrounding
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Depth(Instrument[records.Depth]):
    """Depth of the sensor's own point below the sea surface (m)."""

    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Depth:
        """Return true depths."""
        return records.Depth(time=time, depth=trajectory.at(time).point(self.lever_arm_b).depth)

    def noisy(self, table: records.Depth, generator: Generator) -> records.Depth:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, depth=table.depth + error)


@dataclass(frozen=True, kw_only=True)
class Pressure(Instrument[records.Pressure]):
    """Absolute pressure (Pa) at the sensor's own point: atmosphere + (1 + scale) x water above it, which is `datum` (m) too deep.

    The water is the standard ocean at the latitude of the place, or of constant `density` (kg/m^3) under `gravity` (m/s^2).
    """

    sigma: float = 0.0
    datum: Drift = STEADY
    atmosphere: float = ATMOSPHERE
    density: float | None = None
    gravity: float | None = None
    scale: float = 0.0
    sigma_scale: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Pressure:
        """Return true pressures."""
        state = trajectory.at(time).point(self.lever_arm_b)
        return records.Pressure(time=time, pressure=self.atmosphere + self.water(state.depth, state.geodetic[0]))

    def water(self, depth: Array, latitude: Array) -> Array:
        """Return the pressure of the water alone (Pa)."""
        gravity = surface_gravity(np.sin(latitude) ** 2) if self.gravity is None else np.full(len(depth), self.gravity)
        if self.density is not None:
            return np.asarray(self.density * gravity * depth)
        return np.array([pressure_of_depth(d, g)[0] for d, g in zip(depth, gravity, strict=True)])

    def noisy(self, table: records.Pressure, generator: Generator) -> records.Pressure:
        """Add datum, scale and white noise."""
        column, white = self.datum.draw(table.time, 1, generator)[:, 0], generator.standard_normal(len(table))
        weight = (self.density or 1025.0) * (self.gravity or 9.81)  # of the metre or so of the datum
        factor = 1 + self.scale + self.sigma_scale * generator.standard_normal()
        water = factor * (table.pressure - self.atmosphere + weight * column)
        return replace(table, pressure=self.atmosphere + water + self.sigma * white)


@dataclass(frozen=True, kw_only=True)
class Altimeter(Instrument[records.Altimeter]):
    """Distance (m) along the sensor's z axis to a level sea bed; nan where the axis does not meet it below."""

    seabed: Surrounding | None = None
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Altimeter:
        """Return true distances."""
        if self.seabed is None:
            raise InputError("Altimeter", "has no sea bed", "give seabed")
        state = trajectory.at(time).point(self.lever_arm_b)
        down = (state.rotation_nb @ self.rotation_bs)[:, 2, 2]
        with np.errstate(divide="ignore"):
            distance = (self.seabed.at(time)[:, 0] - state.depth) / down
        return records.Altimeter(time=time, range=np.where(down > 0.0, distance, np.nan))

    def noisy(self, table: records.Altimeter, generator: Generator) -> records.Altimeter:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, range=table.range + error)
