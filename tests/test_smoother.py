"""The smoother against two dense witnesses (tests/smoother_twin.py) on one stream, in sigmas; and what holds of any smoother."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from smoother_twin import Batch, Chain, Row, Smoothed, backward
from twin import dive, nominal, vehicle

from leadline.data.outcome import Outcome
from leadline.estimate import plan as at
from leadline.estimate.run import Results
from leadline.estimate.smoother import Smoother
from leadline.estimate.solve import Stream, navigator_for, stream_of
from leadline.models.view import RATE_V

AIDED = ("dvl", "depth", "heading", "usbl")
EARTH_RADIUS = 6.4e6
EPOCHS = [0.0, 0.3, 5.0, 10.0, 20.01, 29.5, 40.0, 45.2, 60.0]  # of inputs or measurements
BETWEEN = [5.003, 10.0471, 33.3333]
IN_THE_GAP = [30.1, 30.17, 30.3, 30.38, 30.555, 30.59]
# sensors, nuisances, times; agreement of covariances (sigma^2) and of states (sigma), about 10 times what is attained.  With nuisances
# the filters themselves agree no better: their states differ by as much at the end, where there is nothing to smooth.
COMPOSITIONS = {
    "15 states": (AIDED, (), EPOCHS, 1e-8, 1e-6),
    "15 states, between epochs": (AIDED, (), BETWEEN, 1e-9, 1e-6),
    "15 states, in a gap of the IMU": (AIDED, (), IN_THE_GAP, 1e-9, 1e-6),
    "15 states, whole steps in the gap": (("dvl", "heading", "usbl"), (), IN_THE_GAP, 1e-9, 1e-6),
    "21 states": (AIDED, ("dvl", "depth", "heading"), EPOCHS + BETWEEN + IN_THE_GAP, 1e-8, 5e-6),
    "24 states": ((*AIDED, "attitude"), ("dvl", "depth", "heading", "attitude"), EPOCHS, 1e-8, 5e-6),
}


@dataclass(frozen=True)
class Case:
    """A log as a stream, the navigator at its start, and the twin that keeps its chain, at its end."""

    stream: Stream
    state: np.ndarray
    navigator: object
    twin: Chain
    outcomes: list[int]

    def smoothed(self, edges: tuple[float, ...] = (), decided: dict[int, float] | None = None) -> tuple[Results, np.ndarray, Results]:
        """The product's work: filtered, residuals against all others, smoothed; in stretches between `edges`."""
        bounds, composition = [-np.inf, *edges, np.inf], self.navigator.composition
        parts = [self.stream.stretch(a, b) for a, b in pairwise(bounds)]
        told = []
        self.navigator.state[:] = self.state
        forward, checkpoints = [], []
        for events in parts:
            first, count = sum(len(o) for o, _ in told), int(events.measured.sum())
            verdict = np.array([(decided or {}).get(first + k, np.nan) for k in range(count)])
            told.append((np.where(verdict == 0.0, int(Outcome.OVERRULED), -1), np.where(verdict == 1.0, at.ADMIT, np.nan)))
            checkpoints.append(self.navigator.state.copy())
            forward.append(Results.room(composition, count, int((events.kind == at.IS_OUTPUT).sum())))
            forward[-1].outcome[:], forward[-1].result[:count, at.VERDICT] = told[-1]
            self.navigator.runner.run(self.navigator.state, events, forward[-1])
        smoother, others, back = Smoother(composition), [], []
        for events, state, (outcome, verdict) in reversed(list(zip(parts, checkpoints, told, strict=True))):
            found, results = smoother.stretch(state.copy(), events, outcome, verdict)
            others.append(found)
            back.append(results)
        return joined(forward, parts), np.concatenate(others[::-1]), joined(back[::-1], parts)


def joined(found: list[Results], parts: list) -> Results:
    """Results of stretches as those of one."""
    measured = [int(events.measured.sum()) for events in parts]
    outputs = [int((events.kind == at.IS_OUTPUT).sum()) for events in parts]
    return Results(
        np.concatenate([r.outcome for r in found]),
        np.concatenate([r.result[:n] for r, n in zip(found, measured, strict=True)]),
        np.concatenate([r.output[:n] for r, n in zip(found, outputs, strict=True)]),
    )


def case(
    names: tuple[str, ...], nuisances: tuple[str, ...], times: list[float], *, log=None, decided: dict[int, bool] | None = None
) -> Case:
    log, aboard = dive(62.0) if log is None else log, vehicle(*names, nuisances=nuisances)
    navigator, _, _ = navigator_for(log, aboard)
    stream = stream_of(log, aboard, navigator, times=np.sort(times))
    twin = Chain(navigator, aboard, log)
    return Case(stream, navigator.state.copy(), navigator, twin, twin.run(stream.events, decided))


def assert_agreement(case: Case, results: Results, witness: list[Smoothed], covariance: float, state: float) -> None:
    """Every number of each output: view, packed covariance, state and variances, in sigmas of the witness."""
    layout = case.navigator.composition.layout
    end = at.OUT_X + layout.motion_nominal + len(layout.nuisances)
    upper = np.triu_indices(9)
    assert len(results.output) == len(witness)
    for mine, other in zip(results.output, witness, strict=True):
        sigma = other.sigma
        scale = np.outer(sigma, sigma)[upper]
        assert np.abs((mine[at.OUT_COV : at.OUT_X] - other.covariance[upper]) / scale).max() < covariance
        assert np.abs(mine[end : end + len(sigma)] / sigma**2 - 1.0).max() < covariance
        error = np.abs(nominal(layout, mine[at.OUT_X : end]) - other.x)
        assert error[:9].max() * EARTH_RADIUS < state * sigma[:2].min()
        assert error[9] < state * sigma[2]
        assert (error[10:13] < state * sigma[3:6]).all()
        assert error[13:22].max() < state * sigma[6:9].min()
        assert (error[22:] < state * sigma[9:]).all()
        assert np.abs(mine[at.OUT_VIEW + RATE_V :][:3] - other.rate_b).max() < state * sigma[9:12].min() + 1e-15
        assert np.array_equal(mine[at.OUT_VIEW : at.OUT_VIEW + RATE_V], view_of(mine[at.OUT_X :]))


def view_of(x: np.ndarray) -> np.ndarray:
    """Place, velocity and attitude as a view holds them: in the order of the inertial state."""
    return x[:RATE_V]


@pytest.mark.parametrize(("names", "nuisances", "times", "covariance", "state"), COMPOSITIONS.values(), ids=COMPOSITIONS.keys())
def test_smoothed_states_are_those_of_rauch_tung_and_striebel(names, nuisances, times, covariance, state):
    found = case(names, nuisances, times)
    filtered, _, results = found.smoothed()
    assert np.array_equal(filtered.outcome, found.outcomes)
    assert 1 in found.outcomes  # gated rows are among them
    assert_agreement(found, results, backward(found.twin), covariance, state)


RANGED = (*AIDED, "ranges")


def short_dive(pings: float = 2.0):
    """Ten seconds, with a fix that lies 60 m off and a velocity that is far off."""
    log = dive(10.0, rate=50.0, gap=(6.0, 6.3), pings=pings)
    usbl, dvl = log["usbl"], log["dvl"]
    wrong, velocity = np.array(usbl.latitude), np.array(dvl.velocity)
    wrong[0] += 60.0 / EARTH_RADIUS
    velocity[20, 0] += 0.8
    return replace(log, tables={**log.tables, "usbl": replace(usbl, latitude=wrong), "dvl": replace(dvl, velocity=velocity)})


@pytest.fixture(scope="module", params=["15 states", "20 states and 2 clones"])
def short(request) -> tuple[Case, Batch]:
    sensors = {"15 states": (AIDED, ()), "20 states and 2 clones": (RANGED, ("dvl", "ranges"))}[request.param]
    found = case(*sensors, epochs(log := short_dive()), log=log)
    return found, Batch(found.twin)


def epochs(log) -> list[float]:
    """Moments at which there is an event anyway (of inertial rows, of a depth inside the gap, the start and the end), and between such."""
    return [0.0, 2.007, 4.8955, 6.17, *log["imu"].time[[1, 75, 100, 244, 385]], log["depth"].time[61], log["imu"].time[-1]]


def test_smoothed_states_are_those_of_least_squares(short):
    found, batch = short
    filtered, _, results = found.smoothed()
    assert np.array_equal(filtered.outcome, found.outcomes)
    assert_agreement(found, results, batch.smoothed(), 1e-9, 5e-6)


def test_recursion_and_least_squares_are_one(short):
    """The witnesses themselves: the recursion, which knows no clones, and all at once."""
    found, batch = short
    if found.navigator.composition.layout.clones:
        pytest.skip("no clones in the recursion")
    for one, other in zip(backward(found.twin), batch.smoothed(), strict=True):
        assert np.abs((one.correction - other.correction) / other.sigma).max() < 4e-9
        assert np.abs((one.covariance - other.covariance) / np.outer(other.sigma, other.sigma)).max() < 3e-9


def test_residual_against_all_others_is_that_without_the_row(short):
    """Of used rows and of gated ones: least squares over all other rows, and how far the row lies from what they foretell."""
    found, batch = short
    _, others, _ = found.smoothed()
    assert np.isfinite(others).all()
    places = [k for k, link in enumerate(found.twin.chain) if isinstance(link, Row)]
    chosen = places[::7] + [k for k in places if not found.twin.chain[k].used]
    assert sum(not found.twin.chain[k].used for k in chosen) >= 2
    for k in chosen:
        assert others[found.twin.chain[k].number] == pytest.approx(batch.against_others(k), rel=1e-6, abs=1e-6)


def test_rows_that_are_told_beforehand(short):
    """One row is let through an open gate, another is left out; the smoother and least squares are told the same."""
    plain, _ = short
    gated, used = plain.outcomes.index(1), 40
    assert plain.outcomes[used] == 0
    sensors = (RANGED, ("dvl", "ranges")) if plain.navigator.composition.layout.clones else (AIDED, ())
    found = case(*sensors, epochs(log := short_dive()), log=log, decided={gated: True, used: False})
    filtered, others, results = found.smoothed(decided={gated: 1.0, used: 0.0})
    assert filtered.outcome[gated] == Outcome.USED
    assert filtered.outcome[used] == Outcome.OVERRULED
    assert np.isnan(others[used])
    assert_agreement(found, results, Batch(found.twin).smoothed(), 1e-9, 5e-6)


def test_stretches_are_one(short):
    """The adjoint is carried over from stretch to stretch: with living clones, with inputs before the edge, and inside a gap."""
    found, _ = short
    _, others, whole = found.smoothed()
    _, pieces, parts = found.smoothed(edges=(1.34, 2.0, 6.15))
    assert pieces == pytest.approx(others, rel=1e-9)
    scale = np.abs(whole.output).max(axis=0) + 1e-300
    assert np.abs((parts.output - whole.output) / scale).max() < 1e-12


def test_smoothing_takes_nothing_away(short):
    """No sigma is larger than the filter's; the last state is the filter's, bit for bit; what was given is untouched."""
    found, _ = short
    before = found.state.copy()
    filtered, _, results = found.smoothed()
    layout = found.navigator.composition.layout
    variances = slice(at.OUT_X + layout.motion_nominal + len(layout.nuisances), None)
    assert (results.output[:, variances] <= filtered.output[:, variances] * (1.0 + 1e-9)).all()
    assert (results.output[0, variances] < 0.9 * filtered.output[0, variances]).any()
    assert np.array_equal(results.output[-1], filtered.output[-1])
    assert np.array_equal(before, found.state, equal_nan=True)
