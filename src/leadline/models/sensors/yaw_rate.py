"""Rate of a single gyro about the sensor's z axis: z = (1 + s) d . (w + R_nb^T (w_en + w_ie)) + b.

w is the rate of the body against the navigation frame, w_en that of the navigation frame against the Earth (transport), w_ie that of the
Earth against inertial space, which an instrument may have taken off itself (`earth_rate = "removed"`).
Row: rate (rad/s), variance.  Parameters: axis d in body axes 3, whether the Earth rate is felt (1) or removed (0).
Nuisances: bias (rad/s), scale.  Left out of the Jacobian: how w_en and w_ie change with place and speed, below 1/R.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import curvature, level_rotation, third_row
from leadline.core.geodesy import EARTH_RATE
from leadline.core.rotation import cross, load3, load_matrix, turn
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, usable
from leadline.models.view import ATTITUDE_T, HEIGHT_V, QUATERNION_V, RATE, RATE_T, RATE_V, VELOCITY, VELOCITY_V

if TYPE_CHECKING:
    from leadline.data.records import YawRate
    from leadline.data.vehicle import SensorConfig

EARTH_P = 3


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Rate about the axis of the gyro."""
    d = load3(params, 0)
    axis = third_row(views[0], views[1], views[2], views[3])
    t0, t1 = level_rotation(axis, curvature(axis, views[HEIGHT_V]), views[VELOCITY_V], views[VELOCITY_V + 1])
    earth = EARTH_RATE * params[EARTH_P]
    frame = (t0 + earth * axis[0], t1 + earth * axis[1], earth * axis[2])
    n = turn(load_matrix(views, QUATERNION_V), d)  # d . R^T frame = n . frame
    rate = n[0] * frame[0] + n[1] * frame[1] + n[2] * frame[2]
    turned = cross(n, frame)
    for j in range(3):
        rate += d[j] * views[RATE_V + j]
    scale = 1.0 + nuisance[1]
    for j in range(3):
        Hv[0, RATE_T + j] = scale * d[j]
        Hv[0, ATTITUDE_T + j] = scale * turned[j]
    z[0] = scale * rate + nuisance[0]
    Hn[0, 0], Hn[0, 1] = 1.0, rate
    R[0, 0] = row[1]
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a single gyro; its noise is a density, so its rate must be known."""
    rate = config.values.get("rate")
    if rate is None:
        raise InputError(f"sensors.{config.name}", "has no rate_hz", "give it: sigma of a reading is the noise times the root of the rate")
    sigma, fastest = config.value("noise") * math.sqrt(rate), config.value("rate_max", np.inf)
    felt = 0.0 if config.value("earth_rate", "felt") == "removed" else 1.0
    parameters = np.array([*config.rotation_bs[:, 2], felt])

    def read(table: YawRate) -> Reading:
        fast = np.abs(table.yaw_rate) > fastest
        outcome = np.where(fast, int(Outcome.OUT_OF_RANGE), int(Outcome.USED))
        data = np.stack([table.yaw_rate, np.full(len(table), sigma**2)], axis=1)
        return reading(table, finite_rows(0, data, usable(table) & ~fast), outcome=outcome)

    nuisance = nuisances(config, "bias", 1, "rad/s") + nuisances(config, "scale", 1, "1")
    needs, linear = frozenset({RATE, VELOCITY}), "scale" not in config.nuisance
    return Sensor(config, (Channel(("yaw_rate",), predict, parameters, 2, nuisance, requires=needs, linear=linear),), read)
