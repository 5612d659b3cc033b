"""The contract of a process model, as a value: how the vehicle moves, and what it is asked for.

`step` moves the nominal state and leaves in `memory` what the transition needs; `push` is the transition as an operator on
columns; `noise` adds the process noise; `view` makes a NavigationView; `pull` turns Jacobians against the view into Jacobians
against the state.  A process model never hears of nuisance states, clones or sensors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from leadline.core import compiled

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.models.layout import Part


@dataclass(frozen=True)
class Process:
    """A process model with its parameters."""

    name: str
    parts: tuple[Part, ...]
    parameters: Array
    step: Any
    push: Any
    noise: Any
    view: Any
    pull: Any
    defines: frozenset[str]  # of what a sensor can require (models/view.py)
    consumes: str | None = None  # kind of sensor whose rows are its input
    longest_step: float = 0.1  # s: above it a step is divided

    def kernels(self) -> tuple[tuple[Any, Any], ...]:
        """Return the kernels with the contracts that they must fulfil, in the order of the plan."""
        return (
            (self.step, compiled.STEP),
            (self.push, compiled.PUSH),
            (self.noise, compiled.NOISE),
            (self.view, compiled.VIEW),
            (self.pull, compiled.PULL),
        )
