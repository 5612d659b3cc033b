"""What instruments of position would have recorded, and the word that the vehicle stands still."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from leadline.core.geodesy import ecef_from_geodetic, geodetic_from_ecef, north_east, rotation_en
from leadline.data import records
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import ZERO, Instrument, Vector
from leadline.simulate.reception import Fixes, Reception
from leadline.simulate.trajectory import euler
from leadline.simulate.vectors import turned

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array, Text
    from leadline.simulate.trajectory import Trajectory


def displaced(latitude: Array, longitude: Array, height: Array, error_n: Array) -> tuple[Array, Array, Array]:
    """Return latitude, longitude and height of points moved by `error_n` (rows, 3) metres north-east-down; safe at the poles."""
    if not np.any(error_n):
        return latitude, longitude, height
    return geodetic_from_ecef(ecef_from_geodetic(latitude, longitude, height) + turned(rotation_en(latitude, longitude), error_n))


@dataclass(frozen=True, kw_only=True)
class Gnss(Instrument[records.Gnss]):
    """Position of the antenna, while it is not deeper than `max_depth` (m); velocity where `sigma_velocity` is not None.

    With a `reception` rows say what kind of fix they are, how many satellites and which dilution of precision they have, and `sigmas`
    gives sigmas (m) by kind; `sigma` holds for the others.  A row without a fix is there: fix_type none, valid = 0, nan.
    """

    sigma: Vector = ZERO  # north, east, down
    drift: Drift = STEADY
    sigma_velocity: float | None = None
    max_depth: float = np.inf
    reception: Reception | None = None
    sigmas: Mapping[str, Vector] = field(default_factory=dict)

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Gnss:
        """Return true positions of the antenna."""
        seen = trajectory.at(time).point(self.lever_arm_b).depth <= self.max_depth
        state = trajectory.at(time[seen]).point(self.lever_arm_b)
        latitude, longitude, height = state.geodetic
        velocity = None if self.sigma_velocity is None else state.velocity_n
        return records.Gnss(time=state.time, latitude=latitude, longitude=longitude, height=height, velocity=velocity)

    def noisy(self, table: records.Gnss, generator: Generator) -> records.Gnss:
        """Add errors north, east and down, by the kind of fix where it has one."""
        shape = (len(table), 3)
        fixes = None
        if self.reception is not None:
            fixes = self.reception.fixes(table.time, self.offset, 1 / self.rate, generator.spawn(1)[0])
        sigma = np.asarray(self.sigma) if fixes is None else self.sigma_by_row(fixes.fix_type)
        error = self.drift.draw(table.time, 3, generator) + sigma * generator.standard_normal(shape)
        latitude, longitude, height = displaced(table.latitude, table.longitude, cast("Array", table.height), error)
        velocity = table.velocity
        if velocity is not None:
            velocity = velocity + (self.sigma_velocity or 0.0) * generator.standard_normal(shape)
        stated = np.broadcast_to(sigma, shape) if sigma.size and np.min(sigma) > 0 else None
        found = replace(table, latitude=latitude, longitude=longitude, height=height, velocity=velocity, sigma_axes=stated)
        return found if fixes is None else without_fix(found, fixes)

    def sigma_by_row(self, fix_type: Text) -> Array:
        """Return sigmas (rows, 3) north, east and down (m) of kinds of fix."""
        kinds, place = np.unique(fix_type, return_inverse=True)
        return np.array([self.sigmas.get(str(kind), self.sigma) for kind in kinds], float).reshape(-1, 3)[place]


def without_fix(table: records.Gnss, fixes: Fixes) -> records.Gnss:
    """Return a table that says what kind of fix each row is, with nothing measured where there is none."""
    none = fixes.fix_type == "none"
    columns = {name: getattr(table, name) for name in ("latitude", "longitude", "height", "velocity", "sigma_axes")}
    blank: dict[str, Any] = {
        name: np.where(none.reshape(-1, *[1] * (value.ndim - 1)), np.nan, value) for name, value in columns.items() if value is not None
    }
    return replace(table, **blank, valid=(~none).astype(float), **fixes._asdict())


@dataclass(frozen=True, kw_only=True)
class PositionFix(Instrument[records.PositionFix]):
    """Position of the transponder solved elsewhere: `output` is "geographic" or "local" (metres from the trajectory's start).

    White noise `sigma` (m) north and east, `sigma_depth` down, and a `bias` north and east that may wander.  A fraction of the fixes is
    wrong by 0.5 to 1.5 `outlier_size` (m) in any direction; the column `outlier` says which (for assessment: no estimator reads it).
    """

    output: str = "geographic"
    depth: bool = True
    sigma: float = 0.0
    sigma_depth: float = 0.0
    outlier_fraction: float = 0.0
    outlier_size: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.PositionFix:
        """Return true positions of the transponder."""
        state, place = trajectory.at(time).point(self.lever_arm_b), trajectory.place
        latitude, longitude, _ = state.geodetic
        depth = state.depth if self.depth else None
        if self.output == "geographic":
            return records.PositionFix(time=time, latitude=latitude, longitude=longitude, depth=depth)
        north, east = north_east(latitude, longitude, place.latitude, place.longitude)
        return records.PositionFix(time=time, north=north, east=east, depth=depth)

    def noisy(self, table: records.PositionFix, generator: Generator) -> records.PositionFix:
        """Add white noise and outliers."""
        rows = len(table)
        error = np.array([self.sigma, self.sigma, self.sigma_depth]) * generator.standard_normal((rows, 3))
        wrong = generator.random(rows) < self.outlier_fraction
        size, bearing = self.outlier_size * generator.uniform(0.5, 1.5, rows) * wrong, generator.uniform(0, 2 * np.pi, rows)
        error[:, 0] += size * np.cos(bearing)
        error[:, 1] += size * np.sin(bearing)
        if self.bias != STEADY:
            error[:, :2] += self.bias.draw(table.time, 2, generator.spawn(1)[0])
        columns: dict[str, Any] = {"depth": None if table.depth is None else table.depth + error[:, 2]}
        if table.latitude is not None and table.longitude is not None:
            level = error * (1.0, 1.0, 0.0)
            columns["latitude"], columns["longitude"], _ = displaced(table.latitude, table.longitude, np.zeros(rows), level)
        else:
            columns |= {"north": cast("Array", table.north) + error[:, 0], "east": cast("Array", table.east) + error[:, 1]}
        if self.sigma > 0 and self.sigma_depth > 0:
            columns["sigma_axes"] = np.tile([self.sigma, self.sigma, self.sigma_depth], (rows, 1))
        return replace(table, **columns, extra={"outlier": wrong.astype(float)} if self.outlier_fraction else {})


@dataclass(frozen=True, kw_only=True)
class ZeroVelocity(Instrument[records.ZeroVelocity]):
    """The word that the vehicle stands still, with the sigma (m/s) of that; give it only where the trajectory does."""

    sigma: float = 0.001

    def ideal(self, trajectory: Trajectory, time: Array) -> records.ZeroVelocity:  # noqa: ARG002  (knows no motion)
        """Return the rows."""
        return records.ZeroVelocity(time=time, sigma=np.full(len(time), self.sigma))

    def noisy(self, table: records.ZeroVelocity, generator: Generator) -> records.ZeroVelocity:  # noqa: ARG002  (has no noise)
        """Return the rows."""
        return table


@dataclass(frozen=True, kw_only=True)
class Navigation(Instrument[records.Navigation]):
    """Another system's dead reckoning: from the true start on, displacements stretched by `scale`, turned by `rotation` (rad, clockwise).

    Positions walk by `walk` (m per root second, north and east each); depth and heading have white noise (m, rad).
    """

    scale: float = 0.0
    rotation: float = 0.0
    walk: float = 0.0
    sigma_depth: float = 0.0
    sigma_heading: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Navigation:
        """Return true positions, depths and headings, with stretch and turn."""
        state, place = trajectory.at(time).point(self.lever_arm_b), trajectory.place
        latitude, longitude, height = state.geodetic
        if self.scale or self.rotation:
            gone = np.stack(north_east(latitude, longitude, place.latitude, place.longitude), axis=1)
            c, s = np.cos(self.rotation), np.sin(self.rotation)
            error = (1 + self.scale) * gone @ np.array([[c, s], [-s, c]]) - gone
            latitude, longitude, _ = displaced(latitude, longitude, height, np.column_stack([error, np.zeros(len(time))]))
        heading = euler(trajectory.at(time).rotation_nb)[2]
        return records.Navigation(time=time, latitude=latitude, longitude=longitude, depth=state.depth, heading=heading)

    def noisy(self, table: records.Navigation, generator: Generator) -> records.Navigation:
        """Add walk and noise."""
        steps = Drift(walk=self.walk).draw(table.time, 2, generator)
        error, flat = np.column_stack([steps, np.zeros(len(table))]), np.zeros(len(table))
        latitude, longitude, _ = displaced(cast("Array", table.latitude), cast("Array", table.longitude), flat, error)
        depth = cast("Array", table.depth) + self.sigma_depth * generator.standard_normal(len(table))
        heading = (cast("Array", table.heading) + self.sigma_heading * generator.standard_normal(len(table))) % (2 * np.pi)
        return replace(table, latitude=latitude, longitude=longitude, depth=depth, heading=heading)
