"""How likely the values of what an effect searches are before: all shapes alike, not all values.

On a grid of time constants, many of the long ones make nearly the same shape, a straight line: as
likely each as one of those that bend, they would say that warming up is mostly a straight line.
The prior of Jeffreys (Proc. R. Soc. Lond. A 186 (1946) 453) does not depend on how a value is
written: its density goes with the speed at which the shape, at unit length, moves with the value,

    p(theta) ~ |d/dtheta (x / |x|)| = |t - x (x't)/(x'x)| / |x|,

x the column over all cells without its mean, t its derivative. What is searched without a
derivative (the part at which a step is) is as likely at each place as at another, and so are the
values of an effect of several columns, whose grid is even in frequency: there the speed is the
same everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.stats.least_squares import FloatArray

LEAST = 1e-9
"""Least speed, as a share of the mean speed: no value is impossible; and least part of a derivative
that is not along the column: below it is rounding.
"""


def shape_weights(members: Sequence[Member]) -> FloatArray:
    """Prior weights (M,) of one candidate's members, 1 on the average.

    Members of one grid share what they would have alike: those of one covariate and one set of
    parameters, as long as their values rise, or fall. A grid with values of 0 or less, where the
    derivative by the logarithm says nothing, is left even.
    """
    weights = np.ones(len(members))
    groups: dict[object, list[int]] = {}
    for i, member in enumerate(members):
        if len(member.columns) == 1 and len(member.tangent) == 1 and len(member.searched) == 1:
            groups.setdefault((member.covariate, member.parameters), []).append(i)
    for own in groups.values():
        for grid in _grids(own, [_value(members[i]) for i in own]):
            weights[grid] = _along([members[i] for i in grid])
    return weights


def _value(member: Member) -> float:
    return next(iter(member.searched.values()))


def _grids(places: Sequence[int], values: Sequence[float]) -> list[list[int]]:
    """The places of monotone runs of values: two equations of one effect are two grids."""
    grids: list[list[int]] = []
    way = 0.0
    for k, place in enumerate(places):
        step = values[k] - values[k - 1] if k else 0.0
        if grids and step * way >= 0.0 and step != 0.0:
            grids[-1].append(place)
            way = step
        else:
            grids.append([place])
            way = 0.0
    return grids


def _along(members: Sequence[Member]) -> FloatArray:
    """Weights (M,) along one grid, 1 on the average."""
    values = np.array([_value(member) for member in members])
    if len(members) < 3 or values.min() <= 0.0:
        return np.ones(len(members))
    speed = np.array([_speed(member) for member in members]) * np.abs(np.gradient(np.log(values)))
    mean = float(speed.mean())
    if not (np.isfinite(mean) and mean > 0.0):
        return np.ones(len(members))
    found: FloatArray = np.maximum(speed, LEAST * mean)
    found /= found.mean()
    return found


def _speed(member: Member) -> float:
    """The angle by which the shape turns per unit of log(searched)."""
    (column,), (tangent,) = member.columns, member.tangent
    x, t = _centred(column.values()), _centred(tangent[axis] for axis in column)
    length = float(x @ x)
    if not length > 0.0:
        return 0.0
    across = float(np.linalg.norm(t - x * (x @ t) / length))
    return across / length**0.5 if across > LEAST * float(np.linalg.norm(t)) else 0.0


def _centred(values: Iterable[FloatArray]) -> FloatArray:
    """The values of all axes in one row, those of each axis without their mean."""
    return np.concatenate([(own - own.mean()).ravel() for own in values])
