"""What instruments would have recorded on a trajectory: one frozen class per kind of table, SI and radians.

Each stands in the file of its subject; `instrument.py` says what all have in common.
"""

from __future__ import annotations

from leadline.simulate.acoustics import AcousticRange, beacon_position_e
from leadline.simulate.angles import Attitude, Heading
from leadline.simulate.doppler import Dvl, WaterVelocity, beam_vectors
from leadline.simulate.drift import Drift
from leadline.simulate.gyros import Imu, Triad, YawRate, means
from leadline.simulate.instrument import Digital, Instrument, Vector
from leadline.simulate.logs import Speed
from leadline.simulate.machinery import Machinery, MotorCurrents, ThrusterSpeeds
from leadline.simulate.magnetometer import Magnetometer
from leadline.simulate.positions import Gnss, Navigation, PositionFix, ZeroVelocity, displaced
from leadline.simulate.reception import Reception
from leadline.simulate.surroundings import STILL, Surrounding
from leadline.simulate.vertical import Altimeter, Depth, Pressure
from leadline.simulate.water_instruments import CurrentMeter, SoundProfileCast, SoundSpeedMeter, WaterLevel

__all__ = [
    "STILL",
    "AcousticRange",
    "Altimeter",
    "Attitude",
    "CurrentMeter",
    "Depth",
    "Digital",
    "Drift",
    "Dvl",
    "Gnss",
    "Heading",
    "Imu",
    "Instrument",
    "Machinery",
    "Magnetometer",
    "MotorCurrents",
    "Navigation",
    "PositionFix",
    "Pressure",
    "Reception",
    "SoundProfileCast",
    "SoundSpeedMeter",
    "Speed",
    "Surrounding",
    "ThrusterSpeeds",
    "Triad",
    "Vector",
    "WaterLevel",
    "WaterVelocity",
    "YawRate",
    "ZeroVelocity",
    "beacon_position_e",
    "beam_vectors",
    "displaced",
    "means",
]
