"""The rows of a solution's sensors as streams in order of time, and the stretches in which something holds of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from leadline.data.outcome import Outcome

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.data.records import Array, Text
    from leadline.data.solution import Innovations

Integers = npt.NDArray[np.int64]
Booleans = npt.NDArray[np.bool_]
BEAM = "beam"  # the component of one beam is this word and its number
UNSEEN = (Outcome.NOT_CONFIGURED, Outcome.NO_MODEL, Outcome.EXCLUDED)  # of whole tables that nobody looked at


@dataclass(frozen=True)
class Stream:
    """The rows (k,) of one sensor, or of one of its beams, in order of time; of a row of several parts the worst outcome stands.

    `place` numbers them; it leaps where rows are not told of.  `looked` tells which were held against a prediction; `tail` is the
    probability that their gate turns away a good one, `rarity` that a good one lies as far off as one that was turned away (else 1).
    """

    sensor: str
    beam: str
    place: Integers
    time: Array
    outcome: Integers
    looked: Booleans
    widened: Booleans
    tail: Array
    rarity: Array

    @property
    def name(self) -> str:
        """The sensor, and the beam where it is one."""
        return f"{self.sensor} {self.beam}".rstrip()

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)


@dataclass(frozen=True)
class Stretch:
    """From the first to the last of `count` rows, among `among` rows of the stream; s."""

    start: float
    end: float
    count: int
    among: int

    @property
    def length(self) -> float:
        """Its length in s."""
        return self.end - self.start


def streams_of(innovations: Innovations) -> Iterator[tuple[Stream, list[Stream]]]:
    """Yield, for each sensor that was looked at, the stream of its rows, and those of its single beams if it has several."""
    group = innovations.group
    first = np.flatnonzero(np.append(True, group[1:] != group[:-1])[: len(group)])  # one entry for each group: they stand together
    names, code = coded(innovations.sensor[first])
    order = np.argsort(code, kind="stable")
    bounds = np.searchsorted(code[order], np.arange(len(names) + 1))
    for k in sorted(range(len(names)), key=names.__getitem__):
        entries = innovations.select(first[order[bounds[k] : bounds[k + 1]]])
        if not np.isin(entries.outcome, UNSEEN).all():
            yield _stream(names[k], "", entries), _beams(names[k], entries)


def coded(text: Text) -> tuple[list[str], npt.NDArray[np.int16]]:
    """Return the distinct words of (n,), in order of appearance, and the number of each entry's word; made for few distinct ones."""
    names: list[str] = []
    code = np.full(len(text), -1, np.int16)
    while (left := code < 0).any():
        word = text[np.argmax(left)]
        code[text == word] = len(names)
        names.append(str(word))
    return names, code


def _beams(sensor: str, entries: Innovations) -> list[Stream]:
    names, code = coded(entries.component)
    numbers = {int(name[len(BEAM) :]): k for k, name in enumerate(names) if name.startswith(BEAM) and name[len(BEAM) :].isdigit()}
    if len(numbers) < 2:
        return []
    return [_stream(sensor, f"{BEAM}{i}", entries.select(code == numbers.get(i, -1))) for i in range(1, max(numbers) + 1)]


def _stream(sensor: str, beam: str, entries: Innovations) -> Stream:
    """One entry for each row, in order of time."""
    looked = entries.component != ""
    tails, rarities = np.where(looked, 1.0 - entries.gate_probability, 0.0), _rarity(entries)
    widened = entries.widened & ((tails > 0.0) | (entries.outcome == Outcome.REANCHORED))  # Student's t has no gate to widen
    row, where = np.unique(entries.row, return_inverse=True)
    if len(row) == len(entries):
        number, time, outcome, held, wide = entries.row, entries.time, entries.outcome, looked, widened
        tail, rarity = tails, rarities
    else:
        number, time, outcome = row, np.full(len(row), np.inf), np.zeros(len(row), np.int64)
        tail, rarity = np.zeros(len(row)), np.ones(len(row))
        held, wide = np.zeros(len(row), bool), np.zeros(len(row), bool)
        np.minimum.at(time, where, entries.time)
        np.maximum.at(outcome, where, entries.outcome)
        np.add.at(tail, where, tails)
        np.minimum.at(rarity, where, rarities)
        held[where[looked]] = True
        wide[where[widened]] = True
    order = np.argsort(time, kind="stable")
    place = np.arange(len(order)) if looked.any() else number[order]  # of an inertial unit only rows that were not used are told of
    return Stream(sensor, beam, place, time[order], outcome[order], held[order], wide[order], tail[order], rarity[order])


def _rarity(entries: Innovations) -> Array:
    """Probability that chi-square exceeds the normalised innovation squared of each entry that was turned away; 1 for all others."""
    from scipy.special import gammaincc

    rarity = np.ones(len(entries))
    out = np.flatnonzero((entries.outcome == Outcome.GATED) & np.isfinite(entries.nis))
    rarity[out] = gammaincc(0.5 * entries.dof[out], 0.5 * entries.nis[out])
    return rarity


def stretches(time: Array, holds: Booleans, *, apart: int = 1, place: Integers | None = None) -> list[Stretch]:
    """Return the stretches of rows (k,) of which something holds; up to `apart` other rows in between do not end one.

    place (k,): numbers of the rows, where some are missing.
    """
    index = np.flatnonzero(holds)
    if not len(index):
        return []
    at = index if place is None else place[index]
    cut = np.flatnonzero(np.abs(np.diff(at)) > apart + 1)
    first, last = np.append(0, cut + 1), np.append(cut, len(index) - 1)
    found = [time[index[first]], time[index[last]], last - first + 1, np.maximum(np.abs(at[last] - at[first]), last - first) + 1]
    return [Stretch(*values) for values in zip(*(column.tolist() for column in found), strict=True)]


def whole(found: list[Stretch], among: int) -> Stretch:
    """Return several stretches as one."""
    return Stretch(found[0].start, found[-1].end, sum(s.count for s in found), among)
