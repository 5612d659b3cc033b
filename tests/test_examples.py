"""Each example runs, as its first lines say, and says what it should."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from short_dive import EXAMPLES, write_short_dive

import leadline
from leadline.estimate.solve import solve

RUN = {
    "as_library.py": ["dive", "vehicle.toml"],
    "live.py": ["dive", "vehicle.toml", "30"],
    "own_process.py": [],
    "own_sensor.py": [],
    "score_logs.py": ["--vehicle", "vehicle.toml", "dive"],
    "simulate.py": ["missions/survey.toml", "2"],
    "synthetic_dive.py": ["made", "--seed", "2"],
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("examples")
    write_short_dive(found)
    return found


def run(place: Path, name: str) -> str:
    command = [sys.executable, f"examples/{name}", *RUN[name]]
    found = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=300, check=False)
    assert found.returncode == 0, found.stderr
    assert found.stderr == ""
    return found.stdout


def test_every_example_is_run_here() -> None:
    assert set(RUN) == {file.name for file in EXAMPLES.glob("*.py")}


def test_every_vehicle_file_is_right() -> None:
    for vehicle in EXAMPLES.glob("*.toml"):
        assert leadline.read_vehicle(vehicle).sensors


def test_as_library(place: Path) -> None:
    said = run(place, "as_library.py")
    found = re.search(r"horizontal error: ([\d.]+) m rms", said)
    assert found is not None, said
    assert float(found[1]) < 3.0


def test_live_says_what_solving_the_log_says(place: Path) -> None:
    said = [line for line in run(place, "live.py").splitlines() if "north" in line]
    solution = solve(leadline.read_log(place / "dive"), leadline.read_vehicle(place / "vehicle.toml"))
    assert len(said) == 4
    for line in said:
        time, north, east, _ = (float(number) for number in re.findall(r"-?\d+\.\d+", line)[:4])
        nearest = abs(solution.time - time).argmin()
        assert abs(solution.north[nearest] - north) < 0.3  # a tenth of a second at 1.5 m/s, and what has not arrived yet
        assert abs(solution.east[nearest] - east) < 0.3


def test_own_sensor(place: Path) -> None:
    said = run(place, "own_sensor.py")
    assert "'used': 240" in said
    found = re.search(r"depth: ([\d.]+) m rms", said)
    assert found is not None, said
    assert float(found[1]) < 0.05


@pytest.mark.parametrize("name", ["own_sensor.py", "own_process.py"])
def test_ones_own_stays_short(name: str) -> None:
    assert len((EXAMPLES / name).read_text().splitlines()) <= 60


def test_own_process(place: Path) -> None:
    """Every estimator is nearer than a fix, which is 2 m off."""
    found = re.findall(r"(\w+): ([\d.]+) m rms north", run(place, "own_process.py"))
    assert [name for name, _ in found] == ["ekf", "ukf", "pf"]
    assert all(float(error) < 2.0 for _, error in found)


def test_synthetic_dive(place: Path) -> None:
    assert run(place, "synthetic_dive.py").startswith("made: imu 180001")
    assert leadline.read_log(place / "made").truth is not None


def test_simulate(place: Path) -> None:
    said = run(place, "simulate.py").splitlines()
    assert said[0].startswith("survey: REMUS 100, ")
    errors = [float(found[1]) for line in said[1:] if (found := re.search(r"^run \d: ([\d.]+) m rms, ", line))]
    assert len(errors) == 2
    assert errors[0] != errors[1]  # other noise
    assert max(errors) < 3.0  # DVL, beacons and fixes of metres


def test_simulate_stays_short() -> None:
    assert len((EXAMPLES / "simulate.py").read_text().splitlines()) <= 60


def test_score_logs(place: Path) -> None:
    assert "dive" in run(place, "score_logs.py")
