"""The angle between a row and a column of features as a function of their errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mtu_cli.files.part import LoadedPart
from mtu_cli.findings import InputError, finding
from mtu_cli.stats.least_squares import FloatArray

LARGEST_SLOPE = 0.1
"""Nominal slope b1 of a row or column that still counts as along its axis: holes need not stand in
a line. Its change for its angle's is too large by b1^2, 1 % here.
"""

Line = tuple[FloatArray, FloatArray]
"""Coordinates along and across a line (features, m) or (features, 1), each less its mean, or
`contrasts` of them (features - 1, ...); mm."""


def contrasts(n: int) -> FloatArray:
    """H (n - 1, n), Helmert's orthonormal contrasts: H 1 = 0, H H' = 1.

    Hu'Hv = sum (u - mean u)(v - mean v), with one direction fewer to draw.
    """
    k = np.arange(1, n)[:, None]
    i = np.arange(n)[None, :]
    H: FloatArray = np.where(i < k, 1.0, np.where(i == k, -k, 0.0)) / np.sqrt(k * (k + 1))
    return H


def slope(line: Line) -> FloatArray:
    """b1 = sum u v / sum u u (m,) of the least-squares line; nan where u does not vary."""
    u, v = line
    squares = np.einsum("pm,pm->m", u, u)
    found: FloatArray = np.full_like(squares, np.nan)
    np.divide(np.einsum("pm,pm->m", u, v), squares, out=found, where=squares > 0)
    return found


def angle_error(placed: tuple[Line, Line], nominal: tuple[Line, Line]) -> FloatArray:
    """dtheta (m,), rad, of a row and a column, less what it is by design.

    dtheta = -b1(column) - b1(row), Gilsinn & Ling 2004, eqs. (24)-(26). Rows and columns that
    are not quite square by design have no error for it.
    """
    found: FloatArray = -(slope(placed[0]) + slope(placed[1]))
    return found + (slope(nominal[0]) + slope(nominal[1]))


def check_square(part: LoadedPart, entries: Iterable[int]) -> None:
    """Eqs. (24)-(26) take slopes for angles: rows lie along x, columns along y.

    Raises InputError for every row or column of these `entries` of the part file that does not.
    """
    problems = []
    for index in entries:
        entry = part.part.orthogonality[index]
        lines = (("row", entry.row, 0, 1), ("column", entry.column, 1, 0))
        for kind, ids, along, across in lines:
            found = _nominal_slope(part, ids, along, across)
            if abs(found) <= LARGEST_SLOPE:
                continue
            degrees = 90.0 if np.isnan(found) else np.degrees(np.arctan(found))
            axis = "xy"[along]
            problems.append(
                finding(
                    "off-axis",
                    kind=kind,
                    entry=entry.id,
                    degrees=float(degrees),
                    axis=axis,
                    file=part.source.shown,
                    line=part.line_of("orthogonality", index, kind),
                    path=f"orthogonality[{index}].{kind}",
                    expected=f"features in a line along {axis}, seen in the plane of x and y, at "
                    f"most {np.degrees(np.arctan(LARGEST_SLOPE)):.2g} degrees off",
                )
            )
    if problems:
        raise InputError(problems)


def _nominal_slope(part: LoadedPart, ids: Sequence[str], along: int, across: int) -> float:
    places = part.part.places()
    line = np.array([[places[i][along], places[i][across]] for i in ids], np.float64)
    u, v = (line - line.mean(axis=0)).T
    return float(slope((u[:, None], v[:, None]))[0])
