"""The gyros of an inertial unit as a measurement, for process models whose angular rate is a state: z = w + R_nb^T (w_en + w_ie) + b.

w is the rate of the body against the navigation frame, w_en that of the navigation frame against the Earth (transport), w_ie that of the
Earth against inertial space.  A reading, a mean over its interval or an increment divided by it, counts at the moment of its row: where
the vehicle turns unevenly it lags by half an interval.  The accelerometers are not used: these models have no specific force.
Row: rates in body axes 3 (rad/s), variance.  Nuisance: gyro_bias 3, body axes, with the turn-on sigma and the wandering that it has in the
process model `inertial`.  Left out of the Jacobian: how w_en and w_ie change with place and speed, below 1/R.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import curvature, level_rotation, third_row
from leadline.core.geodesy import EARTH_RATE
from leadline.core.rotation import load_matrix, turn_back
from leadline.data.errors import InputError
from leadline.models.imu import rates_of
from leadline.models.nuisance import AXES, Nuisance
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, reading, usable
from leadline.models.view import ATTITUDE_T, HEIGHT_V, QUATERNION_V, RATE_T, RATE_V, TURNING, VELOCITY_V

if TYPE_CHECKING:
    from leadline.data.records import Imu
    from leadline.data.vehicle import SensorConfig


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Rates about the three axes of the body."""
    axis = third_row(views[0], views[1], views[2], views[3])
    t0, t1 = level_rotation(axis, curvature(axis, views[HEIGHT_V]), views[VELOCITY_V], views[VELOCITY_V + 1])
    w0, w1, w2 = t0 + EARTH_RATE * axis[0], t1 + EARTH_RATE * axis[1], EARTH_RATE * axis[2]
    c = load_matrix(views, QUATERNION_V)
    frame = turn_back(c, (w0, w1, w2))
    for i in range(3):
        z[i] = views[RATE_V + i] + frame[i] + nuisance[i]
        Hv[i, RATE_T + i] = 1.0
        # d(R^T w) = R^T (w x d theta): row i is (column i of R) x w
        a, b, d = c[i], c[3 + i], c[6 + i]
        Hv[i, ATTITUDE_T], Hv[i, ATTITUDE_T + 1], Hv[i, ATTITUDE_T + 2] = b * w2 - d * w1, d * w0 - a * w2, a * w1 - b * w0
        Hn[i, i] = 1.0
        R[i, i] = row[3]
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose the gyros of an inertial unit; their noise is a density, so their rate must be known."""
    rate = config.values.get("rate")
    if rate is None:
        right = "give it: sigma of a reading is gyro_noise times the root of the rate"
        raise InputError(f"sensors.{config.name}", "has no rate_hz, and corrects the angular rate", right)
    variance = config.value("gyro_noise") ** 2 * rate

    def read(table: Imu) -> Reading:
        rates, _, interval = rates_of(table)
        rates = np.where(np.isfinite(rates), rates, np.nan)
        data = np.column_stack([rates @ config.rotation_bs.T, np.full(len(table), variance)])
        good = usable(table) & (interval > 0.0) if len(interval) else usable(table)
        return reading(table, finite_rows(0, data, good))

    return Sensor(
        config, (Channel(("rate_x", "rate_y", "rate_z"), predict, np.zeros(1), 4, gyro_bias(config), requires=frozenset({TURNING})),), read
    )


def gyro_bias(config: SensorConfig) -> tuple[Nuisance, ...]:
    """Return the biases of the gyros as nuisances: random walks by their instability in tau, or stationary (`gauss_markov`)."""
    sigma, tau = config.value("gyro_bias"), config.value("gyro_bias_tau")
    law = {"walk": config.value("gyro_bias_instability") / math.sqrt(tau)}
    if config.value("gyro_bias_process", "random_walk") == "gauss_markov":
        law = {"tau": tau, "steady": sigma}
    return tuple(Nuisance(f"{config.name}.gyro_bias{axis}", sigma=sigma, unit="rad/s", frame="body", **law) for axis in AXES[3])
