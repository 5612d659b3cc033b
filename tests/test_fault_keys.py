"""Faults by name: each table of a mission file becomes the value that it says, in SI, and what is wrong with it is said in one line."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from math import inf, pi, radians
from pathlib import Path

import pytest

from leadline.data.errors import InputError
from leadline.data.vehicle import vehicle_from_toml
from leadline.missions.fault_keys import FAULTS, faults_of
from leadline.simulate.faults import ClockJump, CompassSwinging, EmptyRows, LateDelivery, Loss, Outage, Repeats, WildFixes
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

VEHICLE = vehicle_from_toml("""
name = "gannet"
[sensors.imu]
preset = "kvh-1775"
[sensors.imu_b]
kind = "imu"
preset = "kvh-1775"
[sensors.nortek]
kind = "dvl"
sigma_mps = 0.01
mounting_deg = [180.0, 0.0, 45.0]
use = "beams"
beam_azimuth_deg = [0.0, 90.0, 180.0, 270.0]
beam_tilt_deg = 25.0
[sensors.depth]
sigma_m = 0.05
[sensors.heading]
sigma_deg = 0.5
[sensors.yaw]
kind = "yaw_rate"
noise_deg_per_rth = 0.1
rate_hz = 10.0
[sensors.usbl]
kind = "usbl"
sound_speed_mps = 1480.0
[sensors.ranges]
kind = "acoustic_range"
sigma_m = 0.2
sound_speed_mps = 1470.0
""")
SPAN = "from_s = 10\nto_s = 20.0\n"
WINDOW = {"begin": 10.0, "end": 20.0}
HOURLY = pi / 180 / 3600


def read(text: str, vehicle=None):
    """The one fault of a table."""
    raw = tomllib.loads(f"[[faults]]\n{text}")["faults"]
    (fault,) = faults_of(raw, "m.toml", vehicle)
    return fault


TABLES = {
    'kind = "dvl_loss"\n' + SPAN: Outage(sensor="dvl", **WINDOW),
    'kind = "dvl_loss"\nfrom_s = 10.0': Outage(sensor="dvl", begin=10.0, end=inf),
    'kind = "dvl_loss"\nrows = "absent"\nsensor = "dvl_b"\n' + SPAN: Outage(sensor="dvl_b", rows="absent", **WINDOW),
    'kind = "beam_loss"\nbeams = [3, 1]\n' + SPAN: BeamLoss(sensor="dvl", beams=(1, 3), **WINDOW),
    'kind = "false_lock"\nnorth_mps = 0.2\neast_mps = -0.1\nscale_percent = 2.0\naltitude_fraction = 0.3\n' + SPAN: FalseLock(
        sensor="dvl", layer_n=(0.2, -0.1), scale=0.02, share=0.3, **WINDOW
    ),
    'kind = "usbl_outliers"\nfraction = 0.1\nsize_m = [30, 90.0]': WildFixes(sensor="usbl", fraction=0.1, low=30.0, high=90.0),
    'kind = "usbl_outliers"\nfraction = 0.1\nsize_m = [0, 5.0]\nsize_deg = [10.0, 90.0]\n' + SPAN: WildPings(
        sensor="usbl", fraction=0.1, low=0.0, high=5.0, angle_low=radians(10.0), angle_high=pi / 2, **WINDOW
    ),
    'kind = "late_usbl"': LateDelivery(sensor="usbl", low=2.0, high=8.0),
    'kind = "late_usbl"\ndelay_s = [3, 3]\n' + SPAN: LateDelivery(sensor="usbl", low=3.0, high=3.0, **WINDOW),
    'kind = "late"\nsensor = "imu"\ndelay_s = [0.1, 0.2]': LateDelivery(sensor="imu", low=0.1, high=0.2),
    'kind = "compass_swing"\nsize_deg = -90.0\n' + SPAN: CompassSwinging(sensor="heading", step=-pi / 2, **WINDOW),
    'kind = "compass_swing"\namplitude_deg = 90.0\nperiod_s = 30\n' + SPAN: CompassSwinging(
        sensor="heading", amplitude=pi / 2, period=30.0, **WINDOW
    ),
    'kind = "gyro_bias_jump"\nsize_deg_per_h = 20.0\naxis = "y"\n' + SPAN: GyroBiasJump(sensor="imu", size=20.0 * HOURLY, axis=1, **WINDOW),
    'kind = "accel_bias_jump"\nsize_ug = 1000.0\n' + SPAN: AccelBiasJump(sensor="imu", size=9.80665e-3, axis=2, **WINDOW),
    'kind = "gnss_jump"\nnorth_m = 30.0\neast_m = 40.0\nrate_mps = 0.5\n' + SPAN: FixJump(
        sensor="gnss", jump_n=(30.0, 40.0), drag_n=(0.3, 0.4), **WINDOW
    ),
    'kind = "gnss_jump"\nrate_mps = 0.5\nbearing_deg = 90.0\n' + SPAN: FixJump(sensor="gnss", drag_n=(0.0, 0.5), **WINDOW),
    'kind = "clock_jump"\nstep_s = -1.5\n' + SPAN: ClockJump(sensor="dvl", step=-1.5, **WINDOW),
    'kind = "depth_drift"\nrate_m_per_h = 3.6\n' + SPAN: DepthDrift(sensor="depth", rate=1e-3, **WINDOW),
    'kind = "depth_drift"\nsensor = "pressure"\nrate_mps = 0.01\n' + SPAN: DepthDrift(sensor="pressure", rate=0.01, **WINDOW),
    'kind = "imu_gap"\n' + SPAN: Outage(sensor="imu", rows="absent", **WINDOW),
    'kind = "tide_jump"\nsize_m = 0.8\n' + SPAN: TideJump(sensor="depth", size=0.8, **WINDOW),
    'kind = "stuck_value"\nsensor = "depth"\n' + SPAN: StuckValue(sensor="depth", **WINDOW),
    'kind = "scale_jump"\nsize_percent = 3\n' + SPAN: ScaleJump(sensor="dvl", scale=0.03, **WINDOW),
    'kind = "noise_burst"\nsensor = "heading"\nsigma_deg = 90.0\n' + SPAN: NoiseBurst(
        sensor="heading", sigma=pi / 2, quantity="angle", **WINDOW
    ),
    'kind = "noise_burst"\nsensor = "imu"\nsigma_degps = 180.0\n' + SPAN: NoiseBurst(sensor="imu", sigma=pi, quantity="rate", **WINDOW),
    'kind = "noise_burst"\nsensor = "imu"\nsigma_mps2 = 2.0\n' + SPAN: NoiseBurst(sensor="imu", sigma=2.0, quantity="force", **WINDOW),
    'kind = "noise_burst"\nsensor = "p"\nsigma_pa = 2.0\n' + SPAN: NoiseBurst(sensor="p", sigma=2.0, quantity="pressure", **WINDOW),
    'kind = "noise_burst"\nsensor = "dvl"\nsigma_mps = 2.0\n' + SPAN: NoiseBurst(sensor="dvl", sigma=2.0, quantity="speed", **WINDOW),
    'kind = "noise_burst"\nsensor = "usbl"\nsigma_m = 2.0\n' + SPAN: NoiseBurst(sensor="usbl", sigma=2.0, quantity="distance", **WINDOW),
    'kind = "sensor_dead"\nsensor = "dvl"\nfrom_s = 10.0': Outage(sensor="dvl", rows="absent", begin=10.0),
    'kind = "loss"\nsensor = "dvl"\nfraction = 0.2': Loss(sensor="dvl", fraction=0.2),
    'kind = "repeats"\nsensor = "dvl"\nfraction = 0.2\n' + SPAN: Repeats(sensor="dvl", fraction=0.2, **WINDOW),
    'kind = "empty"\nsensor = "dvl"\nfraction = 1': EmptyRows(sensor="dvl", fraction=1.0),
    'kind = "range_outliers"\nsensor = "ranges"\nfraction = 0.1\n' + SPAN: LateEchoes(
        sensor="ranges", fraction=0.1, low=5.0, high=50.0, **WINDOW
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", TABLES, ids=[re.search('"(.*)"', text)[1] for text in TABLES])
def test_a_table_is_the_fault_that_it_says(text):
    """Kinds are the same, and each number is that of the table in SI, to rounding."""
    found, expected = read(text), TABLES[text]
    assert type(found) is type(expected)
    assert vars(found).keys() == vars(expected).keys()
    for name, value in vars(expected).items():
        assert getattr(found, name) == (value if isinstance(value, str) else pytest.approx(value, rel=1e-12, abs=1e-15)), name


def test_every_kind_is_tried():
    assert {re.search('kind = "(.*)"', text)[1] for text in TABLES} == set(FAULTS)


def test_tables_keep_their_order():
    raw = [{"kind": "loss", "sensor": "dvl", "fraction": 0.5}, {"kind": "imu_gap", "from_s": 1.0}, {"kind": "late_usbl"}]
    assert [type(fault) for fault in faults_of(raw, "m.toml")] == [Loss, Outage, LateDelivery]
    assert faults_of([], "m.toml") == ()
    assert raw == [{"kind": "loss", "sensor": "dvl", "fraction": 0.5}, {"kind": "imu_gap", "from_s": 1.0}, {"kind": "late_usbl"}]


def test_the_only_sensor_that_fits_needs_no_name():
    """The Doppler log of this vehicle is called nortek; of two inertial units the usual name is taken, of two of no such name none."""
    assert read('kind = "dvl_loss"\nfrom_s = 1.0', VEHICLE).sensor == "nortek"
    assert read('kind = "clock_jump"\nfrom_s = 1.0\nstep_s = 1.0', VEHICLE).sensor == "nortek"
    assert read('kind = "imu_gap"\nfrom_s = 1.0', VEHICLE).sensor == "imu"
    assert read('kind = "range_outliers"\nfraction = 0.1', VEHICLE).sensor == "ranges"
    sensors = {f"{name}_x": config for name, config in VEHICLE.sensors.items()}
    with pytest.raises(InputError, match=r"has no 'sensor'; give one of imu_x, imu_b_x$"):
        read('kind = "imu_gap"\nfrom_s = 1.0', replace(VEHICLE, sensors=sensors))


def test_the_vehicle_file_gives_the_geometry_and_the_speed_of_sound():
    lock = read('kind = "false_lock"\nfrom_s = 1.0\nnorth_mps = 0.3', VEHICLE)
    assert lock.mounting_bs == pytest.approx((pi, 0.0, pi / 4))
    assert lock.azimuths == pytest.approx((0.0, pi / 2, pi, 3 * pi / 2))
    assert lock.tilt == pytest.approx(radians(25.0))
    assert read('kind = "range_outliers"\nfraction = 0.1', VEHICLE).sound_speed == 1470.0
    pings = read('kind = "usbl_outliers"\nfraction = 0.1', VEHICLE)
    assert isinstance(pings, WildPings)
    assert pings.sound_speed == 1480.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("from_s = 1.0", "m.toml: faults[0]: has no 'kind'; known: accel_bias_jump, "),
        ('kind = "dvl_lost"', "m.toml: faults[0].kind: 'dvl_lost' is not known; did you mean 'dvl_loss'?"),
        ("kind = 3", "m.toml: faults[0].kind: 3 is not known; known: "),
        ('kind = "dvl_loss"', "m.toml: faults[0]: has no 'from_s'; give it"),
        ('kind = "dvl_loss"\nfrom_s = "1"', "m.toml: faults[0].from_s: '1'; a number"),
        ('kind = "dvl_loss"\nfrom_s = nan', "m.toml: faults[0].from_s: nan; a finite number"),
        ('kind = "dvl_loss"\nfrom_s = 5.0\nto_s = 5.0', "m.toml: faults[0].to_s: 5.0; a time after from_s"),
        ('kind = "dvl_loss"\nfrom = 5.0', "m.toml: faults[0]: unknown key 'from' (5.0); did you mean 'from_s'?"),
        ('kind = "dvl_loss"\nfrom_s = 5.0\nrows = "gone"', "m.toml: faults[0].rows: 'gone'; 'invalid' or 'absent'"),
        ('kind = "sensor_dead"\nsensor = "dvl"\nfrom_s = 5.0\nto_s = 6.0', "m.toml: faults[0]: unknown key 'to_s' (6.0); "),
        ('kind = "sensor_dead"\nfrom_s = 5.0', "m.toml: faults[0]: has no 'sensor'; give the name of one"),
        ('kind = "beam_loss"\nfrom_s = 5.0\nbeams = []', "m.toml: faults[0].beams: []; at least 1 of them"),
        ('kind = "beam_loss"\nfrom_s = 5.0\nbeams = [0]', "m.toml: faults[0].beams[0]: 0; 1 or more"),
        ('kind = "loss"\nsensor = "dvl"\nfraction = 1.5', "m.toml: faults[0].fraction: 1.5; 1 or less"),
        ('kind = "late_usbl"\ndelay_s = [8.0, 2.0]', "m.toml: faults[0].delay_s: [8.0, 2.0]; the lower one first"),
        ('kind = "late_usbl"\ndelay_s = [8.0]', "m.toml: faults[0].delay_s: [8.0]; at least 2 of them"),
        ('kind = "late_usbl"\ndelay_s = [-1.0, 2.0]', "m.toml: faults[0].delay_s[0]: -1.0; 0 or more"),
        ('kind = "compass_swing"\nfrom_s = 1.0', "m.toml: faults[0]: has no size; give size_deg, amplitude_deg, or both"),
        ('kind = "gyro_bias_jump"\nfrom_s = 1.0\nsize_deg_per_h = 1.0\naxis = "w"', "m.toml: faults[0].axis: 'w'; 'x', 'y' or 'z'"),
        ('kind = "depth_drift"\nfrom_s = 1.0', "m.toml: faults[0]: has no size; give one of rate_mps, rate_m_per_h"),
        (
            'kind = "depth_drift"\nfrom_s = 1.0\nrate_mps = 1.0\nrate_m_per_h = 1.0',
            "m.toml: faults[0]: has both 'rate_mps' and 'rate_m_per_h'; give one of them",
        ),
        ('kind = "gnss_jump"\nfrom_s = 1.0', "m.toml: faults[0]: has no size; give one of north_m, east_m, rate_mps"),
        ('kind = "gnss_jump"\nfrom_s = 1.0\nrate_mps = 1.0', "m.toml: faults[0]: has a rate_mps, and no direction; give bearing_deg"),
        ('kind = "noise_burst"\nsensor = "dvl"\nfrom_s = 1.0', "m.toml: faults[0]: has no size; give one of sigma_m, "),
    ],
)
def test_what_is_wrong_is_said_in_one_line_that_names_the_key(text, message):
    with pytest.raises(InputError) as refused:
        read(text)
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "dvl_loss"\nfrom_s = 1.0\nsensor = "dvl"', "m.toml: faults[0].sensor: 'dvl' is no sensor of gannet; known: nortek"),
        (
            'kind = "dvl_loss"\nfrom_s = 1.0\nsensor = "depth"',
            "m.toml: faults[0].sensor: 'depth' is of kind depth; a sensor of kind dvl or",
        ),
        (
            'kind = "gnss_jump"\nfrom_s = 1.0\nnorth_m = 9.0',
            "m.toml: faults[0]: has no 'sensor'; gannet has none of kind gnss or position_fix",
        ),
        ('kind = "loss"\nfraction = 0.5', "m.toml: faults[0]: has no 'sensor'; give one of imu, imu_b, nortek, depth"),
        (
            'kind = "imu_gap"\nfrom_s = 1.0\nsensor = "imu_c"',
            "m.toml: faults[0].sensor: 'imu_c' is no sensor of gannet; did you mean 'imu_b'?",
        ),
        (
            'kind = "gyro_bias_jump"\nsensor = "yaw"\naxis = "x"\nfrom_s = 1.0\nsize_deg_per_h = 1.0',
            "m.toml: faults[0].axis: 'x'; 'yaw' is a single gyro, about its z axis",
        ),
        (
            'kind = "noise_burst"\nsensor = "imu"\nfrom_s = 1.0\nsigma_m = 1.0',
            "m.toml: faults[0].sigma_m: is no noise of a sensor of kind imu; give sigma_degps or sigma_mps2",
        ),
    ],
)
def test_a_sensor_that_is_not_aboard_or_cannot_have_it_is_refused(text, message):
    with pytest.raises(InputError) as refused:
        read(text, VEHICLE)
    assert str(refused.value).startswith(message)


def test_a_position_has_no_angles():
    fixes = vehicle_from_toml('name = "a"\n[sensors.imu]\npreset = "kvh-1775"\n[sensors.usbl]\nkind = "position_fix"\nsigma_m = 1.0\n')
    with pytest.raises(InputError, match=r"faults\[0\].size_deg: .* measures no angles"):
        read('kind = "usbl_outliers"\nfraction = 0.1\nsize_deg = [1.0, 2.0]', fixes)
    assert isinstance(read('kind = "usbl_outliers"\nfraction = 0.1', fixes), WildFixes)


def test_a_table_is_a_table():
    with pytest.raises(InputError, match=r"m.toml: faults\[1\]: 3; a table of keys"):
        faults_of([{"kind": "late_usbl"}, 3], "m.toml")


def test_the_page_names_every_kind_and_key():
    text = (Path(__file__).parent.parent / "docs" / "faults.md").read_text("utf-8").partition("## Kinds of faults")[2]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| `")]
    assert [row[0].strip("`") for row in rows] == list(FAULTS)
    for kind, sensor, required, further, _ in rows:
        keys = FAULTS[kind.strip("`")]
        own = {name: field for name, field in keys.model_fields.items() if name not in ("kind", "sensor")}
        assert sensor.strip("`") == keys.usual
        assert set(re.findall(r"`([^`]+)`", required)) == {name for name, field in own.items() if field.is_required()}, kind
        assert set(re.findall(r"`([^`]+)`", further)) == {name for name, field in own.items() if not field.is_required()}, kind
