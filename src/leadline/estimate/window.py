"""The events of a live navigator's window, in order, in arrays that the loop consumes as they lie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.estimate import plan as at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.data.records import Array
    from leadline.estimate.events import Event, Integers

UNNAMED = -1  # number of the sensor of an event that is none's
COLUMNS = ("time", "rank", "kind", "length", "source", "row", "outcome", "result", "rows")


class Window:
    """Events with the results of those that are measurements; the arrays hold `count` of them and grow by doubling.

    `sensors` gives the names that `source` counts; `width` is the longest row.
    """

    def __init__(self, sensors: Sequence[str], width: int, capacity: int = 1024) -> None:
        """Start empty."""
        self.sensors, self.width, self.count = tuple(sensors), width, 0
        self._numbers = {name: i for i, name in enumerate(self.sensors)} | {"": UNNAMED}
        self.time = np.zeros(capacity)
        self.rank, self.kind, self.length, self.source, self.row, self.outcome = (np.zeros(capacity, np.int64) for _ in range(6))
        self.result, self.rows = np.full((capacity, at.RESULT_SIZE), np.nan), np.zeros((capacity, width))
        self._lay()

    def _lay(self) -> None:
        """Where rows lie in the flat data; the index of an event is its place, but for outputs: their number."""
        capacity = len(self.time)
        self.start = np.arange(capacity) * self.width
        self.stop = self.start + self.length
        self.index = np.where(self.kind == at.IS_OUTPUT, self.row, np.arange(capacity))

    @property
    def data(self) -> Array:
        """All rows, flat."""
        return self.rows.reshape(-1)

    def __len__(self) -> int:
        """Return the number of events."""
        return self.count

    def place(self, event: Event) -> int:
        """Return where an event belongs: before the first that is not less than it."""
        time = self.time[: self.count]
        first = int(np.searchsorted(time, event.time, side="left"))
        while first < self.count and time[first] == event.time and self._less(first, event):
            first += 1
        return first

    def _less(self, i: int, event: Event) -> bool:
        head = (int(self.rank[i]), int(self.kind[i]))
        if head != (event.rank, event.kind):
            return head < (event.rank, event.kind)
        own = tuple(self.rows[i, : self.length[i]].tolist())
        if own != event.data:
            return own < event.data
        return (self.name(i), int(self.row[i])) < (event.sensor, event.row)

    def name(self, i: int) -> str:
        """Return the sensor of an event."""
        return self.sensors[self.source[i]] if self.source[i] >= 0 else ""

    def whole(self, last: int, most: int) -> int:
        """Return a place from `last` on, up to `most`, that does not part the events of one row."""
        while last < most and self.source[last] >= 0 and (self.source[last], self.row[last]) == (self.source[last - 1], self.row[last - 1]):
            last += 1
        return last

    def insert(self, event: Event) -> int:
        """Put an event in its place, and return that."""
        if self.count == len(self.time):
            self._grow()
        place, end = self.place(event), self.count
        if place < end:
            for column in COLUMNS:
                values = getattr(self, column)
                values[place + 1 : end + 1] = values[place:end].copy()
        size = len(event.data)
        self.time[place], self.rank[place], self.kind[place], self.length[place] = event.time, event.rank, event.kind, size
        self.source[place], self.row[place], self.outcome[place] = self._numbers[event.sensor], event.row, -1
        self.rows[place, :size], self.result[place] = event.data, np.nan
        self.count = end + 1
        self._relay(place)
        return place

    def _relay(self, place: int) -> None:
        part = slice(place, self.count)
        self.stop[part] = self.start[part] + self.length[part]
        self.index[part] = np.where(self.kind[part] == at.IS_OUTPUT, self.row[part], np.arange(place, self.count))

    def _grow(self) -> None:
        for column in COLUMNS:
            values = getattr(self, column)
            setattr(self, column, np.concatenate([values, np.zeros_like(values)]))
        self._lay()

    def delete(self, places: Integers) -> None:
        """Take events out."""
        kept = np.setdiff1d(np.arange(self.count), places)
        for column in COLUMNS:
            values = getattr(self, column)
            values[: len(kept)] = values[kept]
        self.count = len(kept)
        self._relay(0)

    def forget(self, cut: int) -> None:
        """Take the first `cut` events out."""
        for column in COLUMNS:
            values = getattr(self, column)
            values[: self.count - cut] = values[cut : self.count].copy()
        self.count -= cut
        self._relay(0)

    def columns(self) -> dict[str, Array | Integers]:
        """Return all that is known of the events, by name, for a snapshot."""
        return {column: getattr(self, column)[: self.count].copy() for column in COLUMNS}

    def restore(self, columns: dict[str, Array | Integers]) -> None:
        """Take over what `columns` gave."""
        self.count = len(columns["time"])
        while self.count > len(self.time):
            self._grow()
        for column, values in columns.items():
            getattr(self, column)[: self.count] = values
        self._lay()
