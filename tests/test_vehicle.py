"""The vehicle file: what it says is converted once and rightly, and what is wrong is named in one line."""

from __future__ import annotations

import math
import tomllib
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.records import (
    KINDS,
    AcousticRange,
    Attitude,
    Depth,
    Dvl,
    Gnss,
    Heading,
    Imu,
    Magnetometer,
    Other,
    PositionFix,
    Speed,
    Table,
    Truth,
    YawRate,
    ZeroVelocity,
)
from leadline.data.sensor_keys import BY_KIND
from leadline.data.vehicle import Vehicle, mounting_deg, presets, read_vehicle, si, vehicle_from_toml
from leadline.data.vehicle_keys import NUISANCES, OF_ALL, SHARED, check_prior
from leadline.data.vehicle_template import FIGURES, check, notes, rate_of, template
from leadline.report.vehicle import text

IMU = """\
name = "v"
[sensors.imu]
preset = "mems-tactical"
"""
DEGREE = math.pi / 180


def vehicle(more: str) -> Vehicle:
    return vehicle_from_toml(IMU + more)


# ---- what is right


PRESETS = [(name, kind) for name, entry in presets().items() for kind, keys in entry.items() if isinstance(keys, dict)]


@pytest.mark.parametrize(("name", "kind"), PRESETS)
def test_every_preset_is_a_sensor_of_each_of_its_kinds(name: str, kind: str) -> None:
    assert kind in KINDS
    sensor = vehicle(f'[sensors.a]\nkind = "{kind}"\npreset = "{name}"\n')["a"]
    assert (sensor.kind, sensor.preset) == (kind, name)
    for key, value in sensor.values.items():
        if key.startswith(("sigma", "gyro", "accel", "noise", "beam_sigma")) and not key.endswith("_process"):
            assert value > 0, key
    if kind != "imu":
        assert sensor.values["sigma" if kind != "yaw_rate" else "noise"] > 0
    else:
        assert "rate" not in sensor.values  # a wrong one would turn every interval into a gap
        assert sensor.values["gyro_bias_instability"] <= sensor.values["gyro_bias"]


@pytest.mark.parametrize("name", presets())
def test_every_preset_says_what_it_is_and_where_its_figures_are_from(name: str) -> None:
    entry = presets()[name]
    assert entry["title"]
    assert "figure" in entry["source"] or "estimated" in entry["source"]


@pytest.mark.parametrize(("name", "kind"), [p for p in PRESETS if p[1] == "dvl"])
def test_the_sigmas_of_a_preset_dvl_belong_together(name: str, kind: str) -> None:
    """Four beams, at 90 degrees to each other: velocity along x of two opposite beams is (b1 - b2) / (2 sin tilt)."""
    dvl = presets()[name][kind]
    expected = dvl["beam_sigma_mps"] / (math.sqrt(2) * math.sin(dvl["beam_tilt_deg"] * DEGREE))
    assert dvl["sigma_mps"] == pytest.approx(expected, rel=0.02)
    assert ("nuisance" in dvl) != dvl.get("phased_array", False)


@pytest.mark.parametrize(
    ("key", "value", "name", "expected"),
    [
        ("gyro_noise_deg_per_rth", 60.0, "gyro_noise", 0.017453292519943295),  # 1 deg/rts
        ("gyro_noise_deg_per_rth", 0.15, "gyro_noise", 4.3633231e-5),
        ("gyro_noise_degps_per_rthz", 0.03, "gyro_noise", 5.2359878e-4),  # the same as 1.8 deg/rth
        ("gyro_bias_deg_per_h", 15.041067, "gyro_bias", 7.2921159e-5),  # the Earth's rotation
        ("accel_noise_ug_per_rthz", 100.0, "accel_noise", 9.80665e-4),
        ("accel_noise_mps_per_rth", 0.06, "accel_noise", 1e-3),
        ("accel_bias_ug", 1000.0, "accel_bias", 9.80665e-3),
        ("sigma_percent", 0.2, "sigma", 0.002),
        ("walk_percent_per_rts", 0.2, "walk", 0.002),
        ("walk_deg_per_rts", 1.0, "walk", 0.017453292519943295),
        ("walk_m_per_rts", 0.1, "walk", 0.1),
        ("beam_azimuth_deg", [0.0, 90.0], "beam_azimuth", [0.0, 1.5707963267948966]),
        ("rate_hz", 5, "rate", 5.0),
        ("tau_h", 2.0, "tau", 7200.0),
        ("density_kgpm3", 1025.0, "density", 1025.0),
        ("walk_deg_per_h_per_rts", 3600.0, "walk", 0.017453292519943295),
        ("sigma_ut", 0.2, "sigma", 2e-7),
        ("range_max_m", 3500.0, "range_max", 3500.0),
        ("phased_array", True, "phased_array", True),
        ("use", "beams", "use", "beams"),
        ("names_deg", ["a", "b"], "names_deg", ["a", "b"]),  # no numbers: carried as they are
        ("matrix_m", [[1.0, 2.0]], "matrix", [[1.0, 2.0]]),
    ],
)
def test_a_key_is_converted_by_its_unit(key: str, value: object, name: str, expected: object) -> None:
    found, converted = si(key, value)
    assert found == name
    if isinstance(expected, (float, list)) and not isinstance(value, bool) and "names" not in name:
        np.testing.assert_allclose(converted, expected, rtol=2e-7)
    else:
        assert converted == expected


def test_a_sensor_has_its_place_and_its_figures_in_si() -> None:
    sensor = vehicle("[sensors.dvl]\nsigma_mps = 0.02\nlever_arm_m = [-0.5, 0, 0.2]\nlatency_s = 0.1\nbeam_tilt_deg = 30.0\n")["dvl"]
    assert sensor.kind == "dvl"
    np.testing.assert_array_equal(sensor.lever_arm_b, [-0.5, 0.0, 0.2])
    assert (sensor.latency, sensor.value("sigma"), sensor.value("speed_max")) == (0.1, 0.02, 10.0)
    assert sensor.value("beam_tilt") == pytest.approx(math.pi / 6)
    assert sensor.written["sigma_mps"] == 0.02


def test_what_the_file_says_comes_before_the_preset() -> None:
    sensor = vehicle('[sensors.dvl]\npreset = "rdi-workhorse-navigator-600"\nsigma_mps = 0.02\n')["dvl"]
    assert sensor.value("sigma") == 0.02
    assert sensor.value("beam_sigma") == 0.0028


def test_nuisances_of_file_and_preset_are_merged_by_name() -> None:
    base = '[sensors.dvl]\npreset = "rdi-workhorse-navigator-600"\n'
    assert float(vehicle(base)["dvl"].nuisance["scale"].sigma[0]) == pytest.approx(0.002)
    both = vehicle(base + "nuisance.mounting = { sigma_deg = 1.0 }\n")["dvl"].nuisance
    assert set(both) == {"scale", "mounting"}
    assert float(both["scale"].sigma[0]) == pytest.approx(0.002)
    own = vehicle(base + "nuisance.scale = { value_percent = 0.5 }\n")["dvl"].nuisance
    assert float(own["scale"].value[0]) == pytest.approx(0.005)
    assert float(own["scale"].sigma[0]) == 0.0  # the file's entry replaces the preset's, whole
    array = base + "phased_array = true\n"
    assert vehicle(array)["dvl"].nuisance == {}  # the preset's scale is that of another transducer
    assert float(vehicle(array + "nuisance.scale = { sigma_percent = 0.3 }\n")["dvl"].nuisance["scale"].sigma[0]) == pytest.approx(0.003)
    assert presets()["rdi-workhorse-navigator-600"]["dvl"]["nuisance"] == {"scale": {"sigma_percent": 0.2}}


def test_a_prior_is_one_number_or_one_per_axis() -> None:
    nuisance = vehicle(
        "[sensors.dvl]\nsigma_mps = 0.01\nnuisance.mounting = { sigma_deg = 1.0, value_deg = [0.0, 0.0, 2.0], tau_s = 60.0 }\n"
    )
    prior = nuisance["dvl"].nuisance["mounting"]
    np.testing.assert_allclose(prior.sigma, np.full(3, DEGREE))
    np.testing.assert_allclose(prior.value, [0.0, 0.0, 2 * DEGREE])
    assert prior.tau == 60.0
    for kind, known in NUISANCES.items():
        for name, spec in known.items():
            assert check_prior({f"sigma_{spec.unit}": 1.0}, spec, f"{kind}.{name}") == {f"sigma_{spec.unit}": 1.0}


@pytest.mark.parametrize(
    ("mounting", "sensor_axis", "body_axis"),
    [
        ("[0.0, 0.0, 90.0]", [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),  # turned to starboard: its x looks right
        ("[0.0, 90.0, 0.0]", [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]),  # nose up: its x looks up
        ("[90.0, 0.0, 0.0]", [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),  # rolled to starboard: its y looks down
        ("[180.0, 0.0, 0.0]", [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]),  # upside down
        ("[0.0, 0.0, 45.0]", [1.0, 0.0, 0.0], [math.sqrt(0.5), math.sqrt(0.5), 0.0]),
    ],
)
def test_mounting_is_roll_pitch_heading_of_the_sensor_in_the_body(mounting: str, sensor_axis: list[float], body_axis: list[float]) -> None:
    rotation = vehicle(f"[sensors.dvl]\nsigma_mps = 0.01\nmounting_deg = {mounting}\n")["dvl"].rotation_bs
    np.testing.assert_allclose(rotation @ sensor_axis, body_axis, atol=1e-12)


def test_a_dvl_turned_by_45_degrees_sees_forward_speed_on_both_its_axes() -> None:
    rotation = vehicle("[sensors.dvl]\nsigma_mps = 0.01\nmounting_deg = [0, 0, 45]\n")["dvl"].rotation_bs
    np.testing.assert_allclose(rotation.T @ [1.0, 0.0, 0.0], [math.sqrt(0.5), -math.sqrt(0.5), 0.0], atol=1e-12)
    np.testing.assert_allclose(mounting_deg(rotation), [0.0, 0.0, 45.0], atol=1e-9)


def test_a_mounting_matrix_with_few_digits_is_made_a_rotation() -> None:
    matrix = "[[0.7071, -0.7071, 0.0], [0.7071, 0.7071, 0.0], [0.0, 0.0, 1.0]]"
    rotation = vehicle(f"[sensors.dvl]\nsigma_mps = 0.01\nmounting_matrix = {matrix}\n")["dvl"].rotation_bs
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(mounting_deg(rotation), [0.0, 0.0, 45.0], atol=1e-9)


def test_a_sensor_may_be_named_as_one_likes() -> None:
    both = vehicle('[sensors."bottom track"]\nkind = "dvl"\nsigma_mps = 0.01\n[sensors.kvh]\npreset = "kvh-1775"\n')
    assert {name: sensor.kind for name, sensor in both.sensors.items()} == {"imu": "imu", "bottom track": "dvl", "kvh": "imu"}
    assert set(both.only("imu").sensors) == {"imu"}
    assert set(both.without("kvh").sensors) == {"imu", "bottom track"}


def test_every_walk_has_its_unit() -> None:
    """A unit that `si` does not know would leave a walk behind as zero, unseen."""
    factors = {"percent": 0.01, "deg": DEGREE, "deg_per_h": DEGREE / 3600, "ppm": 1e-6}
    known = [spec for names in (*NUISANCES.values(), *SHARED.values(), OF_ALL) for spec in names.values()]
    for unit in {spec.unit for spec in known}:
        assert si(f"walk_{unit}_per_rts", 2.0) == ("walk", pytest.approx(2.0 * factors.get(unit, 1.0)))
        assert si(f"sigma_{unit}", 2.0) == ("sigma", pytest.approx(2.0 * factors.get(unit, 1.0)))


def test_what_is_no_instruments_own_has_tables_of_its_own() -> None:
    found = vehicle(
        "[process]\nalign_s = 60.0\naligned_sigma_heading_deg = 2.0\nclones = 2\n"
        "[water]\ncurrent = { value_mps = [0.1, -0.2], sigma_mps = 0.3, tau_s = 1800.0, length_m = 500.0 }\n"
        "[seabed]\ndepth = { value_m = 40.0, sigma_m = 5.0, estimate = false }\n"
        "[clocks.dvl-clock]\noffset = { sigma_s = 0.1 }\ndrift = { sigma_ppm = 20.0 }\n"
        "[points.sonar]\nlever_arm_m = [1.0, 0.0, 0.5]\n"
        '[sensors.dvl]\nsigma_mps = 0.01\nclock = "dvl-clock"\nnuisance.time = { sigma_s = 0.02 }\nnuisance.lever = { sigma_m = 0.1 }\n'
    )
    current, depth = found.shared["water.current"], found.shared["seabed.depth"]
    np.testing.assert_array_equal(current.value, [0.1, -0.2])
    np.testing.assert_array_equal(current.sigma, [0.3, 0.3])
    assert (current.tau, current.length, current.estimate) == (1800.0, 500.0, True)
    assert (float(depth.value[0]), float(depth.sigma[0]), depth.length, depth.estimate) == (40.0, 5.0, math.inf, False)
    assert float(found.shared["clocks.dvl-clock.offset"].sigma[0]) == 0.1
    assert float(found.shared["clocks.dvl-clock.drift"].sigma[0]) == pytest.approx(2e-5)
    np.testing.assert_array_equal(found.points["sonar"], [1.0, 0.0, 0.5])
    assert (found.process.align, found.process.clones) == (60.0, 2)
    assert found.process.aligned_sigma_heading == pytest.approx(2 * DEGREE)
    assert found["dvl"].nuisance["lever"].sigma.shape == (3,)


def test_a_gate_and_a_second_instrument_are_of_the_sensor() -> None:
    keys = "gate_widening_s = 30.0\nreanchor_after = 5\nevery_s = 0.5\nstandby_for = 'dvl'\nstandby_after_s = 3.0\n"
    found = vehicle("[sensors.dvl]\nsigma_mps = 0.01\n[sensors.dvl_b]\nkind = 'dvl'\nsigma_mps = 0.01\n" + keys)
    plain, second = found["dvl"], found["dvl_b"]
    assert (second.gate.student_dof, second.gate.widening, second.gate.reanchor_after) == (None, 30.0, 5)
    assert vehicle("[sensors.dvl]\nsigma_mps = 0.01\nstudent_dof = 4.0\n")["dvl"].gate.student_dof == 4.0
    assert (second.every, second.standby_for, second.standby_after) == (0.5, "dvl", 3.0)
    assert (plain.gate.student_dof, plain.gate.widening, plain.gate.reanchor_after) == (None, None, None)
    assert (plain.every, plain.standby_for, plain.standby_after) == (0.0, None, 2.0)


# ---- what is wrong

DVL = "[sensors.dvl]\nsigma_mps = 0.01\n"
WRONG = {
    "unknown key": ("[sensors.dvl]\nsigma_mp = 0.01\n", ["sensors.dvl", "'sigma_mp' (0.01)", "did you mean 'sigma_mps'?"]),
    "a gate beside student": (DVL + "student_dof = 4.0\nreanchor_after = 5\n", ["dvl.reanchor_after", "would do nothing", "take it out"]),
    "unknown key of process": ("[process]\nimuu = 'imu'\n", ["process", "'imuu' ('imu')", "did you mean 'imu'?"]),
    "unknown table": ("[sensor.dvl]\nsigma_mps = 0.01\n", ["unknown key 'sensor'", "did you mean 'sensors'?"]),
    "unknown key of prior": (DVL + "nuisance.scale = { sigma = 1.0 }\n", ["dvl.nuisance.scale", "'sigma' (1.0)", "mean 'sigma_percent'?"]),
    "unknown key of a shared prior": ("[water]\ncurrent = { sigma = 1.0 }\n", ["water.current", "'sigma'", "did you mean 'sigma_mps'?"]),
    "text for yes or no": (DVL + "nuisance.scale = { estimate = 'no' }\n", ["nuisance.scale.estimate", "'no'", "true or false"]),
    "length of nothing": (DVL + "nuisance.scale = { length_m = 0.0 }\n", ["nuisance.scale.length_m", "0.0", "above 0"]),
    "no table of priors": ("[water]\ncurrent = 0.5\n", ["water.current", "0.5", "{ sigma_mps = 1.0 }"]),
    "a current in three axes": ("[water]\ncurrent = { sigma_mps = [1, 1, 1] }\n", ["water.current.sigma_mps", "at most 2"]),
    "nothing of the water": ("[water]\ncurent = { sigma_mps = 1.0 }\n", ["water.curent", "[water]", "did you mean 'current'?"]),
    "nothing of the sea bed": ("[seabed]\nslope = { sigma_m = 1.0 }\n", ["seabed.slope", "[seabed]", "known: depth"]),
    "nothing of a clock": (DVL + "clock = 'a'\n[clocks.a]\njump = { sigma_s = 1.0 }\n", ["clocks.a.jump", "[clocks]", "drift, offset"]),
    "number for a clock": ("[clocks]\na = 5\n", ["clocks.a", "5", "tables"]),
    "clock of no sensor": ("[clocks.a]\noffset = { sigma_s = 1.0 }\n", ["clocks.a", "clock of no sensor", 'clock = "a"']),
    "point without a place": ("[points.a]\n", ["has no 'points.a.lever_arm_m'"]),
    "point of two numbers": ("[points.a]\nlever_arm_m = [0.0, 1.0]\n", ["points.a.lever_arm_m", "[0.0, 1.0]", "at least 3"]),
    "unknown key of a point": ("[points.a]\nlever_arm_m = [0, 0, 0]\nname = 'x'\n", ["points.a", "'name' ('x')", "lever_arm_m"]),
    "no degrees of freedom": (DVL + "student_dof = 0.0\n", ["sensors.dvl.student_dof", "0.0", "above 0"]),
    "widening at once": (DVL + "gate_widening_s = 0.0\n", ["sensors.dvl.gate_widening_s", "0.0", "above 0"]),
    "re-anchoring at once": (DVL + "reanchor_after = 1\n", ["sensors.dvl.reanchor_after", "1", "2 or more"]),
    "half a rejection": (DVL + "reanchor_after = 2.5\n", ["sensors.dvl.reanchor_after", "2.5", "a whole number"]),
    "decimation to nothing": (DVL + "every_s = -1.0\n", ["sensors.dvl.every_s", "-1.0", "above 0"]),
    "standing in for nobody": (DVL + "standby_for = 'dvl2'\n", ["sensors.dvl.standby_for", "'dvl2'", "known: imu"]),
    "standing in for itself": (DVL + "standby_for = 'dvl'\n", ["sensors.dvl.standby_for", "'dvl' is no other sensor"]),
    "standing by for ever": (DVL + "standby_for = 'imu'\nstandby_after_s = inf\n", ["sensors.dvl.standby_after_s", "inf", "finite"]),
    "no second imu": ("[process]\nstandby = 'imu_b'\n", ["process.standby", "'imu_b'", "no other sensor of kind imu"]),
    "an imu for itself": ("[process]\nstandby = 'imu'\n", ["process.standby", "'imu'", "no other sensor of kind imu"]),
    "no time to align": ("[process]\nalign_s = 0\n", ["process.align_s", "0", "above 0"]),
    "aligned to nothing": ("[process]\naligned_sigma_heading_deg = -5.0\n", ["process.aligned_sigma_heading_deg", "-5.0", "above 0"]),
    "wrong process of a bias": (
        "[sensors.b]\npreset = 'kvh-1775'\ngyro_bias_process = 'markov'\n",
        ["sensors.b.gyro_bias_process", "'markov'", "'random_walk' or 'gauss_markov'"],
    ),
    "unknown nuisance": (DVL + "nuisance.scal = { sigma_percent = 1.0 }\n", ["sensors.dvl.nuisance.scal", "did you mean 'scale'?"]),
    "negative sigma": ("[sensors.dvl]\nsigma_mps = -0.01\n", ["sensors.dvl.sigma_mps", "-0.01", "above 0"]),
    "negative noise": (
        "[sensors.b]\npreset = 'kvh-1775'\ngyro_noise_deg_per_rth = -1.0\n",
        ["sensors.b.gyro_noise_deg_per_rth", "-1.0", "0 or more"],
    ),
    "negative noise of a carried kind": ("[sensors.magnetometer]\nnoise_ut = -1\n", ["magnetometer.noise_ut", "-1", "0 or more"]),
    "no noise": ("[sensors.yaw_rate]\nnoise_deg_per_rth = 0.0\n", ["yaw_rate.noise_deg_per_rth", "0.0", "above 0"]),
    "two declinations": (
        "[sensors.heading]\nsigma_deg = 1.0\ndeclination_deg = 3.0\ndeclination = 'wmm'\n",
        ["sensors.heading", "'declination' and 'declination_deg'", "one of them"],
    ),
    "a model of no field": ("[sensors.heading]\nsigma_deg = 1.0\ndeclination = 'igrf'\n", ["heading.declination", "'igrf'", "'wmm'"]),
    "water without density": ("[sensors.pressure]\nsigma_pa = 100.0\ndensity_kgpm3 = 0\n", ["pressure.density_kgpm3", "0", "above 0"]),
    "a swing of three": ("[sensors.heading]\nsigma_deg = 1.0\nnuisance.swing = { sigma_deg = [1, 1, 1] }\n", ["sigma_deg", "at least 4"]),
    "navigation as fixes": ("[sensors.navigation]\nuse = 'fixes'\n", ["navigation.use", "'fixes'", "'none' or 'increments'"]),
    "an increment of nothing": ("[sensors.navigation]\nincrement_s = 0.0\n", ["navigation.increment_s", "0.0", "above 0"]),
    "negative prior": (DVL + "nuisance.scale = { sigma_percent = -1.0 }\n", ["nuisance.scale.sigma_percent", "-1.0", "0 or more"]),
    "negative prior of an axis": (DVL + "nuisance.mounting = { sigma_deg = [1, -2, 1] }\n", ["mounting.sigma_deg[1]", "-2", "0 or more"]),
    "nan": ("[sensors.dvl]\nsigma_mps = nan\n", ["sensors.dvl.sigma_mps", "nan", "a finite number"]),
    "infinite lever arm": (DVL + "lever_arm_m = [inf, 0, 0]\n", ["sensors.dvl.lever_arm_m[0]", "inf", "finite"]),
    "text for a number": ("[sensors.dvl]\nsigma_mps = '0.01'\n", ["sensors.dvl.sigma_mps", "'0.01'", "a number"]),
    "number for a text": (DVL + "clock = 5\n", ["sensors.dvl.clock", "5", "a text in quotes"]),
    "number for a list": (DVL + "lever_arm_m = 0.5\n", ["sensors.dvl.lever_arm_m", "0.5", "a list"]),
    "number for yes or no": (DVL + "phased_array = 1\n", ["sensors.dvl.phased_array", "1", "true or false"]),
    "number for a table": ("[sensors]\ndvl = 5\n", ["sensors.dvl", "5", "a table"]),
    "number for the prior": (DVL + "nuisance.scale = 0.5\n", ["nuisance.scale", "0.5", "{ sigma_percent = 1.0 }"]),
    "number for the priors": (DVL + "nuisance = 0.5\n", ["sensors.dvl.nuisance", "0.5", "a table"]),
    "number for the kind": ("[sensors.a]\nkind = 5\n", ["sensors.a.kind", "5", "a text"]),
    "list for the preset": ("[sensors.a]\npreset = ['x']\n", ["sensors.a.preset", "['x']", "a text"]),
    "short lever arm": (DVL + "lever_arm_m = [0.5, 0.1]\n", ["sensors.dvl.lever_arm_m", "[0.5, 0.1]", "at least 3"]),
    "wrong word": (DVL + "use = 'beam'\n", ["sensors.dvl.use", "'beam'", "'velocity' or 'beams'"]),
    "probability above one": (DVL + "gate_probability = 1.5\n", ["sensors.dvl.gate_probability", "1.5", "1 or less"]),
    "no rotation": (DVL + "mounting_matrix = [[1,0,0],[0,1,0],[0,0,-1]]\n", ["dvl.mounting_matrix", "-1", "right-handed"]),
    "not orthogonal": (DVL + "mounting_matrix = [[1,0.1,0],[0,1,0],[0,0,1]]\n", ["dvl.mounting_matrix", "0.1", "is no rotation"]),
    "no matrix": (DVL + "mounting_matrix = [[1,0],[0,1]]\n", ["dvl.mounting_matrix", "[1, 0]", "at least 3"]),
    "two mountings": (
        DVL + "mounting_deg = [0,0,0]\nmounting_matrix = [[1,0,0],[0,1,0],[0,0,1]]\n",
        ["sensors.dvl", "'mounting_deg' and 'mounting_matrix'", "one of them"],
    ),
    "unknown preset": ("[sensors.dvl]\npreset = 'rdi-explorer'\n", ["sensors.dvl.preset", "'rdi-explorer'", "'rdi-explorer-600'?"]),
    "preset of another kind": ("[sensors.dvl]\npreset = 'keller-33x'\n", ["sensors.dvl.preset", "'keller-33x'", "depth, pressure"]),
    "unknown kind": ("[sensors.a]\nkind = 'dvll'\n", ["sensors.a.kind", "'dvll'", "did you mean 'dvl'?"]),
    "unknown kind with a preset": ("[sensors.a]\nkind = 'dvll'\npreset = 'keller-33x'\n", ["sensors.a.kind", "'dvll'", "'dvl'?"]),
    "no kind": ("[sensors.a]\nsigma_m = 1.0\n", ["sensors.a", "has no 'kind'", "add kind"]),
    "no kind among those of the preset": ("[sensors.a]\npreset = 'keller-33x'\n", ["sensors.a", "'kind'", "depth, pressure"]),
    "no sigma": ("[sensors.dvl]\n", ["sensors.dvl", "'sigma_mps'", "give it"]),
    "no such imu": ("[process]\nimu = 'imi'\n", ["process.imu", "'imi'", "did you mean 'imu'?"]),
    "an imu that is none": ("[process]\nimu = 'dvl'\n" + DVL, ["process.imu", "'dvl'", "kind imu", "known: imu"]),
    "too many clones": ("[process]\nclones = 9\n", ["process.clones", "9", "4 or less"]),
    "half a clone": ("[process]\nclones = 1.5\n", ["process.clones", "1.5", "a whole number"]),
    "syntax": ("[sensors.dvl]\nsigma_mps = 0.01 m/s\n", ["line 5", "sigma_mps = 0.01 m/s", "is not TOML"]),
    "the same key twice": (DVL + "sigma_mps = 0.02\n", ["line 6", "sigma_mps = 0.02", "overwrite"]),
    "unfinished": ("[sensors.dvl]\nlever_arm_m = [0.0,\n", ["is not TOML"]),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_wrong_input_gives_one_line_that_names_file_key_and_value(what: str, tmp_path: Path) -> None:
    more, wanted = WRONG[what]
    path = tmp_path / "vehicle.toml"
    path.write_text(IMU + more, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_vehicle(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    for part in wanted:
        assert part in message
    assert "Input should" not in message  # the words of a library that no user knows


@pytest.mark.parametrize(
    ("whole", "wanted"),
    [
        ("[sensors.imu]\npreset = 'mems-tactical'\n", ["has no 'name'", "give the vehicle a name"]),
        ("name = 'v'\n", ["has no 'sensors'", "[sensors.NAME]"]),
        ("name = 'v'\n[sensors]\n", ["sensors", "at least 1"]),
        ("name = 5\n[sensors.imu]\npreset = 'mems-tactical'\n", ["name", "5", "a text"]),
        ("name = 'v'\nsensors = 5\n", ["sensors", "5", "tables"]),
        ("name = 'v'\nprocess = 5\n[sensors.imu]\npreset = 'mems-tactical'\n", ["process", "5", "a table"]),
        ("name = 'v'\n" + DVL, ["process.imu", "'imu'", "add one"]),
        ("", ["has no 'name'"]),
    ],
)
def test_a_file_that_lacks_the_whole(whole: str, wanted: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        vehicle_from_toml(whole, Path("v.toml"))
    assert str(caught.value).startswith("v.toml: ")
    for part in wanted:
        assert part in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"name = '\xff'")
    for path, wanted in ((tmp_path / "none", "cannot be read"), (tmp_path, "cannot be read"), (tmp_path / "binary", "UTF-8")):
        with pytest.raises(InputError, match=wanted):
            read_vehicle(path)


def test_asking_for_what_is_not_there() -> None:
    with pytest.raises(InputError, match="did you mean 'imu'"):
        vehicle("")["imo"]
    with pytest.raises(InputError, match=r"sensors\.imu: has no sigma"):
        vehicle("")["imu"].value("sigma")


# ---- template and check

TIME = np.arange(200) / 10.0
ONES, THREE = np.ones(200), np.ones((200, 3))
BEACON = np.full(200, "a")
TABLES: dict[str, Table] = {
    "imu": Imu(time=np.arange(2000) / 100.0, accel=np.ones((2000, 3)), gyro=np.ones((2000, 3))),
    "imu_b": Imu(time=TIME, accel=THREE, gyro=THREE),
    "dvl": Dvl(time=TIME * 2.0, velocity=THREE),
    "depth": Depth(time=TIME, depth=ONES),
    "heading": Heading(time=TIME, heading=ONES),
    "ahrs": Attitude(time=TIME, roll=ONES, pitch=ONES, heading=ONES),
    "gnss": Gnss(time=TIME, latitude=ONES, longitude=ONES),
    "usbl fixes": PositionFix(time=TIME, north=ONES, east=ONES),
    "ranges": AcousticRange(time=TIME, transmitter=BEACON, range=ONES, path=np.full(200, "one_way")),
    "still": ZeroVelocity(time=TIME[:2]),
    "magnetometer": Magnetometer(time=TIME, field=THREE),
    "fog": YawRate(time=TIME, yaw_rate=ONES),
    "log": Speed(time=TIME, speed=ONES),
    "truth": Truth(time=TIME, north=ONES, east=ONES),
    "sonar": Other(time=TIME, extra={"x": ONES}),
}
LOG = Log('dive "7"', TABLES)


def test_the_template_of_a_log_reads_and_checks_clean() -> None:
    found = vehicle_from_toml(template(LOG))
    assert found.name == 'dive "7"'
    assert found.process.imu == "imu"
    expected = {name: table.kind for name, table in TABLES.items() if table.kind in BY_KIND and table.kind in FIGURES}
    assert {name: sensor.kind for name, sensor in found.sensors.items()} == expected
    assert found["imu"].values["rate"] == 100.0
    assert found["dvl"].values["rate"] == 5.0
    assert "rate" not in found["still"].values
    assert found["ranges"].value("path") == "one_way"
    assert [note for note in notes(found, LOG) if not note.startswith(("imu_b", "magnetometer", "sonar"))] == []


def test_the_template_names_every_table_even_what_no_model_uses() -> None:
    whole = template(LOG)
    for name in TABLES:
        assert f"[sensors.{name}]" in whole or f'[sensors."{name}"]' in whole or name == "truth"
    assert "# truth: read by assessment alone" in whole
    assert "# magnetometer: no model uses this kind yet." in whole
    assert "# sonar: of no kind that Leadline knows" in whole


def test_every_offer_of_the_template_can_be_taken_up() -> None:
    """Without the # before it, each commented key is one that its sensor knows."""
    for kind, lines in FIGURES.items():
        own = f'[sensors.a]\nkind = "{kind}"\n'
        plain = {key.removeprefix("#"): value.replace("{path}", "two_way") for key, value, _ in lines if not key.startswith("##")}
        assert vehicle(own + "".join(f"{key} = {value}\n" for key, value in plain.items()))["a"].kind == kind
        for key, value, _ in lines:  # what stands in the place of another
            if key.startswith("##"):
                kept = {k: v for k, v in plain.items() if k.partition("_deg")[0] != key[2:]} | {key[2:]: value}
                assert vehicle(own + "".join(f"{k} = {v}\n" for k, v in kept.items()))["a"].kind == kind
    uncommented = template(LOG).replace("# kind =", "kind =").replace("# [sensors.", "[sensors.").replace("# model =", "model =")
    assert set(tomllib.loads(uncommented)["sensors"]) == set(TABLES) - {"truth"}
    assert vehicle_from_toml(uncommented)["sonar"].model == "package.module:function"


def test_the_template_offers_a_dvl_a_bias_that_wanders() -> None:
    whole = template(LOG)
    assert "# nuisance.bias = { sigma_mps = 0.005, tau_s = 60.0 }" in whole
    taken = whole.replace("# nuisance.bias = { sigma_mps", "nuisance.bias = { sigma_mps")
    assert vehicle_from_toml(taken)["dvl"].written["nuisance"]["bias"] == {"sigma_mps": 0.005, "tau_s": 60.0}


@pytest.mark.parametrize("width", [60, 80, 160])
def test_the_report_of_a_vehicle_breaks_nothing_on_a_terminal(width: int) -> None:
    console = Console(file=StringIO(), width=width)
    console.print(text(vehicle("[sensors.dvl]\nsigma_mps = 0.0225\nmounting_deg = [0, 0, -45.125]\n")))
    shown = console.file.getvalue()
    assert "sigma_mps = 0.0225" in shown
    assert "roll 0, pitch 0, heading -45.125 deg" in shown
    assert "…" not in shown
    assert all(line == line.rstrip() for line in shown.splitlines())


def test_the_template_without_a_log_is_a_whole_example() -> None:
    found = vehicle_from_toml(template())
    assert {sensor.kind for sensor in found.sensors.values()} == set(FIGURES)
    assert set(FIGURES) <= set(BY_KIND)
    assert notes(found) == []
    assert all(len(line) < 260 for line in template().splitlines())
    assert {"water.current", "seabed.depth"} == set(found.shared)
    assert "# magnetometer: no model uses this kind yet.\n# [sensors.magnetometer]\n# kind" in template()
    assert set(vehicle_from_toml(template(LOG)).shared) == {"water.current"}  # of a speed log


def test_the_template_of_a_log_without_imu_says_so() -> None:
    whole = template(Log("l", {"depth": TABLES["depth"]}))
    assert whole.startswith("# This log has no imu table; the process model `inertial` needs one.\n# Vehicle file")
    assert not template(LOG).startswith("# This log")
    with pytest.raises(InputError, match=r"process\.imu"):
        vehicle_from_toml(whole)


def test_a_rate_is_that_of_different_times() -> None:
    held = Depth(time=np.repeat(TIME, 3), depth=np.ones(600))
    assert rate_of(held) == 10.0
    assert math.isnan(rate_of(TABLES["still"]))


def test_check_says_what_is_understood() -> None:
    found = vehicle('[sensors.dvl]\npreset = "rdi-workhorse-navigator-600"\nlever_arm_m = [-0.5, 0, 0.2]\nmounting_deg = [0, 0, -45]\n')
    line = check(found)[2]
    for part in (
        "dvl: dvl", "preset rdi-workhorse-navigator-600", "forward -0.5, right 0, down 0.2 m", "roll 0, pitch 0, heading -45 deg",
        "sigma_mps = 0.004", "nuisance scale: sigma_percent = 0.2",
    ):  # fmt: skip
        assert part in line


NOTES = {
    "missing table": ('[sensors.dvl2]\nkind = "dvl"\nsigma_mps = 0.01\n', "dvl2: in the vehicle, but the log has no such table"),
    "other kind": ('[sensors.depth]\nkind = "gnss"\nsigma_m = 1.0\n', "depth: kind gnss in the vehicle, depth in the log"),
    "other rate": ("[sensors.depth]\nsigma_m = 1.0\nrate_hz = 1.0\n", "depth: rate_hz = 1, but the log has 10 rows per second"),
    "rate that makes gaps": (
        '[sensors.imu_b]\npreset = "kvh-1775"\nrate_hz = 1000.0\n',
        "imu_b: rate_hz = 1000, but the log has 10 rows per second; every interval would be a gap",
    ),
    "no beams": ('[sensors.dvl]\nsigma_mps = 0.01\nuse = "beams"\n', "dvl: use = beams, but the log has none"),
    "magnetic": ('[sensors.heading]\nsigma_deg = 1.0\nreference = "magnetic"\n', "heading: its heading is magnetic and it has no"),
    "carried": ("[sensors.magnetometer]\nsigma_ut = 0.2\n", "magnetometer: no model uses kind 'magnetometer' yet; it is carried"),
    "unnamed": ("", "gnss: a table of kind gnss in the log that the vehicle does not name"),
}


@pytest.mark.parametrize("what", NOTES)
def test_check_against_a_log_says_what_does_not_fit(what: str) -> None:
    more, wanted = NOTES[what]
    found = notes(vehicle(more), LOG)
    assert any(note.startswith(wanted) for note in found), found
    assert not any(note.startswith("truth") for note in found)


def test_the_report_shows_sensors_and_notes() -> None:
    console = Console(file=StringIO(), width=160)
    console.print(text(vehicle("[sensors.dvl]\nsigma_mps = 0.02\n"), LOG))
    shown = console.file.getvalue()
    assert "sigma_mps = 0.02" in shown
    assert "gnss: a table of kind gnss in the log" in shown
    clean = Console(file=StringIO(), width=160)
    clean.print(text(vehicle("")))
    assert "Nothing to remark." in clean.file.getvalue()
