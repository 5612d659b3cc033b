"""What Doppler logs would have recorded, over the ground and through the water."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.core.attitude import exponential, matrix_from_quaternion
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.instrument import Digital, Flags
from leadline.simulate.surroundings import STILL, Surrounding, through_water
from leadline.simulate.terrain import distances_down, vertical_distance

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.sea.sound import SoundProfile
    from leadline.sea.terrain import Chart
    from leadline.simulate.trajectory import Kinematics, Trajectory


def beam_vectors(azimuths: tuple[float, ...], tilt: float) -> Array:
    """Return unit outward beams (n, 3), sensor axes, from azimuth (x towards y) and tilt from the z axis (rad)."""
    azimuth = np.asarray(azimuths, float)
    return np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.full_like(azimuth, np.cos(tilt))], axis=-1)


@dataclass(frozen=True, kw_only=True)
class Dvl(Digital[records.Dvl]):
    """Velocity over ground of the transducer, sensor axes: (1 + scale) E^T v_s, E a small misalignment drawn at turn-on.

    `output` is "velocity", "beams" or "both".  With `azimuths` there are beams: positive when the sensor moves outward along the
    beam, noise `beam_sigma`, each ping of each lost with `beam_loss`; the velocity is then their least-squares solution, not valid with
    fewer than three.  `sigma` is white noise (m/s) per axis on top; both grow with speed: sqrt(sigma^2 + (sigma_fraction |v|)^2).
    Within `outages` (from, to) rows are valid = 0 and NaN.  `error_velocity` adds that column for four beams: their least-squares
    residual, scaled so that its sigma is that of a horizontal velocity, nan unless all are heard.

    `seabed` is level (a `Surrounding`) or a chart.  On a chart, and wherever the range is limited, each beam is cast to the bed by the
    full attitude: `range` is slant, off by N(0, sigma_range^2 + (sigma_range_fraction range)^2), and a beam that meets nothing between
    `range_min` and `range_max` (m, slant) is lost.  `altitude` (off by `sigma_altitude`) is vertical: the mean over all beams in reach
    of range times the cosine between beam and true vertical; without beams, or on a level bed without limits, it is straight down.
    With a `profile` the instrument, which reckons with `sound_speed` c_0 (m/s), is off where the water at the transducer has c: ranges by
    c_0 / c, velocities by c_0 / c with pistons; a `phased` array keeps sin(tilt) / c, so that of its velocities only z is off, by
    c_0 / c cos(tilt') / cos(tilt), sin(tilt') = c / c_0 sin(tilt).
    """

    measured = ("velocity", "beam")
    output: str = "velocity"
    scale: float = 0.0
    sigma_scale: float = 0.0
    sigma_mounting: float = 0.0
    sigma: float = 0.0
    sigma_fraction: float = 0.0
    azimuths: tuple[float, ...] = ()
    tilt: float = 0.0
    beam_sigma: float = 0.0
    beam_loss: float = 0.0
    error_velocity: bool = False
    outages: tuple[tuple[float, float], ...] = ()
    seabed: Surrounding | Chart | None = None
    range_min: float = 0.0
    range_max: float = np.inf
    sigma_range: float = 0.0
    sigma_range_fraction: float = 0.0
    sigma_altitude: float = 0.0
    profile: SoundProfile | None = None
    sound_speed: float = 1500.0
    phased: bool = False

    @property
    def limited(self) -> bool:
        """Whether there are places where it does not find the bed."""
        return self.seabed is not None and (not isinstance(self.seabed, Surrounding) or self.range_min > 0 or self.range_max < np.inf)

    @property
    def beams(self) -> Array:
        """Unit outward beams (n, 3), sensor axes."""
        return beam_vectors(self.azimuths, self.tilt)

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Dvl:
        """Return true velocities in sensor axes, as sound of the true speed shows them, and with a `seabed` altitude and ranges."""
        state = trajectory.at(time).point(self.lever_arm_b)
        velocity = state.velocity_b @ self.rotation_bs
        columns: dict[str, Any] = self.below(state)
        if self.profile is None:
            return records.Dvl(time=time, velocity=velocity, **columns)
        stretch = self.sound_speed / self.profile.speed_at(state.depth)
        columns = {name: value * (stretch[:, None] if value.ndim > 1 else stretch) for name, value in columns.items()}
        columns["sound_speed"] = np.full(len(time), self.sound_speed)
        return records.Dvl(time=time, velocity=self.heard_with(velocity, stretch), **columns)

    def heard_with(self, velocity: Array, stretch: Array) -> Array:
        """Return velocities (rows, 3), sensor axes, of an instrument that takes sound for `stretch` (rows,) times as fast as it is."""
        if not self.phased:
            return velocity * stretch[:, None]
        sine = np.sin(self.tilt) / stretch
        return np.column_stack([velocity[:, :2], velocity[:, 2] * stretch * np.sqrt(1 - sine * sine) / np.cos(self.tilt)])

    def below(self, state: Kinematics) -> dict[str, Any]:
        """Return the columns `altitude` and `range` (m) of a transducer; nan where the bed is out of reach."""
        if self.seabed is None:
            return {}
        if not (self.azimuths and self.limited):
            altitude = vertical_distance(self.seabed, state)
            within = (altitude >= self.range_min) & (altitude <= self.range_max)
            return {"altitude": np.where(within, altitude, np.nan) if self.limited else altitude}
        slant, down = distances_down(self.seabed, state, self.rotation_bs, self.beams, self.range_max)
        heard = (slant >= self.range_min) & (slant <= self.range_max)
        count = np.sum(heard, axis=1)
        total = np.sum(np.where(heard, slant * down, 0.0), axis=1)
        altitude = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        return {"altitude": altitude, "range": np.where(heard, slant, np.nan)}

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add scale, misalignment, noise and losses; make beams."""
        self.check()
        twist = matrix_from_quaternion(exponential(self.sigma_mounting * generator.standard_normal(3)))
        factor = 1 + self.scale + self.sigma_scale * generator.standard_normal()
        velocity = factor * (cast("Array", table.velocity) @ twist)
        growth = self.sigma_fraction * np.linalg.norm(velocity, axis=1, keepdims=True)
        white = np.hypot(self.sigma, growth) * generator.standard_normal(velocity.shape)
        lost = self.deaf(table)
        columns: dict[str, Any] = {"sound_speed": table.sound_speed}
        if self.azimuths:
            reached = ~lost[:, None] if table.range is None else ~lost[:, None] & np.isfinite(table.range)
            heard = (generator.random((len(table), len(self.azimuths))) >= self.beam_loss) & reached
            beam = velocity @ self.beams.T + np.hypot(self.beam_sigma, growth) * generator.standard_normal(heard.shape)
            velocity, solved = solve_beams(self.beams, beam, heard)
            lost = ~np.any(heard, axis=1) if self.output == "beams" else ~solved
            columns |= {"beam": np.where(heard, beam, np.nan), "beam_valid": heard.astype(float)} if self.output != "velocity" else {}
            if self.error_velocity:
                columns["error_velocity"] = np.where(np.all(heard, axis=1), beam @ self.discord, np.nan)
        if table.altitude is not None:
            altitude = table.altitude + self.sigma_altitude * generator.standard_normal(len(table))
            columns["altitude"] = np.where(lost, np.nan, altitude) if self.limited else altitude
        if table.range is not None:
            columns["range"] = np.where(heard, self.ranged(table.range, generator.spawn(1)[0]), np.nan)
        kept = None if self.output == "beams" else np.where(lost[:, None], np.nan, velocity + white)
        return records.Dvl(time=table.time, velocity=kept, valid=(~lost).astype(float), **columns)

    def check(self) -> None:
        """Refuse what does not go together."""
        if self.output not in ("velocity", "beams", "both") or (self.output != "velocity" and not self.azimuths):
            found = f"output is '{self.output}' with {len(self.azimuths)} azimuths"
            raise InputError("Dvl", found, "velocity, or beams or both with azimuths")
        if self.error_velocity and len(self.azimuths) != 4:
            raise InputError("Dvl", f"has an error velocity of {len(self.azimuths)} beams", "four beams")

    def deaf(self, table: records.Dvl) -> Flags:
        """Return the rows (n,) in which no beam is heard, whatever chance does."""
        lost: Flags = ~np.isfinite(cast("Array", table.velocity)[:, 0])
        if table.altitude is not None:
            lost |= ~np.isfinite(table.altitude)
        for begin, end in self.outages:
            lost |= (begin <= table.time) & (table.time < end)
        return lost

    @property
    def discord(self) -> Array:
        """Weights (4,) of the beams in the error velocity."""
        beams = self.beams
        away = np.linalg.svd(beams.T)[2][-1]  # of unit length, and no velocity has a part along it
        horizontal = np.linalg.inv(beams.T @ beams)
        return np.asarray(np.sign(away[0]) * away * np.sqrt(0.5 * (horizontal[0, 0] + horizontal[1, 1])))

    def ranged(self, slant: Array, generator: Generator) -> Array:
        """Return ranges with errors."""
        return np.asarray(slant + np.hypot(self.sigma_range, self.sigma_range_fraction * slant) * generator.standard_normal(slant.shape))


def solve_beams(beams: Array, beam: Array, heard: Flags) -> tuple[Array, Flags]:
    """Return the least-squares velocity (rows, 3) of the beams that are `heard`, and whether at least three are."""
    weight = heard.astype(float)
    solved: Flags = np.sum(heard, axis=1) >= 3
    normal = np.einsum("kb,bi,bj->kij", weight, beams, beams)
    normal[~solved] = np.eye(3)
    return np.asarray(np.linalg.solve(normal, (np.where(heard, beam, 0.0) @ beams)[..., None])[..., 0]), solved


@dataclass(frozen=True, kw_only=True)
class WaterVelocity(Dvl):
    """Velocity of the transducer through the water, with the errors of a Doppler log.

    The water is that of a cell from `cell_start` to `cell_end` (m) along the sensor's z axis: it moves as in the cell's middle; with both 0
    as at the transducer.  It moves as that of the trajectory's place does, and as `current` on top.  With a `seabed` rows are not valid
    whose cell reaches the bed, or where the bed hides it: beyond cos(tilt) of the altitude the side lobes hear the ground.  A cell
    above the surface holds no water.
    """

    current: Surrounding | None = STILL
    cell_start: float = 0.0
    cell_end: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Dvl:
        """Return true velocities in sensor axes; nan where the cell holds no water."""
        body = trajectory.at(time)
        state, axis = body.point(self.lever_arm_b), self.rotation_bs[:, 2]
        columns: dict[str, Any] = {}
        if not self.cell_end:
            velocity = through_water(state, self.current) @ self.rotation_bs
        else:
            middle = body.point(np.asarray(self.lever_arm_b) + 0.5 * (self.cell_start + self.cell_end) * axis)
            wet = self.wet(state, body.point(np.asarray(self.lever_arm_b) + self.cell_end * axis), middle)
            velocity = np.where(wet[:, None], through_water(state, self.current, middle) @ self.rotation_bs, np.nan)
            columns = {"cell_start": np.full(len(time), self.cell_start), "cell_end": np.full(len(time), self.cell_end)}
        if self.profile is not None:
            velocity = self.heard_with(velocity, self.sound_speed / self.profile.speed_at(state.depth))
            columns["sound_speed"] = np.full(len(time), self.sound_speed)
        return records.WaterVelocity(time=time, velocity=velocity, **columns)

    def wet(self, state: Kinematics, end: Kinematics, middle: Kinematics) -> Flags:
        """Return which cells (n,) lie in the water and stand clear of the bed."""
        wet: Flags = (middle.depth > 0.0) & (end.depth > 0.0)
        if self.seabed is not None:
            wet &= end.depth - state.depth < np.cos(self.tilt) * vertical_distance(self.seabed, state)
        return wet

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add errors, as of a Doppler log."""
        found = super().noisy(replace(table, altitude=None, range=None), generator)
        cells = {name: getattr(table, name) for name in ("cell_start", "cell_end")}
        return records.WaterVelocity(**{item.name: getattr(found, item.name) for item in found.columns()}, **cells)
