"""Configurations on one log side by side: tables for a terminal, and a page with all tracks on one map and all errors over time."""

from __future__ import annotations

from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.report.drawing import (
    BLACK,
    CYCLE,
    MARGIN,
    MOST_POINTS,
    Clock,
    Figure,
    Panel,
    axis,
    band,
    clock_of,
    common,
    extremes,
    line,
    markers,
    points_per_line,
    spaced,
    stacked,
)
from leadline.report.figures import DEGREE
from leadline.report.page import Section, page_of
from leadline.report.sheet import Sheet
from leadline.report.tables import Grid, number
from leadline.report.text import STYLES, row_style
from leadline.report.tracks import beacon_places, frame_of, position_fixes, track_of_solution, track_of_truth

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.console import Group

    from leadline.assess.errors import Errors, Spread
    from leadline.data.records import Array
    from leadline.missions.compare import Compared, Comparison
    from leadline.report.drawing import Trace

FACTOR = {"horizontal": 1.0, "depth": 1.0, "velocity": 1.0, "heading": DEGREE}
UNIT = {"horizontal": "m", "depth": "m", "velocity": "m/s", "heading": "°"}
PANELS = (
    ("north (m)", 0, 1.0), ("east (m)", 1, 1.0), ("down (m)", 2, 1.0), ("velocity north (m/s)", 3, 1.0), ("velocity east (m/s)", 4, 1.0),
    ("velocity down (m/s)", 5, 1.0), ("heading (°)", 8, DEGREE),
)  # fmt: skip
DASHES = ("solid", "dash", "dot", "dashdot")  # once the colours are used up
SOFT = "26"  # how much of a band shines through, as a colour's fourth byte
FIX_MARKS = 1_500
FOOT = (
    "Errors are truth minus estimate, north-east-down; heading in degrees. Bands are three sigma to either side of zero.\n"
    "Cost is the time of solving alone, compiled beforehand, on the machine that made this page; long series are thinned for drawing."
)

ALIKE = 0.02  # of an RMS of one dive: less says nothing


def comparison_grids(found: Comparison) -> list[Grid]:
    """Return what is told of the runs as tables: errors, consistency, misclosure, differences and cost; empty ones are left out."""
    grids = [_error_grid(found), _consistency_grid(found), _misclosure_grid(found), _difference_grid(found), _cost_grid(found)]
    return [grid for grid in grids if grid.rows]


def _error_grid(found: Comparison) -> Grid:
    names = list(FACTOR)
    columns = ("run", *(f"{name} {what} ({UNIT[name]})>" for name in names for what in ("RMS", "end")))
    rows = [(run.name, *_pairs(run.score.errors)) for run in found.solved if run.score.errors]
    return Grid(columns, rows, "Errors against truth", least=tuple(c for c in reversed(columns) if " end " in c))


def _pairs(spreads: Mapping[str, Spread], other: str = "end") -> list[str]:
    """Return RMS and another statistic of each size."""
    told = []
    for name, factor in FACTOR.items():
        one = spreads.get(name)
        told += [number(factor * value) for value in ((one.rms, getattr(one, other)) if one else (nan, nan))]
    return told


def _consistency_grid(found: Comparison) -> Grid:
    blocks, names = ("position", "velocity", "attitude"), list(FACTOR)
    columns = ("run", "answer", *(f"NEES {block}>" for block in blocks), *(f"{name} inside 3σ>" for name in names))
    rows, marks = [], []
    for run in found.solved:
        assert run.assessment is not None
        answer = run.assessment.verdict.answer
        inside = [f"{100 * share:.1f} %" if isfinite(share := run.score.inside.get(name, nan)) else "–" for name in names]
        rows.append((run.name, answer.value, *(number(run.score.nees.get(block, nan)) for block in blocks), *inside))
        marks.append(answer.name.lower())
    note = "NEES per degree of freedom: 1 is to be expected, more is an error bar too short."
    return Grid(columns, rows, "Consistency", marks, note, columns[:4:-1])


def _misclosure_grid(found: Comparison) -> Grid:
    missed = [(run.name, run.score.misclosure) for run in found.solved if run.score.misclosure is not None]
    rows = [(name, f"{m.count}", *map(number, (m.rms, m.median, m.maximum, m.end))) for name, m in missed]
    columns = ("run", "fixes>", "RMS (m)>", "median (m)>", "largest (m)>", "last (m)>")
    return Grid(columns, rows, "Misclosure at fixes", note="Of each fix that is the first after more than a minute.")


def _difference_grid(found: Comparison) -> Grid:
    columns = ("run", *(f"{name} {what} ({UNIT[name]})>" for name in FACTOR for what in ("RMS", "largest")))
    rows = [(run.name, *_pairs(run.score.apart, "maximum")) for run in found.solved if run.score.apart]
    return Grid(columns, rows, f"Differences from {found.reference}", least=tuple(c for c in reversed(columns) if " largest " in c))


def _cost_grid(found: Comparison) -> Grid:
    rows = [(run.name, f"{run.cost:,.0f}" if isfinite(run.cost) else "–", run.refusal or "solved") for run in found.runs]
    return Grid(("run", "µs per s of data>", "what"), rows, "Cost")


def comparison_text(found: Comparison) -> Group:
    """Return a comparison for a rich console: the verdict of each run in a sentence, then the tables."""
    from rich.console import Group
    from rich.text import Text

    lines = []
    for run in found.runs:
        if run.assessment is None:
            lines.append(Text(f"{run.name}: refused: {run.refusal}", style="bold red"))
        else:
            verdict = run.assessment.verdict
            lines.append(Text(f"{run.name}: {verdict.sentence}", style=STYLES[verdict.answer]))
    return Group(*lines, Text(""), *(Sheet(grid, row_style) for grid in comparison_grids(found)))


def comparison_page(found: Comparison) -> str:
    """Return a comparison as the text of an HTML page that needs no network."""
    solved = found.solved
    first = solved[0].solution
    assert first is not None
    best = [run for run in solved if run.score.errors]
    lines = [("runs", str(len(found.runs))), ("refused", str(len(found.runs) - len(solved)))]
    if best:
        least = min(best, key=lambda run: run.score.errors["horizontal"].rms if "horizontal" in run.score.errors else np.inf)
        if "horizontal" in least.score.errors:
            lines += _least(least, best)
    else:
        lines.append(("truth", "none in the log: judge by innovations and misclosures"))
    when = f"Comparison · counted from {first.epoch:%Y-%m-%d %H:%M:%S} UTC"
    return page_of(found.log.name, when, lines, list(_sections(found)), FOOT)


def _least(least: Compared, runs: Sequence[Compared]) -> Iterator[tuple[str, str]]:
    """Yield which runs err least, those within `ALIKE` of each other together, and which of them costs least."""
    rms = least.score.errors["horizontal"].rms
    near = [run for run in runs if "horizontal" in run.score.errors and run.score.errors["horizontal"].rms <= (1.0 + ALIKE) * rms]
    names = ", ".join(run.name for run in near)
    yield "least horizontal RMS", f"{number(rms)} m: {names}" + (" (alike)" if len(near) > 1 else "")
    cheapest = min(near, key=lambda run: run.cost)
    assert cheapest.assessment is not None
    yield "the cheapest of these" if len(near) > 1 else "it is", f"{cheapest.name}: {cheapest.assessment.verdict.answer.value}"


def _sections(found: Comparison) -> Iterator[Section]:
    first = found.solved[0].solution
    assert first is not None
    clock = clock_of(first.time, first.epoch)
    yield Section("numbers", "Side by side", grids=comparison_grids(found))
    yield Section(
        "map", "Map", "Click a name to hide it; scroll or drag to look closer, double-click to see all.", [("", map_figure(found))]
    )
    known = [run for run in found.solved if run.assessment is not None and run.assessment.errors is not None]
    if known:
        text = "Lines: errors. Shaded: three sigma, as predicted, in the colour of the run; click a name to hide both."
        yield Section("errors", "Errors against truth", text, [("", error_figure(found, clock))])
    yield Section("depth", "Depth", "", [("", depth_figure(found, clock))])
    rows = [(run.name, run.assessment.verdict.sentence) for run in found.solved if run.assessment is not None]
    marks = [run.assessment.verdict.answer.name.lower() for run in found.solved if run.assessment is not None]
    yield Section("verdicts", "Verdicts", grids=[Grid(("run", "what"), rows, "Verdicts", marks)])
    yield Section("runs", "What was run", grids=[_how_grid(found.runs)])


def _how_grid(runs: Sequence[Compared]) -> Grid:
    rows = []
    for run in runs:
        one = run.configuration
        how = "smoothed" if one.smooth else "as live" if one.as_live else ""
        aided = "; ".join([*(f"only {name}" for name in one.only), *(f"without {name}" for name in one.without)])
        rows.append((run.name, one.process or "of the vehicle", one.estimator, how, aided, one.where))
    return Grid(("run", "process", "estimator", "how", "sensors", "from"), rows, "Configurations")


def style_of(number_of_run: int) -> tuple[str, str]:
    """Return colour and dash of a run by its number."""
    return CYCLE[number_of_run % len(CYCLE)], DASHES[(number_of_run // len(CYCLE)) % len(DASHES)]


def map_figure(found: Comparison) -> Figure:
    """Return the map with truth, beacons, fixes and the track of every run, in equal scale."""
    solutions = {run.name: run.solution for run in found.solved if run.solution is not None}
    frame = frame_of(found.log, solutions)
    truth = track_of_truth(found.log, frame)
    traces: list[Trace] = []
    for fixes in position_fixes(found.log, frame, truth):
        index = spaced(len(fixes.track), FIX_MARKS)
        traces.append(_dots(fixes.track.east[index], fixes.track.north[index], "#b9bec6", fixes.name, "circle-open"))
    if truth is not None:
        index = spaced(len(truth), MOST_POINTS)
        traces.append(line(truth.east[index], truth.north[index], BLACK, "truth", width=1.6, legend=True))
    for k, (name, solution) in enumerate(solutions.items()):
        track, (color, dash) = track_of_solution(name, solution, frame), style_of(k)
        index = spaced(len(track), MOST_POINTS)
        traces.append(line(track.east[index], track.north[index], color, name, width=1.6, dash=dash, legend=True))
    places = beacon_places(found.log, frame)
    if places:
        at = np.array(list(places.values()))
        traces.append(_dots(at[:, 1], at[:, 0], BLACK, "beacons", "star") | {"text": list(places)})
    layout: dict[str, Any] = {
        "xaxis": axis("east (m)"), "yaxis": axis() | {"scaleanchor": "x", "scaleratio": 1}, "margin": MARGIN | {"b": 110},
        "legend": {"orientation": "h", "x": 0, "y": -0.09, "yanchor": "top", "font": {"size": 11.5}}, "dragmode": "pan", "height": 680,
    }  # fmt: skip
    return Figure(traces, common() | layout, 680, "map")


def _dots(x: Array, y: Array, color: str, name: str, symbol: str) -> Trace:
    return markers(x, y, color, name, symbol=symbol, size=7, legend=True)


def error_figure(found: Comparison, clock: Clock) -> Figure:
    """Return the errors of every run over time within their bands, a panel for each component of which truth speaks."""
    known: list[tuple[int, str, Errors]] = []
    for k, run in enumerate(found.solved):
        if run.assessment is not None and run.assessment.errors is not None and len(run.assessment.errors):
            known.append((k, run.name, run.assessment.errors))
    most, told, panels = points_per_line(2 * len(PANELS) * max(len(known), 1)), set[str](), []
    for title, column, factor in PANELS:
        seen = [one for one in known if np.isfinite(one[2].error[:, column]).any()]
        traces: list[Trace] = []
        for k, name, errors in seen:
            traces += _error_traces(errors, column, factor, clock, most, style_of(k), name, name not in told)
            told.add(name)
        if traces:
            panels.append(Panel(title, traces, lines=(0.0,)))
    return stacked(panels, clock, "errors")


def _error_traces(
    errors: Errors, column: int, factor: float, clock: Clock, most: int, style: tuple[str, str], name: str, legend: bool
) -> list[Trace]:
    value, sigma = factor * errors.error[:, column], 3.0 * factor * errors.sigma[:, column]
    index = np.union1d(extremes(value, most // 2), extremes(sigma, most // 2)) if len(errors) > most else np.arange(len(errors))
    x, (color, dash) = clock(errors.time[index]), style
    around = band(x, -sigma[index], sigma[index]) | {"fillcolor": color + SOFT, "legendgroup": name}
    return [around, line(x, value[index], color, name, width=1.3, dash=dash) | {"legendgroup": name, "showlegend": legend}]


def depth_figure(found: Comparison, clock: Clock) -> Figure:
    """Return the depths of all runs over time, with that of truth."""
    most, traces = points_per_line(len(found.solved) + 1), []
    truth = found.log.truth
    if truth is not None and truth.depth is not None:
        index = extremes(truth.depth, most)
        traces.append(line(clock(truth.time[index]), truth.depth[index], BLACK, "truth", width=1.6, legend=True))
    for k, run in enumerate(found.solved):
        assert run.solution is not None
        index, (color, dash) = extremes(run.solution.depth, most), style_of(k)
        traces.append(line(clock(run.solution.time[index]), run.solution.depth[index], color, run.name, dash=dash, legend=True))
    return stacked([Panel("depth (m)", traces, reversed=True)], clock, "depth", each=220)
