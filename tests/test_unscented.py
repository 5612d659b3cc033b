"""The unscented filters against a textbook one with published weights (tests/unscented_twin.py), on one stream, in sigmas."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import pi, radians, sqrt
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from twin import LEVER, ROUGH, dive, vehicle
from unscented_twin import CUBATURE, SigmaTwin, Spread

from leadline.core.compiled import WIDE
from leadline.data.log import Log
from leadline.data.outcome import Outcome
from leadline.data.vehicle import Vehicle
from leadline.estimate.assembly import navigator_for
from leadline.estimate.navigator import Navigator
from leadline.estimate.plan import IS_INPUT
from leadline.estimate.solve import solve, stream_of
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import Depth, Dvl, Heading, Imu
from leadline.simulate.plans import circle
from leadline.simulate.trajectory import Place

SPECS = {
    "ukf": Spread(),
    "ukf:alpha=0.1": Spread(0.1),
    "ukf:alpha=0.6,beta=1,kappa=1": Spread(0.6, 1.0, 1.0),
    "ckf": CUBATURE,
    "srukf": Spread(),
    "srckf": CUBATURE,
    "ukf:noise=augmented": Spread(augmented=True),
    "srukf:noise=augmented": Spread(augmented=True),
    "ekf-ukf": Spread(slopes=True),
}
ALL = ("ukf", "ckf", "srukf", "srckf", "ekf-ukf")
ROUNDING = np.finfo(float).eps * 6.4e6  # of a place, m


@dataclass(frozen=True)
class Pair:
    """A finished run of both."""

    navigator: Navigator
    twin: SigmaTwin
    outcomes: np.ndarray
    expected: list[int]
    steps: int

    @property
    def apart(self) -> tuple[float, float]:
        """Largest differences of means and of covariances, in sigmas."""
        sigma = np.sqrt(np.diag(self.twin.P))
        sigma[sigma == 0.0] = 1.0
        x = self.navigator.state[self.navigator.composition.layout.x][: len(self.twin.whole)]
        d = self.twin.difference(x, self.twin.whole)
        P = covariance(self.navigator)
        return float(np.abs(d / sigma).max()), float(np.abs((P - self.twin.P) / np.outer(sigma, sigma)).max())

    @property
    def bar(self) -> float:
        """What rounding leaves, in sigmas: that of a place in each step, in units of its sigma; the mean of points divides it by g^2."""
        g, _, _ = self.twin.spread.weights(1)
        least = sqrt(np.diag(self.twin.P)[:3].min())
        return 2.0 * ROUNDING / least * sqrt(self.steps) / min(1.0, g * g)


def covariance(navigator: Navigator) -> np.ndarray:
    n, layout = int(navigator.state[1]), navigator.composition.layout
    P = navigator.state[layout.covariance].reshape(-1, WIDE)[:n, :n]
    return np.tril(P) @ np.tril(P).T if navigator.composition.estimator.root else P.copy()


def run(spec: str, spread: Spread, log: Log, aboard: Vehicle, unsure: float = 1.0) -> Pair:
    """Run both on a log; `unsure` multiplies the sigmas at the start."""
    navigator, _, _ = navigator_for(log, aboard, estimator=spec)
    stream = stream_of(log, aboard, navigator, rate=1.0)
    plain, _, _ = navigator_for(log, aboard)
    plain.state[plain.composition.layout.covariance] *= unsure**2
    navigator.state[navigator.composition.layout.covariance] *= unsure if navigator.composition.estimator.root else unsure**2
    twin = SigmaTwin(plain, spread)
    results = navigator.run(stream.events, len(stream.times))
    expected = twin.run(stream.events)
    moments = stream.events.time[(stream.events.kind == IS_INPUT) | stream.events.measured]
    return Pair(navigator, twin, results.outcome, expected, len(np.unique(moments)))


def assert_equal(pair: Pair) -> None:
    assert_array_equal(pair.outcomes, pair.expected)
    assert int(pair.navigator.state[1]) == len(pair.twin.P)
    mean, spread = pair.apart
    assert mean < pair.bar
    assert spread < pair.bar


@cache
def rough() -> Log:
    """A rolling and pitching dive with a gap in the inertial rows."""
    return dive(4.0, rate=10.0, gap=(2.0, 2.4))


DIVES = {
    "body-velocity": ("body-velocity", ("dvl", "depth", "attitude", "usbl"), ("dvl", "depth", "attitude")),
    "with clones": ("body-velocity", ("dvl", "depth", "heading", "usbl", "ranges"), ("dvl", "heading", "ranges")),
}


@pytest.mark.parametrize("case", DIVES)
@pytest.mark.parametrize("spec", SPECS)
def test_a_dive(spec: str, case: str) -> None:
    """All rows of a dive, nuisances that decay, a gap, earlier poses: the same outcomes, mean and covariance as the textbook's."""
    model, names, nuisances = DIVES[case]
    assert_equal(run(spec, SPECS[spec], rough(), vehicle(*names, nuisances=nuisances).moved_by(model)))


@pytest.mark.parametrize("spec", ALL)
def test_inertial(spec: str) -> None:
    """The process model with biases."""
    aboard = vehicle("dvl", "depth", "heading", "usbl", "ranges", nuisances=("dvl",))
    assert_equal(run(spec, SPECS[spec], rough(), aboard))


@pytest.mark.parametrize("spec", SPECS)
def test_where_it_is_far_from_linear(spec: str) -> None:
    """Sigmas of the start five times as large (tilt and heading a good part of a radian), so that means shift."""
    aboard = vehicle("dvl", "attitude", "usbl", nuisances=("attitude",)).moved_by("body-velocity")
    log = dive(3.0, rate=10.0)
    assert_equal(run(spec, SPECS[spec], log, aboard, unsure=5.0))


def test_the_witness_can_tell() -> None:
    """Other settings are a hundred bars away: a wrong weight would show."""
    aboard = vehicle("dvl", "depth", "attitude", "usbl").moved_by("body-velocity")
    pair = run("ukf", CUBATURE, rough(), aboard)
    assert min(pair.apart) > 100 * pair.bar


@pytest.mark.parametrize("spec", ALL)
def test_headings_wrap(spec: str) -> None:
    """A tight circle turns the measured heading, and the points about it, across half a turn."""
    place = Place(radians(32.84), radians(-117.0), depth=15.0, surface_height=17.0)
    instruments = {
        "imu": Imu(rate=10.0, lever_arm_b=LEVER["imu"], gyro_density=3e-5, accel_density=1e-3),
        "dvl": Dvl(rate=5.0, offset=0.103, lever_arm_b=LEVER["dvl"], sigma=0.01),
        "depth": Depth(rate=1.0, lever_arm_b=LEVER["depth"], sigma=0.02),
        "heading": Heading(rate=5.0, offset=0.05, sigma=0.01),
    }
    log = simulate(circle(place, 6.0, speed=1.5, radius=2.0, weave=ROUGH), instruments, seed=1)
    headings = log["heading"].heading
    assert np.abs(np.diff(headings)).max() > pi  # so it does cross
    aboard = vehicle("dvl", "depth", "heading", nuisances=("heading",)).moved_by("body-velocity")
    pair = run(spec, SPECS[spec], log, aboard)
    assert_equal(pair)
    assert pair.expected.count(0) > 0.9 * len(pair.expected)


@pytest.mark.parametrize("spec", ALL)
def test_gate(spec: str) -> None:
    """An outlier is turned away by all alike, and leaves no trace."""
    log = rough()
    heading = log["heading"]
    wrong = heading.select(np.ones(len(heading), bool))
    wrong.heading[[4, 11]] += 0.8  # rad
    log = Log(**{**log.__dict__, "tables": {**log.tables, "heading": wrong}})
    aboard = vehicle("dvl", "depth", "heading").moved_by("body-velocity")
    pair = run(spec, SPECS[spec], log, aboard)
    assert_equal(pair)
    assert pair.expected.count(1) == 2


SHALLOW = '''
import numpy as np
from leadline.models.sensors.pressure import compose as plain

def compose(config, context):
    import dataclasses
    sensor = plain(config, context)
    return dataclasses.replace(sensor, channels=tuple(dataclasses.replace(c, predict=look, parameters=c.parameters) for c in sensor.channels))

LIMIT = {limit}

def look(views, nuisance, row):
    depth = SURFACE - views[0].height
    return np.array([depth if depth < LIMIT else np.nan]), np.array([[row[1]]])

SURFACE = {surface}
'''


@pytest.mark.parametrize("spec", ["ekf", "ukf", "ckf", "srukf"])
def test_a_point_that_sees_nothing(spec: str, tmp_path: Path) -> None:
    """A sensor that gives no value beyond a depth: where the estimate is above it and points are below, the row is invalid."""
    log = rough()
    surface, depth = log.datum.geoid_undulation, float(np.median(log["depth"].depth))
    (tmp_path / "shallow.py").write_text(SHALLOW.format(limit=depth + 0.5, surface=surface))
    more = f'\n[sensors.depth]\nkind = "depth"\nmodel = "{tmp_path / "shallow.py"}:compose"\nsigma_m = 0.02\n'
    aboard = vehicle(more=more).moved_by("body-velocity")
    navigator, _, _ = navigator_for(log, aboard, estimator=spec)
    layout = navigator.composition.layout
    P = navigator.state[layout.covariance].reshape(-1, WIDE)
    P[2, :] = P[:, 2] = 0.0
    P[2, 2] = 2.0 if navigator.composition.estimator.root else 4.0  # two metres of sigma: points lie beyond half a metre
    stream = stream_of(log, aboard, navigator, rate=1.0)
    outcomes = navigator.run(stream.events, len(stream.times)).outcome
    assert set(outcomes[:5]) == {Outcome.USED if spec == "ekf" else Outcome.INVALID}


@pytest.mark.parametrize("spec", ["ukf", "ckf", "srukf"])
def test_smoothed(spec: str) -> None:
    """Where points spread little (sigmas are small), a smoothed dive is that of the smoothed Jacobians to second order."""
    aboard, log = vehicle("dvl", "depth", "attitude", "usbl").moved_by("body-velocity"), rough()
    one, other = (solve(log, aboard, estimator=name, smooth=True) for name in (spec, "ekf"))
    sigma = np.sqrt(np.diagonal(other.covariance, axis1=1, axis2=2))
    assert np.abs((one.position_n - other.position_n) / sigma[:, :3]).max() < 0.05
