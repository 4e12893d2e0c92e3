"""Best-fit alignment: errors of points less their least-squares small motions.

A part lies on a coordinate measuring machine as it lies: the datum of its coordinate system leaves
an offset, a rotation or the size of a ring free. Errors e that a motion makes are F m, linear in
its few amounts m; with Q orthonormal columns of F the errors less their best fit are e - Q Q'e.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mtu_cli.files.study import Datum
from mtu_cli.stats.least_squares import BoolArray, FloatArray, IntArray

ROUNDING = 1e-9
"""A direction or a remaining error below this share of the whole is rounding."""


def small_motions(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """Columns (n * a, k), k <= 4, of small motions: the errors that each gives, rows (feature, axis
    of `axes`), features first, at `places` (n, 3) in mm, of which x and y are used. An offset along
    each axis, mm a mm; where x and y are among the axes with rotation (-y, x) about the mean of the
    features, mm a radian, or with the diameter of a ring, whose points they are, (x, y)/r about its
    centre, mm a mm of radius.
    """
    n, a = len(places), len(axes)
    columns = [] if datum == "none" else list(np.tile(np.eye(a), n))
    if datum in ("offset,rotation", "offset,diameter") and {0, 1} <= {*axes}:
        x, y = (places[:, :2] - places[:, :2].mean(axis=0)).T
        along = -y, x
        if datum == "offset,diameter":
            # x^2 + y^2 = 2 a x + 2 b y + c on a circle about (a, b).
            circle = np.column_stack([2 * x, 2 * y, np.ones(n)])
            centre = np.linalg.lstsq(circle, x**2 + y**2, rcond=None)[0]
            x, y = x - centre[0], y - centre[1]
            r = np.maximum(np.hypot(x, y), 1e-300)
            along = x / r, y / r
        motion = np.zeros((n, a))
        motion[:, axes.index(0)], motion[:, axes.index(1)] = along
        columns.append(motion.ravel())
    return np.column_stack(columns) if columns else np.zeros((n * a, 0))


def motion_basis(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """Orthonormal columns Q (n * a, k) of the motions, fewer where some coincide, without unit."""
    F = small_motions(places, axes, datum)
    if not F.size:
        return F
    U, size, _ = np.linalg.svd(F / np.maximum(np.linalg.norm(F, axis=0), 1e-300), False)
    return U[:, size > ROUNDING * size[0]]


def partial_out(Q: FloatArray, errors: FloatArray) -> FloatArray:
    """Errors (n * a, ...) less their least-squares rigid motion, e - Q Q'e; rounding is 0."""
    rest = np.asarray(errors - Q @ (Q.T @ errors))
    size = np.abs(errors).max(axis=0, initial=0.0)
    rest[~(np.abs(rest) > ROUNDING * size)] = 0.0
    return rest


class Motions(NamedTuple):
    """Motions of `rows` (m,) of a table in their `columns` (h,): `Q` (h * A, k) orthonormal."""

    rows: IntArray
    columns: IntArray
    Q: FloatArray


def motions_of(
    datum: Datum, places: FloatArray, operation: IntArray, axes: tuple[int, ...], there: BoolArray
) -> tuple[Motions, ...]:
    """The motions that the datum removes from each row, by operation: rows at nominal `places` (N,
    H, 3) mm have values where they are `there` (N, H); `operation` (H,) codes; `axes` (0, 1, 2)
    those of the errors.
    """
    result: list[Motions] = []
    for code in np.unique(operation) if datum != "none" else ():
        features = np.flatnonzero(operation == code)
        flat = np.nan_to_num(places[:, features]).reshape(len(places), -1)
        alike = np.column_stack([there[:, features], flat])
        _, first, kind = np.unique(alike, axis=0, return_index=True, return_inverse=True)
        for k, row in enumerate(first.tolist()):
            columns = features[there[row, features]]
            if len(columns):
                rows = np.flatnonzero(kind.reshape(-1) == k)
                Q = motion_basis(np.nan_to_num(places[row, columns]), axes, datum)
                result.append(Motions(rows, columns, Q))
    return tuple(result)


def without_motions(values: FloatArray, motions: Sequence[Motions], rows: int) -> FloatArray:
    """Values (rows or 1, H, A, R) less their least-squares motions; cells without any do not
    change. The first dimension stays 1 where all rows have the same motions.
    """
    if not motions:
        return values
    alike = all(len(those) == rows for those, *_ in motions)
    if len(values) == 1 < rows and not alike:
        values = np.broadcast_to(values, (rows, *values.shape[1:]))
    result = values.copy()
    for those, columns, Q in motions:
        index = np.ix_(np.arange(1) if len(values) == 1 else those, columns)
        m, h, a, r = (block := result[index]).shape
        flat = block.transpose(1, 2, 0, 3).reshape(h * a, m * r)
        result[index] = partial_out(Q, flat).reshape(h, a, m, r).transpose(2, 0, 1, 3)
    return result


def aligned_errors(
    errors: FloatArray,
    places: FloatArray,
    at: tuple[IntArray, IntArray],
    shape: tuple[int, int],
    axes: tuple[int, ...],
    datum: Datum,
) -> tuple[FloatArray, BoolArray]:
    """Errors (n, A) of points at nominal `places` (n, 3) mm less the best-fit motion of each row,
    and those (n,) that it removes entirely; `at` are the row and the column (n,) of each in a table
    of `shape`.
    """
    table = np.full((*shape, len(axes)), np.nan)
    table[at] = errors
    there = np.isfinite(table).all(axis=2)
    nominal = np.full((*shape, 3), np.nan)
    nominal[at] = places
    motions = motions_of(datum, nominal, np.zeros(shape[1], np.int64), axes, there)
    mask = np.zeros(shape, bool)
    for rows, columns, Q in motions:
        mask[np.ix_(rows, columns)] = Q.shape[0] == Q.shape[1]
    return without_motions(table[..., None], motions, shape[0])[at][..., 0], mask[at]
