"""Coefficients of the effects that were found, jointly, with their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.close_loop.scan import Scan
from mtu_cli.stats.column_groups import MemberColumns, whitened
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.loop_null import draw
from mtu_cli.stats.streams import stream

REWEIGHTED = 6
DRAWN = 3_000
BATCH_ENTRIES = 2_000_000
MOST_ENTRIES = 60_000_000
FEWEST_DRAWN = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectFit:
    """`beta` (k,), its covariance (k, k), and the effective degrees of freedom (k,) of each by
    Welch-Satterthwaite over the strata; `weights` (S,) one over the strata's variances.
    """

    beta: FloatArray
    covariance: FloatArray
    dof: FloatArray
    weights: FloatArray


def raw_design(scan: Scan, members: Sequence[MemberColumns]) -> FloatArray:
    """The columns of all members, (N, k)."""
    strata = scan.frame.strata
    columns = [column for member in members for column in member]
    X = np.zeros((strata.size, len(columns)))
    for j, column in enumerate(columns):
        for index, values in column.items():
            X[strata.all[index].slice, j] = values
    return X


def estimate(scan: Scan, y: FloatArray, members: Sequence[MemberColumns]) -> EffectFit:
    """Generalised least squares of `y` (N,) on the columns of `members`.

    beta = (X' W X)^-1 X' W y with W the inverse variances of the strata, re-estimated from what
    is left with its degrees of freedom: restricted maximum likelihood in a complete table.
    """
    strata = scan.frame.strata
    plain = whitened(strata, scan.whitening, raw_design(scan, members))
    X, y = _beside_fitted(scan, plain, whitened(strata, scan.whitening, y))
    slices = [stratum.slice for stratum in strata.all]
    n = scan.dof
    G = np.array([X[s].T @ X[s] for s in slices])
    b = np.array([X[s].T @ y[s] for s in slices])
    R0 = np.array([y[s] @ y[s] for s in slices])
    R, spent = R0, np.zeros(len(n))
    for _ in range(REWEIGHTED):
        w = np.maximum(n - spent, 1.0) / np.maximum(R, 1e-300)
        w = np.where((n > 0) & (R0 > 0), w, 0.0)
        C = np.linalg.pinv(np.einsum("s,sij->ij", w, G), hermitian=True)
        beta = C @ (w @ b)
        spent = w * np.einsum("sij,ij->s", G, C)
        R = np.maximum(R0 - 2 * b @ beta + np.einsum("i,sij,j->s", beta, G, beta), 1e-12 * R0)
    shares = np.einsum("ij,sjk,ki->is", C, G, C) * w
    nu = np.maximum(n - spent, 1.0)
    dof = np.diag(C) ** 2 / np.maximum((shares**2 / nu).sum(axis=1), 1e-300)
    return EffectFit(beta=beta, covariance=C, dof=dof, weights=w)


def drawn_covariance(
    scan: Scan, members: Sequence[MemberColumns], fit: EffectFit, seed: int
) -> FloatArray:
    """The covariance (k, k) of beta with these weights, from tables drawn of the null.

    In a table that is incomplete, whose parts were set free, or whose axes share an
    uncertainty, coordinates are correlated: the weights are then not the inverse covariance.
    The formula's covariance is scaled to the drawn one, component by component.
    """
    strata = scan.frame.strata
    plain = whitened(strata, scan.whitening, raw_design(scan, members))
    w = np.concatenate(
        [np.full(s.size, weight) for s, weight in zip(strata.all, fit.weights, strict=True)]
    )
    samples = int(np.clip(MOST_ENTRIES // max(strata.size, 1), FEWEST_DRAWN, DRAWN))
    batch = max(1, BATCH_ENTRIES // max(strata.size, 1))
    rng = stream(seed, 6, 1)
    found = []
    for first in range(0, samples, batch):
        y, _ = draw(scan.frame, scan.null, min(batch, samples - first), rng)
        X, left = _beside_fitted(scan, plain, whitened(strata, scan.whitening, y.T))
        found.append((fit.covariance @ (X.T @ (w[:, None] * left))).T)
    betas = np.concatenate(found)
    return betas.T @ betas / len(betas)


def _beside_fitted(scan: Scan, X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns and coordinates less the polynomial that the readings themselves gave."""
    if not scan.base:
        return X, y
    fitted = whitened(scan.frame.strata, scan.whitening, raw_design(scan, scan.base))
    Q = np.linalg.qr(fitted)[0]
    return X - Q @ (Q.T @ X), y - Q @ (Q.T @ y)
