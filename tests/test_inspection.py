"""Inspection: what is wrong is found, and a good log brings no finding at all."""

from __future__ import annotations

import json
import re
import time as clock
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from leadline.core.attitude import (
    conjugate,
    euler_from_quaternion,
    exponential,
    logarithm,
    matrix_from_quaternion,
    product,
    quaternion_from_euler,
)
from leadline.core.geodesy import from_north_east
from leadline.data.inspection import Facts, Inspection, inspect
from leadline.data.log import Log, Origin
from leadline.data.records import Attitude, Depth, Dvl, Gnss, Heading, Imu, Other, PositionFix, Speed, Table, Truth
from leadline.report.inspection import text

ORIGIN = Origin(0.573, 0.609)
DEG = np.pi / 180


def good_log(seconds: int = 300) -> Log:
    """A vehicle on a winding course: every sensor tells the truth, with noise of its own."""
    rng = np.random.default_rng(5)
    time = np.arange(seconds * 20) / 20
    heading = 1.0 + 2.0 * np.sin(time / 20)
    roll, pitch = 0.10 * np.sin(time / 2), 0.05 * np.sin(time / 3)
    quaternion = quaternion_from_euler(roll, pitch, heading)
    turn = logarithm(product(conjugate(quaternion[:-1]), quaternion[1:])) * 20.0
    gyro = np.vstack([turn[:1], turn]) + rng.normal(0, 2e-3, (len(time), 3))
    force = np.einsum("nji,j->ni", matrix_from_quaternion(quaternion), [0.0, 0.0, -9.8]) + rng.normal(0, 0.02, (len(time), 3))
    north, east = np.cumsum(1.5 * np.cos(heading)) / 20, np.cumsum(1.5 * np.sin(heading)) / 20
    whole = slice(0, None, 20)
    latitude, longitude = from_north_east(north[whole], east[whole], ORIGIN.latitude, ORIGIN.longitude)
    noisy = heading + rng.normal(0, 0.01, len(time))
    ahrs = euler_from_quaternion(product(quaternion, exponential(rng.normal(0, 5e-4, (len(time), 3)))))
    tables: dict[str, Table] = {
        "imu": Imu(time=time, accel=force, gyro=gyro, sequence=np.arange(len(time)), received=time + 0.01),
        "heading": Heading(time=time[::2], heading=noisy[::2] % (2 * np.pi)),
        "attitude": Attitude(time=time, roll=ahrs[0], pitch=ahrs[1], heading=ahrs[2] % (2 * np.pi)),
        "depth": Depth(time=time[::4], depth=5.0 + rng.normal(0, 0.02, len(time[::4]))),
        "dvl": Dvl(time=time[whole], velocity=np.tile([1.5, 0.0, 0.0], (seconds, 1)) + rng.normal(0, 0.01, (seconds, 3))),
        "speed": Speed(time=time[whole], speed=np.full(seconds, 1.5) + rng.normal(0, 0.01, seconds)),
        "gnss": Gnss(time=time[whole], latitude=latitude, longitude=longitude, sigma=np.full(seconds, 0.5)),
    }
    return Log("good", tables, origin=ORIGIN)


def changed(name: str, **values: object) -> Log:
    log = good_log()
    return replace(log, tables={**log.tables, name: replace(log.tables[name], **values)})


def said(log: Log, table: str) -> str:
    return " | ".join(f"{f.severity}: {f.sentence}" for f in inspect(log).findings if f.table == table)


def test_a_good_log_brings_no_finding() -> None:
    assert inspect(good_log()).findings == ()


GOOD = good_log().tables
IMU, HEADING, GNSS, DEPTH, DVL = GOOD["imu"], GOOD["heading"], GOOD["gnss"], GOOD["depth"], GOOD["dvl"]
ROUND = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

BAD = {
    "g": ("imu", {"accel": IMU.accel / 9.8}, "problem.*not 9.8: is it in g"),
    "cm/s2": ("imu", {"accel": IMU.accel * 100}, "is it in cm/s"),
    "no gravity": ("imu", {"accel": IMU.accel + np.array([0, 0, 9.8])}, "is gravity taken out"),
    "wrong sign": ("imu", {"accel": -IMU.accel}, r"suspicion.*averages \+9.* on z"),
    "wrong axis": ("imu", {"accel": IMU.accel @ ROUND.T, "gyro": IMU.gyro @ ROUND.T}, "averages -9.* on y"),
    "degrees per second": ("imu", {"gyro": IMU.gyro / DEG}, "is it in degrees per second"),
    "mirrored rates": ("imu", {"gyro": -IMU.gyro}, "signs or axes"),
    "upward depth": ("depth", {"depth": -DEPTH.depth}, "problem.*positive down"),
    "mm/s": ("dvl", {"velocity": DVL.velocity * 1e3}, "problem.*is it in mm/s"),
    "cm/s": ("speed", {"speed": GOOD["speed"].speed * 1e2}, "problem.*is it in cm/s"),
    "turned": ("heading", {"heading": HEADING.heading - 0.5}, r"turned by \+29 degrees from the course of 'gnss'"),
    "reversed": ("heading", {"heading": HEADING.heading + np.pi}, "reversed against the course"),
    "counter-clockwise": ("heading", {"heading": -HEADING.heading}, "counter-clockwise"),
    "from east": ("heading", {"heading": np.pi / 2 - HEADING.heading}, "counter-clockwise"),
    "random": ("heading", {"heading": np.random.default_rng(1).uniform(0, 6, len(HEADING))}, "does not follow the course"),
    "radians": ("heading", {"heading": HEADING.heading * DEG}, "problem.*is it in radians"),
    "signed radians": ("heading", {"heading": ((HEADING.heading + np.pi) % (2 * np.pi) - np.pi) * DEG}, "problem.*is it in radians"),
    "swapped": ("gnss", {"latitude": GNSS.longitude, "longitude": GNSS.latitude}, ""),
    "place in radians": ("gnss", {"latitude": GNSS.latitude * DEG, "longitude": GNSS.longitude * DEG}, "problem.*are they in radians"),
    "unix": ("depth", {"time": DEPTH.time + 1.66e9}, "problem.*seconds since 1970"),
    "unix ms": ("depth", {"time": (DEPTH.time + 1.66e9) * 1e3}, "problem.*milliseconds since 1970"),
    "ms": ("depth", {"time": DEPTH.time * 1e3}, "problem.*in milliseconds"),
    "elsewhen": ("depth", {"time": DEPTH.time + 1e4}, "problem.*meet those of no other table"),
    "sentinel": ("dvl", {"velocity": np.where(np.arange(300)[:, None] == 7, -32.768, DVL.velocity)}, "-32.768 in 1 rows.*not measured"),
    "9999": ("depth", {"depth": np.where(np.arange(len(DEPTH)) == 7, 9999.0, DEPTH.depth)}, "9999 in 1 rows"),
    "held": ("depth", {"depth": np.repeat(DEPTH.depth, 4)[: len(DEPTH)]}, "suspicion.*changes only every 4 rows"),
    "unmeasured": ("depth", {"depth": np.where(np.arange(len(DEPTH)) < 15, np.nan, DEPTH.depth)}, r"note.*15 of 1500 rows \(1.0%\)"),
    "infinite": ("depth", {"depth": np.where(np.arange(len(DEPTH)) < 2, np.inf, DEPTH.depth)}, "problem.*infinite in 2 rows"),
    "invalid": ("depth", {"valid": (np.arange(len(DEPTH)) > 2) * 1.0}, "3 of 1500 rows are marked invalid"),
    "timeless": ("depth", {"time": np.where(np.arange(len(DEPTH)) < 2, np.nan, DEPTH.time)}, "problem: 2 rows without a time"),
    "early": ("depth", {"received": DEPTH.time - 0.5}, "0.5 s before its time of validity"),
    "clock": ("imu", {"time": IMU.time - 5.0 * (np.arange(len(IMU)) >= 3000)}, "problem: 1 backward step of its clock.*4.95 s"),
}


@pytest.mark.parametrize(("table", "values", "sentence"), BAD.values(), ids=BAD.keys())
def test_what_is_wrong_is_found_and_nothing_else(table: str, values: dict[str, object], sentence: str) -> None:
    log = changed(table, **values)
    assert re.search(sentence or "swapped|km from", said(log, table))
    related = {table, "heading", "attitude"} if table == "gnss" else {table}
    assert {finding.table for finding in inspect(log).findings} <= related


def test_latitude_and_longitude_swapped_far_from_the_diagonal() -> None:
    place = from_north_east(np.arange(10.0), np.arange(10.0), 0.2, 1.2)
    tables = {"gnss": Gnss(time=np.arange(10.0), latitude=place[1], longitude=place[0])}
    assert "are latitude and longitude swapped?" in said(Log("x", tables, origin=Origin(0.2, 1.2)), "gnss")
    beyond = {"gnss": Gnss(time=np.arange(10.0), latitude=place[1] + 1.0, longitude=place[0])}
    assert "beyond the pole" in said(Log("x", beyond), "gnss")


def test_positions_at_zero_are_named() -> None:
    latitude, longitude = GNSS.latitude.copy(), GNSS.longitude.copy()
    latitude[:3], longitude[:3] = 0.0, 0.0
    assert "3 positions are (0, 0)" in said(changed("gnss", latitude=latitude, longitude=longitude), "gnss")


def test_a_constant_value_and_a_rounded_one_are_not_held() -> None:
    rng = np.random.default_rng(2)
    walk = np.round(np.cumsum(rng.normal(0, 0.05, len(DEPTH))), 1) + 50.0
    assert said(changed("depth", depth=walk), "depth") == ""
    assert said(changed("depth", depth=np.full(len(DEPTH), 5.0)), "depth") == ""


def test_999_that_is_a_measurement_is_no_sentinel() -> None:
    assert said(changed("depth", depth=np.random.default_rng(1).integers(900, 1100, len(DEPTH))), "depth") == ""


def test_headings_on_a_northward_leg_are_not_taken_for_radians() -> None:
    rng = np.random.default_rng(2)
    for heading in (rng.normal(0, 1, 500) % 360, np.clip(rng.normal(0, 1, 500), -3, 3), rng.uniform(1, 5, 500)):
        log = Log("x", {"heading": Heading(time=np.arange(500.0), heading=heading * DEG)})
        assert [f for f in inspect(log).findings if f.table] == []


def test_a_fast_hand_held_imu_is_believed() -> None:
    rng = np.random.default_rng(2)
    rate = np.cumsum(rng.normal(0, 0.5, (5000, 3)), axis=0)
    rate *= 5.0 / np.linalg.norm(rate, axis=1, keepdims=True)
    quaternion = [np.array([1.0, 0, 0, 0])]
    for step in exponential(rate / 200)[1:]:
        quaternion.append(product(quaternion[-1], step))
    force = np.einsum("nji,j->ni", matrix_from_quaternion(np.stack(quaternion)), [0, 0, -9.8]) + rng.normal(0, 2, (5000, 3))
    assert "degrees" not in said(Log("x", {"imu": Imu(time=np.arange(5000) / 200, accel=force, gyro=rate)}), "imu")


def test_one_instrument_under_two_names() -> None:
    log = good_log()
    twin = replace(log, tables={**log.tables, "imu_b": log["imu"]})
    assert "equals 'imu' in all values" in said(twin, "imu_b")
    other = replace(log["imu"], gyro=log["imu"].gyro + 1e-3 * np.random.default_rng(1).normal(size=log["imu"].gyro.shape))
    assert said(replace(log, tables={**log.tables, "imu_b": other}), "imu_b") == ""


def test_an_attitude_made_of_the_same_gyro() -> None:
    imu = good_log()["imu"]
    quaternion = [quaternion_from_euler(0, 0, 1.0)]
    for step in exponential(imu.gyro[1:] / 20):
        quaternion.append(product(quaternion[-1], step))
    attitude = Attitude(time=imu.time, quaternion=np.stack(quaternion))
    assert "repeat the noise of the gyro 'imu'" in said(Log("x", {"imu": imu, "ahrs": attitude}), "ahrs")


def in_milliseconds(log: Log) -> Log:
    return replace(log, tables={name: replace(table, time=table.time * 1e3) for name, table in log.tables.items()})


def test_all_times_in_milliseconds_at_once() -> None:
    slow = in_milliseconds(good_log())
    assert {f.table for f in inspect(slow).findings if f.sentence.endswith("is time_s in milliseconds?")} == {"imu"}
    no_imu = replace(slow, tables={name: slow[name] for name in ("heading", "depth", "dvl")})
    assert "is time_s in milliseconds?" in said(no_imu, "dvl")
    good = replace(no_imu, tables={name: good_log()[name] for name in no_imu.tables})
    assert {f.sentence for f in inspect(good).findings} == {"no table of kind imu: the process model `inertial` needs one"}


def test_a_heading_that_the_attitude_has_too() -> None:
    log = good_log()
    attitude = log["attitude"]
    same = Heading(time=attitude.time[::3], heading=(attitude.heading[::3] + 0.08) % (2 * np.pi))
    twice = replace(log, tables={**log.tables, "compass": same})
    assert "its heading repeats that of 'attitude'" in said(twice, "compass")
    noise = np.random.default_rng(8).normal(0, 3e-4, len(same))
    other = replace(same, heading=(same.heading + noise) % (2 * np.pi))
    assert said(replace(log, tables={**log.tables, "compass": other}), "compass") == ""


def test_truth_that_is_a_fix() -> None:
    log = good_log()
    truth = Truth(time=GNSS.time, latitude=GNSS.latitude, longitude=GNSS.longitude)
    assert "note: repeats the positions of 'gnss'" in said(replace(log, tables={**log.tables, "truth": truth}), "truth")
    apart = replace(truth, latitude=truth.latitude + 1e-7)
    assert said(replace(log, tables={**log.tables, "truth": apart}), "truth") == ""
    local = Truth(time=GNSS.time, north=np.zeros(300), east=np.zeros(300))
    assert said(replace(log, tables={**log.tables, "truth": local}), "truth") == ""


@pytest.mark.parametrize(("column", "meant"), [("simga_m", "sigma_m"), ("recieved_s", "received_s"), ("temperature_degc", "")])
def test_a_column_that_was_meant_for_another(column: str, meant: str) -> None:
    found = said(changed("gnss", sigma=None, extra={column: np.linspace(0.0, 1.0, len(GNSS))}), "gnss")
    assert found == (f"suspicion: {column}: carried, not used; did you mean {meant}?" if meant else "")


def test_local_fixes_serve_as_well_as_geographic_ones() -> None:
    log = good_log()
    north, east = np.cumsum(np.cos(log["heading"].heading)) * 0.15, np.cumsum(np.sin(log["heading"].heading)) * 0.15
    fix = PositionFix(time=log["heading"].time, north=north, east=east)
    turned = Heading(time=log["heading"].time, heading=log["heading"].heading + 0.6)
    assert said(Log("x", {"fix": fix, "heading": log["heading"]}), "heading") == ""
    assert "turned by -34 degrees" in said(Log("x", {"fix": fix, "heading": turned}), "heading")


def test_facts_of_time() -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0, 13.0, 14.0, 12.0, 14.0, 15.0, 16.0])
    depth = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.6, np.nan, 0.9])
    facts = inspect(Log("x", {"depth": Depth(time=time, depth=depth, received=time + 0.25)})).tables["depth"]
    assert (facts.rows, facts.first, facts.last, facts.interval, facts.rate) == (10, 0.0, 16.0, 1.0, 1.0)
    assert (facts.gaps, facts.longest_gap, facts.longest_gap_at) == (1, 9.0, 3.0)
    assert (facts.duplicates, facts.out_of_order) == (1, 1)
    assert facts.not_measured == {"depth_m": 1}
    assert facts.ranges["depth_m"].median == pytest.approx(0.5)
    assert (facts.lag.minimum, facts.lag.maximum) == (0.25, 0.25)


def test_ranges_stand_in_file_units() -> None:
    facts = inspect(Log("x", {"heading": Heading(time=[0, 1], heading=[np.pi, np.pi / 2])})).tables["heading"]
    assert facts.ranges["heading_deg"].maximum == pytest.approx(180.0)


def test_beams_of_one_ping_are_no_duplicates() -> None:
    words = np.array(["a", "b", "a"])
    table = Other(time=np.zeros(3), extra={"word": words, "x_m": np.array([1.0, 1.0, 1.0])})
    assert inspect(Log("x", {"w": table})).tables["w"].duplicates == 1


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_logs_of_hardly_any_row(rows: int) -> None:
    log = good_log()
    short = replace(log, tables={name: table.select(slice(0, rows)) for name, table in log.tables.items()})
    json.dumps(inspect(short).to_dict(), allow_nan=False)
    assert {finding.severity for finding in inspect(short).findings} == ({"problem"} if rows == 0 else set())


def test_json_is_plain_and_holds_no_nan() -> None:
    log = changed("depth", **BAD["infinite"][1])
    whole = json.loads(json.dumps(inspect(log).to_dict(), allow_nan=False))
    assert whole["tables"]["depth"]["rate"] == pytest.approx(5.0)
    assert whole["findings"][0]["severity"] == "problem"
    assert whole["findings"][0]["numbers"] == {"rows": 2}


def test_the_text_names_every_table_and_finding() -> None:
    console = Console(width=200, record=True, file=StringIO())
    console.print(text(inspect(changed("depth", **BAD["upward depth"][1]))))
    shown = console.export_text()
    assert "positive down" in shown
    for name in GOOD:
        assert name in shown
    console.print(text(inspect(good_log())))
    assert "Nothing looks wrong" in console.export_text()


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_no_number_and_no_name_is_broken_on_a_terminal(width: int) -> None:
    log = good_log()
    log = replace(log, tables={f"{name}_of_the_vehicle": table for name, table in log.tables.items()})
    inspection = inspect(replace(log, tables={**log.tables, "empty": DEPTH.select(slice(0, 0))}))
    console = Console(width=width, file=StringIO())
    console.print(text(inspection))
    shown = console.file.getvalue()
    assert "…" not in shown
    assert all(line == line.rstrip() and len(line) <= width for line in shown.splitlines())
    assert "duplicates" not in shown  # in no table
    for facts in inspection.tables.values():
        for column, spread in facts.ranges.items():
            in_line = rf"\b{column} +{spread.minimum:.8g} .*{spread.maximum:.8g}\b"
            assert re.search(in_line if width > 60 else rf"column: {column}\n +least: {spread.minimum:.8g}\n", shown)


def test_nothing_of_the_log_is_changed_and_findings_come_worst_first() -> None:
    log = changed("depth", depth=-DEPTH.depth, valid=(np.arange(len(DEPTH)) > 2) * 1.0)
    inspection = inspect(log)
    assert isinstance(inspection, Inspection)
    assert isinstance(inspection.tables["depth"], Facts)
    assert [f.severity for f in inspection.findings] == ["problem", "note"]
    np.testing.assert_array_equal(log["depth"].depth, -DEPTH.depth)


def test_an_hour_at_100_hz_is_inspected_in_a_moment() -> None:
    rng = np.random.default_rng(1)
    rows = 400_000
    force = rng.normal([0, 0, -9.8], 0.1, (rows, 3))
    imu = Imu(time=np.arange(rows) / 100, accel=force, gyro=rng.normal(0, 0.1, (rows, 3)))
    start = clock.perf_counter()
    inspect(Log("long", {"imu": imu}))
    assert clock.perf_counter() - start < 4.0  # measured: 0.3 to 0.5 s
