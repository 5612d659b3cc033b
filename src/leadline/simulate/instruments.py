"""What instruments would have recorded on a trajectory: one frozen class per kind of table, SI and radians.

Each stands in the file of its subject; `instrument.py` says what all have in common.
"""

from __future__ import annotations

from leadline.simulate.acoustics import AcousticRange, beacon_position_e
from leadline.simulate.angles import Attitude, Heading
from leadline.simulate.gyros import Imu, means
from leadline.simulate.instrument import Drift, Instrument, Vector
from leadline.simulate.logs import Dvl, beam_vectors
from leadline.simulate.positions import Gnss, PositionFix, ZeroVelocity, displaced
from leadline.simulate.vertical import Depth

__all__ = [
    "AcousticRange",
    "Attitude",
    "Depth",
    "Drift",
    "Dvl",
    "Gnss",
    "Heading",
    "Imu",
    "Instrument",
    "PositionFix",
    "Vector",
    "ZeroVelocity",
    "beacon_position_e",
    "beam_vectors",
    "displaced",
    "means",
]
