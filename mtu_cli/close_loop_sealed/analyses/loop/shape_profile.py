"""What the data say of a shape that was searched, such as a time constant, and of its size.

A grid finds a shape; its best value lies between two of those searched. The size goes with the
shape: a warm-up that is slower than the run is large by as much. What both may be is told by the
least squares over all shapes (profile likelihood), not by a linear u.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.estimate import (
    FLAT,
    raw_design,
    root_weights,
    whitened_design,
)
from mtu_cli.close_loop_sealed.analyses.loop.fitted import beside_polynomial
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import whole_with_tangents
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import Candidate, EffectLibrary, Member
from mtu_cli.close_loop_sealed.model.effect_members import BoundTemplate
from mtu_cli.close_loop_sealed.model.effect_search import searched_template
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns, whitened
from mtu_cli.close_loop_sealed.stats.loop_frame import grouped
from mtu_cli.stats.least_squares import FloatArray, beside

FINE = 16
"""Values looked at from one that was searched to the next: the likelihood is smooth there."""
BEYOND = 30.0
"""Times the longest value searched, and below the shortest: a straight line or a step to any run.
What the data support there they support farther on, too.
"""
ZOOMED, ZOOMS = 33, 3
"""Values about the best one, how often: to 1e-4 of a step, finer than any data tell."""
DIGITS = 7
BATCH_ENTRIES = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """Least squares for each of G `values` of a shape, beside all other effects: the `sizes` (G,),
    their standard uncertainties `u` (G,) if that were known to be the shape, and what is `left`
    (G,), chi^2.
    """

    values: FloatArray
    sizes: FloatArray
    u: FloatArray
    left: FloatArray


def is_shaped(member: Member) -> bool:
    """Whether it has one size and a shape that changes steadily with what was searched: not the
    part from which on something jumps, nor a wave, whose size is that of sine and cosine.
    """
    return len(member.searched) == 1 and len(member.columns) == 1 == len(member.tangent)


def shape_of(
    prepared: Prepared, step: Step, library: EffectLibrary
) -> tuple[BoundTemplate, FloatArray] | None:
    """What a member found is one shape of, and the values that were searched (G,); None where no
    shape was searched.
    """
    if step.member < 0 or not is_shaped(prepared.members[step.member]):
        return None
    candidate, member = prepared.candidates[step.index], prepared.members[step.member]
    bound = searched_template(prepared.table, library, candidate, member)
    if bound is None or bound.is_periodic:
        return None
    known = searched_values(candidate, member)
    return (bound, known) if len(known) > 1 else None


def searched_values(candidate: Candidate, member: Member) -> FloatArray:
    """All values that were searched with the covariate of a member, in their order (G,)."""
    (name,) = member.searched
    own = (m for m in candidate.members if m.covariate == member.covariate)
    return np.unique([m.searched[name] for m in own])


def best_shape(
    told: Described, step: Step, place: int, bound: BoundTemplate, known: FloatArray
) -> float:
    """The value that fits best between the first and the last of those searched; the one found
    where none is better by what the data see.
    """
    (found,) = told.prepared.members[step.member].searched.values()
    tried, best = np.union1d(_between(known), [found]), found
    for _ in range(1 + ZOOMS):
        profile = _profile(told, step, place, bound, tried)
        at = int(np.argmin(profile.left))
        best = float(profile.values[at])
        low, high = profile.values[max(at - 1, 0)], profile.values[min(at + 1, len(tried) - 1)]
        tried = np.union1d(np.linspace(low, high, ZOOMED), [best])
    better = float(-np.diff(_profile(told, step, place, bound, np.array([found, best])).left)[0])
    return float(f"{best:.{DIGITS}g}") if better >= FLAT else found


def with_shapes(
    told: Described, effects: Sequence[FoundEffect], library: EffectLibrary
) -> tuple[FoundEffect, ...]:
    """The effects, each that has a shape with the 95 % intervals of that and of its size, by the
    profile of the likelihood over what was searched and, of times and the like, beyond: what is
    slower than the run shows how fast it changes, and not how far. Such a size has no upper end.
    """
    found, place = [], 0
    for step, effect in zip(told.found.steps, effects, strict=True):
        own = shape_of(told.effects.prepared, step, library)
        found.append(effect if own is None else _with(told, step, place, effect, *own))
        place += step.member >= 0
    return tuple(found)


def _with(
    told: Described,
    step: Step,
    place: int,
    effect: FoundEffect,
    bound: BoundTemplate,
    known: FloatArray,
) -> FoundEffect:
    ((name, (value, _, _)),) = effect.searched.items()
    tried = np.concatenate([_between(known), _beyond(bound, known), [value]])
    profile = _profile(told, step, place, bound, np.unique(tried))
    dof = effect.intervals[0][2]
    # The shape is an estimate, too, and costs a degree of freedom.
    nu = max(dof - 1.0, 1.0)
    factor = _inflation(told, place) * max(dof / nu, 1.0)
    over = (profile.left - profile.left.min()) / factor
    bound2 = float(stdtrit(nu, 0.975)) ** 2
    inside = over <= bound2
    half = np.sqrt(factor * np.maximum(bound2 - over[inside], 0.0)) * profile.u[inside]
    lows, highs = profile.sizes[inside] - half, profile.sizes[inside] + half
    ends = [float(lows.min()), float(highs.max())]
    if inside[-1] and _is_open(bound):
        # What is slower still is larger still.
        ends = [-math.inf if lows[-1] < 0 else ends[0], math.inf if highs[-1] > 0 else ends[1]]
    low, high = _ends(profile.values, over, bound2, open_=_is_open(bound))
    return replace(
        effect,
        intervals=((ends[0], ends[1], dof), *effect.intervals[1:]),
        searched={name: (value, min(low, value), max(high, value))},
    )


def _inflation(told: Described, place: int) -> float:
    """Of the variance of an effect's size of a known shape: by how much it is larger than by the
    weights alone.
    """
    own, effects = told.effects.coefficients(place)[0], told.effects
    at_weights = 0.0 if effects.fit is None else float(effects.fit.at_weights[own, own])
    return max(float(effects.of_shapes[own, own]) / at_weights, 1.0) if at_weights > 0 else 1.0


def _ends(
    values: FloatArray, over: FloatArray, bound2: float, *, open_: bool
) -> tuple[float, float]:
    """Where the profile passes what bounds a 95 % interval. Where it does not, 0 and no upper end
    of what is `open_`, else the ends of what was searched.
    """
    inside = np.flatnonzero(over <= bound2)
    first, last = int(inside[0]), int(inside[-1])
    low, high = (0.0, math.inf) if open_ else (float(values[0]), float(values[-1]))
    if first > 0:
        low = float(np.interp(bound2, over[[first, first - 1]], values[[first, first - 1]]))
    if last < len(values) - 1:
        high = float(np.interp(bound2, over[[last, last + 1]], values[[last, last + 1]]))
    return low, high


def _between(known: FloatArray) -> FloatArray:
    """The values searched, and some between each two of them."""
    steps = np.linspace(0.0, len(known) - 1.0, FINE * (len(known) - 1) + 1)
    return np.interp(steps, np.arange(len(known)), known)


def _is_open(bound: BoundTemplate) -> bool:
    """Whether what was searched is of any size, such as a time: its grid is one of factors."""
    return bound.template.search is not None and bound.template.search.grid == "log"


def _beyond(bound: BoundTemplate, known: FloatArray) -> FloatArray:
    """Values below and beyond those searched, in equal steps of their logarithm."""
    if not _is_open(bound):
        return np.zeros(0)
    ratio = float(known[-1] / known[-2]) ** (1 / FINE)
    steps = ratio ** np.arange(1.0, math.ceil(math.log(BEYOND) / math.log(ratio)) + 1.0)
    return np.concatenate([known[0] / steps, known[-1] * steps])


def _profile(
    told: Described, step: Step, place: int, bound: BoundTemplate, values: FloatArray
) -> Profile:
    """By the weights of the effects' own estimate."""
    prepared, effects = told.effects.prepared, told.effects
    scan, strata = prepared.scan, prepared.scan.frame.strata
    weights = np.ones(len(scan.dof)) if effects.fit is None else effects.fit.weights
    root = root_weights(strata, weights)[:, None]
    others = [m for i, m in enumerate(effects.members) if i != place]
    X = root * whitened_design(scan, whole_with_tangents(prepared, others))
    y = root * whitened(strata, scan.whitening, prepared.y)[:, None]
    count = max(1, BATCH_ENTRIES // max(strata.size, 1))
    found = []
    for first in range(0, len(values), count):
        shapes = _columns(prepared, step, bound, values[first : first + count])
        T = root * whitened(strata, scan.whitening, raw_design(scan, shapes))
        R = beside(np.concatenate([X, T, y], axis=1), X.shape[1])
        own, of_y = R[:, :-1], R[:, -1:]
        squares = np.maximum((own**2).sum(axis=0), math.ulp(1.0))
        size = (own * of_y).sum(axis=0) / squares
        left = (of_y**2).sum() - squares * size**2
        found.append(np.stack([size, 1 / np.sqrt(squares), left]))
    sizes, u, left = np.concatenate(found, axis=1)
    return Profile(values=values, sizes=sizes, u=u, left=left)


def _columns(
    prepared: Prepared, step: Step, bound: BoundTemplate, values: FloatArray
) -> list[MemberColumns]:
    """The coordinates of a shape at each of the values."""
    columns = bound.columns(values)
    members = bound.members(columns, bound.tangent(values), values, bound.checked_names())
    candidate = replace(prepared.candidates[step.index], members=tuple(members))
    (own,) = beside_polynomial(prepared.table, [candidate])
    return list(grouped(prepared.scan.frame.whole_columns, [m.columns for m in own.members]))
