"""From a log and a vehicle to a navigator at the start: process model, sensors, estimator and initial state put together."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import attitude, geodesy
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.records import Imu
from leadline.estimate.alignment import aligned
from leadline.estimate.beginning import Beginning
from leadline.estimate.clocks import Clock
from leadline.estimate.composition import Composition, room_for_clones
from leadline.estimate.estimators import estimator_of
from leadline.estimate.inputs import Inputs
from leadline.estimate.navigator import Navigator
from leadline.estimate.output import Reference
from leadline.estimate.start import Start, origin_of, start_of
from leadline.models.imu import rates_of
from leadline.models.layout import MOST_CLONES
from leadline.models.process import Pose
from leadline.models.processes import compose_process
from leadline.models.sensor import Context, Reading, Sensor, reading, usable
from leadline.models.sensors import compose
from leadline.models.view import TILTING, TURNING

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.process import Feed, Process


def navigator_for(
    log: Log, vehicle: Vehicle, *, estimator: str = "ekf", process: str | None = None, window: float = 30.0
) -> tuple[Navigator, Start, Context]:
    """Return a navigator at the start of a log, that start, and the context of the sensors.

    estimator: a name with settings, as "ukf:alpha=0.5" (estimate/estimators.py).  process: a process model in place of the vehicle's.
    Where neither the log's [initial] nor a sensor has a heading, the first minutes of the log must determine it.  Raises InputError for
    what cannot be run.
    """
    chosen = estimator_of(estimator)
    if process is not None:
        vehicle = vehicle.moved_by(process)
    moved = compose_process(vehicle, Context.of(log, vehicle))
    context = Context.of(log, vehicle, moved.reference_b)
    sensors = sensors_of(vehicle, moved, context)
    clones = vehicle.process.clones
    if clones is None:
        clones = min(MOST_CLONES, room_for_clones(moved, sensors), _clones_needed(sensors, log))
    composition = Composition(moved, sensors, chosen, clones if chosen.clones else 0)
    driving = driving_of(vehicle, moved)
    unmodelled = frozenset(vehicle.sensors) - {s.config.name for s in sensors} - frozenset(driving)

    def begin(start: Start) -> Navigator:
        beginning = Beginning(moved, _pose(start, vehicle, log, moved))
        state = composition.layout.start(start.time, *(beginning.by_points() if chosen.pointed else beginning.mean()))
        if chosen.prepare is not None:
            chosen.prepare(composition, state, beginning)
        reference = Reference(log.epoch, origin_of(log, start), context)
        clocks = {name: Clock(config.mend_clock) for name, config in vehicle.sensors.items()}
        inputs = Inputs.of(vehicle[vehicle.process.imu], standby_of(vehicle)) if driving else None
        return Navigator(composition, state, inputs, window, reference, unmodelled, clocks)

    start = start_of(log, vehicle, context, sensors)
    if np.isinf(start.sigma_heading):
        if not chosen.smooths:
            right = "add heading_deg or a compass, or take another estimator (ekf, ukf)"
            raise InputError(f"{log.path or log.name}: [initial]", f"says no heading, and '{estimator}' cannot find one", right)
        start = replace(aligned(log, vehicle, start, begin), aligning=True)
    return begin(start), start, context


def driving_of(vehicle: Vehicle, process: Process) -> tuple[str, ...]:
    """Return the inertial units that drive a process model."""
    if process.consumes != "imu":
        return ()
    return (vehicle.process.imu, *([] if vehicle.process.standby is None else [vehicle.process.standby]))


def sensors_of(vehicle: Vehicle, process: Process, context: Context) -> tuple[Sensor, ...]:
    """Return the sensors of a vehicle as a process model uses them: as corrections, as inputs, or as both."""
    feeds = {feed.sensor: feed for feed in process.feeds}
    found = []
    for name, config in vehicle.sensors.items():
        feed = feeds.get(name)
        if feed is not None and not feed.also_corrects:
            found.append(Sensor(config, (), partial(_fed, feed), feed=feed.rows))
            continue
        if config.kind == "imu" and config.model is None and TURNING not in process.defines:
            continue
        sensor = compose(config, context)
        if config.kind == "imu" and config.model is None and TILTING not in process.defines and sensor is not None:
            sensor = replace(sensor, channels=sensor.channels[:1], read=partial(_gyros, sensor.read))
        if sensor is not None:
            found.append(sensor if feed is None else replace(sensor, feed=feed.rows))
    return tuple(found)


def _gyros(read: Callable[[Table], Reading], table: Table) -> Reading:
    """What an inertial unit says of the turning alone: its first channel."""
    found = read(table)
    return reading(table, *(rows for rows in found.rows if rows.channel == 0))


def _fed(feed: Feed, table: Table) -> Reading:
    """What a table that is input alone gives: no channel a row, and the outcome of each of its rows."""
    known = np.isfinite(feed.rows(table)).any(axis=1) & usable(table)
    return Reading((), np.where(known, int(Outcome.USED), int(Outcome.INVALID)))


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


def _pose(start: Start, vehicle: Vehicle, log: Log, process: Process) -> Pose:
    """The start of the body origin, brought to the point that the process model moves."""
    rotation = attitude.matrix_from_quaternion(start.quaternion_nb)
    lever = rotation @ process.reference_b
    rate = _first_rate(log, vehicle, start)
    turning = rotation @ np.cross(rate, process.reference_b)
    place = geodesy.ecef_from_geodetic(start.latitude, start.longitude, start.height)
    point = place + geodesy.rotation_en(start.latitude, start.longitude) @ lever
    latitude, longitude, height = geodesy.geodetic_from_ecef(point)
    q_en = attitude.quaternion_from_matrix(geodesy.rotation_en(latitude, longitude))
    tilt = [start.sigma_tilt, start.sigma_tilt, start.sigma_heading]
    sigma = np.array([start.sigma_position, start.sigma_position, start.sigma_depth, *[start.sigma_velocity] * 3, *tilt])
    shift = np.eye(9)
    shift[0:3, 6:9], shift[3:6, 6:9] = -_skew(lever), -_skew(turning)
    covariance = shift @ np.diag(sigma**2) @ shift.T
    return Pose(q_en, float(height), start.velocity_n + turning, start.quaternion_nb, rate, covariance, start.time)


def standby_of(vehicle: Vehicle) -> SensorConfig | None:
    """Return the inertial unit that stands in for the first, where there is one."""
    return None if vehicle.process.standby is None else vehicle[vehicle.process.standby]


def _skew(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _first_rate(log: Log, vehicle: Vehicle, start: Start) -> Array:
    """Angular rate of the body against the Earth at the start (3,): a line through the gyro's rows of a fifth of a second."""
    imu, config = log.tables.get(vehicle.process.imu), vehicle.sensors.get(vehicle.process.imu)
    if config is None or not isinstance(imu, Imu):
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
