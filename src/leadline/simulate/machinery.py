"""What a vehicle tells of its own machinery: speeds of thrusters, angles of fins, and the currents that its motors draw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.instrument import Digital

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.hull import Hull
    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Machinery:
    """Speeds of thrusters (times, n) (rps) and angles of fins (times,) (rad) of a voyage, at ascending times (s).

    Straight in between, constant beyond the ends.  A motor draws  i = idle + drawn |n|^power  (A) at speed n: a propeller takes a power
    that grows as n^3, and so does the current of a supply of constant voltage; that within the windings grows as its torque, n^2.
    Raises InputError where shapes do not match.
    """

    time: Array
    thrusters: Array
    rudder: Array | None = None
    stern: Array | None = None
    idle: float = 0.0
    drawn: float = 0.0
    power: float = 3.0

    def __post_init__(self) -> None:
        """Refuse what does not belong together."""
        rows, wrong = len(self.time), np.any(np.diff(self.time) <= 0.0)
        shapes = [np.shape(column) for column in (self.rudder, self.stern) if column is not None]
        if not rows or wrong or self.thrusters.ndim != 2 or len(self.thrusters) != rows or any(shape != (rows,) for shape in shapes):
            found = f"has {rows} times, thrusters of shape {self.thrusters.shape}, fins of {shapes}"
            raise InputError("machinery", found, "a row for each of the ascending times, (times, n) and (times,)")

    @classmethod
    def of(cls, hull: Hull, time: Array, moved: Array, *, idle: float = 0.0, drawn: float = 0.0, power: float = 3.0) -> Machinery:
        """Return that of a hull whose actuators moved so (times, actuators), as a voyage tells; fins of a kind are averaged."""
        count = len(hull.thrusters)

        def angle(kind: str) -> Array | None:
            columns = [count + k for k, fin in enumerate(hull.fins) if fin.kind == kind]
            return np.asarray(np.mean(moved[:, columns], axis=1)) if columns else None

        return cls(time, moved[:, :count], angle("rudder"), angle("stern"), idle=idle, drawn=drawn, power=power)

    def speeds(self, time: Array) -> Array:
        """Return the speeds (times, n) of the thrusters (rps) at times (s)."""
        columns = [np.interp(time, self.time, column) for column in self.thrusters.T]
        return np.stack(columns, axis=1) if columns else np.zeros((len(time), 0))

    def currents(self, time: Array) -> Array:
        """Return the currents (times, n) of the motors (A) at times (s)."""
        return np.asarray(self.idle + self.drawn * np.abs(self.speeds(time)) ** self.power)

    def angles(self, time: Array) -> tuple[Array | None, Array | None]:
        """Return the angles (times,) of rudder and stern planes (rad) at times (s), of those that there are."""
        rudder, stern = (None if fin is None else np.interp(time, self.time, fin) for fin in (self.rudder, self.stern))
        return rudder, stern


@dataclass(frozen=True, kw_only=True)
class ThrusterSpeeds(Digital[records.Thruster]):
    """Speeds of thrusters (rps), off by `sigma`, and angles of fins (rad), off by `sigma_angle`."""

    measured = ("thruster",)
    machinery: Machinery
    sigma: float = 0.0
    sigma_angle: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Thruster:  # noqa: ARG002  (the machinery knows)
        """Return true speeds and angles."""
        rudder, stern = self.machinery.angles(time)
        return records.Thruster(time=time, thruster=self.machinery.speeds(time), rudder=rudder, stern=stern)

    def noisy(self, table: records.Thruster, generator: Generator) -> records.Thruster:
        """Add white noise."""
        thruster = table.thruster + self.sigma * generator.standard_normal(table.thruster.shape)
        white = self.sigma_angle * generator.standard_normal((2, len(table)))
        rudder = None if table.rudder is None else table.rudder + white[0]
        return replace(table, thruster=thruster, rudder=rudder, stern=None if table.stern is None else table.stern + white[1])


@dataclass(frozen=True, kw_only=True)
class MotorCurrents(Digital[records.MotorCurrent]):
    """Electric currents of the motors (A): (1 + N(0, sigma_scale)) times the true one, each motor alone, and white noise `sigma`."""

    measured = ("motor",)
    machinery: Machinery
    sigma: float = 0.0
    sigma_scale: float = 0.0

    def ideal(self, trajectory: Trajectory, time: Array) -> records.MotorCurrent:  # noqa: ARG002  (the machinery knows)
        """Return true currents."""
        return records.MotorCurrent(time=time, motor=self.machinery.currents(time))

    def noisy(self, table: records.MotorCurrent, generator: Generator) -> records.MotorCurrent:
        """Add scale and white noise."""
        factor = 1 + self.sigma_scale * generator.standard_normal(table.motor.shape[1])
        return replace(table, motor=factor * table.motor + self.sigma * generator.standard_normal(table.motor.shape))
