"""Each kind of instrument at sea: what is wrong with it is found by the filter within the sigma that it states, and its residuals fit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import radians
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from leadline.assess.errors import errors_of
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.instruments import Drift, Surrounding
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

PLACE = Place(radians(43.0), radians(7.3), depth=3.0, surface_height=48.0)
PLAN = Lawnmower(legs=4, length=120.0, spacing=30.0, speed=1.5, heading=radians(40.0), surface_time=10.0, dive=15.0)
START = StartSigmas(position=2.0, depth=0.2, velocity=0.1, tilt=radians(0.5), heading=radians(2.0))
DURATION, SEEDS = 420.0, range(6)
TRAJECTORY = survey(PLACE, PLAN, duration=DURATION)
DEGREE, HOUR = radians(1.0), 3600.0

BASE = """
name = "sea"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.depth]
rate_hz = 2.0
sigma_m = 0.05
"""
FIXES = """
[sensors.usbl]
kind = "position_fix"
rate_hz = 0.2
sigma_m = 1.0
vertical = false
"""
DVL = """
[sensors.dvl]
rate_hz = 2.0
sigma_mps = 0.01
"""
COMPASS = """
[sensors.heading]
rate_hz = 1.0
sigma_deg = 0.5
"""
CURRENT = Surrounding("water.current", (0.25, -0.35))


@dataclass(frozen=True)
class Case:
    """What the filter believes to be aboard, what is wrong with it in truth (by instrument), and which states say so.

    found: the true value of a state, and to what share of its prior its sigma must fall.
    """

    aboard: str
    truth: dict[str, dict[str, Any]] = field(default_factory=dict)
    found: dict[str, tuple[float, float]] = field(default_factory=dict)


SPEED = "[sensors.speed]\nrate_hz = 2.0\nsigma_mps = 0.05\n"
WATER = "[sensors.water_velocity]\nrate_hz = 2.0\nsigma_mps = 0.03\n"
CASES: dict[str, Case] = {
    "a speed log that shows 1.67 of the speed": Case(
        FIXES + COMPASS + SPEED + "nuisance.scale = { sigma_percent = 50.0 }\n",
        {"speed": {"scale": -0.4}},
        {"speed.scale": (-0.4, 0.05)},
    ),
    "a current between two logs": Case(
        DVL + COMPASS + WATER + "nuisance.scale = { sigma_percent = 2.0 }\n" + SPEED
        + "nuisance.bias = { sigma_mps = 0.2 }\n[water]\ncurrent = { sigma_mps = 0.4 }\n",
        {"water_velocity": {"current": CURRENT, "scale": 0.02}, "speed": {"current": CURRENT, "bias": Drift(constant=0.15)}},
        {"water.current_north": (0.25, 0.1), "water.current_east": (-0.35, 0.1), "speed.bias": (0.15, 0.1)},
    ),
    "a current that wanders": Case(
        FIXES + COMPASS + WATER + "[water]\ncurrent = { sigma_mps = 0.3, tau_s = 300.0 }\n", {}, {}
    ),
    "pressure in water of unknown density": Case(
        DVL + COMPASS + "[sensors.pressure]\nrate_hz = 2.0\nsigma_pa = 200.0\n"
        + "nuisance = { datum = { sigma_m = 0.5 }, scale = { sigma_percent = 3.0 } }\n",
        {"pressure": {"datum": Drift(constant=0.4), "scale": 0.02}},
        {"pressure.datum": (0.4, 0.2), "pressure.scale": (0.02, 0.3)},
    ),
    "a sea bed below an altimeter and a log": Case(
        DVL.replace("[sensors.dvl]", "[sensors.dvl]\naltitude_sigma_m = 0.3")
        + "[sensors.altimeter]\nrate_hz = 2.0\nsigma_m = 0.2\nmounting_deg = [5.0, 10.0, 0.0]\nnuisance.bias = { sigma_m = 1.0 }\n"
        + "[seabed]\ndepth = { value_m = 50.0, sigma_m = 5.0, tau_s = 300.0 }\n",
        {"altimeter": {"bias": Drift(constant=0.8)}},
        {"altimeter.bias": (0.8, 0.1)},
    ),
    "a single gyro": Case(  # of a MEMS: a better one sees that the rate of the inertial unit is a mean over 0.02 s
        DVL + '[sensors.gyro]\nkind = "yaw_rate"\nrate_hz = 10.0\nnoise_deg_per_rth = 0.2\n'
        + "nuisance = { bias = { sigma_deg_per_h = 50.0 }, scale = { sigma_percent = 1.0 } }\n",
        {"gyro": {"bias": Drift(constant=40.0 * DEGREE / HOUR), "scale": 0.008}},
        {"gyro.bias": (40.0 * DEGREE / HOUR, 0.1), "gyro.scale": (0.008, 0.5)},
    ),
    "a compass that swings": Case(
        FIXES + DVL + '[sensors.compass]\nkind = "heading"\nrate_hz = 2.0\nsigma_deg = 1.0\n'
        + "nuisance.swing = { sigma_deg = 8.0 }\n",
        {"compass": {"swing": (10.0 * DEGREE, -6.0 * DEGREE, 3.0 * DEGREE, 2.0 * DEGREE)}},
        {"compass.swing_sin": (10.0 * DEGREE, 0.3), "compass.swing_cos": (-6.0 * DEGREE, 0.3)},
    ),
    "an AHRS with coloured errors": Case(
        FIXES + DVL + "[sensors.attitude]\nrate_hz = 5.0\nsigma_tilt_deg = 0.1\nsigma_deg = 0.3\n"
        + "nuisance.bias = { sigma_deg = 0.5, tau_s = 60.0 }\n"
    ),
    "fixes that share an error": Case(
        FIXES.replace("vertical = false", "vertical = false\nnuisance.bias = { sigma_m = 3.0, tau_s = 60.0 }") + DVL + COMPASS
    ),
    "three beams, one of them wrong": Case(
        FIXES + COMPASS + DVL + 'use = "beams"\nbeam_azimuth_deg = [0.0, 120.0, 240.0]\nbeam_tilt_deg = 25.0\n'
        + "nuisance.beam_bias = { sigma_mps = 0.05 }\n",
        {"dvl": {"beam_bias": Drift(constant=(0.08, 0.0, 0.0))}},
        {"dvl.beam_bias1": (0.08, 0.6)},
    ),
    "satellites with velocity": Case(
        COMPASS + "[sensors.gnss]\nrate_hz = 1.0\nsigma_m = 1.0\nsigma_velocity_mps = 0.05\nsurface_depth_m = 50.0\n"
        + "lever_arm_m = [0.5, 0.2, -1.0]\n"
    ),
    "another system's increments": Case(
        COMPASS + '[sensors.other]\nkind = "navigation"\nuse = "increments"\nincrement_s = 5.0\nrate_hz = 1.0\n'
        + "sigma_rate_m_per_rts = 0.05\nlever_arm_m = [1.0, 0.0, 0.0]\n"
    ),
}  # fmt: skip


def runs_of(case: Case) -> tuple[list[Any], Any]:
    """Solutions by seed, and the truth."""
    vehicle = vehicle_from_toml(BASE + case.aboard)
    made = instruments_of(vehicle_from_toml(BASE + case.aboard))
    for name, changes in case.truth.items():
        kept = {"sigma_scale": 0.0, "sigma_swing": (0.0,) * 4}
        made[name] = replace(made[name], **{k: v for k, v in kept.items() if hasattr(made[name], k)}, **changes)
    recorder = Recorder(TRAJECTORY, made, DURATION, truth_rate=0.1, start=START)
    return [solve(recorder.draw(seed), vehicle, times=recorder.truth.time) for seed in SEEDS], recorder.truth


@pytest.mark.parametrize("name", CASES)
def test_what_is_wrong_with_an_instrument_is_found(name: str) -> None:
    case = CASES[name]
    solutions, truth = runs_of(case)
    for state, (value, share) in case.found.items():
        for solution in solutions:
            found = solution.nuisances[state]
            assert abs(found.value[-1] - value) < 4.0 * found.sigma[-1], state
            assert found.sigma[-1] < share * found.sigma[0], state
    whitened = np.array([errors_of(solution, truth).whitened("position")[-1] for solution in solutions])
    assert np.sum(whitened**2) < chi2.ppf(0.999, whitened.size)
    groups = [s.innovations.select((s.innovations.outcome == Outcome.USED) & np.isfinite(s.innovations.nis)) for s in solutions]
    for sensor in sorted(set(groups[0].sensor)):
        nis, dof = 0.0, 0
        for innovations in groups:
            mine = innovations.select(innovations.sensor == sensor)
            _, first = np.unique(mine.group, return_index=True)
            nis, dof = nis + mine.nis[first].sum(), dof + int(mine.dof[first].sum())
        low, high = chi2.ppf([1e-5, 1.0 - 1e-5], dof)
        assert low * 0.99 < nis < high, (sensor, nis / dof, dof)  # the gate takes the largest thousandth away
    for solution in solutions:
        for sensor, counts in solution.summary["counts"].items():
            assert sensor == "other" or counts.get("used", 0) > 0.97 * sum(counts.values()), (sensor, counts)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (WATER + "[water]\ncurrent = { sigma_mps = 0.3, length_m = 500.0 }\n", "changes over 500.0 m"),
        (WATER + "[water]\ncurrent = { sigma_mps = 0.3, tau_s = 60.0, steady_mps = 0.1 }\n", "steady sigma"),
        ('[sensors.heading]\nrate_hz = 1.0\nsigma_deg = 1.0\nreference = "magnetic"\ndeclination = "wmm"\n', "knows no magnetic field"),
        (COMPASS + "nuisance.swing = { sigma_deg = 1.0, tau_s = 60.0 }\n", "swing: wanders"),
        (
            "[sensors.attitude]\nrate_hz = 1.0\nsigma_deg = 1.0\nsigma_tilt_deg = 1.0\nnuisance.swing = { sigma_deg = 1.0 }\n",
            "draws that of a heading",
        ),
        (
            "[sensors.gnss]\nrate_hz = 1.0\nsigma_m = 1.0\nvertical = true\nnuisance.bias = { sigma_m = 1.0, tau_s = 60.0 }\n",
            "height would wander too",
        ),
        (
            '[sensors.navigation]\nrate_hz = 1.0\nuse = "increments"\nsigma_distance_percent = 1.0\n',
            "errors that the simulator does not draw",
        ),
        ("[sensors.altimeter]\nrate_hz = 1.0\nsigma_m = 1.0\n", "has no sea bed"),
    ],
)
def test_what_the_simulator_cannot_make_is_refused(more: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Recorder(TRAJECTORY, instruments_of(vehicle_from_toml(BASE + more)), 10.0).draw(1)
