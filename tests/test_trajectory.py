"""Truth against witnesses that share nothing with it: finite differences, inertial space, pyproj, pymap3d, published gravity."""

from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np
import pymap3d
import pytest
from numpy.testing import assert_allclose
from pyproj import Transformer
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation

from leadline.data.errors import InputError
from leadline.simulate.gravity import free_air_gravity, gravity
from leadline.simulate.plans import Lawnmower, Weave, circle, figure_eight, still, straight, survey
from leadline.simulate.profiles import Ramp, Sinusoid, Steps
from leadline.simulate.trajectory import Kinematics, Place, Trajectory

EARTH_RATE = 7.292115e-5
ROUGH = Weave((0.3, 6.1), (0.2, 7.3), (0.1, 9.0), (0.4, 11.0), (0.3, 5.0), (0.2, 4.0))
PLACES = {
    "middle": Place(radians(32.8), radians(34.9), 15.0, 17.0),
    "south": Place(radians(-60.0), radians(-150.0), 200.0, -20.0),
    "date line": Place(radians(-17.0), radians(179.9995), 5.0),
    "pole": Place(radians(89.9), radians(-70.0), 30.0, 12.0),
}
MOVES = {
    "survey": lambda place: survey(place, Lawnmower(legs=3, length=60.0, spacing=15.0, dive=12.0, heading=1.2), weave=ROUGH),
    "eight": lambda place: figure_eight(place, 300.0, speed=1.5, length=100.0, width=60.0, weave=ROUGH),
    "circle": lambda place: circle(place, 300.0, speed=2.0, radius=-20.0, weave=ROUGH),
    "straight": lambda place: straight(place, 300.0, speed=2.0, heading=1.9, weave=ROUGH),
}
CASES = [pytest.param(move(place), id=f"{a}, {b}") for a, place in PLACES.items() for b, move in MOVES.items()]
STENCIL = np.array([-1 / 60, 3 / 20, -3 / 4, 0.0, 3 / 4, -3 / 20, 1 / 60])  # central, sixth order


def moments(trajectory: Trajectory, count: int = 40) -> np.ndarray:
    return np.sort(np.random.default_rng(7).uniform(1.0, trajectory.duration - 1.0, count))


def differentiated(states: list[Kinematics], step: float, name: str) -> np.ndarray:
    return sum(weight * getattr(state, name) for weight, state in zip(STENCIL, states, strict=True)) / step


def around(trajectory: Trajectory, time: np.ndarray, step: float, arm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> list[Kinematics]:
    return [trajectory.at(time + k * step).point(arm) for k in range(-3, 4)]


def skew(vector: np.ndarray) -> np.ndarray:
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ([zero, -z, y], [z, zero, -x], [-y, x, zero])], -2)


@pytest.mark.parametrize("trajectory", CASES)
def test_derivatives_are_those_of_the_position_and_of_the_rotation(trajectory: Trajectory) -> None:
    states = around(trajectory, moments(trajectory), 0.01, (0.7, -0.4, 0.3))
    middle = states[3]
    assert_allclose(differentiated(states, 0.01, "position_t"), middle.velocity_t, atol=1e-9)
    assert_allclose(differentiated(states, 0.01, "velocity_t"), middle.acceleration_t, atol=1e-9)
    assert_allclose(differentiated(states, 0.01, "position_e"), middle.velocity_e, atol=1e-6)  # 6,378 km cost 1e-9 m of rounding
    assert_allclose(differentiated(states, 0.01, "velocity_e"), middle.acceleration_e, atol=1e-9)
    assert_allclose(differentiated(states, 0.01, "rotation_eb"), middle.rotation_eb @ skew(middle.rate_eb_b), atol=1e-10)
    assert_allclose(differentiated(states, 0.01, "rate_eb_b"), middle.angular_acceleration_b, atol=1e-10)


@pytest.mark.parametrize("trajectory", CASES)
def test_specific_force_is_inertial_acceleration_less_gravitation(trajectory: Trajectory) -> None:
    time, axis = moments(trajectory), np.array([0.0, 0.0, EARTH_RATE])
    # second derivative of the inertial position, via exact velocities against the Earth: v_i = R_ie (v_e + W x r_e)
    states = around(trajectory, time, 0.01, (1.0, 0.5, -0.7))
    turn = [Rotation.from_rotvec((s.time)[:, None] * axis) for s in states]
    inertial = [r.apply(s.velocity_e + np.cross(axis, s.position_e)) for r, s in zip(turn, states, strict=True)]
    acceleration_i = sum(w * v for w, v in zip(STENCIL, inertial, strict=True)) / 0.01
    state = states[3]
    lat, lon, height = pymap3d.ecef2geodetic(*state.position_e.T, deg=False)
    down = -np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    plumb = gravity(lat, height, trajectory.place.surface_height)[:, None] * down
    gravitation = plumb + np.cross(axis, np.cross(axis, state.position_e))
    felt_e = turn[3].inv().apply(acceleration_i) - gravitation
    assert_allclose(np.einsum("kji,kj->ki", state.rotation_eb, felt_e), state.specific_force_b, atol=2e-7)


@pytest.mark.parametrize("trajectory", CASES)
def test_gyro_is_the_rate_of_the_rotation_against_inertial_space(trajectory: Trajectory) -> None:
    states = around(trajectory, moments(trajectory), 0.01)
    inertial = [Rotation.from_rotvec(s.time[:, None] * [0.0, 0.0, EARTH_RATE]).as_matrix() @ s.rotation_eb for s in states]
    slope = sum(w * r for w, r in zip(STENCIL, inertial, strict=True)) / 0.01
    assert_allclose(slope, inertial[3] @ skew(states[3].rate_ib_b), atol=1e-10)


@pytest.mark.parametrize("trajectory", CASES)
def test_geography_agrees_with_pyproj_and_pymap3d(trajectory: Trajectory) -> None:
    state = trajectory.at(moments(trajectory))
    latitude, longitude, height = state.geodetic
    lon, lat, h = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*state.position_e.T, radians=True)
    assert_allclose(latitude, lat, atol=2e-15 + 1e-9 / 6.4e6)
    assert_allclose(np.exp(1j * longitude), np.exp(1j * np.asarray(lon)), atol=1e-8 / 6.4e6 / cos(trajectory.place.latitude))
    assert_allclose(height, h, atol=5e-9)
    assert_allclose(state.depth, trajectory.place.surface_height - h, atol=5e-9)
    # body axes and velocity north-east-down, from the ends of unit arrows
    for axis, tip in enumerate(np.eye(3)):
        arrow = np.stack(pymap3d.ecef2ned(*state.point(tip).position_e.T, lat, lon, h, deg=False), -1)
        assert_allclose(state.rotation_nb[..., axis], arrow, atol=1e-8)
    moved = np.stack(pymap3d.ecef2ned(*(state.position_e + state.velocity_e).T, lat, lon, h, deg=False), -1)
    assert_allclose(state.velocity_n, moved, atol=1e-8)


@pytest.mark.parametrize("name", ["survey", "circle", "straight"])
def test_position_is_the_integral_of_velocity_at_any_time(name: str) -> None:
    trajectory = MOVES[name](PLACES["middle"])
    for start, end in ((0.0, 3.33), (61.234, 66.1), (100.0071, 100.0099), (150.0, 158.5)):
        integral, _ = quad_vec(lambda t: trajectory.at(t).velocity_t[0], start, end, epsabs=1e-12)
        assert_allclose(trajectory.at(end).position_t - trajectory.at(start).position_t, integral[None], atol=1e-9)


def test_closed_forms() -> None:
    place = PLACES["middle"]
    lap = 2 * pi * 20.0 / 2.0
    ring = circle(place, 100.0, speed=2.0, radius=20.0, heading=0.3, weave=Weave())
    assert_allclose(ring.at(lap).position_t, 0.0, atol=1e-9)
    assert_allclose(ring.at(lap / 4).position_t[0], 20 * np.array([cos(0.3) - sin(0.3), sin(0.3) + cos(0.3), 0.0]), atol=1e-9)
    line = straight(place, 100.0, speed=2.0, heading=0.3, weave=Weave())
    assert_allclose(line.at(99.987).position_t[0], 2 * 99.987 * np.array([cos(0.3), sin(0.3), 0.0]), atol=1e-9)
    assert_allclose(still(place, 100.0).at([0.0, 50.03]).position_t, 0.0, atol=0)


def test_figure_of_eight_follows_its_course() -> None:
    state = MOVES["eight"](PLACES["south"]).at(np.linspace(0.0, 300.0, 500))
    north, east, _ = state.velocity_t.T
    ahead = state.rotation_tb[:, :2, 0]
    assert_allclose(np.arctan2(ahead[:, 1], ahead[:, 0]), np.arctan2(east, north), atol=1e-12)
    circuit = figure_eight(PLACES["south"], 300.0, speed=1.5, length=100.0, width=60.0)
    assert np.mean(np.linalg.norm(circuit.at(np.linspace(0, 300, 3001)).velocity_t[:, :2], axis=1)) == pytest.approx(1.5, rel=0.05)


def test_gravity_meets_the_published_values() -> None:
    assert free_air_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-13)  # NIMA TR8350.2, table 3.4
    assert free_air_gravity(pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-9)
    assert free_air_gravity(radians(45), 0.0) == pytest.approx(9.806199203, abs=2e-6)  # GRS 80 (Moritz, 2000), 1.4e-6 above WGS 84
    slope = (free_air_gravity(0.6, 0.5) - free_air_gravity(0.6, -0.5)) / 1.0
    assert slope == pytest.approx(-(3.0877e-6 - 4.3e-9 * sin(0.6) ** 2), abs=3e-10)  # Heiskanen and Moritz (1967), eq. 2-124 in GRS 80
    bend = free_air_gravity(0.6, 1e4) - 2 * free_air_gravity(0.6, 0.0) + free_air_gravity(0.6, -1e4)
    assert bend / 2e8 == pytest.approx(0.72e-12, abs=0.01e-12)  # the same


def test_gravity_grows_at_the_rate_of_sea_water_below_the_surface() -> None:
    surface = 17.0
    in_air = gravity(0.6, surface + 1.0, surface) - gravity(0.6, surface, surface)
    in_sea = gravity(0.6, surface - 1.0, surface) - gravity(0.6, surface, surface)
    assert in_air == pytest.approx(-3.0864e-6, abs=2e-9)
    assert in_sea == pytest.approx(2.226e-6, abs=5e-9)  # Fofonoff and Millard (1983): 2.226e-6 per metre
    assert gravity(0.6, surface, surface) == free_air_gravity(0.6, surface)


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_at_rest_the_instruments_feel_gravity_and_the_earth(place: Place) -> None:
    angles = (0.1, -0.2, 2.5)
    state = still(place, 60.0, roll=angles[0], pitch=angles[1], heading=angles[2]).at([0.0, 33.0])
    rotation = Rotation.from_euler("ZYX", angles[::-1]).as_matrix()
    weight = gravity(place.latitude, place.surface_height - place.depth, place.surface_height)
    assert_allclose(state.specific_force_b, np.tile(rotation.T @ [0, 0, -weight], (2, 1)), atol=1e-12)
    earth = EARTH_RATE * np.array([cos(place.latitude), 0.0, -sin(place.latitude)])
    assert_allclose(state.rate_ib_b, np.tile(rotation.T @ earth, (2, 1)), atol=1e-18)
    assert_allclose(state.rotation_nb, np.tile(rotation, (2, 1, 1)), atol=1e-12)


def test_truth_table_says_what_the_kinematics_say() -> None:
    trajectory = MOVES["survey"](PLACES["middle"])
    time = moments(trajectory)
    truth, state = trajectory.truth(time), trajectory.at(time)
    angles = np.stack([truth.heading, truth.pitch, truth.roll], -1)
    assert_allclose(Rotation.from_euler("ZYX", angles).as_matrix(), state.rotation_nb, atol=1e-12)
    assert_allclose(np.linalg.norm(truth.velocity, axis=1), np.linalg.norm(state.velocity_e, axis=1), rtol=1e-12)
    assert_allclose(truth.depth + truth.height, 17.0, atol=1e-9)
    assert np.all((truth.heading >= 0) & (truth.heading < 2 * pi))


def test_over_the_pole_and_over_the_date_line() -> None:
    over = straight(Place(radians(89.9999), 0.3, 10.0), 20.0, speed=2.0, weave=Weave()).truth(np.linspace(0.0, 20.0, 401))
    assert np.max(over.latitude) > radians(89.99999)
    assert np.ptp(over.longitude) == pytest.approx(pi, abs=1e-6)
    assert_allclose(np.linalg.norm(over.velocity, axis=1), 2.0, rtol=1e-12)
    assert_allclose(over.velocity[[0, -1], 0], [2.0, -2.0], atol=1e-4)
    across = straight(PLACES["date line"], 60.0, speed=2.0, heading=pi / 2, weave=Weave()).truth([0.0, 60.0])
    assert across.longitude[0] > 0 > across.longitude[1]
    assert_allclose(across.velocity, [[0.0, 2.0, 0.0]] * 2, atol=1e-4)


def test_survey_is_the_plan() -> None:
    plan = Lawnmower(legs=4, length=100.0, spacing=30.0, speed=1.5, heading=0.7, surface_time=20.0, dive=20.0, ascend=True)
    trajectory = survey(Place(0.5, 0.5, 0.0), plan, weave=Weave())
    manoeuvre, slope = plan.dive_times()
    first = 20.0 + 2 * manoeuvre + slope
    centre = first + np.arange(4) * (100.0 / 1.5 + plan.turn_time) + 50.0 / 1.5
    state = trajectory.at(centre)
    assert_allclose(state.depth, 20.0, atol=0.05)
    sideways = state.position_t @ [-sin(0.7), cos(0.7), 0.0]
    assert_allclose(np.diff(sideways), 30.0, atol=1e-6)
    assert_allclose(np.diff(state.position_t @ [cos(0.7), sin(0.7), 0.0]), 0.0, atol=1e-6)
    assert_allclose(trajectory.at([0.0, trajectory.duration]).depth, 0.0, atol=0.05)


@pytest.mark.parametrize(
    "profile", [Ramp(1.0, 0.3), Sinusoid(0.4, 3.0, 0.7), Steps((1.0, 4.0), (2.0, 1.5), (0.3, 2.0, -1.0))], ids=["ramp", "sinusoid", "steps"]
)
def test_profiles_have_the_derivatives_that_they_state(profile: Ramp | Sinusoid | Steps) -> None:
    time, step = np.linspace(0.0, 7.0, 301), 1e-3
    around_it = np.stack([profile(time + k * step, 4) for k in range(-3, 4)])
    slopes = np.tensordot(STENCIL, around_it, 1) / step
    assert_allclose(slopes[:3], profile(time, 4)[1:], atol=2e-7)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="overlap"):
        Steps((1.0, 2.0), (2.0, 1.0), (0.0, 1.0, 2.0))
    with pytest.raises(InputError, match="lasts 300"):
        MOVES["straight"](PLACES["middle"]).at(400.0)
    with pytest.raises(InputError, match="dives"):
        survey(PLACES["middle"], Lawnmower(dive=1.0))
