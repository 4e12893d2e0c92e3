"""Columns of effects in the coordinates of the strata, and their cross products."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.close_loop.strata import NONE, IntArray, Strata
from mtu_cli.stats.least_squares import FloatArray

EMPTY = 1e-9
"""Share of a column's size below which what is left of it in the strata is rounding."""
DIGITS = 6
MARKS = 3
"""Projections by which a column is known."""
MANY = 8
"""Partners of a column from which on its products with all others are calculated at once."""
AT_ONCE = 1_000_000
"""Numbers of columns whose products are calculated at once."""
FACTOR = 2**31
"""More than there are columns."""


class Columns:
    """Unit columns, each stored in the strata where it is not zero.

    A column that is there already, but for sign and size, is not added again.
    """

    def __init__(self, strata: Strata) -> None:
        self.strata = strata
        self.count = 0
        S, N, A = len(strata.slices), int(strata.sizes.sum()), strata.shape[2]
        self._ends = np.array([0, *(part.stop for part in strata.slices)])
        self._values = [np.zeros((1, int(n))) for n in strata.sizes]
        self._used = np.ones(S, int)
        self._rows = np.zeros((S, 0), int)
        """Where a column stands among the values of a stratum; the first row there is zero."""
        self._means = np.zeros((0, A))
        self._known: dict[bytes, int] = {}
        self._new: list[tuple[IntArray, FloatArray, FloatArray]] = []
        self._pivots = np.zeros((S, 0, 0))
        """Cross products (S, K, p) with the columns that many others are asked beside."""
        self._pivot_of = np.zeros(0, int)
        """Which of these a column is (K,), or NONE."""
        self._pairs, self._of_pairs = np.zeros(1, int), np.zeros((S, 1))
        """Other pairs of columns, sorted, and their cross products."""
        self._marks = np.random.default_rng(0).normal(size=(N, MARKS))
        self._append(np.zeros(0, np.int64), np.zeros((1, 0)), np.zeros((1, A)))

    def add(
        self, at: IntArray, X: FloatArray, means: FloatArray, sizes: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Indices and factors (m,) of columns: x = factor * unit column; NONE and nan where nothing
        of one is left.

        `X` (m, n) at the coordinates `at` (n,), `means` (m, A) of the table, `sizes` (m,) their
        norms over the table.
        """
        norms = np.linalg.norm(X, axis=1)
        indices, factors = np.full(len(X), NONE), np.full(len(X), np.nan)
        left = np.flatnonzero((norms > EMPTY * sizes) & (norms > 0))
        units = X[left] / norms[left, None]
        marks = units @ self._marks[at]
        signs = np.where(marks[:, 0] < 0, -1.0, 1.0)
        factors[left] = norms[left] * signs
        keys = np.round(marks * signs[:, None], DIGITS)
        new: list[int] = []
        for i, key in enumerate(keys):
            indices[left[i]] = self._known.setdefault(key.tobytes(), self.count + len(new))
            if indices[left[i]] == self.count + len(new):
                new.append(i)
        if new:
            own = left[new]
            self._append(at, units[new] * signs[new, None], means[own] / factors[own, None])
        return indices, factors

    def add_alone(self, at: IntArray, units: FloatArray, means: FloatArray) -> IntArray:
        """Indices (m,) of unit columns (m, n) at the coordinates `at` (n,), with means (m, A); no
        others share them, for they have priors of their own.
        """
        first = self.count
        self._append(at, units, means)
        return np.arange(first, self.count)

    def _append(self, at: IntArray, units: FloatArray, means: FloatArray) -> None:
        self._new.append((at, units, means))
        self.count += len(units)

    def cross(self, one: IntArray, other: IntArray) -> FloatArray:
        """Cross products (S, ...) in each stratum of columns with these indices.

        They are calculated when they are asked for, and kept.
        """
        self._settle()
        one, other = np.broadcast_arrays(one, other)
        shape, one, other = one.shape, one.ravel(), other.ravel()
        self._calculate(one, other)
        one, other = np.where(self._pivot_of[one] < 0, [other, one], [one, other])
        of_pivot = self._pivot_of[one] >= 0
        result = np.zeros((len(self._values), len(one)))
        result[:, of_pivot] = self._pivots[:, other[of_pivot], self._pivot_of[one[of_pivot]]]
        pairs = _pairs(one[~of_pivot], other[~of_pivot])
        result[:, ~of_pivot] = self._of_pairs[:, np.searchsorted(self._pairs, pairs)]
        return result.reshape(len(result), *shape)

    def _calculate(self, one: IntArray, other: IntArray) -> None:
        """Cross products that are lacking: of a column with many others those with all, else one
        by one.
        """
        lacking = (self._pivot_of[one] < 0) & (self._pivot_of[other] < 0)
        if not lacking.any():
            return
        pairs = np.sort(_pairs(one[lacking], other[lacking]))
        pairs = pairs[np.diff(pairs, prepend=-1) > 0]
        at = np.searchsorted(self._pairs[:-1], pairs)
        pairs = pairs[self._pairs[at] != pairs]
        if not len(pairs):
            return
        ends = np.stack(np.divmod(pairs, FACTOR))
        new = np.flatnonzero(np.bincount(ends.ravel()) > MANY)
        if len(new):
            self._pivot_of[new] = self._pivots.shape[2] + np.arange(len(new))
            own = self.products(self.dense(new.tolist()))
            self._pivots = np.concatenate([self._pivots, own], axis=2)
            single = (self._pivot_of[ends] < 0).all(axis=0)
            pairs, ends = pairs[single], ends[:, single]
        found = np.zeros((len(self._values), len(pairs)))
        for s, values in enumerate(self._values):
            rows = self._rows[s, ends]
            there = np.flatnonzero((rows > 0).all(axis=0))
            for some in np.array_split(there, 1 + len(there) * values.shape[1] // AT_ONCE):
                found[s, some] = np.einsum("kn,kn->k", *values[rows[:, some]])
        order = np.argsort(np.concatenate([self._pairs, pairs]), kind="stable")
        self._pairs = np.concatenate([self._pairs, pairs])[order]
        self._of_pairs = np.concatenate([self._of_pairs, found], axis=1)[:, order]

    @property
    def means(self) -> FloatArray:
        """The means (K, A) of the unit columns over the table."""
        self._settle()
        return self._means

    def _settle(self) -> None:
        """Takes new columns into the cross products."""
        if not self._new:
            return
        first = old = len(self._means)
        self._means = np.concatenate([self._means, *(means for _, _, means in self._new)])
        self._rows = _roomy(self._rows, (len(self._used), self.count))
        for at, units, _ in self._new:
            ends = np.searchsorted(at, self._ends)
            for s in np.flatnonzero(np.diff(ends)):
                block = units[:, ends[s] : ends[s + 1]]
                there = np.flatnonzero(block.any(axis=1))
                rows = self._used[s] + np.arange(len(there))
                self._used[s] += len(there)
                values = self._values[s] = _roomy(self._values[s], (self._used[s], 0))
                values[rows[:, None], at[ends[s] : ends[s + 1]] - self._ends[s]] = block[there]
                self._rows[s, first + there] = rows
            first += len(units)
        self._new = []
        pivots = np.argsort(self._pivot_of)[np.sum(self._pivot_of < 0) :]
        new = self.products(self.dense(pivots.tolist()), old)
        self._pivots = np.concatenate([self._pivots, new], axis=1)
        self._pivot_of = np.concatenate([self._pivot_of, np.full(self.count - old, NONE)])

    def products(self, Y: FloatArray, first: int = 0) -> FloatArray:
        """(S, K, B) products of the columns from the first on in each stratum with coordinates
        Y (B, N), in Y's precision.
        """
        self._settle()
        result = np.zeros((len(self._values), self.count - first, len(Y)))
        for s, part in enumerate(self.strata.slices):
            rows = self._rows[s, first : self.count]
            result[s, rows > 0] = self._values[s][rows[rows > 0]].astype(Y.dtype) @ Y[:, part].T
        return result

    def dense(self, indices: Sequence[int]) -> FloatArray:
        """Columns as coordinates (k, N)."""
        self._settle()
        rows = self._rows[:, list(indices)]
        pairs = zip(self._values, rows, strict=True)
        return np.concatenate([values[own] for values, own in pairs], axis=1)


def _pairs(one: IntArray, other: IntArray) -> IntArray:
    """A number for each pair of columns, either way round."""
    return np.asarray(np.minimum(one, other) * FACTOR + np.maximum(one, other))


def _roomy(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """An array of at least this shape, with room to grow: columns come one by one in a search."""
    if all(a >= b for a, b in zip(array.shape, shape, strict=True)):
        return array
    room = [a if n <= a else n + n // 4 for n, a in zip(shape, array.shape, strict=True)]
    result = np.zeros(room, array.dtype)
    result[tuple(slice(n) for n in array.shape)] = array
    return result
