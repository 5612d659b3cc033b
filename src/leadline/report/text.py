"""The report for a terminal: rich renderables; nothing is printed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.assess.consistency import Answer
from leadline.report import tables

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from leadline.assess.assessment import Assessment
    from leadline.data.solution import Solution
    from leadline.report.tables import Grid

STYLES = {Answer.CONSISTENT: "bold green", Answer.INCONSISTENT: "bold red", Answer.TOO_FEW: "bold yellow"}
ROW_STYLES = {"inconsistent": "bold", "too_few": "dim"}


def assessment_text(assessment: Assessment) -> RenderableType:
    """Return an assessment: the verdict, the few numbers that matter, and the tables that are not empty."""
    from rich.console import Group
    from rich.text import Text

    verdict = Text(assessment.verdict.sentence, style=STYLES[assessment.verdict.answer])
    headlines = Text("\n".join(f"{label}: {value}" for label, value in tables.headlines(assessment)))
    grids = [tables.verdict_grid(assessment), tables.outcome_grid(assessment)]
    if assessment.errors is not None and len(assessment.errors):
        grids.append(tables.error_grid(assessment.errors))
    if assessment.misclosures:
        grids.append(tables.misclosure_grid(assessment))
    return Group(verdict, headlines, *(_table(grid) for grid in grids if grid.rows))


def summary_text(solution: Solution) -> RenderableType:
    """Return what a solution is: its span, its statuses, what was run, and what became of the measurements."""
    from rich.console import Group
    from rich.text import Text

    from leadline.assess.assessment import counts_of
    from leadline.assess.matching import travelled

    span = float(solution.time[-1] - solution.time[0]) if len(solution) else 0.0
    distance = float(travelled(solution.latitude, solution.longitude)[-1]) if len(solution) else 0.0
    lines = [
        f"{len(solution):,} states over {tables.duration(span)} and {tables.length(distance)}, from {solution.epoch:%Y-%m-%d %H:%M:%S} UTC"
    ]
    lines += [f"{share:.1f} % {name}" for name, share in tables.status_shares(solution)]
    grids = [tables.run_grid(solution.summary), tables.outcomes_of(counts_of(solution.innovations))]
    return Group(Text("\n".join(lines)), *(_table(grid) for grid in grids if grid.rows))


def _table(grid: Grid) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=grid.title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, caption=grid.note or None, caption_justify="left"
    )
    for column in grid.columns:
        table.add_column(column.rstrip(">"), justify="right" if column.endswith(">") else "left")
    for k, row in enumerate(grid.rows):
        table.add_row(*map(Text, row), style=ROW_STYLES.get(grid.marks[k] if grid.marks else "", ""))
    return table
