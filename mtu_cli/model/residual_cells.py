"""Measurements gathered into cells: one of every part (or pass) and column."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Cells:
    """The cells of `parts` x `columns` that n measurements fall into; `cell` (n,) is
    part * columns + column.

    `order` (n,) sorts the measurements by cell, `starts` and `count` (m,) are the runs of the m
    cells that hold any, `there` (m,) their numbers.
    """

    parts: int
    columns: int
    cell: IntArray
    order: IntArray
    starts: IntArray
    count: IntArray
    there: IntArray

    @cached_property
    def first(self) -> IntArray:
        """The first measurement of each of the m cells."""
        return self.order[self.starts]

    @cached_property
    def index(self) -> IntArray:
        """The place (n,) of each measurement's cell among the m."""
        place = np.zeros(self.parts * self.columns, np.int64)
        place[self.there] = np.arange(len(self.there))
        return place[self.cell]

    @property
    def part(self) -> IntArray:
        """The part of each measurement."""
        return self.cell // self.columns

    @property
    def column(self) -> IntArray:
        """The column of each measurement."""
        return self.cell % self.columns

    def means(self, values: FloatArray) -> FloatArray:
        """Means (m, ...) of values (n, ...); equal values keep their digits."""
        ordered = values[self.order]
        origin = ordered[self.starts]
        if len(self.starts) == len(ordered):
            return origin
        away = ordered - np.repeat(origin, self.count, axis=0)
        weight = self.count.reshape(-1, *(1,) * (values.ndim - 1))
        found: FloatArray = origin + np.add.reduceat(away, self.starts, axis=0) / weight
        return found

    def squares(self, values: FloatArray) -> FloatArray:
        """Sums (...) over all cells of the squares of values (n, ...) about their cell's mean."""
        left = values - self.means(values)[self.index]
        found: FloatArray = (left**2).sum(axis=0)
        return found

    def table(self, means: FloatArray, fill: float = np.nan) -> FloatArray:
        """Values (m, ...) of the cells as (parts, columns, ...), `fill` where there is none."""
        found = np.full((self.parts * self.columns, *means.shape[1:]), fill, means.dtype)
        found[self.there] = means
        return found.reshape(self.parts, self.columns, *means.shape[1:])

    @cached_property
    def repeats(self) -> IntArray:
        """Measurements in every cell, (parts, columns)."""
        return np.bincount(self.cell, minlength=self.parts * self.columns).reshape(
            self.parts, self.columns
        )


def cells_of(part: IntArray, column: IntArray, parts: int, columns: int) -> Cells:
    """Gathers measurements by their codes `part` and `column` (n,)."""
    cell = part.astype(np.int64) * columns + column
    order = np.argsort(cell, kind="stable")
    ordered = cell[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    return Cells(
        parts=parts,
        columns=columns,
        cell=cell,
        order=order,
        starts=starts,
        count=np.diff(np.r_[starts, len(cell)]),
        there=ordered[starts],
    )


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
