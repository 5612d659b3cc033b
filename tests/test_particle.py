"""The particle filter against Bayes' rule on a grid (ranges from one beacon, a posterior like a ring), its random numbers and replays.

A mean over particles has the variance of the law over their effective number.  Each update costs a share of them: the grid says which, as
E[p]^2 / E[p^2] of the likelihood p before it, and the errors of successive updates and draws add up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import pi, radians, sqrt

import numpy as np
import pytest
from drifting import DRIFT
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from twin import Pose, matrix_of
from unscented_twin import curved

from leadline.assess.errors import errors_of
from leadline.data.log import Beacon, Log
from leadline.data.vehicle import Vehicle, vehicle_from_toml
from leadline.estimate.assembly import navigator_for
from leadline.estimate.navigator import Navigator
from leadline.estimate.run import Results
from leadline.estimate.solve import solve, stream_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.instruments import AcousticRange, Depth, Dvl, PositionFix, YawRate
from leadline.simulate.plans import Weave, circle, driven
from leadline.simulate.profiles import Ramp, Steps
from leadline.simulate.trajectory import Place

PLACE = Place(radians(45.0), radians(10.0), depth=10.0)
BEACON = Beacon(north=25.0, east=15.0, depth=10.0)
PRIOR, CELL, HALF, UPDATES, COUNT = 20.0, 0.2, 100.0, 6, 40_000  # m


@cache
def scene(sigma: float) -> tuple[Log, Vehicle]:
    """A vehicle all but at rest that hears one beacon each five seconds, sigma (m), and knows to 20 m where it is."""
    ranges = AcousticRange(rate=0.2, beacons={"b": BEACON}, sigma=sigma / 1500.0, path="one_way")
    still = circle(PLACE, 60.0, speed=0.05, radius=400.0, weave=Weave())
    start = StartSigmas(position=PRIOR, depth=1e-4, heading=0.01)
    log = Recorder(still, {"ranges": ranges}, truth_rate=1.0, start=start, name="ring").draw(3)
    text = f'name = "small"\n[process]\nmodel = "drifting:compose"\n[sensors.ranges]\nkind = "acoustic_range"\nsigma_m = {sigma}\n'
    return log, vehicle_from_toml(text)


@dataclass(frozen=True)
class Law:
    """A law on the grid after an update: probabilities (n, n) over north and east of the start, and what is left of particles so far."""

    p: np.ndarray
    share: float
    beacon: np.ndarray

    @property
    def moments(self) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Mean (2,), sigmas (2,), mean distance to the beacon and its sigma."""
        axes = self.p.sum(1), self.p.sum(0)
        mean = np.array([q @ AXIS for q in axes])
        sigma = np.sqrt([q @ (AXIS - m) ** 2 for q, m in zip(axes, mean, strict=True)])
        r = np.hypot(NORTH - self.beacon[0], EAST - self.beacon[1])
        far = float((self.p * r).sum())
        return mean, sigma, far, sqrt((self.p * (r - far) ** 2).sum())


AXIS = np.arange(-HALF, HALF + CELL / 2, CELL)
NORTH, EAST = np.meshgrid(AXIS, AXIS, indexing="ij")


@cache
def laws(sigma: float) -> tuple[Law, ...]:
    """Bayes' rule on the grid, in the plane of the start (Earth's curvature: 1e-3 m)."""
    log, aboard = scene(sigma)
    navigator, _, _ = navigator_for(log, aboard)
    events = stream_of(log, aboard, navigator, rate=0.01).events
    place = navigator.state[navigator.composition.layout.x][:5]
    pose = Pose(matrix_of(place[:4]), float(place[4]), np.eye(3))
    p, before, spent, found = np.exp(-(NORTH**2 + EAST**2) / (2 * PRIOR**2)), 0.0, 0.0, []
    p /= p.sum()
    for e in np.flatnonzero(events.measured)[:UPDATES]:
        measured, variance, *beacon_e = events.data[events.start[e] :][:5]
        beacon = pose.en.T @ (np.array(beacon_e) - pose.position_e)
        if events.time[e] > before:
            p = gaussian_filter(p, DRIFT * sqrt(events.time[e] - before) / CELL, mode="constant", truncate=6)
        likelihood = np.exp(-((measured - np.hypot(NORTH - beacon[0], EAST - beacon[1])) ** 2) / (2 * variance))
        spent += (p * likelihood**2).sum() * p.sum() / (p * likelihood).sum() ** 2
        p = p * likelihood
        p, before = p / p.sum(), events.time[e]
        found.append(Law(p, 1.0 / spent, beacon))
    return tuple(found)


def particles(navigator: Navigator) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n,) and particles (n, size): what lies behind a head of three numbers behind the covariance."""
    behind = navigator.state[navigator.composition.layout.covariance.stop :][3:]
    count = round(len(behind) / (1 + navigator.composition.layout.motion_nominal))
    return np.exp(behind[:count]), behind[count:].reshape(count, -1)


def plane(rows: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Places (n, 2) in the plane of the start: the turning of their frames against its own, which is small."""
    w, v = start[0], start[1:4]
    vector = w * rows[:, 1:4] - rows[:, :1] * v - np.cross(v, rows[:, 1:4])
    return np.linalg.solve(curved(start), 2.0 * vector[:, :2].T).T


def clouds(spec: str, sigma: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights and places (n, 2) in the plane of the start, after each update."""
    log, aboard = scene(sigma)
    plain, _, _ = navigator_for(log, aboard)
    start = plain.state[plain.composition.layout.x][:5]
    navigator, _, _ = navigator_for(log, aboard, estimator=spec)
    events = stream_of(log, aboard, navigator, rate=0.01).events
    results, done, found = Results.room(navigator.composition, int(events.measured.sum()), 2), 0, []
    for e in np.flatnonzero(events.measured)[:UPDATES]:
        navigator.runner.run(navigator.state, events, results, done, e + 1)
        weights, rows = particles(navigator)
        assert_allclose(weights.sum(), 1.0, rtol=1e-12)
        found.append((weights, plane(rows, start)))
        done = e + 1
    assert not results.outcome[:UPDATES].any()
    return found


def assert_the_law(cloud: tuple[np.ndarray, np.ndarray], law: Law) -> None:
    """Moments to four sigmas of sampling, marginals in total variation to twice what sampling leaves on average."""
    (weights, places), (mean, sigma, far, thick) = cloud, law.moments
    effective = COUNT * law.share
    found = weights @ places
    assert (np.abs(found - mean) < 4.0 * sigma / sqrt(effective)).all()
    spread = np.sqrt(weights @ (places - found) ** 2)
    assert_allclose(spread, sigma, rtol=4.0 / sqrt(2.0 * effective))
    r = np.hypot(*(places - law.beacon[:2]).T)
    assert abs(weights @ r - far) < 4.0 * thick / sqrt(effective)
    assert_allclose(sqrt(weights @ (r - weights @ r) ** 2), thick, rtol=4.0 / sqrt(2.0 * effective))
    edges = np.arange(-HALF, HALF + 1.0, 4.0) - 0.5 * CELL
    for axis in (0, 1):
        ours, _ = np.histogram(places[:, axis], edges, weights=weights)
        theirs, _ = np.histogram(AXIS, edges, weights=law.p.sum(1 - axis))
        variation = 0.5 * np.abs(ours - theirs).sum()
        assert variation < 2.0 * 0.5 * sqrt(2.0 / pi) * np.sqrt(theirs / effective).sum()


RINGS = ("seed=0", "jitter=0", "threshold=0.9", "threshold=0.1", "seed=7")


@pytest.mark.parametrize("settings", RINGS)
def test_a_ring(settings: str) -> None:
    """Ranges of half a metre: after one update and after six the particles are drawn from the law on the grid."""
    found = clouds(f"pf:particles={COUNT},{settings}", 0.5)
    for cloud, law in zip(found, laws(0.5), strict=True):
        assert_the_law(cloud, law)


def test_a_thin_ring() -> None:
    """Ranges of a tenth of a metre, which leave few particles that count, and no Gaussian: weighed and nothing else."""
    for cloud, law in zip(clouds(f"pf:particles={COUNT}", 0.1)[:1], laws(0.1)[:1], strict=True):
        assert_the_law(cloud, law)


def test_the_witness_can_tell() -> None:
    """The law of another noise, and one that is four metres aside, are told apart."""
    cloud = clouds(f"pf:particles={COUNT}", 0.5)
    right = laws(0.5)[5]
    for wrong in (laws(0.1)[5], replace(right, p=np.roll(right.p, round(4.0 / CELL), axis=0))):
        with pytest.raises(AssertionError):
            assert_the_law(cloud[5], wrong)


def test_a_seed_says_all() -> None:
    """The same seed gives the same bits, another one others."""
    log, aboard = scene(0.5)
    states = []
    for seed in (1, 1, 2):
        navigator, _, _ = navigator_for(log, aboard, estimator=f"pf:particles=500,seed={seed}")
        stream = stream_of(log, aboard, navigator, rate=0.01)
        navigator.run(stream.events, len(stream.times))
        states.append(navigator.state)
    assert_array_equal(states[0], states[1])
    assert (states[0] != states[2]).any()


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4, 5, 6, 7], [0, 2, 3, 1, 4, 7, 6, 5]], ids=["in order", "late"])
def test_live_is_offline(order: list[int]) -> None:
    """Rows one by one, late ones replayed from a checkpoint, and outputs asked for between: the bits of the whole log."""
    log, aboard = scene(0.5)
    log = replace(log, tables={"ranges": log["ranges"].select(np.arange(8))})
    spec = "pf:particles=500,threshold=0.9"
    whole, _, _ = navigator_for(log, aboard, estimator=spec)
    stream = stream_of(log, aboard, whole, rate=0.01)
    whole.run(stream.events, len(stream.times))
    live, _, _ = navigator_for(log, aboard, estimator=spec, window=100.0)
    for row in order:
        live.add("ranges", log["ranges"].select(np.array([row])))
        live.estimate(live.time + 1.0)
    assert live.time == whole.time
    assert_array_equal(live.state, whole.state)


def test_a_heading_of_sixty_degrees() -> None:
    """A start that hardly knows its heading, fixes and a Doppler log: heading and position come out, and sigmas cover them."""
    turned = driven(PLACE, 40.0, forward=Steps((2.0,), (5.0,), (0.0, 1.0)), heading=Ramp(0.3, 0.02), pitch=Ramp(), weave=Weave())
    instruments = {
        "dvl": Dvl(rate=1.0, sigma=0.02), "depth": Depth(rate=1.0, sigma=0.05), "fix": PositionFix(rate=0.2, sigma=1.0),
        "yaw_rate": YawRate(rate=2.0, sigma=radians(0.3) / 60 * sqrt(2.0)),
    }  # fmt: skip
    start = StartSigmas(position=1.0, heading=radians(60.0))
    recorder = Recorder(turned, instruments, truth_rate=0.2, start=start, name="turned")
    aboard = vehicle_from_toml("""
        name = "turned"
        [process]
        model = "cruise"
        cruise = { surge_noise_mps_per_rts = 0.3 }
        [sensors.dvl]
        sigma_mps = 0.02
        [sensors.depth]
        sigma_m = 0.05
        [sensors.yaw_rate]
        noise_deg_per_rth = 0.3
        rate_hz = 2.0
        [sensors.fix]
        kind = "position_fix"
        sigma_m = 1.0
        vertical = false
        """)
    for seed in range(3):
        log = recorder.draw(seed)
        solution = solve(log, aboard, estimator="pf:particles=1000", times=log.truth.time)
        errors = errors_of(solution, log.truth).error[-1]
        sigma = np.sqrt(np.diag(solution.covariance[-1]))
        assert (np.abs(errors[[0, 1, 8]]) < 4.0 * sigma[[0, 1, 8]]).all()
        assert sigma[8] < radians(10.0)
