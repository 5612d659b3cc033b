"""An inspection as tables for a person at a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from leadline.report.sheet import Sheet
from leadline.report.tables import Grid

if TYPE_CHECKING:
    from rich.console import Group, RenderableType

    from leadline.data.inspection import Facts, Inspection

COLOURS = {"problem": "red", "suspicion": "yellow", "note": "cyan"}
FACTS = ("table", "kind", "rows>", "first s>", "last s>", "1/s>", "gaps>", "duplicates>", "not measured>", "invalid>", "lag s>")
LEAST_FACTS = ("lag s>", "duplicates>", "kind", "gaps>", "first s>", "invalid>", "not measured>", "last s>")


def text(inspection: Inspection, *, ranges: bool = True) -> Group:
    """Return an inspection for a rich console: facts by table, ranges by column (in file units), findings, the worst first."""
    from rich.console import Group

    grids = [_facts(inspection), _ranges(inspection)] if ranges else [_facts(inspection)]
    return Group(*(Sheet(grid) for grid in grids if grid.rows), _findings(inspection))


def _facts(inspection: Inspection) -> Grid:
    rows = [(name, facts.kind, *_cells(facts)) for name, facts in inspection.tables.items()]
    return Grid(FACTS, rows, f"Log {inspection.name}", least=LEAST_FACTS)


def _cells(facts: Facts) -> tuple[str, ...]:
    lag = math.nan if facts.lag is None else facts.lag.median
    missing = max(facts.not_measured.values(), default=0)
    times = (_number(facts.first, "z.3f"), _number(facts.last, "z.3f"), _number(facts.rate, ".4g"))
    counts = (str(n) if n else "" for n in (facts.gaps, facts.duplicates, missing, facts.invalid))
    return (str(facts.rows), *times, *counts, _number(lag, ".4g"))


def _ranges(inspection: Inspection) -> Grid:
    rows = [
        ("" if row else name, column, *(_number(value, ".8g") for value in (spread.minimum, spread.median, spread.maximum)))
        for name, facts in inspection.tables.items()
        for row, (column, spread) in enumerate(facts.ranges.items())
    ]
    return Grid(("table", "column", "least>", "median>", "greatest>"), rows, "Values", least=("median>",))


def _findings(inspection: Inspection) -> RenderableType:
    from rich.text import Text

    if not inspection.findings:
        return Text("Nothing looks wrong.", style="green")
    rows = [(finding.severity, finding.table, finding.sentence) for finding in inspection.findings]
    marks = [finding.severity for finding in inspection.findings]
    return Sheet(Grid(("severity", "table", "what"), rows, "Findings", marks), lambda mark: COLOURS[mark])


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ""
