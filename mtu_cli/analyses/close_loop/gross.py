"""Single entries that are far off whatever the rest does: set aside before anything is judged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

RATE = 0.05
"""Chance of the largest normal deviate of a table to pass the limit before the margin."""
MARGIN = 1.0
"""Standard deviations beyond that: only what is gross is set aside."""
MOST = 0.05
"""Share of the entries beyond which they are the table's own distribution."""
FEWEST = 4
SWEEPS = 10
NORMAL_MAD = 1.4826


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

    Deviations are from the median of the part and of the column (Tukey's median polish), of
    one part alone from its median; the scale is the median absolute deviation, grown to the
    degrees of freedom. What is gross in one axis is set aside in all.
    """
    P, H, _ = table.errors.shape
    if P * H < 12 or (1 < P < FEWEST) or (1 < H < FEWEST):
        return table, ()
    left = _polished(np.where(table.there[:, :, None], table.errors, np.nan))
    share = max((P - 1) * (H - 1), 1) / (P * H) if P > 1 and H > 1 else 1.0
    spread = NORMAL_MAD * np.nanmedian(np.abs(left), axis=(0, 1)) / np.sqrt(share)
    with np.errstate(divide="ignore", invalid="ignore"):
        score = np.abs(left) / spread
    score[:, :, spread <= 0] = 0.0
    worst = np.nan_to_num(score).max(axis=2)
    limit = float(-ndtri(RATE / (2 * P * H))) + MARGIN
    gross = worst > limit
    if not gross.any() or gross.sum() > max(MOST * P * H, 1):
        return table, ()
    kept = _still_needed(table.there & ~gross, gross)
    found = tuple(
        Gross(
            part=table.parts[p],
            feature=table.features[h],
            deviation=tuple(float(v) for v in left[p, h]),
            score=float(worst[p, h]),
        )
        for p, h in np.argwhere(gross & ~kept)
    )
    return _without(table, ~kept & gross), found


def _polished(errors: FloatArray) -> FloatArray:
    left = errors.copy()
    P, H, _ = errors.shape
    if P == 1 or H == 1:
        return left - np.nanmedian(left, axis=(0, 1), keepdims=True)
    for _ in range(SWEEPS):
        left = left - np.nanmedian(left, axis=1, keepdims=True)
        left = left - np.nanmedian(left, axis=0, keepdims=True)
    return left


def _still_needed(kept: NDArray[np.bool_], gross: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Entries without which a part or a column would have none are kept."""
    bare_parts = ~np.asarray(kept.any(axis=1))[:, None]
    bare_columns = ~np.asarray(kept.any(axis=0))[None, :]
    found: NDArray[np.bool_] = gross & (bare_parts | bare_columns)
    return found


def _without(table: ResidualTable, aside: NDArray[np.bool_]) -> ResidualTable:
    errors = np.where(aside[:, :, None], np.nan, table.errors)
    return replace(table, errors=errors, repeats=np.where(aside, 0, table.repeats))
