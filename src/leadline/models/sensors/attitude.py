"""Attitude from an AHRS: z = log(R_predicted R_measured^T) + bias, in level axes along the measured heading.

The components are the errors of roll, pitch and heading, without the singularity of the angles.  To that of heading the deviation of a
magnetic instrument is added (heading.py).  Row: 0 0 0, measured quaternion body -> north-east-down 4, cosine and sine of its heading,
variances 3.  Nuisances: bias 3 (with a `tau` each axis is a Gauss-Markov process: the coloured error of an AHRS), swing 4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import attitude
from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import load4, logarithm, product
from leadline.models.sensor import Channel, Context, Reading, Sensor, finite_rows, nuisances, reading, sigmas, usable
from leadline.models.sensors.heading import declination, shown, swing_of, write_heading, write_swing
from leadline.models.view import ATTITUDE_T, POSITION_T, QUATERNION_V, heading_of, north_slope, wander

if TYPE_CHECKING:
    from leadline.data.records import Array, Attitude
    from leadline.data.vehicle import SensorConfig

QUATERNION_R, LEVEL_R, VARIANCE_R = 3, 7, 9


@kernel()
def add_deviation(views, nuisance, z, Hv, Hn):
    """Add the deviation of a magnetic instrument (heading.py) to the error of heading; none where the forward axis is vertical."""
    h = heading_of(views) + nuisance[2]
    m, steep = shown(h, nuisance, 3)
    before = (Hv[2, POSITION_T], Hv[2, POSITION_T + 1], Hv[2, ATTITUDE_T], Hv[2, ATTITUDE_T + 1], Hv[2, ATTITUDE_T + 2])
    if steep == 0.0 or not write_heading(views, steep - 1.0, 2, 0, Hv):
        return
    Hv[2, POSITION_T] += before[0]
    Hv[2, POSITION_T + 1] += before[1]
    for j in range(3):
        Hv[2, ATTITUDE_T + j] += before[2 + j]
    z[2] += m - h
    Hn[2, 2] = steep
    write_swing(m, steep, 2, 3, Hn)


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Rotation from the measured to the predicted attitude."""
    half = 0.5 * wander(views)
    q = product((np.cos(half), 0.0, 0.0, np.sin(half)), load4(views, QUATERNION_V))
    m = load4(row, QUATERNION_R)
    d = product(q, (m[0], -m[1], -m[2], -m[3]))
    e = logarithm(d[0], d[1], d[2], d[3])
    c, s = row[LEVEL_R], row[LEVEL_R + 1]
    z[0] = c * e[0] + s * e[1] + nuisance[0]
    z[1] = -s * e[0] + c * e[1] + nuisance[1]
    z[2] = e[2] + nuisance[2]
    # inverse left Jacobian I - [e]x / 2 + [e]x^2 / 12, then from the navigation frame to level axes along the measured heading
    cw, sw = np.cos(2.0 * half), np.sin(2.0 * half)
    square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
    for j in range(3):
        a = (cw, sw, 0.0) if j == 0 else ((-sw, cw, 0.0) if j == 1 else (0.0, 0.0, 1.0))
        dot = (e[0] * a[0] + e[1] * a[1] + e[2] * a[2]) / 12.0
        own = 1.0 - square / 12.0
        g0 = own * a[0] - 0.5 * (e[1] * a[2] - e[2] * a[1]) + dot * e[0]
        g1 = own * a[1] - 0.5 * (e[2] * a[0] - e[0] * a[2]) + dot * e[1]
        g2 = own * a[2] - 0.5 * (e[0] * a[1] - e[1] * a[0]) + dot * e[2]
        Hv[0, ATTITUDE_T + j] = c * g0 + s * g1
        Hv[1, ATTITUDE_T + j] = -s * g0 + c * g1
        Hv[2, ATTITUDE_T + j] = g2
        Hn[j, j] = 1.0
        R[j, j] = row[VARIANCE_R + j]
    slope = north_slope(views)
    for i in range(3):
        for j in range(2):
            Hv[i, POSITION_T + j] = slope[j] * Hv[i, ATTITUDE_T + 2]
    add_deviation(views, nuisance, z, Hv, Hn)
    return 0


def measured_quaternion(config: SensorConfig, table: Attitude, context: Context) -> Array:
    """Return body -> true north-east-down (n, 4) of an attitude table."""
    if table.quaternion is not None:
        q = table.quaternion / np.linalg.norm(table.quaternion, axis=1, keepdims=True)
    else:
        q = attitude.quaternion_from_euler(*map(np.asarray, (table.roll, table.pitch, table.heading)))
    north = attitude.quaternion_from_euler(0.0, 0.0, declination(config, context))
    mounting = attitude.conjugate(attitude.quaternion_from_matrix(config.rotation_bs))
    return attitude.product(attitude.product(north, q), mounting)


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose an attitude sensor."""
    declination(config, context)  # refused now rather than at the first row
    default = np.array([config.value("sigma_tilt"), config.value("sigma_tilt"), config.value("sigma")])

    def read(table: Attitude) -> Reading:
        q = measured_quaternion(config, table, context)
        given = table.sigma
        sigma = np.stack([sigmas(None if given is None else given[:, i], d, len(table)) for i, d in enumerate(default)], axis=1)
        heading = attitude.euler_from_quaternion(q)[2]
        data = np.column_stack([np.zeros((len(table), 3)), q, np.cos(heading), np.sin(heading), sigma**2])
        return reading(table, finite_rows(0, data, usable(table)))

    bias = nuisances(config, "bias", 3, "rad", "level, along the heading")
    channel = Channel(
        ("roll", "pitch", "heading"),
        predict,
        np.zeros(1),
        12,
        bias + swing_of(config),
        angles=(True, True, True),
        linear="swing" not in config.nuisance,
    )
    return Sensor(config, (channel,), read)
