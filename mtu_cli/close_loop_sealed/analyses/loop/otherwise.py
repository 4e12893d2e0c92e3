"""What an effect would be if one that it hides, or that hides it, stood beside it.

Where a growth far from 20 degC was found alone, its u holds if there is no scale at 20 degC; and
where a scale was, far from 20 degC and at nearly one temperature, it holds if there is no growth.
That of wear against the direction of approach holds if no motion was lost when the tool was new.
That none was told is no proof of it: both are given as they would be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect, Otherwise
from mtu_cli.close_loop_sealed.analyses.loop.same_in_all import Constant, beside_all, constants
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.analyses.loop.two_forms import hidden_in
from mtu_cli.close_loop_sealed.analyses.loop.varying import (
    THERMAL,
    AtReference,
    at_reference,
    level_at_reference,
)
from mtu_cli.language import names, parse

MATTERS = 2.0
"""Times its u at the mean temperature from which on what an effect would be at 20 degC is told."""
DOUBTED = 0.05
"""p of no effect of a temperature below which it is told if it would differ by more than its u."""


def with_otherwise(told: Described, effects: Sequence[FoundEffect]) -> tuple[FoundEffect, ...]:
    """The effects of a search, each with what it hides (see `constants`), or with what it is at
    20 degC beside an effect of a temperature (see `at_reference`).
    """
    steps = told.found.steps
    known = {step.index for step in steps}
    every = [*constants(told.prepared, told.found.members), *_of_other_forms(told)]
    by_coefficient = {own.of: own for own in every if own.hidden and own.index not in known}
    found, first = [], 0
    for step, effect in zip(steps, effects, strict=True):
        count = len(told.prepared.members[step.member].columns) if step.member >= 0 else 0
        own = [
            _beside_constant(told, effect, place, by_coefficient[first + place])
            for place in range(count)
            if first + place in by_coefficient
        ]
        first += count
        news = [o for o in own if o.p < DOUBTED or o.parameter[3] > _u_of(effect, o.parameter[0])]
        found.append(replace(effect, otherwise=(*news, *_beside_thermal(told, step, effect))))
    return tuple(found)


def _of_other_forms(told: Described) -> Iterator[Constant]:
    """What effects differ by from another form of theirs (see `two_forms`), beside all of them; of
    those that grow with a place it is told elsewhere (see `growth_alone`).
    """
    prepared, members, first = told.prepared, told.found.members, 0
    for step in (own for own in told.found.steps if own.member >= 0):
        axis = prepared.candidates[step.index].axis
        texts = prepared.members[step.member].equations.values()
        own = None
        used = {name for text in texts for name in names(parse(text))}
        if axis is not None and used.isdisjoint(axis):
            own = hidden_in(prepared, step)
        found = None if own is None else beside_all(prepared, members, first, *own)
        if found is not None:
            yield replace(found, hidden=True)
        first += len(prepared.members[step.member].columns)


def _u_of(effect: FoundEffect, parameter: str) -> float:
    """Where it is no less certain beside a constant that is not likely there is nothing to tell."""
    return next(u for name, _, _, u in effect.parameters if name == parameter)


def _beside_constant(told: Described, effect: FoundEffect, place: int, own: Constant) -> Otherwise:
    parameter, unit, _, _ = effect.parameters[place]
    u = float(np.sqrt(max(own.covariance[own.of, own.of], 0.0)))
    return _otherwise(told, own, (parameter, unit, float(own.beta[own.of]), u), own.p)


def _beside_thermal(told: Described, step: Step, effect: FoundEffect) -> tuple[Otherwise, ...]:
    """Where it, or a level that it owns, would be much less certain at 20 degC (`MATTERS`) than it
    is at the mean, or another (`DOUBTED`).
    """
    prepared, steps = told.prepared, told.found.steps
    if effect.component is not None:
        return ()
    found = []
    if len(effect.sizes) == 1:
        (size,) = effect.sizes
        found.append((size, at_reference(prepared, steps, step, size[2:])))
    if effect.levels and (effect.covariate is None or not effect.family.startswith(THERMAL)):
        levels = effect.parameters[len(effect.sizes) :]
        for level, letter in zip(levels, effect.levels, strict=True):
            axis = prepared.table.axes.index(letter)
            found.append((level, level_at_reference(prepared, steps, axis, level[2:])))
    return tuple(
        replace(
            _otherwise(told, own.constant, (name, unit, own.value, own.u), own.p),
            at_reference=True,
        )
        for (name, unit, value, u), own in found
        if own is not None and _matters(own, value, u)
    )


def _matters(own: AtReference, value: float, u: float) -> bool:
    differs = own.p < DOUBTED and abs(own.value - value) > u
    return own.u > MATTERS * u or differs


def _otherwise(
    told: Described, own: Constant, parameter: tuple[str, str, float, float], p: float
) -> Otherwise:
    member = told.prepared.members[own.member]
    name, unit = member.parameters[0]
    return Otherwise(
        name=told.prepared.candidates[own.index].name,
        parameter=parameter,
        constant=(name, unit, own.value, own.u),
        covariate=member.covariate,
        p=p,
    )
