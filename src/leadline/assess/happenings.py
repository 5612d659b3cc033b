"""What happened on a dive: each event of a solution in a sentence, from its innovations, its status and its summary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leadline.assess.streams import Stretch, streams_of, stretches, whole
from leadline.data.outcome import Outcome
from leadline.data.solution import Status

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.assess.streams import Booleans, Stream
    from leadline.data.records import Array
    from leadline.data.solution import Solution

SILENT_FOR, AT_LEAST = 8.0, 2.0  # a silence is that many usual intervals long, and that many seconds
RUN = 6  # rows outside the gate, one after the other, that are more than outliers
FEWEST = 5  # rows of the other beams that a beam must have missed
MOST = 3  # of one sort and one sensor that are told one by one
CHANCE = 0.01  # scattered rows outside the gate are told where that many, or one that far off, come by chance less often than that

# What is said of rows that met an outcome; those that come in stretches are told by stretch, the others all together.
WORDS = {
    Outcome.INVALID: "invalid",
    Outcome.OUT_OF_RANGE: "out of range",
    Outcome.CLOCK_JUMP: "back in time (clock jump)",
    Outcome.LATE: "too late for the window",
    Outcome.DUPLICATE: "equal to another row",
    Outcome.HELD: "a held value again",
    Outcome.NO_CLONE: "without the pose at an earlier epoch",
    Outcome.DECIMATED: "sooner than the vehicle file asks for, and left out",
    Outcome.OVERRULED: "overruled by the smoother",
}
BY_STRETCH = (Outcome.INVALID, Outcome.OUT_OF_RANGE, Outcome.CLOCK_JUMP)
JUDGED = (Outcome.USED, Outcome.GATED, Outcome.REANCHORED, Outcome.OVERRULED)
STATUS = {
    Status.ALIGNING: "the attitude was being found",
    Status.DEAD_RECKONING: "nothing bounded the drift (dead reckoning)",
    Status.MULTIMODAL: "several places were possible",
    Status.LOST: "the solution was lost",
}


@dataclass(frozen=True)
class Happening:
    """An event of a dive: its kind, the sensor ("" for the vehicle), when it began and ended (s), of how many rows or states."""

    kind: str
    sensor: str
    start: float
    end: float
    count: int
    sentence: str


def happenings(solution: Solution) -> tuple[Happening, ...]:
    """Return the events of a dive in order of time; sorts of which a sensor has more than a few are told in one sentence each.

    Kinds: silent, beam_silent, gated, outliers, invalid, out_of_range, clock_jump, late, duplicate, held, no_clone, decimated,
    overruled, reanchored, widened, standby, inertial_gap, inertial_standby, aligning, dead_reckoning, multimodal, lost.
    """
    found = [*_of_status(solution), *_of_inertial(solution)]
    span = _span(solution)
    for stream, beams in streams_of(solution.innovations):
        found += [*_of_rows(stream, _total(solution, stream)), *_timeless(stream, span)]
        if stream.looked.any():  # else it is an inertial unit, whose rows are told only where they were not used
            found += [*_silences(stream, span), *_of_standby(stream)]
        for part in beams or [stream]:
            found += [*_gated(part), *_opened(part)]
        for beam in beams:
            found += _beam_silences(beam, stream, span)
    return tuple(sorted(found, key=lambda h: (h.start, h.end, h.kind, h.sensor)))


def _span(solution: Solution) -> tuple[float, float]:
    """Return start and end of the run."""
    return (float(solution.time[0]), float(solution.time[-1])) if len(solution) else (np.inf, -np.inf)


def _total(solution: Solution, stream: Stream) -> int:
    """Return the number of a sensor's rows; the summary alone tells those of an inertial unit that were used."""
    counts = solution.summary.get("counts")
    told = counts.get(stream.sensor) if isinstance(counts, Mapping) else None
    return max(len(stream), sum(told.values()) if isinstance(told, Mapping) else 0)


def _of_status(solution: Solution) -> Iterator[Happening]:
    if not len(solution):
        return
    ends = np.append(solution.time[1:], solution.time[-1])
    for status, words in STATUS.items():
        at = solution.status == status
        begun = stretches(solution.time, at, apart=0)
        last = stretches(ends, at, apart=0)
        spans = [Stretch(a.start, b.end, a.count, a.among) for a, b in zip(begun, last, strict=True)]
        yield from _each(status.name.lower(), "", spans, words, len(solution))


def _of_inertial(solution: Solution) -> Iterator[Happening]:
    told = solution.summary.get("inertial") or ()
    for kind, words in (("gap", "{}: no inertial data"), ("standby", "{}: stood in for the first inertial unit")):
        mine = [s for s in told if s["kind"] == kind]
        for sensor in sorted({str(s["sensor"]) for s in mine}):
            spans = [Stretch(float(s["start_s"]), float(s["end_s"]), 0, 0) for s in mine if s["sensor"] == sensor]
            yield from _each(f"inertial_{kind}", sensor, spans, words.format(sensor), 0)


def _each(kind: str, sensor: str, spans: list[Stretch], words: str, among: int, more: str = "") -> Iterator[Happening]:
    """Tell time spans one by one where they are few, else all in one sentence."""
    if len(spans) <= MOST:
        for s in spans:
            yield Happening(kind, sensor, s.start, s.end, s.count, f"{words} {_from_to(s)} ({_seconds(s.length)}){more}.")
        return
    longest, every = max(spans, key=lambda s: s.length), whole(spans, among)
    lengths = f"{_seconds(sum(s.length for s in spans))} in all, at most {_seconds(longest.length)} ({_from_to(longest)})"
    yield Happening(kind, sensor, every.start, every.end, every.count, f"{words} {len(spans)} times {_from_to(every)}, {lengths}{more}.")


def _of_rows(stream: Stream, total: int) -> Iterator[Happening]:
    """Tell rows that were not used for what they say themselves."""
    for outcome, words in WORDS.items():
        found = stretches(stream.time, (stream.outcome == outcome) & np.isfinite(stream.time), place=stream.place)
        if not found:
            continue
        kind = outcome.name.lower()
        if outcome in BY_STRETCH and len(found) <= MOST:
            for s in found:
                yield _rows(kind, stream, s, words)
            continue
        every = whole(found, total)
        longest = max(found, key=lambda s: s.count)
        more = f", in {len(found)} stretches, the longest of {longest.count:,} rows {_from_to(longest)}" if outcome in BY_STRETCH else ""
        yield _rows(kind, stream, every, words, more)


def _rows(kind: str, stream: Stream, s: Stretch, words: str, more: str = "") -> Happening:
    told = f"a row {words} at {s.start:.1f} s" if s.count == 1 else f"{s.count:,} of {s.among:,} rows {words} {_from_to(s)}{more}"
    return Happening(kind, stream.sensor, s.start, s.end, s.count, f"{stream.name}: {told}.")


def _timeless(stream: Stream, span: tuple[float, float]) -> Iterator[Happening]:
    """Tell rows whose time is no number."""
    count = int((~np.isfinite(stream.time)).sum())
    if count:
        yield Happening("invalid", stream.sensor, *span, count, f"{stream.name}: {count:,} {_noun(count)} without a time.")


def _noun(count: int) -> str:
    return "row" if count == 1 else "rows"


def _silences(stream: Stream, span: tuple[float, float]) -> Iterator[Happening]:
    """Tell when a sensor gave no rows at all for much longer than usual."""
    time = stream.time[(stream.time >= span[0]) & (stream.time <= span[1])]
    usual = _usual(time)
    if usual is None:
        return
    spans = _gaps(time, usual, span)
    more = f"; it usually gives a row every {_seconds(usual)}"
    yield from _each("silent", stream.sensor, spans, f"{stream.name}: silent", 0, more)


def _beam_silences(beam: Stream, stream: Stream, span: tuple[float, float]) -> Iterator[Happening]:
    """Tell when one beam gave nothing while the others did."""
    looked = stream.time[stream.looked & (stream.time >= span[0]) & (stream.time <= span[1])]
    usual = _usual(looked)
    if usual is None:
        return
    spans = []
    for s in _gaps(beam.time, usual, (float(looked[0]), float(looked[-1]))):
        a, b = np.searchsorted(looked, [s.start, s.end])
        if b - a > FEWEST:
            spans.append(Stretch(s.start, s.end, int(b - a - 1), int(b - a)))
    more = " while the others went on"
    yield from _each("beam_silent", beam.sensor, spans, f"{beam.name}: nothing", len(stream), more)


def _usual(time: Array) -> float | None:
    """Return the usual interval (s) of times in order, None where there are too few."""
    step = np.diff(time)
    step = step[step > 0.0]
    return float(np.median(step)) if len(step) > 1 else None


def _gaps(time: Array, usual: float, span: tuple[float, float]) -> list[Stretch]:
    """Return where no row lies for too long, from the start of the run to its end."""
    edges = np.concatenate([[span[0]], time, [span[1]]])
    wide = np.flatnonzero(np.diff(edges) > max(SILENT_FOR * usual, AT_LEAST))
    return [Stretch(float(edges[k]), float(edges[k + 1]), 0, 0) for k in wide.tolist()]


def _of_standby(stream: Stream) -> Iterator[Happening]:
    """Tell when a sensor that stands by was used."""
    known = np.isin(stream.outcome, (*JUDGED, Outcome.STANDBY))
    if not (stream.outcome == Outcome.STANDBY).any():
        return
    taken = stretches(stream.time[known], stream.outcome[known] != Outcome.STANDBY, apart=0)
    yield from _each("standby", stream.sensor, taken, f"{stream.name}: stood in for the instrument that it stands by for", len(stream))


def _gated(stream: Stream) -> Iterator[Happening]:
    """Tell runs of rows outside the gate, and what is scattered, if it is more than the gate makes by itself."""
    judged = np.isin(stream.outcome, JUDGED) & stream.looked
    time, outside = stream.time[judged], stream.outcome[judged] == Outcome.GATED
    found = stretches(time, outside)
    runs = [s for s in found if s.count >= RUN]
    if len(runs) <= MOST:
        for s in runs:
            yield _rows("gated", stream, s, "outside the gate")
    else:
        longest = max(runs, key=lambda s: s.count)
        more = f", in {len(runs)} runs, the longest of {longest.count:,} rows {_from_to(longest)}"
        between = int(np.sum((time >= runs[0].start) & (time <= runs[-1].end)))
        yield _rows("gated", stream, whole(runs, between), "outside the gate", more)
    alone = [s for s in found if s.count < RUN]
    wild = len(time) * float(stream.rarity[judged].min(initial=1.0)) < CHANCE
    if alone and (wild or _surprising(sum(s.count for s in alone), float(stream.tail[judged].sum()))):
        every = whole(alone, len(time))
        share = f", scattered ({100.0 * every.count / every.among:.2g} %)"
        yield _rows("outliers", stream, every, "outside the gate", share)


def _surprising(count: int, expected: float) -> bool:
    """Tell whether so many are rare where `expected` are the mean of a Poisson law."""
    from scipy.special import gammainc

    return bool(expected <= 0.0 or gammainc(count, expected) < CHANCE)


def _opened(stream: Stream) -> Iterator[Happening]:
    """Tell gates that were widened, and estimates that were opened up to a sensor."""
    opened = stream.outcome == Outcome.REANCHORED
    words = f"{stream.name}: the estimate was opened up to it after a run of rejections"
    times = stream.time[opened].tolist()
    if len(times) <= MOST:
        yield from (Happening("reanchored", stream.sensor, t, t, 1, f"{words}, at {t:.1f} s.") for t in times)
    else:
        sentence = f"{words}, {len(times)} times from {times[0]:.1f} s to {times[-1]:.1f} s."
        yield Happening("reanchored", stream.sensor, times[0], times[-1], len(times), sentence)
    passed: Booleans = stream.widened & (stream.outcome == Outcome.USED)
    found = stretches(stream.time, passed)
    if found:
        yield _rows("widened", stream, whole(found, len(stream)), "let in by a gate that had widened")


def _from_to(s: Stretch) -> str:
    return f"from {s.start:.1f} s to {s.end:.1f} s"


def _seconds(value: float) -> str:
    return f"{value:.0f} s" if value >= 100.0 else f"{value:.3g} s"
