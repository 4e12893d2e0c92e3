"""Tables for people: coloured on a terminal, aligned plain text in a pipe, at most 100 columns.

Columns that have no room beside the others stand below them, behind the names of the rows again,
as pandas prints a wide frame.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import IO

from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

WIDTH = 100
"""Columns that a table may take."""
FOLDED = 12
"""Of these a column of text can do with."""
JOINTS = re.compile(r"[^\s_/-]*[\s_/-]+|[^\s_/-]+")
"""Pieces of a name, each with the sign that a line may end with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column: its heading (a second line for the unit), and whether it holds text, which may
    break over lines.

    Where the table is too wide even then, the columns of text in front and what else `names` the
    row begin every group of columns; a group rather `begins` here than elsewhere. `meaning` is for
    HTML.
    """

    title: str
    text: bool = False
    names: bool = False
    begins: bool = False
    meaning: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table with a title above and notes below; a cell that ends in `*` is emphasised."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = field(default=())

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield Text(self.title, style="bold")
        most = min(WIDTH, options.max_width)
        wanted, least = [], []
        for i, column in enumerate(self.columns):
            lines = [*column.title.split("\n"), *(row[i] for row in self.rows)]
            wanted.append(max(map(cell_len, lines)))
            # A heading breaks between its words only.
            words = max(map(cell_len, column.title.split()), default=0)
            least.append(min(wanted[-1], max(FOLDED, words)) if column.text else wanted[-1])
        for n, group in enumerate(self._groups(least, most)):
            if n > 0:
                yield Text("")
            # A terminal too narrow for a name and a number breaks the line itself.
            widths, gap = _widths([wanted[i] for i in group], [least[i] for i in group], most)
            yield from self._lines(group, widths, gap, ruled=console.is_terminal)
        for note in self.notes:
            yield Text(note, style="dim", overflow="fold")

    def _groups(self, least: Sequence[int], width: int) -> list[list[int]]:
        """The columns that stand side by side, by their places in the table."""
        every = range(len(self.columns))
        front = max(1, next((i for i in every if not self.columns[i].text), 1))
        names = [i for i in every if i < front or self.columns[i].names]
        groups, group = [], [*names]
        for i in (i for i in every if i not in names):
            while len(group) > len(names) and sum(least[j] + 1 for j in [*group, i]) - 1 > width:
                both = enumerate([*group, i])
                starts = [n for n, j in both if n > len(names) and self.columns[j].begins]
                end = starts[-1] if starts else len(group)
                groups.append(group[:end])
                group = [*names, *group[end:]]
            group.append(i)
        return [*groups, group]

    def _lines(
        self, group: Sequence[int], widths: Sequence[int], gap: int, *, ruled: bool
    ) -> Iterator[Text]:
        columns = [self.columns[i] for i in group]

        def aligned(cells: Sequence[Sequence[str]], styles: Sequence[str]) -> Iterator[Text]:
            for n in range(max(map(len, cells))):
                line = Text(no_wrap=True, overflow="ignore")
                for i, (column, room) in enumerate(zip(columns, widths, strict=True)):
                    text = cells[i][n] if n < len(cells[i]) else ""
                    blank = " " * max(room - cell_len(text), 0)
                    line.append(" " * gap if i else "")
                    line.append(text + blank if column.text else blank + text, styles[i])
                line.rstrip()
                yield line

        heads = [
            [line for part in column.title.split("\n") for line in broken(part, room)]
            for column, room in zip(columns, widths, strict=True)
        ]
        yield from aligned(heads, ["bold"] * len(group))
        if ruled:
            yield Text("\N{BOX DRAWINGS LIGHT HORIZONTAL}" * (sum(widths) + gap * (len(group) - 1)))
        for row in self.rows:
            cells = [
                broken(row[i], room) if self.columns[i].text else [row[i]]
                for i, room in zip(group, widths, strict=True)
            ]
            yield from aligned(cells, ["bold" if row[i].endswith("*") else "" for i in group])


def _widths(wanted: list[int], least: list[int], width: int) -> tuple[list[int], int]:
    """Columns as wide as they want where that has room, else the narrow first; and their gap."""
    gaps = len(wanted) - 1
    if sum(wanted) + gaps <= width:
        return wanted, 2 if sum(wanted) + 2 * gaps <= width else 1
    widths = [*least]
    for _ in range(width - gaps - sum(widths)):
        narrow = [i for i, most in enumerate(wanted) if widths[i] < most]
        widths[min(narrow, key=widths.__getitem__)] += 1
    return widths, 1


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
