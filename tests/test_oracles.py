"""Instruments of the simulator against oracles written from the data contract alone, on motions of their own (oracle.py).

Tolerances.  Earth-fixed coordinates of 6.4e6 m carry 1e-9 m of rounding, a few of them make FINE (m); angles of places are that over
the Earth's radius.  Rates and velocities never meet that number: what is left is the rounding of Cauchy's integral, 1e-14 of the
largest value over the radius squared, and 1e-12 covers it.  Positions of a driven motion are promised to 1e-9 m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import gsw
import numpy as np
import pygeomag
import pymap3d
import pytest
from oracle import (
    EARTH_RATE,
    FLATTENING,
    SEMI_MAJOR,
    Array,
    Motion,
    Point,
    Wave,
    along_path,
    angles,
    apply,
    attitude,
    back,
    chart,
    driven,
    ecef,
    geodetic,
    level_axes,
    meridian_arc,
    normal_gravity,
    normal_radius,
    turn,
)
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from leadline.data.hull import read_hull
from leadline.data.log import Beacon
from leadline.sea.sound import SoundProfile
from leadline.sea.terrain import plane
from leadline.sea.water import Level, TidalCurrent, Water
from leadline.simulate.instruments import (
    AcousticRange,
    Altimeter,
    Attitude,
    CurrentMeter,
    Depth,
    Dvl,
    Gnss,
    Heading,
    Imu,
    Machinery,
    Magnetometer,
    PositionFix,
    Pressure,
    Speed,
    Surrounding,
    WaterVelocity,
    YawRate,
)
from leadline.simulate.laws import Driven, Path
from leadline.simulate.multibeam import Multibeam
from leadline.simulate.plans import still
from leadline.simulate.platforms import Moving, PlatformPose, Steady
from leadline.simulate.profiles import Profile, Ramp, Sinusoid, Sum
from leadline.simulate.routes import Plan, Waypoints
from leadline.simulate.trajectory import Place, Trajectory
from leadline.simulate.usbl import Usbl, UsblFix
from leadline.simulate.voyage import Voyage

FINE = 5e-9
ARM, MOUNTING = (1.3, -0.4, 0.7), (0.1, -0.2, np.pi / 4)
TIME = np.array([0.0, 0.7, 3.1, 9.45, 17.0, 25.2, 39.0])
JANUS = tuple(np.pi / 4 * np.array([1, 3, 5, 7]))


def profile(wave: Wave) -> Profile:
    """The same function in the package's words."""
    return Sum((Ramp(wave.value, wave.slope), *(Sinusoid(*part) for part in wave.parts)))


@dataclass(frozen=True)
class Case:
    """One motion, told twice."""

    mine: Motion
    theirs: Trajectory


def path_case(place: tuple[float, float, float, float], waves: tuple[Wave, ...], water: Water) -> Case:
    """A path with the heading of its course."""
    return Case(along_path(place, *waves), Trajectory(Place(*place, water=water), Path(*(profile(w) for w in waves)), 45.0))


def driven_case(place: tuple[float, float, float, float], waves: tuple[Wave, ...], water: Water) -> Case:
    """Angles and speeds."""
    law = Driven(*(profile(w) for w in waves), duration=45.0)
    return Case(driven(place, waves[:3], waves[3:]), Trajectory(Place(*place, water=water), law, 45.0))


CALM, SHEARED = Water(), Water(shear=((0.0, 0.5, -0.2), (60.0, -0.1, 0.4)))
CIRCLE = (  # 20 m to starboard round a centre 20 m to the east, pitching and rolling, 30 m deep on the mean
    Wave(parts=((20.0, 60.0, 0.0),)), Wave(20.0, parts=((20.0, 60.0, -np.pi / 2),)), Wave(parts=((3.0, 17.0, 0.0),)),
    Wave(parts=((0.4, 7.0, 0.3),)), Wave(0.1, parts=((0.25, 9.0, 0.0),)),
)  # fmt: skip
ROLLING = (  # roll, pitch, heading, then the speeds
    Wave(0.2, parts=((1.2, 8.0, 0.5),)), Wave(parts=((0.6, 11.0, 0.0),)), Wave(3.0, 0.05), Wave(1.5, parts=((0.4, 13.0, 0.0),)),
    Wave(parts=((0.3, 6.0, 0.2),)), Wave(parts=((0.2, 5.0, 0.0),)),
)  # fmt: skip
WEST = (  # about 270 degrees, over the date line
    Wave(parts=((0.3, 19.0, 0.0),)), Wave(2.0, -1.5, ((0.2, 12.0, 0.0),)), Wave(parts=((0.5, 15.0, 0.0),)),
    Wave(0.3, parts=((0.1, 6.0, 0.0),)), Wave(-0.4, parts=((0.1, 8.0, 0.0),)),
)  # fmt: skip
CASES = {
    "circling": path_case((0.785, 0.17, 30.0, 47.0), CIRCLE, SHEARED),
    "rolling": driven_case((-0.58, -1.25, 25.0, -12.0), ROLLING, SHEARED),
    "westward": path_case((1.05, -np.pi + 2e-6, 40.0, 0.0), WEST, SHEARED),
}


@pytest.fixture(params=CASES.values(), ids=CASES.keys(), name="case")
def _case(request: Any) -> Case:
    return request.param


def seen(instrument: Any, trajectory: Trajectory, time: Array = TIME) -> Any:
    """What the instrument shows without noise."""
    return instrument.record(instrument.ideal(trajectory, time), np.random.default_rng(1))


def assert_place(latitude: Array, longitude: Array, point: Point, tolerance: float = FINE) -> None:
    """Equal on the ground; longitudes are taken the short way round."""
    lat, lon, _ = point.geodetic
    turned = (longitude - lon + np.pi) % (2 * np.pi) - np.pi
    assert np.abs((latitude - lat) * SEMI_MAJOR).max() < tolerance
    assert np.abs(turned * SEMI_MAJOR * np.cos(lat)).max() < tolerance
    assert np.all(np.abs(longitude) <= np.pi)


def test_the_oracle_agrees_with_others_about_the_earth_and_about_angles() -> None:
    lat, lon, h = np.array([0.785, -0.58, 1.05, 0.0]), np.array([0.17, -1.25, -np.pi, 3.0]), np.array([17.0, -50.0, 2.0, 900.0])
    p = ecef(lat, lon, h)
    found = np.array(pymap3d.geodetic2ecef(lat, lon, h, deg=False)).T
    assert found == pytest.approx(p, abs=FINE)
    for found, right, scale in zip(geodetic(p), (lat, lon, h), (1 / SEMI_MAJOR, 1 / SEMI_MAJOR, 1.0), strict=True):
        assert found == pytest.approx(right, abs=FINE * scale)
    found = np.array(pymap3d.ecef2ned(*(p + level_axes(lat, lon) @ [3.0, -5.0, 7.0]).T, lat, lon, h, deg=False)).T
    assert found == pytest.approx(np.tile([3.0, -5.0, 7.0], (4, 1)), abs=FINE)
    matrix = attitude(0.3, -0.5, 4.0)
    assert matrix == pytest.approx(Rotation.from_euler("ZYX", [4.0, -0.5, 0.3]).as_matrix(), abs=1e-15)
    assert angles(matrix) == pytest.approx((0.3, -0.5, 4.0), abs=1e-15)
    assert meridian_arc(0.0, np.pi / 2 * np.ones(1)) == pytest.approx(10001965.7293, abs=1e-3)  # a quarter of the meridian


def test_the_oracle_differentiates_as_differences_do(case: Case) -> None:
    """Velocity, acceleration and rate against central differences of positions and rotations: the oracle judges itself."""
    h, t = 1e-3, np.array([2.0, 11.0, 30.0])
    before, now, after = (case.mine.at(t + s, ARM) for s in (-h, 0, h))
    assert now.velocity_e == pytest.approx((after.position_e - before.position_e) / (2 * h), abs=3e-6)  # 1e-9 / h and h^2 / 6 jerk
    assert now.acceleration_e == pytest.approx((after.velocity_e - before.velocity_e) / (2 * h), abs=3e-6)
    rotated = Rotation.from_matrix(np.swapaxes(before.rotation_eb, 1, 2) @ after.rotation_eb).as_rotvec() / (2 * h)
    assert now.rate_b == pytest.approx(rotated, abs=3e-6)


def test_the_oracle_turns_as_a_level_frame_and_its_transport_do(case: Case) -> None:
    """Earth rate, transport rate from the radii of curvature (2e-7 rad/s here) and the rate against north-east-down make up the gyro's."""
    h, t = 5e-3, np.array([2.0, 11.0, 30.0])
    now = case.mine.at(t)
    (lat, _, height), (vn, ve, _) = now.geodetic, now.velocity_n.T
    n = normal_radius(lat)
    m = n**3 * (1 - FLATTENING) ** 2 / SEMI_MAJOR**2
    earth = EARTH_RATE[2] * np.stack([np.cos(lat), 0 * lat, -np.sin(lat)], -1)
    transport = np.stack([ve / (n + height), -vn / (m + height), -ve * np.tan(lat) / (n + height)], -1)
    nb = now.rotation_nb
    steps = [np.swapaxes(nb, 1, 2) @ case.mine.at(t + k * h).rotation_nb for k in (-2, -1, 1, 2)]
    slope = (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)  # h^4 / 30 of the fifth derivative: 2e-11
    relative = np.stack([slope[:, 2, 1], slope[:, 0, 2], slope[:, 1, 0]], -1)
    assert now.gyro_b == pytest.approx(back(nb, earth + transport) + relative, abs=1e-9)


def test_truth(case: Case) -> None:
    point, table = case.mine.at(TIME), case.theirs.truth(TIME)
    assert_place(table.latitude, table.longitude, point)
    assert table.height == pytest.approx(point.geodetic[2], abs=FINE)
    assert table.depth == pytest.approx(point.depth, abs=FINE)
    assert table.velocity == pytest.approx(point.velocity_n, abs=1e-12)
    for found, right in zip((table.roll, table.pitch, table.heading), angles(point.rotation_nb), strict=True):
        assert found == pytest.approx(right, abs=1e-14)
    assert np.all((table.heading >= 0) & (table.heading < 2 * np.pi))


def test_satellite_fixes_are_of_the_antenna(case: Case) -> None:
    antenna = case.mine.at(TIME, ARM)
    table = seen(Gnss(rate=1.0, lever_arm_b=ARM, sigma_velocity=0.0), case.theirs)
    assert_place(table.latitude, table.longitude, antenna)
    assert table.height == pytest.approx(antenna.geodetic[2], abs=FINE)
    assert table.velocity == pytest.approx(antenna.velocity_n, abs=1e-12)
    fix = seen(PositionFix(rate=1.0, lever_arm_b=ARM), case.theirs)
    assert_place(fix.latitude, fix.longitude, antenna)
    assert fix.depth == pytest.approx(antenna.depth, abs=FINE)
    local = seen(PositionFix(rate=1.0, lever_arm_b=ARM, output="local"), case.theirs)
    north, east = chart(*antenna.geodetic[:2], (case.mine.latitude, case.mine.longitude))
    assert local.north == pytest.approx(north, abs=2e-8)  # a long arc less a long arc, each to 1e-8 m
    assert local.east == pytest.approx(east, abs=FINE)


def test_depth_and_pressure_are_those_of_the_sensor(case: Case) -> None:
    depth = case.mine.at(TIME, ARM).depth
    assert seen(Depth(rate=1.0, lever_arm_b=ARM), case.theirs).depth == pytest.approx(depth, abs=FINE)
    simple = seen(Pressure(rate=1.0, lever_arm_b=ARM, density=1025.0, gravity=9.81, atmosphere=99000.0), case.theirs)
    assert simple.pressure == pytest.approx(99000.0 + 1025.0 * 9.81 * depth, abs=1025 * 9.81 * FINE)
    ocean = seen(Pressure(rate=1.0, lever_arm_b=ARM), case.theirs).pressure
    assert ocean - 101325.0 == pytest.approx(1025.0 * 9.81 * depth, rel=5e-3)
    assert np.array_equal(np.argsort(ocean), np.argsort(depth))


@pytest.mark.parametrize("depth", [10.0, 100.0, 1000.0, 5000.0])
def test_the_column_is_the_standard_ocean(depth: float) -> None:
    """TEOS-10 against whatever the sensor holds: equations of state differ by 0.05 kg/m^3."""
    rest = still(Place(0.785, 0.1, depth=depth), 5.0)
    gauge = 1e4 * gsw.p_from_z(-depth, np.degrees(0.785))
    assert seen(Pressure(rate=1.0), rest, TIME[:1]).pressure - 101325.0 == pytest.approx(gauge, rel=5e-5)


def test_the_tide_is_in_depth_and_pressure_not_in_height() -> None:
    place = (0.785, 0.17, 30.0, 47.0)
    case = path_case(place, CIRCLE, Water(levels=(Level(1.5, 400.0, 7.0), Level(0.2, 33.0))))
    level = 1.5 * np.cos(2 * np.pi * (TIME - 7.0) / 400.0) + 0.2 * np.cos(2 * np.pi * TIME / 33.0)
    depth = case.mine.at(TIME, ARM).depth + level
    assert seen(Depth(rate=1.0, lever_arm_b=ARM), case.theirs).depth == pytest.approx(depth, abs=FINE)
    simple = seen(Pressure(rate=1.0, lever_arm_b=ARM, density=1025.0, gravity=9.81), case.theirs)
    assert simple.pressure == pytest.approx(101325.0 + 1025.0 * 9.81 * depth, abs=1025 * 9.81 * FINE)
    truth = case.theirs.truth(TIME)
    assert truth.height == pytest.approx(case.mine.at(TIME).geodetic[2], abs=FINE)
    assert truth.depth == pytest.approx(case.mine.at(TIME).depth + level, abs=FINE)


def test_a_unit_feels_the_earth_the_turn_and_its_lever_arm(case: Case) -> None:
    """Second derivatives carry 1e-16 x 100 m / 0.2^2 s^2; gravity's water of 1025 kg/m^3 and its constants are known to 1e-9 of g."""
    unit, point, bs = Imu(rate=100.0, lever_arm_b=ARM, mounting_bs=MOUNTING, sample="instant"), case.mine.at(TIME, ARM), attitude(*MOUNTING)
    table = seen(unit, case.theirs)
    assert table.gyro == pytest.approx(back(bs, point.gyro_b), abs=1e-12)
    assert table.accel == pytest.approx(back(bs, point.specific_force_b), abs=1e-8)
    short = replace(unit, lever_arm_b=(0.0, 0.0, 0.0))
    felt = (table.accel - seen(short, case.theirs).accel) @ bs.T
    rate, h = case.mine.at(TIME).rate_b, 1e-4
    faster = (case.mine.at(TIME + h).rate_b - case.mine.at(TIME - h).rate_b) / (2 * h)
    earth = point.gyro_b - rate  # Coriolis of the arm's own velocity; gravity differs by 3e-6 per metre
    right = np.cross(faster, ARM) + np.cross(rate, np.cross(rate, ARM)) + 2 * np.cross(earth, np.cross(rate, ARM))
    assert felt == pytest.approx(right, abs=8e-6)


@pytest.mark.parametrize("sample", ["mean", "increment"])
def test_samples_over_an_interval_are_integrals_in_turning_axes(case: Case, sample: str) -> None:
    unit, bs = Imu(rate=20.0, lever_arm_b=ARM, mounting_bs=MOUNTING, sample=sample), attitude(*MOUNTING)
    time = 3.0 + 0.05 * np.arange(8)
    x, w = np.polynomial.legendre.leggauss(8)
    points = [case.mine.at(t - 0.05 + 0.025 * (1 + x), ARM) for t in time]
    gyro = back(bs, np.stack([0.5 * w @ p.gyro_b for p in points]))
    accel = back(bs, np.stack([0.5 * w @ p.specific_force_b for p in points]))
    table = seen(unit, case.theirs, time)
    assert table.gyro is None if sample == "increment" else table.delta_angle is None
    found = (table.delta_angle / 0.05, table.delta_velocity / 0.05) if sample == "increment" else (table.gyro, table.accel)
    assert found[0] == pytest.approx(gyro, abs=1e-10)
    assert found[1] == pytest.approx(accel, abs=1e-8)


@pytest.mark.parametrize("latitude", [0.785, -0.58])
def test_at_rest_a_level_unit_feels_minus_gravity_and_the_earth_turning(latitude: float) -> None:
    """Down is positive: the sea bed pushes up, and north of the equator the Earth turns about up."""
    rest = still(Place(latitude, 0.3), 10.0, heading=3 * np.pi / 2)  # facing west, starboard north
    table = seen(Imu(rate=1.0, sample="instant"), rest, TIME[:2])
    g = float(normal_gravity(np.array(latitude), np.array(0.0), 0.0))
    assert table.accel == pytest.approx(np.tile([0.0, 0.0, -g], (2, 1)), abs=1e-8)
    w = EARTH_RATE[2]
    assert table.gyro == pytest.approx(np.tile([0.0, w * np.cos(latitude), -w * np.sin(latitude)], (2, 1)), abs=1e-15)
    level, tilted = YawRate(rate=1.0), YawRate(rate=1.0, mounting_bs=(0.3, 0.0, 0.0))
    assert seen(level, rest, TIME[:2]).yaw_rate == pytest.approx(-w * np.sin(latitude), abs=1e-15)
    right = -w * np.sin(latitude) * np.cos(0.3) - w * np.cos(latitude) * np.sin(0.3)  # rolled to starboard, z leans to port: south
    assert seen(tilted, rest, TIME[:2]).yaw_rate == pytest.approx(right, abs=1e-15)
    assert seen(replace(tilted, earth_removed=True), rest, TIME[:2]).yaw_rate == pytest.approx(0.0, abs=1e-15)


def test_a_yaw_gyro_feels_the_rate_about_its_own_axis(case: Case) -> None:
    z, point = attitude(*MOUNTING)[:, 2], case.mine.at(TIME)
    assert seen(YawRate(rate=1.0, mounting_bs=MOUNTING), case.theirs).yaw_rate == pytest.approx(point.gyro_b @ z, abs=1e-12)
    free = YawRate(rate=1.0, mounting_bs=MOUNTING, earth_removed=True)
    assert seen(free, case.theirs).yaw_rate == pytest.approx(point.rate_b @ z, abs=1e-12)


def test_attitude_is_that_of_the_sensor_and_heading_that_of_the_bow(case: Case) -> None:
    nb = case.mine.at(TIME).rotation_nb
    table = seen(Attitude(rate=1.0, mounting_bs=MOUNTING), case.theirs)
    for found, right in zip((table.roll, table.pitch, table.heading), angles(nb @ attitude(*MOUNTING)), strict=True):
        assert found == pytest.approx(right, abs=1e-14)
    assert seen(Heading(rate=1.0), case.theirs).heading == pytest.approx(angles(nb)[2], abs=1e-14)


DATE, YEAR = datetime(2026, 7, 2, 12, tzinfo=UTC), 2026.5


def world_magnetic(case: Case) -> Any:
    """The World Magnetic Model at the origin of the motion; it changes by up to 100 nT a year, 4e-13 T in two minutes of the date."""
    mine, model = case.mine, pygeomag.GeoMag(coefficients_file="wmm/WMM_2025.COF")
    return model.calculate(np.degrees(mine.latitude), np.degrees(mine.longitude), (mine.surface_height - mine.depth) / 1000, YEAR)


def test_a_magnetic_compass_shows_less_by_an_easterly_declination(case: Case) -> None:
    true, declination = angles(case.mine.at(TIME).rotation_nb)[2], np.radians(world_magnetic(case).d)
    shown = seen(Heading(rate=1.0, date=DATE), case.theirs).heading
    assert shown == pytest.approx((true - declination) % (2 * np.pi), abs=4e-13 / 1e-5)  # a horizontal field above 10 uT
    assert seen(Attitude(rate=1.0, date=DATE), case.theirs).heading == pytest.approx(shown, abs=1e-14)


def test_a_magnetometer_has_the_field_in_its_axes(case: Case) -> None:
    sm = attitude(*MOUNTING).T @ np.swapaxes(case.mine.at(TIME).rotation_nb, 1, 2)
    given = seen(Magnetometer(rate=1.0, mounting_bs=MOUNTING, field_n=(21e-6, -2e-6, 43e-6)), case.theirs)
    assert given.field == pytest.approx(sm @ [21e-6, -2e-6, 43e-6], abs=1e-18)
    model = world_magnetic(case)
    field = seen(Magnetometer(rate=1.0, mounting_bs=MOUNTING, date=DATE), case.theirs).field
    assert field == pytest.approx(sm @ (1e-9 * np.array([model.x, model.y, model.z])), abs=4e-13)


def test_facing_east_the_field_lies_to_port_and_down_in_the_north() -> None:
    rest = still(Place(0.785, 0.17), 10.0, heading=np.pi / 2)
    field = seen(Magnetometer(rate=1.0, date=DATE), rest, TIME[:1]).field[0]
    assert field[1] < -15e-6
    assert field[2] > 30e-6
    assert seen(Magnetometer(rate=1.0, field_n=(2e-5, 0.0, 4e-5)), rest, TIME[:1]).field[0] == pytest.approx([0.0, -2e-5, 4e-5], abs=1e-19)


def test_iron_and_motors_add_in_sensor_axes() -> None:
    """Soft iron bends the Earth's field alone; hard iron and the motors' currents come on top."""
    case, soft = CASES["circling"], np.array([[1.1, 0.02, -0.03], [0.01, 0.9, 0.04], [0.0, -0.05, 1.05]])
    hard, coupling, field = np.array([3e-6, -1e-6, 2e-6]), np.array([[1e-7, 2e-7], [-3e-7, 0.0], [0.0, 5e-8]]), np.array([2e-5, 1e-6, 4e-5])
    running = Machinery(time=np.array([0.0, 40.0]), thrusters=np.array([[2.0, -3.0], [4.0, 5.0]]), idle=0.5, drawn=0.1, power=3.0)
    meter = Magnetometer(
        rate=1.0, mounting_bs=MOUNTING, field_n=tuple(field), soft_iron=tuple(map(tuple, soft)), hard_iron=tuple(hard),
        motor_coupling=tuple(map(tuple, coupling)), machinery=running,
    )  # fmt: skip
    speeds = np.stack([2.0 + TIME / 20, -3.0 + TIME / 5], -1)
    currents = 0.5 + 0.1 * np.abs(speeds) ** 3
    earth_s = back(case.mine.at(TIME).rotation_nb @ attitude(*MOUNTING), field)
    assert seen(meter, case.theirs).field == pytest.approx(earth_s @ soft.T + hard + currents @ coupling.T, abs=1e-18)


def moving(case: Case, arm: Any = ARM, mounting: Any = MOUNTING) -> tuple[Point, Array, Array]:
    """A sensor's point, its axes in those of the place, and its velocity over ground in its own axes."""
    point = case.mine.at(TIME, arm)
    sn = point.rotation_nb @ attitude(*mounting)
    return point, sn, back(sn, point.velocity_n)


def outward(azimuth: float, tilt: float) -> Array:
    """A beam that leans by `tilt` from z towards the direction `azimuth` from x towards y."""
    return turn(2, np.array(azimuth)) @ turn(1, np.array(tilt)) @ [0.0, 0.0, 1.0]


BEAMS = np.stack([outward(azimuth, np.pi / 6) for azimuth in JANUS])


def test_a_doppler_log_sees_its_own_point_and_beams_are_positive_outward(case: Case) -> None:
    assert BEAMS[0] == pytest.approx([np.sqrt(1 / 8), np.sqrt(1 / 8), np.sqrt(3 / 4)])
    _, _, velocity = moving(case)
    table = seen(Dvl(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, output="both", azimuths=JANUS, tilt=np.pi / 6), case.theirs)
    assert table.velocity == pytest.approx(velocity, abs=1e-11)
    assert table.beam == pytest.approx(velocity @ BEAMS.T, abs=1e-11)
    body = case.mine.at(TIME)  # the same by v + w x l
    arm = back(body.rotation_eb, body.velocity_e) + np.cross(body.rate_b, ARM)
    assert table.velocity == pytest.approx(back(attitude(*MOUNTING), arm), abs=1e-11)


def water_n(depth: Array) -> Array:
    """The sheared current, straight between 0 and 60 m."""
    part = np.clip(depth / 60.0, 0.0, 1.0)[:, None]
    return (1 - part) * [0.5, -0.2, 0.0] + part * [-0.1, 0.4, 0.0]


def test_through_the_water_is_over_ground_less_the_current(case: Case) -> None:
    point, sn, velocity = moving(case)
    more, drift = np.array([0.1, -0.05, 0.0]), Surrounding("water.current", (0.1, -0.05))
    water = water_n(point.depth) + more
    table = seen(WaterVelocity(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, current=drift), case.theirs)
    assert table.velocity == pytest.approx(velocity - back(sn, water), abs=1e-9)  # shear of 0.01/s times FINE, and rounding
    paddle = seen(Speed(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, current=drift), case.theirs)
    assert paddle.speed == pytest.approx((velocity - back(sn, water))[:, 0], abs=1e-9)
    meter = seen(CurrentMeter(rate=1.0, lever_arm_b=ARM, current=drift), case.theirs)
    assert meter.current == pytest.approx(water[:, :2], abs=1e-9)
    cell = seen(WaterVelocity(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, current=drift, cell_start=4.0, cell_end=10.0), case.theirs)
    lower = case.mine.at(TIME, np.array(ARM) + 7.0 * attitude(*MOUNTING)[:, 2])
    there = water_n(lower.depth) + more  # north is taken at the transducer: 7 m away it is another by 1e-6 rad
    assert cell.velocity == pytest.approx(velocity - back(sn, there), abs=1e-9)


def test_a_tidal_current_turns_with_time() -> None:
    case = path_case((0.785, 0.17, 30.0, 47.0), CIRCLE, Water(tides=(TidalCurrent(0.6, 2.0, 0.25, 90.0, 11.0),)))
    point, sn, velocity = moving(case)
    phase = 2 * np.pi * (TIME - 11.0) / 90.0
    along, across = 0.6 * np.cos(phase), 0.25 * np.sin(phase)
    water = np.stack([along * np.cos(2.0) - across * np.sin(2.0), along * np.sin(2.0) + across * np.cos(2.0), 0 * phase], -1)
    table = seen(WaterVelocity(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING), case.theirs)
    assert table.velocity == pytest.approx(velocity - back(sn, water), abs=1e-11)
    assert len(point.time) == len(TIME)


SLOPE, BED, ORIGINS = (0.12, -0.07), 65.0, {name: (case.mine.latitude, case.mine.longitude) for name, case in CASES.items()}
CHART = plane(BED, *SLOPE, (-250.0, 250.0, -250.0, 250.0), 25.0)


def bed_below(position_e: Array, mine: Motion) -> Array:
    """How far above the sloping plane points are, along the plumb line: the bed's depth at their chart coordinates less their own."""
    lat, lon, h = geodetic(position_e)
    north, east = chart(lat, lon, (mine.latitude, mine.longitude))
    return BED + SLOPE[0] * north + SLOPE[1] * east - (mine.surface_height - h)


def slant(point: Point, beams_s: Array, mounting: Any, mine: Motion) -> tuple[Array, Array]:
    """Distances (times, beams) to the plane in closed form, nan upward of it, and how much the curved Earth may differ from that."""
    beams_e = np.einsum("tij,jk,bk->tbi", point.rotation_eb, attitude(*mounting), beams_s)
    here, step = bed_below(point.position_e, mine), 20.0
    ahead, behind = (bed_below(point.position_e[:, None] + s * step * beams_e, mine) for s in (1, -1))
    closing = (behind - ahead) / (2 * step)
    distance = np.where(closing > 0, here[:, None] / np.where(closing > 0, closing, 1.0), np.nan)
    return distance, distance**2 / (SEMI_MAJOR * (1 - FLATTENING) ** 2 * closing)


def test_slant_ranges_to_a_sloping_bed(case: Case) -> None:
    """Closed form on the chart that is flat where the sensor is, to the rounding of its slope, FINE / 40 m times 100 m."""
    point, sn, _ = moving(case)
    right, curved = slant(point, BEAMS, MOUNTING, case.mine)
    right = np.where(right < 100.0, right, np.nan)
    log = Dvl(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, azimuths=JANUS, tilt=np.pi / 6, output="both", seabed=CHART, range_max=100.0)
    table = seen(log, case.theirs)
    assert table.range == pytest.approx(right, abs=3e-8, nan_ok=True)
    assert np.isfinite(right).sum() >= 15
    cosine = (sn @ BEAMS.T)[:, 2, :]
    heard = np.isfinite(right).sum(axis=1)
    mean = np.where(heard >= 3, np.nanmean(right * cosine, axis=1), np.nan)  # a row of fewer beams is not valid as a whole
    assert table.altitude == pytest.approx(mean, abs=1e-7, nan_ok=True)
    beams_e = np.einsum("tij,bj->tbi", point.rotation_eb @ attitude(*MOUNTING), BEAMS)
    for j, k in np.argwhere(np.isfinite(right)):  # and on the Earth as it is

        def above(r: float, at: Array = point.position_e[j], along: Array = beams_e[j, k]) -> float:
            return float(bed_below(at + r * along, case.mine))

        assert table.range[j, k] == pytest.approx(brentq(above, 0.0, 150.0, xtol=1e-9), abs=1e-7 + curved[j, k])
    assert seen(replace(log, azimuths=(), output="velocity"), case.theirs).altitude == pytest.approx(
        bed_below(point.position_e, case.mine), abs=1e-7
    )


def test_a_level_bed_lies_straight_below(case: Case) -> None:
    point, sn, _ = moving(case)
    seabed, cosine = Surrounding("seabed.depth", (70.0,)), sn[:, 2, 2]
    right = np.where(cosine > 0, (70.0 - point.depth) / cosine, np.nan)
    echo = Altimeter(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, seabed=seabed)
    assert seen(echo, case.theirs).range == pytest.approx(right, rel=1e-12, abs=10 * FINE, nan_ok=True)
    plain = seen(Dvl(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, seabed=seabed), case.theirs)
    assert plain.altitude == pytest.approx(70.0 - point.depth, abs=FINE)
    log = Dvl(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, seabed=seabed, azimuths=JANUS, tilt=np.pi / 6, range_max=300.0)
    cosines = (sn @ BEAMS.T)[:, 2, :]
    ranges = np.where(cosines > 0, (70.0 - point.depth)[:, None] / cosines, np.nan)
    assert seen(log, case.theirs).range == pytest.approx(np.where(ranges < 300.0, ranges, np.nan), abs=20 * FINE, nan_ok=True)


def test_an_altimeter_looks_along_its_axis_to_a_sloping_bed(case: Case) -> None:
    point = case.mine.at(TIME, ARM)
    right, _ = slant(point, np.array([[0.0, 0.0, 1.0]]), MOUNTING, case.mine)
    right = np.where(right < 120.0, right, np.nan)[:, 0]
    echo = Altimeter(rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, seabed=CHART, range_max=120.0)
    assert seen(echo, case.theirs).range == pytest.approx(right, abs=1e-7, nan_ok=True)


def test_a_multibeam_fan_on_a_plane(case: Case) -> None:
    """Angles are positive to starboard: that of the higher ground to starboard is the shorter range."""
    sounder = Multibeam(rate=1.0, lever_arm_b=ARM, mounting_bs=(0.05, -0.1, 0.2), seabed=CHART, beams=21, swath=2.0, range_max=120.0)
    table, across = seen(sounder, case.theirs), np.linspace(-1.0, 1.0, 21)
    fan = np.stack([0 * across, np.sin(across), np.cos(across)], -1)
    right, _ = slant(case.mine.at(TIME, ARM), fan, (0.05, -0.1, 0.2), case.mine)
    ping, beam = np.nonzero(right < 120.0)
    assert np.array_equal(table.ping, ping)
    assert np.array_equal(table.beam, beam)
    assert table.time == pytest.approx(TIME[ping], abs=0.0)
    assert table.angle_across == pytest.approx(across[beam], abs=1e-15)
    assert table.range == pytest.approx(right[ping, beam], abs=1e-7)
    rest = still(Place(0.785, 0.17), 10.0)  # facing north; the bed rises to the east, which is starboard
    rising = plane(50.0, 0.0, -0.2, (-250, 250, -250, 250), 25.0)
    short = seen(Multibeam(rate=1.0, seabed=rising, beams=21, swath=1.6), rest, TIME[:1])
    assert short.range == pytest.approx(50.0 / (np.cos(short.angle_across) + 0.2 * np.sin(short.angle_across)), abs=1e-3)  # s^2 / 2R
    assert np.all(np.diff(short.angle_across) > 0)


SPEED, GRADIENT = 1490.0, 0.03
BOTTOM = {"a": (40.0, 60.0, 60.0, 0.0), "b": (-130.0, 25.0, 45.0, 0.07), "c": (30.0, -200.0, 5.0, 0.5)}  # north, east, depth, turnaround
PINGS = 2.0 + 3.0 * np.arange(6)


def beacons_of(mine: Motion) -> dict[str, tuple[Beacon, Array]]:
    """Beacons near a motion, two geographic and one in metres, and where they are."""
    found = {}
    for name, (north, east, depth, turnaround) in BOTTOM.items():
        latitude = brentq(
            lambda lat, n=north: float(meridian_arc(mine.latitude, lat)) - n, mine.latitude - 1e-3, mine.latitude + 1e-3, xtol=1e-16
        )
        longitude = mine.longitude + east / (normal_radius(latitude) * np.cos(latitude))
        where = {"north": north, "east": east} if name == "b" else {"latitude": latitude, "longitude": float(longitude)}
        found[name] = Beacon(**where, depth=depth, turnaround=turnaround), ecef(latitude, longitude, mine.surface_height - depth)
    return found


def straight(a: Array, b: Array, surface_height: float) -> float:
    """Seconds in water of one speed."""
    assert np.isfinite(surface_height)
    return float(np.linalg.norm(a - b)) / SPEED


def bent(a: Array, b: Array, surface_height: float) -> float:
    """Seconds along an arc of a circle where speed is SPEED + GRADIENT depth: arccosh(1 + g^2 chord^2 / (2 c_a c_b)) / g."""
    c = [SPEED + GRADIENT * (surface_height - float(geodetic(p)[2])) for p in (a, b)]
    return float(np.arccosh(1 + GRADIENT**2 * np.sum((a - b) ** 2) / (2 * c[0] * c[1]))) / GRADIENT


LINEAR = SoundProfile(np.array([0.0, 400.0]), np.array([SPEED, SPEED + 400.0 * GRADIENT]))
WATERS = {"straight": (straight, None, 1e-11), "bent": (bent, LINEAR, 1e-9)}


def arrival(sender: Array, start: float, listener: Any, flight: Any, height: float) -> float:
    """The moment at which a moving listener hears what was sent from a place: fixed point, a thousand times nearer each round."""
    moment = start
    for _ in range(8):
        moment = start + flight(sender, listener(moment), height)
    return moment


def exchange(start: float, asker: Any, replier: Any, turnaround: float, flight: Any, height: float) -> tuple[float, float, float]:
    """Question heard, reply sent, reply heard."""
    heard = arrival(asker(start), start, replier, flight, height)
    reply = heard + turnaround
    return heard, reply, arrival(replier(reply), reply, asker, flight, height)


def transducer(mine: Motion, arm: Any = ARM) -> Any:
    """Where it is at one moment."""
    return lambda moment: mine.place_e(np.array([moment]), arm)[0]


@pytest.mark.parametrize("water", WATERS)
def test_two_way_times_hold_the_motion_and_the_turnaround(case: Case, water: str) -> None:
    """1e-9 s of the arc: arccosh near 1 keeps half the digits less what the chord brings, 1e-16 / (g x / c)^2 = 1e-11 of 0.1 s."""
    flight, sound, tolerance = WATERS[water]
    known = beacons_of(case.mine)
    ranger = AcousticRange(rate=1.0, lever_arm_b=ARM, beacons={k: v[0] for k, v in known.items()}, sound_speed=SPEED, profile=sound)
    table = seen(ranger, case.theirs, PINGS)
    assert set(table.transmitter) == set(known)
    assert table.transmit == pytest.approx(PINGS, abs=0.0)
    for row, name in enumerate(table.transmitter):
        beacon, place = known[name]
        heard = exchange(PINGS[row], transducer(case.mine), lambda _, p=place: p, beacon.turnaround, flight, case.mine.surface_height)[2]
        assert table.travel_time[row] == pytest.approx(heard - PINGS[row], abs=tolerance)
        assert table.time[row] == pytest.approx(heard, abs=tolerance)
        assert table.turnaround[row] == pytest.approx(beacon.turnaround)
    metres = seen(replace(ranger, output="range"), case.theirs, PINGS)
    assert metres.range == pytest.approx(0.5 * SPEED * (table.travel_time - table.turnaround), abs=1e-9)


@pytest.mark.parametrize("water", WATERS)
def test_one_way_times_and_their_differences(case: Case, water: str) -> None:
    flight, sound, tolerance = WATERS[water]
    known, height = beacons_of(case.mine), case.mine.surface_height
    common = {"rate": 1.0, "beacons": {k: v[0] for k, v in known.items()}, "sound_speed": SPEED, "profile": sound}
    table = seen(AcousticRange(**common, lever_arm_b=ARM, path="one_way"), case.theirs, PINGS)
    for row, name in enumerate(table.transmitter):
        heard = arrival(known[name][1], PINGS[row], transducer(case.mine), flight, height)
        assert table.travel_time[row] == pytest.approx(heard - PINGS[row], abs=tolerance)
        assert table.time[row] == pytest.approx(heard, abs=tolerance)
    ears = {"bow": (2.0, 0.0, 0.0), "port": (-1.0, -0.5, 0.2), "stern": (-2.0, 0.3, 0.0)}
    pairs = AcousticRange(**common, path="difference", receivers=ears, reference="bow").ideal(case.theirs, PINGS)
    assert len(pairs.time) == 2 * len(PINGS)
    for row in range(len(pairs.time)):
        sent = max(ping for ping in PINGS if ping < pairs.time[row])
        place = known[pairs.transmitter[row]][1]
        heard = [
            arrival(place, sent, transducer(case.mine, ears[ear]), flight, height) for ear in (pairs.receiver[row], pairs.reference[row])
        ]
        assert pairs.reference[row] == "bow"
        assert pairs.travel_time[row] == pytest.approx(heard[0] - heard[1], abs=tolerance)
        assert pairs.time[row] == pytest.approx(heard[0], abs=tolerance)


def directions(azimuth: Array, elevation: Array) -> Array:
    """Unit vectors: azimuth from x towards y, elevation from the xy plane towards z."""
    return np.stack([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)], -1)


@pytest.mark.parametrize("frame", ["sensor", "level"])
def test_a_head_on_the_vehicle_looks_at_beacons_at_reception(case: Case, frame: str) -> None:
    known = beacons_of(case.mine)
    head = Usbl(
        rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, beacons={k: v[0] for k, v in known.items()}, sound_speed=SPEED, frame=frame
    )
    table = seen(head, case.theirs, PINGS)
    for row, name in enumerate(table.transmitter):
        beacon, place = known[name]
        heard = exchange(PINGS[row], transducer(case.mine), lambda _, p=place: p, beacon.turnaround, straight, 0.0)[2]
        assert (table.time[row], table.travel_time[row]) == pytest.approx((heard, heard - PINGS[row]), abs=1e-11)
        there = case.mine.at(heard, ARM)
        axes = there.axes[0] @ turn(2, angles(there.rotation_nb)[2][0]) if frame == "level" else there.rotation_eb[0] @ attitude(*MOUNTING)
        sight = (place - there.position_e[0]) @ axes
        found = directions(table.azimuth[row], table.elevation[row])
        assert found == pytest.approx(sight / np.linalg.norm(sight), abs=FINE / np.linalg.norm(sight))


SHIP = (  # 5 m/s to the south-west with a roll and a pitch, 150 m north-east of the others
    Wave(120.0, -3.0), Wave(90.0, -4.0, ((1.0, 20.0, 0.0),)), Wave(parts=((0.8, 9.0, 0.0),)), Wave(parts=((0.15, 8.0, 0.0),)),
    Wave(parts=((0.07, 6.0, 1.0),)),
)  # fmt: skip


def ship_of(case: Case) -> Case:
    """A ship at the surface over the start."""
    return path_case((case.mine.latitude, case.mine.longitude, 0.0, case.mine.surface_height), SHIP, CALM)


def test_a_ship_says_where_its_antenna_is(case: Case) -> None:
    ship = ship_of(case)
    table, antenna = (
        seen(PlatformPose(rate=1.0, platforms={"ship": Moving(motion=ship.theirs)}, lever_arm_b=ARM), case.theirs),
        ship.mine.at(TIME, ARM),
    )
    assert_place(table.latitude, table.longitude, antenna)
    assert table.depth == pytest.approx(antenna.depth, abs=FINE)
    for found, right in zip((table.roll, table.pitch, table.heading), angles(ship.mine.at(TIME).rotation_nb), strict=True):
        assert found == pytest.approx(right, abs=1e-14)  # those of the ship, where its reference point is


@pytest.mark.parametrize("frame", ["sensor", "level"])
def test_a_head_on_a_ship_looks_at_the_vehicle_as_it_replied(case: Case, frame: str) -> None:
    ship, below, pinger = ship_of(case), (3.0, -2.0, 4.0), (-0.8, 0.1, -0.3)
    common = {
        "rate": 1.0, "lever_arm_b": below, "mounting_bs": (0.02, -0.03, 0.5), "ship": Moving(motion=ship.theirs), "transponder_b": pinger,
        "turnaround": 0.3, "sound_speed": SPEED, "receiver": "ship",
    }  # fmt: skip
    table, fix = seen(Usbl(**common, frame=frame), case.theirs, PINGS), seen(UsblFix(**common), case.theirs, PINGS)
    assert set(table.transmitter) == {"vehicle"}
    assert set(table.receiver) == {"ship"}
    for row, start in enumerate(PINGS):
        _, reply, heard = exchange(start, transducer(ship.mine, below), transducer(case.mine, pinger), 0.3, straight, 0.0)
        assert (table.time[row], table.travel_time[row]) == pytest.approx((heard, heard - start), abs=1e-11)
        there, replier = ship.mine.at(heard, below), case.mine.at(reply, pinger)
        mounted = there.rotation_eb[0] @ attitude(0.02, -0.03, 0.5)
        axes = there.axes[0] @ turn(2, angles(there.rotation_nb)[2][0]) if frame == "level" else mounted
        sight = (replier.position_e[0] - there.position_e[0]) @ axes
        assert directions(table.azimuth[row], table.elevation[row]) == pytest.approx(
            sight / np.linalg.norm(sight), abs=FINE / np.linalg.norm(sight)
        )
        assert fix.time[row] == pytest.approx(reply, abs=1e-11)
        assert_place(fix.latitude[row : row + 1], fix.longitude[row : row + 1], replier, 2 * FINE)
        assert fix.depth[row] == pytest.approx(replier.depth[0], abs=2 * FINE)


def test_sound_arrives_along_the_bent_ray() -> None:
    """The ray is an arc about a point at the depth where sound would stand still; its tangent at the head is what the head sees."""
    case = CASES["circling"]
    known = beacons_of(case.mine)
    head = Usbl(
        rate=1.0, lever_arm_b=ARM, mounting_bs=MOUNTING, beacons={k: v[0] for k, v in known.items()}, sound_speed=SPEED, profile=LINEAR
    )
    table = seen(head, case.theirs, PINGS)
    for row, name in enumerate(table.transmitter):
        there, place = case.mine.at(table.time[row], ARM), known[name][1]
        sight = back(there.axes, place - there.position_e)[0]
        z = SPEED / GRADIENT + np.array(
            [there.depth[0], case.mine.surface_height - float(geodetic(place)[2])]
        )  # above which depth both lie
        x = np.sqrt(np.sum(sight**2) - (z[1] - z[0]) ** 2)
        centre = (x**2 + z[1] ** 2 - z[0] ** 2) / (2 * x)
        tangent = np.array([z[0], centre]) / np.hypot(z[0], centre)  # along and down, square to the radius
        ray = np.array([*(tangent[0] * sight[:2] / np.hypot(*sight[:2])), tangent[1]])
        found = directions(table.azimuth[row], table.elevation[row])
        assert found == pytest.approx(back(there.rotation_nb[0] @ attitude(*MOUNTING), ray), abs=x / SEMI_MAJOR)  # levels at both ends


def test_a_drifting_buoy_replies_from_where_it_is(case: Case) -> None:
    """Along one parallel at the ellipsoid its way is known exactly."""
    lat, lon = case.mine.latitude, case.mine.longitude
    buoy = Moving(motion=Steady(velocity_east=-1.7, heading=0.9), place=Place(lat, lon), lever_arm_b=(0.5, 0.2, 3.0), turnaround=0.2)

    def hangs(moment: float) -> Array:
        longitude = lon - 1.7 * moment / (normal_radius(lat) * np.cos(lat))
        return np.asarray(ecef(lat, longitude, 0.0) + level_axes(lat, longitude) @ attitude(0.0, 0.0, 0.9) @ [0.5, 0.2, 3.0])

    table = seen(AcousticRange(rate=1.0, lever_arm_b=ARM, platforms={"buoy": buoy}, sound_speed=SPEED), case.theirs, PINGS)
    for row, start in enumerate(PINGS):
        heard = exchange(start, transducer(case.mine), hangs, 0.2, straight, 0.0)[2]
        assert table.travel_time[row] == pytest.approx(heard - start, abs=1e-11)


@pytest.fixture(scope="module", name="voyage")
def _voyage() -> Trajectory:
    """A square at 12 m depth in a current, south of the equator: a dive, legs and corners in 220 s."""
    route = Waypoints(speed=1.0, depth=12.0, through=((40.0, 0.0), (40.0, 40.0), (0.0, 40.0), (0.0, 0.0), (40.0, 0.0)))
    place = Place(-0.6, 2.5, surface_height=21.0, water=Water(shear=((0.0, 0.2, 0.1),)))
    return Voyage(read_hull("rexrov"), Plan(legs=(route,)), place, depth=5.0, heading=0.3).run()


def test_a_voyage_moves_by_its_own_velocity(voyage: Trajectory) -> None:
    """Differences of fourth order between knots: 1.5 x 1e-9 m of rounding each way over 10 ms, and h^4 / 30 of the fifth derivative."""
    time, h = 0.05 + 0.1 * np.arange(20, 2000, 37), 0.01  # knots are at whole tenths

    def place_e(t: Array) -> Array:
        truth = voyage.truth(t)
        return ecef(truth.latitude, truth.longitude, truth.height)

    slope = (8 * (place_e(time + h) - place_e(time - h)) - (place_e(time + 2 * h) - place_e(time - 2 * h))) / (12 * h)
    truth = voyage.truth(time)
    right = apply(level_axes(truth.latitude, truth.longitude), truth.velocity)
    assert slope == pytest.approx(right, abs=1e-6)


def strapdown(voyage: Trajectory, begin: float, rows: Any, gather: int) -> Array:
    """Earth-fixed position at the end: increments, `gather` at a time, with coning and sculling of two samples."""
    angle, thrust = (np.add.reduceat(v, np.arange(0, len(v), gather)) for v in (rows.delta_angle, rows.delta_velocity))
    dt = 0.01 * gather
    start = voyage.truth(np.array([begin]))
    position = ecef(start.latitude, start.longitude, start.height)[0]
    axes = level_axes(start.latitude, start.longitude)[0]
    velocity, quaternion = (
        axes @ start.velocity[0],
        Rotation.from_matrix(axes @ attitude(start.roll[0], start.pitch[0], start.heading[0])).as_quat(),
    )
    half_turn = Rotation.from_rotvec(-EARTH_RATE * dt / 2)

    def pull(place: Array, speed: Array) -> Array:
        lat, lon, h = geodetic(place)
        down = level_axes(lat, lon)[:, 2]
        return down * normal_gravity(lat, h, voyage.place.surface_height) - 2 * np.cross(EARTH_RATE, speed)

    fall = pull(position, velocity)
    for (a0, v0), (a, v) in pairwise(zip(angle, thrust, strict=True)):
        rotation = Rotation.from_quat(quaternion)
        force = v + 0.5 * np.cross(a, v) + np.cross(a, np.cross(a, v)) / 6 + (np.cross(a0, v) + np.cross(v0, a)) / 12
        gained = (half_turn * rotation).apply(force)
        middle = velocity + 0.5 * (gained + dt * fall)  # as it fell in the step before: wrong by the jerk of gravity times dt^2
        fall = pull(position + 0.5 * dt * velocity, middle)
        after = velocity + gained + dt * fall
        position = position + 0.5 * dt * (velocity + after)
        velocity, quaternion = after, (half_turn * half_turn * rotation * Rotation.from_rotvec(a + np.cross(a0, a) / 12)).as_quat()
    return np.asarray(position)


def test_a_voyage_is_found_again_from_what_its_inertial_unit_feels(voyage: Trajectory) -> None:
    """Two minutes at 100 and at 50 Hz: the finer result is off by less than both differ.

    Besides, 12 m of water known to 0.25 kg/m^3 leave gravity 2.5e-9 m/s^2, 1.9e-5 m after two minutes.
    """
    begin, end = 20.0, 140.0
    unit = Imu(rate=100.0, sample="increment")
    coarse, fine = (
        strapdown(voyage, begin, seen(unit, voyage, np.arange(round(100 * begin) - g + 1, round(100 * end) + 1) / 100), g) for g in (2, 1)
    )
    truth = voyage.truth(np.array([end]))
    right = ecef(truth.latitude, truth.longitude, truth.height)[0]
    assert np.linalg.norm(fine - right) < np.linalg.norm(coarse - fine) + 2e-5
