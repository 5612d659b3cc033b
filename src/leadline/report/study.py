"""A study as tables for a terminal and as a page: every mission and configuration, pairs, bars, and errors over time with their bound."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from leadline.report.compare import style_of
from leadline.report.drawing import GREY, Clock, Figure, Panel, band, line, stacked
from leadline.report.figures import DEGREE
from leadline.report.page import Section, page_of
from leadline.report.sheet import Sheet
from leadline.report.tables import Grid, number
from leadline.report.text import row_style

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.console import Group

    from leadline.assess.intervals import Interval
    from leadline.data.records import Array
    from leadline.missions.study import Results
    from leadline.missions.summary import Summary
    from leadline.report.drawing import Trace

QUANTITIES = {"horizontal": ("m", 1.0), "depth": ("m", 1.0), "velocity": ("m/s", 1.0), "heading": ("°", DEGREE)}
COLUMNS = {"horizontal": (0, 1), "depth": (2,), "velocity": (3, 4, 5), "heading": (8,)}
BLOCKS = ("position", "velocity", "attitude")
MOST_FINDINGS = 12
FOOT = (
    "Intervals are 99 %; runs are independent, the times of one are not. Ratios are of root mean square errors on the same runs, judged "
    "together by Holm at 1 %.\nA bar is held where the interval of its statistic reaches the limit."
)


def interval_text(value: Interval | None, factor: float = 1.0) -> str:
    """Write an estimate with the ends of its interval, or a dash."""
    if value is None or not isfinite(value.estimate):
        return "–"
    ends = (
        f"{number(factor * value.low)} to {number(factor * value.high)}"
        if isfinite(value.high)
        else f"{number(factor * value.low)} or more"
    )
    return f"{number(factor * value.estimate)} ({ends})"


def study_grids(found: Results) -> list[Grid]:
    """Return what a study found as tables for a terminal; empty ones are left out, as are pairs that are alike but in the horizontal."""
    grids = [grid for mission in found.missions for grid in _mission_grids(found, mission)]
    grids += [_pair_grid(found, brief=True), _bar_grid(found), _refusal_grid(found)]
    return [grid for grid in grids if grid.rows]


def _of(found: Results, mission: str) -> list[Summary]:
    return [found.summaries[mission, one.name] for one in found.configurations]


def _mission_grids(found: Results, mission: str) -> Iterator[Grid]:
    """Yield errors, consistency and bound of one mission."""
    rows, marks = [], []
    for s in _of(found, mission):
        sizes = [interval_text(s.statistics.get(f"rmse_{q}"), factor) for q, (_, factor) in QUANTITIES.items()]
        cost = s.statistics.get("cost_us_per_s")
        rows.append((s.configuration, f"{len(s.numbers)} of {s.runs}", *sizes, "–" if cost is None else number(cost.estimate)))
        marks.append(s.answer.name.lower())
    columns = ("configuration", "runs>", *(f"{q} RMSE ({unit})>" for q, (unit, _) in QUANTITIES.items()), "µs per s>")
    yield Grid(columns, rows, f"{mission}: errors", marks, "", ("µs per s>", columns[4], columns[3]))
    yield _consistency_grid(found, mission)
    yield _nis_grid(found, mission)
    yield _bound_grid(found, mission)


def _consistency_grid(found: Results, mission: str) -> Grid:
    """Return ANEES with its interval, the share of times in its band, and the answer of all runs together."""
    rows, marks = [], []
    for s in _of(found, mission):
        told = [interval_text(s.statistics.get(f"anees_{block}")) for block in BLOCKS]
        shares = [_percent(s.statistics.get(f"in_band_{block}")) for block in BLOCKS]
        rows.append((s.configuration, s.answer.value if s.numbers else "–", *told, *shares))
        marks.append(s.answer.name.lower())
    columns = ("configuration", "answer", *(f"NEES {b}>" for b in BLOCKS), *(f"{b} in band>" for b in BLOCKS))
    note = "NEES per degree of freedom: 1 is to be expected. In band: share of times at which its mean over runs lies where 95 % should."
    return Grid(columns, rows, f"{mission}: consistency", marks, note, columns[:4:-1])


def _estimate(value: Interval | None) -> str:
    return "–" if value is None else number(value.estimate)


def _percent(value: Interval | None) -> str:
    return "–" if value is None or not isfinite(value.estimate) else f"{100 * value.estimate:.0f} %"


def _nis_grid(found: Results, mission: str) -> Grid:
    summaries = _of(found, mission)
    sensors = list(dict.fromkeys(name for s in summaries for name in s.statistics if name.startswith("nis_")))
    rows = [(s.configuration, *(_estimate(s.statistics.get(name)) for name in sensors)) for s in summaries if s.numbers]
    columns = ("configuration", *(f"{name.removeprefix('nis_')}>" for name in sensors))
    note = "1 is to be expected, more is a sigma too small; intervals are in study.json."
    return Grid(columns, rows if sensors else [], f"{mission}: NIS per degree of freedom, corrected for the gate", (), note)


def _bound_grid(found: Results, mission: str) -> Grid:
    rows = []
    for s in _of(found, mission):
        ratios = [interval_text(s.statistics.get(f"rmse_{q}_over_bound")) for q in QUANTITIES]
        rows.append((s.configuration, *ratios))
    none = list(dict.fromkeys(f"{s.configuration}: {s.no_bound}" for s in _of(found, mission) if s.no_bound))
    note = f"No bound: {'; '.join(none)}." if none else ""
    return Grid(("configuration", *(f"{q}>" for q in QUANTITIES)), rows, f"{mission}: RMSE over the Cramér-Rao bound", (), note)


def _pair_grid(found: Results, *, brief: bool = False) -> Grid:
    rows, marks = [], []
    for p in found.pairs:
        if isfinite(p.found.ratio.estimate) and (p.differs or p.quantity == "horizontal" or not brief):
            size = "smaller" if p.found.ratio.estimate < 1.0 else "larger"
            rows.append(
                (p.mission, p.configuration, p.quantity, interval_text(p.found.ratio), number(p.found.p, 2), size if p.differs else "alike")
            )
            marks.append("inconsistent" if p.differs else "")
    first = found.configurations[0].name
    return Grid(("mission", "configuration", "of", "ratio>", "p>", "Holm"), rows, f"RMSE over that of {first}, on the same runs", marks)


def _bar_grid(found: Results) -> Grid:
    words = {True: "held", False: "missed", None: "not judged"}
    rows = [(o.sentence, words[o.held]) for o in found.outcomes]
    marks = ["consistent" if o.held else "too_few" if o.held is None else "inconsistent" for o in found.outcomes]
    return Grid(("what", "bar"), rows, "Bars", marks)


def _refusal_grid(found: Results) -> Grid:
    rows = []
    for s in found.summaries.values():
        rows += [(s.mission, s.configuration, f"{count}", why) for why, count in s.refused.items()]
        if s.lost:
            rows.append((s.mission, s.configuration, f"{s.lost}", "lost: states that are no numbers; left out of all statistics above"))
    return Grid(("mission", "configuration", "runs>", "what"), rows, "Refused and lost")


def study_text(name: str, found: Results) -> Group:
    """Return a study for a rich console."""
    from rich.console import Group
    from rich.text import Text

    head = f"{name}: {len(found.missions)} missions, {len(found.configurations)} configurations, {len(found.numbers)} runs of each"
    return Group(Text(head + "\n", style="bold"), *(Sheet(grid, row_style) for grid in study_grids(found)))


def study_page(name: str, note: str, found: Results) -> str:
    """Return a study as the text of an HTML page that needs no network."""
    outcomes = found.outcomes
    lines = [("missions", str(len(found.missions))), ("configurations", str(len(found.configurations)))]
    lines.append(("runs of each", str(len(found.numbers))))
    if outcomes:
        lines.append(("bars held", f"{sum(o.held is True for o in outcomes)} of {len(outcomes)}"))
    return page_of(name, note or "Study", lines, list(_sections(found)), FOOT)


def _sections(found: Results) -> Iterator[Section]:
    for key, title, grid in (("bars", "Bars", _bar_grid(found)), ("pairs", "Side by side", _pair_grid(found))):
        if grid.rows:
            yield Section(key, title, grids=[grid])
    for k, mission in enumerate(found.missions):
        grids = [grid for grid in _mission_grids(found, mission) if grid.rows]
        text = "Root mean square over runs; dotted: the bound. NEES: mean over runs of position, per degree of freedom, with its 95 % band."
        summaries = _of(found, mission)
        drawn = [("", time_figure(summaries))] if any(s.numbers for s in summaries) else []
        yield Section(f"mission-{k}", mission, text, drawn, grids)
    for key, grid in (("findings", _finding_grid(found)), ("refused", _refusal_grid(found))):
        if grid.rows:
            yield Section(key, grid.title, grids=[grid])


def _finding_grid(found: Results) -> Grid:
    rows = []
    for s in found.summaries.values():
        rows += [(s.mission, s.configuration, sentence) for sentence in s.findings[:MOST_FINDINGS]]
        if len(s.findings) > MOST_FINDINGS:
            rows.append((s.mission, s.configuration, f"… and {len(s.findings) - MOST_FINDINGS} more, in study.json."))
    return Grid(("mission", "configuration", "what"), rows, "What all runs together hold against the vehicle files")


def time_figure(summaries: Sequence[Summary]) -> Figure:
    """Return root mean square errors and the mean NEES over time, one colour for each configuration, with bound and band."""
    longest = max((s.time for s in summaries), key=len)
    clock = Clock(60.0, "time since the start (min)", (float(longest[0]) / 60.0, float(longest[-1]) / 60.0))
    panels = []
    for quantity, (unit, factor) in QUANTITIES.items():
        traces: list[Trace] = []
        for k, s in enumerate(summaries):
            traces += _size_traces(s, quantity, factor, clock, style_of(k), legend=quantity == "horizontal")
        panels.append(Panel(f"{quantity}, RMS ({unit})", traces))
    panels.append(Panel("NEES of position", list(_nees_traces(summaries, clock)), lines=(1.0,)))
    return stacked(panels, clock, "study", each=170)


def _size_traces(s: Summary, quantity: str, factor: float, clock: Clock, style: tuple[str, str], *, legend: bool) -> list[Trace]:
    if not s.numbers:
        return []
    columns, (color, dash), x = list(COLUMNS[quantity]), style, clock(s.time)
    group = {"legendgroup": s.configuration}
    traces = [line(x, factor * _joined(s.rmse[:, columns]), color, s.configuration, dash=dash, legend=legend) | group]
    if s.bound_sigma is not None:
        size = factor * _joined(s.bound_sigma[:, columns])
        traces.append(line(x, size, color, f"{s.configuration}, bound", width=1.0, dash="dot") | group)
    return traces


def _joined(parts: Array) -> Array:
    return np.asarray(np.linalg.norm(parts, axis=1))


def _nees_traces(summaries: Sequence[Summary], clock: Clock) -> Iterator[Trace]:
    for k, s in enumerate(summaries):
        if s.numbers and "position" in s.nees:
            if k == 0:
                low, high = s.bands["position"]
                yield band(clock(s.time), low / 3.0, high / 3.0) | {"fillcolor": GREY + "33"}
            color, dash = style_of(k)
            yield line(clock(s.time), s.nees["position"] / 3.0, color, dash=dash) | {"legendgroup": s.configuration}
