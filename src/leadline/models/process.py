"""The contract of a process model, as a value: how the vehicle moves, and what it is asked for.

`step` moves the nominal state and leaves in `memory` what the transition needs; `push` is the transition as an operator on
columns; `noise` adds the process noise; `view` makes a NavigationView; `pull` turns Jacobians against the view into Jacobians
against the state.  A process model never hears of nuisance states, clones or sensors; a state that several share and that drives the
motion (a current) is a part of the motion, and its name makes sensors use it.

What drives the model is its input `u`, INPUTS numbers that hold until something else is said: of an inertial unit (models/imu.py), or
of the rows of one or more sensors (`feeds`), each of which writes its own places.  u[NOW_U] (models/layout.py) is the moment at hand.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.core import compiled

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.records import Array, Table
    from leadline.models.layout import Part


@dataclass(frozen=True)
class Pose:
    """Where a run begins: place and motion of the process model's reference point, with the covariance of their errors.

    quaternion_en (4,) and height (m) of the place; velocity_n (3,) over ground, quaternion_nb (4,), rate_b (3,) against the navigation
    frame; covariance (9, 9) of position, velocity and attitude (rotation vector on the left), navigation frame.
    """

    quaternion_en: Array
    height: float
    velocity_n: Array
    quaternion_nb: Array
    rate_b: Array
    covariance: Array
    time: float = 0.0


@dataclass(frozen=True)
class Feed:
    """A sensor whose rows are input: rows (n,) of its table -> inputs (n, INPUTS), nan at the places of which a row says nothing.

    A row acts from its time until the sensor's next one.  One that is nan throughout gives none and is invalid.  also_corrects: whether
    its rows are measurements as well.
    """

    sensor: str
    rows: Callable[[Table], Array]
    also_corrects: bool = False


@dataclass(frozen=True)
class Process:
    """A process model with its parameters.

    begin: initial motion (nominal,) and its covariance (error, error), of a Pose.  consumes: "imu" where an inertial unit is its input;
    feeds: else, the sensors whose rows are.  All other sensors are corrections.  linear: whether `step` is.
    """

    name: str
    parts: tuple[Part, ...]
    parameters: Array
    step: Any
    push: Any
    noise: Any
    view: Any
    pull: Any
    defines: frozenset[str]  # of what a sensor can require (models/view.py)
    begin: Callable[[Pose], tuple[Array, Array]]
    consumes: str | None = None
    feeds: tuple[Feed, ...] = ()
    longest_step: float = 0.1  # s: above it a step is divided
    linear: bool = False
    reference_b: Array = field(default_factory=lambda: np.zeros(3))  # the point that it moves, from the body origin (m)
    volatile: int = 0  # how many of the first parameters are addresses of this process alone
    held: tuple[Any, ...] = ()  # kernels that these belong to, so that they live as long

    def kernels(self) -> tuple[tuple[Any, Any], ...]:
        """Return the kernels with the contracts that they must fulfil, in the order of the plan."""
        return (
            (self.step, compiled.STEP),
            (self.push, compiled.PUSH),
            (self.noise, compiled.NOISE),
            (self.view, compiled.VIEW),
            (self.pull, compiled.PULL),
        )
