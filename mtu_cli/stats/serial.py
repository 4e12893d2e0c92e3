"""Regression of blocks of readings whose errors follow each other, with blocks in clusters."""

from __future__ import annotations

from collections.abc import Sequence
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


class SerialFit:
    """y = X b + e, with a level for each block where `levels`.

    The errors of a block have the covariance s^2 V, V_ij = (1 - w) [i = j] + w phi^|i - j|: white
    noise and a part with memory, of share w. Generalised least squares for each (phi, w) of a
    grid, averaged by the restricted likelihood, s^2 integrated out (Harville 1974, Biometrika 61,
    383-385):

        log L = -(log|V| + log|X'V^-1 X| + nu log e'V^-1 e)/2,  nu = n - rank,

    so that b has the mean covariance and the scatter of b over the grid.

    b = `transform` beta in r directions that the rows determine, beta (r,) with `covariance`;
    `null` (k, k - r) are directions that they do not. `clusters` hold (R_c, A_c, Q'e_c) of the
    whitened rows, `inverse` M = (X'V^-1 X)^-1 (r, r) of the likeliest V. Noise of the columns
    attenuates b, E b = (1 - M N) b with N the noise in X'V^-1 X: `attenuated` = (1 - M N)^-1 takes
    that back (Fuller, Measurement Error Models, 1987, eq. (2.2.20)).
    """

    def __init__(self, blocks: Sequence[Block], *, levels: bool) -> None:
        X = np.vstack([b.X - b.X.mean(axis=0) if levels else b.X for b in blocks])
        scale = np.linalg.norm(X, axis=0)
        scale[scale == 0] = 1.0
        _, singular, Vt = np.linalg.svd(X / scale, full_matrices=len(X) < X.shape[1])
        r = int(np.sum(singular > RANK_TOLERANCE * singular.max(initial=0.0)))
        self.transform = T = Vt[:r].T / singular[:r] / scale[:, None]
        self.null = Vt[r:].T / scale[:, None]
        self.dof = float(len(X) - r - (len(blocks) if levels else 0))
        rows = [
            np.column_stack([np.ones(len(b.y)), b.X @ T, b.y - b.y.mean() if levels else b.y])
            for b in blocks
        ]
        grid = [(0.0, 0.0), *product(MEMORY, SHARE)]
        fits = [_fit(rows, max(self.dof, 1.0), levels, *each) for each in grid]
        log_likelihood, betas, covariances = (np.array([x[i] for x in fits]) for i in range(3))
        # Errors without memory are as likely beforehand as all others together.
        log_likelihood[0] += np.log(len(grid) - 1)
        weight = np.exp(log_likelihood - log_likelihood.max())
        weight /= weight.sum()
        self.beta = weight @ betas
        self.covariance = np.tensordot(weight, covariances, 1)
        self.covariance += (betas - self.beta).T * weight @ (betas - self.beta)
        i = int(np.argmax(weight))
        *_, self.inverse, Z = fits[i]
        self.attenuated = _disattenuation(blocks, T, self.inverse, levels, *grid[i])
        parts = np.split(Z, np.cumsum([len(b.y) for b in blocks])[:-1])
        self.clusters = [
            self._cluster(
                [Z for Z, b in zip(parts, blocks, strict=True) if b.cluster == c], betas[i]
            )
            for c in dict.fromkeys(b.cluster for b in blocks)
        ]

    def _cluster(
        self, parts: list[FloatArray], beta: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(R, A, Q'e): X = Q R, A = (I - R M R')^(-1/2) R M, residuals e."""
        Z = np.vstack(parts)
        Q, R = np.linalg.qr(Z[:, :-1])
        values, vectors = np.linalg.eigh(np.eye(len(R)) - R @ self.inverse @ R.T)
        root = np.where(values > _SINGULAR, 1 / np.sqrt(np.maximum(values, _SINGULAR)), 0.0)
        A = (vectors * root) @ vectors.T @ R @ self.inverse
        return R, A, Q.T @ (Z[:, -1] - Z[:, :-1] @ beta)

    def combinations(self, L: FloatArray) -> Combinations:
        """Values and uncertainties of L b, L (q, k).

        By the clusters' scatter (CR2, Bell & McCaffrey 2002, Survey Methodology 28, 169-181),
        u^2 = sum_c (l' M X_c' A_c e_c)^2 with A_c = (I - H_cc)^(-1/2), where its Satterthwaite
        degrees of freedom (Pustejovsky & Tipton 2018, J. Bus. Econ. Stat. 36, 672-683, eq. (11))
        are CLUSTERED_DOF or more; by the model of the errors elsewhere.
        """
        rows = L @ self.transform @ self.attenuated
        a = [A @ rows.T for _, A, _ in self.clusters]
        scores = np.array([e @ a_c for (_, _, e), a_c in zip(self.clusters, a, strict=True)])
        X = np.array([R.T @ a_c for (R, _, _), a_c in zip(self.clusters, a, strict=True)])
        products = -np.einsum("ciq,ij,djq->qcd", X, self.inverse, X)
        for c, a_c in enumerate(a):
            products[:, c, c] += np.sum(a_c**2, axis=0)
        trace, square = np.einsum("qcc->q", products), np.sum(products**2, axis=(1, 2))
        between = np.where(square > 0, trace**2 / np.where(square > 0, square, 1.0), 0.0)
        clustered = between >= CLUSTERED_DOF
        variance = np.einsum("qi,ij,qj->q", rows, self.covariance, rows)
        variance = np.where(clustered, np.sum(scores**2, axis=0), variance)
        size = np.linalg.norm(L, axis=1, keepdims=True) * np.linalg.norm(self.null, axis=0)
        unknown = (np.abs(L @ self.null) > _SINGULAR * size).any(axis=1) | (self.dof < 1)
        return Combinations(
            value=rows @ self.beta,
            u=np.where(unknown, np.inf, np.sqrt(variance)),
            dof=np.where(clustered, between, self.dof),
            clustered=clustered & ~unknown,
        )


def _covariance(n: int, phi: float, w: float) -> FloatArray:
    """V (n, n)."""
    return np.asarray(w * toeplitz(phi ** np.arange(n)) + (1 - w) * np.eye(n))


def _fit(
    rows: list[FloatArray], nu: float, levels: bool, phi: float, w: float
) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Least squares of Z = L^-1 [X, y] with V = L L', less what a level explains of each block: log
    likelihood, beta, its covariance, M, Z.
    """
    whitened, log_det = [], 0.0
    roots = {n: cholesky(_covariance(n, phi, w), lower=True) for n in {*map(len, rows)}}
    for block in rows:
        L = roots[len(block)]
        Z = solve_triangular(L, block, lower=True)
        log_det += 2 * float(np.sum(np.log(np.diag(L))))
        if levels:
            one = Z[:, :1]
            square = float(one[:, 0] @ one[:, 0])
            Z = Z - one @ (one.T @ Z) / square
            log_det += float(np.log(square))
        whitened.append(Z[:, 1:])
    Z = np.vstack(whitened)
    Q, R = np.linalg.qr(Z[:, :-1])
    beta = solve_triangular(R, Q.T @ Z[:, -1])
    root = solve_triangular(R, np.eye(len(R)))
    least = _ROUNDING * float(Z[:, -1] @ Z[:, -1])
    rss = max(float(np.sum((Z[:, -1] - Z[:, :-1] @ beta) ** 2)), least, 1e-300)
    log_det += 2 * float(np.sum(np.log(np.abs(np.diag(R)))))
    inverse = root @ root.T
    return -(log_det + nu * np.log(rss)) / 2, beta, rss / nu * inverse, inverse, Z


def _disattenuation(
    blocks: Sequence[Block], T: FloatArray, M: FloatArray, levels: bool, phi: float, w: float
) -> FloatArray:
    """(1 - M N)^-1, the noise's share of no direction taken as more than MOST_NOISE."""
    weights: dict[int, float] = {}
    N = np.zeros(M.shape)
    for block in blocks:
        n = len(block.y)
        if n not in weights:
            inverse = np.linalg.inv(_covariance(n, phi, w))
            sums = inverse.sum(axis=0)
            lost = float(sums @ sums) / float(sums.sum()) if levels else 0.0
            weights[n] = float(np.trace(inverse)) - lost
        N += weights[n] * T.T @ block.noise @ T
    root = cholesky(M, lower=True)
    share, W = np.linalg.eigh(root.T @ N @ root)
    gain = 1 / (1 - np.clip(share, 0.0, MOST_NOISE))
    return np.asarray(root @ (W * gain) @ W.T @ np.linalg.inv(root))
