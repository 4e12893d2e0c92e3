"""Lengths between features as functions of their errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.findings import error
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.trials import Measure
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import IntArray
from mtu_cli.stats.workspace import Workspace


def differences(points: FloatArray, pairs: IntArray, names: Sequence[str], file: str) -> FloatArray:
    """End minus start (lengths, 3) of nominal `points` (n, 3), mm; 0 along z where neither has it.

    Raises InputError for a length of which one end alone has a z.
    """
    delta = points[pairs[:, 1]] - points[pairs[:, 0]]
    unknown = np.isnan(points[pairs].sum(axis=2))
    for i in np.flatnonzero(unknown[:, 0] != unknown[:, 1])[:1]:
        raise error(
            "missing-key",
            key="z_mm",
            file=file,
            path=f"length {names[i]!r}",
            expected="z_mm of both features, or of the part",
        )
    return np.nan_to_num(delta)


def length_gradient(prediction: Prediction, pairs: IntArray, delta: FloatArray) -> FloatArray:
    """dL/dE (lengths, rows): minus and plus the nominal unit vector, eq. (22)."""
    a = len(prediction.axes)
    unit = delta / np.linalg.norm(delta, axis=1)[:, None]
    columns = [AXES.index(axis) for axis in prediction.axes]
    gradient = np.zeros((len(pairs), len(prediction.mean)))
    for i, (start, end) in enumerate(pairs):
        gradient[i, start * a : start * a + a] -= unit[i, columns]
        gradient[i, end * a : end * a + a] += unit[i, columns]
    return gradient


def length_measure(
    prediction: Prediction, pairs: IntArray, delta: FloatArray
) -> tuple[Measure, FloatArray]:
    """Length minus nominal, eqs. (20)-(21), and the differences of errors that it needs.

    The sum runs over the prediction's axes: an axis without equation has no error.
    """
    a = len(prediction.axes)
    columns = [AXES.index(axis) for axis in prediction.axes]
    L0 = np.linalg.norm(delta, axis=1)
    m = len(pairs)
    combine = np.zeros((a * m, len(prediction.mean)))
    for j in range(a):
        rows = np.arange(j * m, (j + 1) * m)
        combine[rows, pairs[:, 1] * a + j] += 1.0
        combine[rows, pairs[:, 0] * a + j] -= 1.0

    def measure(differences: FloatArray, work: Workspace) -> FloatArray:
        return length_error(L0, delta[:, columns], differences.reshape(a, m, -1))

    return measure, combine


def length_error(L0: FloatArray, delta: FloatArray, e: FloatArray) -> FloatArray:
    """L - L0 (lengths, n), mm, Gilsinn & Ling 2004, eqs. (20)-(21).

    L - L0 = (2 delta.e + e.e)/(L + L0): no digits are lost to the difference of two lengths.
    `L0` (lengths,) nominal, `delta` (lengths, axes) the ends' nominal difference along the axes
    that have errors, `e` (axes, lengths, n) the difference of the two ends' errors there.
    """
    grown = np.zeros(e.shape[1:])
    for along, slip in zip(delta.T, e, strict=True):
        grown += (2 * along[:, None] + slip) * slip
    length = L0[:, None]
    errors: FloatArray = grown / (np.sqrt(length**2 + grown) + length)
    return errors
