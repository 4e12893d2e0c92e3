"""Plausibility of inputs: mistakes that a machine or an instrument cannot make.

A check looks at one kind of input after reading and before reporting, and yields what is `Odd`:
rows, facts and a column. It changes no number. Its code stands in the catalogue, marked as
suspicious; the severity there decides whether the run ends (exit code 2) or warns.

    @check("copied-pass", of="readings")
    def copied_pass(data: ReadingsData) -> Iterator[Odd]: ...

`run` makes the findings of all checks of one kind of input, each at the first of its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, InputError

Of = Literal["readings", "drift", "points", "part", "machine"]

CHAPTERS = {
    "readings": ("readings",),
    "drift": ("readings", "sensors"),
    "points": ("points", "copies", "sensors", "documents"),
    "part": ("documents",),
    "machine": ("documents",),
}
"""Modules of this room that hold the checks of each kind of input."""


class Odd(NamedTuple):
    """Rows (indices) of the table, the first of which is named, or a path in the document; facts
    for the template, a column and the value there.
    """

    rows: NDArray[np.int64] = np.zeros(0, np.int64)
    facts: Mapping[str, Any] = MappingProxyType({})
    column: str | None = None
    value: str | None = None
    path: tuple[str | int, ...] = ()


@dataclass(frozen=True, slots=True)
class ReadingsData:
    """Readings of `--lbb`, `--laser` or `--drift` and the travels (mm) of the machine's axes."""

    table: Any
    components: Mapping[str, Any] = field(default_factory=dict)
    travels: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PointsData:
    """Measured points, the part whose nominal places they have (None: their own), the travels (mm)
    of the machine's axes, and the freedoms of each part's coordinate system.
    """

    table: Any
    part: Any = None
    travels: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    datum: Literal["none", "offset", "offset,rotation"] = "none"


@dataclass(frozen=True, slots=True)
class DocumentData:
    """A loaded part or machine file, and the travels (mm) of the machine's axes."""

    loaded: Any
    travels: Mapping[str, tuple[float, float]] = field(default_factory=dict)


Data = ReadingsData | PointsData | DocumentData

Find = Callable[[Any], Iterator[Odd]]
CHECKS: dict[str, list[tuple[str, Find]]] = {of: [] for of in CHAPTERS}


def check(code: str, of: Of | tuple[Of, ...]) -> Callable[[Find], Find]:
    """Registers a check of one or more kinds of input under a code of the catalogue."""

    def register(find: Find) -> Find:
        for each in (of,) if isinstance(of, str) else of:
            CHECKS[each].append((code, find))
        return find

    return register


def run(of: Of, data: Data) -> list[Finding]:
    """The findings of all checks of this kind of input, errors among them."""
    for chapter in CHAPTERS[of]:
        import_module(f"{__name__}.{chapter}")
    return [_finding(code, odd, data) for code, find in CHECKS[of] for odd in find(data)]


def warnings_of(of: Of, data: Data) -> list[Finding]:
    """Those of `run` that warn. Raises InputError with the errors where there are any."""
    found = run(of, data)
    if errors := [each for each in found if each.severity == "error"]:
        raise InputError(errors)
    return found


def labels(*columns: NDArray[np.generic]) -> NDArray[np.int64]:
    """A number (n,) for every combination of values of columns (n,)."""
    codes = [np.unique(each, return_inverse=True)[1] for each in columns]
    _, found = np.unique(np.column_stack(codes), axis=0, return_inverse=True)
    return found.reshape(-1).astype(np.int64)


def _finding(code: str, odd: Odd, data: Data) -> Finding:
    if isinstance(data, DocumentData):
        return Finding(
            code=code,
            facts=odd.facts,
            file=data.loaded.source.shown,
            line=data.loaded.line_of(*odd.path),
            path=".".join(map(str, odd.path)),
            value=odd.value,
        )
    table, rows = data.table, np.asarray(odd.rows, np.int64)
    file = int(table.file_index[rows[0]])
    inside = table.row[rows[table.file_index[rows] == file]]
    return Finding(
        code=code,
        facts={**odd.facts, "rows": tuple(inside.tolist()), "count": len(rows)},
        file=table.sources[file].shown,
        row=int(table.row[rows[0]]),
        column=odd.column,
        value=odd.value,
    )
