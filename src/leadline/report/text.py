"""The report for a terminal: rich renderables; nothing is printed here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.assess.consistency import Answer
from leadline.report import tables
from leadline.report.sheet import Sheet

if TYPE_CHECKING:
    from rich.console import RenderableType

    from leadline.assess.assessment import Assessment
    from leadline.data.solution import Solution

STYLES = {Answer.CONSISTENT: "bold green", Answer.INCONSISTENT: "bold red", Answer.TOO_FEW: "bold yellow"}
FIRST = "bold yellow"
MOST_TOLD = 15
ROW_STYLES = {"inconsistent": "bold", "too_few": "dim"}


def assessment_text(assessment: Assessment) -> RenderableType:
    """Return an assessment: the verdict, the few numbers that matter, and the tables that are not empty."""
    from rich.console import Group
    from rich.text import Text

    style = STYLES[assessment.verdict.answer]
    first = len(assessment.verdict.first)
    verdict = [
        Text(line, style=FIRST if k < first else style if k == first else "")
        for k, line in enumerate(tables.verdict_lines(assessment.verdict))
    ]
    headlines = Text("\n".join(f"{label}: {value}" for label, value in tables.headlines(assessment)) + "\n")
    told = tables.happening_lines(assessment.happenings, MOST_TOLD)
    happened = [Text("\n".join(["What happened:", *(f"  {line}" for line in told)]) + "\n")] if told else []
    grids = [tables.verdict_grid(assessment), tables.outcome_grid(assessment)]
    if assessment.errors is not None and len(assessment.errors):
        grids.append(tables.error_grid(assessment.errors))
    if assessment.misclosures:
        grids.append(tables.misclosure_grid(assessment))
    return Group(*verdict, headlines, *happened, *(Sheet(grid, row_style) for grid in grids if grid.rows))


def summary_text(solution: Solution) -> RenderableType:
    """Return what a solution is: its span, its statuses, what was run, and what became of the measurements."""
    from rich.console import Group
    from rich.text import Text

    from leadline.assess.matching import distance
    from leadline.assess.usage import counts_of

    span = float(solution.time[-1] - solution.time[0]) if len(solution) else 0.0
    travelled = distance(solution)
    start = f"{solution.epoch:%Y-%m-%d %H:%M:%S} UTC"
    lines = [f"{len(solution):,} states over {tables.duration(span)} and {tables.length(travelled)}, from {start}"]
    lines += [f"{share:.1f} % {name}" for name, share in tables.status_shares(solution)]
    grids = [tables.run_grid(solution.summary, travelled), tables.outcomes_of(counts_of(solution.innovations))]
    return Group(Text("\n".join(lines) + "\n"), *(Sheet(grid, row_style) for grid in grids if grid.rows))


def row_style(mark: str) -> str:
    """Return the style of a row of a table by its mark."""
    return ROW_STYLES.get(mark, "")
