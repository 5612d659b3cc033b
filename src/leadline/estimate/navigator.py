"""Navigator: one composition and one state; the same object consumes a whole log or one row at a time, with the same bits.

Live, events are kept in order of time for a window.  What arrives late is put in its place, and the stream is replayed from the
checkpoint before it.  A measurement waits for the input that covers it, one sample at most.  What leaves the window is final: it is
counted, handed to `on_final` where somebody listens, and forgotten; so memory does not grow.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.data.errors import InputError, suggestion
from leadline.data.outcome import Outcome
from leadline.data.records import KINDS, Imu, Table, after
from leadline.estimate import loop
from leadline.estimate import plan as at
from leadline.estimate.clocks import Clock
from leadline.estimate.composition import Composition, output_size
from leadline.estimate.events import Batch, Event, Events, Integers, Screen, measurements
from leadline.estimate.output import Reference, solution_of
from leadline.estimate.run import Results, Runner
from leadline.estimate.window import Window
from leadline.models.layout import INPUTS, TIME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from leadline.data.records import Array
    from leadline.data.solution import Solution
    from leadline.estimate.inputs import Inputs

CHECKPOINT_EVERY = 100  # events


@dataclass
class Checkpoint:
    """The state before the event at a place of the window."""

    place: int
    state: Array


class Navigator:
    """A composition at work.

    state: the flat array of models/layout.py; all that is known lies in it.  outcomes: the last word on each row of the window, by
    sensor and number of the row; counts: of the rows that have left it, by sensor and outcome.
    """

    def __init__(
        self,
        composition: Composition,
        state: Array,
        inputs: Inputs | None = None,
        window: float = 30.0,
        reference: Reference | None = None,
        unmodelled: frozenset[str] = frozenset(),
        clocks: dict[str, Clock] | None = None,
    ) -> None:
        """Start from a state; `inputs` turns inertial rows into inputs, `window` (s) is how late a row may arrive.

        `reference` says against what estimates are expressed; `unmodelled` names sensors that no model uses yet; `clocks` are those of
        the sensors' stamps, by sensor: one that is not named is put right where it steps.
        """
        self.unmodelled = unmodelled
        self.composition, self.state, self.inputs, self.window = composition, state.copy(), inputs, window
        self.reference = reference
        self.start = float(state[TIME])
        self.runner = Runner(composition)
        self.screens = {s.config.name: Screen(s.config.repeats, s.config.latency, live=True) for s in composition.sensors}
        self._sensors = {s.config.name: s for s in composition.sensors}
        self.clocks = {name: Clock() for name in (inputs.names if inputs is not None else ())}
        self.clocks |= {name: Clock(s.config.mend_clock) for name, s in self._sensors.items()} | (clocks or {})
        self.kinds = {name: s.config.kind for name, s in self._sensors.items()}
        twice = [s.flight for s in composition.sensors if any(channel.epochs == 2 for channel in s.channels)]
        self.flight = max(twice, default=0.0)  # a late row may look so far back behind its own time (s)
        self.rows = dict.fromkeys(self._sensors, 0)  # seen so far, by sensor
        widest = max([at_least for s in composition.slots for at_least in (s.channel.row_length + s.channel.epochs - 1,)] + [INPUTS])
        self.events = Window(tuple(self._sensors), widest)
        self.done = 0  # how many of them are in the state
        self.checkpoints: list[Checkpoint] = []
        self.outputs = np.zeros((1, output_size(composition.layout)))  # of the output events in the stream, by number
        self.outcomes: dict[tuple[str, int], int] = {}
        self.counts: dict[str, Counter[str]] = {name: Counter() for name in self._sensors}
        self.turned_away: deque[tuple[float, tuple[str, int]]] = deque()  # rows that gave no event, and when they came
        self.recent: dict[str, Table] = {}  # rows of sensors that must see some of those before
        self.trimmed = False  # whether anything has left the window
        self.on_final: Callable[[Window, int], None] | None = None

    @property
    def fed(self) -> frozenset[str]:
        """The sensors whose rows are input and nothing else: those that are used leave no entry of their own."""
        own = self.inputs.names if self.inputs is not None else ()
        return frozenset(own) | {s.config.name for s in self.composition.sensors if s.feed is not None and not s.channels}

    @property
    def time(self) -> float:
        """The moment that the state is valid at (s)."""
        return float(self.state[TIME])

    def run(self, events: Events, outputs: int = 0, progress: Callable[[float], None] | None = None) -> Results:
        """Consume a stream of events in one go; returns outcomes, results and outputs.

        With `progress` it goes in a hundred pieces and calls it after each with the fraction done; the bits are the same.
        """
        results = Results.room(self.composition, int(events.measured.sum()), outputs)
        first, pieces = 0, 1 if progress is None else 100
        for piece in range(1, pieces + 1):
            last = len(events) * piece // pieces
            self.runner.run(self.state, events, results, first, last)
            first = last
            if progress is not None:
                progress(piece / pieces)
        return results

    def add(self, sensor: str, rows: Table) -> Integers:
        """Take in rows of a sensor as they arrive, and bring the state up to date; returns the outcome of each row as far as known.

        A row that waits for its input counts as USED until it has been judged; `outcomes` holds the last word on every row of the
        window.  Raises InputError for a sensor that the composition does not have.
        """
        first = self.rows.get(sensor, 0)
        outcome = self.receive(sensor, rows)
        if sensor not in self.rows:
            return outcome
        return np.array([self.outcomes.get((sensor, first + i), int(code)) for i, code in enumerate(outcome)], np.int64)

    def receive(self, sensor: str, rows: Table) -> Integers:
        """Take in rows as `add` does; returns USED for those that gave a measurement, however that was judged, and why others did not."""
        if self.inputs is not None and self.inputs.is_mine(sensor) and isinstance(rows, Imu):
            return self._add_input(sensor, rows)
        if sensor in self.unmodelled:
            return np.full(len(rows), int(Outcome.NO_MODEL))
        self._check(sensor, rows)
        rows, aside = self.clocks[sensor].take(rows)
        first = self.rows[sensor]
        self.rows[sensor] += len(rows)
        slot = self.composition.first_slot[sensor]
        oldest = self.time - self.window
        earlier = self._earlier(sensor, rows)
        batches, outcome = measurements(self._sensors[sensor], slot, rows, self.screens[sensor], self.start, oldest=oldest, known=earlier)
        outcome[aside] = int(Outcome.CLOCK_JUMP)
        self.take([event for batch in batches for event in _numbered(batch, first)])
        for i, code in enumerate(outcome):
            self.outcomes.setdefault((sensor, first + i), int(code))
            if code != Outcome.USED:
                self.turned_away.append((self.time, (sensor, first + i)))
        return outcome

    def _earlier(self, sensor: str, rows: Table) -> Table | None:
        """The rows that a sensor must see beside the new ones; the new ones are kept for the next."""
        before = self._sensors[sensor].before
        if not before > 0.0:
            return None
        known = self.recent.get(sensor)
        together = rows if known is None else after(known, rows)
        newest = float(np.max(together.time, initial=-np.inf, where=np.isfinite(together.time)))
        self.recent[sensor] = together.select(together.time >= newest - before)
        return known

    def _check(self, sensor: str, rows: Table) -> None:
        if sensor not in self._sensors:
            known = [*self._sensors, *([self.inputs.first.name] if self.inputs is not None else [])]
            raise InputError("navigator", f"has no sensor '{sensor}' for rows of kind '{rows.kind}'", suggestion(sensor, known))
        kind = self._sensors[sensor].config.kind
        if kind in KINDS and rows.kind != kind:
            raise InputError("navigator", f"'{sensor}' was handed rows of kind '{rows.kind}'", f"it is of kind '{kind}'")

    def _add_input(self, sensor: str, rows: Imu) -> Integers:
        if self.inputs is None:
            raise InputError("navigator", "has no input stream", "the process model consumes none")
        mended, aside = self.clocks[sensor].take(rows)
        outcome = np.full(len(rows), int(Outcome.CLOCK_JUMP))
        if aside.all():
            return outcome
        pushed = self.inputs.push(sensor, mended.select(~aside) if aside.any() else mended)  # type: ignore[arg-type]
        if np.isfinite(pushed.withdrawn):
            self.withdraw(pushed.withdrawn)
        self.take(list(Batch(at.IS_INPUT, pushed.time, pushed.data)))
        outcome[~aside] = pushed.outcome
        return outcome

    def take(self, events: Iterable[Event]) -> None:
        """Put events in their places, and consume what inputs cover; the state goes back where one lies before what it has consumed."""
        earliest = self.done
        for event in events:
            if event.kind in (at.IS_CLONE, at.IS_DROP):
                place, needed = self._agree(event)
                earliest = min(earliest, place)
                if not needed:
                    continue
            earliest = min(earliest, self.events.insert(event))
        if earliest < self.done:
            self._rewind(earliest)
        self._process()

    def withdraw(self, time: float) -> None:
        """Take the inputs from a time on out of the stream."""
        events, count = self.events, len(self.events)
        mine = (events.kind[:count] == at.IS_INPUT) & (events.source[:count] < 0)
        places = np.flatnonzero(mine & (events.time[:count] >= time))
        if len(places):
            self._rewind(int(places[0]))
            events.delete(places)

    def _agree(self, event: Event) -> tuple[int, bool]:
        """Agree a clone, or the order to forget it, with what is known: (where the stream changed by it, whether it is needed).

        A clone is made once, and forgotten after the last row that looks at it.
        """
        events, count = self.events, len(self.events)
        if event.kind == at.IS_CLONE:
            place = events.place(event)
            lost = self.trimmed and place == 0
            known = place < count and events.time[place] == event.time and events.kind[place] == at.IS_CLONE
            return count, not lost and not known
        same = np.flatnonzero((events.kind[:count] == at.IS_DROP) & (events.rows[:count, 0] == event.data[0]))
        for i in same:
            if events.time[i] >= event.time:
                return count, False
            self._rewind(int(i))
            events.delete(same[:1])
            return int(i), True
        return count, True

    def _rewind(self, place: int) -> None:
        """Go back to the last checkpoint not behind the event at `place`, or to the oldest there is."""
        while len(self.checkpoints) > 1 and self.checkpoints[-1].place > place:
            self.checkpoints.pop()
        if not self.checkpoints or place >= self.done:
            return
        self.state[:] = self.checkpoints[-1].state
        self.done = self.checkpoints[-1].place

    def _process(self) -> None:
        """Consume the events that inputs cover, in runs between checkpoints, and forget what has left the window."""
        events = self.events
        covered = self.inputs.covered if self.inputs is not None else np.inf
        ready = int(np.searchsorted(events.time[: len(events)], covered, side="right"))
        while self.done < ready:
            if not self.checkpoints or self.done - self.checkpoints[-1].place >= CHECKPOINT_EVERY:
                self.checkpoints.append(Checkpoint(self.done, self.state.copy()))
            last = events.whole(min(ready, self.checkpoints[-1].place + CHECKPOINT_EVERY), ready)
            self._consume(self.done, last)
            self.done = last
        self._forget()

    def _consume(self, first: int, last: int) -> None:
        events = self.events
        events.outcome[first:last] = -1
        events.result[first:last] = np.nan
        self.runner.run(self.state, events, Results(events.outcome, events.result, self.outputs), first, last)  # type: ignore[arg-type]
        found: dict[tuple[str, int], int] = {}
        for i in np.flatnonzero(events.kind[first:last] >= 0).tolist():  # a row of several channels counts as used if any of them was
            key, outcome = (events.name(first + i), int(events.row[first + i])), int(events.outcome[first + i])
            found[key] = min(found.get(key, outcome), outcome)
        self.outcomes |= found

    def _forget(self) -> None:
        """Drop events and checkpoints that no row inside the window can need."""
        oldest, cut = self.time - self.window - self.flight, 0
        while len(self.checkpoints) > 1 and self.events.time[self.checkpoints[1].place] < oldest:
            cut = self.checkpoints[1].place
            self.checkpoints.pop(0)
        if cut:
            self._finish(cut)

    def _finish(self, cut: int) -> None:
        """The first `cut` events are final."""
        events = self.events
        if self.on_final is not None:
            self.on_final(events, cut)
        final = [(events.name(i), int(events.row[i])) for i in np.flatnonzero(events.source[:cut] >= 0).tolist()]
        while self.turned_away and self.turned_away[0][0] < self.time - self.window:
            final.append(self.turned_away.popleft()[1])
        for key in final:
            outcome = self.outcomes.pop(key, None)
            if outcome is not None:
                self.counts[key[0]][Outcome(outcome).name.lower()] += 1
        events.forget(cut)
        self.done, self.trimmed = self.done - cut, True
        for checkpoint in self.checkpoints:
            checkpoint.place -= cut

    def flush(self) -> None:
        """Make all that has been consumed final: no row comes any more."""
        self._finish(self.done)
        self.checkpoints.clear()

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
        work, c, out = self.runner.workspace, self.composition, np.zeros(output_size(self.composition.layout))
        loop.put_out(c.plan, c.params, self.state, moment, 0, work.scratch, work.V[0], work.work, work.points, work.tape[:0], out)
        return out


def _numbered(batch: Batch, first: int) -> list[Event]:
    """The events of a batch, with rows numbered from the first row that this sensor ever sent."""
    return [Event(e.time, e.rank, e.kind, e.data, e.sensor, e.row + first if e.row >= 0 else -1) for e in batch]
