"""The follow-up that tells the effects of a class apart best.

T-optimality (Atkinson & Fedorov, Biometrika 62 (1975) 57): each effect of the class in turn is
taken for the truth, as fitted, and a follow-up is worth what the best of its rivals, fitted
anew, leaves of it: z^2 (1 - max R^2), averaged over the posterior. Of that the part counts that
the data so far do not hold: what they tell is in the posterior already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.follow_up import MORE, as_it_is, follow_ups
from mtu_cli.close_loop_sealed.analyses.loop.further_parts import FollowUp
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.result import Experiment
from mtu_cli.close_loop_sealed.analyses.loop.rivalry import Rivalry
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary, effect_library
from mtu_cli.stats.least_squares import FloatArray

ALIAS = 0.999
"""Share of an effect that a rival holds, from which on they are the same."""
WORTH = 1.05
"""A follow-up must be so many times better than an easier one to be chosen before it."""
NO_RIVALS = "fewer than two effects of the class change the mean"
SAME = "the effects are the same on these points, and after every follow-up that is known"
NO_NOISE = "the data leave no scatter to measure a separation by"


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The `experiment`, or the `reason` why there is none; `separations` (name of the follow-up,
    d with the data so far) of all that were compared, more of the same first.
    """

    experiment: Experiment | None
    reason: str | None
    separations: tuple[tuple[str, float], ...] = ()


def choice(
    prepared: Prepared,
    beta_by_candidate: Mapping[int, FloatArray],
    posterior: Mapping[int, float],
    class_members: Mapping[int, int],
    *,
    beside: Sequence[int] = (),
    library: EffectLibrary | None = None,
    count: int = MORE,
) -> Choice:
    """Compares all follow-ups of `count` further parts for a class of candidates.

    By index among `prepared.candidates`: the best member (among `prepared.members`) of each of
    the class, its coefficients (k,) in internal units, and its posterior. `beside` are members
    of other effects that were found. The null of `prepared` should be that of what the effects
    leave; it is taken to hold for the further parts. `library` (the built-in one if not given)
    tells what else the rivals could be after a follow-up.
    """
    members = {i: m for i, m in class_members.items() if i < len(prepared.scan.columns)}
    if len(members) < 2:
        return Choice(experiment=None, reason=NO_RIVALS)
    if not (prepared.scan.null.interaction > 0).any():
        return Choice(experiment=None, reason=NO_NOISE)
    rivalry = Rivalry(
        prepared, beta_by_candidate, posterior, members, tuple(beside), library or effect_library()
    )
    now = rivalry.separation(as_it_is(prepared.table))
    plans = follow_ups(prepared.table, rivalry.wanted(), count)
    found = [rivalry.separation(plan) for plan in plans]
    told = tuple((plan.name, value.d) for plan, value in zip(plans, found, strict=True))
    if all(value.share < 1 - ALIAS for value in (now, *found)):
        return Choice(experiment=None, reason=SAME, separations=told)
    gained = [max(value.square - now.square, 0.0) for value in found]
    best = _easiest_of_the_best(gained)
    do = _words(plans[best], plans, rivalry.candidates())
    further = float(np.sqrt(gained[best]))
    experiment = Experiment(do=do, predicted_d=found[best].d, now_d=now.d, further_d=further)
    return Choice(experiment=experiment, reason=None, separations=told)


def _easiest_of_the_best(squares: Sequence[float]) -> int:
    """The first, but for those that are well better than all before that were chosen."""
    best = 0
    for i, square in enumerate(squares):
        if square > WORTH * squares[best]:
            best = i
    return best


def _words(plan: FollowUp, plans: Sequence[FollowUp], candidates: Sequence[Candidate]) -> str:
    """What to do: in the words of the library where they say this experiment and no other."""
    others = [p.fits for p in plans if p.fits and p.fits != plan.fits]
    fitting = [
        candidate.separates
        for candidate in candidates
        if candidate.separates and plan.fits and plan.fits in candidate.separates
    ]
    own = [text for text in fitting if not any(phrase in text for phrase in others)]
    if not own and plan.name == "more":
        return plan.words
    predicted = f"predicted for {plan.count} more {plan.noun}"
    if not own:
        return f"{plan.words} ({predicted})"
    return f"{own[0]} ({plan.detail}; {predicted})" if plan.detail else f"{own[0]} ({predicted})"
