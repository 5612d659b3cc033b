"""A log delivered as it arrived: the live call to the bit, the whole log where nothing comes too late, and a run broken off and resumed."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.assembly import navigator_for
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

VEHICLE = """
name = "live"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
lever_arm_m = [0.3, 0.0, -0.05]
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
lever_arm_m = [-0.6, 0.1, 0.3]
[sensors.dvl.nuisance]
scale = { sigma_percent = 0.3 }
bias = { sigma_mps = 0.005, tau_s = 60.0 }
[sensors.depth]
rate_hz = 5.0
sigma_m = 0.05
[sensors.usbl]
kind = "position_fix"
rate_hz = 0.2
sigma_m = 1.0
vertical = false
"""
START = StartSigmas(position=2.0, depth=0.2, velocity=0.05, tilt=radians(0.3), heading=radians(1.0))
PLACE = Place(radians(45.0), radians(10.0), depth=20.0, surface_height=10.0)
TRAJECTORY = survey(PLACE, Lawnmower(legs=2, length=60.0, spacing=20.0, speed=1.5), duration=120.0)
ABOARD = vehicle_from_toml(VEHICLE)


def recorded(seed=1, delay=8.0, spread=0.5):
    """A log whose fixes arrive seconds after they were valid."""
    made = instruments_of(ABOARD)
    made["usbl"] = replace(made["usbl"], latency=delay, latency_jitter=spread, offset=2.0)
    made["dvl"] = replace(made["dvl"], latency=0.05, latency_jitter=0.1, offset=0.013)
    return Recorder(TRAJECTORY, made, truth_rate=1.0, start=START).draw(seed)


def by_hand(log, window=30.0):
    """The live call, one row after the other."""
    navigator, _, _ = navigator_for(log, ABOARD, window=window)
    arrival = {n: log[n].received if log[n].received is not None else log[n].time for n in ABOARD.sensors}
    rows = [(arrival[n][i], k, i, n) for k, n in enumerate(ABOARD.sensors) for i in range(len(log[n]))]
    for _, _, i, name in sorted(rows):
        navigator.add(name, log[name].select([i]))
    return navigator


@pytest.mark.parametrize("window", [30.0, 6.0])
def test_it_is_the_live_call_to_the_bit(window):
    log = recorded()
    navigator, solution = by_hand(log, window), solve_as_live(log, ABOARD, window=window, times=np.array([10.0, 119.0, 120.0]))
    now = navigator.estimate()
    assert now.time[0] == solution.time[-1] == 120.0
    for name in ("latitude", "longitude", "height", "velocity_n", "quaternion_nb", "covariance"):
        assert np.array_equal(getattr(now, name)[0], getattr(solution, name)[-1]), name
    late = solution.innovations.outcome[solution.innovations.sensor == "usbl"] == Outcome.LATE
    assert late.any() == (window < 8.0)


def test_it_is_the_whole_log_where_no_lag_exceeds_the_window():
    log = recorded()
    live, whole = solve_as_live(log, ABOARD, rate=2.0), solve(log, ABOARD, rate=2.0)
    assert np.array_equal(live.time, whole.time)
    scale = np.sqrt(np.diagonal(whole.covariance, axis1=1, axis2=2))
    assert np.abs((live.covariance - whole.covariance) / (scale[:, :, None] * scale[:, None, :])).max() < 1e-9
    assert np.abs(live.position_n - whole.position_n).max() < 1e-6  # the rounding of a place
    assert np.abs(live.velocity_n - whole.velocity_n).max() < 1e-9
    for field in ("sensor", "row", "component", "outcome"):
        used = [s.innovations.select(s.innovations.outcome != Outcome.OUTSIDE_RUN) for s in (live, whole)]
        keys = [np.lexsort((u.component, u.row, u.sensor)) for u in used]
        assert np.array_equal(getattr(used[0], field)[keys[0]], getattr(used[1], field)[keys[1]]), field
    assert np.array_equal(live.status, whole.status)


def test_a_fix_that_comes_too_late_is_told_and_not_used():
    log = recorded()
    solution = solve_as_live(log, ABOARD, window=5.0)
    assert solution.summary["counts"]["usbl"]["late"] > 10
    assert "late" not in solve(log, ABOARD).summary["counts"]["usbl"]


@pytest.mark.parametrize("cut", [37.3, 64.0])
def test_a_run_that_is_resumed_has_the_same_bits(tmp_path, cut):
    log, file = recorded(), tmp_path / "navigator.npz"
    times = np.arange(0.0, 120.5, 0.5)
    whole = solve_as_live(log, ABOARD, times=times)
    first = solve_as_live(log, ABOARD, times=times, end=cut, snapshot=file)
    second = solve_as_live(log, ABOARD, times=times, resume=file)
    assert first.time[-1] <= cut <= second.time[0] + 0.5
    same = np.isin(whole.time, second.time)
    for name in ("latitude", "longitude", "height", "velocity_n", "quaternion_nb", "covariance"):
        assert np.array_equal(getattr(whole, name)[same], getattr(second, name)), name
    total = sum(n for counts in whole.summary["counts"].values() for n in counts.values())
    assert total == sum(len(t) for n, t in log.tables.items() if n != "truth")


def test_a_snapshot_of_another_vehicle_is_refused(tmp_path):
    log, file = recorded(), tmp_path / "navigator.npz"
    solve_as_live(log, ABOARD, end=20.0, snapshot=file)
    for other in (ABOARD.without("depth"), vehicle_from_toml(VEHICLE.replace("sigma_m = 0.05", "sigma_m = 0.06"))):
        with pytest.raises(InputError, match="other states"):
            solve_as_live(log, other, resume=file)
    whole = file.read_bytes()
    for damaged in (b"nothing", b"", whole[: len(whole) // 2], whole[:3000] + bytes(200) + whole[3200:]):
        file.write_bytes(damaged)
        with pytest.raises(InputError, match="is no snapshot; give"):
            solve_as_live(log, ABOARD, resume=file)
    with pytest.raises(InputError, match="is no file; give a file that --snapshot wrote"):
        solve_as_live(log, ABOARD, resume=tmp_path / "missing.npz")


def test_increments_of_another_system_are_the_same_live(tmp_path):
    """A row of `navigation` is understood by those before it: row by row, and over a snapshot, it gives what the whole table gives."""
    text = (
        VEHICLE
        + """
[sensors.other]
kind = "navigation"
use = "increments"
increment_s = 2.0
sigma_rate_m_per_rts = 0.05
rate_hz = 1.0
"""
    )
    aboard = vehicle_from_toml(text)
    log = Recorder(TRAJECTORY, instruments_of(aboard), truth_rate=1.0, start=START).draw(2)
    times, file = np.arange(0.0, 119.0, 0.5), tmp_path / "navigator.npz"
    whole, live = solve(log, aboard, times=times), solve_as_live(log, aboard, times=times)
    assert whole.summary["counts"]["other"]["used"] > 40
    assert np.array_equal(live.covariance, whole.covariance)
    assert np.array_equal(live.latitude, whole.latitude)
    solve_as_live(log, aboard, times=times, end=61.0, snapshot=file)
    second = solve_as_live(log, aboard, times=times, resume=file)
    assert np.array_equal(second.latitude, whole.latitude[np.isin(whole.time, second.time)])
