"""Columns of other programs that may tell the order of parts or the time of rows: by words and by
cells.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.files.column_words import NUMBER, plain
from mtu_cli.files.csv_times import is_moment, is_time_of_day

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mtu_cli.files.csv_table import Table, TableSpec

    Floats = NDArray[np.float64]
    Codes = NDArray[np.int32]

ORDER = {"order", "running", "lfd", "lfdnr", "laufende", "laufnr", "laufnummer", "folge",
         "fertigungsfolge", "fertigungsreihenfolge", "bearbeitungsfolge",
         "bearbeitungsreihenfolge", "ordre", "orden", "ordine"}  # fmt: skip
MADE = {"build", "built", "machining", "machined", "production", "manufacture", "manufacturing"}
"""An order or a number of these is that of manufacture."""
BESIDE = {"run", "part", "of", "teil"}
COUNTER = (NUMBER - {"id"}) | {"index", "idx", "counter", "zahler", "zaehler", "row", "zeile"}
FEWEST_PARTS = 3
"""Fewer are in an order by chance."""
TIME_OF_DAY = {"uhrzeit", "clock", "time", "of", "day", "heure", "hora", "ora"}
DATE = {"date", "datum", "fecha", "data"}
MINUTES = {"minute", "minutes", "minuten", "minuto", "minutos", "minuti"}
ELAPSED = {"elapsed", "since", "start", "total", "ab", "seit", "vergangene"}
HOURS = {"hour", "hours", "stunde", "stunden", "std", "heure", "heures", "hora", "horas"}
EXAMPLE = "2024-05-03T08:15"


def orders_and_times(table: Table, spec: TableSpec) -> Iterator[tuple[str, str, str]]:
    """(column, the contract's column, what is to be done) of each that may be meant as one that
    the table has not.
    """
    header = table.header
    if spec.named("sequence") and "sequence" not in header:
        for name in table.covariates:
            if told := _order(table, name):
                yield name, "sequence", told
    if "time" in header or "time_min" in header:
        return
    words = {name: _words(name) for name in table.covariates}
    dates = [name for name in words if _only(words[name], DATE)]
    hours = any(_only(own, HOURS) for own in words.values())
    for name, own in words.items():
        if spec.named("time") and _only(own, TIME_OF_DAY | DATE):
            if _all(table, name, is_moment):
                when = f"tells when, year, month and day first ({EXAMPLE})"
                yield name, "time", f"rename it where it {when}"
            elif _all(table, name, is_time_of_day):
                date = f"the date of {dates[0]!r}" if dates else "the date"
                yield name, "time", f"write {date} before it ({EXAMPLE}) where it tells when"
        minutes = spec.named("time_min") and not MINUTES.isdisjoint(own) and not hours
        if minutes and _only(own, MINUTES | ELAPSED) and _go_on(table, name):
            yield name, "time_min", "rename it where it counts minutes from one start"


def _words(name: str) -> tuple[str, ...]:
    return tuple(re.findall("[a-z]+", plain(name)))


def _only(words: Collection[str], known: Collection[str]) -> bool:
    return bool(words) and all(word in known for word in words)


def _all(table: Table, name: str, fit: Callable[[str], bool]) -> bool:
    column = table.columns.texts.get(name)
    return column is not None and bool(column.labels) and all(map(fit, column.labels))


def _go_on(table: Table, name: str) -> bool:
    """Whether numbers may count minutes: none is missing or below 0, and not all are equal."""
    values = table.columns.numbers.get(name, np.zeros(0))
    return bool(len(values) and (values >= 0).all() and np.ptp(values) > 0)


def _order(table: Table, name: str) -> str:
    """What is to be done with a column that may tell another order of the parts than that in which
    they appear; nothing where the latter, which counts without a `sequence`, says as much.
    """
    words = _words(name)
    explicit = _only(words, ORDER | MADE | BESIDE | NUMBER) and not (
        ORDER.isdisjoint(words) and (MADE.isdisjoint(words) or NUMBER.isdisjoint(words))
    )
    if not (explicit or _only(words, COUNTER)):
        return ""
    values, part = table.columns.numbers.get(name), table.columns.texts["part"].codes
    if values is None or not bool((values == np.floor(values)).all()):
        return ""
    first = _firsts(values, part)
    if len(first) < FEWEST_PARTS or len(np.unique(first)) < len(first):
        return ""
    of_parts = bool((first[part] == values).all())
    steps = np.diff(first)
    if of_parts and ((steps < 0).any() or (explicit and (steps != 1).any())):
        return "rename it where it is the order in which the parts were made"
    if not of_parts and len(np.unique(values)) == len(values) and (steps < 0).any():
        return (
            "where it tells the order in which the parts were made, give all rows of a part one "
            "number in a column of that name"
        )
    return ""


def _firsts(values: Floats, part: Codes) -> Floats:
    """The least of the values (n,) of each part, in the order in which they first appear: that of
    the codes of texts.
    """
    least = np.full(int(part.max(initial=-1)) + 1, np.inf)
    np.minimum.at(least, part, values)
    return least
