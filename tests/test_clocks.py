"""Clocks that step: found by the times of arrival, put right, and left alone where rows only came late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_dive import write_short_dive
from solutions import EPOCH

from leadline import read_log, read_vehicle, solve
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.records import Depth
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.clocks import AFTER, Clock
from leadline.simulate.faults import ClockJump, troubled

TIME = np.arange(0.0, 600.0, 5.0)


def table(time, received=None):
    return Depth(time=time, depth=20.0 + 0.001 * time, received=received)


def jumped(time, *faults):
    return troubled(Log(name="dive", epoch=EPOCH, tables={"depth": table(time)}), faults, 1)["depth"]


def one_by_one(rows, clock):
    parts = [clock.take(rows.select(slice(i, i + 1))) for i in np.argsort(rows.received, kind="stable")]
    return np.concatenate([part.time for part, _ in parts]), np.concatenate([aside for _, aside in parts])


@pytest.fixture(params=[0.2, 5.0])
def time(request):
    return np.arange(0.0, 600.0, request.param)


@pytest.mark.parametrize("step", [-1.0, 1.0, 0.5, -30.0])
def test_a_clock_that_steps_and_is_set_right(time, step):
    clock = Clock()
    mended, aside = clock.take(jumped(time, ClockJump(sensor="depth", begin=200.0, end=400.0, step=step)))
    assert [s.arrival for s in clock.steps] == pytest.approx([200.0, 400.0])
    assert [s.size for s in clock.steps] == pytest.approx([step, -step])
    first = np.searchsorted(time, [200.0, 400.0])
    assert np.flatnonzero(aside).tolist() == [*range(first[0], first[0] + AFTER), *range(first[1], first[1] + AFTER)]
    assert np.isnan(mended.time[aside]).all()
    assert np.abs(mended.time - time)[~aside].max() < 1e-9
    assert clock.offset == 0.0


def test_a_clock_that_nobody_sets_right_and_delays_that_vary_a_little(time):
    """The stamps after a step are off by no more than delays vary."""
    noisy = time + np.random.default_rng(2).uniform(0.01, 0.05, len(time))
    stamps = time + np.where(time >= 200.0, 1.0, 0.0)
    clock = Clock()
    mended, aside = clock.take(table(stamps, noisy))
    assert [(s.arrival, s.size) for s in clock.steps] == [(pytest.approx(200.0, abs=0.05), pytest.approx(1.0, abs=0.04))]
    assert aside.sum() == AFTER
    assert np.abs(mended.time - time)[~aside].max() < 0.04


def test_one_that_only_tells_changes_nothing(time):
    rows, clock = jumped(time, ClockJump(sensor="depth", begin=200.0, step=1.0)), Clock(mend=False)
    told, aside = clock.take(rows)
    assert np.array_equal(told.time, rows.time)
    assert not aside.any()
    assert len(clock.steps) == 1


@pytest.mark.parametrize("begin", [0.0, 200.0])
def test_delays_that_vary_are_no_step(begin):
    told = 0
    for seed in range(200):
        delay = np.where(begin <= TIME, np.random.default_rng(seed).uniform(2.0, 8.0, len(TIME)), 0.0)
        clock = Clock()
        clock.take(table(TIME, TIME + delay))
        told += len(clock.steps)
    assert told == 0


def test_rows_held_up_in_a_buffer_are_no_step(time):
    received = time.copy()
    held = (time >= 200.0) & (time < 230.0)
    received[held] = 230.0 + 1e-3 * np.arange(held.sum())
    clock = Clock()
    mended, aside = clock.take(table(time, np.maximum.accumulate(received)))
    assert clock.steps == []
    assert not aside.any()
    assert np.array_equal(mended.time, time)


def test_missing_rows_are_no_step_and_one_wild_stamp_is_set_aside():
    kept, clock = np.r_[0:40, 60:120], Clock()
    assert not clock.take(table(TIME[kept], TIME[kept]))[1].any()
    assert clock.steps == []
    wild, clock = TIME.copy(), Clock()
    wild[50] += 1000.0
    mended, aside = clock.take(table(wild, TIME))
    assert np.flatnonzero(aside).tolist() == [50]
    assert clock.steps == []
    assert np.array_equal(mended.time[~aside], TIME[~aside])


def off(stamps, received, clock=None):
    """How far the stamps that are believed are off in the end (s), of a clock whose `received` is right."""
    clock = clock or Clock()
    mended, aside = clock.take(table(stamps, received))
    row, alone = one_by_one(table(stamps, received), Clock())
    assert np.array_equal(mended.time[np.argsort(received, kind="stable")], row, equal_nan=True)
    assert np.array_equal(aside[np.argsort(received, kind="stable")], alone)
    return mended.time, aside


@pytest.mark.parametrize("rows", range(1, 12))
def test_a_hiccup_of_a_few_rows_ends(rows):
    stamps = np.arange(0.0, 60.0, 0.2)
    received = stamps.copy()
    wrong = stamps.copy()
    wrong[100 : 100 + rows] += 1.0
    mended, aside = off(wrong, received + 0.05)
    assert np.abs(mended - stamps)[~aside].max() < 1e-9
    assert aside.sum() <= 2 * AFTER


@pytest.mark.parametrize(("packet", "lost"), [(1.0, 0.4), (0.5, 0.3), (1.0, 0.9)])
def test_rows_lost_from_a_packet_are_no_step(packet, lost):
    time = np.arange(0.0, 60.0, 0.01)
    time = time[(time < 30.02) | (time > 30.02 + lost)]
    received = np.floor(time / packet) * packet + packet + 0.02
    mended, aside = off(time, received)
    assert np.array_equal(mended[~aside], time[~aside])
    assert aside.sum() <= AFTER


def test_rows_lost_in_a_queue_are_no_step():
    time = np.arange(0.0, 600.0, 0.2)
    held = (time > 200.0) & (time < 260.0)
    received = np.where(held, 260.0 + 1e-3 * np.cumsum(held), time + 0.05)
    kept = ~((time > 220.0) & (time < 230.0))
    mended, aside = off(time[kept], received[kept])
    assert np.array_equal(mended[~aside], time[kept][~aside])


@pytest.mark.parametrize("interval", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("rows", [3, 10, 30])
def test_a_driver_that_repeats_its_last_stamp_is_no_step(interval, rows):
    time = np.arange(100) * interval
    stamps = time.copy()
    stamps[40 : 40 + rows] = stamps[39]
    mended, aside = off(stamps, time + 0.05)
    assert np.array_equal(mended[~aside], stamps[~aside])


@pytest.mark.parametrize("wrong", [-1.7e9, -30.0, -0.7, 0.7, 500.0])
def test_a_clock_that_is_wrong_when_it_starts_and_then_set_right(wrong):
    """The clock that is nearer to the arrivals is the right one, whichever came first."""
    time = np.arange(0.0, 60.0, 0.2)
    stamps = time + np.where(np.arange(len(time)) < 30, wrong, 0.0)
    mended, aside = off(stamps, time + 0.05)
    assert np.array_equal(mended[30:][~aside[30:]], time[30:][~aside[30:]])


@pytest.mark.parametrize("period", [1.001, 0.999, 1.002, 0.998, 2.001])
def test_stamps_in_whole_seconds_do_not_drift_away(period):
    time = np.arange(3000) * period
    stamps = np.floor(time)
    mended, aside = off(stamps, time + 0.01)
    assert np.abs(mended - time)[~aside].max() < 1.0 + 1e-9


@pytest.mark.parametrize("polled", [1.002, 0.998])
def test_a_device_that_is_polled_does_not_drift_away(polled):
    received = 10.0 + np.arange(3000) * polled
    stamps = np.floor(received)  # of the last of its rows
    mended, aside = off(stamps, received)
    assert np.abs(mended - stamps)[~aside].max() < 1.0 + 1e-9


def test_a_queue_that_is_flushed_is_no_step():
    time = np.arange(0.0, 200.0, 1.0)
    received = np.where(time < 100.0, time + np.minimum(20.0, 0.4 * time), time + 0.05)
    kept = (time < 80.0) | (time >= 100.0)
    mended, aside = off(time[kept], received[kept])
    assert np.array_equal(mended[~aside], time[kept][~aside])


@pytest.mark.parametrize("chance", [0.02, 0.1, 0.3])
def test_fixes_of_two_ages_are_no_step(chance):
    """A telegram each half minute, with the fix of this cycle or of the one before."""
    generator = np.random.default_rng(5)
    old = np.cumsum(generator.random(2000) < chance) % 2
    received = 30.0 * np.arange(2000) + 12.0
    stamps = received - np.where(old, 10.0, 2.0)
    mended, aside = off(stamps, received)
    assert not aside.any()
    assert np.array_equal(mended, stamps)


def test_a_clock_that_comes_right_in_a_silence():
    time = np.arange(0.0, 200.0, 0.2)
    time = time[(time < 120.0) | (time > 140.0)]
    stamps = time + ((time >= 100.0) & (time < 130.0))
    mended, aside = off(stamps, time + 0.05)
    assert np.abs(mended - time)[~aside].max() < 1e-9
    assert aside.sum() == 2 * AFTER


def test_rows_whose_arrival_is_not_known_are_stamped_as_the_others():
    time = np.arange(0.0, 60.0, 0.2)
    stamps, received = time + (time > 30.0), time + 0.05
    received[::10] = np.nan
    clock = Clock()
    mended, aside = clock.take(table(stamps, received))
    assert len(clock.steps) == 1
    clear = ~aside & ((time < 29.0) | (time > 32.0))
    assert np.abs(mended.time - time)[clear].max() < 1e-9


def test_many_steps_are_found():
    clock = Clock()
    mended, aside = clock.take(table(TIME + np.floor(np.arange(len(TIME)) / 20.0), TIME))
    assert [s.arrival for s in clock.steps] == TIME[20::20].tolist()
    assert np.abs(mended.time - TIME)[~aside].max() < 1e-9


def test_without_times_of_arrival_nothing_is_changed():
    rows = table(TIME + (TIME > 200.0))
    mended, aside = Clock().take(rows)
    assert mended is rows
    assert not aside.any()


@given(
    st.lists(st.tuples(st.sampled_from([0.0, 0.0, 0.0, 0.01, 0.4, 3.0]), st.sampled_from([0.0] * 8 + [1.0, -1.0])), max_size=60), st.data()
)
def test_row_by_row_and_in_pieces_is_the_same(rows, data):
    """Whatever delays and steps: a whole table, pieces of it, and single rows give the same bits."""
    delay, step = (np.array([row[k] for row in rows], float) for k in (0, 1))
    time = np.arange(len(rows)) * 1.0
    received = np.maximum.accumulate(time + delay) if len(rows) else time
    made = table(time + np.cumsum(step), received)
    whole, single, pieces = Clock(), Clock(), Clock()
    mended, aside = whole.take(made)
    times, asides = one_by_one(made, single) if len(rows) else (np.zeros(0), np.zeros(0, bool))
    assert np.array_equal(mended.time, times, equal_nan=True)
    assert np.array_equal(aside, asides)
    cut = data.draw(st.integers(0, len(rows)))
    parts = [pieces.take(made.select(part)) for part in (slice(0, cut), slice(cut, None))]
    assert np.array_equal(mended.time, np.concatenate([part.time for part, _ in parts]), equal_nan=True)
    assert whole == single == pieces


@pytest.mark.parametrize("sensor", ["dvl", "imu", "depth"])
def test_a_dive_with_a_clock_that_steps_is_that_without(tmp_path, sensor):
    """Each sensor's clock, the inertial unit's as well: live as offline, and within what the rows set aside cost."""
    write_short_dive(tmp_path)
    log, vehicle = read_log(tmp_path / "dive"), read_vehicle(tmp_path / "vehicle.toml")
    times = np.arange(0.0, 110.0, 1.0)
    calm = solve(log, vehicle, times=times)
    wrong = troubled(log, [ClockJump(sensor=sensor, begin=50.0, step=-1.0)], 1)
    found, live = solve(wrong, vehicle, times=times), solve_as_live(wrong, vehicle, times=times)
    assert [(s["sensor"], s["step_s"]) for s in found.summary["clock_steps"]] == [(sensor, pytest.approx(-1.0))]
    assert found.summary["clock_steps"] == live.summary["clock_steps"]
    assert np.abs(found.position_n - live.position_n).max() < 1e-9
    assert found.summary["counts"][sensor]["clock_jump"] == live.summary["counts"][sensor]["clock_jump"] == AFTER
    assert np.abs(found.position_n - calm.position_n).max() < 0.1
    aboard = replace(vehicle, sensors={**vehicle.sensors, sensor: replace(vehicle[sensor], mend_clock=False)})
    left = solve(wrong, aboard, times=times[:-1])
    assert [s["mended"] for s in left.summary["clock_steps"]] == [False]
    assert np.abs(left.position_n - calm.position_n[:-1]).max() > np.abs(found.position_n - calm.position_n).max()


def test_a_dive_in_which_some_arrivals_are_not_known(tmp_path):
    """Live as offline, also through a step; a log cut before the step tells none."""
    write_short_dive(tmp_path)
    log, vehicle = read_log(tmp_path / "dive"), read_vehicle(tmp_path / "vehicle.toml")
    calm = solve(log, vehicle)
    log = troubled(log, [ClockJump(sensor="dvl", begin=50.0, step=1.0)], 1)
    for name, every in (("imu", 7), ("dvl", 50)):
        received = log[name].time.copy() if log[name].received is None else log[name].received.copy()
        received[::every] = np.nan
        log = replace(log, tables={**log.tables, name: replace(log[name], received=received)})
    found, live = solve(log, vehicle), solve_as_live(log, vehicle)
    assert found.summary["clock_steps"] == live.summary["clock_steps"] != []
    assert np.abs(found.position_n - live.position_n).max() < 1e-9
    assert np.abs(found.position_n - calm.position_n).max() < 0.1
    assert "clock_steps" not in solve(log, vehicle, end=30.0).summary


def test_a_broken_off_run_remembers_its_clocks(tmp_path):
    """A snapshot between a step and its confirmation, and one after."""
    write_short_dive(tmp_path)
    vehicle = read_vehicle(tmp_path / "vehicle.toml")
    log = troubled(read_log(tmp_path / "dive"), [ClockJump(sensor="dvl", begin=50.0, step=1.0)], 1)
    whole, file = solve_as_live(log, vehicle), tmp_path / "navigator.npz"
    for moment in (50.3, 70.0):
        solve_as_live(log, vehicle, end=moment, snapshot=file)
        resumed = solve_as_live(log, vehicle, resume=file)
        same = np.searchsorted(whole.time, resumed.time[1:])
        assert np.array_equal(whole.position_n[same], resumed.position_n[1:])
        assert resumed.summary["clock_steps"] == whole.summary["clock_steps"]


def test_the_key_takes_only_yes_and_no():
    text = 'name = "auv"\n[sensors.imu]\npreset = "kvh-1775"\n[sensors.depth]\nsigma_m = 0.1\nmend_clock = "no"\n'
    with pytest.raises(InputError, match="mend_clock"):
        vehicle_from_toml(text)
