"""What Doppler logs and logs of speed would have recorded, over the ground and through the water."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.core.attitude import exponential, matrix_from_quaternion
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import Flags, Instrument
from leadline.simulate.surroundings import STILL, Surrounding
from leadline.simulate.vectors import turned_back

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Kinematics, Trajectory


def beam_vectors(azimuths: tuple[float, ...], tilt: float) -> Array:
    """Return unit outward beams (n, 3), sensor axes, from azimuth (x towards y) and tilt from the z axis (rad)."""
    azimuth = np.asarray(azimuths, float)
    return np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.full_like(azimuth, np.cos(tilt))], axis=-1)


@dataclass(frozen=True, kw_only=True)
class Dvl(Instrument[records.Dvl]):
    """Velocity over ground of the transducer, sensor axes: (1 + scale) E^T v_s, E a small misalignment drawn at turn-on.

    `output` is "velocity", "beams" or "both".  With `azimuths` there are beams: positive when the sensor moves outward along the
    beam, noise `beam_sigma`, each ping of each lost with `beam_loss`; the velocity is then their least-squares solution, not valid with
    fewer than three.  `sigma` is white noise (m/s) per axis on top.  Within `outages` (from, to) rows are valid = 0 and NaN.
    """

    output: str = "velocity"
    scale: float = 0.0
    sigma_scale: float = 0.0
    sigma_mounting: float = 0.0
    sigma: float = 0.0
    azimuths: tuple[float, ...] = ()
    tilt: float = 0.0
    beam_sigma: float = 0.0
    beam_loss: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()
    seabed: Surrounding | None = None
    sigma_altitude: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Dvl:
        """Return true velocities in sensor axes, and with a `seabed` the vertical altitude above it."""
        state = trajectory.at(time).point(self.lever_arm_b)
        altitude = None if self.seabed is None else self.seabed.at(time)[:, 0] - state.depth
        return records.Dvl(time=time, velocity=state.velocity_b @ self.rotation_bs, altitude=altitude)

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add scale, misalignment, noise and losses; make beams."""
        if self.output not in ("velocity", "beams", "both") or (self.output != "velocity" and not self.azimuths):
            found = f"output is '{self.output}' with {len(self.azimuths)} azimuths"
            raise InputError("Dvl", found, "velocity, or beams or both with azimuths")
        twist = matrix_from_quaternion(exponential(self.sigma_mounting * generator.standard_normal(3)))
        factor = 1 + self.scale + self.sigma_scale * generator.standard_normal()
        velocity = factor * (cast("Array", table.velocity) @ twist)
        white = self.sigma * generator.standard_normal(velocity.shape)
        lost: Flags = np.zeros(len(table), np.bool_)
        for begin, end in self.outages:
            lost |= (begin <= table.time) & (table.time < end)
        columns: dict[str, Any] = {}
        if self.azimuths:
            beams = beam_vectors(self.azimuths, self.tilt)
            heard = (generator.random((len(table), len(beams))) >= self.beam_loss) & ~lost[:, None]
            beam = velocity @ beams.T + self.beam_sigma * generator.standard_normal(heard.shape)
            velocity, solved = solve_beams(beams, beam, heard)
            lost = ~np.any(heard, axis=1) if self.output == "beams" else ~solved
            columns = {"beam": np.where(heard, beam, np.nan), "beam_valid": heard.astype(float)} if self.output != "velocity" else {}
        if table.altitude is not None:
            columns["altitude"] = table.altitude + self.sigma_altitude * generator.standard_normal(len(table))
        kept = None if self.output == "beams" else np.where(lost[:, None], np.nan, velocity + white)
        return records.Dvl(time=table.time, velocity=kept, valid=(~lost).astype(float), **columns)


def solve_beams(beams: Array, beam: Array, heard: Flags) -> tuple[Array, Flags]:
    """Return the least-squares velocity (rows, 3) of the beams that are `heard`, and whether at least three are."""
    weight = heard.astype(float)
    solved: Flags = np.sum(heard, axis=1) >= 3
    normal = np.einsum("kb,bi,bj->kij", weight, beams, beams)
    normal[~solved] = np.eye(3)
    return np.asarray(np.linalg.solve(normal, ((weight * beam) @ beams)[..., None])[..., 0]), solved


def through_water(state: Kinematics, current: Surrounding) -> Array:
    """Return the velocity (times, 3) of a point through the water, body axes: over ground less the current, north, east and 0 down."""
    flow = np.column_stack([current.at(state.time), np.zeros(len(state.time))])
    return state.velocity_b - turned_back(state.rotation_nb, flow)


@dataclass(frozen=True, kw_only=True)
class WaterVelocity(Dvl):
    """Velocity of the transducer through the water, with the errors of a Doppler log."""

    current: Surrounding = STILL

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Dvl:
        """Return true velocities in sensor axes."""
        state = trajectory.at(time).point(self.lever_arm_b)
        return records.WaterVelocity(time=time, velocity=through_water(state, self.current) @ self.rotation_bs)

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add errors, as of a Doppler log."""
        found = super().noisy(table, generator)
        return records.WaterVelocity(**{item.name: getattr(found, item.name) for item in found.columns()})


@dataclass(frozen=True, kw_only=True)
class Speed(Instrument[records.Speed]):
    """Speed through the water along the sensor's x axis: (1 + scale) measured = speed + bias (m/s)."""

    current: Surrounding = STILL
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
