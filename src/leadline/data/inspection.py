"""Inspection: what a log holds, table by table, and what looks wrong with it; nothing is changed."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.finding import Finding, numeric_columns, value_fields
from leadline.data.records import Imu, Other, Table, expand
from leadline.data.rows import ascending, complete

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from leadline.data.log import Log
    from leadline.data.records import Array

GAP = 3.0  # an interval this many times the median one is a gap
ALIKE = 0.8  # how like a column's name is to another that it may have been meant for (difflib)
RUNS = 10  # so many runs of equal values show that a value is held


@dataclass(frozen=True)
class Spread:
    """Least, median and greatest of the finite values."""

    minimum: float
    median: float
    maximum: float


@dataclass(frozen=True)
class Facts:
    """What one table holds: times in seconds; ranges by file column, in the unit that the column's name ends in."""

    kind: str
    rows: int
    first: float
    last: float
    interval: float  # the median one between different times
    jitter: float  # robust sigma of the intervals
    gaps: int
    longest_gap: float
    longest_gap_at: float
    duplicates: int  # rows that equal an earlier one in all columns
    out_of_order: int  # rows that stand after a later one
    clock_jumps: int  # backward steps of time against sequence or arrival
    largest_jump: float
    invalid: int  # rows that the sensor itself calls invalid
    held: Mapping[str, float]  # by field: how many rows a value stays
    not_measured: Mapping[str, int]  # by file column
    infinite: Mapping[str, int]
    ranges: Mapping[str, Spread]
    lag: Spread | None  # of received - time

    @property
    def rate(self) -> float:
        """Rows with different times per second (1/s), by the median interval."""
        return 1.0 / self.interval if self.interval > 0.0 else math.nan


@dataclass(frozen=True)
class Inspection:
    """Facts by table, and findings, the worst first."""

    name: str
    tables: Mapping[str, Facts]
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON types; what is not a number is None."""
        whole: dict[str, Any] = _plain(asdict(self))
        for name, facts in self.tables.items():
            whole["tables"][name]["rate"] = _plain(facts.rate)
        return whole


def inspect(log: Log) -> Inspection:
    """Look at every table of a log, alone and against the others; O(n log n), and nothing is changed."""
    from leadline.data.suspicion import suspicions

    tables = {name: _facts(table) for name, table in log.tables.items()}
    findings = [finding for name, facts in tables.items() for finding in _findings(name, facts, log.tables[name])]
    findings += suspicions(log)
    if not any(isinstance(table, Imu) for table in log.tables.values()):
        findings.append(Finding("note", "", "no table of kind imu: the process model `inertial` needs one"))
    order = ("problem", "suspicion", "note")
    return Inspection(log.name, tables, tuple(sorted(findings, key=lambda finding: order.index(finding.severity))))


def _facts(table: Table) -> Facts:
    time = table.time[np.isfinite(table.time)]
    unique = ascending(time)
    steps = np.diff(unique)
    interval = float(np.median(steps)) if len(steps) else math.nan
    gaps = np.flatnonzero(steps > GAP * interval)
    longest = gaps[np.argmax(steps[gaps])] if len(gaps) else None
    jumps = _clock_jumps(table)
    columns = [(name, values) for _, name, values in numeric_columns(table)]
    spread = {name: _spread(values) for name, values in columns if name != "time_s"}
    return Facts(
        kind=table.kind,
        rows=len(table),
        first=float(unique[0]) if len(unique) else math.nan,
        last=float(unique[-1]) if len(unique) else math.nan,
        interval=interval,
        jitter=1.4826 * float(np.median(np.abs(steps - interval))) if len(steps) else math.nan,
        gaps=len(gaps),
        longest_gap=math.nan if longest is None else float(steps[longest]),
        longest_gap_at=math.nan if longest is None else float(unique[longest]),
        duplicates=_duplicates(table),
        out_of_order=int(np.sum(np.diff(time) < 0.0)),
        clock_jumps=len(jumps),
        largest_jump=float(-jumps.min()) if len(jumps) else math.nan,
        invalid=0 if table.valid is None else int(np.sum(table.valid == 0.0)),
        held={name: k for name in value_fields(table) if (k := _rows_held(getattr(table, name))) > 1.0},
        not_measured={name: n for name, values in columns if (n := int(np.sum(np.isnan(values))))},
        infinite={name: n for name, values in columns if (n := int(np.sum(np.isinf(values))))},
        ranges={name: s for name, s in spread.items() if s is not None},
        lag=None if table.received is None else _spread(table.received - table.time),
    )


def _spread(values: Array) -> Spread | None:
    finite = values[np.isfinite(values)]
    return Spread(float(finite.min()), float(np.median(finite)), float(finite.max())) if len(finite) else None


def _duplicates(table: Table) -> int:
    """Count the rows that equal an earlier one in all columns; only rows of one time can, so only those are compared."""
    if (np.diff(table.time) > 0.0).all():
        return 0
    _, where, counts = np.unique(table.time, return_inverse=True, return_counts=True)
    rows = np.flatnonzero(counts[where] > 1)
    if not len(rows):
        return 0
    columns = [values[rows] for _, _, values in numeric_columns(table)]
    texts = [getattr(table, item.name) for item in table.columns() if item.metadata["text"]]
    texts += [values for values in table.extra.values() if values.dtype.kind != "f"]
    columns += [values[rows] for values in texts if values is not None]
    codes = np.stack([np.unique(values, return_inverse=True)[1] for values in columns], axis=1)
    return len(rows) - len(np.unique(codes, axis=0))


def _clock_jumps(table: Table) -> Array:
    """Return the backward steps of time (s), below the usual latency, in the order of the sequence number or of arrival."""
    order = table.sequence if table.sequence is not None else table.received
    if order is None:
        return np.empty(0)
    known = np.isfinite(order) & np.isfinite(table.time)
    time = table.time[known][np.argsort(order[known], kind="stable")]
    lag = np.nan_to_num(np.median(table.received[known] - table.time[known])) if table.received is not None and known.any() else 0.0
    steps = np.diff(time)
    return np.asarray(steps[steps < -max(float(lag), 0.0)])


def _rows_held(values: Array) -> float:
    """Return how many rows a value stays before it changes, or 1: runs of equal values must be many and of equal length."""
    rows = values[:, None] if values.ndim == 1 else values
    rows = rows[complete(rows)]
    changes = rows[1:] != rows[:-1]
    runs = np.diff(np.flatnonzero(np.logical_or.reduce([changes[:, j] for j in range(rows.shape[1])])))
    if len(runs) < RUNS or np.mean(runs) < 1.8 or np.mean(np.abs(runs - np.mean(runs)) <= 1.0) < 0.9:
        return 1.0
    return float(np.mean(runs))


def _findings(name: str, facts: Facts, table: Table) -> Iterator[Finding]:
    """Yield what the facts of one table say by themselves."""
    if isinstance(table, Other):
        yield Finding("note", name, "is of a kind that Leadline does not know: carried as its columns (log.toml can say its kind)")
    if facts.rows == 0:
        yield Finding("problem", name, "has no row")
    yield from _near_misses(name, table)
    yield from _findings_of_values(name, facts, table)
    yield from _findings_of_time(name, facts)
    yield from _findings_of_order(name, facts)


def _near_misses(name: str, table: Table) -> Iterator[Finding]:
    """Columns that are carried, not used, and all but spell one that the kind has and the table lacks."""
    lacking = [item.metadata["pattern"] for item in table.columns() if getattr(table, item.name) is None]
    columns = [column for pattern in lacking for column in expand(pattern, [])]
    for column in table.extra:
        if near := get_close_matches(column, columns, 5, ALIKE):
            meant = min(near, key=lambda known: abs(len(known) - len(column)))
            yield Finding("suspicion", name, f"{column}: carried, not used; did you mean {meant}?")


def _findings_of_values(name: str, facts: Facts, table: Table) -> Iterator[Finding]:
    for column, n in facts.infinite.items():
        yield Finding("problem", name, f"{column} is infinite in {_count(n, 'row')}", {"rows": n})
    measured = {column for group, column, _ in numeric_columns(table) if group in value_fields(table)}
    missing = {column: n for column, n in facts.not_measured.items() if column in measured}
    if missing:
        column, n = max(missing.items(), key=lambda item: item[1])
        yield Finding("note", name, f"{column} is not measured in {n} of {facts.rows} rows ({n / facts.rows:.1%})", {"rows": n})
    if facts.invalid:
        yield Finding("note", name, f"{facts.invalid} of {facts.rows} rows are marked invalid by the sensor", {"rows": facts.invalid})
    for group, k in facts.held.items():
        sentence = f"{group} changes only every {k:.3g} rows: held between measurements (say repeats = 'held'), or coarsely rounded"
        yield Finding("suspicion", name, sentence, {"rows": k})


def _findings_of_time(name: str, facts: Facts) -> Iterator[Finding]:
    if n := facts.not_measured.get("time_s", 0):
        yield Finding("problem", name, f"{_count(n, 'row')} without a time", {"rows": n})
    if facts.gaps and facts.jitter < 0.3 * facts.interval and facts.gaps < 0.05 * facts.rows:  # irregular tables have no usual interval
        sentence = f"{_count(facts.gaps, 'gap')} beyond {GAP:g} times the usual interval of {facts.interval:.4g} s; the longest lasts "
        sentence += f"{facts.longest_gap:.4g} s from {facts.longest_gap_at:.3f} s"
        yield Finding("note", name, sentence, {"gaps": facts.gaps, "longest_s": facts.longest_gap, "at_s": facts.longest_gap_at})


def _findings_of_order(name: str, facts: Facts) -> Iterator[Finding]:
    if n := facts.duplicates:
        yield Finding("note", name, f"{_count(n, 'row')} repeating another in all columns, which count once", {"rows": n})
    if n := facts.out_of_order:
        yield Finding("note", name, f"{_count(n, 'backward step')} of time in the order of rows, which carries no meaning", {"steps": n})
    if n := facts.clock_jumps:
        sentence = f"{_count(n, 'backward step')} of its clock against the order of arrival, by up to {facts.largest_jump:.4g} s"
        yield Finding("problem", name, sentence, {"steps": n, "largest_s": facts.largest_jump})
    if facts.lag is not None and facts.lag.minimum < -1e-3:
        sentence = f"arrives up to {-facts.lag.minimum:.4g} s before its time of validity"
        yield Finding("suspicion", name, sentence, {"lag_s": facts.lag.minimum})


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
