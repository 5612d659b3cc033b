"""Recorded dives of a real vehicle, where the folder named by LEADLINE_DATA holds them (logs/akit-*): within twice of what is attainable.

The reference (docs/accuracy.md) is 1.8 m at the end and 1.0 m RMS in the median over dives; truth itself is good to a metre or two.
"""

import os
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from leadline.assess.errors import errors_of
from leadline.calibrate.dvl import calibrate_dvl, fragment
from leadline.data.solution import Status
from leadline.data.vehicle import read_vehicle
from leadline.estimate.solve import solve
from leadline.formats.folder import read_log
from leadline.report.html import report_page

DIVES = sorted(Path(os.environ.get("LEADLINE_DATA", "no-such-folder"), "logs").glob("akit-*"))
VEHICLE = Path(__file__).parents[1] / "examples" / "snapir.toml"
pytestmark = pytest.mark.skipif(not DIVES, reason="LEADLINE_DATA does not name a folder of recorded logs with logs/akit-*")


def test_recorded_dives_are_navigated_within_twice_of_the_reference():
    vehicle = read_vehicle(Path(__file__).parents[1] / "examples" / "snapir.toml")
    errors = []
    for folder in DIVES:
        log = read_log(folder)
        solution = solve(log, vehicle)
        found = errors_of(solution, log.truth)
        errors.append((found.horizontal[-1], np.sqrt(np.mean(found.horizontal**2)), found.horizontal.max()))
        assert np.isfinite(solution.covariance).all()
    end, rms, largest = np.array(errors).T
    assert np.median(end) < 2.0 * 1.8
    assert np.median(rms) < 2.0 * 1.0
    assert largest.max() < 15.0  # none is lost


def test_the_report_of_a_recorded_dive_is_made():
    from leadline.assess.assessment import assess

    log = read_log(DIVES[0])
    solution = solve(log, read_vehicle(Path(__file__).parents[1] / "examples" / "snapir.toml"))
    assert "<html" in report_page(solution, assessment=assess(solution, log.truth), truth=log.truth)


def scored(log, vehicle):
    """Horizontal error at the end and RMS (m), heading RMS (rad), velocity RMS (m/s), share of positions and headings inside 3 sigma."""
    found = errors_of(solve(log, vehicle), log.truth)
    inside = np.abs(found.error) <= 3.0 * found.sigma
    velocity = np.sqrt(np.mean(np.sum(found.error[:, 3:5] ** 2, axis=1)))
    heading = np.sqrt(np.mean(found.error[:, 8] ** 2))
    rms = np.sqrt(np.mean(found.horizontal**2))
    return found.horizontal[-1], rms, heading, velocity, inside[:, :2].mean(), inside[:, 8].mean()


def test_a_calibration_from_four_dives_serves_the_others():
    """Nothing fitted on a dive is used on it.  The fifth and sixth with a fragment of the first four, and each pair with one of the others.

    Over all six the RMS is 1.13 m (1.1 is the reference's), by the fourth, whose Doppler velocity is at odds with truth.
    """
    plain = read_vehicle(VEHICLE)
    logs = [read_log(folder) for folder in DIVES]
    found = {}
    for held_out in ((4, 5), (0, 1), (2, 3)):
        calibration = calibrate_dvl([log for k, log in enumerate(logs) if k not in held_out], plain, reference="truth")
        assert calibration.enlarged == 1.0
        vehicle = vehicle_over(VEHICLE, fragment(calibration, plain))
        found |= {k: scored(logs[k], vehicle)[:4] for k in held_out if k < len(logs)}
    end, rms, heading, velocity = np.median([found[4], found[5]], axis=0)
    assert heading < 1.1 * np.radians(0.03)
    assert end < 1.1 * 1.8
    assert rms < 1.1 * 1.0
    assert velocity < 1.1 * 0.015
    end, _, heading, velocity = np.median(list(found.values()), axis=0)
    assert end < 1.1 * 1.8
    assert heading < 1.1 * np.radians(0.03)
    assert velocity < 1.1 * 0.015


def vehicle_over(path, text):
    with TemporaryDirectory() as folder:
        place = Path(folder) / "fragment.toml"
        place.write_text(text)
        return read_vehicle(path, place)


@pytest.mark.parametrize("lost", [False, True], ids=["heading off by 5 deg", "bottom lock lost from 100 s on"])
def test_what_goes_wrong_stays_inside_three_sigma(lost):
    """But for the fourth dive, whose Doppler velocity is at odds with truth by metres (docs/accuracy.md)."""
    vehicle = read_vehicle(VEHICLE)
    ends = []
    for folder in DIVES:
        log = read_log(folder)
        start = log.initial.time
        if lost:
            dvl = log["dvl"]
            log = replace(log, tables={**log.tables, "dvl": dvl.select(dvl.time < start + 100.0)})
        else:
            wrong = log.initial.heading + np.radians(5.0)
            log = replace(log, initial=replace(log.initial, heading=wrong, sigma_heading=np.radians(5.0)))
        end, _, _, _, position, heading = scored(log, vehicle)
        ends.append(end)
        assert heading == 1.0, folder.name
        if folder.name != "akit-04":
            assert position > 0.98, folder.name
    assert np.median(ends) < (1.1 * 34.0 if lost else 1.1 * 2.1)


def test_a_heading_that_nobody_stated_is_found_under_way():
    vehicle = read_vehicle(VEHICLE)
    for folder in DIVES[:3]:
        log = read_log(folder)
        unknown = dict.fromkeys(("heading", "sigma_heading", "velocity_north", "velocity_east", "velocity_down", "sigma_velocity"))
        solution = solve(replace(log, initial=replace(log.initial, **unknown)), vehicle)
        found = errors_of(solution, log.truth)
        assert solution.status[0] == Status.ALIGNING
        assert abs(found.error[-1, 8]) < np.radians(0.3)
        assert found.horizontal[-1] < 5.0
