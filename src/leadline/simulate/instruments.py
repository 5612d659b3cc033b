"""What instruments would have recorded on a trajectory: one frozen class per kind of table, SI and radians.

Each stands in the file of its subject; `instrument.py` says what all have in common.
"""

from __future__ import annotations

from leadline.simulate.acoustics import AcousticRange, beacon_position_e
from leadline.simulate.angles import Attitude, Heading
from leadline.simulate.drift import Drift
from leadline.simulate.gyros import Imu, YawRate, means
from leadline.simulate.instrument import Instrument, Vector
from leadline.simulate.logs import Dvl, Speed, WaterVelocity, beam_vectors
from leadline.simulate.positions import Gnss, Navigation, PositionFix, ZeroVelocity, displaced
from leadline.simulate.surroundings import STILL, Surrounding
from leadline.simulate.vertical import Altimeter, Depth, Pressure

__all__ = [
    "STILL",
    "AcousticRange",
    "Altimeter",
    "Attitude",
    "Depth",
    "Drift",
    "Dvl",
    "Gnss",
    "Heading",
    "Imu",
    "Instrument",
    "Navigation",
    "PositionFix",
    "Pressure",
    "Speed",
    "Surrounding",
    "Vector",
    "WaterVelocity",
    "YawRate",
    "ZeroVelocity",
    "beacon_position_e",
    "beam_vectors",
    "displaced",
    "means",
]
