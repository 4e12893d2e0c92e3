"""Residual tables: cells, visits, the layout of columns, and the datum taken out of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model_slice import Cells, cells_of
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.visits import (
    Datum,
    IntArray,
    basis,
    incomplete_datum,
    operations_of,
    visits_of,
    without,
)
from mtu_cli.stats.least_squares import FloatArray


def filled(table: FloatArray, there: NDArray[np.bool_]) -> FloatArray:
    """A table (P, H, ...) whose missing cells hold the mean of their column, or of their part
    where the column has none. Means of equal values keep their digits.
    """
    if there.all():
        return table
    shape = (*there.shape, *(1,) * (table.ndim - 2))
    held = there.reshape(shape)
    means = []
    for k in (0, 1):
        first = np.expand_dims(held.argmax(axis=k), k)
        origin = np.take_along_axis(table, first, axis=k)
        away = np.where(held, table - origin, 0.0).sum(axis=k, keepdims=True)
        means.append(origin + away / np.maximum(held.sum(axis=k, keepdims=True), 1))
    return np.where(held, table, np.where(held.any(axis=0, keepdims=True), *means))


@dataclass(frozen=True, slots=True, kw_only=True)
class Visited:
    """V measurements of parts in one operation each, with their motions.

    `there` (V, H) are the columns that each has, `part` and `operation` (V,) its own;
    `of_point` (n,) the measurement of each point.
    """

    of_point: IntArray
    part: IntArray
    operation: IntArray
    there: BoolArray
    motions: tuple[Motions, ...]

    def lost(self, column: IntArray) -> BoolArray:
        """The points (n,), each in its `column`, of whose errors the motions take all."""
        found = np.zeros_like(self.there)
        for own in self.motions:
            if own.takes_all:
                found[np.ix_(own.rows, own.columns)] = True
        return np.asarray(found[self.of_point, column])

    def warnings(self, there: BoolArray, operation: IntArray) -> list[Finding]:
        """Of measurements that lack some of the columns `there` (P, H) of their part, whose
        operations are `operation` (H,).
        """
        whole = there[self.part] & (operation == self.operation[:, None])
        if (self.there == whole).all():
            return []
        return [incomplete_datum()]

    def free(self, errors: FloatArray, column: IntArray) -> tuple[FloatArray, FloatArray]:
        """Errors (n, A) less the motions, and how many of them (A,) these fit."""
        axes = errors.shape[1]
        values = np.full((*self.there.shape, axes, 1), np.nan)
        values[self.of_point, column] = errors[:, :, None]
        left = freed(values, self.motions, len(values))
        fitted = np.sum([own.fitted(axes) for own in self.motions], axis=0)
        return left[self.of_point, column, :, 0], fitted


def visited_of(
    points: Points, layout: Layout, axes: tuple[int, ...], datum: Datum, places: FloatArray
) -> Visited:
    """The measurements of each part at its nominal `places` (P, H, 3) mm.

    Raises InputError for a feature that stands twice in one of them.
    """
    visits = visits_of(points)
    there = np.zeros((len(visits.part), len(layout.features)), bool)
    there[visits.of_point, layout.cells.column] = True
    part = layout.place[visits.part]
    return Visited(
        of_point=visits.of_point,
        part=part,
        operation=visits.operation,
        there=there,
        motions=motions_of(datum, places, layout.operation, axes, there, part),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """`parts` in order of manufacture, `features` the names of the columns, by operation first;
    `operation` (H,) their codes of `operations`; `place` the row of each of the points' parts.
    """

    parts: tuple[str, ...]
    features: tuple[str, ...]
    operations: tuple[str, ...]
    operation: IntArray
    place: IntArray
    cells: Cells


def layout_of(points: Points) -> Layout:
    """Parts by `sequence`, then as they first appear; features as the part file has them."""
    operations, operation = operations_of(points)
    names = len(points.features)
    group = operation.astype(np.int64) * names + points.feature
    columns, column = np.unique(group, return_inverse=True)
    place = _in_order(points)
    used = [points.features[code % names] for code in columns.tolist()]
    of_column = columns // names
    if len(np.unique(of_column)) > 1:
        used = [
            f"{operations[code]} {name}".lstrip()
            for code, name in zip(of_column.tolist(), used, strict=True)
        ]
    ordered = np.argsort(np.where(place < 0, len(place), place), kind="stable")
    parts = tuple(points.parts[i] for i in ordered.tolist() if place[i] >= 0)
    return Layout(
        parts=parts,
        features=tuple(used),
        operations=operations,
        operation=of_column,
        place=place,
        cells=cells_of(place[points.part], column.reshape(-1), len(parts), len(columns)),
    )


def _in_order(points: Points) -> IntArray:
    """The row of each part; -1 where no point is of it."""
    never = np.iinfo(np.int64).max
    sequence = np.full(len(points.parts), never)
    np.minimum.at(sequence, points.part, points.sequence)
    appears = np.full(len(points.parts), len(points))
    np.minimum.at(appears, points.part, np.arange(len(points)))
    order = np.lexsort([appears, sequence])
    place = np.full(len(points.parts), -1)
    there = order[appears[order] < len(points)]
    place[there] = np.arange(len(there))
    return place


BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Motions:
    """The rigid motions of some rows of a table in the columns that all of them have.

    `rows` (m,), `columns` (h,), `Q` (h * A, k) orthonormal, rows of it (column, axis).
    """

    rows: IntArray
    columns: IntArray
    Q: FloatArray

    @property
    def takes_all(self) -> bool:
        """Whether they leave nothing but rounding: as many motions as values."""
        return bool(self.Q.shape[0] == self.Q.shape[1])

    def fitted(self, axes: int) -> FloatArray:
        """How many of the values along each axis (A,) they fit, of all rows together."""
        share = (self.Q**2).reshape(len(self.columns), axes, -1).sum(axis=(0, 2))
        return np.asarray(len(self.rows) * share)


def motions_of(
    datum: Datum,
    places: FloatArray,
    operation: IntArray,
    axes: tuple[int, ...],
    there: BoolArray,
    part: IntArray,
) -> tuple[Motions, ...]:
    """What each row is free to move by, in each operation on its own.

    Row i of `there` (N, H), true where it has a value, is one of part `part[i]`, whose nominal
    `places` (P, H, 3) are in mm; `operation` (H,) codes; `axes` (0, 1, 2) those of the errors.
    """
    if datum == "none":
        return ()
    layouts, which = np.unique(
        np.nan_to_num(places).reshape(len(places), -1), axis=0, return_inverse=True
    )
    layout = which.reshape(-1)[part]
    found = []
    for code in np.unique(operation):
        own = there & (operation == code)
        kinds, of_row = np.unique(np.column_stack([own, layout]), axis=0, return_inverse=True)
        for k, kind in enumerate(kinds):
            columns = np.flatnonzero(kind[:-1])
            if not len(columns):
                continue
            place = layouts[kind[-1]].reshape(-1, 3)[columns]
            rows = np.flatnonzero(of_row.reshape(-1) == k)
            found.append(Motions(rows=rows, columns=columns, Q=basis(place, axes, datum)))
    return tuple(found)


def freed(values: FloatArray, motions: Sequence[Motions], rows: int) -> FloatArray:
    """Values (rows or 1, H, A, R) less their least-squares motions; others stay as they are.

    The first dimension stays 1 where all rows have the same motions.
    """
    if not motions:
        return values
    if len(motions) == 1 and (len(motions[0].rows), len(motions[0].columns)) == (
        rows,
        values.shape[1],
    ):
        return _moved(values, motions[0].Q)
    alike = all(len(own.rows) == rows for own in motions)
    if len(values) == 1 < rows and not alike:
        values = np.broadcast_to(values, (rows, *values.shape[1:]))
    result = values.copy()
    for own in motions:
        index = np.ix_(np.arange(1) if len(values) == 1 else own.rows, own.columns)
        result[index] = _moved(result[index], own.Q)
    return result


def _moved(block: FloatArray, Q: FloatArray) -> FloatArray:
    """A block (m, h, A, R) less what the motions Q (h * A, k) fit of it."""
    m, h, a, r = block.shape
    flat = block.transpose(1, 2, 0, 3).reshape(h * a, m * r)
    return without(Q, flat).reshape(h, a, m, r).transpose(2, 0, 1, 3)
