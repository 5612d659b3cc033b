"""Where echoes came from: soundings of a swath, and positions by direction and distance, laid out from the pose that is known.

Sensors are taken to lie at the origin of their carrier, along its axes, unless a vehicle file says where they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias, cast

import numpy as np

from leadline.core import attitude
from leadline.data.records import Sounding, SoundSpeed, Swath, Usbl
from leadline.data.rows import complete
from leadline.report.tracks import Track, beacon_places, column_of, extra_of, fixes_of, platform_tracks

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import numpy.typing as npt

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.data.vehicle import Vehicle
    from leadline.report.tracks import Fixes, Frame

    Places: TypeAlias = tuple[Mapping[str, Track], Mapping[str, tuple[float, float, float]]]

MOST_SOUNDINGS = 20_000  # of all tables together
USUAL_SOUND_SPEED = 1500.0  # m/s, where the log tells none


def soundings(log: Log, reference: Track | None, vehicle: Vehicle | None = None) -> Array:
    """Return north, east and depth (n, 3) in m of every k-th sounding of the log, without those that are marked as outliers.

    p + R_nb (l_b + R_bs s): p and R_nb the pose of the reference at the moment of the row; s the sounding in the axes of the sensor,
    range (sin along, cos along sin across, cos along cos across) of a swath.
    """
    tables = [(name, table) for name, table in log.tables.items() if isinstance(table, Swath | Sounding) and len(table)]
    if reference is None or reference.quaternion_nb is None or not tables:
        return np.empty((0, 3))
    clouds = []
    for name, table in tables:
        kept = np.flatnonzero((extra_of(table, "outlier") == 0.0) & (column_of(table, "valid") != 0.0))
        rows = table.select(kept[_scattered(len(kept), MOST_SOUNDINGS // len(tables))])
        clouds.append(_laid_out(reference, rows.time, _echo(rows, log), name, vehicle))
    cloud = np.concatenate(clouds)
    return cloud[complete(cloud)]


def _scattered(count: int, most: int) -> npt.NDArray[np.int64]:
    """Return about every k-th index, off by up to half a step, so that a fan of as many beams as the step leaves no stripes."""
    if count <= most:
        return np.arange(count)
    index = np.linspace(0.0, count - 1.0, most)
    off = np.random.default_rng(0).uniform(-0.5, 0.5, most) * count / most
    return np.unique(np.clip(np.round(index + off), 0, count - 1).astype(np.int64))


def _echo(rows: Table, log: Log) -> Array:
    """Return soundings (n, 3) in the axes of their sensor."""
    if isinstance(rows, Sounding):
        return rows.position
    assert isinstance(rows, Swath)
    along, across = np.nan_to_num(column_of(rows, "angle_along")), rows.angle_across
    way = np.stack([np.sin(along), np.cos(along) * np.sin(across), np.cos(along) * np.cos(across)], axis=1)
    speed = column_of(rows, "sound_speed")
    speed = np.where(np.isfinite(speed), speed, sound_speed_of(log))
    distance = 0.5 * speed * column_of(rows, "travel_time") if rows.range is None else rows.range
    return np.asarray(distance[:, None] * way)


def sound_speed_of(log: Log) -> float:
    """Return the median speed of sound (m/s) that the log tells, or a usual one."""
    told = [table.sound_speed for table in log.tables.values() if isinstance(table, SoundSpeed)]
    finite = np.concatenate(told)[np.isfinite(np.concatenate(told))] if told else np.empty(0)
    return float(np.median(finite)) if len(finite) else USUAL_SOUND_SPEED


def _laid_out(carrier: Track, time: Array, seen_s: Array, name: str, vehicle: Vehicle | None) -> Array:
    """Return places (n, 3) of what a sensor of a carrier sees, in its own axes (n, 3)."""
    return np.asarray(carrier.at(time) + _turned(carrier.rotation_at(time), aboard(seen_s, name, vehicle)))


def aboard(seen_s: Array, name: str, vehicle: Vehicle | None) -> Array:
    """Return vectors (n, 3) from the body origin, in its axes, of those in a sensor's: l_b + R_bs s, as the vehicle file says."""
    sensor = None if vehicle is None else vehicle.sensors.get(name)
    return seen_s if sensor is None else np.asarray(sensor.lever_arm_b + seen_s @ sensor.rotation_bs.T)


def usbl_fixes(log: Log, frame: Frame, reference: Track | None, vehicle: Vehicle | None = None) -> Iterator[Fixes]:
    """Yield where the vehicle was by each table of directions and distances.

    A head on the vehicle hears a beacon or a platform: its place less what the head sees.  One on a platform (`receiver`) hears the
    vehicle: the platform's place plus what the head sees.  Rows of which neither is known are left out.
    """
    platforms = {track.name: track for track in platform_tracks(log, frame)}
    beacons = beacon_places(log, frame)
    for name, table in log.tables.items():
        if isinstance(table, Usbl):
            places = np.full((len(table), 3), np.nan)
            for ends, rows in _pairs(table):
                places[rows] = _place(cast("Usbl", table.select(rows)), name, ends, reference, (platforms, beacons), log, vehicle)
            if complete(places).any():
                yield fixes_of(table, Track(name, table.time, places[:, 0], places[:, 1], places[:, 2], measured=True), reference)


def _pairs(table: Usbl) -> Iterator[tuple[tuple[str, str], npt.NDArray[np.int64]]]:
    """Yield transmitter and receiver of a table, and the rows of each pair."""
    receiver = np.full(len(table), "") if table.receiver is None else table.receiver
    for ends in sorted(set(zip(table.transmitter.tolist(), receiver.tolist(), strict=True))):
        yield ends, np.flatnonzero((table.transmitter == ends[0]) & (receiver == ends[1]))


def _place(
    rows: Usbl, name: str, ends: tuple[str, str], reference: Track | None, known: Places, log: Log, vehicle: Vehicle | None
) -> Array:
    """Return where the vehicle was (n, 3) by the rows of one transmitter and one receiver; nan where that cannot be told."""
    (platforms, beacons), (transmitter, receiver) = known, ends
    ship = platforms.get(receiver)
    carrier = reference if ship is None else ship
    if carrier is None or carrier.quaternion_nb is None:
        return np.full((len(rows), 3), np.nan)
    level = np.full(len(rows), "sensor") if rows.frame is None else rows.frame
    seen_s = _seen(rows, log)
    seen_b = seen_s if ship is not None else np.where((level == "level")[:, None], seen_s, aboard(seen_s, name, vehicle))
    rotation = carrier.rotation_at(rows.time)
    heading = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    flat = attitude.matrix_from_euler(np.zeros(len(rows)), np.zeros(len(rows)), heading)
    seen_n = _turned(np.where((level == "level")[:, None, None], flat, rotation), seen_b)
    if ship is not None:
        return np.asarray(ship.at(rows.time) + seen_n)
    there = platforms[transmitter].at(rows.time) if transmitter in platforms else np.asarray(beacons.get(transmitter, np.nan), float)
    return np.asarray(there - seen_n)


def _seen(rows: Usbl, log: Log) -> Array:
    """Return where a head hears its transmitter (n, 3), in its own axes, m."""
    azimuth, elevation = (column_of(rows, part) for part in ("azimuth", "elevation"))
    distance = column_of(rows, "range")
    if rows.range is None:
        two_way = rows.path == "two_way" if rows.path is not None else np.zeros(len(rows), bool)
        turnaround = np.where(two_way, np.nan_to_num(column_of(rows, "turnaround")), 0.0)
        distance = sound_speed_of(log) * (column_of(rows, "travel_time") - turnaround) / np.where(two_way, 2.0, 1.0)
    level = np.cos(elevation)
    way = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1)
    return np.asarray(distance[:, None] * way)


def _turned(rotation: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("kij,kj->ki", rotation, vector))
