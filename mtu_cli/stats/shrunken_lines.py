"""How far single entries of a table are off what the others make one expect, by a line of their
part and a mean of their column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mtu_cli.stats.least_squares import FloatArray

BoolArray = NDArray[np.bool_]

RATE = 0.05
"""Chance of the farthest of a table's entries to pass the limit before the margin."""
MARGIN = 1.0
"""Standard deviations beyond that: only what is gross passes."""
NORMAL_MAD = 1.4826
FAR = 3.0
"""Standard deviations beyond which an entry has no say in what the others make one expect."""
SWEEPS = 12
EXACT = 1e-9
"""Share of what columns hold that their means may miss."""
AT_FIRST = 8.0
"""Standard deviations of its part and its column beyond which an entry has no say at first."""
SETTLED = 0.01
"""Share of the standard deviation of entries by which the last sweep may change it."""
RESCALED = 4
CLEAR = 3.0
"""Standard deviations from which on a part has a slope of its own, whichever entry is left out."""
SMALLEST = 1e-9
"""Variance of slopes over that of entries, and the other way round, that is none."""
TINY = 1e-9
"""Share of the largest square of directions, and of an entry's variance, that is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLines:
    """Deviations (P, H, A) of entries, nan where missing; their sizes in standard deviations, and
    the limit (A,) of those; and the standard deviation (A,) of single entries.
    """

    deviation: FloatArray
    score: FloatArray
    spread: FloatArray
    limit: FloatArray


def off_lines(errors: FloatArray, X: FloatArray, *, columns: bool) -> OffLines:
    """Deviations of `errors` (P, H, A), nan where missing and of a median about 0 in every part
    and column, from a line of every part on `X` (P, H, 1 + k), whose first column is of ones, and
    from a mean of every column, if `columns` have any.

    The slopes of parts are drawn from normal distributions about 0; their best linear prediction
    is (X'X + L)^-1 X'y, L the variance of entries over that of each slope (Robinson, Statistical
    Science 6 (1991) 15). An entry that had a say in it has the variance (1 - h)(1 - (1 - h)/n) of
    single entries, any other 1 + h + 1/n, with h = x'(X'X + L)^-1 x and n the sum of 1 - h over
    its column: exact where parts are complete and alike, and near that elsewhere. Either way the
    score is that of what the *others* make one expect. Entries farther than FAR have no say; the
    farthest go first, as they pull the others of their part and column.
    """
    there = np.isfinite(errors)
    values, near = np.where(there, errors, 0.0), _near_at_first(errors)
    means = np.zeros(errors.shape[1:])
    spread = _typical(errors.reshape(-1, errors.shape[2]))
    scatters = spread > 0.0
    for _ in range(SWEEPS):
        of_parts = _slopes(X, np.where(near, values - means, 0.0), near, spread)
        inverse = _inverse(X, near, _ratios(spread, of_parts))[0]
        if columns:
            means = _means(X, values, near, inverse, means)
        h = np.einsum("phi,phai->pha", X, np.einsum("paij,phj->phai", inverse, X))
        left = _left(X, values - means, near, inverse)
        share, dof = _shares(h, near, columns)
        before = spread
        score, spread, limit = _scored(left, np.where(there, share, 0.0), dof)
        now = there & ((score <= FAR) | (near & (score < _farthest(score, near) / 2)))
        if (now == near).all() and (np.abs(spread - before) <= SETTLED * spread).all():
            break
        near = now
    score = np.where(scatters, score, 0.0)
    return OffLines(
        deviation=np.where(there, left, np.nan), score=score, limit=limit, spread=spread
    )


def _near_at_first(errors: FloatArray) -> BoolArray:
    """What is not far off by the scatter of its part and of its column both."""
    P, H, A = errors.shape
    of_parts = _typical(errors.transpose(1, 0, 2).reshape(H, P * A)).reshape(P, 1, A)
    of_columns = _typical(errors.reshape(P, H * A)).reshape(1, H, A)
    whole = _typical(errors.reshape(-1, A))
    limit = AT_FIRST * np.maximum(np.maximum(of_parts, of_columns), whole)
    return np.isfinite(errors) & ~((np.abs(errors) > limit) & (limit > 0.0))


def _ratios(spread: FloatArray, of_parts: FloatArray) -> FloatArray:
    """The diagonal (P, A, 1 + k) of L; 0 for the intercepts, which are the parts' own."""
    L = np.clip(spread[:, None] ** 2 / np.maximum(of_parts, 1e-300), SMALLEST, 1 / SMALLEST)
    return np.concatenate([np.zeros((*L.shape[:2], 1)), L], axis=2)


def _left(X: FloatArray, y: FloatArray, near: BoolArray, inverse: FloatArray) -> FloatArray:
    """y (P, H, A) less the lines of what is near."""
    b = _coefficients(inverse, X, np.where(near, y, 0.0))
    left: FloatArray = y - np.einsum("phi,pai->pha", X, b)
    return left


def _means(
    X: FloatArray, values: FloatArray, near: BoolArray, inverse: FloatArray, guess: FloatArray
) -> FloatArray:
    """Means (H, A) of columns beside the lines: generalized least squares.

    With M_p what a part's near entries have beside its line, they solve (sum M_p) c = sum M_p y_p
    (the method of conjugate gradients, which takes no matrix and few steps: all but k + 1 of the
    eigenvalues lie together).
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


def _shares(h: FloatArray, near: BoolArray, columns: bool) -> tuple[FloatArray, FloatArray]:
    """Variance of deviations over that of single entries, 0 where nothing is expected; and the
    degrees of freedom (A,) of what is near.
    """
    free = np.where(near, np.maximum(1.0 - h, 0.0), 0.0)
    dof, of_column = free.sum(axis=(0, 1)), free.sum(axis=0)
    has = near.any(axis=0)
    if not columns:
        inside, outside = free, 1.0 + h
    else:
        dof = dof - np.maximum(has.sum(axis=0) - 1, 0)
        alone = 1.0 / np.where(of_column > TINY, of_column, np.inf)
        inside, outside = free * (1.0 - free * alone), 1.0 + h + alone
    told = near.any(axis=1, keepdims=True) & has
    inside = np.where(inside > TINY, inside, 0.0)
    return np.where(near, inside, np.where(told, outside, 0.0)), dof


def _scored(
    left: FloatArray, share: FloatArray, dof: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Deviations `left` (P, H, A) in standard deviations; that of single entries (A,); and the
    limit (A,): Student's of `dof` degrees of freedom (A,), and the margin.

    The scale is the median absolute deviation, or the root mean square of what is within the
    limit where that is more: what medians leave has too many small values.
    """
    told = share > 0.0
    size = np.where(told, np.abs(left) / np.sqrt(np.where(told, share, 1.0)), np.nan)
    count = np.maximum(told.sum(axis=(0, 1)), 1)
    limit = MARGIN - stdtrit(np.maximum(dof, 1.0), RATE / (2 * count))
    robust = _typical(size.reshape(-1, size.shape[2]))
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
    return NORMAL_MAD * _median(np.abs(values))


def _median(flat: FloatArray) -> FloatArray:
    """Medians (n,) of what is not nan in (m, n); 0 where all is."""
    flat = np.sort(flat, axis=0)
    n = (~np.isnan(flat)).sum(axis=0)
    low, high = np.maximum(n - 1, 0) // 2, np.minimum(n // 2, len(flat) - 1)
    found: FloatArray = np.take_along_axis(flat, np.stack([low, high]), axis=0).mean(axis=0)
    return np.nan_to_num(found)


def _slopes(X: FloatArray, y: FloatArray, near: BoolArray, spread: FloatArray) -> FloatArray:
    """Variances (P, A, k) by which the slopes of parts are shrunken.

    That of all parts is the weighted mean square of their least squares slopes less what single
    entries make of it, without slopes beyond the limit of so many, as for entries. A part that has
    a clear slope of its own, whichever of its entries is left out, is shrunken to that.
    """
    if X.shape[2] == 1:
        return np.zeros((y.shape[0], y.shape[2], 0))
    noise = spread[:, None] ** 2
    b, chance, told, alone, alone_chance = _least_squares(X, y, near)
    chance, alone_chance = chance * noise, alone_chance * np.maximum(noise, 1e-300)
    squares, told = b**2, told[..., None]
    count = np.maximum(told.sum(axis=0), 1)
    limit = MARGIN - stdtrit(count.astype(float), RATE / (2 * count))
    robust = NORMAL_MAD**2 * _of_parts(squares, told) - _of_parts(chance, told)
    found = np.maximum(robust, 0.0)
    for _ in range(RESCALED):
        whole = chance + found
        rest = told & (squares <= limit**2 * whole) & (whole > 0.0)
        weight = np.where(rest, np.where(whole > 0.0, whole, 1.0) ** -2, 0.0)
        total = np.maximum(weight.sum(axis=0), 1e-300)
        found = np.maximum((weight * (squares - chance)).sum(axis=0) / total, 0.0)
    clear = alone**2 > CLEAR**2 * alone_chance
    least = np.where(clear, alone**2 - alone_chance, 0.0)
    least = np.where(near[..., None], least, np.inf).min(axis=1)
    return np.maximum(found, np.where(told, least, 0.0))


def _of_parts(values: FloatArray, told: BoolArray) -> FloatArray:
    """Medians (A, k) of values (P, A, k) over the parts that tell."""
    P, A, k = values.shape
    return _median(np.where(told, values, np.nan).reshape(P, A * k)).reshape(A, k)


def _inverse(
    X: FloatArray, near: BoolArray, L: FloatArray | None = None
) -> tuple[FloatArray, BoolArray]:
    """(X'X + L)^-1 (P, A, i, i) of what is near, and where all its directions are told."""
    whole = np.einsum("phi,pha,phj->paij", X, near.astype(float), X)
    if L is not None:
        whole = whole + L[..., None] * np.eye(X.shape[2])
    square, turn = np.linalg.eigh(whole)
    # L alone makes directions differ by any size, and tells all of them.
    least = TINY if L is None else 1e-15
    kept = square > least * np.maximum(square[..., -1:], 1e-300)
    scaled = turn * np.where(kept, 1.0 / np.where(kept, square, 1.0), 0.0)[..., None, :]
    return np.einsum("pain,pajn->paij", scaled, turn), kept.all(axis=2)


def _coefficients(inverse: FloatArray, X: FloatArray, y: FloatArray) -> FloatArray:
    """(P, A, i): inverse X'y."""
    found: FloatArray = np.einsum("paij,paj->pai", inverse, np.einsum("phj,pha->paj", X, y))
    return found


def _least_squares(
    X: FloatArray, y: FloatArray, near: BoolArray
) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray, FloatArray]:
    """Slopes (P, A, k) of parts and their variances by entries of variance 1; which parts
    (P, A) tell all of them with entries to spare; and the same slopes and variances
    (P, H, A, k) without each of the entries.
    """
    inverse, told = _inverse(X, near)
    b = _coefficients(inverse, X, y)
    told = told & (near.sum(axis=1) > X.shape[2] + 1)
    chance = np.einsum("paii->pai", inverse)
    pull = np.einsum("paij,phj->phai", inverse, X)
    left = np.where(near, y - np.einsum("phi,pai->pha", X, b), 0.0)
    free = 1.0 - np.where(near, np.einsum("phi,phai->pha", X, pull), 0.0)
    free = np.where(free > TINY, free, np.inf)[..., None]
    alone = b[:, None] - pull * left[..., None] / free
    alone_chance = np.where(np.isfinite(free), chance[:, None] + pull**2 / free, np.inf)
    return b[..., 1:], chance[..., 1:], told, alone[..., 1:], alone_chance[..., 1:]
