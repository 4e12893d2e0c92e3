"""One declaration for every figure of a report: JSON, CSV, tables, HTML and help come from it.

The analysis returns a frozen Result: labels and arrays in mm, rad, mm^2; a report calculates
nothing. `reports/COMMAND.py`, or the chapter of several commands (`predictions.py` is the model),
declares its figures as a table, and has a function of (result, digits) that returns a `Document`.
A line of the table is a `Field`, its four columns being JSON path, value, meaning and cell::

    error_um | error | actual minus nominal length | error, u=u

- Path: dots nest; ``-`` for a figure of tables or CSV alone. **The unit is the ending of the
  name**: um, um2, arcsec divide by their size, any other name leaves the value alone.
- Value: an attribute (``run.mean.0``: dots go deeper, None on the way is None); ``.`` the item
  itself; ``name()`` a function of the item, given to `declare` by its name; ``name(attribute)`` a
  function of the attribute, of those given or of `COMMON`. Without it: as the path.
- Meaning: one clause in plain English, for ``mtu help`` and the HTML report.
- Cell: the heading of the column, where a table has one (``-``: none; `` / `` begins its second
  line, which without it is the unit), then how it is shown: a key of `SHOWN` or ``name()``, a
  function of (value, u, digits); ``u=`` what the value is rounded to (JCGM 100, 7.2.6); ``mark=``
  what follows, such as a dagger; ``detail``: with ``--detail`` only; ``names``: stands again where
  a table too wide goes on below; ``unit=`` of the heading; ``size=``
  of items of different units; ``csv=`` its column where that is not the path with ``_`` (an
  interval makes two, ``_low`` and ``_high`` before the unit or in place of ``{}``); ``json``: no
  column.

A path that ends in ``.`` is a `Group`, a document within one of the figures in the lines indented
below it; ``[]`` of each of a list, ``{}`` of a mapping by name. CSV names begin with its path.
With the path ``-.`` the figures below are read from a part that has no key of its own. ``*name``
stands for fields, or a text, of those given or of `COMMON`: as a line, or as the meaning of a
group. The lines below ``for NAME UNIT in names`` are repeated with the words, or pairs of words,
that are given by that name.

Results that are arrays: ``rows_of(result, count)`` gives items whose attributes are the elements
``i`` of its arrays. None, nan and infinity are null in JSON, empty in CSV, ``-`` in a table.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from mtu_cli.findings import plain
from mtu_cli.reports import numbers
from mtu_cli.units import ARCSEC, UM

Value = str | Callable[[Any], Any]
Show = Callable[[Any, Any, int], str]

SIZES = {"mm": 1.0, "um": UM, "um2": UM**2, "arcsec": ARCSEC, "arcsec2": ARCSEC**2}
"""Endings of names that are units, and their size in mm and rad."""
UNITS = {**{name: name for name in SIZES}, "percent": "%", "degC": "degC"}


def _tolerance(tolerance: float | tuple[float, float], u: None, digits: int) -> str:
    if isinstance(tolerance, tuple):
        return " to ".join(f"{end:+g}" for end in tolerance)
    return f"±{tolerance:g}"


def _share(value: float, u: None, digits: int) -> str:
    """A negative share is of a covariance, no part of u^2: in words."""
    text = numbers.fixed(100 * abs(value), 1)
    return f"reduces u^2 by {text}" if value < 0 and float(text) else text


SHOWN: dict[str, Show] = {
    "number": lambda value, u, digits: (
        numbers.significant(value, digits) if u is None else numbers.with_u(value, u, digits)[0]
    ),
    "plus-minus": numbers.plus_minus,
    "interval": lambda ends, u, digits: numbers.interval(ends[0], ends[1], u, digits),
    "exact": lambda value, u, digits: numbers.significant(value, numbers.PLAIN_DIGITS),
    "sig3": lambda value, u, digits: numbers.significant(value, 3),
    "sig4": lambda value, u, digits: numbers.significant(value, 4),
    "fix1": lambda value, u, digits: numbers.fixed(value, 1),
    "whole": lambda value, u, digits: numbers.fixed(value, 0),
    "fix4": lambda value, u, digits: numbers.fixed(value, 4),
    "mm": lambda value, u, digits: numbers.fixed(value, 3),
    "p": lambda value, u, digits: numbers.p_value(value),
    "percent": lambda value, u, digits: numbers.percent(value),
    "percent1": lambda value, u, digits: numbers.fixed(100 * value, 1),
    "dof": lambda value, u, digits: numbers.degrees_of_freedom(value),
    "plain": lambda value, u, digits: f"{value:g}" if numbers.known(value) else numbers.MISSING,
    "count": lambda value, u, digits: str(value),
    "text": lambda value, u, digits: str(value),
    "decision": lambda value, u, digits: "yes" if value else "no*",
    "yes_no": lambda value, u, digits: "yes" if value else "no",
    "tolerance": _tolerance,
    "share": _share,
}
"""How a value of a table is written; text stands left and may break over lines."""
COMMON: dict[str, Any] = {
    "as_stated": lambda item: 1.0,
    "root": np.sqrt,
    "int": int,
    "len": len,
    "stated": lambda value: value or None,
    "words": lambda values: " ".join(filter(None, values)),
    "validation": """
        validation.
            passed | | whether the first-order interval agrees with the Monte Carlo (JCGM 101, \
                clause 8); null: the Monte Carlo cannot decide \
                | first order / valid, decision, detail, csv=validation_passed
            d_low_UNIT | d_low | difference of the lower ends | -, json
            d_high_UNIT | d_high | difference of the upper ends | -, json
            tolerance_UNIT | tolerance | largest difference allowed | -, json
    """,
}
"""Definitions that every `declare` has: functions, and the figures of several reports."""


@dataclass(frozen=True, slots=True)
class Field:
    """A figure of a report; see above."""

    path: str
    value: Value
    meaning: str = ""
    _: KW_ONLY
    csv: str | None = None
    head: str = ""
    u: Value | None = None
    show: str | Show = "number"
    unit: str | None = None
    size: Value | None = None
    mark: Value | None = None
    detail: bool = False
    names: bool = False
    within: tuple[Callable[[Any], Any], ...] = ()

    @property
    def title(self) -> str:
        """Its heading, with the unit in the second line."""
        return self.head if "\n" in self.head else f"{self.head}\n{self.unit_name}"

    @property
    def unit_name(self) -> str:
        """As a heading has it: `unit`, or the ending of the name."""
        return UNITS.get(self.path.rpartition("_")[2], "") if self.unit is None else self.unit

    def of(self, item: Any, *values: Value | None) -> list[Any]:
        """Quantities in the unit of the field, of the part that the groups around it name."""
        for within in self.within:
            item = None if item is None else within(item)
        if item is None:
            return [None] * len(values)
        size = SIZES.get(self.unit_name, 1.0) if self.size is None else read(item, self.size)
        return [_quotient(read(item, value), size) for value in values]

    def json(self, item: Any) -> Any:
        """The value as JSON holds it; an interval without one of its ends is none."""
        value = plain(self.of(item, self.value)[0])
        return None if self.show == "interval" and value and None in value else value

    def cell(self, item: Any, digits: int) -> str:
        """The value as a table shows it."""
        value, u, mark = self.of(item, self.value, self.u, self.mark)
        text = numbers.MISSING
        if value is not None:
            show = SHOWN[self.show] if isinstance(self.show, str) else self.show
            text = show(value, u, digits)
        return f"{text}{mark or ''}"

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns in the CSV."""
        name = self.path.replace(".", "_") if self.csv is None else self.csv
        if not name or self.show != "interval":
            return (name,) if name else ()
        if "{}" not in name:
            front, _, last = name.rpartition("_")
            name = f"{front}_{{}}_{last}" if last in UNITS else f"{name}_{{}}"
        return name.format("low"), name.format("high")


@dataclass(frozen=True, slots=True)
class Group:
    """Figures of a part of the item under one key, or of `many` parts (2: lists of lists); `fields`
    may be a function of the part, where names depend on it: of None for their meaning. Parts that
    are `named` are an object, others a list.
    """

    path: str
    fields: Sequence[Field | Group] | Callable[[Any], Sequence[Field | Group]]
    value: Value
    _: KW_ONLY
    many: int = 0
    named: bool = False

    def json(self, item: Any) -> Any:
        """A document, null, or with `many` a list or an object of documents."""

        def document(part: Any, depth: int) -> Any:
            if part is None or not depth:
                return None if part is None else record(self.fields, part)
            if isinstance(part, Mapping):
                return {name: document(each, depth - 1) for name, each in part.items()}
            return [document(each, depth - 1) for each in part]

        return document(read(item, self.value), self.many)


Fields = Sequence[Field | Group]


def declare(text: str, **definitions: Any) -> list[Field | Group]:
    """The figures of a table as above; `definitions` are functions and fields by the names that it
    has for them, and by names in capitals the words that replace these in the text.

    >>> [field.head for field in declare("error_um | error | actual minus nominal | error")]
    ['error']
    """
    return list(_level(text, COMMON | definitions))


def _level(text: str, definitions: Mapping[str, Any]) -> Iterator[Field | Group]:
    """Those of lines of one level, each followed by the lines within it."""
    for name, value in definitions.items():
        if name.isupper() and isinstance(value, str):
            text = text.replace(name, value)
    lines = [line for line in text.splitlines() if line.strip()]
    while lines:
        first, *lines = lines
        depth = len(first) - len(first.lstrip())
        end = next((i for i, x in enumerate(lines) if x[: depth + 1].strip()), len(lines))
        inner, lines = "\n".join(lines[:end]), lines[end:]
        if first.strip().startswith("*"):
            yield from _fields(first.strip()[1:], definitions)
            continue
        if first.split()[0] == "for":
            _, *names, _, given = first.split()
            for each in definitions[given]:
                words = dict(zip(names, [each] if isinstance(each, str) else each, strict=True))
                yield from _level(inner, {**definitions, **words})
            continue
        cells = [" ".join(each.split()) for each in re.split(r"\s\|(?=\s|$)", first)]
        path, value, meaning, cell = [*cells, "", "", ""][:4]
        name = path.rstrip(".[]{}")
        of = _value(value or name, definitions)
        if name == path:
            yield Field(path.removeprefix("-"), of, meaning, **dict(_cell(cell, definitions)))
            continue
        braces = path.count("{}")
        fields = _fields(meaning[1:], definitions) if meaning else list(_level(inner, definitions))
        many = path.count("[]") + braces
        if name == "-":
            yield from (_within(partial(read, value=of), each) for each in fields)
        else:
            yield Group(name, fields, of, many=many, named=bool(braces))


def _within(part: Callable[[Any], Any], each: Field | Group) -> Field | Group:
    """A figure, read from a part of the item."""
    if isinstance(each, Field):
        return replace(each, within=(part, *each.within))
    return replace(each, value=lambda item: read(part(item), each.value))


def _fields(name: str, definitions: Mapping[str, Any]) -> Any:
    """Fields by their name, or of the text that declares them."""
    fields = definitions[name]
    return list(_level(fields, definitions)) if isinstance(fields, str) else fields


def _value(text: str, definitions: Mapping[str, Any]) -> Value:
    """An attribute, or a function of the item or of an attribute."""
    name, bracket, attribute = text.removesuffix(")").partition("(")
    if not bracket:
        return "" if text == "." else text
    function = definitions[name]

    def quantity(item: Any) -> Any:
        value = read(item, attribute)
        return None if value is None else function(value)

    return quantity if attribute else function


def _cell(text: str, definitions: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The figure in tables and CSV, as arguments of its field."""
    head, *options = text.split(", ")
    yield "head", "" if head == "-" else re.sub(" ?/( |$)", "\n", head)
    for option in options:
        name, equals, value = option.partition("=")
        if name in ("csv", "unit"):
            yield name, value
        elif equals:
            yield name, _value(value, definitions)
        elif name in ("detail", "names"):
            yield name, True
        elif name == "json":
            yield "csv", ""
        else:
            yield "show", name if name in SHOWN else definitions[name.removesuffix("()")]


def fields_of(fields: Fields | Callable[[Any], Fields], part: Any = None) -> Fields:
    """Those of a part."""
    return fields(part) if callable(fields) else fields


def leaves(fields: Fields) -> Iterator[Field]:
    """All figures of one item, those of its parts too."""
    for each in fields:
        if isinstance(each, Field):
            yield each
        elif not each.many:
            part = partial(read, value=each.value)
            for field in leaves(fields_of(each.fields)):
                path = f"{each.path}.{field.path}" if field.path else ""
                yield replace(field, path=path, within=(part, *field.within))


def read(item: Any, value: Value | None) -> Any:
    """A quantity of an item: by a function, or by the path of an attribute."""
    if item is None or value is None:
        return None
    if not isinstance(value, str):
        return value(item)
    for name in _names(value):
        if item is None:
            return None
        if isinstance(name, int):
            item = item[name] if name < len(item) else None
        else:
            item = item.get(name) if isinstance(item, Mapping) else getattr(item, name)
    return item


@cache
def _names(path: str) -> list[str | int]:
    return [int(name) if name.isdigit() else name for name in path.split(".") if name]


def record(fields: Fields | Callable[[Any], Fields], item: Any) -> dict[str, Any]:
    """The item as JSON holds it, keys in the order of the declaration."""
    result: dict[str, Any] = {}
    for each in fields_of(fields, item):
        if not each.path:
            continue
        *outer, name = each.path.split(".")
        inner = result
        for key in outer:
            inner = inner.setdefault(key, {})
        inner[name] = each.json(item)
    return result


def _quotient(value: Any, size: Any) -> Any:
    """A value, or those of a sequence, in units of `size`."""
    if value is None or isinstance(value, str | bool) or (isinstance(size, float) and size == 1.0):
        return value
    if isinstance(value, list | tuple):
        return [_quotient(each, size) for each in value]
    return value / size


def csv_rows(fields: Fields, items: Iterable[Any]) -> tuple[list[str], Iterator[list[Any]]]:
    """Header and rows of a CSV, in full precision."""
    figures = [field for field in leaves(fields) if field.columns]

    def row(item: Any) -> Iterator[Any]:
        for field in figures:
            value = field.json(item)
            if len(field.columns) == 1:
                yield value
            else:
                yield from (None, None) if value is None else value

    header = [name for field in figures for name in field.columns]
    return header, (list(row(item)) for item in items)


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV with ``\\n`` line ends; None and numbers that are not finite are empty cells, truth
    values are true and false, members of a list stand with blanks between them.
    """

    def cell(value: Any) -> Any:
        if isinstance(value, bool):
            return "true" if value else "false"
        return " ".join(map(str, value)) if isinstance(value, list | tuple) else plain(value)

    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([cell(value) for value in row] for row in rows)
    return out.getvalue()


@dataclass(frozen=True, slots=True)
class RowOf:
    """Element `index` of everything that a result holds by rows."""

    table: Any
    index: int

    def __getattr__(self, name: str) -> Any:
        value = getattr(self.table, name)
        if isinstance(value, (np.ndarray, list, tuple)):  # a union of types takes longer
            return value[self.index]
        return RowOf(value, self.index) if hasattr(value, "__dataclass_fields__") else value


def rows_of(table: Any, count: int) -> list[RowOf]:
    """The first `count` rows of a result of arrays as items of a report."""
    return [RowOf(table, index) for index in range(count)]
