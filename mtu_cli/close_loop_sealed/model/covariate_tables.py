"""Covariates of measurements as tables, and rows left out for gaps in them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model_slice import Cells
from mtu_cli.files.points import Points
from mtu_cli.files.readings import Readings
from mtu_cli.files.source import Source
from mtu_cli.findings import Finding, finding
from mtu_cli.model.covariates import Columns, point_columns
from mtu_cli.model.visits import IntArray, only_rows
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
    return only_rows(points, ~gone), [_left_out(named, gone, place)]


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
    return rows[~gone], [_left_out(named, gone, place, f" of {component}")]


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


def _left_out(
    named: Sequence[str], gone: NDArray[np.bool_], place: str, whose: str = ""
) -> Finding:
    consequence = f"{int(gone.sum())} of {len(gone)} rows{whose} left out, the first {place}"
    return finding("missing-values", what="cells", names=named, consequence=consequence)


def _differs(column: FloatArray) -> bool:
    return len(np.unique(column[np.isfinite(column)])) > 1


def _takes_all(groups: Sequence[NDArray[np.int64]], gone: NDArray[np.bool_]) -> bool:
    """Whether some group is in no other row."""
    return any(len(np.unique(code)) > len(np.unique(code[~gone])) for code in groups)


ROUNDING = 1e-12
"""Means of repeats that differ by less than this share of their size are equal."""


def table_covariates(
    columns: Columns, cells: Cells, files: tuple[IntArray, Sequence[Source]]
) -> tuple[dict[str, FloatArray], tuple[Finding, ...]]:
    """Numeric columns (n,) as tables that broadcast to (parts, columns).

    (1, 1) where nothing differs, (parts, 1) where nothing does within a part, (1, columns)
    where nothing does within a column, else the cells' means; missing cells hold the mean of
    their part. A column of text is left out, one with gaps with a warning; `files` are the file
    of each row (n,) and all files.
    """
    found: dict[str, FloatArray] = {}
    gaps: list[str] = []
    for name, column in columns.items():
        if column.dtype == object:
            continue
        known = np.isfinite(column)
        if known.all():
            found[name] = _smallest(column.astype(np.float64), cells)
        else:
            gaps.append(f"{name} ({_where(known, *files)})")
    if not gaps:
        return found, ()
    consequence = "no effect of such a column can be tested"
    gap = finding("missing-values", what="cells", names=gaps, consequence=consequence)
    return found, (gap,)


def _where(known: NDArray[np.bool_], index: IntArray, sources: Sequence[Source]) -> str:
    """The files that have no cell of a column, or how many rows have none."""
    without = [sources[f].shown for f in np.unique(index) if not known[index == f].any()]
    rows = f"{int((~known).sum())} of {len(known)} rows"
    return f"{rows}, all of {' and '.join(without)}" if without else rows


def _smallest(column: FloatArray, cells: Cells) -> FloatArray:
    for part, along in ((False, False), (True, False), (False, True)):
        table = _reduced(column, cells, part=part, along=along)
        if table is not None:
            return table
    means = cells.means(column)
    table = cells.table(means)
    size = ROUNDING * np.abs(means).max()
    for axis in (1, 0):
        low, high = (f(table, axis=axis, keepdims=True) for f in (np.nanmin, np.nanmax))
        if (high - low <= size).all():
            return np.asarray(low)
    of_part = np.nanmean(table, axis=1, keepdims=True)
    return np.where(np.isnan(table), of_part, table)


def _reduced(column: FloatArray, cells: Cells, *, part: bool, along: bool) -> FloatArray | None:
    """The column by part, by column or as one value, if it differs by nothing else."""
    size = cells.parts if part else cells.columns if along else 1
    code = cells.part if part else cells.column if along else np.zeros(len(column), np.int64)
    table = np.empty(size)
    table[code[::-1]] = column[::-1]
    if not (column == table[code]).all():
        return None
    return table[:, None] if part else table[None, :]
