"""How far single entries of a table are off what the others make one expect, by a line of their
part and a mean of their column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mtu_cli.close_loop_sealed.stats.nan_median import nan_median
from mtu_cli.close_loop_sealed.stats.part_slopes import (
    TINY,
    coefficients,
    crossed,
    shrunken,
    slope_variances,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import NORMAL_MAD

BoolArray = NDArray[np.bool_]

RATE = 0.05
"""Chance of the farthest of a table's entries to pass the limit before the margin."""
MARGIN = 1.0
"""Standard deviations beyond that: only what is gross passes."""
FAR = 3.0
"""Standard deviations beyond which an entry has no say in what the others make one expect."""
SWEEPS = 20
EXACT = 1e-9
"""Share of what columns hold that their means may miss."""
AT_FIRST = 8.0
"""Standard deviations of its part and its column beyond which an entry has no say at first."""
SETTLED = 0.01
"""Share of the standard deviation of entries by which the last sweep may change it."""
RESCALED = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLines:
    """Deviations (P, H, A) of entries, nan where missing; their sizes in standard deviations, and
    the limit (A,) of those; and the standard deviation (A,) of single entries.
    """

    deviation: FloatArray
    score: FloatArray
    spread: FloatArray
    limit: FloatArray

    @property
    def gross(self) -> BoolArray:
        """Entries (P, H) beyond the limit, along any axis."""
        return np.asarray((self.score > self.limit).any(axis=2))


def off_lines(errors: FloatArray, slopes: FloatArray, least: FloatArray) -> OffLines:
    """Deviations of `errors` (P, H, A), nan where missing and of a median about 0 in every part
    and column, from a line of every part along `slopes` (P, H, k) and from a mean of every column.

    The slopes of parts are drawn from normal distributions about 0; their best linear prediction
    is (X'X + L)^-1 X'y, X with a column of ones, L the variance of entries over that of each slope
    (Robinson, Statistical Science 6 (1991) 15; `slope_variances`). An entry that had a say in it
    has the variance (1 - h)(1 - (1 - h)/n) of single entries, any other 1 + h + 1/n, with h =
    x'(X'X + L)^-1 x and n the sum of 1 - h over its column: exact where parts are complete and
    alike, and near that elsewhere. Either way the score is that of what the *others* make one
    expect. Entries farther than FAR have no say; the farthest go first, as they pull the others
    of their part and column. Single entries scatter by no less than `least` (A,); along an axis
    in which they do not at all nothing is off.
    """
    X, (_, H, A) = _design(slopes), errors.shape
    there = np.isfinite(errors)
    values, near = np.where(there, errors, 0.0), _near_at_first(errors)
    means = np.zeros((H, A))
    spread = np.maximum(_typical(errors.reshape(-1, A)), least)
    scatters, variances = spread > 0.0, None
    for _ in range(SWEEPS):
        y = np.where(near, values - means, 0.0)
        variances, of_parts = slope_variances(X, y, near, spread, variances)
        inverse = shrunken(crossed(X, near), spread, of_parts)
        means = _means(X, values, near, inverse, means)
        h = np.einsum("phi,phai->pha", X, np.einsum("paij,phj->phai", inverse, X))
        left = _left(X, values - means, near, inverse)
        share, dof = _shares(h, near)
        before = spread
        score, spread, limit = _scored(left, np.where(there, share, 0.0), dof, least)
        now = there & ((score <= FAR) | (near & (score < _farthest(score, near) / 2)))
        if (now == near).all() and (np.abs(spread - before) <= SETTLED * spread).all():
            break
        near = now
    # What had a say to the last is not judged by itself.
    score = np.where(scatters, np.where(near, np.minimum(score, FAR), score), 0.0)
    return OffLines(
        deviation=np.where(there, left, np.nan), score=score, limit=limit, spread=spread
    )


def _design(slopes: FloatArray) -> FloatArray:
    """(P, H, 1 + k): ones, and slopes of order 1."""
    reach = max(float(np.abs(slopes).max(initial=0.0)), 1e-300)
    return np.concatenate([np.ones((*slopes.shape[:2], 1)), slopes / reach], axis=2)


def _near_at_first(errors: FloatArray) -> BoolArray:
    """What is not far off by the scatter of its part and of its column both."""
    P, H, A = errors.shape
    of_parts = _typical(errors.transpose(1, 0, 2).reshape(H, P * A)).reshape(P, 1, A)
    of_columns = _typical(errors.reshape(P, H * A)).reshape(1, H, A)
    whole = _typical(errors.reshape(-1, A))
    limit = AT_FIRST * np.maximum(np.maximum(of_parts, of_columns), whole)
    return np.isfinite(errors) & ~((np.abs(errors) > limit) & (limit > 0.0))


def _left(X: FloatArray, y: FloatArray, near: BoolArray, inverse: FloatArray) -> FloatArray:
    """y (P, H, A) less the lines of what is near."""
    b = coefficients(inverse, X, np.where(near, y, 0.0))
    left: FloatArray = y - np.einsum("phi,pai->pha", X, b)
    return left


def _means(
    X: FloatArray, values: FloatArray, near: BoolArray, inverse: FloatArray, guess: FloatArray
) -> FloatArray:
    """Means (H, A) of columns beside the lines: generalized least squares.

    With M_p what a part's near entries have beside its line, they solve (sum M_p) c = sum M_p y_p,
    as in `lines_and_columns`, but that M_p is no projector and differs by axis: here by the method
    of conjugate gradients, which takes no matrix and few steps, as all but k + 1 of the
    eigenvalues lie together. Means that are not exact to the last digit are as good.
    """
    from scipy.sparse.linalg import LinearOperator, cg

    H, A = guess.shape
    means = guess.copy()
    for a in range(A):
        one, own, part = near[..., a : a + 1], inverse[:, a : a + 1], values[..., a : a + 1]

        def summed(c: FloatArray, one: BoolArray = one, own: FloatArray = own) -> FloatArray:
            y = np.where(one, c.reshape(1, H, 1), 0.0)
            found: FloatArray = np.where(one, _left(X, y, one, own), 0.0).sum(axis=0)[:, 0]
            return found

        wanted = np.where(one, _left(X, part, one, own), 0.0).sum(axis=0)[:, 0]
        operator = LinearOperator((H, H), matvec=summed, dtype=np.float64)
        means[:, a], _ = cg(operator, wanted, x0=guess[:, a], rtol=EXACT, maxiter=4 * H)
    return means


def _farthest(score: FloatArray, near: BoolArray) -> FloatArray:
    """(P, H, A): the larger of the farthest near entries of the part and of the column."""
    own = np.where(near, score, 0.0)
    found: FloatArray = np.maximum(own.max(axis=1, keepdims=True), own.max(axis=0, keepdims=True))
    return found


def _shares(h: FloatArray, near: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Variance of deviations over that of single entries, 0 where nothing is expected; and the
    degrees of freedom (A,) of what is near.
    """
    free = np.where(near, np.maximum(1.0 - h, 0.0), 0.0)
    of_column, has = free.sum(axis=0), near.any(axis=0)
    alone = 1.0 / np.where(of_column > TINY, of_column, np.inf)
    inside = free * (1.0 - free * alone)
    outside = np.where(near.any(axis=1, keepdims=True) & has, 1.0 + h + alone, 0.0)
    dof = free.sum(axis=(0, 1)) - np.maximum(has.sum(axis=0) - 1, 0)
    return np.where(near, np.where(inside > TINY, inside, 0.0), outside), dof


def _scored(
    left: FloatArray, share: FloatArray, dof: FloatArray, least: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Deviations `left` (P, H, A) in standard deviations; that of single entries (A,), no less
    than `least`; and the limit (A,): Student's of `dof` degrees of freedom (A,), and the margin.

    The scale is the median absolute deviation, or the root mean square of what is within the
    limit where that is more: what medians leave has too many small values.
    """
    told = share > 0.0
    size = np.where(told, np.abs(left) / np.sqrt(np.where(told, share, 1.0)), np.nan)
    count = np.maximum(told.sum(axis=(0, 1)), 1)
    limit = MARGIN - stdtrit(np.maximum(dof, 1.0), RATE / (2 * count))
    robust = np.maximum(_typical(size.reshape(-1, size.shape[2])), least)
    spread = robust
    for _ in range(RESCALED):
        rest = told & (np.where(told, size, 0.0) <= limit * spread)
        squares = np.where(rest, size, 0.0) ** 2
        whole = np.sqrt(squares.sum(axis=(0, 1)) / np.maximum(rest.sum(axis=(0, 1)), 1))
        spread = np.where(robust > 0, np.maximum(robust, whole), 0.0)
    score = np.where(told & (spread > 0), size / np.where(spread > 0, spread, 1.0), 0.0)
    return score, spread, limit


def _typical(values: FloatArray) -> FloatArray:
    """Median absolute deviations (n,) from 0 of the columns of (m, n), as standard deviations of
    normal values; 0 of a column that is all nan.
    """
    found: FloatArray = NORMAL_MAD * nan_median(np.abs(values), axis=0)[0]
    return np.nan_to_num(found)
