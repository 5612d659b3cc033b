"""Doppler log through the water: as dvl.py, with the velocity over ground less the current (water.py) in place of that over ground.

Nuisances: those of a Doppler log of its own, and last the current 2, which all sensors share that measure against the water.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.core.compiled import SENSOR, kernel
from leadline.models.sensor import Context, Reading, Sensor, reading, shared_nuisances
from leadline.models.sensors.dvl import BEAM_N, beam, doppler_channels, doppler_rows, level, vector
from leadline.models.sensors.water import through_water, write_current

if TYPE_CHECKING:
    from leadline.data.records import WaterVelocity
    from leadline.data.vehicle import SensorConfig

CURRENT_N = 7  # place of the current among the nuisances of a vector; that of a beam stands behind the bias of the beam


@kernel(SENSOR)
def predict_vector(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity through the water in the axes of the sensor."""
    vector(through_water(views, nuisance, CURRENT_N), views, nuisance, row, params, z, R, Hv, Hn)
    for i in range(3):
        write_current(views, nuisance, CURRENT_N, i, Hv, Hn)
    return 0


@kernel(SENSOR)
def predict_level(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity through the water in level axes."""
    level(through_water(views, nuisance, CURRENT_N), views, nuisance, row, params, z, R, Hv, Hn)
    for i in range(3):
        write_current(views, nuisance, CURRENT_N, i, Hv, Hn)
    return 0


@kernel(SENSOR)
def predict_beam(views, nuisance, row, params, z, R, Hv, Hn):
    """Velocity through the water along one beam."""
    beam(through_water(views, nuisance, BEAM_N + 1), views, nuisance, row, params, z, R, Hv, Hn)
    write_current(views, nuisance, BEAM_N + 1, 0, Hv, Hn)
    return 0


def compose(config: SensorConfig, context: Context) -> Sensor:
    """Compose a Doppler log that measures against the water."""
    current = shared_nuisances(context, "water.current", 2, "m/s", "north-east")
    channels = doppler_channels(config, context, (predict_vector, predict_level, predict_beam), current)

    def read(table: WaterVelocity) -> Reading:
        parts, outcome = doppler_rows(config, table)
        return reading(table, *parts, outcome=outcome)

    return Sensor(config, channels, read)
