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
    return replace(value, scale=_plain(scale), sigma_scale=0.0)


def _plain(value: Array) -> Any:
    return float(value) if value.ndim == 0 else tuple(map(float, value))
