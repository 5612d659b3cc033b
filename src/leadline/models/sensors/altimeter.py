"""Distance to the sea bed, which is taken as level below the vehicle: its depth is a nuisance shared by all that look down.

    altitude = seabed - (surface - height + (R_nb l)_down)
    z = altitude / u_down + b,  u = R_nb R_bs (0 0 1)     along the sensor's z axis, bias b (m)
    z = altitude + b                                      vertical: the altitude of a Doppler log

Row: distance (m), variance (m^2).  Parameters: lever_arm_b 3, surface, and along the axis its direction in body axes 3.
Nuisances: seabed.depth, bias.  An axis more than 84 degrees off the vertical sees no bottom: out of range.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import load3, load_matrix, turn
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.models.nuisance import Nuisance
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, shared_nuisances, sigmas, usable
from leadline.models.view import ATTITUDE_T, HEIGHT_V, POSITION_T, QUATERNION_V

if TYPE_CHECKING:
    from leadline.data.records import Altimeter
    from leadline.data.vehicle import SensorConfig

SURFACE_P, AXIS_P = 3, 4
STEEPEST = 0.1  # cosine of the largest angle of the axis with the vertical


@kernel()
def altitude_of(views, nuisance, params, factor, Hv, Hn):
    """Altitude of the sensor above the sea bed; its Jacobians, times `factor`, go to the first row."""
    a = turn(load_matrix(views, QUATERNION_V), load3(params, 0))
    Hv[0, POSITION_T + 2] = -factor
    Hv[0, ATTITUDE_T], Hv[0, ATTITUDE_T + 1] = -factor * a[1], factor * a[0]
    Hn[0, 0], Hn[0, 1] = factor, 1.0
    return nuisance[0] - (params[SURFACE_P] - views[HEIGHT_V] + a[2])


@kernel(SENSOR)
def predict_altitude(views, nuisance, row, params, z, R, Hv, Hn):
    """Vertical distance to the sea bed."""
    z[0] = altitude_of(views, nuisance, params, 1.0, Hv, Hn) + nuisance[1]
    R[0, 0] = row[1]
    return 0


@kernel(SENSOR)
def predict_range(views, nuisance, row, params, z, R, Hv, Hn):
    """Distance to the sea bed along the axis of the sensor."""
    u = turn(load_matrix(views, QUATERNION_V), load3(params, AXIS_P))
    if not u[2] > STEEPEST:
        return 3
    altitude = altitude_of(views, nuisance, params, 1.0 / u[2], Hv, Hn)
    z[0] = altitude / u[2] + nuisance[1]
    leaning = altitude / (u[2] * u[2])  # d u_down = dtheta_0 u_1 - dtheta_1 u_0
    Hv[0, ATTITUDE_T] -= leaning * u[1]
    Hv[0, ATTITUDE_T + 1] += leaning * u[0]
    R[0, 0] = row[1]
    return 0


def seabed(config: SensorConfig, context: Context) -> tuple[Nuisance, ...]:
    """Return the depth of the sea bed as a nuisance; raises InputError where the vehicle file states none."""
    if "seabed.depth" not in context.shared:
        right = "add [seabed] with depth = { value_m = ..., sigma_m = ..., length_m = ... }"
        raise InputError(f"sensors.{config.name}", "measures the distance to a sea bed of unknown depth", right)
    return shared_nuisances(context, "seabed.depth", 1, "m")


def altitude_channel(config: SensorConfig, context: Context) -> Channel:
    """Return the channel of a vertical altitude without a bias of its own."""
    parameters = np.array([*context.lever(config), context.surface])
    return Channel(("altitude",), predict_altitude, parameters, 2, (*seabed(config, context), Nuisance(f"{config.name}.altitude_bias")))


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose an echo sounder that looks along its z axis; a distance that is not positive is invalid."""
    default, longest = config.value("sigma"), config.value("range_max", np.inf)
    parameters = np.array([*context.lever(config), context.surface, *config.rotation_bs[:, 2]])

    def read(table: Altimeter) -> Reading:
        data = np.stack([np.where(table.range > 0.0, table.range, np.nan), sigmas(table.sigma, default, len(table)) ** 2], axis=1)
        far = table.range > longest
        outcome = np.where(far, int(Outcome.OUT_OF_RANGE), int(Outcome.USED))
        return reading(table, finite_rows(0, data, usable(table) & ~far), outcome=outcome)

    nuisance = seabed(config, context) + nuisances(config, "bias", 1, "m")
    return Sensor(config, (Channel(("range",), predict_range, parameters, 2, nuisance),), read)
