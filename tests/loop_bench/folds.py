"""All folds of a table one after the other: for the sealed loop's tests, and to go with it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.held_out import (
    FOLDS,
    Fold,
    HeldOut,
    fold_of,
    joined,
    of_fold,
    splits_by,
    splits_of,
)
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, effect_library
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable

LIBRARY = effect_library()


def folds_of(
    table: ResidualTable,
    candidates: Sequence[Candidate],
    seed: int,
    pass_dof: float = np.inf,
    count: int = FOLDS,
    number: NDArray[np.int64] | None = None,
) -> tuple[Fold, ...]:
    """Those of `splits_of`; of `splits_by` where `number` (P,) tells the fold of each part."""
    splits = splits_of(table, count) if number is None else splits_by(table, number)
    return tuple(fold_of(table, candidates, split, seed, pass_dof) for split in splits)


def held_out(
    table: ResidualTable, folds: Sequence[Fold], *, alpha: float, most: int
) -> HeldOut | None:
    """Searches every fold's kept part of `table` and scores all that it left out, gross entries
    too; None without folds.
    """
    found = [of_fold(table, fold, LIBRARY, alpha=alpha, most=most) for fold in folds]
    return joined(table, [fold.split for fold in folds], found)
