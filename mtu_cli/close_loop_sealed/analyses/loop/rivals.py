"""The other effects of a small class, each estimated in the place of the one that was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from mtu_cli.close_loop_sealed.analyses.loop.added import added
from mtu_cli.close_loop_sealed.analyses.loop.classes import class_of
from mtu_cli.close_loop_sealed.analyses.loop.describe import (
    Described,
    found_effects,
    joint_covariance,
)
from mtu_cli.close_loop_sealed.analyses.loop.other_pitches import with_other_pitches
from mtu_cli.close_loop_sealed.analyses.loop.own_constant import owners_of
from mtu_cli.close_loop_sealed.analyses.loop.refined import searched_members, with_refined
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.shape_profile import with_shapes
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary
from mtu_cli.stats.least_squares import FloatArray

MOST = 4
"""Effects of a class that are estimated, the likeliest: a reader compares no more."""
OTHER = 1.0
"""Standard uncertainties by which the size of another effect changes where it is another one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instead:
    """The `effects` of a table with the one at `place` taken for a rival of it, and the joint
    `covariance` of all their parameters, internal units.
    """

    place: int
    effects: tuple[FoundEffect, ...]
    covariance: FloatArray

    @property
    def rival(self) -> FoundEffect:
        """What the effect at `place` was taken for."""
        return self.effects[self.place]


def all_instead(
    told: Described,
    effects: Sequence[FoundEffect],
    library: EffectLibrary,
    seed: int | None = None,
) -> tuple[Instead, ...]:
    """The likeliest rivals of each effect, the first of them first, `MOST` with itself.

    Those that change the mean: a drift or field without a name has no parameters.
    """
    found = []
    for place, (step, effect) in enumerate(zip(told.found.steps, effects, strict=True)):
        if step.member >= 0 and len(effect.candidates) > 1:
            likeliest = islice(_rivals(told, step), MOST - 1)
            found += [_instead(told, place, rival, library, seed) for rival in likeliest]
    return tuple(found)


def with_rivals(
    effects: Sequence[FoundEffect], others: Sequence[Instead]
) -> tuple[FoundEffect, ...]:
    """The effects, each with its rivals, and those with the offsets of their axes that are told
    from 0 beside what was found, and are not beside them, and with the other effects that have
    another size beside them.
    """
    return tuple(
        replace(effect, rivals=tuple(_rival(own, effects) for own in others if own.place == place))
        for place, effect in enumerate(effects)
    )


def _rival(other: Instead, effects: Sequence[FoundEffect]) -> FoundEffect:
    pairs = [(a, b) for a, b in zip(effects, other.effects, strict=True) if b is not other.rival]
    along = other.rival.equations.keys()
    gone = [
        a.name
        for a, b in pairs
        if a.kind == "offset" and b.equations.keys() <= along and _is_told(a) and not _is_told(b)
    ]
    changed = (b for a, b in pairs if a.name not in gone and _has_other_size(a, b))
    return replace(other.rival, without=tuple(gone), changed=tuple(changed))


def _has_other_size(own: FoundEffect, other: FoundEffect) -> bool:
    """Whether one effect has another size where another one stands for a third: of a wave at
    another pitch, or what starts elsewhere, that is no matter of size.
    """
    if len(own.sizes) != 1 or own.searched or own.kind == "offset":
        return False
    (_, _, value, u), (_, _, beside, _) = own.sizes[0], other.sizes[0]
    return abs(beside - value) > OTHER * u


def _is_told(offset: FoundEffect) -> bool:
    """Whether its 95 % interval tells it from 0."""
    return not offset.intervals[0][0] < 0 < offset.intervals[0][1]


def _rivals(told: Described, step: Step) -> Iterator[Step]:
    """The step with the best member of each rival, beside all other effects."""
    taken = {other.index for other in told.found.steps}
    members = class_of(told.effects.prepared, told.found, step).members
    for index, member in members.items():
        if index not in taken:
            yield replace(step, index=index, member=member)


def _instead(
    told: Described, place: int, rival: Step, library: EffectLibrary, seed: int | None
) -> Instead:
    """A rival gets the offset that was taken for the constant of the effect."""
    steps = list(told.found.steps)
    steps[place] = rival
    found = replace(told.found, steps=tuple(steps))
    members = [told.prepared.members[m] for m in found.members]
    owners = {
        axis: at
        for axis, at in owners_of(told.prepared, told.found).items()
        if any(axis in column for column in members[at].columns)
    }
    values = searched_members(told.prepared, found, library)
    effects = added(told.prepared, found, seed, owners=owners, values=values)
    other = replace(told, found=found, effects=effects)
    other = with_refined(other, library, seed, owners)
    alone = with_shapes(other, found_effects(other, [None] * len(steps)), library)
    return Instead(
        place=place,
        effects=with_other_pitches(other, alone, library),
        covariance=joint_covariance(other),
    )
