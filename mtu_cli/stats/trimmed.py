"""Least trimmed squares: the line of the many, whatever a few readings are, alone or in a row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import BoolArray, IntArray, display_u, gross_limit, spread

TRIMMED = 0.25
"""Share of the degrees of freedom that readings may be taken from as gross."""
FEWEST_IN = 1500
"""Rows, more for many columns, that the starts are compared on: more are thinned to these."""
WINDOWS = 8
STEPS, KEPT_STARTS, LAST_STEPS = 3, 3, 20
REWEIGHTED = 10
DEPENDENT = 1e-10
"""Share of the largest eigenvalue of X'X, its columns of unit length, that is rounding."""
DETERMINED = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Trimmed:
    """`expected` (n,) of all rows by the clean ones, all but `out`; `dof` of which their standard
    deviation `spread` is known; `distance` (n,) of each reading, in those of a new reading.
    """

    expected: FloatArray
    spread: float
    dof: int
    distance: FloatArray
    out: int

    @property
    def limit(self) -> float:
        """The distance from which on a reading is gross."""
        return gross_limit(len(self.expected), self.dof, self.out)


def trimmed_fit(X: FloatArray, y: FloatArray, orders: Sequence[IntArray] = ()) -> Trimmed:
    """The fit of y (n,) on X (n, k) to those readings that are not gross.

    It begins with least trimmed squares, min sum of the h smallest r_i^2, by concentration steps
    (Rousseeuw & Van Driessen, Data Min. Knowl. Disc. 12 (2006) 29), from starts that are
    no random ones: all rows, least absolute deviations, and all but a window of rows that follow
    each other in the order given or one of `orders` (n,), as slips often do. From there
    readings within the limit come in and those beyond it go out until none does, each judged by
    its residual over that of a prediction from the clean ones, s sqrt(1 + x'(X'X)^-1 x) (Hadi &
    Simonoff, J. Am. Stat. Assoc. 88 (1993) 1264). A row whose value the clean ones do
    not determine is not judged.
    """
    Q = _orthonormal(X)
    n, k = Q.shape
    every = (np.arange(n), *orders)
    step = max(1, n // max(FEWEST_IN, 20 * k))
    thin = np.arange(0, n, step)
    ranks = [_rank(np.argsort(order, kind="stable")[thin]) for order in every]
    b = _best(Q[thin], y[thin], ranks)
    for _ in range(2):
        b = _concentrated(Q, y, b[None], 1)[0]
    left = y - Q @ b
    least = display_u(y)
    s = max(spread(left, k), least)
    found = _at(y, left, s, (max(n - k, 1), 0), np.ones(n))
    kept = found.distance <= found.limit
    for _ in range(LAST_STEPS):
        found = _refitted(Q, y, kept, least)
        now = found.distance <= found.limit
        if (now == kept).all() or now.sum() <= k:
            break
        kept = now
    return found


def _refitted(Q: FloatArray, y: FloatArray, kept: BoolArray, least: float) -> Trimmed:
    """Least squares on the rows `kept` (n,), and all rows against it; `least` of a deviation."""
    own = Q[kept]
    inverse = np.linalg.pinv(own.T @ own, rcond=DEPENDENT, hermitian=True)
    left = y - Q @ (inverse @ (own.T @ y[kept]))
    rank = int(np.linalg.matrix_rank(inverse, hermitian=True))
    dof = max(int(kept.sum()) - rank, 1)
    s = max(float(np.sqrt(left[kept] @ left[kept] / dof)), least)
    out = np.flatnonzero(~kept)
    new = np.ones(len(y))
    new[out] = np.sqrt(1 + np.einsum("ij,jk,ik->i", Q[out], inverse, Q[out]))
    missed = Q[out] - Q[out] @ inverse @ (own.T @ own)
    new[out[(missed**2).sum(axis=1) > DETERMINED * (Q[out] ** 2).sum(axis=1)]] = np.inf
    return _at(y, left, s, (dof, len(out)), new)


def _at(
    y: FloatArray, left: FloatArray, s: float, known: tuple[int, int], new: FloatArray
) -> Trimmed:
    distance = np.abs(left) / (s * new) if s > 0 else np.zeros(len(y))
    return Trimmed(expected=y - left, spread=s, dof=known[0], out=known[1], distance=distance)


def _orthonormal(X: FloatArray) -> FloatArray:
    """Columns (n, rank) that span those of X."""
    length = np.linalg.norm(X, axis=0)
    scaled = X / np.where(length > 0, length, 1.0)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    sound = values > DEPENDENT * values[-1]
    found: FloatArray = scaled @ (vectors[:, sound] / np.sqrt(values[sound]))
    return found


def _best(Q: FloatArray, y: FloatArray, ranks: Sequence[IntArray]) -> FloatArray:
    """Coefficients (k,) of the least trimmed squares that the starts lead to."""
    masks = np.array(list(_windows(len(y), ranks)), float)
    starts = np.vstack([_solved(Q, y, masks), _least_absolute(Q, y)])
    b = _concentrated(Q, y, starts, STEPS)
    best = np.argsort(_objective(Q, y, b), kind="stable")[:KEPT_STARTS]
    b = _concentrated(Q, y, b[best], LAST_STEPS)
    found: FloatArray = b[int(np.argmin(_objective(Q, y, b)))]
    return found


def _rank(values: IntArray) -> IntArray:
    """How many of the values are smaller than each of them, (n,)."""
    found = np.empty(len(values), np.int64)
    found[np.argsort(values, kind="stable")] = np.arange(len(values))
    return found


def _windows(n: int, ranks: Sequence[IntArray]) -> Iterator[BoolArray]:
    """All rows, and all but those in each of the windows, that overlap by half."""
    yield np.ones(n, bool)
    for rank in ranks:
        for first in np.linspace(0, (1 - TRIMMED) * n, WINDOWS):
            yield (rank < first) | (rank >= first + TRIMMED * n)


def _solved(Q: FloatArray, y: FloatArray, weights: FloatArray) -> FloatArray:
    """Weighted fits (m, k), `weights` (m, n)."""
    G = np.matmul(weights[:, None, :] * Q.T, Q)
    inverse = np.linalg.pinv(G, rcond=DEPENDENT, hermitian=True)
    found: FloatArray = np.einsum("mij,mj->mi", inverse, (weights * y) @ Q)
    return found


def _least_absolute(Q: FloatArray, y: FloatArray) -> FloatArray:
    """Least absolute deviations (1, k), by weights 1/|r|."""
    weights = np.ones((1, len(y)))
    for _ in range(REWEIGHTED):
        b = _solved(Q, y, weights)
        left = np.abs(y - Q @ b[0])
        # Weights of what is hit exactly would be infinite.
        least = max(1e-3 * float(np.median(left)), np.finfo(np.float64).tiny)
        weights = 1 / np.maximum(left, least)[None] * least
    return b


def _concentrated(Q: FloatArray, y: FloatArray, b: FloatArray, steps: int) -> FloatArray:
    """Fits (m, k) to the h rows nearest to each fit `b` (m, k), again and again."""
    h = _covered(Q)
    for _ in range(steps):
        away = np.abs(y - b @ Q.T)
        near = away <= np.partition(away, h - 1, axis=1)[:, h - 1 : h]
        now = _solved(Q, y, near.astype(float))
        if np.array_equal(now, b):
            break
        b = now
    return b


def _objective(Q: FloatArray, y: FloatArray, b: FloatArray) -> FloatArray:
    h = _covered(Q)
    squares = np.partition((y - b @ Q.T) ** 2, h - 1, axis=1)[:, :h]
    found: FloatArray = squares.sum(axis=1)
    return found


def _covered(Q: FloatArray) -> int:
    """h: those that are not trimmed."""
    rows, columns = len(Q), Q[:1].size
    return rows - int(TRIMMED * max(rows - columns, 0))
