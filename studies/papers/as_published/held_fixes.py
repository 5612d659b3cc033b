"""Fixes as Wang and Pang (2014) hand them to the filter: the last one is kept, and shown as new at the rate of the filter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from common import Fixes

if TYPE_CHECKING:
    from numpy.random import Generator

    from leadline.data.log import Log
    from leadline.data.records import PositionFix


def held(table: PositionFix, rate: float, end: float) -> PositionFix:
    """Return a table in which each fix stands again at each multiple of 1 / rate (s) until the next comes, as if it were new."""
    time = np.arange(np.ceil(table.time[0] * rate), np.floor(end * rate + 1e-6) + 1) / rate
    source = table.select(np.searchsorted(table.time, time, side="right") - 1)
    again: dict[str, Any] = {"time": time, "received": None}
    return replace(source, **again)


def transformed(log: Log, sensor: str = "sbl", rate: float = 10.0) -> Log:
    """Return a log, recorded or simulated, with the fixes of a sensor held."""
    end = max(float(table.time[-1]) for table in log.tables.values() if len(table))
    return replace(log, tables={**log.tables, sensor: held(log.tables[sensor], rate, end)})


@dataclass(frozen=True, kw_only=True)
class HeldFixes(Fixes):
    """A short baseline whose recorder does so."""

    shown_at: float = 10.0  # Hz
    end: float = 60.0

    def noisy(self, table: PositionFix, generator: Generator) -> PositionFix:
        """Return the fixes with noise, held; none says its sigma, so that the vehicle file says how far they are trusted."""
        silent: dict[str, Any] = {"sigma_axes": None}
        return held(replace(super().noisy(table, generator), **silent), self.shown_at, self.end)
