"""Paper 001: on its three paths the filters are as good as they can be and say so, and each thing that is wrong in it leaves its mark.

Bars hold by the rule of the house: the 99 % interval of a statistic reaches the limit.  studies/papers/paper_001.py asks the same of 200
runs; here it is few, of fixed seeds, and a mark that is wrong by a factor is seen all the same.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from math import pi
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from leadline.assess.consistency import Answer
from leadline.core import attitude, geodesy
from leadline.core.compiled import WIDE
from leadline.data.records import PositionFix
from leadline.models.layout import INPUTS, Layout, difference, retract
from leadline.models.process import Process
from leadline.models.processes import compose_process
from leadline.models.sensor import Context
from leadline.simulate.dive import Recorder

sys.path.append(str(Path(__file__).parent.parent / "studies" / "papers"))
import as_published_001 as printed
import common
import held_fixes
import paper_001 as paper
import paths_001 as paths
import slope_heading

RUNS, FEW = range(20), range(6)
TIME = np.linspace(0.0, 60.0, 241)


@pytest.fixture(scope="module")
def found() -> SimpleNamespace:
    """The study of the three paths with two estimators, its rows, and C1 from an exact start."""
    results = paper.on_the_paths(RUNS, estimators=("ekf", "ukf"))
    rows = paper.rows_of(results, paper.bounds(patterns=4), RUNS)
    return SimpleNamespace(results=results, rows=rows, exact=paper.exact_start(RUNS))


def test_paths_are_those_of_table_3_with_the_course_for_a_heading() -> None:
    for name, (x, y) in {
        "sine": (TIME, 5.0 * np.sin(0.2 * TIME)),
        "circle": (10.0 * np.cos(pi / 30 * TIME), 10.0 * np.sin(pi / 30 * TIME)),
        "straight": (TIME, np.ones_like(TIME)),
    }.items():
        motion = paths.PATHS[name].trajectory.at(TIME)
        assert np.abs(motion.position_t - np.stack([x, y, 0.0 * TIME], axis=1)).max() < 1e-12
        assert np.abs(motion.velocity_b[:, 1:]).max() < 1e-12  # it goes where it heads
    heading = paths.PATHS["sine"].trajectory.truth(TIME).heading
    assert np.abs(np.sin(0.5 * (heading - np.arctan2(np.cos(0.2 * TIME), 1.0)))).max() < 1e-6
    heading = paths.PATHS["circle"].trajectory.truth(TIME).heading
    assert np.abs(np.sin(0.5 * (heading - pi / 30 * TIME - pi / 2))).max() < 1e-6


def test_fixes_come_at_intervals_of_their_own_in_each_run() -> None:
    recorder = paths.case("intervals", paths.PATHS["straight"]).source
    assert isinstance(recorder, Recorder)
    times = [recorder.draw(seed).tables["sbl"].time for seed in range(40)]
    gaps = np.concatenate([np.diff(t) for t in times])
    assert 0.1 <= gaps.min() < 0.15
    assert 1.95 < gaps.max() <= 2.0
    assert abs(gaps.mean() - 1.05) < 4.0 * 1.9 / np.sqrt(12 * len(gaps))
    assert not np.array_equal(times[0][:5], times[1][:5])
    assert np.array_equal(times[3], recorder.draw(3).tables["sbl"].time)


def test_the_vehicle_says_what_is_drawn() -> None:
    """Noise of a long record has the variances of table II, and those that are assumed."""
    still = replace(paths.PATHS["straight"].trajectory, duration=400.0)
    recorder = Recorder(still, paths.instruments(), name="long")
    log, ideal = recorder.draw(0), recorder.steady
    dvl = np.var(log.tables["dvl"].velocity - ideal["dvl"].velocity, axis=0)
    accel = np.var(log.tables["imu"].accel - ideal["imu"].accel, axis=0)
    spread = 4.0 * np.sqrt(2.0 / 4000)  # of a variance, four sigma
    assert np.abs(dvl / paths.DVL_VARIANCE - 1.0).max() < spread
    assert np.abs(accel / np.mean([1.73e-4, 1.39e-4, 3.9e-4]) - 1.0).max() < spread
    imu = paths.vehicle()["imu"]
    assert imu.value("accel_noise") ** 2 * 10.0 == pytest.approx(paths.ACCEL_VARIANCE, rel=1e-12)
    assert imu.value("gyro_noise") ** 2 * 10.0 == pytest.approx(0.005**2, rel=1e-12)


def test_right_filters_reach_the_bound_and_say_so(found: SimpleNamespace) -> None:
    verdicts = paper.bars(found.rows, found.results, found.exact)
    missed = [v for v in verdicts if not v.held and "C1 ukf: never" not in v.bar]
    family = [v for v in verdicts if ": NIS of" in v.bar]
    # at 99 % one NIS in a hundred misses; they are judged as one family by Holm, as those of a study are
    assert [v.bar for v in missed if v not in family] == []
    assert all(s.answer == Answer.CONSISTENT for s in found.results.summaries.values())
    assert len(found.rows) == 12
    for row in found.rows:
        assert all(value.reaches(1.05, at_least=0.95) for value in row.over), (row.path, row.configuration, row.estimator)
        for block, value in row.anees.items():
            assert value.reaches(1.0, at_least=1.0), (row.path, row.configuration, row.estimator, block)


def test_a_right_filter_is_a_hundred_times_better_than_table_4_ahead(found: SimpleNamespace) -> None:
    for row in found.rows:
        east = paper.TABLE_IV[row.estimator, row.path, row.configuration][0]
        if row.path != "straight" or row.configuration == "C2":
            assert row.mse[0].low < east / 100.0
    for path in found.results.missions:
        assert all(ratio.low < 1.0 for ratio in paper.gained(found.results, path))


def test_extended_and_unscented_filters_are_one(found: SimpleNamespace) -> None:
    """They part by millimetres, with fixes and without."""
    for path in found.results.missions:
        assert printed.apart(path, FEW, "ukf", sbl=False) < 0.01
        assert paper.differences(found.results, path)["C2 ukf"] < 0.01


def test_the_papers_alpha_and_lambda_make_no_other_filter() -> None:
    """The weights of alpha 1e-3, beta 2, lambda 1 for nine states are those of the stated estimator; and it stays with the EKF."""
    alpha, beta, kappa = (float(part.split("=")[1]) for part in printed.LAMBDA_ONE.split(":")[1].split(","))
    scale = alpha**2 * (9 + kappa) - 9
    assert scale == 1.0
    assert scale / (9 + scale) + 1.0 - alpha**2 + beta == pytest.approx(1 / 10 + 1.0 - 1e-6 + 2.0, abs=1e-12)
    assert printed.apart("sine", FEW, printed.LAMBDA_ONE) < 0.01


def test_held_fixes_stand_until_the_next() -> None:
    fixes = PositionFix(time=np.array([0.13, 0.4, 0.95]), north=np.array([1.0, 2.0, 3.0]), east=np.array([4.0, 5.0, 6.0]))
    shown = held_fixes.held(fixes, 10.0, 1.2)
    by_hand = {0.2: 1, 0.3: 1, 0.4: 2, 0.5: 2, 0.6: 2, 0.7: 2, 0.8: 2, 0.9: 2, 1.0: 3, 1.1: 3, 1.2: 3}
    assert np.allclose(shown.time, list(by_hand))
    assert shown.north is not None
    assert shown.north.tolist() == list(by_hand.values())


def test_a_recorded_log_can_be_held_as_well() -> None:
    log = paths.case("to hold", paths.PATHS["sine"]).log(0)
    again = held_fixes.transformed(log)
    assert len(again.tables["sbl"]) >= 590
    assert set(np.unique(again.tables["sbl"].latitude)) <= set(log.tables["sbl"].latitude)
    assert again.tables["dvl"] is log.tables["dvl"]


def test_held_fixes_leave_their_mark() -> None:
    """A fix is held for I ~ U(0.1, 2) s: its mean age is E[I^2] / 2 E[I] = 0.668 s, and a filter that trusts it lags by that.

    The published MSE of X, which grows with the speed alone, is 0.446 v^2: the square of that age.
    """
    straight = printed.held_fixes("straight", FEW)
    assert straight.along.reaches(0.70, at_least=0.30)
    for path in paths.PATHS:
        row = printed.held_fixes(path, FEW, printed.TRUSTED)
        assert row.along.reaches(0.70, at_least=0.30)
        assert row.along.low > 0.2
        assert row.nees.low > 100.0
    assert straight.nees.low > 100.0
    assert straight.mse[0].low < paper.TABLE_IV["ekf", "straight", "C2"][0] < straight.mse[0].high + 0.1


def test_a_motion_without_transport_leaves_its_mark() -> None:
    wide, right = (printed.without_transport("wide", paths.WIDE_SINE, FEW, process) for process in (printed.PUBLISHED, printed.MODEL))
    assert wide.mse[0].low > 150.0
    assert wide.mse[0].high < 215.0
    assert wide.mse[1].high < 1.0
    assert wide.nees.low > 1500.0
    assert right.mse[0].high < 0.1
    assert right.nees.reaches(5.0, at_least=5.0)


def test_headings_of_table_3_leave_their_mark() -> None:
    slope = slope_heading.slope
    assert np.allclose(slope("sine", 5.0, 0.2, TIME), np.gradient(5.0 * np.sin(0.2 * TIME), TIME, edge_order=2), atol=2e-3)
    for path in ("sine", "circle"):
        row = printed.slope_heading(path, paths.PATHS[path], FEW)
        assert row.nees.low > 100.0
        assert row.mse[0].low > 1.0
    assert printed.slope_heading("straight", paths.PATHS["straight"], FEW).nees.reaches(5.0, at_least=5.0)


def test_half_a_degree_is_the_published_error_across_the_straight_path() -> None:
    """Y = X sin(0.5 deg) has the mean square 0.0914 m^2 over X = 0..60 m, less what the heading takes to arrive there; paper: 0.124."""
    row = printed.biased_heading(FEW)
    assert row.mse[1].reaches(0.12, at_least=0.07)
    assert row.mse[1].low > 0.03
    assert row.mse[0].high < 0.01
    assert row.nees.low > 10.0


def composed(model: str) -> Process:
    vehicle = paths.vehicle().moved_by(model)
    return compose_process(vehicle, Context(surface=-29.0))


def motion(generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A random motion and a random input of an inertial unit."""
    place = attitude.quaternion_from_matrix(geodesy.rotation_en(*generator.uniform(-1.0, 1.0, 2)))
    turned = generator.standard_normal(4)
    x = np.concatenate([place, [-40.0], generator.uniform(-3.0, 3.0, 3), turned / np.linalg.norm(turned)])
    u = np.zeros(INPUTS)
    u[:8] = [*generator.uniform(-0.5, 0.5, 3), *generator.uniform(-5.0, 5.0, 3), 1.0, 0.1]
    return x, u


def test_the_motion_as_printed_lacks_the_transport_term_alone() -> None:
    """In a short step it and `body-velocity` part by w x v, but for the turning Earth (3e-4 m/s^2 at 3 m/s) and second order."""
    mine, right = composed(printed.PUBLISHED), composed(printed.MODEL)
    generator, dt = np.random.default_rng(3), 1e-4
    for _ in range(20):
        x, u = motion(generator)
        y, rate, speed = x.copy(), u[:3].copy(), x[5:8].copy()
        mine.step(x, u, dt, mine.parameters, np.zeros(WIDE * WIDE))
        right.step(y, u, dt, right.parameters, np.zeros(WIDE * WIDE))
        assert np.abs((x[5:8] - y[5:8]) / dt - np.cross(rate, speed)).max() < 2e-3
        assert np.abs(x[:5] - y[:5]).max() < 1e-6


def test_the_printed_transition_is_the_derivative_of_the_printed_motion() -> None:
    """Where gravity is not in it, as in a gap, whose turning of the attitude the printed motion knows nothing of either."""
    process = composed(printed.PUBLISHED)
    plan, generator, dt = Layout(process.parts, (), 0, 1).head(), np.random.default_rng(4), 0.1

    def after(x: np.ndarray, j: int, h: float, u: np.ndarray) -> np.ndarray:
        d = np.zeros(WIDE)
        d[j] = h
        y = x.copy()
        retract(plan, y, d, 9)
        process.step(y, u, dt, process.parameters, np.zeros(WIDE * WIDE))
        return y

    for _ in range(10):
        x, u = motion(generator)
        u[6] = 0.0
        memory, found = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
        end = x.copy()
        process.step(end, u, dt, process.parameters, memory)
        process.push(memory, dt, process.parameters, np.eye(WIDE).ravel(), found, 16)
        for j in range(9):
            up, low = np.zeros(WIDE), np.zeros(WIDE)
            h = 1.0 if j < 6 else 1e-3
            difference(plan, after(x, j, h, u), end, up)
            difference(plan, after(x, j, -h, u), end, low)
            # places are known to 6378137 m x 2^-52 = 1.4e-9 m, and differ over 2e-3
            assert np.abs(found.reshape(WIDE, WIDE)[:9, j] - ((up - low) / (2.0 * h))[:9]).max() < 2e-6


def test_all_is_told(found: SimpleNamespace) -> None:
    verdicts = paper.bars(found.rows, found.results, found.exact)
    whole: dict[str, Any] = {
        "runs": list(RUNS), "rows": found.rows, "exact": found.exact, "far": {"sine": paper.differences(found.results, "sine")},
        "pool": {"C1": found.exact["sine"][0], "C2": found.exact["sine"][1]}, "published": [printed.biased_heading(range(2))],
        "verdicts": verdicts,
    }  # fmt: skip
    text = paper.text_of(whole, every_bar=True)
    assert "194.42" in text
    assert f"of {len(verdicts)} bars held" in text
    again = json.loads(json.dumps(paper.jsonable(whole)))
    assert len(again["rows"]) == 12
    assert again["rows"][0]["mse"][0]["estimate"] == found.rows[0].mse[0].estimate
    assert common.judged("x", found.exact["sine"][0], 0.0, -1.0).held == (found.exact["sine"][0].low <= 0.0)


def test_in_the_pool_the_track_closes() -> None:
    gaps = paper.pool(range(10))
    assert gaps["C1"].high < paper.CLOSURE["C1"]
    assert gaps["C2"].high < paper.CLOSURE["C2"]
    assert gaps["C2"].low <= gaps["C1"].high
