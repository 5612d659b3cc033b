"""What instruments that look up and down would have recorded: depth, pressure, distance to the sea bed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from leadline.data import records
from leadline.simulate.instrument import STEADY, Drift, Instrument

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Depth(Instrument[records.Depth]):
    """Depth of the sensor's own point below the sea surface (m)."""

    sigma: float = 0.0
    bias: Drift = STEADY

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Depth:
        """Return true depths."""
        return records.Depth(time=time, depth=trajectory.at(time).point(self.lever_arm_b).depth)

    def noisy(self, table: records.Depth, generator: Generator) -> records.Depth:
        """Add bias and white noise."""
        error = self.bias.draw(table.time, 1, generator)[:, 0] + self.sigma * generator.standard_normal(len(table))
        return replace(table, depth=table.depth + error)
