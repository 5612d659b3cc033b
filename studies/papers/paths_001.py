"""The three paths of paper 001 as exact motion, and the instruments of its table II with what it leaves open filled in."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import pi, radians, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from common import UNGATED, Fixes

from leadline.data import records
from leadline.data.vehicle import vehicle_from_toml
from leadline.missions.cell_maker import Case
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.instruments import Attitude, Depth, Dvl, Imu
from leadline.simulate.laws import Path
from leadline.simulate.profiles import Ramp, Sinusoid
from leadline.simulate.trajectory import Place, Trajectory

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator

    from leadline.data.vehicle import Vehicle
    from leadline.simulate.instruments import Instrument

DURATION, RATE, DEPTH = 60.0, 10.0, 10.0
DVL_VARIANCE = (4.46e-4, 4.58e-4, 1.05e-5)  # (m/s)^2, table II
ACCEL_VARIANCE = (1.73e-4 + 1.39e-4 + 3.9e-4) / 3  # (m/s^2)^2: the mean of table II, as an inertial unit has one density
GYRO_SIGMA = 0.005  # rad/s a row, and what follows: assumed (none is published)
HEADING_SIGMA, TILT_SIGMA = radians(1.0), radians(0.2)
SBL_SIGMA = 0.2  # m, each axis
DEPTH_SIGMA = 0.05  # m
START = StartSigmas(position=0.1, depth=0.05, velocity=0.05, tilt=0.005, heading=0.02)
EXACT_PLACE = StartSigmas(position=1e-3, depth=1e-3, velocity=0.05, tilt=0.005, heading=0.02)
EXACT = StartSigmas(position=1e-3, depth=1e-3, velocity=1e-3, tilt=1e-3, heading=1e-3)
PLACE = Place(radians(29.19), radians(-81.05), depth=DEPTH, surface_height=-29.0)
G = 9.80665


@dataclass(frozen=True)
class Course:
    """A path of table III: sine X = t, Y = A sin wt; circle X = A cos wt, Y = A sin wt; straight X = t, Y = 1. X is north, Y east."""

    form: str
    amplitude: float = 0.0
    omega: float = 1.0

    @property
    def trajectory(self) -> Trajectory:
        """The motion, level at its depth, with the heading along the way: atan2(Y', X')."""
        wave = Sinusoid(self.amplitude, 2 * pi / self.omega)
        north = Sinusoid(self.amplitude, 2 * pi / self.omega, pi / 2) if self.form == "circle" else Ramp(0.0, 1.0)
        return Trajectory(PLACE, Path(north, Ramp(1.0) if self.form == "straight" else wave, Ramp()), DURATION)


PATHS: Mapping[str, Course] = {
    "sine": Course("sine", 5.0, 0.2), "circle": Course("circle", 10.0, 2 * pi / 60), "straight": Course("straight"),
}  # fmt: skip
WIDE_SINE = Course("sine", 30.0, 0.25)


@dataclass(frozen=True, kw_only=True)
class TableDvl(Dvl):
    """A Doppler log with the variances of table II, which differ by axis and are stated in each row."""

    axes: tuple[float, float, float] = field(default=tuple(map(sqrt, DVL_VARIANCE)))  # type: ignore[arg-type]

    def noisy(self, table: records.Dvl, generator: Generator) -> records.Dvl:
        """Add white noise."""
        sigma = np.tile(self.axes, (len(table), 1))
        return replace(table, velocity=table.velocity + sigma * generator.standard_normal(sigma.shape), sigma=sigma)


def vehicle(*, gated: bool = True, sbl_sigma: float = SBL_SIGMA) -> Vehicle:
    """Return the vehicle: what is drawn is what it states, if `sbl_sigma` (m) is; `gated`: with the usual gates, else without."""
    gate = "" if gated else UNGATED
    return vehicle_from_toml(f"""
name = "paper-001"
[sensors.imu]
rate_hz = {RATE}
gyro_noise_deg_per_rth = {np.degrees(GYRO_SIGMA / sqrt(RATE)) * 60.0}
gyro_bias_deg_per_h = 0.0
accel_noise_ug_per_rthz = {sqrt(ACCEL_VARIANCE / RATE) / G * 1e6}
accel_bias_ug = 0.0
[sensors.attitude]
rate_hz = {RATE}
sigma_deg = {np.degrees(HEADING_SIGMA)}
sigma_tilt_deg = {np.degrees(TILT_SIGMA)}
{gate}
[sensors.dvl]
rate_hz = {RATE}
sigma_mps = {sqrt(DVL_VARIANCE[0])}
{gate}
[sensors.depth]
rate_hz = 1.0
sigma_m = {DEPTH_SIGMA}
{gate}
[sensors.sbl]
kind = "position_fix"
sigma_m = {sbl_sigma}
sigma_depth_m = {sbl_sigma}
{gate}
""")


def instruments() -> dict[str, Instrument[Any]]:
    """Return the instruments; white noise alone."""
    return {
        "imu": Imu(rate=RATE, gyro_density=GYRO_SIGMA / sqrt(RATE), accel_density=sqrt(ACCEL_VARIANCE / RATE)),
        "attitude": Attitude(rate=RATE, sigma=(TILT_SIGMA, TILT_SIGMA, HEADING_SIGMA)),
        "dvl": TableDvl(rate=RATE),
        "depth": Depth(rate=1.0, sigma=DEPTH_SIGMA),
        "sbl": Fixes(sigma=SBL_SIGMA, sigma_depth=SBL_SIGMA, offset=0.1),
    }


def case(name: str, course: Course, *, start: StartSigmas = START, gated: bool = True, **changed: Instrument[Any]) -> Case:
    """Return the case of a path; changed: instruments in place of the usual ones.  Its name makes its seeds."""
    return Case(Recorder(course.trajectory, {**instruments(), **changed}, start=start, name=name), vehicle(gated=gated))
