"""An inspection as tables for a person at a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    from leadline.data.inspection import Facts, Inspection

COLOURS = {"problem": "red", "suspicion": "yellow", "note": "cyan"}


def text(inspection: Inspection, *, ranges: bool = True) -> Group:
    """Return an inspection for a rich console: facts by table, ranges by column (in file units), findings, the worst first."""
    from rich.console import Group

    parts = [_facts(inspection), _ranges(inspection), _findings(inspection)] if ranges else [_facts(inspection), _findings(inspection)]
    return Group(*parts)


def _facts(inspection: Inspection) -> Table:
    columns = ("table", "kind", "rows", "first s", "last s", "rate 1/s", "gaps", "duplicates", "not measured", "invalid", "median lag s")
    table = _grid(f"Log {inspection.name}", columns, left=2)
    for name, facts in inspection.tables.items():
        table.add_row(name, facts.kind, *_cells(facts))
    return table


def _cells(facts: Facts) -> list[str]:
    lag = math.nan if facts.lag is None else facts.lag.median
    missing = max(facts.not_measured.values(), default=0)
    times = [_number(facts.first, "z.3f"), _number(facts.last, "z.3f"), _number(facts.rate, ".4g")]
    counts = [str(n) if n else "" for n in (facts.gaps, facts.duplicates, missing, facts.invalid)]
    return [str(facts.rows), *times, *counts, _number(lag, ".4g")]


def _ranges(inspection: Inspection) -> Table:
    table = _grid("Values", ("table", "column", "least", "median", "greatest"), left=2)
    for name, facts in inspection.tables.items():
        for row, (column, spread) in enumerate(facts.ranges.items()):
            cells = (_number(value, ".8g") for value in (spread.minimum, spread.median, spread.maximum))
            table.add_row("" if row else name, column, *cells, end_section=row == len(facts.ranges) - 1)
    return table


def _findings(inspection: Inspection) -> Table | Text:
    from rich.text import Text

    if not inspection.findings:
        return Text("Nothing looks wrong.", style="green")
    table = _grid("Findings", ("severity", "table", "what"), left=3)
    for finding in inspection.findings:
        table.add_row(Text(finding.severity, style=COLOURS[finding.severity]), Text(finding.table), Text(finding.sentence))
    return table


def _grid(title: str, columns: tuple[str, ...], left: int) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD)
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index < left else "right", overflow="fold")
    return table


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ""
