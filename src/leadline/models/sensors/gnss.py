"""Satellite positions of an antenna: the horizontal channel of position.py, and the height where it is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.models.sensor import Context, Reading, Sensor, filled, finite_rows, reading, usable
from leadline.models.sensors.position import channels, rows_of, sigma_of

if TYPE_CHECKING:
    from leadline.data.records import Gnss
    from leadline.data.vehicle import SensorConfig


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a satellite receiver; rows of `fix_type` "none" are invalid, heights are used only if `vertical` says so."""
    default = (config.value("sigma"), config.value("sigma_vertical", 2.0 * config.value("sigma")))
    vertical = config.value("vertical", False)

    def read(table: Gnss) -> Reading:
        count = len(table)
        good = usable(table) if table.fix_type is None else usable(table) & (table.fix_type != "none")
        sigma = sigma_of(table.sigma_axes, table.sigma, default, count)
        height = filled(table.height, context.surface, count)
        point = geodesy.ecef_from_geodetic(table.latitude, table.longitude, height)
        parts = [finite_rows(0, rows_of(point, sigma[:, :2], np.zeros(count)), good)]
        if vertical and table.height is not None:
            parts.append(finite_rows(1, np.stack([context.surface - table.height, sigma[:, 2] ** 2], axis=1), good))
        return reading(table, *parts)

    return Sensor(config, channels(config, context), read)
