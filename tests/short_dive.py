"""The dive of examples/synthetic_dive.py, two minutes of it: what examples and pages are run on."""

from __future__ import annotations

import shutil
import sys
from dataclasses import replace
from math import radians
from pathlib import Path

from leadline import write_log
from leadline.simulate.dive import StartSigmas, simulate
from leadline.simulate.plans import survey

EXAMPLES = Path(__file__).parent.parent / "examples"


def write_short_dive(place: Path) -> None:
    """Write the log `dive`, and beside it `vehicle.toml`, the examples and the missions."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        import synthetic_dive as example
    finally:
        sys.path.remove(str(EXAMPLES))
    plan = replace(example.PLAN, legs=2, length=60.0, surface_time=20.0, dive=6.0, ascend=False)
    when = {"gnss": {"stop": 20.0}, "usbl": {"offset": 30.0, "rate": 1 / 10}, "ranges": {"offset": 25.0}}
    instruments = {name: replace(instrument, **when.get(name, {})) for name, instrument in example.INSTRUMENTS.items()}
    start = StartSigmas(position=2.0, depth=0.2, velocity=0.1, tilt=radians(0.5), heading=radians(2.0))
    log = simulate(survey(example.HARBOUR, plan, duration=120.0), instruments, seed=1, start=start, name="dive")
    write_log(log, place / "dive")
    shutil.copy(EXAMPLES / "synthetic.toml", place / "vehicle.toml")
    shutil.copytree(EXAMPLES, place / "examples", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(EXAMPLES.parent / "missions", place / "missions")
