"""Plotly figures as plain dictionaries: stacked panels over time, bands, thinned lines, and colours that the colour-blind can tell apart.

Plotly itself is not imported: a figure is JSON with numbers as base64 float32, which keeps a report small.
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from leadline.data.records import Array

Trace: TypeAlias = dict[str, Any]

# Okabe and Ito (2008)
BLUE, ORANGE, GREEN, VERMILLION, SKY, PURPLE, BLACK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#222222"
GREY, PALE = "#8a8f98", "rgba(0,114,178,0.16)"
CYCLE = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
BUDGET = 45_000  # points of all lines of a report together, before bands
MOST_POINTS, FEWEST_POINTS = 4_000, 300  # of one line
BREAK = np.array([np.nan])  # in a line
MARGIN = {"l": 58, "r": 14, "t": 30, "b": 44}


@dataclass(frozen=True)
class Clock:
    """The time axis of a report: seconds are divided by `scale`; `range` is what all figures show, in its unit."""

    scale: float
    title: str
    range: tuple[float, float]

    def __call__(self, time: Array) -> Array:
        """Return times in the unit of the axis."""
        return time / self.scale


@dataclass(frozen=True)
class Panel:
    """One of several plots above each other: a title with its unit, traces, and the range of its axis where it is not free."""

    title: str
    traces: Sequence[Trace]
    range: tuple[float, float] | None = None
    lines: Sequence[float] = ()
    reversed: bool = False
    ticks: tuple[Sequence[float], Sequence[str]] | None = None


@dataclass(frozen=True)
class Figure:
    """A figure as plotly's JavaScript takes it, and its height in pixels."""

    data: Sequence[Trace]
    layout: dict[str, Any]
    height: int
    name: str = ""
    notes: Sequence[str] = field(default_factory=tuple)


def clock_of(time: Array, epoch: Any) -> Clock:
    """Choose seconds, minutes or hours for the time axis of a run."""
    start, end = (float(time[0]), float(time[-1])) if len(time) else (0.0, 0.0)
    span = end - start
    scale, unit = (1.0, "s") if span < 300 else (60.0, "min") if span < 4 * 3600 else (3600.0, "h")
    return Clock(scale, f"time since {epoch:%Y-%m-%d %H:%M:%S} UTC ({unit})", ((start - 0.01 * span) / scale, (end + 0.01 * span) / scale))


def points_per_line(lines: int) -> int:
    """Return how many points a line may have in a report of so many lines."""
    return int(min(MOST_POINTS, max(FEWEST_POINTS, BUDGET / max(lines, 1))))


def spaced(count: int, most: int) -> npt.NDArray[np.int64]:
    """Return every k-th index of a sequence and its last, at most about `most`."""
    step = max(1, -(-count // max(most, 1)))
    index = np.arange(0, count, step)
    return np.append(index, count - 1) if count and index[-1] != count - 1 else index


def extremes(values: Array, most: int) -> npt.NDArray[np.int64]:
    """Return indices of the lowest and highest value in each of most / 2 stretches, in order, so that no spike is lost."""
    count = len(values)
    if count <= most:
        return np.arange(count)
    starts = np.linspace(0, count, max(most // 2, 1), endpoint=False).astype(np.int64)
    width = np.diff(np.append(starts, count))
    low, high = (np.where(np.isfinite(values), values, fill) for fill in (np.inf, -np.inf))
    at_low, at_high = (
        np.array([s + f(v[s : s + w]) for s, w in zip(starts, width, strict=True)]) for f, v in ((np.argmin, low), (np.argmax, high))
    )
    return np.unique(np.concatenate([at_low, at_high, [0, count - 1]]))


def packed(values: Array) -> dict[str, str]:
    """Return numbers as plotly's typed array, float32."""
    return {"dtype": "f4", "bdata": b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")}


def line(x: Array, y: Array, color: str, name: str = "", *, width: float = 1.4, dash: str = "solid", legend: bool = False) -> Trace:
    """Return a line; nan breaks it."""
    style = {"color": color, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": packed(x), "y": packed(y), "line": style, "name": name, "showlegend": legend}


def markers(
    x: Array,
    y: Array,
    color: str,
    name: str = "",
    *,
    symbol: str = "circle",
    size: float = 4,
    text: Sequence[str] = (),
    legend: bool = False,
) -> Trace:
    """Return points, with a text each to show under the pointer."""
    trace: Trace = {
        "type": "scatter", "mode": "markers", "x": packed(x), "y": packed(y), "name": name, "showlegend": legend,
        "marker": {"color": color, "symbol": symbol, "size": size},
    }  # fmt: skip
    if len(text):
        trace |= {"text": list(text), "hovertemplate": "%{text}<extra></extra>"}
    return trace


def band(x: Array, low: Array, high: Array, name: str = "") -> Trace:
    """Return the area between two lines, interrupted where either is nan."""
    good = np.isfinite(low) & np.isfinite(high)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    outline_x: list[Array] = []
    outline_y: list[Array] = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        piece = slice(start, end)
        outline_x += [x[piece], x[piece][::-1], BREAK]
        outline_y += [low[piece], high[piece][::-1], BREAK]
    around = [np.concatenate(part) if part else np.empty(0) for part in (outline_x, outline_y)]
    return line(around[0], around[1], PALE, name, width=0) | {"fill": "toself", "fillcolor": PALE, "hoverinfo": "skip"}


def with_band(clock: Clock, time: Array, value: Array, sigma: Array, most: int, *, center: Array | None = None) -> list[Trace]:
    """Return a line with its three-sigma band about itself, or about `center`."""
    index = np.union1d(extremes(value, most // 2), extremes(sigma, most // 2)) if len(time) > most else np.arange(len(time))
    x, v, s = clock(time[index]), value[index], 3.0 * sigma[index]
    c = v if center is None else center[index]
    return [band(x, c - s, c + s, "±3σ"), line(x, v, BLUE)]


def stacked(panels: Sequence[Panel], clock: Clock, name: str = "", *, each: int = 150) -> Figure:
    """Return panels above each other over one time axis, each titled at its upper left."""
    count = len(panels)
    height = each * count + 60
    gap = 30.0 / (height - MARGIN["t"] - MARGIN["b"])
    share = (1.0 - gap * (count - 1)) / count
    data, shapes, titles = [], [], []
    layout: dict[str, Any] = {"xaxis": axis(clock.title) | _span(clock) | {"anchor": "y" if count == 1 else f"y{count}"}}
    for k, panel in enumerate(panels):
        top = 1.0 - k * (share + gap)
        key = "y" if k == 0 else f"y{k + 1}"
        vertical = axis() | {"domain": [max(top - share, 0.0), top], "anchor": "x", "nticks": 5, "zeroline": False}
        layout[key.replace("y", "yaxis")] = vertical | _range(panel)
        titles.append(_title(panel.title, top))
        shapes += [_level(value, key) for value in panel.lines]
        data += [trace | {"xaxis": "x", "yaxis": key} for trace in panel.traces]
    return Figure(data, common() | layout | {"shapes": shapes, "annotations": titles, "height": height}, height, name)


def _span(clock: Clock) -> dict[str, Any]:
    return {"zeroline": False} | ({"range": list(clock.range)} if clock.range[1] > clock.range[0] else {})


def _range(panel: Panel) -> dict[str, Any]:
    """Return what a panel asks of its vertical axis."""
    asked: dict[str, Any] = {"autorange": "reversed"} if panel.reversed else {}
    if panel.range is not None:
        asked["range"] = list(panel.range)
    if panel.ticks is not None:
        asked |= {"tickmode": "array", "tickvals": list(panel.ticks[0]), "ticktext": list(panel.ticks[1])}
    return asked


def _title(text: str, top: float) -> dict[str, Any]:
    place = {"xref": "paper", "yref": "paper", "x": 0, "y": top, "xanchor": "left", "yanchor": "bottom", "showarrow": False}
    return place | {"text": text, "font": {"size": 12.5, "color": BLACK}, "yshift": 2}


def _level(value: float, key: str) -> dict[str, Any]:
    style = {"color": GREY, "width": 1, "dash": "dot"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": key, "y0": value, "y1": value, "line": style, "layer": "below"}


def axis(title: str = "") -> dict[str, Any]:
    """Return the style that all axes share."""
    style = {"gridcolor": "#ececec", "linecolor": "#c4c8ce", "showline": True, "ticks": "outside", "ticklen": 3, "tickcolor": "#c4c8ce"}
    return style | {"title": {"text": title, "font": {"size": 12}, "standoff": 8}, "zerolinecolor": "#d5d8dc", "automargin": False}


def common() -> dict[str, Any]:
    """Return the layout that all figures share."""
    return {
        "font": {"family": FONT, "size": 11.5, "color": "#333"}, "margin": MARGIN, "paper_bgcolor": "white", "plot_bgcolor": "white",
        "hovermode": "closest", "hoverlabel": {"align": "left", "font": {"size": 12}}, "dragmode": "zoom",
        "legend": {"orientation": "h", "x": 1, "xanchor": "right", "y": 1, "yanchor": "bottom", "font": {"size": 11}},
    }  # fmt: skip
