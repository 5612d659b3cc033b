"""The way of a vehicle, as other programs take it: the states of a solution that are numbers, thinned, with their times in UTC."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError
from leadline.data.solution import Status

if TYPE_CHECKING:
    import numpy.typing as npt

    from leadline.data.records import Array, Text
    from leadline.data.solution import Solution

WORDS = np.array([status.name.lower() for status in Status])


@dataclass(frozen=True)
class Track:
    """States (n,) in order of time, none of them lost; `piece` (n,) counts up where lost states were left out between two rows."""

    states: Solution
    piece: npt.NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.states)

    @property
    def name(self) -> str:
        """The name of the log."""
        return str(self.states.summary.get("log") or "leadline")

    @property
    def degrees(self) -> tuple[Array, Array]:
        """Latitude and longitude (n,) in degrees."""
        return np.degrees(self.states.latitude), np.degrees(self.states.longitude)

    @property
    def status(self) -> Text:
        """The status of each state, as a word (n,)."""
        return WORDS[self.states.status]

    @property
    def utc(self) -> Text:
        """The time of each state in UTC to the millisecond, as text (n,)."""
        moments = np.datetime64(self.states.epoch.astimezone(UTC).replace(tzinfo=None), "us")
        whole = moments + np.round(1e6 * self.states.time).astype("timedelta64[us]")
        rounded = (whole + np.timedelta64(500, "us")).astype("datetime64[ms]")
        return np.char.add(np.datetime_as_string(rounded, unit="ms"), "Z")

    @property
    def sigma_horizontal(self) -> Array:
        """The larger semi-axis (n,) of the horizontal error ellipse at one sigma, m."""
        block = self.states.covariance[:, :2, :2]
        half, difference = 0.5 * (block[:, 0, 0] + block[:, 1, 1]), 0.5 * (block[:, 0, 0] - block[:, 1, 1])
        return np.asarray(np.sqrt(np.maximum(half + np.hypot(difference, block[:, 0, 1]), 0.0)))

    def runs(self, *values: npt.NDArray[np.generic]) -> list[tuple[int, int]]:
        """Return first row and end of each stretch of one piece in which the values (n,) stay the same."""
        changed = np.diff(self.piece) != 0
        for value in values:
            changed = changed | (value[1:] != value[:-1])
        edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(self)]
        return list(pairwise(edges))


def track_of(solution: Solution, every: float = 0.0) -> Track:
    """Return the states of a solution that are not lost and whose position, velocity and attitude are numbers.

    With `every` (s) one state in each such interval; the ends of each piece and each change of status stay.
    Raises InputError where `every` is no time, or where no state is left.
    """
    if not 0.0 <= every < np.inf:
        raise InputError("--every", f"{every} s", "give a time of zero or more")
    s = solution
    plain = np.stack([s.time, s.latitude, s.longitude, s.height, s.depth, s.north, s.east], axis=1)
    good = np.isfinite(np.concatenate([plain, s.velocity_n, s.quaternion_nb], axis=1)).all(axis=1) & (s.status != Status.LOST)
    kept = np.flatnonzero(good)
    if not len(kept):
        raise InputError("solution", f"none of its {len(s)} states has a position that is a number", "solve the log again")
    piece = np.cumsum(np.diff(kept, prepend=kept[0]) > 1, dtype=np.int64)
    if every > 0.0:
        thin = _thinned(s.time[kept], every, piece, s.status[kept])
        kept, piece = kept[thin], piece[thin]
    return Track(s.select(kept), piece)


def _thinned(time: Array, every: float, piece: npt.NDArray[np.int64], status: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Tell which rows stay."""
    new = np.ones(len(time), bool)
    slot = np.floor((time - time[0]) / every + 1e-6)
    apart = piece[1:] != piece[:-1]
    new[1:] = (slot[1:] != slot[:-1]) | apart | (status[1:] != status[:-1])
    new[-1] = True
    new[:-1] |= apart
    return new
