"""The report of a command, before it is terminal text, JSON, CSV or HTML, and as one HTML file that
needs no other, or the same as PDF.

Undefined figures are null, with a warning; degrees of freedom that are null are infinite.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from importlib import import_module
from importlib.resources import files
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table as Grid
from rich.text import Text

from mtu_cli import __version__
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, error, plain
from mtu_cli.model.settings import Settings
from mtu_cli.reports import figures
from mtu_cli.reports.fields import Field, Fields, Group, csv_rows, fields_of, leaves, record
from mtu_cli.reports.numbers import MISSING

KIND = {True: "components and points independent", False: "covariance included"}
"""Of correlation, by whether it is independent."""
WIDTH = 100
"""Columns that a table may take."""


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
            # A heading breaks between its words only; 12 columns do for other text.
            words = max(map(cell_len, titles[i].split()), default=0)
            least.append(min(widths[-1], max(12, words)) if column.show == "text" else widths[-1])
        for n, group in enumerate(self._groups(least, limit)):
            if n > 0:
                yield Text("")
            gaps = len(group) - 1
            gap = 2 if sum(widths[i] for i in group) + 2 * gaps <= limit else 1
            # On a terminal a rule below the headings, and one more blank between columns.
            box = SIMPLE_HEAD if console.is_terminal else None
            grid = Grid(
                box=box, show_edge=False, pad_edge=False, padding=(0, gap - bool(box), 0, 0)
            )
            for i in group:
                text = self.columns[i].show == "text"
                grid.add_column(
                    Text(titles[i]), justify="left" if text else "right", header_style="bold",
                    no_wrap=not text, overflow="fold", min_width=least[i],
                )  # fmt: skip
            for row in self.rows:
                cells = (row[i] for i in group)
                grid.add_row(*(Text(x, style="bold" if x.endswith("*") else "") for x in cells))
            # A terminal too narrow for a name and a number breaks the line itself.
            room = max(limit, sum(least[i] for i in group) + gaps)
            yield from console.render(grid, options.update(max_width=room))
        for note in self.notes:
            yield Text(note, style="dim", overflow="fold")

    def _groups(self, least: Sequence[int], width: int) -> list[list[int]]:
        """The groups of columns that fit side by side, by their places in the table."""
        columns = range(len(self.columns))
        front = max(1, next((i for i in columns if self.columns[i].show != "text"), 1))
        names = [i for i in columns if i < front or self.columns[i].names]
        groups, group = [], [*names]
        for i in (i for i in columns if i not in names):
            if len(group) > len(names) and sum(least[j] + 1 for j in [*group, i]) - 1 > width:
                groups.append(group)
                group = [*names]
            group.append(i)
        return [*groups, group]


@dataclass(frozen=True, slots=True)
class Table:
    """Fields of items under a title, with a `footer`, and with ``--detail`` the `notes`; with
    `detail` the whole table needs it. `selection` are the items of the printed table where it has
    not all.
    """

    title: str
    fields: Fields
    items: Sequence[Any]
    footer: str = ""
    notes: Sequence[str] = ()
    _: KW_ONLY
    selection: Sequence[Any] | None = None
    detail: bool = False

    def sheet(self, digits: int, *, detail: bool) -> Sheet:
        """The cells as people read them, without columns that have nothing in them."""
        columns, cells = list[Field](), list[list[str]]()
        for field in (f for f in leaves(self.fields) if f.head and (detail or not f.detail)):
            column = [field.cell(item, digits) for item in self.printed]
            if all(text in (MISSING, "") for text in column):
                continue
            if field.show == "mm" and all(text.endswith((".000", MISSING)) for text in column):
                column = [text.removesuffix(".000") for text in column]
            cells.append(column)
            columns.append(field)
        notes = [*filter(None, [self.footer]), *(self.notes if detail else ())]
        return Sheet(self.title, columns, list(zip(*cells, strict=True)), notes)

    @property
    def printed(self) -> Sequence[Any]:
        """The items of the printed table."""
        return self.items if self.selection is None else self.selection


@dataclass(frozen=True, slots=True)
class Document:
    """A report: `results` are the fields of the JSON document and the item they are read from. The
    first of `tables` is the main one, of which ``--csv`` has every item; `draw` takes the item of
    `results`, and is None where there is nothing to draw. `verdict` is what the figures say, in a
    sentence; `title` heads the file that is handed on.
    """

    title: str
    results: tuple[Fields, Any]
    tables: Sequence[Table]
    draw: Callable[[Any], figures.Figure] | None
    verdict: str = ""
    digits: int = 2

    @property
    def figure(self) -> Callable[[], figures.Figure] | None:
        """The picture, which is drawn where it is asked for."""
        return self.draw and partial(self.draw, self.results[1])

    def record(self) -> dict[str, Any]:
        """`results` of the JSON report."""
        return record(*self.results)

    def rows(self) -> tuple[Sequence[str], Iterable[Sequence[Any]]]:
        """Header and rows of the CSV."""
        return csv_rows(self.tables[0].fields, self.tables[0].items)

    def blocks(self, *, detail: bool = False) -> Iterator[Text | Sheet]:
        """The verdict and the tables, for terminals and HTML; with `detail` all of them."""
        if self.verdict:
            yield Text(self.verdict)
        tables = [each for each in self.tables if each.printed]
        selection = [each for each in tables if detail or not each.detail]
        for table in selection:
            yield table.sheet(self.digits, detail=detail)
        if tables and not selection:
            counts = ", ".join(f"{each.title} ({len(each.items)} rows)" for each in tables)
            yield Text(f"{counts}: with --detail; all figures with --csv and -o")


def plain_text(renderables: Iterable[object]) -> str:
    """What a pipe receives: no escape codes, no trailing blanks, at most 100 columns."""
    out = io.StringIO()
    target = Console(
        file=out, width=WIDTH, highlight=False, force_terminal=False, color_system=None
    )
    for renderable in renderables:
        target.print(renderable)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def envelope(
    command: str,
    *,
    inputs: Iterable[Source],
    settings: Settings,
    results: Mapping[str, Any],
    warnings: Iterable[Finding] = (),
    at: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The whole document of a command, ``mtu/<command>/1``; `at` are the covariates given."""
    distinct = {(item.code, item.message): item for item in warnings}
    return {
        "schema": f"mtu/{command.replace(' ', '-')}/1",
        "tool": {"name": "mtu", "version": __version__},
        "inputs": [
            {"role": item.role, "path": item.shown, "sha256": item.sha256, "rows": item.rows}
            | ({"synthetic": True} if item.synthetic else {})
            for item in inputs
        ],
        "settings": {
            "coverage_factor": plain(settings.coverage_factor),
            "seed": settings.seed,
            "correlation": settings.correlation,
            "digits": settings.digits,
            "trials": settings.trials,
            "at": {name: float(value) for name, value in (at or {}).items()},
        },
        "results": dict(results),
        "warnings": [item.to_dict() for item in distinct.values()],
    }


REPORTS = {
    **{
        command: (command.replace("-", "_"), "document", "RESULTS", "ROW")
        for command in ("fit-components", "anova", "compare", "close-loop", "thermal-fit",
                        "correct", "budget", "compensate")
    },
    "predict-points": ("predictions", "points", "POINTS", "POINT"),
    "lengths": ("predictions", "lengths", "LENGTHS", "LENGTH"),
    "orthogonality": ("predictions", "orthogonality", "ANGLES", "ANGLE"),
    "iso230": ("standards", "positioning", "POSITIONING", "FIGURE_ROW"),
    "circular": ("standards", "circular", "CIRCULAR", "CAUSE"),
    "graph check": ("graph", "check", "CHECK", "STEP"),
    "graph simulate": ("graph", "simulate", "SIMULATION", "COORDINATE_ROW"),
    "graph sweep": ("graph", "sweep", "SWEEP", "GRID_ROW"),
}  # fmt: skip
"""By command: its module, and in it what makes the document, the fields of `results` and those of a
row of --csv. Where they depend on the input (axes, coefficients, units, what is varied), these are
of the usual one."""


def document_of(command: str, result: Any, digits: int) -> Document:
    """The document of a command's result."""
    name, make, *_ = REPORTS[command]
    return getattr(import_module(f"mtu_cli.reports.{name}"), make)(result, digits)


def declaration(command: str) -> tuple[Fields, Fields]:
    """The fields of `results` and of a row of --csv."""
    name, _, results, row = REPORTS[command]
    module = import_module(f"mtu_cli.reports.{name}")
    return getattr(module, results), getattr(module, row)


def meanings(fields: Fields, within: str = "") -> Iterator[tuple[str, str]]:
    """Path in `results` and meaning of every figure of JSON: for help and tests."""
    for each in fields:
        path = f"{within}{each.path}"
        if isinstance(each, Group):
            member = (".<name>" if each.named else "[]") * each.many
            yield from meanings(fields_of(each.fields), f"{path}{member}.")
        elif each.path:
            yield path, each.meaning


def column_meanings(fields: Fields) -> Iterator[tuple[str, str]]:
    """Name and meaning of every column of a CSV."""
    for field in leaves(fields):
        ends = ("", "") if len(field.columns) < 2 else ("; its lower end", "; its upper end")
        for name, end in zip(field.columns, ends, strict=False):
            yield name, f"{field.meaning}{end}"


def help_text(command: str) -> str:
    """Markdown: the meaning of the keys of the report and columns of --csv; also of a group."""
    lines = []
    for name in REPORTS:
        if name == command or name.startswith(f"{command} "):
            results, row = declaration(name)
            for title, kind, entries in (
                (f"Report of {name}: `results` of --out", "key", meanings(results)),
                (f"Columns of --csv of {name}", "column", column_meanings(row)),
            ):
                lines += ["", f"## {title}", "", f"| {kind} | meaning |", "|---|---|"]
                lines += [f"| `{x}` | {text.replace('|', chr(92) + '|')} |" for x, text in entries]
    return "".join(f"{line}\n" for line in lines)


def page_bytes(
    suffix: str,
    svg: str,
    blocks: Iterable[Any],
    warnings: Iterable[Finding],
    settings: Mapping[str, Any],
    **context: Any,
) -> bytes:
    """The file; the same bytes for the same page. `svg` is the picture, empty without one, `blocks`
    are those of a document, `context` its title, subject (names of machine and study), inputs and
    date.

    Raises InputError for a PDF without the package that writes it.
    """
    from jinja2 import Environment
    from markupsafe import Markup

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    source = (files("mtu_cli.reports") / "report.html.j2").read_text("utf-8")
    page = environment.from_string(source).render(
        blocks=[each.plain if isinstance(each, Text) else each for each in blocks],
        # Without the head of a file; nothing in it leaves the page.
        figure=Markup(re.sub(r"^.*?(?=<svg)|<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)),
        warnings=list({each.message: each for each in warnings}.values()),
        # Numbers to six significant digits.
        settings={k: f"{x:.6g}" if isinstance(x, float) else x for k, x in settings.items()},
        version=__version__,
        **context,
    )
    if suffix != ".pdf":
        return page.encode()
    try:
        from weasyprint import HTML  # type: ignore[import-not-found,unused-ignore]  # an extra
    except (ImportError, OSError):
        expected = "the extra mtu-cli[pdf] (pip install 'mtu-cli[pdf]'), or a name ending in .html"
        reason = "this installation writes no PDF"
        raise error("output-form", path="--report", reason=reason, expected=expected) from None
    return HTML(string=page).write_pdf()
