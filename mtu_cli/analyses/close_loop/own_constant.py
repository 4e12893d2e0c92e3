"""An offset that is only the constant of a drift: both are 0 at the temperature of the growth.

An axis that grows from a fixed point c as g (x - c) (T - T_r) shows, about the middle of places
and covariate, a growth, a drift g (x_0 - c) (T - T_0), and an offset g (x_0 - c) (T_0 - T_r). The
offset is no cause of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.close_loop.added import Added, added
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.search import Search, search
from mtu_cli.analyses.close_loop.searched import Searched
from mtu_cli.analyses.close_loop.state import Step
from mtu_cli.language import evaluate, linear_form, names, parse
from mtu_cli.model.effect_library import Member
from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

AGREES = 3.0
"""Standard uncertainties within which an offset is the constant of a drift: one in 400 such is
told apart by chance.
"""
STRAIGHT = 1e-9
"""Share of its size by which a lever may bend and still be a straight line."""
DIGITS = 12
"""Of the value at which an equation is 0: rounding is less."""
PROBES = np.array([-50.0, 0.0, 50.0])
"""Values of a covariate that a straight line is known by."""


@dataclass(frozen=True, slots=True)
class _Drift:
    """A step whose one parameter acts along `axis` alone as slope (T - start)."""

    step: Step
    axis: int
    slope: float
    start: float


def with_own_constants(first: Searched, *, alpha: float, most: int) -> Searched:
    """A search for `most` effects without each offset that agrees (`AGREES`) with what a drift
    found beside it has where the growth of its axis with the same covariate may be 0; that drift
    then starts there. A search that stopped goes on for as many effects as were none.

    The coordinates of a member are free of its mean: data and gate stay as they are.
    """
    prepared, found = _joined(first.prepared, first.found)
    full = len(first.found.steps) >= most
    for more in range(_offsets(first.prepared, first.found) if full else 0, 0, -1):
        longer = search(first.prepared, first.gate, alpha=alpha, most=most + more)
        own = _joined(first.prepared, longer)
        if len(own[1].steps) <= most:
            prepared, found = own
            break
    return replace(first, prepared=prepared, found=found)


def _offsets(prepared: Prepared, found: Search) -> int:
    first = len(prepared.scan.columns)
    return sum(first <= step.index < prepared.scan.tested for step in found.steps)


def _joined(prepared: Prepared, found: Search) -> tuple[Prepared, Search]:
    """The drifts with the constants that are theirs, which the search is then without."""
    first = len(prepared.scan.columns)
    for own in found.steps:
        if not first <= own.index < prepared.scan.tested:
            continue
        axis = prepared.scan.offsets[own.index - first]
        whole = added(prepared, found)
        for drift, zero in _pairs(prepared, found, axis):
            if _agrees(whole, found, drift, zero):
                prepared = _starting(prepared, drift, zero)
                found = replace(found, steps=tuple(s for s in found.steps if s is not own))
                break
    return prepared, found


def axes_with_offset(prepared: Prepared, index: int) -> frozenset[int]:
    """The axes along which a member was given an offset that was found."""
    member = prepared.members[index]
    if any(member is own for candidate in prepared.source for own in candidate.members):
        return frozenset()
    return frozenset(axis for column in member.columns for axis in column)


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
    line = _line(member, letter, {known: PROBES})
    if line is None or line[1] == 0:
        return None
    return _Drift(step, axis, line[1], -line[0] / line[1])


def _zero(table: ResidualTable, axis: int, member: Member) -> float | None:
    """Where in the covariate a growth along an axis is 0; None where a member is none."""
    letter, known = table.axes[axis], member.covariate
    text = member.equations.get(f"E{letter}")
    if known is None or text is None or len(member.parameters) != 1:
        return None
    if _depends_on(member, letter) != {letter, known}:
        return None
    lines = [_line(member, letter, {known: PROBES, letter: at}) for at in (0.0, 1000.0)]
    if lines[0] is None or lines[1] is None:
        return None
    constant, slope = (b - a for a, b in zip(*lines, strict=True))
    return None if slope == 0 else float(f"{-constant / slope:.{DIGITS}g}")


def _depends_on(member: Member, letter: str) -> set[str]:
    """What the equation along an axis depends on beside its parameters."""
    text = member.equations[f"E{letter}"]
    return set(names(parse(text))) - {name for name, _ in member.parameters}


def _line(member: Member, letter: str, at: dict[str, FloatArray | float]) -> list[float] | None:
    """Constant and slope of the one lever along an axis; None where it is no straight line."""
    (name, _), *_ = member.parameters
    node = linear_form(parse(member.equations[f"E{letter}"]), [name]).coefficients[name]
    values = np.broadcast_to(np.asarray(evaluate(node, at), float), PROBES.shape)
    low, middle, high = values.tolist()
    if not abs(high + low - 2 * middle) <= STRAIGHT * float(np.abs(values).max()):
        return None
    return [middle, (high - low) / float(np.ptp(PROBES))]


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
