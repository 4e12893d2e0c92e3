"""What a search foretells of cells that it did not see: the mean over all that may be meant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.added import added, contribution
from mtu_cli.analyses.close_loop.folds import Identity, identity
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.search import Search, posterior_of, same_place
from mtu_cli.analyses.close_loop.state import State, Step
from mtu_cli.model.effect_library import Member
from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

LEAST = 0.02
"""Posterior below which an explanation is left out of the mean."""


def foretold(
    prepared: Prepared, found: Search, table: ResidualTable, whole: Mapping[Identity, Member]
) -> FloatArray:
    """Errors (P, H, A) of a whole `table`, of which the search saw some parts or columns.

    An effect that was found is one of several explanations. With m(S) the errors of effects S
    that are estimated together, S those found, and p_ic the posterior of explanation c in
    place i beside all others,

        m(S) + sum_i sum_c p_ic (m(S with c in place i) - m(S)):

    model averaging (Hoeting et al., Statistical Science 14 (1999) 382), place by place.
    Explanations are all candidates and, where an effect lies in the parts, drifts without a name,
    which foretell nothing of other parts, each as likely as the other before, and that there is
    nothing, as likely before as all candidates together. A field without a name stays as it is
    from part to part: the likeliest named curve foretells what it has in common with it, as the
    machine that is written does. Where nothing passed the gate there is one place still: what is
    left out makes a search the weaker, and where little speaks for an effect little is foretold
    of it. There are no more places than effects that passed: a machine would not get them.
    `whole` holds the members on all cells.
    """
    steps = tuple(step for step in found.steps if step.index < prepared.scan.tested)

    def said(*own: Step) -> FloatArray:
        effects = added(prepared, replace(found, steps=own))
        members = tuple(whole[_identity(prepared, m)] for m in effects.members)
        return contribution(effects, table, members)

    chosen = said(*steps)
    total = chosen.copy()
    for place in range(max(len(steps), 1)):
        before, after = steps[:place], steps[place + 1 :]
        own_place = steps[place] if steps else None
        for step, posterior in _explanations(prepared, (*before, *after), own_place):
            own = (*before, *after) if step is None else (*before, step, *after)
            total += posterior * (said(*own) - chosen)
    return total


def _explanations(
    prepared: Prepared, others: Sequence[Step], place: Step | None
) -> Iterator[tuple[Step | None, float]]:
    """Each explanation beside other effects as the step that it would be, None for all those
    that foretell nothing, with its posterior; in the place of an effect that passed, if one did.
    """
    scan, state = prepared.scan, State(prepared, None)
    for step in others:
        state.take_out(step)
    looked = state.look()
    scores = looked.log_bayes[: scan.tested].copy()
    scores[[i for i in state.done if i < scan.tested]] = -np.inf
    nothing = np.log(max(scan.tested, 1))
    drifts = looked.unnamed[: scan.frame.strata.shape[2]]
    if place is not None and place.member >= 0:
        drifts = np.where(same_place(scan, place)[: len(drifts)], drifts, -np.inf)
    posterior = posterior_of(np.concatenate([scores, [nothing], drifts]))
    yield None, float(posterior[scan.tested :].sum())
    for i in np.flatnonzero(posterior[: scan.tested] >= LEAST).tolist():
        member = int(looked.best[i]) if i < len(scan.columns) else -1
        yield (
            Step(
                index=i,
                member=member,
                p=1.0,
                log_bayes=float(scores[i]),
                posterior=float(posterior[i]),
                credible=(i,),
            ),
            float(posterior[i]),
        )


def _identity(prepared: Prepared, member: int) -> Identity:
    ends = np.cumsum([len(members) for members in prepared.scan.columns])
    family = int(np.searchsorted(ends, member, side="right"))
    return identity(prepared.candidates[family].name, prepared.members[member])
