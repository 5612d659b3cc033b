"""Instruments against witnesses: finite differences of Earth-fixed points, composition of increments, equations, statistics of noise."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from math import cos, pi, radians, sin
from typing import Any

import gsw
import numpy as np
import pymap3d
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pyproj import Geod
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from leadline.data.errors import InputError
from leadline.data.log import Beacon, Log
from leadline.data.records import Table
from leadline.simulate.dive import Recorder, StartSigmas, simulate
from leadline.simulate.instruments import (
    AcousticRange,
    Altimeter,
    Attitude,
    Depth,
    Drift,
    Dvl,
    Gnss,
    Heading,
    Imu,
    Instrument,
    Navigation,
    PositionFix,
    Pressure,
    Speed,
    Surrounding,
    WaterVelocity,
    YawRate,
    ZeroVelocity,
    means,
)
from leadline.simulate.plans import Lawnmower, Weave, circle, still, straight, survey
from leadline.simulate.trajectory import Place, Trajectory

EARTH_RATE = 7.292115e-5
ROUGH = Weave((0.3, 6.1), (0.2, 7.3), (0.1, 9.0), (0.4, 11.0), (0.3, 5.0), (0.2, 4.0))
MIDDLE = Place(radians(32.8), radians(34.9), 15.0, 17.0)
POLE = Place(radians(89.9), radians(179.9999), 30.0, 12.0)
STENCIL = np.array([-1 / 60, 3 / 20, -3 / 4, 0.0, 3 / 4, -3 / 20, 1 / 60])  # central, sixth order
ARM = (0.7, -0.4, 0.3)
TURNED = (0.05, -0.1, 0.8)
ROTATION_BS = Rotation.from_euler("ZYX", TURNED[::-1]).as_matrix()
JANUS = (radians(45), radians(135), radians(225), radians(315))


@pytest.fixture(scope="module", params=[MIDDLE, POLE], ids=["middle", "pole"])
def rough(request: pytest.FixtureRequest) -> Trajectory:
    return survey(request.param, Lawnmower(legs=2, length=40.0, spacing=15.0, dive=12.0, surface_time=5.0), weave=ROUGH)


def quiet(instrument: Instrument[Any], trajectory: Trajectory, duration: float | None = None) -> Any:
    return simulate(trajectory, {"it": instrument}, duration=duration)["it"]


def assert_spread(values: np.ndarray, sigma: float) -> None:
    """Independent normal values have this sigma: chi-square, 99.9 %."""
    low, high = chi2.ppf([0.0005, 0.9995], values.size)
    assert low < np.sum((values / sigma) ** 2) < high


def inertial(trajectory: Trajectory, time: np.ndarray | float) -> Rotation:
    """Rotation from body to an inertial frame, by way of ECEF."""
    state = trajectory.at(time)
    return Rotation.from_rotvec(state.time[:, None] * [0.0, 0.0, EARTH_RATE]) * Rotation.from_matrix(state.rotation_eb)


# IMU


def test_five_quadrature_points_are_enough(rough: Trajectory) -> None:
    end = np.linspace(1.0, 90.0, 300)
    for five, nine in zip(means(rough, end - 0.01, end, ARM, 5), means(rough, end - 0.01, end, ARM, 9), strict=True):
        assert_allclose(five, nine, atol=2e-13, rtol=0)
    for five, nine in zip(means(rough, end - 0.1, end, ARM, 5), means(rough, end - 0.1, end, ARM, 9), strict=True):
        assert_allclose(five, nine, atol=1e-9, rtol=0)  # a joint of two smooth steps lies in one of these


def test_angle_increments_compose_to_the_attitude(rough: Trajectory) -> None:
    table = quiet(Imu(rate=200.0, sample="increment", mounting_bs=TURNED), rough, 60.0)
    angle = table.delta_angle @ ROTATION_BS.T
    vector = angle[1:] + np.cross(angle[:-1], angle[1:]) / 12  # coning, two samples (Savage, 1998): the rotation vector to dt^5
    total = inertial(rough, 0.0)[0]
    for step in Rotation.from_rotvec(vector):
        total = total * step
    assert (total.inv() * inertial(rough, 60.0)[0]).magnitude() < 1e-8


def test_velocity_increments_are_the_body_frame_integral_of_specific_force(rough: Trajectory) -> None:
    table = quiet(Imu(rate=50.0, sample="increment", lever_arm_b=ARM, mounting_bs=TURNED), rough, 30.0)
    for row in (0, 10, 777):
        inside = table.time[row] - table.interval[row] * (1 - (np.arange(2000) + 0.5) / 2000)
        force = rough.at(inside).point(ARM).specific_force_b @ ROTATION_BS
        assert_allclose(table.delta_velocity[row], np.sum(force, axis=0) * 0.02 / 2000, atol=1e-9)
    assert_allclose(table.interval, 0.02, atol=1e-12)


def test_mean_instant_and_increment_agree(rough: Trajectory) -> None:
    mean, instant, increment = (quiet(Imu(rate=100.0, sample=s, lever_arm_b=ARM), rough, 20.0) for s in ("mean", "instant", "increment"))
    assert_allclose(increment.delta_angle / increment.interval[:, None], mean.gyro, atol=1e-12)
    assert_allclose(increment.delta_velocity / increment.interval[:, None], mean.accel, atol=1e-10)
    # a mean over (previous, time] is the value in its middle, but for the curvature
    assert_allclose(0.5 * (instant.gyro[:-1] + instant.gyro[1:]), mean.gyro[1:], atol=2e-5)
    assert np.max(np.abs(instant.gyro - mean.gyro)) > 1e-4
    assert (mean.sample, instant.sample) == ("mean", "instant")


def test_imu_feels_the_acceleration_of_its_own_point(rough: Trajectory) -> None:
    """Difference of two IMUs = R^T of the second derivative of the arm between them: from ECEF positions alone."""
    time = np.linspace(6.0, 80.0, 30)
    apart = [inertial(rough, time + k * 0.02).apply(ARM) for k in (-2, -1, 0, 1, 2)]
    second = sum(w * a for w, a in zip((-1 / 12, 4 / 3, -5 / 2, 4 / 3, -1 / 12), apart, strict=True)) / 0.02**2
    here, there = rough.at(time), rough.at(time).point(ARM)
    expected = inertial(rough, time).inv().apply(second)
    assert_allclose(there.specific_force_b - here.specific_force_b, expected, atol=3e-6)  # gravity gradient: 3e-6 per metre


def test_white_noise_has_its_density_at_every_rate() -> None:
    trajectory = still(MIDDLE, 200.0)
    for rate, sample in ((100.0, "mean"), (50.0, "increment"), (25.0, "instant")):
        imu = Imu(rate=rate, sample=sample, gyro_density=1e-4, accel_density=2e-3)
        noisy, clean = (quiet(i, trajectory) for i in (imu, replace(imu, gyro_density=0.0, accel_density=0.0)))
        scale = 1.0 if sample != "increment" else 1 / rate
        names = ("gyro", "accel") if sample != "increment" else ("delta_angle", "delta_velocity")
        for name, density in zip(names, (1e-4, 2e-3), strict=True):
            error = (getattr(noisy, name) - getattr(clean, name)) / scale
            assert_spread(error, density * np.sqrt(rate))
            seconds = error[1:].reshape(200, int(rate), 3).mean(axis=1)
            assert_spread(seconds, density)  # the mean over one second has sigma = density
            assert kstest(error.ravel() / density / np.sqrt(rate), "norm").pvalue > 1e-3


# Drift


def test_gauss_markov_has_its_sigma_and_its_time_constant() -> None:
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(0.0, 4000.0, 400))
    time[[100, 200, 300]] = 500.0, 550.0, 3000.0
    time = np.sort(time)
    error = Drift(steady=2.0, tau=50.0).draw(time, 2000, rng)
    first, last = np.searchsorted(time, [500.0, 550.0])
    for row in (0, first, last, -1):
        assert_spread(error[row], 2.0)
    assert np.mean(error[first] * error[last]) / 4 == pytest.approx(np.exp(-1), abs=4 / np.sqrt(2000))
    step = error[first + 1] - np.exp(-(time[first + 1] - time[first]) / 50) * error[first]
    assert_spread(step, 2.0 * np.sqrt(1 - np.exp(-2 * (time[first + 1] - time[first]) / 50)))


@pytest.mark.parametrize("tau", [0.003, 0.7, 20.0, 1e7])
def test_gauss_markov_is_the_plain_recursion(tau: float) -> None:
    time = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.3, 900))
    drawn = Drift(steady=1.0, tau=tau).draw(time, 2, np.random.default_rng(5))
    rng = np.random.default_rng(5)
    rng.standard_normal(2)  # turn-on
    normal = rng.standard_normal((900, 2))
    expected = [normal[0]]
    for gap, w in zip(np.diff(time), normal[1:], strict=True):
        keep = np.exp(-gap / tau)
        expected.append(keep * expected[-1] + np.sqrt(-np.expm1(-2 * gap / tau)) * w)
    assert_allclose(drawn, expected, atol=1e-11)


def test_random_walk_turn_on_and_constant() -> None:
    time = np.arange(0.0, 101.0)
    walk = Drift(walk=0.3).draw(time, 1000, np.random.default_rng(2))
    assert_array_equal(walk[0], 0.0)
    assert_spread(walk[-1], 0.3 * 10)
    fixed = Drift(turn_on=0.2, constant=(1.0,) * 1000).draw(time, 1000, np.random.default_rng(2))
    assert_spread(fixed[0] - 1.0, 0.2)
    assert_array_equal(fixed, np.broadcast_to(fixed[0], fixed.shape))
    assert_array_equal(Drift().draw(time, 3, np.random.default_rng(2)), 0.0)


# DVL


def test_dvl_is_the_velocity_of_the_transducer_over_ground(rough: Trajectory) -> None:
    dvl = Dvl(rate=1.0, offset=1.0, lever_arm_b=ARM, mounting_bs=TURNED, output="both", azimuths=JANUS, tilt=radians(30))
    table = quiet(dvl, rough, 80.0)
    places = [rough.at(table.time + k * 0.05) for k in range(-3, 4)]
    points = [s.position_e + s.rotation_eb @ np.asarray(ARM) for s in places]
    velocity_e = sum(w * (p - points[3]) for w, p in zip(STENCIL, points, strict=True)) / 0.05
    velocity_s = np.einsum("kji,kj->ki", places[3].rotation_eb @ ROTATION_BS, velocity_e)
    assert_allclose(table.velocity, velocity_s, atol=5e-8)  # rounding of ECEF, 1e-9 m, over 0.05 s
    for k, azimuth in enumerate(JANUS):
        beam_s = np.array([0.5 * cos(azimuth), 0.5 * sin(azimuth), cos(radians(30))])
        # the slant range to a fixed far point along the outward beam shrinks at the beam velocity
        far = points[3] + 1e5 * np.einsum("kij,j->ki", places[3].rotation_eb @ ROTATION_BS, beam_s)
        slant = [np.linalg.norm(far - p, axis=1) for p in points]
        closing = -sum(w * (r - slant[3]) for w, r in zip(STENCIL, slant, strict=True)) / 0.05
        assert_allclose(table.beam[:, k], closing, atol=1e-6)


def test_dvl_signs_by_hand() -> None:
    ahead = straight(MIDDLE, 20.0, speed=2.0, heading=1.0, weave=Weave())
    plain = quiet(Dvl(rate=1.0, output="both", azimuths=(0.0, pi / 2, pi, -pi / 2), tilt=radians(30)), ahead)
    assert_allclose(plain.velocity, np.tile([2.0, 0.0, 0.0], (21, 1)), atol=1e-9)
    assert_allclose(plain.beam, np.tile([1.0, 0.0, -1.0, 0.0], (21, 1)), atol=1e-9)
    # the sensor's x axis points 90 degrees to starboard: going ahead is going to its own port side, -y
    assert_allclose(quiet(Dvl(rate=1.0, mounting_bs=(0.0, 0.0, pi / 2)), ahead).velocity[0], [0.0, -2.0, 0.0], atol=1e-9)
    # turning to starboard, a sensor at the bow swings to starboard
    turning = circle(MIDDLE, 20.0, speed=2.0, radius=10.0, weave=Weave())
    assert_allclose(quiet(Dvl(rate=1.0, lever_arm_b=(1.0, 0.0, 0.0)), turning).velocity[3], [2.0, 0.2, 0.0], atol=1e-9)


def test_dvl_scale_misalignment_and_noise() -> None:
    ahead = straight(MIDDLE, 2000.0, speed=2.0, weave=Weave())
    assert_allclose(quiet(Dvl(rate=1.0, scale=0.01), ahead).velocity[:, 0], 2.02, atol=1e-9)
    assert_spread(quiet(Dvl(rate=1.0, sigma=0.01), ahead).velocity - [2.0, 0.0, 0.0], 0.01)
    recorder = Recorder(ahead, {"dvl": Dvl(rate=0.01, sigma_scale=0.005, sigma_mounting=0.01)}, 100.0)
    turn_on = np.stack([recorder.draw(seed)["dvl"].velocity[0] for seed in range(300)]) / 2.0
    assert_spread(np.linalg.norm(turn_on, axis=1) - 1.0, 0.005)
    assert_spread(turn_on[:, 1:] / turn_on[:, :1], 0.01)
    beams = quiet(Dvl(rate=1.0, output="both", azimuths=JANUS, tilt=radians(30), beam_sigma=0.02), ahead)
    share = 0.02 / np.sqrt([4 * 0.125, 4 * 0.125, 4 * 0.75])  # least squares: (B^T B)^-1 of a Janus
    for axis in range(3):
        assert_spread(beams.velocity[:, axis] - [2.0, 0.0, 0.0][axis], share[axis])


def test_dvl_loses_beams_and_bottom() -> None:
    ahead = straight(MIDDLE, 1000.0, speed=2.0)
    dvl = Dvl(rate=2.0, output="both", azimuths=JANUS, tilt=radians(30), beam_loss=0.3, outages=((100.0, 160.0),))
    table, clean = quiet(dvl, ahead), quiet(Dvl(rate=2.0), ahead)
    assert_array_equal(np.isnan(table.beam), table.beam_valid == 0)
    out = (table.time >= 100.0) & (table.time < 160.0)
    assert np.count_nonzero(out) == 120
    assert not np.any(table.valid[out])
    assert not np.any(table.beam_valid[out])
    assert np.mean(table.beam_valid[~out]) == pytest.approx(0.7, abs=0.03)
    assert_array_equal(table.valid, np.sum(table.beam_valid, axis=1) >= 3)
    assert_array_equal(np.isnan(table.velocity[:, 0]), table.valid == 0)
    known = table.valid == 1
    assert_allclose(table.velocity[known], clean.velocity[known], atol=1e-12)
    alone = quiet(replace(dvl, output="beams"), ahead)
    assert alone.velocity is None
    assert_array_equal(alone.valid, np.any(alone.beam_valid, axis=1))
    plain = quiet(Dvl(rate=2.0, outages=((100.0, 160.0),)), ahead)
    assert_array_equal(plain.valid == 0, out)
    assert_array_equal(np.isnan(plain.velocity[:, 1]), out)


# Depth, angles, positions


def test_depth_is_that_of_the_sensor_itself() -> None:
    nose_up = still(MIDDLE, 10.0, pitch=0.2, roll=0.3)
    assert_allclose(quiet(Depth(rate=1.0, lever_arm_b=(2.0, 0.0, 0.0)), nose_up).depth, 15.0 - 2.0 * sin(0.2), atol=2e-9)
    assert_allclose(quiet(Depth(rate=1.0, lever_arm_b=(0.0, 2.0, 0.0)), nose_up).depth, 15.0 + 2.0 * sin(0.3) * cos(0.2), atol=2e-9)
    table = quiet(Depth(rate=10.0, sigma=0.05, bias=Drift(constant=0.4)), still(MIDDLE, 100.0))
    assert_spread(table.depth - 15.4, 0.05)


def test_angles_are_those_of_the_axes_they_belong_to(rough: Trajectory) -> None:
    attitude, heading = quiet(Attitude(rate=1.0, mounting_bs=TURNED), rough), quiet(Heading(rate=1.0, mounting_bs=TURNED), rough)
    state = rough.at(attitude.time)
    angles = np.stack([attitude.heading, attitude.pitch, attitude.roll], -1)
    assert_allclose(Rotation.from_euler("ZYX", angles).as_matrix(), state.rotation_nb @ ROTATION_BS, atol=1e-12)
    latitude, longitude, height = pymap3d.ecef2geodetic(*state.position_e.T, deg=False)
    north, east, _ = pymap3d.ecef2ned(*state.point((1.0, 0.0, 0.0)).position_e.T, latitude, longitude, height, deg=False)
    assert_allclose(np.exp(1j * heading.heading), np.exp(1j * np.arctan2(east, north)), atol=1e-8)


def test_angles_stay_in_their_turn_and_have_their_noise() -> None:
    north = still(MIDDLE, 500.0)
    heading = quiet(Heading(rate=2.0, sigma=0.1, bias=Drift(constant=-0.02)), north)
    assert np.all((heading.heading >= 0.0) & (heading.heading < 2 * pi))
    assert_spread((heading.heading + pi) % (2 * pi) - pi + 0.02, 0.1)
    attitude = quiet(Attitude(rate=2.0, sigma=(0.01, 0.02, 0.03)), north)
    for name, sigma in (("roll", 0.01), ("pitch", 0.02), ("heading", 0.03)):
        assert_spread((getattr(attitude, name) + pi) % (2 * pi) - pi, sigma)


@pytest.mark.parametrize("place", [MIDDLE, POLE], ids=["middle", "pole"])
def test_gnss_errors_are_metres_north_east_down(place: Place) -> None:
    trajectory = still(place, 1000.0, heading=1.0, pitch=0.2)
    gnss = Gnss(rate=1.0, sigma=(1.0, 2.0, 3.0), sigma_velocity=0.1, lever_arm_b=ARM)
    table, state = quiet(gnss, trajectory), trajectory.at(0.0).point(ARM)
    lat, lon, height = (float(v) for v in pymap3d.ecef2geodetic(*state.position_e[0], deg=False))
    error = pymap3d.geodetic2ned(table.latitude, table.longitude, table.height, lat, lon, height, deg=False)
    for axis, sigma in zip(error, (1.0, 2.0, 3.0), strict=True):
        assert_spread(axis, sigma)
    assert_spread(table.velocity, 0.1)
    assert_array_equal(table.sigma_axes[5], [1.0, 2.0, 3.0])


def test_gnss_is_heard_at_the_surface_only() -> None:
    trajectory = survey(Place(0.5, 0.5, 0.2), Lawnmower(legs=1, length=30.0, surface_time=20.0), weave=Weave())
    table = quiet(Gnss(rate=1.0, lever_arm_b=(0.0, 0.0, -0.6), max_depth=0.0), trajectory)
    assert 20 <= table.time[-1] < 30
    assert len(quiet(Gnss(rate=1.0, max_depth=-50.0), trajectory)) == 0


@pytest.mark.parametrize("output", ["geographic", "local"])
def test_position_fixes_and_their_outliers(output: str) -> None:
    trajectory = still(MIDDLE, 2000.0)
    fix = PositionFix(rate=1.0, output=output, sigma=1.0, sigma_depth=0.3, outlier_fraction=0.1, outlier_size=100.0)
    table = quiet(fix, trajectory)
    if output == "geographic":
        north, east, _ = pymap3d.geodetic2ned(table.latitude, table.longitude, 0.0, MIDDLE.latitude, MIDDLE.longitude, 0.0, deg=False)
    else:
        north, east = table.north, table.east
    wrong = table.extra["outlier"] == 1
    assert np.mean(wrong) == pytest.approx(0.1, abs=0.03)
    assert np.all(np.hypot(north, east)[wrong] > 40)
    for axis in (north, east):
        assert_spread(axis[~wrong], 1.0)
    assert_spread(table.depth - 15.0, 0.3)


# Through the water, pressure, sea bed, compass, another system

CURRENT = Surrounding("water.current", (0.4, -0.3))


def test_a_log_through_the_water_drifts_with_it() -> None:
    """Heading north-east at rest over ground, the water from the north-west: the log sees it come from port, at 0.5 m/s."""
    rest = still(MIDDLE, 20.0, heading=np.arctan2(0.4, 0.3))
    water, speed = quiet(WaterVelocity(rate=1.0, current=CURRENT), rest), quiet(Speed(rate=1.0, current=CURRENT), rest)
    assert water.kind == "water_velocity"
    assert_allclose(water.velocity, np.tile([0.0, 0.5, 0.0], (21, 1)), atol=1e-12)
    assert_allclose(speed.speed, 0.0, atol=1e-12)
    turned = quiet(Speed(rate=1.0, current=CURRENT, mounting_bs=(0.0, 0.0, np.pi / 2), scale=0.25, bias=Drift(constant=0.1)), rest)
    assert_allclose(1.25 * turned.speed, 0.6, atol=1e-12)


def test_a_current_is_drawn_anew_for_each_seed_and_is_the_same_for_all() -> None:
    wandering = replace(CURRENT, drift=Drift(turn_on=0.2, steady=0.1, tau=50.0))
    aboard = {"adcp": WaterVelocity(rate=2.0, current=wandering), "log": Speed(rate=1.0, current=wandering)}
    recorder = Recorder(still(MIDDLE, 200.0), aboard)
    first, second = recorder.draw(1), recorder.draw(2)
    assert_allclose(first["adcp"].velocity[::2, 0], first["log"].speed, atol=1e-9)  # looking north
    assert np.ptp(first["log"].speed) > 0.05
    assert np.max(np.abs(first["log"].speed - second["log"].speed)) > 0.05
    assert same_bytes(first["log"], recorder.draw(1)["log"])
    starts = [-recorder.draw(seed)["log"].speed[0] - 0.4 for seed in range(200)]
    assert_spread(np.array(starts), np.hypot(0.2, 0.1))


def test_pressure_is_that_of_the_standard_ocean_or_of_a_given_water() -> None:
    deep = still(replace(MIDDLE, depth=2000.0), 5.0)
    table = quiet(Pressure(rate=1.0, atmosphere=1e5), deep)
    assert_allclose(table.pressure, 1e5 + 1e4 * gsw.p_from_z(-2000.0, 32.8), rtol=5e-5)
    lake = Pressure(rate=1.0, density=1000.0, gravity=9.8, scale=0.01, datum=Drift(constant=1.0), lever_arm_b=(0.0, 0.0, 0.5))
    assert_allclose(quiet(lake, still(MIDDLE, 5.0)).pressure, 101325.0 + 1.01 * 9800.0 * 16.5, atol=1e-3)
    noisy = quiet(Pressure(rate=10.0, sigma=150.0), still(MIDDLE, 100.0)).pressure
    assert_spread(noisy - quiet(Pressure(rate=10.0), still(MIDDLE, 100.0)).pressure, 150.0)


def test_an_altimeter_meets_a_level_sea_bed_along_its_axis() -> None:
    seabed = Surrounding("seabed.depth", (40.0,))
    pitched = still(MIDDLE, 5.0, pitch=0.3)
    assert_allclose(quiet(Altimeter(rate=1.0, seabed=seabed), pitched).range, 25.0 / cos(0.3), atol=1e-5)
    ahead = Altimeter(rate=1.0, seabed=seabed, mounting_bs=(0.0, pi / 2 + 0.1, 0.0))  # looks backward, and above the horizon by 0.2 then
    assert np.all(np.isnan(quiet(ahead, still(MIDDLE, 5.0, pitch=0.1)).range))
    plain = quiet(Altimeter(rate=10.0, seabed=seabed, sigma=0.2, bias=Drift(constant=1.0)), still(MIDDLE, 50.0))
    assert_spread(plain.range - 26.0, 0.2)
    assert_allclose(quiet(Dvl(rate=1.0, seabed=seabed, lever_arm_b=(0.0, 0.0, 0.5)), pitched).altitude, 25.0 - 0.5 * cos(0.3), atol=1e-8)


def test_a_single_gyro_feels_the_earth_or_not() -> None:
    rest = still(MIDDLE, 5.0)
    assert_allclose(quiet(YawRate(rate=1.0), rest).yaw_rate, -EARTH_RATE * sin(radians(32.8)), atol=1e-15)
    forward = quiet(YawRate(rate=1.0, mounting_bs=(0.0, pi / 2, 0.0)), rest).yaw_rate  # its z axis points forward, which is north
    assert_allclose(forward, EARTH_RATE * cos(radians(32.8)), atol=1e-15)
    removed = YawRate(rate=1.0, earth_removed=True, scale=0.01, bias=Drift(constant=1e-4))
    assert_allclose(quiet(removed, circle(MIDDLE, 5.0, speed=1.0, radius=20.0, weave=Weave())).yaw_rate, 1.01 * 0.05 + 1e-4, atol=1e-12)


def test_the_deviation_of_a_compass_belongs_to_the_heading_that_it_shows(rough: Trajectory) -> None:
    swing = (0.3, -0.1, 0.05, 0.02)
    shown, true = quiet(Heading(rate=2.0, swing=swing), rough).heading, quiet(Heading(rate=2.0), rough).heading
    a, b, c, d = swing
    deviation = a * np.sin(shown) + b * np.cos(shown) + c * np.sin(2 * shown) + d * np.cos(2 * shown)
    assert np.max(np.abs(deviation)) > 0.2
    assert_allclose(np.exp(1j * (shown - deviation)), np.exp(1j * true), atol=1e-12)


def test_dead_reckoning_of_another_system_is_stretched_and_turned() -> None:
    ahead = straight(MIDDLE, 400.0, speed=1.5, heading=1.0, weave=Weave())
    table = quiet(Navigation(rate=0.1, scale=0.02, rotation=0.05), ahead)
    north, east, _ = pymap3d.geodetic2ned(table.latitude, table.longitude, 0.0, MIDDLE.latitude, MIDDLE.longitude, 0.0, deg=False)
    assert_allclose(np.hypot(north, east), 1.02 * 1.5 * table.time, atol=2e-3)
    assert_allclose(np.arctan2(east[1:], north[1:]), 1.05, atol=2e-5)
    walked = quiet(Navigation(rate=1.0, walk=0.3), still(MIDDLE, 2000.0))
    north, east, _ = pymap3d.geodetic2ned(walked.latitude, walked.longitude, 0.0, MIDDLE.latitude, MIDDLE.longitude, 0.0, deg=False)
    assert_spread(np.diff([north, east]), 0.3)


def test_zero_velocity_rows() -> None:
    table = quiet(ZeroVelocity(rate=2.0, offset=3.0, stop=5.0, sigma=0.01), still(MIDDLE, 10.0))
    assert_allclose(table.time, [3.0, 3.5, 4.0, 4.5, 5.0])
    assert_array_equal(table.sigma, 0.01)


# Acoustic ranges

BEACONS = {
    "a": Beacon(latitude=MIDDLE.latitude + 1e-4, longitude=MIDDLE.longitude - 2e-4, depth=40.0, turnaround=0.3),
    "b": Beacon(north=-300.0, east=500.0, depth=1.0),
}


def transducer(trajectory: Trajectory, time: float) -> np.ndarray:
    state = trajectory.at(time)
    return (state.position_e + state.rotation_eb @ np.asarray(ARM))[0]


def beacon_e(name: str) -> np.ndarray:
    beacon = BEACONS[name]
    if beacon.latitude is None:  # metres along the meridian and along the beacon's own parallel
        _, latitude, _ = Geod(ellps="WGS84").fwd(MIDDLE.longitude, MIDDLE.latitude, pi, 300.0, radians=True)
        radius = np.hypot(*pymap3d.geodetic2ecef(latitude, 0.0, 0.0, deg=False)[:2])
        return np.array(pymap3d.geodetic2ecef(latitude, MIDDLE.longitude + 500.0 / radius, 17.0 - beacon.depth, deg=False)).ravel()
    return np.array(pymap3d.geodetic2ecef(beacon.latitude, beacon.longitude, 17.0 - beacon.depth, deg=False)).ravel()


@pytest.mark.parametrize("path", ["one_way", "two_way"])
def test_range_equations_hold_at_the_poses_of_their_moments(path: str) -> None:
    trajectory = circle(MIDDLE, 200.0, speed=3.0, radius=30.0, weave=ROUGH)
    acoustic = AcousticRange(rate=0.5, offset=1.0, beacons=BEACONS, path=path, sound_speed=1480.0, lever_arm_b=ARM)
    table = quiet(acoustic, trajectory)
    assert list(table.transmitter[:3]) == ["a", "b", "a"]
    assert set(table.path) == {path}
    assert_allclose(table.transmit, 1.0 + 2.0 * np.arange(len(table)))
    assert_allclose(table.time, table.transmit + table.travel_time, atol=1e-15 * 300)
    for row, name in enumerate(table.transmitter):
        b, sent, heard = beacon_e(str(name)), table.transmit[row], table.time[row]
        if path == "two_way":
            sent = sent + np.linalg.norm(transducer(trajectory, sent) - b) / 1480.0 + BEACONS[str(name)].turnaround
            assert table.turnaround[row] == BEACONS[str(name)].turnaround
        tolerance = 1e-12 if name == "a" else 5e-9  # b is placed by a geodesic formula good to micrometres
        assert abs(heard - sent - np.linalg.norm(transducer(trajectory, heard) - b) / 1480.0) < max(tolerance, 3e-12)


def test_ranges_noise_and_late_arrivals() -> None:
    trajectory = still(MIDDLE, 3000.0)
    acoustic = AcousticRange(rate=1.0, beacons={"a": BEACONS["a"]}, lever_arm_b=ARM)
    clean = quiet(acoustic, trajectory).travel_time[0]
    distance = np.linalg.norm(transducer(trajectory, 0.0) - beacon_e("a"))
    assert clean == pytest.approx(2 * distance / 1500.0 + 0.3, abs=1e-11)
    assert_allclose(quiet(replace(acoustic, output="range"), trajectory).range, distance, atol=1e-8)
    one_way = quiet(replace(acoustic, path="one_way", output="range"), trajectory)
    assert_allclose(one_way.range, distance, atol=1e-8)
    assert one_way.turnaround is None
    noisy = quiet(replace(acoustic, sigma=1e-4), trajectory)
    assert_spread(noisy.travel_time - clean, 1e-4)
    assert_allclose(noisy.time - noisy.transmit, noisy.travel_time, atol=1e-12)
    late = quiet(replace(acoustic, outlier_fraction=0.2, outlier_delay=0.05), trajectory).travel_time - clean
    assert np.mean(late > 1e-9) == pytest.approx(0.2, abs=0.03)
    assert np.mean(late[late > 1e-9]) == pytest.approx(0.05, rel=0.2)


# Sampling, delivery, the whole log

SEABED = Surrounding("seabed.depth", (90.0,))
ALL: dict[str, Instrument[Any]] = {
    "imu": Imu(rate=50.0, gyro_density=1e-4, accel_density=1e-3, gyro_bias=Drift(turn_on=1e-5, steady=1e-5), accel_bias=Drift(walk=1e-4)),
    "dvl": Dvl(rate=5.0, sigma=0.01, sigma_scale=0.01, beam_loss=0.1, azimuths=JANUS, tilt=0.5, output="both"),
    "depth": Depth(rate=10.0, sigma=0.02, jitter=0.01),
    "attitude": Attitude(rate=10.0, sigma=(0.01, 0.01, 0.01)),
    "heading": Heading(rate=10.0, sigma=0.01),
    "gnss": Gnss(rate=1.0, sigma=(1.0, 1.0, 1.0)),
    "fix": PositionFix(rate=0.1, sigma=1.0, latency=2.0, latency_jitter=0.5),
    "still": ZeroVelocity(rate=1.0),
    "range": AcousticRange(rate=0.5, beacons=BEACONS, sigma=1e-4, loss=0.1),
    "water": WaterVelocity(rate=2.0, sigma=0.01, current=CURRENT),
    "log": Speed(rate=1.0, sigma=0.05, current=CURRENT),
    "pressure": Pressure(rate=2.0, sigma=100.0),
    "sounder": Altimeter(rate=2.0, sigma=0.1, seabed=SEABED),
    "gyro": YawRate(rate=10.0, sigma=1e-4),
    "other": Navigation(rate=1.0, walk=0.1, sigma_depth=0.1, sigma_heading=0.01),
}


def same_bytes(a: Table, b: Table) -> bool:
    return all(np.asarray(getattr(a, f.name)).tobytes() == np.asarray(getattr(b, f.name)).tobytes() for f in fields(a) if f.name != "extra")


@pytest.fixture(scope="module")
def recorder() -> Recorder:
    return Recorder(straight(MIDDLE, 60.0, speed=1.5, weave=ROUGH), ALL)


def test_same_seed_same_bytes(recorder: Recorder) -> None:
    first, second = recorder.draw(4), simulate(recorder.trajectory, ALL, seed=4)
    other = recorder.draw(5)
    assert (first.initial, first.beacons) == (second.initial, second.beacons)
    assert first.initial != other.initial
    for name in (*ALL, "truth"):
        assert same_bytes(first[name], second[name]), name
        assert same_bytes(first[name], other[name]) == (name in ("still", "truth")), name


def test_another_instrument_or_another_order_changes_no_byte(recorder: Recorder) -> None:
    log = recorder.draw(4)
    for names in (["depth", "imu"], ["imu"], sorted(ALL, reverse=True)):
        fewer = simulate(recorder.trajectory, {name: ALL[name] for name in names}, seed=4)
        assert all(same_bytes(log[name], fewer[name]) for name in names)
        assert fewer.initial == log.initial
    twins = simulate(recorder.trajectory, {"imu": ALL["imu"], "imu_b": ALL["imu"]}, seed=4)
    assert not same_bytes(twins["imu"], twins["imu_b"])


def test_without_noise_tables_are_the_ideal(recorder: Recorder) -> None:
    needed = {"range": {"beacons": BEACONS}, "sounder": {"seabed": SEABED}}
    bare = {name: type(item)(rate=item.rate, **needed.get(name, {})) for name, item in ALL.items()}
    clean = Recorder(recorder.trajectory, bare)
    log = clean.draw(9)
    for name in bare:
        ideal = clean.ideal(name)
        for item in ideal.columns():
            if getattr(ideal, item.name) is not None:
                same = assert_array_equal if getattr(ideal, item.name).dtype.kind == "U" else partial(assert_allclose, atol=1e-15)
                same(getattr(log[name], item.name), getattr(ideal, item.name), err_msg=f"{name}.{item.name}")


def test_sampling_and_delivery(recorder: Recorder) -> None:
    log: Log = recorder.draw(4)
    late = log["fix"].received - log["fix"].time - 2.0
    assert np.all(late > 0)
    assert np.max(late) < 2.5
    shift = log["depth"].time - np.arange(601) / 10
    assert_spread(shift, 0.01)
    moved = recorder.trajectory.at(log["depth"].time).depth
    assert_spread(log["depth"].depth - moved, 0.02)  # the depth is that of the shifted moment
    assert len(log["range"]) < 31
    assert log["imu"].received is None
    many = quiet(Heading(rate=10.0, loss=0.25), straight(MIDDLE, 300.0, speed=1.0))
    assert len(many) / 3001 == pytest.approx(0.75, abs=0.03)
    offset = quiet(Heading(rate=4.0, offset=0.1, stop=2.0), recorder.trajectory).time
    assert_allclose(offset, 0.1 + np.arange(8) / 4)


def test_log_states_its_frame(recorder: Recorder) -> None:
    log = recorder.draw(4)
    assert (log.origin.latitude, log.origin.longitude, log.datum.geoid_undulation) == (MIDDLE.latitude, MIDDLE.longitude, 17.0)
    assert_allclose(log.truth.time, np.arange(601) / 10)
    assert log.beacons["a"].turnaround == 0.3
    stated = pymap3d.geodetic2ecef(log.beacons["b"].latitude, log.beacons["b"].longitude, 17.0 - log.beacons["b"].depth, deg=False)
    assert_allclose(stated, beacon_e("b"), atol=1e-5)


def test_the_start_is_drawn_with_its_sigmas() -> None:
    trajectory = straight(MIDDLE, 10.0, speed=1.5, heading=1.0, weave=ROUGH)
    sigmas = StartSigmas(position=3.0, depth=0.2, velocity=0.1, tilt=0.01, heading=0.05)
    recorder = Recorder(trajectory, {}, 1.0, start=sigmas)
    starts = [recorder.draw(seed).initial for seed in range(300)]
    truth = trajectory.truth(0.0)
    errors = []
    for s in starts:
        position = pymap3d.geodetic2ned(
            truth.latitude[0], truth.longitude[0], truth.height[0], s.latitude, s.longitude, 17.0 - s.depth, deg=False
        )
        velocity = truth.velocity[0] - [s.velocity_north, s.velocity_east, s.velocity_down]
        estimate = Rotation.from_euler("ZYX", [s.heading, s.pitch, s.roll])
        true = Rotation.from_euler("ZYX", [truth.heading[0], truth.pitch[0], truth.roll[0]])
        errors.append([*position, *velocity, *(true * estimate.inv()).as_rotvec()])
    for column, sigma in zip(np.transpose(errors), (3.0, 3.0, 0.2, 0.1, 0.1, 0.1, 0.01, 0.01, 0.05), strict=True):
        assert_spread(column, sigma)
    assert (starts[0].sigma_position, starts[0].sigma_heading, starts[0].time) == (3.0, 0.05, 0.0)


def test_beacons_are_stated_with_their_sigmas() -> None:
    off = {"a": replace(BEACONS["a"], sigma_north=1.0, sigma_east=2.0, sigma_depth=0.5)}
    recorder = Recorder(still(MIDDLE, 10.0), {"range": AcousticRange(rate=1.0, beacons=off)}, 1.0)
    stated = [recorder.draw(seed).beacons["a"] for seed in range(300)]
    places = np.array([(b.latitude, b.longitude, 17.0 - b.depth) for b in stated]).T
    error = pymap3d.geodetic2ned(*places, off["a"].latitude, off["a"].longitude, 17.0 - 40.0, deg=False)
    for column, sigma in zip(error, (1.0, 2.0, 0.5), strict=True):
        assert_spread(column, sigma)


@pytest.mark.parametrize(
    ("instrument", "message"),
    [
        (Imu(rate=1.0, sample="sum"), "mean, instant or increment"),
        (Dvl(rate=1.0, output="beams"), "0 azimuths"),
        (AcousticRange(rate=1.0), "0 beacons"),
        (AcousticRange(rate=1.0, beacons={"a": Beacon()}), "no position"),
    ],
)
def test_what_cannot_be_is_refused(instrument: Instrument[Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        quiet(instrument, still(MIDDLE, 10.0))


def test_contradictions_between_instruments_are_refused() -> None:
    trajectory = still(MIDDLE, 10.0)
    elsewhere = {"a": replace(BEACONS["a"], depth=1.0)}
    with pytest.raises(InputError, match="another instrument"):
        simulate(trajectory, {"x": AcousticRange(rate=1.0, beacons=BEACONS), "y": AcousticRange(rate=1.0, beacons=elsewhere)})
    with pytest.raises(InputError, match="named 'truth'"):
        simulate(trajectory, {"truth": Depth(rate=1.0)})
