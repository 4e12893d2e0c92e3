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
MANY = 100
"""Times that a column is asked for at once from which on its products with all others are kept."""
AT_ONCE = 1_000_000
"""Numbers of columns whose products are calculated at once."""
PADDING = 0
"""Index of the column of zeros that fills models of unequal size up."""


class Columns:
    """Unit columns, each stored in the strata where it is not zero.

    A column that is there already, but for sign and size, is not added again.
    """

    def __init__(self, strata: Strata) -> None:
        self.strata, self.count = strata, 0
        S, N, A = len(strata.slices), int(strata.sizes.sum()), strata.shape[2]
        self._values = [np.zeros((1, int(n))) for n in strata.sizes]
        self._used = np.ones(S, int)
        self._rows = np.zeros((S, 0), int)
        """Where a column stands among the values of a stratum; the first row there is zero."""
        self._means = np.zeros((0, A))
        self._known: dict[bytes, int] = {}
        self._new: list[tuple[IntArray, FloatArray, FloatArray]] = []
        self._pivots, self._pivot_of = np.zeros((S, 0, 0)), np.zeros(0, int)
        """Cross products (S, K, p) with columns that many others are asked beside, and which of
        these a column is (K,), or NONE.
        """
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
        """Cross products (S, ...) in each stratum of columns with these indices."""
        self._settle()
        one, other = np.broadcast_arrays(one, other)
        shape, one, other = one.shape, one.ravel(), other.ravel()
        lacking = (self._pivot_of[one] < 0) & (self._pivot_of[other] < 0)
        asked = np.bincount(np.concatenate([one[lacking], other[lacking]]), minlength=1)
        if len(new := np.flatnonzero(asked > MANY)):
            self._pivot_of[new] = self._pivots.shape[2] + np.arange(len(new))
            own = self.products(self.dense(new.tolist()))
            self._pivots = np.concatenate([self._pivots, own], axis=2)
        one, other = np.where(self._pivot_of[one] < 0, [other, one], [one, other])
        kept = self._pivot_of[one] >= 0
        result = np.zeros((len(self._values), len(one)))
        result[:, kept] = self._pivots[:, other[kept], self._pivot_of[one[kept]]]
        for s, values in enumerate(self._values):
            rows = self._rows[s][np.stack([one, other])]
            there = np.flatnonzero(~kept & (rows > 0).all(axis=0))
            for some in np.array_split(there, 1 + len(there) * values.shape[1] // AT_ONCE):
                result[s, some] = np.einsum("kn,kn->k", *values[rows[:, some]])
        return result.reshape(len(result), *shape)

    @property
    def means(self) -> FloatArray:
        """The means (K, A) of the unit columns over the table."""
        self._settle()
        return self._means

    def _settle(self) -> None:
        """Takes new columns in."""
        if not self._new:
            return
        first = old = len(self._means)
        self._means = np.concatenate([self._means, *(means for _, _, means in self._new)])
        self._rows = np.pad(self._rows, ((0, 0), (0, self.count - old)))
        blocks: list[list[FloatArray]] = [[values] for values in self._values]
        for at, units, _ in self._new:
            for s, part in enumerate(self.strata.slices):
                low, high = np.searchsorted(at, [part.start, part.stop])
                there = np.flatnonzero(units[:, low:high].any(axis=1))
                if len(there):
                    blocks[s].append(np.zeros((len(there), part.stop - part.start)))
                    blocks[s][-1][:, at[low:high] - part.start] = units[there, low:high]
                    self._rows[s, first + there] = self._used[s] + np.arange(len(there))
                    self._used[s] += len(there)
            first += len(units)
        self._values = [own[0] if len(own) == 1 else np.concatenate(own) for own in blocks]
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
            rows = self._rows[s, first:]
            result[s, rows > 0] = self._values[s][rows[rows > 0]].astype(Y.dtype) @ Y[:, part].T
        return result

    def dense(self, indices: Sequence[int]) -> FloatArray:
        """Columns as coordinates (k, N)."""
        self._settle()
        rows = self._rows[:, list(indices)]
        pairs = zip(self._values, rows, strict=True)
        return np.concatenate([values[own] for values, own in pairs], axis=1)
