"""The inputs of the process model: rows of an inertial unit, and of the unit that stands in for it while it is silent.

Inputs come from the first unit as long as its rows follow each other within its gap.  A longer silence is filled by the second unit's
inputs, from the moment at which the first one's end to the moment at which they begin again; without a second unit it is a gap.  The
rule asks for nothing but times, so live and offline give the same inputs.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.data.outcome import Outcome
from leadline.data.records import after
from leadline.models.imu import INPUT_SIZE, TIME_M, InputStream
from leadline.models.inertial import DEVICE_U, PRESENT_U

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array, Imu
    from leadline.data.vehicle import SensorConfig

FIRST, SECOND = 0, 1
BLOCK = 60_000  # rows


class Pushed(NamedTuple):
    """What rows gave: start times (k,), inputs (k, INPUT_SIZE), the outcome of each row, and from when on earlier inputs are withdrawn."""

    time: Array
    data: Array
    outcome: npt.NDArray[np.int64]
    withdrawn: float = np.inf


@dataclass(frozen=True)
class Span:
    """A stretch without the first unit: filled by the second (`standby`), or not (`gap`)."""

    kind: str
    sensor: str
    start: float
    end: float


@dataclass
class Inputs:
    """Turns rows of one or two inertial units into inputs, in order of time; it remembers, so that one row at a time gives the same."""

    first: InputStream
    second: InputStream | None = None
    time: Array = field(default_factory=lambda: np.zeros(0))  # of the second unit's inputs that may still be wanted
    data: Array = field(default_factory=lambda: np.zeros((0, INPUT_SIZE)))
    handed: float = -np.inf  # the last of the second unit's inputs that was handed out in this silence
    begun: float = -np.inf  # when the second unit's first input began
    waiting: Imu | None = None  # a row beyond a gap that no other has confirmed yet

    @classmethod
    def of(cls, imu: SensorConfig, standby: SensorConfig | None) -> Inputs:
        """Return the inputs of configured units."""
        first = InputStream.of(imu)
        return cls(first, None if standby is None else InputStream.of(standby, standby.lever_arm_b - imu.lever_arm_b))

    @property
    def names(self) -> tuple[str, ...]:
        """The sensors whose rows are inputs."""
        return (self.first.name,) if self.second is None else (self.first.name, self.second.name)

    def is_mine(self, name: str) -> bool:
        """Tell whether rows of a sensor are inputs."""
        return name in self.names

    @property
    def covered(self) -> float:
        """The time up to which inputs are known."""
        return self.second.covered if self.second is not None and self.silent else self.first.covered

    @property
    def silent(self) -> bool:
        """Whether the first unit has been silent for longer than its gap, or for so long from the start, as the second one tells."""
        if self.second is None:
            return False
        since = self.first.covered if np.isfinite(self.first.covered) else self.begun
        return self.second.covered > since + self.first.gap

    def push(self, name: str, table: Imu) -> Pushed:
        """Take in rows of one of the units, in order of time.

        A row of the first unit that comes after a gap is held back until another follows it: one wrong stamp far ahead must not condemn
        all that comes after.
        """
        if name != self.first.name:
            return self._push_second(table)
        count = len(table)
        if self.waiting is not None:
            table, self.waiting = self._confirmed(self.waiting, table), None
        time = table.time - self.first.latency
        newest = float(np.max(time[:-1], initial=self.first.covered, where=np.isfinite(time[:-1])))
        if len(table) and np.isfinite(newest) and time[-1] > newest + self.first.gap:
            self.waiting = table.select(slice(-1, None))  # type: ignore[assignment]
            pushed = self._push_first(table.select(slice(0, -1)))  # type: ignore[arg-type]
            pushed = pushed._replace(outcome=np.append(pushed.outcome, int(Outcome.USED)))
        else:
            pushed = self._push_first(table)
        return pushed._replace(outcome=pushed.outcome[len(pushed.outcome) - count :])

    def _confirmed(self, waiting: Imu, table: Imu) -> Imu:
        """New rows, behind the one that waited where they confirm it."""
        near = np.isfinite(table.time) & (table.time > waiting.time[0]) & (table.time <= waiting.time[0] + self.first.gap)
        return after(waiting, table) if near.any() else table  # type: ignore[return-value]

    def _push_first(self, table: Imu) -> Pushed:
        before = self.first.covered
        time, data, outcome = self.first.push(table)
        if self.second is None or not len(time):
            return Pushed(time, data, outcome)
        pieces, last, withdrawn = [], 0, np.inf
        handed = self.handed
        if not np.isfinite(before):  # its first rows: before them the second unit's inputs act
            if np.isfinite(self.begun) and time[0] > self.begun + self.first.gap:
                pieces.append(self._missing(self.begun, float(time[0]), handed))
            withdrawn = float(time[0]) if handed >= time[0] else np.inf
        elif np.isfinite(handed):  # a silence, or rows that were only late in arriving
            silence = data[0, PRESENT_U] == 0.0
            begins = float(time[1]) if silence else before
            withdrawn = begins if handed >= begins or not silence else np.inf
        for i in np.flatnonzero(data[:, PRESENT_U] == 0.0).tolist():
            pieces.append((time[last:i], data[last:i]))
            pieces.append(self._missing(float(time[i]), float(time[i + 1]), handed))
            last = i + 1
        pieces.append((time[last:], data[last:]))
        self.handed = -np.inf
        self._trim(self.first.covered)
        return Pushed(np.concatenate([t for t, _ in pieces]), np.concatenate([d for _, d in pieces]), outcome, withdrawn)

    def _missing(self, start: float, end: float, handed: float) -> tuple[Array, Array]:
        """What of the second unit's inputs from `start` to `end` is not in the stream yet."""
        time, data = self.fill(max(start, handed), end) if handed < end else (np.zeros(0), np.zeros((0, INPUT_SIZE)))
        fresh = time > handed
        return time[fresh], data[fresh]

    def _trim(self, moment: float) -> None:
        kept = max(0, int(np.searchsorted(self.time, moment - 1.0)) - 1)
        self.time, self.data = self.time[kept:], self.data[kept:]

    def _push_second(self, table: Imu) -> Pushed:
        assert self.second is not None
        time, data, outcome = self.second.push(table)
        data[:, DEVICE_U] = SECOND
        self.time, self.data = np.concatenate([self.time, time]), np.concatenate([self.data, data])
        if np.isinf(self.begun) and len(self.time):
            self.begun = float(self.time[0])
        if not self.silent:
            outcome[outcome == Outcome.USED] = Outcome.STANDBY
            return Pushed(np.zeros(0), np.zeros((0, INPUT_SIZE)), outcome)
        start = self.first.covered if np.isfinite(self.first.covered) else self.begun
        fresh, rows = self._missing(start, self.second.covered, self.handed)
        self.handed = float(fresh[-1]) if len(fresh) else self.handed
        self._trim(self.handed)
        return Pushed(fresh, rows, outcome)

    def stand_by(self, table: Imu) -> npt.NDArray[np.int64]:
        """Take in all rows of the second unit, in order of time, before those of the first; returns their outcomes."""
        assert self.second is not None
        self.time, self.data, outcome = self.second.push(table)
        self.data[:, DEVICE_U] = SECOND
        self.begun = float(self.time[0]) if len(self.time) else -np.inf
        return outcome

    def fill(self, start: float, end: float) -> tuple[Array, Array]:
        """Return the second unit's inputs that act from `start` to `end`, with an absence where it is silent as well."""
        assert self.second is not None
        first, last = np.searchsorted(self.time, start, side="right"), np.searchsorted(self.time, end, side="left")
        time, data = self.time[first:last], self.data[first:last]
        absent = np.zeros((1, INPUT_SIZE))
        head = self.data[first - 1 : first] if first > 0 and self.second.covered > start else absent
        time, data = np.concatenate([[start], time]), np.concatenate([head, data])
        if start < self.second.covered < end:
            time, data = np.concatenate([time, [self.second.covered]]), np.concatenate([data, absent])
        return time, data


def spans_of(time: Array, data: Array, covered: float, units: tuple[str, str | None]) -> tuple[Span, ...]:
    """Return the stretches without the first unit, of inputs (k, INPUT_SIZE) at ascending times (k,) that reach up to `covered`."""
    kind = np.where(data[:, PRESENT_U] == 0.0, 2, np.where(data[:, DEVICE_U] == SECOND, 1, 0))
    edges = np.flatnonzero(np.diff(kind, prepend=-1))  # where runs begin
    bounds = np.concatenate([time, [covered]])
    found = []
    for a, b in zip(edges, [*edges[1:], len(time)], strict=True):
        if kind[a]:
            sensor = units[1] if kind[a] == 1 else units[0]
            found.append(Span("standby" if kind[a] == 1 else "gap", sensor or units[0], float(bounds[a]), float(bounds[b])))
    return tuple(found)


@dataclass(frozen=True)
class Made:
    """Inputs that stand in memory: start times (k,), ascending, and inputs (k, INPUT_SIZE)."""

    time: Array
    data: Array

    def between(self, first: float, last: float) -> tuple[Array, Array]:
        """Return the inputs that begin at first <= time < last."""
        a, b = np.searchsorted(self.time, [first, last], side="left")
        return self.time[a:b], self.data[a:b]


class Conditioned:
    """The inputs of one unit, made of its rows whenever they are asked for: a day of them is larger than the rows.

    Before every `BLOCK` rows stands what the stream remembers there, so that any stretch can be made by itself, with the same bits.
    """

    def __init__(self, stream: InputStream, table: Imu) -> None:
        """Go through a table in order of time once, for the outcomes (n,) of its rows, and the stretches without input."""
        self.stream, self.table = stream, table
        self.memories: list[Array] = []
        self.gaps: list[tuple[float, float]] = []
        outcomes = []
        for block in range(0, len(table), BLOCK):
            self.memories.append(stream.memory.copy())
            time, data, outcome = stream.push(table.select(slice(block, block + BLOCK)))  # type: ignore[arg-type]
            outcomes.append(outcome)
            absent = np.flatnonzero(data[:, PRESENT_U] == 0.0).tolist()
            self.gaps += [(float(time[i]), float(time[i + 1])) for i in absent]
        self.outcome = np.concatenate(outcomes)
        self.covered = stream.covered
        self._kept: tuple[int, Array, Array] | None = None

    def between(self, first: float, last: float) -> tuple[Array, Array]:
        """Return the inputs that begin at first <= time < last."""
        starts = np.array([m[TIME_M] for m in self.memories])  # a block's inputs begin at or after this
        a = max(0, int(np.searchsorted(starts, first, side="right")) - 1)
        b = max(a + 1, int(np.searchsorted(starts, last, side="left")))
        made = []
        for time, data in (self._block(k) for k in range(a, min(b, len(starts)))):
            i, j = np.searchsorted(time, [first, last], side="left")
            made.append((time[i:j], data[i:j]))
        return np.concatenate([t for t, _ in made]), np.concatenate([d for _, d in made])

    def _block(self, k: int) -> tuple[Array, Array]:
        if self._kept is not None and self._kept[0] == k:
            return self._kept[1:]
        self.stream.memory = self.memories[k].copy()
        time, data, _ = self.stream.push(self.table.select(slice(k * BLOCK, (k + 1) * BLOCK)))  # type: ignore[arg-type]
        self._kept = (k, time, data)
        return time, data
