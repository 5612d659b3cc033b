"""A log cut into stretches, each of which can be run again from a start: what instruments would have said, and what they said."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from leadline.calibrate.hull_knobs import current_of, hull_with
from leadline.calibrate.replay import replay
from leadline.core.attitude import conjugate, exponential, logarithm, matrix_from_quaternion, product
from leadline.data.errors import InputError
from leadline.sea.water import Water
from leadline.simulate.dynamics import site_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.calibrate.hull_knobs import Knob
    from leadline.calibrate.motion_data import Channel, Recorded
    from leadline.data.hull import Hull
    from leadline.data.records import Array

Index: TypeAlias = npt.NDArray[np.int64]
STEP = 0.1  # s of the integration
SPAN, FEW = 3000.0, 5  # s of the log that are used at most, and stretches that are needed
GAP = 1.0  # s without a row of the thrusters that a stretch may hold
BEGIN = 10  # numbers of a start: velocity 3, rate 3, rotation vector against a reference 3, depth
BEGIN_SIGMA = np.array([0.5, 0.5, 0.5, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 5.0])
LEAST = {"velocity": 1e-3, "attitude": 2e-4, "depth": 2e-3}  # sigma of a residual, at least: what lies between rows of the thrusters
FAR = 1e4  # m, m/s, rad/s: where a motion that is not finite is held to be
NUDGE = 1e-6  # of a difference that stands for a derivative: along a ridge, effects cancel to a part in a thousand


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a channel that lie in stretches: index into the channel, stretch, node before and share of the way to the next."""

    channel: Channel
    index: Index
    stretch: Index
    node: Index
    share: Array


@dataclass(frozen=True, eq=False)
class Problem:
    """A log cut into stretches from `begins` (s), with inputs (stretches, nodes, actuators) at nodes `STEP` apart."""

    hull: Hull
    knobs: tuple[Knob, ...]
    begins: Array
    inputs: Array
    rows: tuple[Rows, ...]
    reference: Array  # (stretches, 4): attitude that the rotation vector of a start counts from
    guess: Array  # (stretches, BEGIN)
    latitude: float
    density: float

    @property
    def length(self) -> float:
        """Duration (s) of a stretch."""
        return float(STEP * (self.inputs.shape[1] - 1))

    @cached_property
    def site(self) -> Array:
        """The site array of the simulator, its origin at the surface."""
        return site_at(self.latitude, 0.0, self.density)

    @cached_property
    def order(self) -> tuple[Index, Index]:
        """Order of all residuals by stretch, and where each stretch begins in it (stretches + 1,)."""
        stretch = np.concatenate([np.repeat(rows.stretch, rows.channel.width) for rows in self.rows])
        order = np.argsort(stretch, kind="stable")
        return order, np.searchsorted(stretch[order], np.arange(len(self.begins) + 1)).astype(np.int64)

    @cached_property
    def group(self) -> Index:
        """Which component of which channel each residual is of, in the order of the channels."""
        found, at = [], 0
        for rows in self.rows:
            found.append(np.tile(np.arange(rows.channel.width), len(rows.index)) + at)
            at += rows.channel.width
        return np.concatenate(found)

    @cached_property
    def floor(self) -> Array:
        """The least sigma of each group."""
        return np.concatenate([np.full(rows.channel.width, LEAST[rows.channel.quantity]) for rows in self.rows])

    def hull_at(self, x: Array) -> Hull:
        """Return the hull at x."""
        return hull_with(self.hull, self.knobs, x, self.density, float(self.site[3]))

    def states(self, x: Array, begin: Array) -> Array:
        """Return the states (stretches, nodes, 13) from the starts (stretches, BEGIN)."""
        starts = np.zeros((len(begin), 13))
        starts[:, 2] = begin[:, 9]
        starts[:, 3:7] = product(self.reference, exponential(begin[:, 6:9]))
        starts[:, 7:13] = begin[:, :6]
        north, east = map(float, current_of(self.knobs, x))
        water = Water(shear=((0.0, north, east),)).parameters
        states = replay(starts, self.inputs, STEP, self.hull_at(x), self.site, water)
        return np.clip(np.nan_to_num(states, nan=FAR), -FAR, FAR)

    def residuals(self, x: Array, begin: Array) -> Array:
        """Return all residuals (n,), in the order of the channels."""
        states, current = self.states(x, begin), current_of(self.knobs, x)
        parts = [rows.channel.residual(rows.index, *between(states, rows), current).ravel() for rows in self.rows]
        return np.concatenate(parts)

    def jacobians(self, x: Array, begin: Array, base: Array) -> tuple[Array, Array]:
        """Return the derivatives of residuals to x (n, knobs) and to the start of their stretch (n, BEGIN), by differences."""
        by_knob, by_begin = np.empty((len(base), len(x))), np.empty((len(base), BEGIN))
        for k in range(len(x)):
            moved = x.copy()
            moved[k] += NUDGE
            by_knob[:, k] = (self.residuals(moved, begin) - base) / NUDGE
        for k in range(BEGIN):
            shifted = begin.copy()
            shifted[:, k] += NUDGE * BEGIN_SIGMA[k]
            by_begin[:, k] = (self.residuals(x, shifted) - base) / NUDGE
        return by_knob, by_begin


def between(states: Array, rows: Rows) -> tuple[Array, Array, Array]:
    """Return nu (n, 6), quaternion (n, 4) and depth (n,) at the times of rows, straight between nodes."""
    share = rows.share[:, None]
    found = states[rows.stretch, rows.node] * (1 - share) + states[rows.stretch, rows.node + 1] * share
    quaternion = found[:, 3:7] / np.maximum(np.linalg.norm(found[:, 3:7], axis=1), 1e-9)[:, None]
    return found[:, 7:13], quaternion, found[:, 2]


def problem_of(data: Recorded, hull: Hull, knobs: tuple[Knob, ...], density: float, length: float) -> Problem:
    """Cut a log into stretches of a length (s); raises InputError where fewer than `FEW` can be used."""
    nodes = round(length / STEP) + 1
    begins = stretches(data, hull, length)
    if len(begins) < FEW:
        right = (
            f"at least {FEW} are needed: a longer log, thrusters logged once a second or more often, and the vehicle well below the surface"
        )
        raise InputError(data.name, f"has {len(begins)} stretches of {length:.0f} s that can be used", right)
    time = begins[:, None] + STEP * np.arange(nodes)
    inputs = np.stack([np.interp(time, data.time, column) for column in data.inputs.T], axis=-1)
    rows = tuple(_rows(channel, begins, length) for channel in data.channels)
    reference, guess = _guess(rows, begins)
    return Problem(hull, knobs, begins, inputs, rows, reference, guess, data.latitude, density)


def stretches(data: Recorded, hull: Hull, length: float) -> Array:
    """Return where stretches begin (s): thrusters logged throughout, instruments too, the hull below the surface and not laid up.

    Of more than fit into `SPAN` the liveliest of each part of the log are taken.
    """
    first = max([data.time[0], *(c.time[0] for c in data.channels)])
    last = min([data.time[-1], *(c.time[-1] for c in data.channels)])
    every, many = np.arange(first, last - length, length), round(SPAN / length)
    lively, kept = [], []
    most = np.array([*(t.most for t in hull.thrusters), *(f.most for f in hull.fins)])
    for begin in every:
        inside = data.inputs[slice(*np.searchsorted(data.time, [begin, begin + length]))]
        if _usable(data, hull, float(begin), length) and np.any(np.abs(inside[:, : len(hull.thrusters)]) > 0.0):
            kept.append(float(begin))
            lively.append(float(np.sum(np.std(inside / most, axis=0))))
    if len(kept) <= many:
        return np.array(kept)
    parts = np.array_split(np.arange(len(kept)), many)
    return np.array([kept[part[np.argmax(np.array(lively)[part])]] for part in parts])


def _usable(data: Recorded, hull: Hull, begin: float, length: float) -> bool:
    """Whether a stretch has what it needs."""
    edges = np.array([begin, begin + length])
    a, b = np.searchsorted(data.time, edges)
    around = data.time[max(a - 1, 0) : b + 1]
    if len(around) < 2 or np.max(np.diff(around)) > GAP:
        return False
    for quantity, least in (("velocity", length / 4), ("attitude", length / 2)):
        if all(np.diff(np.searchsorted(c.time, edges))[0] < least for c in data.of(quantity)):
            return False
    depths = [c.value[slice(*np.searchsorted(c.time, edges)), 0] for c in data.of("depth")]
    return all(len(d) > 1 and float(np.min(d)) > max(hull.height, 0.5) for d in depths)


def _rows(channel: Channel, begins: Array, length: float) -> Rows:
    stretch = np.searchsorted(begins, channel.time, side="right") - 1
    place = (channel.time - begins[np.maximum(stretch, 0)]) / STEP
    index = np.flatnonzero((stretch >= 0) & (place < length / STEP))
    node = np.floor(place[index]).astype(np.int64)
    return Rows(channel, index, stretch[index], node, place[index] - node)


def _guess(rows: Sequence[Rows], begins: Array) -> tuple[Array, Array]:
    """Return the reference attitude (stretches, 4) and a first guess of each start, from the rows at its beginning."""
    reference, guess = np.zeros((len(begins), 4)), np.zeros((len(begins), BEGIN))
    attitude = next(r for r in rows if r.channel.quantity == "attitude")
    velocity = next(r for r in rows if r.channel.quantity == "velocity")
    depth = next((r for r in rows if r.channel.quantity == "depth"), None)
    guess[:, 9] = 1000.0  # deep, where no depth is known
    for s, begin in enumerate(begins):
        time, q = _first(attitude, s, begin, 3.0)
        reference[s] = q[0]
        turn = logarithm(product(conjugate(np.broadcast_to(q[0], q.shape)), q))
        for axis in range(3):
            guess[s, 6 + axis], guess[s, 3 + axis] = _line(time, turn[:, axis])
        pick = np.flatnonzero(velocity.stretch == s)[:10]
        rotation = np.broadcast_to(matrix_from_quaternion(q[0]), (len(pick), 3, 3))
        if len(pick):
            arm = np.cross(guess[s, 3:6], velocity.channel.lever_arm_b)
            guess[s, :3] = np.mean(velocity.channel.velocity_b(velocity.index[pick], rotation), axis=0) - arm
        if depth is not None:
            guess[s, 9] = _line(*_first(depth, s, begin, 3.0))[0]
    return reference, guess


def _first(rows: Rows, stretch: int, begin: float, span: float) -> tuple[Array, Array]:
    """Return times from the beginning of a stretch and values of its first seconds, at least two rows."""
    pick = np.flatnonzero(rows.stretch == stretch)
    time = rows.channel.time[rows.index[pick]] - begin
    count = max(int(np.searchsorted(time, span)), 2)
    return time[:count], rows.channel.value[rows.index[pick[:count]]].squeeze()


def _line(time: Array, value: Array) -> tuple[float, float]:
    """Return value at time 0 and slope of the straight line through values."""
    if len(time) < 3:
        return float(np.mean(value)), 0.0
    slope, level = np.polyfit(time, value, 1)
    return float(level), float(slope)
