"""An inertial unit as a measurement, for process models whose angular rate is a state.

Gyros:           z = w + R_nb^T (w_en + w_ie) + b
Accelerometers:  z = (w x (R_nb^T v + w x l) - R_nb^T g) along the first two axes of the body: they show which way is down, once a second

w is the rate of the body against the navigation frame, w_en that of the navigation frame against the Earth (transport), w_ie that of the
Earth against inertial space.  A reading, a mean over its interval or an increment divided by it, counts at the moment of its row: where
the vehicle turns unevenly it lags by half an interval.  How the speed along the body changes is unknown to the accelerometers' model and is
their noise, `sigma_level`; it is taken to be another from second to second, so one reading in a second is used.
Row: rates in body axes 3 (rad/s), variance; or forces along the first two axes, variance.  Nuisance: gyro_bias 3, body axes, with the
turn-on sigma and the wandering that it has in the process model `inertial`.  Left out of the Jacobians: how w_en, w_ie and g change with
the place.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import curvature, gravity, level_rotation, third_row
from leadline.core.geodesy import EARTH_RATE
from leadline.core.rotation import cross, load3, load_matrix, turn, turn_back
from leadline.data.errors import InputError
from leadline.models.imu import rates_of
from leadline.models.nuisance import AXES, Nuisance
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, reading, usable
from leadline.models.view import ATTITUDE_T, HEIGHT_V, QUATERNION_V, RATE_T, RATE_V, TURNING, VELOCITY, VELOCITY_T, VELOCITY_V

if TYPE_CHECKING:
    from leadline.data.records import Imu
    from leadline.data.vehicle import SensorConfig


SIGMA_LEVEL, EVERY = 0.2, 1.0  # m/s^2; s


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


@kernel(SENSOR)
def predict_level(views, nuisance, row, params, z, R, Hv, Hn):
    """Specific force along the first two axes of a body that keeps its velocity in body axes.  Parameters: surface, lever arm 3."""
    axis = third_row(views[0], views[1], views[2], views[3])
    g = gravity(axis, views[HEIGHT_V], params[0])
    c, w, n = load_matrix(views, QUATERNION_V), load3(views, RATE_V), load3(views, VELOCITY_V)
    v, lever = turn_back(c, n), load3(params, 1)
    swing = cross(w, lever)
    here = (v[0] + swing[0], v[1] + swing[1], v[2] + swing[2])
    pull = cross(w, here)
    for i in range(2):
        z[i] = pull[i] - g * c[6 + i]
        unit = (1.0 - i, 1.0 * i, 0.0)
        by_v, by_w = cross(unit, w), cross(here, unit)  # e . (w x v) = v . (e x w) = w . (v x e)
        by_swing = cross(lever, by_v)
        by_n = turn(c, by_v)
        turned = cross(by_n, n)  # d(R^T v) = R^T (v x d theta)
        for j in range(3):
            Hv[i, VELOCITY_T + j] = by_n[j]
            Hv[i, RATE_T + j] = by_w[j] + by_swing[j]
            Hv[i, ATTITUDE_T + j] = turned[j]
        Hv[i, ATTITUDE_T] -= g * c[3 + i]  # d(R^T down) = R^T (down x d theta)
        Hv[i, ATTITUDE_T + 1] += g * c[i]
        R[i, i] = row[2]
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose the gyros of an inertial unit; their noise is a density, so their rate must be known."""
    rate = config.values.get("rate")
    if rate is None:
        right = "give it: sigma of a reading is gyro_noise times the root of the rate"
        raise InputError(f"sensors.{config.name}", "has no rate_hz, and corrects the angular rate", right)
    variance, unsteady = config.value("gyro_noise") ** 2 * rate, config.value("sigma_level", SIGMA_LEVEL) ** 2

    def read(table: Imu) -> Reading:
        rates, forces, interval = rates_of(table)
        rates = np.where(np.isfinite(rates), rates, np.nan)
        turning = np.column_stack([rates @ config.rotation_bs.T, np.full(len(table), variance)])
        level = np.column_stack([(forces @ config.rotation_bs.T)[:, :2], np.full(len(table), unsteady)])
        good = usable(table) & (interval > 0.0) if len(interval) else usable(table)
        with np.errstate(invalid="ignore"):
            first = np.mod(table.time, EVERY) < 1.0 / rate  # of each second; asks nothing of the rows beside
        return reading(table, finite_rows(0, turning, good), finite_rows(1, level, good & first))

    needs, none = frozenset({TURNING, VELOCITY}), ()
    surface = np.array([context.surface, *context.lever(config)])
    channels = (
        Channel(("rate_x", "rate_y", "rate_z"), predict, np.zeros(1), 4, gyro_bias(config), requires=needs),
        Channel(("force_x", "force_y"), predict_level, surface, 3, none, requires=needs),
    )
    return Sensor(config, channels, read)


def gyro_bias(config: SensorConfig) -> tuple[Nuisance, ...]:
    """Return the biases of the gyros as nuisances: random walks by their instability in tau, or stationary (`gauss_markov`)."""
    sigma, tau = config.value("gyro_bias"), config.value("gyro_bias_tau")
    law = {"walk": config.value("gyro_bias_instability") / math.sqrt(tau)}
    if config.value("gyro_bias_process", "random_walk") == "gauss_markov":
        law = {"tau": tau, "steady": sigma}
    return tuple(Nuisance(f"{config.name}.gyro_bias{axis}", sigma=sigma, unit="rad/s", frame="body", **law) for axis in AXES[3])
