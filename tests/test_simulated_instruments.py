"""Instruments of the simulator against geometry and equations worked out by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from leadline.data.errors import InputError
from leadline.data.hull import read_hull
from leadline.sea.magnetic import declination, field_n
from leadline.sea.sound import SoundProfile
from leadline.sea.terrain import plane
from leadline.sea.water import Level, Water, Waves
from leadline.simulate.first_order import lagging
from leadline.simulate.instruments import (
    Altimeter,
    Attitude,
    CurrentMeter,
    Depth,
    Drift,
    Dvl,
    Gnss,
    Heading,
    Imu,
    Machinery,
    Magnetometer,
    MotorCurrents,
    Pressure,
    Reception,
    SoundProfileCast,
    SoundSpeedMeter,
    Speed,
    Surrounding,
    ThrusterSpeeds,
    Triad,
    WaterLevel,
    WaterVelocity,
    YawRate,
    beam_vectors,
)
from leadline.simulate.plans import Weave, circle, still, straight
from leadline.simulate.trajectory import Motion, Place, Trajectory

EARTH_RATE = 7.292115e-5
PLACE = Place(radians(32.8), radians(34.9), depth=30.0)
JANUS = tuple(radians(a) for a in (45, 135, 225, 315))
ARM, TURNED = (0.7, -0.4, 0.3), (0.05, -0.1, 0.8)
R_BS = Rotation.from_euler("ZYX", TURNED[::-1]).as_matrix()
DATE = datetime(2025, 1, 1, tzinfo=UTC)
HERE = (PLACE.latitude, PLACE.longitude, -PLACE.depth, DATE, "x")


@dataclass(frozen=True)
class Steady:
    """Constant acceleration (t), rate (body) and attitude at time 0 (roll, pitch, heading), from rest or a velocity (t)."""

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, time: np.ndarray) -> Motion:
        v, a, w = (np.array(x)[None] * np.ones((len(time), 1)) for x in (self.velocity, self.acceleration, self.rate))
        t = time[:, None]
        rotation = Rotation.from_euler("ZYX", self.angles[::-1]) * Rotation.from_rotvec(w * t)
        return Motion(v * t + 0.5 * a * t * t, v + a * t, a, rotation.as_matrix(), w, 0 * w)


def moving(place: Place = PLACE, duration: float = 100.0, **law: Any) -> Trajectory:
    return Trajectory(place, Steady(**law), duration)


def made(instrument: Any, trajectory: Trajectory, seed: int = 1, duration: float | None = None) -> Any:
    duration = trajectory.duration if duration is None else duration
    time = instrument.sampling(duration, np.random.default_rng(seed))
    return instrument.record(instrument.ideal(trajectory, time), np.random.default_rng(seed))


def rotation(roll: float, pitch: float, heading: float) -> np.ndarray:
    return np.asarray(Rotation.from_euler("ZYX", (heading, pitch, roll)).as_matrix())


def spread(values: np.ndarray, sigma: float) -> bool:
    """Whether independent normal values have this sigma: chi-square, 99.9 %."""
    low, high = chi2.ppf([0.0005, 0.9995], values.size)
    return bool(low < np.sum((values / sigma) ** 2) < high)


# The clock of the device, quanta and limits


def test_a_device_clock_stamps_what_it_shows_and_the_computer_what_arrives() -> None:
    trajectory = moving(velocity=(1.0, 0.0, 0.0))
    plain = Depth(rate=2.0, sigma=0.1, latency=0.3, latency_jitter=0.1, loss=0.2)
    before, after = made(plain, trajectory), made(replace(plain, stamp_offset=1.5, stamp_drift=1e-3), trajectory)
    assert_allclose(after.time, before.time * 1.001 + 1.5, atol=1e-12)
    assert_array_equal(after.device_time, after.time)
    assert_array_equal(after.received, before.received)
    assert_array_equal(after.depth, before.depth)
    on_time = made(Depth(rate=2.0, stamp_offset=-0.5), trajectory)
    assert_allclose(on_time.received - on_time.time, 0.5, atol=1e-12)
    jittering = made(Depth(rate=20.0, stamp_jitter=2e-3), trajectory)
    assert spread(jittering.time - jittering.received, 2e-3)
    assert before.device_time is None


def test_quanta_are_whole_and_limits_hold() -> None:
    trajectory = moving(velocity=(1.234, 0.0, 0.0))
    speed = made(Speed(rate=1.0, sigma=0.5, quantum=0.1, limit=1.0), trajectory).speed
    assert_allclose(speed, np.round(speed, 1), atol=1e-12)
    assert np.max(speed) == pytest.approx(1.0)
    deep = made(Depth(rate=1.0, sigma=1.0, limit=30.0), trajectory).depth
    assert 0 < np.sum(np.isnan(deep)) < len(deep)
    assert np.nanmax(deep) <= 30.0
    full = made(Heading(rate=1.0, quantum=0.1), moving(angles=(0.0, 0.0, 2 * pi - 0.01))).heading
    assert_allclose(full, (0.1 * np.round((2 * pi - 0.01) / 0.1)) % (2 * pi), atol=1e-12)
    assert np.all(full < 2 * pi)


# Gyros and accelerometers


def test_bent_axes_are_matrices_drawn_at_turn_on() -> None:
    weave = Weave((0.3, 6.1), (0.2, 7.3), (0.1, 9.0), (0.4, 11.0), (0.3, 5.0), (0.2, 4.0))
    trajectory = straight(PLACE, 20.0, speed=1.0, weave=weave)
    bent = Triad(scale=(0.01, -0.02, 0.005), sigma_scale=0.01, sigma_misalignment=0.003)
    imu = Imu(rate=10.0, sample="instant", gyro_axes=bent, accel_axes=bent, g_sensitivity=1e-4, sigma_g_sensitivity=2e-5)
    ideal = imu.ideal(trajectory, imu.sampling(20.0, np.random.default_rng(0)))
    gyro, accel, coupling = [], [], []
    for seed in range(200):
        found = imu.record(ideal, np.random.default_rng(seed))
        inputs = np.concatenate([ideal.gyro, ideal.accel], axis=1)
        outputs = np.concatenate([found.gyro, found.accel], axis=1)
        whole = np.linalg.lstsq(inputs, outputs, rcond=None)[0].T
        assert_allclose(inputs @ whole.T, outputs, atol=1e-9)
        gyro.append(whole[:3, :3]), accel.append(whole[3:, 3:]), coupling.append(whole[:3, 3:])
        assert_allclose(whole[3:, :3], 0.0, atol=1e-6)  # no rate is felt as a force
    diagonal = np.eye(3, dtype=bool)
    for found in (np.array(gyro), np.array(accel)):
        error = found - np.eye(3) - np.diag(bent.scale)
        assert spread(error[:, diagonal], 0.01)
        assert spread(error[:, ~diagonal], 0.003)
    assert spread(np.array(coupling) - 1e-4 * np.eye(3), 2e-5)


def test_increments_are_bent_as_means_are() -> None:
    trajectory = moving(rate=(0.1, -0.2, 0.3), duration=5.0)
    axes = Triad(scale=(0.01, -0.02, 0.005), sigma_misalignment=0.01)
    imu = Imu(rate=10.0, gyro_axes=axes, accel_axes=axes, sigma_g_sensitivity=1e-3)
    mean, increment = made(imu, trajectory), made(replace(imu, sample="increment"), trajectory)
    assert_allclose(increment.delta_angle / increment.interval[:, None], mean.gyro, atol=1e-12)
    assert_allclose(increment.delta_velocity / increment.interval[:, None], mean.accel, atol=1e-11)


def test_quanta_and_limits_of_an_imu_are_those_of_each_triad() -> None:
    trajectory = moving(rate=(0.5, 0.1, -0.7), duration=20.0)
    imu = Imu(rate=10.0, sample="instant", gyro_axes=Triad(quantum=1e-3, limit=0.6), accel_axes=Triad(quantum=0.01), gyro_density=0.01)
    found = made(imu, trajectory)
    assert_allclose(found.gyro / 1e-3, np.round(found.gyro / 1e-3), atol=1e-9)
    assert_allclose(found.gyro[:, 2], -0.6)
    assert_allclose(found.accel / 0.01, np.round(found.accel / 0.01), atol=1e-9)
    counted = made(replace(imu, sample="increment", gyro_density=0.0), trajectory)
    true = made(Imu(rate=10.0, sample="increment"), trajectory)
    assert_allclose(counted.delta_angle / 1e-4, np.round(counted.delta_angle / 1e-4), atol=1e-8)
    missing = np.cumsum(counted.delta_angle - true.delta_angle, axis=0)
    assert np.max(np.abs(missing[:, :2])) <= 0.5e-4 + 1e-12  # the sum is never off by more than half a quantum
    assert_allclose(counted.delta_angle[:, 2], -0.06, atol=1e-12)


@pytest.mark.parametrize(("latitude", "heading"), [(32.8, 0.0), (-60.0, 1.1), (89.0, 4.0)])
def test_a_fibre_gyro_at_rest_feels_the_earth_turn(latitude: float, heading: float) -> None:
    """W (cos L, 0, -sin L) north, east, down: along an axis that is pitched and rolled, by hand."""
    roll, pitch = 0.2, -0.3
    down_axis = np.array([
        cos(roll) * sin(pitch) * cos(heading) + sin(roll) * sin(heading),
        cos(roll) * sin(pitch) * sin(heading) - sin(roll) * cos(heading),
        cos(roll) * cos(pitch),
    ])  # fmt: skip
    lat = radians(latitude)
    right = EARTH_RATE * np.array([cos(lat), 0.0, -sin(lat)]) @ down_axis
    trajectory = moving(Place(lat, 0.3, 20.0), angles=(roll, pitch, heading))
    assert_allclose(made(YawRate(rate=1.0), trajectory).yaw_rate, right, atol=1e-16)
    assert_allclose(made(YawRate(rate=1.0, earth_removed=True), trajectory).yaw_rate, 0.0, atol=1e-16)


def test_a_lag_is_that_of_its_differential_equation() -> None:
    def drive(t: np.ndarray) -> np.ndarray:
        return np.sin(1.3 * t) + 0.2 * t

    time = np.sort(np.random.default_rng(2).uniform(0.0, 20.0, 60))
    found = lagging(time, lambda t: drive(t)[:, None], 0.8)[:, 0]
    right = solve_ivp(lambda t, x: (drive(t) - x) / 0.8, (time[0], time[-1]), [drive(time[0])], t_eval=time, rtol=1e-10, atol=1e-12).y[0]
    assert_allclose(found, right, atol=0.02**2 * 1.3**2 / 8)  # straight between moments 20 ms apart
    assert_array_equal(lagging(time, lambda t: drive(t)[:, None], 0.0)[:, 0], drive(time))
    with pytest.raises(InputError, match="lags by -1"):
        lagging(time, lambda t: drive(t)[:, None], -1.0)


def test_a_lagging_yaw_rate_in_a_steady_turn_is_the_rate() -> None:
    trajectory = moving(rate=(0.0, 0.0, 0.3))
    assert_allclose(made(YawRate(rate=5.0, lag=0.5, earth_removed=True), trajectory).yaw_rate, 0.3, atol=1e-12)


# Attitude and heading


def triad_attitude(down: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Rotation from the sensor to magnetic north, east, down that takes a felt direction for down and a felt field for north."""
    d = down / np.linalg.norm(down)
    e = np.cross(d, field)
    e /= np.linalg.norm(e)
    return np.array([np.cross(e, d), e, d])


@pytest.mark.parametrize("heading", [0.0, 0.9, 2.5, 4.4])
def test_a_steady_acceleration_tilts_an_attitude_as_a_plumb_line_is(heading: float) -> None:
    """After long, down is against the specific force, and magnetic north is level to that: worked out of the two vectors alone."""
    pull, angles = (0.12, -0.2, 0.05), (0.1, -0.15, heading)
    trajectory = moving(acceleration=pull, angles=angles, duration=6.0)
    gravity = 9.7957  # at 32.8 degrees, 30 m below: to 1e-4 of itself, so angles to 3e-6
    r_nb = rotation(*angles)
    force_b = r_nb.T @ (np.array(pull) - [0.0, 0.0, gravity])
    field = field_n(*HERE)
    magnetic = triad_attitude(-force_b, r_nb.T @ field)
    found = made(Attitude(rate=4.0, tilt_gain=1.0, tilt_tau=0.2, date=DATE), trajectory)
    last = rotation(found.roll[-1], found.pitch[-1], found.heading[-1])
    # first order: what is left is half the square of the lean (0.024 rad), times tan of the dip (1.1) for the heading
    assert np.linalg.norm(Rotation.from_matrix(last @ magnetic.T).as_rotvec()) < 0.024**2 * (1 + 1.1)
    without = made(Attitude(rate=4.0, tilt_gain=1.0, tilt_tau=0.2), trajectory)
    level = rotation(without.roll[-1], without.pitch[-1], without.heading[-1]) @ force_b / np.linalg.norm(force_b)
    assert np.hypot(level[0], level[1]) < 0.024**2
    compass = made(Heading(rate=4.0, tilt_gain=1.0, tilt_tau=0.2, date=DATE), trajectory)
    assert_allclose(compass.heading, found.heading, atol=1e-12)


def test_signs_of_a_lean() -> None:
    """Heading north: to gain speed looks like the nose up; to be pulled to starboard like starboard up, a negative roll."""
    forward = made(Attitude(rate=4.0, tilt_gain=1.0, tilt_tau=0.1), moving(acceleration=(0.5, 0.0, 0.0), duration=3.0))
    aside = made(Attitude(rate=4.0, tilt_gain=0.5, tilt_tau=0.1), moving(acceleration=(0.0, 0.5, 0.0), duration=3.0))
    assert forward.pitch[-1] == pytest.approx(0.5 / 9.8, rel=2e-3)
    assert aside.roll[-1] == pytest.approx(-0.25 / 9.8, rel=2e-3)
    assert np.max(np.abs([forward.roll, aside.pitch])) < 2.3e-5  # Coriolis at 1.5 m/s: 2 W v / g


def test_a_lean_grows_with_its_time_constant_and_turns_average_out() -> None:
    tau = 5.0
    found = made(Attitude(rate=4.0, tilt_gain=1.0, tilt_tau=tau), moving(acceleration=(0.3, 0.0, 0.0), duration=20.0))
    final = 0.3 / 9.7957
    assert_allclose(found.pitch, final * (1 - np.exp(-found.time / tau)), atol=final * 1e-2 * 0.5)
    turn = circle(PLACE, 600.0, speed=2.0, radius=20.0, weave=Weave())
    period, pull = 2 * pi * 20.0 / 2.0, 2.0**2 / 20.0
    rows = made(Attitude(rate=4.0, tilt_gain=1.0, tilt_tau=30.0), turn)
    true = made(Attitude(rate=4.0), turn)
    off = np.hypot(rows.roll - true.roll, rows.pitch - true.pitch)[rows.time > 200.0]
    right = pull / 9.7957 / np.hypot(1.0, 2 * pi / period * 30.0)  # of a vector that goes round, through a first-order lag
    assert_allclose(off, right, rtol=0.02)


def test_a_magnetic_compass_shows_the_declination_less() -> None:
    trajectory = moving(angles=(0.0, 0.0, 1.0))
    right = 1.0 - declination(*HERE)
    assert_allclose(made(Heading(rate=1.0, date=DATE), trajectory).heading, right, atol=1e-12)
    assert_allclose(made(Attitude(rate=1.0, date=DATE), trajectory).heading, right, atol=1e-12)
    with pytest.raises(InputError, match="magnetic pole"):
        made(Heading(rate=1.0, date=DATE), moving(Place(radians(86.0), radians(140.0), 10.0)))


# The magnetic field


# At the ellipsoid, X, Y, Z in nT: 2020 as in the report of WMM2020 (Chulliat et al.); 2025 as pygeomag gives them: no witness of the model.
PUBLISHED = [
    (2020, 80.0, 0.0, (6570.4, -146.3, 54606.0)),
    (2020, 0.0, 120.0, (39624.3, 109.9, -10932.5)),
    (2020, -80.0, 240.0, (5940.6, 15772.1, -52480.8)),
    (2025, 80.0, 0.0, (6521.6, 145.9, 54791.5)),
    (2025, 0.0, 120.0, (39677.8, -109.6, -10580.2)),
    (2025, -80.0, 240.0, (6117.5, 15751.9, -52022.5)),
]


@pytest.mark.parametrize(("year", "latitude", "longitude", "right"), PUBLISHED)
def test_the_field_has_its_published_values(year: int, latitude: float, longitude: float, right: tuple[float, ...]) -> None:
    found = field_n(radians(latitude), radians(longitude), 0.0, datetime(year, 1, 1, tzinfo=UTC), "x")
    assert_allclose(found * 1e9, right, atol=0.0501)


def test_a_field_of_the_past_is_refused() -> None:
    with pytest.raises(InputError, match="field of 1999"):
        field_n(0.5, 0.5, 0.0, datetime(1999, 1, 1, tzinfo=UTC), "x")


def test_heading_east_the_northern_field_comes_from_port() -> None:
    north = (3e-5, 0.0, 4e-5)
    for heading, right in ((0.0, (3e-5, 0.0, 4e-5)), (pi / 2, (0.0, -3e-5, 4e-5)), (pi, (-3e-5, 0.0, 4e-5)), (-pi / 2, (0.0, 3e-5, 4e-5))):
        found = made(Magnetometer(rate=1.0, field_n=north), moving(angles=(0.0, 0.0, heading)))
        assert_allclose(found.field, np.tile(right, (len(found), 1)), atol=1e-18)
    nose_up = made(Magnetometer(rate=1.0, field_n=north), moving(angles=(0.0, pi / 2, 0.0)))
    assert_allclose(nose_up.field[0], (-4e-5, 0.0, 3e-5), atol=1e-18)


def test_a_magnetometer_among_iron_and_motors() -> None:
    angles = (0.3, -0.2, 1.2)
    soft = ((1.1, 0.02, -0.03), (0.05, 0.9, 0.01), (0.0, 0.04, 1.0))
    hard = (1e-6, -2e-6, 3e-6)
    coupling = ((1e-7, 2e-7), (0.0, -1e-7), (3e-7, 0.0))
    motors = Machinery(np.array([0.0, 100.0]), np.array([[0.0, -10.0], [20.0, -10.0]]), idle=0.5, drawn=1e-3)
    it = Magnetometer(rate=1.0, date=DATE, mounting_bs=TURNED, soft_iron=soft, hard_iron=hard, motor_coupling=coupling, machinery=motors)
    found = made(it, moving(angles=angles))
    earth = R_BS.T @ rotation(*angles).T @ field_n(*HERE)
    for k in (0, 40, 100):
        currents = np.array([0.5 + 1e-3 * (0.2 * k) ** 3, 0.5 + 1e-3 * 10.0**3])
        assert_allclose(found.field[k], np.array(soft) @ earth + hard + np.array(coupling) @ currents, atol=1e-16)
    noisy = Magnetometer(rate=1.0, date=DATE, sigma=1e-8, sigma_hard=1e-6, sigma_soft=0.01)
    errors = np.array([made(noisy, moving(angles=angles), seed, 3.0).field for seed in range(300)])
    b = rotation(*angles).T @ field_n(*HERE)
    assert spread((errors[:, 0] - b), np.hypot(np.hypot(1e-6, 0.01 * np.linalg.norm(b)), 1e-8))
    assert spread((errors[:, 1] - errors[:, 0]), np.sqrt(2) * 1e-8)
    with pytest.raises(InputError, match="motors"):
        made(replace(it, machinery=None), moving())


# Doppler logs


def test_without_noise_a_doppler_log_is_the_velocity_of_its_point() -> None:
    """R^T (v + w x l) in sensor axes, of a vehicle that drives, dives and turns."""
    velocity, rate, angles = np.array([1.2, -0.4, 0.3]), np.array([0.1, -0.05, 0.2]), (0.2, -0.1, 0.7)
    trajectory = moving(velocity=tuple(velocity), rate=tuple(rate), angles=angles, duration=20.0)
    found = made(Dvl(rate=2.0, lever_arm_b=ARM, mounting_bs=TURNED, azimuths=JANUS, tilt=0.5, output="both"), trajectory)
    for k in range(len(found)):
        r_nb = rotation(*angles) @ Rotation.from_rotvec(rate * found.time[k]).as_matrix()
        right = R_BS.T @ (r_nb.T @ velocity + np.cross(rate, ARM))
        assert_allclose(found.velocity[k], right, atol=1e-9)
        assert_allclose(found.beam[k], beam_vectors(JANUS, 0.5) @ right, atol=1e-9)
    assert np.all(found.valid == 1)


SLOPE = (0.1, -0.05)
BED = plane(80.0, *SLOPE, (-500.0, 500.0, -500.0, 500.0), 50.0)


def slants(r_ns: np.ndarray, depth: float, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances along beams from a point above the origin to the plane, and by how much they go down: a line and a plane."""
    u = beam_vectors(JANUS, tilt) @ r_ns.T
    return (80.0 - depth) / (u[:, 2] - u[:, :2] @ SLOPE), u[:, 2]


NEAR = 2e-3  # m: 100 m from the place the level surface has dropped by 0.8 mm; a metre 30 m down is 5e-6 longer on the chart


def test_ranges_of_a_rolled_and_pitched_log_over_a_slope() -> None:
    angles, tilt = (0.15, -0.2, 0.6), radians(25)
    dvl = Dvl(rate=1.0, mounting_bs=TURNED, azimuths=JANUS, tilt=tilt, seabed=BED, output="both")
    found = made(dvl, moving(angles=angles))
    right, down = slants(rotation(*angles) @ R_BS, 30.0, tilt)
    assert_allclose(found.range, np.tile(right, (len(found), 1)), atol=NEAR)
    assert_allclose(found.altitude, np.mean(right * down), atol=NEAR)
    upright = made(Dvl(rate=1.0, seabed=BED), moving())
    assert_allclose(upright.altitude, 50.0, atol=NEAR)


def test_a_level_bed_of_limited_range_is_met_by_trigonometry() -> None:
    seabed = Surrounding("seabed.depth", (80.0,))
    pitch, tilt = radians(10), radians(30)
    dvl = Dvl(rate=1.0, azimuths=(0.0, pi / 2, pi, 3 * pi / 2), tilt=tilt, seabed=seabed, range_max=100.0, output="both")
    found = made(dvl, moving(angles=(0.0, pitch, 0.0)))
    across = 50.0 / (cos(tilt) * cos(pitch))
    assert_allclose(found.range[0], [50.0 / cos(tilt + pitch), across, 50.0 / cos(tilt - pitch), across], atol=1e-6)
    assert_allclose(found.altitude, 50.0, atol=1e-6)


def test_beams_out_of_reach_are_lost_and_with_two_the_row() -> None:
    angles, tilt = (0.15, -0.2, 0.6), radians(25)
    right, _ = slants(rotation(*angles), 30.0, tilt)
    order = np.sort(right)
    trajectory = moving(velocity=(1.0, 0.5, 0.0), angles=angles, duration=1.0)
    for lost in range(5):
        reach = order[-1] + 5.0 if lost == 0 else 0.5 * (order[3 - lost] + order[4 - lost]) if lost < 4 else order[0] - 5.0
        found = made(Dvl(rate=1.0, azimuths=JANUS, tilt=tilt, seabed=BED, range_max=reach, output="both"), trajectory)
        assert_array_equal(found.beam_valid[0], right < reach)
        assert_array_equal(np.isnan(found.range[0]), right > reach)
        assert found.valid[0] == (lost < 2)
        assert np.isnan(found.velocity[0]).all() == (lost >= 2)
        assert np.isnan(found.altitude[0]) == (lost >= 2)
        near = made(Dvl(rate=1.0, azimuths=JANUS, tilt=tilt, seabed=BED, range_min=reach, output="beams"), trajectory)
        assert_array_equal(near.beam_valid[0], right > reach)
        assert near.valid[0] == (lost > 0)
    above = made(Dvl(rate=1.0, seabed=BED, range_max=40.0), trajectory)
    assert not above.valid.any()
    assert np.isnan(above.velocity).all()


def test_noise_of_a_doppler_log_grows_with_speed_and_range() -> None:
    trajectory = moving(velocity=(3.0, 4.0, 0.0), duration=2.0)
    dvl = Dvl(rate=2000.0, sigma=0.01, sigma_fraction=0.004)
    assert spread(made(dvl, trajectory).velocity - (3.0, 4.0, 0.0), np.hypot(0.01, 0.02))
    beams = replace(dvl, sigma=0.0, azimuths=JANUS, tilt=0.5, output="both", beam_sigma=0.01, seabed=BED, error_velocity=True)
    beams = replace(beams, sigma_range=0.03, sigma_range_fraction=1e-3)
    found = made(beams, moving(duration=2.0))
    ideal = made(replace(beams, beam_sigma=0.0, sigma_range=0.0, sigma_range_fraction=0.0), moving(duration=2.0))
    assert spread(found.beam - ideal.beam, 0.01)
    assert spread((found.range - ideal.range) / np.hypot(0.03, 1e-3 * ideal.range), 1.0)
    horizontal = 0.01 / (np.sqrt(2) * sin(0.5))  # of x and of y of a Janus of four, by hand
    assert spread(found.velocity[:, 0], horizontal)
    assert spread(found.error_velocity, horizontal)
    assert abs(np.mean(found.error_velocity * found.velocity[:, 0])) < 4 * horizontal**2 / np.sqrt(len(found))
    assert_allclose(ideal.error_velocity, 0.0, atol=1e-12)
    by_hand = (found.beam @ [1.0, -1.0, 1.0, -1.0]) / (2 * np.sqrt(2) * sin(0.5))
    assert_allclose(np.abs(found.error_velocity), np.abs(by_hand), atol=1e-12)


def test_sound_slower_than_reckoned_stretches_what_a_log_shows() -> None:
    profile = SoundProfile(np.array([0.0, 100.0]), np.array([1460.0, 1560.0]))  # 1490 m/s at 30 m
    trajectory = moving(velocity=(2.0, 0.5, 0.2), duration=1.0)
    dvl = Dvl(rate=1.0, azimuths=JANUS, tilt=0.5, seabed=BED, output="both")
    plain, piston, phased = (made(d, trajectory) for d in (dvl, replace(dvl, profile=profile), replace(dvl, profile=profile, phased=True)))
    k = 1500.0 / 1490.0
    assert_allclose(piston.velocity[0], k * plain.velocity[0], rtol=1e-9)
    assert_allclose(piston.range[0], k * plain.range[0], rtol=1e-9)
    assert_allclose(phased.velocity[0, :2], plain.velocity[0, :2], rtol=1e-9)
    # a phased array's beam leans by asin(sin(tilt) / k): its Doppler, reckoned with 1500 m/s, along the beam that is there
    leaning = beam_vectors(JANUS, np.arcsin(sin(0.5) / k))
    assert_allclose(phased.beam[0], k * leaning @ plain.velocity[0], rtol=1e-9)
    assert piston.sound_speed[0] == 1500.0


SHEARED = Water(shear=((0.0, 0.5, 0.0), (100.0, -0.5, 0.4)))


def test_a_water_track_sees_the_current_of_its_cell() -> None:
    place = replace(PLACE, water=SHEARED)
    angles, velocity = (0.0, 0.0, 0.8), np.array([1.0, 0.3, 0.0])
    trajectory = moving(place, velocity=tuple(velocity), angles=angles, duration=1.0)
    r_nb = rotation(*angles)

    def right(depth: float) -> np.ndarray:
        return np.asarray(r_nb.T @ (velocity - [0.5 - 0.01 * depth, 0.004 * depth, 0.0]))

    cell = made(WaterVelocity(rate=1.0, cell_start=10.0, cell_end=30.0), trajectory)
    assert_allclose(cell.velocity[0], right(50.0), atol=1e-9)
    assert (cell.cell_start[0], cell.cell_end[0]) == (10.0, 30.0)
    assert_allclose(made(WaterVelocity(rate=1.0), trajectory).velocity[0], right(30.0), atol=1e-9)
    upward = made(WaterVelocity(rate=1.0, cell_start=5.0, cell_end=15.0, mounting_bs=(pi, 0.0, 0.0)), trajectory)
    assert_allclose(upward.velocity[0] * (1, -1, -1), right(20.0), atol=1e-9)
    assert_allclose(made(Speed(rate=1.0, lever_arm_b=(0.0, 0.0, 2.0)), trajectory).speed[0], right(32.0)[0], atol=1e-9)
    more = made(Speed(rate=1.0, current=Surrounding("water.current", (0.1, 0.0))), trajectory)
    assert more.speed[0] == pytest.approx(right(30.0)[0] - 0.1 * cos(0.8), abs=1e-9)
    assert made(Speed(rate=1.0, current=None), trajectory).speed[0] == pytest.approx(right(30.0)[0], abs=1e-9)


@pytest.mark.parametrize(("end", "up", "valid"), [(40.0, False, 1), (49.0, False, 0), (60.0, False, 0), (29.0, True, 1), (31.0, True, 0)])
def test_a_cell_holds_water_and_nothing_else(end: float, up: bool, valid: int) -> None:
    """50 m above the ground, 30 m below the surface; with beams at 30 degrees side lobes hide what is deeper than 43.3 m below."""
    mounting = (pi if up else 0.0, 0.0, 0.0)
    log = WaterVelocity(rate=1.0, cell_start=5.0, cell_end=end, seabed=BED, azimuths=JANUS, tilt=radians(30), mounting_bs=mounting)
    found = made(log, moving(velocity=(1.0, 0.0, 0.0), duration=1.0))
    assert found.valid[0] == valid
    assert np.isnan(found.velocity[0]).all() == (not valid)


# Depth, pressure, altitude


def test_tide_and_waves_are_in_depth_and_pressure() -> None:
    water = Water(levels=(Level(1.5, 1000.0),), waves=Waves(1.0, 8.0, seed=3))
    trajectory = moving(replace(PLACE, water=water), duration=200.0)
    time = np.arange(201.0)
    tide = 1.5 * np.cos(2 * pi * time / 1000.0)
    amplitude, number, omega, phase = water.waves.rows.T[[0, 1, 2, 5]]
    psi = phase - omega * time[:, None]
    head = np.sum(amplitude * np.exp(-number * (30.0 + tide)[:, None]) * np.cos(psi), axis=1)
    assert_allclose(made(Depth(rate=1.0), trajectory).depth, 30.0 + tide + head, atol=1e-6)
    assert np.std(head) > 1e-3
    gauge = Pressure(rate=1.0, density=1025.0, gravity=9.81)
    assert_allclose(made(gauge, trajectory).pressure, 101325.0 + 1025.0 * 9.81 * (30.0 + tide + head), atol=0.02)
    heavy = made(replace(gauge, weather=Drift(constant=2000.0)), trajectory).pressure
    assert_allclose(heavy - made(gauge, trajectory).pressure, 2000.0, atol=1e-6)


def test_an_altimeter_looks_along_its_axis_onto_a_chart() -> None:
    angles = (0.15, -0.2, 0.6)
    axis = rotation(*angles)[:, 2]
    right = 50.0 / (axis[2] - axis[:2] @ SLOPE)
    look = Altimeter(rate=1.0, seabed=BED)
    assert_allclose(made(look, moving(angles=angles)).range, right, atol=NEAR)
    assert np.isnan(made(replace(look, range_max=right - 1.0), moving(angles=angles)).range).all()
    assert np.isnan(made(replace(look, range_min=right + 1.0), moving(angles=angles)).range).all()
    assert np.isnan(made(replace(look, limit=right - 1.0), moving(angles=angles)).range).all()
    # upright over the slope, a beam finds the ground nearest where it leans uphill: one of eight rays does so within 22.5 degrees
    half, steep = 0.06, float(np.hypot(*SLOPE))
    wide = made(replace(look, opening=2 * half), moving()).range[0]
    assert 50.0 / (cos(half) + steep * sin(half)) - NEAR < wide < 50.0 / (cos(half) + steep * cos(pi / 8) * sin(half)) + NEAR
    level = Surrounding("seabed.depth", (80.0,))
    assert_allclose(made(replace(look, seabed=level), moving(angles=(0.0, 0.3, 0.0))).range, 50.0 / cos(0.3), atol=1e-6)
    assert np.isnan(made(replace(look, seabed=level), moving(angles=(0.0, 2.0, 0.0))).range).all()


# Satellites


@dataclass(frozen=True)
class Bobbing:
    """At the surface, but for dives of 5 m at given spans of time (s)."""

    dives: tuple[tuple[float, float], ...]

    def __call__(self, time: np.ndarray) -> Motion:
        z = np.zeros((len(time), 3))
        down = z.copy()
        for begin, end in self.dives:
            down[(begin <= time) & (time < end), 2] = 5.0
        return Motion(down, z, z, np.tile(np.eye(3), (len(time), 1, 1)), z, z)


def afloat(*dives: tuple[float, float], duration: float = 2000.0) -> Trajectory:
    return Trajectory(Place(0.5, 0.6), Bobbing(dives), duration)


def test_a_receiver_finds_its_fix_again_step_by_step() -> None:
    stages = (("single", 0.0), ("float", 20.0), ("fixed", 60.0))
    reception = Reception(cold=40.0, least=40.0, hot=5.0, hot_least=5.0, hot_for=60.0, stages=stages)
    sigmas = {"single": (2.0, 2.0, 4.0), "fixed": (0.02, 0.02, 0.04)}
    gnss = Gnss(rate=1.0, sigma=(0.5, 0.5, 1.0), sigmas=sigmas, max_depth=1.0, sigma_velocity=0.1, reception=reception)
    found = made(gnss, afloat((100.0, 130.0), (500.0, 800.0)))
    kind = dict(zip(found.time, found.fix_type, strict=True))
    assert [kind[t] for t in (0.0, 99.0)] == ["fixed", "fixed"]  # it lay on deck for long
    assert [kind[t] for t in (130.0, 134.0, 136.0, 154.0, 156.0, 196.0)] == ["none", "none", "single", "single", "float", "fixed"]
    assert [kind[t] for t in (800.0, 838.0, 841.0, 861.0, 901.0)] == ["none", "none", "single", "float", "fixed"]
    assert not set(kind) & set(np.arange(100.0, 130.0))
    none = found.fix_type == "none"
    assert_array_equal(found.valid, (~none).astype(float))
    for column in (found.latitude, found.longitude, found.height, found.velocity[:, 0], found.sigma_axes[:, 0], found.hdop):
        assert_array_equal(np.isnan(column), none)
    assert_array_equal(found.satellites == 0, none)
    north = 6335439.0 * (1 + 3.0 * 0.00669438 * sin(0.5) ** 2 / 2) * (found.latitude - 0.5)  # of the meridian, to 1e-4
    for name, sigma in (("single", 2.0), ("float", 0.5), ("fixed", 0.02)):
        rows = found.fix_type == name
        assert spread(north[rows] / sigma, 1.0), name
        assert_array_equal(found.sigma_axes[rows, 0], sigma)


def test_the_time_to_the_first_fix_is_a_least_and_an_exponential() -> None:
    dives = tuple((1000.0 * k, 1000.0 * k + 300.0) for k in range(200))
    reception = Reception(cold=60.0, least=20.0)
    found = made(Gnss(rate=10.0, max_depth=1.0, reception=reception), afloat(*dives, duration=200_000.0))
    start = found.time[np.flatnonzero(np.diff(found.fix_type != "none", prepend=False) & (found.fix_type != "none"))]
    delay = start % 1000.0 - 300.0
    assert len(delay) == 200
    assert np.min(delay) >= 20.0
    assert kstest(delay - 20.0 - 0.05, "expon", args=(0.0, 40.0)).pvalue > 1e-3  # rows are 0.1 s apart: half of that late in the mean


def test_spray_and_lapses_come_at_their_rates() -> None:
    reception = Reception(stages=(("single", 0.0), ("fixed", 0.0)), wash=0.2, lapse=0.1)
    found = made(Gnss(rate=1.0, reception=reception), afloat(duration=9999.0))
    share = {kind: np.mean(found.fix_type == kind) for kind in ("none", "single", "fixed")}
    for kind, right in (("none", 0.2), ("single", 0.08), ("fixed", 0.72)):
        assert abs(share[kind] - right) < 4 * np.sqrt(right * (1 - right) / 1e4), kind


def test_a_reception_that_makes_no_sense_is_refused() -> None:
    for wrong in ({"stages": (("single", 5.0),)}, {"stages": (("good", 0.0),)}, {"stages": ()}, {"cold": 5.0, "least": 9.0}):
        with pytest.raises(InputError, match="Gnss"):
            Reception(**wrong)


# Machinery


def test_thrusters_and_motors_tell_of_a_voyage() -> None:
    time = np.arange(0.0, 10.0, 0.1)
    speeds, rudder = np.stack([time, -2.0 * time], axis=1), 0.01 * time
    machinery = Machinery(time, speeds, rudder=rudder, idle=0.2, drawn=0.01, power=2.0)
    told = made(ThrusterSpeeds(rate=4.0, machinery=machinery), moving(duration=9.0))
    assert_allclose(told.thruster, np.stack([told.time, -2 * told.time], axis=1), atol=1e-12)
    assert_allclose(told.rudder, 0.01 * told.time, atol=1e-12)
    assert told.stern is None
    drawn = made(MotorCurrents(rate=4.0, machinery=machinery), moving(duration=9.0))
    assert_allclose(drawn.motor[8], [0.2 + 0.01 * 2.0**2, 0.2 + 0.01 * 4.0**2], atol=1e-12)
    noisy = made(ThrusterSpeeds(rate=100.0, machinery=machinery, sigma=0.1, sigma_angle=0.02), moving(duration=9.0))
    assert spread(noisy.thruster[:, 0] - noisy.time, 0.1)
    assert spread(noisy.rudder - 0.01 * noisy.time, 0.02)
    with pytest.raises(InputError, match="machinery"):
        Machinery(time, speeds[:5])


def test_the_machinery_of_a_hull_has_its_thrusters_and_fins() -> None:
    hull = read_hull("remus-100")
    names = hull.actuators
    moved = np.arange(2.0 * len(names)).reshape(2, -1)
    machinery = Machinery.of(hull, np.array([0.0, 1.0]), moved)
    assert machinery.thrusters.shape[1] == len(hull.thrusters)
    for kind, angle in (("rudder", machinery.rudder), ("stern", machinery.stern)):
        columns = [names.index(fin.name) for fin in hull.fins if fin.kind == kind]
        assert columns
        assert_allclose(angle, moved[:, columns].mean(axis=1))


# Water


def test_instruments_of_the_water_see_the_water() -> None:
    water = Water(shear=SHEARED.shear, levels=(Level(1.5, 1000.0, 200.0),))
    trajectory = moving(replace(PLACE, water=water), duration=200.0)
    gauge = made(WaterLevel(rate=0.1, mean=0.4), trajectory)
    tide = 1.5 * np.cos(2 * pi * (gauge.time - 200.0) / 1000.0)
    assert_allclose(gauge.water_level, 0.4 + tide, atol=1e-12)
    here = made(CurrentMeter(rate=0.1, vertical=True), trajectory)
    assert_allclose(here.depth, 30.0 + tide, atol=1e-6)
    assert_allclose(here.current, np.tile([0.5 - 0.3, 0.12], (len(here), 1)), atol=1e-9)  # layers keep their depth below the mean surface
    assert_array_equal(here.current_down, 0.0)
    there = made(CurrentMeter(rate=0.1, depth=75.0, current=Surrounding("water.current", (0.05, 0.0)), sigma=0.0), trajectory)
    below = 75.0 - tide
    assert_allclose(there.current, np.stack([0.55 - 0.01 * below, 0.004 * below], axis=1), atol=1e-9)
    assert spread(made(CurrentMeter(rate=10.0, sigma=0.02), trajectory).current - (0.2, 0.12), 0.02)


def test_sound_is_measured_aboard_and_by_casts() -> None:
    profile = SoundProfile(np.array([0.0, 40.0, 100.0]), np.array([1530.0, 1510.0, 1514.0]))
    aboard = made(SoundSpeedMeter(rate=1.0, profile=profile), moving())
    assert_allclose(aboard.sound_speed, 1530.0 - 0.5 * 30.0, atol=1e-6)
    assert_allclose(aboard.depth, 30.0, atol=1e-6)
    cast = made(SoundProfileCast(rate=1 / 50.0, offset=10.0, profile=profile, depths=(0.0, 20.0, 40.0, 70.0), fall=2.0), moving())
    assert_allclose(cast.time, [10.0, 20.0, 30.0, 45.0, 60.0, 70.0, 80.0, 95.0])
    assert_allclose(cast.sound_speed, [1530.0, 1520.0, 1510.0, 1512.0] * 2)
    again = SoundProfile.from_table(cast)
    assert_allclose(again.speed_at([10.0, 40.0, 55.0]), [1525.0, 1510.0, 1511.0])
    noisy = made(SoundProfileCast(rate=1.0, profile=profile, depths=(10.0, 20.0), sigma=0.2, sigma_depth=0.5), moving())
    assert spread(noisy.sound_speed - np.tile([1525.0, 1520.0], 101), 0.2)
    assert spread(noisy.depth - np.tile([10.0, 20.0], 101), 0.5)
    with pytest.raises(InputError, match="sinks at"):
        made(SoundProfileCast(rate=1.0, profile=profile, depths=(20.0, 10.0)), moving())


# All of them


def everything() -> dict[str, Any]:
    motors = Machinery(np.array([0.0, 100.0]), np.array([[5.0], [9.0]]), rudder=np.zeros(2))
    profile = SoundProfile.uniform(1500.0)
    return {
        "imu": Imu(rate=10.0), "yaw_rate": YawRate(rate=5.0, lag=0.1), "attitude": Attitude(rate=5.0, tilt_gain=1.0, date=DATE),
        "heading": Heading(rate=5.0, date=DATE), "magnetometer": Magnetometer(rate=5.0, machinery=motors, motor_coupling=((0.0,),) * 3),
        "dvl": Dvl(rate=2.0, azimuths=JANUS, tilt=0.5, seabed=BED, output="both", error_velocity=True, profile=profile),
        "water_velocity": WaterVelocity(rate=2.0, cell_start=2.0, cell_end=9.0, seabed=BED), "speed": Speed(rate=1.0),
        "altimeter": Altimeter(rate=2.0, seabed=BED, opening=0.1), "depth": Depth(rate=2.0), "pressure": Pressure(rate=2.0),
        "gnss": Gnss(rate=1.0, max_depth=np.inf, reception=Reception()), "thruster": ThrusterSpeeds(rate=1.0, machinery=motors),
        "motor_current": MotorCurrents(rate=1.0, machinery=motors), "water_level": WaterLevel(rate=1.0),
        "water_current": CurrentMeter(rate=1.0), "sound_speed": SoundSpeedMeter(rate=1.0, profile=profile),
        "sound_speed_profile": SoundProfileCast(rate=0.1, profile=profile, depths=(0.0, 10.0)),
    }  # fmt: skip


@pytest.mark.parametrize("name", everything())
def test_without_noise_what_is_shown_is_the_ideal(name: str) -> None:
    it = everything()[name]
    water = Water(shear=SHEARED.shear, levels=(Level(0.5),), waves=Waves(0.5, 6.0))
    trajectory = straight(replace(PLACE, water=water), 20.0, speed=1.5, heading=0.4)
    ideal = it.ideal(trajectory, it.sampling(20.0, np.random.default_rng(0)))
    shown = it.record(ideal, np.random.default_rng(1))
    assert shown.kind == name
    for column in ideal.columns():
        right, found = getattr(ideal, column.name), getattr(shown, column.name)
        if right is not None and found is not None:
            assert_allclose(found, right, atol=1e-9, rtol=1e-12, err_msg=column.name)
        assert (right is None) or (found is not None)


def test_tables_of_all_instruments_go_through_files(tmp_path: Any) -> None:
    from leadline.formats.folder import read_log, write_log
    from leadline.simulate.dive import simulate

    log = simulate(still(PLACE, 20.0, heading=1.0), everything(), seed=3)
    write_log(log, tmp_path / "log")
    back = read_log(tmp_path / "log")
    for name in everything():
        for column in log[name].columns():
            was, now = getattr(log[name], column.name), getattr(back[name], column.name)
            if was is None or was.dtype.kind == "U":
                assert (was is None and now is None) or list(was) == list(now), f"{name} {column.name}"
            else:
                assert_allclose(now, was, rtol=1e-12, atol=1e-12, err_msg=f"{name} {column.name}")
