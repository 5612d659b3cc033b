"""One log through several configurations: what is told of each is what it is, whatever the others are."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import radians
from typing import TYPE_CHECKING

import numpy as np
import pytest

from leadline import cli
from leadline.assess.comparison import as_truth, inside_of, nees_of
from leadline.assess.errors import Errors, errors_of
from leadline.core.geodesy import north_east
from leadline.data.errors import InputError
from leadline.data.log import Log
from leadline.data.vehicle import Vehicle, read_vehicle, vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.formats.folder import write_log
from leadline.formats.solution import read_solution
from leadline.missions.compare import COMPARISON, PAGE, compare, compare_folder
from leadline.missions.configuration import Configuration, configuration_of, configurations_of, read_configuration
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

if TYPE_CHECKING:
    from pathlib import Path

VEHICLE = """
name = "small"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
[sensors.depth]
rate_hz = 2.0
sigma_m = 0.05
[sensors.heading]
rate_hz = 1.0
sigma_deg = 0.3
[sensors.usbl]
kind = "position_fix"
rate_hz = 0.0125
sigma_m = 1.0
"""
LOOSE = """
note = "a Doppler log taken for worse than it is"
[sensors.dvl]
sigma_mps = 0.05
"""


def small() -> Vehicle:
    return vehicle_from_toml(VEHICLE)


@pytest.fixture(scope="module")
def log() -> Log:
    place, plan = Place(radians(45.0), radians(10.0), depth=20.0), Lawnmower(legs=2, length=60.0, speed=1.5)
    recorder = Recorder(survey(place, plan, duration=170.0), instruments_of(small()), truth_rate=10.0, start=StartSigmas(2.0), name="dive")
    return recorder.draw(4)


@pytest.fixture
def place(log: Log, tmp_path: Path) -> Path:
    write_log(log, tmp_path / "dive")
    (tmp_path / "vehicle.toml").write_text(VEHICLE)
    (tmp_path / "loose.toml").write_text(LOOSE)
    return tmp_path


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_errors_are_truth_minus_estimate(log: Log) -> None:
    found = compare(log, small(), ["ekf", Configuration("no fixes", without=("usbl",))])
    solution, truth = solve(log, small().without("usbl")), log.truth
    assert truth is not None
    assert truth.latitude is not None
    assert truth.longitude is not None
    assert truth.velocity is not None
    np.testing.assert_allclose(solution.time, truth.time, atol=1e-9)
    true = np.stack(north_east(truth.latitude, truth.longitude, solution.origin.latitude, solution.origin.longitude))
    apart = np.hypot(*(true - [solution.north, solution.east]))
    told = found.runs[1].score.errors
    # north and east of an origin that is 200 m away: a sphere turns by 3e-5 over that, and so does an error of a few metres
    assert told["horizontal"].rms == pytest.approx(rms(apart), rel=1e-4)
    assert told["horizontal"].end == pytest.approx(apart[-1], rel=1e-4)
    assert told["velocity"].rms == pytest.approx(rms(np.linalg.norm(truth.velocity - solution.velocity_n, axis=1)), rel=1e-4)
    assert found.runs[0].score.errors["horizontal"].rms != told["horizontal"].rms


def test_differences_are_from_the_first_that_was_solved(log: Log) -> None:
    wrong = Configuration("wrong", without=("sonar",))
    found = compare(log, small(), [wrong, "ekf", Configuration("again"), Configuration("no fixes", without=("usbl",))])
    assert found.reference == "ekf"
    assert "has no sensor 'sonar'" in found.runs[0].refusal
    assert found.runs[1].score.apart == {}
    assert all(spread.maximum < 1e-6 for spread in found.runs[2].score.apart.values())  # rounding of an Earth-fixed position: 1e-9 m
    one, two = solve(log, small()), solve(log, small().without("usbl"))
    expected = rms(np.hypot(one.north - two.north, one.east - two.east))
    assert found.runs[3].score.apart["horizontal"].rms == pytest.approx(expected, rel=1e-4)


def test_without_truth_misclosures_and_differences_are_told(log: Log) -> None:
    found = compare(log.without("truth"), small(), ["ekf", Configuration("smooth", smooth=True)])
    for run in found.runs:
        assert run.score.errors == {}
        assert run.score.misclosure is not None
        assert run.score.misclosure.count == 2  # fixes at 80 s and 160 s
    assert found.runs[1].score.apart["horizontal"].rms > 0.0
    assert found.to_dict()["truth"] is False


def test_shares_and_nees_of_known_errors() -> None:
    rng = np.random.default_rng(3)
    error = rng.standard_normal((4000, 9))
    made = Errors(np.arange(4000.0), 2.0 * error, np.tile(np.diag(np.full(9, 4.0)), (4000, 1, 1)), np.zeros(4000))
    assert nees_of(made)["position"] == pytest.approx(np.mean(error[:, :3] ** 2), rel=1e-12)
    assert inside_of(made)["velocity"] == np.mean(np.abs(error[:, 3:6]) <= 3.0)
    assert nees_of(replace(made, error=4.0 * error))["all"] == pytest.approx(4.0 * np.mean(error**2), rel=1e-12)
    assert np.isnan(inside_of(replace(made, error=np.full((4000, 9), np.nan)))["heading"])


def test_a_solution_is_no_error_from_itself(log: Log) -> None:
    solution = solve(log, small())
    errors = errors_of(solution, as_truth(solution))
    assert len(errors) == len(solution)
    assert np.abs(errors.error).max() < 1e-6  # rounding of an Earth-fixed position: 6.4e6 m in double precision is 1e-9 m


def test_words_of_a_command_line() -> None:
    assert configuration_of("ukf") == Configuration("ukf", "ukf", where="ukf")
    assert configuration_of("cruise") == Configuration("cruise", "ekf", "cruise", where="cruise")
    assert configuration_of("planar+ukf:alpha=0.1,kappa=0").estimator == "ukf:alpha=0.1,kappa=0"
    assert configuration_of("mine.py:model+ckf").process == "mine.py:model"
    assert configuration_of("mine.py:model").process == "mine.py:model"
    assert configuration_of("cruise+ukf").folder == "cruise-ukf"
    with pytest.raises(InputError, match="there are none"):
        configurations_of([])
    with pytest.raises(InputError, match="2 of that name"):
        configurations_of(["ekf", "ekf"])
    with pytest.raises(InputError, match="2 of that folder"):
        configurations_of(["cruise+ekf", Configuration("cruise-ekf")])


def test_a_run_file_lays_its_keys_over_those_of_the_vehicle_file(place: Path) -> None:
    found = read_configuration(place / "loose.toml")
    vehicle = found.aboard(place / "vehicle.toml")
    assert found.name == "loose"
    assert vehicle["dvl"].values["sigma"] == 0.05
    assert vehicle["dvl"].values["rate"] == 5.0
    assert read_vehicle(place / "vehicle.toml")["dvl"].values["sigma"] == 0.01
    (place / "runs").mkdir()
    (place / "part.toml").write_text("[sensors.depth]\nsigma_m = 0.2\n")
    text = (
        'name = "b"\nvehicle = "../vehicle.toml"\nprocess = "cruise"\ncalibration = ["../part.toml"]\nset = {{ points = {{ nose = {} }} }}'
    )
    (place / "runs" / "b.toml").write_text(text.replace("{{", "{").replace("}}", "}").replace("{}", "{ lever_arm_m = [1.0, 0.0, 0.0] }"))
    other = read_configuration(place / "runs" / "b.toml").aboard(None)
    assert other.process.model == "cruise"
    assert other["depth"].values["sigma"] == 0.2
    assert other.points["nose"][0] == 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("estimater = 'ukf'", r"unknown key 'estimater' \('ukf'\); did you mean 'estimator'"),
        ("smooth = true\nas_live = true", "has smooth and as_live"),
        ("set = { sensors = {} }\n[sensors.dvl]\nsigma_mps = 1.0", r"stands beside \[sensors\]"),
        ("smooth = 'yes'", "true or false"),
        ("process = 'planar'\nset = { process = 3 }", "set.process: 3; a table of keys"),
        ("smooth = ", "is not TOML"),
    ],
)
def test_a_wrong_run_file_is_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_configuration(tmp_path / "a.toml")
    assert "\n" not in str(error.value)
    assert "a.toml" in str(error.value)


def test_a_wrong_key_over_the_vehicle_file_names_the_run_file(place: Path) -> None:
    (place / "bad.toml").write_text("[sensors.dvl]\nsigma_mpss = 1.0\n")
    with pytest.raises(InputError, match=r"under .*bad\.toml.*sigma_mpss"):
        read_configuration(place / "bad.toml").aboard(place / "vehicle.toml")
    with pytest.raises(InputError, match="no vehicle file"):
        read_configuration(place / "loose.toml").aboard(small())


def test_the_folder_holds_all_that_was_solved(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = place / "out"
    found = compare_folder(place / "dive", place / "vehicle.toml", ["ekf", str(place / "loose.toml"), "nonesuch"], out)
    assert sorted(entry.name for entry in out.iterdir()) == [PAGE, COMPARISON, "ekf", "loose"]
    assert read_solution(out / "loose").summary["verdict"]["answer"] == "not consistent"
    told = json.loads((out / COMPARISON).read_text())
    assert [run["refused"] is None for run in told["runs"]] == [True, True, False]
    assert told["runs"][0]["errors"]["horizontal"]["rms"] == found.runs[0].score.errors["horizontal"].rms
    page = (out / PAGE).read_text("utf-8")
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.https?:", page)
    figures = [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)]
    assert len(figures) == 3
    assert {"truth", "ekf", "loose"} <= {trace["name"] for trace in figures[0]["data"]}
    bands = [trace for trace in figures[1]["data"] if trace.get("fill") == "toself"]
    assert len(bands) == 2 * 7  # of two runs, for each of seven errors
    with pytest.raises(InputError, match="is there already"):
        compare_folder(place / "dive", place / "vehicle.toml", ["ekf"], out)


def test_nothing_is_written_where_all_are_refused_or_writing_fails(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="was refused, as were all"):
        compare_folder(place / "dive", place / "vehicle.toml", ["nonesuch"], place / "out")
    assert not (place / "out").exists()

    def failing(*_: object) -> str:
        raise RuntimeError("the page")

    monkeypatch.setattr("leadline.report.compare.comparison_page", failing)
    before = sorted(place.iterdir())
    with pytest.raises(RuntimeError, match="the page"):
        compare_folder(place / "dive", place / "vehicle.toml", ["ekf"], place / "out")
    assert sorted(place.iterdir()) == before


def test_the_command(place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(place)
    words = ["compare", "dive", "--vehicle", "vehicle.toml", "--runs", "ekf", "loose.toml", "nonesuch"]
    assert cli.run([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [run["name"] for run in told["runs"]] == ["ekf", "loose", "nonesuch"]
    assert told["runs"][0]["cost_us_per_s"] > 0.0
    assert cli.run([*words, "--out", "side"]) == 0
    shown = capsys.readouterr().out
    assert "ekf: Consistent" in shown
    assert "nonesuch: refused: estimator" in shown
    assert "Differences from ekf" in shown
    assert cli.run(["compare", "dive", "--vehicle", "vehicle.toml"]) == 2
    assert "runs: there are none" in capsys.readouterr().err
