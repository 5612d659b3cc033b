"""Scale, mounting and lever arm of a Doppler log: found within their sigmas, logs held against each other, refused where not to be had."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline import cli
from leadline.calibrate.dvl import BROAD, Light, calibrate_dvl, combined, fragment
from leadline.data.errors import InputError
from leadline.data.vehicle import read_vehicle, vehicle_from_toml
from leadline.formats.folder import write_log
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

VEHICLE = """
name = "calibrated"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
rate_hz = 2.0
sigma_mps = 0.01
mounting_deg = [0.0, 0.0, 45.0]
lever_arm_m = [-0.5, 0.0, 0.2]
[sensors.depth]
rate_hz = 2.0
sigma_m = 0.05
[sensors.heading]
rate_hz = 1.0
sigma_deg = 0.2
[sensors.gnss]
rate_hz = 0.1
sigma_m = 0.5
"""
ABOARD = vehicle_from_toml(VEHICLE)
PLACE = Place(radians(45.0), radians(10.0), depth=10.0)
TRAJECTORY = survey(PLACE, Lawnmower(legs=4, length=120.0, spacing=30.0, speed=1.5), duration=420.0)
START = StartSigmas(position=1.0, depth=0.1, velocity=0.05, tilt=radians(0.2), heading=radians(0.5))
SCALE, TWIST, ARM = 0.008, 0.010, np.array([-0.3, 0.1, 0.2])  # as they truly are


@pytest.fixture(scope="module")
def recorder():
    made = instruments_of(ABOARD)
    made["gnss"] = replace(made["gnss"], max_depth=1e3)
    turned = replace(made["dvl"], scale=SCALE, mounting_bs=(0.0, 0.0, radians(45.0) + TWIST), lever_arm_b=tuple(ARM))
    return Recorder(TRAJECTORY, made | {"dvl": turned}, truth_rate=0.1, start=START)


def error_of(found):
    """Estimates less truth, in sigmas: scale, heading of the mounting, lever arm."""
    arm = ARM - ABOARD["dvl"].lever_arm_b
    error = np.array([found.value[0] - SCALE, found.value[3] - TWIST, *(found.value[4:] - arm)])
    return error / found.sigma[[0, 3, 4, 5, 6]]


@pytest.mark.parametrize("reference", ["fixes", "truth"])
def test_it_is_found_within_its_sigmas(recorder, reference):
    squares = []
    for pair in range(8):
        found = calibrate_dvl([recorder.draw(2 * pair), recorder.draw(2 * pair + 1)], ABOARD, reference=reference)
        assert found.sigma[0] < 0.003
        assert found.sigma[3] < 0.004
        assert found.enlarged == 1.0
        squares.append(error_of(found) ** 2)
    total = np.sum(squares, axis=0)  # each chi-square with 8 degrees of freedom, or less where truth is better than it says
    assert (total < 26.1).all(), total  # 0.1 % above it
    if reference == "fixes":
        assert total.sum() > 15.0  # 40 values: 0.01 % below


def test_more_logs_know_more_and_ends_know_less(recorder):
    logs = [recorder.draw(seed) for seed in range(4)]
    one, four = calibrate_dvl(logs[:1], ABOARD, reference="fixes"), calibrate_dvl(logs, ABOARD, reference="fixes")
    ends = calibrate_dvl(logs, ABOARD, reference="ends")
    assert four.sigma[0] == pytest.approx(one.sigma[0] / 2, rel=0.2)
    assert ends.sigma[0] > four.sigma[0]
    assert one.light != Light.GREEN


def test_logs_that_disagree_turn_the_light(recorder):
    good, odd = recorder.draw(1), recorder.draw(2)
    scaled = replace(odd["dvl"], velocity=odd["dvl"].velocity * 1.03)
    found = calibrate_dvl([good, replace(odd, tables={**odd.tables, "dvl": scaled})], ABOARD, reference="fixes")
    assert found.p < 1e-3
    assert found.enlarged > 2.0
    assert found.light != Light.GREEN


def test_a_log_that_says_nothing_leaves_the_light_red():
    found = combined("dvl", ["still"], np.zeros(7), [(np.zeros(7), np.diag(BROAD**2) * 0.999)])
    assert found.light == Light.RED
    assert "do not determine" in found.sentence


def test_the_fragment_is_read_over_the_vehicle_file(recorder, tmp_path):
    found = calibrate_dvl([recorder.draw(1), recorder.draw(2)], ABOARD, reference="fixes")
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    (tmp_path / "fragment.toml").write_text(fragment(found, ABOARD))
    both = read_vehicle(tmp_path / "vehicle.toml", tmp_path / "fragment.toml")
    assert both["dvl"].nuisance["scale"].value[0] == pytest.approx(found.value[0], abs=1e-6)
    assert both["dvl"].nuisance["mounting"].sigma == pytest.approx(found.sigma[1:4], abs=2e-6)
    assert both["dvl"].values["sigma"] == 0.01
    assert np.array_equal(both["dvl"].rotation_bs, ABOARD["dvl"].rotation_bs)


def test_the_command_writes_the_fragment_and_refuses_what_it_cannot_use(recorder, tmp_path, capsys):
    log = recorder.draw(3)
    write_log(log, tmp_path / "a")
    write_log(replace(log, tables={k: v for k, v in log.tables.items() if k not in ("gnss", "truth")}), tmp_path / "bare")
    (tmp_path / "v.toml").write_text(VEHICLE)
    common = ["--vehicle", str(tmp_path / "v.toml")]
    assert cli.run(["calibrate", "dvl", str(tmp_path / "a"), *common, "--out", str(tmp_path / "f.toml")]) == 0
    assert "together" in capsys.readouterr().out
    assert (tmp_path / "f.toml").read_text().startswith("#")
    for arguments, words in (
        ([str(tmp_path / "bare"), *common], "no gnss or position_fix"),
        ([str(tmp_path / "bare"), *common, "--reference", "truth"], "no table of kind truth"),
        ([str(tmp_path / "a"), *common, "--reference", "nothing.csv"], "is no file"),
        ([str(tmp_path / "a"), *common, "--sensor", "dlv"], "did you mean 'dvl'?"),
        ([str(tmp_path / "a"), *common, "--out", str(tmp_path / "f.toml")], "is there already"),
    ):
        assert cli.run(["calibrate", "dvl", *arguments]) == 2
        told = capsys.readouterr()
        assert words in told.err
        assert told.err.count("\n") == 1
    with pytest.raises(InputError, match="at least one"):
        calibrate_dvl([], ABOARD)
