"""Measured points that cannot be what they claim: swapped axes, wrong units, copied parts."""

from __future__ import annotations

import numpy as np

from mtu_cli.errors import InputError, Problem
from mtu_cli.files.points import Points
from mtu_cli.model.settings import Warned
from mtu_cli.stats.least_squares import FloatArray

SUSPICIOUS_MM = 0.5
"""A typical error beyond this is not one of a machine tool."""
EXPLAINS = 0.1
"""A mistake is named if undoing it leaves less than this share of the error."""
FEWEST_COPIED = 4
"""Fewer equal values than this may be chance."""


def check_measured(points: Points) -> list[Warned]:
    """Warnings on errors of millimetres, with the mistake that would explain them.

    Raises InputError for a part whose values are those of another part, to the last digit.
    """
    _refuse_copies(points)
    known = np.isfinite(points.measured).all(axis=0) & np.isfinite(points.nominal).all(axis=0)
    measured, nominal = points.measured[:, known], points.nominal[:, known]
    size = np.abs(measured - nominal).max(axis=1)
    far = size > SUSPICIOUS_MM
    if not far.any():
        return []
    i = int(np.flatnonzero(far)[0])
    guess = _mistake(measured[far], nominal[far])
    place = f"{points.sources[points.file_index[i]].shown}, row {points.row[i]}"
    return [
        Warned(
            code="error-of-millimetres",
            message=f"{int(far.sum())} of {len(far)} points are more than {SUSPICIOUS_MM:g} mm "
            f"from their nominal (first: {place}): {guess}",
        )
    ]


def _mistake(measured: FloatArray, nominal: FloatArray) -> str:
    now = _typical(measured - nominal)
    guesses = {
        "this looks like x and y swapped": measured[:, [1, 0, *range(2, measured.shape[1])]],
        "this looks like a sign the other way round": -measured,
        "this looks like the sign of x the other way round": measured * _flip(measured, 0),
        "this looks like the sign of y the other way round": measured * _flip(measured, 1),
        "this looks like inches taken for mm": measured * 25.4,
        "this looks like um taken for mm": measured / 1000.0,
        "this looks like metres taken for mm": measured * 1000.0,
    }
    left = {text: _typical(changed - nominal) for text, changed in guesses.items()}
    best = min(left, key=lambda text: left[text])
    if left[best] < EXPLAINS * now:
        return best
    shift = np.median(measured - nominal, axis=0)
    if _typical(measured - nominal - shift) < EXPLAINS * now:
        return "this looks like an origin that differs by " + ", ".join(
            f"{value:.4g} mm" for value in shift
        )
    return "this looks like a unit, a sign, swapped axes or another origin"


def _flip(measured: FloatArray, axis: int) -> FloatArray:
    sign = np.ones(measured.shape[1])
    sign[axis] = -1.0
    return sign


def _typical(errors: FloatArray) -> float:
    return float(np.median(np.abs(errors).max(axis=1)))


def _refuse_copies(points: Points) -> None:
    """Real parts never agree to the last digit in all their values."""
    operation = np.maximum(points.operation, 0)
    order = np.lexsort((points.repeat, points.feature, operation, points.part))
    part = points.part[order]
    starts = np.flatnonzero(np.r_[True, part[1:] != part[:-1]])
    seen: dict[bytes, int] = {}
    problems = []
    for begin, end in zip(starts, np.r_[starts[1:], len(order)], strict=True):
        rows = order[begin:end]
        if len(rows) * 2 < FEWEST_COPIED:
            continue
        key = (
            points.measured[rows].tobytes()
            + points.feature[rows].tobytes()
            + operation[rows].tobytes()
        )
        first = seen.setdefault(key, int(rows[0]))
        if first != int(rows[0]):
            name, other = (points.parts[points.part[j]] for j in (rows[0], first))
            problems.append(
                Problem(
                    what=f"part {name!r} has the same values as part {other!r}",
                    file=points.sources[points.file_index[rows[0]]].shown,
                    row=int(points.row[rows[0]]),
                    column="part",
                    expected="each part once; repeated measurements are numbered in `repeat`",
                )
            )
    if problems:
        raise InputError(problems)
