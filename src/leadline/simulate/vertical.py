"""What instruments that look up and down would have recorded: depth, pressure, distance to the sea bed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.water import ATMOSPHERE, pressure_of_depth, surface_gravity
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import Digital
from leadline.simulate.terrain import distances_down

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.sea.terrain import Chart
    from leadline.simulate.surroundings import Surrounding
    from leadline.simulate.trajectory import Kinematics, Trajectory


def waves_above(state: Kinematics) -> Array | float:
    """Return the height (m) of water by which the waves of the sea raise the pressure at a point (times,)."""
    water = state.place.water
    return 0.0 if water.waves is None else water.wave_pressure(state.time, *state.north_east, state.depth)


@dataclass(frozen=True, kw_only=True)
class Depth(Digital[records.Depth]):
    """Depth of the sensor's own point below the sea surface (m), as its pressure tells: the tide is in it, and so are waves above."""

    measured = ("depth",)
    silent = True
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Depth:
        """Return depths without errors but the waves."""
        state = trajectory.at(time).point(self.lever_arm_b)
        return records.Depth(time=time, depth=state.depth + waves_above(state))

    def noisy(self, table: records.Depth, generator: Generator) -> records.Depth:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, depth=table.depth + error)


@dataclass(frozen=True, kw_only=True)
class Pressure(Digital[records.Pressure]):
    """Absolute pressure (Pa) at the sensor's own point: atmosphere + (1 + scale) x water above it, which is `datum` (m) too deep.

    The water is the standard ocean at the latitude of the place, or of constant `density` (kg/m^3) under `gravity` (m/s^2); tide and
    waves are in it.  The atmosphere is `atmosphere`, and `weather` (Pa) on top.
    """

    measured = ("pressure",)
    silent = True
    sigma: float = 0.0
    datum: Drift = STEADY
    atmosphere: float = ATMOSPHERE
    weather: Drift = STEADY
    density: float | None = None
    gravity: float | None = None
    scale: float = 0.0
    sigma_scale: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Pressure:
        """Return pressures without errors but the waves."""
        state = trajectory.at(time).point(self.lever_arm_b)
        depth = np.asarray(state.depth + waves_above(state))
        return records.Pressure(time=time, pressure=self.atmosphere + self.water(depth, state.geodetic[0]))

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
        pressure = self.atmosphere + water + self.sigma * white
        if self.weather != STEADY:
            pressure = pressure + self.weather.draw(table.time, 1, generator.spawn(1)[0])[:, 0]
        return replace(table, pressure=pressure)


@dataclass(frozen=True, kw_only=True)
class Altimeter(Digital[records.Altimeter]):
    """Distance (m) along the sensor's z axis to the sea bed, level or of a chart; nan where there is none.

    With an `opening` (rad, the full angle of the beam's cone) it is the shortest distance within the beam, of the axis and eight rays
    around it.  Between `range_min` and `range_max` (m) the bed is found.
    """

    measured = ("range",)
    silent = True
    seabed: Surrounding | Chart | None = None
    opening: float = 0.0
    range_min: float = -np.inf
    range_max: float = np.inf
    sigma: float = 0.0
    bias: Drift = STEADY

    @property
    def rays(self) -> Array:
        """Unit vectors (n, 3), sensor axes, along which it looks."""
        around = np.arange(8) * np.pi / 4 if self.opening else np.zeros(0)
        half = 0.5 * self.opening
        ring = np.stack([np.sin(half) * np.cos(around), np.sin(half) * np.sin(around), np.full(len(around), np.cos(half))], axis=1)
        return np.concatenate([[[0.0, 0.0, 1.0]], ring])

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Altimeter:
        """Return true distances."""
        if self.seabed is None:
            raise InputError("Altimeter", "has no sea bed", "give seabed")
        state = trajectory.at(time).point(self.lever_arm_b)
        slant, _ = distances_down(self.seabed, state, self.rotation_bs, self.rays, self.range_max)
        nearest = np.min(np.where(np.isfinite(slant), slant, np.inf), axis=1)
        within = (nearest >= self.range_min) & (nearest <= self.range_max) & np.isfinite(nearest)
        return records.Altimeter(time=time, range=np.where(within, nearest, np.nan))

    def noisy(self, table: records.Altimeter, generator: Generator) -> records.Altimeter:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, range=table.range + error)
