"""Gates that explain and recover, sensors that stand by or come too often, views that are displaced, headings that are found."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from leadline.assess.errors import errors_of
from leadline.core.compiled import COMPONENTS
from leadline.data.errors import InputError
from leadline.data.log import Initial
from leadline.data.outcome import Outcome
from leadline.data.records import PositionFix
from leadline.data.solution import Status
from leadline.data.vehicle import Prior, vehicle_from_toml
from leadline.estimate.gate import student_factor
from leadline.estimate.solve import solve
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey
from leadline.simulate.trajectory import Place

VEHICLE = """
name = "gates"
[sensors.imu]
preset = "kvh-1775"
rate_hz = 50.0
lever_arm_m = [0.3, 0.0, 0.0]
[sensors.dvl]
rate_hz = 5.0
sigma_mps = 0.02
lever_arm_m = [-0.5, 0.1, 0.2]
[sensors.depth]
rate_hz = 5.0
sigma_m = 0.05
[sensors.heading]
rate_hz = 2.0
sigma_deg = 0.5
[sensors.usbl]
kind = "position_fix"
rate_hz = 0.2
sigma_m = 1.0
vertical = false
"""
PLACE = Place(radians(45.0), radians(10.0), depth=15.0)
START = StartSigmas(position=2.0, depth=0.1, velocity=0.05, tilt=radians(0.2), heading=radians(0.5))
PLAN = Lawnmower(legs=4, length=60.0, spacing=20.0, speed=1.5)


def aboard(**keys):
    """The vehicle, with further keys for sensors."""
    text = VEHICLE
    for sensor, lines in keys.items():
        text = text.replace(f"[sensors.{sensor}]\n", f"[sensors.{sensor}]\n{lines}\n")
    return vehicle_from_toml(text)


def recorded(seed=1, duration=240.0, vehicle=None, **changes):
    made = instruments_of(vehicle or aboard())
    made |= {name: replace(made[name], **values) for name, values in changes.items()}
    return Recorder(survey(PLACE, PLAN, duration=duration), made, truth_rate=1.0, start=START).draw(seed)


def outcomes(solution, sensor):
    mine = solution.innovations.select(solution.innovations.sensor == sensor)
    return mine.select(np.sort(np.unique(mine.group, return_index=True)[1]))


def horizontal(solution, log):
    return errors_of(solution, log.truth).horizontal


# Student's t


def likeliest_factor(R, T, r, dof):
    """By brute force: the mode of log f for noise f R, with f inverse-gamma (what makes Gaussian noise Student's t)."""

    def likelihood(u):
        S = T + np.exp(u) * R
        return -np.linalg.slogdet(S)[1] - r @ np.linalg.solve(S, r) - dof * (u + np.exp(-u))

    grid = np.linspace(-3.0, 25.0, 28001)
    return np.exp(grid[np.argmax([likelihood(u) for u in grid])])


@pytest.mark.parametrize("vague", [0.01, 1.0, 100.0])
@pytest.mark.parametrize("size", [0.5, 3.0, 100.0])
def test_factor_of_student_is_the_likeliest(size, vague):
    """Also where the estimate is far vaguer than the measurement, and a far residual might be the one or the other."""
    generator = np.random.default_rng(4)
    for c in (1, 2, 3):
        a, b = generator.normal(size=(2, c, c))
        R, T = a @ a.T + np.eye(c), vague * (b @ b.T + 0.1 * np.eye(c))
        r = size * np.linalg.cholesky(T + R) @ generator.normal(size=c)
        flat, padded = np.zeros((2, COMPONENTS, COMPONENTS))
        flat[:c, :c], padded[:c, :c] = T, R
        found = student_factor(padded, flat.ravel(), np.pad(r, (0, COMPONENTS - c)), 4.0, 1.0, c, np.zeros(512))
        assert found == pytest.approx(likeliest_factor(R, T, r, 4.0), rel=3e-3)


def test_a_far_fix_has_no_weight_for_a_student_even_if_nothing_is_known():
    """A prior of 10 m and a first fix 100 m off: the plain gate turns it away, and Student's t must not take it in."""
    log = recorded()
    fixes = log["usbl"]
    first = np.arange(len(fixes)) == np.argmin(fixes.time)
    moved = np.where(first, fixes.latitude + 100.0 / 6.37e6, fixes.latitude)
    log = replace(log, tables={**log.tables, "usbl": replace(fixes, latitude=moved)}, initial=replace(log.initial, sigma_position=10.0))
    error = errors_of(solve(log, aboard(usbl="student_dof = 4.0")), log.truth)
    assert error.horizontal[3] < 30.0
    assert error.horizontal[-1] < 3.0


def test_wild_fixes_hurt_a_student_less_than_an_open_gate():
    log = recorded(usbl={"outlier_fraction": 0.2, "outlier_size": 20.0})
    student = solve(log, aboard(usbl="student_dof = 4.0"))
    believing = solve(log, aboard(usbl="gate_probability = 0.999999999999"))
    found = outcomes(student, "usbl")
    assert (found.outcome == Outcome.USED).all()
    assert found.widened.all()  # none takes part in the verdict on the NIS
    assert np.median(horizontal(student, log)) < 0.5 * np.median(horizontal(believing, log)) + 0.3
    assert np.abs(errors_of(student, log.truth).error[:, :2] / errors_of(student, log.truth).sigma[:, :2]).max() < 4.5


# Gates


def jumped(log, metres, after):
    """Fixes that lie `metres` north from a moment on: a reference that was moved."""
    fixes = log["usbl"]
    moved = np.where(fixes.time > after, fixes.latitude + metres / 6.37e6, fixes.latitude)
    return replace(log, tables={**log.tables, "usbl": replace(fixes, latitude=moved)})


def test_a_gate_widens_with_the_time_since_the_last_acceptance():
    log = jumped(recorded(), 12.0, 100.0)
    strict, widening = solve(log, aboard()), solve(log, aboard(usbl="gate_widening_s = 20.0"))
    assert (outcomes(strict, "usbl").outcome[22:] == Outcome.GATED).all()
    found = outcomes(widening, "usbl")
    accepted = np.flatnonzero(found.widened)
    assert len(accepted)
    assert (found.outcome[accepted] == Outcome.USED).all()
    limit = 13.8155  # chi-square of two at 0.999
    first = accepted[0]
    since = found.time[first] - found.time[:first][found.outcome[:first] == Outcome.USED][-1]
    assert limit < found.nis[first] < limit * (1.0 + since / 20.0) ** 2
    gated = found.nis[found.outcome == Outcome.GATED]
    assert (gated > limit).all()


def test_after_a_run_of_rejections_the_estimate_is_opened_up():
    """A start that claims a metre and is off by two hundred: without it the filter never comes back."""
    log = recorded()
    lost = replace(log, initial=replace(log.initial, latitude=log.initial.latitude + 200.0 / 6.37e6))
    never, again = solve(lost, aboard()), solve(lost, aboard(usbl="reanchor_after = 4"))
    assert (outcomes(never, "usbl").outcome == Outcome.GATED).mean() > 0.9
    assert horizontal(never, lost)[-1] > 100.0
    found = outcomes(again, "usbl")
    assert [Outcome(o) for o in found.outcome[:4]] == [Outcome.GATED, Outcome.GATED, Outcome.GATED, Outcome.REANCHORED]
    assert found.widened[3]
    assert found.nis[3] < 5.0  # as it lies after the opening
    assert (found.outcome[5:] == Outcome.USED).mean() > 0.9
    after = errors_of(again, lost.truth)
    late = after.time > 60.0
    assert np.abs(after.error[late, :2] / after.sigma[late, :2]).max() < 4.5
    assert again.summary["counts"]["usbl"]["reanchored"] == 1


def test_a_sensor_is_decimated_to_the_time_that_its_errors_take_to_change():
    solution = solve(recorded(), aboard(heading="every_s = 5.0"))
    found = outcomes(solution, "heading")
    used = found.time[found.outcome == Outcome.USED]
    assert (np.diff(used) > 4.999).all()
    assert set(found.outcome) <= {int(Outcome.USED), int(Outcome.DECIMATED), int(Outcome.GATED)}
    assert len(used) == pytest.approx(240.0 / 5.0, abs=3)


def test_a_sensor_stands_by_until_the_other_is_silent():
    text = (
        VEHICLE
        + """
[sensors.dvl_b]
kind = "dvl"
rate_hz = 5.0
sigma_mps = 0.05
standby_for = "dvl"
standby_after_s = 1.5
"""
    )
    two = vehicle_from_toml(text)
    made = instruments_of(two)
    made["dvl"] = replace(made["dvl"], outages=((100.0, 130.0),))
    log = Recorder(survey(PLACE, PLAN, duration=180.0), made, truth_rate=1.0, start=START).draw(2)
    found = outcomes(solve(log, two), "dvl_b")
    inside = (found.time > 101.6) & (found.time < 130.0)
    assert (found.outcome[inside] == Outcome.USED).mean() > 0.98
    outside = (found.time < 100.0) & (found.time > 1.0) | (found.time > 130.2)
    assert (found.outcome[outside] == Outcome.STANDBY).all()
    assert solve(log, two).summary["counts"]["dvl_b"]["standby"] == int((found.outcome == Outcome.STANDBY).sum())


# Displaced views


def test_a_late_stamp_a_clock_and_a_lever_arm_are_found():
    """Doppler stamps 0.04 s late and a lever arm wrong by 0.3 m; a clock shared by two sensors that is late and drifts."""
    truth_dvl = aboard(dvl="")
    squares = []
    for seed in range(5):
        log = recorded(seed, vehicle=truth_dvl, duration=240.0)
        late = replace(log["dvl"], time=log["dvl"].time + 0.04)
        log = replace(log, tables={**log.tables, "dvl": late})
        used = aboard(dvl="")
        priors = {"time": Prior(np.zeros(1), np.array([0.3])), "lever": Prior(np.zeros(3), np.full(3, 0.5))}
        dvl = replace(used["dvl"], lever_arm_b=used["dvl"].lever_arm_b + np.array([0.3, 0.0, 0.0]), nuisance=priors)
        solution = solve(log, replace(used, sensors={**used.sensors, "dvl": dvl}))
        time, lever = solution.nuisances["dvl.time"], solution.nuisances["dvl.lever_x"]
        assert time.sigma[-1] < 0.05
        assert lever.sigma[-1] < 0.1
        squares.append([((time.value[-1] - 0.04) / time.sigma[-1]) ** 2, ((lever.value[-1] + 0.3) / lever.sigma[-1]) ** 2])
    assert (np.sum(squares, axis=0) < 20.5).all()  # chi-square of 5: 0.1 %


def test_a_clock_is_shared_by_its_sensors():
    text = VEHICLE.replace("[sensors.dvl]\n", '[sensors.dvl]\nclock = "b"\n').replace("[sensors.usbl]\n", '[sensors.usbl]\nclock = "b"\n')
    text += "[clocks.b]\noffset = { sigma_s = 0.2 }\ndrift = { sigma_ppm = 500.0 }\n"
    clocked = vehicle_from_toml(text)
    squares = []
    for seed in range(4):
        log = recorded(seed)
        wrong = {n: replace(log[n], time=log[n].time + 0.05 + 0.0002 * log[n].time) for n in ("dvl", "usbl")}
        log = replace(log, tables={**log.tables, **wrong})
        solution = solve(log, clocked)
        offset, drift = solution.nuisances["clocks.b.offset"], solution.nuisances["clocks.b.drift"]
        assert sum("clocks" in name for name in solution.nuisances) == 2
        assert offset.sigma[-1] < 0.1
        squares.append([((offset.value[-1] - 0.05) / offset.sigma[-1]) ** 2, ((drift.value[-1] - 0.0002) / drift.sigma[-1]) ** 2])
        error = errors_of(solution, log.truth)
        assert np.abs(error.error[:, :2] / error.sigma[:, :2]).max() < 4.5
    assert (np.sum(squares, axis=0) < 18.5).all()


def test_a_lever_arm_of_a_sensor_that_looks_twice_is_refused():
    text = VEHICLE + '[sensors.ranges]\nkind = "acoustic_range"\nsigma_m = 1.0\npath = "two_way"\n'
    text += "[sensors.ranges.nuisance]\nlever = { sigma_m = 0.1 }\n"
    with pytest.raises(InputError, match="give these no prior"):
        solve(recorded(), vehicle_from_toml(text))


# Alignment


def unknown_heading(log):
    kept = {name: getattr(log.initial, name) for name in ("time", "latitude", "longitude", "depth", "roll", "pitch", "sigma_position")}
    return replace(log, initial=Initial(**kept), tables={k: v for k, v in log.tables.items() if k != "heading"})


@pytest.mark.parametrize("heading", [0.3, 2.0, 4.4])
def test_fixes_and_a_doppler_log_find_the_heading_on_the_way(heading):
    fixed = aboard().without("heading")
    made = instruments_of(fixed)
    plan = replace(PLAN, heading=heading)
    log = Recorder(survey(PLACE, plan, duration=300.0), made, truth_rate=1.0, start=START).draw(5)
    solution = solve(unknown_heading(log), fixed)
    error = errors_of(solution, log.truth)
    known = solution.sigma[:, 8] < radians(5.0)
    assert (solution.status[: np.argmax(known)] == Status.ALIGNING).all()
    assert (solution.status[np.argmax(known) :] != Status.ALIGNING).all()
    late = error.time > 150.0
    assert np.abs(error.error[late, 8] / error.sigma[late, 8]).max() < 4.0
    assert np.abs(error.error[late, 8]).max() < radians(4.0)
    smoothed = solve(unknown_heading(log), fixed, smooth=True)
    assert np.abs(errors_of(smoothed, log.truth).error[:, 8]).max() < radians(4.0)


def test_a_good_gyro_finds_north_at_rest_and_a_poor_one_is_refused():
    from leadline.simulate.plans import still

    text = """
name = "quay"
[process]
align_s = 600.0
[sensors.imu]
preset = "{preset}"
rate_hz = 20.0
[sensors.zero_velocity]
rate_hz = 1.0
sigma_mps = 0.002
[sensors.depth]
rate_hz = 1.0
sigma_m = 0.05
"""
    for preset, works in (("fog-navigation", True), ("xsens-mti-30", False)):
        used = vehicle_from_toml(text.format(preset=preset))
        for heading in (1.0, 4.0) if works else (1.0,):
            log = Recorder(still(PLACE, 700.0, heading=heading), instruments_of(used), truth_rate=0.1, start=START).draw(7)
            if not works:
                with pytest.raises(InputError, match="determine none"):
                    solve(unknown_heading(log), used)
                continue
            error = errors_of(solve(unknown_heading(log), used, rate=1.0), log.truth)
            assert error.sigma[-1, 8] < radians(3.0)
            assert abs(error.error[-1, 8]) < 4.0 * error.sigma[-1, 8]


def test_a_field_decays_with_the_distance_travelled():
    """A nuisance with a length forgets as exp(-speed t / length), and settles at its steady sigma."""
    text = VEHICLE + "[sensors.dvl.nuisance]\nbias = { sigma_mps = 0.05, length_m = 30.0 }\n"
    bare = vehicle_from_toml(text).only("imu", "dvl")
    log = recorded(duration=60.0)
    from leadline.estimate.assembly import navigator_for

    navigator, _, _ = navigator_for(replace(log, initial=replace(log.initial, velocity_north=1.5, velocity_east=0.0)), bare)
    layout = navigator.composition.layout
    index = layout.nuisance_error("dvl.bias_x")
    place = layout.x.start + layout.motion_nominal + index - layout.motion_error
    navigator.state[place] = 0.05
    variance = layout.covariance.start + index * 49
    navigator.state[variance] = 0.0
    imu = log["imu"]
    navigator.add("imu", imu.select(imu.time <= 2.0))
    left = np.exp(-1.5 * 2.0 / 30.0)
    assert navigator.state[place] == pytest.approx(0.05 * left, rel=0.02)
    assert navigator.state[variance] == pytest.approx(0.05**2 * (1.0 - left**2), rel=0.02)


def test_rows_of_a_fix_that_is_valid_later_wait():
    """`PositionFix` with latency acts at its validity, whenever it arrived: the same bits as with exact stamps."""
    log = recorded()
    fixes = log["usbl"]
    shifted = PositionFix(
        time=fixes.time + 0.5, latitude=fixes.latitude, longitude=fixes.longitude, depth=fixes.depth, sigma_axes=fixes.sigma_axes
    )
    late = solve(replace(log, tables={**log.tables, "usbl": shifted}), aboard(usbl="latency_s = 0.5"), rate=1.0)
    exact = solve(log, aboard(), rate=1.0)
    np.testing.assert_allclose(late.position_n, exact.position_n, atol=2e-6)
