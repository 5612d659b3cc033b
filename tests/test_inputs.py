"""Which inertial unit drives: late arrivals, returns, units that never speak, and stamps far ahead; live and offline alike."""

from dataclasses import replace

import numpy as np
import pytest
from test_inertial_units import VEHICLE, recorded, without_rows

from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.assembly import navigator_for
from leadline.estimate.solve import solve

ABOARD = vehicle_from_toml(VEHICLE)
LOG = recorded(ABOARD, 4, 100.0, lively=False)
TIMES = np.arange(0.0, 99.5, 0.5)
SAME = ("latitude", "longitude", "height", "velocity_n", "quaternion_nb", "covariance")


def the_same(live, whole):
    for name in SAME:
        assert np.array_equal(getattr(live, name), getattr(whole, name)), name


def test_rows_of_the_first_unit_that_are_only_late_in_arriving_are_its_own():
    imu = LOG["imu"]
    received = np.maximum.accumulate(imu.time + np.where((imu.time > 40.0) & (imu.time < 45.0), 0.4, 0.0))
    log = replace(LOG, tables={**LOG.tables, "imu": replace(imu, received=received)})
    live, whole = solve_as_live(log, ABOARD, times=TIMES), solve(log, ABOARD, times=TIMES)
    the_same(live, whole)
    assert "inertial" not in live.summary


@pytest.mark.parametrize(
    ("gone", "gone_b"),
    [
        (lambda t: (t > 40.0) & (t < 60.0), lambda t: (t > 45.0) & (t < 50.0)),
        (lambda t: (t > 40.0) & (t < 43.0) | (t > 60.0) & (t < 62.0), lambda t: t < 0.0),
        (lambda t: t < 10.0, lambda t: t < 0.0),
        (lambda t: t > 40.0, lambda t: (t > 70.0) & (t < 72.0)),
    ],
    ids=["the second falls silent as well", "twice", "the first begins late", "for good, with a gap of the second"],
)
def test_silences_are_filled_alike_live_and_offline(gone, gone_b):
    log = without_rows(without_rows(LOG, "imu", gone), "imu_b", gone_b)
    live, whole = solve_as_live(log, ABOARD, times=TIMES), solve(log, ABOARD, times=TIMES)
    the_same(live, whole)
    spans = [[(s["kind"], s["start_s"]) for s in found.summary["inertial"]] for found in (live, whole)]
    assert spans[0] == [(kind, pytest.approx(start, abs=1e-9)) for kind, start in spans[1]]


def test_a_unit_that_never_speaks_is_replaced_from_the_start():
    log = without_rows(LOG, "imu", lambda t: t > -1.0)
    live, whole = solve_as_live(log, ABOARD, times=TIMES[:-2]), solve(log, ABOARD, times=TIMES[:-2])
    the_same(live, whole)
    assert whole.summary["inertial"][0]["kind"] == "standby"
    assert np.isfinite(whole.covariance).all()


def test_inputs_of_the_second_unit_are_not_kept_for_ever():
    navigator, _, _ = navigator_for(LOG, ABOARD)
    navigator.add("imu", LOG["imu"].select(LOG["imu"].time < 5.0))
    rows = LOG["imu_b"]
    for first in range(0, len(rows), 50):
        navigator.add("imu_b", rows.select(slice(first, first + 50)))
    assert navigator.time > 95.0
    assert len(navigator.inputs.time) < 200


@pytest.mark.parametrize("ahead", [40.0, 5000.0, 1e7])
def test_one_stamp_far_ahead_does_not_end_a_live_run(ahead):
    imu = LOG["imu"]
    time = imu.time.copy()
    time[2000] += ahead
    log = replace(LOG, tables={**LOG.tables, "imu": replace(imu, time=time, received=imu.time)})
    alone = ABOARD.without("imu_b")
    live, whole = solve_as_live(log, alone, times=TIMES), solve(LOG, alone, times=TIMES)
    assert np.abs(live.position_n - whole.position_n).max() < 0.05
    assert live.summary["counts"]["dvl"]["used"] == whole.summary["counts"]["dvl"]["used"]
    assert "inertial" not in live.summary


def test_a_row_beyond_a_gap_waits_for_the_next():
    alone = ABOARD.without("imu_b")
    navigator, _, _ = navigator_for(LOG, alone)
    imu = LOG["imu"]
    navigator.add("imu", imu.select(imu.time < 10.0))
    before = navigator.inputs.covered
    assert navigator.add("imu", imu.select(np.array([600]))).tolist() == [Outcome.USED]
    assert navigator.inputs.covered == before
    navigator.add("imu", imu.select(np.array([601])))
    assert navigator.inputs.covered == imu.time[601]


def test_the_second_unit_can_be_left_out():
    assert ABOARD.without("imu_b").process.standby is None
    assert ABOARD.only("imu", "dvl").process.standby is None


def test_a_stretch_without_events_is_no_trouble():
    log = without_rows(LOG, "imu", lambda t: (t > 10.0) & (t < 90.0))
    bare = replace(log, tables={k: t.select((t.time < 9.0) | (t.time > 91.0)) if k != "imu" else t for k, t in log.tables.items()})
    alone = ABOARD.without("imu_b")
    for smooth in (False, True):
        solution = solve(bare, alone, times=np.array([5.0, 95.0]), smooth=smooth)
        assert np.isfinite(solution.covariance).all()
