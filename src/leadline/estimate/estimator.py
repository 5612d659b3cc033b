"""An estimator as a value: kernels that fulfil the contract, with their parameters and what they need of a state and of workspaces.

`propagate` moves the state by a step; `points` says at which points a sensor is asked; `update` makes of what it predicted there a
correction.  In between the loop asks the sensor, so one in plain Python works with every estimator, and halves of two can be mixed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import compiled

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.records import Array
    from leadline.estimate.beginning import Beginning
    from leadline.estimate.composition import Composition
    from leadline.models.layout import Layout


@dataclass(frozen=True)
class Estimator:
    """An estimator with its parameters.

    settle: brings x and P up to date on a copy before an output, where they are not always.  parameters: as plan.py has them for all
    estimators, then its own.  count: how many points it asks a sensor at, of a layout.  extra: numbers that it keeps behind the covariance.
    prepare: makes of a flat state at the start its own.  pointed: begins with sigma points of the pose.  root: the covariance's place
    holds its lower triangular root.  linear: refuses what is not linear.  clones: whether it holds poses at earlier epochs.  smooths:
    whether its tape can be smoothed.  check: refuses a layout, with a sentence.
    """

    name: str
    propagate: Any
    points: Any
    update: Any
    settle: Any | None = None
    parameters: Array = field(default_factory=lambda: np.array([0.0, 0.0, 50.0]))
    count: Callable[[Layout], int] = lambda _: 1
    extra: Callable[[Layout], int] = lambda _: 0
    prepare: Callable[[Composition, Array, Beginning], None] | None = None
    pointed: bool = False
    root: bool = False
    linear: bool = False
    clones: bool = True
    smooths: bool = True
    check: Callable[[Layout], None] = lambda _: None

    def kernels(self) -> tuple[tuple[Any, Any], ...]:
        """Return the kernels that every estimator has, with their contracts, in the order of the plan."""
        return (self.propagate, compiled.PROPAGATE), (self.points, compiled.POINTS), (self.update, compiled.UPDATE)
