"""The command line from outside: what it prints and writes, its exit codes, and that trouble leaves one line and no half of a folder."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from leadline import __version__, cli, read_log, read_solution, write_log
from leadline.data.records import Depth, Speed
from leadline.simulate.dive import simulate
from leadline.simulate.instruments import Depth as DepthSensor
from leadline.simulate.instruments import Dvl, Gnss, Heading, Imu
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from leadline.data.log import Log

VEHICLE = """\
name = "small"
[sensors.imu]
preset = "fog-tactical"
rate_hz = 50.0
[sensors.dvl]
sigma_mps = 0.01
[sensors.depth]
sigma_m = 0.02
[sensors.heading]
sigma_deg = 0.5
[sensors.gnss]
sigma_m = 1.0
"""
INSTRUMENTS = {
    "imu": Imu(rate=50.0, gyro_density=6e-6, accel_density=1e-3),
    "dvl": Dvl(rate=2.0, sigma=0.01),
    "depth": DepthSensor(rate=2.0, sigma=0.02),
    "heading": Heading(rate=2.0, sigma=radians(0.5)),
    "gnss": Gnss(rate=1.0, sigma=(1.0, 1.0, 2.0), stop=20.0, max_depth=0.0),
}
SECONDS = 60.0
ROWS = {"imu": 3001, "dvl": 121, "depth": 121, "heading": 121}


@pytest.fixture(scope="module")
def small() -> Log:
    plan = Lawnmower(legs=1, length=200.0, speed=1.5, surface_time=20.0, dive=12.0)
    trajectory = survey(Place(radians(32.8), radians(34.9), depth=0.3), plan, duration=SECONDS)
    return simulate(trajectory, INSTRUMENTS, seed=1, name="small")


class Desk:
    """A folder with a log and a vehicle file, in which commands run; it knows what lies there."""

    def __init__(self, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.place, self.capsys = place, capsys
        self.log, self.vehicle, self.out = place / "log", place / "vehicle.toml", place / "solution"

    def run(self, *arguments: object) -> tuple[int, str, str]:
        self.capsys.readouterr()
        code = cli.run([str(a) for a in arguments])
        return code, *self.capsys.readouterr()

    def solve(self, *more: object) -> tuple[int, str, str]:
        return self.run("solve", self.log, "--vehicle", self.vehicle, "--out", self.out, "--no-report", *more)

    def summary(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.out / "summary.json").read_text())
        return found

    def edit(self, name: str, change: Callable[[str], str]) -> None:
        file = self.place / name
        file.write_text(change(file.read_text()))

    def refused(self, result: tuple[int, str, str], *words: str, code: int = 2) -> str:
        """One line on standard error that holds the words; nothing written."""
        found, out, err = result
        assert (found, out) == (code, ""), err
        assert err.count("\n") == 1, err
        assert err.startswith("leadline: ")
        assert "Traceback" not in err
        for word in words:
            assert word in err
        self.nothing_written()
        return err

    def nothing_written(self) -> None:
        assert {entry.name for entry in self.place.iterdir()} <= {"log", "vehicle.toml"}


@pytest.fixture(scope="module")
def files(small: Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("small")
    write_log(small, place / "log")
    (place / "vehicle.toml").write_text(VEHICLE)
    return place


@pytest.fixture
def desk(files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Desk:
    """A fresh copy, free to be spoiled."""
    place = tmp_path / "desk"
    shutil.copytree(files, place)
    return Desk(place, capsys)


@pytest.fixture(scope="module")
def solved(files: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A solution with its report."""
    out = tmp_path_factory.mktemp("solved") / "solution"
    assert cli.run(["solve", str(files / "log"), "--vehicle", str(files / "vehicle.toml"), "--out", str(out)]) == 0
    return out


# ---- what is right


def test_solve_writes_a_whole_folder_that_opens_again(solved: Path) -> None:
    names = {"solution.parquet", "covariance.parquet", "innovations.parquet", "states.toml", "summary.json", "report.html"}
    assert {file.name for file in solved.iterdir()} == names
    solution = read_solution(solved)
    assert len(solution) == round(SECONDS * 10) + 1
    assert [entry.name for entry in solved.parent.iterdir()] == ["solution"]


def test_solve_says_the_verdict_and_where_the_solution_is(desk: Desk) -> None:
    code, out, err = desk.solve()
    assert (code, err) == (0, "")
    assert str(desk.out) in out
    assert "report" not in out.splitlines()[-1]
    summary = desk.summary()
    for name, rows in ROWS.items():
        assert sum(summary["counts"][name].values()) == rows
    assert set(summary["inputs"]) == {str(f) for f in [*desk.log.iterdir(), desk.vehicle]}
    assert set(summary["verdict"]) == {"answer", "sentence"}


def test_json_is_all_there_is_on_standard_output(desk: Desk, solved: Path) -> None:
    code, out, err = desk.solve("--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["counts"] == desk.summary()["counts"]
    assert {"verdict", "errors", "misclosures"} <= json.loads(out)["assessment"].keys()
    for arguments in (["inspect", desk.log, "--json"], ["assess", solved, "--truth", desk.log, "--json"]):
        code, out, err = desk.run(*arguments)
        assert (code, err) == (0, "")
        assert json.loads(out)


def test_options_of_solve_change_what_is_written(desk: Desk) -> None:
    assert desk.solve("--csv", "--rate", "2")[0] == 0
    assert "report.html" not in os.listdir(desk.out)
    assert len((desk.out / "solution.csv").read_text().splitlines()) == 1 + round(SECONDS * 2) + 1
    coarse = read_solution(desk.out)
    assert desk.solve("--rate", "10")[0] == 0  # a solution may be replaced by the next one
    fine = read_solution(desk.out)
    np.testing.assert_allclose(fine.latitude[::5], coarse.latitude, rtol=0, atol=1e-15)


def test_only_and_without_leave_sensors_out(desk: Desk) -> None:
    assert desk.solve("--only", "dvl, depth")[0] == 0
    only = desk.summary()["counts"]
    assert desk.solve("--without", "heading,gnss")[0] == 0
    assert desk.summary()["counts"] == only
    assert "used" in only["dvl"]
    assert only["heading"] == {"excluded": ROWS["heading"]}
    assert "used" in only["imu"]


def test_inspect_and_assess_speak_to_a_person(desk: Desk, solved: Path) -> None:
    code, out, err = desk.run("inspect", desk.log)
    assert (code, err) == (0, "")
    assert all(name in out for name in INSTRUMENTS)
    code, out, err = desk.run("assess", solved)
    assert (code, err) == (0, "")
    with_truth = desk.run("assess", solved, "--truth", desk.log)[1]
    assert len(with_truth) > len(out) > 0


def test_a_new_vehicle_file_can_be_checked_and_used_at_once(desk: Desk) -> None:
    assert desk.run("vehicle", "new")[:1] == (0,)
    new = desk.place / "new.toml"
    code, out, err = desk.run("vehicle", "new", desk.log, "--out", new)
    assert (code, out, err) == (0, "", "")
    assert "[sensors.dvl]" in new.read_text()
    code, out, err = desk.run("vehicle", "check", new, "--log", desk.log)
    assert (code, err) == (0, "")
    assert "dvl" in out
    desk.vehicle = new
    assert desk.solve()[0] == 0
    code, out, err = desk.run("vehicle", "new", desk.log, "--out", new)
    assert (code, out) == (2, "")
    assert "is there already" in err


def test_version_and_help(desk: Desk) -> None:
    assert desk.run("--version") == (0, f"{__version__}\n", "")
    for arguments in ([], ["--help"], ["solve", "--help"], ["vehicle", "--help"], ["vehicle", "check", "--help"]):
        code, out, err = desk.run(*arguments)
        assert (code, err) == (0, "")
        assert "Usage" in out


# ---- trouble at sea is an outcome, not an error


def test_a_table_that_the_vehicle_does_not_name_is_counted(desk: Desk, small: Log) -> None:
    write_log(replace(small, tables={**small.tables, "log_speed": Speed(time=[1.0, 2.0], speed=[1.5, 1.5])}), desk.log)
    assert desk.solve()[0] == 0
    assert desk.summary()["counts"]["log_speed"] == {"not_configured": 2}


@pytest.mark.parametrize("known", ["sequence", "received", "told"])
def test_a_clock_that_jumps_back_is_counted(desk: Desk, small: Log, known: str) -> None:
    """Ten rows fifteen seconds back: each steps back, or where arrivals are known, four after each of two steps are set aside."""
    depth = small["depth"]
    time = depth.time.copy()
    time[60:70] -= 15.0
    order = {"sequence": np.arange(len(time), dtype=float)} if known == "sequence" else {"received": depth.time + 0.01}
    write_log(replace(small, tables={**small.tables, "depth": replace(depth, time=time, **order)}), desk.log)
    if known == "told":
        text = desk.vehicle.read_text().replace("[sensors.depth]", "[sensors.depth]\nmend_clock = false")
        desk.vehicle.write_text(text)
    assert desk.solve()[0] == 0
    counts = desk.summary()["counts"]["depth"]
    assert counts["clock_jump"] == (8 if known == "received" else 10)
    assert sum(counts.values()) == ROWS["depth"]
    assert len(desk.summary().get("clock_steps", [])) == (0 if known == "sequence" else 2)


def test_rows_that_are_no_numbers_are_counted(desk: Desk, small: Log) -> None:
    depth, imu = small["depth"], small["imu"]
    assert isinstance(depth, Depth)
    values, gyro = depth.depth.copy(), imu.gyro.copy()  # type: ignore[attr-defined]
    values[10:14], gyro[500:503] = np.nan, np.nan
    tables = {**small.tables, "depth": replace(depth, depth=values), "imu": replace(imu, gyro=gyro)}  # type: ignore[call-arg]
    write_log(replace(small, tables=tables), desk.log)
    assert desk.solve()[0] == 0
    counts = desk.summary()["counts"]
    assert counts["depth"]["invalid"] == 4
    assert counts["imu"] == {"used": ROWS["imu"] - 3, "invalid": 3}


def test_a_sensor_without_a_row_is_no_error(desk: Desk) -> None:
    desk.edit("log/heading.csv", lambda text: text.splitlines()[0] + "\n")
    code, _, err = desk.solve()
    assert code == 0, err
    assert desk.summary()["counts"]["heading"] == {}


def test_rows_outside_the_run_are_counted(desk: Desk) -> None:
    desk.edit("log/log.toml", lambda text: re.sub(r"time_s = .*", "time_s = 10.0", text))
    assert desk.solve()[0] == 0
    assert desk.summary()["counts"]["depth"]["outside_run"] == 20


# ---- wrong input: exit code 2, one line, nothing written


def test_missing_places(desk: Desk) -> None:
    nowhere = desk.place / "nowhere"
    for command in (["inspect", nowhere], ["assess", nowhere], ["vehicle", "new", nowhere], ["vehicle", "check", nowhere]):
        desk.refused(desk.run(*command), str(nowhere))
    desk.refused(desk.run("solve", nowhere, "--vehicle", desk.vehicle, "--out", desk.out), str(nowhere))
    desk.refused(desk.run("solve", desk.log, "--vehicle", nowhere, "--out", desk.out), str(nowhere), "vehicle")
    (desk.log / "log.toml").unlink()
    desk.refused(desk.solve(), "log.toml", "is missing")


def _without_column(name: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = [line.split(",") for line in text.splitlines()]
        place = rows[0].index(name)
        return "\n".join(",".join(row[:place] + row[place + 1 :]) for row in rows) + "\n"

    return change


def _cell(line: int, column: int, cell: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        lines = text.splitlines()
        cells = lines[line - 1].split(",")
        cells[column] = cell
        lines[line - 1] = ",".join(cells)
        return "\n".join(lines) + "\n"

    return change


def _first_lines(count: int) -> Callable[[str], str]:
    return lambda text: "\n".join(text.splitlines()[:count]) + "\n"


WRONG_TABLES = [
    ("depth", _without_column("depth_m"), ["depth.csv", "depth_m"]),
    ("depth", _without_column("time_s"), ["depth.csv", "time_s"]),
    ("imu", _without_column("gyro_y_radps"), ["imu.csv", "gyro_y_radps"]),
    ("dvl", lambda text: text.replace("velocity_x_mps", "velocity_x_knots"), ["dvl.csv", "velocity_x_knots"]),
    (
        "depth",
        lambda text: text.replace("depth_m", "depth_m,water_depth_fathom").replace("\n", ",1.0\n", 1),
        ["water_depth_fathom", "unit"],
    ),
    ("depth", _cell(7, 1, "deep"), ["depth.csv, line 7", "depth_m", "'deep'"]),
    ("imu", _cell(2000, 3, "1.0.0"), ["imu.csv, line 2000", "'1.0.0'"]),
    ("depth", lambda text: text + "1.0\n", ["depth.csv, line 123", "1 cells"]),
    ("depth", lambda text: text.replace(",", ";"), ["depth.csv, line 1", "commas"]),
]


@pytest.mark.parametrize(("table", "change", "words"), WRONG_TABLES)
def test_a_table_that_is_wrong(desk: Desk, table: str, change: Callable[[str], str], words: list[str]) -> None:
    desk.edit(f"log/{table}.csv", change)
    desk.refused(desk.solve(), *words)
    desk.refused(desk.run("inspect", desk.log), *words)


def test_an_empty_log(desk: Desk) -> None:
    for file in desk.log.glob("*.csv"):
        file.write_text(_first_lines(1)(file.read_text()))
    desk.refused(desk.solve(), "no table has a row")
    for file in desk.log.glob("*.csv"):
        file.unlink()
    desk.edit("log/log.toml", lambda text: 'name = "empty"\n')
    desk.refused(desk.solve(), "no table")


@pytest.mark.parametrize("rows", [0, 1])
def test_a_log_with_no_interval_to_navigate_over(desk: Desk, rows: int) -> None:
    desk.edit("log/imu.csv", _first_lines(1 + rows))
    desk.refused(desk.solve(), "imu")


def test_a_log_of_one_row_in_each_table(desk: Desk) -> None:
    for file in desk.log.glob("*.csv"):
        file.write_text(_first_lines(2)(file.read_text()))
    desk.refused(desk.solve(), "imu", "two")


def test_a_sensor_that_the_log_lacks(desk: Desk) -> None:
    desk.edit("vehicle.toml", lambda text: text + "[sensors.usbl]\nkind = 'position_fix'\nsigma_m = 1.0\n")
    desk.refused(desk.solve(), "has no table 'usbl'")
    assert desk.run("vehicle", "check", desk.vehicle, "--log", desk.log)[0] == 0
    assert desk.solve("--without", "usbl")[0] == 0


WRONG_VEHICLES = [
    (("sigma_mps = 0.01", "sigma_mp = 0.01"), ["sensors.dvl", "sigma_mp'", "did you mean 'sigma_mps'"]),
    (("sigma_m = 0.02", "sigma_m = -0.02"), ["sensors.depth.sigma_m", "-0.02"]),
    (("[sensors.dvl]", "[sensors.dvl]\nmounting_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 2]]"), ["mounting_matrix", "no rotation"]),
    (("[sensors.dvl]", "[sensors.dvl]\nmounting_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]"), ["mounting_matrix", "no rotation"]),
    (("[sensors.dvl]", "[sensors.dvl]\nlever_arm_m = [1.0, 2.0]"), ["sensors.dvl.lever_arm_m"]),
    (("[sensors.dvl]", "[sensors.dvl]\nkind = 'dlv'"), ["did you mean 'dvl'"]),
    (("fog-tactical", "fog-tactica"), ["did you mean 'fog-tactical'"]),
    (("[sensors.imu]", "[sensors.imu"), ["vehicle.toml: line 2"]),
    (("[sensors.dvl]", "[sensors.dvl.nuisance]\nscal = { sigma_percent = 1.0 }\n[sensors.dvl]"), ["did you mean 'scale'"]),
    (("[sensors.dvl]", "[process]\nmodel = 'submarine'\n[sensors.dvl]"), ["process.model", "'submarine'"]),
    (("[sensors.dvl]", "[process]\nimu = 'ins'\n[sensors.dvl]"), ["process.imu", "'ins'"]),
    (("[sensors.dvl]", "[sensors.dvl]\nmodel = 'no.such:thing'"), ["sensors.dvl.model", "no.such:thing"]),
    (("rate_hz = 50.0", "rate_hz = 'fast'"), ["sensors.imu.rate_hz", "a number"]),
]


@pytest.mark.parametrize(("change", "words"), WRONG_VEHICLES)
def test_a_vehicle_file_that_is_wrong(desk: Desk, change: tuple[str, str], words: list[str]) -> None:
    desk.edit("vehicle.toml", lambda text: text.replace(*change, 1))
    desk.refused(desk.solve(), *words)


WRONG_OPTIONS = [
    (["--rate", "0"], ["rate", "positive"]),
    (["--rate", "-5"], ["rate", "positive"]),
    (["--rate", "nan"], ["rate"]),
    (["--rate", "inf"], ["rate"]),
    (["--rate", "often"], ["--rate"]),
    (["--until", "nan"], ["--until"]),
    (["--only", "dvll"], ["did you mean 'dvl'"]),
    (["--without", "sonar"], ["'sonar'"]),
    (["--without", "imu"], ["imu"]),
    (["--estimator", "ekg"], ["did you mean 'ekf'"]),
    (["--fast"], ["--fast"]),
    (["more"], ["more"]),
]


@pytest.mark.parametrize(("options", "words"), WRONG_OPTIONS)
def test_options_that_are_wrong(desk: Desk, options: list[str], words: list[str]) -> None:
    desk.refused(desk.solve(*options), *words)


def test_commands_that_are_wrong(desk: Desk, solved: Path, small: Log) -> None:
    desk.refused(desk.run("sovle", desk.log), "sovle")
    desk.refused(desk.run("solve"), "LOG")
    desk.refused(desk.run("solve", desk.log, "--out", desk.out), "--vehicle")
    desk.refused(desk.run("vehicle", "make"), "make")
    desk.refused(desk.run("assess", desk.log), "summary.json")
    write_log(small.without("truth"), desk.log)
    desk.refused(desk.run("assess", solved, "--truth", desk.log), "truth")


def test_a_start_that_cannot_be_had(desk: Desk, small: Log) -> None:
    nowhere = replace(small.initial, latitude=None, longitude=None)
    write_log(replace(small, initial=nowhere), desk.log)
    desk.refused(desk.solve("--without", "gnss"), "position", "latitude_deg")
    write_log(replace(small, initial=replace(small.initial, heading=None)), desk.log)
    desk.refused(desk.solve("--only", "depth"), "heading", "heading_deg")
    write_log(replace(small, initial=replace(small.initial, time=1000.0)), desk.log)
    desk.refused(desk.solve(), "time_s", "1000", "after the last")


def test_a_beacon_place_without_an_origin(desk: Desk, small: Log) -> None:
    nowhere = replace(small.initial, latitude=None, longitude=None, north=0.0, east=0.0)
    write_log(replace(small, initial=nowhere, origin=None), desk.log)
    desk.refused(desk.solve(), "origin")


# ---- the place of the output


def test_somebodys_folder_is_not_touched(desk: Desk, tmp_path: Path) -> None:
    desk.out = tmp_path / "thesis"
    desk.out.mkdir()
    (desk.out / "chapter.txt").write_text("years of work")
    desk.refused(desk.solve(), str(desk.out))
    assert [f.name for f in desk.out.iterdir()] == ["chapter.txt"]
    desk.out = desk.log
    desk.refused(desk.solve(), str(desk.log))
    assert read_log(desk.log)["imu"]


def test_a_snapshot_takes_the_place_of_a_snapshot_only(desk: Desk, tmp_path: Path) -> None:
    notes, snapshot = tmp_path / "elsewhere" / "notes.txt", tmp_path / "elsewhere" / "aboard.npz"
    notes.parent.mkdir()
    notes.write_text("mine")
    desk.refused(desk.solve("--as-live", "--until", "20", "--snapshot", notes), "--snapshot", "is there already")
    assert notes.read_text() == "mine"
    snapshot.write_bytes(b"older")
    assert desk.solve("--as-live", "--until", "20", "--snapshot", snapshot)[0] == 0
    assert snapshot.stat().st_size > 1000


def test_states_of_a_sensor_are_not_judged_by_truth_of_the_body(desk: Desk) -> None:
    assert desk.solve("--at", "dvl")[0] == 0
    code, out, err = desk.run("assess", desk.out, "--truth", desk.log)
    assert (code, out) == (2, "")
    assert "holds the states of 'dvl'" in err


def test_a_place_that_is_a_file_or_lies_in_one(desk: Desk) -> None:
    desk.out = desk.vehicle
    desk.refused(desk.solve(), "is a file")
    desk.out = desk.vehicle / "solution"
    desk.refused(desk.solve(), str(desk.out), "cannot be written")
    assert desk.vehicle.read_text() == VEHICLE


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES])
def test_a_place_that_may_not_be_written(desk: Desk, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refuse(*_: object, **__: object) -> str:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("leadline.formats.atomic.mkdtemp", refuse)
    desk.refused(desk.solve(), str(desk.out), os.strerror(number))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_folder_without_permission(desk: Desk) -> None:  # pragma: no cover
    desk.place.chmod(0o555)
    try:
        desk.refused(desk.solve(), "cannot be written")
    finally:
        desk.place.chmod(0o755)


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(
    "where", ["leadline.formats.solution._write_table", "pathlib.Path.write_text", "leadline.report.html.write_report"]
)
def test_a_full_disk(desk: Desk, monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    def fail(*_: object, **__: object) -> None:
        raise FULL

    monkeypatch.setattr(where, fail)
    desk.refused(desk.solve("--report"), str(desk.out), "No space left", "make room")


def test_a_full_disk_keeps_the_solution_that_was_there(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    assert desk.solve()[0] == 0
    before = {f.name: f.read_bytes() for f in desk.out.iterdir()}

    def fail(*_: object, **__: object) -> None:
        raise FULL

    with monkeypatch.context() as full:
        full.setattr("pathlib.Path.write_text", fail)
        code, _, err = desk.solve("--rate", "1")
    assert (code, err.count("\n")) == (2, 1)
    assert {f.name: f.read_bytes() for f in desk.out.iterdir()} == before
    assert {f.name for f in desk.place.iterdir()} == {"log", "vehicle.toml", "solution"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_standard_output_that_is_full(desk: Desk) -> None:
    with open("/dev/full", "w") as full:
        found = _leadline("inspect", desk.log, "--json", stdout=full)
    err = found.communicate(timeout=60)[1]
    assert found.returncode == 2, err
    assert err.count("\n") == 1


# ---- interruption, and our own faults


@pytest.mark.parametrize(
    "where", ["leadline.missions.dive.solve", "leadline.missions.dive.assess", "leadline.formats.solution._write_table"]
)
def test_an_interruption(desk: Desk, monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(where, stop)
    assert "interrupted" in desk.refused(desk.solve(), code=130)


def test_an_interruption_from_the_progress(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    from contextlib import contextmanager

    seen: list[float] = []

    def tell(fraction: float) -> None:
        seen.append(fraction)
        if fraction > 0.5:
            raise KeyboardInterrupt

    @contextmanager
    def progress(_: str) -> Iterator[Callable[[float], None]]:
        yield tell

    monkeypatch.setattr(cli, "_progress", progress)
    desk.refused(desk.solve(), code=130)
    assert seen == sorted(seen)
    assert 0.5 < seen[-1] <= 1.0


def _leadline(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    command = [sys.executable, "-m", "leadline.cli", *map(str, arguments)]
    return subprocess.Popen(command, **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options})


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("wait", [0.2, 1.2])
def test_ctrl_c(desk: Desk, small: Log, wait: float) -> None:
    """While modules are loaded, and while the work goes on."""
    copies, imu = 40, small["imu"]
    late = [replace(imu, time=imu.time + k * (SECONDS + 0.02)) for k in range(copies)]
    joined = {name: np.concatenate([getattr(table, name) for table in late]) for name in ("time", "accel", "gyro")}
    write_log(replace(small, tables={**small.tables, "imu": replace(imu, **joined)}), desk.log)
    command = [sys.executable, "-c", "from leadline import cli; print('ready', flush=True); cli.main()"]
    arguments = ["solve", desk.log, "--vehicle", desk.vehicle, "--out", desk.out, "--rate", "100"]
    found = subprocess.Popen([*command, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert found.stdout is not None
    assert found.stdout.readline() == "ready\n"
    time.sleep(wait)
    found.send_signal(signal.SIGINT)
    out, err = found.communicate(timeout=60)
    desk.refused((found.returncode, out, err), "interrupted", code=130)


def test_the_command_in_a_process_of_its_own(desk: Desk) -> None:
    found = _leadline("solve", desk.log, "--vehicle", desk.vehicle, "--out", desk.out, "--no-report", "--json")
    out, err = found.communicate(timeout=120)
    assert (found.returncode, err) == (0, "")
    assert json.loads(out)["log"] == "small"
    found = _leadline("solve", desk.log, "--vehicle", desk.place / "none.toml", "--out", desk.out)
    out, err = found.communicate(timeout=60)
    assert (found.returncode, out, err.count("\n")) == (2, "", 1)


def test_an_error_of_ours_leaves_its_traceback_in_a_file(desk: Desk, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("oh\nno")

    monkeypatch.setattr("leadline.missions.dive.assess", fail)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    err = desk.refused(desk.solve(), "our fault", "ZeroDivisionError", code=1)
    file = Path(err.split()[-1])
    assert "Traceback" in file.read_text()
    assert "ZeroDivisionError" in file.read_text()


def test_a_reader_that_goes_away_is_no_fault(desk: Desk, solved: Path) -> None:
    """As `leadline ... | head -1` does; with little output, and with more than a pipe's buffer."""
    for arguments in (["--version"], ["inspect", desk.log, "--json"], ["vehicle", "check", desk.vehicle]):
        found = _leadline(*arguments)
        assert found.stdout is not None
        found.stdout.close()
        found.stdout = None
        err = found.communicate(timeout=60)[1]
        assert (found.returncode, err) == (0, "")
