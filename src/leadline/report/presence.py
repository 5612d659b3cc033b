"""When each table of a log speaks: a bar for each, broken where it is silent, with the rows that are doubtful, and its figures."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.data.inspection import GAP
from leadline.data.records import Truth
from leadline.data.rows import ascending
from leadline.report.drawing import BLUE, PURPLE, VERMILLION, Panel, line, markers, spaced, stacked
from leadline.report.tables import Grid, number
from leadline.report.tracks import extra_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from leadline.data.inspection import Facts, Inspection
    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.report.drawing import Clock, Figure, Trace

FINEST = 1_500  # parts of the time axis: shorter silences are not drawn
MOST_MARKS = 1_500  # of one table
SHARE = 0.2  # of the rows of such a part, that is marked when it is bad
OUTLIERS, INVALID = "marked as outliers", "invalid"
THICK = 9  # pixels
LANE = 24  # pixels for each table


def presence_figure(log: Log, inspection: Inspection, clock: Clock) -> Figure:
    """Return a lane for each table over the time of the log."""
    names = list(log.tables)
    span = (clock.range[1] - clock.range[0]) * clock.scale
    traces: list[Trace] = []
    for lane, name in enumerate(names):
        traces += _lane(log.tables[name], inspection.tables[name], float(lane), clock, span)
    for color, what in ((PURPLE, OUTLIERS), (VERMILLION, INVALID)):
        if any(trace["name"] == what for trace in traces):
            traces.append(markers(np.array([np.nan]), np.array([np.nan]), color, what, symbol="line-ns-open", size=9, legend=True))
    panel = Panel("", traces, (len(names) - 0.4, -0.6), ticks=(list(range(len(names))), names))
    figure = stacked([panel], clock, "presence", each=LANE * len(names) + 20)
    wide = {"l": 22 + 7 * max(map(len, names), default=0)}
    yaxis = figure.layout["yaxis"] | {"gridcolor": "white", "ticks": "", "nticks": None}
    layout: dict[str, Any] = figure.layout | {"margin": figure.layout["margin"] | wide, "yaxis": yaxis}
    return replace(figure, layout=layout)


def _lane(table: Table, facts: Facts, lane: float, clock: Clock, span: float) -> Iterator[Trace]:
    time = ascending(table.time[np.isfinite(table.time)])
    if not len(time):
        return
    start, end = _stretches(time, max(GAP * facts.interval if isfinite(facts.interval) else 0.0, span / FINEST))
    single = end - start < span / FINEST
    bars = np.stack([start, end, np.full(len(start), np.nan)], axis=1)[~single].ravel()
    if len(bars):
        yield line(clock(bars), np.full(len(bars), lane), BLUE, "rows", width=THICK) | {"opacity": 0.55}
    if single.any():
        at = 0.5 * (start + end)[single]
        at = at[spaced(len(at), MOST_MARKS)]
        yield markers(clock(at), np.full(len(at), lane), BLUE, "rows", size=5) | {"opacity": 0.7}
    for bad, color, what in ((_invalid(table), VERMILLION, INVALID), (_outlier(table), PURPLE, OUTLIERS)):
        at = _often(table.time, bad, max(span, 1e-9) / FINEST)
        if len(at):
            yield markers(clock(at), np.full(len(at), lane), color, what, symbol="line-ns-open", size=9)


def _often(time: Array, bad: npt.NDArray[np.bool_], width: float) -> Array:
    """Return the middle of each part of the time axis in which at least `SHARE` of the rows are bad."""
    known = np.isfinite(time)
    if not bad[known].any():
        return np.empty(0)
    part, where = np.unique(np.floor(time[known] / width), return_inverse=True)
    share = np.bincount(where, bad[known]) / np.bincount(where)
    return np.asarray((part[share >= SHARE] + 0.5) * width)


def _invalid(table: Table) -> npt.NDArray[np.bool_]:
    return np.zeros(len(table), bool) if table.valid is None else table.valid == 0.0


def _outlier(table: Table) -> npt.NDArray[np.bool_]:
    marked = table.outlier if isinstance(table, Truth) and table.outlier is not None else extra_of(table, "outlier")
    return np.asarray(np.nan_to_num(marked) > 0.0)


def _stretches(time: Array, longest: float) -> tuple[Array, Array]:
    """Return start and end of each stretch of ascending times without a longer silence."""
    cuts = np.flatnonzero(np.diff(time) > longest)
    return time[np.concatenate([[0], cuts + 1])], time[np.concatenate([cuts, [len(time) - 1]])]


def table_grid(log: Log, inspection: Inspection) -> Grid:
    """Return kind, rows, rate, span, gaps and doubtful rows of each table."""
    rows = [(name, *_cells(log.tables[name], facts)) for name, facts in inspection.tables.items()]
    columns = ("table", "kind", "rows>", "rate (1/s)>", "from (s)>", "to (s)>", "gaps>", "longest>", "at (s)>", "invalid>", "outliers>")
    note = f"Rate: by the median interval between different times. A gap is an interval of more than {GAP:g} times that."
    return Grid(columns, rows, "Tables", (), note)


def _cells(table: Table, facts: Facts) -> tuple[str, ...]:
    times = (f"{t:,.1f}" if isfinite(t) else "" for t in (facts.first, facts.last))
    longest = f"{number(facts.longest_gap)} s" if isfinite(facts.longest_gap) else ""
    at = f"{facts.longest_gap_at:,.1f}" if isfinite(facts.longest_gap_at) else ""
    counts = (f"{n:,}" if n else "" for n in (facts.invalid, int(_outlier(table).sum())))
    rate = number(facts.rate, 4) if isfinite(facts.rate) else ""
    return facts.kind, f"{facts.rows:,}", rate, *times, f"{facts.gaps:,}" if facts.gaps else "", longest, at, *counts


def finding_grid(inspection: Inspection) -> Grid:
    """Return what an inspection finds, the worst first."""
    rows = [(finding.severity, finding.table, finding.sentence) for finding in inspection.findings]
    marks = ["first" if k and row[0] != rows[k - 1][0] else "" for k, row in enumerate(rows)]
    return Grid(("severity", "table", "what"), rows, "Findings", marks)
