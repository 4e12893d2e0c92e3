"""Freedoms of hand-set part coordinate systems, projected out of tables of errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.datum import Datum, basis, without
from mtu_cli.model.residual_cells import IntArray
from mtu_cli.stats.least_squares import FloatArray

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
