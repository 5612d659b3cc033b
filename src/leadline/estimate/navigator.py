"""Navigator: one composition and one state; the same object consumes a whole log or one row at a time, with the same bits.

Live, events are kept in order of time for a window.  What arrives late is put in its place, and the stream is replayed from the
checkpoint before it.  A measurement waits for the input that covers it, one sample at most.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.data.outcome import Outcome
from leadline.data.records import KINDS, Imu, Table
from leadline.estimate import loop
from leadline.estimate import plan as at
from leadline.estimate.composition import Composition, Workspace, output_size
from leadline.estimate.events import RANK, Batch, Event, Events, Integers, Screen, measurements, of_list
from leadline.estimate.output import Reference, solution_of
from leadline.estimate.python_sensor import evaluate
from leadline.models.imu import InputStream
from leadline.models.layout import TIME

if TYPE_CHECKING:
    from collections.abc import Callable

    from leadline.data.records import Array
    from leadline.data.solution import Solution

CHECKPOINT_EVERY = 100  # events


@dataclass(frozen=True)
class Results:
    """What a run leaves: per measurement its outcome and result, per output its numbers (plan.py)."""

    outcome: Integers
    result: Array
    output: Array


@dataclass(frozen=True)
class Checkpoint:
    """The state before an event of the stream."""

    event: Event
    state: Array


class Navigator:
    """A composition at work.

    state: the flat array of models/layout.py; all that is known lies in it.
    """

    def __init__(
        self,
        composition: Composition,
        state: Array,
        inputs: InputStream | None = None,
        window: float = 30.0,
        reference: Reference | None = None,
        unmodelled: frozenset[str] = frozenset(),
    ) -> None:
        """Start from a state; `inputs` turns IMU rows into inputs, `window` (s) is how late a row may arrive.

        `reference` says against what estimates are expressed; `unmodelled` names sensors that no model uses yet.
        """
        self.unmodelled = unmodelled
        self.composition, self.state, self.inputs, self.window = composition, state.copy(), inputs, window
        self.reference = reference
        self.start = float(state[TIME])
        self._workspace = Workspace(composition.layout)
        self._screens = {s.config.name: Screen(s.config.repeats, s.config.latency, live=True) for s in composition.sensors}
        self._sensors = {s.config.name: s for s in composition.sensors}
        self._rows = dict.fromkeys(self._sensors, 0)
        self._events: list[Event] = []  # in order, of the window
        self._done = 0  # how many of them are in the state
        self._checkpoints: list[Checkpoint] = []
        self.outcomes: dict[tuple[str, int], int] = {}

    @property
    def time(self) -> float:
        """The moment that the state is valid at (s)."""
        return float(self.state[TIME])

    def run(self, events: Events, outputs: int = 0, progress: Callable[[float], None] | None = None) -> Results:
        """Consume a stream of events in one go; returns outcomes, results and outputs.

        With `progress` it goes in a hundred pieces and calls it after each with the fraction done; the bits are the same.
        """
        measured = int(events.measured.sum())
        results = Results(
            np.full(measured, -1),
            np.full((max(1, measured), at.RESULT_SIZE), np.nan),
            np.zeros((max(1, outputs), output_size(self.composition.layout))),
        )
        first, pieces = 0, 1 if progress is None else 100
        for piece in range(1, pieces + 1):
            last = len(events) * piece // pieces
            while first < last:
                first = self._consume(events, first, last, results)
            if progress is not None:
                progress(piece / pieces)
        return results

    def _consume(self, events: Events, first: int, last: int, results: Results) -> int:
        """Run compiled up to `last` or to a sensor in plain Python, which is evaluated here; returns the next event."""
        c = self.composition
        stream = (events.time, events.kind, events.start, events.data, events.index)
        e: int = loop.run(
            c.plan, c.params, self.state, *stream, first, last, *self._workspace.arrays, results.outcome, results.result, results.output
        )
        if e == last:
            return e
        row = events.data[events.start[e] : events.start[e + 1]]
        i = events.index[e]
        results.outcome[i] = evaluate(c, self._workspace, self.state, int(events.kind[e]), row, results.result[i])
        return e + 1

    def add(self, sensor: str, rows: Table) -> Integers:
        """Take in rows of a sensor as they arrive, and bring the state up to date; returns the outcome of each row as far as known.

        A row that waits for its input counts as USED until it has been judged; `outcomes` holds the last word on every row, by
        sensor and number of the row.  Raises InputError for a sensor that the composition does not have.
        """
        if self.inputs is not None and sensor == self.inputs.name and isinstance(rows, Imu):
            return self._add_input(rows)
        if sensor in self.unmodelled:
            return np.full(len(rows), int(Outcome.NO_MODEL))
        self._check(sensor, rows)
        first = self._rows[sensor]
        self._rows[sensor] += len(rows)
        slot = self.composition.first_slot[sensor]
        oldest = self.time - self.window
        batches, outcome = measurements(self._sensors[sensor], slot, rows, self._screens[sensor], self.start, oldest=oldest)
        self._insert([event for batch in batches for event in _numbered(batch, first)])
        for i, code in enumerate(outcome):
            self.outcomes[sensor, first + i] = int(code)
        self._process()
        return np.array([self.outcomes[sensor, first + i] for i in range(len(rows))])

    def _check(self, sensor: str, rows: Table) -> None:
        if sensor not in self._sensors:
            known = [*self._sensors, *([self.inputs.name] if self.inputs is not None else [])]
            raise InputError("navigator", f"has no sensor '{sensor}' for rows of kind '{rows.kind}'", suggestion(sensor, known))
        kind = self._sensors[sensor].config.kind
        if kind in KINDS and rows.kind != kind:
            raise InputError("navigator", f"'{sensor}' was handed rows of kind '{rows.kind}'", f"it is of kind '{kind}'")

    def _add_input(self, rows: Imu) -> Integers:
        if self.inputs is None:
            raise InputError("navigator", "has no input stream", "the process model consumes none")
        start, data, outcome = self.inputs.push(rows)
        self._insert(list(Batch(at.IS_INPUT, start, data)))
        self._process()
        return outcome

    def _insert(self, events: list[Event]) -> None:
        """Put events in their places; the state goes back where one lies before what has been consumed."""
        earliest = self._done
        for event in events:
            if event.kind in (at.IS_CLONE, at.IS_DROP):
                place, needed = self._agree(event)
                earliest = min(earliest, place)
                if not needed:
                    continue
            earliest = min(earliest, bisect_left(self._events, event))
            insort(self._events, event)
        if earliest < self._done:
            self._rewind(earliest)

    def _agree(self, event: Event) -> tuple[int, bool]:
        """Agree a clone, or the order to forget it, with what is known: (where the stream changed by it, whether it is needed).

        A clone is made once, and forgotten after the last row that looks at it.
        """
        if event.kind == at.IS_CLONE:
            lost = bool(self._checkpoints) and event < self._checkpoints[0].event
            return len(self._events), not lost and event not in self._events[bisect_left(self._events, event) :][:1]
        for i, other in enumerate(self._events):
            if other.kind == at.IS_DROP and other.data == event.data:
                if other.time >= event.time:
                    return len(self._events), False
                del self._events[i]
                return i, True
        return len(self._events), True

    def _rewind(self, place: int) -> None:
        """Go back to the checkpoint before the event at `place`, or to the oldest there is."""
        target = self._events[place] if place < len(self._events) else None
        while len(self._checkpoints) > 1 and (target is not None and not self._checkpoints[-1].event < target):
            self._checkpoints.pop()
        if not self._checkpoints:
            return
        self.state[:] = self._checkpoints[-1].state
        self._done = bisect_left(self._events, self._checkpoints[-1].event)

    def _process(self) -> None:
        """Consume the events that inputs cover, in runs between checkpoints, and forget what has left the window."""
        covered = self.inputs.covered if self.inputs is not None else np.inf
        ready = bisect_right(self._events, covered, key=lambda event: event.time)
        while self._done < ready:
            if not self._checkpoints or self._done - self._place(self._checkpoints[-1]) >= CHECKPOINT_EVERY:
                before = self._events[self._done] if self._checkpoints else Event(-np.inf, 0, 0)  # the first: before all that may come late
                self._checkpoints.append(Checkpoint(before, self.state.copy()))
            last = min(ready, self._done + CHECKPOINT_EVERY)
            self._consume_live(self._events[self._done : last])
            self._done = last
        self._forget()

    def _place(self, checkpoint: Checkpoint) -> int:
        return bisect_left(self._events, checkpoint.event)

    def _consume_live(self, events: list[Event]) -> None:
        stream = of_list(events)
        results = self.run(stream)
        found: dict[tuple[str, int], int] = {}
        for event, index in zip(events, stream.index, strict=True):
            if event.kind >= 0:  # a row of several channels counts as used if any of them was
                key, outcome = (event.sensor, event.row), int(results.outcome[index])
                found[key] = min(found.get(key, outcome), outcome)
        self.outcomes |= found

    def _forget(self) -> None:
        """Drop events and checkpoints that no row inside the window can need."""
        while len(self._checkpoints) > 1 and self._checkpoints[1].event.time < self.time - self.window:
            self._checkpoints.pop(0)
            cut = self._place(self._checkpoints[0])
            del self._events[:cut]
            self._done -= cut

    def estimate(self, time: float | None = None) -> Solution:
        """Return the estimate at a time not before the state's, as a Solution of one row; the state stays as it is."""
        if self.reference is None:
            raise InputError("navigator", "has no reference to express estimates against", "make it with `navigator_for`")
        moment = np.array([self.time if time is None else time])
        return solution_of(self.reference, self.composition, moment, self.output(time)[None])

    def output(self, time: float | None = None) -> Array:
        """Return the numbers of one output (plan.py) at a time not before the state's; the state stays as it is."""
        moment = self.time if time is None else time
        if moment < self.time:
            raise InputError("navigator", f"cannot say what was at {moment} s", f"it stands at {self.time} s")
        events = of_list([Event(moment, RANK[at.IS_OUTPUT], at.IS_OUTPUT)])
        return np.asarray(self.run(events, outputs=1).output[0])


def _numbered(batch: Batch, first: int) -> list[Event]:
    """The events of a batch, with rows numbered from the first row that this sensor ever sent."""
    return [Event(e.time, e.rank, e.kind, e.data, e.sensor, e.row + first if e.row >= 0 else -1) for e in batch]
