"""A vehicle as tables for a person at a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.data.vehicle_template import describe, notes

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from leadline.data.log import Log
    from leadline.data.vehicle import Vehicle


def text(vehicle: Vehicle, log: Log | None = None) -> Group:
    """Return a vehicle for a rich console: its sensors, and what to look at, by itself or against a log."""
    from rich.console import Group

    return Group(_sensors(vehicle), _notes(notes(vehicle, log), log))


def _sensors(vehicle: Vehicle) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    title = f"Vehicle {vehicle.name}: process model {vehicle.process.model}, driven by {vehicle.process.imu}"
    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD)
    for column in ("sensor", "kind", "where and how mounted", "figures", "nuisances with a prior"):
        table.add_column(column, overflow="fold")
    for sensor in map(describe, vehicle.sensors.values()):
        kind = sensor.kind + (f"\n{sensor.preset}" if sensor.preset else "")
        where = f"{sensor.lever_arm}\n{sensor.mounting}"
        cells = (sensor.name, kind, where, "\n".join(sensor.figures), "\n".join(sensor.nuisances))
        table.add_row(*map(Text, cells), style="dim" if sensor.used else "", end_section=True)
    return table


def _notes(found: list[str], log: Log | None) -> Text:
    from rich.text import Text

    if found:
        return Text("\n".join(found), style="yellow")
    return Text("Vehicle and log fit." if log else "Nothing to remark.", style="green")
