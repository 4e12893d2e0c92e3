"""The classes of a search with their effects as fitted, and the experiment for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.added import Added
from mtu_cli.close_loop_sealed.analyses.loop.estimate import estimate, raw_design
from mtu_cli.close_loop_sealed.analyses.loop.experiment import ALIAS, NO_RIVALS, Choice, choice
from mtu_cli.close_loop_sealed.analyses.loop.follow_up import as_it_is
from mtu_cli.close_loop_sealed.analyses.loop.one_size import of_no_size
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, without_rounding
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.separation import sight_of
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary
from mtu_cli.close_loop_sealed.stats.profile_ratio import member_ratios, ratios
from mtu_cli.stats.least_squares import FloatArray

MOST = 6
"""Effects of a class that an experiment is sought for, the most probable ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectClass:
    """Candidates (by index) that explain the same: their best `members`, coefficients and
    posterior, beside the effects `beside` (members) that were found as well.
    """

    members: dict[int, int]
    beta: dict[int, FloatArray]
    posterior: dict[int, float]
    beside: tuple[int, ...]


def experiments(
    effects: Added,
    found: Search,
    *,
    library: EffectLibrary | None = None,
) -> tuple[Choice, ...]:
    """For each effect of a search, in the order found, what would tell its class apart."""
    chosen = []
    for step in found.steps:
        if step.member < 0:
            chosen.append(Choice(experiment=None, reason=NO_RIVALS))
            continue
        own = class_of(effects.prepared, found, step)
        chosen.append(
            choice(
                effects.prepared,
                own.beta,
                own.posterior,
                own.members,
                beside=own.beside,
                library=library,
            )
        )
    return tuple(chosen)


def class_of(prepared: Prepared, found: Search, step: Step) -> EffectClass:
    """The credible set of a step that has columns, and, where it is alone, its aliases.

    Members and coefficients are the best beside all other effects of the search.
    """
    scan = prepared.scan
    F = len(scan.columns)
    beside = tuple(m for m in found.members if m != step.member)
    pack = scan.pack(prepared.with_tangents(beside))
    y, taken = prepared.y, prepared.whole(beside)
    if taken:
        # Beside the rest of an effect, what is minor of it is in strata that are not freed of it.
        design = raw_design(scan, taken)
        y = without_rounding(prepared.table, y - design @ estimate(scan, y, taken).beta)
    left = pack.without_found(y)[None]
    LR = member_ratios(pack, left).ratio[0]
    judged = ratios(pack, left, F)
    members = {i: int(judged.best[0, i]) for i in _first(step, F)}
    members[step.index] = step.member
    if len(members) == 1:
        for m in aliases_of(prepared, step, beside):
            family = int(pack.family[m])
            if family not in members or LR[m] > LR[members[family]]:
                members[family] = m
    members = {i: m for i, m in members.items() if m >= 0}
    beta = {}
    for i, m in members.items():
        (own,) = prepared.whole([m])
        beta[i] = estimate(scan, prepared.y, [*taken, own]).beta[-len(own) :]
    scores = np.array([judged.log_bayes[0, i] for i in members])
    weight = np.exp(scores - scores.max())
    posterior = dict(zip(members, (weight / weight.sum()).tolist(), strict=True))
    return EffectClass(members=members, beta=beta, posterior=posterior, beside=beside)


def _first(step: Step, columns: int) -> list[int]:
    """The step's own candidate and those that come nearest to it."""
    others = [i for i in step.credible if i < columns and i != step.index]
    return [step.index, *others[: MOST - 1]]


def aliases_of(prepared: Prepared, step: Step, beside: tuple[int, ...]) -> list[int]:
    """Members of other candidates that hold all columns of the step's, whatever the data say,
    beside the members `beside` that were found as well.
    """
    flat, own = prepared.flat(), prepared.members[step.member]
    sight = sight_of(prepared, as_it_is(prepared.table), beside)
    effects = dict(enumerate(sight.columns(own.columns)))
    whole = sight.left(effects)
    lies_in = {index for column in flat[step.member] for index in column}
    others, start = [], 0
    never = of_no_size(prepared, [step.member, *beside])
    for family, members in enumerate(prepared.scan.columns):
        owned = range(start, start + len(members))
        start += len(members)
        # A cause that was found as well is there in any case: two forms of it, which differ by
        # the step's column, do not stand for the step.
        if any(m in owned for m in beside):
            continue
        if family != step.index:
            others += [
                m for m in owned if m not in never and lies_in <= {i for c in flat[m] for i in c}
            ]
    found = []
    for m, columns in zip(
        others, sight.members(prepared.members[m].columns for m in others), strict=True
    ):
        left = sight.left(effects, columns)
        if all(left[j] < (1 - ALIAS) * whole[j] for j in effects):
            found.append(m)
    return found
