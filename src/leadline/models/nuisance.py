"""Nuisance states: what must be estimated beside the motion, or else known, for a measurement to be understood."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

AXES: Mapping[int, tuple[str, ...]] = {  # what the components of a nuisance, or of a part of the motion, are called, by their number
    1: ("",),
    2: ("_north", "_east"),
    3: ("_x", "_y", "_z"),
    4: ("_sin", "_cos", "_sin2", "_cos2"),
    6: ("_xy", "_xz", "_yx", "_yz", "_zx", "_zy"),
}


@dataclass(frozen=True)
class Nuisance:
    """One scalar nuisance: a constant when `sigma` is zero, a state otherwise; a sensor cannot tell which.

    As a state it is a first-order Gauss-Markov process about its value with correlation time `tau` and steady sigma `steady`, or,
    with infinite tau, a random walk of density `walk` per square root of a second (0: a random constant).  With a `length` it is a
    field in space as well: its decay rate grows by speed / length.
    """

    name: str  # keyed by instance, for example "dvl.scale"; equal names are one state
    value: float = 0.0
    sigma: float = 0.0
    tau: float = math.inf
    steady: float = 0.0
    walk: float = 0.0
    unit: str = ""
    frame: str = ""
    length: float = math.inf  # distance over which it changes as it does over tau (m): a field that the vehicle moves through
    considered: float = 0.0  # sigma of what is not estimated, for an error budget

    @property
    def rate(self) -> float:
        """Decay rate 1/tau (1/s)."""
        return 0.0 if math.isinf(self.tau) else 1.0 / self.tau

    @property
    def density(self) -> float:
        """Variance of the driving noise per second."""
        return self.walk**2 if math.isinf(self.tau) else 2.0 * self.steady**2 / self.tau

    @property
    def per_metre(self) -> float:
        """Decay per metre travelled (1/m)."""
        return 0.0 if math.isinf(self.length) else 1.0 / self.length

    @property
    def density_per_metre(self) -> float:
        """Variance of the driving noise per metre travelled."""
        return 2.0 * self.steady**2 * self.per_metre
