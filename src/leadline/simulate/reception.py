"""How a satellite receiver finds its satellites again after it has been under water, and loses them under the spray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leadline.data.errors import InputError

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.records import Array, Text
    from leadline.simulate.instrument import Flags

ORDER = ("none", "single", "dgps", "float", "fixed")
SPREAD = 1.5  # satellites, of the number in use from row to row
GAP = 2.5  # looks without a row that are a dive: jitter makes no gap of that length
BEST = 3.0  # horizontal dilution of precision times the root of the number of satellites: 0.95 with ten


class Fixes(NamedTuple):
    """What kind of fix each row is (rows,), how many satellites it uses, and their horizontal dilution of precision (nan: no fix)."""

    fix_type: Text
    satellites: Array
    hdop: Array


@dataclass(frozen=True, kw_only=True)
class Reception:
    """From surfacing to a fix, and from one kind of fix to a better.

    After each surfacing the first fix takes `least` + an exponential delay of mean `cold` - `least` (s) (cold start: at least `least`,
    `cold` in the mean); after less than `hot_for` (s) under water `hot_least` and `hot` hold instead.  A receiver that is dry when the log
    begins has had its best fix for long.  `stages` are kinds of fix and the times (s) since the first fix from which on they hold, in
    ascending order, the first from 0.  A row is of the first kind again by chance with `lapse`, and washed over, no fix, with `wash`.
    The number of satellites scatters about `satellites` (at least 4); the dilution of precision is 3 / sqrt(number).
    """

    cold: float = 0.0
    least: float = 0.0
    hot: float = 0.0
    hot_least: float = 0.0
    hot_for: float = 0.0
    stages: tuple[tuple[str, float], ...] = (("single", 0.0),)
    lapse: float = 0.0
    wash: float = 0.0
    satellites: float = 10.0

    def __post_init__(self) -> None:
        """Refuse stages that do not follow each other."""
        kinds, times = [kind for kind, _ in self.stages], [time for _, time in self.stages]
        if not times or times[0] != 0.0 or times != sorted(times) or not set(kinds) <= set(ORDER[1:]):
            right = f"kinds of {', '.join(ORDER[1:])} by ascending times, the first at 0 s"
            raise InputError("Gnss", "has the stages " + ", ".join(f"{kind} at {at:g} s" for kind, at in self.stages), right)
        if self.cold < self.least or self.hot < self.hot_least:
            found = f"takes {self.cold:g} s (hot: {self.hot:g} s) to a fix and {self.least:g} s ({self.hot_least:g} s) at least"
            raise InputError("Gnss", found, "means that are not below the least")

    def fixes(self, time: Array, begin: float, interval: float, generator: Generator) -> Fixes:
        """Return what each row is, at the times (s) of an antenna that is dry; it looks every `interval` (s) from `begin` on."""
        waiting, chance = generator.spawn(2)
        kinds = np.array(["none", *(kind for kind, _ in self.stages)])
        since = self.since_fix(time, begin, interval, waiting)
        stage = np.searchsorted([after for _, after in self.stages], since, side="right")
        lapsed, washed = chance.random((2, len(time)))
        stage = np.where(lapsed < self.lapse, np.minimum(stage, 1), stage)
        stage = np.where(washed < self.wash, 0, stage)
        count = np.maximum(np.round(self.satellites + SPREAD * chance.standard_normal(len(time))), 4.0)
        return Fixes(kinds[stage], np.where(stage > 0, count, 0.0), np.where(stage > 0, BEST / np.sqrt(count), np.nan))

    def since_fix(self, time: Array, begin: float, interval: float, generator: Generator) -> Array:
        """Return how long ago (s) the receiver got its first fix since it surfaced; negative: it has none yet."""
        under = np.diff(time, prepend=begin)
        rises = np.flatnonzero(under > GAP * interval)
        if not len(rises):
            return np.full(len(time), np.inf)
        hot = under[rises] < self.hot_for
        hot[rises == 0] = False  # how long it had been under water before, nobody knows
        delay = self.delay(hot, generator)
        which = np.searchsorted(rises, np.arange(len(time)), side="right") - 1
        return np.where(which < 0, np.inf, time - (time[rises] + delay)[which])

    def delay(self, hot: Flags, generator: Generator) -> Array:
        """Return the time (s) from surfacings to their first fixes: `hot` (surfacings,) after short dives."""
        least = np.where(hot, self.hot_least, self.least)
        return np.asarray(least + (np.where(hot, self.hot, self.cold) - least) * generator.standard_exponential(len(hot)))
