"""A hull from a log of it: what was put into the simulated hull comes back within its own sigmas, and what a log cannot show is kept."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from math import radians
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from leadline import cli
from leadline.calibrate.hull_fit import LENGTHS
from leadline.calibrate.hull_knobs import knobs_of
from leadline.calibrate.motion_data import Channel
from leadline.calibrate.replay import replay
from leadline.calibrate.vehicle import Verdict, calibrate_vehicle
from leadline.core.attitude import matrix_from_euler, quaternion_from_euler, quaternion_from_matrix
from leadline.data import records
from leadline.data.errors import InputError
from leadline.data.hull import read_hull
from leadline.data.log import Log
from leadline.data.vehicle import vehicle_from_toml
from leadline.formats.folder import write_log
from leadline.sea.water import CALM, Water
from leadline.simulate.dynamics import at_rest, motion, site_at
from leadline.simulate.routes import Circle, Hold, Lawnmower, Plan, Rotate, Sine, Waypoints
from leadline.simulate.trajectory import Place, euler
from leadline.simulate.voyage import Voyage

if TYPE_CHECKING:
    from pathlib import Path

    from leadline.data.hull import Hull

PLACE = Place(radians(44.0), radians(9.8), depth=5.0, surface_height=40.0)
ARM, GRAVITY = (-0.2, 0.1, 0.1), float(site_at(PLACE.latitude)[3])
STREAM = Water(shear=((0.0, 0.12, -0.08),))
VEHICLE = """
name = "calibrated"
[process]
model = "cruise"
[sensors.dvl]
sigma_mps = 0.005
lever_arm_m = [-0.2, 0.1, 0.1]
[sensors.depth]
sigma_m = 0.01
[sensors.attitude]
sigma_deg = 0.2
sigma_tilt_deg = 0.2
"""
ABOARD = vehicle_from_toml(VEHICLE)
AFLOAT = {"remus-100": 3.0, "typhoon": 3.0, "rexrov": 120.0}  # N, of the hull that was sailed


def other(name: str) -> Hull:
    """The hull that is sailed: drag x 1.4, thrust x 0.8, another buoyancy."""
    hull = read_hull(name)
    return replace(
        hull,
        linear_damping=1.4 * hull.linear_damping,
        quadratic_damping=1.4 * hull.quadratic_damping,
        thrusters=tuple(replace(t, ahead=0.8 * t.ahead, astern=0.8 * t.astern) for t in hull.thrusters),
        volume=(hull.mass + AFLOAT[name] / GRAVITY) / 1025.0,
    )


def plan_of(name: str) -> Plan:
    if name == "remus-100":
        way = Sine(speed=1.2, depth=8.0, length=90.0, amplitude=12.0, wavelength=45.0)
        back = Waypoints(speed=1.6, depth=14.0, through=((0.0, 40.0), (0.0, 0.0)))
        return Plan((way, Circle(speed=1.0, depth=7.0, radius=12.0, turns=1.2), back))
    line = Lawnmower(legs=2, length=30.0, spacing=8.0, speed=0.8, depth=8.0)
    across = Waypoints(speed=0.3, depth=12.0, heading=1.0, through=((8.0, 8.0), (0.0, 0.0)))
    turns = (Rotate(speed=0.3, depth=7.0, seconds=40.0, angle=3.0), Rotate(speed=0.3, depth=10.0, seconds=40.0, angle=-3.0))
    return Plan((line, across, *turns, Hold(speed=0.3, depth=9.0, seconds=30.0)))


@cache
def sailed(name: str, water: Water = CALM, straight: bool = False) -> tuple[Any, Any]:
    plan = Plan((Waypoints(speed=0.8, depth=5.0, through=((90.0, 0.0),)),)) if straight else plan_of(name)
    voyage = Voyage(other(name), plan, replace(PLACE, water=water), speed=1.0 if name == "remus-100" else 0.0)
    return voyage, voyage.run()


@cache
def log_of(name: str, seed: int, water: Water = CALM, straight: bool = False) -> Log:
    return noted(name, *sailed(name, water, straight), seed)


def noted(name: str, voyage: Any, trajectory: Any, seed: int) -> Log:
    """What a Doppler log (5 mm/s), a depth gauge (1 cm), an attitude sensor (0.2 degrees) and tachometers (steps of 0.05 rps) noted."""
    noise = np.random.default_rng(seed)
    quick, slow = np.arange(0.0, trajectory.duration, 0.1), np.arange(0.0, trajectory.duration, 0.2)
    velocity = trajectory.at(slow).point(ARM).velocity_b
    angles = np.array(euler(trajectory.at(quick).rotation_nb)) + radians(0.2) * noise.standard_normal((3, len(quick)))
    hull, (time, moved) = voyage.hull, voyage.actuators()
    time, moved = time[time <= trajectory.duration], moved[time <= trajectory.duration]
    fins = {fin.kind: moved[:, len(hull.thrusters) + k] for k, fin in enumerate(hull.fins)}
    tables = {
        "dvl": records.Dvl(time=slow, velocity=velocity + 0.005 * noise.standard_normal(velocity.shape)),
        "depth": records.Depth(time=slow, depth=trajectory.at(slow).depth + 0.01 * noise.standard_normal(len(slow))),
        "attitude": records.Attitude(time=quick, roll=angles[0], pitch=angles[1], heading=angles[2]),
        "thruster": records.Thruster(time=time, thruster=np.round(moved[:, : len(hull.thrusters)] / 0.05) * 0.05, **fins),
    }
    return Log(name, tables)


def truth_of(name: str, water: Water) -> dict[str, float]:
    knobs = {knob.name: knob.start for knob in knobs_of(other(name), 1025.0, GRAVITY, current=False)}
    stream = water.shear[0][1:] if water.shear else (0.0, 0.0)
    return knobs | {"current, north": stream[0], "current, east": stream[1]}


@pytest.mark.parametrize(("name", "seed", "water"), [
    ("remus-100", 1, STREAM), ("typhoon", 1, STREAM), ("rexrov", 1, STREAM),
    *(pytest.param(name, seed, water, marks=pytest.mark.slow) for name in AFLOAT for seed, water in ((2, CALM),)),
])  # fmt: skip
def test_the_hull_that_was_sailed_is_found(name: str, seed: int, water: Water) -> None:
    """About 35 numbers with Gaussian errors: their mean square is within 0.25 and 2.3 (chi-square, 1e-5), the largest below 4.5 sigma."""
    found = calibrate_vehicle(log_of(name, seed, water), read_hull(name), ABOARD)
    truth = truth_of(name, water)
    shown = [one for one in found.quantities if one.verdict is not Verdict.KEPT]
    errors = np.array([(one.value - truth[one.name]) / one.sigma for one in shown])
    assert found.converged
    assert np.mean(errors**2) < 2.3
    assert np.max(np.abs(errors)) < 4.5
    sure = [one for one in shown if one.verdict is Verdict.DETERMINED]
    assert len(sure) > len(found.quantities) / 2
    for one in sure:
        if one.part == "ahead":  # the thrust that drives and holds, which every log shows
            assert one.value == pytest.approx(truth[one.name], rel=0.15 if name == "remus-100" else 0.04)
    assert abs(found.trim.buoyancy - AFLOAT[name]) < 3.5 * found.trim.sigma
    assert found.trim.sigma < 0.05 * AFLOAT[name]
    hull = other(name)
    for drag in (one for one in found.drags if one.axis not in ("roll", "pitch")):
        axis = ("surge", "sway", "heave", "roll", "pitch", "yaw").index(drag.axis)
        force = hull.linear_damping[axis, axis] * drag.speed + hull.quadratic_damping[axis] * drag.speed**2
        assert abs(drag.value - force) < 4 * drag.sigma
    assert all(one.explained > 0.5 for one in found.residuals if one.quantity == "velocity")


def test_a_weak_thruster_is_told_from_the_others() -> None:
    """The log of six thrusters of which one has lost a quarter: simulated as such, started from equal ones."""
    hull = other("typhoon")
    weak = replace(hull.thrusters[3], ahead=0.75 * hull.thrusters[3].ahead, astern=0.75 * hull.thrusters[3].astern)
    hull = replace(hull, thrusters=(*hull.thrusters[:3], weak, *hull.thrusters[4:]))
    voyage = Voyage(hull, plan_of("typhoon"), PLACE)
    found = calibrate_vehicle(noted("weak", voyage, voyage.run(), 5), read_hull("typhoon"), ABOARD)
    assert found["lateral aft ahead"].value / found["lateral fore ahead"].value == pytest.approx(0.75, abs=0.02)
    assert found["vertical aft ahead"].value / found["vertical fore ahead"].value == pytest.approx(1.0, abs=0.02)


def test_what_a_log_cannot_show_is_kept_and_said() -> None:
    """Straight ahead with the rear propellers: they never turn astern, nothing rolls, and the starting hull stands for both."""
    start = read_hull("typhoon")
    found = calibrate_vehicle(log_of("typhoon", 4, CALM, straight=True), start, ABOARD)
    kept = {one.name for one in found.quantities if one.verdict is Verdict.KEPT}
    assert {"rear port astern", "rear starboard astern", "quadratic drag in roll"} <= kept
    for name in kept:
        assert found[name].value == found[name].start
    assert [t.astern for t in found.hull.thrusters[:2]] == [t.astern for t in start.thrusters[:2]]
    assert found.hull.quadratic_damping[3] == start.quadratic_damping[3]
    assert any(one.verdict is Verdict.TOGETHER and one.partner for one in found.quantities)


def test_a_run_again_is_that_of_the_simulator() -> None:
    """With thrusters that stand still at their commands both integrate one equation by one method: they agree to rounding."""
    hull, site = read_hull("typhoon"), site_at(0.7, depth=0.0)
    inputs = np.array([8.0, 7.0, 3.0, -4.0, 5.0, 4.0])
    start = at_rest(hull, position_t=np.array([0.0, 0.0, 10.0]), nu=np.array([0.5, 0.1, -0.05, 0.01, 0.02, 0.05]))
    start[13:] = inputs
    expected, _ = motion(hull, start, np.tile(inputs, (81, 1)), site, STREAM.parameters, step=0.1)
    states = replay(start[None, :13], np.tile(inputs, (1, 81, 1)), 0.1, hull, site, STREAM.parameters)
    np.testing.assert_allclose(states[0], expected[:, :13], rtol=0, atol=1e-12)


@pytest.mark.parametrize("frame", ["sensor", "level", "ned"])
def test_a_channel_predicts_what_the_instrument_would_say(frame: str) -> None:
    """Against the kinematics of the simulated trajectory at the place of the instrument."""
    trajectory = sailed("typhoon", STREAM)[1]
    time = np.linspace(5.0, 60.0, 40)
    state, turn = trajectory.at(time), matrix_from_euler(0.1, -0.2, 0.7)
    there = state.point(ARM)
    heading = np.arctan2(state.rotation_nb[:, 1, 0], state.rotation_nb[:, 0, 0])
    zero = np.zeros_like(heading)
    level = np.einsum("nji,nj->ni", matrix_from_euler(zero, zero, heading), there.velocity_n)
    value = {"sensor": there.velocity_b @ turn, "level": level, "ned": there.velocity_n}[frame]
    channel = Channel("dvl", "velocity", time, value, turn, np.array(ARM), frame=frame)
    nu = np.hstack([state.velocity_b, state.rate_eb_b])
    quaternion = quaternion_from_matrix(state.rotation_nb)
    left = channel.residual(np.arange(len(time)), nu, quaternion, state.depth, np.zeros(2))
    np.testing.assert_allclose(left, 0.0, atol=1e-6)  # the level axes of the instrument are 0.2 m away from those of the origin
    water = replace(channel, water=True, value=value - np.einsum("nji,j->ni", state.rotation_nb, [0.12, -0.08, 0.0]) @ turn)
    if frame == "sensor":
        np.testing.assert_allclose(water.residual(np.arange(len(time)), nu, quaternion, state.depth, np.array([0.12, -0.08])), 0, atol=1e-6)


def test_a_log_through_the_water_needs_no_current() -> None:
    log, trajectory = log_of("rexrov", 1, STREAM), sailed("rexrov", STREAM)[1]
    time = log["dvl"].time
    state = trajectory.at(time)
    velocity = state.velocity_b - np.einsum("nji,j->ni", state.rotation_nb, [0.12, -0.08, 0.0])
    noisy = velocity + 0.005 * np.random.default_rng(9).standard_normal(velocity.shape)
    tables = {name: log[name] for name in ("thruster", "attitude", "depth")}
    found = calibrate_vehicle(Log("w", tables | {"water_velocity": records.WaterVelocity(time=time, velocity=noisy)}), read_hull("rexrov"))
    truth = truth_of("rexrov", STREAM)
    assert not [one for one in found.quantities if one.part == "current"]
    assert all(abs(one.value - truth[one.name]) < 4.5 * one.sigma for one in found.quantities if one.verdict is Verdict.DETERMINED)
    assert "no vehicle file says how it is mounted" in found.notes[0]


def without(log: Log, **changes: Any) -> Log:
    return replace(log, tables={name: t for name, t in {**log.tables, **changes}.items() if t is not None})


def test_wrong_input_is_one_line() -> None:
    log, hull = log_of("typhoon", 1, STREAM), read_hull("typhoon")
    thruster: Any = log["thruster"]
    cases = [
        (without(log, thruster=None), hull, "no table of kind thruster"),
        (log, read_hull("rexrov"), "has the speeds of 6 thrusters; RexROV has 8"),
        (without(log, dvl=None), hull, "says no velocity"),
        (without(log, attitude=None), hull, "says no attitude"),
        (without(log, thruster=thruster.select(thruster.time < 4 * LENGTHS[-1])), hull, "at least 5 are needed"),
        (without(log, thruster=records.Thruster(time=thruster.time, thruster=thruster.thruster[:, :1])), read_hull("remus-100"), "rudder"),
    ]
    for given, start, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            calibrate_vehicle(given, start, ABOARD)
        assert "\n" not in str(caught.value)


def test_from_folder_to_hull_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(log_of("remus-100", 1, STREAM), tmp_path / "log")
    (tmp_path / "aboard.toml").write_text(VEHICLE)
    mounted = ["--vehicle", str(tmp_path / "aboard.toml")]
    out, common = tmp_path / "own.toml", ["calibrate", "vehicle", str(tmp_path / "log"), *mounted, "--hull"]
    assert cli.run([*common, "remus-100", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "speed per rps" in shown
    assert "buoyancy: +" in shown
    hull, start = read_hull(out), read_hull("remus-100")
    assert hull.quadratic_damping[1] == pytest.approx(1.4 * start.quadratic_damping[1], rel=0.1)
    assert hull.mass == start.mass
    np.testing.assert_array_equal(hull.added_mass, start.added_mass)
    assert "fitted to remus-100" in hull.origins["quadratic_damping"]
    assert "sigma" in hull.origins["volume"]
    assert hull.origins["mass"] == start.origins["mass"]
    assert cli.run([*common, "remus-100", "--out", str(out)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert cli.run([*common, "remus-10"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert cli.run([*common, str(out), "--json"]) == 0  # a fitted hull is a hull to start from
    printed = json.loads(capsys.readouterr().out)
    assert {one["verdict"] for one in printed["quantities"]} >= {"determined"}
    assert "[[thrusters]]" in printed["hull_file"]


def test_angles_beyond_a_turn_are_no_matter() -> None:
    """An attitude residual is a rotation, not a difference of angles."""
    a, b = quaternion_from_euler([0.0], [0.0], [np.pi - 0.01]), quaternion_from_euler([0.0], [0.0], [-np.pi + 0.01])
    channel = Channel("attitude", "attitude", np.zeros(1), b)
    left = channel.residual(np.array([0]), np.zeros((1, 6)), a, np.zeros(1), np.zeros(2))
    np.testing.assert_allclose(left, [[0.0, 0.0, 0.02]], atol=1e-12)
