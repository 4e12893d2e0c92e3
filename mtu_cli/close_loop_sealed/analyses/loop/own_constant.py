"""An offset that is only the constant of a drift: both are 0 at the temperature of the growth.

An axis that grows from a fixed point c as g (x - c) (T - T_r) shows, about the middle of places
and covariate, a growth, a drift g (x_0 - c) (T - T_0), and an offset g (x_0 - c) (T_0 - T_r). The
offset is no cause of its own. What it is off the drift's constant is within its uncertainty, and
stays as the drift's level: as an observation of the drift it would draw it towards an offset that
is too small to be told apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.searched import Searched
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.analyses.loop.straight_lines import (
    depended_on,
    extent,
    in_covariate,
    middle_and_rise,
)
from mtu_cli.close_loop_sealed.model.effect_candidate import CENTRED
from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.language import linear_form, parse

AGREES = 3.0
"""Standard uncertainties within which an offset is the constant of a drift: one in 400 such is
told apart by chance.
"""
DIGITS = 12
"""Of the value at which an equation is 0: rounding is less."""


@dataclass(frozen=True, slots=True)
class _Drift:
    """A step whose one parameter acts along `axis` alone as slope (T - start)."""

    step: Step
    axis: int
    slope: float
    start: float


def with_own_constants(first: Searched) -> Searched:
    """A search without each offset that agrees (`AGREES`) with what a drift found beside it has
    where the growth of its axis with the same covariate may be 0; that drift then starts there,
    and gets a level (`owners_of`). So does a drift along an axis without an offset: one too small
    to be found is no 0. No fold has that one, so that the held-out errors are without it.

    The coordinates of a member are free of its mean: data and gate stay as they are.
    """
    prepared, found = _joined(first.prepared, first.found)
    return replace(first, prepared=prepared, found=found)


def _joined(prepared: Prepared, found: Search) -> tuple[Prepared, Search]:
    """The drifts with the constants that are theirs, which the search is then without."""
    for index, axis in enumerate(prepared.scan.offsets, len(prepared.scan.columns)):
        pairs = tuple(_pairs(prepared, found, axis))
        beside = with_offset(prepared, found, index, axis) if pairs else None
        if beside is None:
            continue
        whole = added(prepared, beside)
        for drift, zero in pairs:
            if _agrees(whole, beside, drift, zero):
                prepared = _starting(prepared, drift, zero)
                found = replace(found, steps=tuple(s for s in found.steps if s.index != index))
                break
    return prepared, found


def with_offset(prepared: Prepared, found: Search, index: int, axis: int) -> Search | None:
    """The search with the offset `index` along an axis, found or not; None where it is the level
    of an effect that has a mean along that axis.
    """
    if any(step.index == index for step in found.steps):
        return found
    for m in found.members:
        if axis in prepared.members[m].centred:
            continue
        sizes = [np.sqrt(np.mean(c[axis] ** 2)) for c in prepared.members[m].columns if axis in c]
        if np.abs(prepared.means[m][:, axis]).max() > CENTRED * max(sizes, default=np.inf):
            return None
    step = Step(index=index, member=-1, p=1.0, log_bayes=0.0, posterior=0.0, credible=(index,))
    return replace(found, steps=(*found.steps, step))


def owners_of(prepared: Prepared, found: Search) -> dict[int, int]:
    """By axis, the place of the effect that was given an offset that was found: its level."""
    own = {id(member) for candidate in prepared.source for member in candidate.members}
    return {
        axis: place
        for place, index in enumerate(found.members)
        if id(prepared.members[index]) not in own
        for column in prepared.members[index].columns
        for axis in column
    }


def _pairs(prepared: Prepared, found: Search, axis: int) -> Iterator[tuple[_Drift, float]]:
    """Drifts along an axis, each with a value of the covariate at which its growth may be 0: that
    of the member found first, then those of others that are written of the same cause.
    """
    table = prepared.table
    steps = [s for s in found.steps if s.member >= 0 and table.component is None]
    for step in steps:
        member = prepared.members[step.member]
        drift = _drift(table, axis, step, member)
        if drift is None:
            continue
        for other in (s for s in steps if s is not step):
            own = prepared.members[other.member]
            if own.covariate != member.covariate or _zero(table, axis, own) is None:
                continue
            ways = (own, *prepared.candidates[other.index].members)
            zeros = [_zero(table, axis, m) for m in ways if m.covariate == member.covariate]
            yield from ((drift, zero) for zero in dict.fromkeys(zeros) if zero is not None)


def _drift(table: ResidualTable, axis: int, step: Step, member: Member) -> _Drift | None:
    letter, known = table.axes[axis], member.covariate
    if known is None or len(member.parameters) != 1 or set(member.equations) != {f"E{letter}"}:
        return None
    if _depends_on(member, letter) != {known}:
        return None
    constant, slope = _about_places(table, letter, member, known)
    if not slope[0] or slope[1]:
        return None
    return _Drift(step, axis, slope[0], -constant[0] / slope[0])


def _zero(table: ResidualTable, axis: int, member: Member) -> float | None:
    """Where in the covariate a growth along an axis is 0; None where a member is none."""
    letter, known = table.axes[axis], member.covariate
    text = member.equations.get(f"E{letter}")
    if known is None or text is None or len(member.parameters) != 1:
        return None
    if _depends_on(member, letter) != {letter, known}:
        return None
    (_, constant), (_, slope) = _about_places(table, letter, member, known)
    if not slope or np.isnan(slope) or np.isnan(constant):
        return None
    return float(f"{-constant / slope:.{DIGITS}g}") + 0.0


def _depends_on(member: Member, letter: str) -> set[str]:
    """What the equation along an axis depends on beside its parameters."""
    text = member.equations[f"E{letter}"]
    return depended_on(text, member.parameters)


def _about_places(
    table: ResidualTable, letter: str, member: Member, known: str
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Of constant and slope of the one lever in a covariate, each at the middle of the places
    along an axis and what it rises over half of them; nan where it is no straight line.
    """
    (name, _), *_ = member.parameters
    node = linear_form(parse(member.equations[f"E{letter}"]), [name]).coefficients[name]
    constant, slope = in_covariate(node, known, letter, *extent(table, letter))
    return middle_and_rise(constant), middle_and_rise(slope)


def _agrees(whole: Added, found: Search, drift: _Drift, zero: float) -> bool:
    """Whether the offset is what the drift has from the growth's zero to its own start."""
    if whole.fit is None:
        return False
    place = [s for s in found.steps if s.member >= 0].index(drift.step)
    rows = [whole.offset(drift.axis), *whole.coefficients(place)[:1]]
    own = np.array([1.0, -drift.slope * (drift.start - zero)])
    left = float(own @ whole.fit.beta[rows])
    return left**2 <= AGREES**2 * float(own @ whole.fit.covariance[np.ix_(rows, rows)] @ own)


def _starting(prepared: Prepared, drift: _Drift, zero: float) -> Prepared:
    """With the member of a drift as one that is 0 where the covariate is `zero`."""
    index, letter = drift.step.member, prepared.table.axes[drift.axis]
    member = prepared.members[index]
    ((name, _),) = member.parameters
    by = drift.slope * (drift.start - zero)
    factor = "" if drift.slope == 1 else f"*{drift.slope!r}"
    text = f"{name}{factor}*({member.covariate} - {zero:.{DIGITS}g})"
    ((axis, lever),) = member.columns[0].items()
    other = replace(
        member,
        columns=({axis: lever + by},),
        equations={f"E{letter}": text},
        centred=member.centred - {axis},
    )
    mean = prepared.means[index].copy()
    mean[0, axis] += by
    members = (*prepared.members[:index], other, *prepared.members[index + 1 :])
    return replace(prepared, members=members, means={**prepared.means, index: mean})
