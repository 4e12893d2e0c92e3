"""Tables for people: coloured on a terminal, aligned plain text in a pipe, at most 100 columns.

Columns that do not fit in the width follow below, with the names of the rows again,
as pandas prints a wide frame.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from mtu_cli.reports.fields import Field

WIDTH = 100
"""Columns that a table may take."""
FOLDED = 12
"""Of these a column of text can do with."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table with a title above and notes below; a cell that ends in `*` is emphasised. Text may
    break over lines.

    Where the table is too wide even then, the columns of text in front and what else `names` the
    row begin every group of columns.
    """

    title: str
    columns: Sequence[Field]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield Text(self.title, style="bold")
        limit = min(WIDTH, options.max_width)
        titles = [column.title for column in self.columns]
        if all(title.endswith("\n") for title in titles):
            titles = [title.rstrip("\n") for title in titles]
        widths, least = [], []
        for i, column in enumerate(self.columns):
            lines = [*titles[i].split("\n"), *(row[i] for row in self.rows)]
            widths.append(max(map(cell_len, lines)))
            # A heading breaks between its words only.
            words = max(map(cell_len, titles[i].split()), default=0)
            least.append(min(widths[-1], max(FOLDED, words)) if column.text else widths[-1])
        for n, group in enumerate(self._groups(least, limit)):
            if n > 0:
                yield Text("")
            gaps = len(group) - 1
            gap = 2 if sum(widths[i] for i in group) + 2 * gaps <= limit else 1
            # On a terminal a rule below the headings, and one more blank between columns.
            box = SIMPLE_HEAD if console.is_terminal else None
            table = Table(
                box=box, show_edge=False, pad_edge=False, padding=(0, gap - bool(box), 0, 0)
            )
            for i in group:
                text = self.columns[i].text
                table.add_column(
                    Text(titles[i]), justify="left" if text else "right", header_style="bold",
                    no_wrap=not text, overflow="fold", min_width=least[i],
                )  # fmt: skip
            for row in self.rows:
                cells = (row[i] for i in group)
                table.add_row(*(Text(x, style="bold" if x.endswith("*") else "") for x in cells))
            # A terminal too narrow for a name and a number breaks the line itself.
            room = max(limit, sum(least[i] for i in group) + gaps)
            yield from console.render(table, options.update(max_width=room))
        for note in self.notes:
            yield Text(note, style="dim", overflow="fold")

    def _groups(self, least: Sequence[int], width: int) -> list[list[int]]:
        """The groups of columns that fit side by side, by their places in the table."""
        columns = range(len(self.columns))
        front = max(1, next((i for i in columns if not self.columns[i].text), 1))
        names = [i for i in columns if i < front or self.columns[i].names]
        groups, group = [], [*names]
        for i in (i for i in columns if i not in names):
            if len(group) > len(names) and sum(least[j] + 1 for j in [*group, i]) - 1 > width:
                groups.append(group)
                group = [*names]
            group.append(i)
        return [*groups, group]


def plain_text(renderables: Iterable[object]) -> str:
    """What a pipe receives: no escape codes, no trailing blanks, at most 100 columns."""
    out = io.StringIO()
    target = Console(
        file=out, width=WIDTH, highlight=False, force_terminal=False, color_system=None
    )
    for renderable in renderables:
        target.print(renderable)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"
