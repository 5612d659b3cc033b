"""Sigmas that are wrong by 2 are found within their intervals, through gates, outliers and errors that wander; what none can tell is said.

The vehicle file of the truth is read by the simulator; the one that is tuned states sigmas that are wrong by 2, up or down by seed.
As a script it prints the coverage of many runs:  python tests/test_tune.py [RUNS [FIRST_SEED]]
"""

import json
import sys
from collections import defaultdict
from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest
from scipy.stats import binom, chi2

from leadline import cli
from leadline.assess.intervals import interval_of_fraction
from leadline.calibrate.knobs import knobs_of
from leadline.calibrate.likelihood import Recording
from leadline.calibrate.tune import FEWEST, fragment, interval, tune
from leadline.data.errors import InputError
from leadline.data.vehicle import read_vehicle, vehicle_from_toml
from leadline.formats.folder import write_log
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.instruments import Drift
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

TRUE = {
    "imu.gyro_noise_deg_per_rth": 0.6,
    "imu.accel_noise_ug_per_rthz": 120.0,
    "dvl.sigma_mps": 0.01,
    "depth.sigma_m": 0.05,
    "heading.sigma_deg": 0.5,
    "usbl.sigma_m": 0.5,
}
VEHICLE = """
name = "tuned"
[sensors.imu]
rate_hz = 25.0
gyro_noise_deg_per_rth = {imu.gyro_noise_deg_per_rth}
gyro_bias_deg_per_h = 5.0
accel_noise_ug_per_rthz = {imu.accel_noise_ug_per_rthz}
accel_bias_ug = 500.0
[sensors.dvl]
rate_hz = 2.0
sigma_mps = {dvl.sigma_mps}
lever_arm_m = [-0.5, 0.0, 0.2]
nuisance = {{ scale = {{ sigma_percent = 0.3 }} }}
[sensors.depth]
rate_hz = 2.0
sigma_m = {depth.sigma_m}
[sensors.heading]
rate_hz = 1.0
sigma_deg = {heading.sigma_deg}
[sensors.usbl]
kind = "position_fix"
rate_hz = 0.25
sigma_m = {usbl.sigma_m}
vertical = false
"""
PLACE = Place(radians(45.0), radians(10.0), depth=10.0)
START = StartSigmas(position=1.0, depth=0.1, velocity=0.05, tilt=radians(0.2), heading=radians(0.5))
TRAJECTORY = survey(PLACE, Lawnmower(legs=3, length=100.0, spacing=30.0, speed=1.5), duration=240.0)
CASES = {
    "dvl": ("dvl.sigma_mps",),
    "aiding": ("depth.sigma_m", "heading.sigma_deg", "usbl.sigma_m"),
    "gyro": ("imu.gyro_noise_deg_per_rth",),
}


def text_of(wrong=(), factor=1.0, more=""):
    """The vehicle file, with some sigmas times a factor (one, or one each)."""
    factors = dict(zip(wrong, np.broadcast_to(factor, len(wrong)), strict=True))
    text = VEHICLE.replace("{{", "\0").replace("}}", "\1")
    for key, value in TRUE.items():
        text = text.replace("{" + key + "}", repr(float(value * factors.get(key, 1.0))))
    return text.replace("\0", "{").replace("\1", "}") + more


ABOARD = vehicle_from_toml(text_of())


@cache
def recorder_of(duration=240.0):
    return Recorder(TRAJECTORY, instruments_of(ABOARD), duration=duration, truth_rate=0.1, start=START)


def drawn(seed, duration=240.0):
    """A log whose rows state no sigma of their own."""
    log = recorder_of(duration).draw(seed)
    fixes = replace(log["usbl"], sigma=None, sigma_axes=None, cov_north_east=None)
    return replace(log, tables={**log.tables, "usbl": fixes})


def realised(log, name, field):
    """The RMS of the noise that a table really has."""
    error = getattr(log[name], field) - getattr(recorder_of().ideal(name), field)
    return float(np.sqrt(np.mean(error**2)))


def found_by(case, seed):
    """Tune a log with some sigmas wrong by 2; returns the tuning, and the keys."""
    wrong = CASES[case]
    factor = np.where(np.random.default_rng([seed, 7]).random(len(wrong)) < 0.5, 0.5, 2.0)
    return tune([drawn(seed)], vehicle_from_toml(text_of(wrong, factor)), process=case == "gyro"), wrong


def covers(sigma, truth):
    """Whether the interval holds the truth, and is narrow enough to speak against a sigma wrong by 2."""
    return sigma.determined and sigma.low <= truth <= sigma.high and not sigma.low <= sigma.value <= sigma.high


def coverage(runs, first=0):
    """How often each key was found within its interval."""
    counts = defaultdict(int)
    for case in CASES:
        for seed in range(first, first + runs):
            found, wrong = found_by(case, seed)
            for key in wrong:
                counts[key] += covers(found[key], TRUE[key])
    return dict(counts)


def test_a_sigma_wrong_by_two_is_found_within_its_interval():
    runs = 3
    counts = coverage(runs, first=1000)
    assert sum(counts.values()) >= binom.ppf(0.001, runs * len(counts), 0.95), counts


def test_the_estimate_is_the_noise_that_the_log_really_has():
    log = drawn(1)
    found = tune([log], vehicle_from_toml(text_of(("dvl.sigma_mps", "depth.sigma_m"), (2.0, 0.5))), sensors=["dvl", "depth"])
    for key, name, field in (("dvl.sigma_mps", "dvl", "velocity"), ("depth.sigma_m", "depth", "depth")):
        sigma = found[key]
        scale = np.sqrt(1.0 / (1.0 + ABOARD["dvl"].nuisance["scale"].sigma[0])) if name == "dvl" else 1.0
        assert scale * realised(log, name, field) == pytest.approx(sigma.estimate, rel=0.5 * (sigma.high / sigma.low - 1.0))
    assert found.gain > 50.0


def test_what_a_gate_cuts_off_shrinks_no_sigma():
    """A gate of 90 % takes 11 % of the normalised squares of what it lets through: without correction, sigmas sink far below."""
    log = drawn(2)
    tight = text_of(("dvl.sigma_mps",), 2.0).replace("[sensors.dvl]", "[sensors.dvl]\ngate_probability = 0.9")
    found = tune([log], vehicle_from_toml(tight), sensors=["dvl"])["dvl.sigma_mps"]
    plain = tune([log], vehicle_from_toml(text_of(("dvl.sigma_mps",), 2.0)), sensors=["dvl"])["dvl.sigma_mps"]
    assert found.left_out > 0.05 * found.rows
    assert found.low <= 0.01 <= found.high
    assert found.estimate == pytest.approx(plain.estimate, rel=0.06)
    assert found.high / found.low > plain.high / plain.low


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_outliers_do_not_blow_a_sigma_up(factor):
    log, generator = drawn(3), np.random.default_rng(5)
    velocity, north = log["dvl"].velocity.copy(), log["usbl"].latitude.copy()
    bad = generator.random(len(velocity)) < 0.05
    velocity[bad] += generator.choice([-1.0, 1.0], (bad.sum(), 3)) * generator.uniform(0.1, 2.0, (bad.sum(), 3))
    wild = generator.random(len(north)) < 0.1
    north[wild] += generator.uniform(10.0, 200.0, wild.sum()) / 6.37e6
    tables = {"dvl": replace(log["dvl"], velocity=velocity), "usbl": replace(log["usbl"], latitude=north)}
    told = vehicle_from_toml(text_of(("dvl.sigma_mps", "usbl.sigma_m"), factor))
    found = tune([replace(log, tables={**log.tables, **tables})], told)
    for key, count in (("dvl.sigma_mps", bad.sum()), ("usbl.sigma_m", wild.sum())):
        assert found[key].estimate == pytest.approx(TRUE[key], rel=0.2), key
        assert count <= found[key].left_out <= count + 4, key
        assert any("outside the gate" in words for words in found[key].remarks)


def test_errors_that_wander_are_named_and_widen_the_interval():
    made = instruments_of(ABOARD)
    slow = replace(made["heading"], bias=Drift(steady=radians(1.0), tau=10.0))
    log = Recorder(TRAJECTORY, made | {"heading": slow}, truth_rate=0.1, start=START).draw(4)
    white, coloured = tune([drawn(4)], ABOARD), tune([log], ABOARD)
    assert not white.not_white
    assert list(coloured.not_white) == ["heading"]
    assert "autocorrelation" in coloured.not_white["heading"]
    assert coloured["heading.sigma_deg"].enlarged > 1.3
    assert coloured["dvl.sigma_mps"].enlarged < 1.3


def test_more_logs_know_more():
    logs = [drawn(seed) for seed in range(4)]
    one, four = (tune(some, ABOARD, sensors=["dvl"])["dvl.sigma_mps"] for some in (logs[:1], logs))
    assert np.log(four.high / four.low) == pytest.approx(0.5 * np.log(one.high / one.low), rel=0.15)
    assert four.rows > 3.9 * one.rows


def test_what_a_log_cannot_determine_is_said_and_stays_out_of_the_fragment():
    still = text_of().replace("gyro_bias_deg_per_h", "gyro_bias_instability_deg_per_h = 0.001\ngyro_bias_deg_per_h")
    found = tune([drawn(5, duration=60.0)], vehicle_from_toml(still), process=True)
    few, walk = found["usbl.sigma_m"], found["imu.gyro_bias_instability_deg_per_h"]
    assert few.rows < FEWEST
    assert not few.determined
    assert "fewer than 20" in few.remarks[0]
    assert not walk.determined
    assert "not determined" in walk.remarks[0]
    lines = [line for line in fragment(found).splitlines() if not line.startswith("#")]
    assert not any("sigma_m " in line and "0.5" in line for line in lines)
    assert not any("instability" in line for line in lines)
    assert any(line.startswith("sigma_mps = ") for line in lines)


def test_process_noise_that_is_not_there_is_not_told_from_zero():
    quiet = replace(instruments_of(ABOARD)["imu"], accel_density=0.0)
    log = Recorder(TRAJECTORY, instruments_of(ABOARD) | {"imu": quiet}, truth_rate=0.1, start=START).draw(6)
    found = tune([log], ABOARD, sensors=["imu"])
    assert not found["imu.accel_noise_ug_per_rthz"].determined
    assert found["imu.gyro_noise_deg_per_rth"].determined


def test_each_key_of_a_sensor_is_found_by_itself():
    more = "[sensors.ahrs]\nkind = 'attitude'\nrate_hz = 2.0\nsigma_deg = {}\nsigma_tilt_deg = {}\n"
    log = Recorder(TRAJECTORY, instruments_of(vehicle_from_toml(text_of(more=more.format(1.0, 0.2)))), truth_rate=0.1, start=START).draw(7)
    log = replace(log, tables={**log.tables, "ahrs": replace(log["ahrs"], sigma=None)})
    found = tune([log], vehicle_from_toml(text_of(more=more.format(2.0, 0.1))), sensors=["ahrs"])
    for key, truth in (("ahrs.sigma_deg", 1.0), ("ahrs.sigma_tilt_deg", 0.2)):
        assert found[key].estimate == pytest.approx(truth, rel=0.12)
        assert found[key].low < found[key].estimate < found[key].high


def test_a_column_of_sigmas_is_told_a_factor_and_written_nowhere():
    log = drawn(8)
    stated = replace(log["usbl"], sigma=np.full(len(log["usbl"]), 1.0))
    found = tune([replace(log, tables={**log.tables, "usbl": stated})], ABOARD, sensors=["usbl"])
    (sigma,) = found.sigmas
    assert sigma.key == ""
    assert sigma.low <= 0.5 <= sigma.high
    assert any("no key scales it" in words for words in sigma.remarks)
    assert "[sensors.usbl]" not in fragment(found)
    assert "times 0.5" in fragment(found) or "times 0.4" in fragment(found)


def test_rows_that_state_their_sigma_keep_it_beside_those_that_do_not():
    log = drawn(8)
    stated = replace(
        log["heading"], sigma=np.where(np.arange(len(log["heading"])) % 3 == 0, TRUE["heading.sigma_deg"], np.nan) * radians(1.0)
    )
    found = tune([replace(log, tables={**log.tables, "heading": stated})], vehicle_from_toml(text_of(("heading.sigma_deg",), 2.0)))
    sigma = found["heading.sigma_deg"]
    assert sigma.low <= TRUE["heading.sigma_deg"] <= sigma.high
    assert any("81 more rows do not depend on it" in words for words in sigma.remarks), sigma.remarks


def test_a_ratio_of_one_leaves_a_run_as_the_file_has_it():
    recording = Recording(drawn(9, duration=60.0), ABOARD)
    before = recording.run(np.zeros(0))
    knobs = knobs_of(ABOARD, [recording], tuple(ABOARD.sensors), process=True)
    changed, back = recording.run(np.full(len(knobs), 1.5)), recording.run(np.ones(len(knobs)))
    assert len(knobs) == 6
    assert not np.array_equal(before.log_det, changed.log_det)
    for name in ("nis", "log_det", "residual", "outcome"):
        assert np.array_equal(getattr(before, name), getattr(back, name), equal_nan=True)


def test_the_interval_is_that_of_chi_square():
    """Of n values the variance of log sigma is 1 / 2n; the exact interval of their sigma is known."""
    for n in (20, 1000):
        low, high = interval(1.0 / (2.0 * n))
        assert low == pytest.approx(np.sqrt(n / chi2.ppf(0.975, n)), rel=1e-6)
        assert high == pytest.approx(np.sqrt(n / chi2.ppf(0.025, n)), rel=1e-6)


def test_the_fragment_is_read_over_the_vehicle_file(tmp_path):
    found = tune([drawn(10)], vehicle_from_toml(text_of(("dvl.sigma_mps", "imu.gyro_noise_deg_per_rth"), 2.0)), process=True)
    (tmp_path / "vehicle.toml").write_text(text_of(("dvl.sigma_mps", "imu.gyro_noise_deg_per_rth"), 2.0))
    (tmp_path / "fragment.toml").write_text(fragment(found))
    both = read_vehicle(tmp_path / "vehicle.toml", tmp_path / "fragment.toml")
    assert both["dvl"].values["sigma"] == pytest.approx(found["dvl.sigma_mps"].estimate, rel=1e-3)
    assert both["imu"].values["gyro_noise"] == pytest.approx(radians(found["imu.gyro_noise_deg_per_rth"].estimate) / 60.0, rel=1e-3)
    assert both["dvl"].nuisance["scale"].sigma[0] == pytest.approx(0.003)
    assert np.array_equal(both["dvl"].lever_arm_b, ABOARD["dvl"].lever_arm_b)
    assert both["usbl"].values["vertical"] is False


def test_the_command_writes_the_fragment_and_refuses_what_it_cannot_use(tmp_path, capsys):
    log = drawn(11, duration=60.0)
    write_log(log, tmp_path / "a")
    write_log(log.without("imu"), tmp_path / "bare")
    silent = replace(log["heading"], valid=np.zeros(len(log["heading"])))
    write_log(replace(log, tables={**log.tables, "heading": silent}), tmp_path / "silent")
    (tmp_path / "v.toml").write_text(text_of(("dvl.sigma_mps",), 2.0))
    common = ["--vehicle", str(tmp_path / "v.toml")]
    assert cli.run(["tune", str(tmp_path / "a"), *common, "--sensors", "dvl", "--out", str(tmp_path / "f.toml")]) == 0
    assert "sigma_mps" in capsys.readouterr().out
    assert (tmp_path / "f.toml").read_text().startswith("#")
    assert read_vehicle(tmp_path / "v.toml", tmp_path / "f.toml")["dvl"].values["sigma"] < 0.013
    assert cli.run(["tune", str(tmp_path / "a"), *common, "--sensors", "dvl", "--json"]) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["sigmas"][0]["key"] == "sigma_mps"
    assert document["fragment"].startswith("#")
    assert told.err == ""
    for arguments, words in (
        ([str(tmp_path / "a"), *common, "--sensors", "dlv"], "did you mean 'dvl'?"),
        ([str(tmp_path / "bare"), *common], "has no table 'imu'"),
        ([str(tmp_path / "silent"), *common, "--sensors", "heading"], "gives no row"),
        ([str(tmp_path / "nowhere"), *common], "nowhere"),
        ([str(tmp_path / "a"), *common, "--out", str(tmp_path / "f.toml")], "is there already"),
    ):
        assert cli.run(["tune", *arguments]) == 2
        told = capsys.readouterr()
        assert words in told.err
        assert told.err.count("\n") == 1
    with pytest.raises(InputError, match="at least one"):
        tune([], ABOARD)


if __name__ == "__main__":
    asked = [int(word) for word in sys.argv[1:]]
    number = asked[0] if asked else 100
    for name, count in coverage(number, asked[1] if len(asked) > 1 else 0).items():
        held = interval_of_fraction(count, number)
        print(f"{name:32} {count} of {number}   99 %: {held.low:.3f} to {held.high:.3f}")
