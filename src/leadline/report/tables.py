"""Tables of a report, for the page and for the terminal: cells are words, as a person reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.assess.errors import spread
from leadline.assess.intervals import factor_text
from leadline.data.solution import Status

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.assess.assessment import Assessment
    from leadline.assess.consistency import Verdict
    from leadline.assess.errors import Errors, Spread
    from leadline.assess.happenings import Happening
    from leadline.data.outcome import Outcome
    from leadline.data.solution import Solution

MOST_ROWS, MOST_TOLD = 40, 200
TESTS = {"nis": "size (NIS)", "gate": "gate", "whiteness": "whiteness", "nees": "errors (NEES)"}
DEGREE = 180.0 / np.pi


@dataclass(frozen=True)
class Grid:
    """A table: columns whose name ends in '>' are set flush right; `marks` names the kind of each row."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    title: str = ""
    marks: Sequence[str] = ()
    note: str = ""
    least: tuple[str, ...] = ()  # columns that a narrow terminal may drop, the least important first


def number(value: float, digits: int = 3) -> str:
    """Write a number with so many figures, or a dash."""
    if not isfinite(value):
        return "–"
    return (
        f"{value:.{digits}g}" if 1e-4 <= abs(value) < 10**digits or value == 0 else f"{value:,.0f}" if abs(value) >= 1 else f"{value:.1e}"
    )


def length(metres: float) -> str:
    """Write a distance in metres or kilometres."""
    return f"{metres / 1000:.2f} km" if metres >= 2000 else f"{number(metres)} m"


def duration(seconds: float) -> str:
    """Write a time span in hours, minutes and seconds."""
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {whole % 60:02d} s"


def headlines(assessment: Assessment) -> list[tuple[str, str]]:
    """Return the few numbers that stand at the top, as label and value; what has no value is left out."""
    lines = [("duration", duration(assessment.duration)), ("distance travelled", length(assessment.distance))]
    if assessment.errors is not None and len(assessment.errors):
        horizontal = assessment.errors.statistics()["horizontal"]
        lines += _metres("horizontal error, median (CEP50)", horizontal.median)
        lines += _metres("95 % (R95)", horizontal.p95)
        lines += _metres("at the end", horizontal.end, assessment.errors.percent_of_distance)
    elif assessment.misclosures:
        worst = max(assessment.misclosures, key=lambda m: m.horizontal)
        lines += _metres("largest misclosure", worst.horizontal, worst.percent_of_distance)
    return lines


def _metres(label: str, value: float, percent: float = nan) -> list[tuple[str, str]]:
    share = f" ({number(percent)} % of distance)" if isfinite(percent) else ""
    return [(label, f"{number(value)} m{share}")] if isfinite(value) else []


def verdict_lines(verdict: Verdict) -> list[str]:
    """Return what a verdict says, line by line: what comes before the answer, the answer, and what it rests on."""
    body = verdict.sentence[len(". ".join((*verdict.first, ""))) :]
    answer = [f"{verdict.answer.value.capitalize()}:", *verdict.findings] if len(verdict.findings) > 1 else [body]
    return [*verdict.first, *answer]


def verdict_grid(assessment: Assessment) -> Grid:
    """Return one row for each test of the family."""
    rows, marks = [], []
    for v in assessment.consistency.verdicts:
        factor = f"{factor_text(v.factor.estimate)} ({v.factor.as_factor})" if isfinite(v.factor.estimate) else "–"
        rows.append((v.name, TESTS.get(v.test, v.test), v.answer.value, f"{v.count:,}", number(v.value), factor, number(v.p, 2)))
        marks.append(v.answer.name.lower())
    columns = ("of", "test", "answer", "values>", "statistic>", "errors larger by ×>", "p>")
    note = (
        "Statistic: mean NIS or NEES per degree of freedom (1 is to be expected), the fraction that the gate turned away, or the largest "
        "autocorrelation. Factor ×: how many times as large as predicted. "
        "Judged together by Holm at 1 %; intervals are simultaneous. Factors within 10 % and autocorrelations up to 0.1 "
        "count as consistent."
    )
    return Grid(columns, rows, "Tests", marks, note, least=("p>", "statistic>", "values>"))


def happening_lines(happenings: Sequence[Happening], most: int) -> list[str]:
    """Return what happened, a sentence to a line, at most so many, and how many more there are."""
    left = len(happenings) - most
    return [h.sentence for h in happenings[:most]] + ([f"… and {left} more, in summary.json."] if left > 0 else [])


def happening_grid(happenings: Sequence[Happening]) -> Grid:
    """Return what happened as a table, from start to end."""
    rows = [(f"{h.start:,.1f}", f"{h.end:,.1f}", h.sentence) for h in happenings[:MOST_TOLD]]
    left = len(happenings) - len(rows)
    return Grid(("from (s)>", "to (s)>", "what"), rows, "What happened", note=f"{left} more are in summary.json." if left > 0 else "")


def outcome_grid(assessment: Assessment) -> Grid:
    """Return what became of the rows of each sensor instance, in sentences."""
    return outcomes_of(assessment.counts)


def outcomes_of(counts: Mapping[str, Mapping[Outcome, int]]) -> Grid:
    """Return numbers of rows by sensor instance and outcome as a table."""
    rows, marks = [], []
    for sensor, by in sorted(counts.items()):
        total = sum(by.values())
        for k, (outcome, count) in enumerate(sorted(by.items())):
            rows.append((sensor if k == 0 else "", f"{count:,}", f"{100 * count / total:.1f} %", outcome.sentence))
            marks.append("first" if k == 0 else "")
    return Grid(("sensor", "rows>", "share>", "a row …"), rows, "Outcomes", marks, least=("share>",))


def status_shares(solution: Solution) -> list[tuple[str, float]]:
    """Return each status that a solution has, and in how many per cent of its rows."""
    names = {int(status): status.name.lower().replace("_", " ") for status in Status}
    values, counts = np.unique(solution.status, return_counts=True)
    return [(names[int(v)], 100.0 * float(n) / len(solution)) for v, n in zip(values, counts, strict=True)]


def error_grid(errors: Errors) -> Grid:
    """Return the statistics of the errors against truth."""
    units = {"velocity": ("m/s", 1.0), "tilt": ("°", DEGREE), "heading": ("°", DEGREE)}
    rows = [
        _spread_row(f"{name} ({units.get(name, ('m', 1.0))[0]})", s, units.get(name, ("m", 1.0))[1])
        for name, s in errors.statistics().items()
        if s.count
    ]
    drift = spread(errors.drift())
    if drift.count:
        rows.append(_spread_row("drift over legs of 1 km (m/km)", drift, 1.0))
    left_out = ", ".join(f"{count:,} {reason}" for reason, count in errors.left_out.items() if count)
    note = f"Compared at {len(errors):,} moments of truth over {length(errors.distance)}." + (f" Left out: {left_out}." if left_out else "")
    return Grid(
        ("error", "RMS>", "median>", "95 %>", "largest>", "at the end>", "moments>"),
        rows,
        "Errors against truth",
        (),
        note,
        ("moments>", "largest>", "median>"),
    )


def _spread_row(name: str, s: Spread, factor: float) -> tuple[str, ...]:
    return (name, *(number(factor * v) for v in (s.rms, s.median, s.p95, s.maximum, s.end)), f"{s.count:,}")


def misclosure_grid(assessment: Assessment) -> Grid:
    """Return the misclosures, the largest ones where there are many."""
    found = sorted(assessment.misclosures, key=lambda m: -m.horizontal)[:MOST_ROWS]
    rows = [
        (
            m.sensor,
            f"{m.time:,.0f}",
            number(m.since),
            length(m.distance),
            number(m.horizontal),
            number(m.sigma),
            number(m.percent_of_distance),
        )
        for m in sorted(found, key=lambda m: m.time)
    ]
    more = len(assessment.misclosures) - len(rows)
    note = "Residual of a fix that is the first after more than a minute: what dead reckoning had gathered by then."
    columns = ("fix", "time (s)>", "after (s)>", "travelled>", "misclosure (m)>", "predicted 1σ (m)>", "% of distance>")
    note += f" {more} smaller ones are not shown." if more else ""
    return Grid(columns, rows, "Misclosure at fixes", (), note, ("travelled>", "after (s)>", "% of distance>", "predicted 1σ (m)>"))


APART = ("counts", "verdict", "happenings", "inertial")  # of a summary: these have a place of their own


def run_grid(summary: Mapping[str, Any], distance: float) -> Grid:
    """Return what was run, as the solution's summary tells it, with the distance (m) as the assessment measures it."""
    told = {key: distance if key == "distance_m" else value for key, value in summary.items() if key not in APART}
    rows = [row for key, value in told.items() for row in _told(str(key), value)]
    return Grid(("what", "value"), rows, "What was run")


def _told(key: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for part, inner in value.items():
            yield from _told(f"{key}: {part}", inner)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        yield _label(key), "; ".join(map(_value, value)) or "–"
    else:
        yield _label(key), _value(value)


def _label(key: str) -> str:
    """Return a key as words, with its unit in brackets."""
    name, _, unit = key.rpartition("_")
    return f"{name.replace('_', ' ')} ({unit})" if name and unit in ("s", "m") and ":" not in key else key.replace("_", " ")


def _value(value: Any) -> str:
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return "–"
    return f"{value:.1f}".removesuffix(".0") if isinstance(value, float) and abs(value) >= 100 else _short(value)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
