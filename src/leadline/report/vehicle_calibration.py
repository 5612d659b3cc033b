"""A fitted hull for a terminal: what an operator wants first, then each number with its sigma and what it is worth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leadline.calibrate.vehicle import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Group
    from rich.table import Table

    from leadline.calibrate.vehicle import Quantity, VehicleCalibration

COLOURS = {
    Verdict.DETERMINED: "green",
    Verdict.ROUGHLY: "yellow",
    Verdict.TOGETHER: "yellow",
    Verdict.ALIKE: "dim",
    Verdict.KEPT: "dim",
}
SPIN = ("roll", "pitch", "yaw")


def vehicle_text(found: VehicleCalibration) -> Group:
    """Return sentences for the operator, thrusters, drags, all other numbers, residuals and remarks."""
    from rich.console import Group
    from rich.text import Text

    head = Text(f"{found.start.name} by the log {found.log}: {found.stretches} stretches, {found.seconds:.0f} s", style="bold")
    sentences = [Text(line) for line in operator_lines(found)]
    tables = [_thrusters(found), _drags(found), _numbers(found), _residuals(found)]
    kept = [one.name for one in found.quantities if one.verdict is Verdict.KEPT]
    remarks = [Text(f"not shown by this log, and kept as it was: {', '.join(kept)}")] if kept else []
    return Group(head, *sentences, *tables, *remarks, *(Text(note) for note in found.notes), Text(""))


def operator_lines(found: VehicleCalibration) -> Iterator[str]:
    """Yield what an operator wants to know first: speed per rps, buoyancy and trim, current."""
    line, trim = found.line, found.trim
    if line is None:
        yield "speed per rps: not shown by this log, too few steady stretches ahead"
    else:
        per = f"{line.slope:.4f} ± {line.sigma:.4f} m/s per rps ({60 / line.slope:.1f} rpm for 1 m/s)"
        span = f"{line.stretches} steady stretches, {line.slowest:.2f} to {line.fastest:.2f} m/s"
        yield f"speed per rps: {per}, scatter {line.scatter:.3f} m/s, {span}"
    way = "floats" if trim.buoyancy > 0 else "sinks"
    yield f"buoyancy: {trim.buoyancy:+.2f} ± {trim.sigma:.2f} N ({100 * trim.share_of_weight:+.2f} % of the weight): it {way}"
    if trim.rps is not None:
        yield f"hover: {abs(trim.rps):.1f} rps of each vertical thruster {'down' if trim.rps > 0 else 'up'} hold the depth"
    if trim.pitch is not None:
        stern = "" if trim.stern is None else f", stern planes {np.degrees(trim.stern):+.1f} deg"
        yield f"trim, level ahead: pitch {np.degrees(trim.pitch):+.1f} deg{stern}"
    current = [one for one in found.quantities if one.part == "current"]
    if current:
        yield f"current: {', '.join(f'{one.name[9:]} {one.value:+.3f} ± {one.sigma:.3f} m/s' for one in current)}"


def _table(title: str, *columns: str) -> Table:
    from rich.table import Table

    table = Table(title=title)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number == 0 else "right")
    return table


def _thrusters(found: VehicleCalibration) -> Table:
    columns = ("thruster", "ahead", "astern", "astern : ahead") + (("A per rps^2",) if found.amperes else ())
    table = _table("thrust, N per rps^2", *columns)
    for number, thruster in enumerate(found.hull.thrusters):
        ways = [q for q in found.quantities if q.part in ("ahead", "astern") and q.index == number]
        amperes = (f"{found.amperes[number]:.4g}",) if found.amperes else ()
        table.add_row(thruster.name, *(_value(q) for q in ways), f"{thruster.astern / thruster.ahead:.2f}", *amperes)
    return table


def _drags(found: VehicleCalibration) -> Table:
    table = _table("drag, linear and quadratic together", "axis", "at", "drag")
    for one in found.drags:
        speed, force = ("rad/s", "N m") if one.axis in SPIN else ("m/s", "N")
        table.add_row(one.axis, f"{one.speed:.3f} {speed}", f"{one.value:.3g} ± {one.sigma:.2g} {force}")
    return table


def _numbers(found: VehicleCalibration) -> Table:
    table = _table("the other numbers", "number", "starting hull", "by the log", "unit")
    table.add_column("", justify="left")
    for one in found.quantities:
        if one.part not in ("ahead", "astern", "current"):
            words = f"{one.verdict}{f' {one.partner}' if one.partner else ''}"
            style = COLOURS[one.verdict]
            table.add_row(one.name, f"{one.start:.4g}", _value(one), one.unit, f"[{style}]{words}[/{style}]")
    return table


def _value(one: Quantity) -> str:
    if one.verdict is Verdict.KEPT:
        return f"[dim]{one.value:.4g}, kept[/dim]"
    mark = "" if one.verdict is Verdict.DETERMINED else "[dim]~[/dim]"
    return f"{mark}{one.value:.4g} ± {one.sigma:.2g}"


def _residuals(found: VehicleCalibration) -> Table:
    table = _table("what is left", "instrument", "rms", "R^2")
    units = {"velocity": ("m/s", 1.0), "attitude": ("deg", float(np.degrees(1.0))), "depth": ("m", 1.0)}
    for one in found.residuals:
        unit, factor = units[one.quantity]
        axis = "" if one.quantity == "depth" else f" {'xyz'[one.component]}"
        name = one.channel if one.channel == one.quantity else f"{one.channel} {one.quantity}"
        table.add_row(f"{name}{axis}", f"{factor * one.rms:.4f} {unit}", f"{one.explained:.3f}")
    return table
