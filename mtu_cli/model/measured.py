"""Measured parts as arrays: errors of features, lengths and angles, part by part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.points import Points
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.anova import Cells, cells_of
from mtu_cli.stats.least_squares import FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTables:
    """Tables of one kind of quantity, one row a table and one column a part.

    `labels` name each table (operation, id, axis; "" where there is none), `cells` hold what an
    analysis of variance needs, in mm or rad; `parts` the columns.
    """

    labels: tuple[tuple[str, str, str], ...]
    parts: tuple[str, ...]
    cells: Cells


def axes_of(points: Points) -> tuple[int, ...]:
    """The axes (0, 1, 2) along which every point was measured and has a nominal."""
    errors_known = np.isfinite(points.measured).all(axis=0) & np.isfinite(points.nominal).all(
        axis=0
    )
    return tuple(int(i) for i in np.flatnonzero(errors_known))


def feature_tables(points: Points) -> MeasuredTables:
    """One table an operation, feature and axis: measured minus nominal, mm."""
    operations = points.operations or ("",)
    operation = np.maximum(points.operation, 0)
    group = operation * len(points.features) + points.feature
    used, table = np.unique(group, return_inverse=True)
    parts = len(points.parts)
    cell = table.reshape(-1) * parts + points.part
    labels: list[tuple[str, str, str]] = []
    found: list[Cells] = []
    for axis in axes_of(points):
        errors = points.measured[:, axis] - points.nominal[:, axis]
        found.append(cells_of(errors, cell, len(used), parts))
        labels += [
            (operations[g // len(points.features)], points.features[g % len(points.features)],
             AXES[axis])
            for g in used
        ]  # fmt: skip
    return MeasuredTables(labels=tuple(labels), parts=points.parts, cells=_stacked(found))


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
    visit is one repeat of one part in one
    operation: repeats by their number or, without one, in the order of the file.
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
    operation = np.maximum(points.operation, 0)
    features = len(points.features)
    base = (operation * len(points.parts) + points.part) * features + points.feature
    repeat = np.where(points.repeat >= 0, points.repeat, occurrence(base))
    keys = np.column_stack([operation, points.part, repeat])
    distinct, visit = np.unique(keys, axis=0, return_inverse=True)
    visit = visit.reshape(-1)
    place = visit * features + points.feature
    first = np.unique(place, return_index=True)[1]
    if len(first) < len(place):
        _refuse_doubled(points, place)
    errors = np.full((len(distinct) * features, 3), np.nan)
    errors[place] = points.measured - points.nominal
    nominal = np.full((features, 3), np.nan)
    nominal[points.feature] = points.nominal
    return Visits(
        part=distinct[:, 1].astype(np.int64),
        operation=distinct[:, 0].astype(np.int64),
        errors=errors.reshape(len(distinct), features, 3),
        nominal=nominal,
        of_point=visit.astype(np.int64),
    )


def occurrence(codes: IntArray) -> IntArray:
    """How often the code of each entry has stood before it: 0, 1, 2, ..."""
    order = np.argsort(codes, kind="stable")
    ordered = codes[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    lengths = np.diff(np.r_[starts, len(codes)])
    count = np.empty(len(codes), np.int64)
    count[order] = np.arange(len(codes)) - np.repeat(starts, lengths)
    return count


def _refuse_doubled(points: Points, place: IntArray) -> None:
    rows = np.flatnonzero(occurrence(place) > 0)
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
            for i in rows
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
    slope: FloatArray = (u * v).sum(axis=1) / (u * u).sum(axis=1)
    return slope


def _visit_tables(
    points: Points, visits: Visits, ids: list[str], values: FloatArray
) -> MeasuredTables | None:
    """Tables of quantities (ids, visits) by operation; visits without a value are left out."""
    operations = points.operations or ("",)
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
