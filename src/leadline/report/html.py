"""The report for a person: one file that needs no network."""

from __future__ import annotations

from typing import TYPE_CHECKING

from leadline.assess.consistency import Answer
from leadline.assess.usage import finite
from leadline.report import figures, judged, tables
from leadline.report.drawing import clock_of, points_per_line
from leadline.report.page import Banner, Section, page_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from leadline.assess.assessment import Assessment
    from leadline.assess.consistency import Verdict
    from leadline.data.records import Truth
    from leadline.data.solution import Solution
    from leadline.report.drawing import Clock

SIGNS = {Answer.CONSISTENT: "✓", Answer.INCONSISTENT: "✕", Answer.TOO_FEW: "?"}
FOOT = (
    "Positions are those of the reported point; north-east-down; angles in degrees, heading clockwise from true north.\n"
    "Long series are thinned for drawing: lines keep their extremes, points every k-th."
)


def write_report(
    solution: Solution, path: str | Path, *, assessment: Assessment, truth: Truth | None = None, log_name: str | None = None
) -> None:
    """Write the report of a solution as one self-contained page, whole or not at all.

    Raises InputError where the place cannot be written.
    """
    from leadline.formats.atomic import new_file

    page = report_page(solution, assessment=assessment, truth=truth, log_name=log_name)
    with new_file(path) as part:
        part.write_text(page, "utf-8")


def report_page(solution: Solution, *, assessment: Assessment, truth: Truth | None = None, log_name: str | None = None) -> str:
    """Return the report as the text of an HTML page."""
    solution = finite(solution)
    verdict = assessment.verdict
    words, first = _without_answer(verdict), len(verdict.first)
    answer = verdict.answer
    return page_of(
        log_name or solution.summary.get("name") or "Solution",
        f"Navigation report · counted from {solution.epoch:%Y-%m-%d %H:%M:%S} UTC",
        tables.headlines(assessment),
        list(_sections(solution, assessment, truth)),
        FOOT,
        Banner(answer.value, SIGNS[answer], answer.name.lower(), words[:first], words[first:]),
    )


def _sections(solution: Solution, assessment: Assessment, truth: Truth | None) -> Iterator[Section]:
    clock = clock_of(solution.time, solution.epoch)
    most = points_per_line(_line_count(solution, assessment))
    if assessment.happenings:
        yield Section("happenings", "What happened", grids=[tables.happening_grid(assessment.happenings)])
    yield _run_section(solution, assessment.distance)
    if len(solution):
        yield from _state_sections(solution, truth, clock, most)
    yield from _error_sections(assessment, clock, most)
    yield from _innovation_sections(solution, clock)
    yield Section("outcomes", "What became of the measurements", grids=[tables.outcome_grid(assessment)])
    yield Section("tests", "Verdict, test by test", assessment.verdict.sentence, grids=[tables.verdict_grid(assessment)])


def _line_count(solution: Solution, assessment: Assessment) -> int:
    return 13 + min(len(solution.nuisances), figures.MOST_STATES) + (9 if assessment.errors is not None else 0)


def _run_section(solution: Solution, distance: float) -> Section:
    if not solution.summary:
        return Section("run", "What was run", "The solution does not say what was run.")
    return Section("run", "What was run", grids=[tables.run_grid(solution.summary, distance)])


def _state_sections(solution: Solution, truth: Truth | None, clock: Clock, most: int) -> Iterator[Section]:
    text = (
        "Fixes are drawn at the estimate before each plus its residual; those that were not used say why under the pointer. "
        "Scroll or drag to look closer, double-click to see all."
    )
    yield Section("map", "Map", text, [("", figures.map_figure(solution, truth))])
    motion = figures.motion_figures(solution, clock, most)
    bands = "Shaded: three sigma to either side."
    yield Section("depth", "Depth", bands, [("", motion["depth"])])
    yield Section("velocity", "Velocity", "Over ground, of the reported point. " + bands, [("", motion["velocity"])])
    yield Section("attitude", "Attitude", bands, [("", motion["attitude"])])
    yield Section("uncertainty", "Predicted uncertainty", figures=[("", motion["uncertainty"])])
    nuisance = figures.nuisance_figure(solution, clock, most)
    if nuisance is None:
        yield Section("nuisance", "Instrument and environment states", "None was estimated.")
        return
    hidden = len(solution.nuisances) - figures.MOST_STATES
    more = f" {hidden} further states are in the solution's tables only." if hidden > 0 else ""
    yield Section("nuisance", "Instrument and environment states", bands + more, [("", nuisance)])


def _error_sections(assessment: Assessment, clock: Clock, most: int) -> Iterator[Section]:
    errors = assessment.errors
    if errors is not None and len(errors):
        drawn = [(block.capitalize(), figure) for block, figure in figures.error_figures(errors, clock, most).items()]
        text = "Truth minus estimate. Shaded: three sigma as predicted, with the truth's own where it states one."
        yield Section("errors", "Errors against truth", text, drawn, [tables.error_grid(errors)])
    elif errors is not None:
        yield Section("errors", "Errors against truth", "No moment of truth could be compared.", grids=[tables.error_grid(errors)])
    if assessment.misclosures:
        yield Section("misclosure", "Misclosure at fixes", grids=[tables.misclosure_grid(assessment)])


def _innovation_sections(solution: Solution, clock: Clock) -> Iterator[Section]:
    residuals = judged.residual_figures(solution, clock) if len(solution.innovations) else {}
    if not residuals:
        yield Section("residuals", "Residuals", "No measurement was looked at.")
        return
    text = (
        "Measured minus predicted, in units of the sigma that was predicted for it; dotted at 0 and ±3. Crosses were turned away by the "
        "gate and say why under the pointer; what lies beyond ±6 is drawn at the edge."
    )
    yield Section("residuals", "Residuals", text, list(residuals.items()))
    nis = judged.nis_figure(solution, clock)
    if nis is not None:
        text = "Line: running mean, which should stay in the shaded band 99 % of the time. Dots: single groups that were used."
        yield Section("nis", "Normalised innovations squared", text, [("", nis)])


def _without_answer(verdict: Verdict) -> list[str]:
    """Return the lines of a verdict without the answer that they open with, which stands above them."""
    first, body = verdict.first, tables.verdict_lines(verdict)[len(verdict.first) :]
    answer, colon, rest = body[0].partition(":")
    rest = rest.strip() if colon and answer.lower() in {a.value for a in Answer} else body[0]
    return [*first, *(line[:1].upper() + line[1:] if k == 0 else line for k, line in enumerate([rest, *body[1:]]) if line)]
