"""The verdict: how often it raises a false alarm, what it finds, and what it says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from solutions import group_rows, innovations, lost_rows, straight

from leadline.assess.consistency import (
    Answer,
    consistency,
    holm,
    innovation_evidence,
    judge,
    nees_evidence,
    nis_evidence,
    whiteness_evidence,
)
from leadline.assess.gated import autocorrelation, effective_size, truncated_moments
from leadline.assess.intervals import Interval, interval_of_anees, interval_of_fraction, interval_of_mean, interval_of_rmse_ratio

RUN = straight(np.arange(0.0, 10.0))


def verdict_on(*tables):
    return consistency(replace(RUN, innovations=innovations(list(tables))))


def sensor(rng, name, count, dof, factor=1.0, gate=0.999):
    names = ["north", "east", "down", "x"][:dof]
    return group_rows(name, np.arange(count), factor * rng.standard_normal((count, dof)), [1.0] * dof, names, gate=gate)


def correlated(rng, count, memory):
    """Unit-variance first-order process (count,)."""
    white = rng.standard_normal(count)
    x = np.empty(count)
    x[0] = white[0]
    for k in range(1, count):
        x[k] = memory * x[k - 1] + np.sqrt(1 - memory**2) * white[k]
    return x


@pytest.mark.parametrize(("dof", "limit"), [(1, 2.0), (3, 11.0), (4, 1e-4), (2, np.inf), (1, 1e-9)])
def test_truncated_moments_against_integration(dof, limit):
    from scipy.integrate import quad

    top = min(limit, 200.0)
    weight = chi2.cdf(top, dof)
    mean, variance = truncated_moments(dof, limit)
    assert mean == pytest.approx(quad(lambda x: x * chi2.pdf(x, dof), 0, top)[0] / weight, rel=1e-4)
    second = quad(lambda x: x * x * chi2.pdf(x, dof), 0, top)[0] / weight
    assert variance + mean**2 == pytest.approx(second, rel=1e-4)


def test_holm():
    assert holm([0.004, 0.3, 0.0001, 0.006]) == [False, False, True, False]
    assert holm([0.001, 0.004, 0.009]) == [True, True, True]
    assert holm([]) == []


@pytest.mark.parametrize(("count", "dof", "gate"), [(20, 1, 0.99), (60, 3, 0.95), (500, 2, 0.999), (40, 1, 1.0)])
def test_right_sigmas_are_seldom_called_wrong(count, dof, gate):
    """Of 300 families at 1 % at most 3 are expected to raise an alarm; 9 or more have probability 0.4 %."""
    rng = np.random.default_rng(11)
    alarms = [verdict_on(sensor(rng, "a", count, dof, gate=gate)).verdict.answer == Answer.INCONSISTENT for _ in range(300)]
    assert sum(alarms) <= 8


def test_raw_tests_have_their_size():
    """p-values below 5 % come about in 5 % of the cases, before materiality: 30 or more of 300 have probability 0.03 %."""
    rng = np.random.default_rng(12)
    nis, white = [], []
    for _ in range(300):
        table = sensor(rng, "a", 100, 2, gate=0.99)
        evidence = list(innovation_evidence(table))
        nis.append(evidence[0].p)
        white.append(evidence[2].p)
    assert sum(p < 0.05 for p in nis) <= 29
    assert sum(p < 0.05 for p in white) <= 29
    assert np.mean(nis) > 0.35


@pytest.mark.parametrize("factor", [1.5, 2.0, 1 / 1.5, 0.5])
def test_wrong_sigma_is_found_with_its_factor_through_the_gate(factor):
    rng = np.random.default_rng(5)
    covered, blamed = 0, 0
    for _ in range(40):
        found = verdict_on(sensor(rng, "good", 300, 3), sensor(rng, "usbl", 300, 2, factor))
        assert found.verdict.answer == Answer.INCONSISTENT
        assert "usbl" in found.verdict.sentence
        blamed += "good" in found.verdict.sentence
        interval = found.of("usbl")[0].factor
        covered += interval.low <= factor <= interval.high
        assert interval.estimate == pytest.approx(factor, rel=0.35)
    assert covered >= 38
    assert blamed <= 2


def test_sigma_wrong_by_two_is_mostly_shown_by_twenty_and_never_by_fewer():
    rng = np.random.default_rng(6)
    answers = [verdict_on(sensor(rng, "a", 20, 1, 2.0, gate=1.0)).verdict.answer for _ in range(50)]
    assert answers.count(Answer.INCONSISTENT) >= 30
    few = verdict_on(sensor(rng, "a", 19, 1, 2.0))
    assert few.verdict.answer == Answer.TOO_FEW
    assert "too few data (1" in few.of("a")[0].sentence


def test_significant_but_within_ten_per_cent_is_consistent():
    rng = np.random.default_rng(7)
    found = verdict_on(sensor(rng, "dvl", 50_000, 1, 1.05))
    mine = found.of("dvl")[0]
    assert mine.p < 1e-6
    assert mine.answer == Answer.CONSISTENT
    assert "within 10 %" in mine.sentence
    assert mine.factor.low < 1.05 < mine.factor.high
    assert verdict_on(sensor(rng, "dvl", 50_000, 1, 1.2)).verdict.answer == Answer.INCONSISTENT


def test_correlated_innovations_are_flagged():
    rng = np.random.default_rng(8)
    x = np.stack([correlated(rng, 300, 0.5), rng.standard_normal(300)], axis=1)
    found = verdict_on(group_rows("dvl", np.arange(300), x, [1.0, 1.0], ["x", "y"]))
    wrong = [v for v in found.verdicts if v.answer == Answer.INCONSISTENT]
    assert [(v.test, v.component) for v in wrong] == [("whiteness", "x")]
    assert wrong[0].value == pytest.approx(0.5, abs=0.15)
    assert "dvl x innovations are correlated" in found.verdict.sentence


def test_whiteness_does_not_depend_on_the_order_of_rows():
    rng = np.random.default_rng(9)
    table = sensor(rng, "a", 50, 2)
    shuffled = table.select(rng.permutation(len(table)))
    assert [e.p for e in innovation_evidence(table)] == pytest.approx([e.p for e in innovation_evidence(shuffled)])


def test_bias_is_flagged():
    rng = np.random.default_rng(10)
    assert verdict_on(group_rows("a", np.arange(200), 0.8 + 0.6 * rng.standard_normal(200), [1.0], ["x"])).verdict.test == ""
    found = verdict_on(group_rows("a", np.arange(200), 0.8 + 0.6 * rng.standard_normal(200), [1.0], ["x"]))
    assert [v.test for v in found.verdicts if v.answer == Answer.INCONSISTENT] == ["whiteness"]


def test_outliers_are_no_inconsistency_but_a_gate_that_takes_nearly_all_is():
    rng = np.random.default_rng(13)
    outliers = group_rows("a", np.arange(200), rng.standard_normal(200), [1.0], ["x"], outliers=range(0, 200, 10))
    found = verdict_on(outliers)
    assert found.verdict.answer == Answer.CONSISTENT
    assert "(outliers, or a sigma too small)" in found.of("a")[1].sentence
    nearly_all = group_rows("a", np.arange(200), 300.0 + rng.standard_normal(200), [1.0], ["x"])
    assert "turned away 100 %" in verdict_on(nearly_all).verdict.sentence


def test_widened_and_unjudged_groups_do_not_count():
    rng = np.random.default_rng(14)
    table = sensor(rng, "a", 100, 1, 5.0, gate=1.0)
    widened = np.arange(100) < 90
    found = verdict_on(replace(table, widened=widened))
    assert found.of("a")[0].count == 10


def test_correlated_nis_counts_for_less():
    rng = np.random.default_rng(15)
    p = []
    for _ in range(150):
        x = np.stack([correlated(rng, 400, 0.9) for _ in range(2)], axis=1)
        p.append(nis_evidence("a", group_rows("a", np.arange(400), x, [1.0, 1.0], ["x", "y"], gate=1.0).select(slice(None, None, 2))).p)
    assert sum(value < 0.05 for value in p) <= 20  # twice the nominal rate at most, where a naive test has ten times


def test_effective_size_of_a_first_order_process():
    rng = np.random.default_rng(16)
    x = correlated(rng, 100_000, 0.8)
    assert effective_size(autocorrelation(x), len(x)) == pytest.approx(100_000 * 0.2 / 1.8, rel=0.1)
    assert autocorrelation(np.zeros(4)).tolist() == [1, 0, 0, 0]


def test_nees_over_runs_has_its_size_and_power():
    rng = np.random.default_rng(17)
    memory = np.array([[correlated(rng, 60, 0.9) for _ in range(3)] for _ in range(100)])  # (runs, 3, times)
    errors = np.swapaxes(memory, 1, 2)
    right = judge([nees_evidence(errors, "position")])[0]
    assert right.answer == Answer.CONSISTENT
    assert right.factor.low < 1.0 < right.factor.high
    wrong = judge([nees_evidence(1.5 * errors, "position")])[0]
    assert wrong.answer == Answer.INCONSISTENT
    assert wrong.factor.estimate == pytest.approx(1.5, rel=0.1)
    assert wrong.factor.low < 1.5 < wrong.factor.high
    assert "too small" in wrong.sentence
    assert judge([nees_evidence(errors / 1.5, "position")])[0].sentence.endswith("too large")


def test_nees_false_alarms_of_slow_errors_in_one_run_and_in_many():
    rng = np.random.default_rng(18)
    one = [nees_evidence(np.stack([correlated(rng, 600, 0.98) for _ in range(3)], axis=1), "position").p for _ in range(200)]
    assert sum(p < 0.01 for p in one) <= 8
    white = [nees_evidence(rng.standard_normal((5, 40, 3)), "position").p for _ in range(300)]
    assert sum(p < 0.05 for p in white) <= 26


def test_one_slow_run_confirms_nothing_yet_a_gross_error_refutes():
    slow = np.tile([0.5, -0.3, 0.8], (200, 1))
    assert judge([nees_evidence(slow, "position")])[0].answer == Answer.TOO_FEW
    assert judge([nees_evidence(12 * slow, "position")])[0].answer == Answer.INCONSISTENT


def test_whiteness_of_few_values():
    evidence = whiteness_evidence("a", "x", np.array([1.0, -1.0]))
    assert judge([evidence])[0].answer == Answer.TOO_FEW


def test_intervals():
    rng = np.random.default_rng(19)
    inside = [interval_of_mean(rng.standard_normal(12)).reaches(0.0, at_least=0.0) for _ in range(300)]
    assert sum(inside) >= 291
    ratio = [interval_of_rmse_ratio(1.3 * rng.standard_normal((30, 5)), rng.standard_normal((30, 5))) for _ in range(200)]
    assert sum(i.low <= 1.3 <= i.high for i in ratio) >= 192
    same = rng.standard_normal(40)
    exact = interval_of_rmse_ratio(2.0 * same, same)
    assert exact.low == pytest.approx(2.0)
    assert exact.high == pytest.approx(2.0)
    anees = interval_of_anees(3.3, 50, 3)
    assert anees.low == pytest.approx(3.3 * 150 / chi2.ppf(0.995, 150))
    assert interval_of_fraction(0, 100).high == pytest.approx(1 - 0.005 ** (1 / 100))
    assert interval_of_fraction(100, 100).high == 1.0


def test_a_bar_holds_when_the_interval_reaches_it():
    interval = Interval(0.9, 1.2, 1.05)
    assert interval.reaches(1.0)
    assert not interval.reaches(0.8)
    assert interval.reaches(at_least=1.1)
    assert not interval.reaches(at_least=1.3)
    assert not interval.reaches(0.85, at_least=0.5)
    assert str(Interval(2.0, np.inf)) == "2 or more"


def test_a_sensor_of_which_little_was_used_is_the_first_thing_to_read():
    from leadline.data.outcome import Outcome

    rng = np.random.default_rng(3)
    good = sensor(rng, "depth", 400, 1)
    none = lost_rows("dvl", np.arange(399), Outcome.OUT_OF_RANGE)
    spare = [lost_rows("gnss", np.arange(50), Outcome.NOT_CONFIGURED), lost_rows("depth", np.arange(900), Outcome.HELD)]
    found = verdict_on(good, none, *spare).verdict
    assert found.answer == Answer.CONSISTENT
    assert found.first == ("dvl: 0 of 399 rows used (out of range)",)
    assert found.sentence == "dvl: 0 of 399 rows used (out of range). Consistent: the errors of depth are those predicted."
    half = sensor(rng, "usbl", 100, 2)
    used = len(np.unique(half.row[half.outcome == Outcome.USED]))
    assert verdict_on(good, half, lost_rows("usbl", np.arange(90), Outcome.INVALID)).verdict.first == ()
    more = lost_rows("usbl", np.arange(120), Outcome.INVALID)
    assert verdict_on(good, half, more).verdict.sentence.startswith(f"usbl: {used} of 220 rows used (invalid). Consistent")
    assert verdict_on(good).verdict.sentence.startswith("Consistent")


def test_sensors_without_rows_and_inertial_rows_are_known_from_the_summary():
    counts = {"depth": {}, "imu": {"used": 900, "duplicate": 3}, "fog": {"no_input": 80, "used": 20, "unheard_of": 5}}
    run = replace(RUN, summary={"counts": counts})
    found = consistency(run).verdict
    assert found.answer == Answer.TOO_FEW
    assert found.first[0] == "depth: has no rows"
    assert not [line for line in found.first if line.startswith("imu")]
    assert consistency(replace(RUN, summary={"counts": None})).verdict.first == ()


@pytest.mark.parametrize("name", ["latitude", "longitude", "depth", "north", "east", "covariance"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1e300])
def test_a_lost_solution_is_not_consistent(name, value):
    values = getattr(RUN, name).copy()
    values[4:] = value
    found = consistency(replace(RUN, innovations=innovations([sensor(np.random.default_rng(1), "a", 400, 1)]), **{name: values})).verdict
    assert found.answer == Answer.INCONSISTENT
    assert found.sentence.startswith("The solution is lost after 4 s. Not consistent: ")


def test_the_status_lost_is_a_lost_solution():
    from leadline.data.solution import Status

    status = np.where(RUN.time < 7, RUN.status, Status.LOST)
    assert consistency(replace(RUN, status=status)).verdict.first == ("The solution is lost after 7 s",)


def test_a_component_named_as_its_sensor_is_named_once():
    rng = np.random.default_rng(5)
    x = correlated(rng, 2000, 0.8)
    found = verdict_on(group_rows("depth", np.arange(2000), x, [1.0], ["depth"])).verdict
    assert "depth innovations are correlated" in found.sentence
    assert "depth depth" not in found.sentence


def test_a_tiny_factor_is_no_zero():
    tiny = verdict_on(sensor(np.random.default_rng(2), "a", 2000, 1, factor=1e-5))
    assert "innovations <0.001 times as large as predicted: its sigma is too large" in tiny.verdict.sentence
    assert Interval(0.0, 0.5).as_factor == "<0.001 to 0.5"
    assert Interval(0.5, np.inf).as_factor == "0.5 or more"
    assert Interval(0.0, 1e-4).as_factor == "<0.001"
