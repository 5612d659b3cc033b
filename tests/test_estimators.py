"""Estimators side by side: on a linear problem all are Kalman's recursion, roots stay definite, noise is learnt, settings are checked."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import cos, radians, sqrt
from pathlib import Path

import numpy as np
import pytest
from drifting import DRIFT
from numpy.testing import assert_allclose
from twin import Pose, dive, matrix_of, vehicle
from unscented_twin import apart

from leadline.core.compiled import COMPONENTS, WIDE
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.vehicle import Vehicle, vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.assembly import navigator_for
from leadline.estimate.estimators import estimator_of
from leadline.estimate.navigator import Navigator
from leadline.estimate.plan import NIS
from leadline.estimate.solve import solve, stream_of
from leadline.models.layout import BY_CHANNEL, LAST_USED
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.instruments import PositionFix
from leadline.simulate.plans import Weave, circle
from leadline.simulate.trajectory import Place

LATITUDE, EARTH = radians(45.0), 6.37e6
PLACE = Place(LATITUDE, radians(10.0), depth=10.0)
START = 2.0  # m


@cache
def still(duration: float, rate: float) -> Log:
    """A vehicle at rest, with position fixes that have no error."""
    fixes = {"fix": PositionFix(rate=rate, sigma=1e-6)}
    motion = circle(PLACE, duration, speed=1e-9, radius=400.0, weave=Weave())
    return Recorder(motion, fixes, truth_rate=0.1, start=StartSigmas(position=START, depth=1e-4, heading=0.01), name="still").draw(0)


def drifting(sigma: float, walk: float, seed: int, duration: float = 60.0, rate: float = 1.0, outliers: float = 0.0) -> Log:
    """The same with a random walk (m per root of a second) and noise (m) of the test's own on the fixes; outliers: share of 30 sigmas."""
    log, generator = still(duration, rate), np.random.default_rng(seed)
    fix = log["fix"]
    n = len(fix)
    way = np.cumsum(generator.normal(size=(n, 2)) * walk / sqrt(rate), axis=0)
    noise = generator.normal(size=(n, 2)) * sigma
    noise[generator.random(n) < outliers] *= 30.0
    move = (way + noise) / EARTH
    moved = replace(fix, latitude=fix.latitude + move[:, 0], longitude=fix.longitude + move[:, 1] / cos(LATITUDE))
    return replace(log, tables={**log.tables, "fix": moved})


def aboard(sigma: float, more: str = "") -> Vehicle:
    """The vehicle file: a sigma as stated."""
    sensor = f'[sensors.fix]\nkind = "position_fix"\nsigma_m = {sigma}\nvertical = false\n'
    return vehicle_from_toml(f'name = "small"\n[process]\nmodel = "drifting:compose"\n{sensor}{more}')


def fixes_of(navigator: Navigator, events: object, start: np.ndarray) -> list[tuple[float, np.ndarray, float]]:
    """Time, north and east of the start, and variance of each fix in the stream."""
    pose, found = Pose(matrix_of(start[:4]), float(start[4]), np.eye(3)), []
    for e in np.flatnonzero(events.measured):
        row = events.data[events.start[e] :]
        found.append((events.time[e], (pose.en.T @ (row[2:5] - pose.position_e))[:2], row[5]))
    return found


@pytest.mark.parametrize("spec", ["kf", "ekf", "ukf", "ukf:alpha=0.5", "ckf", "ekf-ukf", "srukf", "srckf", "ukf:noise=augmented"])
def test_on_a_linear_problem_all_are_kalmans(spec: str) -> None:
    """Place and variance after sixty fixes are those of the scalar recursion, but for the curvature of the Earth (sigma / R)."""
    log, small = drifting(1.0, DRIFT, 1), aboard(1.0)
    navigator, _, _ = navigator_for(log, small, estimator=spec)
    start = navigator.state[navigator.composition.layout.x][:5].copy()
    stream = stream_of(log, small, navigator, rate=0.01)
    mean, variance, before = np.zeros(2), START**2, 0.0
    for time, z, r in fixes_of(navigator, stream.events, start):
        variance += DRIFT**2 * (time - before)
        gain = variance / (variance + r)
        mean, variance, before = mean + gain * (z - mean), (1.0 - gain) * variance, time
    results = navigator.run(stream.events, len(stream.times))
    layout = navigator.composition.layout
    P = navigator.state[layout.covariance].reshape(-1, WIDE)[:2, :2]
    P = np.tril(P) @ np.tril(P).T if navigator.composition.estimator.root else P
    assert not results.outcome.any()
    far = max(np.abs(mean).max(), 3.0 * START)  # how far from the start anything lies
    assert np.abs(apart(navigator.state[layout.x][:5], start)[:2] - mean).max() < 2.0 * far**2 / EARTH
    assert_allclose(P / variance, np.eye(2), atol=10.0 * far / EARTH + 1e-9)


@pytest.mark.parametrize("settings", ["", "jitter=0", "threshold=0.2", "threshold=0.1", "threshold=0.9,jitter=0.3", "seed=3"])
def test_particles_on_a_linear_problem(settings: str) -> None:
    """Whatever the settings: Kalman's mean to four sigmas of sampling, its variance likewise; each fix leaves a share of the particles."""
    count = 10_000
    log, small = drifting(1.0, DRIFT, 1, duration=20.0, rate=0.5), aboard(1.0)
    kalman, particle = (solve(log, small, estimator=e, rate=0.1) for e in ("kf", f"pf:particles={count}," + settings))
    # sampling: of successive updates each adds a share to the variance of a mean, and forgets with the gain; ten updates at most count
    prior = START**2 / 1.0
    share = 1.0 / (sqrt(1.0 + 2.0 * prior) / (1.0 + prior)) ** 2 * (1.0 + prior / (1.0 + 2.0 * prior)) + 10.0
    effective = count / share
    sigma = np.sqrt(np.diagonal(kalman.covariance, axis1=1, axis2=2))
    assert (np.abs(kalman.position_n - particle.position_n)[:, :2] < 4.0 * sigma[:, :2] / sqrt(effective)).all()
    assert_allclose(np.sqrt(np.diagonal(particle.covariance, axis1=1, axis2=2))[:, :2], sigma[:, :2], rtol=4.0 / sqrt(2 * effective))


@pytest.mark.parametrize("spec", ["kf", "ukf", "ckf", "srukf"])
def test_smoothed_on_a_linear_problem(spec: str) -> None:
    """Smoothed states and covariances are those of the extended filter, but for the curvature of the Earth."""
    log, small = drifting(1.0, DRIFT, 2), aboard(1.0)
    one, other = (solve(log, small, estimator=e, smooth=True, rate=0.5) for e in (spec, "ekf"))
    forward = solve(log, small, estimator=spec, rate=0.5)
    assert (one.covariance[5:-5, 0, 0] < 0.8 * forward.covariance[5:-5, 0, 0]).all()
    assert np.abs(one.position_n - other.position_n)[:, :2].max() < (10 * START) ** 2 / EARTH
    assert_allclose(one.covariance[:, :2, :2], other.covariance[:, :2, :2], atol=1e-4)


def test_planar_is_linear_for_all() -> None:
    """The process model of the plane with headings and fixes: Gaussian filters agree in sigmas, to the Earth's curvature."""
    log = dive(20.0, rate=10.0)
    plane = vehicle("depth", "heading", "usbl").moved_by("planar").without("imu")  # a gyro sees turning by the tilt: not quite linear
    plane = replace(plane, sensors={**plane.sensors, "usbl": replace(plane["usbl"], lever_arm_b=np.zeros(3))})
    reference = solve(log, plane, estimator="ekf", rate=1.0)
    sigma = np.sqrt(np.diagonal(reference.covariance, axis1=1, axis2=2))[:, :2]
    for spec in ("kf", "ukf", "ckf", "srukf"):
        other = solve(log, plane, estimator=spec, rate=1.0)
        assert np.abs((other.position_n - reference.position_n)[:, :2] / sigma).max() < 1e-4


def test_what_is_not_linear_is_refused() -> None:
    """A process model, and a sensor: in one line that names it."""
    log = dive(4.0, rate=10.0)
    with pytest.raises(InputError, match=r"'kf' wants linear models; process model 'inertial'") as found:
        solve(log, vehicle("dvl", "depth"), estimator="kf")
    assert "\n" not in str(found.value)
    with pytest.raises(InputError, match=r"sensors\.(imu|ranges): .*not linear") as found:
        solve(log, vehicle("depth", "heading", "ranges").moved_by("planar"), estimator="kf")
    assert "\n" not in str(found.value)


def test_a_root_stays_definite() -> None:
    """Sigmas eight decades apart and three hundred sharp measurements: the root is that of least squares, the plain form loses its sign."""
    from leadline.estimate.square_root import correct_root

    generator, n = np.random.default_rng(0), 8
    S = np.zeros(WIDE * WIDE)
    full = S.reshape(WIDE, WIDE)[:n, :n]
    full[:] = np.tril(generator.standard_normal((n, n))) + 3.0 * np.eye(n)
    full *= 10.0 ** np.linspace(4.0, -4.0, n)[:, None]
    prior, plain = full.copy(), full @ full.T
    rows, lost = [], False
    for _ in range(300):
        H, noise = generator.standard_normal((2, n)), np.diag([1e-8, 4e-8])
        D, R = np.zeros((COMPONENTS, WIDE)), np.zeros((COMPONENTS, COMPONENTS))
        D[:2, :n], R[:2, :2] = H @ full, noise
        correct_root(S, D.ravel(), R, 1.0, 2, n, np.zeros(20 * WIDE * WIDE), np.zeros(20 * WIDE * WIDE))
        if not lost:
            gain = np.linalg.solve(H @ plain @ H.T + noise, H @ plain).T
            plain = plain - gain @ H @ plain
            lost = bool(np.linalg.eigvalsh(plain).min() <= 0.0)
        rows.append(H / np.sqrt(np.diag(noise))[:, None])
    # least squares in units in which its matrix is of one size: all that was seen, and the prior
    unit = np.linalg.norm(np.vstack(rows), axis=0)
    A = np.vstack([np.linalg.inv(prior), *rows]) / unit
    inverse = np.linalg.inv(np.linalg.qr(A, mode="r"))
    expected = inverse @ inverse.T / np.outer(unit, unit)
    sigma = np.sqrt(np.diag(expected))
    assert lost
    assert (np.diag(full) > 0.0).all()
    assert_allclose(full @ full.T / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-6)


# --- noise that is learnt -----------------------------------------------------------------------------------------------------------

MEMORY, SEEDS = 50.0, 6
INFLATED = 1.0 + 0.5 * (DRIFT**2 + sqrt(DRIFT**4 + 4.0 * DRIFT**2))  # innovation variance over that of the noise, settled, one row a second


def learnt(spec: str, log: Log, small: Vehicle) -> tuple[float, float, float]:
    """Factors on the noise of the fixes and of the motion at the end, and the mean of normalised squares per component, second half."""
    navigator, _, _ = navigator_for(log, small, estimator=spec)
    stream = stream_of(log, small, navigator, rate=0.01)
    results = navigator.run(stream.events, len(stream.times))
    nis = results.result[:, NIS]
    layout = navigator.composition.layout
    noise = LAST_USED + (BY_CHANNEL - 1) * layout.channels  # of the first channel; that of the motion is the last number before x
    return navigator.state[noise], navigator.state[layout.x.start - 1], float(np.mean(nis[len(nis) // 2 :])) / 2.0


@pytest.mark.parametrize("spec", ["ekf", "ukf", "srukf"])
@pytest.mark.parametrize("wrong", [0.25, 1.0, 4.0])
def test_noise_of_a_sensor_is_found(spec: str, wrong: float) -> None:
    """A sigma stated four times too small or too large: the factor, over seeds, is the square of that to its sampling error.

    A ratio is a mean over two components: variance one, times the square of S / R; a memory of N leaves 1 / 2 N of it.
    """
    outcomes = [learnt(f"{spec}:adaptive=r", drifting(1.0, DRIFT, seed, 600.0), aboard(wrong)) for seed in range(SEEDS)]
    factor, _, nis = np.mean(np.array(outcomes) * [wrong**2, 1.0, 1.0], axis=0)
    assert abs(factor - 1.0) < 4.0 * INFLATED / sqrt(2.0 * MEMORY * SEEDS)
    assert abs(nis - 1.0) < 4.0 / sqrt(300.0 * SEEDS)  # a mean over two components of 300 rows has the variance 1 / 300


def test_noise_of_the_motion_is_found() -> None:
    """A drift four times as large as stated in sigma."""
    outcomes = [learnt("ekf:adaptive=q", drifting(0.3, 4.0 * DRIFT, seed, 600.0), aboard(0.3)) for seed in range(SEEDS)]
    _, factor, nis = np.mean(outcomes, axis=0)
    assert abs(factor / 16.0 - 1.0) < 4.0 / sqrt(2.0 * MEMORY * SEEDS) + 0.1
    assert abs(nis - 1.0) < 0.2


def test_outliers_do_not_blow_it_up() -> None:
    """One row in twenty is thirty sigmas off: a ratio is cut off at nine, so f is at most where 0.95 / f + 9 * 0.05 = 1."""
    factors = [learnt("ekf:adaptive=r", drifting(1.0, DRIFT, seed, 600.0, outliers=0.05), aboard(1.0))[0] for seed in range(SEEDS)]
    assert np.mean(factors) < 0.95 / (1.0 - 9.0 * 0.05) * (1.0 + 4.0 / sqrt(2.0 * MEMORY * SEEDS))
    assert np.mean(factors) > 0.8


def test_nothing_is_learnt_unasked() -> None:
    """Factors stay one."""
    assert learnt("ekf", drifting(1.0, DRIFT, 0), aboard(4.0))[:2] == (1.0, 1.0)


# --- settings -----------------------------------------------------------------------------------------------------------------------

WRONG = {
    "ekff": "ekf", "": "not known", "EKF": "ekf", "none:at=all": "at=all|not known",
    "ekf:alpha=1": "alpha", "kf:particles=3": "particles", "ukf:alfa=1": "alpha", "ukf:alpha": "alpha", "ukf:alpha=": "alpha",
    "ukf:alpha=much": "much", "ukf:alpha=0": "alpha", "ukf:alpha=-1": "alpha", "ukf:alpha=nan": "alpha", "ukf:alpha=inf": "alpha",
    "ukf:beta=20": "beta", "ukf:kappa=1000": "kappa", "ckf:alpha=0.5": "alpha", "srckf:beta=1": "beta",
    "ukf:noise=big": "noise", "ukf:noise=augmented,adaptive=q": "adaptive", "ukf:adaptive=all": "adaptive", "ekf:memory=1": "memory",
    "pf:particles=1": "particles", "pf:particles=1e9": "particles", "pf:threshold=2": "threshold", "pf:jitter=-0.1": "jitter",
    "pf:seed=-1": "seed", "pf:alpha=1": "alpha", "no_such_module_.x:make": "no_such_module_",
    "ekf:memory=50,memory=60": "memory.*twice", ".relative:make": "cannot be imported",
}  # fmt: skip


@pytest.mark.parametrize("spec", WRONG)
def test_wrong_settings(spec: str) -> None:
    """One line that names the setting or the estimator."""
    with pytest.raises(InputError, match=WRONG[spec]) as found:
        estimator_of(spec)
    assert "\n" not in str(found.value)


BROKEN = {
    "def make(:": "cannot be imported",
    "1 / 0": "cannot be imported",
    "make = 3": "not callable",
    "make = lambda *a: 3": "made a int",
    "make = lambda *a: 1 / 0": "ZeroDivisionError",
    "from leadline.estimate.estimator import Estimator\nmake = lambda: Estimator('own', print, print, print)": "does not fit",
}


@pytest.mark.parametrize("text", BROKEN)
def test_a_users_estimator_that_is_broken(tmp_path: Path, text: str) -> None:
    """One line, however it fails, and the same when it is asked for again."""
    file = tmp_path / "broken_estimator.py"
    file.write_text(text + "\n")
    for _ in range(2):
        with pytest.raises(InputError, match=BROKEN[text]) as found:
            estimator_of(f"{file}:make")
        assert "\n" not in str(found.value)


def test_a_users_process_model_that_is_broken(tmp_path: Path) -> None:
    """Kernels that are none, and a start of another size than its parts: one line that says so."""
    file = tmp_path / "broken_process.py"
    file.write_text(
        "from dataclasses import replace\nimport numpy as np\nfrom drifting import compose\n"
        "def bare(v, c): return replace(compose(v, c), step=print)\n"
        "def short(v, c): return replace(compose(v, c), begin=lambda pose: (np.zeros(3), np.eye(2)))\n"
        "def failing(v, c): return replace(compose(v, c), begin=lambda pose: 1 / 0)\n"
    )
    for name, named in (("bare", "does not fit"), ("short", r"begins with \(3,\) numbers"), ("failing", "ZeroDivisionError")):
        with pytest.raises(InputError, match=named) as found:
            solve(still(4.0, 1.0), aboard(1.0), process=f"{file}:{name}")
        assert "\n" not in str(found.value)


def test_a_snapshot_is_of_one_estimator(tmp_path: Path) -> None:
    """A root is not taken for a covariance: the same settings of another filter are refused."""
    log, small = still(10.0, 1.0), aboard(1.0)
    solve_as_live(log, small, estimator="ukf", end=5.0, snapshot=tmp_path / "s")
    with pytest.raises(InputError, match="navigator of other"):
        solve_as_live(log, small, estimator="srukf", resume=tmp_path / "s")


@pytest.mark.parametrize(
    ("spec", "named"), [("ukf:kappa=-50", "kappa"), ("srukf:beta=-3", "beta"), ("pf", "states")], ids=["kappa", "beta", "states"]
)
def test_settings_that_do_not_fit_the_states(spec: str, named: str) -> None:
    """Refused when the states are known, in one line."""
    log = dive(4.0, rate=10.0)
    with pytest.raises(InputError, match=named) as found:
        solve(log, vehicle("dvl", "depth", "attitude", nuisances=("dvl", "attitude")), estimator=spec)
    assert "\n" not in str(found.value)


def test_settings_that_are_right() -> None:
    """Blanks and order do not matter; a number is taken as it stands."""
    made = estimator_of("ukf:beta=1, alpha=0.5")
    assert_allclose(made.parameters[3:5], [0.5, 1.0])
    assert estimator_of("pf:particles=300").parameters[3] == 300
