"""The unscented filters against a textbook one with published weights (tests/unscented_twin.py), on one stream, in sigmas."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import inf, pi, radians, sqrt
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from twin import LEVER, ROUGH, dive, vehicle
from unscented_twin import CUBATURE, SigmaTwin, Spread

from leadline.core.compiled import WIDE
from leadline.data.log import Log
from leadline.data.outcome import Outcome
from leadline.data.vehicle import SensorConfig, Vehicle
from leadline.estimate.assembly import navigator_for
from leadline.estimate.navigator import Navigator
from leadline.estimate.plan import IS_INPUT
from leadline.estimate.solve import solve, stream_of
from leadline.models.sensor import Channel, Context, Sensor, finite_rows, reading, usable
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import Depth, Heading, Imu
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
    kinds: np.ndarray  # of the measurements
    finest: float = inf  # sigma of a distance between two places that is known better than either, m

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
        least = min(self.finest, sqrt(np.diag(self.twin.P)[:3].min()))
        return 2.0 * ROUNDING / least * sqrt(self.steps) / min(1.0, g * g)


def covariance(navigator: Navigator) -> np.ndarray:
    n, layout = int(navigator.state[1]), navigator.composition.layout
    P = navigator.state[layout.covariance].reshape(-1, WIDE)[:n, :n]
    return np.tril(P) @ np.tril(P).T if navigator.composition.estimator.root else P.copy()


def run(spec: str, spread: Spread, log: Log, aboard: Vehicle, unsure: float = 1.0, finest: float = inf) -> Pair:
    """Run both on a log; `unsure` multiplies the sigmas at the start."""
    navigator, _, _ = navigator_for(log, aboard, estimator=spec)
    stream = stream_of(log, aboard, navigator, rate=1.0)
    plain, _, _ = navigator_for(log, aboard, estimator="ukf")
    plain.state[plain.composition.layout.covariance] *= unsure**2
    navigator.state[navigator.composition.layout.covariance] *= unsure if navigator.composition.estimator.root else unsure**2
    twin = SigmaTwin(plain, spread)
    results = navigator.run(stream.events, len(stream.times))
    expected = twin.run(stream.events)
    moments = stream.events.time[(stream.events.kind == IS_INPUT) | stream.events.measured]
    return Pair(navigator, twin, results.outcome, expected, len(np.unique(moments)), stream.events.kind[stream.events.measured], finest)


def assert_equal(pair: Pair) -> None:
    assert_array_equal(pair.outcomes, pair.expected)
    assert int(pair.navigator.state[1]) == len(pair.twin.P)
    mean, spread = pair.apart
    assert mean < pair.bar
    assert spread < pair.bar


@cache
def rough() -> Log:
    """A rolling and pitching dive with a gap in the inertial rows."""
    return dive(3.0, rate=10.0, gap=(1.5, 1.9))


@pytest.mark.parametrize("spec", SPECS)
def test_a_dive(spec: str) -> None:
    """All rows of a dive, nuisances that decay, a gap: the same outcomes, mean and covariance as the textbook's."""
    aboard = vehicle("dvl", "depth", "attitude", "heading", "usbl", nuisances=("dvl", "depth", "attitude", "heading"))
    assert_equal(run(spec, SPECS[spec], rough(), aboard.moved_by("body-velocity")))


@pytest.mark.parametrize("spec", [*ALL, "ukf:noise=augmented"])
def test_earlier_poses(spec: str) -> None:
    """Two-way ranges: clones are made, seen and forgotten.

    By the Doppler log the way since a clone, 0.4 s, is known to 4 mm: rounding of places is to be seen in units of that.
    """
    aboard = vehicle("dvl", "heading", "ranges", nuisances=("dvl", "ranges")).moved_by("body-velocity")
    pair = run(spec, SPECS[spec], dive(3.0, rate=10.0, pings=4.0), aboard, finest=0.004)
    assert_equal(pair)
    ranges = pair.navigator.composition.first_slot["ranges"]
    assert np.count_nonzero(pair.kinds >= ranges) > 2


@pytest.mark.parametrize("spec", ["ukf", "srckf", "ekf-ukf"])
def test_inertial(spec: str) -> None:
    """The process model with biases."""
    aboard = vehicle("dvl", "depth", "heading", "usbl", nuisances=("dvl",))
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
        "depth": Depth(rate=1.0, lever_arm_b=LEVER["depth"], sigma=0.02),
        "heading": Heading(rate=5.0, offset=0.05, sigma=0.01),
    }
    log = simulate(circle(place, 6.0, speed=1.5, radius=2.0, weave=ROUGH), instruments, seed=1)
    headings = log["heading"].heading
    assert headings.min() < pi < headings.max()  # so it does cross
    turns = 2.0 * pi * (np.arange(len(headings)) % 3 - 1)  # and rows are whole turns apart
    log = replace(log, tables={**log.tables, "heading": replace(log["heading"], heading=headings + turns)})
    aboard = vehicle("depth", "heading", nuisances=("heading",)).moved_by("body-velocity")
    pair = run(spec, SPECS[spec], log, aboard)
    assert_equal(pair)
    assert pair.expected.count(0) > 0.9 * len(pair.expected)


@pytest.mark.parametrize("spec", ALL)
def test_gate(spec: str) -> None:
    """An outlier is turned away by all alike, and leaves no trace."""
    log = rough()
    heading = log["heading"]
    wrong = heading.heading.copy()
    wrong[[4, 11]] += 0.8  # rad
    log = replace(log, tables={**log.tables, "heading": replace(heading, heading=wrong)})
    aboard = vehicle("dvl", "depth", "heading").moved_by("body-velocity")
    pair = run(spec, SPECS[spec], log, aboard)
    assert_equal(pair)
    assert pair.expected.count(1) == 2


def shallow(config: SensorConfig, context: Context) -> Sensor:
    """A depth sensor that sees nothing deeper than half a metre below its own first value."""
    limit: list[float] = []

    def predict(views: Any, nuisance: Any, row: Any) -> Any:
        depth = context.surface - views[0].height
        return depth if depth < limit[0] + 0.5 else np.nan, [1e4]

    def read(table: Any) -> Any:
        limit.append(float(table.depth[0]))
        return reading(table, finite_rows(0, table.depth[:, None], usable(table)))

    return Sensor(config, (Channel(("depth",), predict, np.zeros(0), 1),), read)


@pytest.mark.parametrize("spec", ["ekf", "ukf", "ckf", "srukf"])
def test_a_point_that_sees_nothing(spec: str) -> None:
    """A sensor that gives no value beyond a depth: where the estimate is above it and points are below, the row is invalid."""
    log, aboard = rough(), vehicle("depth").moved_by("body-velocity")
    aboard = replace(aboard, sensors={**aboard.sensors, "depth": replace(aboard["depth"], model="test_unscented:shallow")})
    navigator, _, _ = navigator_for(log, aboard, estimator=spec)
    P = navigator.state[navigator.composition.layout.covariance].reshape(-1, WIDE)
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
