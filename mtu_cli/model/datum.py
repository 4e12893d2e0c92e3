"""The best-fit alignment of each part, which is set up by hand on the CMM, removed."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from mtu_cli.files.points import Points
from mtu_cli.findings import Finding, finding
from mtu_cli.model.visits import Visits, visits_of
from mtu_cli.stats.least_squares import FloatArray

Datum = Literal["none", "offset", "offset,rotation"]
ROUNDING = 1e-9
"""A direction or an error below this share of what it is left of is rounding."""


def freedoms(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """Columns (n * a, k), k <= 4, of small rigid motions: the errors that each of them gives.

    `places` (n, 3) in mm, of which x and y are used; rows are (feature, axis of `axes`),
    features first. An offset along each axis, in the errors' own unit (mm of error a mm of
    offset); with rotation, where x and y are among the axes, (-y, x) about the centre of the
    features, mm of error a radian.
    """
    n, a = len(places), len(axes)
    columns = []
    if datum != "none":
        columns += [np.tile(np.eye(a)[i], n) for i in range(a)]
    if datum == "offset,rotation" and 0 in axes and 1 in axes:
        centred = places[:, :2] - places[:, :2].mean(axis=0)
        turned = np.zeros((n, a))
        turned[:, axes.index(0)] = -centred[:, 1]
        turned[:, axes.index(1)] = centred[:, 0]
        columns.append(turned.ravel())
    return np.column_stack(columns) if columns else np.zeros((n * a, 0))


def basis(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """Orthonormal columns Q (n * a, k) of the freedoms, fewer where some coincide: one feature
    cannot tell a rotation. Without unit.
    """
    F = freedoms(places, axes, datum)
    if not F.size:
        return F
    U, size, _ = np.linalg.svd(F / np.maximum(np.linalg.norm(F, axis=0), 1e-300), False)
    found: FloatArray = U[:, size > ROUNDING * size[0]]
    return found


def incomplete_datum() -> Finding:
    """The warning of parts that lack some of the features that the others have."""
    consequence = "the datum is fitted to the features that a part has"
    facts = {"what": "features of some parts", "names": ["--datum"], "consequence": consequence}
    return finding("missing-values", **facts)


def without(Q: FloatArray, errors: FloatArray) -> FloatArray:
    """Errors (n * a, ...) less their least-squares rigid motion, e - Q Q'e; rounding is 0."""
    left: FloatArray = errors - Q @ (Q.T @ errors)
    size = np.abs(errors).max(axis=0, initial=0.0)
    left[~(np.abs(left) > ROUNDING * size)] = 0.0
    return left


def projector(places: FloatArray, axes: tuple[int, ...], datum: Datum) -> FloatArray:
    """(n * a, n * a), without unit: takes the freedoms out of errors at `places` (n, 3)."""
    Q = basis(places, axes, datum)
    return without(Q, np.eye(len(Q)))


def freed(points: Points, axes: tuple[int, ...], datum: Datum) -> tuple[Points, bool]:
    """The points with each visit's freedoms taken out, and whether all visits are complete:
    each has every feature of its operation.

    A least-squares motion of k <= 4 parameters a visit, its columns made once for all visits
    of the same features.
    """
    if datum == "none" or not axes:
        return points, True
    visits = visits_of(points)
    errors = visits.errors.copy()
    there = np.asarray(np.isfinite(errors[:, :, list(axes)]).all(axis=2))
    patterns, of_visit = np.unique(there, axis=0, return_inverse=True)
    of_visit = of_visit.reshape(-1)
    for p, present in enumerate(patterns):
        Q = basis(visits.nominal[present], axes, datum)
        index = np.ix_(of_visit == p, present, list(axes))
        block = errors[index]
        errors[index] = without(Q, block.reshape(len(block), -1).T).T.reshape(block.shape)
    return _with_errors(points, visits, errors), _complete(visits, there)


def _complete(visits: Visits, there: np.ndarray) -> bool:
    for operation in np.unique(visits.operation):
        own = there[visits.operation == operation]
        if not (own == own.any(axis=0)).all():
            return False
    return True


def _with_errors(points: Points, visits: Visits, errors: FloatArray) -> Points:
    changed = errors[visits.of_point, points.feature]
    return replace(points, measured=points.nominal + changed)
