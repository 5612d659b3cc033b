"""Keys of simulated instruments: whatever a file says of one is refused in a line that names the key, or simulates finite numbers."""

from __future__ import annotations

import tomllib
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from leadline import cli
from leadline.data.errors import InputError
from leadline.data.vehicle import vehicle_from_toml
from leadline.missions import equipment_keys as keys
from leadline.missions.equipment import CLASSES, carried, equip
from leadline.missions.mission import read_mission
from leadline.missions.simulation import Simulation, sailed
from leadline.simulate import instruments as simulated
from leadline.simulate.dive import Recorder
from leadline.simulate.drift import Drift
from leadline.simulate.faults_of_echoes import FalseLock, WildPings
from leadline.simulate.gyros import Triad

if TYPE_CHECKING:
    from leadline.data.records import Table
    from leadline.missions.mission import Mission

MISSION = """
name = "keys"
vehicle = "vehicle.toml"
hull = "rexrov"
epoch = 2025-06-01T08:00:00Z
duration_s = 12.0
[origin]
latitude_deg = 44.0
longitude_deg = 9.8
[start]
depth_m = 3.0
[sea]
sound_speed_mps = 1500.0
[sea.terrain.plane]
depth_m = 30.0
[plan]
speed_mps = 0.5
depth_m = 3.0
[[plan.legs]]
shape = "waypoints"
through_m = [[20.0, 5.0]]
[beacons]
one = { north_m = 60.0, east_m = 10.0, depth_m = 25.0, turnaround_s = 0.05 }
two = { north_m = -60.0, east_m = 10.0, depth_m = 15.0 }
three = { north_m = 0.0, east_m = 50.0, depth_m = 5.0 }
[platforms.ship]
through_m = [[30.0, 0.0]]
depth_m = 2.0
"""
VEHICLE = """
name = "keys-vehicle"
[sensors.imu]
preset = "fog-tactical"
rate_hz = 50.0
[sensors.dvl]
preset = "waterlinked-a50"
rate_hz = 2.0
[sensors.water_velocity]
sigma_mps = 0.01
rate_hz = 2.0
[sensors.acoustic_range]
path = "two_way"
sigma_m = 0.2
rate_hz = 1.0
[sensors.zero_velocity]
sigma_mps = 0.01
rate_hz = 1.0
[sensors.navigation]
rate_hz = 1.0
"""
ABOARD = tuple(tomllib.loads(VEHICLE)["sensors"])
BASE: dict[str, dict[str, Any]] = {"usbl_fix": {"receiver": "ship"}, "short_baseline": {}, "gnss": {"max_depth_m": 100.0}}
WRONG: tuple[Any, ...] = (
    "much", [1.0], [1.0] * 7, [[1.0, 2.0], [3.0]], [["north"]], [], {}, -1, -1.0, 0, 0.0, float("nan"), float("inf"), True, 10**400,
    1e9, "north",
)  # fmt: skip
SILENT = {("gnss", "max_depth_m")}  # without a fix there are no numbers


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    (tmp_path / "mission.toml").write_text(MISSION)
    return tmp_path


@pytest.fixture(scope="module")
def sea(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    folder = tmp_path_factory.mktemp("keys")
    (folder / "vehicle.toml").write_text(VEHICLE)
    (folder / "mission.toml").write_text(MISSION)
    return sailed(read_mission(folder / "mission.toml"))


def table_of(kind: str) -> dict[str, Any]:
    """The least that a mission says of an instrument of a kind."""
    if kind in ABOARD:
        return {}
    return {"kind": kind} | BASE.get(kind, {}) | ({} if kind == "short_baseline" else {"rate_hz": 2.0})


def recorded(simulation: Simulation, mission: Mission, name: str) -> Table:
    """What one instrument leaves of a voyage that is sailed already."""
    made = equip(mission, simulation.voyage)[name]
    return Recorder(simulation.voyage.trajectory(), {name: made}, epoch=mission.epoch).draw(1)[name]


def poor(table: Table) -> set[str]:
    """Names of columns of numbers that are not finite everywhere."""
    columns = {c.name: getattr(table, c.name) for c in table.columns() if not c.metadata["text"]}
    return {name for name, value in columns.items() if value is not None and not np.all(np.isfinite(value))}


def complaint(mission: Mission) -> str:
    """What is wrong with the instruments of a mission; nothing: they are aboard."""
    try:
        carried(mission)
    except InputError as error:
        return str(error)
    return ""


@cache
def places(kind: str) -> tuple[tuple[str, ...], ...]:
    """Each key of a kind, and each key of a table in it."""
    made = type(instrument_of(kind))
    own = {field.name: keys._default(field) for field in fields(made)}
    found: list[tuple[str, ...]] = []
    for name, unit in {**keys.EVERY, **keys.OF_KIND[kind]}.items():
        if name not in own:
            continue
        key = keys._key(name, unit, own[name])
        found.append((key,))
        if isinstance(own[name], Drift):
            found += [(key, f"{part}_{unit}" + ("_per_rts" if part == "walk" else "")) for part in keys.DRIFT] + [(key, "tau_s")]
        if isinstance(own[name], Triad):
            found += [(key, f"{part}_{of}") for part, of in {**keys.TRIAD, "quantum": unit, "limit": unit}.items()]
        if name == "reception":
            found += [(key, f"{part}_{of}" if of else part) for part, of in keys.RECEPTION.items()] + [(key, "stages")]
        if name == "sigmas":
            found.append((key, "fixed"))
    return (*found, *((name,) for name in ("beacons", "platforms", "transducers", "receivers_m") if name in (*own, "receivers_m")))


def instrument_of(kind: str) -> Any:
    if kind in ABOARD:
        from leadline.missions.instruments import instruments_of

        return instruments_of(vehicle_from_toml(VEHICLE))[kind]
    empty = {field.name: None for field in fields(CLASSES[kind]) if field.name in ("rate", "machinery", "profile", "depths", "seabed")}
    return CLASSES[kind](**empty)


@pytest.mark.parametrize("kind", sorted(keys.OF_KIND))
def test_a_key_is_refused_by_its_name_or_simulates_finite_numbers(sea: Simulation, kind: str) -> None:
    """Each key of each kind with each of some wrong values, and those of its tables."""
    plain = replace(sea.mission, instruments={kind: table_of(kind)})
    assert not poor(recorded(sea, plain, kind)) - {"error_velocity"}
    refused = 0
    for place in places(kind):
        for value in WRONG:
            raw = {place[0]: value if len(place) == 1 else {place[1]: value}}
            mission = replace(plain, instruments={kind: table_of(kind) | raw})
            said = complaint(mission)
            if said:
                refused += 1
                near = isinstance(value, (float, int)) and not isinstance(value, bool)  # such may be wrong beside another key alone
                assert "\n" not in said
                assert said.startswith(f"{mission.path}: instruments.{kind}"), said
                assert near or value in ([], {}) or place[-1] in said, (place, value, said)
                continue
            if value == 1e9:  # as large as that only what was refused is of interest
                continue
            table = recorded(sea, mission, kind)
            assert (kind, place[0]) in SILENT or not poor(table), (place, value, poor(table))
    assert refused > len(places(kind))


def test_each_field_of_numbers_has_bounds_and_only_once() -> None:
    names = [name for text in keys.BOUNDS.values() for name in text.split()]
    assert len(names) == len(set(names))
    for kind in keys.OF_KIND:
        own = {field.name: keys._default(field) for field in fields(type(instrument_of(kind)))}
        for name in {**keys.EVERY, **keys.OF_KIND[kind]}:
            if name in own and not isinstance(own[name], (str, bool, Drift, Triad)) and name not in ("reception", "sigmas"):
                assert keys.span_of(name)


SAID = {
    "rate": ("dvl", {"rate_hz": 0.0}, "dvl.rate_hz: 0.0; 1e-05 to 2000"),
    "too fast": ("dvl", {"rate_hz": 1e9}, "dvl.rate_hz: 1000000000.0; 1e-05 to 2000"),
    "negative rate": ("dvl", {"rate_hz": -1}, "dvl.rate_hz: -1; 1e-05 to 2000"),
    "beacons": ("acoustic_range", {"beacons": 5}, "acoustic_range.beacons: 5; a list of names in quotes"),
    "nested": ("acoustic_range", {"beacons": [["north"]]}, "acoustic_range.beacons: [['north']]; a list of names"),
    "lever": ("dvl", {"lever_arm_m": [1, 2]}, "dvl.lever_arm_m: [1, 2]; a list of 3 numbers"),
    "swing": ("c", {"kind": "heading", "rate_hz": 1.0, "swing_deg": [1, 2]}, "c.swing_deg: [1, 2]; a list of 4 numbers"),
    "bias": ("d", {"kind": "depth", "rate_hz": 1, "bias": {"constant_m": [1, 2, 3]}}, "d.bias.constant_m: [1, 2, 3]; a list of 1 numbers"),
    "tilt": ("dvl", {"tilt_deg": 0}, "dvl.tilt_deg: 0; 1 to 89"),
    "sound": ("acoustic_range", {"sound_speed_mps": 0}, "acoustic_range.sound_speed_mps: 0; 1000 to 2000"),
    "tau": ("dvl", {"bias": {"tau_s": 0}}, "dvl.bias.tau_s: 0; above 0"),
    "loss": ("dvl", {"loss": 2}, "dvl.loss: 2; 0 to 1"),
    "soft": ("m", {"kind": "magnetometer", "rate_hz": 1.0, "soft_iron": [[1, 0, 0]]}, "m.soft_iron: [[1, 0, 0]]; a list of 3 rows of 3"),
    "motors": ("m", {"kind": "magnetometer", "rate_hz": 1.0, "motor_coupling_ut": [[1]] * 3}, "motor_coupling_ut: has rows of 1; of 8"),
    "two beams": ("dvl", {"azimuths_deg": [0.0, 90.0]}, "dvl.azimuths_deg: 2 beams, 2 of them apart; three or more"),
    "one direction": ("dvl", {"azimuths_deg": [0.0, 360.0, 90.0]}, "dvl.azimuths_deg: 3 beams, 2 of them apart"),
    "kind": ("dvl", {"kind": "gnss", "rate_hz": 1.0}, "dvl.kind: 'gnss', and the vehicle file has a dvl of that name; dvl, or"),
    "word": ("imu", {"sample": "median"}, "imu.sample: 'median'; one of mean, instant, increment"),
    "alone": ("u", {"kind": "usbl", "rate_hz": 1.0, "beacons": []}, "instruments.u: speaks with nobody; add [beacons.NAME]"),
    "no head": ("u", {"kind": "usbl_fix", "rate_hz": 1.0}, "instruments.u: has no 'receiver'"),
    "two transducers": ("s", {"kind": "short_baseline", "transducers": ["one", "two"]}, "s.transducers: has 2 transducers"),
    "stages": ("g", {"kind": "gnss", "rate_hz": 1, "reception": {"stages": [["best", 0]]}}, "instruments.g.reception: has the stages"),
}  # fmt: skip


@pytest.mark.parametrize("case", SAID)
def test_what_is_wrong_with_an_instrument_is_said_before_it_sails(sea: Simulation, case: str) -> None:
    name, raw, said = SAID[case]
    with pytest.raises(InputError) as caught:
        replace(sea.mission, instruments={name: raw}).voyage()
    assert said in str(caught.value)


def test_one_number_stands_for_all_axes_where_that_means_something(sea: Simulation) -> None:
    raw = {"imu": {"gyro_axes": {"scale_percent": 1.0}}, "a": {"kind": "attitude", "rate_hz": 1.0, "sigma_deg": 1.0}}
    found = carried(replace(sea.mission, instruments=raw))
    imu, attitude = found["imu"], found["a"]
    assert isinstance(imu, simulated.Imu)
    assert isinstance(attitude, simulated.Attitude)
    assert imu.gyro_axes.scale == pytest.approx((0.01,) * 3)
    assert attitude.sigma == pytest.approx((np.pi / 180,) * 3)


EDITS = {
    "no points": ("through_m = [[20.0, 5.0]]", "through_m = []", "through_m: []"),
    "no places": ("through_m = [[20.0, 5.0]]", "through_deg = []", "through_deg: []"),
    "no latitude": ("through_m = [[20.0, 5.0]]", "through_deg = [[95.0, 9.8]]", "through_deg[0]: [95.0, 9.8]; latitude -90 to 90"),
    "no circle": ('"waypoints"\nthrough_m = [[20.0, 5.0]]', '"circle"\nradius_m = 0.0', "radius_m: 0.0; 0.1 or more in size"),
    "no turns": ('"waypoints"\nthrough_m = [[20.0, 5.0]]', '"circle"\nradius_m = -5.0\nturns = 1e-9', "turns: 1e-09"),
    "no line": ('"waypoints"\nthrough_m = [[20.0, 5.0]]', '"square"\nlength_m = 1e-6', "length_m: 1e-06"),
    "too wavy": ('"waypoints"\nthrough_m = [[20.0, 5.0]]', '"sine"\nlength_m = 9\namplitude_m = 1\nwavelength_m = 0.1', "wavelength_m"),
    "no zone": ("08:00:00Z", "08:00:00", "give it with Z"),
    "seed": ("[sea.terrain", "[sea.waves]\nheight_m = 1.0\nperiod_s = 8.0\nseed = -1\n[sea.terrain", "sea.waves.seed: -1; 0 or more"),
    "too fine": ("[sea.terrain.plane]", "[sea.terrain.fractal]\nsigma_m = 1.0\nsize_m = 2e5\nstep_m = 1.0", "4999 of them"),
    "no fault there": ("[beacons]", '[[faults]]\nkind = "loss"\nfraction = 0.1\nsensor = "mag"\n[beacons]', "[0].sensor: 'mag' is no"),
}  # fmt: skip


@pytest.mark.parametrize("case", EDITS)
def test_a_mission_out_of_range_is_refused_in_one_line(folder: Path, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    old, new, said = EDITS[case]
    path = folder / "mission.toml"
    assert old in MISSION
    path.write_text(MISSION.replace(old, new))
    assert cli.run(["simulate", str(path), "--out", str(folder / "log")]) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line
    assert said in line


def test_faults_befall_what_the_mission_adds(folder: Path) -> None:
    """By name; with the mounting and beams, or the angles, that the mission gives it."""
    path = folder / "mission.toml"
    more = """
[instruments.log]
kind = "dvl"
rate_hz = 2.0
mounting_deg = [0.0, 0.0, 45.0]
azimuths_deg = [0.0, 120.0, 240.0]
tilt_deg = 25.0
[instruments.head]
kind = "usbl"
rate_hz = 1.0
[[faults]]
kind = "false_lock"
sensor = "log"
from_s = 2.0
[[faults]]
kind = "usbl_outliers"
fraction = 1.0
[[faults]]
kind = "sensor_dead"
sensor = "head"
from_s = 6.0
"""
    path.write_text(MISSION + more)
    mission = read_mission(path)
    lock, wild, _ = mission.faults
    assert isinstance(lock, FalseLock)
    assert isinstance(wild, WildPings)
    assert lock.mounting_bs == pytest.approx((0.0, 0.0, np.pi / 4))
    assert lock.tilt == pytest.approx(np.radians(25.0))
    assert wild.sensor == "head"
    simulation = sailed(mission)
    assert simulation.healthy(0)["head"].time[-1] > 10.0
    assert simulation.log(0)["head"].time[-1] < 7.0


@pytest.mark.parametrize(("stated", "density"), [("", None), ("density_kgpm3 = 1000.0", 1000.0)])
def test_the_density_of_the_sea_reaches_a_pressure_sensor_where_it_is_stated(folder: Path, stated: str, density: float | None) -> None:
    """1000 kg/m^3 weighs 1000 g per metre; unstated, the standard ocean, as the filter takes it."""
    path = folder / "mission.toml"
    path.write_text(MISSION.replace("[sea]\n", f"[sea]\n{stated}\n") + '[instruments.p]\nkind = "pressure"\nrate_hz = 1.0\n')
    mission = read_mission(path)
    found = carried(mission)["p"]
    assert isinstance(found, simulated.Pressure)
    assert found.density == density
    own = replace(mission, instruments={"p": {"kind": "pressure", "rate_hz": 1.0, "density_kgpm3": 1010.0}})
    assert carried(own)["p"].density == 1010.0  # type: ignore[attr-defined]


def test_sensors_that_are_not_simulated_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "vehicle.toml").write_text(VEHICLE + "[sensors.sonar]\nkind = 'swath'\n[sensors.mag]\nkind = 'magnetometer'\nrate_hz = 5.0\n")
    path = folder / "mission.toml"
    path.write_text(MISSION + "[instruments.mag]\nsigma_ut = 0.1\n")
    assert read_mission(path).not_simulated == ("sonar",)
    assert cli.run(["simulate", str(path), "--out", str(folder / "log")]) == 0
    assert "not simulated, for want of a table [instruments.NAME] in the mission: sonar" in " ".join(capsys.readouterr().out.split())


def test_a_value_of_a_prior_that_is_not_drawn_is_refused(folder: Path) -> None:
    text = VEHICLE.replace("rate_hz = 2.0\n", "rate_hz = 2.0\nnuisance.time = { value_s = 0.1, sigma_s = 0.1 }\n", 1)
    (folder / "vehicle.toml").write_text(text)
    with pytest.raises(InputError, match=r"sensors.dvl.nuisance.time: has the value \[0.1\]; a sigma alone"):
        read_mission(folder / "mission.toml")
