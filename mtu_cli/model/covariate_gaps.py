"""Rows that lack a covariate: while they are few, they go and the covariate stays."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.points import Points
from mtu_cli.files.readings import Readings
from mtu_cli.findings import Finding, finding
from mtu_cli.model.residual_covariates import point_columns
from mtu_cli.model.residual_visits import only_rows
from mtu_cli.stats.least_squares import FloatArray

FEW = 0.05
"""Share of the rows up to which they are left out: without its covariate an effect cannot be named,
and looks like one that the library lacks."""


def without_gaps(points: Points, needed: Collection[str]) -> tuple[Points, list[Finding]]:
    """The points without rows that lack a covariate which nearly all others have (`_few`). Not of
    `needed` ones, whose gaps are faults.
    """
    columns = point_columns(points)
    gone, named = _few(
        {name: column for name, column in columns.items() if name not in needed},
        (points.part, points.feature, points.file_index),
    )
    if not named:
        return points, []
    first = int(gone.argmax())
    place = f"{points.sources[points.file_index[first]].shown}, row {points.row[first]}"
    return only_rows(points, ~gone), [_told(named, gone, place)]


def rows_without_gaps(
    readings: Readings,
    rows: NDArray[np.int64],
    columns: Mapping[str, NDArray[Any]],
    groups: Sequence[NDArray[np.int64]],
) -> tuple[NDArray[np.int64], list[Finding]]:
    """The readings `rows` (n,) of a component without those that lack one of the `columns` (n,)
    which nearly all others have; `groups` (n,) are codes of which each keeps a reading.
    """
    files = readings.file_index[rows]
    gone, named = _few(columns, (*groups, files))
    if not named:
        return rows, []
    first = int(gone.argmax())
    component = readings.components[readings.code[rows[first]]]
    place = f"{readings.sources[files[first]].shown}, row {readings.row[rows[first]]}"
    return rows[~gone], [_told(named, gone, place, f" of {component}")]


def _few(
    columns: Mapping[str, NDArray[Any]], groups: Sequence[NDArray[np.int64]]
) -> tuple[NDArray[np.bool_], list[str]]:
    """Rows (n,) to leave out for gaps, and the columns that have these; the columns with the
    fewest come first. Not of those that are the same everywhere, nor gaps that are all that there
    is of a part, feature, pass, target or file.
    """
    empty = {
        name: ~np.isfinite(column)
        for name, column in columns.items()
        if column.dtype != object and not np.isfinite(column).all() and _differs(column)
    }
    gone, named = np.zeros(len(groups[0]), bool), []
    for name in sorted(empty, key=lambda name: int(empty[name].sum())):
        both = gone | empty[name]
        if both.sum() <= FEW * len(gone) and not _takes_all(groups, both):
            gone = both
            named.append(name)
    return gone, named


def _told(named: Sequence[str], gone: NDArray[np.bool_], place: str, whose: str = "") -> Finding:
    consequence = f"{int(gone.sum())} of {len(gone)} rows{whose} left out, the first {place}"
    return finding("covariate-gaps", names=named, consequence=consequence)


def _differs(column: FloatArray) -> bool:
    return len(np.unique(column[np.isfinite(column)])) > 1


def _takes_all(groups: Sequence[NDArray[np.int64]], gone: NDArray[np.bool_]) -> bool:
    """Whether some group is in no other row."""
    return any(len(np.unique(code)) > len(np.unique(code[~gone])) for code in groups)
