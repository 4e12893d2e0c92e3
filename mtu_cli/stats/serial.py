"""Readings in the order of time: first-order lag, regression of blocks of readings whose errors
follow each other, with blocks in clusters, and what residuals and regressors tell about a fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from mtu_cli.stats.groups import group_means
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
    `null` (k, k - r) are directions that they do not. `clusters` hold (R, A, Q'e) of the whitened
    rows, X = Q R, A = (I - R M R')^(-1/2) R M, residuals e; `inverse` M = (X'V^-1 X)^-1 (r, r) is
    of the likeliest V. Noise of the columns attenuates b, E b = (1 - M N) b with N the noise in
    X'V^-1 X: `attenuated` = (1 - M N)^-1 takes that back (Fuller, Measurement Error Models, 1987,
    eq. (2.2.20)).
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
        self.clusters = list[tuple[FloatArray, FloatArray, FloatArray]]()
        for c in dict.fromkeys(b.cluster for b in blocks):
            Z = np.vstack([part for part, b in zip(parts, blocks, strict=True) if b.cluster == c])
            Q, R = np.linalg.qr(Z[:, :-1])
            values, vectors = np.linalg.eigh(np.eye(len(R)) - R @ self.inverse @ R.T)
            root = np.where(values > _SINGULAR, 1 / np.sqrt(np.maximum(values, _SINGULAR)), 0.0)
            A = (vectors * root) @ vectors.T @ R @ self.inverse
            self.clusters.append((R, A, Q.T @ (Z[:, -1] - Z[:, :-1] @ betas[i])))

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
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return np.asarray(w * (phi ** np.arange(n))[lags] + (1 - w) * np.eye(n))


def _fit(
    rows: list[FloatArray], nu: float, levels: bool, phi: float, w: float
) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Least squares of Z = L^-1 [X, y] with V = L L', less what a level explains of each block: log
    likelihood, beta, its covariance, M, Z.
    """
    from scipy.linalg import solve_triangular

    whitened, log_det = [], 0.0
    roots = {n: np.linalg.cholesky(_covariance(n, phi, w)) for n in {*map(len, rows)}}
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
    root = np.linalg.cholesky(M)
    share, W = np.linalg.eigh(root.T @ N @ root)
    gain = 1 / (1 - np.clip(share, 0.0, MOST_NOISE))
    return np.asarray(root @ (W * gain) @ W.T @ np.linalg.inv(root))


def first_order_lag(signal: FloatArray, time: FloatArray, time_constants: FloatArray) -> FloatArray:
    """u (k, n, s) with tau du/dt = T - u for each of k time constants; T is (n, s), time (n,).

    Exact for a signal that is linear between its samples:

        u_i = T_i - g tau + (u_(i-1) - T_(i-1) + g tau) exp(-dt/tau),  g = (T_i - T_(i-1))/dt.

    Rows of one time that follow each other are one sample, their mean. The first sample counts as
    settled, and so does one that is earlier than the one before (a new run). tau = 0 gives every
    row's own signal, an infinite step T. Time and time constants are in the same unit.
    """
    new = np.concatenate([[True], np.diff(time) != 0])
    starts, moment = np.flatnonzero(new), np.cumsum(new) - 1
    T = signal if new.all() else group_means(signal, moment, len(starts))
    tau = np.asarray(time_constants, float)
    slow = tau[tau > 0][:, None]
    lagged = np.repeat(T[None], len(slow), axis=0)
    for i, dt in enumerate(np.diff(time[starts]).tolist() if len(slow) else (), start=1):
        if dt > 0:
            rise = (T[i] - T[i - 1]) * (slow / dt)
            lagged[:, i] = T[i] - rise + (lagged[:, i - 1] - T[i - 1] + rise) * np.exp(-dt / slow)
    result = np.repeat(signal[None], len(tau), axis=0)
    result[tau > 0] = lagged[:, moment]
    return result


FEWEST_FOR_NORMALITY = 20
DEPENDENT = 1e-12
"""Share of the largest singular value below which only rounding is left."""


def normality_p(values: FloatArray, effective: float) -> float | None:
    """p of D'Agostino & Pearson's K^2 test of normality (1973, Biometrika 60, 613-622).

    `effective`: how many of the values, which follow each other, count as independent; about
    so many, evenly spaced, are tested. None below 20 of them, where the approximation does not
    hold, and for values that are all equal.
    """
    from scipy.stats import normaltest

    values = values[:: max(1, round(len(values) / effective))]
    if len(values) < FEWEST_FOR_NORMALITY or np.ptp(values) == 0:
        return None
    return float(normaltest(values).pvalue)


def collinearity(columns: FloatArray) -> tuple[float, FloatArray]:
    """The condition number of centred columns (r, k), and the variance inflation (k,) of each.

    The largest over the smallest singular value of the columns scaled to unit length (Belsley, Kuh
    & Welsch, Regression Diagnostics, 1980, ch. 3), and VIF_j = 1/(1 - R_j^2) of each against all
    others, the diagonal of the inverse correlation matrix (Marquardt 1970, Technometrics 12,
    591-612). Infinite where columns depend, as more columns than rows do; 1 without columns.
    """
    length = np.linalg.norm(columns, axis=0)
    # Rows of zeros change nothing, and give the columns a singular value each.
    rows = np.zeros((max(columns.shape), columns.shape[1]))
    rows[: len(columns)] = columns / np.where(length > 0, length, 1.0)
    _, singular, Vt = np.linalg.svd(rows, full_matrices=False)
    tiny = singular <= DEPENDENT * singular.max(initial=0.0)
    condition = np.inf if tiny.any() else singular.max(initial=1.0) / singular.min(initial=1.0)
    inflation = ((Vt[~tiny].T / singular[~tiny]) ** 2).sum(axis=1)
    dependent = (Vt[tiny] ** 2).sum(axis=0) > DEPENDENT
    return float(condition), np.where(dependent, np.inf, inflation)
