"""Speed through the water along the sensor's x axis: z = d . (R_nb^T (v - current) + w x l) + b - s z_measured.

The scale s says true = (1 + s) measured, against the measured value: so the equation is linear in speed and scale together, and a scale
that is wrong by half, before the speed itself is known, does no harm.  (Of a Doppler log it is measured = (1 + s) true.)
Row: speed (m/s), variance (m^2/s^2), which grows with (1 + s)^2.  Parameters: axis d in body axes 3, lever_arm_b 3.
Nuisances: scale, bias (m/s), current 2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import cross, load3, load_matrix, turn_back
from leadline.data.outcome import Outcome
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, shared_nuisances, usable
from leadline.models.sensors.dvl import write_row
from leadline.models.sensors.water import through_water, write_current
from leadline.models.view import QUATERNION_V, RATE, RATE_V, VELOCITY

if TYPE_CHECKING:
    from leadline.data.records import Speed
    from leadline.data.vehicle import SensorConfig

LEVER_P, CURRENT_N = 3, 2


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Speed through the water, as the instrument tells it with its scale."""
    d, lever, v = load3(params, 0), load3(params, LEVER_P), through_water(views, nuisance, CURRENT_N)
    body, arm = turn_back(load_matrix(views, QUATERNION_V), v), cross(load3(views, RATE_V), lever)
    z[0] = nuisance[1] - nuisance[0] * row[0]
    for j in range(3):
        z[0] += d[j] * (body[j] + arm[j])
    write_row(Hv, 0, v, views, lever, d, d)
    write_current(views, nuisance, CURRENT_N, 0, Hv, Hn)
    Hn[0, 0], Hn[0, 1] = -row[0], 1.0
    R[0, 0] = row[1] * (1.0 + nuisance[0]) * (1.0 + nuisance[0])
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a log of speed through the water."""
    fastest, variance = config.value("speed_max", 10.0), config.value("sigma") ** 2
    nuisance = nuisances(config, "scale", 1, "1") + nuisances(config, "bias", 1, "m/s")
    nuisance += shared_nuisances(context, "water.current", 2, "m/s", "north-east")
    parameters = np.array([*config.rotation_bs[:, 0], *context.lever(config)])

    def read(table: Speed) -> Reading:
        fast = np.abs(table.speed) > fastest
        data = np.stack([table.speed, np.full(len(table), variance)], axis=1)
        outcome = np.where(fast, int(Outcome.OUT_OF_RANGE), int(Outcome.USED))
        return reading(table, finite_rows(0, data, usable(table) & ~fast), outcome=outcome)

    return Sensor(config, (Channel(("speed",), predict, parameters, 2, nuisance, requires=frozenset({VELOCITY, RATE})),), read)
