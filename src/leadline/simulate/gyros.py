"""What gyros and accelerometers would have recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.dense import Dense
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.inertial_kernels import means_of
from leadline.simulate.instrument import ZERO, Instrument, Vector

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory

CHUNK = 4096  # IMU intervals evaluated at a time, so that the work stays in the cache of the processor


def means(trajectory: Trajectory, start: Array, end: Array, lever_arm_b: Vector = ZERO, nodes: int = 5) -> tuple[Array, Array]:
    """Return the means (n, 3) over (start, end] of angular rate against inertial space and of specific force, body axes.

    Gauss-Legendre quadrature with `nodes` points in each interval; a motion between knots is integrated by compiled code.
    """
    if isinstance(trajectory.law, Dense):
        return means_of(trajectory.law, trajectory.place, start, end, np.asarray(lever_arm_b, float))
    points, weights = np.polynomial.legendre.leggauss(nodes)
    rate, force = np.empty((len(start), 3)), np.empty((len(start), 3))
    for first in range(0, len(start), CHUNK):
        part = slice(first, first + CHUNK)
        inside = start[part, None] + 0.5 * (end[part] - start[part])[:, None] * (1 + points)
        state = trajectory.at(inside.ravel()).point(lever_arm_b)
        for target, value in ((rate, state.rate_ib_b), (force, state.specific_force_b)):
            target[part] = np.einsum("kjc,j->kc", value.reshape(*inside.shape, 3), 0.5 * weights)
    return rate, force


@dataclass(frozen=True, kw_only=True)
class Imu(Instrument[records.Imu]):
    """Specific force and rate against inertial space at the IMU's point: `sample` is "mean", "instant" or "increment".

    The first interval reaches back by 1 / rate.  An increment is the integral in turning body axes, not a rotation vector.
    White noise by density (rad/s/sqrt(Hz), m/s^2/sqrt(Hz)): sigma = density / sqrt(interval).
    """

    sample: str = "mean"
    gyro_density: float = 0.0
    accel_density: float = 0.0
    gyro_bias: Drift = STEADY
    accel_bias: Drift = STEADY

    def intervals(self, time: Array) -> Array:
        """Return the length (s) of the interval that each row covers."""
        return np.diff(time, prepend=time[:1] - 1 / self.rate)

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Imu:
        """Return rates and specific forces without errors."""
        if self.sample not in ("mean", "instant", "increment"):
            raise InputError("Imu", f"sample is '{self.sample}'", "mean, instant or increment")
        interval = 0 * time if self.sample == "instant" else self.intervals(time)
        rate, force = means(trajectory, time - interval, time, self.lever_arm_b, nodes=1 if self.sample == "instant" else 5)
        gyro, accel = rate @ self.rotation_bs, force @ self.rotation_bs
        if self.sample == "increment":
            span = interval[:, None]
            return records.Imu(time=time, delta_angle=gyro * span, delta_velocity=accel * span, interval=interval)
        return records.Imu(time=time, gyro=gyro, accel=accel, sample=self.sample)

    def noisy(self, table: records.Imu, generator: Generator) -> records.Imu:
        """Add biases and white noise."""
        span = self.intervals(table.time)[:, None]
        shape = (len(table), 3)
        gyro = self.gyro_bias.draw(table.time, 3, generator) + self.gyro_density / np.sqrt(span) * generator.standard_normal(shape)
        accel = self.accel_bias.draw(table.time, 3, generator) + self.accel_density / np.sqrt(span) * generator.standard_normal(shape)
        if table.delta_angle is not None and table.delta_velocity is not None:
            return replace(table, delta_angle=table.delta_angle + gyro * span, delta_velocity=table.delta_velocity + accel * span)
        return replace(table, gyro=cast("Array", table.gyro) + gyro, accel=cast("Array", table.accel) + accel)


@dataclass(frozen=True, kw_only=True)
class YawRate(Instrument[records.YawRate]):
    """Rate about the sensor's z axis (rad/s): against inertial space, or with `earth_removed` against the Earth; (1 + scale) times it.

    `sigma` is white noise of one reading (rad/s).
    """

    earth_removed: bool = False
    scale: float = 0.0
    sigma_scale: float = 0.0
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.YawRate:
        """Return true rates at the moments themselves."""
        state = trajectory.at(time)
        rate = state.rate_eb_b if self.earth_removed else state.rate_ib_b
        return records.YawRate(time=time, yaw_rate=rate @ self.rotation_bs[:, 2])

    def noisy(self, table: records.YawRate, generator: Generator) -> records.YawRate:
        """Add scale, bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        factor = 1 + self.scale + self.sigma_scale * generator.standard_normal()
        return replace(table, yaw_rate=factor * table.yaw_rate + error)
