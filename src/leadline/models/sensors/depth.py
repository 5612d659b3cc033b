"""Depth: z = surface - height + (R_nb l)_down + datum.

Row: depth (m), variance (m^2).  Parameters: lever_arm_b 3, surface.  Nuisance: datum.  Heights come as depths: surface - height.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import load3, load_matrix, turn
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, usable
from leadline.models.view import ATTITUDE_T, HEIGHT_V, POSITION_T, QUATERNION_V

if TYPE_CHECKING:
    from leadline.data.records import Depth
    from leadline.data.vehicle import SensorConfig
    from leadline.models.nuisance import Nuisance


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Depth of the sensor's own point."""
    a = turn(load_matrix(views, QUATERNION_V), load3(params, 0))
    z[0] = params[3] - views[HEIGHT_V] + a[2] + nuisance[0]
    Hv[0, POSITION_T + 2] = 1.0
    Hv[0, ATTITUDE_T], Hv[0, ATTITUDE_T + 1] = a[1], -a[0]
    Hn[0, 0] = 1.0
    R[0, 0] = row[1]
    return 0


def channel(config: SensorConfig, context: Context, component: str, datum: tuple[Nuisance, ...]) -> Channel:
    """Return the channel that compares depths."""
    return Channel((component,), predict, np.array([*context.lever(config), context.surface]), 2, datum, linear=True)


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a depth sensor."""
    variance = config.value("sigma") ** 2

    def read(table: Depth) -> Reading:
        depth = table.depth
        return reading(table, finite_rows(0, np.stack([depth, np.full(len(table), variance)], axis=1), usable(table)))

    return Sensor(config, (channel(config, context, "depth", nuisances(config, "datum", 1, "m")),), read)
