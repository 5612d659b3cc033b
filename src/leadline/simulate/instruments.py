"""What instruments would have recorded on a trajectory: one frozen class per kind of table, SI and radians.

Each has two halves.  `ideal` asks the trajectory and knows no noise: it depends on no seed, so that it is computed once for many
runs.  `noisy` adds the errors, from a generator of the instrument's own.  With all sigmas zero, noisy equals ideal.
Nothing here is shared with the sensor models of the estimator: each is the other's witness.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt

from leadline.core.attitude import exponential, matrix_from_euler, matrix_from_quaternion, wrapped
from leadline.core.geodesy import ecef_from_geodetic, from_north_east, geodetic_from_ecef, north_east, rotation_en
from leadline.data import records
from leadline.data.errors import InputError
from leadline.simulate.trajectory import euler, turned

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator

    from leadline.data.log import Beacon
    from leadline.data.records import Array
    from leadline.simulate.trajectory import Place, Trajectory

Vector: TypeAlias = tuple[float, float, float]
Flags: TypeAlias = npt.NDArray[np.bool_]
T = TypeVar("T", bound=records.Table)
CHUNK = 4096  # IMU intervals evaluated at a time, so that the work stays in the cache of the processor
ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Drift:
    """A slowly varying error: constant + drawn at turn-on + first-order Gauss-Markov + random walk, each axis alone.

    Sigmas in the unit of the value; `tau` in s; `walk` in the unit per sqrt(s).  The Gauss-Markov part starts in its steady state:
    x(t + dt) = exp(-dt / tau) x(t) + w,  var(w) = steady^2 (1 - exp(-2 dt / tau)).
    """

    constant: float | tuple[float, ...] = 0.0
    turn_on: float = 0.0
    steady: float = 0.0
    tau: float = 300.0
    walk: float = 0.0

    def draw(self, time: Array, axes: int, generator: Generator) -> Array:
        """Return the error (times, axes) at ascending times (s); the numbers drawn do not depend on the sigmas."""
        fixed = np.asarray(self.constant, float) + self.turn_on * generator.standard_normal(axes)
        markov = self.steady * gauss_markov(time / self.tau, generator.standard_normal((len(time), axes)))
        steps = np.sqrt(np.diff(time, prepend=time[:1]))[:, None] * generator.standard_normal((len(time), axes))
        return np.asarray(fixed + markov + self.walk * np.cumsum(steps, axis=0))


def gauss_markov(time: Array, normal: Array) -> Array:
    """Return the unit Gauss-Markov process (times, axes) of time constant 1, driven by `normal` of the same shape.

    x_k = e_k (x_0 + sum_j s_j w_j / e_j) with e = exp(-(time - time_0)), summed within blocks of 20 time constants, since e underflows.
    """
    result, first = np.empty_like(normal), 0
    driven = np.sqrt(-np.expm1(-2 * np.diff(time, prepend=-np.inf)))[:, None] * normal
    while first < len(time):
        last = max(first + 1, int(np.searchsorted(time, time[first] + 20.0)))
        decay = np.exp(time[first] - time[first:last])[:, None]
        block = np.cumsum(driven[first:last] / decay, axis=0)
        if first:
            block += result[first - 1] * np.exp(time[first - 1] - time[first])
        result[first:last] = decay * block
        first = last
    return result


@dataclass(frozen=True, kw_only=True)
class Instrument(ABC, Generic[T]):
    """When an instrument samples, where it sits, and how its rows arrive.

    It samples at offset + k / rate up to `stop` (s), shifted by N(0, jitter) but less than 0.4 / rate; `time` is the true moment.
    Rows arrive at time + latency + |N(0, latency_jitter)|; a fraction `loss` of them never does.
    The reference point lies at `lever_arm_b` (m) from the body origin; `mounting_bs` holds roll, pitch and heading (rad) of the
    sensor axes against the body: v_b = R_bs v_s.
    """

    rate: float
    offset: float = 0.0
    stop: float = np.inf
    jitter: float = 0.0
    latency: float = 0.0
    latency_jitter: float = 0.0
    loss: float = 0.0
    lever_arm_b: Vector = ZERO
    mounting_bs: Vector = ZERO

    @property
    def rotation_bs(self) -> Array:
        """Rotation (3, 3) from sensor to body axes."""
        return matrix_from_euler(*self.mounting_bs)

    def sampling(self, duration: float, generator: Generator) -> Array:
        """Return the moments (s) at which the instrument looks."""
        count = int(np.floor((min(self.stop, duration) - self.offset) * self.rate + 1e-6)) + 1
        time = self.offset + np.arange(max(count, 0)) / self.rate
        return np.asarray(time + np.clip(self.jitter * generator.standard_normal(len(time)), -0.4 / self.rate, 0.4 / self.rate))

    @abstractmethod
    def ideal(self, trajectory: Trajectory, time: Array) -> T:
        """Return the table without errors of looks at `time` (s)."""

    @abstractmethod
    def noisy(self, table: T, generator: Generator) -> T:
        """Return the table with errors."""

    def record(self, ideal: T, generator: Generator) -> T:
        """Return the table with errors, as it arrives."""
        errors, delivery = generator.spawn(2)
        table = self.noisy(ideal, errors)
        if self.latency or self.latency_jitter:
            late = self.latency + np.abs(self.latency_jitter * delivery.standard_normal(len(table)))
            table = replace(table, received=table.time + late)
        return cast("T", table.select(delivery.random(len(table)) >= self.loss)) if self.loss else table


def means(trajectory: Trajectory, start: Array, end: Array, lever_arm_b: Vector = ZERO, nodes: int = 5) -> tuple[Array, Array]:
    """Return the means (n, 3) over (start, end] of angular rate against inertial space and of specific force, body axes.

    Gauss-Legendre quadrature with `nodes` points in each interval.
    """
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
    gyro_bias: Drift = Drift()
    accel_bias: Drift = Drift()

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

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Dvl:
        """Return true velocities in sensor axes."""
        return records.Dvl(time=time, velocity=trajectory.at(time).point(self.lever_arm_b).velocity_b @ self.rotation_bs)

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
        kept = None if self.output == "beams" else np.where(lost[:, None], np.nan, velocity + white)
        return records.Dvl(time=table.time, velocity=kept, valid=(~lost).astype(float), **columns)


def solve_beams(beams: Array, beam: Array, heard: Flags) -> tuple[Array, Flags]:
    """Return the least-squares velocity (rows, 3) of the beams that are `heard`, and whether at least three are."""
    weight = heard.astype(float)
    solved: Flags = np.sum(heard, axis=1) >= 3
    normal = np.einsum("kb,bi,bj->kij", weight, beams, beams)
    normal[~solved] = np.eye(3)
    return np.asarray(np.linalg.solve(normal, ((weight * beam) @ beams)[..., None])[..., 0]), solved


@dataclass(frozen=True, kw_only=True)
class Depth(Instrument[records.Depth]):
    """Depth of the sensor's own point below the sea surface (m)."""

    sigma: float = 0.0
    bias: Drift = Drift()

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Depth:
        """Return true depths."""
        return records.Depth(time=time, depth=trajectory.at(time).point(self.lever_arm_b).depth)

    def noisy(self, table: records.Depth, generator: Generator) -> records.Depth:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, depth=table.depth + error)


@dataclass(frozen=True, kw_only=True)
class Attitude(Instrument[records.Attitude]):
    """Roll, pitch and true heading (rad) of the sensor axes against north-east-down; errors add to the three angles."""

    sigma: Vector = ZERO
    bias: Drift = Drift()

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Attitude:
        """Return true angles of the sensor axes."""
        roll, pitch, heading = euler(trajectory.at(time).rotation_nb @ self.rotation_bs)
        return records.Attitude(time=time, roll=roll, pitch=pitch, heading=heading)

    def noisy(self, table: records.Attitude, generator: Generator) -> records.Attitude:
        """Add biases and white noise."""
        error = self.bias.draw(table.time, 3, generator) + np.asarray(self.sigma) * generator.standard_normal((len(table), 3))
        roll, pitch, heading = cast("Array", table.roll), cast("Array", table.pitch), cast("Array", table.heading)
        return replace(table, roll=wrapped(roll + error[:, 0]), pitch=pitch + error[:, 1], heading=(heading + error[:, 2]) % (2 * np.pi))


@dataclass(frozen=True, kw_only=True)
class Heading(Instrument[records.Heading]):
    """True heading of the body's forward axis (rad, in [0, 2 pi))."""

    sigma: float = 0.0
    bias: Drift = Drift()

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Heading:
        """Return true headings."""
        return records.Heading(time=time, heading=euler(trajectory.at(time).rotation_nb)[2])

    def noisy(self, table: records.Heading, generator: Generator) -> records.Heading:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, heading=(table.heading + error) % (2 * np.pi))


def displaced(latitude: Array, longitude: Array, height: Array, error_n: Array) -> tuple[Array, Array, Array]:
    """Return latitude, longitude and height of points moved by `error_n` (rows, 3) metres north-east-down; safe at the poles."""
    if not np.any(error_n):
        return latitude, longitude, height
    return geodetic_from_ecef(ecef_from_geodetic(latitude, longitude, height) + turned(rotation_en(latitude, longitude), error_n))


@dataclass(frozen=True, kw_only=True)
class Gnss(Instrument[records.Gnss]):
    """Position of the antenna, while it is not deeper than `max_depth` (m); velocity where `sigma_velocity` is not None."""

    sigma: Vector = ZERO  # north, east, down
    drift: Drift = Drift()
    sigma_velocity: float | None = None
    max_depth: float = np.inf

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Gnss:
        """Return true positions of the antenna."""
        seen = trajectory.at(time).point(self.lever_arm_b).depth <= self.max_depth
        state = trajectory.at(time[seen]).point(self.lever_arm_b)
        latitude, longitude, height = state.geodetic
        velocity = None if self.sigma_velocity is None else state.velocity_n
        return records.Gnss(time=state.time, latitude=latitude, longitude=longitude, height=height, velocity=velocity)

    def noisy(self, table: records.Gnss, generator: Generator) -> records.Gnss:
        """Add errors north, east and down."""
        shape = (len(table), 3)
        error = self.drift.draw(table.time, 3, generator) + np.asarray(self.sigma) * generator.standard_normal(shape)
        latitude, longitude, height = displaced(table.latitude, table.longitude, cast("Array", table.height), error)
        velocity = table.velocity
        if velocity is not None:
            velocity = velocity + (self.sigma_velocity or 0.0) * generator.standard_normal(shape)
        stated = np.tile(self.sigma, (len(table), 1)) if min(self.sigma) > 0 else None
        return replace(table, latitude=latitude, longitude=longitude, height=height, velocity=velocity, sigma_axes=stated)


@dataclass(frozen=True, kw_only=True)
class PositionFix(Instrument[records.PositionFix]):
    """Position of the transponder solved elsewhere: `output` is "geographic" or "local" (metres from the trajectory's start).

    White noise `sigma` (m) north and east, `sigma_depth` down.  A fraction of the fixes is wrong by 0.5 to 1.5 `outlier_size` (m) in any
    direction; the column `outlier` says which (for assessment: no estimator reads it).
    """

    output: str = "geographic"
    depth: bool = True
    sigma: float = 0.0
    sigma_depth: float = 0.0
    outlier_fraction: float = 0.0
    outlier_size: float = 0.0

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
class AcousticRange(Instrument[records.AcousticRange]):
    """Ranges between the vehicle's transducer and fixed beacons, each in its turn; straight rays, one speed of sound c.

    one_way   the beacon transmits at t0, the vehicle receives at t3:        |r(t3) - b| = c (t3 - t0)
    two_way   the vehicle transmits at t0, the beacon receives at t1 and replies a turnaround later, the vehicle, having moved,
              receives at t3:   |r(t0) - b| = c (t1 - t0),   |r(t3) - b| = c (t3 - t1 - turnaround)
    r is the transducer (body origin + lever arm at the pose of that moment), distances are taken in ECEF.  `time` = t3 and
    `transmit` = t0 (pings at offset + k / rate).  travel_time = t3 - t0 CONTAINS THE TURNAROUND, which has its own column.
    `output` "range" gives instead c (t3 - t0) one way and c (t3 - t0 - turnaround) / 2 two ways.
    `sigma` (s) is noise of the measured travel time and so of t3; a fraction of the arrivals comes late by an exponential delay.
    """

    beacons: Mapping[str, Beacon] = field(default_factory=dict)
    path: str = "two_way"
    sound_speed: float = 1500.0
    sigma: float = 0.0
    outlier_fraction: float = 0.0
    outlier_delay: float = 0.02
    output: str = "travel_time"

    def ideal(self, trajectory: Trajectory, time: Array) -> records.AcousticRange:
        """Return true travel times, solved to 1e-12 s."""
        if self.path not in ("one_way", "two_way") or not self.beacons or self.output not in ("travel_time", "range"):
            found = f"path '{self.path}', output '{self.output}', {len(self.beacons)} beacons"
            raise InputError("AcousticRange", found, "one_way or two_way, travel_time or range, at least one beacon")
        names, turn = sorted(self.beacons), np.arange(len(time)) % len(self.beacons)
        beacon_e = np.stack([beacon_position_e(self.beacons[name], trajectory.place) for name in names])[turn]
        turnaround, sent = np.array([self.beacons[name].turnaround for name in names])[turn], time
        if self.path == "two_way":
            sent = time + self.delay(trajectory, time, beacon_e) + turnaround
        arrival = sent + self.delay(trajectory, sent, beacon_e)
        for _ in range(20):
            previous, arrival = arrival, sent + self.delay(trajectory, arrival, beacon_e)
            if np.all(np.abs(arrival - previous) < 1e-12):
                break
        columns: dict[str, Any] = {"turnaround": turnaround} if self.path == "two_way" else {}
        return records.AcousticRange(
            time=arrival, transmit=time, travel_time=arrival - time, transmitter=np.asarray(names)[turn],
            path=np.full(len(time), self.path), **columns,
        )  # fmt: skip

    def delay(self, trajectory: Trajectory, time: Array, beacon_e: Array) -> Array:
        """Return the time (s) that sound needs between the transducer at `time` and the beacon."""
        gap = trajectory.at(time).point(self.lever_arm_b).position_e - beacon_e
        return np.asarray(np.sqrt(np.sum(gap * gap, axis=-1)) / self.sound_speed)

    def noisy(self, table: records.AcousticRange, generator: Generator) -> records.AcousticRange:
        """Add noise and late arrivals; turn times into ranges where asked."""
        late = (generator.random(len(table)) < self.outlier_fraction) * generator.exponential(self.outlier_delay, len(table))
        error = self.sigma * generator.standard_normal(len(table)) + late
        travel = cast("Array", table.travel_time) + error
        columns: dict[str, Any] = {"travel_time": travel}
        if self.output == "range":
            distance = travel if table.turnaround is None else 0.5 * (travel - table.turnaround)
            columns = {"travel_time": None, "range": self.sound_speed * distance}
        return replace(table, time=table.time + error, **columns)


def beacon_position_e(beacon: Beacon, place: Place) -> Array:
    """Return the Earth-fixed position (3,) of a beacon; north and east count from `place`, depth from its sea surface."""
    if beacon.latitude is not None and beacon.longitude is not None:
        latitude, longitude = np.asarray(beacon.latitude), np.asarray(beacon.longitude)
    elif beacon.north is not None and beacon.east is not None:
        latitude, longitude = from_north_east(beacon.north, beacon.east, place.latitude, place.longitude)
    else:
        raise InputError("beacon", "has no position", "give latitude and longitude, or north and east")
    return ecef_from_geodetic(latitude, longitude, place.surface_height - beacon.depth)
