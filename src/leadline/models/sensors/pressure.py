"""Absolute pressure of the sea: z = atmosphere + (1 + s) P(depth of the sensor + datum).

P is the pressure of the standard ocean (core/water.py), or density x gravity x depth where a density is given.  Gravity follows the
latitude unless it is given.  Predicted from the depth rather than turned into one when read: so scale and datum are nuisances, gravity
is that of the place, and the sigma of the instrument stays what its maker says.
Row: pressure (Pa), variance (Pa^2), atmosphere (Pa).  Parameters: lever_arm_b 3, surface, density (0: sea water), gravity (0: by latitude).
Nuisances: datum (m), scale (of the density).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from leadline.core.compiled import SENSOR, kernel
from leadline.core.earth import third_row
from leadline.core.rotation import load3, load_matrix, turn
from leadline.core.water import ATMOSPHERE, depth_of_pressure, pressure_of_depth, surface_gravity
from leadline.data.outcome import Outcome
from leadline.models.sensor import Channel, Context, Reading, Sensor, filled, finite_rows, nuisances, reading, usable
from leadline.models.view import ATTITUDE_T, HEIGHT_V, POSITION_T, QUATERNION_V

if TYPE_CHECKING:
    from leadline.data.records import Array, Pressure
    from leadline.data.vehicle import SensorConfig

SURFACE_P, DENSITY_P, GRAVITY_P = 3, 4, 5


@kernel(SENSOR)
def predict(views, nuisance, row, params, z, R, Hv, Hn):
    """Pressure at the sensor's own point."""
    a = turn(load_matrix(views, QUATERNION_V), load3(params, 0))
    depth = params[SURFACE_P] - views[HEIGHT_V] + a[2] + nuisance[0]
    axis = third_row(views[0], views[1], views[2], views[3])
    gravity = params[GRAVITY_P] if params[GRAVITY_P] > 0.0 else surface_gravity(axis[2] * axis[2])
    if params[DENSITY_P] > 0.0:
        slope = params[DENSITY_P] * gravity
        water = slope * depth
    else:
        water, slope = pressure_of_depth(depth, gravity)
    scale = 1.0 + nuisance[1]
    z[0] = row[2] + scale * water
    Hv[0, POSITION_T + 2] = scale * slope
    Hv[0, ATTITUDE_T], Hv[0, ATTITUDE_T + 1] = scale * slope * a[1], -scale * slope * a[0]
    Hn[0, 0], Hn[0, 1] = scale * slope, water
    R[0, 0] = row[1]
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a sensor of absolute pressure; the row's own atmosphere comes before the configured one."""
    variance, air = config.value("sigma") ** 2, config.value("atmosphere", ATMOSPHERE)
    most = config.value("full_scale", np.inf)
    parameters = np.array([*context.lever(config), context.surface, config.value("density", 0.0), config.value("gravity", 0.0)])

    def read(table: Pressure) -> Reading:
        count = len(table)
        data = np.stack([table.pressure, np.full(count, variance), filled(table.atmosphere, air, count)], axis=1)
        beyond = table.pressure > most
        outcome = np.where(beyond, int(Outcome.OUT_OF_RANGE), int(Outcome.USED))
        return reading(table, finite_rows(0, data, usable(table) & ~beyond), outcome=outcome)

    nuisance = nuisances(config, "datum", 1, "m") + nuisances(config, "scale", 1, "1")
    return Sensor(config, (Channel(("pressure",), predict, parameters, 3, nuisance, linear="scale" not in config.nuisance),), read)


def depth_of_pressures(config: SensorConfig, table: Pressure, context: Context) -> tuple[Array, Array]:
    """Return the depths (n,) of rows of absolute pressure, before any datum, and their sigmas (n,): m; nan beyond the full scale.

    Gravity is that of the origin's latitude, or, without one, of 45 degrees: off by a quarter of a percent at most, which is not in
    the sigma; the prior of the scale is.
    """
    sine2 = 0.5 if context.origin is None else math.sin(context.origin.latitude) ** 2
    gravity, density = config.value("gravity", 0.0) or surface_gravity(sine2), config.value("density", 0.0)
    gauge = table.pressure - filled(table.atmosphere, config.value("atmosphere", ATMOSPHERE), len(table))
    gauge = np.where(table.pressure > config.value("full_scale", np.inf), np.nan, gauge)
    scale, unknown = config.nuisance.get("scale"), 0.0
    if scale is not None:
        gauge, unknown = gauge / (1.0 + float(scale.value[0])), float(scale.sigma[0])
    if density > 0.0:
        depth = gauge / (density * gravity)
    else:
        depth = np.array([depth_of_pressure(pressure, gravity) for pressure in gauge], float)
    slope = density * gravity if density > 0.0 else pressure_of_depth(0.0, gravity)[1]
    return depth, np.hypot(config.value("sigma") / slope, unknown * depth)
