"""What is said of cells that are no ISO 8601 times, those of one kind at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from mtu_cli.files.csv_cells import TIME_EXPECTED, number
from mtu_cli.files.csv_text import Decimal

FEWEST = 3
"""Fewer cells of one kind, beside others, are slips of single rows."""
SERIAL = (40_000.0, 80_000.0)
"""Serial days of spreadsheets from 2009 to 2119."""
SERIAL_ZERO = datetime(1899, 12, 30)  # of no zone, as those are
UNIX = {"seconds": 1.0, "milliseconds": 1e3}
UNIX_SECONDS = (1e9, 4e9)
"""Of the years 2001 to 2096: nobody counts minutes up to there."""
UNIX_ZERO = datetime(1970, 1, 1)
NUMBERS, CLOCK, DATES = "numbers", "times of day", "dates"
"""Kinds of cells."""
_CLOCK = re.compile(r"[0-9]{1,2}:[0-9]{2}(?::[0-9]{2})?(?:[.,][0-9]+)?(?: *[AaPp]\.?[Mm]\.?)?")
_DATED = re.compile(
    r"(?:[0-9]{1,2}([-./])[0-9]{1,2}\1(?:[0-9]{4}|[0-9]{2})|[0-9]{4}([./])[0-9]{1,2}\2[0-9]{1,2})"
    r"(?:[T ,].*)?"
)
_MOMENT = re.compile(r"[0-9]{1,4}([-./]?)[0-9]{1,2}\1[0-9]{1,4}[T ,]+[0-9]{1,2}:[0-9]{2}.*")


class TimeFault(NamedTuple):
    """What is wrong with the cell at a place, maybe with others too, and what was expected."""

    place: int
    what: str
    expected: str


def time_faults(
    cells: Sequence[str], rows: Sequence[int], of: int, decimal: Decimal, *, minutes: bool
) -> Iterator[TimeFault]:
    """The faults of `cells` in `rows` that are no times, of a column of so many cells that are
    not empty; `minutes` where a column of them is known.
    """
    kinds: dict[str, list[int]] = {}
    for index, cell in enumerate(cells):
        kinds.setdefault(_kind(cell, decimal), []).append(index)
    for kind, own in kinds.items():
        whole = len(own) == of
        alike = bool(kind) and (whole or len(own) >= FEWEST)
        expected = _expected(kind, [cells[i] for i in own], decimal, minutes and whole)
        if alike and len(own) > 1:
            place = f"(rows {rows[own[0]]} to {rows[own[-1]]})"
            yield TimeFault(own[0], f"{len(own)} of {of} cells are no times {place}", expected)
            continue
        for index in own:
            yield TimeFault(index, "not a time", expected if alike else TIME_EXPECTED)


def _kind(cell: str, decimal: Decimal) -> str:
    cell = cell.strip()
    if number(cell, decimal) is not None:
        return NUMBERS
    if is_time_of_day(cell):
        return CLOCK
    return DATES if _DATED.fullmatch(cell) else ""


def is_time_of_day(cell: str) -> bool:
    """Whether a cell tells hours and minutes of some day."""
    return _CLOCK.fullmatch(cell) is not None


def is_moment(cell: str) -> bool:
    """Whether a cell tells a date and a time of day, in whatever order."""
    return _MOMENT.fullmatch(cell) is not None


def _expected(kind: str, cells: Sequence[str], decimal: Decimal, minutes: bool) -> str:
    if kind == CLOCK:
        return f"{TIME_EXPECTED}: the date is to stand before the time of day"
    if kind == DATES:
        return f"{TIME_EXPECTED}: year, month and day in this order, with hyphens"
    if kind != NUMBERS:
        return TIME_EXPECTED
    values = [value for cell in cells if (value := number(cell, decimal)) is not None]
    if counted := _since_1970(values):
        return f"{TIME_EXPECTED}: {counted}"
    serial, sure = _serial_days(values)
    if sure:
        return f"{TIME_EXPECTED}: {serial}"
    told = f"; or, where these are {serial}" if serial else ""
    if not minutes:
        return f"{TIME_EXPECTED}: these are plain numbers{told}"
    renamed = "where these are minutes, the column renamed to 'time_min'"
    return f"{TIME_EXPECTED} or, {renamed}{told}"


def _serial_days(values: Sequence[float]) -> tuple[str, bool]:
    """What is to be said of a spreadsheet's days since 1899-12-30, if all are; and whether they
    can be nothing else: whole numbers may be minutes or seconds.
    """
    if len(values) < FEWEST or not all(SERIAL[0] <= value <= SERIAL[1] for value in values):
        return "", False
    first = SERIAL_ZERO + timedelta(days=round(values[0] * 1440) / 1440)
    told = (
        f"serial days of a spreadsheet, the first of them {first:%Y-%m-%dT%H:%M}; "
        "give the column a date format there"
    )
    sure = not all(value.is_integer() for value in values)
    return (f"these look like {told}" if sure else told.replace(";", ",")), sure


def _since_1970(values: Sequence[float]) -> str:
    """What is to be said of seconds or milliseconds since 1970; nothing of other numbers."""
    for unit, scale in UNIX.items():
        if all(UNIX_SECONDS[0] <= value / scale <= UNIX_SECONDS[1] for value in values):
            first = UNIX_ZERO + timedelta(seconds=round(values[0] / scale))
            return f"these look like {unit} since 1970, the first of them {first:%Y-%m-%dT%H:%M:%S}"
    return ""
