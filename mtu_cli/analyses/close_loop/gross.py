"""Single entries that are far off whatever the rest does: set aside before anything is judged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.shrunken_lines import OffLines, off_lines

MOST = 0.05
"""Share of the entries beyond which they are the table's own distribution."""
FEWEST = 4
SWEEPS = 10
NOTHING = 1e-12
"""Share of the places' squares below which they do not differ along a direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gross:
    """An entry that was set aside: `deviation` (A,) from what its part and column make one
    expect, mm (rad), `score` the largest in robust standard deviations.
    """

    part: str
    feature: str
    deviation: tuple[float, ...]
    score: float


def set_aside(table: ResidualTable) -> tuple[ResidualTable, tuple[Gross, ...]]:
    """The table without gross entries, and what they were.

    Deviations are from a line of the part and from the column (see `off_lines`), which begin at
    their medians (Tukey's median polish); of one part or one column alone from its mean. What is
    gross in one axis is set aside in all.
    """
    P, H, _ = table.errors.shape
    if P * H < 12 or (1 < P < FEWEST) or (1 < H < FEWEST):
        return table, ()
    found = _judged(np.where(table.there[:, :, None], table.errors, np.nan), table.places)
    worst = found.score.max(axis=2)
    gross = np.asarray((found.score > found.limit).any(axis=2))
    if not gross.any() or gross.sum() > max(MOST * P * H, 1):
        return table, ()
    kept = _still_needed(table.there & ~gross, gross)
    told = tuple(
        Gross(
            part=table.parts[p],
            feature=table.features[h],
            deviation=tuple(float(v) for v in found.deviation[p, h]),
            score=float(worst[p, h]),
        )
        for p, h in np.argwhere(gross & ~kept)
    )
    return _without(table, ~kept & gross), told


def _judged(errors: FloatArray, places: FloatArray) -> OffLines:
    """How far each entry is off, of errors (P, H, A), nan where missing, at places (P, H, d)."""
    P, H, A = errors.shape
    if min(P, H) > 1:
        left = errors
        for _ in range(SWEEPS):
            left = left - _medians(left, axis=1)
            left = left - _medians(left, axis=0)
        X = np.concatenate([np.ones((P, H, 1)), _slopes(places)], axis=2)
        return off_lines(left, X, columns=True)
    row = errors.reshape(1, -1, A)
    found = off_lines(row - _medians(row, axis=1), np.ones((1, row.shape[1], 1)), columns=False)
    shape = (P, H, A)
    return replace(
        found, deviation=found.deviation.reshape(shape), score=found.score.reshape(shape)
    )


def _medians(values: FloatArray, axis: int) -> FloatArray:
    """Medians along an axis, which is kept, of what is not nan; nan where all is.

    As numpy.nanmedian, which goes through small tables column by column; six times as fast.
    """
    ordered, n = np.sort(values, axis=axis), (~np.isnan(values)).sum(axis=axis, keepdims=True)
    low = np.take_along_axis(ordered, np.maximum(n - 1, 0) // 2, axis)
    found: FloatArray = (low + np.take_along_axis(ordered, n // 2, axis)) / 2
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


def _still_needed(kept: NDArray[np.bool_], gross: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Entries without which a part or a column would have none are kept."""
    bare_parts = ~np.asarray(kept.any(axis=1))[:, None]
    bare_columns = ~np.asarray(kept.any(axis=0))[None, :]
    found: NDArray[np.bool_] = gross & (bare_parts | bare_columns)
    return found


def _without(table: ResidualTable, aside: NDArray[np.bool_]) -> ResidualTable:
    errors = np.where(aside[:, :, None], np.nan, table.errors)
    return replace(table, errors=errors, repeats=np.where(aside, 0, table.repeats))
