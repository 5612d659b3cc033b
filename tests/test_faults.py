"""Faults against what they say of themselves: which rows they befall, by how much, and that all else keeps its bits."""

from __future__ import annotations

from dataclasses import fields, replace
from math import pi, radians

import numpy as np
import pytest
from pyproj import Geod
from scipy.stats import binomtest, kstest

from leadline.data import records
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.solve import solve
from leadline.simulate.dive import simulate
from leadline.simulate.faults import (
    BeamsFailing,
    ClockJump,
    CompassSwinging,
    EmptyRows,
    LateDelivery,
    Loss,
    Outage,
    Repeats,
    WildFixes,
    arrival,
    troubled,
)
from leadline.simulate.instruments import Attitude, Depth, Dvl, Gnss, Heading, Imu, PositionFix
from leadline.simulate.plans import circle
from leadline.simulate.trajectory import Place, Trajectory

PLACE = Place(radians(45.0), radians(10.0), depth=20.0, surface_height=10.0)
JANUS = tuple(np.radians([45.0, 135.0, 225.0, 315.0]))
VEHICLE = """
name = "faulty"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
sigma_mps = 0.01
[sensors.depth]
sigma_m = 0.05
[sensors.heading]
sigma_deg = 0.5
[sensors.usbl]
kind = "position_fix"
sigma_m = 1.0
vertical = false
"""
BEAMS = "use = 'beams'\nbeam_azimuth_deg = [45.0, 135.0, 225.0, 315.0]\nbeam_tilt_deg = 30.0\n"


@pytest.fixture(scope="module")
def path() -> Trajectory:
    return circle(PLACE, 60.0, speed=1.5, radius=60.0)


@pytest.fixture(scope="module")
def log(path: Trajectory) -> Log:
    instruments = {
        "imu": Imu(rate=50.0, gyro_density=3e-6, accel_density=1e-3),
        "dvl": Dvl(rate=5.0, sigma=0.01),
        "depth": Depth(rate=5.0, sigma=0.05),
        "heading": Heading(rate=5.0, sigma=0.008),
        "ahrs": Attitude(rate=5.0, sigma=(0.01, 0.01, 0.01)),
        "usbl": PositionFix(rate=20.0, sigma=1.0, sigma_depth=1.0),
        "local": PositionFix(rate=20.0, sigma=1.0, sigma_depth=1.0, output="local"),
        "gnss": Gnss(rate=20.0, sigma=(1.0, 1.0, 2.0)),
    }
    return simulate(path, instruments, seed=3)


@pytest.fixture(scope="module")
def beams(path: Trajectory) -> Log:
    made = {"imu": Imu(rate=50.0), "dvl": Dvl(rate=5.0, output="beams", azimuths=JANUS, tilt=radians(30.0), beam_sigma=0.01)}
    return simulate(path, made, seed=3)


def content(table: records.Table) -> dict[str, np.ndarray]:
    return {c.name: v for c in table.columns() if (v := getattr(table, c.name)) is not None} | dict(table.extra)


def changed_columns(one: records.Table, other: records.Table) -> set[str]:
    """Names of the columns that differ by a bit, or that one of the tables lacks."""
    a, b = content(one), content(other)
    alike = {k for k in a.keys() & b.keys() if np.array_equal(a[k], b[k], equal_nan=a[k].dtype.kind == "f")}
    return (a.keys() | b.keys()) - alike


def outcomes(solution, sensor: str) -> np.ndarray:
    """Outcome of each row of a sensor, in order of rows; a row of several parts has its smallest."""
    mine = solution.innovations.select(solution.innovations.sensor == sensor)
    found = np.full(mine.row.max() + 1, 99)
    np.minimum.at(found, mine.row, mine.outcome)
    return found


EVERY = {
    "late": LateDelivery(sensor="usbl"),
    "wild": WildFixes(sensor="usbl", fraction=0.3, low=20.0, high=50.0),
    "outage": Outage(sensor="dvl", begin=10.0, end=20.0),
    "empty": EmptyRows(sensor="depth", fraction=0.3),
    "loss": Loss(sensor="dvl", fraction=0.3),
    "repeats": Repeats(sensor="dvl", fraction=0.3),
    "swing": CompassSwinging(sensor="heading", begin=10.0, end=20.0, amplitude=0.5, period=10.0),
    "jump": ClockJump(sensor="dvl", begin=10.0, step=-1.0),
}


@pytest.mark.parametrize("fault", EVERY.values(), ids=EVERY.keys())
def test_a_fault_is_a_value(log, fault):
    """The same seed makes the same log, another one another where the fault draws; the caller's log and all other tables are untouched."""
    before = {name: {k: v.copy() for k, v in content(table).items()} for name, table in log.tables.items()}
    one, again, other = (troubled(log, [fault], seed) for seed in (1, 1, 2))
    assert changed_columns(one[fault.sensor], log[fault.sensor])
    assert not changed_columns(one[fault.sensor], again[fault.sensor])
    draws = isinstance(fault, LateDelivery | WildFixes | EmptyRows | Loss | Repeats)
    assert bool(changed_columns(one[fault.sensor], other[fault.sensor])) == draws
    for name, table in log.tables.items():
        assert all(np.array_equal(before[name][k], v, equal_nan=v.dtype.kind == "f") for k, v in content(table).items())
        assert name == fault.sensor or one[name] is table
    assert all(getattr(one, f.name) is getattr(log, f.name) for f in fields(Log) if f.name != "tables")


def test_faults_are_drawn_alike_whatever_else_befalls_a_log(log):
    """The wild fixes of a seed are the same beside another fault; two faults of a kind do not befall the same rows."""
    wild = EVERY["wild"]
    alone, beside = troubled(log, [wild], 5), troubled(log, [EVERY["empty"], wild, EVERY["late"]], 5)
    assert changed_columns(alone["usbl"], beside["usbl"]) == {"received"}
    twice = troubled(log, [wild, wild], 5)["usbl"].extra["outlier"]
    once = alone["usbl"].extra["outlier"]
    assert np.all(twice >= once)
    assert twice.sum() > 1.3 * once.sum()


def test_late_rows_arrive_as_late_as_they_are_told(log):
    late = troubled(log, [LateDelivery(sensor="usbl", begin=10.0)], 1)["usbl"]
    assert changed_columns(late, log["usbl"]) == {"received"}
    delay, inside = late.received - late.time, late.time >= 10.0
    assert np.all(delay[~inside] == 0.0)
    assert kstest(delay[inside], "uniform", args=(2.0, 6.0)).pvalue > 0.001
    alike = troubled(log, [LateDelivery(sensor="usbl", low=3.0, high=3.0)], 1)["usbl"]
    assert np.allclose(alike.received - alike.time, 3.0)


@pytest.mark.parametrize("sensor", ["usbl", "local", "gnss"])
def test_wild_fixes_are_off_by_what_is_stated_and_marked(log, sensor):
    found = troubled(log, [WildFixes(sensor=sensor, fraction=0.1, low=20.0, high=60.0)], 1)[sensor]
    wild = found.extra["outlier"] > 0
    assert binomtest(int(wild.sum()), len(wild), 0.1).pvalue > 0.001
    if sensor == "local":
        east, north = found.east - log[sensor].east, found.north - log[sensor].north
        bearing, distance = np.degrees(np.arctan2(east, north)), np.hypot(north, east)
    else:
        bearing, _, distance = Geod(ellps="WGS84").inv(
            *np.degrees([log[sensor].longitude, log[sensor].latitude, found.longitude, found.latitude])
        )
    assert np.all(distance[~wild] == 0.0)
    assert kstest(distance[wild], "uniform", args=(20.0, 40.0)).pvalue > 0.001
    assert kstest(bearing[wild], "uniform", args=(-180.0, 360.0)).pvalue > 0.001
    assert changed_columns(found, log[sensor]) == {"outlier", *(("north", "east") if sensor == "local" else ("latitude", "longitude"))}


def test_outage_empties_rows_or_takes_them_away(log):
    inside = (log["dvl"].time >= 10.0) & (log["dvl"].time < 20.0)
    silent = troubled(log, [Outage(sensor="dvl", begin=10.0, end=20.0)], 1)["dvl"]
    assert np.array_equal(silent.valid == 0.0, inside)
    assert np.array_equal(np.isnan(silent.velocity).all(axis=1), inside)
    assert not changed_columns(silent.select(~inside), log["dvl"].select(~inside))
    gone = troubled(log, [Outage(sensor="dvl", begin=10.0, end=20.0, rows="absent")], 1)["dvl"]
    assert not changed_columns(gone, log["dvl"].select(~inside))
    dead = troubled(log, [Outage(sensor="imu", begin=30.0, rows="absent")], 1)["imu"]
    assert not changed_columns(dead, log["imu"].select(log["imu"].time < 30.0))
    assert dead.sample == log["imu"].sample


def test_empty_rows_say_nothing_of_it(log):
    found = troubled(log, [EmptyRows(sensor="usbl", fraction=0.2, begin=10.0)], 1)["usbl"]
    empty = np.isnan(found.latitude)
    assert binomtest(int(empty.sum()), int(np.sum(found.time >= 10.0)), 0.2).pvalue > 0.001
    assert not empty[found.time < 10.0].any()
    for name in ("longitude", "depth"):
        assert np.array_equal(np.isnan(getattr(found, name)), empty)
    assert np.array_equal(np.isnan(found.sigma_axes).all(axis=1), empty)
    assert found.valid is None
    assert np.array_equal(found.time, log["usbl"].time)


def test_loss_and_repeats_leave_the_other_rows_alone(log):
    lost = troubled(log, [Loss(sensor="usbl", fraction=0.25)], 1)["usbl"]
    assert binomtest(len(log["usbl"]) - len(lost), len(log["usbl"]), 0.25).pvalue > 0.001
    assert not changed_columns(lost, log["usbl"].select(np.isin(log["usbl"].time, lost.time)))
    twice = troubled(log, [Repeats(sensor="usbl", fraction=0.25)], 1)["usbl"]
    assert binomtest(len(twice) - len(log["usbl"]), len(log["usbl"]), 0.25).pvalue > 0.001
    first = np.unique(twice.time, return_index=True)[1]
    assert not changed_columns(twice.select(first), log["usbl"])
    again = np.flatnonzero(np.diff(twice.time) == 0)
    assert not changed_columns(twice.select(again), twice.select(again + 1))


def test_beams_fail_one_by_one(beams):
    times = (10.0, 20.0, 30.0, 40.0)
    found = troubled(beams, [BeamsFailing(sensor="dvl", times=times)], 1)["dvl"]
    for k, end in enumerate(times):
        dead = found.time >= end
        assert np.array_equal(np.isnan(found.beam[:, k]), dead)
        assert np.array_equal(found.beam_valid[:, k] == 0.0, dead)
        assert np.array_equal(found.beam[~dead, k], beams["dvl"].beam[~dead, k])
    assert np.array_equal(found.valid == 0.0, found.time >= 40.0)


@pytest.mark.parametrize("sensor", ["heading", "ahrs"])
def test_compass_swings_in_its_time_alone(log, sensor):
    found = troubled(log, [CompassSwinging(sensor=sensor, begin=12.0, end=42.0, amplitude=radians(30.0), period=20.0)], 1)[sensor]
    off = (found.heading - log[sensor].heading + pi) % (2 * pi) - pi
    inside = (found.time >= 12.0) & (found.time < 42.0)
    assert changed_columns(found, log[sensor]) == {"heading"}
    assert np.all(off[~inside] == 0.0)
    assert off[inside] == pytest.approx(radians(30.0) * np.sin(2 * pi * (found.time[inside] - 12.0) / 20.0), abs=1e-12)
    assert np.abs(off).max() == pytest.approx(radians(30.0), abs=1e-6)
    assert np.all((found.heading >= 0.0) & (found.heading < 2 * pi))


@pytest.mark.parametrize("step", [-1.0, 1.0])
@pytest.mark.parametrize("end", [30.0, np.inf])
def test_clock_jump_moves_stamps_and_nothing_else(log, step, end):
    device = replace(log["dvl"], device_time=log["dvl"].time + 100.0)
    found = ClockJump(sensor="dvl", begin=10.0, end=end, step=step).changed(device, np.random.default_rng(0))
    assert changed_columns(found, device) == {"time", "device_time", "received", "sequence"}
    true = log["dvl"].time
    off = np.where((true >= 10.0) & (true < end), step, 0.0)
    assert np.array_equal(found.time, true + off)
    assert found.device_time - found.time == pytest.approx(100.0)
    assert np.array_equal(found.received, true)
    assert np.array_equal(found.sequence, np.arange(len(found)))
    back = np.flatnonzero(np.diff(found.time) < 0)
    assert list(true[back + 1]) == [t for t, backward in ((10.0, step < 0), (30.0, step > 0 and end == 30.0)) if backward]


def test_arrival_is_received_where_it_is_known():
    table = records.Depth(time=[1.0, 2.0], received=[1.5, np.nan], depth=[0.0, 0.0])
    assert list(arrival(table)) == [1.5, 2.0]


# What the navigator makes of them: the outcome of each row.
def test_navigator_sees_each_fault_for_what_it_is(log):
    vehicle = vehicle_from_toml(VEHICLE)
    known = log.without("ahrs", "local", "gnss")
    faults = [
        Outage(sensor="dvl", begin=10.0, end=20.0),
        EmptyRows(sensor="depth", fraction=0.3),
        Repeats(sensor="heading", fraction=0.3),
        WildFixes(sensor="usbl", fraction=0.1, low=50.0, high=90.0),
    ]
    found = troubled(known, faults, 1)
    solution = solve(found, vehicle)
    for sensor, rows, outcome in (
        ("dvl", found["dvl"].valid == 0.0, Outcome.INVALID),
        ("depth", np.isnan(found["depth"].depth), Outcome.INVALID),
        ("heading", np.diff(found["heading"].time, prepend=-1.0) == 0.0, Outcome.DUPLICATE),
        ("usbl", found["usbl"].extra["outlier"] > 0, Outcome.GATED),
    ):
        got = outcomes(solution, sensor)
        assert np.all(got[rows] == outcome), sensor
        assert np.mean(got[~rows] == Outcome.USED) > 0.95, sensor


def test_navigator_sees_a_clock_that_steps(log):
    """Four rows after each step, as arrivals show it; where that only tells, the rows that step back."""
    vehicle, known = vehicle_from_toml(VEHICLE), log.without("ahrs", "local", "gnss")
    left = replace(vehicle, sensors={**vehicle.sensors, "dvl": replace(vehicle["dvl"], mend_clock=False)})
    back, ahead = ClockJump(sensor="dvl", begin=10.0, step=-1.0), ClockJump(sensor="dvl", begin=10.0, end=30.0, step=1.0)

    def jumped(fault, aboard):
        return np.flatnonzero(outcomes(solve(troubled(known, [fault], 1), aboard), "dvl") == Outcome.CLOCK_JUMP).tolist()

    assert jumped(back, vehicle) == [50, 51, 52, 53]
    assert jumped(ahead, vehicle) == [50, 51, 52, 53, 150, 151, 152, 153]
    stepped = jumped(back, left)
    assert stepped == list(range(50, 50 + len(stepped)))
    assert jumped(ahead, left)[0] == 150  # when it is set right


def test_late_rows_cost_nothing_within_the_window_and_are_late_beyond_it(log):
    vehicle, known = vehicle_from_toml(VEHICLE), log.without("ahrs", "local", "gnss")
    sparse = replace(known, tables={**known.tables, "usbl": known["usbl"].select(slice(0, None, 200))})  # so that none overtakes
    late = troubled(sparse, [LateDelivery(sensor="usbl")], 1)
    times = np.arange(0.0, 50.0, 5.0)
    whole, live = solve(sparse, vehicle, times=times), solve_as_live(late, vehicle, times=times)
    assert np.all(outcomes(live, "usbl") == Outcome.USED)
    assert np.abs(whole.position_n - live.position_n).max() < 1e-7
    hasty = solve_as_live(late, vehicle, times=times, window=1.0)
    assert np.all(outcomes(hasty, "usbl")[:-1] == Outcome.LATE)  # after the last one nothing more is valid


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Outage(sensor="dvl", begin=2.0, end=1.0), "lasts from"),
        (lambda: Loss(sensor="dvl", fraction=1.5), "fraction from 0 to 1"),
        (lambda: Outage(sensor="dvl", rows="gone"), "invalid or absent"),
        (lambda: Outage(sensor="sonar"), "no table 'sonar'"),
        (lambda: LateDelivery(sensor="dvl", low=3.0, high=2.0), "low <= high"),
        (lambda: WildFixes(sensor="dvl", fraction=0.1, low=1.0, high=2.0), "kind position_fix or gnss"),
        (lambda: BeamsFailing(sensor="dvl", times=(1.0,)), "beams alone"),
        (lambda: CompassSwinging(sensor="dvl", begin=0.0, amplitude=0.1, period=1.0), "sensor with headings"),
        (lambda: CompassSwinging(sensor="heading", amplitude=0.1, period=1.0), "give begin"),
        (lambda: ClockJump(sensor="dvl", step=np.nan), "finite step"),
    ],
)
def test_what_cannot_be_is_refused(log, make, message):
    with pytest.raises(InputError, match=message):
        troubled(log, [make()], 1)


def test_as_many_times_as_beams(beams):
    with pytest.raises(InputError, match="one for each of 4 beams"):
        troubled(beams, [BeamsFailing(sensor="dvl", times=(1.0,))], 1)


def test_beams_that_fail_are_left_out_of_the_solution(beams):
    vehicle = vehicle_from_toml(VEHICLE.replace("[sensors.dvl]\n", "[sensors.dvl]\n" + BEAMS)).only("imu", "dvl")
    solution = solve(troubled(beams, [BeamsFailing(sensor="dvl", times=(10.0, 20.0, 30.0, 40.0))], 1), vehicle)
    used = solution.innovations.select((solution.innovations.sensor == "dvl") & (solution.innovations.outcome == Outcome.USED))
    alive = np.bincount(used.row, minlength=len(beams["dvl"]))
    expected = np.sum(beams["dvl"].time[:, None] < [10.0, 20.0, 30.0, 40.0], axis=1)
    assert np.mean(alive == expected) > 0.98
    assert np.all(alive <= expected)
