"""Recorded dives of a real vehicle, where the folder named by LEADLINE_DATA holds them (logs/akit-*): within twice of what is attainable.

The reference (docs/accuracy.md) is 1.8 m at the end and 1.0 m RMS in the median over dives; truth itself is good to a metre or two.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from leadline.assess.errors import errors_of
from leadline.data.vehicle import read_vehicle
from leadline.estimate.solve import solve
from leadline.formats.folder import read_log
from leadline.report.html import report_page

DIVES = sorted(Path(os.environ.get("LEADLINE_DATA", "no-such-folder"), "logs").glob("akit-*"))
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
