"""The page of a report: sections of words, figures and tables as one HTML file that needs no network."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from leadline.report.drawing import Figure
    from leadline.report.tables import Grid


@dataclass(frozen=True)
class Section:
    """A heading with a sentence, figures (title, figure) and tables."""

    key: str
    title: str
    text: str = ""
    figures: Sequence[tuple[str, Figure]] = ()
    grids: Sequence[Grid] = ()


@dataclass(frozen=True)
class Banner:
    """What stands in a box at the top: an answer with its sign and style (as the verdicts are named), and lines before and after."""

    answer: str
    sign: str
    style: str
    before: Sequence[str] = ()
    after: Sequence[str] = ()


def page_of(
    name: str, when: str, headlines: Sequence[tuple[str, str]], sections: Sequence[Section], foot: str, banner: Banner | None = None
) -> str:
    """Return the text of an HTML page.

    name: its title.  when: the line below it.  headlines: label and value of the few numbers at the top.  foot: what its last line says.
    """
    from leadline import __version__

    content = {"name": name, "when": when, "headlines": headlines, "sections": sections, "foot": foot, "banner": banner}
    return str(_template().render(version=__version__, figure_json=figure_json, plotly=_plotly(), **content))


def figure_json(figure: Figure) -> str:
    """Return a figure as JSON that may stand inside a script element."""
    body: dict[str, Any] = {"data": figure.data, "layout": figure.layout}
    return json.dumps(body, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


@cache
def _template() -> Any:
    from importlib.resources import files

    from jinja2 import Environment, StrictUndefined

    source = files("leadline.report").joinpath("report.html.j2").read_text("utf-8")
    return Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True).from_string(source)


@cache
def _plotly() -> str:
    """Return plotly's JavaScript, to be inlined once."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs()).replace("</script", "<\\/script")
