"""A composition at work on a stream of events: compiled as far as it goes, back to Python for the rows of a plain-Python sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.estimate import loop
from leadline.estimate import plan as at
from leadline.estimate import tape as on_tape
from leadline.estimate.composition import Workspace, output_size
from leadline.estimate.python_sensor import evaluate

if TYPE_CHECKING:
    from leadline.data.records import Array
    from leadline.estimate.composition import Composition
    from leadline.estimate.events import Events, Integers


@dataclass(frozen=True)
class Results:
    """What a run leaves: per measurement its outcome and result, per output its numbers (plan.py)."""

    outcome: Integers
    result: Array
    output: Array

    @classmethod
    def room(cls, composition: Composition, measured: int, outputs: int) -> Results:
        """Return room for the results of so many measurements and outputs."""
        return cls(
            np.full(measured, -1),
            np.full((max(1, measured), at.RESULT_SIZE), np.nan),
            np.zeros((max(1, outputs), output_size(composition.layout))),
        )


class Runner:
    """A composition with the arrays that it works in."""

    def __init__(self, composition: Composition) -> None:
        """Allocate for a composition."""
        self.composition = composition
        self.workspace = Workspace(composition.layout, composition.estimator.count(composition.layout))

    def run(self, state: Array, events: Events, results: Results, first: int = 0, last: int | None = None) -> None:
        """Consume the events first .. last-1 in place of `state`, and fill in their results."""
        last, c, work = len(events.time) if last is None else last, self.composition, self.workspace
        stream = (events.time, events.kind, events.start, events.stop, events.data, events.index)
        while first < last:
            e: int = loop.run(c.plan, c.params, state, *stream, first, last, *work.arrays, results.outcome, results.result, results.output)
            first = e
            if e < last:
                row, i = events.data[events.start[e] : events.stop[e]], events.index[e]
                if len(work.tape):
                    work.tape[on_tape.EVENT] = i
                results.outcome[i] = evaluate(c, work, state, int(events.kind[e]), row, results.result[i])
                first = e + 1
