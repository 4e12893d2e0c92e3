"""Components of variance of grouped readings: passes with random intercept and slope.

The model of one error component read in G passes is

    y_gi = x_i' b + z_i' d_g + e_gi,    d_g ~ N(0, D),    e_gi ~ N(0, s_repeat^2),

with x = [1, p, p^2, ...] and z = [1, p - c], c the mean position. D is the pass-to-pass
covariance, s_repeat the repeatability. It is estimated from mean squares, whose
distributions are known exactly on a balanced design: within passes (nu_w degrees of
freedom) and between the passes' own coefficients (nu_b). See Searle, Casella & McCulloch,
Variance Components (1992), ch. 4, for the moment equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import LeastSquares, least_squares

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PassFit:
    """The mixed model of one component; q = 2 random columns with an axis, 1 without, or 0.

    `plain` is the ordinary least-squares fit of all readings as repeats (Gilsinn & Ling 2004,
    eqs. (5)-(11)). `covariance` (k, k) is that of its coefficients under the mixed model, D
    (q, q) the pass-to-pass covariance at `center`, `s2` the repeatability variance, `split` (q, q)
    the T of `split_mean_square`.
    `between` (q, q) is the mean square of the passes' own coefficients with `pass_dof`
    degrees of freedom, `within_dof` belongs to `s2`. `pass_coefficients` (G, q) are the
    passes' own intercepts (at the centre) and slopes, `deviations` (G, q) the same less
    their mean by direction. `separated` is False where the data cannot tell D from s2.
    `per_pass_precision` (G, q, q) holds Z_g' Z_g.
    """

    plain: LeastSquares
    covariance: FloatArray
    center: float
    s2: float
    D: FloatArray
    D_moment: FloatArray
    split: FloatArray
    between: FloatArray
    pass_dof: int
    within_dof: int
    within_rss: float
    separated: bool
    groups: IntArray
    group_direction: FloatArray
    pass_coefficients: FloatArray
    deviations: FloatArray
    per_pass_precision: FloatArray

    @property
    def n_passes(self) -> int:
        """Number of passes G."""
        return len(self.groups)


def polynomial(position: FloatArray, degree: int) -> FloatArray:
    """Design rows [1, p, ..., p^degree], shape (n, degree + 1)."""
    return np.vander(position, degree + 1, increasing=True)


def fit_passes(
    y: FloatArray,
    position: FloatArray,
    degree: int,
    group: IntArray | None = None,
    direction: FloatArray | None = None,
) -> PassFit:
    """Fits one component; all arrays are (n,), in internal units and mm.

    `group` is the pass of each reading (None: passes are not known), `direction` is +1, -1
    or 0 (not given) and constant within a pass. Direction is a fixed effect of the passes'
    coefficients, so that reversal does not enter D. Without an axis, give degree 0.
    """
    X = polynomial(position, degree)
    plain = least_squares(X, y)
    center = float(position.mean())
    if group is None:
        return _single(plain, center)
    ids, codes = np.unique(group, return_inverse=True)
    q = _random_columns(position, codes, len(ids), degree)
    sign = np.zeros(len(ids))
    if direction is not None:
        sign[codes] = direction
    fixed = _direction_columns(sign)
    dof_between = len(ids) - fixed.shape[1]
    if q == 0 or dof_between < 1:
        return _single(plain, center, ids.astype(np.int64), sign)
    Z = polynomial(position - center, q - 1)
    stage = _within(y, Z, X[:, q:] if degree >= q else X[:, :0], codes, len(ids))
    between, deviations, leverage = _between(stage.coefficients, fixed)
    mean_inverse = np.einsum("g,gij->ij", leverage, stage.inverses) / dof_between
    D, split = split_mean_square(between, stage.s2, mean_inverse)
    raw = between - stage.s2 * mean_inverse
    return PassFit(
        plain=plain,
        covariance=_coefficient_covariance(X, Z, codes, len(ids), stage.s2, raw),
        center=center,
        s2=stage.s2,
        D=D,
        D_moment=raw,
        split=split,
        between=between,
        pass_dof=dof_between,
        within_dof=stage.dof,
        within_rss=stage.rss,
        separated=True,
        groups=ids.astype(np.int64),
        group_direction=sign,
        pass_coefficients=stage.coefficients,
        deviations=deviations,
        per_pass_precision=stage.precisions,
    )


def _single(
    plain: LeastSquares,
    center: float,
    ids: IntArray | None = None,
    sign: FloatArray | None = None,
) -> PassFit:
    """One pass, or none known: all scatter counts as repeatability."""
    q = min(2, len(plain.coefficients))
    empty = np.zeros((0, q))
    return PassFit(
        plain=plain,
        covariance=plain.s2 * plain.unscaled_covariance,
        center=center,
        s2=plain.s2,
        D=np.zeros((q, q)),
        D_moment=np.zeros((q, q)),
        split=np.zeros((q, q)),
        between=np.zeros((q, q)),
        pass_dof=0,
        within_dof=plain.dof,
        within_rss=plain.rss,
        separated=False,
        groups=np.zeros(0, np.int64) if ids is None else ids,
        group_direction=np.zeros(0) if sign is None else sign,
        pass_coefficients=empty,
        deviations=empty,
        per_pass_precision=np.zeros((0, q, q)),
    )


def _random_columns(position: FloatArray, codes: IntArray, G: int, degree: int) -> int:
    """Random intercept and slope where every pass has two positions or more, else fewer."""
    pairs = np.unique(np.column_stack([codes.astype(float), position]), axis=0)
    positions_per_pass = np.bincount(pairs[:, 0].astype(np.int64), minlength=G)
    if degree >= 1 and positions_per_pass.min() >= 2:
        return 2
    return 1


def _direction_columns(sign: FloatArray) -> FloatArray:
    """Fixed columns of the passes: 1, and +-1/2 by direction where both were read."""
    ones = np.ones((len(sign), 1))
    both = (sign > 0).any() and (sign < 0).any()
    return np.column_stack([ones, sign / 2]) if both and len(sign) > 2 else ones


@dataclass(frozen=True, slots=True)
class _Within:
    coefficients: FloatArray
    inverses: FloatArray
    precisions: FloatArray
    s2: float
    rss: float
    dof: int


def _within(y: FloatArray, Z: FloatArray, common: FloatArray, codes: IntArray, G: int) -> _Within:
    """Each pass's own coefficients, with the higher powers common to all passes.

    The common columns and y are first freed from every pass's own line (Frisch-Waugh), so
    that nothing larger than the readings is ever formed.
    """
    free = np.column_stack([common, y])
    lines = np.zeros((G, Z.shape[1], free.shape[1]))
    precisions = np.zeros((G, Z.shape[1], Z.shape[1]))
    residual = np.empty_like(free)
    order = np.argsort(codes, kind="stable")
    for g, rows in enumerate(np.split(order, np.searchsorted(codes[order], np.arange(1, G)))):
        lines[g] = np.linalg.lstsq(Z[rows], free[rows], rcond=None)[0]
        residual[rows] = free[rows] - Z[rows] @ lines[g]
        precisions[g] = Z[rows].T @ Z[rows]
    k = common.shape[1]
    gamma = np.zeros(0)
    rest = residual[:, k]
    if k:
        shared = least_squares(residual[:, :k], rest)
        gamma, rest = shared.coefficients, shared.residuals
    rss = float(rest @ rest)
    dof = len(y) - G * Z.shape[1] - k
    return _Within(
        coefficients=lines[:, :, k] - lines[:, :, :k] @ gamma,
        inverses=np.asarray(np.linalg.inv(precisions), dtype=np.float64),
        precisions=precisions,
        # One reading a pass: nothing repeats within it, all scatter is pass-to-pass.
        s2=rss / dof if dof > 0 else 0.0,
        rss=rss if dof > 0 else 0.0,
        dof=max(dof, 0),
    )


def _between(b: FloatArray, fixed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean square (q, q) of the passes' coefficients about their mean by direction."""
    hat = fixed @ np.linalg.pinv(fixed)
    deviations = b - hat @ b
    leverage = 1.0 - np.diag(hat)
    return deviations.T @ deviations / leverage.sum(), deviations, leverage


def _coefficient_covariance(
    X: FloatArray, Z: FloatArray, codes: IntArray, G: int, s2: float, D: FloatArray
) -> FloatArray:
    """Covariance of plain least squares under V = s2 I + Z D Z' by pass.

    (X'X)^-1 X' V X (X'X)^-1; on a balanced design this is the between mean square over G.
    The unclipped D keeps it unbiased; it is clipped only where the result is not a covariance.
    """
    inverse = least_squares(X, X[:, 0]).unscaled_covariance
    cross = np.zeros((G, X.shape[1], Z.shape[1]))
    for column in range(X.shape[1]):
        for other in range(Z.shape[1]):
            cross[:, column, other] = np.bincount(codes, X[:, column] * Z[:, other], G)
    A = inverse @ cross
    scatter = np.einsum("gij,jk,glk->il", A, D, A)
    total = s2 * inverse + scatter
    total = (total + total.T) / 2
    if np.linalg.eigvalsh(_correlation(total)).min() < -1e-9:
        clipped = split_mean_square(D, 0.0, np.eye(len(D)))[0]
        total = s2 * inverse + np.einsum("gij,jk,glk->il", A, clipped, A)
        total = (total + total.T) / 2
    symmetric: FloatArray = total
    return symmetric


def _correlation(S: FloatArray) -> FloatArray:
    scale = np.sqrt(np.abs(np.diag(S)))
    scale[scale == 0] = 1.0
    correlation: FloatArray = S / np.outer(scale, scale)
    return correlation


def split_mean_square(
    S: FloatArray, s2: float, metric: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """D and T with D = T S T' = S - s2 metric, its negative part set to zero.

    S (q, q) is a between-pass mean square, s2 * metric what repeatability alone gives.
    Measured in units of `metric`, S has the eigenvalues l; D keeps max(l - s2, 0) on the same
    eigenvectors, so the result does not depend on the units of slope and intercept.
    T carries the same split to the products of several components' deviations.
    """
    L = np.linalg.cholesky(metric)
    white = np.linalg.solve(L, np.linalg.solve(L, S).T)
    values, vectors = np.linalg.eigh((white + white.T) / 2)
    kept = np.clip(values - s2, 0.0, None)
    share = np.sqrt(np.divide(kept, values, out=np.zeros_like(kept), where=values > 0))
    root = L @ vectors
    whole = (root * kept) @ root.T
    D: FloatArray = (whole + whole.T) / 2
    T: FloatArray = (root * share) @ vectors.T @ np.linalg.inv(L)
    return D, T
