"""The start of a run: what the log's [initial] says, filled up from the first usable rows of the sensors.

Position comes from [initial], else the first satellite or position fix; heading from the first attitude or heading, and without any it is
left to alignment; roll and pitch from the first attitude, else by levelling; depth from the first depth; velocity from [initial], else
the first ping of a Doppler log or rest, within 2 m/s.  Mountings, declination and lever arms are those of the sensor models.  A row that
serves here and later as a measurement counts once and a quarter: its sigma is doubled here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude, geodesy
from leadline.core.water import ATMOSPHERE, depth_of_pressure, surface_gravity
from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.outcome import Outcome
from leadline.data.records import Imu
from leadline.models.imu import rates_of
from leadline.models.sensors.attitude import measured_quaternion
from leadline.models.sensors.heading import true_heading

if TYPE_CHECKING:
    from leadline.data.log import Log
    from leadline.data.records import Array
    from leadline.data.vehicle import SensorConfig, Vehicle
    from leadline.models.sensor import Context, Sensor

SIGMA_POSITION, SIGMA_DEPTH, SIGMA_VELOCITY = 10.0, 1.0, 2.0
SOON = 2.0  # s
WEIGHT, PRESSURE_TO_DEPTH = 1e4, 0.5  # Pa per metre of water; m that a depth by pressure may be off at the start
SIGMA_TILT, SIGMA_LEVELLED, SIGMA_UNKNOWN_TILT, SIGMA_HEADING = 0.02, 0.05, 0.2, 0.05


@dataclass(frozen=True)
class Start:
    """Pose and velocity of the body origin at a time, north-east-down, with sigmas: SI and radians.

    An infinite sigma of heading: it is not known, and has to be found (estimate/alignment.py).
    """

    time: float
    latitude: float
    longitude: float
    height: float
    velocity_n: Array
    quaternion_nb: Array
    sigma_position: float
    sigma_depth: float
    sigma_velocity: float
    sigma_tilt: float
    sigma_heading: float
    velocity_known: bool = True  # or but a place to linearise at, that turns with the heading
    aligning: bool = False  # whether the run began without a heading


@dataclass(frozen=True)
class Source:
    """Where a start is looked for."""

    log: Log
    vehicle: Vehicle
    context: Context
    sensors: tuple[Sensor, ...]

    @property
    def where(self) -> str:
        """The place to name in a message."""
        return f"{self.log.path or self.log.name}: [initial]"

    def first(self, kind: str, value: str, time: float) -> tuple[SensorConfig, Any] | None:
        """The first usable row of a kind, with a value, at or after a time: configuration, and a table of one row."""
        for sensor in self.sensors:
            table = self.log.tables.get(sensor.config.name)
            column = getattr(table, value, None)
            if table is None or sensor.config.kind != kind or column is None:
                continue
            known = np.isfinite(column).reshape(len(table), -1).all(axis=1)
            index = np.flatnonzero(known & (sensor.read(table).outcome == Outcome.USED) & (table.time >= time))
            if len(index):
                return sensor.config, table.select(index[np.argmin(table.time[index])][None])
        return None


def start_of(log: Log, vehicle: Vehicle, context: Context, sensors: tuple[Sensor, ...]) -> Start:
    """Return the start of a log; raises InputError where time or position cannot be had."""
    source, initial = Source(log, vehicle, context, sensors), log.initial
    time = _time(source)
    roll, pitch, sigma_tilt = _tilt(source, time)
    heading, sigma_heading = _heading(source, time)
    quaternion = attitude.quaternion_from_euler(roll, pitch, heading)
    depth, sigma_depth = _depth(source, time, quaternion)
    latitude, longitude, sigma_position = _position(source, time, quaternion)
    velocity = _velocity(source, time, quaternion)
    velocity_known = any(v is not None for v in (initial.velocity_north, initial.velocity_east, initial.velocity_down))
    return Start(
        time,
        latitude,
        longitude,
        context.surface - depth,
        velocity,
        quaternion,
        _given(initial.sigma_position, sigma_position),
        _given(initial.sigma_depth, sigma_depth),
        _given(initial.sigma_velocity, 0.1 if velocity_known else SIGMA_VELOCITY),
        _given(initial.sigma_tilt, sigma_tilt),
        sigma_heading if np.isinf(sigma_heading) else _given(initial.sigma_heading, sigma_heading),
        velocity_known,
    )


def origin_of(log: Log, start: Start) -> Origin:
    """Return the log's origin, or the start where it has none."""
    return log.origin or Origin(start.latitude, start.longitude)


def _given(stated: float | None, found: float) -> float:
    return found if stated is None else stated


def _imu(source: Source) -> Imu | None:
    table = source.log.tables.get(source.vehicle.process.imu)
    return table if isinstance(table, Imu) and len(table) else None


def _time(source: Source) -> float:
    if source.log.initial.time is not None:
        return source.log.initial.time
    imu = _imu(source)
    if imu is not None:
        return float(np.nanmin(imu.time))
    tables = [source.log.tables[s.config.name] for s in source.sensors if s.config.name in source.log.tables]
    first = [float(np.min(t.time, initial=np.inf, where=np.isfinite(t.time))) for t in tables]
    if not np.isfinite(min(first, default=np.inf)):
        raise InputError(source.where, "says no time, and there is no row to start from", "add time_s, or a table")
    return min(first)


def _tilt(source: Source, time: float) -> tuple[float, float, float]:
    """Roll, pitch and their sigma: as given, from an AHRS, else from the direction of the mean specific force over the first second."""
    initial = source.log.initial
    if initial.roll is not None and initial.pitch is not None:
        return initial.roll, initial.pitch, SIGMA_TILT
    if found := source.first("attitude", "quaternion", time) or source.first("attitude", "roll", time):
        roll, pitch, _ = attitude.euler_from_quaternion(measured_quaternion(*found, source.context)[0])
        return float(roll), float(pitch), 2.0 * found[0].value("sigma_tilt")
    imu = _imu(source)
    if imu is None:
        return 0.0, 0.0, SIGMA_UNKNOWN_TILT
    forces = rates_of(imu)[1]
    first = np.flatnonzero((imu.time >= time) & (imu.time <= time + 1.0) & np.isfinite(forces).all(axis=1))
    if not len(first):
        return 0.0, 0.0, SIGMA_UNKNOWN_TILT
    ordered = forces[first[np.argsort(imu.time[first], kind="stable")]]  # the order of rows carries no meaning
    force = source.vehicle[source.vehicle.process.imu].rotation_bs @ ordered.mean(axis=0)
    return float(np.arctan2(-force[1], -force[2])), float(np.arctan2(force[0], np.hypot(force[1], force[2]))), SIGMA_LEVELLED


def _heading(source: Source, time: float) -> tuple[float, float]:
    if source.log.initial.heading is not None:
        return source.log.initial.heading, SIGMA_HEADING
    if found := source.first("attitude", "quaternion", time) or source.first("attitude", "heading", time):
        return float(attitude.euler_from_quaternion(measured_quaternion(*found, source.context)[0])[2]), 2.0 * found[0].value("sigma")
    if found := source.first("heading", "heading", time):
        return float(true_heading(*found, source.context)[0]), 2.0 * found[0].value("sigma")
    return 0.0, np.inf


def _depth(source: Source, time: float, quaternion: Array) -> tuple[float, float]:
    initial = source.log.initial
    if initial.depth is not None:
        return initial.depth, _given(initial.sigma_position, SIGMA_DEPTH)
    if found := source.first("depth", "depth", time):
        config, row = found
        lever = attitude.matrix_from_quaternion(quaternion) @ config.lever_arm_b
        return float(row.depth[0] - lever[2]), max(2.0 * config.value("sigma"), 0.1)
    if found := source.first("pressure", "pressure", time):
        config, row = found
        lever = attitude.matrix_from_quaternion(quaternion) @ config.lever_arm_b
        sigma = 2.0 * config.value("sigma") / WEIGHT + PRESSURE_TO_DEPTH
        return float(_depth_of_pressure(config, row) - lever[2]), sigma
    return 0.0, SIGMA_DEPTH


def _depth_of_pressure(config: SensorConfig, row: Any) -> float:
    """Depth of a row of absolute pressure, with gravity of middle latitudes: good to half a percent, which its sigma contains."""
    air = config.value("atmosphere", ATMOSPHERE)
    if row.atmosphere is not None and np.isfinite(row.atmosphere[0]):
        air = float(row.atmosphere[0])
    gauge, density = float(row.pressure[0]) - air, config.value("density", 0.0)
    return gauge / (density * surface_gravity(0.5)) if density > 0.0 else float(depth_of_pressure(gauge, surface_gravity(0.5)))


def _velocity(source: Source, time: float, quaternion: Array) -> Array:
    """As given, else by the first ping of a Doppler log within `SOON` (its levers apart), else rest.

    A ping only says where to linearise: the sigma stays that of not knowing, and the ping is used as a measurement in its turn.
    """
    initial = source.log.initial
    if initial.velocity_north is not None or initial.velocity_east is not None or initial.velocity_down is not None:
        return np.array([initial.velocity_north or 0.0, initial.velocity_east or 0.0, initial.velocity_down or 0.0])
    found = source.first("dvl", "velocity", time)
    if found is None or found[1].time[0] > time + SOON:
        return np.zeros(3)
    config, row = found
    frame = str(row.frame[0]) if row.frame is not None and row.frame[0] else config.value("frame", "sensor")
    _, _, heading = attitude.euler_from_quaternion(quaternion)
    turn = {
        "sensor": attitude.matrix_from_quaternion(quaternion) @ config.rotation_bs,
        "body": attitude.matrix_from_quaternion(quaternion),
        "level": attitude.matrix_from_euler(0.0, 0.0, heading),
    }
    return np.asarray(turn.get(frame, np.eye(3)) @ row.velocity[0])


def _position(source: Source, time: float, quaternion: Array) -> tuple[float, float, float]:
    initial, context = source.log.initial, source.context
    if initial.latitude is not None and initial.longitude is not None:
        return initial.latitude, initial.longitude, SIGMA_POSITION
    if initial.north is not None and initial.east is not None:
        latitude, longitude = context.geographic(np.array(initial.north), np.array(initial.east), source.where)
        return float(latitude), float(longitude), SIGMA_POSITION
    for kind, value in (("gnss", "latitude"), ("position_fix", "latitude"), ("position_fix", "north")):
        if found := source.first(kind, value, time):
            return _from_fix(source, found, value, time, quaternion)
    right = "add latitude_deg and longitude_deg"
    raise InputError(source.where, "says no position, and no gnss or position_fix that the vehicle file names has one", right)


def _from_fix(source: Source, found: tuple[SensorConfig, Any], value: str, time: float, quaternion: Array) -> tuple[float, float, float]:
    """The body origin by a fix; a fix that comes later is less certain by what the vehicle may have moved."""
    config, row = found
    place = (row.latitude, row.longitude) if value == "latitude" else source.context.geographic(row.north, row.east, source.where)
    turn = geodesy.rotation_en(place[0][0], place[1][0]) @ attitude.matrix_from_quaternion(quaternion)
    origin = geodesy.ecef_from_geodetic(place[0][0], place[1][0], source.context.surface) - turn @ config.lever_arm_b
    latitude, longitude, _ = geodesy.geodetic_from_ecef(origin)
    stated = [config.value("sigma"), *np.atleast_1d(np.nan_to_num(row.sigma if row.sigma is not None else 0.0)).tolist()]
    axes = row.sigma_axes[0, :2].tolist() if row.sigma_axes is not None else []
    sigma = max(1.0, 2.0 * max(np.nan_to_num([*stated, *axes])))
    return float(latitude), float(longitude), float(sigma + SIGMA_VELOCITY * (row.time[0] - time))
