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
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.findings import Finding, InputError

Of = Literal["readings", "drift", "points"]

CHAPTERS = {
    "readings": ("readings",),
    "drift": ("readings", "sensors"),
    "points": ("sensors",),
}
"""Modules of this room that hold the checks of each kind of input."""


class Odd(NamedTuple):
    """Rows (indices) of the table, facts for the template, a column."""

    rows: NDArray[np.int64]
    facts: dict[str, Any]
    column: str | None = None
    value: str | None = None


@dataclass(frozen=True, slots=True)
class ReadingsData:
    """Readings of `--lbb`, `--laser` or `--drift` and the travels (mm) of the machine's axes."""

    table: Any
    components: Mapping[str, Any] = field(default_factory=dict)
    travels: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PointsData:
    """Measured points, the part's places and the travels (mm) of the machine's axes."""

    table: Any
    part: Any = None
    travels: Mapping[str, tuple[float, float]] = field(default_factory=dict)


Find = Callable[[Any], Iterator[Odd]]
CHECKS: dict[str, list[tuple[str, Find]]] = {of: [] for of in CHAPTERS}


def check(code: str, of: Of | tuple[Of, ...]) -> Callable[[Find], Find]:
    """Registers a check of one or more kinds of input under a code of the catalogue."""

    def register(find: Find) -> Find:
        for each in (of,) if isinstance(of, str) else of:
            CHECKS[each].append((code, find))
        return find

    return register


def run(of: Of, data: ReadingsData | PointsData) -> list[Finding]:
    """The findings of all checks of this kind of input, errors among them."""
    for chapter in CHAPTERS[of]:
        import_module(f"{__name__}.{chapter}")
    return [_finding(code, odd, data) for code, find in CHECKS[of] for odd in find(data)]


def warnings_of(of: Of, data: ReadingsData | PointsData) -> list[Finding]:
    """Those of `run` that warn. Raises InputError with the errors where there are any."""
    found = run(of, data)
    if errors := [each for each in found if each.severity == "error"]:
        raise InputError(errors)
    return found


def _finding(code: str, odd: Odd, data: ReadingsData | PointsData) -> Finding:
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
