"""Leadline from Python: read, solve, look at arrays, assess.

python examples/as_library.py LOG VEHICLE
"""

from __future__ import annotations

import sys

import numpy as np

import leadline
from leadline.assess.assessment import assess


def main(log_folder: str, vehicle_file: str) -> None:
    """Solve a log and print where the vehicle ended, how well that is known, and whether the error bars hold."""
    log = leadline.read_log(log_folder)
    solution = leadline.solve(log, leadline.read_vehicle(vehicle_file))
    assessment = assess(solution, log.truth)
    north, east, depth = solution.position_n[-1]
    sigma_north, sigma_east, sigma_depth = solution.sigma[-1, :3]
    print(f"after {solution.time[-1]:.0f} s: north {north:.1f} m, east {east:.1f} m, depth {depth:.1f} m")
    print(f"sigmas: {sigma_north:.2f}, {sigma_east:.2f}, {sigma_depth:.2f} m; speed {np.linalg.norm(solution.velocity_n[-1]):.2f} m/s")
    print(assessment.verdict.sentence)
    if assessment.errors is not None:
        print(f"horizontal error: {assessment.errors.statistics()['horizontal'].rms:.2f} m rms")


if __name__ == "__main__":
    main(*sys.argv[1:3])
