"""Parts and columns of a table of residuals, from measured points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.measured import operations_of
from mtu_cli.model.residual_cells import Cells, IntArray, cells_of


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
