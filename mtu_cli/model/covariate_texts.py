"""Columns of texts beside measured values: no effect of them can be tested."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from mtu_cli.files.csv_table import DECIMALS, number
from mtu_cli.files.points import Points
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, finding

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


def text_warnings(measured: Points | Readings) -> list[Finding]:
    """One warning of all columns that are texts by more than a few of their cells."""
    texts = [
        _text(name, column, measured)
        for name, column in measured.covariates.items()
        if column.dtype == object and of_names(map(str, column))
    ]
    facts = {"what": "effects", "items": texts, "reason": "text, not numbers"}
    return [finding("not-tested", **facts)] if texts else []


def _text(name: str, column: NDArray[Any], measured: Points | Readings) -> str:
    """The name of a column, with the texts that it has beside numbers: these may be meant."""
    cells = {i: text for i, text in enumerate(map(str, column)) if text}
    own = [i for i, text in cells.items() if is_name(text)]
    if len(own) == len(cells):
        return repr(name)
    source = measured.sources[measured.file_index[own[0]]]
    first = f"{cells[own[0]]!r} in {source.shown}, row {measured.row[own[0]]}"
    count = f"texts in {len(own)} of {len(cells)} cells"
    return f"{name!r} ({count}, the first {first}; where that means not known, leave it empty)"
