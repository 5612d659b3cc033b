"""What estimators cost: beside filterpy, by step and by update on the survey, and the first use of each with nothing compiled yet.

    pytest benchmarks/test_estimators.py --benchmark-columns=min,median,rounds -s

filterpy's UnscentedKalmanFilter runs the process model `body-velocity` as its documentation asks for it: functions of one point, in NumPy.
Each of its runs stands between two of ours, and the median of the ratios counts.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from twin import dive, rotation, vehicle

from leadline.data.log import Log
from leadline.data.vehicle import Vehicle
from leadline.estimate.assembly import navigator_for
from leadline.estimate.events import Events
from leadline.estimate.navigator import Navigator
from leadline.estimate.plan import IS_INPUT
from leadline.estimate.solve import stream_of
from leadline.formats.folder import write_log
from leadline.missions.mission import read_mission
from leadline.missions.simulation import sailed

SURVEY = Path(__file__).parents[1] / "missions" / "survey.toml"
GRAVITY = np.array([0.0, 0.0, 9.8])
EARTH_N = 7.292115e-5 * np.array([np.cos(0.57), 0.0, -np.sin(0.57)])


def timed(work: Callable[[], Any]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def only(events: Events, keep: np.ndarray) -> Events:
    """Some of the events."""
    chosen = {f.name: getattr(events, f.name) for f in fields(events)}
    return replace(events, **{k: v[keep] for k, v in chosen.items() if isinstance(v, np.ndarray) and len(v) == len(keep) and k != "data"})


def seconds(navigator: Navigator, events: Events, rounds: int) -> float:
    """The quickest of some runs from the state at the start."""
    start, found = navigator.state.copy(), []
    for _ in range(rounds):
        navigator.state[:] = start
        found.append(timed(lambda: navigator.run(events)))
    navigator.state[:] = start
    return min(found)


def moved_by_points(x: np.ndarray, dt: float, u: np.ndarray) -> np.ndarray:
    """Position (m), velocity in body axes and rotation vector after a step: the strapdown equations, Earth's turning in them."""
    rotation_nb = rotation(x[6:9])
    rate = u[0:3] - rotation_nb.T @ EARTH_N
    velocity = x[3:6] + dt * (u[3:6] + rotation_nb.T @ GRAVITY - np.cross(rate + rotation_nb.T @ EARTH_N, x[3:6]))
    turned = rotation_nb @ rotation(rate * dt)
    angle = np.arccos(np.clip(0.5 * (np.trace(turned) - 1.0), -1.0, 1.0))
    axis = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
    vector = axis * (0.5 * angle / np.sin(angle) if angle > 1e-8 else 0.5)
    return np.concatenate([x[0:3] + dt * (rotation_nb @ x[3:6]), velocity, vector])


def test_beside_filterpy(benchmark: Any) -> None:
    """Microseconds per 100 Hz step of the unscented filter with nine states, and how many times longer filterpy takes."""
    filterpy = pytest.importorskip("filterpy.kalman")
    log, aboard = dive(60.0), vehicle("dvl", "depth", "heading").moved_by("body-velocity")
    navigator, _, _ = navigator_for(log, aboard, estimator="ukf")
    events = stream_of(log, aboard, navigator, rate=1.0).events
    steps = only(events, events.kind == IS_INPUT)
    inputs = [steps.data[a:b] for a, b in zip(steps.start[:300], steps.stop[:300], strict=True)]
    points = filterpy.MerweScaledSigmaPoints(9, alpha=1.0, beta=2.0, kappa=-6.0)
    opponent = filterpy.UnscentedKalmanFilter(9, 3, 0.01, hx=lambda x: x[3:6], fx=moved_by_points, points=points)
    opponent.P, opponent.Q = np.eye(9) * 1e-2, np.eye(9) * 1e-9

    def theirs() -> None:
        for u in inputs:
            opponent.predict(u=u)

    start = navigator.state.copy()

    def ours() -> None:
        navigator.state[:] = start
        navigator.run(steps)

    ours()
    ratios = []
    for _ in range(5):
        before, dense, after = timed(ours), timed(theirs), timed(ours)
        ratios.append(dense / len(inputs) / (0.5 * (before + after) / len(steps)))
    benchmark.pedantic(ours, rounds=20)
    mine = benchmark.stats.stats.min / len(steps) * 1e6
    benchmark.extra_info.update(us_per_step=round(mine, 2), ratio=round(statistics.median(ratios)))
    print(f"\n{benchmark.extra_info}")
    assert np.isfinite(opponent.x).all()
    assert np.isfinite(navigator.state[navigator.composition.layout.x]).all()


@cache
def survey() -> tuple[Log, Vehicle]:
    """The first ten minutes of the survey, and the vehicle that sails it."""
    mission = read_mission(SURVEY)
    return sailed(replace(mission, duration=600.0, faults=())).log(0, keep=False), mission.vehicle


@pytest.mark.parametrize("model", ["inertial", "body-velocity"])
@pytest.mark.parametrize("spec", ["ekf", "ekf-ukf", "ukf", "ckf", "srukf", "srckf", "ukf:noise=augmented", "ekf:adaptive=rq"])
def test_by_step_and_by_update(benchmark: Any, model: str, spec: str) -> None:
    """Microseconds per inertial step and per update on the survey: all events, and inputs alone, of the same stream."""
    log, aboard = survey()
    aboard = aboard.moved_by(model)
    navigator, _, _ = navigator_for(log, aboard, estimator=spec)
    events = stream_of(log, aboard, navigator, rate=1.0).events
    inputs, measured = events.kind == IS_INPUT, int(events.measured.sum())
    kept = only(events, inputs | events.measured)
    whole, bare = seconds(navigator, kept, 3), seconds(navigator, only(events, inputs), 3)
    benchmark.pedantic(lambda: navigator.run(kept), rounds=1)
    benchmark.extra_info.update(
        states=navigator.composition.layout.fixed, us_per_step=round(float(bare / inputs.sum()) * 1e6, 2),
        us_per_update=round((whole - bare) / measured * 1e6, 2), measurements=measured,
    )  # fmt: skip
    print(f"\n{model} {spec}: {benchmark.extra_info}")
    assert measured > 100


FIRST = """
import time
begun = time.perf_counter()
from leadline import read_log, read_vehicle, solve
solve(read_log("{place}/log"), read_vehicle("{place}/vehicle.toml"), estimator="{spec}")
print(f"{{time.perf_counter() - begun:.2f}} s")
"""
SMALL = """
name = "small"
[process]
model = "body-velocity"
[sensors.imu]
rate_hz = 100.0
gyro_noise_deg_per_rth = 0.1
accel_noise_ug_per_rthz = 100.0
gyro_bias_deg_per_h = 1.0
accel_bias_ug = 100.0
[sensors.dvl]
sigma_mps = 0.01
[sensors.depth]
sigma_m = 0.02
[sensors.heading]
sigma_deg = 0.5
"""


@pytest.mark.parametrize("spec", ["ekf", "ukf", "srukf", "pf:particles=100"])
def test_first_use(benchmark: Any, spec: str, tmp_path: Path) -> None:
    """Seconds of the first solution with an empty cache, and of that in a second process."""
    write_log(dive(3.0), tmp_path / "log")
    (tmp_path / "vehicle.toml").write_text(SMALL)
    code = FIRST.format(place=tmp_path, spec=spec)
    environment = {**os.environ, "LEADLINE_CACHE": str(tmp_path / "cache")}

    def process() -> str:
        return subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True, text=True).stdout.strip()

    first, second = process(), process()
    benchmark.pedantic(process, rounds=1)
    benchmark.extra_info.update(first=first, second=second)
    print(f"\n{spec}: first {first}; second {second}")
