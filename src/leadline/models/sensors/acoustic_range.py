"""Distance to a beacon by sound, one way or two ways.

    one way:  z = (1 + s) |p(t) + R l - beacon| + b
    two way:  z = (1 + s) (|p(t) + R l - beacon| + |p(t') + R' l - beacon|) / 2 + b        t' the moment of transmission

A two-way time looks at the vehicle twice: at t' the pose is cloned, at t both are seen.  Taken as one epoch it would be biased by
about half of speed times flight time.  Sound runs straight at a constant speed.  Distances are Earth-fixed, so exact at any range.
The position of the beacon is uncertain by the sigmas that it states; along the line of sight they add to the noise, as if they were
drawn anew for each row.
Row: distance (m), variance (m^2), beacon Earth-fixed 3, its variances north, east, down.  Parameters: lever_arm_b 3.
Nuisances: bias (m), scale.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import earth_fixed
from leadline.core.rotation import cross, load3, load_matrix, turn, turn_back
from leadline.data.outcome import Outcome
from leadline.models.sensor import Channel, Context, Reading, Sensor, filled, finite_rows, nuisances, reading, sigmas, usable
from leadline.models.view import ATTITUDE_T, PLACE_V, POSITION_T, QUATERNION_V, TANGENT, VIEW_SIZE, wander

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.log import Beacon
    from leadline.data.records import AcousticRange, Array
    from leadline.data.vehicle import SensorConfig

BEACON_R, BEACON_VARIANCE_R, ROW = 2, 5, 8
KNOWN_PATHS = ("one_way", "two_way")
ONE_WAY, TWO_WAY = 0, 1


@kernel()
def leg(view, row, params, factor, Hv, column):
    """Distance from the transducer to the beacon; its Jacobian, times `factor`, goes to the columns of this view."""
    a = turn(load_matrix(view, QUATERNION_V), load3(params, 0))
    place = load_matrix(view, PLACE_V)
    p, o = earth_fixed(view, PLACE_V), turn(place, a)
    d = (p[0] + o[0] - row[BEACON_R], p[1] + o[1] - row[BEACON_R + 1], p[2] + o[2] - row[BEACON_R + 2])
    distance = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    n = turn_back(place, d)
    unit = (factor * n[0] / distance, factor * n[1] / distance, factor * n[2] / distance)
    t = cross(a, unit)
    for j in range(3):
        Hv[0, column + POSITION_T + j] = unit[j]
        Hv[0, column + ATTITUDE_T + j] = t[j]
    return distance


@kernel()
def beacon_noise(row, n0, n1, n2, views):
    """Variance of a distance by that of the beacon, with its slope (n0, n1, n2) in the navigation frame."""
    angle = wander(views)
    c, s = math.cos(angle), math.sin(angle)
    north, east = c * n0 - s * n1, s * n0 + c * n1
    at = BEACON_VARIANCE_R
    return row[at] * north * north + row[at + 1] * east * east + row[at + 2] * n2 * n2


@kernel(SENSOR)
def predict_one_way(views, nuisance, row, params, z, R, Hv, Hn):
    """Distance at one epoch."""
    scale = 1.0 + nuisance[1]
    distance = leg(views, row, params, scale, Hv, 0)
    if not distance > 0.0:
        return 3
    z[0] = scale * distance + nuisance[0]
    Hn[0, 0], Hn[0, 1] = 1.0, distance
    R[0, 0] = row[1] + beacon_noise(row, Hv[0, 0], Hv[0, 1], Hv[0, 2], views)
    return 0


@kernel(SENSOR)
def predict_two_way(views, nuisance, row, params, z, R, Hv, Hn):
    """Mean of the distances at reception and at transmission."""
    half = 0.5 * (1.0 + nuisance[1])
    distance = leg(views, row, params, half, Hv, 0) + leg(views[VIEW_SIZE:], row, params, half, Hv, TANGENT)
    if not distance > 0.0:
        return 3
    z[0] = half * distance + nuisance[0]
    Hn[0, 0], Hn[0, 1] = 1.0, 0.5 * distance
    T = TANGENT
    R[0, 0] = row[1] + beacon_noise(row, Hv[0, 0] + Hv[0, T], Hv[0, 1] + Hv[0, T + 1], Hv[0, 2] + Hv[0, T + 2], views)
    return 0


def beacon_position(table: AcousticRange, context: Context, where: str) -> Array:
    """Earth-fixed positions (n, 3) of the beacons: as the row says, else as the log's [beacons]; nan where neither knows."""
    known = {name: _fixed(beacon, context, where) for name, beacon in context.beacons.items()}
    listed = np.array([known.get(str(name), np.full(3, np.nan)) for name in table.transmitter]).reshape(len(table), 3)
    if table.beacon_latitude is not None and table.beacon_longitude is not None:
        latitude, longitude = table.beacon_latitude, table.beacon_longitude
    elif table.beacon_north is not None and table.beacon_east is not None:
        latitude, longitude = context.geographic(table.beacon_north, table.beacon_east, where)
    else:
        return listed
    own = context.position_e(latitude, longitude, filled(table.beacon_depth, 0.0, len(table)))
    return np.where(np.isfinite(own), own, listed)


def beacon_variance(table: AcousticRange, context: Context) -> Array:
    """Variances (n, 3) of the beacons' positions, north, east, down: as the row says, else as the log's [beacons]; else none."""
    by_name = {n: (b.sigma_north**2, b.sigma_east**2, b.sigma_depth**2) for n, b in context.beacons.items()}
    listed = np.array([by_name.get(str(name), (0.0, 0.0, 0.0)) for name in table.transmitter]).reshape(len(table), 3)
    own = filled(table.beacon_sigma, np.nan, len(table))[:, None] ** 2
    return np.where(np.isfinite(own), own, listed)


def _fixed(beacon: Beacon, context: Context, where: str) -> Array:
    if beacon.latitude is not None and beacon.longitude is not None:
        latitude, longitude = np.array(beacon.latitude), np.array(beacon.longitude)
    else:
        latitude, longitude = context.geographic(np.array(beacon.north), np.array(beacon.east), where)
    return geodesy.ecef_from_geodetic(latitude, longitude, context.surface - beacon.depth)


def _turnaround(table: AcousticRange, context: Context) -> Array:
    """Turn-around times (n,): as the row says, else as the log's [beacons], else none."""
    by_name = [context.beacons[str(n)].turnaround if str(n) in context.beacons else 0.0 for n in table.transmitter]
    given = np.full(len(table), np.nan) if table.turnaround is None else table.turnaround
    return np.where(np.isfinite(given), given, by_name)


def _for_us(table: AcousticRange, name: str) -> npt.NDArray[np.bool_]:
    """Which rows were received by the vehicle."""
    return np.ones(len(table), bool) if table.receiver is None else np.isin(table.receiver, ("", "vehicle", name))


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose acoustic ranges; `travel_time` of a two-way path contains the turn-around."""
    sigma, speed = config.value("sigma"), config.value("sound_speed", 1500.0)
    longest = config.value("range_max", 5000.0)
    nuisance = nuisances(config, "bias", 1, "m") + nuisances(config, "scale", 1, "1")
    parameters = context.lever(config)
    one = Channel(("range",), predict_one_way, parameters, ROW, nuisance, bounds_drift=True)
    two = Channel(("range",), predict_two_way, parameters, ROW, nuisance, epochs=2, bounds_drift=True)

    def read(table: AcousticRange) -> Reading:
        count, good = len(table), usable(table)
        path = np.full(count, config.value("path", "one_way")) if table.path is None else table.path
        two_way = path == "two_way"
        turnaround = np.where(two_way, _turnaround(table, context), 0.0)
        flown = np.full(count, np.nan) if table.travel_time is None else speed * (table.travel_time - turnaround)
        measured = filled(table.range, np.nan, count)
        distance = np.where(np.isfinite(measured), measured, np.where(two_way, 0.5 * flown, flown))
        beacon = beacon_position(table, context, config.name)
        data = np.column_stack([distance, sigmas(table.sigma, sigma, count) ** 2, beacon, beacon_variance(table, context)])
        good = good & np.isin(path, KNOWN_PATHS)  # a difference of ranges has no model yet
        near = ~(distance > longest)
        placed = np.isfinite(beacon).all(axis=1) & _for_us(table, config.name)
        transmit = filled(table.transmit, np.nan, count)
        transmit = np.where(np.isfinite(transmit), transmit, table.time - 2.0 * distance / speed - turnaround)
        outcome = np.select([~near, ~placed], [int(Outcome.OUT_OF_RANGE), int(Outcome.NOT_CONFIGURED)], int(Outcome.USED))
        one_row = finite_rows(ONE_WAY, data, good & near & placed & ~two_way)
        return reading(table, one_row, finite_rows(TWO_WAY, data, good & near & placed & two_way, transmit), outcome=outcome)

    return Sensor(config, (one, two), read, flight=2.0 * longest / speed + 10.0)
