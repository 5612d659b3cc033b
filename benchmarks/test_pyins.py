"""Leadline's loop against the feedback filter of pyins 1.0.1 (github.com/nmayorov/pyins), on the same log in the same run.

pyins is on no package index: install it from its repository beside Leadline, else this is skipped.  Both get 100 Hz inertial rows,
a 5 Hz body velocity and a 1 Hz position; 15 states, covariance at every inertial row and, for pyins, also at its default of 10 Hz.
"""

from __future__ import annotations

import time
from math import degrees, radians

import numpy as np
import pytest

from leadline.core import attitude
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import navigator_for, stream_of
from leadline.simulate.dive import StartSigmas, simulate
from leadline.simulate.instruments import Drift, Dvl, Imu, PositionFix
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

pyins = pytest.importorskip("pyins.filters", reason="pyins is not installed (see the top of this file)")

DURATION = 20.0
VEHICLE = """
name = "bench"
[sensors.imu]
gyro_noise_deg_per_rth = 0.1
gyro_bias_deg_per_h = 2.0
accel_noise_ug_per_rthz = 100.0
accel_bias_ug = 500.0
[sensors.dvl]
sigma_mps = 0.01
[sensors.fix]
kind = "position_fix"
sigma_m = 1.0
sigma_depth_m = 1.0
"""


@pytest.fixture(scope="module")
def log():
    """Return twenty seconds of a survey with an inertial unit, a Doppler log and fixes with depth."""
    instruments = {
        "imu": Imu(
            rate=100.0,
            gyro_density=radians(0.1) / 60,
            accel_density=1e-3,
            gyro_bias=Drift(turn_on=radians(2) / 3600),
            accel_bias=Drift(turn_on=5e-3),
        ),
        "dvl": Dvl(rate=5.0, offset=0.105, sigma=0.01),
        "fix": PositionFix(rate=1.0, offset=0.505, sigma=1.0, sigma_depth=1.0),
    }
    plan = Lawnmower(legs=2, length=50.0, spacing=20.0, speed=1.5, heading=0.3, dive=5.0)
    start = StartSigmas(position=1.0, depth=1.0, velocity=0.1, tilt=radians(0.2), heading=radians(1.0))
    place = Place(radians(45.0), radians(10.0), depth=1.0)
    return simulate(survey(place, plan, duration=DURATION), instruments, seed=3, start=start)


def ours(log):
    """Return seconds per inertial row of the loop, stream building left out, and the horizontal error at the end (m)."""
    vehicle = vehicle_from_toml(VEHICLE)
    best = np.inf
    for _ in range(5):
        navigator, _, _ = navigator_for(log, vehicle)
        stream = stream_of(log, vehicle, navigator, rate=0.1)
        began = time.perf_counter()
        results = navigator.run(stream.events, len(stream.times))
        best = min(best, time.perf_counter() - began)
    q = results.output[len(stream.times) - 1, :4]
    c = attitude.matrix_from_quaternion(q)
    return best / len(log["imu"]), np.degrees([np.arcsin(-c[2, 2]), np.arctan2(-c[1, 2], -c[0, 2])])


def theirs(log, time_step):
    """Return the same of pyins."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    imu, initial = log["imu"], log.initial
    frame = pd.DataFrame(
        np.column_stack([imu.gyro * 0.01, imu.accel * 0.01]),
        index=imu.time,
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    increments = strapdown.compute_increments_from_imu(frame, "increment")
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    velocity = [initial.velocity_north, initial.velocity_east, initial.velocity_down]
    angles = [degrees(a) for a in (initial.roll, initial.pitch, initial.heading)]
    pva = pd.Series([degrees(initial.latitude), degrees(initial.longitude), -initial.depth, *velocity, *angles], names, name=imu.time[0])
    fix, dvl = log["fix"], log["dvl"]
    places = pd.DataFrame(np.column_stack([np.degrees(fix.latitude), np.degrees(fix.longitude), -fix.depth]), fix.time, names[:3])
    aiding = [
        measurements.Position(places, 1.0),
        measurements.BodyVelocity(pd.DataFrame(dvl.velocity, dvl.time, ["VX", "VY", "VZ"]), 0.01),
    ]
    gyro = inertial_sensor.EstimationModel(bias_sd=radians(2) / 3600, noise=radians(0.1) / 60)
    accel = inertial_sensor.EstimationModel(bias_sd=5e-3, noise=1e-3)
    began = time.perf_counter()
    found = filters.run_feedback_filter(pva, 1.0, 0.1, 0.2, 1.0, increments, gyro, accel, aiding, time_step=time_step)
    return (time.perf_counter() - began) / len(imu), found.trajectory[["lat", "lon"]].to_numpy()[-1]


@pytest.mark.parametrize("time_step", [0.01, 0.1])
def test_against_pyins(benchmark, log, time_step):
    """The ratio stands in the benchmark's extra information; both end at the same place to a tenth of a sigma."""
    mine, place = ours(log)
    their, their_place = theirs(log, time_step)
    apart = np.abs(place - their_place) * 111e3
    benchmark.extra_info.update(us_per_step=mine * 1e6, pyins_us_per_step=their * 1e6, ratio=their / mine, apart_m=apart.tolist())
    print(f"\nper inertial row: Leadline {mine * 1e6:.2f} us, pyins {their * 1e6:.0f} us, ratio {their / mine:.0f}; ends {apart} m apart")
    benchmark.pedantic(lambda: ours(log), rounds=1)
    assert apart.max() < 0.1
