"""Heading of the body from true north: z = heading + bias.

Row: heading (rad), variance (rad^2).  Nuisance: bias.  A magnetic heading is brought to true north by the declination when read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core.attitude import euler_from_quaternion, quaternion_from_matrix
from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import load_matrix
from leadline.data.errors import InputError
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, sigmas, usable
from leadline.models.view import ATTITUDE_T, POSITION_T, QUATERNION_V, heading_of, north_slope

if TYPE_CHECKING:
    from leadline.data.records import Array, Heading
    from leadline.data.vehicle import SensorConfig


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Heading of the body's forward axis; it has none when that axis is vertical."""
    c = load_matrix(views, QUATERNION_V)
    level = c[0] * c[0] + c[3] * c[3]
    if level < 1e-6:
        return 3
    z[0] = heading_of(views) + nuisance[0]
    Hv[0, ATTITUDE_T] = -c[0] * c[6] / level
    Hv[0, ATTITUDE_T + 1] = -c[3] * c[6] / level
    Hv[0, ATTITUDE_T + 2] = 1.0
    Hv[0, POSITION_T], Hv[0, POSITION_T + 1] = north_slope(views)
    Hn[0, 0] = 1.0
    R[0, 0] = row[1]
    return 0


def declination(config: SensorConfig) -> float:
    """Return what must be added to the sensor's headings to count them from true north (rad)."""
    if config.value("reference", "true") == "true":
        return 0.0
    if config.values.get("declination") is None:
        raise InputError(f"sensors.{config.name}", "is magnetic and has no declination_deg", "give declination_deg, east positive")
    return float(config.value("declination"))


def true_heading(config: SensorConfig, table: Heading) -> Array:
    """Return the headings (n,) of the body from true north; the mounting turns about the vertical only."""
    mounting = float(euler_from_quaternion(quaternion_from_matrix(config.rotation_bs))[2])
    return np.asarray(table.heading + declination(config) - mounting)


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a compass or gyrocompass."""
    default = config.value("sigma")
    declination(config)  # refused now rather than at the first row

    def read(table: Heading) -> Reading:
        sigma = sigmas(table.sigma, default, len(table))
        return reading(table, finite_rows(0, np.stack([true_heading(config, table), sigma**2], axis=1), usable(table)))

    bias = nuisances(config, "bias", 1, "rad")
    return Sensor(config, (Channel(("heading",), predict, np.zeros(1), 2, bias, angles=(True,)),), read)
