"""What happened: each event that is put into a dive is named, with its sensor, its span and its count, and nothing else is."""

from __future__ import annotations

import json
from dataclasses import replace
from math import radians
from time import perf_counter

import numpy as np
import pytest
from solutions import group_rows, innovations, lost_rows, straight, survey

from leadline import read_vehicle, solve
from leadline.assess.assessment import assess
from leadline.assess.happenings import happenings
from leadline.assess.streams import coded, stretches
from leadline.data.outcome import Outcome
from leadline.data.solution import Status
from leadline.missions.dive import solve_dive
from leadline.report.html import report_page
from leadline.report.tables import happening_lines
from leadline.report.text import assessment_text

TIME = np.arange(0.0, 1000.5, 0.5)


def quiet(time, *, sensor="dvl", components=("x",)):
    """Rows with residuals far inside the gate: nothing happens."""
    return group_rows(sensor, time, np.zeros((len(time), len(components))), np.full(len(components), 0.1), list(components), gate=0.999)


def gated(part, *chosen):
    """The same with rows outside the gate."""
    outcome = part.outcome.copy()
    outcome[np.isin(part.row, np.concatenate([np.atleast_1d(c) for c in chosen]))] = Outcome.GATED
    return replace(part, outcome=outcome)


def told(*parts, **more):
    time = np.arange(0.0, 1001.0, 1.0)
    table = innovations(list(parts))
    order = np.argsort(table.time, kind="stable")  # as a solution has them
    return happenings(straight(time, table=table.select(order), **more))


def only(found, kind, sensor, start, end, count):
    assert [(h.kind, h.sensor, h.count) for h in found] == [(kind, sensor, count)], found
    (happening,) = found
    assert (happening.start, happening.end) == pytest.approx((start, end))
    assert sensor in happening.sentence
    return happening.sentence


def test_of_a_quiet_dive_nothing_is_told():
    assert told(quiet(TIME), quiet(TIME[::4], sensor="depth"), quiet(TIME[::20], sensor="usbl", components=("north", "east"))) == ()


def test_a_dive_without_rows_or_states():
    assert told() == ()
    assert happenings(straight(np.arange(0.0, 10.0)).select(slice(0, 0))) == ()


@pytest.mark.parametrize(("first", "last"), [(200.0, 800.0), (0.0, 300.0), (700.0, 1000.0)])
def test_a_silence_is_told_at_start_middle_and_end(first, last):
    seen = TIME[(first >= TIME) & (first > 0.0) | (last <= TIME) & (last < 1000.0)]
    only(told(quiet(seen)), "silent", "dvl", first, last, 0)


def test_jitter_and_a_missing_row_are_no_silence():
    rng = np.random.default_rng(4)
    assert told(quiet(np.delete(TIME + rng.uniform(-0.1, 0.1, len(TIME)), [50, 51, 400]).clip(0.0, 1000.0))) == ()


def test_many_silences_are_one_sentence():
    sentence = only(told(quiet(TIME[TIME % 100.0 < 60.0])), "silent", "dvl", 59.5, 1000.0, 0)
    assert "10 times" in sentence
    assert "405 s in all, at most 40.5 s (from 59.5 s to 100.0 s)" in sentence


def test_a_run_of_gated_rows():
    rows = np.delete(np.arange(400, 640), [30, 90, 150])  # now and then one passes
    sentence = only(told(gated(quiet(TIME), rows)), "gated", "dvl", 200.0, 319.5, 237)
    assert "237 of 240 rows" in sentence


def test_many_runs_are_one_sentence_of_the_rows_between():
    rows = np.concatenate([np.arange(k, k + 20) for k in (400, 500, 600, 700)])
    sentence = only(told(gated(quiet(TIME), rows)), "gated", "dvl", 200.0, 359.5, 80)
    assert "80 of 320 rows" in sentence
    assert "in 4 runs, the longest of 20 rows" in sentence


def test_scattered_outliers_are_one_sentence_with_their_share():
    rng = np.random.default_rng(5)
    rows = np.sort(rng.choice(len(TIME), 200, replace=False))
    sentence = only(told(gated(quiet(TIME), rows)), "outliers", "dvl", TIME[rows[0]], TIME[rows[-1]], 200)
    assert "200 of 2,001 rows" in sentence
    assert "10 %" in sentence


def test_outliers_as_many_as_the_gate_makes_are_not_told():
    """Of 2001 rows at 99.9 % two are to be expected; six come by chance in 1.7 % of dives, seven in 0.5 %."""
    from scipy.stats import poisson

    assert poisson.sf(5, 2.001) > 0.01 > poisson.sf(6, 2.001)
    assert told(gated(quiet(TIME), np.arange(100, 1300, 200))) == ()
    assert [h.kind for h in told(gated(quiet(TIME), np.arange(100, 1500, 200)))] == ["outliers"]


def test_one_wild_fix_among_few_is_told():
    """One of 51 rows is what the gate makes in 5 % of dives, but none is 30 sigma off."""
    time = TIME[::40]
    wild = group_rows("usbl", time, np.zeros((len(time), 2)), np.array([2.0, 2.0]), ["north", "east"], outliers=(7,))
    sentence = only(told(wild), "outliers", "usbl", 140.0, 140.0, 1)
    assert "a row outside the gate at 140.0 s" in sentence
    assert told(gated(quiet(time, sensor="usbl", components=("north", "east")), 7)) == ()


@pytest.mark.parametrize(
    ("outcome", "word"),
    [
        (Outcome.INVALID, "invalid"),
        (Outcome.OUT_OF_RANGE, "out of range"),
        (Outcome.CLOCK_JUMP, "clock jump"),
        (Outcome.LATE, "too late"),
        (Outcome.DUPLICATE, "equal to another row"),
        (Outcome.HELD, "held"),
        (Outcome.DECIMATED, "sooner"),
        (Outcome.OVERRULED, "overruled by the smoother"),
        (Outcome.NO_CLONE, "earlier epoch"),
    ],
)
def test_rows_that_were_not_used_are_told_by_their_outcome(outcome, word):
    out = (TIME >= 300.0) & (TIME < 330.0)
    sentence = only(told(quiet(TIME[~out]), lost_rows("dvl", TIME[out], outcome)), outcome.name.lower(), "dvl", 300.0, 329.5, 60)
    assert word in sentence
    assert "60 of" in sentence


def test_many_invalid_stretches_are_one_sentence():
    out = (TIME % 100.0 < 5.0) | (TIME > 900.0) & (TIME < 950.0)
    (happening,) = told(quiet(TIME[~out]), lost_rows("dvl", TIME[out], Outcome.INVALID))
    assert happening.kind == "invalid"
    assert happening.count == out.sum()
    assert "in 11 stretches, the longest of 100 rows from 900.0 s to 949.5 s" in happening.sentence


def test_rows_without_a_time_are_told():
    time = np.full(3, np.nan)
    (happening,) = told(quiet(TIME), lost_rows("dvl", time, Outcome.INVALID))
    assert "3 rows without a time" in happening.sentence
    assert np.isfinite([happening.start, happening.end]).all()


def beams(*silent, gate=()):
    """Four beams of one sensor; `silent` are (beam, from, to)."""
    parts = []
    for k in range(1, 5):
        keep = np.ones(len(TIME), bool)
        for beam, first, last in silent:
            keep &= ~((beam == k) & (first < TIME) & (last > TIME))
        part = quiet(TIME, components=(f"beam{k}",))
        part = gated(part, gate) if len(gate) and k == 2 else part
        parts.append(part.select(keep))
    return parts


def test_a_beam_that_fails_is_an_event_of_its_own():
    sentence = only(told(*beams((3, 400.0, 700.0))), "beam_silent", "dvl", 400.0, 700.0, 599)
    assert "beam3" in sentence


def test_beams_fail_one_by_one_and_one_never_speaks():
    found = told(*beams((1, 200.0, 2000.0), (2, 500.0, 2000.0), (3, -1.0, 2000.0)))
    assert [(h.kind, h.start, h.end) for h in found] == [
        ("beam_silent", 0.0, 1000.0),
        ("beam_silent", 200.0, 1000.0),
        ("beam_silent", 500.0, 1000.0),
    ]
    assert ["beam3" in found[0].sentence, "beam1" in found[1].sentence, "beam2" in found[2].sentence] == [True] * 3


def test_all_beams_silent_are_a_silence_of_the_sensor():
    found = told(*beams(*((k, 400.0, 700.0) for k in range(1, 5))))
    only(found, "silent", "dvl", 400.0, 700.0, 0)


def test_a_beam_outside_the_gate_is_named():
    assert "beam2" in only(told(*beams(gate=np.arange(100, 200))), "gated", "dvl", 50.0, 99.5, 100)


def test_a_sensor_that_stands_by_and_takes_over():
    spare = quiet(TIME, sensor="spare")
    outcome = np.where((TIME > 300.0) & (TIME <= 500.0), Outcome.USED, Outcome.STANDBY)
    only(told(replace(spare, outcome=outcome)), "standby", "spare", 300.5, 500.0, 400)
    assert told(replace(spare, outcome=np.full(len(TIME), Outcome.STANDBY))) == ()


def test_the_inertial_unit_is_told_by_the_summary():
    spans = [
        {"kind": "gap", "sensor": "imu", "start_s": 100.0, "end_s": 102.0},
        {"kind": "standby", "sensor": "imu_b", "start_s": 400.0, "end_s": 500.0},
    ]
    spare = lost_rows("imu_b", TIME[(TIME < 400.0) | (TIME > 500.0)], Outcome.STANDBY)  # its rows that were used are not told of
    found = told(spare, summary={"inertial": spans})
    assert [(h.kind, h.sensor, h.start, h.end) for h in found] == [
        ("inertial_gap", "imu", 100.0, 102.0),
        ("inertial_standby", "imu_b", 400.0, 500.0),
    ]
    assert "no inertial data from 100.0 s to 102.0 s" in found[0].sentence


def test_bad_rows_of_an_inertial_unit_stay_apart():
    """Its good rows are not among the innovations: two bad rows far apart are two events, of all the rows that the summary counts."""
    rows = np.array([1000, 1001, 1002, 90_000])
    part = replace(lost_rows("imu", rows / 100.0, Outcome.INVALID), row=rows)
    found = told(part, summary={"counts": {"imu": {"used": 99_997, "invalid": 4}}})
    assert [(h.start, h.end, h.count) for h in found] == [(10.0, 10.02, 3), (900.0, 900.0, 1)]
    assert "3 of 3 rows" in found[0].sentence


def test_reanchoring_and_widened_gates():
    part = gated(quiet(TIME), np.arange(400, 440))
    outcome, widened = part.outcome.copy(), part.widened.copy()
    outcome[440], widened[440] = Outcome.REANCHORED, True
    widened[700:720] = True
    found = told(replace(part, outcome=outcome, widened=widened))
    assert [(h.kind, h.start, h.count) for h in found] == [("gated", 200.0, 40), ("reanchored", 220.0, 1), ("widened", 350.0, 20)]


def test_student_has_no_gate_that_could_widen():
    part = quiet(TIME)
    widened = np.ones(len(TIME), bool)
    assert [h.kind for h in told(replace(part, widened=widened))] == ["widened"]
    assert not told(replace(part, widened=widened, gate_probability=np.ones(len(TIME))))


def test_status():
    time = np.arange(0.0, 1001.0)
    status = np.select([time < 60, (time >= 300) & (time < 400), time >= 900], [Status.ALIGNING, Status.DEAD_RECKONING, Status.LOST], 1)
    found = told(quiet(TIME), status=status)
    assert [(h.kind, h.start, h.end, h.count) for h in found] == [
        ("aligning", 0.0, 60.0, 60),
        ("dead_reckoning", 300.0, 400.0, 100),
        ("lost", 900.0, 1000.0, 101),
    ]


def test_what_nobody_looked_at_is_not_told():
    for outcome in (Outcome.NOT_CONFIGURED, Outcome.NO_MODEL, Outcome.EXCLUDED):
        assert told(lost_rows("modem", TIME[::7], outcome)) == ()


def test_a_row_of_several_parts_counts_once():
    both = [
        gated(quiet(TIME, sensor="gnss", components=("north", "east")), np.arange(100, 150)),
        quiet(TIME, sensor="gnss", components=("vn",)),
    ]
    only(told(*both), "gated", "gnss", 50.0, 74.5, 50)


def test_the_order_of_rows_in_a_table_says_nothing():
    part = gated(quiet(TIME), np.arange(400, 640))
    shuffled = np.random.default_rng(3).permutation(len(TIME))
    assert told(replace(part, row=shuffled[part.row], group=shuffled[part.group])) == told(part)


def test_stretches_against_a_loop():
    rng = np.random.default_rng(1)
    for apart in (0, 1, 3):
        holds = rng.random(500) < 0.4
        found = [(s.start, s.end, s.count, s.among) for s in stretches(np.arange(500.0), holds, apart=apart)]
        right: list[tuple[float, float, int, int]] = []
        for k in np.flatnonzero(holds):
            if right and k - right[-1][1] <= apart + 1:
                start, _, count, _ = right[-1]
                right[-1] = (start, float(k), count + 1, int(k - start) + 1)
            else:
                right.append((float(k), float(k), 1, 1))
        assert found == right


def test_words_are_numbered():
    names, code = coded(np.array(["b", "", "b", "a"]))
    assert (names, code.tolist()) == (["b", "", "a"], [0, 1, 0, 2])
    assert coded(np.zeros(0, "<U1"))[0] == []


def test_a_day_of_rows_takes_seconds():
    time = np.arange(0.0, 86_400.0, 0.1)
    parts = [
        quiet(time, sensor="depth"),
        quiet(time[::2], components=("x", "y", "z")),
        gated(quiet(time, sensor="heading"), np.arange(0, 864_000, 10)),
    ]
    table = innovations(parts)
    estimate = straight(np.arange(0.0, 86_400.0, 10.0), table=table.select(np.argsort(table.time, kind="stable")))
    begin = perf_counter()
    found = happenings(estimate)
    assert perf_counter() - begin < 20.0
    assert [(h.kind, h.sensor) for h in found] == [("outliers", "heading")]


# A real run, and where the sentences stand


@pytest.fixture(scope="module")
def troubled(tmp_path_factory):
    """The short dive of the pages with trouble put into its tables."""
    from short_dive import write_short_dive

    from leadline import read_log, write_log

    place = tmp_path_factory.mktemp("troubled")
    write_short_dive(place)
    log = read_log(place / "dive")
    tables = dict(log.tables)
    dvl, depth, heading, imu = (tables[name] for name in ("dvl", "depth", "heading", "imu"))
    velocity = np.array(dvl.velocity)
    velocity[(dvl.time >= 60.0) & (dvl.time < 75.0)] = np.nan
    tables["dvl"] = replace(dvl, velocity=velocity)
    tables["depth"] = depth.select((depth.time < 40.0) | (depth.time > 52.0))
    swung = np.where((heading.time >= 85.0) & (heading.time < 100.0), radians(30.0), 0.0)
    tables["heading"] = replace(heading, heading=heading.heading + swung)
    tables["imu"] = imu.select((imu.time < 105.0) | (imu.time > 107.0))
    write_log(replace(log, tables=tables, path=None), place / "troubled")
    return place


def test_the_summary_of_a_real_run_names_each_event(troubled):
    solution, assessment = solve_dive(troubled / "troubled", troubled / "vehicle.toml", troubled / "solution")
    summary = json.loads((troubled / "solution" / "summary.json").read_text())
    found = {(h["kind"], h["sensor"]): h for h in summary["happenings"]}
    expected = {
        ("invalid", "dvl"): (60.0, 75.0),
        ("silent", "depth"): (40.0, 52.0),
        ("gated", "heading"): (85.0, 100.0),
        ("inertial_gap", "imu"): (105.0, 107.0),
    }
    for key, (start, end) in expected.items():
        assert key in found, summary["happenings"]
        assert found[key]["start"] == pytest.approx(start, abs=1.1)
        assert found[key]["end"] == pytest.approx(end, abs=1.1)
    page = (troubled / "solution" / "report.html").read_text()
    assert found["silent", "depth"]["sentence"] in page
    assert tuple(solution.summary["happenings"][0].values()) == tuple(vars(assessment.happenings[0]).values())


def test_the_same_dive_without_trouble_tells_none_of_it(troubled):
    from leadline import read_log

    solution = solve(read_log(troubled / "dive"), read_vehicle(troubled / "vehicle.toml"))
    kinds = {(h.kind, h.sensor) for h in happenings(solution)}
    assert not kinds & {("invalid", "dvl"), ("silent", "depth"), ("gated", "heading"), ("inertial_gap", "imu")}


def test_reports_tell_it():
    from rich.console import Console

    estimate, _ = survey()
    assessment = assess(estimate)
    console = Console(width=200, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(assessment_text(assessment))
    text = console.export_text()
    page = report_page(estimate, assessment=assessment)
    for happening in assessment.happenings:
        assert happening.sentence in text
        assert happening.sentence in page
    assert assessment.to_dict()["happenings"][0]["kind"] == assessment.happenings[0].kind


def test_a_long_list_is_capped_with_a_count():
    found = told(*(gated(quiet(TIME, sensor=f"s{k:02d}"), np.arange(100, 200)) for k in range(20)))
    lines = happening_lines(found, 15)
    assert len(lines) == 16
    assert "5 more" in lines[-1]
    assert happening_lines(found, 20)[-1] == found[-1].sentence
