"""Incomplete two-way tables completed by their additive least-squares fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

ALMOST_ZERO = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class Completion:
    """Fills the missing entries of tables (..., P, H, A) of rows and columns.

    `observed` (P, H) tells which entries there are; `inverse` (P + H, P + H) is the
    pseudo-inverse of the normal equations of row plus column effects. An entry that is missing
    is given the least-squares row effect plus column effect of those that are there: linear in
    them, and exact for every table that is a function of the row plus one of the column.
    """

    observed: NDArray[np.bool_]
    inverse: FloatArray | None

    @property
    def complete(self) -> bool:
        """Whether no entry is missing."""
        return self.inverse is None

    def fill(self, tables: FloatArray) -> FloatArray:
        """The completed tables (..., P, H, A); what stood in missing entries is ignored."""
        if self.inverse is None:
            return tables
        there = self.observed[:, :, None]
        known = np.where(there, tables, 0.0)
        return np.where(there, known, self._additive(known))

    def adjoint(self, tables: FloatArray) -> FloatArray:
        """The transpose of `fill`, so that sum(fill(Y) * W) = sum(Y * adjoint(W))."""
        if self.inverse is None:
            return tables
        there = self.observed[:, :, None]
        missing = np.where(there, 0.0, tables)
        return np.where(there, tables + self._additive(missing), 0.0)

    def _additive(self, known: FloatArray) -> FloatArray:
        """Row plus column effects of the sums over rows and columns of `known`."""
        assert self.inverse is not None
        P = self.observed.shape[0]
        sums = np.concatenate([known.sum(axis=-2), known.sum(axis=-3)], axis=-2)
        effects = self.inverse @ sums
        found: FloatArray = effects[..., :P, None, :] + effects[..., None, P:, :]
        return found


def completion(observed: NDArray[np.bool_]) -> Completion:
    """The completion of tables of which the entries `observed` (P, H) are there.

    Every row and every column must have an entry. Where rows and columns fall apart into
    groups without a common entry, the differences between the groups are taken as 0
    (minimum norm).
    """
    if observed.all():
        return Completion(observed=observed, inverse=None)
    there = observed.astype(float)
    normal = np.block([[np.diag(there.sum(axis=1)), there], [there.T, np.diag(there.sum(axis=0))]])
    values, vectors = np.linalg.eigh(normal)
    kept = values > ALMOST_ZERO * values[-1]
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return Completion(observed=observed, inverse=inverse)
