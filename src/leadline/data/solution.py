"""Solution: all that leaves a run, enough for anyone to score it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from leadline.data.log import Origin
    from leadline.data.records import Array, Text

# The error space of `Solution.covariance`: metres, metres per second, and a rotation vector in north-east-down on the left (rad).
ERROR_NAMES = (
    "north", "east", "down", "velocity_north", "velocity_east", "velocity_down", "rotation_north", "rotation_east", "rotation_down",
)  # fmt: skip
POSITION, VELOCITY, ROTATION = slice(0, 3), slice(3, 6), slice(6, 9)


class Status(IntEnum):
    """How an estimate came about."""

    ALIGNING = 0
    AIDED = 1
    DEAD_RECKONING = 2
    MULTIMODAL = 3
    LOST = 4


@dataclass(frozen=True)
class Estimate:
    """One estimated nuisance state over time: value and sigma (n,) in SI, its unit and frame in words."""

    value: Array
    sigma: Array
    unit: str
    frame: str = ""


@dataclass(frozen=True)
class Innovations:
    """One entry per component of each measurement that was looked at, and one per row that was not (component "").

    `group` numbers the components that were judged together: `nis` (normalised innovation squared) and `dof` are those of
    the group and stand at each of its components.  `outcome` holds numbers of `Outcome`.  SI units and radians.
    """

    sensor: Text  # (n,)
    row: npt.NDArray[np.int64]  # row in the sensor's table
    group: npt.NDArray[np.int64]
    time: Array
    applied: Array  # when it acted; nan: never
    component: Text
    residual: Array
    sigma: Array  # of the residual, as predicted
    nis: Array
    dof: npt.NDArray[np.int64]
    gate_probability: Array
    widened: npt.NDArray[np.bool_]
    outcome: npt.NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self.time)

    def select(self, index: Any) -> Innovations:
        """Return the entries that `index` (mask, slice or indices) selects."""
        return Innovations(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})


@dataclass(frozen=True)
class Solution:
    """States of the body origin (or of another point) at n moments, with full covariance; north-east-down, SI, radians.

    time, latitude, longitude, height, depth, north, east (n,); velocity_n (n, 3); quaternion_nb (n, 4) body -> north-east-down,
    scalar first; covariance (n, 9, 9) over `ERROR_NAMES`; status (n,) of `Status`.
    """

    epoch: datetime
    origin: Origin
    time: Array
    latitude: Array
    longitude: Array
    height: Array
    depth: Array
    north: Array
    east: Array
    velocity_n: Array
    quaternion_nb: Array
    covariance: Array
    status: npt.NDArray[np.int64]
    innovations: Innovations
    nuisances: Mapping[str, Estimate] = field(default_factory=dict)
    altitude: Array | None = None
    summary: Mapping[str, Any] = field(default_factory=dict)  # what was run, version, hashes of inputs, counts, distance

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.time)

    def select(self, index: Any) -> Solution:
        """Return the states that `index` (mask, slice or indices) selects; innovations and summary stay whole."""
        states = {f.name: getattr(self, f.name) for f in fields(self)}
        chosen: dict[str, Any] = {name: values[index] for name, values in states.items() if isinstance(values, np.ndarray)}
        nuisances = {k: replace(e, value=e.value[index], sigma=e.sigma[index]) for k, e in self.nuisances.items()}
        return replace(self, **chosen, nuisances=nuisances)

    @property
    def position_n(self) -> Array:
        """North and east of the origin, and depth (n, 3), m."""
        return np.stack([self.north, self.east, self.depth], axis=1)

    @property
    def sigma(self) -> Array:
        """Standard deviations (n, 9) over `ERROR_NAMES`."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))
