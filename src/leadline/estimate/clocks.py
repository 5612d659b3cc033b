"""Clocks that step: the times of arrival show a step, and the stamps after it are put right.

A row is received a delay after its stamp.  Where the delay of a regular sensor leaps from one row to the next, and its stamps show the
leap while its arrivals do not, its clock was set, and not the row held up.  The row is set aside, as are those after it, until so many
agree that the step is certain; what follows is stamped anew by the size of the step.  Nothing looks ahead, so live and offline agree.
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


class Step(NamedTuple):
    """A clock that was set: when (s, of arrival), and by how much (s, positive: ahead)."""

    arrival: float
    size: float


@dataclass
class Clock:
    """The clock of one sensor's stamps.  It remembers, so that one row at a time gives the same as a whole table.

    mend: put stamps right, or only note the steps.  offset: how far ahead (s) the stamps are by now.  known: stamp and arrival of the
    last rows that were believed, as they came; doubted: of those since a leap, that are set aside until it is certain.
    """

    mend: bool = True
    offset: float = 0.0
    known: list[tuple[float, float]] = field(default_factory=list)
    doubted: list[tuple[float, float]] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)

    def take(self, table: Table) -> tuple[Table, npt.NDArray[np.bool_]]:
        """Return the table with its stamps put right, and which rows (n,) are set aside: their stamps are nan.

        Rows are taken in the order of their arrival; without times of arrival nothing is changed.
        """
        aside = np.zeros(len(table), bool)
        if table.received is None or not len(table):
            return table, aside
        shift = np.full(len(table), self.offset)
        good = np.flatnonzero(np.isfinite(table.time) & np.isfinite(table.received))
        order = good[np.argsort(table.received[good], kind="stable")]
        stamps, received = table.time[order], table.received[order]
        leaping = np.append(np.flatnonzero(self._leaping(received - stamps)), len(order))
        k = 0
        while k < len(order):
            last = int(leaping[np.searchsorted(leaping, k)])
            if not self.doubted and len(self.known) == BEFORE and last > k:
                recent = slice(max(k, last - BEFORE), last)
                self._believe(list(zip(stamps[recent].tolist(), received[recent].tolist(), strict=True)))
                shift[order[k:last]] = self.offset
                k = last
                continue
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
        before = self.known[-1][1] - self.known[-1][0] if self.known else np.nan
        return np.asarray(np.abs(np.diff(delay, prepend=before)) > 0.5 * LEAST_STEP)

    def _believe(self, rows: list[tuple[float, float]]) -> None:
        self.known = [*self.known, *rows][-BEFORE:]

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
        self.known, self.doubted = self.doubted, []
        return certain  # where it is not, delays merely vary

    def _begins(self, row: tuple[float, float]) -> bool:
        """Tell whether a step may begin with a row: stamps leap from the row before to this one, and arrivals do not."""
        if len(self.known) < BEFORE:
            return False
        leap, (stamp, received) = abs(self._leap([row])), self.known[-1]
        usual = median(b[1] - a[1] for a, b in zip(self.known[:-1], self.known[1:], strict=True))
        stamps, arrivals = row[0] - stamp - usual, row[1] - received - usual
        return leap > self._least(self.known) and abs(stamps) > 0.5 * leap and abs(arrivals) < 0.5 * leap

    def _leap(self, rows: list[tuple[float, float]]) -> float:
        """How far (s) stamps of rows are ahead of those that are known."""
        return _delay(self.known) - _delay(rows)

    @staticmethod
    def _least(rows: list[tuple[float, float]]) -> float:
        """The least leap (s) that stands out from the delays of rows."""
        return max(LEAST_STEP, SPREADS * _range(rows))

    def _step(self, leap: float) -> None:
        """Note a step; a clock that was set back to where it had been, as far as delays can tell, is right again."""
        self.steps.append(Step(self.doubted[0][1], leap))
        offset = self.offset + leap
        self.offset = 0.0 if abs(offset) < max(1e-3, _range(self.known), _range(self.doubted)) else offset


def _delay(rows: list[tuple[float, float]]) -> float:
    """The usual delay (s) of rows."""
    return median(received - stamp for stamp, received in rows)


def _range(rows: list[tuple[float, float]]) -> float:
    """How far (s) the delays of rows differ."""
    delays = [received - stamp for stamp, received in rows]
    return max(delays) - min(delays)
