"""What times of arrival tell: late rows that were used, and clocks that stepped, on logs in which that was done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from short_dive import write_short_dive
from solutions import EPOCH, straight

from leadline import read_log, write_log
from leadline.assess.arrivals import arrivals
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


def test_steps_are_told_as_the_run_found_them():
    steps = [{"sensor": "depth", "arrival_s": moment, "step_s": 1.0, "mended": True} for moment in (100.0, 200.0)]

    def of(*told):
        return list(arrivals(replace(run(), summary={**run().summary, "clock_steps": [*told]}), log_of(TIME, TIME)))

    assert [(h.kind, h.start, h.count) for h in of(*steps)] == [("clock_step", 100.0, 1), ("clock_step", 200.0, 1)]
    assert of(*steps)[0].sentence == "depth: its clock stepped by +1.00 s at 100.0 s; the stamps after it were put right."
    (found,) = of({**steps[0], "mended": False})
    assert "left as they are" in found.sentence
    assert of({**steps[0], "sensor": "dvl"}, {**steps[0], "arrival_s": -5.0}, {**steps[0], "arrival_s": 700.0}) == []
    (found,) = of(*({**steps[0], "arrival_s": 100.0 * k, "step_s": 0.5 * k} for k in range(1, 6)))
    assert (found.count, found.start, found.end) == (5, 100.0, 500.0)
    assert "stepped 5 times" in found.sentence
    assert "+2.50 s at most" in found.sentence


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
