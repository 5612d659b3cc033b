"""Where a simulated vehicle is to go: legs of a plan made into one line of points that a pilot follows.

A leg is a shape (waypoints, lawnmower, polygon, circle, spiral, sine, L with a turn back) or a stay (station keeping, a turn on the
spot).  Curves become chords at most `CHORD` off them.  Each point says how fast, how deep (or how high above the ground) the vehicle is on
the way to it, and what it does there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from leadline.data.records import Array

Points = list[tuple[float, float]]

SMALLEST = 0.1  # m, radius of a circle
CHORD = 0.02  # m, how far a chord may lie off its curve
# Columns of a route: on the way to the point, and at it.
NORTH, EAST, SPEED, VERTICAL, ALTITUDE, HEADING, HOLD, TURN, LEG, ALONG, WIDTH = range(11)


@dataclass(frozen=True, kw_only=True)
class Leg(ABC):
    """One part of a plan.  speed (m/s); depth (m) or altitude (m) above the ground, one of them; heading (rad) or None: along the way."""

    name: ClassVar[str] = ""
    speed: float
    depth: float | None = None
    altitude: float | None = None
    heading: float | None = None
    needs_hover: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse a leg that is no leg."""
        if not self.speed > 0:
            raise InputError(self.name, f"has a speed of {self.speed} m/s", "above 0")
        if (self.depth is None) == (self.altitude is None):
            found = "has neither depth nor altitude" if self.depth is None else "has both depth and altitude"
            raise InputError(self.name, found, "give one of them")
        if self.depth is not None and self.depth < 0:
            raise InputError(self.name, f"asks for a depth of {self.depth} m", "0 or more: depths are positive down")

    @abstractmethod
    def points(self, start: tuple[float, float]) -> Points:
        """Return the points (north, east) after `start`."""

    def rows(self, start: tuple[float, float], number: int) -> Array:
        """Return the rows of the route."""
        points = self.points(start)
        found = np.zeros((len(points), WIDTH))
        found[:, [NORTH, EAST]] = np.reshape(points, (-1, 2))
        found[:, SPEED], found[:, LEG] = self.speed, number
        found[:, VERTICAL] = self.depth if self.depth is not None else self.altitude
        found[:, ALTITUDE] = self.altitude is not None
        found[:, HEADING] = np.nan if self.heading is None else self.heading
        return found


@dataclass(frozen=True, kw_only=True)
class Waypoints(Leg):
    """Straight lines through points (north, east)."""

    name = "waypoints"
    through: tuple[tuple[float, float], ...]

    def points(self, start: tuple[float, float]) -> Points:  # noqa: ARG002
        """Return the points themselves."""
        return [(float(n), float(e)) for n, e in self.through]


@dataclass(frozen=True, kw_only=True)
class Placed(Leg):
    """A shape that begins at `at` (north, east; by default where the vehicle is), its first side along `bearing` (rad)."""

    at: tuple[float, float] | None = None
    bearing: float = 0.0

    @abstractmethod
    def local(self) -> Points:
        """Return the shape: (along the bearing, to starboard of it), beginning after (0, 0)."""

    def points(self, start: tuple[float, float]) -> Points:
        """Return the shape where it lies."""
        n, e = self.at or start
        c, s = np.cos(self.bearing), np.sin(self.bearing)
        way = [] if self.at is None else [self.at]
        return way + [(float(n + c * x - s * y), float(e + s * x + c * y)) for x, y in self.local()]


@dataclass(frozen=True, kw_only=True)
class Lawnmower(Placed):
    """`legs` parallel lines of `length`, `spacing` apart, the next to starboard (negative spacing: to port); turns are half circles.

    square: turns at right angles instead.
    """

    name = "lawnmower"
    legs: int
    length: float
    spacing: float
    square: bool = False

    def local(self) -> Points:
        """Return the lines and what joins them."""
        found: Points = []
        for k in range(self.legs):
            up, y = k % 2 == 0, k * self.spacing
            if k:
                found += self._joint(k, 0.0 if up else self.length)
            found.append((self.length if up else 0.0, y))
        return found

    def _joint(self, k: int, x: float) -> Points:
        """From the end of line k - 1 to the beginning of line k."""
        before, radius = (k - 1) * self.spacing, 0.5 * self.spacing
        if self.square:
            return [(x, before + self.spacing)]
        ahead = 1.0 if k % 2 else -1.0
        angles = np.linspace(0.0, np.pi, _chords(abs(radius), np.pi) + 1)[1:]
        return [(float(x + ahead * abs(radius) * np.sin(a)), float(before + radius * (1 - np.cos(a)))) for a in angles]


@dataclass(frozen=True, kw_only=True)
class Polygon(Placed):
    """A regular polygon of `sides` with side `length`, run round to starboard `laps` times: 3 a triangle, 4 a square."""

    name = "polygon"
    sides: int
    length: float
    laps: int = 1

    def local(self) -> Points:
        """Return the corners."""
        found: Points = []
        x = y = direction = 0.0
        for _ in range(self.sides * self.laps):
            x, y = x + self.length * np.cos(direction), y + self.length * np.sin(direction)
            found.append((float(x), float(y)))
            direction += 2 * np.pi / self.sides
        return found


@dataclass(frozen=True, kw_only=True)
class Circle(Placed):
    """A circle of `radius` (m) that begins along the bearing, to starboard (negative: to port), `turns` times round."""

    name = "circle"
    radius: float
    turns: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a circle that is a point."""
        super().__post_init__()
        if not abs(self.radius) >= SMALLEST:
            raise InputError(self.name, f"has a radius of {self.radius} m", f"{SMALLEST} m or more, to port with a minus")

    def local(self) -> Points:
        """Return the points."""
        whole = 2 * np.pi * self.turns
        angles = np.linspace(0.0, whole, _chords(abs(self.radius), whole) + 1)[1:]
        return [(float(abs(self.radius) * np.sin(a)), float(self.radius * (1 - np.cos(a)))) for a in angles]


@dataclass(frozen=True, kw_only=True)
class Spiral(Leg):
    """A helix about a centre at the starboard side: `turns` circles of `radius` from `depth` down (or up) to `end_depth`."""

    name = "spiral"
    radius: float
    turns: float
    end_depth: float
    at: tuple[float, float] | None = None
    bearing: float = 0.0

    def points(self, start: tuple[float, float]) -> Points:
        """Return the points of the circles."""
        return Circle(speed=self.speed, depth=0.0, at=self.at, bearing=self.bearing, radius=self.radius, turns=self.turns).points(start)

    def rows(self, start: tuple[float, float], number: int) -> Array:
        """Return the rows, each a little deeper."""
        if self.depth is None:
            raise InputError(self.name, "has an altitude", "give depth_m and end_depth_m")
        found = super().rows(start, number)
        found[:, VERTICAL] = np.linspace(self.depth, self.end_depth, len(found))
        return found


@dataclass(frozen=True, kw_only=True)
class Sine(Placed):
    """A sine about the bearing: amplitude sin(2 pi x / wavelength) to starboard, for `length` metres along."""

    name = "sine"
    length: float
    amplitude: float
    wavelength: float

    def local(self) -> Points:
        """Return the points."""
        k = 2 * np.pi / self.wavelength
        step = np.sqrt(8 * CHORD / max(abs(self.amplitude) * k * k, 1e-9))
        x = np.linspace(0.0, self.length, max(int(np.ceil(self.length / min(step, self.wavelength / 16))), 2) + 1)[1:]
        return [(float(a), float(self.amplitude * np.sin(k * a))) for a in x]


@dataclass(frozen=True, kw_only=True)
class Ell(Placed):
    """An L: `length` along the bearing, `width` to starboard, and back by the same way (a U-turn at its end)."""

    name = "ell"
    length: float
    width: float

    def local(self) -> Points:
        """Return the corners."""
        return [(self.length, 0.0), (self.length, self.width), (self.length, 0.0), (0.0, 0.0)]


@dataclass(frozen=True, kw_only=True)
class Hold(Leg):
    """Station keeping for so many seconds at `at` (by default where the vehicle is)."""

    name = "hold"
    seconds: float
    at: tuple[float, float] | None = None
    needs_hover = True

    def points(self, start: tuple[float, float]) -> Points:
        """Return the one point."""
        return [self.at or start]

    def rows(self, start: tuple[float, float], number: int) -> Array:
        """Return the row with its stay."""
        found = super().rows(start, number)
        found[-1, HOLD] = self.seconds
        return found


@dataclass(frozen=True, kw_only=True)
class Rotate(Hold):
    """A turn on the spot by `angle` (rad, to starboard) within `seconds`."""

    name = "rotate"
    angle: float

    def rows(self, start: tuple[float, float], number: int) -> Array:
        """Return the row with its turn."""
        found = super().rows(start, number)
        found[-1, TURN] = self.angle
        return found


@dataclass(frozen=True)
class Surfacing:
    """Up to the surface every so many seconds, for so many seconds with the antenna in air, then down again; on along the route meanwhile.

    stop: the vehicle stays where it is while it rises and waits.
    """

    every: float
    stay: float
    stop: bool = False


@dataclass(frozen=True)
class Plan:
    """Legs in their order, from `start` (north, east) on; surfacing, if any; ascend: up to the surface at the end."""

    legs: tuple[Leg, ...]
    start: tuple[float, float] = (0.0, 0.0)
    surfacing: Surfacing | None = None
    ascend: bool = False
    stay: float = 0.0  # s at the end: at the surface, or where it is

    @property
    def route(self) -> Array:
        """The rows (points, WIDTH), the start first; raises InputError for a plan without legs."""
        if not self.legs:
            raise InputError("plan", "has no legs", "give at least one")
        here, rows = self.start, []
        for number, leg in enumerate(self.legs, 1):
            rows.append(leg.rows(here, number))
            here = (float(rows[-1][-1, NORTH]), float(rows[-1][-1, EAST]))
        whole = np.concatenate(rows)
        first = whole[:1].copy()
        first[0, [NORTH, EAST]], first[0, [HOLD, TURN, LEG]] = self.start, 0.0  # leg 0: so that of the first leg a row is left
        return measured(np.concatenate([first, whole]))


def measured(route: Array) -> Array:
    """Return the route without points that coincide with the one before (unless something happens there), with distances along it."""
    gap = np.hypot(np.diff(route[:, NORTH]), np.diff(route[:, EAST]))
    kept = np.concatenate([[True], (gap > 1e-6) | (route[1:, HOLD] > 0) | (np.diff(route[:, LEG]) > 0)])
    found = np.ascontiguousarray(route[kept])
    found[:, ALONG] = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(found[:, NORTH]), np.diff(found[:, EAST])))])
    return found


def between(route: Array, step: float) -> Array:
    """Return the route with further rows along its straight lines, at most `step` (m) apart; each is as the row that it leads to."""
    rows = [route[:1]]
    for a, b in pairwise(route):
        count = max(int(np.ceil((b[ALONG] - a[ALONG]) / step)), 1)
        part = np.tile(b, (count, 1))
        share = np.arange(1, count + 1)[:, None] / count
        part[:, [NORTH, EAST, ALONG]] = a[[NORTH, EAST, ALONG]] + share * (b - a)[[NORTH, EAST, ALONG]]
        rows.append(part)
    return np.concatenate(rows)


def duration_of(route: Array) -> float:
    """Return how long (s) the route takes at its speeds, with its stays."""
    lengths = [b[ALONG] - a[ALONG] for a, b in pairwise(route)]
    return float(sum(length / row[SPEED] for length, row in zip(lengths, route[1:], strict=True)) + np.sum(route[:, HOLD]))


def _chords(radius: float, angle: float) -> int:
    """Return into how many chords an arc is cut."""
    return max(int(np.ceil(abs(angle) / np.sqrt(8 * CHORD / max(radius, CHORD)))), 2)


LEGS: dict[str, type[Leg]] = {kind.name: kind for kind in (Waypoints, Lawnmower, Polygon, Circle, Spiral, Sine, Ell, Hold, Rotate)}
