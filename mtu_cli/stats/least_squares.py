"""The one least-squares routine: singular values with column scaling, rank and null space; and
regression on very many rows through small matrices that hold all that it needs of them: how the
residuals follow each other, ridge paths, forward-backward selection.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

RANK_TOLERANCE = 1e-10
"""Relative size of a singular value of the column-scaled design below which it counts as 0."""
REFINEMENTS = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastSquares:
    """An ordinary least-squares fit y = X b + r with n rows and k columns.

    `coefficients` (k,), `unscaled_covariance` (k, k) = (X'X)^-1, `residuals` (n,),
    `rss` the residual sum of squares, `dof` = n - rank, `rank`, `null_space` (k, k - rank):
    directions of b that the rows do not determine.
    """

    coefficients: FloatArray
    unscaled_covariance: FloatArray
    residuals: FloatArray
    rss: float
    dof: int
    rank: int
    null_space: FloatArray

    @property
    def s2(self) -> float:
        """Residual variance rss/(n - rank), eq. (11) of Gilsinn & Ling 2004; nan without dof."""
        return self.rss / self.dof if self.dof > 0 else float("nan")


def least_squares(X: FloatArray, y: FloatArray) -> LeastSquares:
    """Minimises |y - X b|^2; X is (n, k), y is (n,).

    b = (X'X)^-1 X'y (Gilsinn & Ling 2004, eq. (6)), computed from the singular value
    decomposition of X with its columns scaled to unit length, so that columns of very
    different units (1, mm, mm^2) do not cost digits. Where X is rank deficient the
    minimum-norm solution (in the scaled columns) is returned and `null_space` spans what is
    free. Iterative refinement brings residuals and coefficients to working accuracy.
    """
    scale = np.linalg.norm(X, axis=0)
    scale[scale == 0] = 1.0
    U, singular, Vt = np.linalg.svd(X / scale, full_matrices=X.shape[0] < X.shape[1])
    k = X.shape[1]
    largest = singular[0] if singular.size else 0.0
    rank = int(np.sum(singular > RANK_TOLERANCE * largest)) if largest > 0 else 0
    U, V = U[:, :rank], Vt[:rank].T / singular[:rank]
    # Of S = U V^-T, r + S b = y and S'r = 0 are refined together (Bjorck 1967, BIT 7, 257-278):
    # where residuals are large the first alone leaves the error of the second in b. Their defects
    # are formed in extended precision where the platform has it.
    S, target = X.astype(np.longdouble) / scale, y.astype(np.longdouble)
    b = (V @ (U.T @ y)).astype(np.longdouble)
    r = target - S @ b
    for _ in range(REFINEMENTS):
        f = (target - r - S @ b).astype(np.float64)
        g = (S.T @ r).astype(np.float64)
        step = V @ (U.T @ f + V.T @ g)
        b, r = b + step, r + f - S @ step
    residuals = (target - S @ b).astype(np.float64)
    return LeastSquares(
        coefficients=(b / scale).astype(np.float64),
        unscaled_covariance=V @ V.T / np.outer(scale, scale),
        residuals=residuals,
        rss=float(residuals @ residuals),
        dof=X.shape[0] - rank,
        rank=rank,
        null_space=Vt[rank:k].T / scale[:, None],
    )


def batched_least_squares(X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Minimises |y - X b|^2 of m small problems at once; X is (k, n, m), y is (n, m), k <= n.

    Returns b (k, m) and the sum of squares (m,) that X explains, |y|^2 - |y - X b|^2, by modified
    Gram-Schmidt of X with y beside it, which loses no more digits than Householder's (Bjorck 1967,
    BIT 7, 1-21): the condition of X is not squared. Where a problem does not determine its b (to
    `RANK_TOLERANCE` of a column's length) both are nan.
    """
    k, _, m = X.shape
    least = RANK_TOLERANCE * np.linalg.norm(X, axis=1)
    Q, rest = X.copy(), y.copy()
    R, z, b = np.zeros((k, k, m)), np.empty((k, m)), np.empty((k, m))
    for j in range(k):
        norm = np.linalg.norm(Q[j], axis=0)
        R[j, j] = np.where(norm > least[j], norm, np.nan)
        Q[j] /= R[j, j]
        for c in range(j + 1, k):
            R[j, c] = np.einsum("nm,nm->m", Q[j], Q[c])
            Q[c] -= R[j, c] * Q[j]
        z[j] = np.einsum("nm,nm->m", Q[j], rest)
        rest -= z[j] * Q[j]
    for j in reversed(range(k)):
        b[j] = (z[j] - np.einsum("cm,cm->m", R[j, j + 1 :], b[j + 1 :])) / R[j, j]
    return b, np.einsum("km,km->m", z, z)


def quotient(numerator: FloatArray, denominator: FloatArray, empty: float = np.nan) -> FloatArray:
    """numerator/denominator, `empty` where the denominator is not above 0."""
    result = np.full_like(numerator, empty)
    return np.divide(numerator, denominator, out=result, where=denominator > 0)


def polynomial(position: FloatArray, degree: int) -> FloatArray:
    """Design rows [1, p, ..., p^degree], shape (n, degree + 1)."""
    return np.vander(position, degree + 1, increasing=True)


def triangle(Z: FloatArray) -> FloatArray:
    """R (min(n, k), k) upper triangular with R'R = Z'Z, Z (n, k)."""
    return np.asarray(np.linalg.qr(Z, mode="r"))


ENTER = 0.05
REMOVE = 0.10
_ROUNDING = 1e-24
"""Share of the squares that cancel in residuals below which these are rounding alone."""
_NOTHING_LEFT = 1e-12
"""Share of a column, or of the sum of squares, below which only rounding is left."""


@dataclass(frozen=True, slots=True)
class Compressed:
    """n rows Z of k columns, the first of them the constant, in the order in which they were read.

    `factor` (r, k), r <= k, with factor'factor = Z'Z: a triangular factor by orthogonal
    rotations, so that conditioning is that of Z and not its square (Golub & Van Loan, Matrix
    Computations, 5.2). `lag` (k, k) = sum z_i z_(i+1)' over `pairs` consecutive rows, by which
    any residual's autocorrelation follows. `freed`: of how many pieces the mean was taken out.
    """

    factor: FloatArray
    n: int
    lag: FloatArray
    pairs: int
    freed: int = 0

    @property
    def levels(self) -> int:
        """Levels that a fit takes of the rows: one, or that of every piece freed of its mean."""
        return max(self.freed, 1)

    def mean(self, columns: Sequence[int]) -> FloatArray:
        """Means (l,) of some columns."""
        return np.asarray(self.factor[0, columns] / self.factor[0, 0])

    def inner(self, columns: Sequence[int]) -> FloatArray:
        """The factor (r - 1, l) of some columns about their means; 0 where only rounding is."""
        chosen = self.factor[:, columns]
        live = np.linalg.norm(chosen[1:], axis=0) > RANK_TOLERANCE * np.linalg.norm(chosen, axis=0)
        return np.where(live, chosen[1:], 0.0)

    def only(self, columns: Sequence[int]) -> Compressed:
        """Some of the columns."""
        lag = self.lag[np.ix_(columns, columns)]
        return replace(self, factor=self.factor[:, columns], lag=lag)

    def about_mean(self) -> Compressed:
        """All columns but the constant less their means."""
        T = np.eye(self.factor.shape[1])
        T[0, 1:] = -self.factor[0, 1:] / self.factor[0, 0]
        return replace(self, factor=self.factor @ T, lag=T.T @ self.lag @ T, freed=1)


def compress(Z: FloatArray) -> Compressed:
    """Rows Z (n, k) compressed; n may be any number above 0."""
    return Compressed(triangle(Z), len(Z), Z[:-1].T @ Z[1:], len(Z) - 1)


def together(items: Sequence[Compressed]) -> Compressed:
    """All rows of several pieces; no pair of consecutive rows spans two of them."""
    return Compressed(
        factor=triangle(np.vstack([item.factor for item in items])),
        n=sum(item.n for item in items),
        lag=np.sum([item.lag for item in items], axis=0),
        pairs=sum(item.pairs for item in items),
        freed=sum(item.freed for item in items),
    )


def mean_products(pieces: Iterable[tuple[Compressed, FloatArray]]) -> tuple[float, float]:
    """Mean e_i^2 and mean e_i e_(i+1) of the residuals e = Z w of several pieces (Z, w (k,)).

    No product spans two pieces; (0, 0) where the residuals are rounding alone.
    """
    square = product = cancelled = 0.0
    n = pairs = 0
    for rows, weights in pieces:
        square += float(np.sum((rows.factor @ weights) ** 2))
        cancelled += float(np.sum((rows.factor * weights) ** 2))
        product += float(weights @ rows.lag @ weights)
        n, pairs = n + rows.n, pairs + rows.pairs
    if square <= _ROUNDING * cancelled:
        return 0.0, 0.0
    return square / n, product / pairs if pairs else 0.0


def autocorrelation(pieces: Iterable[tuple[Compressed, FloatArray]]) -> float:
    """Lag-1 autocorrelation of the residuals of several pieces; 0 where there is none to tell."""
    square, product = mean_products(pieces)
    return product / square if square > 0 else 0.0


def effective_number(n: int, autocorrelation: float) -> float:
    """n (1 - r)/(1 + r), between 1 and n: a negative autocorrelation gives no credit.

    Bayley & Hammersley 1946, J. R. Stat. Soc. Suppl. 8, 184-197.
    """
    r = min(max(autocorrelation, 0.0), 1.0)
    return max(n * (1 - r) / (1 + r), 1.0)


class RidgePath(NamedTuple):
    """b (l, k) along a path of l penalties; `effective` (l,) is the trace of the hat matrix,
    `unit_covariance` (k, k) = (X'X + P)^-1 X'X (X'X + P)^-1 that of the first b for errors of
    variance 1, given P.
    """

    coefficients: FloatArray
    effective: FloatArray
    unit_covariance: FloatArray


def ridge(X: FloatArray, y: FloatArray, n: int, penalties: FloatArray) -> RidgePath:
    """Minimises |y - X b|^2 / n + penalty * sum (s_j b_j)^2 for each of the penalties.

    X (r, k) and y (r,) are about their means; s_j is the standard deviation of column j, so that
    units do not matter. The r rows may be the compressed ones of n readings. Hoerl & Kennard 1970,
    Technometrics 12, 55-67, by singular values. Penalty 0 is ordinary least squares, of least norm
    where columns depend on each other; a column of zeros gets 0.
    """
    scale = np.linalg.norm(X, axis=0) / np.sqrt(n)
    divisor = np.where(scale > 0, scale, np.inf)
    U, singular, Vt = np.linalg.svd(X / divisor, full_matrices=False)
    nonzero = singular > RANK_TOLERANCE * singular.max(initial=0.0)
    singular, directions = singular[nonzero], Vt[nonzero].T / divisor[:, None]
    gains = singular / (singular**2 + n * np.asarray(penalties, float)[:, None])
    b = (gains * (U[:, nonzero].T @ y)) @ directions.T
    root = directions * gains[0]
    return RidgePath(b, (gains * singular).sum(axis=1), root @ root.T)


def stepwise(rows: Compressed, enter: float = ENTER, remove: float = REMOVE) -> tuple[int, ...]:
    """The chosen of the columns 1 ... k-2; column 0 is the constant, the last one the target.

    Forward-backward selection by the partial F of each column (Draper & Smith, Applied
    Regression Analysis, 1998, ch. 15): the best one enters at p < `enter`, any whose p rises
    above `remove` leaves again. Residuals of one warm-up follow each other, so that n counts
    with the effective number of independent ones (`effective_number`), by the autocorrelation of
    the residuals on all columns: those on few columns hold the drift itself and would let nothing
    enter.
    """
    # Steps cost less by a factor of no more rows than columns.
    Z = triangle(rows.factor) if len(rows.factor) > rows.factor.shape[1] else rows.factor
    everything = least_squares(Z[:, :-1], Z[:, -1]).coefficients
    residuals = replace(rows, factor=Z), np.append(-everything, 1.0)
    number = effective_number(rows.n, autocorrelation([residuals]))
    least = _NOTHING_LEFT * float(Z[:, -1] @ Z[:, -1])

    def p(count: int, gain: float, before: float) -> float:
        """Of the F by which one of `count` columns lowers the sum of squares `before`."""
        dof, rss = number - count - 1, before - gain
        if dof <= 0 or before <= least:
            return 1.0
        return float(fdtrc(1, dof, gain / rss * dof)) if rss > _NOTHING_LEFT * before else 0.0

    chosen: list[int] = []
    history = set[frozenset[int]]()
    # A set of columns that was there before would come back for ever.
    while frozenset(chosen) not in history:
        history.add(frozenset(chosen))
        candidates = [j for j in range(1, Z.shape[1] - 1) if j not in chosen]
        # R of constant, chosen, candidates, target: residuals on the chosen stand below them.
        R, k = triangle(Z[:, [0, *chosen, *candidates, -1]]), len(chosen) + 1
        rest, residual = R[k:, k:-1], R[k:, -1]
        # What each candidate takes off the residual sum of squares of the chosen.
        squares = np.sum(rest**2, axis=0)
        usable = squares > _NOTHING_LEFT * np.sum(R[:, k:-1] ** 2, axis=0)
        gains = np.where(usable, (rest.T @ residual) ** 2 / np.where(usable, squares, 1.0), 0.0)
        if not candidates or p(k, float(gains.max()), float(residual @ residual)) >= enter:
            break
        chosen.append(candidates[int(np.argmax(gains))])
        while len(chosen) > 1:
            fit = least_squares(Z[:, [0, *chosen]], Z[:, -1])
            loss = fit.coefficients[1:] ** 2 / np.diag(fit.unscaled_covariance)[1:]
            weakest = float(loss.min())
            if p(len(chosen), weakest, fit.rss + weakest) <= remove:
                break
            del chosen[int(np.argmin(loss))]
    return tuple(sorted(chosen))


def submodel_average(
    values: FloatArray, covariance: FloatArray, optional: Sequence[int], n: int
) -> FloatArray:
    """Estimates (k,), of variances above 0, averaged over the models in which any of `optional` are
    0 and the others re-estimated. m zeros have the odds (1 + n)^(m/2) exp(-q n / (2 (1 + n))),
    q = b' C^-1 b: a prior with the information of one of n units (Kass & Wasserman 1995).
    """
    u = np.sqrt(np.diag(covariance))
    t, r = values / u, covariance / np.outer(u, u)
    logs, means = list[float](), list[FloatArray]()
    for count in range(len(optional) + 1):
        for zero in map(list, combinations(optional, count)):
            inverse = np.linalg.pinv(r[np.ix_(zero, zero)], rcond=RANK_TOLERANCE, hermitian=True)
            shift = inverse @ t[zero]
            logs.append(0.5 * (count * np.log1p(n) - t[zero] @ shift * n / (1 + n)))
            means.append(t - r[:, zero] @ shift)
    weights = np.exp(np.array(logs) - max(logs))
    return u * (weights @ np.array(means)) / weights.sum()
