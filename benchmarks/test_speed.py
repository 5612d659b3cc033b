"""The loop's time per inertial step at 15, 24 and 30 states, all aiding and outcomes on, beside the dense NumPy twin on the same stream.

    pytest benchmarks/test_speed.py --benchmark-columns=min,median,rounds -s

Both consume the same events in the same process.  The twin (tests/twin.py) does per step what NumPy does well: one dense product with
the whole transition, no Python loop over numbers.  Each run of the twin is paired with a
hundred of the loop around it, and the median of the three ratios counts, so that what else runs on the machine slows both alike.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from twin import Twin, dive, prepared, vehicle

from leadline.estimate.plan import IS_INPUT

AIDED = ("dvl", "depth", "heading", "usbl")
FULL = ("dvl", "depth", "heading", "attitude")
SIZES = {  # states: sensors, nuisances
    15: (AIDED, ()),
    24: ((*AIDED, "attitude"), FULL),
    30: ((*AIDED, "attitude", "ranges"), FULL),  # 24, and four fifths of the time a clone
}


def timed(work: Callable[[], Any]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


@pytest.mark.parametrize("states", SIZES)
def test_loop(benchmark: Any, states: int) -> None:
    """Microseconds per 100 Hz step, and how many times longer the twin takes."""
    names, nuisances = SIZES[states]
    log, aboard = dive(60.0, pings=1.0), vehicle(*names, nuisances=nuisances)
    navigator, stream = prepared(log, aboard)
    start, steps = navigator.state.copy(), int((stream.events.kind == IS_INPUT).sum())

    def loop() -> Any:
        navigator.state[:] = start
        return navigator.run(stream.events, len(stream.times))

    twins = [Twin(navigator, aboard, log) for _ in range(3)]
    results = loop()

    def pair(twin: Twin) -> tuple[float, float]:
        before = timed(lambda: [loop() for _ in range(50)])
        dense = timed(lambda: twin.run(stream.events))
        return dense, (before + timed(lambda: [loop() for _ in range(50)])) / 100

    pairs = [pair(twin) for twin in twins]
    benchmark.pedantic(loop, rounds=30, warmup_rounds=2)
    per_step = benchmark.stats.stats.min / steps * 1e6
    layout = navigator.composition.layout
    benchmark.extra_info.update(
        states=f"{layout.fixed} + {layout.error - layout.fixed} of clones", steps=steps, measurements=len(results.outcome),
        us_per_step=round(per_step, 3), twin_us_per_step=round(min(dense for dense, _ in pairs) / steps * 1e6, 1),
        ratio=round(statistics.median(dense / compiled for dense, compiled in pairs)),
    )  # fmt: skip
    print(f"\n{benchmark.extra_info}")
    assert layout.error == states
    assert np.count_nonzero(results.outcome) < 0.1 * len(results.outcome)
