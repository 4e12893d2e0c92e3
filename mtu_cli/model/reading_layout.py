"""Readings of one component as passes and targets: the rows and columns of their table."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mtu_cli.files.readings import Readings
from mtu_cli.model.residual_cells import Cells, IntArray, cells_of
from mtu_cli.model.runs import runs_of, ways
from mtu_cli.stats.least_squares import FloatArray

SAME = 1e-4
"""Positions within this share of the travel are one target, recorded as it was reached."""
SIGNS = {1: "+", -1: "-", 0: ""}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingLayout:
    """`passes` in order of time, `columns` named by target and direction, whose sign is
    `direction` (H,). `paired`: each pass ran one way, and one there is a row with one back.
    """

    passes: tuple[str, ...]
    paired: bool
    columns: tuple[str, ...]
    direction: IntArray
    cells: Cells


def reading_layout(readings: Readings, rows: IntArray, of: str | None, name: str) -> ReadingLayout:
    """The readings `rows` (n,) of the component `name`, a function of the axis `of`.

    Without an axis, or where the readings have no pass number, every reading is a pass of its
    own; else a pass is one number of one file. Readings with an axis and no pass number are
    repeats of pass 0.
    """
    keys, code = _passes(readings, rows, of)
    order = _in_time(readings, rows, keys, code)
    sign = np.zeros(len(rows), np.int64) if of is None else readings.direction[rows].astype(int)
    row = runs_of(keys, order, ways(code, sign, len(keys)))
    names = _pass_names(readings, keys)
    count = int(row.max(initial=-1)) + 1
    target, labels = _targets(readings, rows, of, name)
    # Forward first, as the passes of a fit are.
    columns, column = np.unique(target * 3 + (1 - sign), return_inverse=True)
    signs = 1 - columns % 3
    several = len(np.unique(signs)) > 1
    return ReadingLayout(
        passes=_row_names(names, order, row, count),
        paired=count < len(keys),
        columns=tuple(
            f"{labels[k // 3]} {SIGNS[int(sign)]}".rstrip() if several else labels[k // 3]
            for k, sign in zip(columns.tolist(), signs, strict=True)
        ),
        direction=signs,
        cells=cells_of(row[code], column.reshape(-1), count, len(columns)),
    )


def _row_names(names: list[str], order: IntArray, row: IntArray, count: int) -> tuple[str, ...]:
    """The passes of each row, in one go: every reading may be a pass of its own."""
    found: list[list[str]] = [[] for _ in range(count)]
    for i in order.tolist():
        found[row[i]].append(names[i])
    return tuple(map("/".join, found))


def _passes(readings: Readings, rows: IntArray, of: str | None) -> tuple[IntArray, IntArray]:
    """(file, number) of every pass (m, 2), and the pass of each reading."""
    has = readings.has_pass[rows]
    files = readings.file_index[rows]
    if of is None and not has.all():
        return np.column_stack([files, np.arange(1, len(rows) + 1)]), np.arange(len(rows))
    numbers = np.where(has, readings.pass_number[rows], 0)
    keys, code = np.unique(np.column_stack([files, numbers]), axis=0, return_inverse=True)
    return keys.astype(np.int64), code.reshape(-1).astype(np.int64)


def _in_time(readings: Readings, rows: IntArray, keys: IntArray, code: IntArray) -> IntArray:
    """Passes by their first time where the files share a clock, else by file and number.

    Files whose times overlap were each counted from their own start.
    """
    times = readings.time_min[rows]
    if not np.isfinite(times).all():
        return np.arange(len(keys))
    start, end = np.full(len(keys), np.inf), np.full(len(keys), -np.inf)
    np.minimum.at(start, code, times)
    np.maximum.at(end, code, times)
    files = np.unique(keys[:, 0])
    spans = [(start[keys[:, 0] == f].min(), end[keys[:, 0] == f].max()) for f in files]
    spans.sort()
    if any(later[0] <= earlier[1] for earlier, later in pairwise(spans)):
        return np.arange(len(keys))
    return np.lexsort([np.arange(len(keys)), start])


def _pass_names(readings: Readings, keys: IntArray) -> list[str]:
    """The numbers, with their file where two files have the same."""
    numbers = keys[:, 1].tolist()
    if len(set(numbers)) == len(numbers):
        return [str(number) for number in numbers]
    shown = [readings.sources[file].shown for file in keys[:, 0]]
    return [f"{file} {number}" for file, number in zip(shown, numbers, strict=True)]


def _targets(
    readings: Readings, rows: IntArray, of: str | None, name: str
) -> tuple[IntArray, list[str]]:
    """The target of each reading, ascending, and the targets' names."""
    if of is None:
        return np.zeros(len(rows), np.int64), [name]
    position = readings.position_mm[rows]
    distinct, code = np.unique(position, return_inverse=True)
    group = _groups(distinct)
    target = group[code.reshape(-1)]
    count = np.bincount(target)
    means = np.bincount(target, position) / count
    labels = _labels(means)
    return target, labels


def _groups(distinct: FloatArray) -> IntArray:
    """The target of each distinct position; each its own where targets would run together."""
    alone = np.arange(len(distinct))
    near = SAME * float(np.ptp(distinct)) if len(distinct) else 0.0
    group = np.cumsum(np.r_[0, np.diff(distinct) > near])
    first = np.searchsorted(group, np.arange(group[-1] + 1))
    last = np.r_[first[1:], len(distinct)] - 1
    return group if (distinct[last] - distinct[first] <= 3 * near).all() else alone


def _labels(means: FloatArray) -> list[str]:
    """Positions with as many digits as tell them apart."""
    for digits in (6, 9, 12):
        found = [f"{value:.{digits}g}" for value in means]
        if len(set(found)) == len(found):
            return found
    return [repr(float(value)) for value in means]
