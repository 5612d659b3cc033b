"""An hour, simulated: hull, pilot, instruments, and a multibeam on four million cells; and how many times faster than the hour it is.

    pytest benchmarks/test_simulate.py --benchmark-columns=min,median,rounds -s

`hour` is warm: kernels are loaded, nothing is kept from the round before; the log is written.  The multibeam's rays are compared with the
same rays marched in NumPy, a fiftieth of them, in the same run.
"""

from __future__ import annotations

import time
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from leadline.formats.folder import write_log
from leadline.missions.mission import read_mission
from leadline.missions.simulation import sailed
from leadline.sea.fractal import fractal
from leadline.simulate.multibeam import Multibeam, on_chart
from leadline.simulate.routes import Lawnmower

SURVEY = Path(__file__).parents[1] / "missions" / "survey.toml"
MORE: dict[str, dict[str, Any]] = {
    "ahrs": {"kind": "attitude", "rate_hz": 100.0, "sigma_deg": 0.1},
    "mag": {"kind": "magnetometer", "rate_hz": 100.0, "sigma_ut": 0.1},
    "fog": {"kind": "yaw_rate", "rate_hz": 100.0, "sigma_degps": 0.01},
    "pressure": {"kind": "pressure", "rate_hz": 10.0, "sigma_pa": 100.0},
    "speed": {"kind": "speed", "rate_hz": 10.0},
    "altimeter": {"kind": "altimeter", "rate_hz": 10.0},
    "water": {"kind": "water_velocity", "rate_hz": 5.0},
    "thrusters": {"kind": "thruster", "rate_hz": 10.0},
    "motors": {"kind": "motor_current", "rate_hz": 10.0},
    "current": {"kind": "water_current", "rate_hz": 1.0},
    "level": {"kind": "water_level", "rate_hz": 0.1},
    "svs": {"kind": "sound_speed", "rate_hz": 1.0},
    "inverted": {"kind": "usbl", "rate_hz": 1.0},
}


def hour_long() -> Any:
    mission = read_mission(SURVEY)
    legs = (mission.plan.legs[0], Lawnmower(legs=24, length=255.0, spacing=30.0, at=(150.0, 55.0), bearing=0.3, speed=1.5, depth=15.0))
    return replace(mission, plan=replace(mission.plan, legs=legs), duration=3600.0, instruments=MORE, faults=())


def test_hour(benchmark: Any, tmp_path: Path) -> None:
    """One hour of a survey with every instrument but a multibeam, written as Parquet."""
    mission = hour_long()

    def work() -> None:
        log = sailed(mission).log(0, keep=False)
        write_log(log, tmp_path / "log", parquet=True)

    work()
    benchmark.pedantic(work, rounds=5)
    seconds = benchmark.stats.stats.median
    print(f"\n1 h in {seconds:.2f} s: {3600 / seconds:.0f} times faster than it lasts")


def marched(chart: Any, points: Any, ways: Any, reach: float = 200.0, step: float = 0.05) -> Any:
    """The first sample of each ray that lies below the bed, by NumPy."""
    found = np.full(len(points), np.nan)
    distance = np.arange(0.0, reach, step)
    for i, (point, way) in enumerate(zip(points, ways, strict=True)):
        line = point + distance[:, None] * way
        below = np.flatnonzero(line[:, 2] >= chart.depth_at(line[:, 0], line[:, 1]))
        found[i] = distance[below[0]] if len(below) else np.nan
    return found


def test_multibeam(benchmark: Any) -> None:
    """256 beams at 10 Hz for an hour over 2000 x 2000 cells of 1 m, 9.2 million rays."""
    mission = hour_long()
    chart = fractal((-500.0, 1500.0, -500.0, 1500.0), 1.0, 60.0, beta=3.2, sigma=4.0, seed=1)
    trajectory = sailed(replace(mission, sea=replace(mission.sea, chart=None), instruments={}, plan=mission.plan)).voyage.trajectory()
    head = Multibeam(rate=10.0, seabed=chart, beams=256, swath=radians(120.0), sigma=0.05)
    times = np.arange(0.0, 3600.0, 0.1)
    head.ideal(trajectory, times[:10])
    table = benchmark.pedantic(lambda: head.record(head.ideal(trajectory, times), np.random.default_rng(0)), rounds=3)
    seconds = benchmark.stats.stats.median
    state = trajectory.at(times[::720])
    points, turn = on_chart(state)
    ways = np.einsum("nij,kj->nki", turn @ state.rotation_nb, head.directions)[:, ::64].reshape(-1, 3)
    begin = time.perf_counter()
    marched(chart, np.repeat(points, 4, axis=0), ways)
    each = (time.perf_counter() - begin) / len(ways)
    rays = 256 * len(times)
    print(
        f"\n{rays / 1e6:.1f} million rays in {seconds:.1f} s, {len(table)} rows; NumPy would take {each * rays / seconds:.0f} times as long"
    )
