"""What the sea is like while a vehicle is in it: the current and the depth of the sea bed, the same for all instruments of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.sea.water import CALM
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.vectors import turned_back

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Kinematics

STEP = 0.1  # s between the moments at which what wanders is drawn; in between it is straight, and so too smooth: short against a ping


@dataclass(frozen=True, eq=False)
class Surrounding:
    """One quantity: `mean` (SI), and what is drawn anew for each seed; `series` (moments, axes) once it has been drawn.

    For the current: velocity of the water north and east (m/s), water.current.  For the sea bed: depth (m), seabed.depth.
    """

    name: str
    mean: tuple[float, ...]
    drift: Drift = STEADY
    series: Array | None = None

    def drawn(self, duration: float, generator: Generator) -> Surrounding:
        """Return it as it is in the run of one seed."""
        moments = np.arange(0.0, duration + 2 * STEP, STEP)
        return replace(self, series=self.drift.draw(moments, len(self.mean), generator))

    def at(self, time: Array) -> Array:
        """Return its value (times, axes) at times (s)."""
        value = np.tile(np.asarray(self.mean, float), (len(time), 1))
        if self.series is None:
            return value
        moments = STEP * np.arange(len(self.series))
        return np.asarray(value + np.stack([np.interp(time, moments, column) for column in self.series.T], axis=1))


STILL = Surrounding("water.current", (0.0, 0.0))


def current_n(where: Kinematics, current: Surrounding | None) -> Array:
    """Return the velocity (times, 3) of the water at a point, north, east, down (m/s): that of the mission's sea and of a surrounding."""
    rows = len(where.time)
    flow = np.column_stack([np.zeros((rows, 2)) if current is None else current.at(where.time), np.zeros(rows)])
    return flow if where.place.water is CALM else flow + where.water_velocity_n


def through_water(state: Kinematics, current: Surrounding | None, where: Kinematics | None = None) -> Array:
    """Return the velocity (times, 3) of a point through the water, body axes: over ground less that of the water there, or elsewhere."""
    return state.velocity_b - turned_back(state.rotation_nb, current_n(state if where is None else where, current))
