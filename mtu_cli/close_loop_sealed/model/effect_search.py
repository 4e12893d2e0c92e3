"""Values of a searched parameter that its grid does not have: shorter ones, and those between."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_binding import filled, of_candidates, of_members
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate, Column, FloatArray, Member
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS, TableData
from mtu_cli.close_loop_sealed.model.effect_grid import shortest_of
from mtu_cli.close_loop_sealed.model.effect_lacks import NoMember
from mtu_cli.close_loop_sealed.model.effect_library import EffectLibrary
from mtu_cli.close_loop_sealed.model.effect_members import BoundTemplate
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable


@dataclass(frozen=True, slots=True, kw_only=True)
class Waves:
    """Members that repeat along an axis, for any period.

    `along` (1, H) or (P, H) are the places, `shortest` is the least period that the library
    speaks of, whatever the spacing of the data.
    """

    along: FloatArray
    shortest: float
    bound: BoundTemplate

    def columns(self, periods: FloatArray) -> tuple[Column, ...]:
        """Levers of the parameters by axis, each (G or 1, P or 1, H or 1) for G periods."""
        return self.bound.columns(periods)


def member_at(bound: BoundTemplate, value: float, names: Collection[str]) -> Member:
    """The member of one value of what is searched, with the parameters of these `names`."""
    searched = np.array([value])
    columns, tangent = bound.columns(searched), bound.tangent(searched)
    (member,) = bound.members(columns, tangent, searched, bound.checked_names())
    kept = [i for i, (name, _) in enumerate(member.parameters) if name in names]
    return member if len(kept) == len(member.parameters) else bound.narrowed(member, kept)


def searched_template(
    table: ResidualTable, library: EffectLibrary, candidate: Candidate, member: Member
) -> BoundTemplate | None:
    """What `member` is one value of, on a table; None where nothing is searched."""
    if len(member.searched) != 1:
        return None
    data = TableData.of(table)
    for family in library.families:
        if family.family.family != candidate.family:
            continue
        for binding in of_candidates(family, data):
            if filled(family.name, binding) != candidate.name:
                continue
            for template in family.templates:
                for bound in of_members(family, template, binding, data):
                    if isinstance(bound, str) or template.search is None:
                        continue
                    own = BoundTemplate(
                        family=family.family, template=template, binding=bound, data=data
                    )
                    if _holds(own, member):
                        return own
    return None


def _holds(own: BoundTemplate, member: Member) -> bool:
    """Whether a template has a member's parameters, and its covariate."""
    try:
        covariate = own.covariate(own.checked_names())
    except NoMember:
        return False
    return {*own.parameters()} >= {*member.parameters} and covariate == member.covariate


def waves_of(
    table: ResidualTable, library: EffectLibrary, candidate: Candidate, member: Member
) -> Waves | None:
    """What `member` is one period of; None where nothing periodic is searched along an axis."""
    if member.covariate is not None:
        return None
    bound = searched_template(table, library, candidate, member)
    return None if bound is None else _waves(bound)


def _waves(bound: BoundTemplate) -> Waves | None:
    search = bound.template.search
    if search is None or search.grid != "frequency" or search.of is None:
        return None
    name = filled(search.of, bound.binding)
    if name not in POSITIONS or name not in bound.data.values:
        return None
    along = bound.data.values[name]
    shortest = shortest_of(search, along)
    if not math.isfinite(shortest):
        return None
    return Waves(along=np.atleast_2d(along), shortest=shortest, bound=bound)
