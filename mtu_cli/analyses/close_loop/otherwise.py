"""What an effect would be if one that it hides, or that hides it, stood beside it.

Where a growth far from 20 degC was found alone, its u holds if there is no scale at 20 degC; and
where a scale was, far from 20 degC and at nearly one temperature, it holds if there is no growth.
That none was told is no proof of it: both are given as they would be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.describe import Described
from mtu_cli.analyses.close_loop.result import FoundEffect, Otherwise
from mtu_cli.analyses.close_loop.same_in_all import Constant, constants
from mtu_cli.analyses.close_loop.varying import varying

MATTERS = 2.0
"""Times its u from which on what a constant would be beside a growth is told."""


def with_otherwise(told: Described, effects: Sequence[FoundEffect]) -> tuple[FoundEffect, ...]:
    """The effects of a search, each with what it hides (see `constants`) or is hidden by
    (`varying`).
    """
    known = {step.index for step in told.found.steps}
    members = told.found.members
    every = [own for own in constants(told.prepared, members) if own.hidden]
    every += varying(told.prepared, members)
    by_coefficient = {own.of: own for own in every if own.index not in known}
    found, first = [], 0
    for step, effect in zip(told.found.steps, effects, strict=True):
        count = len(told.prepared.members[step.member].columns) if step.member >= 0 else 0
        own = [
            _otherwise(told, effect, place, by_coefficient[first + place])
            for place in range(count)
            if first + place in by_coefficient
        ]
        first += count
        found.append(replace(effect, otherwise=tuple(o for o in own if _matters(effect, o))))
    return tuple(found)


def _matters(effect: FoundEffect, own: Otherwise) -> bool:
    """A growth far from 20 degC always hides a scale; a scale is hidden where growth is not told
    by what varies.
    """
    if effect.covariate is not None:
        return True
    (u,) = (u for name, _, _, u in effect.parameters if name == own.parameter[0])
    return own.parameter[3] > MATTERS * u


def _otherwise(told: Described, effect: FoundEffect, place: int, own: Constant) -> Otherwise:
    member = told.prepared.members[own.member]
    name, unit = member.parameters[0]
    parameter, own_unit, _, _ = effect.parameters[place]
    u = float(np.sqrt(max(own.covariance[own.of, own.of], 0.0)))
    return Otherwise(
        name=told.prepared.candidates[own.index].name,
        parameter=(parameter, own_unit, float(own.beta[own.of]), u),
        constant=(name, unit, own.value, own.u),
        p=own.p,
    )
