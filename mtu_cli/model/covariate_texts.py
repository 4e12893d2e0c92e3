"""Columns of texts beside measured values: no effect of them can be tested."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.mixed_cells import is_name, of_names
from mtu_cli.files.source import Source
from mtu_cli.model.settings import Warned


def texts_told(
    columns: Mapping[str, NDArray[Any]], index: NDArray[np.int64], sources: Sequence[Source]
) -> list[Warned]:
    """One warning of all columns (n,) that are texts by more than a few of their cells; row i is
    of the file `sources[index[i]]`.
    """
    told = [
        _text(name, column, index, sources)
        for name, column in columns.items()
        if column.dtype == object and of_names(map(str, column))
    ]
    if not told:
        return []
    text = f"{', '.join(told)}: text, not numbers, so that no effect of it can be tested"
    return [Warned(code="covariate-is-text", message=text)]


def _text(
    name: str, column: NDArray[Any], index: NDArray[np.int64], sources: Sequence[Source]
) -> str:
    """The name of a column, with the texts that it has beside numbers: these may be meant."""
    cells = {i: text for i, text in enumerate(map(str, column)) if text}
    own = [i for i, text in cells.items() if is_name(text)]
    if len(own) == len(cells):
        return repr(name)
    first = f"{cells[own[0]]!r} in {sources[index[own[0]]].shown}"
    count = f"{len(own)} of {len(cells)} cells"
    return f"{name!r} ({count}, the first {first}; what is not known is left empty)"
