"""The scene of a dive in three dimensions, as plotly's JavaScript takes it: metres east, north and down, seen from above the south."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.report.drawing import BLACK, BLUE, FONT, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION, Figure, common, packed, spaced
from leadline.report.tables import number
from leadline.report.tracks import Track

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from leadline.data.records import Array
    from leadline.report.drawing import Clock, Trace
    from leadline.report.picture import Box, Ground, Picture
    from leadline.report.tracks import Fixes

HEIGHT = 720  # pixels
MOST_PLACES, MOST_OTHERS = 12_000, 6_000  # of the reference, and of any other track
MOST_FIXES = 3_000  # of one instrument
CROWD = 200  # fixes, from which on they are drawn smaller
# From the shallow to the deep, and from the start to the end: both grow evenly in lightness, which any eye can tell.
SEA_BED = ((0.0, "#e8dfc8"), (0.25, "#cdc9b4"), (0.5, "#a3b0ad"), (0.75, "#74909f"), (1.0, "#48677f"))
TIME = ((0.0, "#0d0887"), (0.25, "#5c01a6"), (0.5, "#9c179e"), (0.75, "#cc4778"), (1.0, "#f1844b"))
SURFACE = "#9fd0ec"
SOLVED = (GREEN, ORANGE, BLUE, VERMILLION)
FIX_COLORS = (GREEN, BLUE, PURPLE, ORANGE)
LIGHT = {"ambient": 0.5, "diffuse": 0.85, "specular": 0.06, "roughness": 0.95, "fresnel": 0.02}
SUN = {"x": -4e4, "y": 4e4, "z": 6e4}  # in the north-west and above
LIFT = 0.012  # of the height of the box, by which what lies on the ground is drawn above it
VIEWS = {
    "from the south": (0.45, -1.75, 1.05),
    "from the east": (1.75, 0.4, 1.05),
    "from the side": (0.0, -1.9, 0.12),
    "from above": (0.0, -0.001, 2.0),
}


def scene_figure(picture: Picture, clock: Clock) -> Figure | None:
    """Return the scene, or None where nothing in it has a place."""
    if picture.box is None:
        return None
    box = picture.box
    traces = [*_ground(picture.ground), *_surface(box), *_cloud(picture), *_reference(picture, clock)]
    for k, track in enumerate(picture.others):
        traces.append(_path(track, clock, SOLVED[k % len(SOLVED)], MOST_OTHERS))
    traces += [_path(track, clock, GREY, MOST_OTHERS, dash="dot") for track in picture.platforms]
    for k, fixes in enumerate(picture.fixes):
        if picture.reference is not fixes.track:
            traces += _fixes(fixes, clock, SKY if not fixes.track.depth.any() else FIX_COLORS[k % len(FIX_COLORS)])
    traces += _beacons(picture, box)
    return Figure(traces, _layout(box), HEIGHT, "scene")


def scale_words(exaggeration: float) -> str:
    """Say how the vertical scale compares with the horizontal one."""
    return "at true scale" if exaggeration == 1.0 else f"drawn {exaggeration:g} × the horizontal scale"


def _layout(box: Box) -> dict[str, Any]:
    x, y, z = box.ratio
    size = 1.38 / max(0.75, 0.5 * (x + y))
    scene = {
        "xaxis": _axis("east (m)", (box.west, box.east)),
        "yaxis": _axis("north (m)", (box.south, box.north)),
        "zaxis": _axis(_depth_title(box.exaggeration), (-box.bottom, -box.top)) | _depth_ticks(box.top, box.bottom, 7),
        "aspectmode": "manual",
        "aspectratio": {"x": size * x, "y": size * y, "z": size * z},
        "camera": _camera(VIEWS["from the south"]),
        "dragmode": "turntable",
    }
    legend = {"orientation": "v", "x": 0.0, "xanchor": "left", "y": 0.9, "yanchor": "top", "font": {"size": 11.5}}
    legend |= {"bgcolor": "rgba(255,255,255,0.72)", "itemsizing": "constant"}
    buttons = [_views(), _stretches(box, size)]
    return common() | {
        "scene": scene,
        "legend": legend,
        "height": HEIGHT,
        "margin": {"l": 0, "r": 0, "t": 44, "b": 8},
        "updatemenus": buttons,
    }


def _depth_title(exaggeration: float) -> str:
    return "depth (m), true scale" if exaggeration == 1.0 else f"depth (m), × {exaggeration:g}"


def _axis(title: str, span: tuple[float, float]) -> dict[str, Any]:
    style = {"gridcolor": "#d9dee3", "zerolinecolor": "#d9dee3", "linecolor": "#b9c0c8", "showspikes": False, "backgroundcolor": "#f6f7f9"}
    text = {"title": {"text": title, "font": {"size": 12}}, "tickfont": {"size": 10.5}, "tickformat": "~r"}
    return style | text | {"range": list(span), "showbackground": True, "nticks": 8}


def _camera(eye: tuple[float, float, float]) -> dict[str, Any]:
    return {"eye": dict(zip("xyz", eye, strict=True)), "up": {"x": 0, "y": 0, "z": 1}, "center": {"x": 0, "y": 0, "z": -0.2}}


def _views() -> dict[str, Any]:
    buttons = [{"label": name, "method": "relayout", "args": [{"scene.camera": _camera(eye)}]} for name, eye in VIEWS.items()]
    return _menu(buttons, 0, 1.0)


def _stretches(box: Box, size: float) -> dict[str, Any]:
    """Return buttons that stretch the depth: true scale, the one that is drawn first, and half and twice of it."""
    x = box.exaggeration
    offered = sorted({1.0, 0.5 * x, x, 2.0 * x} - ({0.5} if x == 1.0 else set()))
    height = size * box.ratio[2] / x
    buttons = [
        {
            "label": f"× {value:g}",
            "method": "relayout",
            "args": [{"scene.aspectratio.z": value * height, "scene.zaxis.title.text": _depth_title(value)}],
        }
        for value in offered
    ]
    return _menu(buttons, offered.index(x), 0.0)


def _menu(buttons: Sequence[dict[str, Any]], active: int, y: float) -> dict[str, Any]:
    """Return buttons side by side, at the left, at the top or the bottom."""
    place = {"type": "buttons", "direction": "right", "x": 0.0, "xanchor": "left", "y": y, "yanchor": "bottom"}
    style = {"font": {"size": 11, "family": FONT}, "bgcolor": "#f6f7f9", "bordercolor": "#dfe3e8", "pad": {"t": 0, "b": 6}}
    return place | style | {"buttons": list(buttons), "active": active, "showactive": True}


def _ground(ground: Ground | None) -> Iterator[Trace]:
    if ground is None:
        return
    low, high = float(np.nanmin(ground.depth)), float(np.nanmax(ground.depth))
    step = _round_step((high - low) / 8.0)
    lines = {"show": True, "color": "#5f7482", "width": 1, "highlight": False}
    lines |= {"start": -float(np.floor(high / step) * step), "end": -low, "size": step}
    yield {
        "type": "surface", "x": packed(ground.east), "y": packed(ground.north), "z": _matrix(-ground.depth), "name": "sea bed",
        "colorscale": _upward(SEA_BED), "cmin": -max(high, low + 1e-3), "cmax": -low, "customdata": _matrix(ground.depth),
        "colorbar": _bar("sea bed (m)", 0.24) | _depth_ticks(low, high, 8), "lighting": LIGHT, "lightposition": SUN, "showlegend": True,
        "contours": {"z": lines, "x": _quiet(), "y": _quiet()},
        "hovertemplate": "north %{y:.0f} m, east %{x:.0f} m<br>depth %{customdata:.1f} m<extra>sea bed</extra>",
    }  # fmt: skip


def _quiet() -> dict[str, Any]:
    return {"highlight": False}


def _matrix(values: Array) -> dict[str, str]:
    return packed(values) | {"shape": f"{values.shape[0]}, {values.shape[1]}"}


def _round_step(step: float) -> float:
    """Return the next larger of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(step, 1e-3)))
    return float(next(power * k for k in (1.0, 2.0, 5.0, 10.0) if power * k >= 0.999 * step))


def _surface(box: Box) -> Iterator[Trace]:
    if box.surface:
        east, north = np.array([box.west, box.east]), np.array([box.south, box.north])
        yield {
            "type": "surface", "x": packed(east), "y": packed(north), "z": _matrix(np.zeros((2, 2))), "opacity": 0.16, "showscale": False,
            "colorscale": [[0, SURFACE], [1, SURFACE]], "hoverinfo": "skip", "name": "sea surface", "showlegend": True,
            "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0}, "contours": {axis: _quiet() for axis in "xyz"},
        }  # fmt: skip


def _cloud(picture: Picture) -> Iterator[Trace]:
    if len(picture.cloud):
        north, east, depth = picture.cloud.T
        low, high = (float(v) for v in np.percentile(depth, [1.0, 99.0]))
        ground = picture.ground
        if ground is not None:
            low, high = float(np.nanmin(ground.depth)), float(np.nanmax(ground.depth))
        bar = {} if ground is not None else {"colorbar": _bar("soundings (m)", 0.24) | _depth_ticks(low, high, 8), "showscale": True}
        style = {
            "size": 0.8,
            "color": packed(-depth),
            "colorscale": _upward(_darker()),
            "cmin": -max(high, low + 1e-3),
            "cmax": -low,
            **bar,
        }
        yield _points(north, east, depth - _lift(picture), "soundings", style) | {"hoverinfo": "skip"}


def _lift(picture: Picture) -> float:
    """Return by how much (m) what lies on the ground is drawn above it, so that the ground does not hide it."""
    return 0.0 if picture.box is None or picture.ground is None else LIFT * (picture.box.bottom - picture.box.top)


def _upward(colors: Sequence[tuple[float, str]]) -> list[list[Any]]:
    """Return colours by depth as plotly takes them by height."""
    return [[1.0 - at, color] for at, color in reversed(colors)]


def _depth_ticks(low: float, high: float, count: int) -> dict[str, Any]:
    """Return ticks at round depths of an axis that counts upward."""
    step = _round_step((high - low) / count)
    depths = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0)
    return {"tickmode": "array", "tickvals": (-depths).tolist(), "ticktext": [f"{depth:g}" for depth in depths + 0.0]}


def _darker() -> list[tuple[float, str]]:
    """Return the colours of the sea bed, darker, so that points stand out from it."""
    whole = [(at, [int(int(color[k : k + 2], 16) * 0.8) for k in (1, 3, 5)]) for at, color in SEA_BED]
    return [(at, f"rgb({r},{g},{b})") for at, (r, g, b) in whole]


def _reference(picture: Picture, clock: Clock) -> Iterator[Trace]:
    """Yield the way of the vehicle in the colours of time, its shadow on the ground, its start and its end."""
    track = picture.reference
    if track is None or not len(track):
        return
    thin, x = _thinned(track, MOST_PLACES), clock
    time = x(thin.time)
    colors = {"color": packed(time), "colorscale": [list(pair) for pair in TIME], "showscale": True, "colorbar": _bar(_short(clock), 0.72)}
    colors |= {"cmin": float(np.nanmin(time)), "cmax": float(max(np.nanmax(time), np.nanmin(time) + 1e-9))}
    if track.measured:
        yield _points(thin.north, thin.east, thin.depth, track.name, colors | {"size": 3.5}) | _hover(thin, track.name, clock)
    else:
        yield _line(thin, track.name, colors | {"width": 6}) | _hover(thin, track.name, clock)
    if picture.ground is not None and not track.measured:
        below = picture.ground.below(thin.north, thin.east)
        style = {"color": "#39434d", "width": 2}
        yield _line(thin, "track on the sea bed", style, below - _lift(picture)) | {"hoverinfo": "skip"}
    yield from _ends(track)


def _ends(track: Track) -> Iterator[Trace]:
    for name, at, symbol in (("start", slice(0, 1), "circle"), ("end", slice(-1, None), "square")):
        n, e, d = track.north[at], track.east[at], track.depth[at]
        style = {"size": 6, "color": "white", "symbol": symbol, "line": {"color": BLACK, "width": 2}}
        label = {"mode": "markers+text", "text": [name], "textposition": "top center", "textfont": {"size": 12, "color": BLACK}}
        yield _points(n, e, d, name, style) | label | {"showlegend": False, "hoverinfo": "skip"}


def _thinned(track: Track, most: int) -> Track:
    """Return every k-th place, with nan where a gap is."""
    index = spaced(len(track), most)
    broken = np.flatnonzero(np.diff(track.pieces[index])) + 1
    thin = track.select(index)
    if track.measured or not len(broken):
        return thin
    north, east, depth = (np.insert(column, broken, np.nan) for column in (thin.north, thin.east, thin.depth))
    return Track(thin.name, np.insert(thin.time, broken, thin.time[broken]), north, east, depth)


def _path(track: Track, clock: Clock, color: str, most: int, dash: str = "solid") -> Trace:
    thin = _thinned(track, most)
    style = {"color": color, "width": 3, "dash": dash}
    return _line(thin, track.name, style) | _hover(thin, track.name, clock)


def _fixes(fixes: Fixes, clock: Clock, color: str) -> Iterator[Trace]:
    kinds = (
        (~fixes.doubtful, fixes.name, {"color": color, "size": 2.6 if len(fixes.track) < CROWD else 1.6, "symbol": "circle"}),
        (fixes.doubtful, f"{fixes.name}, doubtful", {"color": VERMILLION, "size": 4.5, "symbol": "diamond-open"}),
    )
    for mask, name, style in kinds:
        index = np.flatnonzero(mask)
        index = index[spaced(len(index), MOST_FIXES)]
        if len(index):
            part = fixes.track.select(index)
            yield _points(part.north, part.east, part.depth, name, style) | _hover(part, name, clock)


def _beacons(picture: Picture, box: Box) -> Iterator[Trace]:
    """Yield a mark for each beacon, and a stem from it to the top of the box."""
    if not picture.beacons:
        return
    north, east, depth = np.array(list(picture.beacons.values())).T
    names = list(picture.beacons)
    style = {"color": BLACK, "size": 5.5, "symbol": "diamond"}
    text = {"mode": "markers+text", "text": names, "textposition": "middle right", "textfont": {"size": 12, "color": BLACK}}
    hover = [f"{n}<br>north {a:.1f} m, east {b:.1f} m, depth {number(c)} m" for n, a, b, c in zip(names, north, east, depth, strict=True)]
    yield _points(north, east, depth, "beacons", style) | text | {"hovertext": hover, "hoverinfo": "text"}
    stem = np.stack([depth, np.full(len(depth), 0.0 if box.surface else box.top), np.full(len(depth), np.nan)], axis=1).ravel()
    base = {"type": "scatter3d", "mode": "lines", "line": {"color": GREY, "width": 2}, "hoverinfo": "skip", "showlegend": False}
    yield base | {"x": packed(np.repeat(east, 3)), "y": packed(np.repeat(north, 3)), "z": packed(-stem), "legendgroup": "beacons"}


def _points(north: Array, east: Array, depth: Array, name: str, style: dict[str, Any]) -> Trace:
    place = {"x": packed(east), "y": packed(north), "z": packed(-depth)}
    line = {"line": {"width": 0}} | style
    return {"type": "scatter3d", "mode": "markers", **place, "name": name, "marker": line, "showlegend": True}


def _line(track: Track, name: str, style: dict[str, Any], depth: Array | None = None) -> Trace:
    place = {"x": packed(track.east), "y": packed(track.north), "z": packed(-track.depth if depth is None else -depth)}
    return {"type": "scatter3d", "mode": "lines", **place, "name": name, "line": style, "showlegend": True}


def _hover(track: Track, name: str, clock: Clock) -> Trace:
    unit = clock.title.rpartition("(")[2].rstrip(")")
    told = f"%{{customdata[0]:.2f}} {unit}<br>north %{{y:.1f}} m, east %{{x:.1f}} m<br>depth %{{customdata[1]:.2f}} m<extra>{name}</extra>"
    return {"customdata": _matrix(np.stack([clock(track.time), track.depth], axis=1)), "hovertemplate": told}


def _short(clock: Clock) -> str:
    return f"time ({clock.title.rpartition('(')[2]}"


def _bar(title: str, y: float) -> dict[str, Any]:
    size = {"len": 0.4, "thickness": 11, "x": 1.0, "xanchor": "right", "y": y, "yanchor": "middle", "outlinewidth": 0}
    return size | {"title": {"text": title, "font": {"size": 11.5}, "side": "top"}, "tickfont": {"size": 10.5}}
