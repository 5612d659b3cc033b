"""Paper 002: with current, bias and scale a vehicle that surfaces is as good as can be; without them it errs as published, by any filter.

Bars hold by the rule of the house: the 99 % interval of a statistic reaches the limit.  studies/papers/paper_002.py asks the same of 100
runs; here it is few, of fixed seeds, and a mark that is wrong by a factor is seen all the same.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leadline.assess.intervals import Interval
from leadline.missions.configuration import Configuration

sys.path.append(str(Path(__file__).parent.parent / "studies" / "papers"))
import paper_002 as paper
import sailing
import triangle_002 as triangle

RUNS, FEW = range(14), range(2)
BARE, CURRENT, FULL, SMOOTHED = paper.WAYS


@pytest.fixture(scope="module")
def lines() -> list[Any]:
    return paper.kinematic(RUNS)


def of(lines: list[Any], way: str, what: str) -> Any:
    (found,) = [line for line in lines if (line.way, line.what) == (way, what)]
    return found


def test_all_bars_of_the_kinematic_reduction_are_held(lines: list[Any]) -> None:
    judged = [line for line in lines if line.held is not None]
    assert len(judged) == 9
    assert [str(line) for line in judged if not line.held] == []


def test_the_bound_is_that_of_the_written_specification(lines: list[Any]) -> None:
    """6.34 m over the whole mission and 4.93 m after 160 s were found by another program, whose noise is assumed: 3 % for that."""
    assert of(lines, FULL, "bound").value.estimate == pytest.approx(6.34, rel=0.03)
    assert of(lines, FULL, "bound after 160 s").value.estimate == pytest.approx(4.93, rel=0.03)


def test_marks_of_what_is_left_out(lines: list[Any]) -> None:
    """Without the states twice as bad or worse, and grossly too sure; the states in between lie in between; a smoother is best."""
    rmse = {way: of(lines, way, "RMSE after 160 s").value for way in paper.WAYS}
    assert rmse[BARE].low > 2.0 * rmse[FULL].high
    assert rmse[BARE].estimate > rmse[CURRENT].estimate > rmse[FULL].estimate > rmse[SMOOTHED].estimate
    assert rmse[SMOOTHED].high < 0.6 * rmse[FULL].low
    assert of(lines, BARE, "ANEES(2)").value.low > 25 * of(lines, FULL, "ANEES(2)").value.high
    assert of(lines, CURRENT, "ANEES(2)").value.low > 2.0


def test_gps_is_heard_in_its_windows_alone() -> None:
    time = paper.kinematic_case().log(0)["gnss"].time
    window, within = np.divmod(time, 150.0)
    assert np.unique(window, return_counts=True)[1].tolist() == [10] * 8
    assert np.max(within) < 10.0


def test_current_heading_and_scale_are_drawn_for_each_run() -> None:
    """On the first leg, due north at 0.6 m/s: speed and sway through the water and the heading are off by as much as was asked, 0.1 m/s
    and 2 degrees; standard deviations of 40 runs, four of their own sigmas wide."""
    case = paper.kinematic_case()
    found = []
    for number in range(40):
        log = case.log(number)
        first = [log[name].time < 200.0 for name in ("sway", "attitude")]
        off = (log["attitude"].heading[first[1]] + np.pi) % (2 * np.pi) - np.pi
        found.append((np.mean(log["sway"].speed[first[0]]), np.mean(off)))
    spread = np.std(found, axis=0)
    assert spread == pytest.approx([0.1, np.radians(2.0)], rel=4 / np.sqrt(80))


def test_the_polygon_is_a_triangle_of_190_m() -> None:
    """In the middle of each side the vehicle is 190 m further along it than in the middle of the one before, 120 degrees turned."""
    track = paper.kinematic_case().source.trajectory.at(190.0 / 0.6 * np.array([0.5, 1.5, 2.5, 3.5])).position_t[:, :2]
    sides = np.diff(track, axis=0)
    cut = 2 * 190.0 * 0.5 * np.sin(np.pi / 6)  # from the middle of a side to that of the next
    assert np.linalg.norm(sides, axis=1) == pytest.approx([cut] * 3, abs=12.0)  # corners of 30 s are cut
    assert np.linalg.norm(track[3] - track[0]) < 12.0


def test_table_one_as_it_is_printed() -> None:
    """Means of 18.6 m and 12.4 m, of the paper's text; the UKF is worse at fixes 4 and 6."""
    one, two = (np.array(triangle.PUBLISHED[name]) for name in ("EKF", "UKF"))
    assert [round(float(np.mean(row)), 1) for row in (one, two)] == [18.6, 12.4]
    assert (np.flatnonzero(two > one) + 1).tolist() == [4, 6]


@pytest.fixture(scope="module")
def dives() -> dict[str, Any]:
    return triangle.solved(FEW, ["EKF", "UKF", "no current, EKF", "no current, UKF", "smoothed"])


def test_ekf_and_ukf_are_alike_with_the_hull(dives: dict[str, Any]) -> None:
    """Of one dive they differ by much less than each errs, with and without the states that are missing in the paper."""
    for before, most in (("", 0.03), ("no current, ", 0.06)):
        ekf, ukf = (np.sqrt(np.mean(np.sum(dives[before + name].error ** 2, axis=2))) for name in ("EKF", "UKF"))
        assert ekf / ukf == pytest.approx(1.0, abs=most)


def test_marks_of_the_hull_without_a_current(dives: dict[str, Any]) -> None:
    """Currents of these dives: 0.1 m/s and more."""
    size = {way: np.sqrt(np.mean(np.sum(one.error**2, axis=(2)), axis=1)) for way, one in dives.items()}
    assert np.all(size["no current, EKF"] > 2.0 * size["EKF"])
    assert np.all(size["EKF"] > 2.0 * size["smoothed"])
    assert np.mean(np.abs(dives["EKF"].surfacing) <= 3.0) > 0.95
    nees = np.einsum("rti,rtij,rtj->rt", *(dives["no current, EKF"].error, np.linalg.inv(dives["no current, EKF"].covariance)),
                     dives["no current, EKF"].error)  # fmt: skip
    assert np.mean(nees) > 50.0


def test_a_bar_can_be_missed() -> None:
    value = Interval(1.1, 1.3, 1.2)
    assert sailing.Line("", "", "", value, most=1.15).held is True
    assert sailing.Line("", "", "", value, most=1.05).held is False
    assert sailing.Line("", "", "", value, least=1.35).held is False
    assert sailing.Line("", "", "", value).held is None
    assert sailing.Line("", "", "", Interval(), most=1.0).held is False


def test_anees_of_what_is_chi_square() -> None:
    """Whitened errors of 200 runs, each constant over its times: two on average, and an interval as for 200 independent numbers."""
    white = np.repeat(np.random.default_rng(0).standard_normal((200, 1, 3)), 50, axis=1)
    found = sailing.anees(type("Runs", (), {"whitened": {"position": white}})())
    assert found.reaches(2.0, at_least=2.0)
    half = 2.576 * 2.0 / np.sqrt(200)
    assert found.high - found.low == pytest.approx(2 * half, rel=0.35)


def test_keys_of_a_run_file_are_laid_over_those_of_a_variant() -> None:
    made = sailing.published("no_current", paper.over(sigma=5.0, current=0.05), name="x")
    assert isinstance(made, Configuration)
    assert made.over["sensors"]["gnss"]["sigma_m"] == 5.0
    assert made.over["water"]["current"]["estimate"] is False
