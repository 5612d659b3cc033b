"""The process models `body-velocity`, `cruise` and `planar` against closed forms, and the gyros as a correction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import cos, radians, sin

import numpy as np
import pytest
from scipy.linalg import expm

from leadline.assess.errors import errors_of
from leadline.core import attitude
from leadline.core.compiled import COMPONENTS, NUISANCES, WIDE
from leadline.core.earth import offset
from leadline.core.geodesy import rotation_en
from leadline.data.errors import InputError
from leadline.data.log import Origin
from leadline.data.records import Attitude, Depth, Heading, Imu, Pressure
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.bound import ideal_log
from leadline.missions.instruments import instruments_of
from leadline.models.layout import INPUTS, NOW_U
from leadline.models.process import Pose
from leadline.models.processes import compose_process
from leadline.models.sensor import Context
from leadline.models.sensors import compose
from leadline.models.view import RATE_V, TANGENT, VELOCITY_V, VIEW_SIZE, view_of
from leadline.simulate import instruments as simulated
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Weave, circle, figure_eight
from leadline.simulate.trajectory import Place

DEGREE = radians(1.0)
IMU = """
[sensors.imu]
rate_hz = 100.0
lever_arm_m = [0.3, 0.1, -0.05]
gyro_noise_deg_per_rth = 0.1
gyro_bias_deg_per_h = 10.0
gyro_bias_instability_deg_per_h = 3.0
gyro_bias_tau_s = 400.0
accel_noise_ug_per_rthz = 100.0
accel_bias_ug = 0.0
"""
AIDS = """
[sensors.dvl]
sigma_mps = 0.01
lever_arm_m = [-0.5, 0.1, 0.2]
[sensors.depth]
sigma_m = 0.02
lever_arm_m = [0.6, 0.1, -0.1]
[sensors.ahrs]
kind = "attitude"
sigma_deg = 1.0
sigma_tilt_deg = 0.5
mounting_deg = [10.0, -20.0, 30.0]
"""
FIGURES = """
[process]
body-velocity = { bias_s = 0.0 }
planar = { accel_noise_mps2_per_rts = 0.1 }
"""
CONTEXT = Context(surface=17.0)
LATITUDE, LONGITUDE = 0.7, 0.2
SOLID = Weave((0.0, 1.0), (0.0, 1.0), (0.0, 1.0), (0.0, 1.0), (0.0, 1.0), (0.0, 1.0))


def aboard(text: str = IMU + AIDS):
    return vehicle_from_toml('name = "all"\n' + text)


def without_unit(text: str):
    return aboard('[process]\nmodel = "cruise"\n' + text)


@cache
def process(model: str):
    return compose_process(vehicle_from_toml('name = "all"\n' + FIGURES + IMU + AIDS).moved_by(model), CONTEXT)


def pose(generator: np.random.Generator, pitch: float = 1.0) -> Pose:
    """A pose that moves and turns, with any covariance."""
    root = generator.normal(0.0, 1.0, (9, 9))
    wandered = attitude.quaternion_from_euler(0.0, 0.0, 0.8)
    place = attitude.product(attitude.quaternion_from_matrix(rotation_en(LATITUDE, LONGITUDE)), wandered)
    angles = generator.uniform(-1.0, 1.0, 3) * (0.3, pitch, np.pi)
    rates = generator.normal(0.0, 0.2, 3)
    return Pose(place, -40.0, generator.normal(0.0, 1.5, 3), attitude.quaternion_from_euler(*angles), rates, root @ root.T, 5.0)


def moved(model: str, x: np.ndarray, duration: float, steps: int, u: np.ndarray | None = None) -> np.ndarray:
    """The nominal state after a time cut into steps."""
    made, x, m = process(model), x.copy(), np.zeros(WIDE * WIDE)
    for _ in range(steps):
        made.step(x, np.zeros(INPUTS) if u is None else u, duration / steps, made.parameters, m)
    return x


def driven_noise(model: str, x: np.ndarray, dt: float, u: np.ndarray) -> np.ndarray:
    """Q of one step."""
    made, m, P = process(model), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
    made.step(x.copy(), u, dt, made.parameters, m)
    made.noise(m, dt, made.parameters, P)
    return P.reshape(WIDE, WIDE)


def van_loan(F: np.ndarray, G: np.ndarray, dt: float) -> np.ndarray:
    """The integral of exp(F s) G exp(F s)^T over a step (Van Loan, 1978)."""
    n = len(F)
    whole = expm(np.block([[-F, G], [np.zeros((n, n)), F.T]]) * dt)
    return whole[n:, n:].T @ whole[:n, n:]


# --- what holds for all of them ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["inertial", "body-velocity", "cruise", "planar"])
def test_a_start_is_seen_as_it_was_stated(model: str) -> None:
    """The view of the initial state is the pose, and its Jacobian turns the initial covariance back into that of the pose."""
    generator, made = np.random.default_rng(3), process(model)
    for _ in range(10):
        start = pose(generator)
        x, P = made.begin(start)
        errors = sum(part.size for part in made.parts)
        assert x.shape == (sum(part.nominal for part in made.parts),)
        assert P.shape == (errors, errors)
        u, view, H = np.zeros(INPUTS), np.zeros(VIEW_SIZE), np.zeros((TANGENT, WIDE))
        made.view(x, u, made.parameters, view)
        made.pull(x, u, made.parameters, view, np.eye(TANGENT), H, TANGENT)
        np.testing.assert_allclose(view[:5], [*start.quaternion_en, start.height], rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(view[5:8], start.velocity_n, rtol=0.0, atol=1e-14)
        turned = attitude.logarithm(attitude.product(view[8:12], attitude.conjugate(start.quaternion_nb)))
        np.testing.assert_allclose(turned, 0.0, atol=1e-14)
        if model in ("cruise", "planar"):
            np.testing.assert_allclose(view[RATE_V : RATE_V + 3], start.rate_b, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(H[:9, :errors] @ P @ H[:9, :errors].T, start.covariance, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("model", ["cruise", "planar"])
def test_noise_of_a_step_cut_in_ten_is_that_of_the_whole(model: str) -> None:
    """Of what is estimated: what is drawn anew in each step is not.  With rates of a thousandth, so that directions hold still."""
    made = process(model)
    x, _ = made.begin(replace(pose(np.random.default_rng(8)), rate_b=np.full(3, 1e-3)))
    kept = [i for i in range(9) if model == "cruise" or i != 2]
    if model == "cruise":
        kept = [*range(10)]
        x[12:14] = 0.0
    u, whole = np.zeros(INPUTS), np.zeros((WIDE, WIDE))
    for _ in range(10):
        m, half, full = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
        whole[[i for i in range(WIDE) if i not in kept]] = whole[:, [i for i in range(WIDE) if i not in kept]] = 0.0
        made.step(x, u, 0.01, made.parameters, m)
        made.push(m, 0.01, made.parameters, whole.ravel(), half, 24)
        made.push(m, 0.01, made.parameters, np.ascontiguousarray(half.reshape(WIDE, WIDE).T).ravel(), full, 24)
        made.noise(m, 0.01, made.parameters, full)
        whole = full.reshape(WIDE, WIDE).copy()
    once = driven_noise(model, x, 0.1, u)
    scale = np.sqrt(np.outer(np.diag(once)[kept], np.diag(once)[kept]))
    assert (np.abs(whole[np.ix_(kept, kept)] - once[np.ix_(kept, kept)]) / scale).max() < 2e-3  # the body turned by 1e-4 rad, v did not


# --- body-velocity -----------------------------------------------------------------------------------------------------------------


def inputs_of(trajectory, count: int, dt: float) -> np.ndarray:
    """Inputs (count, INPUTS) from rates and forces in the middle of each interval."""
    at = trajectory.at((np.arange(count) + 0.5) * dt)
    made = np.zeros((count, INPUTS))
    made[:, :3], made[:, 3:6], made[:, 6], made[:, 7] = at.rate_ib_b, at.specific_force_b, 1.0, dt
    return made


def test_what_a_bias_does_counts_as_noise() -> None:
    """A bias b counts as a density b^2 bias_s: after that time the velocity is as uncertain as by b itself."""
    with_bias = compose_process(
        vehicle_from_toml('name = "b"\nprocess.model = "body-velocity"\n' + IMU.replace("accel_bias_ug = 0.0", "accel_bias_ug = 1000.0")),
        CONTEXT,
    )
    plain = process("body-velocity")
    assert with_bias.parameters[1] - plain.parameters[1] == pytest.approx((1e-3 * 9.80665) ** 2 * 10.0)
    assert with_bias.parameters[2] - plain.parameters[2] == pytest.approx((10.0 * DEGREE / 3600.0) ** 2 * 10.0)


def test_body_velocity_is_inertial_in_other_variables() -> None:
    """On the same input for a lively minute with a gap: the same places, velocities and attitudes, to rounding."""
    lively = Weave((0.25, 1.9), (0.15, 1.3), (0.3, 2.9), (0.3, 1.7), (0.3, 1.1), (0.3, 1.3))
    trajectory = figure_eight(Place(1.2, 0.3, depth=20.0), 60.0, speed=2.0, length=40.0, width=15.0, weave=lively)
    own, plain = process("body-velocity"), process("inertial")
    start = replace(pose(np.random.default_rng(1)), covariance=np.eye(9))
    x, y = own.begin(start)[0], plain.begin(start)[0]
    m = np.zeros(WIDE * WIDE)
    for k, u in enumerate(inputs_of(trajectory, 6000, 0.01)):
        if 3000 <= k < 3030:
            u[6] = 0.0
        own.step(x, u, 0.01, own.parameters, m)
        plain.step(y, u, 0.01, plain.parameters, m)
    seen, expected = np.zeros(VIEW_SIZE), np.zeros(VIEW_SIZE)
    for given in (u, np.zeros(INPUTS)):
        own.view(x, given, own.parameters, seen)
        plain.view(y, given, plain.parameters, expected)
        np.testing.assert_allclose(seen, expected, rtol=0.0, atol=1e-9)


def test_a_turning_body_keeps_its_velocity() -> None:
    """On a circle the accelerometer feels u r to starboard for a minute, 60 u r of sway in all; the velocity stays ahead."""
    speed, radius, dt = 1.5, 15.0, 0.01
    trajectory = circle(Place(0.6, 0.3, depth=20.0), 60.0, speed=speed, radius=radius, weave=SOLID)
    at, made, m = trajectory.at(np.array([0.0])), process("body-velocity"), np.zeros(WIDE * WIDE)
    turned = attitude.quaternion_from_matrix(at.rotation_nb[0])
    place = attitude.quaternion_from_matrix(rotation_en(0.6, 0.3))
    start = Pose(place, -20.0, at.velocity_n[0], turned, np.zeros(3), np.eye(9))
    x, felt = made.begin(start)[0], 0.0
    for u in inputs_of(trajectory, 6000, dt):
        made.step(x, u, dt, made.parameters, m)
        felt += u[4] * dt
    sway = 60.0 * speed * speed / radius  # what the published equations would hold for the velocity to starboard
    assert felt == pytest.approx(sway, abs=60.0 * 2.0 * 7.3e-5 * speed)  # but for Coriolis
    np.testing.assert_allclose(x[5:8], [speed, 0.0, 0.0], atol=1e-3 * sway)


def test_noise_of_body_velocity_is_that_of_inertial_in_other_variables() -> None:
    """T^-1 Q T^-T, at the attitude and velocity after the step, with input and in a gap."""
    generator, own, plain = np.random.default_rng(4), process("body-velocity"), process("inertial")
    for present in (1.0, 0.0):
        start = pose(generator)
        x, y = own.begin(start)[0], plain.begin(start)[0]
        u = np.zeros(INPUTS)
        u[:8] = *generator.normal(0.0, 0.3, 3), 0.1, 0.2, -9.8, present, 0.01
        end = moved("body-velocity", x, 0.1, 1, u)
        rotation, change = attitude.matrix_from_quaternion(end[8:12]), np.eye(9)
        change[3:6, 3:6] = rotation
        change[3:6, 6:9] = np.cross(np.eye(3), rotation @ end[5:8]).T
        back = np.linalg.inv(change)
        expected = back @ driven_noise("inertial", y, 0.1, u)[:9, :9] @ back.T
        found = driven_noise("body-velocity", x, 0.1, u)
        np.testing.assert_allclose(found[:9, :9], expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
        assert not found[9:].any()


def test_body_velocity_knows_one_unit() -> None:
    text = '[process]\nstandby = "second"\n' + IMU + IMU.replace("[sensors.imu]", '[sensors.second]\nkind = "imu"')
    with pytest.raises(InputError, match=r"process.standby: is 'second'"):
        compose_process(aboard(text).moved_by("body-velocity"), CONTEXT)


# --- cruise ------------------------------------------------------------------------------------------------------------------------


def cruising(velocity, heading=0.0, pitch=0.0, turn=0.0, pitching=0.0) -> np.ndarray:
    place = attitude.quaternion_from_matrix(rotation_en(LATITUDE, LONGITUDE))
    return np.array([*place, -40.0, *velocity, heading, pitch, turn, pitching, 0.0, 0.0])


def way(x: np.ndarray, begun: np.ndarray) -> np.ndarray:
    return np.array(offset(x, 0, begun, 0))


def turned_way(velocity, heading, pitch, turn, time) -> np.ndarray:
    """The integral of Rz(heading + turn t) Ry(pitch) v."""
    level = attitude.matrix_from_euler(0.0, pitch, 0.0) @ velocity
    s, c = (sin(heading + turn * time) - sin(heading)) / turn, -(cos(heading + turn * time) - cos(heading)) / turn
    return np.array([level[0] * s - level[1] * c, level[0] * c + level[1] * s, level[2] * time])


@pytest.mark.parametrize("pitch", [0.0, radians(-55.0)], ids=["circle", "helix"])
def test_cruise_on_a_circle_and_on_a_helix(pitch: float) -> None:
    """With sway and heave; the error of a step is of the fifth order, so halving the steps divides that of the whole by 16.

    The metres of the witness are those at the height of the start: off by the change of height over the Earth's radius.
    """
    begun = cruising((1.5, 0.2, -0.1), 0.4, pitch, 1.0)
    exact = turned_way((1.5, 0.2, -0.1), 0.4, pitch, 1.0, 12.0)
    coarse, fine = (np.linalg.norm(way(moved("cruise", begun, 12.0, steps), begun) - exact) for steps in (12, 24))
    assert 14.5 < coarse / fine < 17.5
    found = way(moved("cruise", begun, 12.0, 240), begun)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-7 + 3.0 * abs(exact[2]) / 6.3e6)  # 3 m across the circle


def test_cruise_through_a_vertical_arc() -> None:
    """Nose up at a steady rate q with the speed u ahead: forward u sin(qt) / q, down -u (1 - cos(qt)) / q."""
    begun = cruising((2.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.1)
    found = way(moved("cruise", begun, 10.0, 100), begun)
    np.testing.assert_allclose(found, [20.0 * sin(1.0), 0.0, -20.0 * (1.0 - cos(1.0))], rtol=0.0, atol=17.0 * 9.2 / 6.3e6)


def test_noise_of_cruise_against_van_loan() -> None:
    """White accelerations of surge, sway, heave, heading and pitch, on their way into position and angles."""
    made, begun = process("cruise"), cruising((1.5, 0.2, -0.1), 0.4, 0.9)
    rotation = attitude.matrix_from_euler(0.0, 0.9, 0.4)
    velocity, F, G = rotation @ begun[5:8], np.zeros((10, 10)), np.zeros((10, 10))
    F[:3, 3:6], F[6, 8], F[7, 9] = rotation, 1.0, 1.0
    F[:3, 6], F[:3, 7] = np.cross([0.0, 0.0, 1.0], velocity), np.cross([-sin(0.4), cos(0.4), 0.0], velocity)
    G[3:, 3:] = np.diag([0.05, 0.03, 0.03, 0.0, 0.0, 2.0 * DEGREE, 1.0 * DEGREE]) ** 2
    expected = van_loan(F, G, 0.1)
    found = driven_noise("cruise", begun, 0.1, np.zeros(INPUTS))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found[:10, :10] / scale, expected / scale, rtol=0.0, atol=1e-9)
    assert made.longest_step == 0.1


def test_roll_falls_back_to_level() -> None:
    """Without a rate its variance stays that of sigma_roll_deg and a roll falls by e within roll_s, however the time is cut."""
    made, sigma = process("cruise"), 3.0 * DEGREE
    for steps in (50, 500):
        x, P = cruising((1.5, 0.0, 0.0)), np.zeros((WIDE, WIDE))
        x[12] = 0.3
        P[10, 10] = sigma**2
        for _ in range(steps):
            m, half, full = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
            made.step(x, np.zeros(INPUTS), 5.0 / steps, made.parameters, m)
            made.push(m, 5.0 / steps, made.parameters, P.ravel(), half, 16)
            made.push(m, 5.0 / steps, made.parameters, np.ascontiguousarray(half.reshape(WIDE, WIDE).T).ravel(), full, 16)
            made.noise(m, 5.0 / steps, made.parameters, full)
            P = full.reshape(WIDE, WIDE).copy()
            P[11, :] = P[:, 11] = 0.0  # a rate that is known to be nothing
        assert P[10, 10] == pytest.approx(sigma**2, rel=1e-12)
        assert x[12] == pytest.approx(0.3 / np.e)


def test_what_a_gyro_says_turns_the_roll_and_is_forgotten() -> None:
    made, x, m = process("cruise"), cruising((1.5, 0.0, 0.0)), np.zeros(WIDE * WIDE)
    x[13] = 0.2
    made.step(x, np.zeros(INPUTS), 0.01, made.parameters, m)
    assert x[12] == pytest.approx(0.002)
    assert x[13] == pytest.approx(0.02)


# --- planar ------------------------------------------------------------------------------------------------------------------------


def planar_start(**given) -> np.ndarray:
    generator = np.random.default_rng(6)
    start = pose(generator, 0.2)
    return process("planar").begin(replace(start, **given))[0]


def test_planar_on_a_parabola() -> None:
    """p = v t + a t^2 / 2 and heading + rate t, however the time is cut; the depth goes on with the velocity downward."""
    begun = planar_start(velocity_n=np.array([1.2, -0.4, 0.3]))
    begun[7:9] = 0.02, -0.05
    for steps in (1, 7):
        x = moved("planar", begun, 8.0, steps)
        np.testing.assert_allclose(way(x, begun), [1.2 * 8 + 0.01 * 64, -0.4 * 8 - 0.025 * 64, 0.3 * 8], atol=2e-6)  # v^2 t / R
        np.testing.assert_allclose(x[5:10], [1.36, -0.8, 0.02, -0.05, begun[9] + 8 * begun[10]], atol=1e-12)


def test_noise_of_planar_against_van_loan() -> None:
    F, G = np.zeros((6, 6)), np.zeros((6, 6))  # north, its velocity, its acceleration; the same is east; heading and its rate
    F[0, 1] = F[1, 2] = F[4, 5] = 1.0
    G[2, 2], G[5, 5] = 0.1**2, (2.0 * DEGREE) ** 2
    expected = van_loan(F, G, 0.1)
    found = driven_noise("planar", planar_start(), 0.1, np.zeros(INPUTS))
    for i in range(2):
        np.testing.assert_allclose(found[np.ix_([i, 3 + i, 5 + i], [i, 3 + i, 5 + i])], expected[:3, :3], rtol=1e-9)
    np.testing.assert_allclose(found[7:9, 7:9], expected[4:, 4:], rtol=1e-9)
    assert not found[14:].any()


def feed(name: str, table) -> np.ndarray:
    return next(f for f in process("planar").feeds if f.sensor == name).rows(table)


def test_planar_is_supplied_with_depth_and_tilt() -> None:
    """A dive at 0.3 m/s with 20 degrees nose down: height without the lever arm, the velocity within 1 % after 10 s, tilt of the body."""
    made, x, m = process("planar"), planar_start(height=-3.0, velocity_n=np.zeros(3)), np.zeros(WIDE * WIDE)
    time = np.arange(0.0, 10.0, 0.1)
    rotation = attitude.matrix_from_euler(0.05, radians(-20.0), 1.0)
    depth = 20.0 + 0.3 * time + (rotation @ aboard()["depth"].lever_arm_b)[2]
    sensor = rotation @ aboard()["ahrs"].rotation_bs
    ahrs = attitude.quaternion_from_matrix(sensor)[None].repeat(len(time), axis=0)
    supplied, tilt = feed("depth", Depth(time=time, depth=depth)), feed("ahrs", Attitude(time=time, quaternion=ahrs))
    assert np.isnan(supplied[:, 3:]).all()
    assert np.isnan(tilt[:, [0, 1, 2, *range(8, INPUTS)]]).all()
    u = np.zeros(INPUTS)
    for k in range(len(time)):
        for row in (supplied[k], tilt[k]):
            u[np.isfinite(row)] = row[np.isfinite(row)]
        for part in range(4):  # measurements in between cut the time
            u[NOW_U] = time[k] + 0.025 * part
            made.step(x, u, 0.025, made.parameters, m)
    assert 17.0 - x[4] == pytest.approx(20.0 + 0.3 * 10.0, abs=1e-3)
    view = np.zeros(VIEW_SIZE)
    made.view(x, u, made.parameters, view)
    assert view[VELOCITY_V + 2] == pytest.approx(0.3 * (1.0 - np.exp(-9.9 / 2.0)), abs=1e-7)
    np.testing.assert_allclose(attitude.euler_from_quaternion(view[8:12])[:2], [0.05, radians(-20.0)], atol=1e-9)


def test_a_supply_that_falls_silent_is_trusted_less_and_less() -> None:
    """The variance of the depth grows by that of the velocity times the square of the age; a correction is forgotten in a step."""
    made, u = process("planar"), np.zeros(INPUTS)
    u[:3] = 40.0, 5.0, 0.02**2
    for age in (0.0, 3.0):
        x, m, P = planar_start(), np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
        u[NOW_U] = 5.0 + age
        made.step(x, u, 0.1, made.parameters, m)
        made.noise(m, 0.1, made.parameters, P)
        down = (2.0 * 0.2) ** 2 + (0.02 / 2.0) ** 2
        assert P[2 * (WIDE + 1)] == pytest.approx(0.99 * (0.02**2 + down * (age + 0.1) ** 2))
        assert P[11 * (WIDE + 1)] == pytest.approx(0.99 * down)


def test_rows_that_are_no_numbers_supply_nothing() -> None:
    rows = feed("depth", Depth(time=[1.0, 2.0, 3.0], depth=[5.0, np.nan, 5.0], valid=[1.0, 1.0, 0.0]))
    assert np.isfinite(rows).any(axis=1).tolist() == [True, False, False]


@pytest.mark.parametrize("water", ["", "density_kgpm3 = 1020.0\ngravity_mps2 = 9.8\n"], ids=["standard ocean", "density"])
def test_pressure_supplies_the_depth_that_the_sensor_would_measure(water: str) -> None:
    """The inverse of models/sensors/pressure.py, value and sigma."""
    text = (
        "[sensors.p]\nkind = 'pressure'\nsigma_pa = 200.0\n"
        + water
        + "nuisance = { datum = { value_m = 0.4 }, scale = { value_percent = 0.3 } }\n"
    )
    found = without_unit(text)
    context = replace(CONTEXT, origin=Origin(LATITUDE, LONGITUDE))
    channel = compose(found["p"], context).channels[0]
    view, z, R = np.zeros(2 * VIEW_SIZE), np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    view[:VIEW_SIZE] = view_of(LATITUDE, LONGITUDE, 17.0 - 300.0, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    known = np.array([0.4, 0.003] + [0.0] * (NUISANCES - 2))
    channel.predict(view, known, np.array([0.0, 4e4, 101325.0]), channel.parameters, z, R, Hv, Hn)
    made = compose_process(found.moved_by("planar"), context)
    row = made.feeds[0].rows(Pressure(time=[7.0], pressure=[z[0]]))[0]
    assert row[0] == pytest.approx(300.0, abs=1e-6)
    assert row[1] == 7.0
    assert np.sqrt(row[2]) == pytest.approx(200.0 / Hv[0, 2], rel=5e-3)  # it is taken at the surface, where water is lighter


def test_planar_needs_a_depth() -> None:
    with pytest.raises(InputError, match="no sensor of kind depth or pressure"):
        compose_process(aboard(IMU).moved_by("planar"), CONTEXT)
    with pytest.raises(InputError, match=r"process.planar.depth: 'dvl' is of kind 'dvl'"):
        compose_process(aboard('[process.planar]\ndepth = "dvl"\n' + IMU + AIDS).moved_by("planar"), CONTEXT)


# --- the gyros as a correction, and a heading that drifts --------------------------------------------------------------------------


def gyros(text: str = IMU):
    return compose(aboard(text)["imu"], CONTEXT)


def test_gyros_need_a_rate_and_their_bias_wanders_as_in_inertial() -> None:
    with pytest.raises(InputError, match="has no rate_hz"):
        gyros(IMU.replace("rate_hz = 100.0\n", ""))
    walking = gyros().channels[0].nuisances[2]
    stationary = gyros(IMU + 'gyro_bias_process = "gauss_markov"\n').channels[0].nuisances[2]
    hour = DEGREE / 3600
    assert (walking.name, walking.rate) == ("imu.gyro_bias_z", 0.0)
    assert walking.density == pytest.approx((3.0 * hour) ** 2 / 400.0)
    assert (stationary.rate, stationary.density) == pytest.approx((1 / 400.0, 2.0 * (10.0 * hour) ** 2 / 400.0))
    assert walking.sigma == stationary.sigma == pytest.approx(10.0 * hour)
    bias = process("inertial").parameters[3:5]
    assert (walking.rate, walking.density) == pytest.approx(tuple(bias))


@pytest.mark.parametrize("sample", ["mean", "instant", "increment"])
def test_gyros_on_a_steady_circle_leave_nothing(sample: str) -> None:
    """Truth of the simulator, with the turning Earth and a mounting; that of the frame by latitude and radii.

    A mean or an increment is that of the middle of its interval, but for the Earth's rate times (turn)^2 / 24: 1e-11 rad/s.
    """
    mounting, dt = (0.3, -0.2, 1.0), 0.02
    trajectory = circle(Place(LATITUDE, LONGITUDE, depth=20.0), 5.0, speed=1.5, radius=15.0, heading=0.4, weave=SOLID)
    table = simulated.Imu(rate=50.0, sample=sample, mounting_bs=mounting).ideal(trajectory, np.arange(1.0, 4.0, dt))
    sensor = gyros(IMU + f"mounting_deg = {[float(a / DEGREE) for a in mounting]}\n")
    row = sensor.read(table).rows[0]
    channel, at = sensor.channels[0], trajectory.at(table.time - (0.0 if sample == "instant" else 0.5 * dt))
    latitude, longitude, height = at.geodetic
    for k in (0, 70, 149):
        view = view_of(latitude[k], longitude[k], height[k], attitude.quaternion_from_matrix(at.rotation_nb[k]), at.velocity_n[k])
        w = 1.0 - 0.00669437999014 * sin(latitude[k]) ** 2
        prime, meridian = 6378137.0 / w**0.5 + height[k], 6378137.0 * (1.0 - 0.00669437999014) / w**1.5 + height[k]
        transport = np.array([at.velocity_n[k, 1] / prime, -at.velocity_n[k, 0] / meridian, 0.0])
        view[RATE_V : RATE_V + 3] = at.rate_eb_b[k] - at.rotation_nb[k].T @ transport
        z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
        Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
        assert channel.predict(np.concatenate([view, view]), np.zeros(NUISANCES), row.data[k], channel.parameters, z, R, Hv, Hn) == 0
        np.testing.assert_allclose(z[:3] - row.data[k][:3], 0.0, atol=2e-11)
        assert R[1, 1] == pytest.approx((0.1 * DEGREE / 60) ** 2 * 100.0)


def test_gyro_rows_without_an_interval_are_invalid() -> None:
    table = Imu(
        time=[1.0, 2.0], delta_angle=[[0.1, 0.0, 0.0]] * 2, delta_velocity=np.zeros((2, 3)), interval=[0.0, 0.5], sample="increment"
    )
    read = gyros().read(table)
    assert read.rows[0].row.tolist() == [1]
    np.testing.assert_allclose(read.rows[0].data[0, :3], [0.2, 0.0, 0.0])


def test_a_heading_drifts_from_time_zero() -> None:
    """bias + drift t: 20 degrees an hour are 10 degrees after half of it."""
    text = (
        "[sensors.fog]\nkind = 'heading'\nsigma_deg = 0.1\nnuisance = { bias = { value_deg = 3.0 }, drift = { value_deg_per_h = 20.0 } }\n"
    )
    sensor = compose(without_unit(text)["fog"], CONTEXT)
    channel, row = sensor.channels[0], sensor.read(Heading(time=[1800.0], heading=[0.0])).rows[0].data[0]
    view = view_of(LATITUDE, LONGITUDE, 0.0, attitude.quaternion_from_euler(0.0, 0.0, 0.5), np.zeros(3))
    z, R = np.zeros(COMPONENTS), np.zeros((COMPONENTS, COMPONENTS))
    Hv, Hn = np.zeros((COMPONENTS, 2 * TANGENT)), np.zeros((COMPONENTS, NUISANCES))
    values = np.array([nuisance.value for nuisance in channel.nuisances] + [0.0] * (NUISANCES - len(channel.nuisances)))
    assert channel.predict(np.concatenate([view, view]), values, row, channel.parameters, z, R, Hv, Hn) == 0
    assert z[0] == pytest.approx(0.5 + 13.0 * DEGREE)
    assert (Hn[0, 0], Hn[0, 5]) == (1.0, 1800.0)


def test_the_simulator_draws_the_drift_of_a_heading() -> None:
    """What the vehicle file says: its value, and over many seeds its sigma."""
    text = "[sensors.fog]\nkind = 'heading'\nrate_hz = 1.0\nsigma_deg = 0.0001\nnuisance = {{ drift = {{ {} }} }}\n"
    trajectory = circle(Place(LATITUDE, LONGITUDE, depth=20.0), 3600.0, speed=1.5, radius=15.0, weave=SOLID)

    def gained(keys: str, seed: int) -> float:
        instrument = instruments_of(without_unit(text.format(keys)))["fog"]
        exact = instrument.ideal(trajectory, np.array([0.0, 3600.0]))
        off = attitude.wrapped(instrument.noisy(exact, np.random.default_rng(seed)).heading - exact.heading)
        return float(off[1] - off[0]) / DEGREE

    assert gained("value_deg_per_h = 20.0", 0) == pytest.approx(20.0, abs=1e-3)
    drawn = np.array([gained("sigma_deg_per_h = 20.0", seed) for seed in range(400)])
    assert 15.9 < np.sqrt(np.mean(drawn**2)) < 24.1  # 400 numbers: chi-square, five sigmas of 1 / sqrt(800) and more
    with pytest.raises(InputError, match="wanders"):
        gained("sigma_deg_per_h = 20.0, tau_s = 100.0", 0)


# --- whole runs --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["body-velocity", "cruise", "planar"])
def test_without_noise_a_run_follows_the_truth(model: str) -> None:
    """A circle at a steady rate is what all of them hold for natural; aided without errors they stay on it, to the sigmas of the aids."""
    made = {
        "imu": simulated.Imu(rate=50.0, lever_arm_b=(0.3, 0.1, -0.05)),
        "dvl": simulated.Dvl(rate=5.0, offset=0.2, lever_arm_b=(-0.5, 0.1, 0.2)),
        "depth": simulated.Depth(rate=10.0, lever_arm_b=(0.6, 0.1, -0.1)),
        "ahrs": simulated.Attitude(rate=10.0, mounting_bs=tuple(np.radians([10.0, -20.0, 30.0]))),
    }
    trajectory = circle(Place(LATITUDE, LONGITUDE, depth=20.0, surface_height=17.0), 120.0, speed=1.5, radius=25.0, weave=SOLID)
    log = ideal_log(Recorder(trajectory, made, truth_rate=1.0, start=StartSigmas(0.01, 0.01, 0.01, 0.001, 0.001)))
    solution = solve(log, aboard(), process=model, times=log.truth.time)
    error = np.abs(errors_of(solution, log.truth).error[10:])
    assert error[:, :2].max() < (1e-3 if model == "planar" else 2e-5)  # it takes the turn for one in the acceleration
    assert error[:, 2].max() < 2e-5
    assert error[:, 3:6].max() < (1e-3 if model == "planar" else 1e-5)
    assert error[:, 6:9].max() < 1e-5
    judged = {
        "body-velocity": {"dvl", "depth", "ahrs"},  # the unit drives it
        "cruise": {"dvl", "depth", "ahrs", "imu"},
        "planar": {"dvl", "ahrs", "imu"},  # the depth sensor drives it; the attitude sensor does both
    }
    assert set(solution.innovations.sensor.tolist()) == judged[model]
