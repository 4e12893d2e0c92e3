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
PADDING = 0
"""Index of the column of zeros that fills models of unequal size up."""


class Columns:
    """Unit columns, each stored in the strata where it is not zero.

    A column that is there already, but for sign and size, is not added again.
    """

    def __init__(self, strata: Strata) -> None:
        self.strata = strata
        self.count = 0
        S, N, A = len(strata.slices), int(strata.sizes.sum()), strata.shape[2]
        self._values = [np.zeros((1, int(n))) for n in strata.sizes]
        self._rows = np.zeros((S, 0), int)
        """Where a column stands among the values of a stratum; the first row there is zero."""
        self._products = [np.zeros((1, 1))] * S
        """Of all rows of a stratum with each other."""
        self._means = np.zeros((0, A))
        self._known: dict[bytes, int] = {}
        self._new: list[tuple[IntArray, FloatArray, FloatArray]] = []
        self._marks = np.random.default_rng(0).normal(size=(N, MARKS))
        self.add_alone(np.zeros(0, np.int64), np.zeros((1, 0)), np.zeros((1, A)))

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
            self.add_alone(at, units[new] * signs[new, None], means[own] / factors[own, None])
        return indices, factors

    def add_alone(self, at: IntArray, units: FloatArray, means: FloatArray) -> IntArray:
        """Indices (m,) of unit columns (m, n) at the coordinates `at` (n,), with means (m, A); no
        others share them, for they have priors of their own.
        """
        self._new.append((at, units, means))
        self.count += len(units)
        return np.arange(self.count - len(units), self.count)

    @property
    def means(self) -> FloatArray:
        """The means (K, A) of the unit columns over the table."""
        self._settle()
        return self._means

    def cross(self, one: IntArray, other: IntArray) -> FloatArray:
        """Cross products (S, ...) in each stratum of columns with these indices."""
        self._settle()
        pairs = zip(self._products, self._rows, strict=True)
        return np.array([products[rows[one], rows[other]] for products, rows in pairs])

    def products(self, Y: FloatArray) -> FloatArray:
        """(S, K, B) products of all columns in each stratum with coordinates Y (B, N), in Y's
        precision.
        """
        self._settle()
        result = np.zeros((len(self._values), self.count, len(Y)))
        for s, part in enumerate(self.strata.slices):
            there = self._rows[s] > 0
            result[s, there] = self._values[s][1:].astype(Y.dtype) @ Y[:, part].T
        return result

    def dense(self, indices: Sequence[int]) -> FloatArray:
        """Columns as coordinates (k, N)."""
        self._settle()
        pairs = zip(self._values, self._rows[:, list(indices)], strict=True)
        return np.concatenate([values[own] for values, own in pairs], axis=1)

    def _settle(self) -> None:
        """Takes new columns into the strata."""
        if not self._new:
            return
        self._means = np.concatenate([self._means, *(means for _, _, means in self._new)])
        rows = np.zeros((len(self._values), self.count), int)
        rows[:, : self._rows.shape[1]] = self._rows
        for s, part in enumerate(self.strata.slices):
            blocks, first = [self._values[s]], self._rows.shape[1]
            old = used = len(self._values[s])
            for at, units, _ in self._new:
                low, high = np.searchsorted(at, [part.start, part.stop])
                there = np.flatnonzero(units[:, low:high].any(axis=1))
                rows[s, first + there] = used + np.arange(len(there))
                blocks.append(np.zeros((len(there), part.stop - part.start)))
                blocks[-1][:, at[low:high] - part.start] = units[there, low:high]
                first, used = first + len(units), used + len(there)
            self._values[s] = values = np.concatenate(blocks)
            across = values[:old] @ values[old:].T
            inner = values[old:] @ values[old:].T
            self._products[s] = np.block([[self._products[s], across], [across.T, inner]])
        self._rows, self._new = rows, []
