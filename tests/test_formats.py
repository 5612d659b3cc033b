"""Logs as folders: what is written is read again, and what is wrong is said in one line that names it."""

from __future__ import annotations

import os
import time
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from leadline.data.errors import InputError
from leadline.data.inspection import inspect
from leadline.data.log import Beacon, Datum, Initial, Log, Origin
from leadline.data.records import KINDS, Depth, Dvl, Gnss, Imu, Other, Table, expand
from leadline.formats.folder import read_log, write_log

DEG = np.pi / 180
NUMBERS = st.floats(-1e12, 1e12) | st.just(np.nan) | st.sampled_from([0.0, -0.0, 1e-300, np.inf])
WORDS = st.text("abc XYZ019,;\"'äß-_", max_size=6).map(str.strip)


@st.composite
def tables(draw, kind: str) -> Table:
    """Draw a table of a kind with some of its optional fields."""
    record = KINDS.get(kind, Other)
    rows = draw(st.integers(1, 4))
    chosen = draw(st.sampled_from(record.alternatives)) if record.alternatives else ()
    values = {}
    for item in record.columns():
        if not (item.metadata["required"] or item.name in chosen or draw(st.booleans())):
            continue
        pattern = item.metadata["pattern"]
        width = draw(st.integers(1, 4)) if "{i}" in pattern else len(expand(pattern, []))
        cells = draw(st.lists(WORDS if item.metadata["text"] else NUMBERS, min_size=rows * width, max_size=rows * width))
        values[item.name] = np.array(cells).reshape((rows, width) if "{" in pattern else rows)
    extra = {"wheel_m": np.array(draw(st.lists(NUMBERS, min_size=rows, max_size=rows)))} if draw(st.booleans()) else {}
    return record(**values, extra=extra)


def assert_same(a: Table, b: Table) -> None:
    assert type(a) is type(b)
    for item in a.columns():
        one, two = getattr(a, item.name), getattr(b, item.name)
        assert (one is None) == (two is None), item.name
        if one is not None and item.metadata["text"]:
            assert one.tolist() == two.tolist()
        elif one is not None:
            np.testing.assert_allclose(two, one, rtol=1e-12, atol=0.0, err_msg=item.name)
    assert a.extra.keys() == b.extra.keys()
    for name, value in a.extra.items():
        np.testing.assert_array_equal(b.extra[name], value)


@pytest.mark.parametrize("parquet", [False, True], ids=["csv", "parquet"])
@pytest.mark.parametrize("kind", [*KINDS, "wheel"])
def test_each_kind_comes_back_as_it_was(kind: str, parquet: bool) -> None:
    @settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(tables(kind))
    def round_trip(table: Table) -> None:
        with TemporaryDirectory() as folder:
            write_log(Log("x", {kind: table}), Path(folder) / "log", parquet=parquet)
            assert_same(table, read_log(Path(folder) / "log")[kind])

    round_trip()


finite = st.none() | st.floats(-1e6, 1e6)
latitudes = st.floats(-89 * DEG, 89 * DEG)


@settings(max_examples=40, deadline=None)
@given(
    name=st.text(st.characters(codec="utf-8", exclude_characters="\r"), min_size=1, max_size=8),
    initial=st.builds(Initial, **{f.name: finite for f in fields(Initial)} | {"latitude": st.none() | latitudes}),
    beacon=st.builds(Beacon, north=st.floats(-1e4, 1e4), east=st.floats(-1e4, 1e4), latitude=st.none() | latitudes, depth=st.floats(0, 9)),
    epoch=st.datetimes(datetime(1971, 1, 1), datetime(2099, 1, 1)),
    origin=st.none() | st.builds(Origin, latitudes, st.floats(-3, 3)),
)
def test_the_frame_of_reference_comes_back(name, initial, beacon, epoch, origin) -> None:
    tables = {"wet end": Depth(time=[1.0], depth=[2.0]), "imu_b": Imu(time=[0.0], accel=[[0, 0, -9.8]], gyro=[[0, 0, 0]], sample="instant")}
    log = Log(
        name, tables, epoch.replace(tzinfo=UTC), origin, "snapir", {"imu_b": "pps"}, Datum(17.0, "msl"), initial, {'buoy "1"': beacon}
    )
    with TemporaryDirectory() as folder:
        write_log(log, Path(folder) / "log")
        back = read_log(Path(folder) / "log")
    assert (back.name, back.epoch, back.vehicle, back.clocks, back.datum) == (log.name, log.epoch, log.vehicle, log.clocks, log.datum)
    assert back["imu_b"].sample == "instant"
    for one, two in ((log.initial, back.initial), (beacon, back.beacons['buoy "1"']), (log.origin, back.origin)):
        assert (one is None) == (two is None)
        for item in fields(one) if one is not None else ():
            a, b = getattr(one, item.name), getattr(two, item.name)
            assert b == (pytest.approx(a, rel=1e-12, abs=1e-300) if isinstance(a, float) else a), item.name


def folder(tmp_path: Path, toml: str = 'name = "x"', **files: str) -> Path:
    """Make a log by hand; files are tables by name."""
    (tmp_path / "log.toml").write_text(toml)
    for name, content in files.items():
        (tmp_path / f"{name}.csv").write_text(content)
    return tmp_path


DEPTH = "time_s,depth_m\n0,1\n1,2\n"


def test_a_log_made_by_hand(tmp_path: Path) -> None:
    toml = """
epoch = 2022-06-08T11:00:00+02:00
origin = { latitude_deg = 32.5, longitude_deg = 34 }
[tables]
wet = { kind = "depth" }
[clocks.wet]
source = "device"
[initial]
heading_deg = 180
velocity_north_mps = 2
[beacons.b1]
north_m = 1
east_m = 2
sigma_m = 3
sigma_depth_m = 4
"""
    depth = '\ufeff"time_s", depth_m ,received_s,sequence,note_m\r\n1,,1.5,0,nan\r\n0.5,2.5,NaN,1,7\r\n'
    log = read_log(folder(tmp_path, toml, wet=depth))
    assert log.name == tmp_path.name
    assert log.epoch == datetime(2022, 6, 8, 9, tzinfo=UTC)
    assert (log.initial.heading, log.initial.velocity_north, log.initial.roll) == (pytest.approx(np.pi), 2.0, None)
    assert log.beacons["b1"] == Beacon(north=1.0, east=2.0, sigma_north=3.0, sigma_east=3.0, sigma_depth=4.0)
    assert log.clocks == {"wet": "device"}
    wet = log["wet"]
    np.testing.assert_array_equal(wet.time, [1.0, 0.5])  # in the order of the file
    np.testing.assert_array_equal(wet.depth, [np.nan, 2.5])
    np.testing.assert_array_equal(wet.received, [1.5, np.nan])
    np.testing.assert_array_equal(wet.extra["note_m"], [np.nan, 7.0])
    assert not wet.depth.flags.writeable


def test_what_is_not_a_table_is_ignored(tmp_path: Path) -> None:
    (tmp_path / "extras").mkdir()
    (tmp_path / "extras" / "bad.csv").write_text("x")
    (tmp_path / ".hidden.csv").write_text("x")
    (tmp_path / "notes.txt").write_text("x")
    assert list(read_log(folder(tmp_path, depth=DEPTH)).tables) == ["depth"]


def test_columns_of_an_unknown_kind_are_carried_as_they_stand(tmp_path: Path) -> None:
    wheel = "time_s,turns,angle_deg,mode,day\n0,1,180,fast,2020-01-01\n1,,90,,2020-01-02\n"
    table = read_log(folder(tmp_path, wheel=wheel))["wheel"]
    assert isinstance(table, Other)
    np.testing.assert_array_equal(table.extra["turns"], [1.0, np.nan])
    np.testing.assert_array_equal(table.extra["angle_deg"], [180.0, 90.0])
    assert table.extra["mode"].tolist() == ["fast", ""]
    assert table.extra["day"].tolist() == ["2020-01-01", "2020-01-02"]


def test_numbers_that_only_the_patient_reader_knows(tmp_path: Path) -> None:
    table = read_log(folder(tmp_path, depth="time_s,depth_m,source\n0,+1.5, a\n1, ,b\n\n"))["depth"]
    np.testing.assert_array_equal(table.depth, [1.5, np.nan])
    assert table.extra["source"].tolist() == ["a", "b"]


def test_a_part_of_an_optional_group_is_filled_with_not_measured(tmp_path: Path) -> None:
    fix = "time_s,north_m,east_m,sigma_north_m,sigma_east_m\n0,1,2,3,4\n"
    np.testing.assert_array_equal(read_log(folder(tmp_path, position_fix=fix))["position_fix"].sigma_axes, [[3.0, 4.0, np.nan]])


def test_empty_tables_beside_a_full_one_have_no_rows(tmp_path: Path) -> None:
    log = read_log(folder(tmp_path, depth="time_s,depth_m\n0,1", imu="", dvl="time_s,velocity_x_mps,velocity_y_mps,velocity_z_mps\n"))
    assert {name: len(table) for name, table in log.tables.items()} == {"depth": 1, "imu": 0, "dvl": 0}
    assert log["dvl"].velocity.shape == (0, 3)


WRONG_TABLES = {
    "text in a number": ({"depth": "time_s,depth_m\n0,1\n1,deep\n"}, ["depth.csv, line 3, column 'depth_m'", "'deep'", "empty cell"]),
    "text in an extra": ({"depth": "time_s,depth_m,wheel_m\n0,1,x\n"}, ["line 2, column 'wheel_m'", "'x'"]),
    "true and false": ({"depth": "time_s,depth_m,valid\n0,1,True\n"}, ["line 2, column 'valid'", "'True'", "0 or 1"]),
    "thousands": ({"depth": "time_s,depth_m\n0,1_000\n"}, ["'1_000'"]),
    "short line": ({"depth": "time_s,depth_m\n0,1\n1"}, ["line 3", "has 1 cells", "2 columns"]),
    "foot": ({"depth": "time_s,depth_ft\n0,1\n"}, ["depth.csv", "'depth_ft'", "'depth_m'"]),
    "no unit": ({"depth": "time_s,depth\n0,1\n"}, ["'depth'", "'depth_m'"]),
    "milliseconds": ({"depth": "time_ms,depth_m\n0,1\n"}, ["'time_ms'", "'time_s'"]),
    "km/h": ({"dvl": "time_s,velocity_x_kmh,velocity_y_kmh,velocity_z_kmh\n0,1,1,1\n"}, ["'velocity_x_kmh'", "'velocity_x_mps'"]),
    "g": (
        {"imu": "time_s,accel_x_g,accel_y_g,accel_z_g,gyro_x_radps,gyro_y_radps,gyro_z_radps\n0,1,1,1,1,1,1\n"},
        ["imu.csv", "'accel_x_g'", "'accel_x_mps2'"],
    ),
    "rpm": ({"thruster": "time_s,thruster3_rpm\n0,1\n"}, ["'thruster3_rpm'", "'thruster3_rps'"]),
    "radians": ({"heading": "time_s,heading_rad\n0,1\n"}, ["'heading_rad'", "'heading_deg'"]),
    "unknown unit": ({"depth": "time_s,depth_m,size_furlong\n0,1,1\n"}, ["'size_furlong'", "unknown unit suffix", "_mps"]),
    "missing column": ({"depth": "time_s\n0\n"}, ["depth.csv", "has no depth", "depth_m"]),
    "missing value": ({"dvl": "time_s,altitude_m\n0,1\n"}, ["dvl.csv", "velocity_{x,y,z}_mps, or beam{i}_mps"]),
    "missing time": ({"depth": "depth_m\n0\n"}, ["depth.csv", "time"]),
    "a part": ({"dvl": "time_s,velocity_x_mps,velocity_y_mps\n0,1,1\n"}, ["dvl.csv", "no column velocity_z_mps"]),
    "numbers with a gap": ({"thruster": "time_s,thruster1_rps,thruster3_rps\n0,1,1\n"}, ["thruster{i}_rps", "without a gap"]),
    "twice": ({"depth": "time_s,depth_m,depth_m\n0,1,1\n"}, ["'depth_m' 2 times"]),
    "semicolons": ({"depth": "time_s;depth_m\n0;1\n"}, ["line 1", "commas"]),
    "unnamed": ({"depth": ",time_s,depth_m\n0,0,1\n"}, ["line 1", "column 1 has no name"]),
    "all empty": ({"depth": "time_s,depth_m\n", "imu": ""}, ["empty log"]),
    "no table": ({}, ["holds no table", "CSV or Parquet"]),
}


@pytest.mark.parametrize(("files", "words"), WRONG_TABLES.values(), ids=WRONG_TABLES.keys())
def test_wrong_tables_are_refused_in_one_line(tmp_path: Path, files: dict[str, str], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        read_log(folder(tmp_path, **files))
    assert_says(caught.value, [str(tmp_path), *words])


def assert_says(error: InputError, words: list[str]) -> None:
    message = str(error)
    assert "\n" not in message
    for word in words:
        assert word in message


WRONG_MANIFESTS = {
    "not TOML": ("name = \n", ["log.toml", "is not TOML", "line 1"]),
    "unknown key": ("epohc = 2020-01-01T00:00:00Z", ["'epohc'", "did you mean 'epoch'?"]),
    "name": ("name = 3", ["name = 3", "quotes"]),
    "epoch as text": ('epoch = "yesterday"', ["epoch = yesterday", "2022-06-08T09:00:00Z"]),
    "epoch without zone": ("epoch = 2020-01-01T00:00:00", ["no time zone"]),
    "epoch as date": ("epoch = 2020-01-01", ["is not a date and time"]),
    "origin": ("origin = { latitude_deg = 1.0 }", ["[origin] has no longitude_deg"]),
    "origin as text": ('origin = { latitude_deg = "1", longitude_deg = 1 }', ["latitude_deg = '1' is not a number"]),
    "origin beyond the pole": ("origin = { latitude_deg = 134.0, longitude_deg = 34.0 }", ["134.0", "longitude?"]),
    "origin as list": ("origin = [1, 2]", ["origin = [1, 2] is not a section"]),
    "radians": ("[initial]\nheading_rad = 1", ["'heading_rad'", "did you mean 'heading_deg'?"]),
    "nan": ("[initial]\nheading_deg = nan", ["heading_deg = nan", "leave the key out"]),
    "switch": ("[initial]\nheading_deg = true", ["heading_deg = True"]),
    "sample": ('[tables.depth]\nkind = "imu"\nsample = "meen"', ["[tables.depth] sample = 'meen'", "mean, instant, increment"]),
    "sample of a depth": ('[tables.depth]\nsample = "mean"', ["[tables.depth] has 'sample'", "imu"]),
    "table without file": ('[tables.dept]\nkind = "depth"', ["[tables.dept]", "did you mean 'depth'?"]),
    "key of a table": ('[tables.depth]\nknd = "depth"', ["'knd'", "did you mean 'kind'?"]),
    "kind": ("[tables.depth]\nkind = 1", ["tables.depth.kind = 1"]),
    "clock": ('[clocks.depth]\nsource = "sun"', ["[clocks.depth] source = 'sun'", "device, host, pps"]),
    "clock without table": ('[clocks.dvl]\nsource = "host"', ["[clocks.dvl] has no table"]),
    "map": ('[datum]\nmap = "wgs84"', ["[datum] map = 'wgs84'", "surface, msl, lat, ellipsoid"]),
    "beacon": ("[beacons.b1]\nnorth_m = 1", ["[beacons.b1] has no position"]),
    "beacon key": ("[beacons.b1]\nnorth = 1", ["'north'", "did you mean 'north_m'?"]),
}


@pytest.mark.parametrize(("toml", "words"), WRONG_MANIFESTS.values(), ids=WRONG_MANIFESTS.keys())
def test_wrong_manifests_are_refused_in_one_line(tmp_path: Path, toml: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        read_log(folder(tmp_path, toml, depth=DEPTH))
    assert_says(caught.value, [str(tmp_path / "log.toml"), *words])


def test_missing_folder_and_manifest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere: is not a folder"):
        read_log(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"log\.toml: is missing"):
        read_log(tmp_path)


def test_increments_must_be_there_when_promised(tmp_path: Path) -> None:
    imu = "time_s,accel_x_mps2,accel_y_mps2,accel_z_mps2,gyro_x_radps,gyro_y_radps,gyro_z_radps\n0,0,0,-9.8,0,0,0\n"
    with pytest.raises(InputError, match=r"imu\.csv: has no increments.*delta_angle"):
        read_log(folder(tmp_path, '[tables.imu]\nsample = "increment"', imu=imu))


def test_a_file_in_another_encoding(tmp_path: Path) -> None:
    folder(tmp_path)
    (tmp_path / "acoustic_range.csv").write_bytes("time_s,transmitter,range_m\n0,Boje,1\n1,Bö,2\n".encode("latin-1"))
    with pytest.raises(InputError, match="UTF-8"):
        read_log(tmp_path)


def test_csv_and_parquet_of_one_name(tmp_path: Path) -> None:
    folder(tmp_path, depth=DEPTH)
    (tmp_path / "depth.parquet").write_bytes(b"")
    with pytest.raises(InputError, match=r"holds both depth\.csv and depth\.parquet"):
        read_log(tmp_path)


def test_parquet_of_other_types(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    folder(tmp_path)
    file = tmp_path / "depth.parquet"
    columns = {"time_s": pa.array([1, 2]), "depth_m": pa.array([None, 1.5], pa.float32()), "valid": [True, False]}
    parquet.write_table(pa.table(columns), file)
    table = read_log(tmp_path)["depth"]
    np.testing.assert_array_equal(table.depth, [np.nan, 1.5])
    np.testing.assert_array_equal(table.valid, [1.0, 0.0])
    parquet.write_table(pa.table(columns | {"time_s": pa.array([1, 2], pa.timestamp("ms"))}), file)
    with pytest.raises(InputError, match=r"depth\.parquet: column 'time_s' holds timestamp\[ms\].*seconds from the epoch"):
        read_log(tmp_path)
    file.write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"depth\.parquet: is not Parquet"):
        read_log(tmp_path)


def test_names_that_could_not_be_read_again_are_not_written(tmp_path: Path) -> None:
    depth = Depth(time=[0.0], depth=[1.0])
    with pytest.raises(InputError, match="cannot be the name of a table"):
        write_log(Log("x", {"../depth": depth}), tmp_path / "log")
    with pytest.raises(InputError, match="unknown unit suffix"):
        write_log(Log("x", {"depth": replace(depth, extra={"colour": np.array([1.0])})}), tmp_path / "log")
    assert not list(tmp_path.iterdir())


def test_writing_replaces_a_log_and_nothing_else(tmp_path: Path) -> None:
    log = Log("x", {"depth": Depth(time=[0.0], depth=[1.0])})
    write_log(log, tmp_path / "log")
    write_log(log, tmp_path / "log", parquet=True)
    assert sorted(file.name for file in (tmp_path / "log").iterdir()) == ["depth.parquet", "log.toml"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="mine"):
        write_log(log, tmp_path / "mine")
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"


def test_an_hour_at_100_hz_is_read_in_a_moment(tmp_path: Path) -> None:
    rows = 360_000
    values = np.random.default_rng(1).normal(size=(rows, 6)).round(6)
    imu = Imu(time=np.arange(rows) / 100, accel=values[:, :3], gyro=values[:, 3:])
    write_log(Log("long", {"imu": imu}), tmp_path / "log")
    start = time.perf_counter()
    assert len(read_log(tmp_path / "log")["imu"]) == rows
    assert time.perf_counter() - start < 2.0  # measured: 0.1 to 0.2 s; the limit leaves room for a busy machine


def test_recorded_logs() -> None:
    data = os.environ.get("LEADLINE_DATA")
    if not data:
        pytest.skip("LEADLINE_DATA does not name a folder of recorded logs")
    folders = sorted(path for path in (Path(data) / "logs").iterdir() if path.is_dir())
    assert folders
    for path in folders:
        log = read_log(path)
        assert not [f for f in inspect(log).findings if f.severity == "problem"], path.name


def test_dvl_and_gnss_in_the_units_of_the_inside(tmp_path: Path) -> None:
    dvl = "time_s,beam1_mps,beam2_mps,beam1_valid,beam2_valid,range1_m,range2_m,frame\n0,1,2,1,0,3,4,sensor\n"
    gnss = "time_s,latitude_deg,longitude_deg,sigma_m,fix_type\n0,90,-180,1,fixed\n"
    log = read_log(folder(tmp_path, dvl=dvl, gnss=gnss))
    a, b = log["dvl"], log["gnss"]
    assert isinstance(a, Dvl)
    assert isinstance(b, Gnss)
    assert (a.beam.tolist(), a.beam_valid.tolist(), a.range.tolist(), a.frame.tolist()) == ([[1, 2]], [[1, 0]], [[3, 4]], ["sensor"])
    assert (b.latitude[0], b.longitude[0], b.fix_type[0]) == (pytest.approx(np.pi / 2), pytest.approx(-np.pi), "fixed")
