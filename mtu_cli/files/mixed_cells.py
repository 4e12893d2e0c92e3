"""Columns of numbers that a few cells make texts, of which no equation and no search knows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from mtu_cli.errors import Notice
from mtu_cli.files.csv_cells import number
from mtu_cli.files.csv_table import Table, TableSpec
from mtu_cli.files.csv_text import DECIMALS
from mtu_cli.findings import Finding

FEW = 0.1
"""Share of the cells that are texts up to which the others are what the column holds."""


def is_name(cell: str) -> bool:
    """Whether a cell is no number, with a decimal point or with a comma."""
    return all(number(cell, sign) is None for sign in DECIMALS)


def of_names(cells: Iterable[str]) -> bool:
    """Whether a column, of which some cells are texts, is one of names by more than FEW of them."""
    count = Counter(cell for cell in cells if cell)
    names = sum(n for cell, n in count.items() if is_name(cell))
    return names > FEW * count.total()


@dataclass(slots=True)
class _Cells:
    """How many cells of a column are given, how many of them are texts, and the first of these."""

    given: int = 0
    texts: int = 0
    place: str = ""
    cell: str = ""


class MixedCells:
    """The cells of each column beside those of the contract, of tables or of blocks of them: what
    the equations see is the column of all files.
    """

    def __init__(self, spec: TableSpec) -> None:
        self._spec = spec
        self._found: dict[str, _Cells] = {}

    def add(self, table: Table) -> None:
        """The rows of one more table, or block."""
        for name, numbers in table.columns.numbers.items():
            if not self._spec.named(name):
                own = self._found.setdefault(name, _Cells())
                own.given += int((~np.isnan(numbers)).sum())
        for name, column in table.columns.texts.items():
            if self._spec.named(name):
                continue
            own = self._found.setdefault(name, _Cells())
            names = np.array([*map(is_name, column.labels), False], bool)
            odd = np.flatnonzero(names[column.codes])
            if len(odd) and not own.texts:
                own.place = f"{table.source.shown}, row {table.rows[odd[0]]}"
                own.cell = column.labels[column.codes[odd[0]]]
            own.given += int((column.codes >= 0).sum())
            own.texts += len(odd)

    def notes(self) -> Iterator[Finding]:
        """One warning of each column whose cells are numbers but for a few: these make it one of
        names. More of them are names that digits stand among.
        """
        for name, own in self._found.items():
            if not 0 < own.texts <= FEW * own.given:
                continue
            others = f" and {own.texts - 1} more" if own.texts > 1 else ""
            text = (
                f"{own.place}, column {name!r}: {own.cell!r}{others} among numbers makes the "
                "column one of names, which no equation uses and no effect is sought in; expected "
                "a number, or an empty cell where there is none"
            )
            yield Notice(code="cells-mixed", message=text)


def mixed_cells(tables: Iterable[Table], spec: TableSpec) -> tuple[Finding, ...]:
    """All of it of whole tables."""
    found = MixedCells(spec)
    for table in tables:
        found.add(table)
    return tuple(found.notes())
