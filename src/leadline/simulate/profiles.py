"""Smooth scalar functions of time with exact derivatives, of which plans of motion are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from leadline.data.records import Array


class Profile(Protocol):
    """A smooth scalar function of time."""

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times), orders at most 4."""
        ...


@dataclass(frozen=True)
class Ramp:
    """value + slope * time."""

    value: float = 0.0
    slope: float = 0.0

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        result = np.zeros((orders, len(time)))
        result[0] = self.value + self.slope * time
        result[1:2] = self.slope
        return result


@dataclass(frozen=True)
class Sinusoid:
    """amplitude * sin(2 pi time / period + phase)."""

    amplitude: float
    period: float
    phase: float = 0.0

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        omega = 2 * np.pi / self.period
        sine, cosine = np.sin(omega * time + self.phase), np.cos(omega * time + self.phase)
        return np.stack([self.amplitude * omega**k * (sine, cosine, -sine, -cosine)[k] for k in range(orders)])


@dataclass(frozen=True)
class Steps:
    """A staircase: values[0], then from start[i], within length[i], smoothly to values[i + 1].

    The step is the polynomial of degree 9 in x = (time - start) / length whose first four derivatives vanish at both ends:
    s' = 630 x^4 (1 - x)^4.
    """

    start: tuple[float, ...]
    length: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse steps that overlap."""
        if np.any(np.array(self.start[:-1]) + self.length[:-1] > np.array(self.start[1:]) + 1e-9):
            raise InputError("Steps", f"steps overlap: start {self.start}, length {self.length}", "let one end before the next")

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        index = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        values, length = np.asarray(self.values), np.asarray(self.length)[index]
        x = np.clip((time - np.asarray(self.start)[index]) / length, 0.0, 1.0)
        q, slope = x * (1 - x), 1 - 2 * x
        q_2, x_4 = q * q, x * x * x * x
        shape = (
            lambda: x_4 * x * (126 + x * (-420 + x * (540 + x * (-315 + 70 * x)))),
            lambda: 630 * q_2 * q_2 / length,
            lambda: 2520 * q_2 * q * slope / length**2,
            lambda: 2520 * q_2 * (3 * slope * slope - 2 * q) / length**3,
        )
        result = np.stack([shape[k]() for k in range(orders)]) * np.diff(values)[index]
        result[0] += values[index]
        return result


@dataclass(frozen=True)
class Sum:
    """The sum of several profiles."""

    parts: tuple[Profile, ...]

    def __call__(self, time: Array, orders: int) -> Array:
        """Return the value and its derivatives, shape (orders, times)."""
        return np.asarray(np.sum([part(time, orders) for part in self.parts], axis=0))
