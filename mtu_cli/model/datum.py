"""The freedoms of a part's coordinate system, set by hand on the CMM, projected out."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.model.measured import Visits, visits_of
from mtu_cli.stats.least_squares import FloatArray

Datum = Literal["none", "offset", "offset,rotation"]
DATUMS: tuple[Datum, ...] = ("none", "offset", "offset,rotation")


def freedoms(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """Columns (features * axes, k) of small rigid motions: errors they give at `places` (n, 3).

    An offset along each axis; with rotation (-y, x) about the features' centre in the plane.
    """
    n, a = len(places), len(axes)
    columns = []
    if datum != "none":
        for i in range(a):
            column = np.zeros((n, a))
            column[:, i] = 1.0
            columns.append(column.ravel())
    if datum == "offset,rotation" and 0 in axes and 1 in axes:
        centred = places - np.nanmean(places, axis=0)
        column = np.zeros((n, a))
        column[:, axes.index(0)] = -centred[:, 1]
        column[:, axes.index(1)] = centred[:, 0]
        columns.append(column.ravel())
    return np.column_stack(columns) if columns else np.zeros((n * a, 0))


def projector(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """(rows, rows) matrix that takes the freedoms out of errors at `places`, by least squares."""
    F = freedoms(places, axes, datum)
    P: FloatArray = np.eye(len(F)) - F @ np.linalg.pinv(F)
    return P


def freed(points: Points, axes: tuple[int, ...], datum: Datum) -> tuple[Points, bool]:
    """The points with each visit's freedoms taken out, and whether all visits are complete."""
    if datum == "none":
        return points, True
    visits = visits_of(points)
    errors = visits.errors.copy()
    complete = True
    columns = list(axes)
    for v in range(len(errors)):
        there = np.isfinite(errors[v][:, columns]).all(axis=1)
        complete &= bool(there.all())
        P = projector(visits.nominal[there], axes, datum)
        block = errors[v][np.ix_(there, columns)]
        errors[v][np.ix_(there, columns)] = (P @ block.ravel()).reshape(block.shape)
    return _with_errors(points, visits, errors), complete


def _with_errors(points: Points, visits: Visits, errors: FloatArray) -> Points:
    changed = errors[visits.of_point, points.feature]
    return replace(points, measured=points.nominal + changed)
