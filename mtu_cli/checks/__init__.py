"""Plausibility of inputs: mistakes that a machine or an instrument cannot make.

A check looks at one kind of input after reading and before reporting, and yields what is `Odd`:
rows, facts and a column. It changes no number. Its code stands in the catalogue, marked as
suspicious; the severity there decides whether the run ends (exit code 2) or warns.

What a check holds against an input is of three sorts: a size that another unit makes plausible,
values that agree by more than chance, or one that is too far off its neighbours. All limits are in
`limits`; outliers are those of `stats.outliers`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.headers import LISTED_FAULTS
from mtu_cli.files.study import Datum
from mtu_cli.findings import Finding, InputError
from mtu_cli.model.visits import Visits, aligned, axes_of, visits_of
from mtu_cli.stats.groups import distinct

Rows = NDArray[np.int64]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Of = Literal["readings", "drift", "points", "part", "machine"]
Travels = Mapping[str, tuple[float, float]]

CHAPTERS = ("readings", "points", "copies")
"""Modules of this room that hold the checks."""


class Odd(NamedTuple):
    """Rows (indices) of the table, the first of which is named, or a path in the document; facts
    for the template, a column and the value there; a code where it is not that of the check.

    Where there are as many `values` as rows, each is a bad cell and a finding by itself.
    """

    rows: Rows
    facts: Mapping[str, Any]
    column: str | None = None
    value: str | None = None
    path: tuple[str | int, ...] = ()
    code: str | None = None
    values: Floats | None = None


@dataclass(frozen=True)
class ReadingsData:
    """Readings of `--lbb`, `--laser` or `--drift` and the travels (mm) of the machine's axes."""

    table: Any
    components: Mapping[str, Any] = field(default_factory=dict)
    travels: Travels = field(default_factory=dict)

    @cached_property
    def by_component(self) -> list[tuple[str, Rows]]:
        """Each component that was read, and its rows."""
        names = self.table.components
        return [(names[self.table.code[rows[0]]], rows) for rows in split(None, self.table.code)]


@dataclass(frozen=True)
class PointsData:
    """Measured points, the part whose nominal places they have (None: their own), the travels (mm)
    of the machine's axes, and the best-fit alignment that is removed from each part.
    """

    table: Any
    part: Any = None
    travels: Travels = field(default_factory=dict)
    datum: Datum = "none"

    @cached_property
    def visits(self) -> Visits:
        """The points of each measurement of each part."""
        return visits_of(self.table)

    def named(self, parts: Rows) -> Any:
        """The names of parts, in lists of the shape of the codes."""
        return np.array(self.table.parts, object)[parts].tolist()

    @cached_property
    def axes(self) -> tuple[int, ...]:
        """The axes (0, 1, 2) along which every point was measured and has a nominal."""
        return axes_of(self.table)

    @cached_property
    def errors(self) -> Floats:
        """Measured minus nominal (n, axes) less the best-fit alignment, mm."""
        table = aligned(self.table, self.axes, self.datum)
        return (table.measured - table.nominal)[:, self.axes]


@dataclass(frozen=True)
class DocumentData:
    """A loaded part or machine file, and the travels (mm) of the machine's axes."""

    loaded: Any
    travels: Travels = field(default_factory=dict)


Data = ReadingsData | PointsData | DocumentData
Find = Callable[[Any], Iterator[Odd]]
CHECKS: dict[str, list[tuple[str, Find]]] = {of: [] for of in get_args(Of)}


def check(code: str, of: Of | tuple[Of, ...]) -> Callable[[Find], Find]:
    """Registers a check of one or more kinds of input under a code, which several may have."""

    def register(find: Find) -> Find:
        for kind in (of,) if isinstance(of, str) else of:
            CHECKS[kind].append((code, find))
        return find

    return register


def data_of(
    kind: str, item: Any, machine: Any = None, part: Any = None, datum: Datum = "none"
) -> tuple[Of, Data]:
    """What the checks look at of one input of a call, a `machine`, a `part`, `points` or readings
    (`readings`, `drift`, `before`, `verify`), and as what: with the machine and part of the call.
    """
    travels = {} if machine is None else machine.travels
    if kind in ("machine", "part"):
        return cast(Of, kind), DocumentData(item, travels)
    if kind == "points":
        return "points", PointsData(item, part, travels, datum)
    components = {} if machine is None else machine.components
    return "drift" if kind == "drift" else "readings", ReadingsData(item, components, travels)


def run(of: Of, data: Data) -> list[Finding]:
    """The findings of all checks of this kind of input, errors among them."""
    for chapter in CHAPTERS:
        import_module(f"{__name__}.{chapter}")
    return [
        item
        for code, find in CHECKS[of]
        for odd in find(data)
        for item in _findings(odd.code or code, odd, data)
    ]


def warnings_of(of: Of, data: Data) -> list[Finding]:
    """Those of `run` that warn. Raises InputError with the errors where there are any."""
    result = run(of, data)
    if errors := [item for item in result if item.severity == "error"]:
        raise InputError(errors[:LISTED_FAULTS], len(errors[LISTED_FAULTS:]))
    return result


def split(rows: Rows | None, *columns: NDArray[Any]) -> list[Rows]:
    """Rows in groups that are equal in all of the columns (n,), in the order of these values and
    each in the order of `rows`; of all rows where these are None.
    """
    if rows is None:
        rows = np.arange(len(columns[0]))
    if not len(rows):
        return []
    code = np.zeros(len(rows), np.int64)
    for column in columns:
        _, value = distinct(column[rows])
        _, code = distinct(code * (value.max() + 1) + value)
    # Small whole numbers are sorted by counting them, several times quicker.
    order = np.argsort(code.astype(np.min_scalar_type(code.max())), kind="stable")
    return np.split(rows[order], np.cumsum(np.bincount(code))[:-1])


def _findings(code: str, odd: Odd, data: Data) -> Iterator[Finding]:
    """One finding at the first of the rows, or one of each where these have values."""
    if isinstance(data, DocumentData):
        place = data.loaded.place(*odd.path)
        yield Finding(code=code, facts=odd.facts, value=odd.value, **place)
        return
    rows, files = data.table.row[odd.rows], data.table.file_index[odd.rows]
    names = [data.table.sources[i].shown for i in files.tolist()]
    if odd.values is None:
        file_rows = tuple(rows[files == files[0]].tolist())
        facts = {**odd.facts, "rows": file_rows, "count": len(rows)}
        cells = [(names[0], file_rows[0], odd.value)]
    else:
        facts = {**odd.facts, "count": 1}
        values = [f"{value:g}" for value in odd.values.tolist()]
        cells = [*zip(names, rows.tolist(), values, strict=True)]
    for file, row, value in cells:
        place = {"file": file, "row": row, "column": odd.column, "value": value}
        yield Finding(code=code, facts=facts, **place)
