"""Regression of blocks of readings whose errors follow each other, with blocks in clusters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

from mtu_cli.stats.least_squares import RANK_TOLERANCE, FloatArray

MEMORY = (0.3, 0.5, 0.7, 0.8, 0.88, 0.93, 0.96, 0.98, 0.99)
SHARE = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Autocorrelations from reading to reading, and shares of the variance that have it, by which the
likelihood is averaged."""
CLUSTERED_DOF = 4.0
"""Degrees of freedom from which on the scatter between clusters is known well enough."""
MOST_NOISE = 0.9
"""Share of a column's variance that is taken to be noise, at most."""
_ROUNDING = 1e-12
_SINGULAR = 1e-9


class Block(NamedTuple):
    """Readings that follow each other: columns X (n, k), readings y (n,), which cluster, and the
    covariance (k, k) of the white noise that each row of X holds.
    """

    X: FloatArray
    y: FloatArray
    cluster: int
    noise: FloatArray


class Combinations(NamedTuple):
    """Linear combinations of coefficients: values (q,), u (q,) (inf: not determined), dof (q,),
    and whether u is that of the scatter between clusters.
    """

    value: FloatArray
    u: FloatArray
    dof: FloatArray
    clustered: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialFit:
    """Coefficients T beta of r directions that the rows determine, beta (r,) with `covariance`.

    `null` (k, k - r) are directions that they do not. `clusters` hold (R_c, A_c, Q'e_c) of the
    whitened rows, `inverse` M = (X'V^-1 X)^-1 (r, r). Noise of the columns attenuates b, E b =
    (1 - M N) b with N the noise in X'V^-1 X: `attenuated` = (1 - M N)^-1 takes that back (Fuller,
    Measurement Error Models, 1987, eq. (2.2.20)).
    """

    transform: FloatArray
    null: FloatArray
    beta: FloatArray
    covariance: FloatArray
    dof: float
    inverse: FloatArray
    attenuated: FloatArray
    clusters: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]

    def combinations(self, L: FloatArray) -> Combinations:
        """Values and uncertainties of L b, L (q, k).

        By the clusters' scatter (CR2, Bell & McCaffrey 2002, Survey Methodology 28, 169-181),
        u^2 = sum_c (l' M X_c' A_c e_c)^2 with A_c = (I - H_cc)^(-1/2), where its Satterthwaite
        degrees of freedom (Pustejovsky & Tipton 2018, J. Bus. Econ. Stat. 36, 672-683, eq. (11))
        are CLUSTERED_DOF or more; by the model of the errors elsewhere.
        """
        rows = L @ self.transform @ self.attenuated
        u = np.sqrt(np.einsum("qi,ij,qj->q", rows, self.covariance, rows))
        dof = np.full(len(L), self.dof)
        variance, between = self._between_clusters(rows)
        clustered = between >= CLUSTERED_DOF
        u, dof = np.where(clustered, np.sqrt(variance), u), np.where(clustered, between, dof)
        size = np.linalg.norm(L, axis=1, keepdims=True) * np.linalg.norm(self.null, axis=0)
        undetermined = (np.abs(L @ self.null) > _SINGULAR * size).any(axis=1) | (self.dof < 1)
        u = np.where(undetermined, np.inf, u)
        return Combinations(rows @ self.beta, u, dof, clustered & ~undetermined)

    def _between_clusters(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Variances (q,) of combinations `rows` (q, r) of beta and their degrees of freedom."""
        a = [A @ rows.T for _, A, _ in self.clusters]
        scores = np.array([e @ own for (_, _, e), own in zip(self.clusters, a, strict=True)])
        X = np.array([R.T @ own for (R, _, _), own in zip(self.clusters, a, strict=True)])
        products = -np.einsum("ciq,ij,djq->qcd", X, self.inverse, X)
        for c, own in enumerate(a):
            products[:, c, c] += np.sum(own**2, axis=0)
        trace, square = np.einsum("qcc->q", products), np.sum(products**2, axis=(1, 2))
        dof = np.where(square > 0, trace**2 / np.where(square > 0, square, 1.0), 0.0)
        return np.sum(scores**2, axis=0), dof


class _Whitened(NamedTuple):
    """Rows of unit variance: blocks of X, y, and the log likelihood's terms."""

    X: list[FloatArray]
    y: list[FloatArray]
    log_det: float


def serial_fit(blocks: Sequence[Block], *, levels: bool) -> SerialFit:
    """y = X b + e, with a level of its own for each block where `levels`.

    The errors of a block have the covariance s^2 V, V_ij = (1 - w) [i = j] + w phi^|i - j|: white
    noise and a part with memory, of share w. Generalised least squares for each (phi, w) of a
    grid, averaged by the restricted likelihood, s^2 integrated out (Harville 1974, Biometrika 61,
    383-385):

        log L = -(log|V| + log|X'V^-1 X| + nu log e'V^-1 e)/2,  nu = n - rank,

    so that b has the mean covariance and the scatter of the grid's own b.
    """
    X = np.vstack([b.X - b.X.mean(axis=0) if levels else b.X for b in blocks])
    scale = np.linalg.norm(X, axis=0)
    scale[scale == 0] = 1.0
    _, singular, Vt = np.linalg.svd(X / scale, full_matrices=len(X) < X.shape[1])
    r = int(np.sum(singular > RANK_TOLERANCE * singular.max(initial=0.0)))
    T = Vt[:r].T / singular[:r] / scale[:, None]
    designs = [b.X @ T for b in blocks]
    readings = [b.y - b.y.mean() if levels else b.y for b in blocks]
    nu = len(X) - r - (len(blocks) if levels else 0)
    grid = [(0.0, 0.0), *product(MEMORY, SHARE)]
    found = [_fitted(_whitened(designs, readings, levels, *each), nu) for each in grid]
    # Errors without memory are as likely beforehand as all others together.
    log_likelihood = np.array([each[0] for each in found])
    log_likelihood[0] += np.log(len(grid) - 1)
    weight = np.exp(log_likelihood - log_likelihood.max())
    weight /= weight.sum()
    betas, covariances = (np.array([each[i] for each in found]) for i in (1, 2))
    beta = weight @ betas
    covariance = np.tensordot(weight, covariances, 1)
    covariance += (betas - beta).T * weight @ (betas - beta)
    best = int(np.argmax(weight))
    white = _whitened(designs, readings, levels, *grid[best])
    inverse = found[best][3]
    return SerialFit(
        transform=T,
        null=Vt[r:].T / scale[:, None],
        beta=beta,
        covariance=covariance,
        dof=float(nu),
        inverse=inverse,
        attenuated=_unattenuated(blocks, T, inverse, levels, *grid[best]),
        clusters=_clusters(blocks, white, betas[best], inverse),
    )


def _whitened(
    designs: list[FloatArray], readings: list[FloatArray], levels: bool, phi: float, w: float
) -> _Whitened:
    """L^-1 [X, y] with V = L L', less what a level explains of each block."""
    X, y, log_det = [], [], 0.0
    roots: dict[int, FloatArray] = {}
    for design, reading in zip(designs, readings, strict=True):
        n = len(reading)
        if n not in roots:
            V = w * toeplitz(phi ** np.arange(n)) + (1 - w) * np.eye(n)
            roots[n] = cholesky(V, lower=True)
        L = roots[n]
        Z = solve_triangular(L, np.column_stack([np.ones(n), design, reading]), lower=True)
        log_det += 2 * float(np.sum(np.log(np.diag(L))))
        if levels:
            one = Z[:, :1]
            square = float(one[:, 0] @ one[:, 0])
            Z = Z - one @ (one.T @ Z) / square
            log_det += float(np.log(square))
        X.append(Z[:, 1:-1])
        y.append(Z[:, -1])
    return _Whitened(X, y, log_det)


def _unattenuated(
    blocks: Sequence[Block], T: FloatArray, M: FloatArray, levels: bool, phi: float, w: float
) -> FloatArray:
    """(1 - M N)^-1, the noise's share of no direction taken as more than MOST_NOISE."""
    weights: dict[int, float] = {}
    N = np.zeros(M.shape)
    for block in blocks:
        n = len(block.y)
        if n not in weights:
            inverse = np.linalg.inv(w * toeplitz(phi ** np.arange(n)) + (1 - w) * np.eye(n))
            each = inverse.sum(axis=0)
            lost = float(each @ each) / float(each.sum()) if levels else 0.0
            weights[n] = float(np.trace(inverse)) - lost
        N += weights[n] * T.T @ block.noise @ T
    root = cholesky(M, lower=True)
    share, W = np.linalg.eigh(root.T @ N @ root)
    gain = 1 / (1 - np.clip(share, 0.0, MOST_NOISE))
    return root @ (W * gain) @ W.T @ np.linalg.inv(root)


def _fitted(white: _Whitened, nu: int) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """(log likelihood, beta, its covariance, (X'V^-1 X)^-1)."""
    X, y = np.vstack(white.X), np.concatenate(white.y)
    Q, R = np.linalg.qr(X)
    beta = solve_triangular(R, Q.T @ y)
    inverse = solve_triangular(R, np.eye(len(R)))
    inverse = inverse @ inverse.T
    rss = max(float(np.sum((y - X @ beta) ** 2)), _ROUNDING * float(y @ y), 1e-300)
    log_det = white.log_det + 2 * float(np.sum(np.log(np.abs(np.diag(R)))))
    freedom = max(nu, 1)
    return -(log_det + freedom * np.log(rss)) / 2, beta, rss / freedom * inverse, inverse


def _clusters(
    blocks: Sequence[Block], white: _Whitened, beta: FloatArray, M: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], ...]:
    """(R, A, Q'e) of each cluster: X = Q R, A = (I - R M R')^(-1/2) R M, residuals e."""
    result = []
    for cluster in dict.fromkeys(block.cluster for block in blocks):
        mine = [i for i, block in enumerate(blocks) if block.cluster == cluster]
        X = np.vstack([white.X[i] for i in mine])
        e = np.concatenate([white.y[i] for i in mine]) - X @ beta
        Q, R = np.linalg.qr(X)
        values, vectors = np.linalg.eigh(np.eye(len(R)) - R @ M @ R.T)
        usable = values > _SINGULAR
        root = np.where(usable, 1 / np.sqrt(np.where(usable, values, 1.0)), 0.0)
        result.append((R, (vectors * root) @ vectors.T @ R @ M, Q.T @ e))
    return tuple(result)
