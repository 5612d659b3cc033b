"""The page of a mission: what a log holds, real or simulated, with the dive in three dimensions."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from leadline.assess.happenings import Happening
from leadline.data.inspection import inspect
from leadline.report import presence, tables
from leadline.report.drawing import clock_of
from leadline.report.page import Section, page_of
from leadline.report.picture import picture_of
from leadline.report.scene import scale_words, scene_figure
from leadline.report.series import series_figures
from leadline.report.tables import Grid

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from leadline.data.inspection import Inspection
    from leadline.data.log import Log
    from leadline.data.solution import Solution
    from leadline.data.vehicle import Vehicle
    from leadline.report.drawing import Clock
    from leadline.report.picture import Picture
    from leadline.sea.terrain import Chart

FOOT = (
    "North and east count from the origin of the log, along meridian and parallel; depth is positive down; angles in degrees, heading "
    "clockwise from north.\nLong series are thinned for drawing: lines keep their extremes, points every k-th."
)
WORDS = {"Depth and altitude": "Depth is counted from the sea surface, positive down."}


def write_mission_report(
    log: Log,
    path: str | Path,
    *,
    solutions: Mapping[str, Solution] | None = None,
    chart: Chart | None = None,
    vehicle: Vehicle | None = None,
    faults: Sequence[Mapping[str, Any]] = (),
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write the page of a mission as one self-contained file, whole or not at all; arguments as `mission_page`.

    Raises InputError where the place cannot be written.
    """
    from leadline.formats.atomic import new_file

    page = mission_page(log, solutions=solutions, chart=chart, vehicle=vehicle, faults=faults, progress=progress)
    with new_file(path) as part:
        part.write_text(page, "utf-8")


def mission_page(
    log: Log,
    *,
    solutions: Mapping[str, Solution] | None = None,
    chart: Chart | None = None,
    vehicle: Vehicle | None = None,
    faults: Sequence[Mapping[str, Any]] = (),
    progress: Callable[[float], None] | None = None,
) -> str:
    """Return the page of a mission as the text of an HTML page.

    solutions: by the name to show.  chart: the ground, in metres from the log's origin.  vehicle: where sensors are mounted; without it
    echo sounders and acoustic heads are taken to lie at the body origin, along its axes.  faults: what was made to go wrong, by the
    keys of a mission file.  progress: called with the fraction that is done.
    """
    tell = progress or (lambda _: None)
    inspection = inspect(log)
    tell(0.4)
    picture = picture_of(log, solutions, chart, vehicle)
    tell(0.6)
    clock = _clock(log, inspection)
    sections = list(_sections(log, inspection, picture, clock, vehicle, solutions or {}, faults))
    tell(0.9)
    when = f"Mission report · counted from {log.epoch:%Y-%m-%d %H:%M:%S} UTC"
    return page_of(log.name, when, _headlines(log, inspection, picture), sections, FOOT)


def _clock(log: Log, inspection: Inspection) -> Clock:
    return clock_of(np.array(_span(inspection)), log.epoch)


def _span(inspection: Inspection) -> tuple[float, float]:
    """Return start and end (s) of what the log holds; a table that speaks but once, such as a profile, does not widen it."""
    known = [facts for facts in inspection.tables.values() if isfinite(facts.first)]
    lasting = [facts for facts in known if facts.last > facts.first] or known
    return (min(f.first for f in lasting), max(f.last for f in lasting)) if lasting else (0.0, 0.0)


def _headlines(log: Log, inspection: Inspection, picture: Picture) -> list[tuple[str, str]]:
    start, end = _span(inspection)
    lines = [("duration", tables.duration(end - start))]
    track = picture.reference
    if track is not None and len(track):
        lines.append((f"distance travelled, by {track.name}", tables.length(picture.distance)))
    deep = _depth_range(log, picture)
    if deep is not None:
        lines.append(("depth", f"{deep[0]:.1f} to {deep[1]:.1f} m"))
    rows = sum(facts.rows for facts in inspection.tables.values())
    return [*lines, ("tables", f"{len(inspection.tables)} with {rows:,} rows")]


def _depth_range(log: Log, picture: Picture) -> tuple[float, float] | None:
    """Return the least and the greatest depth (m) by the way that is known, else by the depth sensors."""
    from leadline.data.records import Depth

    track = picture.reference
    values = [track.depth] if track is not None and not track.measured else []
    values = values or [table.depth for table in log.tables.values() if isinstance(table, Depth)]
    known = np.concatenate([v[np.isfinite(v)] for v in values]) if values else np.empty(0)
    return (float(known.min()), float(known.max())) if len(known) else None


def _sections(
    log: Log,
    inspection: Inspection,
    picture: Picture,
    clock: Clock,
    vehicle: Vehicle | None,
    solutions: Mapping[str, Solution],
    faults: Sequence[Mapping[str, Any]],
) -> Iterator[Section]:
    figure = scene_figure(picture, clock)
    if figure is None:
        yield Section("scene", "The dive", "No table of this log says where the vehicle was.")
    else:
        yield Section("scene", "The dive", _scene_words(log, picture, vehicle), [("", figure)])
    grids = [presence.table_grid(log, inspection)]
    yield Section("tables", "What the log holds", "", [("", presence.presence_figure(log, inspection, clock))], grids)
    if faults:
        yield Section("faults", "What was made to go wrong", "", grids=[_fault_grid(faults)])
    for k, (name, solution) in enumerate(solutions.items(), 1):
        found = _happenings(solution)
        if found:
            yield Section(f"happened-{k}", f"What happened, by {name}", grids=[tables.happening_grid(found)])
    for title, drawn in series_figures(log, picture, clock).items():
        yield Section(drawn.name, title, WORDS.get(title, ""), [("", drawn)])
    if inspection.findings:
        yield Section("findings", "What an inspection finds", grids=[presence.finding_grid(inspection)])


def _scene_words(log: Log, picture: Picture, vehicle: Vehicle | None) -> str:
    """Say what is drawn, in which scale, and what a person should know of it."""
    assert picture.box is not None
    track = picture.reference
    words = [f"Depth is {scale_words(picture.box.exaggeration)}; north and east have one scale."]
    if track is not None:
        words.append(f"The colours of {track.name} tell the time.")
    else:
        words.append("No table of this log says where the vehicle was.")
    doubtful = [f"{fixes.name}: {int(fixes.doubtful.sum())} of {len(fixes.track)} ({fixes.why})" for fixes in picture.fixes if fixes.why]
    if doubtful:
        words.append(f"Open diamonds are doubtful: {', '.join(doubtful)}.")
    if vehicle is None and _seen_by_mounting(log, picture):
        words.append("Echo sounders and acoustic heads are taken to lie at the body origin, along its axes.")
    words += picture.remarks
    return " ".join([*words, "Drag to turn, scroll to come closer, click a name to hide it."])


def _seen_by_mounting(log: Log, picture: Picture) -> bool:
    from leadline.data.records import Usbl

    return len(picture.cloud) > 0 or any(isinstance(log.tables.get(fixes.name), Usbl) for fixes in picture.fixes)


def _happenings(solution: Solution) -> list[Happening]:
    """Return what a solution's summary tells of the dive."""
    told = solution.summary.get("happenings") or ()
    keys = Happening.__dataclass_fields__
    return [Happening(**{key: entry[key] for key in keys}) for entry in told if isinstance(entry, dict) and set(keys) <= set(entry)]


def _fault_grid(faults: Sequence[Mapping[str, Any]]) -> Grid:
    """Return faults by the keys of a mission file: kind, sensor, when, and how."""
    rows = []
    for fault in faults:
        how = {k: v for k, v in fault.items() if k not in ("kind", "sensor", "from_s", "to_s")}
        when = tuple(f"{fault[k]:,}" if isinstance(fault.get(k), int | float) else "" for k in ("from_s", "to_s"))
        rows.append((str(fault.get("kind", "")), str(fault.get("sensor", "")), *when, ", ".join(f"{k} = {v}" for k, v in how.items())))
    return Grid(("fault", "sensor", "from (s)>", "to (s)>", "what"), rows, "Faults")
