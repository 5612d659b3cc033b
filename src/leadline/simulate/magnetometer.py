"""What a magnetometer aboard a vehicle of iron and motors would have recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from leadline.data import records
from leadline.data.errors import InputError
from leadline.sea.magnetic import field_n
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.instrument import ZERO, Digital, Matrix, Vector
from leadline.simulate.vectors import turned_back

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.machinery import Machinery
    from leadline.simulate.trajectory import Trajectory

SQUARE: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class Magnetometer(Digital[records.Magnetometer]):
    """Magnetic flux density (T) in sensor axes: what the Earth's field becomes among iron and wires.

    z = soft_iron B_s + hard_iron + motor_coupling i(t) + bias + noise,   B_s = R_ns^T B_n
    B_n is that of the World Magnetic Model on `date` where the trajectory starts, all along, or `field_n` (T) if that is given.
    The elements of `soft_iron` (3, 3), scale and crossed axes of the sensor included, are off by N(0, sigma_soft), those of `hard_iron` (T)
    by N(0, sigma_hard), drawn at turn-on.  `motor_coupling` (3, motors), T/A, weighs the currents i of the motors of a `machinery`.
    `sigma` (T) is white noise of one reading.
    """

    measured = ("field",)
    date: datetime = datetime(2025, 1, 1, tzinfo=UTC)
    field_n: Vector | None = None
    soft_iron: Matrix = SQUARE
    sigma_soft: float = 0.0
    hard_iron: Vector = ZERO
    sigma_hard: float = 0.0
    motor_coupling: tuple[tuple[float, ...], ...] = ()
    machinery: Machinery | None = None
    bias: Drift = STEADY
    sigma: float = 0.0

    def earth_n(self, trajectory: Trajectory) -> Array:
        """Return the Earth's field (3,), north, east, down (T)."""
        if self.field_n is not None:
            return np.asarray(self.field_n, float)
        place = trajectory.place
        return field_n(place.latitude, place.longitude, place.surface_height - place.depth, self.date, "Magnetometer")

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Magnetometer:
        """Return the Earth's field in sensor axes."""
        rotation = trajectory.at(time).rotation_nb @ self.rotation_bs
        return records.Magnetometer(time=time, field=turned_back(rotation, np.broadcast_to(self.earth_n(trajectory), (len(time), 3))))

    def noisy(self, table: records.Magnetometer, generator: Generator) -> records.Magnetometer:
        """Add iron, motors, drift and white noise."""
        soft = np.asarray(self.soft_iron) + self.sigma_soft * generator.standard_normal((3, 3))
        hard = np.asarray(self.hard_iron) + self.sigma_hard * generator.standard_normal(3)
        error = self.bias.draw(table.time, 3, generator) + self.sigma * generator.standard_normal((len(table), 3))
        return replace(table, field=table.field @ soft.T + hard + self.motors(table.time) + error)

    def motors(self, time: Array) -> Array:
        """Return the field of the motors (times, 3) (T)."""
        if not self.motor_coupling:
            return np.zeros((len(time), 3))
        coupling = np.asarray(self.motor_coupling, float)
        count = 0 if self.machinery is None else self.machinery.thrusters.shape[1]
        if self.machinery is None or coupling.shape != (3, count):
            raise InputError("Magnetometer", f"motor_coupling has the shape {coupling.shape}, of {count} motors", "(3, motors)")
        return np.asarray(self.machinery.currents(time) @ coupling.T)
