"""The start of a run: what the log's [initial] says, filled up from the first rows of the sensors.

Position comes from [initial], else the first position fix or satellite fix; heading from the first attitude or heading; roll and
pitch from the first attitude, else by levelling; depth from the first depth; velocity from [initial], else rest within 2 m/s.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import attitude
from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.records import Attitude, Depth, Gnss, Heading, Imu, PositionFix
from leadline.models.sensor import usable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from leadline.data.log import Initial, Log
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import Vehicle
    from leadline.models.sensor import Context

SIGMA_POSITION, SIGMA_DEPTH, SIGMA_VELOCITY = 10.0, 1.0, 2.0
SIGMA_TILT, SIGMA_HEADING = 0.02, 0.05


@dataclass(frozen=True)
class Start:
    """Pose and velocity of the body origin at a time, north-east-down, with sigmas: SI and radians."""

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


def start_of(log: Log, vehicle: Vehicle, context: Context) -> Start:
    """Return the start of a log; raises InputError where position or heading cannot be had."""
    tables = {name: table for name, table in log.tables.items() if name in vehicle.sensors and len(table)}
    initial, where = log.initial, log.path or log.name
    time = _time(initial, tables, vehicle)
    latitude, longitude, sigma_position = _position(initial, tables, vehicle, context, str(where), time)
    roll, pitch, heading, sigma_heading = _attitude(initial, tables, vehicle, str(where), time)
    depth, sigma_depth = _depth(initial, tables, vehicle, time)
    velocity = np.array([initial.velocity_north or 0.0, initial.velocity_east or 0.0, initial.velocity_down or 0.0])
    default = SIGMA_VELOCITY if initial.velocity_north is None else 0.1
    return Start(
        time,
        latitude,
        longitude,
        context.surface - depth,
        velocity,
        attitude.quaternion_from_euler(roll, pitch, heading),
        sigma_position,
        sigma_depth,
        initial.sigma_velocity if initial.sigma_velocity is not None else default,
        initial.sigma_tilt if initial.sigma_tilt is not None else SIGMA_TILT,
        sigma_heading,
    )


def _first(tables: Mapping[str, Table], kind: type[Table], value: str, time: float) -> tuple[str, Any] | None:
    """The first valid row with a value at or after the start, of the first table of a kind: name and a table of one row."""
    for name, table in tables.items():
        column = getattr(table, value, None)
        if type(table) is not kind or column is None:
            continue
        index = np.flatnonzero(usable(table) & (table.time >= time) & np.isfinite(column))
        if len(index):
            return name, table.select(index[np.argmin(table.time[index])][None])
    return None


def _time(initial: Initial, tables: Mapping[str, Table], vehicle: Vehicle) -> float:
    if initial.time is not None:
        return initial.time
    imu = tables.get(vehicle.process.imu)
    times = imu.time if imu is not None else np.concatenate([table.time for table in tables.values()])
    return float(np.nanmin(times))


def _position(
    initial: Initial, tables: Mapping[str, Table], vehicle: Vehicle, context: Context, where: str, time: float
) -> tuple[float, float, float]:
    given = initial.sigma_position
    if initial.latitude is not None and initial.longitude is not None:
        return initial.latitude, initial.longitude, given if given is not None else SIGMA_POSITION
    if initial.north is not None and initial.east is not None:
        latitude, longitude = context.geographic(np.array(initial.north), np.array(initial.east), where)
        return float(latitude), float(longitude), given if given is not None else SIGMA_POSITION
    for kind, value in ((Gnss, "latitude"), (PositionFix, "latitude"), (PositionFix, "north")):
        if found := _first(tables, kind, value, time):
            name, row = found
            place = (row.latitude, row.longitude) if value == "latitude" else context.geographic(row.north, row.east, where)
            moved = SIGMA_VELOCITY * float(row.time[0] - time)
            return float(place[0][0]), float(place[1][0]), max(2.0 * vehicle[name].value("sigma"), 1.0) + moved
    raise InputError(f"{where}: [initial]", "says no position, and there is no gnss or position_fix", "add latitude_deg and longitude_deg")


def _attitude(
    initial: Initial, tables: Mapping[str, Table], vehicle: Vehicle, where: str, time: float
) -> tuple[float, float, float, float]:
    ahrs = _first(tables, Attitude, "heading", time)
    roll, pitch = _tilt(initial, ahrs[1] if ahrs else None, tables, vehicle, time)
    if initial.heading is not None:
        return roll, pitch, initial.heading, initial.sigma_heading if initial.sigma_heading is not None else SIGMA_HEADING
    if found := ahrs or _first(tables, Heading, "heading", time):
        from leadline.models.sensors.heading import declination

        name, row = found
        heading = float(row.heading[0]) + declination(vehicle[name])
        sigma = initial.sigma_heading if initial.sigma_heading is not None else 2.0 * vehicle[name].value("sigma")
        return roll, pitch, heading, max(sigma, SIGMA_HEADING)
    raise InputError(f"{where}: [initial]", "says no heading, and there is no heading or attitude sensor", "add heading_deg")


def _tilt(initial: Initial, ahrs: Any, tables: Mapping[str, Table], vehicle: Vehicle, time: float) -> tuple[float, float]:
    """Roll and pitch: as given, from an AHRS, else from the direction of the mean specific force over the first second."""
    if initial.roll is not None and initial.pitch is not None:
        return initial.roll, initial.pitch
    if ahrs is not None and ahrs.roll is not None and ahrs.pitch is not None:
        return float(ahrs.roll[0]), float(ahrs.pitch[0])
    imu = tables.get(vehicle.process.imu)
    if not isinstance(imu, Imu) or imu.accel is None:
        return 0.0, 0.0
    first = np.flatnonzero((imu.time >= time) & (imu.time <= time + 1.0))
    first = first[np.argsort(imu.time[first], kind="stable")]
    force = vehicle[vehicle.process.imu].rotation_bs @ np.nanmean(imu.accel[first], axis=0)
    return float(np.arctan2(-force[1], -force[2])), float(np.arctan2(force[0], np.hypot(force[1], force[2])))


def _depth(initial: Initial, tables: Mapping[str, Table], vehicle: Vehicle, time: float) -> tuple[float, float]:
    if initial.depth is not None:
        sigma = initial.sigma_depth if initial.sigma_depth is not None else initial.sigma_position
        return initial.depth, sigma if sigma is not None else SIGMA_DEPTH
    if found := _first(tables, Depth, "depth", time):
        name, row = found
        return float(row.depth[0]), max(2.0 * vehicle[name].value("sigma"), 0.1)
    return 0.0, SIGMA_DEPTH


def origin_of(log: Log, start: Start) -> Origin:
    """Return the log's origin, or the start where it has none."""
    return log.origin or Origin(start.latitude, start.longitude)
