"""One declaration for every figure of a report: JSON, CSV, tables, HTML and help come from it.

The analysis returns a frozen Result: labels and arrays in mm, rad, mm^2; a report calculates
nothing. `reports/COMMAND.py` declares its figures as a table (`lengths.py` is the model) and has a
function ``document(result, digits)`` that returns a `Document`. A line of the table is a `Field`,
its four columns being JSON path, value, meaning and cell::

    error_um | error | actual minus nominal length | error, u=u

- Path: dots nest; ``-`` for a figure of tables or CSV alone. **The unit is the ending of the
  name**: um, um2, arcsec divide by their size, any other name leaves the value alone.
- Value: an attribute (``run.mean.0``: dots reach deeper, None on the way is None); ``.`` the item
  itself; ``name()`` a function of the item, given to `declare` by its name; ``name(attribute)`` a
  function of the attribute, of those given or of `OF_ATTRIBUTE`. Without it: as the path.
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
``*name`` stands for fields that are given to `declare`: as a line, or as the meaning of a group.

Results that are arrays: ``rows_of(result, count)`` gives items whose attributes are the elements
``i`` of its arrays. None, nan and infinity are null in JSON, empty in CSV, ``-`` in a table.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from mtu_cli.reports import numbers
from mtu_cli.units import ARCSEC, UM

Value = str | Callable[[Any], Any]
Show = Callable[[Any, Any, int], str]

SIZES = {"mm": 1.0, "um": UM, "um2": UM**2, "arcsec": ARCSEC, "arcsec2": ARCSEC**2}
"""Endings of names that are units, and their size in mm and rad."""
UNITS = {**{name: name for name in SIZES}, "percent": "%", "degC": "degC"}

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
    "fix4": lambda value, u, digits: numbers.fixed(value, 4),
    "mm": lambda value, u, digits: numbers.fixed(value, 3),
    "p": lambda value, u, digits: numbers.p_value(value),
    "percent": lambda value, u, digits: numbers.percent(value),
    "percent1": lambda value, u, digits: numbers.fixed(100 * value, 1),
    "dof": lambda value, u, digits: numbers.degrees_of_freedom(value),
    "span": lambda ends, u, digits: numbers.span(*(numbers.significant(x, digits) for x in ends)),
    "plain": lambda value, u, digits: f"{value:g}",
    "count": lambda value, u, digits: str(value),
    "text": lambda value, u, digits: str(value),
}
"""How a value of a table is written; text stands left and may break over lines."""
COLUMN = re.compile(r"\s\|(?=\s|$)")
"""Between the columns of a declaration."""
OF_ATTRIBUTE: dict[str, Callable[[Any], Any]] = {
    "as_stated": lambda item: 1.0,
    "root": np.sqrt,
    "int": int,
    "len": len,
    "stated": lambda value: value or None,
    "words": lambda values: " ".join(filter(None, values)),
}
"""Functions that need not be given to `declare`; `as_stated`: a size, of values in their unit."""


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
    def text(self) -> bool:
        """Whether it is text, which stands left and may break over lines."""
        return self.show == "text"

    @property
    def unit_name(self) -> str:
        """As a heading has it: `unit`, or the ending of the name."""
        return UNITS.get(self.path.rpartition("_")[2], "") if self.unit is None else self.unit

    def of(self, item: Any, *values: Value | None) -> list[Any]:
        """Quantities in the unit of the field; of the item, or the part of it that the groups
        around the field name.
        """
        for within in self.within:
            item = None if item is None else within(item)
        if item is None:
            return [None] * len(values)
        size = SIZES.get(self.unit_name, 1.0) if self.size is None else read(item, self.size)
        return [_divided(read(item, value), size) for value in values]

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
    value: Value | None = None
    _: KW_ONLY
    many: int = False
    named: bool = False
    csv: bool = True

    def part(self, item: Any) -> Any:
        """What the figures are of."""
        return read(item, self.path if self.value is None else self.value)

    def json(self, item: Any) -> Any:
        """A document, null, or with `many` a list or an object of documents."""
        part = self.part(item)
        return None if part is None else self._each(part, int(self.many))

    def _each(self, part: Any, depth: int) -> Any:
        if not depth:
            return record(self.fields, part)
        if isinstance(part, Mapping):
            return {name: self._each(each, depth - 1) for name, each in part.items()}
        return [self._each(each, depth - 1) for each in part]

    def leaves(self) -> Iterator[Field]:
        """Its figures as those of the whole item."""
        for field in () if self.many else leaves(fields_of(self.fields)):
            path = f"{self.path}.{field.path}" if field.path else ""
            csv, within = field.csv if self.csv else "", (self.part, *field.within)
            yield replace(field, path=path, csv=csv, within=within)


Fields = Sequence[Field | Group]


def declare(text: str, **known: Any) -> list[Field | Group]:
    """The figures of a table as above; `known` are its functions and fields by name.

    >>> [field.head for field in declare("error_um | error | actual minus nominal | error")]
    ['error']
    """
    return list(_declared([line for line in text.splitlines() if line.strip()], known))


def _declared(lines: list[str], known: Mapping[str, Any]) -> Iterator[Field | Group]:
    """Those of lines of one level, each followed by the lines within it."""
    while lines:
        first, *lines = lines
        depth = len(first) - len(first.lstrip())
        end = next((i for i, x in enumerate(lines) if x[: depth + 1].strip()), len(lines))
        inner, lines = lines[:end], lines[end:]
        if first.strip().startswith("*"):
            yield from known[first.strip()[1:]]
            continue
        cells = [" ".join(each.split()) for each in COLUMN.split(first)]
        path, value, meaning, cell = [*cells, "", "", ""][:4]
        name = path.rstrip(".[]{}")
        of = _value(value or name, known)
        if name == path:
            yield Field(path.removeprefix("-"), of, meaning, **dict(_cell(cell, known)))
            continue
        named = path.count("{}")
        fields = known[meaning[1:]] if meaning else list(_declared(inner, known))
        many = path.count("[]") + named
        yield Group(name, fields, of, many=many, named=bool(named), csv=cell != "json")


def _value(text: str, known: Mapping[str, Any]) -> Value:
    """An attribute, or a function of the item or of an attribute."""
    name, bracket, attribute = text.removesuffix(")").partition("(")
    if not bracket:
        return "" if text == "." else text
    function = known[name] if name in known else OF_ATTRIBUTE[name]
    return partial(_applied, function, attribute) if attribute else function


def _applied(function: Callable[[Any], Any], attribute: str, item: Any) -> Any:
    value = read(item, attribute)
    return None if value is None else function(value)


def _cell(text: str, known: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """How the figure stands in tables and CSV, as arguments of its field."""
    head, *options = text.split(", ")
    yield "head", "" if head == "-" else re.sub(" ?/( |$)", "\n", head)
    for option in options:
        name, equals, value = option.partition("=")
        if name in ("csv", "unit"):
            yield name, value
        elif equals:
            yield name, _value(value, known)
        elif name in ("detail", "names"):
            yield name, True
        elif name == "json":
            yield "csv", ""
        else:
            yield "show", name if name in SHOWN else known[name.removesuffix("()")]


def fields_of(fields: Fields | Callable[[Any], Fields], part: Any = None) -> Fields:
    """Those of a part."""
    return fields(part) if callable(fields) else fields


def leaves(fields: Fields) -> Iterator[Field]:
    """All figures of one item, those of its parts too."""
    for each in fields:
        if isinstance(each, Field):
            yield each
        else:
            yield from each.leaves()


def read(item: Any, value: Value | None) -> Any:
    """A quantity of an item: by a function, or by the name of an attribute."""
    if value is None:
        return None
    return _getter(value)(item) if isinstance(value, str) else value(item)


@cache
def _getter(path: str) -> Callable[[Any], Any]:
    names = [name for name in path.split(".") if name]

    def found(item: Any) -> Any:
        for name in names:
            if item is None:
                return None
            if name.isdigit():
                item = item[int(name)]
            else:
                item = item.get(name) if isinstance(item, Mapping) else getattr(item, name)
        return item

    return found


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


def _divided(value: Any, size: Any) -> Any:
    """A value, or those of a sequence or mapping, in units of `size`."""
    if value is None or isinstance(value, str | bool) or (isinstance(size, float) and size == 1.0):
        return value
    if isinstance(value, Mapping):
        return {name: _divided(each, size) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_divided(each, size) for each in value]
    return value / size


def plain(value: Any) -> Any:
    """What JSON can hold: lists for arrays, None for what is not finite."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and np.isfinite(value).all():
        return value.tolist()
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    return [plain(each) for each in value]


def csv_rows(fields: Fields, items: Iterable[Any]) -> tuple[list[str], Iterator[list[Any]]]:
    """Header and rows of a CSV, in full precision."""
    kept = [field for field in leaves(fields) if field.columns]

    def row(item: Any) -> Iterator[Any]:
        for field in kept:
            value = field.json(item)
            if len(field.columns) == 1:
                yield value
            else:
                yield from (None, None) if value is None else value

    header = [name for field in kept for name in field.columns]
    return header, (list(row(item)) for item in items)


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """CSV with ``\\n`` line ends; None and numbers that are not finite are empty cells, truth
    values are true and false, members of a list stand with blanks between them.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_csv_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _csv_cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value)) if math.isfinite(value) else ""
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


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


def validation(unit: str, *, csv: str = "") -> Group:
    """The outcome of JCGM 101, clause 8, with differences in `unit` (none: that of the figures);
    `csv` names its column.
    """
    ending = f"_{unit}" if unit else ""
    verdicts = {True: "yes", False: "no*", None: "undecided"}
    text = f"""
        passed | | whether the first-order interval agrees with the Monte Carlo (JCGM 101, \
            clause 8); null: the Monte Carlo cannot decide | -, csv={csv}
        - | verdict() | | first order / valid, text, detail
        d_low{ending} | d_low | difference of the lower ends | -, json
        d_high{ending} | d_high | difference of the upper ends | -, json
        tolerance{ending} | tolerance | largest difference allowed | -, json
    """
    return Group("validation", declare(text, verdict=lambda found: verdicts[found.passed]))


def conformance(unit: str) -> Group:
    """The probability that an error of a future part is within its tolerance, in `unit`."""
    return Group("conformance", declare(CONFORMANCE.replace("UNIT", unit), **CONFORMING))


def _tolerance(stated: float | tuple[float, float], u: None, digits: int) -> str:
    if isinstance(stated, tuple):
        return " to ".join(f"{end:+g}" for end in stated)
    return f"±{stated:g}"


CONFORMING: dict[str, Any] = {
    "conforming": declare("""
        probability | | probability that a future part is within the tolerance \
            | conforming / %, percent, csv=conformance_probability
    """),
    "tolerance": _tolerance,
}
CONFORMANCE = """
    tolerance_UNIT | tolerance.stated | errors allowed: plus and minus this, or [low, high]; \
        conformance is null without | tolerance, tolerance(), csv=tolerance_UNIT, size=as_stated()
    *conforming
"""
SHARES = """
    coefficients | | share of u^2 of the coefficients, the same for all parts \
        | coefficients / % of u^2, share(), detail
    passes | | share of the drift between passes, common to the points of one part; negative: \
        a covariance that reduces u | passes / % of u^2, share(), detail
    repeatability | | share of the repeatability of every visit \
        | repeatability / % of u^2, share(), detail
"""


def shares(path: str = "shares", value: Value | None = None) -> Group:
    """What a variance consists of; null under independence and where u is 0."""
    return Group(path, declare(SHARES, share=_share), value, csv=False)


def _share(value: float, u: None, digits: int) -> str:
    """A negative share is of a covariance, no part of u^2: it says what it does."""
    shown = numbers.fixed(100 * abs(value), 1)
    return f"reduces u^2 by {shown}" if value < 0 and float(shown) else shown
