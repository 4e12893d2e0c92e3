"""Readings in passes as columns: what varies from pass to pass, and which passes tell of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import polynomial
from mtu_cli.stats.pass_pairs import pairs_of, units_dof

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OWN_SLOPE_SPAN = 0.3
"""A pass over less than this share of the measured range has no slope of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassDesign:
    """Columns X (n, k) and Z (n, q) of all readings, and the passes that tell of all of Z.

    Passes that broke off early have no slope of their own: they count in the coefficients
    and their covariance, but say nothing of how slopes scatter. `codes` (n,) are the passes of
    all readings, `all_pairs` (P, 2) those there and back; `rows` (n,) the readings of passes that
    tell; `own` (rows,) number those passes, `ids` and `sign` (G,) are theirs, `pairs` those of
    them there and back, `fixed` (G, 1 or 2) the columns of direction.
    """

    X: FloatArray
    Z: FloatArray
    codes: IntArray
    all_pairs: IntArray
    rows: NDArray[np.bool_]
    own: IntArray
    ids: IntArray
    sign: FloatArray
    pairs: IntArray
    fixed: FloatArray

    @property
    def dof_between(self) -> int:
        """Degrees of freedom of the scatter between the passes that tell."""
        return units_dof(len(self.ids), self.pairs, int(self.fixed.shape[1]))

    @property
    def common(self) -> FloatArray:
        """Powers (rows,) that all passes have in common, of the readings of those that tell."""
        columns: FloatArray = self.X[self.rows, self.Z.shape[1] :]
        return columns


def pass_design(
    position: FloatArray,
    center: float,
    degree: int,
    group: IntArray,
    direction: FloatArray | None,
    runs: IntArray | None,
) -> PassDesign:
    """The columns of readings at `position` (n,); `group`, `direction` and `runs` as `fit_passes`
    has them.
    """
    ids, first, codes = np.unique(group, return_index=True, return_inverse=True)
    q, whole = _random_columns(position, codes, len(ids), degree)
    rows = whole[codes]
    sign = np.zeros(len(ids)) if direction is None else direction[first]
    run = np.arange(len(ids)) if runs is None else runs[first]
    return PassDesign(
        X=polynomial(position, degree),
        Z=polynomial(position - center, q - 1),
        codes=codes,
        all_pairs=pairs_of(run, sign),
        rows=rows,
        own=(np.cumsum(whole) - 1)[codes[rows]],
        ids=ids[whole].astype(np.int64),
        sign=sign[whole],
        pairs=pairs_of(run[whole], sign[whole]),
        fixed=_direction_columns(sign[whole]),
    )


def _random_columns(
    position: FloatArray, codes: IntArray, G: int, degree: int
) -> tuple[int, NDArray[np.bool_]]:
    """Random columns q, and which passes (G,) can tell of them.

    Intercept and slope where most passes, three or more, span enough of the range.
    """
    low, high = np.full(G, np.inf), np.full(G, -np.inf)
    np.minimum.at(low, codes, position)
    np.maximum.at(high, codes, position)
    spans = high - low > OWN_SLOPE_SPAN * float(np.ptp(position))
    if degree >= 1 and (spans.all() or (spans.sum() >= 3 and spans.mean() > 0.5)):
        return 2, spans
    return 1, np.ones(G, bool)


def _direction_columns(sign: FloatArray) -> FloatArray:
    """Fixed columns of the passes: 1, and +-1/2 by direction where both were read."""
    ones = np.ones((len(sign), 1))
    both = (sign > 0).any() and (sign < 0).any()
    return np.column_stack([ones, sign / 2]) if both and len(sign) > 2 else ones
