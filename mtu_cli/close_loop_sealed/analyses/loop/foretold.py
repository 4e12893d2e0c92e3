"""What a search foretells of cells that it did not see: the mean over all that may be meant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.analyses.loop.added import added, contribution
from mtu_cli.close_loop_sealed.analyses.loop.evidence import Evidence
from mtu_cli.close_loop_sealed.analyses.loop.folds import Identity, identity
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.ranking import posterior_of
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.state import State, Step
from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.loop_null import entry_variance
from mtu_cli.close_loop_sealed.stats.size_prior import sized
from mtu_cli.stats.least_squares import FloatArray

LEAST = 0.001
"""Posterior below which an explanation is left out of the mean."""
Whole = Mapping[Identity, Member]
Weights = Mapping[Identity, float]


def foretold(
    prepared: Prepared, found: Search, table: ResidualTable, whole: Whole, weights: Weights
) -> FloatArray:
    """Errors (P, H, A) of a whole `table`, of which the search saw some parts or columns.

    An effect that was found is one of several explanations, each of them one candidate with one
    value of what it searches. With m(S) the errors of effects S that are estimated together, S
    those found, S_i these without that in place i, p_ic the posterior of explanation c in place
    i beside all others, and h_ic the share of its estimate that is believed,

        m(S) + sum_i (m(S_i) - m(S) + sum_c p_ic h_ic (m(S_i with c) - m(S_i))):

    model averaging (Hoeting et al., Statistical Science 14 (1999) 382), place by place. The
    candidates are equally likely before, the values of each go by `weights` (`shape_prior`), and
    the size of each on all cells is of the order of the scatter of one entry in the null of this
    table (beside parts and columns), with long tails (`size_prior`). That there is nothing is
    one explanation more where an effect passed the gate. Where none did there is one place
    still, for what is left out makes a search the weaker: nothing is then as likely before as
    all candidates together, and a mean error that passed stays: a level is not yet a cause. There
    are no more places than effects that passed, and no drifts and fields without a name: a
    machine would not get them. `whole` holds the members on all cells.
    """
    steps = tuple(step for step in found.steps if step.index < prepared.scan.tested)
    all_cells = _before(prepared, whole, weights)

    def said(*own: Step) -> FloatArray:
        effects = added(prepared, replace(found, steps=own), rough=True)
        return contribution(effects, table, tuple(all_cells.whole[m] for m in effects.members))

    chosen = said(*steps)
    total = chosen.copy()
    places = [i for i, step in enumerate(steps) if step.member >= 0]
    for place in places or [len(steps)]:
        before, after = steps[:place], steps[place + 1 :]
        without = said(*before, *after)
        total += without - chosen
        explanations = _explanations(prepared, (*before, *after), bool(places), all_cells)
        for explained in explanations:
            total += explained.weight * (said(*before, explained.step, *after) - without)
    return total


@dataclass(frozen=True, slots=True, kw_only=True)
class _Explained:
    """An explanation as the `step` that it would be; `weight`: posterior times share believed."""

    step: Step
    weight: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Before:
    """What is thought of M members before: each on all cells (`whole`), its `family`, the number
    of its `columns`, the scale `tau` of its coefficients, and its `weight` in its family.
    """

    whole: tuple[Member, ...]
    family: NDArray[np.int64]
    columns: FloatArray
    tau: FloatArray
    weight: FloatArray


def _before(prepared: Prepared, whole: Whole, weights: Weights) -> _Before:
    counts = [len(own) for own in prepared.scan.columns]
    family = np.repeat(np.arange(len(counts)), counts)
    owners = [prepared.candidates[f].name for f in family.tolist()]
    names = [identity(name, m) for name, m in zip(owners, prepared.members, strict=True)]
    members = tuple(whole[name] for name in names)
    return _Before(
        whole=members,
        family=family,
        columns=np.array([len(member.columns) for member in prepared.members], float),
        tau=_scales(members, prepared.scan),
        weight=np.array([weights[name] for name in names]),
    )


def _explanations(
    prepared: Prepared, others: Sequence[Step], passed: bool, before: _Before
) -> Iterator[_Explained]:
    """Those beside other effects, in a place that an effect passed the gate for, or in none."""
    scan, state = prepared.scan, State(prepared, None)
    for step in others:
        state.take_out(step)
    looked = state.look()
    M, F, family = len(prepared.members), len(scan.columns), before.family
    members = sized(looked.members, before.columns, before.tau)
    weight = np.where(np.isfinite(members.log_bayes), before.weight, 0.0)
    share = np.bincount(family, weights=weight, minlength=F)[family]
    prior = np.full(M, -np.inf)
    np.log(np.divide(weight, share, where=weight > 0.0, out=weight), where=weight > 0.0, out=prior)
    offsets = np.full(scan.tested - F, -np.inf) if passed else _offsets(looked, scan, state)
    nothing = 0.0 if passed else np.log(max(scan.tested, 1))
    posterior = posterior_of(np.concatenate([members.log_bayes + prior, offsets, [nothing]]))
    for m in np.flatnonzero(posterior[:M] >= LEAST).tolist():
        step = _step(int(family[m]), m, posterior[m])
        yield _Explained(step=step, weight=float(posterior[m] * members.believed[m]))
    for i in np.flatnonzero(posterior[M:-1] >= LEAST).tolist():
        step = _step(F + i, -1, posterior[M + i])
        yield _Explained(step=step, weight=float(posterior[M + i]))


def _offsets(looked: Evidence, scan: Scan, state: State) -> FloatArray:
    """log Bayes factors of mean errors, beside those that are there. They are none of an effect
    that was found beside a free mean: either may act without the other.
    """
    found = looked.log_bayes[len(scan.columns) : scan.tested].copy()
    found[[i - len(scan.columns) for i in state.done if i < scan.tested]] = -np.inf
    return found


def _scales(members: Sequence[Member], scan: Scan) -> FloatArray:
    """The coefficients (M,) at which members are as large on all cells as the scatter of one
    entry.
    """
    variance = entry_variance(scan.null, scan.frame.strata)
    own = np.where(scan.null.interaction > 0, scan.null.interaction, variance)
    found = [
        np.mean(
            [
                float(np.var(values)) / max(float(own[axis]), 1e-300)
                for column in member.columns
                for axis, values in column.items()
            ]
        )
        for member in members
    ]
    scales: FloatArray = 1 / np.sqrt(np.maximum(found, 1e-300))
    return scales


def _step(index: int, member: int, posterior: float) -> Step:
    return Step(
        index=index,
        member=member,
        p=1.0,
        log_bayes=0.0,
        posterior=float(posterior),
        credible=(index,),
    )
