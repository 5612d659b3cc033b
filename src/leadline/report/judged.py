"""Figures of what was judged: residuals of each sensor in units of their predicted sigma, and the normalised innovations squared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.data.outcome import Outcome
from leadline.report.drawing import BLUE, GREY, VERMILLION, Clock, Figure, Panel, band, line, markers, spaced, stacked

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from leadline.data.records import Array
    from leadline.data.solution import Innovations, Solution
    from leadline.report.drawing import Trace

EDGE = 6.0  # sigma, at which a residual's panel ends; what lies beyond is drawn at the edge, with its number under the pointer
MARKS = 12_000  # points of all panels together
LOST_MARKS = 4_000  # of them that were not used, each with its words
WINDOW = 20  # groups at least in a running mean
PAUSE = 20.0  # median intervals without a group, over which no line is drawn


def residual_figures(solution: Solution, clock: Clock) -> dict[str, Figure]:
    """Return one figure for each sensor instance, with a panel for each of its components."""
    table = solution.innovations
    looked = table.select((table.component != "") & np.isfinite(table.residual) & (table.sigma > 0.0))
    keys = list(dict.fromkeys(zip(looked.sensor.tolist(), looked.component.tolist(), strict=True)))
    most = int(np.clip(MARKS / max(len(keys), 1), 200, 2_000))
    figures = {}
    for sensor in dict.fromkeys(name for name, _ in keys):
        mine = looked.select(looked.sensor == sensor)
        parts = [(name, mine.select(mine.component == name)) for of, name in keys if of == sensor]
        panels = [
            Panel(f"{name}: residual / σ", list(_residual_traces(part, clock, most)), (-EDGE, EDGE), (-3.0, 0.0, 3.0))
            for name, part in parts
        ]
        figures[sensor] = stacked(panels, clock, f"residual-{sensor}", each=130)
    return figures


def _residual_traces(part: Innovations, clock: Clock, most: int) -> Iterator[Trace]:
    used = part.outcome == Outcome.USED
    gated = part.outcome == Outcome.GATED
    chosen = part.select(np.flatnonzero(used)[spaced(int(used.sum()), most)])
    if len(chosen):
        yield _residual_marks(chosen, clock, BLUE, "used", "circle", 3.2)
    for mask, color, name, symbol in ((gated, VERMILLION, "gated", "x"), (~used & ~gated, GREY, "not used", "square-open")):
        lost = part.select(np.flatnonzero(mask)[spaced(int(mask.sum()), most * LOST_MARKS // MARKS)])
        if len(lost):
            yield _residual_marks(lost, clock, color, name, symbol, 7.0)


def _residual_marks(part: Innovations, clock: Clock, color: str, name: str, symbol: str, size: float) -> Trace:
    ratio = part.residual / part.sigma
    text = [_told(part, k, float(ratio[k])) for k in range(len(part))] if name != "used" else []
    return markers(clock(part.time), np.clip(ratio, -0.96 * EDGE, 0.96 * EDGE), color, name, symbol=symbol, size=size, text=text)


def _told(part: Innovations, k: int, ratio: float) -> str:
    sentence = list(Outcome)[int(part.outcome[k])].sentence
    numbers = f"residual {part.residual[k]:.4g}, {ratio:.1f} σ; nis {part.nis[k]:.1f} of {part.dof[k]}"
    return f"row {part.row[k]} at {part.time[k]:.1f} s<br>{numbers}<br>{sentence}"


def nis_figure(solution: Solution, clock: Clock) -> Figure | None:
    """Return NIS per degree of freedom of each sensor's groups with a running mean and the band in which 99 % of it should lie."""
    table = solution.innovations
    judged = table.select((table.component != "") & np.isfinite(table.nis) & (table.dof > 0) & (table.outcome == Outcome.USED))
    sensors = list(dict.fromkeys(judged.sensor.tolist()))
    most = int(np.clip(MARKS / max(len(sensors), 1), 200, 2_000))
    panels = [_nis_panel(sensor, judged.select(judged.sensor == sensor), clock, most) for sensor in sensors]
    return stacked(panels, clock, "nis", each=140) if panels else None


def _nis_panel(sensor: str, mine: Innovations, clock: Clock, most: int) -> Panel:
    groups = mine.select(np.unique(mine.group, return_index=True)[1])
    groups = groups.select(np.argsort(groups.time, kind="stable"))
    ratio, x = groups.nis / groups.dof, clock(groups.time)
    top, traces = 4.0, []
    if len(groups) >= WINDOW:
        low, high, mean, index = _running(groups, ratio, most)
        top = float(np.clip(1.3 * max(mean.max(), high.max()), 3.0, 12.0))
        steps = np.diff(groups.time[index], prepend=groups.time[index[0]])
        low, mean = (np.where(steps > PAUSE * np.median(steps), np.nan, v) for v in (low, mean))
        traces = [band(x[index], low, high, "99 % of the running mean"), line(x[index], mean, BLUE, "running mean", width=1.8)]
    shown = spaced(len(groups), most)
    dots = markers(x[shown], np.minimum(ratio[shown], 0.97 * top), "rgba(34,34,34,0.28)", "NIS / dof", size=3)
    return Panel(f"{sensor}: NIS per degree of freedom", [dots, *traces], (0.0, top), (1.0,))


def _running(groups: Innovations, ratio: Array, most: int) -> tuple[Array, Array, Array, npt.NDArray[np.int64]]:
    """Return the lower and upper end of the band, the running mean, and the groups at which it ends its windows."""
    from scipy.special import gammaincinv

    window = max(WINDOW, len(groups) // 50)
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (ratio * groups.dof, groups.dof)]
    nis, dof = (v[window:] - v[:-window] for v in sums)
    index = spaced(len(nis), most)
    low, high = (2.0 * gammaincinv(0.5 * dof[index], q) / dof[index] for q in (0.005, 0.995))
    return low, high, nis[index] / dof[index], index + window // 2
