"""Instruments that have been switched on: what is drawn once per dive is drawn, so that they can look at a dive piece by piece.

An instrument draws the errors of a whole dive at once.  Where the vehicle steers by what its instruments say, its dive is not known
beforehand; so what lasts (turn-on values, scales, what wanders) is settled first, and what is left has no memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from leadline.core.attitude import euler_from_quaternion, exponential, product, quaternion_from_euler
from leadline.data.errors import InputError
from leadline.simulate.drift import STEADY, Drift
from leadline.simulate.gyros import EVEN, Triad
from leadline.simulate.reception import GAP, Reception

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array
    from leadline.simulate.instrument import Instrument

Made = TypeVar("Made", bound="Instrument[Any]")

GRID = 0.5  # s between the moments at which what wanders is drawn; in between it is straight
ONCE = {
    "sigma_scale": "scale", "sigma_hard": "hard_iron", "sigma_swing": "swing", "sigma_g_sensitivity": "g_sensitivity",
}  # fmt: skip
NEVER = ("sigma_soft",)  # drawn once, and no field holds what was drawn


@dataclass(frozen=True, eq=False)
class Drawn(Drift):
    """A drift that has been drawn for a whole dive, on a grid of moments; whoever asks again gets the same."""

    law: Drift = STEADY
    last: float = 0.0
    seed: int = 0
    series: dict[int, Array] = field(default_factory=dict)

    def draw(self, time: Array, axes: int, generator: Generator) -> Array:  # noqa: ARG002  (its own is older)
        """Return the error (times, axes)."""
        grid = np.arange(-10.0, self.last + 2 * GRID, GRID)
        if axes not in self.series:
            self.series[axes] = self.law.draw(grid, axes, np.random.default_rng([self.seed, axes]))
        return np.stack([np.interp(time, grid, column) for column in self.series[axes].T], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Counting(Triad):
    """A triad that is shown increments piece after piece, in their order: what is left over of one goes into the next."""

    left: Array = field(default_factory=lambda: np.zeros(3))

    def counted(self, increment: Array, span: Array, rate: float) -> Array:
        """Return increments (rows, 3) over spans (rows, 1) (s) as they are shown, by an instrument of a rate (Hz)."""
        if not self.quantum or not len(increment):
            return np.asarray(super().counted(increment, span, rate))
        felt = np.clip(increment, -self.limit * span, self.limit * span)
        felt[0] += self.left
        shown: Array = super().counted(felt, np.full(span.shape, np.inf), rate)
        self.left[:] = np.sum(felt, axis=0) - np.sum(shown, axis=0)
        return shown


@dataclass(frozen=True, kw_only=True, eq=False)
class Receiving(Reception):
    """A receiver that is shown its dry moments piece after piece, in their order; each surfacing has a delay drawn by its number."""

    seed: int = 0
    known: dict[str, float] = field(default_factory=dict)  # last: the last dry moment (s), fixed: of the first fix since it surfaced

    def since_fix(self, time: Array, begin: float, interval: float, generator: Generator) -> Array:  # noqa: ARG002  (its own is older)
        """Return how long ago (s) the receiver got its first fix since it surfaced; negative: it has none yet."""
        if not len(time):
            return np.zeros(0)
        last, fixed = self.known.get("last"), np.full(len(time), self.known.get("fixed", -np.inf))
        under = np.diff(time, prepend=begin if last is None else last)
        for rise in np.flatnonzero(under > GAP * interval):
            hot = under[rise] < self.hot_for and (rise > 0 or last is not None)
            number = self.known["rises"] = self.known.get("rises", 0.0) + 1.0
            fixed[rise:] = time[rise] + self.delay(np.array([hot]), np.random.default_rng([self.seed, int(number)]))
        self.known.update(last=float(time[-1]), fixed=float(fixed[-1]))
        return np.asarray(time - fixed)


def settled(instrument: Made, name: str, duration: float, generator: Generator) -> Made:
    """Return an instrument whose lasting errors are those of one dive of at most `duration` (s).

    Raises InputError for one whose errors cannot be told apart so.
    """
    own = {f.name: getattr(instrument, f.name) for f in fields(instrument)}
    for key in NEVER:
        if np.any(own.get(key, 0.0)):
            raise InputError(name, f"has {key}, which is drawn once", "0 where the vehicle steers by its estimate: give what it is instead")
    changed: dict[str, Any] = {}
    for key, value in own.items():
        if isinstance(value, Drift) and value != STEADY:
            changed[key] = Drawn(law=value, last=duration, seed=int(generator.integers(2**62)))
        elif isinstance(value, Triad) and value != EVEN:
            changed[key] = _triad(value, name, generator)
        elif isinstance(value, Reception):
            own_fields = {f.name: getattr(value, f.name) for f in fields(value)}
            changed[key] = Receiving(**own_fields, seed=int(generator.integers(2**62)))
        elif key in ONCE and np.any(value):
            changed |= _once(own, key, name, generator)
        elif key == "sigma_mounting" and value:
            twist = exponential(value * generator.standard_normal(3))
            turned = product(quaternion_from_euler(*instrument.mounting_bs), twist)
            changed |= {key: 0.0, "mounting_bs": tuple(float(angle) for angle in euler_from_quaternion(turned))}
    return replace(instrument, **changed)


def _once(own: dict[str, Any], key: str, name: str, generator: Generator) -> dict[str, Any]:
    if ONCE[key] not in own:
        raise InputError(name, f"has {key}, which is drawn once", "0 where the vehicle steers by its estimate")
    value, sigma = np.asarray(own[ONCE[key]], float), np.asarray(own[key], float)
    drawn = value + sigma * generator.standard_normal(value.shape)
    return {key: type(own[key])() if isinstance(own[key], float) else tuple(0.0 for _ in own[key]), ONCE[key]: _plain(drawn)}


def _triad(value: Triad, name: str, generator: Generator) -> Triad:
    if value.sigma_misalignment:
        raise InputError(name, "has a misalignment that is drawn once", "0 where the vehicle steers by its estimate")
    scale = np.asarray(value.scale, float) + value.sigma_scale * generator.standard_normal(3)
    return Counting(scale=_plain(scale), quantum=value.quantum, limit=value.limit)


def _plain(value: Array) -> Any:
    return float(value) if value.ndim == 0 else tuple(map(float, value))
