"""Properties of smoothed runs: outputs, stretches and shuffles change no bit; the adjoint stays symmetric; the second pass abides."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from test_gates import PLACE, PLAN, START, aboard, outcomes, recorded

from leadline.assess.errors import errors_of
from leadline.core.compiled import WIDE
from leadline.data.outcome import Outcome
from leadline.estimate import stream as streams
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.assembly import navigator_for
from leadline.estimate.plan import ADMIT
from leadline.estimate.smoother import Smoother
from leadline.estimate.solve import Decision, decided, solve
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder
from leadline.simulate.plans import survey

SAME = ("latitude", "longitude", "height", "velocity_n", "quaternion_nb", "covariance")
FEW = settings(
    max_examples=8, phases=(Phase.explicit, Phase.generate), deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
LOG = recorded(9, 80.0)


@FEW
@given(st.lists(st.floats(0.0, 80.0), min_size=1, max_size=30))
def test_more_outputs_change_no_smoothed_state(times):
    moments = np.array([10.0, 40.013, 79.9])
    few = solve(LOG, aboard(), times=moments, smooth=True)
    many = solve(LOG, aboard(), times=np.unique([*moments, *times]), smooth=True)
    same = np.isin(many.time, moments)
    for name in SAME:
        assert np.array_equal(getattr(few, name), getattr(many, name)[same]), name


def test_shuffled_rows_change_no_smoothed_state():
    generator = np.random.default_rng(2)
    shuffled = {name: table.select(generator.permutation(len(table))) for name, table in LOG.tables.items()}
    a, b = (solve(log, aboard(), rate=1.0, smooth=True) for log in (LOG, replace(LOG, tables=shuffled)))
    for name in SAME:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_the_length_of_stretches_changes_nothing_that_can_be_seen(monkeypatch):
    a = solve(LOG, aboard(), rate=1.0, smooth=True)
    monkeypatch.setattr(streams, "STRETCH", 7.3)
    b = solve(LOG, aboard(), rate=1.0, smooth=True)
    scale = np.sqrt(np.diagonal(a.covariance, axis1=1, axis2=2))
    assert np.abs((a.covariance - b.covariance) / (scale[:, :, None] * scale[:, None, :])).max() < 1e-9
    assert np.abs(a.position_n - b.position_n).max() < 1e-6


def test_the_adjoint_stays_symmetric():
    """What is not symmetric in it would grow with every measurement, and after hours be all there is."""
    navigator, _, _ = navigator_for(LOG, aboard())
    stream = streams.stream_of(LOG, aboard(), navigator, rate=0.1)
    smoother = Smoother(navigator.composition)
    generator = np.random.default_rng(1)
    n = navigator.composition.layout.error
    skew = np.zeros((WIDE, WIDE))
    skew[:n, :n] = 1e-3 * generator.normal(size=(n, n))
    smoother.adjoint.L += (skew - skew.T).ravel()
    count = int(stream.events.measured.sum())
    smoother.stretch(navigator.state, stream.events, np.full(count, -1), np.full(count, np.nan))
    L = smoother.adjoint.L.reshape(WIDE, WIDE)
    assert np.abs(L - L.T).max() < 1e-9 * np.abs(L).max()


OPEN = dict.fromkeys(("dvl", "depth", "heading", "usbl"), "gate_probability = 0.999999999")


def test_a_smoothed_run_is_no_worse_and_ends_where_the_filter_ends():
    """Where no row is judged anew, smoothed sigmas lie below those of the filter and meet them at the end; over runs errors do so too."""
    squares = []
    for seed in range(6):
        log = recorded(seed, 200.0)
        filtered, smoothed = (solve(log, aboard(**OPEN), times=log.truth.time, smooth=s) for s in (False, True))
        assert smoothed.summary["judged_again"] == {"rounds": 1, "overruled": 0, "admitted": 0}
        assert (smoothed.sigma <= filtered.sigma * (1.0 + 1e-6)).all()
        np.testing.assert_allclose(smoothed.sigma[-1], filtered.sigma[-1], rtol=1e-9)
        np.testing.assert_allclose(smoothed.position_n[-1], filtered.position_n[-1], atol=1e-6)
        errors = [errors_of(s, log.truth).error for s in (filtered, smoothed)]
        squares.append([np.mean(e**2, axis=0) for e in errors])
    filtered, smoothed = np.sqrt(np.mean(squares, axis=0))
    assert (smoothed[:2] < 0.8 * filtered[:2]).all()
    assert (smoothed < 1.05 * filtered).all()


def test_the_second_pass_turns_away_a_wild_fix_and_takes_the_good_ones_that_followed():
    """After two minutes without Doppler log and fixes any fix is believed; the first is wild by 15 m, and the good ones that follow are
    turned away until the estimate is vague enough again.  By all that comes later the wild one stands alone."""
    log = recorded(4, 300.0, dvl={"outages": ((60.0, 270.0),)})
    fixes = log["usbl"].select((log["usbl"].time < 60.0) | (log["usbl"].time > 190.0))
    wild = int(np.argmax(fixes.time > 190.0))
    moved = np.where(np.arange(len(fixes)) == wild, fixes.latitude + 15.0 / 6.37e6, fixes.latitude)
    log = replace(log, tables={**log.tables, "usbl": replace(fixes, latitude=moved)})
    believed, judged = (outcomes(solve(log, aboard(), smooth=s), "usbl") for s in (False, True))
    assert believed.outcome[believed.row == wild][0] == Outcome.USED
    assert (believed.outcome == Outcome.GATED).sum() >= 1
    assert judged.outcome[judged.row == wild][0] == Outcome.OVERRULED
    assert (judged.outcome[judged.row != wild] == Outcome.USED).mean() > 0.95
    told = solve(log, aboard(), smooth=True).summary
    assert told["judged_again"]["overruled"] >= 1
    assert told["counts"]["usbl"]["overruled"] == 1


def test_rows_are_judged_by_all_others():
    """Used and outside the gate: overruled, for good.  Turned away and inside: admitted, for as long as it stays inside."""
    navigator, _, _ = navigator_for(LOG, aboard())
    events = streams.stream_of(LOG, aboard(), navigator, rate=0.1).events
    count = int(events.measured.sum())
    outcome, others = np.full(count, int(Outcome.USED)), np.full(count, 0.5)
    outcome[[2, 3]], others[[1, 3]], others[5] = Outcome.GATED, 1e3, np.nan
    first = decided(navigator, events, outcome, others, Decision.none(events))
    assert np.flatnonzero(first.outcome == Outcome.OVERRULED).tolist() == [1]
    assert np.flatnonzero(first.verdict == ADMIT).tolist() == [2]
    outcome[1], outcome[2], others[1], others[2] = Outcome.OVERRULED, Outcome.USED, np.nan, 0.7
    second = decided(navigator, events, outcome, others, first)
    assert second.same_as(first)
    others[2] = 1e3
    assert np.flatnonzero(decided(navigator, events, outcome, others, first).outcome == Outcome.OVERRULED).tolist() == [1, 2]


@settings(FEW, max_examples=6)
@given(st.integers(0, 1000), st.floats(0.1, 9.0), st.floats(0.0, 3.0))
def test_a_log_that_arrives_in_any_order_within_the_window_is_the_whole_log(seed, delay, spread):
    made = instruments_of(aboard())
    made["usbl"] = replace(made["usbl"], latency=delay, latency_jitter=spread, offset=1.0)
    made["depth"] = replace(made["depth"], latency=0.3 * delay, latency_jitter=0.2 * spread, offset=0.003)
    log = Recorder(survey(PLACE, PLAN, duration=40.0), made, truth_rate=1.0, start=START).draw(seed)
    times = np.array([5.0, 20.0])
    live, whole = solve_as_live(log, aboard(), times=times), solve(log, aboard(), times=times)
    overtaken = {name: table.summary["counts"].get("depth", {}).get("clock_jump") for name, table in (("a", live), ("b", whole))}
    assert overtaken["a"] == overtaken["b"]
    assert np.abs(live.velocity_n - whole.velocity_n).max() < 1e-9
    assert np.abs(live.height - whole.height).max() < 1e-8
    assert np.abs(live.covariance / whole.covariance - 1.0).max() < 1e-6


@pytest.mark.parametrize("window", [0.0, 2.0])
def test_what_comes_too_late_is_told(window):
    made = instruments_of(aboard())
    made["usbl"] = replace(made["usbl"], latency=5.0, offset=1.0)
    log = Recorder(survey(PLACE, PLAN, duration=40.0), made, truth_rate=1.0, start=START).draw(1)
    found = solve_as_live(log, aboard(), window=window)
    mine = outcomes(found, "usbl")
    assert set(mine.outcome) <= {int(Outcome.LATE), int(Outcome.OUTSIDE_RUN)}
