"""Parts that are copies of others: all their values agree, to the last digit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mtu_cli.errors import InputError, Problem, Warned
from mtu_cli.files.features_alike import SAME_MM
from mtu_cli.files.points import Points
from mtu_cli.files.row_marks import fingerprints
from mtu_cli.findings import Finding
from mtu_cli.model.part_spread import shares_alike
from mtu_cli.model.residual_cells import IntArray
from mtu_cli.model.visits import operations_of
from mtu_cli.stats.least_squares import FloatArray

FEWEST_COPIED = 4
"""Fewer equal values than this are no reason to speak."""
CHANCE = 1e-3
"""Equal parts are refused where chance alone would make a pair less often than this."""
FEW_GROUPS = 2
"""Groups of equal parts that may be set-ups; of more, each with nothing but equal parts, one table
was pasted again.
"""
MOST_ALIKE = 6
"""Equal parts that a warning names."""


class _Values(NamedTuple):
    """Of each value (n, axes): a number that equal ones of a feature and operation share, and how
    often two others there agree. Of each point (n,): a number that equal parts share, and in how
    many of its operation's values two parts agree but for a shift.
    """

    code: IntArray
    agree: FloatArray
    equal: IntArray
    shared: FloatArray


def copied_parts(points: Points, axes: tuple[int, ...]) -> list[Finding]:
    """A warning of parts whose values of an operation agree with an earlier part's in every
    feature, in whatever order.

    Raises InputError for those that are no chance.
    """
    parts = len(points.parts)
    operations, operation = operations_of(points)
    columns = [points.feature, operation, *(points.measured[:, axis] for axis in axes)]
    several = len(operations) > 1
    # Files of one operation each are copied one by one: a part need not be a copy in all.
    run = operation.astype(np.int64) * parts + points.part if several else points.part
    marks = fingerprints(columns, run, len(operations) * parts)
    first: dict[bytes, int] = {}
    problems, alike = [], []
    values: _Values | None = None
    chances: dict[bytes, float] = {}
    for copy in np.flatnonzero(marks[:, 0]).tolist():
        mark = marks[copy].tobytes()
        other = first.setdefault(mark, copy)
        if other == copy:
            continue
        rows = np.flatnonzero(run == copy)
        if len(rows) * len(axes) < FEWEST_COPIED:
            continue
        part, twin = points.parts[copy % parts], points.parts[other % parts]
        name = operations[copy // parts] if several else ""
        where = f" in operation {name!r}" if name else ""
        if mark not in chances:
            values = values or _values(points, operation, axes, _numbered(marks)[run])
            asked = _set_ups(points, rows, operation, values)
            chances[mark] = np.inf if asked else _chance(points, rows, axes, values)
        if chances[mark] >= CHANCE:
            alike.append((part, f"{twin!r}{where}"))
            continue
        what = f"part {part!r} has the same values as part {twin!r}{where}"
        problems.append(_problem(points, int(rows[0]), what))
    if problems:
        raise InputError(problems)
    return [Warned(code="parts-alike", message=_twice(alike))] if alike else []


def _problem(points: Points, row: int, what: str) -> Finding:
    return Problem(
        what=what,
        file=points.sources[points.file_index[row]].shown,
        row=int(points.row[row]),
        column="part",
        expected="each part once; repeated measurements are numbered in `repeat`",
    )


def _twice(alike: Sequence[tuple[str, str]]) -> str:
    """One question on all parts that agree with another one, the first few of them by name."""
    if len(alike) == 1:
        ((part, twin),) = alike
        return f"part {part!r} has the same values as part {twin}: was it measured twice?"
    more = len(alike) - MOST_ALIKE
    shown = ", ".join(f"{part!r} as {twin}" for part, twin in alike[:MOST_ALIKE])
    return (
        f"{len({part for part, _ in alike})} parts have the same values as another one: {shown}"
        f"{f' and {more} more' if more > 0 else ''}: were they measured twice?"
    )


def _chance(points: Points, rows: IntArray, axes: tuple[int, ...], values: _Values) -> float:
    """Expected number of pairs of parts that agree by chance in as many values as this one.

    Two errors agree as often as two of the part's own: coarse or vanishing errors often do. Or as
    two of other parts in the same place do, or the two parts that are most alike but for a shift:
    where the CMM's last digit is larger than what parts of a set-up differ by. Repeats that agree
    are one value.
    """
    errors = np.concatenate(
        [points.measured[rows, axis] - points.nominal[rows, axis] for axis in axes]
    )
    count = np.unique(np.round(errors / SAME_MM), return_counts=True)[1] / len(errors)
    pairs = len(points.parts) * (len(points.parts) - 1) / 2
    first = np.unique(values.code[rows], return_index=True)[1]
    alike = values.agree[rows].ravel()[first]
    each = np.maximum(alike, min(max(values.shared[rows[0]], (count**2).sum()), 1.0))
    return float(pairs * np.exp(np.log(each).sum()))


def _set_ups(points: Points, rows: IntArray, operation: IntArray, values: _Values) -> bool:
    """Whether all parts of an operation fall into one or two groups of equal ones: nothing tells
    then what parts of one set-up differ by, a coarse digit or nothing at all.
    """
    own = operation == operation[rows[0]]
    parts = np.unique(np.column_stack([values.equal[own], points.part[own]]), axis=0)
    counts = np.unique(parts[:, 0], return_counts=True)[1]
    return len(counts) <= FEW_GROUPS and bool((counts > 1).all())


def _numbered(marks: FloatArray) -> IntArray:
    """A number (n,) that equal rows of `marks` (n, k) share."""
    return np.unique(marks, axis=0, return_inverse=True)[1].reshape(-1)


def _values(points: Points, operation: IntArray, axes: tuple[int, ...], equal: IntArray) -> _Values:
    """How often two measurements of a feature and operation agree, a point's own left out; 0
    where there are no two others.
    """
    cell = operation.astype(np.int64) * len(points.features) + points.feature
    codes = np.zeros((len(points), len(axes)), np.int64)
    agree = np.zeros(codes.shape)
    for k, axis in enumerate(axes):
        value = np.unique(np.round(points.measured[:, axis] / SAME_MM), return_inverse=True)[1]
        key = cell * (int(value.max(initial=0)) + 1) + value.reshape(-1)
        _, code, count = np.unique(key, return_inverse=True, return_counts=True)
        codes[:, k] = code.reshape(-1) * len(axes) + k
        own = count[code.reshape(-1)]
        # Each of n points counts its fellows: twice the pairs.
        pairs = np.bincount(cell, weights=own - 1.0) / 2
        n = np.bincount(cell)[cell]
        others = (n - 1) * (n - 2) / 2
        np.divide(pairs[cell] - (own - 1), others, out=agree[:, k], where=others > 0)
    return _Values(codes, agree, equal, shares_alike(points, operation, axes, equal))
