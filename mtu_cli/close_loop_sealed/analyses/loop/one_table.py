"""The loop on one table: search, estimates, held-out scores, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.added import added, contribution
from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint, NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.classes import experiments
from mtu_cli.close_loop_sealed.analyses.loop.describe import (
    Described,
    floor_of,
    found_effects,
    joint_covariance,
)
from mtu_cli.close_loop_sealed.analyses.loop.detectable import minimum_detectable
from mtu_cli.close_loop_sealed.analyses.loop.fitted import refitted
from mtu_cli.close_loop_sealed.analyses.loop.fixed_point import fixed_points
from mtu_cli.close_loop_sealed.analyses.loop.held_out import (
    HeldOut,
    OfFold,
    fold_of,
    joined,
    of_fold,
    scores,
    splits_of,
)
from mtu_cli.close_loop_sealed.analyses.loop.left_mean import with_left
from mtu_cli.close_loop_sealed.analyses.loop.neutral_point import neutral_points
from mtu_cli.close_loop_sealed.analyses.loop.one_temperature import with_temperature
from mtu_cli.close_loop_sealed.analyses.loop.other_pitches import with_other_pitches
from mtu_cli.close_loop_sealed.analyses.loop.otherwise import with_otherwise
from mtu_cli.close_loop_sealed.analyses.loop.own_constant import owners_of, with_own_constants
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.analyses.loop.result import (
    FoundEffect,
    Judged,
    Scores,
    TableResult,
    Verdict,
)
from mtu_cli.close_loop_sealed.analyses.loop.rivals import Instead, all_instead, with_rivals
from mtu_cli.close_loop_sealed.analyses.loop.scan import calibrated
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.searched import Searched, searched
from mtu_cli.close_loop_sealed.analyses.loop.shape_profile import with_shapes
from mtu_cli.close_loop_sealed.analyses.loop.share_done import NOBODY, ShareDone
from mtu_cli.close_loop_sealed.analyses.loop.shown import is_lone
from mtu_cli.close_loop_sealed.analyses.loop.twofold import twofold
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, EffectLibrary
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.family_gate import Gate
from mtu_cli.close_loop_sealed.stats.loop_null import entry_variance
from mtu_cli.close_loop_sealed.stats.profile_ratio import NEVER
from mtu_cli.close_loop_sealed.stats.side_by_side import SideBySide
from mtu_cli.stats.least_squares import FloatArray

SAMPLES = 1999
LARGE = 20_000
"""Entries from which on the gate is drawn from fewer tables."""
SAMPLES_LARGE = 499


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """The result of a table with the covariance of its effects' parameters, internal units."""

    result: TableResult
    covariance: FloatArray


def loop_on(
    given: ResidualTable,
    candidates: Sequence[Candidate],
    library: EffectLibrary,
    *,
    alpha: float,
    most: int,
    seed: int,
    tell: ShareDone = NOBODY,
) -> LoopResult:
    """Closes the loop on one table at the family-wise rate `alpha`; `tell` hears what is done."""
    first, out = _all_searched(given, candidates, library, alpha, most, seed, tell)
    told, table, found = _told(first, out, library, seed), first.prepared.table, first.found
    scored, fired, twice = _scored(told, out, given), found.fired(alpha), twofold(told)
    described, others, covariance = _described(told, candidates, library, seed)
    result = TableResult(
        table=table,
        verdict=verdict_of(found, described, (*fired, *twice)),
        effects=described,
        candidates=_judged(first, candidates, alpha),
        checks=found.checks,
        fired=fired,
        nameless=told.nameless,
        twofold=twice,
        stopped=found.stopped,
        gross=first.gross,
        explained=scored.explained,
        before=scored.before,
        after=scored.after,
        in_sample_before=scored.in_sample_before,
        in_sample_after=scored.in_sample_after,
        held_out_by=None if out is None else out.by,
        held_out_with_gross=scored.with_gross,
        by_column=scored.by_column,
        folds=len(told.chosen),
        floor=floor_of(told.effects.prepared),
        fixed_points=_fixed_points(table, described, covariance, others),
        neutral_points=_neutral_points(table, described, covariance, others),
    )
    return LoopResult(result=with_left(result, told, seed), covariance=covariance)


def _all_searched(
    given: ResidualTable,
    candidates: Sequence[Candidate],
    library: EffectLibrary,
    alpha: float,
    most: int,
    seed: int,
    tell: ShareDone,
) -> tuple[Searched, HeldOut | None]:
    """What is found in the table, and in its folds meanwhile."""
    splits = splits_of(given)
    steps = 1 + len(splits)

    def of_split(i: int) -> OfFold:
        fold = fold_of(given, candidates, splits[i], seed, given.pass_dof)
        return of_fold(given, fold, library, alpha=alpha, most=most)

    with SideBySide(of_split, len(splits)) as folds:
        first = _searched(given, candidates, alpha, most, seed)
        tell(1, steps)
        return first, joined(given, splits, folds.results(lambda done: tell(1 + done, steps)))


def _fixed_points(
    table: ResidualTable,
    effects: Sequence[FoundEffect],
    covariance: FloatArray,
    others: Sequence[Instead],
) -> tuple[FixedPoint, ...]:
    """Those of the effects as found, then those that a rival in the place of one would give."""
    found = [fixed_points(table, effects, covariance)]
    found += [fixed_points(table, x.effects, x.covariance, instead=x.place) for x in others]
    return tuple(point for points in found for point in points)


def _neutral_points(
    table: ResidualTable,
    effects: Sequence[FoundEffect],
    covariance: FloatArray,
    others: Sequence[Instead],
) -> tuple[NeutralPoint, ...]:
    """The same, in a temperature."""
    found = [neutral_points(table, effects, covariance)]
    found += [neutral_points(table, x.effects, x.covariance, instead=x.place) for x in others]
    return tuple(point for points in found for point in points)


def _told(first: Searched, out: HeldOut | None, library: EffectLibrary, seed: int) -> Described:
    owners = owners_of(first.prepared, first.found)
    values = searched_members(first.prepared, first.found, library)
    told = Described(
        prepared=first.prepared,
        found=first.found,
        effects=added(first.prepared, first.found, seed, owners=owners, values=values),
        chosen=() if out is None else out.chosen,
    )
    return with_refined(told, library, seed, owners)


def _described(
    told: Described, candidates: Sequence[Candidate], library: EffectLibrary, seed: int
) -> tuple[tuple[FoundEffect, ...], tuple[Instead, ...], FloatArray]:
    """The effects found, with their rivals; what each rival would be in their place; and the
    joint covariance.
    """
    planned = experiments(told.effects, told.found, library=library)
    shaped = with_shapes(told, found_effects(told, planned), library)
    alone = with_other_pitches(told, shaped, library)
    others = all_instead(told, alone, library, seed)
    found = with_otherwise(told, with_rivals(alone, others))
    return with_temperature(told, found, candidates), others, joint_covariance(told)


def _searched(
    given: ResidualTable, candidates: Sequence[Candidate], alpha: float, most: int, seed: int
) -> Searched:
    samples = SAMPLES_LARGE if given.errors.size > LARGE else SAMPLES

    def start(table: ResidualTable) -> tuple[Prepared, Gate]:
        left = refitted(table) if not np.array_equal(table.there, given.there) else table
        prepared = prepare(left, candidates, given.pass_dof)
        return prepared, calibrated(prepared.scan, samples, seed)

    first = searched(given, start, alpha=alpha, most=most, seed=seed)
    return with_own_constants(first)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scored:
    explained: FloatArray
    before: Scores
    after: Scores
    in_sample_before: Scores
    in_sample_after: Scores
    with_gross: tuple[Scores, Scores] | None
    by_column: Scores | None


def _scored(told: Described, out: HeldOut | None, given: ResidualTable) -> _Scored:
    """Scores held out where they can be had, and in sample; of what was not set aside, for one
    slip of the pen outweighs all else.
    """
    prepared, effects = told.prepared, told.effects
    table = prepared.table
    members = tuple(prepared.members[m] for m in effects.members)
    explained = contribution(effects, table, members)
    strata = prepared.scan.frame.strata
    left = entry_variance(effects.prepared.scan.null, strata)
    before = scores(table.errors, table.axes, left)
    after = scores(table.errors - explained, table.axes, left)
    whole = None if out is None else _held_out_scores(told, out)
    kept = None if out is None else _held_out_scores(told, out, table.there)
    return _Scored(
        explained=explained,
        before=before if kept is None else kept[0],
        after=after if kept is None else kept[1],
        in_sample_before=before,
        in_sample_after=after,
        with_gross=whole if (given.there & ~table.there).any() else None,
        by_column=None if out is None else _by_column(table, out),
    )


def _by_column(table: ResidualTable, out: HeldOut) -> Scores | None:
    if out.by_column is None:
        return None
    own = np.where(table.there[:, :, None], out.by_column, np.nan)
    return scores(own, table.axes, out.variance)


def _held_out_scores(
    told: Described, out: HeldOut, cells: NDArray[np.bool_] | None = None
) -> tuple[Scores, Scores]:
    """Before and after, of the `cells` (P, H) alone if given.

    Of a machine that gets no equation the errors stay as they are, whatever folds foretell.
    """
    axes = told.prepared.table.axes

    def scored(left: FloatArray) -> Scores:
        own = left if cells is None else np.where(cells[:, :, None], left, np.nan)
        return scores(own, axes, out.variance)

    return scored(out.before), scored(out.before if told.effects.fit is None else out.after)


def verdict_of(found: Search, effects: Sequence[FoundEffect], fired: Sequence[str]) -> Verdict:
    if fired or found.without_name or any(effect.of_one_axis for effect in effects):
        return "unexplained"
    if not effects:
        return "none"
    return "named" if all(map(is_lone, effects)) else "class"


def _judged(first: Searched, candidates: Sequence[Candidate], alpha: float) -> tuple[Judged, ...]:
    """Every candidate of the library as the first look judged it."""
    prepared, found = first.prepared, first.found
    index = {candidate.name: i for i, candidate in enumerate(prepared.candidates)}
    smallest = minimum_detectable(prepared, first.gate, found, alpha)
    judged = []
    for candidate in candidates:
        i = index.get(candidate.name)
        if i is not None and found.log_bayes[i] <= NEVER:
            i = None
        seen = i is not None
        reason = candidate.unavailable or (None if seen else "this data cannot tell it apart")
        judged.append(
            Judged(
                name=candidate.name,
                family=candidate.family,
                component=prepared.table.component,
                p_familywise=float(found.p[i]) if i is not None else None,
                log_bayes_factor=float(found.log_bayes[i]) if i is not None else None,
                posterior=float(found.posterior[i]) if i is not None else None,
                minimum_detectable=smallest.get(candidate.name) if seen else None,
                unavailable=reason,
                notes=candidate.notes,
            )
        )
    return tuple(judged)
