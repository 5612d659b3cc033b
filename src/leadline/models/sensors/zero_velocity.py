"""Rest: the vehicle is known to stand still over the ground.  z = velocity, measured value zero.

Row: 0 0 0, variance (m^2/s^2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, reading, sigmas, usable
from leadline.models.view import VELOCITY, VELOCITY_T, VELOCITY_V

if TYPE_CHECKING:
    from leadline.data.records import ZeroVelocity
    from leadline.data.vehicle import SensorConfig


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity over ground of the reference point."""
    for i in range(3):
        z[i] = views[VELOCITY_V + i]
        Hv[i, VELOCITY_T + i] = 1.0
        R[i, i] = row[3]
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose moments of rest."""
    default = config.value("sigma")

    def read(table: ZeroVelocity) -> Reading:
        sigma = sigmas(table.sigma, default, len(table))
        return reading(table, finite_rows(0, np.column_stack([np.zeros((len(table), 3)), sigma**2]), usable(table)))

    names = ("velocity_x", "velocity_y", "velocity_z")
    return Sensor(config, (Channel(names, predict, np.zeros(1), 4, requires=frozenset({VELOCITY}), linear=True, bounds_drift=True),), read)
