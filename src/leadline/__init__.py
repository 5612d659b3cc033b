"""Leadline: where an autonomous underwater vehicle is, was, and how well that is known.

Conventions, without exceptions
-------------------------------
Units      SI and radians inside; degrees and other human units only at the border (files, vehicle file, report, command line).
Frames     e  Earth-fixed (WGS 84).
           n  navigation frame: local level, axis 3 down along the ellipsoid's normal.  Reported values are north-east-down.
              Inside the filter its azimuth wanders (it does not turn about the vertical), so that the pole is an ordinary place.
           b  body: forward, right, down.    s  sensor, as its manufacturer draws it.
Names      A suffix says the frame: `velocity_n`, `lever_arm_b`.  `rotation_nb` and `quaternion_nb` turn b into n: v_n = R_nb v_b.
           `quaternion` is Hamilton, scalar first.  Angles are Z-Y-X: heading (clockwise from true north), pitch, roll.
           `depth` is positive down from the water surface; `height` positive up from the ellipsoid.
           `sigma` is a standard deviation; `nis`, `nees` normalised innovation and estimation error squared.
Errors     true = estimate [+] error.  Position in metres along n; attitude a rotation vector in n, on the left:
           R_true = exp([error]x) R_estimate.
Time       Seconds from the log's epoch.  `time` is when a value was valid, `received` when it arrived.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {  # resolved on first use, so that `import leadline` stays light
    "InputError": "leadline.data.errors",
    "Log": "leadline.data.log",
    "Navigator": "leadline.estimate.navigator",
    "Outcome": "leadline.data.outcome",
    "Solution": "leadline.data.solution",
    "Vehicle": "leadline.data.vehicle",
    "assess": "leadline.assess.assessment",
    "read_log": "leadline.formats.folder",
    "read_solution": "leadline.formats.solution",
    "read_vehicle": "leadline.data.vehicle",
    "solve": "leadline.estimate.solve",
    "write_log": "leadline.formats.folder",
    "write_solution": "leadline.formats.solution",
}
__all__ = [
    "InputError", "Log", "Navigator", "Outcome", "Solution", "Vehicle", "assess", "read_log", "read_solution", "read_vehicle", "solve",
    "write_log", "write_solution",
]  # fmt: skip

if TYPE_CHECKING:
    from leadline.assess.assessment import assess
    from leadline.data.errors import InputError
    from leadline.data.log import Log
    from leadline.data.outcome import Outcome
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle, read_vehicle
    from leadline.estimate.navigator import Navigator
    from leadline.estimate.solve import solve
    from leadline.formats.folder import read_log, write_log
    from leadline.formats.solution import read_solution, write_solution


def __getattr__(name: str) -> Any:
    """Resolve a public name on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'leadline' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
