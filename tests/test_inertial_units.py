"""Scale, misalignment and a second inertial unit: transition and view against differences, what they find, and who stands in for whom."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest
from test_jacobians import PROCESS_STEPS, random_motion, view_difference

from leadline.assess.errors import errors_of
from leadline.core.compiled import WIDE
from leadline.data.errors import InputError
from leadline.data.outcome import Outcome
from leadline.data.vehicle import vehicle_from_toml
from leadline.estimate.as_live import solve_as_live
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
from leadline.models.inertial import PARAMETERS
from leadline.models.inertial_units import inertial_units
from leadline.models.layout import INPUTS, Layout, difference, retract
from leadline.models.view import TANGENT, VIEW_SIZE
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

ENTRIES = """
gyro_scale = { sigma_percent = 0.5 }
accel_scale = { sigma_percent = 0.3 }
gyro_misalignment = { sigma_deg = 0.2 }
accel_misalignment = { sigma_deg = 0.1 }
"""
VEHICLE = """
name = "two units"
[process]
standby = "imu_b"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
[sensors.imu_b]
kind = "imu"
preset = "xsens-mti-30"
rate_hz = 50.0
lever_arm_m = [0.4, -0.2, 0.1]
mounting_deg = [180.0, 0.0, 90.0]
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.01
[sensors.depth]
rate_hz = 5.0
sigma_m = 0.05
[sensors.heading]
rate_hz = 5.0
sigma_deg = 1.0
"""
PLACE = Place(radians(45.0), radians(10.0), depth=20.0)
START = StartSigmas(position=1.0, depth=0.1, velocity=0.05, tilt=radians(0.3), heading=radians(0.5))


def extended(text=VEHICLE, entries=("imu", "imu_b")):
    for name in entries:
        text += f"[sensors.{name}.nuisance]{ENTRIES}"
    return vehicle_from_toml(text)


@cache
def process():
    aboard = extended()
    # one unit with all entries, and another with three of them: 15 + 6 + 18 + 3 states
    second = replace(aboard["imu_b"], nuisance={"gyro_scale": aboard["imu_b"].nuisance["gyro_scale"]})
    made = inertial_units(aboard["imu"], second, 17.0)
    return made, Layout(made.parts, (), 0, 1)


def motion(generator, device):
    x, u = random_motion(generator)
    n = process()[1].error
    return np.concatenate([x, generator.normal(0.0, 1e-3, n - 15)]), np.array([*u, device, *np.zeros(INPUTS - 9)])


def shifted(x, j, h):
    n, x = process()[1].error, x.copy()
    d = np.zeros(n)
    d[j] = h
    retract(process()[1].head(), x, d, n)
    return x


def steps():
    return np.concatenate([PROCESS_STEPS, np.full(process()[1].error - 15, 1e-4)])


def difference_quotient(value, x):
    return np.stack([(value(shifted(x, j, h)) - value(shifted(x, j, -h))) / (2 * h) for j, h in enumerate(steps())], axis=1)


def transition_error(x, u, dt):
    made, layout = process()
    n, end, memory = layout.error, x.copy(), np.zeros(WIDE * WIDE)
    made.step(end, u, dt, made.parameters, memory)
    unit, analytic = np.eye(WIDE).ravel(), np.zeros(WIDE * WIDE)
    made.push(memory, dt, made.parameters, unit, analytic, WIDE)
    assert np.array_equal(unit, np.eye(WIDE).ravel())  # given back as it was

    def after(x):
        x, d = x.copy(), np.zeros(n)
        made.step(x, u, dt, made.parameters, np.zeros(WIDE * WIDE))
        difference(layout.head(), x, end, d)
        return d

    return analytic.reshape(WIDE, WIDE)[:n, :n] - difference_quotient(after, x)


@pytest.mark.parametrize("device", [0.0, 1.0])
def test_push_is_right_to_first_order(device):
    generator = np.random.default_rng(5)
    assert process()[1].error == 15 + 6 + 18 + 3
    for _ in range(5):
        x, u = motion(generator, device)
        coarse, fine = transition_error(x, u, 0.02), transition_error(x, u, 0.01)
        left = np.abs(2.0 * fine / 0.01 - coarse / 0.02)
        assert left[6:, 9:].max() < 2e-3  # attitude and all constants, against biases and entries
        assert left[3:6, 9:].max() < 3e-2  # velocity: second order, of the force (9.8) times the rate
        assert left[15:, :].max() < 1e-9


@pytest.mark.parametrize("device", [0.0, 1.0])
def test_pull_is_the_derivative_of_the_view(device):
    made, layout = process()
    generator = np.random.default_rng(6)
    for _ in range(5):
        x, u = motion(generator, device)
        view, H = np.zeros(VIEW_SIZE), np.zeros((TANGENT, WIDE))
        made.view(x, u, made.parameters, view)
        made.pull(x, u, made.parameters, view, np.eye(TANGENT), H, TANGENT)

        def seen(x, u=u, origin=view):
            out = np.zeros(VIEW_SIZE)
            made.view(x, u, made.parameters, out)
            return view_difference(out, origin)

        error = np.abs(H[:, : layout.error] - difference_quotient(seen, x))
        assert error[9:12, 3:6].max() < 2e-7  # transport rate by velocity: 1/R
        error[9:12, 3:6] = 0.0
        assert error.max() < 2e-8


def test_noise_is_that_of_the_unit_at_hand_and_both_biases_wander():
    made, _ = process()
    own = [made.parameters[PARAMETERS * k : PARAMETERS * (k + 1)] for k in (0, 1)]
    for device in (0, 1):
        x, u = motion(np.random.default_rng(1), float(device))
        memory, P = np.zeros(WIDE * WIDE), np.zeros(WIDE * WIDE)
        made.step(x, u, 0.01, made.parameters, memory)
        made.noise(memory, 0.01, made.parameters, P)
        grown = np.diag(P.reshape(WIDE, WIDE)) / 0.01
        assert grown[3] == pytest.approx(own[device][1], rel=1e-12, abs=0.0)
        assert grown[6] == pytest.approx(own[device][2], rel=1e-12, abs=0.0)
        for unit, first in ((0, 9), (1, 15)):
            assert grown[first] == pytest.approx(own[unit][4], rel=1e-9, abs=0.0)
            assert grown[first + 3] == pytest.approx(own[unit][6], rel=1e-9, abs=0.0)


def recorded(aboard, seed, duration=240.0, lively=True):
    plan = Lawnmower(legs=8, length=15.0, spacing=6.0, speed=1.5) if lively else Lawnmower(legs=2, length=100.0)
    made = instruments_of(aboard, rates={"gnss": 1.0})
    if "gnss" in made:
        made["gnss"] = replace(made["gnss"], max_depth=1e3)
    return Recorder(survey(PLACE, plan, duration=duration), made, truth_rate=1.0, start=START).draw(seed)


def test_scale_and_misalignment_of_gyros_are_found():
    """A unit whose gyro turns 1 % too fast about its vertical, and leans: found within its sigmas, and heading is right again."""
    text = VEHICLE.replace('standby = "imu_b"', "").replace("sigma_deg = 1.0", "sigma_deg = 0.3")
    plain, aboard = vehicle_from_toml(text), extended(text, ("imu",))
    wrong = np.array([[0.0, 0.0, 0.003], [0.0, 0.0, -0.002], [0.0, 0.0, 0.01]])
    true = np.eye(3) - np.linalg.inv(np.eye(3) + wrong)  # entries are taken times what is measured
    squares, ratio = [], []
    for seed in range(6):
        log = recorded(plain, seed)
        bent = replace(log["imu"], gyro=log["imu"].gyro @ (np.eye(3) + wrong).T)
        log = replace(log, tables={**log.tables, "imu": bent})
        found, without = solve(log, aboard, times=log.truth.time), solve(log, plain, times=log.truth.time)
        n = found.nuisances
        names = ("imu.gyro_misalignment_xz", "imu.gyro_misalignment_yz", "imu.gyro_scale_z")
        squares.append([((n[name].value[-1] - value) / n[name].sigma[-1]) ** 2 for name, value in zip(names, true[:, 2], strict=True)])
        assert n["imu.gyro_scale_z"].sigma[-1] < 0.5 * n["imu.gyro_scale_z"].sigma[0]
        size = [np.sqrt(np.mean(errors_of(s, log.truth).error[:, 8] ** 2)) for s in (found, without)]
        ratio.append(size[0] / size[1])
    assert (np.sum(squares, axis=0) < 22.5).all()  # chi-square, 6 degrees of freedom: 0.1 %
    assert np.median(ratio) < 0.7


def test_a_wandering_entry_is_refused():
    text = VEHICLE + "[sensors.imu.nuisance]\ngyro_scale = { sigma_percent = 0.1, tau_s = 10.0 }\n"
    log = recorded(vehicle_from_toml(VEHICLE), 1, 60.0)
    with pytest.raises(InputError, match="it is a constant"):
        solve(log, vehicle_from_toml(text))


def without_rows(log, name, gone):
    return replace(log, tables={**log.tables, name: log[name].select(~gone(log[name].time))})


def test_a_second_unit_fills_a_silence_and_takes_over_for_good():
    aboard = vehicle_from_toml(VEHICLE)
    log = recorded(aboard, 3, 120.0, lively=False)
    whole = solve(log, aboard, rate=1.0)
    for gone, spans, used in (
        (lambda t: (t > 50.0) & (t < 55.0), [(50.0, 55.0)], 250),
        (lambda t: t > 80.0, [(80.0, 120.0)], 2000),
    ):
        broken = without_rows(log, "imu", gone)
        solution = solve(broken, aboard, rate=1.0)
        found = solution.summary["inertial"]
        assert [(s["kind"], s["sensor"]) for s in found] == [("standby", "imu_b")]
        assert [(s["start_s"], s["end_s"]) for s in found] == [pytest.approx(s, abs=0.05) for s in spans]
        counts = solution.summary["counts"]["imu_b"]
        assert counts["used"] == pytest.approx(used, abs=3)
        assert counts["used"] + counts["standby"] == len(log["imu_b"])
        error = errors_of(solution, log.truth)
        assert np.abs(error.error / error.sigma).max() < 5.0
        assert np.abs(solution.position_n - whole.position_n).max() < 1.0
        alone = solve(broken, vehicle_from_toml(VEHICLE.replace('standby = "imu_b"', "")), rate=1.0)
        assert solution.sigma[len(alone) - 1, 6:9].max() <= alone.sigma[-1, 6:9].max() * 1.5


@pytest.mark.parametrize("gone", [lambda t: (t > 50.0) & (t < 55.0), lambda t: t > 80.0])
def test_standing_in_is_the_same_live(gone):
    aboard = vehicle_from_toml(VEHICLE)
    log = without_rows(recorded(aboard, 4, 100.0, lively=False), "imu", gone)
    times = np.arange(0.0, 99.5, 0.5)
    live, whole = solve_as_live(log, aboard, times=times), solve(log, aboard, times=times)
    for name in ("latitude", "longitude", "height", "velocity_n", "quaternion_nb", "covariance"):
        assert np.array_equal(getattr(live, name), getattr(whole, name)), name
    assert not np.isin(live.innovations.outcome, (Outcome.NO_CLONE, Outcome.LATE)).any()


def test_a_gauss_markov_bias_decays():
    text = VEHICLE.replace('standby = "imu_b"', "").replace(
        "rate_hz = 50.0", 'rate_hz = 50.0\ngyro_bias_process = "gauss_markov"\ngyro_bias_tau_s = 50.0', 1
    )
    aboard = vehicle_from_toml(text)
    log = recorded(aboard, 5, 60.0, lively=False)
    bare = replace(log, tables={"imu": log["imu"], "truth": log["truth"]})
    from leadline.estimate.assembly import navigator_for

    navigator, _, _ = navigator_for(bare, aboard.only("imu"))
    layout, start = navigator.composition.layout, 1e-3
    bias = layout.x.start + layout.nominal_of("gyro_bias").start
    navigator.state[bias] = start
    navigator.add("imu", log["imu"])
    left = np.exp(-(navigator.time - navigator.start) / 50.0)
    assert navigator.state[bias] == pytest.approx(start * left, rel=1e-9)
    variance = navigator.state[layout.covariance].reshape(-1, WIDE)[9, 9]
    assert variance == pytest.approx(aboard["imu"].value("gyro_bias") ** 2, rel=1e-3)
