"""Figures of what a solution says: map, depth, velocity, attitude, uncertainty, nuisance states.  Degrees stand here, at the border."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.core import geodesy
from leadline.core.attitude import euler_from_quaternion
from leadline.data.outcome import Outcome
from leadline.data.solution import Status
from leadline.report.drawing import (
    BLACK,
    BLUE,
    CYCLE,
    GREEN,
    GREY,
    MARGIN,
    MOST_POINTS,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    Clock,
    Figure,
    Panel,
    axis,
    common,
    extremes,
    line,
    markers,
    spaced,
    stacked,
    with_band,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from leadline.assess.errors import Errors
    from leadline.data.records import Array, Truth
    from leadline.data.solution import Innovations, Solution
    from leadline.report.drawing import Trace

DEGREE = 180.0 / np.pi
OUTCOMES = list(Outcome)  # by number
ELLIPSES, CORNERS = 25, 36
FIX_MARKS = 1_500  # used ones of all sensors together, and as many that were not
MOST_STATES = 24  # nuisance states drawn
SHOWN_UNIT = {"rad": (DEGREE, "°"), "rad/s": (DEGREE * 3600.0, "°/h"), "1": (100.0, "%")}
STATUS_STYLE = {
    Status.ALIGNING: (PURPLE, "dot"),
    Status.AIDED: (BLUE, "solid"),
    Status.DEAD_RECKONING: (ORANGE, "solid"),
    Status.MULTIMODAL: (SKY, "dash"),
    Status.LOST: (BLACK, "dot"),
}
FIX_SYMBOLS = ("circle-open", "square-open", "diamond-open", "triangle-up-open", "star-open")


def map_figure(solution: Solution, truth: Truth | None, most: int = MOST_POINTS) -> Figure:
    """Return the map: metres north and east of the origin in equal scale."""
    traces = [_ellipses(solution), *_tracks(solution, most)]
    if truth is not None:
        traces.append(_truth_track(solution, truth, most))
    traces += [*_fixes(solution), *_ends(solution)]
    layout = {
        "xaxis": axis("east (m)"),
        "yaxis": axis() | {"scaleanchor": "x", "scaleratio": 1},
        "annotations": [{"text": "north (m)", "xref": "paper", "yref": "paper", "x": 0, "y": 1, "yanchor": "bottom", "showarrow": False}],
        "legend": {"orientation": "h", "x": 0, "y": -0.09, "yanchor": "top", "font": {"size": 11.5}},
        "margin": MARGIN | {"b": 110},
        "dragmode": "pan",
        "height": 680,
    }
    return Figure(traces, common() | layout, 680, "map")


def _tracks(solution: Solution, most: int) -> Iterator[Trace]:
    """Yield the track in a colour for each status; a stretch reaches to the first row of the next."""
    index = spaced(len(solution), most)
    status = solution.status[index]
    for number, (color, dash) in STATUS_STYLE.items():
        here = status == number
        here[1:] |= here[:-1].copy()
        if (status == number).any():
            north, east = (np.where(here, v[index], np.nan) for v in (solution.north, solution.east))
            yield line(east, north, color, number.name.lower().replace("_", " "), width=2, dash=dash, legend=True)


def _ellipses(solution: Solution) -> Trace:
    """Return the three-sigma ellipses at intervals, as one trace."""
    index = spaced(len(solution), ELLIPSES)
    values, vectors = np.linalg.eigh(np.nan_to_num(solution.covariance[index, :2, :2]))
    root = vectors * (3.0 * np.sqrt(np.maximum(values, 0.0)))[:, None, :]
    angle = np.append(np.linspace(0.0, 2 * np.pi, CORNERS), np.nan)
    around = np.einsum("kij,jn->kin", root, np.stack([np.cos(angle), np.sin(angle)]))
    north, east = solution.north[index, None] + around[:, 0], solution.east[index, None] + around[:, 1]
    return line(east.ravel(), north.ravel(), GREY, "3σ ellipses", width=1, legend=True) | {"hoverinfo": "skip"}


def _truth_track(solution: Solution, truth: Truth, most: int) -> Trace:
    from leadline.assess.errors import horizontal_of

    latitude, longitude = horizontal_of(solution, truth)
    good = np.isfinite(latitude) if truth.outlier is None else np.isfinite(latitude) & ~(truth.outlier > 0)
    order = np.flatnonzero(good)[np.argsort(truth.time[good], kind="stable")]
    index = order[spaced(len(order), most)]
    north, east = geodesy.north_east(latitude[index], longitude[index], solution.origin.latitude, solution.origin.longitude)
    sparse = len(order) < 2 or np.median(np.diff(truth.time[order])) > 10.0
    if sparse:
        return markers(east, north, BLACK, "truth", symbol="cross-thin-open", size=8, legend=True)
    return line(east, north, BLACK, "truth", width=1.2, dash="dot", legend=True)


def _ends(solution: Solution) -> Iterator[Trace]:
    if len(solution):
        for at, name, symbol in ((0, "start", "triangle-right"), (-1, "end", "square")):
            place = slice(at, None) if at else slice(0, 1)
            yield markers(solution.east[place], solution.north[place], BLACK, name, symbol=symbol, size=10, legend=True)


def _fixes(solution: Solution) -> Iterator[Trace]:
    """Yield the position fixes of each sensor, used and gated, at the estimate before each plus its residual."""
    table = solution.innovations
    sensors = np.unique(table.sensor[table.component == "north"])
    for number, sensor in enumerate(sensors if len(solution) else sensors[:0]):
        fixes = _pairs(table.select(table.sensor == sensor))
        symbol = FIX_SYMBOLS[number % len(FIX_SYMBOLS)]
        for used, color, name, mark in ((True, GREEN, "used", symbol), (False, VERMILLION, "not used", "x")):
            picked = np.flatnonzero((fixes[0].outcome == Outcome.USED) == used)
            picked = picked[spaced(len(picked), FIX_MARKS // len(sensors))]
            if len(picked):
                yield _fix_marks(solution, fixes[0].select(picked), fixes[1].select(picked), f"{sensor}, {name}", color, mark)


def _pairs(table: Innovations) -> tuple[Innovations, Innovations]:
    """Return the north and the east components of the groups that have both, in the same order."""
    parts = [table.select((table.component == name) & np.isfinite(table.residual)) for name in ("north", "east")]
    _, first, second = np.intersect1d(parts[0].group, parts[1].group, return_indices=True)
    return parts[0].select(first), parts[1].select(second)


def _fix_marks(solution: Solution, north: Innovations, east: Innovations, name: str, color: str, symbol: str) -> Trace:
    before = np.maximum(np.searchsorted(solution.time, north.time, side="left") - 1, 0)
    ahead = np.maximum(north.time - solution.time[before], 0.0)
    at_north = solution.north[before] + solution.velocity_n[before, 0] * ahead + north.residual
    at_east = solution.east[before] + solution.velocity_n[before, 1] * ahead + east.residual
    size = np.hypot(north.residual, east.residual)
    text = [
        f"{name}: row {row} at {time:.1f} s<br>residual {r:.2f} m, nis {nis:.1f} of {dof}<br>{OUTCOMES[outcome].sentence}"
        for row, time, r, nis, dof, outcome in zip(north.row, north.time, size, north.nis, north.dof, north.outcome, strict=True)
    ]
    return markers(at_east, at_north, color, name, symbol=symbol, size=7, text=text, legend=True)


def motion_figures(solution: Solution, clock: Clock, most: int) -> dict[str, Figure]:
    """Return depth, velocity, attitude and uncertainty over time."""
    s, sigma = solution, solution.sigma
    depth = [Panel("depth (m)", with_band(clock, s.time, s.depth, sigma[:, 2], most), reversed=True)]
    if s.altitude is not None and np.isfinite(s.altitude).any():
        depth.append(Panel("altitude above the sea bed (m)", [_curve(clock, s.time, s.altitude, BLUE, most)]))
    velocity = [
        Panel(f"velocity {axis_} (m/s)", with_band(clock, s.time, s.velocity_n[:, k], sigma[:, 3 + k], most))
        for k, axis_ in enumerate(("north", "east", "down"))
    ]
    return {
        "depth": stacked(depth, clock, "depth", each=200),
        "velocity": stacked(velocity, clock, "velocity"),
        "attitude": stacked(list(_attitude(solution, clock, most)), clock, "attitude"),
        "uncertainty": stacked(list(_uncertainty(solution, clock, most)), clock, "uncertainty"),
    }


def _attitude(solution: Solution, clock: Clock, most: int) -> Iterator[Panel]:
    roll, pitch, heading = euler_from_quaternion(solution.quaternion_nb)
    sigma = angle_sigma(solution) * DEGREE
    yield Panel("roll (°)", with_band(clock, solution.time, roll * DEGREE, sigma[:, 0], most))
    yield Panel("pitch (°)", with_band(clock, solution.time, pitch * DEGREE, sigma[:, 1], most))
    yield _heading_panel(heading, sigma[:, 2], solution.time, clock, most)


def _heading_panel(heading: Array, sigma: Array, time: Array, clock: Clock, most: int) -> Panel:
    """Return the heading counted on across north, so that the line does not jump, with ticks that stay within a turn."""
    known = np.isfinite(heading)
    turned = np.full(len(heading), np.nan)
    turned[known] = np.unwrap(heading[known]) * DEGREE
    ticks = heading_ticks(turned)
    return Panel("heading (°, counted on across north)", with_band(clock, time, turned, sigma, most), ticks=ticks)


def heading_ticks(turned: Array) -> tuple[list[float], list[str]]:
    """Return where ticks stand on an axis of headings (degrees, counted on across north), and their names within a turn."""
    known = np.isfinite(turned).any()
    low, high = (np.floor(np.nanmin(turned) / 90.0), np.ceil(np.nanmax(turned) / 90.0)) if known else (0.0, 4.0)
    step = max(1.0, np.ceil((high - low) / 8.0))
    ticks = 90.0 * np.arange(low, high + 1.0, step)
    return ticks.tolist(), [f"{tick % 360:.0f}" for tick in ticks]


def angle_sigma(solution: Solution) -> Array:
    """Return the standard deviations (n, 3) of roll, pitch and heading (rad) of a solution.

    For an error e (north, east, down) on the left: pitch changes by e_E cos h - e_N sin h, roll by a = (e_N cos h + e_E sin h) / cos p,
    heading by e_D + a sin p.
    """
    _, pitch, heading = euler_from_quaternion(solution.quaternion_nb)
    c, s, secant = np.cos(heading), np.sin(heading), 1.0 / np.maximum(np.cos(pitch), 1e-6)
    zero, one = np.zeros_like(c), np.ones_like(c)
    rows = [[c * secant, s * secant, zero], [-s, c, zero], [c * secant * np.sin(pitch), s * secant * np.sin(pitch), one]]
    jacobian = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    variance = np.einsum("kij,kjl,kil->ki", jacobian, solution.covariance[:, 6:9, 6:9], jacobian)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _uncertainty(solution: Solution, clock: Clock, most: int) -> Iterator[Panel]:
    major = np.sqrt(np.maximum(np.linalg.eigvalsh(np.nan_to_num(solution.covariance[:, :2, :2]))[:, 1], 0.0))
    for title, value in (
        ("horizontal position, 1σ along the longest axis (m)", major),
        ("velocity, 1σ horizontal (m/s)", np.hypot(solution.sigma[:, 3], solution.sigma[:, 4])),
        ("heading, 1σ (°)", angle_sigma(solution)[:, 2] * DEGREE),
    ):
        top = float(np.nanmax(value, initial=0.0))
        yield Panel(title, [_curve(clock, solution.time, value, BLUE, most)], (0.0, 1.1 * top) if 0.0 < top < np.inf else None)


def _curve(clock: Clock, time: Array, value: Array, color: str, most: int) -> Trace:
    index = extremes(value, most)
    return line(clock(time[index]), value[index], color)


def nuisance_figure(solution: Solution, clock: Clock, most: int) -> Figure | None:
    """Return the estimated nuisance states with their bands, the first `MOST_STATES` of them."""
    panels = []
    for name, state in list(solution.nuisances.items())[:MOST_STATES]:
        factor, unit = SHOWN_UNIT.get(state.unit, (1.0, state.unit))
        title = f"{name} ({unit}{', ' + state.frame if state.frame else ''})"
        panels.append(Panel(title, with_band(clock, solution.time, factor * state.value, factor * state.sigma, most), lines=(0.0,)))
    return stacked(panels, clock, "nuisance", each=130) if panels else None


def error_figures(errors: Errors, clock: Clock, most: int) -> dict[str, Figure]:
    """Return errors against truth within their three-sigma envelopes, for the blocks of which truth speaks."""
    blocks = {
        "position": (0, 1.0, [f"{n} (m)" for n in ("north", "east", "down")]),
        "velocity": (3, 1.0, [f"velocity {n} (m/s)" for n in ("north", "east", "down")]),
        "attitude": (6, DEGREE, [f"rotation about {n} (°)" for n in ("north", "east", "down (heading)")]),
    }
    figures = {}
    for block, (start, factor, titles) in blocks.items():
        panels = [
            Panel(title, _error_traces(errors, start + k, factor, clock, most))
            for k, title in enumerate(titles)
            if np.isfinite(errors.error[:, start + k]).any()
        ]
        if panels:
            figures[block] = stacked(panels, clock, f"error-{block}")
    return figures


def _error_traces(errors: Errors, column: int, factor: float, clock: Clock, most: int) -> list[Trace]:
    value, sigma = factor * errors.error[:, column], factor * errors.sigma[:, column]
    traces = with_band(clock, errors.time, value, sigma, most, center=np.zeros(len(errors)))
    if len(errors) < 200:
        traces.append(markers(clock(errors.time), value, CYCLE[0], size=5))
    return traces
