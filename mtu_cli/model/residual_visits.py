"""Measurements of parts, each of which has a rigid motion of its own."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.datum import Datum
from mtu_cli.model.measured import visits_of
from mtu_cli.model.residual_cells import IntArray
from mtu_cli.model.residual_datum import BoolArray, Motions, freed, motions_of
from mtu_cli.model.residual_layout import Layout
from mtu_cli.stats.least_squares import FloatArray


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
        return [finding("incomplete-datum")]

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


def only_rows(points: Points, kept: BoolArray) -> Points:
    """Some of the points; parts, features and operations keep their codes."""
    arrays: dict[str, Any] = {
        field.name: getattr(points, field.name)[kept]
        for field in fields(points)
        if isinstance(getattr(points, field.name), np.ndarray)
    }
    covariates = {name: column[kept] for name, column in points.covariates.items()}
    return replace(points, covariates=covariates, **arrays)
