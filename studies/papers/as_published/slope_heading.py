"""Headings of table III of Wang and Pang (2014): the slope of the path in place of its course."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leadline.data import records
from leadline.simulate.instruments import Attitude

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.simulate.trajectory import Trajectory


def slope(form: str, amplitude: float, omega: float, time: Array) -> Array:
    """Return the heading (rad) that the table gives for its paths: A w cos(wt), -tan(wt), 0."""
    if form == "straight":
        return 0.0 * time
    return amplitude * omega * np.cos(omega * time) if form == "sine" else -np.tan(omega * time)


@dataclass(frozen=True, kw_only=True)
class SlopeAttitude(Attitude):
    """An attitude sensor whose heading is the table's; what the Doppler log and the inertial unit see is that of the true course."""

    form: str = "sine"
    amplitude: float = 5.0
    omega: float = 0.2

    def ideal(self, trajectory: Trajectory, time: Array) -> records.Attitude:
        """Return roll and pitch of the body, and the heading of the table."""
        return replace(super().ideal(trajectory, time), heading=slope(self.form, self.amplitude, self.omega, time) % (2 * np.pi))
