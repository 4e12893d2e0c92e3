"""Before and after on data that took no part: the whole search, without it, again.

`after` scores what the search without the held-out data foretells of them, the mean over all
explanations by their posterior (`foretold`): a single one would be scored as if it were certain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added
from mtu_cli.close_loop_sealed.analyses.loop.folds import (
    CutCandidates,
    Split,
    cut_candidates,
)
from mtu_cli.close_loop_sealed.analyses.loop.foretold import foretold
from mtu_cli.close_loop_sealed.analyses.loop.gross import set_aside
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.refined import with_refined_of_fold
from mtu_cli.close_loop_sealed.analyses.loop.result import Scores
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.searched import searched
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, EffectLibrary
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.close_loop_sealed.stats.loop_null import entry_variance
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray

FOLDS = 7
FEWEST_PARTS = 4
FEWEST_COLUMNS = 10
SAMPLES = 599
LARGE, SAMPLES_LARGE = 20_000, 199
"""Entries from which on a fold's gate is drawn from fewer tables."""


@dataclass(frozen=True, kw_only=True)
class Fold:
    """A split with the preparation and gate of what it keeps, that serve all data of the same
    design; `cut` its candidates.
    """

    split: Split
    cut: CutCandidates
    prepared: Prepared
    gate: Gate


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Residuals (P, H, A) of held-out cells before and after what is foretold without them, and
    `chosen` the names that passed the gate in each fold. `by_column` is `after` less the mean of
    what the other folds leave at each column, gross entries apart: what a correction for each
    would leave; None where columns are held out.
    """

    before: FloatArray
    after: FloatArray
    by_column: FloatArray | None
    variance: FloatArray
    chosen: tuple[frozenset[str], ...]
    by: str


def splits_of(table: ResidualTable, count: int = FOLDS) -> tuple[Split, ...]:
    """Blocks of consecutive parts, so that drifts do not leak; of few parts, every n-th column.

    Empty where there are too few of both.
    """
    P, H = table.there.shape
    if P >= FEWEST_PARTS:
        count = min(count, P)
        return splits_by(table, np.minimum(np.arange(P) * count // P, count - 1))
    if H >= FEWEST_COLUMNS:
        return splits_by(table, np.arange(H) % count, dimension=1)
    return ()


def splits_by(
    table: ResidualTable, number: NDArray[np.int64], dimension: int = 0
) -> tuple[Split, ...]:
    """`number` tells the fold of each part (P,), or of each column (H,) along dimension 1.

    Left out are folds without which a part or a column was never measured.
    """
    found = []
    for fold in range(int(number.max()) + 1):
        split = Split(dimension=dimension, kept=number != fold, stream=1 + fold)
        there = split.cut(table).there
        if there.any(axis=0).all() and there.any(axis=1).all():
            found.append(split)
    return tuple(found)


def fold_of(
    table: ResidualTable,
    candidates: Sequence[Candidate],
    split: Split,
    seed: int,
    pass_dof: float = np.inf,
) -> Fold:
    """The preparation of one split, to be used for every table of the same design. Gross entries of
    what is kept are set aside, fold by fold.
    """
    own = cut_candidates(candidates, split.kept, split.dimension)
    prepared = prepare(set_aside(split.cut(table))[0], own.candidates, pass_dof)
    samples = SAMPLES_LARGE if table.errors.size > LARGE else SAMPLES
    gate = calibrated(prepared.scan, samples, seed, split.stream)
    return Fold(split=split, cut=own, prepared=prepared, gate=gate)


def joined(
    table: ResidualTable, splits: Sequence[Split], found: Sequence[OfFold]
) -> HeldOut | None:
    """What the folds, in the order of their splits, say of all that they left out, gross entries
    too; None without folds.
    """
    if not splits:
        return None
    before = np.full(table.errors.shape, np.nan)
    after, variance, by_column = before.copy(), before.copy(), before.copy()
    of_parts = splits[0].dimension == 0
    for split, own in zip(splits, found, strict=True):
        out = ~split.kept
        place = (out,) if of_parts else (slice(None), out)
        left = table.errors - own.foretold
        before[place] = table.errors[place]
        after[place] = left[place]
        variance[place] = own.variance
        if of_parts:
            kept = np.where(own.there[:, :, None], left[split.kept], np.nan)
            by_column[out] = left[out] - np.nanmean(kept, axis=0)
    return HeldOut(
        before=before,
        after=after,
        by_column=by_column if of_parts else None,
        variance=variance,
        chosen=tuple(own.chosen for own in found),
        by="parts" if of_parts else "columns",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OfFold:
    """What a fold says of all cells: errors `foretold` (P, H, A), the `variance` (A,) of an
    entry beside what was found, and the names of what passed the gate. Of the cells that it keeps
    those are `there` that were measured and are not gross.
    """

    there: NDArray[np.bool_]
    foretold: FloatArray
    variance: FloatArray
    chosen: frozenset[str]


def of_fold(
    table: ResidualTable, fold: Fold, library: EffectLibrary, *, alpha: float, most: int
) -> OfFold:
    """Searches what a fold keeps of `table`; what it leaves out takes no part in anything."""

    def start(kept: ResidualTable) -> tuple[Prepared, Gate]:
        return fold.prepared.with_table(kept), fold.gate

    own = searched(fold.split.cut(table), start, alpha=alpha, most=most)
    found = own.found
    prepared, cut = with_refined_of_fold(own.prepared, found, table, fold.split, fold.cut, library)
    return OfFold(
        there=prepared.table.there,
        foretold=foretold(prepared, found, table, cut.whole, cut.weights),
        variance=_cell_variance(added(prepared, found), prepared.scan.frame.strata),
        chosen=frozenset(prepared.candidates[step.index].name for step in found.steps),
    )


def _cell_variance(effects: Added, strata: Strata) -> FloatArray:
    """Variance (A,) of one entry by the null of what the effects leave."""
    return entry_variance(effects.prepared.scan.null, strata)


def scores(errors: FloatArray, axes: Sequence[str], variance: FloatArray | None = None) -> Scores:
    """Scores of errors (P, H, A); cells that are nan do not count."""
    there = np.isfinite(errors).all(axis=2)
    own = errors[there]
    length = np.sqrt((own**2).sum(axis=1))
    chi2 = None
    if variance is not None:
        known = np.broadcast_to(variance, errors.shape)[there]
        if (known > 0).all():
            chi2 = float(np.mean(own**2 / known))
    return Scores(
        rms=float(np.sqrt(np.mean(own**2))),
        rms_by_axis={axis: float(np.sqrt(np.mean(own[:, i] ** 2))) for i, axis in enumerate(axes)},
        p95=float(np.quantile(length, 0.95)),
        largest=float(length.max()),
        chi2_per_dof=chi2,
    )
