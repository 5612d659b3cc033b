"""Missions: every file that comes along sails; seeds mean what they say; a wrong file is refused in one line that names the key."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leadline import cli
from leadline.data.errors import InputError
from leadline.formats.chart import read_chart
from leadline.formats.folder import read_log
from leadline.missions.mission import read_mission
from leadline.missions.simulation import Simulation, sailed, simulate_folder

ROOT = Path(__file__).parent.parent / "missions"

MISSION = """
name = "short"
vehicle = "vehicle.toml"
hull = "rexrov"
epoch = 2025-06-01T08:00:00Z

[origin]
latitude_deg = 44.0
longitude_deg = 9.8
geoid_undulation_m = 40.0

[start]
depth_m = 3.0
heading_deg = 10.0

[sea]
sound = [{ depth_m = 0.0, speed_mps = 1520.0 }, { depth_m = 40.0, speed_mps = 1505.0 }]
[sea.current]
north_mps = 0.05
east_mps = -0.02
[sea.terrain.plane]
depth_m = 30.0

[plan]
speed_mps = 0.5
depth_m = 5.0
[[plan.legs]]
shape = "waypoints"
through_m = [[20.0, 5.0]]

[beacons.one]
north_m = 60.0
east_m = 10.0
depth_m = 25.0
turnaround_s = 0.05

[platforms.ship]
through_m = [[30.0, 0.0], [0.0, 30.0]]
speed_mps = 0.5
depth_m = 2.0
roll_deg = 2.0

[instruments.dvl]
loss = 0.1
bias = { turn_on_mps = 0.01 }
"""
MORE = """
[instruments.swath]
kind = "swath"
rate_hz = 1.0
beams = 16
sigma_m = 0.05
[instruments.thrusters]
kind = "thruster"
rate_hz = 5.0
[instruments.motors]
kind = "motor_current"
rate_hz = 5.0
[instruments.mag]
kind = "magnetometer"
rate_hz = 10.0
hard_iron_ut = [1.0, 2.0, 3.0]
sigma_ut = 0.1
motor_coupling_ut = [[0.1, 0, 0, 0, 0, 0, 0, 0], [0, 0.1, 0, 0, 0, 0, 0, 0], [0, 0, 0.1, 0, 0, 0, 0, 0]]
[instruments.inverted]
kind = "usbl"
rate_hz = 0.5
beacons = ["one"]
[instruments.ship-usbl]
kind = "usbl_fix"
rate_hz = 0.2
receiver = "ship"
sigma_angle_deg = 0.5
[instruments.ship-pose]
kind = "platform"
rate_hz = 1.0
sigma_m = 1.0
[instruments.buoy]
kind = "acoustic_range"
rate_hz = 0.5
path = "one_way"
beacons = []
platforms = ["ship"]
[instruments.gauge]
kind = "water_level"
rate_hz = 0.1
[instruments.current]
kind = "water_current"
rate_hz = 0.5
[instruments.cast]
kind = "sound_speed_profile"
rate_hz = 0.01
[instruments.svs]
kind = "sound_speed"
rate_hz = 0.5
"""
VEHICLE = """
name = "short-vehicle"
[sensors.imu]
preset = "fog-tactical"
rate_hz = 50.0
[sensors.dvl]
preset = "waterlinked-a50"
rate_hz = 4.0
simulated = { range_max_m = 50.0 }
[sensors.depth]
sigma_m = 0.02
rate_hz = 5.0
[sensors.heading]
sigma_deg = 0.5
rate_hz = 5.0
reference = "magnetic"
declination = "wmm"
[sensors.ranges]
kind = "acoustic_range"
path = "two_way"
sigma_m = 0.2
rate_hz = 0.5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    (tmp_path / "mission.toml").write_text(MISSION + MORE)
    return tmp_path


def edited(folder: Path, old: str, new: str) -> Path:
    text = (folder / "mission.toml").read_text()
    assert text.count(old) >= 1, old
    (folder / "mission.toml").write_text(text.replace(old, new, 1))
    return folder / "mission.toml"


@pytest.fixture(scope="module")
def sim(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    place = tmp_path_factory.mktemp("mission")
    (place / "vehicle.toml").write_text(VEHICLE)
    (place / "mission.toml").write_text(MISSION + MORE)
    return sailed(read_mission(place / "mission.toml"))


def same(a: Any, b: Any) -> bool:
    return all(
        np.array_equal(getattr(a, c.name), getattr(b, c.name), equal_nan=not c.metadata["text"])
        for c in a.columns()
        if getattr(a, c.name) is not None or getattr(b, c.name) is not None
    )


def test_every_instrument_leaves_its_table(sim: Simulation) -> None:
    log = sim.log(0)
    kinds = {name: table.kind for name, table in log.tables.items()}
    assert kinds == {
        "imu": "imu", "dvl": "dvl", "depth": "depth", "heading": "heading", "ranges": "acoustic_range", "swath": "swath",
        "thrusters": "thruster", "motors": "motor_current", "mag": "magnetometer", "inverted": "usbl", "ship-usbl": "position_fix",
        "ship-pose": "platform", "buoy": "acoustic_range", "gauge": "water_level", "current": "water_current",
        "cast": "sound_speed_profile", "svs": "sound_speed", "truth": "truth",
    }  # fmt: skip
    assert all(len(table) for table in log.tables.values())
    assert set(log.beacons) == {"one"}
    assert log.vehicle == "short-vehicle"


def test_what_was_seen_fits_the_truth(sim: Simulation) -> None:
    """Tables against truth by the definition of each, to a few sigmas: what looks at what, not how well."""
    log = sim.log(0)
    truth = log.truth
    assert truth is not None
    assert truth.depth is not None
    gone = np.array([log["current"].current]).reshape(-1, 2)
    assert gone == pytest.approx(np.tile([0.05, -0.02], (len(gone), 1)))
    bed = np.interp(log["dvl"].time, truth.time, 30.0 - truth.depth)
    seen = np.isfinite(log["dvl"].altitude)
    assert log["dvl"].altitude[seen] == pytest.approx(bed[seen], abs=0.5)
    sound = np.interp(np.interp(log["svs"].time, truth.time, truth.depth), [0.0, 40.0], [1520.0, 1505.0])
    assert log["svs"].sound_speed == pytest.approx(sound, abs=0.01)
    assert 0.05 < 1 - len(log["dvl"]) / (4 * truth.time[-1]) < 0.15  # a tenth never arrives


def test_a_seed_is_a_log_to_the_bit(sim: Simulation) -> None:
    first, again, other = sim.log(3), sailed(sim.mission).log(3), sim.log(4)
    for name, table in first.tables.items():
        assert same(table, again[name]), name
    assert same(first["truth"], other["truth"])  # the loop is closed on truth: another seed changes noise alone
    for name in ("imu", "dvl", "depth", "heading", "ranges", "swath", "mag"):
        assert not same(first[name], other[name]), name


def test_a_stream_depends_on_nothing_else(folder: Path) -> None:
    """What one instrument draws does not change when another is taken off, nor with the order in the file."""
    full = sailed(read_mission(folder / "mission.toml")).log(2)
    text = (folder / "mission.toml").read_text()
    blocks = re.split(r"(?=^\[instruments\.)", text, flags=re.MULTILINE)
    (folder / "mission.toml").write_text(blocks[0] + "".join(reversed([b for b in blocks[1:] if not b.startswith("[instruments.swath]")])))
    fewer = sailed(read_mission(folder / "mission.toml")).log(2)
    assert "swath" not in fewer.tables
    for name, table in fewer.tables.items():
        assert same(table, full[name]), name


def test_a_folder_is_written_and_read_back(folder: Path) -> None:
    out = folder / "log"
    _, log = simulate_folder(folder / "mission.toml", out, 1)
    back = read_log(out)
    assert {name: len(table) for name, table in back.tables.items()} == {name: len(table) for name, table in log.tables.items()}
    assert read_chart(out / "chart.asc").depth_at(10.0, 5.0) == pytest.approx(30.0)
    simulate_folder(folder / "mission.toml", out, 1)  # once more: what Leadline wrote it may replace


def test_the_command(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["simulate", str(folder / "mission.toml"), "--out", str(folder / "log"), "--seed", "5"]
    assert cli.run([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["mission"], found["seed"], found["hull"]) == ("short", 5, "RexROV")
    assert found["tables"]["dvl"]["rows"] > 100
    assert found["distance_m"] == pytest.approx(20.0, abs=5.0)
    assert cli.run([*arguments, "--csv"]) == 0
    assert "RexROV with the instruments of short-vehicle" in capsys.readouterr().out
    assert (folder / "log" / "imu.csv").exists()
    assert not (folder / "log" / "imu.parquet").exists()


WRONG = {
    "no TOML": ('name = "short"', "name = ", r"is not TOML"),
    "unknown key": ("[plan]\n", "[plan]\nspeed_kn = 3.0\n", r"toml: plan: unknown key 'speed_kn' \(3.0\); did you mean 'speed_mps'"),
    "missing": ('hull = "rexrov"\n', "", r"mission.toml: has no 'hull'; give it"),
    "no hull": ('hull = "rexrov"', 'hull = "rexrof"', r"rexrof: .*did you mean 'rexrov'"),
    "no vehicle": ('"vehicle.toml"', '"vehicel.toml"', r"vehicel.toml: cannot be read"),
    "shape": ('shape = "waypoints"', 'shape = "waypoint"', r"plan.legs\[0\].shape: 'waypoint' is not known; did you mean 'waypoints'"),
    "no points": ("through_m = [[20.0, 5.0]]", "", r"plan.legs\[0\]: has no points; give through_m"),
    "both ways": ("through_m = [[20.0, 5.0]]", "through_m = [[2.0, 5.0]]\nthrough_deg = [[44.0, 9.8]]", r"has its points twice"),
    "wrong pair": ("[[20.0, 5.0]]", "[[20.0]]", r"plan.legs\[0\].through_m\[0\]: \[20.0\]; at least 2"),
    "no speed": ("speed_mps = 0.5\ndepth_m = 5.0", "depth_m = 5.0", r"plan.legs\[0\]: has no 'speed_mps', nor has \[plan\]"),
    "no depth": ("depth_m = 5.0\n[[plan", "[[plan", r"has neither a depth nor an altitude"),
    "latitude": ("latitude_deg = 44.0", "latitude_deg = 94.0", r"origin.latitude_deg: 94.0; 90 or less"),
    "current twice": ("east_mps = -0.02", "profile = [{ depth_m = 0.0, north_mps = 1.0, east_mps = 0.0 }]", r"sea.current: has north_mps"),
    "two grounds": ("[sea.terrain.plane]", "[sea.terrain]\nchart = 'x.asc'\n[sea.terrain.plane]", r"has chart and plane; give one"),
    "no chart": ("[sea.terrain.plane]\ndepth_m = 30.0", "[sea.terrain]\nchart = 'none.asc'", r"none.asc"),
    "field": ("loss = 0.1", "losses = 0.1", r"instruments.dvl.losses: is no key of an instrument of kind 'dvl'; did you mean 'loss'"),
    "unit": ("loss = 0.1", "range_max = 9.0", r"did you mean 'range_max_m'"),
    "type": ("loss = 0.1", "loss = 'much'", r"instruments.dvl.loss: 'much'; a finite number"),
    "drift": ("turn_on_mps = 0.01", "turn_on = 0.01", r"instruments.dvl.bias.turn_on: is not known; did you mean 'turn_on_mps'"),
    "kind": ('kind = "swath"', 'kind = "swaths"', r"instruments.swath: the kind 'swaths' is not known; did you mean 'swath'"),
    "no kind": ('kind = "swath"\n', "", r"instruments.swath: has no 'kind', and the vehicle file has no such sensor"),
    "no rate": ('kind = "thruster"\nrate_hz = 5.0', 'kind = "thruster"', r"instruments.thrusters: has no 'rate_hz'; give it"),
    "no beacon": ('beacons = ["one"]', 'beacons = ["two"]', r"instruments.inverted.beacons: 'two' is not known"),
    "no ship": ('receiver = "ship"', 'receiver = "shop"', r"instruments.ship-usbl.receiver: 'shop' is no platform; did you mean 'ship'"),
    "fault": ("[beacons.one]", '[[faults]]\nkind = "dvl_los"\n[beacons.one]', r"faults\[0\].kind: .*did you mean 'dvl_loss'"),
    "epoch": ("2025-06-01T08:00:00Z", '"today"', r"epoch: 'today'"),
    "through the ground": ("depth_m = 5.0\n[[plan", "depth_m = 45.0\n[[plan", r"where the ground lies at 30.0 m; a lesser depth"),
    "too fast": ("speed_mps = 0.5\ndepth_m = 5.0", "speed_mps = 5.0\ndepth_m = 5.0", r"plan: asks for 5.0 m/s, and RexROV makes"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_refused_in_one_line(folder: Path, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    old, new, said = WRONG[case]
    path = edited(folder, old, new)
    assert cli.run(["simulate", str(path), "--out", str(folder / "log")]) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line
    assert re.search(said, line), line
    assert not (folder / "log").exists()


def test_a_mission_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_mission(tmp_path / "none.toml")


MISSIONS = [path for path in sorted(ROOT.rglob("*.toml")) if path.parent.name != "vehicles"]


@pytest.mark.parametrize("path", MISSIONS, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_mission_that_comes_along_can_be_read(path: Path) -> None:
    mission = read_mission(path)
    mission.voyage()  # whose hull can follow its plan
    assert mission.note or path.parent.name != "papers"


def test_hydrophones_on_the_body_hear_a_difference(folder: Path) -> None:
    """A beacon dead ahead: the aft hydrophone hears it later by the length between them."""
    keys = '[instruments.pair]\nkind = "acoustic_range"\nrate_hz = 1.0\npath = "difference"\nreference = "fore"\n'
    arms = "receivers_m = { fore = [1.0, 0, 0], aft = [-1.0, 0, 0] }\n"
    edited(folder, "[instruments.swath]", keys + arms + "[instruments.swath]")
    edited(folder, "sound = [", "sound_speed_mps = 1500.0\n# sound = [")
    for name in ("cast", "svs"):
        text = (folder / "mission.toml").read_text()
        (folder / "mission.toml").write_text(re.sub(rf"\[instruments\.{name}\][^\[]*", "", text))
    edited(folder, "depth_m = 25.0\nturnaround_s", "depth_m = 5.0\nturnaround_s")
    table = sailed(read_mission(folder / "mission.toml")).log(0)["pair"]
    late = table.travel_time[-5:]  # heading for the beacon's side by then
    assert np.all(late > 0)
    assert np.all(late < 2.0 / 1500.0)


def test_what_is_not_aboard_leaves_nothing(folder: Path) -> None:
    edited(folder, "[instruments.swath]", "[instruments.ranges]\naboard = false\n[instruments.swath]")
    assert "ranges" not in sailed(read_mission(folder / "mission.toml")).log(0).tables


def test_a_doppler_log_reckons_with_its_own_speed_of_sound_where_it_is_said_to(folder: Path) -> None:
    """c_0 / c: in water of 1515 m/s one that reckons with 1400 shows velocities too small by 7.6 %."""
    plain = sailed(read_mission(folder / "mission.toml"))
    told = sailed(read_mission(edited(folder, "loss = 0.1", "sound_speed_mps = 1400.0")))
    speeds = [np.nanmedian(np.linalg.norm(s.recorder.ideal("dvl").velocity, axis=1)[-20:]) for s in (plain, told)]
    depth = plain.log(0).truth.depth[-1]  # type: ignore[union-attr, index]
    assert speeds[1] / speeds[0] == pytest.approx(1400.0 / np.interp(depth, [0.0, 40.0], [1520.0, 1505.0]), rel=0.02)


def test_a_recorded_log_is_never_replaced_by_a_simulated_one(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    real = folder / "real"
    real.mkdir()
    (real / "log.toml").write_text('name = "a dive that cannot be dived again"\n')
    (real / "depth.csv").write_text("time_s,depth_m\n0,1\n1,2\n")
    assert cli.run(["simulate", str(folder / "mission.toml"), "--out", str(real)]) == 2
    assert "holds no mission.toml" in capsys.readouterr().err
    assert (real / "depth.csv").read_text().startswith("time_s")


def test_a_log_can_be_simulated_again_from_its_own_folder(folder: Path) -> None:
    _, log = simulate_folder(folder / "mission.toml", folder / "first", 2)
    _, again = simulate_folder(folder / "first" / "mission.toml", folder / "second", 2)
    assert all(same(table, again[name]) for name, table in log.tables.items())
