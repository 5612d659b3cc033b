"""The compiled filter against its dense NumPy twin (tests/twin.py) on one stream, in sigmas; and the mechanisation alone."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from twin import Twin, covariance, dive, nominal, prepared, vehicle

from leadline.estimate import plan as at
from leadline.estimate.navigator import Navigator, Results
from leadline.models.inertial import inertial
from leadline.models.layout import CLONE_TIME
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import Imu
from leadline.simulate.plans import GENTLE, circle
from leadline.simulate.trajectory import Place

AIDED = ("dvl", "depth", "heading", "usbl")
EARTH_RADIUS = 6.4e6
# sensors, nuisances, states without clones, latitude (deg), agreement of covariances in units of sigma^2 (about 10 times what is attained)
COMPOSITIONS = {
    "15 states": (AIDED, (), 15, 32.84, 1e-11),
    "21 states": (AIDED, ("dvl", "depth", "heading"), 21, 32.84, 1e-9),
    "24 states": ((*AIDED, "attitude"), ("dvl", "depth", "heading", "attitude"), 24, 32.84, 1e-9),
    "20 states and 2 clones": ((*AIDED, "ranges"), ("dvl", "ranges"), 20, 32.84, 2e-8),
    "near the pole": ((*AIDED, "ranges"), ("depth",), 16, 89.9, 2e-8),
}


@dataclass(frozen=True)
class Pair:
    """A finished run of both."""

    navigator: Navigator
    results: Results
    twin: Twin
    outcomes: list[int]
    fixed: int
    bar: float


@pytest.fixture(scope="module", params=COMPOSITIONS.values(), ids=COMPOSITIONS.keys())
def pair(request: pytest.FixtureRequest) -> Pair:
    names, nuisances, fixed, latitude, bar = request.param
    log, aboard = dive(62.0, latitude=latitude), vehicle(*names, nuisances=nuisances)
    navigator, stream = prepared(log, aboard)
    twin = Twin(navigator, aboard, log)
    return Pair(navigator, navigator.run(stream.events, len(stream.times)), twin, twin.run(stream.events), fixed, bar)


def test_outcomes_are_equal(pair: Pair) -> None:
    """Both gate the same measurements (the outliers among the fixes, and little else), and none is invalid or without its clone."""
    assert pair.navigator.composition.layout.fixed == pair.fixed
    assert_array_equal(pair.results.outcome, pair.outcomes)
    assert set(pair.outcomes) == {0, 1}
    assert pair.outcomes.count(1) < 0.02 * len(pair.outcomes)


def test_estimates_agree(pair: Pair) -> None:
    """At each second all states agree: places to their rounding (1e-16 of the Earth's radius per step), the others far below sigmas."""
    layout = pair.navigator.composition.layout
    x = pair.results.output[:, at.OUT_X : at.OUT_X + layout.motion_nominal + len(layout.nuisances)]
    error = np.array([nominal(layout, mine) for mine in x]) - np.array([twin for twin, _ in pair.twin.outputs])
    worst = np.abs(error).max(axis=0)
    sigma = np.sqrt(np.diag(pair.twin.outputs[-1][1]))
    assert worst[:9].max() * EARTH_RADIUS < 1e-6  # m
    assert worst[9] < 2e-9  # height, m
    assert worst[10:13].max() < 1e-8  # m/s
    assert worst[13:22].max() < 1e-9  # rad
    assert (worst[22:] < 1e-6 * sigma[9:]).all()


def test_covariances_agree(pair: Pair) -> None:
    """At each second the variances, and at the end the whole covariance with its clones, agree in units of sigma."""
    layout = pair.navigator.composition.layout
    variances = pair.results.output[:, at.OUT_X + layout.motion_nominal + len(layout.nuisances) :]
    assert np.abs(variances / np.array([np.diag(P) for _, P in pair.twin.outputs]) - 1.0).max() < 3 * pair.bar
    mine, twin = covariance(pair.navigator.composition, pair.navigator.state), pair.twin.P
    order = in_use(pair)
    sigma = np.sqrt(np.diag(twin))
    assert np.abs((mine[np.ix_(order, order)] - twin) / np.outer(sigma, sigma)).max() < pair.bar


def in_use(pair: Pair) -> np.ndarray:
    """Error indices of motion, nuisances and living clones, in the order in which the twin holds its clones."""
    layout, state = pair.navigator.composition.layout, pair.navigator.state
    slots = {float(epoch): k for k, epoch in enumerate(state[CLONE_TIME : CLONE_TIME + layout.clones]) if np.isfinite(epoch)}
    clones = [pair.fixed + 6 * slots[epoch] + np.arange(6) for epoch, _ in pair.twin.clones]
    assert len(clones) == len(slots)
    return np.concatenate([np.arange(pair.fixed), *clones])


@pytest.mark.parametrize("latitude", [-75.0, 32.84])
def test_mechanisation(latitude: float) -> None:
    """Ten minutes of inputs without noise: the strapdown kernel and matrices in NumPy arrive at the same place, velocity and attitude."""
    place = Place(radians(latitude), radians(10.0), depth=20.0)
    log = simulate(circle(place, 600.0, speed=1.5, radius=50.0, weave=GENTLE), {"imu": Imu(rate=25.0)})
    aboard = vehicle()
    navigator, stream = prepared(log, aboard)
    twin, process = Twin(navigator, aboard, log), inertial(aboard["imu"], 0.0)
    layout = navigator.composition.layout
    x, memory, events = navigator.state[layout.x].copy(), np.zeros(64), stream.events
    inputs = np.flatnonzero(events.kind == at.IS_INPUT)
    for e, dt in zip(inputs, np.diff(np.maximum(events.time[inputs], 0.0), append=600.0), strict=True):
        twin.input = events.data[events.start[e] : events.stop[e]]
        if dt > 0.0:
            process.step(x, twin.input, dt, process.parameters, memory)
            twin.mechanise(dt)
    error = np.abs(nominal(layout, x) - twin.x)
    assert len(inputs) > 14_990
    assert error[:9].max() * EARTH_RADIUS < 1e-5  # m: the rounding of 15,000 steps, doubled by Schuler's loop
    assert error[9] < 1e-7
    assert error[10:13].max() < 1e-8
    assert error[13:22].max() < 1e-11
