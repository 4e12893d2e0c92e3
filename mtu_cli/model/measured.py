"""Measured parts as arrays: errors of features, lengths and angles, part by part."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.points import Points
from mtu_cli.files.row_marks import all_distinct
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.anova import Cells, cells_of
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.files.part import LoadedPart

IntArray = NDArray[np.int64]
MOST_TOLD = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTables:
    """Tables of one kind of quantity, one row a table and one column a part.

    `labels` name each table (operation, id, axis; "" where there is none), `cells` hold what an
    analysis of variance needs, in mm or rad; `parts` the columns.
    """

    labels: tuple[tuple[str, str, str], ...]
    parts: tuple[str, ...]
    cells: Cells

    def only(self, kept: list[int]) -> MeasuredTables:
        """The tables at the indices `kept`."""
        cells = Cells(
            origin=self.cells.origin[kept],
            n=self.cells.n[kept],
            mean=self.cells.mean[kept],
            within=self.cells.within[kept],
        )
        return MeasuredTables(
            labels=tuple(self.labels[i] for i in kept), parts=self.parts, cells=cells
        )


def axes_of(points: Points) -> tuple[int, ...]:
    """The axes (0, 1, 2) along which every point was measured and has a nominal."""
    return tuple(
        axis
        for axis in range(3)
        if np.isfinite(points.measured[:, axis]).all()
        and np.isfinite(points.nominal[:, axis]).all()
    )


def operations_of(points: Points) -> tuple[tuple[str, ...], IntArray]:
    """Names and codes (n,) of operations; "" where a file does not tell them."""
    if not points.operations:
        return ("",), np.broadcast_to(np.int64(0), len(points))
    untold = points.operation < 0
    if not untold.any():
        return points.operations, points.operation
    return (*points.operations, ""), np.where(untold, len(points.operations), points.operation)


def feature_tables(points: Points) -> MeasuredTables:
    """One table an operation, feature and axis: measured minus nominal, mm.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    operations, operation = operations_of(points)
    features, parts = len(points.features), len(points.parts)
    group = points.feature
    if len(operations) > 1:
        group = operation.astype(np.int64) * features + points.feature
    seen = np.zeros(len(operations) * features, bool)
    seen[group] = True
    used = np.flatnonzero(seen)
    table = group if len(used) == len(seen) else (np.cumsum(seen) - 1)[group]
    cell = np.multiply(table, parts, dtype=np.int64)
    cell += points.part
    _check_repeats(points, cell, len(used) * parts)

    def along(axis: int) -> Cells:
        errors = points.measured[:, axis] - points.nominal[:, axis]
        return cells_of(errors, cell, len(used), parts, spare=True)

    axes = axes_of(points)
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(along, axes))
    labels = [
        (operations[g // features], points.features[g % features], AXES[axis])
        for axis in axes
        for g in used.tolist()
    ]
    return MeasuredTables(labels=tuple(labels), parts=points.parts, cells=_stacked(found))


def _check_repeats(points: Points, cell: IntArray, cells: int) -> None:
    """Refuses a repeat that stands twice in a cell."""
    low, high = int(points.repeat.min()), int(points.repeat.max())
    if high < 0:
        return
    columns = [(cell, cells), (points.repeat - low, high - low + 1)]
    if all_distinct(columns, 8 * len(points) + 1000):
        return
    code = np.unique(points.repeat, return_inverse=True)[1].reshape(-1)
    place = cell * (int(code.max()) + 1) + code
    given = points.repeat >= 0
    if len(np.unique(place[given])) < int(given.sum()):
        _refuse_doubled(points, place, given)


def _stacked(found: list[Cells]) -> Cells:
    return Cells(
        origin=np.concatenate([cells.origin for cells in found]),
        n=np.concatenate([cells.n for cells in found]),
        mean=np.concatenate([cells.mean for cells in found]),
        within=np.concatenate([cells.within for cells in found]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Visits:
    """The points of each measurement of each part together.

    `errors` and `nominal` (visits, features, 3) mm, nan where a feature was not measured;
    `part` and `operation` (visits,) are codes, `of_point` (n,) the visit of each point. A
    visit is one repeat of one part in one operation: repeats by their number or, without one,
    in the order of the file, after those with a number.
    """

    part: IntArray
    operation: IntArray
    errors: FloatArray
    nominal: FloatArray
    of_point: IntArray


def visits_of(points: Points) -> Visits:
    """Gathers points into visits.

    Raises InputError for a feature that stands twice in one repeat of one part.
    """
    _, operation = operations_of(points)
    features, parts = len(points.features), len(points.parts)
    run = operation.astype(np.int64) * parts + points.part
    repeat = _numbered(points.repeat, run * features + points.feature)
    numbers, code = np.unique(repeat, return_inverse=True)
    distinct, visit = np.unique(run * len(numbers) + code.reshape(-1), return_inverse=True)
    visit = visit.reshape(-1)
    place = visit * features + points.feature
    if np.bincount(place).max() > 1:
        _refuse_doubled(points, place, np.ones(len(points), bool))
    errors = np.full((len(distinct) * features, 3), np.nan)
    errors[place] = points.measured - points.nominal
    nominal = np.full((features, 3), np.nan)
    nominal[points.feature] = points.nominal
    run_of = distinct // len(numbers)
    return Visits(
        part=run_of % parts,
        operation=run_of // parts,
        of_point=visit.astype(np.int64),
        errors=errors.reshape(len(distinct), features, 3),
        nominal=nominal,
    )


def _numbered(repeat: IntArray, place: IntArray) -> IntArray:
    """Repeats with a number each; where none is given, counted on from the largest given."""
    untold, found = repeat < 0, repeat.copy()
    if untold.any():
        found[untold] = max(int(repeat.max()), -1) + 1 + occurrence(place[untold])
    return found


def only_features(points: Points, names: Iterable[str]) -> Points:
    """The points of some features; parts and operations keep their codes."""
    index = {name: code for code, name in enumerate(points.features)}
    kept = [index[name] for name in dict.fromkeys(names) if name in index]
    code = np.full(len(points.features), -1)
    code[kept] = np.arange(len(kept))
    feature = code[points.feature]
    rows = np.flatnonzero(feature >= 0)
    return replace(
        points,
        features=tuple(points.features[i] for i in kept),
        feature=feature[rows],
        covariates={name: column[rows] for name, column in points.covariates.items()},
        **{name: getattr(points, name)[rows] for name in _BY_POINT},
    )


_BY_POINT = (
    "part", "operation", "measured", "nominal", "repeat", "time_min", "sequence", "direction",
    "file_index", "row",
)  # fmt: skip


def occurrence(codes: IntArray) -> IntArray:
    """How often the code of each entry has stood before it: 0, 1, 2, ..."""
    order = np.argsort(codes, kind="stable")
    ordered = codes[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    lengths = np.diff(np.r_[starts, len(codes)])
    count = np.empty(len(codes), np.int64)
    count[order] = np.arange(len(codes)) - np.repeat(starts, lengths)
    return count


def _refuse_doubled(points: Points, place: IntArray, given: NDArray[np.bool_]) -> None:
    rows = np.flatnonzero(given)
    rows = rows[occurrence(place[rows]) > 0]
    raise InputError(
        [
            Problem(
                what="the feature stands twice in one repeat of one part",
                file=points.sources[points.file_index[i]].shown,
                row=int(points.row[i]),
                column="feature",
                value=points.features[points.feature[i]],
                expected="one row a feature and `repeat`",
            )
            for i in rows[:MOST_TOLD]
        ]
    )


def length_tables(points: Points, visits: Visits, part: LoadedPart) -> MeasuredTables | None:
    """One table an operation and length of the part file: measured minus nominal, mm."""
    entries = part.part.lengths
    pairs = [
        (points.features.index(e.from_), points.features.index(e.to))
        for e in entries
        if e.from_ in points.features and e.to in points.features
    ]
    ids = [e.id for e in entries if e.from_ in points.features and e.to in points.features]
    if not pairs:
        return None
    values = []
    for start, end in pairs:
        delta = np.nan_to_num(visits.nominal[end] - visits.nominal[start])
        e = visits.errors[:, end] - visits.errors[:, start]
        e = np.where(np.isnan(e) & (np.arange(3) == 2), 0.0, e)
        L0 = float(np.linalg.norm(delta))
        grown = (e * (2 * delta + e)).sum(axis=1)
        values.append(grown / (np.sqrt(L0**2 + grown) + L0))
    return _visit_tables(points, visits, ids, np.array(values))


def angle_tables(points: Points, visits: Visits, part: LoadedPart) -> MeasuredTables | None:
    """One table an operation and row-to-column angle, rad: eqs. (24)-(26)."""
    ids, values = [], []
    for entry in part.part.orthogonality:
        if not all(name in points.features for name in (*entry.row, *entry.column)):
            continue
        row = [points.features.index(name) for name in entry.row]
        column = [points.features.index(name) for name in entry.column]
        angle = -_slope(visits, column, 1, 0) - _slope(visits, row, 0, 1)
        ids.append(entry.id)
        values.append(angle)
    return _visit_tables(points, visits, ids, np.array(values)) if ids else None


def _slope(visits: Visits, which: list[int], along: int, across: int) -> FloatArray:
    """Slope (visits,) of the line through the features; nan where one is missing."""
    place = visits.nominal[which]
    u = place[:, along] - place[:, along].mean() + visits.errors[:, which, along]
    v = place[:, across] - place[:, across].mean() + visits.errors[:, which, across]
    u = u - u.mean(axis=1, keepdims=True)
    squares = (u * u).sum(axis=1)
    # Features one above the other have no slope.
    slope = np.full(len(u), np.nan)
    np.divide((u * v).sum(axis=1), squares, out=slope, where=squares > 0)
    return slope


def _visit_tables(
    points: Points, visits: Visits, ids: list[str], values: FloatArray
) -> MeasuredTables | None:
    """Tables of quantities (ids, visits) by operation; visits without a value are left out."""
    operations, _ = operations_of(points)
    labels, found = [], []
    parts = len(points.parts)
    for code, operation in enumerate(operations):
        for name, value in zip(ids, values, strict=True):
            kept = (visits.operation == code) & np.isfinite(value)
            if kept.any():
                labels.append((operation, name, ""))
                found.append(cells_of(value[kept], visits.part[kept], 1, parts))
    if not found:
        return None
    return MeasuredTables(labels=tuple(labels), parts=points.parts, cells=_stacked(found))
