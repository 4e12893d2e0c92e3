"""Cells that were not measured, or are excluded as outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import FloatArray

BoolArray = NDArray[np.bool_]
GROSS = 5.5
"""Robust standard deviations of the interaction from which on an entry is excluded."""
ROUNDS = 5
FEWEST_FOR_OUTLIERS = 5
"""Parts from which on one cell can be judged by the others of its feature."""
MOST_SHARE = 0.1
"""Share of the entries beyond which they are no outliers but heavy tails."""


class Missing:
    """Cells without a value, by where there are values (P, H): those of a table are filled in so
    that the interaction there is 0 (Yates 1933), which is as if they were left out where parts and
    features are free. `lines` (H, k), orthonormal, are what each part is free in.
    """

    def __init__(self, measured: BoolArray, lines: FloatArray) -> None:
        self.measured, self.lines = measured, lines
        self.cells = p, h = np.nonzero(~measured)
        within = (np.eye(len(lines)) - lines @ lines.T)[h[:, None], h[None]]
        M = ((p[:, None] == p[None]) - 1 / len(measured)) * within
        self.inverse = np.linalg.pinv(M, rcond=1e-9, hermitian=True) if len(p) else M

    def filled(self, table: FloatArray) -> FloatArray:
        """Tables (..., P, H) with their missing cells filled in, whatever stood there."""
        if self.measured.all():
            return table
        p, h = self.cells
        Y = np.where(self.measured, table, 0.0)
        E = interaction(Y, self.lines)[..., p, h]
        result = Y.copy()
        result[..., p, h] = -E @ self.inverse
        return result


def interaction(table: FloatArray, lines: FloatArray) -> FloatArray:
    """Tables (..., P, H) less the means of the features and what each part has of some lines."""
    rest = table - table.mean(axis=-2, keepdims=True)
    return np.asarray(rest - (rest @ lines) @ lines.T)


def outliers(
    errors: FloatArray, measured: BoolArray, lines: FloatArray, least: FloatArray
) -> BoolArray:
    """Where (P, H, A) single entries are further from what part and feature predict than `GROSS`
    robust standard deviations of the interaction; `least` (A,) deviations that rounding gives.

    The search is repeated without them, as outliers hide others.
    """
    mask = np.zeros(errors.shape, bool)
    if errors.shape[0] < FEWEST_FOR_OUTLIERS or errors.shape[1] < 2:
        return mask
    for a in range(errors.shape[2]):
        for _ in range(ROUNDS):
            valid = measured & ~mask[..., a]
            filled = Missing(valid, lines).filled(np.nan_to_num(errors[..., a]))
            fitted = filled - interaction(filled, lines)
            deviation = np.where(measured, np.nan_to_num(errors[..., a]) - fitted, 0.0)
            spread = max(1.4826 * float(np.median(np.abs(deviation[measured]))), float(least[a]))
            new = (np.abs(deviation) > GROSS * spread) & measured & ~mask[..., a]
            if not new.any() or (mask[..., a] | new).sum() > MOST_SHARE * measured.sum():
                break
            mask[..., a] |= new
    return mask
