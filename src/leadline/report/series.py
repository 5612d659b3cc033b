"""What a log holds over time, as figures: each quantity by all tables that tell it.  Degrees stand here, at the border."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from leadline.assess.usage import ABSURD
from leadline.core.attitude import euler_from_quaternion
from leadline.data import records
from leadline.data.finding import numeric_columns
from leadline.report.drawing import BLACK, CYCLE, Clock, Figure, Panel, extremes, line, markers, points_per_line, spaced, stacked
from leadline.report.figures import DEGREE, heading_ticks
from leadline.report.tracks import LONGEST_GAP, column_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from leadline.data.log import Log
    from leadline.data.records import Array, Table
    from leadline.report.drawing import Trace
    from leadline.report.picture import Picture

SAND = "#a9885a"
FIXED = {"truth": BLACK, "sea bed by the chart": SAND}  # colours of sources that are the same in all figures
MOST_COLUMNS = 6  # of a table whose kind is not known
MOST_DOTS = 3_000  # of one source
FEW = 40  # values, below which each is marked
AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Curve:
    """One quantity (n,) over time (s) by one source; `dots`: single measurements, not a line."""

    source: str
    time: Array
    value: Array
    dots: bool = False

    @property
    def usable(self) -> npt.NDArray[np.bool_]:
        """Which values (n,) are numbers, and such as can be drawn, at a time that is known."""
        return np.asarray((np.abs(self.value) < ABSURD) & np.isfinite(self.time))


@dataclass(frozen=True, eq=False)
class Quantity:
    """A panel to be: its title with the unit, and all curves of it."""

    title: str
    curves: Sequence[Curve]
    downward: bool = False
    heading: bool = False


def series_figures(log: Log, picture: Picture, clock: Clock) -> dict[str, Figure]:
    """Return the figures of what the log holds, by title; quantities of which nobody tells are left out."""
    groups = {
        "Depth and altitude": _vertical(log, picture),
        "Speed": _speeds(log),
        "Attitude": _angles(log),
        "Machinery": _machinery(log),
        "Water": _water(log),
        "Acoustics": _acoustics(log),
        "Inertial and magnetic": _inertial(log),
        "Other tables": _others(log),
    }
    kept = {title: [spoken for quantity in group if (spoken := _spoken(quantity)).curves] for title, group in groups.items()}
    most = points_per_line(sum(len(quantity.curves) for group in kept.values() for quantity in group))
    return {title: _figure(title, group, clock, most) for title, group in kept.items() if group}


def _spoken(quantity: Quantity) -> Quantity:
    curves = [curve for curve in quantity.curves if curve.usable.any()]
    return Quantity(quantity.title, curves, quantity.downward, quantity.heading)


def _figure(title: str, group: Sequence[Quantity], clock: Clock, most: int) -> Figure:
    """Return panels above each other, with one colour and one line of the legend for each source."""
    sources = list(dict.fromkeys(curve.source for quantity in group for curve in quantity.curves))
    free = [source for source in sources if source not in FIXED]
    colors = {source: CYCLE[k % len(CYCLE)] for k, source in enumerate(free)} | FIXED
    told: set[str] = set()
    panels = []
    for quantity in group:
        traces = []
        for curve in quantity.curves:
            legend = {"name": curve.source, "legendgroup": curve.source, "showlegend": len(sources) > 1 and curve.source not in told}
            told.add(curve.source)
            traces.append(_trace(curve, colors[curve.source], clock, most) | legend)
        ticks = heading_ticks(np.concatenate([curve.value for curve in quantity.curves])) if quantity.heading else None
        panels.append(Panel(quantity.title, traces, reversed=quantity.downward, ticks=ticks))
    return stacked(panels, clock, title.partition(" ")[0].lower(), each=220 if title.startswith("Depth") else 150)


def _trace(curve: Curve, color: str, clock: Clock, most: int) -> Trace:
    time, value = _in_order(curve)
    if curve.dots:
        index = spaced(len(time), MOST_DOTS)
        return markers(clock(time[index]), value[index], color, size=3)
    index = extremes(value, most)
    broken = np.flatnonzero(np.diff(_pieces(time)[index])) + 1
    x, y = np.insert(clock(time[index]), broken, np.nan), np.insert(value[index], broken, np.nan)
    drawn = line(x, y, color, width=1.3)
    return drawn if len(time) > FEW else drawn | {"mode": "lines+markers", "marker": {"color": color, "size": 4}}


def _in_order(curve: Curve) -> tuple[Array, Array]:
    """Return the times and values that are numbers, in order of time."""
    good = np.flatnonzero(curve.usable)
    time, value = curve.time[good], curve.value[good]
    if (np.diff(time) >= 0.0).all():
        return time, value
    order = np.argsort(time, kind="stable")
    return time[order], value[order]


def _pieces(time: Array) -> Array:
    """Return a number (n,) that counts up at each gap."""
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else np.inf
    return np.concatenate([[0], np.cumsum(steps > LONGEST_GAP * usual)])[: len(time)]


def _vertical(log: Log, picture: Picture) -> Iterator[Quantity]:
    depth, altitude, pressure = [], [], []
    for name, table in log.tables.items():
        if isinstance(table, records.Depth):
            depth.append(Curve(name, table.time, table.depth))
        elif isinstance(table, records.Pressure):
            pressure.append(Curve(name, table.time, 1e-3 * table.pressure))
        elif isinstance(table, records.Dvl) and table.altitude is not None:
            altitude.append(Curve(name, table.time, _valid(table, table.altitude)))
        elif isinstance(table, records.Altimeter):
            altitude.append(Curve(name, table.time, _valid(table, table.range)))
    tracks = [t for t in (*picture.others, picture.reference) if t is not None and not t.measured]
    depth += [Curve(track.name, track.time, track.depth) for track in tracks]
    track = picture.reference
    if track is not None and picture.ground is not None and not track.measured:
        below = picture.ground.below(track.north, track.east)
        depth.append(Curve("sea bed by the chart", track.time, below))
        altitude.append(Curve(f"{track.name} above the chart", track.time, below - track.depth))
    yield Quantity("depth (m)", depth, downward=True)
    yield Quantity("altitude above the sea bed (m)", altitude)
    yield Quantity("pressure (kPa)", pressure)


def _speeds(log: Log) -> Iterator[Quantity]:
    ground: list[Curve] = []
    water: list[Curve] = []
    for name, table in log.tables.items():
        if isinstance(table, records.Speed):
            water.append(Curve(name, table.time, _valid(table, table.speed)))
        elif isinstance(table, records.Dvl | records.Gnss | records.Navigation | records.Truth) and table.velocity is not None:
            down = np.nan_to_num(table.velocity[:, 2])
            level = np.hypot(table.velocity[:, 0], table.velocity[:, 1])
            speed = Curve(name, table.time, _valid(table, np.hypot(level, down)))
            (water if isinstance(table, records.WaterVelocity) else ground).append(speed)
    yield Quantity("speed over the ground (m/s)", ground)
    yield Quantity("speed through the water (m/s)", water)


def _angles(log: Log) -> Iterator[Quantity]:
    found: dict[str, list[Curve]] = {"roll": [], "pitch": [], "heading": []}
    for name, table in log.tables.items():
        if isinstance(table, records.Platform):
            continue
        angles = {angle: getattr(table, angle, None) for angle in found}
        if isinstance(table, records.Attitude) and table.quaternion is not None and table.roll is None:
            angles = dict(zip(found, euler_from_quaternion(table.quaternion), strict=True))
        for angle, value in angles.items():
            if value is not None:
                found[angle].append(Curve(name, table.time, DEGREE * _valid(table, value)))
    for angle in ("roll", "pitch"):
        yield Quantity(f"{angle} (°)", found[angle])
    yield Quantity("heading (°, counted on across north)", _counted_on(found["heading"]), heading=True)
    rates = [Curve(n, t.time, DEGREE * t.yaw_rate) for n, t in log.tables.items() if isinstance(t, records.YawRate)]
    yield Quantity("rate of heading (°/s)", rates)


def _counted_on(curves: Sequence[Curve]) -> list[Curve]:
    """Return headings (degrees) without jumps at north, each by whole turns near to the first where it begins."""
    found: list[Curve] = []
    for curve in curves:
        time, value = _in_order(curve)
        value = np.unwrap(value, period=360.0)
        if found and len(time) and len(found[0].time):
            value = value - 360.0 * np.round((value[0] - np.interp(time[0], found[0].time, found[0].value)) / 360.0)
        found.append(Curve(curve.source, time, value))
    return found


def _machinery(log: Log) -> Iterator[Quantity]:
    turns: list[Curve] = []
    fins: list[Curve] = []
    amperes: list[Curve] = []
    for name, table in log.tables.items():
        if isinstance(table, records.Thruster):
            turns += _columns(name, table, table.thruster, "thruster")
            fins += [Curve(f"{name} {fin}", table.time, DEGREE * column_of(table, fin)) for fin in ("rudder", "stern")]
        elif isinstance(table, records.MotorCurrent):
            amperes += _columns(name, table, table.motor, "motor")
    yield Quantity("thruster speeds (revolutions per second)", turns)
    yield Quantity("fins (°)", fins)
    yield Quantity("motor currents (A)", amperes)


def _columns(name: str, table: Table, values: Array, part: str) -> Iterator[Curve]:
    return (Curve(f"{name} {part} {k + 1}", table.time, column) for k, column in enumerate(values.T))


def _water(log: Log) -> Iterator[Quantity]:
    flow: list[list[Curve]] = [[], [], []]
    levels, sound, warmth = [], [], []
    for name, table in log.tables.items():
        if isinstance(table, records.WaterCurrent):
            for k, column in enumerate((*table.current.T, column_of(table, "current_down"))):
                flow[k].append(Curve(name, table.time, column))
        elif isinstance(table, records.WaterLevel):
            levels.append(Curve(name, table.time, table.water_level))
        elif isinstance(table, records.SoundSpeed) and len(np.unique(table.time)) > 1:
            sound.append(Curve(name, table.time, table.sound_speed))
            warmth.append(Curve(name, table.time, column_of(table, "temperature")))
    for axis, curves in zip(("north", "east", "down"), flow, strict=True):
        yield Quantity(f"current {axis} (m/s)", curves)
    yield Quantity("water level above the chart's datum (m)", levels)
    yield Quantity("speed of sound (m/s)", sound)
    yield Quantity("temperature (°C)", warmth)


def _acoustics(log: Log) -> Iterator[Quantity]:
    ranges: list[Curve] = []
    times: list[Curve] = []
    azimuths: list[Curve] = []
    for name, table in log.tables.items():
        if isinstance(table, records.AcousticRange):
            for other in np.unique(table.transmitter):
                rows = table.transmitter == other
                who = f"{name}, {other}"
                for curves, column, factor in ((ranges, "range", 1.0), (times, "travel_time", 1.0), (azimuths, "azimuth", DEGREE)):
                    curves.append(Curve(who, table.time[rows], factor * column_of(table, column)[rows], dots=True))
    yield Quantity("range (m)", ranges)
    yield Quantity("travel time (s)", times)
    yield Quantity("azimuth (°)", azimuths)


def _inertial(log: Log) -> Iterator[Quantity]:
    for name, table in log.tables.items():
        if isinstance(table, records.Imu):
            force, rate = table.accel, table.gyro
            if force is None or rate is None:
                span = column_of(table, "interval")[:, None]
                span = np.where(span > 0.0, span, np.nan)
                force, rate = cast("Array", table.delta_velocity) / span, cast("Array", table.delta_angle) / span
            yield Quantity(f"{name}: specific force (m/s²)", _axes(table, force))
            yield Quantity(f"{name}: angular rate (°/s)", _axes(table, DEGREE * rate))
    for name, table in log.tables.items():
        if isinstance(table, records.Magnetometer):
            yield Quantity(f"{name}: magnetic field (µT)", _axes(table, 1e6 * table.field))


def _axes(table: Table, values: Array) -> list[Curve]:
    return [Curve(axis, table.time, column) for axis, column in zip(AXES, values.T, strict=True)]


def _others(log: Log) -> Iterator[Quantity]:
    for name, table in log.tables.items():
        if isinstance(table, records.ScalarField):
            yield Quantity(f"{name}", [Curve(name, table.time, table.value)])
        elif isinstance(table, records.Other):
            columns = [
                (column, values) for _, column, values in numeric_columns(table) if column not in ("time_s", "received_s", "sequence")
            ]
            for column, values in columns[:MOST_COLUMNS]:
                yield Quantity(f"{name}: {column}", [Curve(name, table.time, values)])


def _valid(table: Table, value: Array) -> Array:
    """Return values, nan where the sensor calls its row invalid."""
    return value if table.valid is None else np.where(table.valid == 0.0, np.nan, value)
