"""The water of a simulated sea: current, waves and tide as values, made into the one array that the kernels of `flow` read."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.sea import flow

if TYPE_CHECKING:
    from leadline.data.records import Array

GRAVITY = 9.81  # m/s^2, of waves
COMPONENTS = 40  # of a sea state
SERIES_STEP = 10.0  # s between moments at which a wandering current is drawn


@dataclass(frozen=True)
class TidalCurrent:
    """A current that goes round an ellipse: major (m/s) along `heading` (rad), minor across it, to starboard first if positive.

    velocity = major cos(w (t - crest)) along + minor sin(w (t - crest)) to starboard of heading, w = 2 pi / period.
    """

    major: float
    heading: float
    minor: float = 0.0
    period: float = 44714.16  # s, the constituent M2 (12.4206 h)
    crest: float = 0.0

    @property
    def row(self) -> tuple[float, ...]:
        """The numbers that `flow` reads."""
        w = 2 * np.pi / self.period
        along, across = np.array([np.cos(self.heading), np.sin(self.heading)]), np.array([-np.sin(self.heading), np.cos(self.heading)])
        c, s = np.cos(w * self.crest), np.sin(w * self.crest)
        cosine = self.major * c * along - self.minor * s * across
        sine = self.major * s * along + self.minor * c * across
        return (w, *map(float, cosine), *map(float, sine), 0.0)


@dataclass(frozen=True)
class Waves:
    """A sea state: significant height (m), peak period (s), mean direction (rad) into which the waves travel.

    Spectrum of JONSWAP with peak enhancement `gamma` (Hasselmann et al., 1973; 1: Pierson-Moskowitz's shape), scaled to the height;
    directions spread as cos^2 about the mean; phases and directions are drawn from `seed`.
    """

    height: float
    period: float
    heading: float = 0.0
    gamma: float = 3.3
    seed: int = 0

    @cached_property
    def rows(self) -> Array:
        """The components (n, 6), as `flow` reads them."""
        generator = np.random.default_rng([self.seed, 0x5EA])
        peak = 2 * np.pi / self.period
        edges = peak * np.geomspace(0.6, 4.0, COMPONENTS + 1)
        omega = np.sqrt(edges[1:] * edges[:-1])
        width = np.where(omega <= peak, 0.07, 0.09)
        density = omega**-5 * np.exp(-1.25 * (peak / omega) ** 4) * self.gamma ** np.exp(-((omega / peak - 1) ** 2) / (2 * width**2))
        energy = density * np.diff(edges)
        amplitude = np.sqrt(2 * energy / energy.sum() * (self.height / 4) ** 2)  # the variance of the surface is (H / 4)^2
        heading = self.heading + _spread(generator.uniform(0.0, 1.0, COMPONENTS))
        phase = generator.uniform(0.0, 2 * np.pi, COMPONENTS)
        return np.column_stack([amplitude, omega**2 / GRAVITY, omega, np.cos(heading), np.sin(heading), phase])


@dataclass(frozen=True)
class Wandering:
    """A current that wanders, alike at all depths: a Gauss-Markov process of steady sigma (m/s, each axis) and time constant (s)."""

    sigma: float
    tau: float
    seed: int = 0

    def series(self, duration: float) -> Array:
        """Return north and east (n, 2) at moments `SERIES_STEP` apart."""
        count = int(np.ceil(duration / SERIES_STEP)) + 2
        white = np.random.default_rng([self.seed, 0xC0]).standard_normal((count, 2))
        keep = np.exp(-SERIES_STEP / self.tau)
        found = np.empty((count, 2))
        found[0] = self.sigma * white[0]
        for k in range(1, count):
            found[k] = keep * found[k - 1] + self.sigma * np.sqrt(1 - keep * keep) * white[k]
        return found


@dataclass(frozen=True)
class Level:
    """One constituent of the tide: the surface stands amplitude cos(2 pi (t - crest) / period) (m) above its mean."""

    amplitude: float
    period: float = 44714.16
    crest: float = 0.0


@dataclass(frozen=True, eq=False)
class Water:
    """How the water of a sea moves.

    shear: rows (depth m, north m/s, east m/s) by ascending depth; one row is a uniform current.  What is not given does not move.
    duration: s for which a wandering current is drawn.
    """

    shear: tuple[tuple[float, float, float], ...] = ()
    tides: tuple[TidalCurrent, ...] = ()
    waves: Waves | None = None
    wandering: Wandering | None = None
    levels: tuple[Level, ...] = ()
    duration: float = 0.0

    def __post_init__(self) -> None:
        """Refuse depths that do not ascend."""
        depths = [row[0] for row in self.shear]
        if any(b <= a for a, b in itertools.pairwise(depths)):
            raise InputError("current", f"has depths {depths}", "ascending ones")

    @cached_property
    def parameters(self) -> Array:
        """The flat array that the kernels of `flow` read."""
        waves = self.waves.rows if self.waves is not None else np.zeros((0, flow.WAVE))
        series = self.wandering.series(self.duration) if self.wandering is not None else np.zeros((0, flow.STEP))
        head = np.zeros(flow.HEAD)
        head[flow.SHEARS], head[flow.TIDES], head[flow.WAVES] = len(self.shear), len(self.tides), len(waves)
        head[flow.SERIES], head[flow.LEVELS], head[flow.SERIES_STEP] = len(series), len(self.levels), SERIES_STEP
        levels = [(one.amplitude, 2 * np.pi / one.period, -2 * np.pi * one.crest / one.period) for one in self.levels]
        lists = (self.shear, [tide.row for tide in self.tides], waves, series, levels)
        return np.concatenate([head, *(np.asarray(rows, float).ravel() for rows in lists)])

    def velocity_n(self, time: Array, north: Array, east: Array, depth: Array) -> Array:
        """Return the velocity (n, 3) of the water, north, east, down (m/s), at times (s), places (m) and depths (m)."""
        found = np.empty((len(time), 3))
        flow.flows(*_rows(time, north, east, depth), self.parameters, found)
        return found

    def level(self, time: Array) -> Array:
        """Return how high (m) the surface stands above its mean without its waves, at times (s)."""
        found = np.zeros(len(time))
        if self.levels:
            flow.levels(np.ascontiguousarray(time, float), self.parameters, found)
        return found

    def wave_pressure(self, time: Array, north: Array, east: Array, depth: Array) -> Array:
        """Return the height (m) of water by which the waves raise the pressure."""
        found = np.zeros(len(time))
        if self.waves is not None:
            flow.wave_pressures(*_rows(time, north, east, depth), self.parameters, found)
        return found


CALM = Water()


def _spread(share: Array) -> Array:
    """Return the angles (rad) below which shares of a law of density 2 / pi cos^2 lie."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 721)
    return np.asarray(np.interp(share, 0.5 + angle / np.pi + np.sin(2 * angle) / (2 * np.pi), angle))


def _rows(*columns: Array) -> list[Array]:
    return [np.ascontiguousarray(column, float) for column in np.broadcast_arrays(*columns)]
