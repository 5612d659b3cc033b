"""Satellite positions and velocities of an antenna: the channels of position.py, depth.py and dvl.py, while it is out of the water.

With `surface_depth` a row is out of range where the antenna is predicted deeper than that: what a receiver says then is no fix.
Parameters of each channel: those of its own kernel, then what the antenna's depth is made of (lever_arm_b 3, surface) and that limit.
Nuisance: bias 2 of the position (m).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.core.compiled import SENSOR, kernel
from leadline.core.rotation import load3, load_matrix, turn
from leadline.models.nuisance import Nuisance
from leadline.models.sensor import Channel, Context, Reading, Sensor, filled, finite_rows, reading, sigmas, usable
from leadline.models.sensors import depth, dvl, position
from leadline.models.sensors.position import ROW, bias_of, rows_of, sigma_of
from leadline.models.view import HEIGHT_V, QUATERNION_V, RATE, VELOCITY

if TYPE_CHECKING:
    from leadline.data.records import Array, Gnss
    from leadline.data.vehicle import SensorConfig

POSITION_P, HEIGHT_P, VELOCITY_P = 3, 4, 13  # where the parameters of the kernels that are called end
FIX_TYPES = ("single", "dgps", "float", "fixed")


@kernel()
def submerged(views, params, at):
    """Whether the antenna is deeper than the limit; lever arm, surface and limit stand from place `at`."""
    a = turn(load_matrix(views, QUATERNION_V), load3(params, at))
    return params[at + 3] - views[HEIGHT_V] + a[2] > params[at + 4]


@kernel(SENSOR)
def predict_position(views, nuisance, row, params, z, R, Hv, Hn):
    """Horizontal position of the antenna."""
    if submerged(views, params, POSITION_P):
        return 3
    return position.predict(views, nuisance, row, params, z, R, Hv, Hn)


@kernel(SENSOR)
def predict_height(views, nuisance, row, params, z, R, Hv, Hn):
    """Height of the antenna, as a depth."""
    if submerged(views, params, HEIGHT_P):
        return 3
    return depth.predict(views, nuisance, row, params, z, R, Hv, Hn)


@kernel(SENSOR)
def predict_velocity(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity of the antenna, north, east, down."""
    if submerged(views, params, VELOCITY_P):
        return 3
    return dvl.predict_level(views, nuisance, row, params, z, R, Hv, Hn)


def channels_of(config: SensorConfig, context: Context) -> tuple[Channel, ...]:
    """Return the channels of position, height and velocity."""
    lever = context.lever(config)
    dry = [*lever, context.surface, config.value("surface_depth", np.inf)]
    none = (Nuisance(f"{config.name}.none"),)
    moving = np.array([*np.eye(3).ravel(), *lever, 1.0, *dry])
    down = np.array([*lever, context.surface, *dry])
    names = ("velocity_north", "velocity_east", "velocity_down")
    return (
        Channel(("north", "east"), predict_position, np.array([*lever, *dry]), ROW, bias_of(config), linear=True, bounds_drift=True),
        Channel(("down",), predict_height, down, 2, none, linear=True),
        Channel(names, predict_velocity, moving, 9, none, requires=frozenset({VELOCITY, RATE}), linear=True, bounds_drift=True),
    )


def horizontal_sigma(config: SensorConfig, table: Gnss) -> Array:
    """Return sigma (n,) of north and east where the row states none: by its hdop, else by its type of fix, else the general one."""
    count = len(table)
    found = np.full(count, config.value("sigma"))
    for name in FIX_TYPES if table.fix_type is not None else ():
        found = np.where(table.fix_type == name, config.value(f"sigma_{name}", config.value("sigma")), found)
    per_hdop = config.values.get("sigma_per_hdop")
    if per_hdop is not None and table.hdop is not None:
        found = np.where(table.hdop > 0.0, per_hdop * table.hdop, found)
    return found


def sigma_axes(config: SensorConfig, table: Gnss) -> Array:
    """Return sigma north, east and down (n, 3) of the positions; down is by default twice that of north."""
    own = horizontal_sigma(config, table)
    down = filled(None, config.value("sigma_vertical", np.nan), len(table))
    default = np.stack([own, own, np.where(np.isfinite(down), down, 2.0 * own)], axis=1)
    stated = sigma_of(table.sigma_axes, table.sigma, (np.inf, np.inf), len(table))  # infinite where the row says nothing
    return np.where(np.isinf(stated), default, stated)


def velocity_rows(config: SensorConfig, table: Gnss) -> Array | None:
    """Return the rows of velocity (n, 9), or None where there are none; without a sigma, the row's or the configured, they are nan."""
    if table.velocity is None:
        return None
    sigma = sigmas(table.sigma_velocity, config.value("sigma_velocity", np.nan), len(table))
    return np.column_stack([table.velocity, np.tile((sigma**2)[:, None], 3), np.zeros((len(table), 3))])


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a satellite receiver; rows of `fix_type` "none" are invalid, heights are used only if `vertical` says so."""
    vertical = config.value("vertical", False)

    def read(table: Gnss) -> Reading:
        count = len(table)
        good = usable(table) if table.fix_type is None else usable(table) & (table.fix_type != "none")
        sigma, height = sigma_axes(config, table), filled(table.height, context.surface, count)
        point = geodesy.ecef_from_geodetic(table.latitude, table.longitude, height)
        parts = [finite_rows(0, rows_of(point, sigma[:, :2], np.zeros(count)), good)]
        if vertical and table.height is not None:
            parts.append(finite_rows(1, np.stack([context.surface - table.height, sigma[:, 2] ** 2], axis=1), good))
        if (moving := velocity_rows(config, table)) is not None:
            parts.append(finite_rows(2, moving, good))
        return reading(table, *parts)

    return Sensor(config, channels_of(config, context), read)
