"""Horizontal position: z = the level offset of the predicted point from the measured one, north and east; measured value 0 0.

Row: 0 0, measured point Earth-fixed 3, variance north, variance east, covariance.  Parameters: lever_arm_b 3.
The height of a fix, where it is used, goes through the depth channel: its errors are of another kind than the horizontal ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import earth_fixed
from leadline.core.rotation import load3, load_matrix, turn, turn_back
from leadline.data.outcome import Outcome
from leadline.models.nuisance import Nuisance
from leadline.models.sensor import Channel, Context, Reading, Sensor, filled, finite_rows, reading, usable
from leadline.models.sensors import depth
from leadline.models.view import ATTITUDE_T, PLACE_V, POSITION_T, QUATERNION_V, wander

if TYPE_CHECKING:
    from leadline.data.records import Array, Gnss, PositionFix
    from leadline.data.vehicle import SensorConfig

POINT_R, VARIANCE_R, ROW = 2, 5, 8


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Offset in the navigation frame, turned to north and east."""
    a = turn(load_matrix(views, QUATERNION_V), load3(params, 0))
    p = earth_fixed(views, PLACE_V)
    d = (p[0] - row[POINT_R], p[1] - row[POINT_R + 1], p[2] - row[POINT_R + 2])
    n = turn_back(load_matrix(views, PLACE_V), d)
    angle = wander(views)
    c, s = np.cos(angle), np.sin(angle)
    x, y = n[0] + a[0], n[1] + a[1]
    z[0], z[1] = c * x - s * y, s * x + c * y
    Hv[0, POSITION_T], Hv[0, POSITION_T + 1] = c, -s
    Hv[1, POSITION_T], Hv[1, POSITION_T + 1] = s, c
    # d(R l) = dtheta x a
    Hv[0, ATTITUDE_T], Hv[0, ATTITUDE_T + 1], Hv[0, ATTITUDE_T + 2] = s * a[2], c * a[2], -c * a[1] - s * a[0]
    Hv[1, ATTITUDE_T], Hv[1, ATTITUDE_T + 1], Hv[1, ATTITUDE_T + 2] = -c * a[2], s * a[2], -s * a[1] + c * a[0]
    R[0, 0], R[1, 1], R[0, 1], R[1, 0] = row[VARIANCE_R], row[VARIANCE_R + 1], row[VARIANCE_R + 2], row[VARIANCE_R + 2]
    return 0


def _rows(point_e: Array, sigma: Array, covariance: Array) -> Array:
    """Rows of the horizontal channel: points (n, 3), sigma north and east (n, 2), covariance (n,)."""
    return np.column_stack([np.zeros((len(point_e), 2)), point_e, sigma**2, covariance])


def _sigma(axes: Array | None, single: Array | None, default: tuple[float, float], count: int) -> Array:
    """Sigma north, east and down (n, 3): by axis where given, else the single one, else the default."""
    if axes is not None:
        return np.where(np.isfinite(axes), axes, np.array([default[0], default[0], default[1]]))
    return np.stack([filled(single, d, count) for d in (default[0], *default)], axis=1)


def _channels(config: SensorConfig, context: Context) -> tuple[Channel, Channel]:
    horizontal = Channel(("north", "east"), predict, context.lever(config), ROW, bounds_drift=True)
    return horizontal, depth.channel(config, context, "down", (Nuisance(f"{config.name}.datum"),))


def compose_gnss(config: SensorConfig, context: Context) -> Sensor:
    """Compose a satellite receiver; rows of `fix_type` "none" are invalid, heights are used only if `vertical` says so."""
    default = (config.value("sigma"), config.value("sigma_vertical", 2.0 * config.value("sigma")))
    vertical = config.value("vertical", False)

    def read(table: Gnss) -> Reading:
        count = len(table)
        good = usable(table) if table.fix_type is None else usable(table) & (table.fix_type != "none")
        sigma = _sigma(table.sigma_axes, table.sigma, default, count)
        height = filled(table.height, context.surface, count)
        point = geodesy.ecef_from_geodetic(table.latitude, table.longitude, height)
        parts = [finite_rows(0, _rows(point, sigma[:, :2], np.zeros(count)), good)]
        if vertical and table.height is not None:
            parts.append(finite_rows(1, np.stack([context.surface - table.height, sigma[:, 2] ** 2], axis=1), good))
        return reading(table, *parts)

    return Sensor(config, _channels(config, context), read)


def compose_fix(config: SensorConfig, context: Context) -> Sensor:
    """Compose positions solved elsewhere; a depth that comes with them is used unless `vertical` says no."""
    default = (config.value("sigma"), config.value("sigma_depth", config.value("sigma")))
    vertical = config.value("vertical", True)

    def read(table: PositionFix) -> Reading:
        count = len(table)
        sigma = _sigma(table.sigma_axes, table.sigma, default, count)
        if table.latitude is not None and table.longitude is not None:
            latitude, longitude = table.latitude, table.longitude
        else:
            latitude, longitude = context.geographic(np.asarray(table.north), np.asarray(table.east), config.name)
        point = context.position_e(latitude, longitude, filled(table.depth, 0.0, count))
        parts = [finite_rows(0, _rows(point, sigma[:, :2], filled(table.cov_north_east, 0.0, count)), usable(table))]
        if vertical and table.depth is not None:
            parts.append(finite_rows(1, np.stack([table.depth, sigma[:, 2] ** 2], axis=1), usable(table)))
        outcome = np.where(np.abs(latitude) > np.pi / 2, int(Outcome.INVALID), int(Outcome.USED))
        return reading(table, *parts, outcome=outcome)

    return Sensor(config, _channels(config, context), read)
