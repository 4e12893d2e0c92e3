"""Rows that lack a covariate: while they are few, they go and the covariate stays."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.points import Points
from mtu_cli.model.residual_covariates import point_columns
from mtu_cli.model.residual_visits import only_rows
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray

FEW = 0.05
"""Share of the rows up to which they are left out: without its covariate an effect cannot be named,
and looks like one that the library lacks."""


def without_gaps(points: Points, needed: Collection[str]) -> tuple[Points, list[Warned]]:
    """The points without rows that lack a covariate which nearly all others have; the columns
    with the fewest gaps come first. Not of `needed` ones, whose gaps are faults, nor of those
    that are the same everywhere, or whose gaps are all that there is of a part, feature or file.
    """
    n = len(points)
    empty = {
        name: ~np.isfinite(column)
        for name, column in point_columns(points).items()
        if column.dtype != object and name not in needed and _differs(column)
    }
    gone, named = np.zeros(n, bool), []
    for name in sorted(empty, key=lambda name: int(empty[name].sum())):
        both = gone | empty[name]
        if empty[name].any() and both.sum() <= FEW * n and not _takes_all(points, both):
            gone = both
            named.append(name)
    if not named:
        return points, []
    first = int(gone.argmax())
    place = f"{points.sources[points.file_index[first]].shown}, row {points.row[first]}"
    text = (
        f"empty cells in {', '.join(map(repr, named))}: left out {int(gone.sum())} of {n} rows, "
        f"the first {place}"
    )
    return only_rows(points, ~gone), [Warned(code="covariate-gaps", message=text)]


def _differs(column: FloatArray) -> bool:
    return len(np.unique(column[np.isfinite(column)])) > 1


def _takes_all(points: Points, gone: NDArray[np.bool_]) -> bool:
    """Whether some part, feature or file is in no other row."""
    codes = (points.part, points.feature, points.file_index)
    return any(len(np.unique(code)) > len(np.unique(code[~gone])) for code in codes)
