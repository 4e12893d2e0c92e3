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
from mtu_cli.stats.pass_lines import between_passes, own_lines

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FEW_PASSES = 3
"""Below so many degrees of freedom between passes D is never taken as negative."""
OWN_SLOPE_SPAN = 0.3
"""A pass over less than this share of the measured range has no slope of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassFit:
    """The mixed model of one component; q = 2 random columns with an axis, 1 without.

    `plain` is the ordinary least-squares fit of all readings as repeats (Gilsinn & Ling 2004,
    eqs. (5)-(11)). `covariance` (k, k) is that of its coefficients under the mixed model, D
    (q, q) the pass-to-pass covariance at `center`, `s2` the repeatability variance, `split`
    (q, q) the T of `split_mean_square`. `D_moment` is D before its negative part is set to
    zero, the unbiased moment estimate. `between` (q, q) is the mean square of the passes' own
    coefficients with `pass_dof` degrees of freedom, `within_dof` belongs to `s2`.
    `pass_coefficients` (G, q) are the passes' own intercepts (at the centre) and slopes,
    `deviations` (G, q) the same less their mean by direction. `separated` is False where the
    data cannot tell D from s2.
    `pooled_rss` with `pooled_dof` is the residual sum of squares of one line a direction.
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
    pooled_rss: float
    pooled_dof: int

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
    or 0 (not given) and constant within a pass. With three passes or more direction is a
    fixed effect of their coefficients, so that reversal does not enter D. Without an axis,
    give degree 0. Where the passes differ in what no pass determines by itself (single
    readings along an axis), D is not separated.
    """
    X = polynomial(position, degree)
    plain = least_squares(X, y)
    center = float(position.mean())
    if group is None:
        return _single(plain, center)
    ids, codes = np.unique(group, return_inverse=True)
    q, whole = _random_columns(position, codes, len(ids), degree)
    Z = polynomial(position - center, q - 1)
    # Passes that broke off early have no slope of their own: they count in the coefficients
    # and their covariance, but say nothing of how slopes scatter.
    rows = whole[codes]
    kept = (np.cumsum(whole) - 1)[codes[rows]]
    ids = ids[whole]
    sign = np.zeros(len(ids))
    if direction is not None:
        sign[kept] = direction[rows]
    fixed = _direction_columns(sign)
    dof_between = len(ids) - fixed.shape[1]
    if dof_between < 1:
        return _single(plain, center, ids.astype(np.int64), sign)
    stage = own_lines(y[rows], Z[rows], X[rows, q:], kept, len(ids))
    found = between_passes(stage, fixed)
    if found is None:
        return _single(plain, center, ids.astype(np.int64), sign)
    between, of_repeatability, deviations = found
    D, split = split_mean_square(between, stage.s2, of_repeatability)
    raw = between - stage.s2 * of_repeatability
    if dof_between < FEW_PASSES:
        # Two or three passes may agree by chance far better than repeatability allows; the
        # coefficients are then no surer than repeatability alone would leave them.
        raw = D
    common = [Z[rows] * f[kept, None] for f in fixed.T]
    pooled = least_squares(np.column_stack([*common, X[rows, q:]]), y[rows])
    return PassFit(
        plain=plain,
        covariance=_coefficient_covariance(plain, X, Z, codes, stage.s2, (raw, D)),
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
        pooled_rss=pooled.rss,
        pooled_dof=pooled.dof,
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
        pooled_rss=plain.rss,
        pooled_dof=plain.dof,
    )


def _random_columns(
    position: FloatArray, codes: IntArray, G: int, degree: int
) -> tuple[int, NDArray[np.bool_]]:
    """Random columns q, and which passes (G,) can tell of them.

    Intercept and slope where most passes, three or more, span enough of the range.
    """
    low, high = np.full(G, np.inf), np.full(G, -np.inf)
    np.minimum.at(low, codes, position)
    np.maximum.at(high, codes, position)
    spans = high - low > OWN_SLOPE_SPAN * float(np.ptp(position))
    if degree >= 1 and (spans.all() or (spans.sum() >= 3 and spans.mean() > 0.5)):
        return 2, spans
    return 1, np.ones(G, bool)


def _direction_columns(sign: FloatArray) -> FloatArray:
    """Fixed columns of the passes: 1, and +-1/2 by direction where both were read."""
    ones = np.ones((len(sign), 1))
    both = (sign > 0).any() and (sign < 0).any()
    return np.column_stack([ones, sign / 2]) if both and len(sign) > 2 else ones


def _coefficient_covariance(
    plain: LeastSquares,
    X: FloatArray,
    Z: FloatArray,
    codes: IntArray,
    s2: float,
    choices: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Covariance of plain least squares under V = s2 I + Z D Z' by pass.

    (X'X)^-1 X' V X (X'X)^-1; on a balanced design this is the between mean square over G.
    The first choice, the unclipped D, keeps it unbiased; the second, the clipped one, stands
    in only where the result is not a covariance.
    """
    inverse = plain.unscaled_covariance
    cross = np.zeros((int(codes.max()) + 1, X.shape[1], Z.shape[1]))
    for column in range(X.shape[1]):
        for other in range(Z.shape[1]):
            cross[:, column, other] = np.bincount(codes, X[:, column] * Z[:, other])
    A = inverse @ cross
    for D in choices:
        total: FloatArray = s2 * inverse + np.einsum("gij,jk,glk->il", A, D, A)
        total = (total + total.T) / 2
        if np.linalg.eigvalsh(_correlation(total)).min() >= -1e-9:
            break
    return total


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
