"""Where a run starts from when [initial] does not say: the geometry of mountings and lever arms, and rows that must not be believed."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline.core.attitude import euler_from_quaternion, matrix_from_euler, matrix_from_quaternion, quaternion_from_matrix
from leadline.core.geodesy import ecef_from_geodetic, rotation_en
from leadline.data.errors import InputError
from leadline.data.log import Initial, Log
from leadline.data.outcome import Outcome
from leadline.data.records import Attitude, Depth, Gnss, Heading, Imu
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import navigator_for, solve
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import Gnss as Receiver
from leadline.simulate.instruments import Imu as Inertial
from leadline.simulate.plans import still
from leadline.simulate.trajectory import Place

VEHICLE = """
name = "starts"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.depth]
sigma_m = 0.02
lever_arm_m = [0.0, 0.0, -1.0]
[sensors.heading]
sigma_deg = 1.0
mounting_deg = [0.0, 0.0, 90.0]
[sensors.attitude]
sigma_deg = 1.0
sigma_tilt_deg = 0.2
mounting_deg = [180.0, 0.0, 30.0]
[sensors.gnss]
sigma_m = 1.0
lever_arm_m = [2.0, -1.0, -3.0]
"""
ROLL, PITCH, HEADING = radians(4.0), radians(-7.0), radians(70.0)
TRAJECTORY = still(Place(radians(40.0), radians(15.0), depth=5.0), 30.0, heading=HEADING, pitch=PITCH, roll=ROLL)


@pytest.fixture(scope="module")
def quay():
    """A vehicle at rest, heeled and trimmed: inertial rows, and a GNSS antenna at the end of a lever arm."""
    instruments = {"imu": Inertial(rate=50.0), "gnss": Receiver(rate=1.0, lever_arm_b=(2.0, -1.0, -3.0), max_depth=100.0)}
    log = simulate(TRAJECTORY, instruments, seed=1)
    return replace(log, initial=Initial(time=1.0))


def with_rows(log, **tables):
    return replace(log, tables={**log.tables, **tables})


def started(log, *names):
    return navigator_for(log, vehicle_from_toml(VEHICLE).only("imu", *names))[1]


def angles(start):
    return np.array(euler_from_quaternion(start.quaternion_nb))


def test_levelling_and_a_turned_compass(quay):
    """Roll and pitch by the direction of gravity; a compass mounted across the hull says its own heading, not the vehicle's."""
    start = started(with_rows(quay, heading=Heading(time=[2.0], heading=[HEADING + radians(90.0)])), "heading", "gnss")
    np.testing.assert_allclose(angles(start), [ROLL, PITCH, HEADING], atol=2e-5)
    assert start.sigma_heading == pytest.approx(radians(2.0))


@pytest.mark.parametrize("form", ["angles", "quaternion"])
def test_an_ahrs_upside_down(quay, form):
    """An AHRS mounted on its head gives the attitude of the body, by angles or quaternion."""
    sensor = matrix_from_euler(ROLL, PITCH, HEADING) @ matrix_from_euler(radians(180.0), 0.0, radians(30.0))
    quaternion = quaternion_from_matrix(sensor)[None]
    roll, pitch, heading = euler_from_quaternion(quaternion)
    table = (
        Attitude(time=[2.0], quaternion=quaternion)
        if form == "quaternion"
        else Attitude(time=[2.0], roll=roll, pitch=pitch, heading=heading)
    )
    start = started(with_rows(quay, attitude=table), "attitude", "gnss")
    np.testing.assert_allclose(angles(start), [ROLL, PITCH, HEADING], atol=1e-9)


def test_depth_and_fix_at_the_end_of_a_lever_arm(quay):
    """The start is the body origin: what a sensor says of its own place is brought there."""
    rotation = matrix_from_euler(ROLL, PITCH, HEADING)
    depth = Depth(time=[1.5], depth=[5.0 + (rotation @ [0.0, 0.0, -1.0])[2]])
    log = with_rows(quay, depth=depth, heading=Heading(time=[2.0], heading=[HEADING + radians(90.0)]))
    start = started(log, "depth", "heading", "gnss")
    assert start.height == pytest.approx(-5.0, abs=1e-4)
    truth = ecef_from_geodetic(TRAJECTORY.place.latitude, TRAJECTORY.place.longitude, -5.0)
    found = ecef_from_geodetic(start.latitude, start.longitude, start.height)
    apart = rotation_en(start.latitude, start.longitude).T @ (found - truth)
    assert np.abs(apart[:2]).max() < 1e-3


def test_a_fix_that_is_none_is_no_start(quay):
    """Rows of fix type none stand at 0, 0; the start is the first real fix."""
    gnss = quay["gnss"]
    kind = np.where(gnss.time < 3.0, "none", "single")
    lost = Gnss(time=gnss.time, latitude=np.where(kind == "none", 0.0, gnss.latitude), longitude=gnss.longitude, fix_type=kind)
    start = started(with_rows(quay, gnss=lost, heading=Heading(time=[2.0], heading=[HEADING])), "heading", "gnss")
    assert start.latitude == pytest.approx(radians(40.0), abs=1e-6)


def test_a_start_before_the_first_inertial_row_is_no_nan(quay):
    imu = quay["imu"]
    log = with_rows(quay, imu=imu.select(imu.time > 4.0), heading=Heading(time=[2.0], heading=[HEADING]))
    assert np.isfinite(angles(started(log, "heading", "gnss"))).all()


@pytest.mark.parametrize(("missing", "words"), [("heading", "says no heading"), ("gnss", "says no position")])
def test_what_cannot_be_known_is_said(quay, missing, words):
    log = with_rows(quay, heading=Heading(time=[2.0], heading=[0.0]))
    names = [name for name in ("heading", "gnss") if name != missing]
    with pytest.raises(InputError, match=words):
        started(log, *names)


def test_a_log_of_which_the_vehicle_names_nothing():
    with pytest.raises(InputError, match="says no time"):
        navigator_for(Log("empty", {}), vehicle_from_toml(VEHICLE))


def resting(quay):
    return replace(quay, initial=Initial(time=1.0, latitude=0.7, longitude=0.3, depth=5.0, roll=ROLL, pitch=PITCH, heading=HEADING))


def test_one_inertial_stamp_far_ahead_does_not_lead_the_run_astray(quay):
    """A last row beyond a gap is not believed: the run ends where its inertial rows end."""
    imu = quay["imu"]
    time = imu.time.copy()
    time[700] += 1000.0
    log = with_rows(resting(quay), imu=Imu(time=time, accel=imu.accel, gyro=imu.gyro))
    solution = solve(log, vehicle_from_toml(VEHICLE).only("imu", "gnss"), rate=1.0)
    assert solution.time[-1] == pytest.approx(imu.time[-1])
    assert solution.summary["counts"]["imu"] == {"used": len(imu) - 1, "invalid": 1}


def test_inertial_rows_that_the_sensor_calls_invalid_and_duplicates(quay):
    imu = quay["imu"]
    valid, gyro = np.ones(len(imu)), imu.gyro.copy()
    valid[700:710], gyro[700:710] = 0.0, 5.0
    twice = np.sort(np.concatenate([np.arange(len(imu)), [300, 301]]))
    log = with_rows(resting(quay), imu=Imu(time=imu.time, accel=imu.accel, gyro=gyro, valid=valid).select(twice))
    solution = solve(log, vehicle_from_toml(VEHICLE).only("imu", "gnss"), rate=1.0)
    assert solution.summary["counts"]["imu"] == {"used": len(imu) - 10, "invalid": 10, "duplicate": 2}
    tilt = matrix_from_quaternion(solution.quaternion_nb[-1]).T @ matrix_from_euler(ROLL, PITCH, HEADING)
    assert np.abs(tilt - np.eye(3)).max() < 0.2  # the gap opens sigma, ten rows of 5 rad/s would have turned it right round


def test_a_late_row_is_judged_by_its_time_of_validity(quay):
    """A latency of 8 s makes a row of 5 s ago 13 s old: older than a window of 10 s."""
    vehicle = vehicle_from_toml(VEHICLE.replace("[sensors.depth]", "[sensors.depth]\nlatency_s = 8.0")).only("imu", "depth")
    navigator, _, _ = navigator_for(resting(quay), vehicle, window=10.0)
    navigator.add("imu", quay["imu"])
    before = navigator.state.copy()
    assert navigator.add("depth", Depth(time=[25.0], depth=[9.0])).tolist() == [Outcome.LATE]
    np.testing.assert_array_equal(navigator.state, before)
    assert navigator.add("depth", Depth(time=[29.0], depth=[4.0])).tolist() == [Outcome.USED]


def test_a_row_under_a_wrong_name_is_refused(quay):
    navigator, _, _ = navigator_for(resting(quay), vehicle_from_toml(VEHICLE).only("imu", "depth"))
    for name, words in (("banana", "has no sensor 'banana'"), ("depth", "was handed rows of kind 'imu'")):
        with pytest.raises(InputError, match=words):
            navigator.add(name, quay["imu"].select(slice(0, 1)))
