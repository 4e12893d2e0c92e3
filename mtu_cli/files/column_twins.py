"""Columns that may be meant as one of the contract: by their letters, as a count or as signs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.column_dimensions import POSITIONS
from mtu_cli.files.column_orders import orders_and_times
from mtu_cli.files.column_words import (
    direction_alone,
    direction_along,
    nominal_by_sign,
    plain,
)
from mtu_cli.files.contracts import NAME_TAKEN
from mtu_cli.files.csv_header import may_count
from mtu_cli.files.csv_missing import MEASUREMENTS, squeezed
from mtu_cli.files.csv_table import Table, TableSpec
from mtu_cli.files.source import DRIFT
from mtu_cli.findings import Finding
from mtu_cli.language.functions import MACHINE_FUNCTIONS

TAKEN = (
    dict.fromkeys(POSITIONS, "the position")
    | dict.fromkeys(MACHINE_FUNCTIONS, "a function")
    | {"pi": "a number"}
)
"""What the equation language means by names that columns may have."""
OF_READINGS = {"direction": "is the direction of travel", "setup": "tells set-ups apart"}
NOT_USED = "column-not-used"
COUNTS = ("repeat", "pass")
SETUPS = ("setup", "aufspannung", "aufbau", "montage")
SIGNS = {"+", "-", "+1", "-1", "1", "pos", "neg", "positive", "negative", "positiv", "negativ",
         "forward", "reverse", "plus", "minus"}  # fmt: skip
_ALONG = re.compile("[+-] ?[xyz]|[xyz] ?[+-]", re.IGNORECASE)
NOMINAL = "nominal_"


def column_twins(tables: Iterable[Table], spec: TableSpec) -> Iterator[Finding]:
    """One warning a column: of `error` and `Error` the first alone is read, and a reader of the
    table may take the other for it; a `Run` may be the repeat, or the pass, and `Richtung_x` the
    direction along x. Nor is a column that an equation cannot name.
    """
    for given in tables:
        # Of a block of a long file, columns of texts are named by its own contract.
        free = tuple(name for name in given.header if not spec.named(name))
        table = replace(given, covariates=free)
        # No equation has columns of drifts.
        taken = () if table.source.role == DRIFT else TAKEN
        for other in filter(taken.__contains__, table.covariates):
            yield _notice(
                table, other, NAME_TAKEN,
                f"cannot be named in an equation, where {other!r} is {TAKEN[other]}; rename it "
                f"where one needs it, such as to '{other}_value'",
            )  # fmt: skip
        for other in table.covariates:
            own = _maybe(other, table, spec)
            if own is not None and own not in table.header:
                words = f"is not used as {own!r}: rename it where it {_holds(own)}"
                yield _notice(table, other, NOT_USED, words)
        for other, own, todo in (*orders_and_times(table, spec), *_directions(table, spec)):
            yield _notice(table, other, NOT_USED, f"is not used as {own!r}: {todo}")
        named = {name.casefold(): name for name in table.header if spec.named(name)}
        for other in table.covariates:
            own = named.get(other.casefold())
            if own is not None:
                yield _notice(
                    table, other, "columns-alike",
                    f"is not used as {own!r}, from which it differs by capital letters alone: "
                    "remove it, or give it a name of its own",
                )  # fmt: skip


def _notice(table: Table, other: str, code: str, words: str) -> Finding:
    place = f"{table.source.shown}, row {table.header_row}"
    return Notice(code=code, message=f"{place}: the column {other!r} {words}")


def _directions(table: Table, spec: TableSpec) -> Iterator[tuple[str, str, str]]:
    """Of columns of signs that do not tell the axis, what to do; `+X` or `-Y` tells it in cells."""
    if not spec.named("dir_x") or any(name.startswith("dir_") for name in table.header):
        return
    for other in filter(direction_alone, table.covariates):
        column = table.columns.texts.get(other)
        labels = () if column is None else column.labels
        if _signs(table, other) or (labels and all(map(_ALONG.fullmatch, labels))):
            yield other, "dir_x", "-1 or +1 along x stand in 'dir_x', those along y in 'dir_y'"


def _holds(own: str) -> str:
    if own in COUNTS:
        return "numbers these"
    if own in OF_READINGS:
        return OF_READINGS[own]
    if own.startswith(NOMINAL):
        return "is the nominal coordinate"
    return f"is the direction along {own[-1]}, -1 or +1"


def _maybe(other: str, table: Table, spec: TableSpec) -> str | None:
    """The column of the contract that one beside it may be, as far as its cells allow."""
    if spec.named("direction") and table.source.role != DRIFT:
        if squeezed(other) in SETUPS:
            return "setup"
        if direction_alone(other) and _signs(table, other):
            return "direction"
    along = direction_along(other) or _by_its_difference(other)
    if along is not None:
        return along if spec.named(along) and _signs(table, other) else None
    nominal = nominal_by_sign(other)
    if nominal is not None:
        return nominal if spec.named(nominal) and not _directs(table, other) else None
    if table.source.role == DRIFT:
        return None
    own = next((name for name in COUNTS if spec.named(name)), None)
    # Of points a measurement is a value, unless its cells are numbers as of repeats.
    measured = own == "repeat" and plain(other).strip() in MEASUREMENTS
    counts = measured and _counts(table, other)
    return own if counts or (may_count(other, spec) and _whole(table, other)) else None


def _by_its_difference(other: str) -> str | None:
    """The column `dir_x` that `dx` may be, where its cells are signs; else it is a deviation."""
    word = plain(other)
    return f"dir_{word[1]}" if word in ("dx", "dy", "dz") else None


def _signs(table: Table, name: str) -> bool:
    column = table.columns.texts.get(name)
    if column is not None:
        return bool(column.labels) and SIGNS.issuperset(map(str.casefold, column.labels))
    cells = table.columns.numbers.get(name, np.zeros(0))
    return bool((np.isnan(cells) | (np.abs(cells) == 1)).all() and (cells == cells).any())


def _directs(table: Table, name: str) -> bool:
    """Whether cells are components of a direction, or no numbers."""
    cells = table.columns.numbers.get(name, np.zeros(0))
    return bool((np.isnan(cells) | (np.abs(cells) <= 1)).all())


def _whole(table: Table, name: str) -> bool:
    """Whether cells may number something: whole numbers, or texts."""
    cells = table.columns.numbers.get(name, np.zeros(0))
    return bool((np.isnan(cells) | (cells == np.floor(cells))).all())


def _counts(table: Table, name: str) -> bool:
    """Whether cells are numbered from 0 or 1 on."""
    cells = table.columns.numbers.get(name, np.zeros(0))
    return bool(len(cells) and cells.min() in (0, 1) and (cells == np.floor(cells)).all())
