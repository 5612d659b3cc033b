"""From a log and a vehicle to a navigator at the start: process model, sensors, estimator and initial state put together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude, geodesy
from leadline.data.errors import InputError, suggestion
from leadline.data.records import Imu
from leadline.estimate import kalman
from leadline.estimate.alignment import aligned
from leadline.estimate.clocks import Clock
from leadline.estimate.composition import Composition, room_for_clones
from leadline.estimate.inputs import Inputs
from leadline.estimate.navigator import Navigator
from leadline.estimate.output import Reference
from leadline.estimate.start import Start, origin_of, start_of
from leadline.models.imu import rates_of
from leadline.models.inertial_units import inertial_units, initial_units
from leadline.models.layout import MOST_CLONES
from leadline.models.sensor import Context
from leadline.models.sensors import compose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.sensor import Sensor

ESTIMATORS: Mapping[str, Any] = {"ekf": kalman}


def navigator_for(log: Log, vehicle: Vehicle, *, estimator: str = "ekf", window: float = 30.0) -> tuple[Navigator, Start, Context]:
    """Return a navigator at the start of a log, that start, and the context of the sensors.

    Where neither the log's [initial] nor a sensor has a heading, the first minutes of the log must determine it.  Raises InputError for
    what cannot be run.
    """
    if estimator not in ESTIMATORS:
        raise InputError("estimator", f"'{estimator}' is not known", suggestion(estimator, ESTIMATORS))
    if vehicle.process.model != "inertial":
        raise InputError("process.model", f"'{vehicle.process.model}' is not known", "known: inertial")
    context = Context.of(log, vehicle)
    imu = vehicle[vehicle.process.imu]
    sensors = tuple(s for config in vehicle.sensors.values() if (s := compose(config, context)) is not None)
    process = inertial_units(imu, standby_of(vehicle), context.surface)
    clones = vehicle.process.clones
    if clones is None:
        clones = min(MOST_CLONES, room_for_clones(process, sensors), _clones_needed(sensors, log))
    composition = Composition(process, sensors, ESTIMATORS[estimator], clones)
    unmodelled = frozenset(vehicle.sensors) - {s.config.name for s in sensors} - {vehicle.process.imu, vehicle.process.standby}

    def begin(start: Start) -> Navigator:
        state = composition.layout.start(start.time, *_initial(start, vehicle, log))
        reference = Reference(log.epoch, origin_of(log, start), context)
        clocks = {name: Clock(config.mend_clock) for name, config in vehicle.sensors.items()}
        return Navigator(composition, state, Inputs.of(imu, standby_of(vehicle)), window, reference, unmodelled, clocks)

    start = start_of(log, vehicle, context, sensors)
    if np.isinf(start.sigma_heading):
        start = replace(aligned(log, vehicle, start, begin), aligning=True)
    return begin(start), start, context


def _clones_needed(sensors: tuple[Sensor, ...], log: Log) -> int:
    """How many poses at earlier epochs the rows of all sensors need at once; one where no row has come yet."""
    twice = [sensor for sensor in sensors if any(channel.epochs == 2 for channel in sensor.channels)]
    if not twice:
        return 0
    tables = [(sensor, log.tables[sensor.config.name]) for sensor in twice if sensor.config.name in log.tables]
    rows = [(r.earlier, table.time[r.row], s.flight) for s, table in tables for r in s.read(table).rows if r.earlier is not None]
    awaited = [(earlier[time - earlier <= flight], time[time - earlier <= flight]) for earlier, time, flight in rows]
    if not sum(len(time) for _, time in awaited):
        return 1
    earlier, time = (np.concatenate(part) for part in zip(*awaited, strict=True))
    first, which = np.unique(earlier, return_inverse=True)
    last = np.full(len(first), -np.inf)
    np.maximum.at(last, which, time)
    begun, ended = np.arange(1, len(first) + 1), np.searchsorted(np.sort(last), first, side="right")
    return int(max(1, (begun - ended).max()))


def _initial(start: Start, vehicle: Vehicle, log: Log) -> tuple[Array, Array]:
    """Nominal motion and its covariance at the IMU, from the start of the body origin."""
    imu = vehicle[vehicle.process.imu]
    rotation = attitude.matrix_from_quaternion(start.quaternion_nb)
    lever = rotation @ imu.lever_arm_b
    turning = rotation @ np.cross(_first_rate(log, vehicle, start), imu.lever_arm_b)
    place = geodesy.ecef_from_geodetic(start.latitude, start.longitude, start.height)
    point = place + geodesy.rotation_en(start.latitude, start.longitude) @ lever
    latitude, longitude, height = geodesy.geodetic_from_ecef(point)
    q_en = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, longitude))
    values, bias = initial_units(imu, standby_of(vehicle))
    x = np.concatenate([q_en, [float(height)], start.velocity_n + turning, start.quaternion_nb, values])
    tilt = [start.sigma_tilt, start.sigma_tilt, start.sigma_heading]
    sigma = np.array([start.sigma_position, start.sigma_position, start.sigma_depth, *[start.sigma_velocity] * 3, *tilt, *bias])
    shift = np.eye(len(sigma))
    shift[0:3, 6:9], shift[3:6, 6:9] = -_skew(lever), -_skew(turning)
    return x, shift @ np.diag(sigma**2) @ shift.T


def standby_of(vehicle: Vehicle) -> SensorConfig | None:
    """Return the inertial unit that stands in for the first, where there is one."""
    return None if vehicle.process.standby is None else vehicle[vehicle.process.standby]


def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _first_rate(log: Log, vehicle: Vehicle, start: Start) -> Array:
    """Angular rate of the body against the Earth at the start (3,): a line through the gyro's rows of a fifth of a second."""
    imu, config = log.tables.get(vehicle.process.imu), vehicle[vehicle.process.imu]
    if not isinstance(imu, Imu):
        return np.zeros(3)
    rates, _, _ = rates_of(imu)
    near = np.flatnonzero(np.isfinite(rates).all(axis=1) & (np.abs(imu.time - start.time) < 0.1))
    near = near[np.argsort(imu.time[near], kind="stable")]  # the order of rows carries no meaning, down to the rounding of a sum
    if not len(near):
        return np.zeros(3)
    time = imu.time[near] - start.time
    line = np.polynomial.polynomial.polyfit(time, rates[near], min(1, len(np.unique(time)) - 1))
    earth = np.array([np.cos(start.latitude), 0.0, -np.sin(start.latitude)]) * geodesy.EARTH_RATE
    return np.asarray(config.rotation_bs @ line[0] - attitude.matrix_from_quaternion(start.quaternion_nb).T @ earth)
