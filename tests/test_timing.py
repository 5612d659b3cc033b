"""Headings that are right at another time: found on dives whose inertial stamps are off, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import pytest
from short_dive import write_short_dive
from test_trials import PLACE, vehicle

from leadline import read_log, read_vehicle, solve
from leadline.assess.assessment import assess
from leadline.assess.errors import errors_of
from leadline.assess.timing import FEWEST, heading_lead
from leadline.missions.instruments import instruments_of
from leadline.simulate.dive import Recorder, StartSigmas
from leadline.simulate.plans import Lawnmower, survey

GOOD = StartSigmas(position=0.1, depth=0.05, velocity=0.02, tilt=radians(0.02), heading=radians(0.05))


@pytest.fixture(scope="module")
def dive():
    """A well-started survey by dead reckoning: what is still being found of the heading hides some milliseconds."""
    trajectory = survey(PLACE, Lawnmower(legs=12, length=40.0, spacing=20.0, speed=1.5, heading=radians(30.0)), duration=300.0)
    aboard = vehicle(50.0)
    return Recorder(trajectory, instruments_of(aboard), truth_rate=1.0, start=GOOD).draw(3), aboard.without("heading", "usbl")


@pytest.mark.parametrize("off", [-0.01, 0.005, 0.03])
def test_stamps_that_are_off_are_found_and_mended(dive, off):
    """Stamps of the inertial unit that are `off` too late make the heading late; the latency that is said, twice at most, sets it right."""
    log, vehicle = dive
    imu, latency, told = log["imu"], 0.0, []
    wrong = replace(log, tables={**log.tables, "imu": replace(imu, time=imu.time + off)})
    for _ in range(3):
        aboard = replace(vehicle, sensors={**vehicle.sensors, "imu": replace(vehicle["imu"], latency=latency)})
        told = [h for h in assess(solve(wrong, aboard, end=299.9), log.truth).happenings if h.kind == "timing"]
        if not told:
            break
        assert ("behind" if latency < off else "ahead of") in told[0].sentence
        latency += float(told[0].sentence.split("add ")[1].split(" ")[0])
        assert latency == pytest.approx(off, abs=0.1 * abs(off) + 5e-4)
    assert told == []
    assert latency == pytest.approx(off, abs=1.1e-3)


def test_right_stamps_tell_nothing(dive):
    log, vehicle = dive
    solution = solve(log, vehicle)
    lead = heading_lead(errors_of(solution, log.truth), solution, log.truth)
    assert abs(lead.ahead) < 5.0 * lead.sigma + 1e-4
    assert not [h for h in assess(solution, log.truth).happenings if h.kind == "timing"]


def test_too_little_truth_tells_nothing(dive, tmp_path):
    log, vehicle = dive
    solution = solve(log, vehicle)
    few, thin, none = log.truth.select(slice(0, FEWEST - 1)), log.truth.select(slice(0, None, 5)), replace(log.truth, heading=None)
    assert heading_lead(errors_of(solution, few), solution, few) is None
    assert heading_lead(errors_of(solution, thin), solution, thin) is None  # rows of truth too far apart
    assert heading_lead(errors_of(solution, none), solution, none) is None
    sparse = solve(log, vehicle, rate=1.0)
    assert heading_lead(errors_of(sparse, log.truth), sparse, log.truth) is None
    write_short_dive(tmp_path)
    short = read_log(tmp_path / "dive")
    found = assess(solve(short, read_vehicle(tmp_path / "vehicle.toml")), short.truth)
    assert not [h for h in found.happenings if h.kind == "timing"]
