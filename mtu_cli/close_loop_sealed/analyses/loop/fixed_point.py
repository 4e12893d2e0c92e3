"""An axis that grows from a fixed point: a growth and a drift that were found together.

About the middle of the data such an axis shows two effects, a growth and a drift of the middle.
They are one physical cause, and what a mechanic asks is where it is fixed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import FixedPoint
from mtu_cli.close_loop_sealed.analyses.loop.crossing import Crossing, Lever, counted_from, crossing
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.straight_lines import (
    STRAIGHT,
    depended_on,
    extent,
    in_covariate,
    in_place,
    middle_and_rise,
)
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.language import linear_form, parse
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

SAME = 1e-9
"""Share of it by which the value of a covariate at which errors are 0 may differ by rounding."""
Over = frozenset[str]
"""The one covariate that errors are proportional to; empty where they are constant."""


def fixed_points(
    table: ResidualTable,
    effects: Sequence[FoundEffect],
    covariance: FloatArray,
    instead: int | None = None,
) -> tuple[FixedPoint, ...]:
    """All that the effects found in a table tell together.

    `covariance` (k, k) is that of the k parameters of all effects in their order, internal units.
    Where the errors are a + g (x - c), or that times a covariate, a and g sums over all such
    effects, the fixed point is c - a/g; its u is by the joint covariance (JCGM 100:2008, 5.2.2),
    its interval that of Fieller (J. R. Stat. Soc. B 16 (1954) 175). An effect that is one of
    several which the data cannot tell apart gives one if it is that (`given`); two of them give
    none, nor do any beside one that bends, nor constant ones beside such that are 0 at different
    values of a covariate: what is constant is then the error at none of them. `instead` is the
    place of an effect that stands for one found: what has no part of it is not told again.
    """
    found = []
    for axis in table.axes if table.component is None else ():
        over = [_beside(effect, axis) for effect in effects]
        for own in dict.fromkeys(known for known in over if known is not None and len(known) < 2):
            if not own and not _at_one_time(table, effects, over, axis):
                continue
            chosen = [e for e, known in enumerate(over) if known == own]
            levers = [x for e in chosen for x in levers_of(table, axis, effects[e], e, own)]
            growth = tuple(dict.fromkeys(x.effect for x in levers if x.growth))
            drift = tuple(
                dict.fromkeys(x.effect for x in levers if x.shift and x.effect not in growth)
            )
            straight = all(np.isfinite(x.shift) for x in levers)
            unsure = [e for e in chosen if len(effects[e].candidates) > 1]
            given = next(((e, effects[e].name) for e in unsure), None)
            if instead is not None and instead not in unsure:
                continue
            if growth and drift and straight and len(unsure) < 2:
                crossed = crossing(effects, covariance, levers)
                point = _point(table, axis, min(own, default=None), growth, drift, crossed)
                start = counted_from(levers, *extent(table, axis))
                found.append(replace(point, counted_from=start, given=given))
    return tuple(found)


def _beside(effect: FoundEffect, axis: str) -> Over | None:
    """What the error along an axis depends on beside the place there; None without an equation,
    and where it changes along another axis: no point of this one is then fixed.
    """
    text = effect.equations.get(f"E{axis}")
    if text is None:
        return None
    over = frozenset(depended_on(text, effect.parameters)) - {axis}
    return None if over & set(AXES) else over


def _at_one_time(
    table: ResidualTable, effects: Sequence[FoundEffect], over: Sequence[Over | None], axis: str
) -> bool:
    """Whether all errors along an axis that are straight in one covariate are 0 at the same value
    of it.
    """
    zeros: dict[str, list[float]] = {}
    middle, half = extent(table, axis)
    for effect, known in zip(effects, over, strict=True):
        if known is None or len(known) != 1:
            continue
        (covariate,) = known
        own = [name for name, _, _, _ in effect.parameters]
        form = linear_form(parse(effect.equations[f"E{axis}"]), own)
        for node in form.coefficients.values():
            at_zero, slope = in_covariate(node, covariate, axis, middle, half)
            # A growth is 0 at its middle, but for rounding.
            there = np.abs(slope) > STRAIGHT * np.nanmax(np.abs(slope), initial=0.0)
            zeros.setdefault(covariate, []).extend((-at_zero[there] / slope[there]).tolist())
    return all(np.ptp(values) <= SAME * np.abs(values).max() for values in zeros.values() if values)


def levers_of(
    table: ResidualTable, axis: str, effect: FoundEffect, e: int, over: Over
) -> Iterator[Lever]:
    """Of the parameters of effect `e`, where errors depend on `over` beside the place; nan where
    it is no straight line along the axis.
    """
    own = [name for name, _, _, _ in effect.parameters]
    middle, half = extent(table, axis)
    form = linear_form(parse(effect.equations[f"E{axis}"]), own)
    for name, node in form.coefficients.items():
        if over:
            (covariate,) = over
            _, values = in_covariate(node, covariate, axis, middle, half)
        else:
            values = in_place(node, axis, middle, half)
        shift, growth = middle_and_rise(values)
        yield Lever(e, own.index(name), shift, growth)


def _point(
    table: ResidualTable,
    axis: str,
    covariate: str | None,
    growth: tuple[int, ...],
    drift: tuple[int, ...],
    crossed: Crossing,
) -> FixedPoint:
    """In mm: where they cross is in halves of the places' extent from their middle."""
    found = crossed.over(*extent(table, axis))
    ends = found.interval
    return FixedPoint(
        axis=axis,
        covariate=covariate,
        growth=growth,
        drift=drift,
        at=found.value,
        u=found.u,
        interval=ends,
        told=ends is not None and ends[1] - ends[0] <= _reach(table, axis),
    )


def _reach(table: ResidualTable, axis: str) -> float:
    """The travel of an axis, mm; where it is not known, the longest that the machine has by the
    other axes and the parts: a fixed point lies beyond flat parts as well as beyond high ones.
    """
    if axis in table.travel:
        low, high = table.travel[axis]
        return high - low
    known = [high - low for low, high in table.travel.values()]
    placed = [a for i, a in enumerate(AXES) if np.isfinite(table.places[..., i]).any()]
    return max([*known, *(2 * extent(table, other)[1] for other in placed)])
