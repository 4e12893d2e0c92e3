"""Passes there and back: what the two passes of one run share.

The axis is as warm on its way back as it was on its way there. With f_r there and g_r back, the
deviations of level and slope of run r = 1 .. P from the mean of their direction,

    m_r = (f_r + g_r)/2,    h_r = (f_r - g_r)/2

have mean squares S_m and S_h of P - 1 degrees of freedom each, which are independent. Then
S = S_m + S_h is the mean square of single passes, K = S_m - S_h the covariance of the two of a
run, S_m/P that of the mean of all, whose passes are independent only where K = 0 (the split-plot
analysis with runs as whole plots: Box, Hunter & Hunter, Statistics for Experimenters, 9.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.positive_part import as_covariance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FEWEST_RUNS = 2
"""One run has nothing to differ from."""
ROUNDING = 1e-12
"""Eigenvalue of a correlation matrix that is 0 but for rounding."""


def pairs_of(runs: IntArray, sign: FloatArray) -> IntArray:
    """(P, 2) the pass there and the pass back of every run that has one of each.

    `runs` (G,) number the run of each pass, `sign` (G,) is its direction; of several passes one
    way the last there and the first back are taken.
    """
    order = np.lexsort([-sign, runs])
    first, second = order[:-1], order[1:]
    both = (runs[first] == runs[second]) & (sign[first] > 0) & (sign[second] < 0)
    found: IntArray = np.column_stack([first[both], second[both]]).astype(np.int64)
    return found


def units_dof(G: int, pairs: IntArray, columns: int) -> int:
    """Degrees of freedom between G passes less `columns` of directions, runs being the units. The
    two passes of a run alone differ by S_h at least: they count as independent.
    """
    if len(pairs) < FEWEST_RUNS:
        return G - columns
    return min(G - columns, G - len(pairs) - 1)


def covariance_in_runs(deviations: FloatArray, pairs: IntArray, between: FloatArray) -> FloatArray:
    """K (q, q), the covariance of the passes there and back of a run, from their `deviations`
    (G, q) and the mean square S = `between` of all; 0 of fewer than two runs.

    Where some passes have no fellow S is not of the same passes: K then stays within -S and S.
    """
    q = deviations.shape[1]
    if len(pairs) < FEWEST_RUNS:
        return np.zeros((q, q))
    there, back = (own - own.mean(axis=0) for own in (deviations[way] for way in pairs.T))
    product = there.T @ back / (len(pairs) - 1)
    K: FloatArray = (product + product.T) / 2
    return K if 2 * len(pairs) == len(deviations) else bounded(K, between)


def bounded(K: FloatArray, S: FloatArray) -> FloatArray:
    """K (q, q) cut to lie between -S and S; 0 in what S does not scatter in."""
    values, vectors = np.linalg.eigh(S / np.outer(scale := _scale(S), scale))
    live = values > ROUNDING
    root = scale[:, None] * vectors[:, live] * np.sqrt(values[live])
    inverse = (vectors[:, live] / np.sqrt(values[live])).T / scale
    values, vectors = np.linalg.eigh(inverse @ K @ inverse.T)
    turned = root @ vectors
    found: FloatArray = (turned * values.clip(-1.0, 1.0)) @ turned.T
    return (found + found.T) / 2


def _scale(S: FloatArray) -> FloatArray:
    scale: FloatArray = np.sqrt(np.diag(S))
    return np.where(scale > 0, scale, 1.0)


def half_differences(S: FloatArray, K: FloatArray, pairs: IntArray, G: int) -> FloatArray | None:
    """S_h (q, q) of the mean square S between G passes; None of fewer than two runs.

    Passes without a fellow have no covariance: over all of them it is so much less. Where both
    passes of every run differ by the same it is 0, which rounding may have made negative.
    """
    if len(pairs) < FEWEST_RUNS:
        return None
    return as_covariance((S - 2 * len(pairs) / G * K) / 2)
