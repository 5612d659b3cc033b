"""The main loop with every index checked: out of bounds is silent in a kernel, so one run looks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
PROGRAM = """
import numba
import numpy as np
from twin import covariance, dive, prepared, vehicle

assert numba.config.BOUNDSCHECK
names = ("dvl", "depth", "heading", "attitude", "gnss", "usbl", "ranges")
for nuisances, clones in (((), ""), (("dvl", "ranges"), ""), (("dvl", "depth", "heading"), "[process]\\nclones = 1")):
    navigator, stream = prepared(dive(6.0, gap=(3.0, 3.2)), vehicle(*names, nuisances=nuisances, more=clones), rate=5.0)
    results = navigator.run(stream.events, len(stream.times))
    layout = navigator.composition.layout
    assert np.linalg.eigvalsh(covariance(navigator.composition, navigator.state)[: layout.fixed, : layout.fixed]).min() > 0
    print(layout.fixed, layout.error, np.bincount(results.outcome))
"""


@pytest.mark.slow
def test_the_loop_stays_in_bounds(tmp_path: Path) -> None:
    """All sensors with clones, up to the 32 states that fit, a gap and outputs, under NUMBA_BOUNDSCHECK=1 in a cache of its own."""
    path = os.pathsep.join((str(TESTS.parent / "src"), str(TESTS)))
    environment = {**os.environ, "PYTHONPATH": path, "LEADLINE_CACHE": str(tmp_path), "NUMBA_BOUNDSCHECK": "1"}
    done = subprocess.run([sys.executable, "-B", "-c", PROGRAM], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    sizes = [tuple(map(int, line.split()[:2])) for line in done.stdout.splitlines()]
    assert [fixed for fixed, _ in sizes] == [15, 20, 21]
    assert max(size for _, size in sizes) == 32
