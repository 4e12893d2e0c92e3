"""Single entries that are far off whatever the rest does: set aside before anything is judged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.nan_median import nan_median
from mtu_cli.close_loop_sealed.stats.shrunken_lines import off_lines
from mtu_cli.stats.least_squares import FloatArray

MOST = 0.05
"""Share of the entries beyond which they are the table's own distribution."""
MOST_OF_ONE, SINGLE = 0.1, 2
"""Share of the entries of a part, or of a column, beyond which they are that one's own (it moved,
or it is loose), and up to how many they are single ones in any case."""
QUARTER = 0.25
"""Share of them beyond which they tell nothing of the others' distribution."""
FEWEST, FEWEST_ENTRIES = 4, 12
"""Parts and columns, and entries: of less nothing is told."""
SWEEPS = 50
STILL = 1e-3
"""Of the root mean square, by which the last sweep may move a median."""
NOTHING = 1e-8
"""Share of the places' squares below which they do not differ along a direction."""
ROUNDING = 1e-12
"""Of the root mean square of the errors: what scatters less does not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gross:
    """An entry that was set aside: `deviation` (A,) from what its part and column make one
    expect, mm (rad), `score` the largest in standard deviations.
    """

    part: str
    feature: str
    deviation: tuple[float, ...]
    score: float


def set_aside(table: ResidualTable) -> tuple[ResidualTable, tuple[Gross, ...]]:
    """The table without gross entries, and what they were.

    Deviations are from what all others make one expect of the entry's part and column (see
    `off_lines`), beginning at their medians (Tukey's median polish). What is gross in one axis is
    set aside in all. Of one part, or one column, every entry is all that is known of something.
    """
    P, H, _ = table.errors.shape
    if min(P, H) < FEWEST or table.there.sum() < FEWEST_ENTRIES:
        return table, ()
    errors = np.where(table.there[:, :, None], table.errors, np.nan)
    found = off_lines(_polished(errors), _slopes(table.places), _least(table, errors))
    own = _few_of_one(found.gross, table.there, QUARTER)
    gross = _few_of_one(found.gross, table.there, MOST_OF_ONE)
    if not gross.any() or own.sum() > max(MOST * table.there.sum(), 1):
        return table, ()
    told = tuple(
        Gross(
            part=table.parts[p],
            feature=table.features[h],
            deviation=tuple(float(v) for v in found.deviation[p, h]),
            score=float(found.score[p, h].max()),
        )
        for p, h in np.argwhere(gross)
    )
    return _without(table, gross), told


def _few_of_one(
    gross: NDArray[np.bool_], there: NDArray[np.bool_], share: float
) -> NDArray[np.bool_]:
    """Gross entries (P, H) without those of parts and columns that have more than this share."""
    own: NDArray[np.bool_] = gross.copy()
    for axis in (0, 1):
        most = np.maximum(share * there.sum(axis=axis, keepdims=True), SINGLE)
        own &= gross.sum(axis=axis, keepdims=True) <= most
    return own


def _least(table: ResidualTable, errors: FloatArray) -> FloatArray:
    """Standard deviations (A,) that rounding gives to entries at least."""
    step = np.array(table.resolution) if table.resolution else np.zeros(errors.shape[2])
    return np.asarray(step / np.sqrt(12.0))


def _polished(errors: FloatArray) -> FloatArray:
    """Errors (P, H, A) less the medians of parts and columns; 0 where that is rounding alone."""
    left = errors
    level = np.sqrt(np.nanmean(errors**2, axis=(0, 1)))
    for _ in range(SWEEPS):
        before = left
        left = left - nan_median(left, axis=1)
        left = left - nan_median(left, axis=0)
        if not (np.abs(left - before) > STILL * np.nanmax(np.abs(left), axis=(0, 1))).any():
            break
    found: FloatArray = np.where(np.abs(left) <= ROUNDING * level, 0.0, left)
    return found


def _slopes(places: FloatArray) -> FloatArray:
    """(P, H, k): places (P, H, d) about their part's mean, along the k directions they lie in,
    which single entries of all parts together tell apart (the principal axes).
    """
    known = np.isfinite(places).all(axis=(0, 1)) & (np.ptp(places, axis=(0, 1)) > 0)
    X = places[:, :, known] - places[:, :, known].mean(axis=1, keepdims=True)
    X = X / max(float(np.abs(X).max(initial=0.0)), 1e-300)
    square, turn = np.linalg.eigh(np.einsum("phi,phj->ij", X, X))
    found: FloatArray = X @ turn[:, square > NOTHING * square.max(initial=0.0)]
    return found


def _without(table: ResidualTable, aside: NDArray[np.bool_]) -> ResidualTable:
    errors = np.where(aside[:, :, None], np.nan, table.errors)
    return replace(table, errors=errors, repeats=np.where(aside, 0, table.repeats))
