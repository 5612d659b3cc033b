"""What times of arrival tell: late rows that were used, and clocks that stepped, on logs in which that was done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_dive import write_short_dive
from solutions import EPOCH, straight

from leadline import read_log, write_log
from leadline.assess.arrivals import arrivals, clock_steps
from leadline.data.log import Log
from leadline.data.records import Depth
from leadline.missions.dive import solve_dive
from leadline.simulate.faults import ClockJump, LateDelivery, troubled

TIME = np.arange(0.0, 600.0, 5.0)


def log_of(time, received=None):
    return Log(name="dive", epoch=EPOCH, tables={"depth": Depth(time=time, depth=20.0 + 0.001 * time, received=received)})


def run(outcome="used"):
    return straight(np.arange(0.0, 600.0), summary={"counts": {"depth": {outcome: 10}}})


@pytest.fixture(params=[0.2, 5.0])
def time(request):
    return np.arange(0.0, 600.0, request.param)


def test_rows_on_time_tell_nothing(time):
    assert arrivals(run(), log_of(time)) == ()
    assert arrivals(run(), log_of(time, time + np.random.default_rng(1).uniform(0.01, 0.05, len(time)))) == ()
    assert arrivals(straight(np.zeros(0)), log_of(time, time + 5.0)) == ()


def test_late_rows_are_told_with_their_span_and_delay():
    late = troubled(log_of(TIME), [LateDelivery(sensor="depth", begin=100.0, end=300.0)], 1)
    (found,) = arrivals(run(), late)
    assert (found.kind, found.sensor, found.start, found.end, found.count) == ("delayed", "depth", 100.0, 295.0, 40)
    delay = np.max(late["depth"].received - late["depth"].time)
    assert "40 of 120 rows arrived more than 2 s after they were valid" in found.sentence
    assert f"at most {delay:.1f} s" in found.sentence


@pytest.mark.parametrize("step", [-1.0, 1.0, 0.5])
def test_a_clock_that_steps_and_is_set_right(time, step):
    jumped = troubled(log_of(time), [ClockJump(sensor="depth", begin=200.0, end=400.0, step=step)], 1)
    found = [h for h in arrivals(run(), jumped) if h.kind == "clock_step"]
    assert [h.start for h in found] == pytest.approx([200.0, 400.0])
    assert f"stepped by {step:+.2f} s at 200.0 s" in found[0].sentence
    assert f"stepped by {-step:+.2f} s at 400.0 s" in found[1].sentence


def test_a_clock_that_nobody_sets_right(time):
    jumped = troubled(log_of(time), [ClockJump(sensor="depth", begin=200.0, step=1.0)], 1)
    assert [(h.kind, h.start) for h in arrivals(run(), jumped)] == [("clock_step", pytest.approx(200.0))]


@pytest.mark.parametrize("begin", [0.0, 200.0])
def test_delays_that_vary_are_no_step(begin):
    told = 0
    for seed in range(200):
        delay = np.where(begin <= TIME, np.random.default_rng(seed).uniform(2.0, 8.0, len(TIME)), 0.0)
        order = np.argsort(TIME + delay)
        told += len(clock_steps(TIME[order], (TIME + delay)[order]))
    assert told <= 1  # of two hundred dives


def test_rows_held_up_in_a_buffer_are_no_step(time):
    received = time.copy()
    held = (time >= 200.0) & (time < 230.0)
    received[held] = 230.0 + 1e-3 * np.arange(held.sum())
    received = np.maximum.accumulate(received)
    assert clock_steps(time, received) == []


def test_missing_rows_and_one_wild_stamp_are_no_step():
    kept = np.r_[0:40, 60:120]
    assert clock_steps(TIME[kept], TIME[kept]) == []
    wild = TIME.copy()
    wild[50] += 1000.0
    assert clock_steps(wild, TIME) == []


def test_many_steps_are_one_sentence():
    stamps = TIME + np.floor(np.arange(len(TIME)) / 20.0)
    (found,) = [h for h in arrivals(run(), log_of(stamps, TIME)) if h.kind == "clock_step"]
    assert (found.count, found.start, found.end) == (5, TIME[20], TIME[100])
    assert "stepped 5 times" in found.sentence


def test_solving_a_dive_tells_them(tmp_path):
    write_short_dive(tmp_path)
    faults = [LateDelivery(sensor="usbl"), ClockJump(sensor="dvl", begin=60.0, step=1.0)]
    write_log(troubled(read_log(tmp_path / "dive"), faults, 1), tmp_path / "troubled")
    solution, assessment = solve_dive(tmp_path / "troubled", tmp_path / "vehicle.toml", tmp_path / "out", report=False)
    told = [(h["kind"], h["sensor"]) for h in solution.summary["happenings"] if h["kind"] in ("delayed", "clock_step")]
    assert told == [("delayed", "usbl"), ("clock_step", "dvl")]
    assert [h.start for h in assessment.happenings] == sorted(h.start for h in assessment.happenings)
    calm, _ = solve_dive(tmp_path / "dive", tmp_path / "vehicle.toml", tmp_path / "calm", report=False)
    assert not {h["kind"] for h in calm.summary["happenings"]} & {"delayed", "clock_step"}


def test_a_table_that_nobody_looked_at_is_left_out():
    late = log_of(TIME, TIME + 5.0)
    assert arrivals(run("not_configured"), late) == ()
    assert len(arrivals(run(), late)) == 1
    assert arrivals(replace(run(), summary={}), late) == ()
