"""A table that fits a terminal: numbers and names stay whole, and the columns that matter least make way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console, ConsoleOptions, JustifyMethod, RenderableType
    from rich.segment import Segment
    from rich.table import Table

    from leadline.report.tables import Grid

NARROW = 100  # columns, below which tables are drawn with less air
WORDS = 24  # letters that a column of prose has at least, to be wrapped between words
PROSE = ("a row …", "what", "value")  # columns that hold sentences; all others hold numbers and names


@dataclass(frozen=True)
class Sheet:
    """A grid for a rich console: columns without any cell are left out, and as many of `grid.least` as there is no room for.

    style: of a row's mark.  otherwise: what stands in for a table that does not fit even so, or the cells line by line.
    """

    grid: Grid
    style: Callable[[str], str] = str
    otherwise: RenderableType | None = None

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Yield the title, the table and the note, without blanks at the ends of lines."""
        from rich.measure import Measurement
        from rich.text import Text

        grid, free = self.grid, options.update_width(10_000)
        names = [name for k, name in enumerate(grid.columns) if any(row[k] for row in grid.rows)]
        droppable = [name for name in grid.least if name in names]
        table = self._table(names, options.max_width)
        while (too_wide := Measurement.get(console, free, table).minimum > options.max_width) and droppable:
            names.remove(droppable.pop(0))
            table = self._table(names, options.max_width)
        if grid.title:
            yield Text(grid.title, style="bold")
        if too_wide:
            yield self.otherwise or Text("\n".join(_lines(grid)))
        else:
            yield Trimmed(table)
        if grid.note:
            yield Text(grid.note, style="dim italic")
        yield Text("")

    def _table(self, names: list[str], width: int) -> Table:
        from rich import box
        from rich.table import Table
        from rich.text import Text

        table = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=(0, 1) if width >= NARROW else (0, 1, 0, 0))
        index = [self.grid.columns.index(name) for name in names]
        for k, name in zip(index, names, strict=True):
            justify: JustifyMethod = "right" if name.endswith(">") else "left"
            table.add_column(name.rstrip(">"), justify=justify, no_wrap=name not in PROSE, min_width=_least_width(self.grid, k))
        for number, row in enumerate(self.grid.rows):
            mark = self.grid.marks[number] if self.grid.marks else ""
            table.add_row(*(Text(row[k]) for k in index), style=self.style(mark) if mark else "")
        return table


def _lines(grid: Grid) -> Iterator[str]:
    """Yield the cells of a grid, one a line, those after the first with the names of their columns."""
    for row in grid.rows:
        if row[0]:
            yield row[0]
        yield from (f"    {name.rstrip('>')}: {cell}" for name, cell in zip(grid.columns[1:], row[1:], strict=True) if cell)


def _least_width(grid: Grid, column: int) -> int:
    """Return the width that a column needs, so that no number and no name is broken, and no word of prose."""
    name, cells = grid.columns[column], [row[column] for row in grid.rows]
    whole = max(map(len, [name.rstrip(">"), *cells]))
    return max(min(whole, WORDS), max(len(word) for cell in cells for word in cell.split())) if name in PROSE else whole


@dataclass(frozen=True)
class Trimmed:
    """What a rich console draws, less the blanks at the ends of its lines."""

    content: RenderableType

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        """Yield the segments of each line up to its last letter."""
        from rich.segment import Segment

        for line in console.render_lines(self.content, options, pad=False):
            kept = list(line)
            while kept and not kept[-1].text.strip():
                kept.pop()
            yield from kept[:-1]
            if kept:
                yield Segment(kept[-1].text.rstrip(), kept[-1].style)
            yield Segment.line()
