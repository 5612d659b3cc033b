"""Paper 002 with a hull: the sailed triangle of `missions/papers/002-triangle.toml`, in a current that is drawn for each run.

The filter knows the speeds of the thrusters and a hull whose drag is 16 % too low.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from sailing import published

from leadline.core.geodesy import north_east
from leadline.data.log import Log
from leadline.missions.configuration import Configuration
from leadline.missions.mission import read_mission
from leadline.missions.montecarlo import compared
from leadline.missions.simulation import sailed
from leadline.simulate.dive import stream

MISSION = Path(__file__).resolve().parents[2] / "missions" / "papers" / "002-triangle.toml"
CURRENT, WANDER = 0.095, 0.03  # m/s per axis: of the whole dive, and what comes and goes; 0.1 together
END, EVERY, FIXES = 1150.0, 10.0, 11
OVER: dict[str, Any] = {
    "process": {
        "model": "dynamics",
        "dynamics": {"hull": "typhoon", "nuisance": {"drag": {"value_percent": -16.0, "sigma_percent": 16.0}}},
    },
    "water": {"current": {"sigma_mps": 0.1, "tau_s": 1800.0}},
}
PUBLISHED = {
    "EKF": (22.3, 32.4, 7.8, 10.4, 20.7, 18.9, 14.8, 26.4, 40.3, 4.0, 6.6),
    "UKF": (11.1, 17.0, 7.7, 13.6, 17.3, 20.8, 10.6, 12.4, 18.1, 3.8, 4.0),
}  # table 1: distances to the 11 fixes of the USBL (m)


def dive(number: int) -> Log:
    """Return the log of a run: its own current, 10 rows of attitude a second, no inertial unit."""
    drawn = CURRENT * stream(number, "current").standard_normal(2)
    text = MISSION.read_text("utf-8")
    text = re.sub(r"^north_mps = .*$", f"north_mps = {drawn[0]:.6f}", text, flags=re.MULTILINE)
    text = re.sub(r"^east_mps = .*$", f"east_mps = {drawn[1]:.6f}", text, flags=re.MULTILINE)
    text = text.replace("tau_s = 1800.0, seed = 2", f"tau_s = 1800.0, seed = {number}")
    text = text.replace("../vehicles/", f"{MISSION.parents[1] / 'vehicles'}/")
    text += "\n[instruments.attitude]\nrate_hz = 10.0\n\n[instruments.imu]\naboard = false\n"
    with TemporaryDirectory() as folder:
        path = Path(folder) / MISSION.name
        path.write_text(text, "utf-8")
        return sailed(read_mission(path)).log(number, keep=False)


def ways() -> dict[str, Configuration]:
    """Return what is compared."""
    keys: dict[str, Any] = {"over": OVER, "without": ("imu",)}
    return {
        "EKF": Configuration("EKF", **keys),
        "UKF": Configuration("UKF", "ukf", **keys),
        "smoothed": Configuration("smoothed", smooth=True, **keys),
        "no current, EKF": published("no_current_dynamics", OVER, name="no current, EKF", without=("imu",)),
        "no current, UKF": published("no_current_dynamics", OVER, name="no current, UKF", estimator="ukf", without=("imu",)),
    }


@dataclass
class Way:
    """What one way made of the runs: errors (runs, times, 2) in m and their covariances, whitened errors before the first fix of each
    surfacing (surfacings, 2), distances to fixes of the USBL (runs, fixes), innovations of GPS."""

    error: Any
    covariance: Any
    surfacing: Any
    usbl: Any
    nis: Any


class Moments(NamedTuple):
    """When a run is looked at (s): at checks, before each surfacing, at fixes of the USBL."""

    checks: Any
    before: Any
    usbl: Any


def moments(log: Log) -> Moments:
    """Return the moments of a run at which its solutions are looked at."""
    fixes = log["gnss"].time
    first = fixes[np.diff(fixes, prepend=0.0) > 30.0]
    return Moments(np.arange(0.0, END + 1e-9, EVERY), np.floor(10.0 * first - 0.5) / 10.0, log["usbl"].time[:FIXES])


def solved(runs: Sequence[int], names: Sequence[str]) -> dict[str, Way]:
    """Solve runs in the ways that are named."""
    kept: dict[str, list[Any]] = {name: [] for name in names}
    made = ways()
    for number in runs:
        log, mission = dive(number), read_mission(MISSION)
        when = moments(log)
        for name in names:
            kept[name].append(_run(made[name], log, made[name].aboard(mission.vehicle), when))
    return {name: _way(found) for name, found in kept.items()}


def _run(one: Configuration, log: Log, vehicle: Any, when: Moments) -> Any:
    times = np.unique(np.concatenate([when.checks, when.before, when.usbl]))
    solution = one.solve(log, vehicle, times=times)
    assert log.truth is not None
    known = np.unique(np.concatenate([when.checks, when.before]))
    found = compared(solution, log.truth.select(np.searchsorted(log.truth.time, known - 1e-6)))
    at, before = np.searchsorted(known, when.checks - 1e-6), np.searchsorted(known, when.before - 1e-6)
    root = np.linalg.cholesky(found.covariance[:, :2, :2])
    white = np.linalg.solve(root, found.error[:, :2, None])[..., 0]
    fix, rows = np.searchsorted(times, when.usbl), log["usbl"]
    assert log.origin is not None
    here = north_east(solution.latitude[fix], solution.longitude[fix], log.origin.latitude, log.origin.longitude)
    there = north_east(rows.latitude[: len(fix)], rows.longitude[: len(fix)], log.origin.latitude, log.origin.longitude)
    apart = np.hypot(here[0] - there[0], here[1] - there[1])
    apart = np.concatenate([apart, np.full(FIXES - len(apart), np.nan)])
    looked = solution.innovations.select(solution.innovations.sensor == "gnss")
    return found.error[at, :2], found.covariance[at, :2, :2], white[before], apart, looked.nis[::2] / looked.dof[::2]


def _way(found: Sequence[Any]) -> Way:
    error, covariance, surfacing, usbl, nis = zip(*found, strict=True)
    return Way(np.array(error), np.array(covariance), np.concatenate(surfacing), np.array(usbl), np.concatenate(nis))
