"""Tables for people: boxed and coloured on a terminal, aligned plain text in a pipe."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import IO

from rich import box
from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from mtu_cli.reports.table_groups import Extent, Group, groups

WIDTH = 100
"""Columns that a table may take."""
FOLDED = 12
"""Of these a column that folds can do with."""
JOINTS = re.compile(r"[^\s_/-]*[\s_/-]+|[^\s_/-]+")
"""Pieces of a name, each with the sign that a line may end with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column: its heading (a second line for the unit), and whether it holds text.

    A `folds` column may break its cells over lines where the table is too wide. Where it is too
    wide even then columns stand below each other in groups: behind the text in front of the
    first number, and whatever else `names` the row, in each; a group rather `begins` here.
    """

    title: str
    text: bool = False
    folds: bool = False
    names: bool = False
    begins: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table with a title above and notes below; a cell that ends in `*` is emphasised.

    `widest` bounds the columns taken, on terminals too.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = field(default=())
    widest: int = WIDTH

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield Text(self.title, style="bold")
        found = groups(self._extents(), min(self.widest, options.max_width))
        for i, group in enumerate(found):
            if i > 0:
                yield Text("")
            # A terminal too narrow for a name and a number breaks the line itself: rich would cut.
            width = max(group.width, options.max_width)
            for line in console.render_lines(
                self._table(group, boxed=console.is_terminal),
                options.update(width=width),
                pad=False,
                new_lines=True,
            ):
                yield from line
        for note in self.notes:
            yield Text(note, style="dim", overflow="fold")

    def _table(self, group: Group, *, boxed: bool) -> Table:
        """A group of the columns; the lines of a box take one blank of the gap."""
        table = Table(
            box=box.SIMPLE_HEAD if boxed else None,
            show_edge=False,
            pad_edge=False,
            padding=(0, group.gap - 1 if boxed else group.gap, 0, 0),
            header_style="bold",
            collapse_padding=True,
        )
        chosen = [self.columns[i] for i in group.columns]
        for column, width in zip(chosen, group.widths, strict=True):
            table.add_column(
                Text(column.title),
                justify="left" if column.text else "right",
                no_wrap=not column.folds,
                overflow="fold",
                width=width,
            )
        for row in self.rows:
            cells = [row[i] for i in group.columns]
            table.add_row(
                *[
                    Name(value) if column.folds else _cell(value)
                    for value, column in zip(cells, chosen, strict=True)
                ]
            )
        return table

    def fits(self) -> bool:
        """Whether all columns stand side by side; one that folds then does so."""
        first, *others = groups(self._extents(), self.widest)
        return not others and first.width <= self.widest

    def _extents(self) -> list[Extent]:
        """Widths of heading and cells; a heading breaks between its words only."""
        front = max(1, next((i for i, c in enumerate(self.columns) if not c.text), 1))
        found = []
        for i, column in enumerate(self.columns):
            cells = max((cell_len(row[i]) for row in self.rows), default=0)
            wanted = max([cells, *map(cell_len, column.title.split("\n"))])
            words = max(map(cell_len, column.title.split()), default=0)
            least = min(wanted, max(FOLDED, words)) if column.folds else wanted
            names = column.names or i < front
            found.append(Extent(wanted=wanted, least=least, names=names, begins=column.begins))
        return found


@dataclass(frozen=True, slots=True)
class Name:
    """A cell that breaks where a name has its joints: after a blank, `_`, `-` or `/`."""

    text: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield _cell("\n".join(broken(self.text, options.max_width)))

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        pieces = [cell_len(piece.rstrip()) for piece in JOINTS.findall(self.text)]
        return Measurement(max(pieces, default=0), cell_len(self.text))


def broken(name: str, width: int) -> list[str]:
    """A name in lines of at most `width` columns; only what has no joint is cut anywhere."""
    lines = [""]
    for piece in JOINTS.findall(name):
        if cell_len((lines[-1] + piece).rstrip()) <= width:
            lines[-1] += piece
        elif cell_len(piece.rstrip()) <= width:
            lines.append(piece)
        else:
            lines += chop_cells(piece, max(width, 1))
    return [line.rstrip() for line in lines if line] or [""]


def _cell(value: str) -> Text:
    return Text(value, style="bold" if value.endswith("*") else "")


def console(file: IO[str] | None = None) -> Console:
    """A console for tables: a terminal's own width and colours, 100 plain columns elsewhere."""
    stream = sys.stdout if file is None else file
    if stream.isatty():
        return Console(file=stream, highlight=False)
    return Console(
        file=stream, width=WIDTH, highlight=False, force_terminal=False, color_system=None
    )


def plain_text(renderables: Iterable[object]) -> str:
    """What a pipe receives: no escape codes, no trailing blanks, at most 100 columns."""
    out = io.StringIO()
    target = console(out)
    for renderable in renderables:
        target.print(renderable)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"
