"""Generalised least squares over strata whose variances are estimated along with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray, least_squares, shortened

REWEIGHTED = 6
FEWEST = 1.0
"""Degrees of freedom that a stratum is judged by at least."""
LEAST = 1e-12
"""Share of a stratum's squares below which what is left of them is rounding."""
FEWEST_BESIDE = 5.0
"""Degrees of freedom that a stratum needs beside the columns in it to be judged by itself alone:
of fewer its mean square is by chance a hundredth of what lies in it, and effects are found there.
"""
HELD = 1e-20
"""Share of a column's square below which a stratum does not hold it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StratifiedFit:
    """`beta` (k,), its `covariance` (k, k), and the effective degrees of freedom (k,) of each by
    Welch-Satterthwaite over the strata; `weights` (S,) one over the strata's variances, and
    `at_weights` (k, k) what the covariance would be if these were exactly known.
    """

    beta: FloatArray
    covariance: FloatArray
    dof: FloatArray
    weights: FloatArray
    at_weights: FloatArray

    def only(self, count: int) -> StratifiedFit:
        """The first `count` coefficients, those behind them fitted beside."""
        return StratifiedFit(
            beta=self.beta[:count],
            covariance=self.covariance[:count, :count],
            dof=self.dof[:count],
            weights=self.weights,
            at_weights=self.at_weights[:count, :count],
        )


def stratified_fit(
    X: FloatArray,
    y: FloatArray,
    places: Sequence[slice],
    dof: FloatArray,
    within: NDArray[np.int64] | None = None,
) -> StratifiedFit:
    """Fits y = X beta + e; X (N, k), y (N,), `places` and `dof` (S,) those of the strata.

    beta = (X' W X)^-1 X' W y with W one over the strata's variances, which are re-estimated
    from what is left with the degrees of freedom that are left: restricted maximum likelihood
    where coordinates of a stratum are uncorrelated with one variance. Of one that its columns fit
    nearly exactly (`_bounded`) `within` (S,) is the stratum whose variance is a part of its own.
    """
    k = X.shape[1]
    rows = _triangles(np.column_stack([X, y]), places)
    G = rows[:, :, :k].transpose(0, 2, 1) @ rows[:, :, :k]
    total = (rows[:, :, k] ** 2).sum(axis=1)
    null, beside = dof / np.maximum(total, 1e-300), dof - _held(G)
    left, spent = total, np.zeros(len(rows))
    for _ in range(REWEIGHTED):
        w = np.maximum(dof - spent, FEWEST) / np.maximum(left, 1e-300)
        w = np.where((dof > 0) & (total > 0), w, 0.0)
        w = _bounded(w, null, beside, within)
        whole = (np.sqrt(w)[:, None, None] * rows).reshape(-1, k + 1)
        fit = least_squares(whole[:, :k], whole[:, k])
        beta, C = fit.coefficients, fit.unscaled_covariance
        spent = w * np.einsum("sij,ji->s", G, C)
        squares = ((rows[:, :, k] - rows[:, :, :k] @ beta) ** 2).sum(axis=1)
        left = np.maximum(squares, LEAST * total)
    nu = np.maximum(dof - spent, FEWEST)
    # What each stratum adds to C: their sum.
    own = w[:, None, None] * (C @ G @ C)
    return StratifiedFit(
        beta=beta,
        covariance=C + _of_estimated_weights(C @ (w[:, None, None] * G), own, nu),
        dof=_effective(C, own, nu),
        weights=w,
        at_weights=C,
    )


def _held(G: FloatArray) -> FloatArray:
    """The number (S,) of columns that each stratum holds, by their cross products (S, k, k)."""
    squares = np.diagonal(G, axis1=1, axis2=2)
    found: FloatArray = (squares > HELD * squares.sum(axis=0)).sum(axis=1).astype(np.float64)
    return found


def _bounded(
    w: FloatArray, null: FloatArray, beside: FloatArray, within: NDArray[np.int64] | None
) -> FloatArray:
    """Weights (S,) no larger than strata with so few degrees of freedom `beside` their columns can
    have: where none are, not above those of the `null`, of which nothing was taken out, for
    the columns fit them whatever their variance; where fewer than `FEWEST_BESIDE` are, not above
    the weight of what lies `within`, as a part's mean scatters no less than its entries.
    """
    found: FloatArray = np.where(beside < 1.0, np.minimum(w, null), w)
    if within is None:
        return found
    least = np.where(w[within] > 0, found[within], np.inf)
    return np.where(beside < FEWEST_BESIDE, np.minimum(found, least), found)


def _of_estimated_weights(M: FloatArray, own: FloatArray, nu: FloatArray) -> FloatArray:
    """What C lacks because the weights are estimates: sum_s 4/nu_s (C_s - M_s C_s).

    C_s (S, k, k) is the part of stratum s in C and M_s = C_s C^-1. Half of it is the scatter of
    beta that the errors of the weights cause, half the bias of C itself: Kenward & Roger,
    Biometrics 53 (1997) 983, for one variance a stratum; Meier, ibid. 9 (1953) 59, for k = 1.
    """
    lacks = (4 / nu[:, None, None] * (own - M @ own)).sum(axis=0)
    found: FloatArray = 0.5 * (lacks + lacks.T)
    return found


def _effective(C: FloatArray, own: FloatArray, nu: FloatArray) -> FloatArray:
    """Welch-Satterthwaite (k,): C_ii^2 / sum_s C_s,ii^2 / nu_s."""
    squares = np.diagonal(own, axis1=1, axis2=2) ** 2 / nu[:, None]
    found: FloatArray = np.diag(C) ** 2 / np.maximum(squares.sum(axis=0), 1e-300)
    return found


def _triangles(rows: FloatArray, places: Sequence[slice]) -> FloatArray:
    """The `shortened` of each stratum's rows, filled up with zeros to (S, m, m)."""
    m = rows.shape[1]
    found = np.zeros((len(places), m, m))
    for own, place in zip(found, places, strict=True):
        short = shortened(rows[place])
        own[: len(short)] = short
    return found
