"""Heading of the body from true north, as a compass shows it: z = m with m = heading + bias + drift t + swing(m).

    swing(m) = A sin m + B cos m + C sin 2m + D cos 2m

is the deviation by the vehicle's own iron, over the heading m that the compass shows: A and B by what is permanently magnetic, C and D by
what the Earth's field makes so.  m is solved for, so that the noise of a reading does not pass for deviation.
Row: heading (rad), variance (rad^2).  Nuisances: bias, swing 4.
A magnetic heading is brought to true north by the declination when read: as given, or by the World Magnetic Model at epoch and origin.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.attitude import euler_from_quaternion, quaternion_from_matrix
from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import load4, load_matrix
from leadline.data.errors import InputError
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, sigmas, usable
from leadline.models.view import ATTITUDE_T, POSITION_T, QUATERNION_V, heading_of, north_slope
from leadline.sea import magnetic

if TYPE_CHECKING:
    from leadline.data.records import Array, Heading
    from leadline.data.vehicle import SensorConfig
    from leadline.models.nuisance import Nuisance

DRIFT = 5  # place among the nuisances


@kernel()
def deviation(m, nuisance, at):
    """Deviation at a shown heading m, and its derivative; its four factors stand at place `at` of the nuisances."""
    s, c = math.sin(m), math.cos(m)
    s2, c2 = 2.0 * s * c, c * c - s * s
    a, b, d, e = load4(nuisance, at)
    return a * s + b * c + d * s2 + e * c2, a * c - b * s + 2.0 * (d * c2 - e * s2)


@kernel()
def shown(h, nuisance, at):
    """What a compass shows at heading h (its bias counted in), and the derivative of that; by Newton's method.

    The derivative is zero where the needle sticks: the deviation then grows as fast as the heading, or nearly.
    """
    m, slope = h, 1.0
    for _ in range(8):
        value, steep = deviation(m, nuisance, at)
        if steep > 0.9:
            return m, 0.0
        slope = 1.0 / (1.0 - steep)
        step = (m - h - value) * slope
        m -= step
        if abs(step) < 1e-15:
            break
    return m, slope


@kernel()
def write_swing(m, factor, i, at, Hn):
    """Jacobian of row i for the four factors of the deviation, times `factor`."""
    Hn[i, at], Hn[i, at + 1] = factor * math.sin(m), factor * math.cos(m)
    Hn[i, at + 2], Hn[i, at + 3] = factor * math.sin(2.0 * m), factor * math.cos(2.0 * m)


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
    z[0], slope = shown(heading_of(views) + nuisance[0] + nuisance[DRIFT] * row[2], nuisance, 1)
    if slope == 0.0 or not write_heading(views, slope, 0, 0, Hv):
        return 3
    write_swing(z[0], slope, 0, 1, Hn)
    Hn[0, 0], Hn[0, DRIFT] = slope, slope * row[2]
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
        data = np.stack([true_heading(config, table, context), sigma**2, table.time], axis=1)
        return reading(table, finite_rows(0, data, usable(table)))

    nuisance = nuisances(config, "bias", 1, "rad") + swing_of(config) + nuisances(config, "drift", 1, "rad/s")
    return Sensor(
        config, (Channel(("heading",), predict, np.zeros(1), 3, nuisance, angles=(True,), linear="swing" not in config.nuisance),), read
    )
