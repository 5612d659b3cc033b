"""Clocks that step: the times of arrival show a step, and the stamps after it are put right.

A row is received a delay after its stamp.  Where the delay of a regular and prompt sensor leaps from one row to the next, and its stamps
show the leap while its arrivals do not, its clock was set, and not the row held up.  The row is set aside, as are those after it, until
so many agree that the step is certain; what follows is stamped anew by the size of the step.  Where the new stamps are as near to the
arrivals as the old ones ever were, the clock was set right, and they are taken as they are.  Nothing looks ahead, so live and offline
agree.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from leadline.data.records import Array, Table

LEAST_STEP = 0.25  # s; a smaller step of a clock is told by nobody
SPREADS = 2.0  # and in units of the range of the delays before and after it
BEFORE, AFTER = 8, 4  # rows before and after a step whose delays are compared
PROMPT = 1.0  # s; of a sensor whose rows take longer, delays say nothing of its clock
EXACT = 1e-3  # s


class Step(NamedTuple):
    """A clock that was set: when (s, of arrival), and by how much (s, positive: ahead)."""

    arrival: float
    size: float


@dataclass
class Clock:
    """The clock of one sensor's stamps.  It remembers, so that one row at a time gives the same as a whole table.

    mend: put stamps right, or only note the steps.  offset: how far ahead (s) the stamps are by now.  known: stamp and arrival of the
    last rows that were believed, as they came; doubted: of those since a leap, that are set aside until it is certain.  least, most:
    the delays (s) that mended stamps had since it changed: what lies between them is nothing new.
    """

    mend: bool = True
    offset: float = 0.0
    known: list[tuple[float, float]] = field(default_factory=list)
    doubted: list[tuple[float, float]] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    least: float = np.inf
    most: float = -np.inf

    def take(self, table: Table) -> tuple[Table, npt.NDArray[np.bool_]]:
        """Return the table with its stamps put right, and which rows (n,) are set aside: their stamps are nan.

        Rows are taken in the order of their arrival; without times of arrival nothing is changed.
        """
        aside = np.zeros(len(table), bool)
        if table.received is None or not len(table):
            return table, aside
        shift = np.zeros(len(table))
        arrival = np.where(np.isfinite(table.received), table.received, table.time)
        told = np.flatnonzero(np.isfinite(table.time))
        order = told[np.argsort(arrival[told], kind="stable")]
        stamps, received = table.time[order], table.received[order]
        silent = ~np.isfinite(received)  # when those came is not known: they are stamped as the others are by then
        delay = received - stamps
        special = np.append(np.flatnonzero(self._leaping(delay) | silent), len(order))
        k = 0
        while k < len(order):
            last = int(special[np.searchsorted(special, k)])
            if not self.doubted and len(self.known) == BEFORE and last > k:
                recent = slice(max(k, last - BEFORE), last)
                self._believe(list(zip(stamps[recent].tolist(), received[recent].tolist(), strict=True)), delay[k:last])
                shift[order[k:last]] = self.offset
                k = last
                continue
            if not silent[k]:
                aside[order[k]] = self._doubts((float(stamps[k]), float(received[k])))
            shift[order[k]] = self.offset
            k += 1
        if not self.mend:
            return table, np.zeros(len(table), bool)
        if not (aside.any() or shift.any()):
            return table, aside
        return replace(table, time=np.where(aside, np.nan, table.time - shift)), aside

    def _leaping(self, delay: Array) -> npt.NDArray[np.bool_]:
        """Which rows have a delay that differs from that of the row before: a step can begin with no other."""
        known = np.isfinite(delay)
        before = self.known[-1][1] - self.known[-1][0] if self.known else np.nan
        leaping = np.zeros(len(delay), bool)
        leaping[known] = np.abs(np.diff(delay[known], prepend=before)) > 0.5 * LEAST_STEP
        return leaping

    def _believe(self, rows: list[tuple[float, float]], delay: Array | None = None) -> None:
        """Take rows for right; `delay`: those of all of them, where `rows` are the last alone."""
        self.known = [*self.known, *rows][-BEFORE:]
        if len(self.known) >= self._enough:  # what comes first may be anything
            self._widen(np.array([received - stamp for stamp, received in rows]) if delay is None else delay)

    def _widen(self, delay: Array) -> None:
        self.least = min(self.least, float(np.min(delay)) + self.offset)
        self.most = max(self.most, float(np.max(delay)) + self.offset)

    @property
    def _enough(self) -> int:
        """How many rows must be known before a step can be told."""
        return AFTER if self.steps else BEFORE

    def _doubts(self, row: tuple[float, float]) -> bool:
        """Take in one row, and tell whether it is to be set aside."""
        if not self.doubted:
            if not self._begins(row):
                self._believe([row])
                return False
            self.doubted = [row]
            return True
        if abs(self._leap([row])) < self._least(self.known):  # back to what it was: one wild stamp
            self.doubted = []
            self._believe([row])
            return False
        self.doubted.append(row)
        if len(self.doubted) < AFTER:
            return True
        leap = self._leap(self.doubted)
        certain = abs(leap) > max(self._least(self.known), self._least(self.doubted))
        if certain:
            self._step(leap)
        self._widen(np.array([received - stamp for stamp, received in self.doubted]))
        self.known, self.doubted = self.doubted, []
        return certain  # where it is not, delays merely vary

    def _begins(self, row: tuple[float, float]) -> bool:
        """Tell whether a step may begin with a row: stamps leap from the row before to this one, and arrivals do not."""
        if len(self.known) < self._enough:
            return False
        (stamp, received), (last_stamp, last_received) = row, self.known[-1]
        leap, mended = abs(self._leap([row])), received - stamp + self.offset
        ordinary = self.least - EXACT <= mended <= self.most + EXACT
        if leap <= self._least(self.known) or ordinary or stamp == last_stamp or abs(_delay(self.known) + self.offset) > PROMPT:
            return False
        if self.offset and self._right([row]):
            return True  # whatever its arrivals: a clock may come right in a silence
        stamps, arrivals = (median(b[i] - a[i] for a, b in zip(self.known[:-1], self.known[1:], strict=True)) for i in (0, 1))
        if abs(stamps - arrivals) > 0.5 * abs(stamps):  # rows come as a packet, or stand still
            return False
        return abs(stamp - last_stamp - stamps) > 0.5 * leap and abs(received - last_received - arrivals) < 0.5 * leap

    def _right(self, rows: list[tuple[float, float]]) -> bool:
        """Tell whether stamps as they came are as near to their arrivals, and as little ahead of them, as mended ones were before."""
        before, now = _delay(self.known) + self.offset, _delay(rows)
        slack = max(EXACT, _range(self.known), _range(rows))
        return min(0.0, before) - slack <= now and abs(now) <= abs(before) + slack

    def _leap(self, rows: list[tuple[float, float]]) -> float:
        """How far (s) stamps of rows are ahead of those that are known."""
        return _delay(self.known) - _delay(rows)

    @staticmethod
    def _least(rows: list[tuple[float, float]]) -> float:
        """The least leap (s) that stands out from the delays of rows."""
        return max(LEAST_STEP, SPREADS * _range(rows))

    def _step(self, leap: float) -> None:
        """Note a step; from a clock that was set right nothing is to be taken off."""
        self.steps.append(Step(self.doubted[0][1], leap))
        offset = 0.0 if self._right(self.doubted) else self.offset + leap
        if offset != self.offset:
            self.offset, self.least, self.most = offset, np.inf, -np.inf


def _delay(rows: list[tuple[float, float]]) -> float:
    """The usual delay (s) of rows."""
    return median(received - stamp for stamp, received in rows)


def _range(rows: list[tuple[float, float]]) -> float:
    """How far (s) the delays of rows differ."""
    delays = [received - stamp for stamp, received in rows]
    return max(delays) - min(delays)
