"""Without noise there must be no error: the mechanisation and the filter against analytic truth, over an hour.

A figure of eight at 2 m/s with gentle waves, started exactly, at 60 degrees of latitude, near the pole and across the date line.
The filter is told of small but not of zero noise: sigma 1e-4 m/s of the Doppler log, 1 mm of depth, and a gyro and an accelerometer
far better than any (1e-4 deg/sqrt(h), 1 ug/sqrt(Hz)), so that no measurement is ignored and none is trusted blindly.  The IMU is the
body's origin: from another point its speed at the start would be known only as well as the first angular rate.
"""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest

from leadline.assess.errors import errors_of
from leadline.data.records import Depth
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.bound import ideal_log
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Weave, figure_eight, straight
from leadline.simulate.trajectory import Place

HOUR = 3600.0
SURE = StartSigmas(position=1e-3, depth=1e-3, velocity=1e-4, tilt=1e-5, heading=1e-5)
PLACES = {"60 degrees": (60.0, 10.0), "89.9 degrees": (89.9, 10.0), "date line": (60.0, 179.999)}
# the first leg leads north-east, and crosses 180 degrees within a minute

IMU = """
name = "exact"
[sensors.imu]
rate_hz = {rate}
gyro_noise_deg_per_rth = 1e-4
gyro_bias_deg_per_h = 1e-4
accel_noise_ug_per_rthz = 1.0
accel_bias_ug = 1.0
"""
AIDS = """
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 1e-4
lever_arm_m = [-0.6, 0.1, 0.3]
mounting_deg = [0.0, 0.0, 45.0]
[sensors.depth]
rate_hz = 10.0
sigma_m = 1e-3
lever_arm_m = [0.7, 0.0, -0.1]
"""


def vehicle(rate=100.0, aids=""):
    return vehicle_from_toml(IMU.format(rate=rate) + aids)


@cache
def recorded(place, sample="mean", dvl_offset=0.005):
    """The ideal log of an hour at a place; truth every 10 s."""
    latitude, longitude = PLACES[place]
    start = Place(radians(latitude), radians(longitude), depth=20.0, surface_height=10.0)
    trajectory = figure_eight(start, HOUR, speed=2.0, length=400.0, width=150.0)
    made = instruments_of(vehicle(aids=AIDS))
    made |= {"imu": replace(made["imu"], sample=sample), "dvl": replace(made["dvl"], offset=dvl_offset)}
    return ideal_log(Recorder(trajectory, made, truth_rate=0.1, start=SURE))


def errors(log, used):
    """True minus estimated (times, 9)."""
    return errors_of(solve(log, used, times=log.truth.time), log.truth).error


def horizontal(error):
    return float(np.hypot(error[:, 0], error[:, 1]).max())


def test_the_date_line_is_crossed():
    longitude = recorded("date line").truth.longitude
    assert longitude.min() < -3.0
    assert longitude.max() > 3.0


@pytest.mark.parametrize("place", PLACES)
def test_aided_by_exact_velocity_and_depth_at_most_a_millimetre_in_an_hour(place):
    """Asked: 1 mm.  The Doppler log pings in the middle of an IMU interval, whose mean rate is then that of the moment."""
    error = errors(recorded(place), vehicle(aids=AIDS))
    assert horizontal(error) < 1e-3
    assert np.abs(error[:, 2]).max() < 1e-3


def test_a_ping_at_the_end_of_an_interval_sees_the_rate_half_an_interval_late():
    """The lever arm (0.7 m) turns the lag of 5 ms into residuals of 0.1 mm/s, and these into 2 mm in an hour at most."""
    assert horizontal(errors(recorded("60 degrees", dvl_offset=0.2), vehicle(aids=AIDS))) < 2e-3


def test_a_measurement_at_the_very_start_sees_the_rate():
    log = recorded("60 degrees", dvl_offset=0.0)
    looked = solve(log, vehicle(aids=AIDS), times=np.array([0.0]), end=10.0).innovations
    first = (looked.sensor == "dvl") & (looked.time == 0.0)
    assert first.sum() == 3
    assert np.abs(looked.residual[first]).max() < 3e-4


@pytest.mark.parametrize("sample", ["mean", "increment"])
@pytest.mark.parametrize("place", PLACES)
def test_free_inertial_at_most_a_metre_in_an_hour(place, sample):
    """Asked: 1 m, horizontally; the vertical channel is unstable by nature (e-folding time 10 minutes), and stays below 1 cm here."""
    error = errors(recorded(place, sample), vehicle())
    assert horizontal(error) < 1.0
    assert horizontal(error) < 1e-3  # what it can
    assert np.abs(error[:, 2]).max() < 1e-2
    assert np.abs(error[:, 6:]).max() < 1e-9


LIVELY = Weave(
    roll=(0.25, 1.9), pitch=(0.15, 1.3), heading=(0.3, 2.9), forward=(0.3, 1.7), starboard=(0.3, 1.1), down=(0.3, 1.3)
)  # coning and sculling far beyond what a vehicle does, so that errors stand clear of rounding


def sizes(sample, rate):
    """Position, velocity and attitude error (3,) after a lively minute."""
    trajectory = straight(Place(radians(60.0), radians(10.0), 20.0), 60.0, speed=2.0, weave=LIVELY)
    imu = replace(instruments_of(vehicle(rate))["imu"], sample=sample)
    last = errors(ideal_log(Recorder(trajectory, {"imu": imu}, truth_rate=0.1, start=SURE)), vehicle(rate))[-1]
    return np.linalg.norm(last.reshape(3, 3), axis=1)


@pytest.mark.parametrize(("sample", "order"), [("mean", 3), ("increment", 3), ("instant", 2)])
def test_order_of_convergence(sample, order):
    """Means and increments carry the integral: third order with coning and sculling terms.  Instants are joined by lines: second."""
    coarse, middle, fine = (sizes(sample, rate) for rate in (25.0, 50.0, 100.0))
    for ratio in (coarse / middle, middle / fine):
        assert np.all(np.abs(np.log2(ratio) - order) < 0.25), ratio


def test_a_measurement_inside_an_interval_changes_nothing():
    """Depths of no weight (sigma 1e9 m) split every tenth interval: the two halves compose to the whole.

    Attitude does so exactly and velocity to 1e-9; position is the trapezoid of velocity, which a split refines (0.5 um in 10 minutes).
    """
    log = recorded("60 degrees")
    time = np.arange(0.0137, 599.9, 0.1)
    blind = replace(log, tables={**log.tables, "depth": Depth(time=time, depth=np.full(len(time), 20.0))})
    weightless = vehicle_from_toml(IMU.format(rate=100.0) + "[sensors.depth]\nsigma_m = 1e9\n")
    times = np.arange(0.0, 600.0, 10.0)
    whole, split = (solve(each, used, times=times) for each, used in ((log, vehicle()), (blind, weightless)))
    assert np.abs(whole.quaternion_nb - split.quaternion_nb).max() < 1e-12
    assert np.abs(whole.velocity_n - split.velocity_n).max() < 5e-9
    assert np.abs(whole.position_n - split.position_n).max() < 1e-6


def test_a_run_whose_output_is_asked_for_more_often_is_the_same():
    log = recorded("60 degrees")
    once, often = (solve(log, vehicle(), times=times, end=60.0) for times in (np.array([60.0]), np.linspace(0.0, 60.0, 7777)))
    assert np.array_equal(once.velocity_n[-1], often.velocity_n[-1])
    assert once.latitude[-1] == often.latitude[-1]
