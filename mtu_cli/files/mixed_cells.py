"""Columns of numbers that a few cells make texts, of which no equation and no search knows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np

from mtu_cli.files.contracts import Notice
from mtu_cli.files.csv_cells import number
from mtu_cli.files.csv_table import Table, TableSpec
from mtu_cli.files.csv_text import DECIMALS

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


def mixed_cells(tables: Iterable[Table], spec: TableSpec) -> Iterator[Notice]:
    """One warning of each column beside those of the contract whose cells are numbers but for a
    few: these make it one of names. More of them are names that digits stand among.
    """
    for table in tables:
        for name, column in table.columns.texts.items():
            if spec.named(name):
                continue
            texts = np.array([is_name(label) for label in column.labels], bool)
            given = column.codes >= 0
            odd = np.flatnonzero(given & np.append(texts, False)[column.codes])
            if not 0 < len(odd) <= FEW * given.sum():
                continue
            others = f" and {len(odd) - 1} more" if len(odd) > 1 else ""
            text = (
                f"{table.source.shown}, row {table.rows[odd[0]]}, column {name!r}: "
                f"{column.labels[column.codes[odd[0]]]!r}{others} among numbers makes the column "
                "one of names, which no equation uses and no effect is sought in; expected a "
                "number, or an empty cell where there is none"
            )
            yield Notice(code="cells-mixed", message=text)
