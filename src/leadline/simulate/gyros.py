"""What gyros and accelerometers would have recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self, cast

import numpy as np

from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.dense import Dense
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.first_order import lagging
from leadline.simulate.inertial_kernels import means_of
from leadline.simulate.instrument import ZERO, Digital, Instrument, Vector, digits, frozen

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
class Triad:
    """Three axes that are not quite equal nor quite square, and what they show: z = (I + M) true, within +-limit, in whole quanta.

    M has `scale` on its diagonal, each off by N(0, sigma_scale), and N(0, sigma_misalignment) (rad) in its six other places, drawn at
    turn-on: those of an axis are the angles by which it leans towards the two others.  `quantum` and `limit` in the unit of a rate (rad/s)
    or a specific force (m/s^2).  An increment consists of whole quanta / rate, and what is left over goes into the next: quantisation
    noise, of Allan deviation quantum / (2 rate T) at averaging times T.
    """

    scale: Vector = ZERO
    sigma_scale: float = 0.0
    sigma_misalignment: float = 0.0
    quantum: float = 0.0
    limit: float = np.inf

    @property
    def bent(self) -> bool:
        """Whether M is not zero."""
        return any(self.scale) or self.sigma_scale > 0 or self.sigma_misalignment > 0

    def matrix(self, generator: Generator) -> Array:
        """Return I + M (3, 3) of one turn-on."""
        normal = generator.standard_normal((3, 3))
        sigma = np.where(np.eye(3, dtype=bool), self.sigma_scale, self.sigma_misalignment)
        return np.asarray(np.eye(3) + np.diag(self.scale) + sigma * normal)

    def shown(self, value: Array) -> Array:
        """Return rates or specific forces as they are shown."""
        return digits(value, self.quantum, self.limit) if self.quantum or self.limit < np.inf else value

    def counted(self, increment: Array, span: Array, rate: float) -> Array:
        """Return increments (rows, 3) over spans (rows, 1) (s) as they are shown, by an instrument of a rate (Hz)."""
        if self.limit < np.inf:
            increment = np.clip(increment, -self.limit * span, self.limit * span)
        if not self.quantum:
            return increment
        whole = np.round(np.cumsum(increment, axis=0) * (rate / self.quantum))
        return np.asarray(np.diff(whole, axis=0, prepend=0.0) * (self.quantum / rate))


EVEN = Triad()


@dataclass(frozen=True, kw_only=True)
class Imu(Instrument[records.Imu]):
    """Specific force and rate against inertial space at the IMU's point: `sample` is "mean", "instant" or "increment".

    The first interval reaches back by 1 / rate, or to where the motion begins, if that is later.
    An increment is the integral in turning body axes, not a rotation vector.
    White noise by density (rad/s/sqrt(Hz), m/s^2/sqrt(Hz)): sigma = density / sqrt(interval).  Bias instability and rate random walk are
    the `flicker` and the `walk` of the biases.
    What is shown:  gyro = T_g ((I + M_g) w + G f + bias + noise),  accel = T_a ((I + M_a) f + bias + noise),
    with M, limits and quanta T of `gyro_axes` and `accel_axes`, and G (3, 3), rad/s per m/s^2, whose elements are `g_sensitivity` on
    the diagonal, and off by N(0, sigma_g_sensitivity) everywhere, drawn at turn-on.
    """

    sample: str = "mean"
    gyro_density: float = 0.0
    accel_density: float = 0.0
    gyro_bias: Drift = STEADY
    accel_bias: Drift = STEADY
    gyro_axes: Triad = EVEN
    accel_axes: Triad = EVEN
    g_sensitivity: float = 0.0
    sigma_g_sensitivity: float = 0.0
    since: float | None = None  # moment (s) of the row before the first: of a piece of a dive

    def going_on(self, moments: Array) -> Self:
        """Return the instrument as it goes on after rows at earlier `moments` (s)."""
        return replace(self, since=float(moments[-1])) if len(moments) else self

    def intervals(self, time: Array) -> Array:
        """Return the length (s) of the interval that each row covers."""
        return np.diff(time, prepend=time[:1] - 1 / self.rate if self.since is None else np.full(len(time[:1]), self.since))

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Imu:
        """Return rates and specific forces without errors."""
        if self.sample not in ("mean", "instant", "increment"):
            raise InputError("Imu", f"sample is '{self.sample}'", "mean, instant or increment")
        interval = 0 * time if self.sample == "instant" else self.intervals(time)
        interval[:1] = np.minimum(interval[:1], time[:1] - trajectory.begin)
        rate, force = means(trajectory, time - interval, time, self.lever_arm_b, nodes=1 if self.sample == "instant" else 5)
        gyro = rate @ self.rotation_bs
        del rate  # of a day each of these takes a fifth of a gigabyte
        accel = force @ self.rotation_bs
        del force
        if self.sample == "increment":
            gyro *= interval[:, None]
            accel *= interval[:, None]
            return records.Imu(time=time, delta_angle=frozen(gyro), delta_velocity=frozen(accel), interval=interval)
        return records.Imu(time=time, gyro=frozen(gyro), accel=frozen(accel), sample=self.sample)

    def noisy(self, table: records.Imu, generator: Generator) -> records.Imu:
        """Add what is bent, biases and white noise; show that in digits."""
        span = (self.intervals(table.time) if table.interval is None else table.interval)[:, None]
        shape = (len(table), 3)
        gyro, accel = (
            _with_white(bias.draw(table.time, 3, generator), density / np.sqrt(span), generator.standard_normal(shape))
            for bias, density in ((self.gyro_bias, self.gyro_density), (self.accel_bias, self.accel_density))
        )
        if table.delta_angle is not None and table.delta_velocity is not None:
            angle, velocity = self.bent(table.delta_angle, table.delta_velocity, generator)
            angle, velocity = angle + gyro * span, velocity + accel * span
            angle, velocity = (a.counted(v, span, self.rate) for a, v in ((self.gyro_axes, angle), (self.accel_axes, velocity)))
            return replace(table, delta_angle=angle, delta_velocity=velocity)
        rate, force = self.bent(cast("Array", table.gyro), cast("Array", table.accel), generator)
        gyro += rate
        accel += force
        return replace(table, gyro=frozen(self.gyro_axes.shown(gyro)), accel=frozen(self.accel_axes.shown(accel)))

    def bent(self, gyro: Array, accel: Array, generator: Generator) -> tuple[Array, Array]:
        """Return rates and specific forces, or their increments, as bent axes feel them."""
        if not (self.gyro_axes.bent or self.accel_axes.bent or self.g_sensitivity or self.sigma_g_sensitivity):
            return gyro, accel
        own, other, coupling = generator.spawn(3)
        felt = self.g_sensitivity * np.eye(3) + self.sigma_g_sensitivity * coupling.standard_normal((3, 3))
        return gyro @ self.gyro_axes.matrix(own).T + accel @ felt.T, accel @ self.accel_axes.matrix(other).T


def _with_white(error: Array, sigma: Array, white: Array) -> Array:
    """Return an error with white noise on top, in the place of both."""
    white *= sigma
    error += white
    return error


@dataclass(frozen=True, kw_only=True)
class YawRate(Digital[records.YawRate]):
    """Rate about the sensor's z axis (rad/s): against inertial space, or with `earth_removed` against the Earth; (1 + scale) times it.

    It follows with a lag (s), lag z' = rate - z, settled at the start.  `sigma` is white noise of one reading (rad/s).
    """

    measured = ("yaw_rate",)
    earth_removed: bool = False
    lag: float = 0.0
    scale: float = 0.0
    sigma_scale: float = 0.0
    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.YawRate:
        """Return true rates at the moments themselves, less the lag."""

        def felt(moments: Array) -> Array:
            state = trajectory.at(moments)
            rate = state.rate_eb_b if self.earth_removed else state.rate_ib_b
            return np.asarray(rate @ self.rotation_bs[:, 2])[:, None]

        return records.YawRate(time=time, yaw_rate=lagging(time, felt, self.lag)[:, 0])

    def noisy(self, table: records.YawRate, generator: Generator) -> records.YawRate:
        """Add scale, bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        factor = 1 + self.scale + self.sigma_scale * generator.standard_normal()
        return replace(table, yaw_rate=factor * table.yaw_rate + error)
