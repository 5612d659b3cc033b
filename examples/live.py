"""Leadline aboard: rows are handed to the navigator one at a time, as they arrive, and it always knows where the vehicle is.

    python examples/live.py LOG VEHICLE [SECONDS BETWEEN LINES]

The log is played back in the order of arrival.  Aboard, the loop over `arrivals` is the one over the vehicle's messages.  A row that
arrives late is put in its place, and what came after it is worked through again.
"""

from __future__ import annotations

import sys
from collections import Counter
from math import degrees, hypot
from typing import TYPE_CHECKING

import numpy as np

from leadline import Log, Navigator, Outcome, read_log, read_vehicle
from leadline.core.attitude import euler_from_quaternion
from leadline.estimate.solve import navigator_for

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.data.records import Table


def arrivals(log: Log, names: list[str]) -> Iterator[tuple[str, Table]]:
    """Yield the rows of the named tables one at a time, in the order in which they arrived."""
    rows = [
        (when, name, index)
        for name in names
        for index, when in enumerate(log[name].time if log[name].received is None else log[name].received)
        if np.isfinite(when)
    ]
    for _, name, index in sorted(rows):
        yield name, log[name].select(slice(index, index + 1))


def line(navigator: Navigator) -> str:
    """Say where the vehicle is, and how well that is known."""
    now = navigator.estimate()
    north, east, _ = now.position_n[0]
    sigma = hypot(*now.sigma[0, :2])
    heading = degrees(euler_from_quaternion(now.quaternion_nb)[2][0]) % 360
    return f"{now.time[0]:8.1f} s   north {north:8.2f} m   east {east:8.2f} m   +- {sigma:5.2f} m   heading {heading:5.1f} deg"


def main(log_folder: str, vehicle_file: str, every: float = 60.0) -> None:
    """Play a log back."""
    log, vehicle = read_log(log_folder), read_vehicle(vehicle_file)
    navigator, _, _ = navigator_for(log, vehicle)
    due = navigator.start + every
    for name, row in arrivals(log, [name for name in vehicle.sensors if name in log.tables]):
        navigator.add(name, row)
        if navigator.time >= due:
            print(line(navigator))
            due += every
    for code, count in Counter(navigator.outcomes.values()).most_common():
        print(f"{count} measurements: {Outcome(code).sentence}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python examples/live.py LOG VEHICLE [SECONDS BETWEEN LINES]")
    main(*sys.argv[1:3], *map(float, sys.argv[3:]))
