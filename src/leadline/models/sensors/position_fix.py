"""Positions solved elsewhere (USBL, LBL, SBL, landmark): the horizontal channel of position.py, and the depth that comes with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.data.outcome import Outcome
from leadline.models.sensor import Context, Reading, Sensor, filled, finite_rows, reading, usable
from leadline.models.sensors.position import channels, rows_of, sigma_of

if TYPE_CHECKING:
    from leadline.data.records import PositionFix
    from leadline.data.vehicle import SensorConfig


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose positions solved elsewhere; a depth that comes with them is used unless `vertical` says no."""
    default = (config.value("sigma"), config.value("sigma_depth", config.value("sigma")))
    vertical = config.value("vertical", True)

    def read(table: PositionFix) -> Reading:
        count = len(table)
        sigma = sigma_of(table.sigma_axes, table.sigma, default, count)
        if table.latitude is not None and table.longitude is not None:
            latitude, longitude = table.latitude, table.longitude
        else:
            latitude, longitude = context.geographic(np.asarray(table.north), np.asarray(table.east), config.name)
        point = context.position_e(latitude, longitude, filled(table.depth, 0.0, count))
        covariance = filled(table.cov_north_east, 0.0, count)
        good = usable(table) & ~(np.abs(covariance) >= sigma[:, 0] * sigma[:, 1])  # what is not positive definite is no covariance
        parts = [finite_rows(0, rows_of(point, sigma[:, :2], covariance), good)]
        if vertical and table.depth is not None:
            parts.append(finite_rows(1, np.stack([table.depth, sigma[:, 2] ** 2], axis=1), good))
        outcome = np.where(np.abs(latitude) > np.pi / 2, int(Outcome.INVALID), int(Outcome.USED))
        return reading(table, *parts, outcome=outcome)

    return Sensor(config, channels(config, context), read)
