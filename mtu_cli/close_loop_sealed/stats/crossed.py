"""Incomplete two-way tables completed by their least-squares fit of rows and columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

Freeing = Callable[[FloatArray], FloatArray]
"""Takes the freedoms of the part's coordinate system out of tables (..., P, H, A)."""
ALMOST_ZERO = 1e-10
SAME = 1e-8
"""Effects of unit norm that differ by less are the same but for rounding."""
CACHED = 1 << 16
"""Numbers that are worked on at once."""
FARTHEST = 1.0
"""Variance, over that of an entry, up to which a row's own lines tell its missing entries: they
are no worse known then than if they had been read.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """Fills the missing entries of tables (..., P, H, A) of rows and columns.

    `observed` (P, H) tells which entries there are. An entry that is missing is given the
    least-squares row effect, with the row's lines along the `smooth` directions where those are
    told, plus column effect of those that are there: linear in them, and, of a `connected` table,
    exact where it is such a function of the row plus one of the column. The lines of rows have
    the mean 0, so that rows of which they are not told do not settle the columns' own. Effects
    that the entries do not tell are those of minimum norm.

    Rows are eliminated: with N_p (m, m) the normal matrix of a row's effects, B_p (m, H + k) its
    cross products with the columns and the k multipliers of that condition, and S the Schur
    complement of these, c = S^+ r and a_p = N_p^+ (s_p - B_p c) for sums s_p and r. `solved`
    (P, m, H + k) is N_p^+ B_p, `rows` (P, m, m) N_p^+, `columns` (H + k, H + k) S^+; `free`
    (H + k, q) spans the null space of S and `lean` (q, P, m) gives the part along it for which
    the effects have minimum norm.
    """

    observed: NDArray[np.bool_]
    smooth: FloatArray
    rows: FloatArray
    solved: FloatArray
    columns: FloatArray
    free: FloatArray
    lean: FloatArray
    connected: bool

    @property
    def complete(self) -> bool:
        """Whether no entry is missing."""
        return bool(self.observed.all())

    def fill(self, tables: FloatArray) -> FloatArray:
        """The completed tables (..., P, H, A); what stood in missing entries is ignored."""
        if self.complete:
            return tables
        missing = ~self.observed[:, :, None]
        found = np.array(tables, float).reshape(-1, *tables.shape[-3:])
        # In pieces that stay in the cache: the fit passes over them several times.
        step = max(CACHED // found[0].size, 1) if len(found) else 1
        for first in range(0, len(found), step):
            known = found[first : first + step]
            np.copyto(known, 0.0, where=missing)
            np.copyto(known, self._fitted(known), where=missing)
        return found.reshape(tables.shape)

    def _fitted(self, known: FloatArray) -> FloatArray:
        """Row plus column effects of the sums over rows and columns of `known`."""
        # Axes first, and rows with their effects in one dimension: all products are of matrices.
        turned = np.moveaxis(known, -1, -3)
        H = turned.shape[-1]
        solved = self.solved.reshape(-1, self.solved.shape[2])
        sums = turned @ self.smooth
        own = (self.rows @ sums[..., None])[..., 0].reshape(*sums.shape[:-2], -1)
        column = -sums.reshape(own.shape) @ solved
        column[..., :H] += turned.sum(axis=-2)
        column = column @ self.columns
        own -= column @ solved.T
        along = own @ self.lean.reshape(len(self.lean), -1).T @ self.free.T
        column += along
        own -= along @ solved.T
        found: FloatArray = own.reshape(sums.shape) @ self.smooth.T + column[..., None, :H]
        return np.moveaxis(found, -3, -1)


def completion(observed: NDArray[np.bool_], smooth: FloatArray | None = None) -> Completion:
    """The completion of tables of which the entries `observed` (P, H) are there.

    `smooth` (H, k) are directions along the columns in which whole rows may differ: a row's own
    entries tell its lines there, unless a missing entry lies too far from them (`FARTHEST`).
    Every row and every column must have an entry. Where rows and columns fall apart into
    groups without a common entry, the differences between the groups are taken as 0
    (minimum norm).
    """
    ones = np.ones((observed.shape[1], 1))
    X = ones if smooth is None else np.concatenate([ones, smooth], axis=1)
    rows = np.stack([_of_row(X, observed[p]) for p in range(len(observed))])
    lines = X.shape[1] - 1
    cross = np.zeros((*rows.shape[:2], len(X) + lines))
    cross[:, :, : len(X)] = X.T * observed[:, None, :]
    cross[:, 1:, len(X) :] = np.eye(lines)
    solved = rows @ cross
    schur = -np.einsum("pih,pig->hg", cross, solved)
    schur[: len(X), : len(X)] += np.diag(observed.sum(axis=0))
    values, vectors = np.linalg.eigh(schur)
    kept = np.abs(values) > ALMOST_ZERO * np.abs(values).max()
    free = vectors[:, ~kept]
    along = np.einsum("pih,hq->qpi", solved, free)
    square = free[: len(X)].T @ free[: len(X)] + np.einsum("qpi,rpi->qr", along, along)
    # What the entries do not tell leaves no trace in a connected table: its rows take off again
    # what its columns put on. One by one, for of a table in many pieces there is much of it.
    connected = all(
        np.abs(of_columns - of_rows @ X.T).max() <= SAME
        for of_columns, of_rows in zip(free[: len(X)].T, along, strict=True)
    )
    return Completion(
        observed=observed,
        smooth=X,
        rows=rows,
        solved=solved,
        columns=(vectors[:, kept] / values[kept]) @ vectors[:, kept].T,
        free=free,
        lean=np.einsum("qr,rpi->qpi", np.linalg.pinv(square), along),
        connected=connected,
    )


def _of_row(X: FloatArray, there: NDArray[np.bool_]) -> FloatArray:
    """The inverse (m, m) of a row's normal matrix, 0 but for its mean where its lines are not
    told.
    """
    found = np.zeros((X.shape[1], X.shape[1]))
    found[0, 0] = 1.0 / there.sum()
    if X.shape[1] == 1 or there.sum() <= X.shape[1]:
        return found
    values, vectors = np.linalg.eigh(X[there].T @ X[there])
    if values[0] <= ALMOST_ZERO * values[-1]:
        return found
    inverse: FloatArray = (vectors / values) @ vectors.T
    far = np.einsum("hi,ij,hj->h", X[~there], inverse, X[~there])
    return inverse if far.max(initial=0.0) <= FARTHEST else found
