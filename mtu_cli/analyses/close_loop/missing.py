"""Cells that were not measured, or are set aside as outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

BoolArray = NDArray[np.bool_]
GROSS = 5.5
"""Robust standard deviations of the interaction from which on an entry is set aside."""
ROUNDS = 5
MAD = 1.4826
"""Standard deviation over the median absolute deviation of a normal law."""
FEWEST_FOR_OUTLIERS = 5
"""Parts from which on one cell can be judged by the others of its feature."""
MOST_SHARE = 0.1
"""Share of the entries beyond which they are no outliers but heavy tails."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Missing:
    """Cells without a value: those of a table are filled in so that nothing of the interaction is
    left there (Yates 1933), which is as if they were left out where parts and features are free.

    `there` (P, H); `lines` (H, k), orthonormal, are what each part is free in; `inverse` (m, m) of
    the interaction's projection at the cells.
    """

    there: BoolArray
    lines: FloatArray
    cells: tuple[NDArray[np.int64], NDArray[np.int64]]
    inverse: FloatArray

    @property
    def count(self) -> int:
        """Cells without a value."""
        return len(self.cells[0])

    def filled(self, table: FloatArray) -> FloatArray:
        """Tables (..., P, H) with their missing cells filled in, whatever stood there."""
        if not self.count:
            return table
        p, h = self.cells
        Y = np.where(self.there, table, 0.0)
        E = interaction(Y, self.lines)[..., p, h]
        result = Y.copy()
        result[..., p, h] = -E @ self.inverse
        return result

    def of_axes(self, errors: FloatArray) -> FloatArray:
        """Errors (P, H, A) with what is missing filled in."""
        return np.moveaxis(self.filled(np.moveaxis(errors, -1, 0)), 0, -1)


def missing(there: BoolArray, lines: FloatArray) -> Missing:
    """The missing cells of a table, by where there are values (P, H)."""
    p, h = np.nonzero(~there)
    P, H = there.shape
    within = (np.eye(H) - lines @ lines.T)[h[:, None], h[None]]
    M = ((p[:, None] == p[None]) - 1 / P) * within
    inverse = np.linalg.pinv(M, hermitian=True) if len(p) else np.zeros((0, 0))
    return Missing(there=there, lines=lines, cells=(p, h), inverse=inverse)


def interaction(table: FloatArray, lines: FloatArray) -> FloatArray:
    """Tables (..., P, H) less the means of the features and what each part has of some lines."""
    left = table - table.mean(axis=-2, keepdims=True)
    return np.asarray(left - (left @ lines) @ lines.T)


def outliers(
    errors: FloatArray, there: BoolArray, lines: FloatArray, least: FloatArray
) -> BoolArray:
    """Where (P, H, A) single entries are further from what part and feature foretell than `GROSS`
    robust standard deviations of the interaction; `least` (A,) deviations that rounding gives.

    They are looked for again without those that were found, for these hide others.
    """
    hit = np.zeros(errors.shape, bool)
    if errors.shape[0] < FEWEST_FOR_OUTLIERS or errors.shape[1] < 2:
        return hit
    for a in range(errors.shape[2]):
        for _ in range(ROUNDS):
            kept = there & ~hit[..., a]
            filled = missing(kept, lines).filled(np.nan_to_num(errors[..., a]))
            fitted = filled - interaction(filled, lines)
            left = np.where(there, np.nan_to_num(errors[..., a]) - fitted, 0.0)
            spread = max(MAD * float(np.median(np.abs(left[there]))), float(least[a]))
            new = (np.abs(left) > GROSS * spread) & there & ~hit[..., a]
            if not new.any() or (hit[..., a] | new).sum() > MOST_SHARE * there.sum():
                break
            hit[..., a] |= new
    return hit
