"""Faults of what is measured against what they say of themselves: by how much each changes what, and that all else keeps its bits."""

from __future__ import annotations

from dataclasses import fields, replace
from math import pi, radians

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import binomtest, kstest

from leadline.data import records
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.simulate.faults import CompassSwinging, troubled
from leadline.simulate.faults_of_echoes import BeamLoss, FalseLock, LateEchoes, WildPings
from leadline.simulate.faults_of_values import (
    AccelBiasJump,
    DepthDrift,
    FixJump,
    GyroBiasJump,
    NoiseBurst,
    ScaleJump,
    StuckValue,
    TideJump,
)

ROWS = 2000
BEGIN, END = 30.0, 70.0
WINDOW = {"begin": BEGIN, "end": END}
JANUS = tuple(np.radians([45.0, 135.0, 225.0, 315.0]))


def made_log() -> Log:
    """A log of random numbers, a table for each kind that can have a fault: 100 s of 20 Hz."""
    generator = np.random.default_rng(8)
    time = np.arange(ROWS) / 20.0

    def random(*shape):
        return generator.uniform(1.0, 2.0, (ROWS, *shape))

    names = np.tile(["a", "b"], ROWS // 2)
    tables = {
        "imu": records.Imu(time=time, accel=random(3), gyro=random(3), temperature=random()),
        "increments": records.Imu(
            time=time, delta_velocity=random(3), delta_angle=random(3), interval=np.full(ROWS, 0.05), sample="increment"
        ),
        "gyro": records.YawRate(time=time, yaw_rate=random()),
        "dvl": records.Dvl(
            time=time, velocity=random(3), beam=random(4), altitude=random(), range=random(4), valid=np.ones(ROWS),
            beam_valid=np.ones((ROWS, 4)), beam_correlation=random(4), error_velocity=random(), sigma=random(3),
        ),
        "beams": records.Dvl(time=time, beam=random(4)),
        "vector": records.Dvl(time=time, velocity=random(3)),
        "speed": records.Speed(time=time, speed=random()),
        "depth": records.Depth(time=time, depth=random()),
        "pressure": records.Pressure(time=time, pressure=1e5 * random(), temperature=random()),
        "altimeter": records.Altimeter(time=time, range=random(), sigma=random()),
        "heading": records.Heading(time=time, heading=3.0 * random()),
        "ahrs": records.Attitude(time=time, roll=random() - 1.5, pitch=random() - 1.5, heading=3.0 * random()),
        "gnss": records.Gnss(time=time, latitude=0.5 * random(), longitude=random(), height=random(), hdop=random()),
        "local": records.PositionFix(time=time, north=random(), east=random(), depth=random()),
        "one_way": records.AcousticRange(
            time=time + 0.5, received=time + 0.6, transmit=time, travel_time=random(), transmitter=names, path=np.full(ROWS, "one_way")
        ),
        "two_way": records.AcousticRange(time=time + 0.5, range=100.0 * random(), turnaround=0.1 * random(), transmitter=names),
        "usbl": records.Usbl(time=time, azimuth=random(), elevation=random() - 1.5, range=100.0 * random(), transmitter=names),
        "other": records.Other(time=time, extra={"value": random()}),
        "truth": records.Truth(
            time=time[::2], roll=0.2 * np.sin(time[::2] / 9), pitch=0.3 * np.cos(time[::2] / 7), heading=(6.0 + 0.1 * time[::2]) % (2 * pi)
        ),
    }  # fmt: skip
    return Log("made", tables)


LOG = made_log()
TIME = LOG["depth"].time
INSIDE = (TIME >= BEGIN) & (TIME < END)


def content(table: records.Table) -> dict[str, np.ndarray]:
    return {c.name: v for c in table.columns() if (v := getattr(table, c.name)) is not None} | dict(table.extra)


def changed_columns(one: records.Table, other: records.Table) -> set[str]:
    a, b = content(one), content(other)
    alike = {k for k in a.keys() & b.keys() if np.array_equal(a[k], b[k], equal_nan=a[k].dtype.kind == "f")}
    return (a.keys() | b.keys()) - alike


def struck(fault, name=None, seed=1):
    return troubled(LOG, [fault], seed)[name or fault.sensor]


ECHO = {"time", "outlier"}
EVERY = {
    "beam_loss": (BeamLoss(sensor="beams", beams=(2,), **WINDOW), {"beam", "beam_valid", "valid"}),
    "false_lock": (FalseLock(sensor="dvl", layer_n=(0.3, 0.1), share=0.5, azimuths=JANUS, tilt=0.5, **WINDOW),
                   {"velocity", "beam", "altitude", "range"}),
    "late_echoes": (LateEchoes(sensor="one_way", fraction=0.5, low=5.0, high=9.0, **WINDOW), ECHO | {"received", "travel_time"}),
    "late_echoes_two": (LateEchoes(sensor="two_way", fraction=0.5, low=5.0, high=9.0, **WINDOW), ECHO | {"range"}),
    "wild_pings": (WildPings(sensor="usbl", fraction=0.5, angle_low=0.2, angle_high=0.4, low=5.0, high=9.0, **WINDOW),
                   ECHO | {"azimuth", "elevation", "range"}),
    "wild_angles": (WildPings(sensor="usbl", fraction=0.5, angle_low=0.2, angle_high=0.4, **WINDOW), {"outlier", "azimuth", "elevation"}),
    "gyro": (GyroBiasJump(sensor="imu", size=0.1, axis=1, **WINDOW), {"gyro"}),
    "gyro_increments": (GyroBiasJump(sensor="increments", size=0.1, **WINDOW), {"delta_angle"}),
    "single_gyro": (GyroBiasJump(sensor="gyro", size=0.1, **WINDOW), {"yaw_rate"}),
    "accel": (AccelBiasJump(sensor="imu", size=0.1, axis=0, **WINDOW), {"accel"}),
    "accel_increments": (AccelBiasJump(sensor="increments", size=0.1, **WINDOW), {"delta_velocity"}),
    "depth_drift": (DepthDrift(sensor="depth", rate=0.1, **WINDOW), {"depth"}),
    "pressure_drift": (DepthDrift(sensor="pressure", rate=0.1, **WINDOW), {"pressure"}),
    "fix_jump": (FixJump(sensor="gnss", jump_n=(10.0, -5.0), **WINDOW), {"latitude", "longitude", "outlier"}),
    "fix_drag": (FixJump(sensor="local", drag_n=(1.0, -0.5), **WINDOW), {"north", "east", "outlier"}),
    "scale": (ScaleJump(sensor="dvl", scale=0.03, **WINDOW), {"velocity", "beam"}),
    "scale_speed": (ScaleJump(sensor="speed", scale=0.03, **WINDOW), {"speed"}),
    "stuck": (StuckValue(sensor="depth", **WINDOW), {"depth"}),
    "stuck_other": (StuckValue(sensor="other", **WINDOW), {"value"}),
    "compass_step": (CompassSwinging(sensor="heading", step=0.2, **WINDOW), {"heading"}),
    "noise_gyro": (NoiseBurst(sensor="imu", sigma=0.1, quantity="rate", **WINDOW), {"gyro"}),
    "noise_depth": (NoiseBurst(sensor="depth", sigma=0.1, quantity="distance", **WINDOW), {"depth"}),
    "noise_dvl": (NoiseBurst(sensor="dvl", sigma=0.1, quantity="speed", **WINDOW), {"velocity", "beam"}),
    "noise_fix": (NoiseBurst(sensor="gnss", sigma=3.0, quantity="distance", **WINDOW), {"latitude", "longitude"}),
    "noise_ahrs": (NoiseBurst(sensor="ahrs", sigma=0.1, quantity="angle", **WINDOW), {"roll", "pitch", "heading"}),
    "noise_range": (NoiseBurst(sensor="two_way", sigma=3.0, quantity="distance", **WINDOW), {"time", "range"}),
}  # fmt: skip
DRAWS = LateEchoes | WildPings | NoiseBurst


@pytest.mark.parametrize(("fault", "columns"), EVERY.values(), ids=EVERY.keys())
def test_a_fault_changes_its_columns_in_its_window_alone(fault, columns):
    """All other columns, rows and tables keep their bits; the caller's log is what it was; a seed makes one log."""
    before = {name: {k: v.copy() for k, v in content(table).items()} for name, table in LOG.tables.items()}
    found, again, other = (troubled(LOG, [fault], seed) for seed in (1, 1, 2))
    table, healthy = found[fault.sensor], LOG[fault.sensor]
    assert changed_columns(table, healthy) == columns
    inside = (healthy.time >= BEGIN) & (healthy.time < END)
    added = {"valid", "beam_valid", "outlier"} - content(healthy).keys()
    assert changed_columns(table.select(~inside), healthy.select(~inside)) <= added
    assert not changed_columns(table, again[fault.sensor])
    assert bool(changed_columns(table, other[fault.sensor])) == isinstance(fault, DRAWS)
    for name, mine in LOG.tables.items():
        assert all(np.array_equal(before[name][k], v, equal_nan=v.dtype.kind == "f") for k, v in content(mine).items())
        assert name == fault.sensor or found[name] is mine
    assert all(getattr(found, f.name) is getattr(LOG, f.name) for f in fields(Log) if f.name != "tables")


@pytest.mark.parametrize("fault", [fault for fault, _ in EVERY.values()], ids=EVERY.keys())
def test_a_fault_of_an_empty_table_is_an_empty_table(fault):
    empty = replace(LOG, tables={**LOG.tables, fault.sensor: LOG[fault.sensor].select(slice(0))})
    assert len(troubled(empty, [fault], 1)[fault.sensor]) == 0


# ---- Doppler logs


def test_dead_beams_are_empty_and_a_velocity_needs_three():
    """With all four there is an error velocity, with three a velocity, with two neither."""
    one, two, all_ = (struck(BeamLoss(sensor="dvl", beams=beams, **WINDOW)) for beams in ((3,), (1, 3), (4, 3, 2, 1)))
    for table, dead in ((one, [2]), (two, [0, 2]), (all_, [0, 1, 2, 3])):
        for name in ("beam", "range", "beam_correlation"):
            gone = np.isnan(getattr(table, name))
            assert gone[INSIDE][:, dead].all()
            assert gone.sum() == INSIDE.sum() * len(dead), name
        assert np.array_equal(table.beam_valid == 0.0, np.isnan(table.beam))
        assert np.array_equal(np.isnan(table.error_velocity), INSIDE)
    assert changed_columns(one, LOG["dvl"]) == {"beam", "range", "beam_correlation", "beam_valid", "error_velocity"}
    for table in (two, all_):
        assert np.array_equal(np.isnan(table.velocity).all(axis=1), INSIDE)
        assert np.array_equal(table.valid == 0.0, INSIDE)


def test_a_log_of_beams_alone_is_valid_while_one_lives():
    three = struck(BeamLoss(sensor="beams", beams=(1, 2, 3), **WINDOW))
    assert np.all(three.valid == 1.0)
    none = struck(BeamLoss(sensor="beams", beams=(1, 2, 3, 4), **WINDOW))
    assert np.array_equal(none.valid == 0.0, INSIDE)


def test_beams_that_fail_together_are_those_of_either_fault():
    both = troubled(LOG, [BeamLoss(sensor="beams", beams=(1,), begin=20.0), BeamLoss(sensor="beams", beams=(3,), begin=40.0)], 1)["beams"]
    assert np.array_equal(np.isnan(both.beam[:, 0]), TIME >= 20.0)
    assert np.array_equal(np.isnan(both.beam[:, 2]), TIME >= 40.0)
    assert not np.isnan(both.beam[:, [1, 3]]).any()


def test_a_false_lock_reports_the_velocity_against_the_layer():
    """Witness: SciPy's rotations and its slerp between rows of truth, R_bs from the same three angles."""
    mounting, tilt, layer = (0.1, -0.2, 0.7), 0.5, (0.4, -0.3)
    fault = FalseLock(
        sensor="dvl", layer_n=layer, scale=0.02, share=0.25, mounting_bs=mounting, azimuths=JANUS, tilt=tilt, begin=BEGIN, end=END
    )
    found, healthy, truth = struck(fault), LOG["dvl"], LOG["truth"]
    between = np.isin(np.round(TIME * 20), np.round(truth.time * 20))
    rotation_nb = Rotation.from_euler("ZYX", np.column_stack([truth.heading, truth.pitch, truth.roll]))
    sensor_b = Rotation.from_euler("ZYX", mounting[::-1])
    flow_s = sensor_b.inv().apply(rotation_nb.inv().apply([*layer, 0.0]))
    rows = between & INSIDE
    flow = flow_s[INSIDE[between]]
    assert found.velocity[rows] == pytest.approx(1.02 * (healthy.velocity[rows] - flow), abs=1e-12)
    ways = np.array([[np.sin(tilt) * np.cos(a), np.sin(tilt) * np.sin(a), np.cos(tilt)] for a in JANUS])
    assert found.beam[rows] == pytest.approx(1.02 * (healthy.beam[rows] - flow @ ways.T), abs=1e-12)
    assert found.range[INSIDE] == pytest.approx(0.25 * healthy.range[INSIDE])
    assert found.altitude[INSIDE] == pytest.approx(0.25 * healthy.altitude[INSIDE])
    assert np.all(found.valid == 1.0)


def test_a_false_lock_between_rows_of_truth_turns_evenly():
    """Between rows 0.1 s apart the rotation is off from the even one by at most the cube of the half turn, here below 1e-6 rad."""
    truth = LOG["truth"]
    found = struck(FalseLock(sensor="vector", layer_n=(1.0, 0.0)))
    middle = truth.time[-1] > TIME
    rotations = Rotation.from_euler("ZYX", np.column_stack([truth.heading, truth.pitch, truth.roll]))
    flow = Slerp(truth.time, rotations)(TIME[middle]).inv().apply([1.0, 0.0, 0.0])
    assert LOG["vector"].velocity[middle] - found.velocity[middle] == pytest.approx(flow, abs=1e-6)


@pytest.mark.parametrize("frame", ["sensor", "body", "ned"])
def test_a_false_lock_knows_the_frame_of_a_velocity(frame):
    table = replace(LOG["vector"], frame=np.full(ROWS, frame))
    log = replace(LOG, tables={**LOG.tables, "vector": table})
    mounting = (0.0, 0.0, pi / 2)
    found = troubled(log, [FalseLock(sensor="vector", layer_n=(1.0, 0.0), mounting_bs=mounting)], 1)["vector"]
    truth = LOG["truth"]
    flow = (table.velocity - found.velocity)[::2]
    flow_b = Rotation.from_euler("ZYX", np.column_stack([truth.heading, truth.pitch, truth.roll])).inv().apply([1.0, 0.0, 0.0])
    x, y, z = flow_b.T
    expected = {"ned": np.tile([1.0, 0.0, 0.0], (len(flow), 1)), "body": flow_b, "sensor": np.column_stack([y, -x, z])}[frame]
    assert flow == pytest.approx(expected, abs=1e-12)


def test_a_scale_multiplies_velocities():
    found = struck(ScaleJump(sensor="dvl", scale=-0.02, **WINDOW))
    assert found.velocity[INSIDE] == pytest.approx(0.98 * LOG["dvl"].velocity[INSIDE])
    assert found.beam[INSIDE] == pytest.approx(0.98 * LOG["dvl"].beam[INSIDE])


# ---- echoes


@pytest.mark.parametrize(("sensor", "ways"), [("one_way", 1), ("two_way", 2)])
def test_late_echoes_are_longer_and_arrive_later(sensor, ways):
    healthy = LOG[sensor]
    found = struck(LateEchoes(sensor=sensor, fraction=0.3, low=5.0, high=25.0, sound_speed=1480.0))
    wild = found.extra["outlier"] > 0
    assert binomtest(int(wild.sum()), ROWS, 0.3).pvalue > 0.001
    late = found.time - healthy.time
    longer = 1480.0 * (found.travel_time - healthy.travel_time) if sensor == "one_way" else found.range - healthy.range
    assert np.all(late[~wild] == 0.0)
    assert np.all(longer[~wild] == 0.0)
    assert kstest(longer[wild], "uniform", args=(5.0, 20.0)).pvalue > 0.001
    assert late == pytest.approx(ways * longer / 1480.0, abs=1e-12)
    if sensor == "one_way":
        assert found.received - found.time == pytest.approx(0.1, abs=1e-12)


def test_wild_pings_are_off_by_the_angle_they_are_told_in_any_direction():
    healthy = LOG["usbl"]
    found = struck(WildPings(sensor="usbl", fraction=0.4, angle_low=0.1, angle_high=0.5, low=2.0, high=4.0))
    wild = found.extra["outlier"] > 0

    def unit(table):
        level = np.cos(table.elevation)
        return np.column_stack([level * np.cos(table.azimuth), level * np.sin(table.azimuth), np.sin(table.elevation)])

    true, shown = unit(healthy), unit(found)
    apart = np.arctan2(np.linalg.norm(np.cross(true, shown), axis=1), np.sum(true * shown, axis=1))
    assert np.array_equal(apart == 0.0, ~wild)
    assert kstest(apart[wild], "uniform", args=(0.1, 0.4)).pvalue > 0.001
    # The way across: against the horizontal one, which is uniform where all ways are alike.
    level = np.column_stack([-np.sin(healthy.azimuth), np.cos(healthy.azimuth), np.zeros(ROWS)])
    up = np.cross(true, level)
    way = np.arctan2(np.sum(shown * up, axis=1), np.sum(shown * level, axis=1))
    assert kstest(way[wild], "uniform", args=(-pi, 2 * pi)).pvalue > 0.001
    assert kstest((found.range - healthy.range)[wild], "uniform", args=(2.0, 2.0)).pvalue > 0.001


# ---- biases and drifts


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_bias_appears_on_one_axis_and_in_increments_by_their_interval(axis):
    push = np.zeros((ROWS, 3))
    push[INSIDE, axis] = 0.25
    for fault, mean, increment in ((GyroBiasJump, "gyro", "delta_angle"), (AccelBiasJump, "accel", "delta_velocity")):
        rates = struck(fault(sensor="imu", size=0.25, axis=axis, **WINDOW))
        assert getattr(rates, mean) - getattr(LOG["imu"], mean) == pytest.approx(push)
        sums = struck(fault(sensor="increments", size=0.25, axis=axis, **WINDOW))
        assert getattr(sums, increment) - getattr(LOG["increments"], increment) == pytest.approx(0.05 * push)
        assert sums.sample == "increment"


def test_a_depth_drifts_by_metres_and_a_pressure_by_their_weight():
    since = np.where(INSIDE, TIME - BEGIN, 0.0)
    depth = struck(DepthDrift(sensor="depth", rate=0.01, step=0.5, **WINDOW)).depth - LOG["depth"].depth
    assert depth == pytest.approx(np.where(INSIDE, 0.5 + 0.01 * since, 0.0))
    pressure = struck(DepthDrift(sensor="pressure", rate=0.01, **WINDOW)).pressure - LOG["pressure"].pressure
    assert pressure == pytest.approx(1025.0 * 9.81 * 0.01 * since, abs=1e-9)


def test_a_tide_lifts_all_depths_and_no_altitude():
    found = troubled(LOG, [TideJump(sensor="depth", size=1.5, begin=BEGIN)], 1)
    assert found["depth"].depth - LOG["depth"].depth == pytest.approx(np.where(TIME >= BEGIN, 1.5, 0.0))
    assert found["pressure"].pressure - LOG["pressure"].pressure == pytest.approx(
        np.where(TIME >= BEGIN, 1.5 * 1025.0 * 9.81, 0.0), abs=1e-9
    )
    assert {name for name in LOG.tables if found[name] is not LOG[name]} == {"depth", "pressure"}


def test_fixes_jump_and_are_drawn_away():
    """Metres north and east of radians: by the radii of the WGS 84 ellipsoid at the point (the second order is below 1e-4 of it)."""
    fault = FixJump(sensor="gnss", jump_n=(10.0, -5.0), drag_n=(0.2, 0.1), **WINDOW)
    found, healthy = struck(fault), LOG["gnss"]
    a, e2 = 6378137.0, 0.0066943799901413165
    w = np.sqrt(1 - e2 * np.sin(healthy.latitude) ** 2)
    north = (found.latitude - healthy.latitude) * a * (1 - e2) / w**3
    east = (found.longitude - healthy.longitude) * a / w * np.cos(healthy.latitude)
    since = np.where(INSIDE, TIME - BEGIN, 0.0)
    assert north == pytest.approx(np.where(INSIDE, 10.0 + 0.2 * since, 0.0), abs=2e-3)
    assert east == pytest.approx(np.where(INSIDE, -5.0 + 0.1 * since, 0.0), abs=2e-3)
    assert np.array_equal(found.extra["outlier"] > 0, INSIDE)
    local = struck(replace(fault, sensor="local"))
    assert local.north - LOG["local"].north == pytest.approx(np.where(INSIDE, 10.0 + 0.2 * since, 0.0))
    assert local.east - LOG["local"].east == pytest.approx(np.where(INSIDE, -5.0 + 0.1 * since, 0.0))


@pytest.mark.parametrize("sensor", ["heading", "ahrs"])
def test_a_compass_steps_and_swings_on_top(sensor):
    found = struck(CompassSwinging(sensor=sensor, step=radians(20.0), amplitude=radians(5.0), period=8.0, **WINDOW))
    off = (found.heading - LOG[sensor].heading + pi) % (2 * pi) - pi
    swing = radians(20.0) + radians(5.0) * np.sin(2 * pi * (TIME - BEGIN) / 8.0)
    assert off == pytest.approx(np.where(INSIDE, swing, 0.0), abs=1e-12)
    assert np.all((found.heading >= 0.0) & (found.heading < 2 * pi))


# ---- values that stick, and noise


def test_a_stuck_sensor_repeats_the_last_good_row_and_its_stamps_go_on():
    healthy = LOG["dvl"]
    last = int(np.flatnonzero(TIME < BEGIN)[-1])
    valid = np.ones(ROWS)
    valid[[last, last - 1, last + 100]] = 0.0
    velocity = np.array(healthy.velocity)
    velocity[last + 100] = np.nan
    table = replace(healthy, valid=valid, velocity=velocity, received=TIME + 0.3, sequence=np.arange(ROWS))
    found = StuckValue(sensor="dvl", **WINDOW).changed(table, np.random.default_rng(0))
    for name in ("velocity", "beam", "altitude", "range", "sigma", "error_velocity", "valid"):
        values, before = getattr(found, name), getattr(table, name)
        assert np.all(values[INSIDE] == before[last - 2]), name
        assert np.array_equal(values[~INSIDE], before[~INSIDE], equal_nan=True), name
    for name in ("time", "received", "sequence"):
        assert np.array_equal(getattr(found, name), getattr(table, name))


def test_a_stuck_sensor_without_a_past_repeats_its_first_good_row():
    table = records.Depth(time=[0.0, 1.0, 2.0, 3.0], depth=[np.nan, 5.0, 6.0, 7.0])
    assert np.array_equal(StuckValue(sensor="d").changed(table, np.random.default_rng(0)).depth, [np.nan, 5.0, 5.0, 5.0], equal_nan=True)
    none = replace(table, depth=np.full(4, np.nan))
    assert not changed_columns(StuckValue(sensor="d").changed(none, np.random.default_rng(0)), none)


def test_rows_stick_by_time_whatever_their_order_and_each_beacon_by_itself():
    order = np.random.default_rng(3).permutation(ROWS)
    table = LOG["two_way"].select(order)
    fault = StuckValue(sensor="x", **WINDOW)
    found = fault.changed(table, np.random.default_rng(0))
    inside = (table.time >= BEGIN) & (table.time < END)
    for name in ("a", "b"):
        mine = np.flatnonzero(table.transmitter == name)
        past = mine[table.time[mine] < BEGIN]
        last = past[np.argmax(table.time[past])]
        assert np.all(found.range[mine[inside[mine]]] == table.range[last])
        assert np.all(found.turnaround[mine[inside[mine]]] == table.turnaround[last])
    assert np.array_equal(found.transmitter, table.transmitter)


NOISY = {
    "depth": ("distance", ["depth"], 1.0), "altimeter": ("distance", ["range"], 1.0), "dvl": ("speed", ["velocity", "beam"], 1.0),
    "speed": ("speed", ["speed"], 1.0), "imu": ("rate", ["gyro"], 1.0), "increments": ("force", ["delta_velocity"], 0.05),
    "gyro": ("rate", ["yaw_rate"], 1.0), "pressure": ("pressure", ["pressure"], 1.0), "ahrs": ("angle", ["roll", "pitch", "heading"], 1.0),
    "usbl": ("angle", ["azimuth", "elevation"], 1.0), "local": ("distance", ["north", "east"], 1.0),
    "two_way": ("distance", ["range"], 1.0),
}  # fmt: skip


@pytest.mark.parametrize("sensor", NOISY)
def test_noise_is_white_normal_and_of_the_sigma_that_is_told(sensor):
    quantity, names, factor = NOISY[sensor]
    found = struck(NoiseBurst(sensor=sensor, sigma=0.3, quantity=quantity, **WINDOW))
    for name in names:
        error = getattr(found, name) - getattr(LOG[sensor], name)
        if quantity == "angle":
            error = (error + pi) % (2 * pi) - pi
        healthy = LOG[sensor].time
        rows = (healthy >= BEGIN) & (healthy < END)
        assert kstest(error[rows].ravel() / (0.3 * factor), "norm").pvalue > 0.001, name
        following = np.corrcoef(error[rows][:-1].ravel(), error[rows][1:].ravel())[0, 1]
        assert abs(following) < 4.0 / np.sqrt(error[rows].size), name


def test_noise_does_not_depend_on_its_window():
    short, long = (struck(NoiseBurst(sensor="depth", sigma=0.3, quantity="distance", begin=40.0, end=end)) for end in (50.0, 90.0))
    rows = (TIME >= 40.0) & (TIME < 50.0)
    assert np.array_equal(short.depth[rows], long.depth[rows])


def test_noise_of_angles_stays_on_the_circle():
    found = struck(NoiseBurst(sensor="ahrs", sigma=3.0, quantity="angle"))
    assert np.all((found.heading >= 0.0) & (found.heading < 2 * pi))
    assert np.all(np.abs(found.roll) <= pi)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (BeamLoss(sensor="vector", beams=(1,)), "with beams"),
        (BeamLoss(sensor="beams", beams=(5,)), "some of 1 to 4"),
        (BeamLoss(sensor="beams", beams=()), "some of 1 to 4"),
        (FalseLock(sensor="depth"), "a Doppler log"),
        (FalseLock(sensor="dvl", share=0.0), "share above 0"),
        (FalseLock(sensor="beams", layer_n=(1.0, 0.0)), "one for each of 4 beams"),
        (LateEchoes(sensor="depth", fraction=0.1, low=0.0, high=1.0), "acoustic ranges"),
        (LateEchoes(sensor="one_way", fraction=0.1, low=2.0, high=1.0), "low <= high"),
        (WildPings(sensor="one_way", fraction=0.1), "azimuth and elevation"),
        (WildPings(sensor="usbl", fraction=0.1, angle_low=1.0, angle_high=4.0), "angles up to pi"),
        (GyroBiasJump(sensor="depth", size=1.0), "an inertial unit, or a yaw_rate"),
        (GyroBiasJump(sensor="gyro", size=1.0, axis=0), "about z"),
        (GyroBiasJump(sensor="imu", size=1.0, axis=3), "0, 1 or 2"),
        (AccelBiasJump(sensor="gyro", size=1.0), "an inertial unit"),
        (DepthDrift(sensor="altimeter", step=1.0), "kind depth or pressure"),
        (DepthDrift(sensor="depth", rate=1.0), "give begin"),
        (TideJump(sensor="altimeter", size=1.0), "kind depth or pressure"),
        (FixJump(sensor="depth"), "kind position_fix or gnss"),
        (FixJump(sensor="gnss", drag_n=(1.0, 0.0)), "give begin"),
        (ScaleJump(sensor="depth", scale=0.1), "dvl, water_velocity, speed"),
        (NoiseBurst(sensor="depth", sigma=1.0, quantity="angle"), "it has: distance"),
        (NoiseBurst(sensor="depth", sigma=-1.0, quantity="distance"), "0 or more"),
        (CompassSwinging(sensor="heading", amplitude=0.1, period=0.0, begin=0.0), "a period above 0"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(fault, message):
    with pytest.raises(InputError, match=message) as refused:
        troubled(LOG, [fault], 1)
    assert "\n" not in str(refused.value)


def test_a_layer_that_moves_needs_an_attitude():
    blind = LOG.without("truth")
    with pytest.raises(InputError, match="truth has no attitude"):
        troubled(blind, [FalseLock(sensor="vector", layer_n=(1.0, 0.0))], 1)
    still = troubled(blind, [FalseLock(sensor="vector", scale=0.1)], 1)["vector"]
    assert still.velocity == pytest.approx(1.1 * LOG["vector"].velocity)
