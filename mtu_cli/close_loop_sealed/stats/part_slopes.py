"""Lines of parts whose slopes are drawn from one distribution: their variances, and what each part
makes of its own entries.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.nan_median import nan_median
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import NORMAL_MAD

BoolArray = NDArray[np.bool_]

STEPS, AGAIN = 30, 4
"""Steps to the variances: at first, and from those of entries that hardly differ."""
SETTLED = 1e-3
"""Share of a variance by which the last step may change it: steps are small ones."""
LITTLE = 0.1
"""Of what entries make of a slope's variance: from less, steps hardly move."""
BEYOND = 5.0
"""Standard deviations from which on a part's slope is none of the others' distribution."""
CLEAR = 3.0
"""Standard deviations from which on a part has a slope of its own, whichever entry is left out."""
SMALLEST = 1e-9
"""Variance of slopes over that of entries, and the other way round, that is none."""
TINY = 1e-9
"""Share of the largest square of directions, and of an entry's variance, that is none."""
TOLD = 0.999
"""Of a slope's direction, what entries must tell."""


def slope_variances(
    X: FloatArray, y: FloatArray, near: BoolArray, spread: FloatArray, before: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Variances (A, k) of the parts' slopes, and those (P, A, k) by which each part's are shrunken.

    Of `y` (P, H, A), 0 where it is not `near`, on `X` (P, H, 1 + k), a column of ones first, with
    entries of the standard deviations `spread` (A,): EM for restricted maximum likelihood, the mean
    over the parts of b^2 + u^2(b) (Laird & Ware, Biometrics 38 (1982) 963), from what they were
    `before` or else from the median of least squares slopes. A part that is BEYOND the others'
    distribution is none of it. One that has a clear slope of its own, whichever of its entries is
    left out, is shrunken to that.
    """
    lines = _LeastSquares.of(X, y, near)
    noise, steps = spread[:, None] ** 2, STEPS if before is None else AGAIN
    # No step changes them, and they take longer than the rest of it.
    G, Xy = crossed(X, near), np.einsum("phj,pha->paj", X, y)
    found = lines.typical(noise) if before is None else before
    for _ in range(steps):
        inverse = shrunken(G, spread, np.broadcast_to(found, lines.b.shape))
        b = np.einsum("paij,paj->pai", inverse, Xy)[..., 1:]
        u2 = noise * np.einsum("paii->pai", inverse)[..., 1:]
        within = b**2 <= BEYOND**2 * np.maximum(found - u2, TINY * found)
        rest = within & np.asarray(near.any(axis=1))[..., None]
        last, found = found, np.where(rest, b**2 + u2, 0.0).sum(axis=0)
        found = found / np.maximum(rest.sum(axis=0), 1)
        if (np.abs(found - last) <= SETTLED * last).all():
            break
    return found, np.maximum(found, lines.own(near, noise))


def crossed(X: FloatArray, near: BoolArray) -> FloatArray:
    """X'X (P, A, i, i) of what is near (P, H, A)."""
    found: FloatArray = np.einsum("phi,pha,phj->paij", X, near.astype(float), X)
    return found


def shrunken(G: FloatArray, spread: FloatArray, variances: FloatArray) -> FloatArray:
    """(X'X + L)^-1 (P, A, i, i), G = X'X as in `crossed`: L is the variance of entries over those
    of slopes, `variances` (P, A, k), 0 for the intercepts, which are the parts' own.
    """
    noise = np.maximum(spread[:, None] ** 2, 1e-300)
    ratio = np.maximum(variances / noise, SMALLEST)
    L = np.maximum(1.0 / ratio, SMALLEST)
    return _inverse(G, np.concatenate([np.zeros((*L.shape[:2], 1)), L], axis=2))[0]


def coefficients(inverse: FloatArray, X: FloatArray, y: FloatArray) -> FloatArray:
    """(P, A, i): inverse X'y."""
    found: FloatArray = np.einsum("paij,paj->pai", inverse, np.einsum("phj,pha->paj", X, y))
    return found


def _inverse(G: FloatArray, L: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(X'X + L)^-1 (P, A, i, i) along what X'X tells; which coefficients (P, A, i) that are."""
    whole = G + L[..., None] * np.eye(G.shape[3])
    square, turn = np.linalg.eigh(whole)
    # L alone makes directions differ by any size, and tells all of them.
    least = TINY * np.where(L.any(axis=2), TINY, 1.0)[..., None]
    kept = square > least * np.maximum(square[..., -1:], 1e-300)
    scaled = turn * np.where(kept, 1.0 / np.where(kept, square, 1.0), 0.0)[..., None, :]
    held = np.einsum("pain,pan->pai", turn**2, kept.astype(float))
    return np.einsum("pain,pajn->paij", scaled, turn), held > TOLD


class _LeastSquares(NamedTuple):
    """Slopes `b` (P, A, k) of the parts by themselves, their `variance` by entries of variance 1,
    and which of them are `told`; and without each of the entries slopes `alone` and their variance
    `chance` (P, H, A, k), infinite where the others tell none.
    """

    b: FloatArray
    variance: FloatArray
    told: BoolArray
    alone: FloatArray
    chance: FloatArray

    @classmethod
    def of(cls, X: FloatArray, y: FloatArray, near: BoolArray) -> _LeastSquares:
        """Deletion formulas of least squares (Cook & Weisberg 1982, 2.2)."""
        inverse, told = _inverse(crossed(X, near), np.zeros((*y.shape[::2], X.shape[2])))
        b = coefficients(inverse, X, y)
        told &= (near.sum(axis=1) > X.shape[2])[..., None]
        chance = np.einsum("paii->pai", inverse)
        pull = np.einsum("paij,phj->phai", inverse, X)
        left = np.where(near, y - np.einsum("phi,pai->pha", X, b), 0.0)
        free = 1.0 - np.where(near, np.einsum("phi,phai->pha", X, pull), 0.0)
        free = np.where(free > TINY, free, np.inf)[..., None]
        alone = b[:, None] - pull * left[..., None] / free
        without = np.where(np.isfinite(free), chance[:, None] + pull**2 / free, np.inf)
        return cls(b[..., 1:], chance[..., 1:], told[..., 1:], alone[..., 1:], without[..., 1:])

    def typical(self, noise: FloatArray) -> FloatArray:
        """Variances (A, k) of the parts' slopes by medians of what is told, less what entries make
        of them, or a little where that is none.
        """
        squares, chance = (
            nan_median(np.where(self.told, own, np.nan), axis=0)[0]
            for own in (self.b**2, self.variance * noise)
        )
        found: FloatArray = np.maximum(NORMAL_MAD**2 * squares - chance, LITTLE * chance)
        return np.nan_to_num(found)

    def own(self, near: BoolArray, noise: FloatArray) -> FloatArray:
        """Variances (P, A, k) of clear slopes that parts have of their own, 0 of others."""
        chance = self.chance * np.maximum(noise, 1e-300)
        excess = np.where(self.alone**2 > CLEAR**2 * chance, self.alone**2 - chance, 0.0)
        least = np.where(near[..., None], excess, np.inf).min(axis=1)
        return np.where(self.told, least, 0.0)
