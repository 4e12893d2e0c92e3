"""Damage to CSV tables that keeps them tables: columns, rows, cells, separators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from random import Random

from fuzz.extremes import NO_NUMBERS, NUMBERS, TEXTS, UNITS


@dataclass
class Sheet:
    """A table of texts: its comments, its header, its rows, and how it is written."""

    comments: list[str]
    header: list[str]
    rows: list[list[str]]
    separator: str = ","
    quoted: bool = False
    end: str = "\n"

    def text(self) -> str:
        lines = [*self.comments, *(self._line(row) for row in (self.header, *self.rows))]
        return self.end.join(lines) + self.end

    def _line(self, cells: list[str]) -> str:
        return self.separator.join(self._cell(cell) for cell in cells)

    def _cell(self, cell: str) -> str:
        if self.quoted:
            return '"' + cell.replace('"', '""') + '"'
        return cell


def sheet_of(text: str) -> Sheet:
    """The table of a shipped file, which has plain cells."""
    lines = text.splitlines()
    comments = [line for line in lines if line.startswith("#")]
    header, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    return Sheet(comments, header, rows)


def _any_cell(rng: Random) -> str:
    return rng.choice(rng.choice((NUMBERS, NUMBERS, NO_NUMBERS, TEXTS, UNITS)))


def set_cells(sheet: Sheet, rng: Random) -> None:
    for _ in range(rng.choice((1, 1, 2, 5))):
        row = rng.choice(sheet.rows)
        if row:
            row[rng.randrange(len(row))] = _any_cell(rng)


def set_column(sheet: Sheet, rng: Random) -> None:
    column, value = rng.randrange(len(sheet.header)), _any_cell(rng)
    for row in sheet.rows:
        if column < len(row) and rng.random() < 0.95:
            row[column] = value


def scale_column(sheet: Sheet, rng: Random) -> None:
    column, factor = rng.randrange(len(sheet.header)), 10.0 ** rng.randint(-12, 12)
    for row in sheet.rows:
        try:
            row[column] = repr(float(row[column]) * factor)
        except (ValueError, IndexError):
            continue


def swap_units(sheet: Sheet, rng: Random) -> None:
    if "unit" in sheet.header:
        column, unit = sheet.header.index("unit"), rng.choice(UNITS)
        for row in sheet.rows if rng.random() < 0.5 else [rng.choice(sheet.rows)]:
            if column < len(row):
                row[column] = unit


def rename_column(sheet: Sheet, rng: Random) -> None:
    known = ("time", "time_min", "cycle", "sequence", "repeat", "operation", "pass", "direction")
    more = ("dir_x", "nominal_x_mm", "T_1_degC", "x", "pi", "T__degC", "z_mm", "part", "error")
    name = rng.choice((*known, *more, rng.choice(TEXTS), rng.choice(sheet.header)))
    sheet.header[rng.randrange(len(sheet.header))] = name


def drop_column(sheet: Sheet, rng: Random) -> None:
    if len(sheet.header) > 1:
        column = rng.randrange(len(sheet.header))
        for row in (sheet.header, *sheet.rows):
            del row[column : column + 1]


def double_column(sheet: Sheet, rng: Random) -> None:
    column = rng.randrange(len(sheet.header))
    for row in (sheet.header, *sheet.rows):
        row.extend(row[column : column + 1])
    if rng.random() < 0.7:
        rename_column(sheet, rng)


def swap_columns(sheet: Sheet, rng: Random) -> None:
    i, j = rng.randrange(len(sheet.header)), rng.randrange(len(sheet.header))
    whole = (sheet.header, *sheet.rows) if rng.random() < 0.5 else (sheet.header,)
    for row in whole:
        if max(i, j) < len(row):
            row[i], row[j] = row[j], row[i]


def shuffle_rows(sheet: Sheet, rng: Random) -> None:
    rng.shuffle(sheet.rows)


def double_row(sheet: Sheet, rng: Random) -> None:
    at = rng.randrange(len(sheet.rows))
    sheet.rows[at:at] = [[*sheet.rows[at]] for _ in range(rng.choice((1, 1, 3)))]


def keep_few(sheet: Sheet, rng: Random) -> None:
    sheet.rows = sheet.rows[: rng.choice((1, 1, 2, 3, 10))]


def other_length(sheet: Sheet, rng: Random) -> None:
    row = rng.choice(sheet.rows)
    if rng.random() < 0.5:
        row.extend([_any_cell(rng) if rng.random() < 0.5 else ""] * rng.choice((1, 1, 2, 300)))
    else:
        del row[rng.randrange(len(row) + 1) :]


def blank_line(sheet: Sheet, rng: Random) -> None:
    line = rng.choice(([""], [" "], ["", ""], ["#"], ["# x", "y"], [""] * len(sheet.header)))
    sheet.rows.insert(rng.randrange(len(sheet.rows) + 1), [*line])


def other_separator(sheet: Sheet, rng: Random) -> None:
    sheet.separator = rng.choice((";", ";", ";", "\t", "|", " ", ",,", ", "))
    if rng.random() < 0.6:
        sheet.rows = [[cell.replace(".", ",") for cell in row] for row in sheet.rows]


def quote(sheet: Sheet, rng: Random) -> None:
    sheet.quoted = True


def other_ends(sheet: Sheet, rng: Random) -> None:
    sheet.end = rng.choice(("\r\n", "\r", "\n\n", "\n\r\n", ",\n", " \n"))


def no_rows(sheet: Sheet, rng: Random) -> None:
    sheet.rows = [[]] if rng.random() < 0.5 else [[""]]


def dates(sheet: Sheet, rng: Random) -> None:
    """A column of times in place of one of minutes, one of them perhaps no time."""
    name = "time_min" if "time_min" in sheet.header else rng.choice(sheet.header)
    column = sheet.header.index(name)
    sheet.header[column] = "time"
    ending = rng.choice(("", "", "Z", "+02:00"))
    for i, row in enumerate(sheet.rows):
        if column < len(row):
            row[column] = f"2024-05-03T{i // 60 % 24:02d}:{i % 60:02d}:00{ending}"
    if rng.random() < 0.4:
        set_cells(sheet, rng)


DAMAGES: tuple[Callable[[Sheet, Random], None], ...] = (
    set_cells, set_cells, set_cells, set_cells, set_column, set_column, scale_column, swap_units,
    rename_column, rename_column, drop_column, double_column, swap_columns, shuffle_rows,
    double_row, keep_few, other_length, blank_line, other_separator, quote, other_ends, no_rows,
    dates,
)  # fmt: skip


def drop_rows(sheet: Sheet, rng: Random) -> None:
    share = rng.choice((0.02, 0.3, 0.9))
    sheet.rows = [row for row in sheet.rows if rng.random() > share] or sheet.rows[:1]


def drop_label(sheet: Sheet, rng: Random) -> None:
    """All rows with one value of a column: a part, a component, a pass."""
    column = rng.randrange(min(4, len(sheet.header)))
    label = rng.choice(sheet.rows)[column]
    sheet.rows = [row for row in sheet.rows if row[column] != label] or sheet.rows[:1]


def shift_numbers(sheet: Sheet, rng: Random) -> None:
    """Numbers of a column that stay numbers: rounded, all equal, scattered, one far away."""
    column = rng.randrange(len(sheet.header))
    way = rng.randrange(4)
    only = rng.randrange(len(sheet.rows))
    for i, row in enumerate(sheet.rows):
        try:
            value = float(row[column])
        except ValueError:
            continue
        if not isfinite(value) or (way == 3 and i != only):
            continue
        new = (round(value), 1, value + rng.gauss(0, 0.01), value + 10.0 ** rng.randint(-3, 5))
        row[column] = repr(new[way])


MILD: tuple[Callable[[Sheet, Random], None], ...] = (
    drop_rows, drop_label, shift_numbers, shift_numbers, scale_column, shuffle_rows, swap_columns,
    keep_few, drop_column, quote, dates,
)  # fmt: skip
"""What mostly leaves a table that can be read, for the sake of what is calculated of it."""


def mildly_damaged_table(text: str, rng: Random) -> str:
    """One mild damage, or two."""
    sheet = sheet_of(text)
    for _ in range(rng.choice((1, 1, 2))):
        rng.choice(MILD)(sheet, rng)
    return sheet.text()


def damaged_table(text: str, rng: Random) -> str:
    """Some damages, drawn from all of them."""
    sheet = sheet_of(text)
    if rng.random() < 0.7:
        # Small tables, of which more rows are out of place.
        start = rng.randrange(len(sheet.rows))
        sheet.rows = sheet.rows[start : start + rng.choice((2, 5, 20))]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        rng.choice(DAMAGES)(sheet, rng)
    return sheet.text()
