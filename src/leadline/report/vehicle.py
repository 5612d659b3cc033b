"""A vehicle as tables for a person at a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.data.vehicle_template import describe, notes
from leadline.report.sheet import Sheet
from leadline.report.tables import Grid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Group
    from rich.text import Text

    from leadline.data.log import Log
    from leadline.data.vehicle import Vehicle
    from leadline.data.vehicle_template import Description

COLUMNS = ("sensor", "kind", "where and how mounted", "figures", "nuisances with a prior")


def text(vehicle: Vehicle, log: Log | None = None) -> Group:
    """Return a vehicle for a rich console: its sensors, and what to look at, by itself or against a log."""
    from rich.console import Group

    return Group(_sensors(vehicle), _notes(notes(vehicle, log), log))


def _sensors(vehicle: Vehicle) -> Sheet:
    """Return a table of the sensors or, where that is too wide, a block of lines for each."""
    found = [describe(sensor) for sensor in vehicle.sensors.values()]
    driven = f", driven by {vehicle.process.imu}" if vehicle.process.model in ("inertial", "body-velocity") else ""
    title = f"Vehicle {vehicle.name}: process model {vehicle.process.model}{driven}"
    rows = [cells for sensor in found for cells in _rows(sensor)]
    marks = ["unused" if sensor.used else "" for sensor in found for _ in _rows(sensor)]
    return Sheet(Grid(COLUMNS, rows, title, marks), lambda _: "dim", _blocks(found))


def _rows(sensor: Description) -> list[tuple[str, ...]]:
    """Return the rows of one sensor: a line for each of its figures, as no cell may be broken."""
    columns = (
        (sensor.name,), (sensor.kind, sensor.preset), (sensor.lever_arm, sensor.mounting), sensor.figures, sensor.nuisances,
    )  # fmt: skip
    height = max(map(len, columns))
    lines = [tuple(column[k] if k < len(column) else "" for column in columns) for k in range(height)]
    return [line for line in lines if any(line)]


def _blocks(found: Sequence[Description]) -> Text:
    from rich.text import Text

    lines = []
    for sensor in found:
        lines.append(f"{sensor.name}: {sensor.kind}" + (f", preset {sensor.preset}" if sensor.preset else ""))
        parts = (sensor.lever_arm, sensor.mounting, *sensor.figures, *(f"nuisance {nuisance}" for nuisance in sensor.nuisances))
        lines += [f"    {part}" for part in parts]
    return Text("\n".join(lines))


def _notes(found: list[str], log: Log | None) -> Text:
    from rich.text import Text

    if found:
        return Text("\n".join(found), style="yellow")
    return Text("Vehicle and log fit." if log else "Nothing to remark.", style="green")
