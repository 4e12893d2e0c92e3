"""Columns of effects in the coordinates of the strata, and their cross products."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.close_loop.strata import NONE, IntArray, Strata
from mtu_cli.stats.least_squares import FloatArray

EMPTY = 1e-9
"""Share of a column's size below which its coordinates in the strata are rounding."""
PADDING = 0
"""Index of the column of zeros that fills models of unequal size up."""
FREE = 1e-9
"""Prior precision of the size of a unit column that is free."""
DIGITS = 6
MARKS = 3
"""Projections by which a column is known."""
AT_ONCE = 1_000_000
"""Numbers of columns whose products are calculated at once."""


class Columns:
    """Unit columns, each stored in the strata where it is not zero; `means` (K, A) are those over
    the table, `precisions` (K,) of their sizes what is known beforehand. The first one is zero.

    A column that is there already, but for sign and size, is not added again.
    """

    def __init__(self, strata: Strata) -> None:
        self.strata = strata
        self.means, self.precisions = np.zeros((1, strata.shape[2])), np.ones(1)
        self._ends = np.array([0, *(part.stop for part in strata.slices)])
        self._values = [np.zeros((1, int(n))) for n in strata.sizes]
        self._used = np.ones(len(strata.slices), int)
        self._rows = np.zeros((len(strata.slices), 1), int)
        """Where a column stands among the values of a stratum; the first row there is zero."""
        self._index: dict[bytes, int] = {}
        self._marks = np.random.default_rng(0).normal(size=(self._ends[-1], MARKS))

    @property
    def count(self) -> int:
        """How many columns there are, K."""
        return len(self.means)

    def add(
        self, at: IntArray, X: FloatArray, means: FloatArray, sizes: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Indices and factors (m,) of columns: x = factor * unit column; NONE and nan of those that
        are rounding.

        `X` (m, n) at the coordinates `at` (n,), `means` (m, A) of the table, `sizes` (m,) their
        norms over the table.
        """
        norms = np.linalg.norm(X, axis=1)
        indices, factors = np.full(len(X), NONE), np.full(len(X), np.nan)
        nonzero = np.flatnonzero((norms > EMPTY * sizes) & (norms > 0))
        units = X[nonzero] / norms[nonzero, None]
        marks = units @ self._marks[at]
        signs = np.where(marks[:, 0] < 0, -1.0, 1.0)
        factors[nonzero] = norms[nonzero] * signs
        keys = np.round(marks * signs[:, None], DIGITS)
        new: list[int] = []
        for i, key in enumerate(keys):
            indices[nonzero[i]] = self._index.setdefault(key.tobytes(), self.count + len(new))
            if indices[nonzero[i]] == self.count + len(new):
                new.append(i)
        fresh = nonzero[new]
        units, precisions = units[new] * signs[new, None], np.full(len(fresh), FREE)
        self.add_alone(at, units, means[fresh] / factors[fresh, None], precisions)
        return indices, factors

    def add_alone(
        self, at: IntArray, units: FloatArray, means: FloatArray, precisions: FloatArray
    ) -> IntArray:
        """Indices (m,) of unit columns (m, n) at the coordinates `at` (n,), with means (m, A); no
        others share them, as each has its prior precision in `precisions` (m,).
        """
        rows, ends = np.zeros((len(self._used), len(units)), int), np.searchsorted(at, self._ends)
        for s in np.flatnonzero(np.diff(ends)):
            block = units[:, ends[s] : ends[s + 1]]
            nonzero = np.flatnonzero(block.any(axis=1))
            i = self._used[s] + np.arange(len(nonzero))
            self._used[s] += len(nonzero)
            if (room := len(self._values[s])) < self._used[s]:
                # Columns come one by one in a search.
                growth = self._used[s] + self._used[s] // 4 - room
                self._values[s] = np.pad(self._values[s], ((0, growth), (0, 0)))
            self._values[s][i[:, None], at[ends[s] : ends[s + 1]] - self._ends[s]] = block[nonzero]
            rows[s, nonzero] = i
        first = self.count
        self._rows = np.concatenate([self._rows, rows], axis=1)
        self.means = np.concatenate([self.means, means])
        self.precisions = np.concatenate([self.precisions, precisions])
        return np.arange(first, self.count)

    def cross(self, one: IntArray, other: IntArray) -> FloatArray:
        """Products (S, ...) in each stratum of pairs of columns with these indices."""
        one, other = np.broadcast_arrays(one, other)
        result = np.zeros((len(self._values), *one.shape))
        for values, rows, products in zip(self._values, self._rows, result, strict=True):
            cells = np.argwhere((rows[one] > 0) & (rows[other] > 0))
            for chunk in np.array_split(cells, 1 + len(cells) * values.shape[1] // AT_ONCE):
                at = tuple(chunk.T)
                pairs = values[rows[one[at]]], values[rows[other[at]]]
                products[at] = np.einsum("kn,kn->k", *pairs)
        return result

    def crossed(
        self, added: IntArray, shared: Sequence[int] = (), inner: FloatArray | None = None
    ) -> tuple[IntArray, FloatArray]:
        """The columns (M, w + k) of models: those `added` (M, w) of each, and then those (k,) that
        all of them share; and their products (S, M, w + k, w + k) in each stratum, `inner` those
        among the former before some became PADDING.
        """
        w, common = added.shape[1], np.array(shared, int)
        if inner is None:
            inner = self.cross(added[:, :, None], added[:, None])
        nonzero = added != PADDING
        across = self.gram(added, common)
        G = np.empty((*inner.shape[:2], w + len(common), w + len(common)))
        G[:, :, :w, :w], G[:, :, :w, w:], G[:, :, w:, :w] = inner, across, np.swapaxes(across, 2, 3)
        G[:, :, :w, :w] *= nonzero[:, :, None] & nonzero[:, None]
        G[:, :, w:, w:] = self.gram(common, common)[:, None]
        return np.hstack([added, np.tile(common, (len(added), 1))]), G

    def gram(self, columns: IntArray, targets: IntArray) -> FloatArray:
        """Products (S, ..., m) in each stratum of columns (...) with each of the `targets` (m,)."""
        result = np.zeros((len(self._values), *columns.shape, len(targets)))
        for s, rows in enumerate(self._rows[:, targets]):
            if rows.any():
                result[s] = self._times(s, columns, self._values[s][rows].T)
        return result

    def products(self, Y: FloatArray, first: int = 0) -> FloatArray:
        """(S, K, B) products of the columns from the first on in each stratum with coordinates
        Y (B, N), in Y's precision.
        """
        columns = np.arange(first, self.count)
        parts = enumerate(self.strata.slices)
        return np.array([self._times(s, columns, Y[:, part].T) for s, part in parts], float)

    def _times(self, s: int, columns: IntArray, Z: FloatArray) -> FloatArray:
        """Products (..., m) in a stratum of columns (...) with Z (n, m), in Z's precision."""
        values, rows = self._values[s][: self._used[s]], self._rows[s, columns]
        nonzero = rows > 0
        if 2 * nonzero.sum() > len(values):  # Of most of them: without a copy.
            return np.asarray((values.astype(Z.dtype, copy=False) @ Z)[rows])
        result = np.zeros((*rows.shape, Z.shape[1]))
        result[nonzero] = values[rows[nonzero]].astype(Z.dtype) @ Z
        return result

    def dense(self, indices: Sequence[int]) -> FloatArray:
        """Columns as coordinates (k, N)."""
        pairs = zip(self._values, self._rows[:, list(indices)], strict=True)
        return np.concatenate([values[at] for values, at in pairs], axis=1)
