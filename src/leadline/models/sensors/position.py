"""Horizontal position: z = the level offset of the predicted point from the measured one, north and east, + bias; measured value 0 0.

Row: 0 0, measured point Earth-fixed 3, variance north, variance east, covariance.  Parameters: lever_arm_b 3.  Nuisance: bias 2 (m), with
a `tau` the coloured error of fixes that were filtered or share a sound speed.
The height of a fix, where it is used, goes through the depth channel: its errors are of another kind than the horizontal ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import earth_fixed
from leadline.core.rotation import load3, load_matrix, turn, turn_back
from leadline.models.nuisance import Nuisance
from leadline.models.sensor import Channel, Context, nuisances, sigmas
from leadline.models.sensors import depth
from leadline.models.view import ATTITUDE_T, PLACE_V, POSITION_T, QUATERNION_V, wander

if TYPE_CHECKING:
    from leadline.data.records import Array
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
    z[0], z[1] = c * x - s * y + nuisance[0], s * x + c * y + nuisance[1]
    Hn[0, 0] = Hn[1, 1] = 1.0
    Hv[0, POSITION_T], Hv[0, POSITION_T + 1] = c, -s
    Hv[1, POSITION_T], Hv[1, POSITION_T + 1] = s, c
    # d(R l) = dtheta x a
    Hv[0, ATTITUDE_T], Hv[0, ATTITUDE_T + 1], Hv[0, ATTITUDE_T + 2] = s * a[2], c * a[2], -c * a[1] - s * a[0]
    Hv[1, ATTITUDE_T], Hv[1, ATTITUDE_T + 1], Hv[1, ATTITUDE_T + 2] = -c * a[2], s * a[2], -s * a[1] + c * a[0]
    R[0, 0], R[1, 1], R[0, 1], R[1, 0] = row[VARIANCE_R], row[VARIANCE_R + 1], row[VARIANCE_R + 2], row[VARIANCE_R + 2]
    return 0


def rows_of(point_e: Array, sigma: Array, covariance: Array) -> Array:
    """Return rows of the horizontal channel: points (n, 3), sigma north and east (n, 2), covariance (n,)."""
    return np.column_stack([np.zeros((len(point_e), 2)), point_e, sigma**2, covariance])


def sigma_of(axes: Array | None, single: Array | None, default: tuple[float, float], count: int) -> Array:
    """Return sigma north, east and down (n, 3): by axis where given, else the single one, else the default."""
    if axes is not None:
        return np.stack([sigmas(axes[:, i], d, count) for i, d in enumerate((default[0], *default))], axis=1)
    return np.stack([sigmas(single, d, count) for d in (default[0], *default)], axis=1)


def bias_of(config: SensorConfig) -> tuple[Nuisance, ...]:
    """Return the bias of positions, north and east, as nuisances."""
    return nuisances(config, "bias", 2, "m", "north-east")


def channels(config: SensorConfig, context: Context) -> tuple[Channel, Channel]:
    """Return the horizontal channel, and the one that compares depths."""
    horizontal = Channel(("north", "east"), predict, context.lever(config), ROW, bias_of(config), linear=True, bounds_drift=True)
    return horizontal, depth.channel(config, context, "down", (Nuisance(f"{config.name}.datum"),))
