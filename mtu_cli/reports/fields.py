"""One declaration for every figure of a report: JSON, CSV, tables, HTML and help come from it.

How a command is declared (`lengths.py` is the model):

1. The analysis returns a frozen Result: labels and arrays in mm, rad, mm^2; no formatting, no
   sentence, and every quantity that the report states. A report calculates nothing.
2. `reports/COMMAND.py` holds tuples of `Field` and `Group` and a function ``document(result,
   digits)`` that returns a `Document`: title, verdict, ``results=(fields, result)``, tables of
   fields and items, the figure. The first table is the one of ``--csv``.
3. A `Field` is a figure::

       Field("error_um", "error", "actual minus nominal length", head="error", u="u")

   - `path`: the JSON key; dots nest. Without one the figure stands in tables or CSV alone. **The
     unit is the ending of the name**: um, um2, arcsec divide by their size, any other name leaves
     the value alone. `size` is for items of different units, `unit` for headings.
   - `value`: an attribute (``run.mean.0``: dots reach deeper, None on the way is None), or a
     function of the item; without it the attribute that `path` names, ``""`` the item itself.
   - `meaning`: one clause in plain English, for ``mtu help`` and the HTML report.
   - `csv`: the column's name where it is not the path with ``_``; ``""`` for no column. An
     interval makes two columns, ``_low`` and ``_high`` before the unit or in place of ``{}``.
   - `head`: the column's heading in a table, where it has one; the unit goes below it. A column
     without any value in it is not shown, one of `detail` only with ``--detail``.
   - `u`: what the value is rounded to (JCGM 100, 7.2.6); `show`: a key of `SHOWN` or a function
     of (value, u, digits); `mark`: what follows the cell, such as ``*`` or a dagger.
   - `begins`: a table too wide for its columns rather goes on below from here, where the columns
     that are text or `names` the row stand again.
4. A `Group` is a document within one: of one part of the item (null where it is None), or with
   `many` of each of a list (a mapping makes a JSON object by name; of lists of lists `many` is
   2). CSV names begin with its path.
5. Results that are arrays: ``rows_of(found, count)`` gives items whose attributes are the
   elements ``i`` of the arrays of `found`, so that ``"predicted.mean"`` is a figure of item i.

None, nan and infinity are null in JSON, empty in CSV, ``-`` in a table.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from mtu_cli.reports import numbers
from mtu_cli.units import ARCSEC, UM

Value = str | Callable[[Any], Any]
Show = Callable[[Any, Any, int], str]

SIZES = {"mm": 1.0, "um": UM, "um2": UM**2, "arcsec": ARCSEC, "arcsec2": ARCSEC**2}
"""Endings of names that are units, and their size in mm and rad."""
UNITS = {**{name: name for name in SIZES}, "percent": "%", "degC": "degC"}

VERDICTS = {True: "yes", False: "no*", None: "undecided"}

SHOWN: dict[str, Show] = {
    "number": lambda value, u, digits: (
        numbers.significant(value, digits) if u is None else numbers.with_u(value, u, digits)[0]
    ),
    "plus-minus": numbers.plus_minus,
    "interval": lambda ends, u, digits: numbers.interval(ends[0], ends[1], u, digits),
    "exact": lambda value, u, digits: numbers.significant(value, numbers.PLAIN_DIGITS),
    "mm": lambda value, u, digits: numbers.fixed(value, 3),
    "p": lambda value, u, digits: numbers.p_value(value),
    "percent": lambda value, u, digits: numbers.percent(value),
    "dof": lambda value, u, digits: numbers.degrees_of_freedom(value),
    "count": lambda value, u, digits: str(value),
    "text": lambda value, u, digits: str(value),
}
"""How a value of a table is written; text stands left and may break over lines."""


@dataclass(frozen=True, slots=True)
class Field:
    """A figure of a report; see above."""

    path: str = ""
    value: Value | None = None
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
    begins: bool = False
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

    def of(self, item: Any, value: Value | None) -> Any:
        """A quantity of the item in the unit of the field."""
        size = SIZES.get(self.unit_name, 1.0) if self.size is None else read(item, self.size)
        return _divided(read(item, value), size)

    def part(self, item: Any) -> Any:
        """What the figure is of: the item, or the part of it that the groups around it name."""
        for within in self.within:
            item = None if item is None else within(item)
        return item

    def json(self, item: Any) -> Any:
        """The value as JSON holds it; an interval without one of its ends is none."""
        part = self.part(item)
        value = None if part is None else plain(self.of(part, self.source))
        return None if self.show == "interval" and value and None in value else value

    @property
    def source(self) -> Value:
        """Where the value is read."""
        return self.path if self.value is None else self.value

    def cell(self, item: Any, digits: int) -> str:
        """The value as a table shows it."""
        part = self.part(item)
        value = None if part is None else self.of(part, self.source)
        mark = None if part is None else read(part, self.mark)
        text = numbers.MISSING
        if value is not None:
            show = SHOWN[self.show] if isinstance(self.show, str) else self.show
            text = show(value, None if self.u is None else self.of(part, self.u), digits)
        return f"{text}{mark or ''}"

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns in the CSV."""
        name = self.path.replace(".", "_") if self.csv is None else self.csv
        if not name or self.show != "interval":
            return (name,) if name else ()
        if "{}" in name:
            return name.format("low"), name.format("high")
        front, _, last = name.rpartition("_")
        unit = f"_{last}" if last in UNITS else ""
        front = front if unit else name
        return f"{front}_low{unit}", f"{front}_high{unit}"


@dataclass(frozen=True, slots=True)
class Group:
    """Figures of a part of the item under one key, or of `many` parts; `fields` may be a function
    of the part, where names depend on it: of None for their meaning. Parts that are `named` are
    an object, others a list.
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
            yield replace(field, path=path, value=field.source, csv=csv, within=within)


Fields = Sequence[Field | Group]


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


def count(path: str) -> Callable[[Any], int]:
    """A whole number that an array holds as a float."""
    return lambda item: int(read(item, path))


def root(path: str) -> Callable[[Any], Any]:
    """The standard deviation of a variance, or those of several."""
    return lambda item: np.sqrt(read(item, path))


def record(fields: Fields | Callable[[Any], Fields], item: Any) -> dict[str, Any]:
    """The item as JSON holds it, keys in the order of the declaration."""
    found: dict[str, Any] = {}
    for each in fields_of(fields, item):
        if not each.path:
            continue
        *outer, name = each.path.split(".")
        inner = found
        for key in outer:
            inner = inner.setdefault(key, {})
        inner[name] = each.json(item)
    return found


def _divided(value: Any, size: Any) -> Any:
    """A value, or those of a sequence or mapping, in units of `size`."""
    if isinstance(value, float) and isinstance(size, float):
        return value / size
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
    return Group(
        "validation",
        (
            Field(
                "passed",
                meaning="whether the first-order interval agrees with the Monte Carlo (JCGM 101, "
                "clause 8); null: the Monte Carlo cannot decide",
                csv=csv,
            ),
            Field(
                "",
                lambda found: VERDICTS[found.passed],
                head="first order\nvalid",
                show="text",
                detail=True,
            ),
            Field(f"d_low{ending}", "d_low", "difference of the lower ends", csv=""),
            Field(f"d_high{ending}", "d_high", "difference of the upper ends", csv=""),
            Field(f"tolerance{ending}", "tolerance", "largest difference allowed", csv=""),
        ),
    )


def conformance(unit: str) -> Group:
    """The probability that an error of a future part is within its tolerance, in `unit`."""
    return Group(
        "conformance",
        (
            Field(
                f"tolerance_{unit}",
                "tolerance.stated",
                "errors allowed: plus and minus this, or [low, high]; conformance is null without",
                csv=f"tolerance_{unit}",
                head="tolerance",
                # As the part file has it, in its unit.
                size=lambda _: 1.0,
                show=_tolerance,
            ),
            conforming(),
        ),
    )


def conforming() -> Field:
    """The probability of conformance."""
    return Field(
        "probability",
        meaning="probability that a future part is within the tolerance",
        csv="conformance_probability",
        head="conforming\n%",
        show="percent",
    )


def _tolerance(stated: float | tuple[float, float], u: None, digits: int) -> str:
    if isinstance(stated, tuple):
        return " to ".join(f"{end:+g}" for end in stated)
    return f"±{stated:g}"


def shares(path: str = "shares", value: Value | None = None) -> Group:
    """What a variance consists of; null under independence and where u is 0."""
    meanings = {
        "coefficients": "share of u^2 of the coefficients, the same for all parts",
        "passes": "share of the drift between passes, common to the points of one part; "
        "negative: a covariance that reduces u",
        "repeatability": "share of the repeatability of every visit",
    }
    return Group(
        path,
        [
            Field(name, name, text, head=f"{name}\n% of u^2", show=_share, detail=True)
            for name, text in meanings.items()
        ],
        value,
        csv=False,
    )


def _share(value: float, u: None, digits: int) -> str:
    """A negative share is of a covariance, no part of u^2: it says what it does."""
    shown = numbers.fixed(100 * abs(value), 1)
    return f"reduces u^2 by {shown}" if value < 0 and float(shown) else shown
