"""Heading of the body from true north: z = heading + bias + swing(m),  swing = A sin m + B cos m + C sin 2m + D cos 2m.

Swing is the deviation of a compass by the vehicle's own iron, over the heading m that the compass shows: A and B by what is permanently
magnetic, C and D by what the Earth's field makes so.  Row: heading m (rad), variance (rad^2).  Nuisances: bias, swing 4.
A magnetic heading is brought to true north by the declination when read: as given, or by the World Magnetic Model at epoch and origin.
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
from leadline.sea import magnetic

if TYPE_CHECKING:
    from leadline.data.records import Array, Heading
    from leadline.data.vehicle import SensorConfig
    from leadline.models.nuisance import Nuisance


@kernel()
def swing(nuisance, at, sine, cosine, i, Hn):
    """Deviation at a heading of which sine and cosine are given; the Jacobian of row i for its four values goes to place `at`."""
    part = (sine, cosine, 2.0 * sine * cosine, cosine * cosine - sine * sine)
    total = 0.0
    for j in range(4):
        Hn[i, at + j] = part[j]
        total += part[j] * nuisance[at + j]
    return total


@kernel()
def write_heading(view, factor, i, column, Hv):
    """Jacobian of factor x heading, into row i; false where the heading is none, because the forward axis is vertical."""
    c = load_matrix(view, QUATERNION_V)
    level = c[0] * c[0] + c[3] * c[3]
    if level < 1e-6:
        return False
    Hv[i, column + ATTITUDE_T] = -factor * c[0] * c[6] / level
    Hv[i, column + ATTITUDE_T + 1] = -factor * c[3] * c[6] / level
    Hv[i, column + ATTITUDE_T + 2] = factor
    slope = north_slope(view)
    for j in range(2):
        Hv[i, column + POSITION_T + j] = factor * slope[j]
    return True


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Heading of the body's forward axis; it has none when that axis is vertical."""
    if not write_heading(views, 1.0, 0, 0, Hv):
        return 3
    z[0] = heading_of(views) + nuisance[0] + swing(nuisance, 1, np.sin(row[0]), np.cos(row[0]), 0, Hn)
    Hn[0, 0] = 1.0
    R[0, 0] = row[1]
    return 0


def declination(config: SensorConfig, context: Context) -> float:
    """Return what must be added to the sensor's headings to count them from true north (rad).

    Raises InputError where a magnetic sensor has none, and where the field is asked for without an origin or for a year without a model.
    """
    found, where = config.values.get("declination"), f"sensors.{config.name}"
    if config.value("reference", "true") == "true":
        return 0.0
    if found is None:
        raise InputError(where, "is magnetic and has no declination_deg", 'give declination_deg, east positive, or declination = "wmm"')
    if found != "wmm":
        return float(found)
    if context.origin is None or context.date is None:
        raise InputError(f"{where}.declination", "is 'wmm', but the log has no origin", "add origin to log.toml, or give declination_deg")
    return magnetic.declination(context.origin.latitude, context.origin.longitude, context.surface, context.date, f"{where}.declination")


def true_heading(config: SensorConfig, table: Heading, context: Context) -> Array:
    """Return the headings (n,) of the body from true north; the mounting turns about the vertical only."""
    mounting = float(euler_from_quaternion(quaternion_from_matrix(config.rotation_bs))[2])
    return np.asarray(table.heading + declination(config, context) - mounting)


def swing_of(config: SensorConfig) -> tuple[Nuisance, ...]:
    """Return the four values of the deviation as nuisances."""
    return nuisances(config, "swing", 4, "rad")


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a compass or gyrocompass."""
    default = config.value("sigma")
    declination(config, context)  # refused now rather than at the first row

    def read(table: Heading) -> Reading:
        sigma = sigmas(table.sigma, default, len(table))
        return reading(table, finite_rows(0, np.stack([true_heading(config, table, context), sigma**2], axis=1), usable(table)))

    nuisance = nuisances(config, "bias", 1, "rad") + swing_of(config)
    return Sensor(config, (Channel(("heading",), predict, np.zeros(1), 2, nuisance, angles=(True,)),), read)
