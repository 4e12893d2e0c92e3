"""Where an axis whose error changes with something stands right: a drift, a trend or a squareness
and an offset found together.

A drift is counted from the middle of the data's temperatures, a squareness from that of the places
along the other axis, and the offset is the error there. They are one cause where the machine is
right at another temperature, or place, which is what a shop asks. So are an angle that changes
with a temperature and the drift of its middle: the axis turns about another place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.cancelling import NeutralPoint
from mtu_cli.close_loop_sealed.analyses.loop.crossing import Lever, counted_from, crossing
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.analyses.loop.straight_lines import (
    depended_on,
    in_covariate,
    in_place,
    middle_and_rise,
)
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.language import linear_form, parse
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

WIDEST, FARTHEST = 2.0, 2.0
"""Of an interval, and of its nearer end from the middle, in halves of the data's range."""
DIRECTION = "dir_"
"""A direction turns an error about: its middle stays where it is."""


def neutral_points(
    table: ResidualTable,
    effects: Sequence[FoundEffect],
    covariance: FloatArray,
    instead: int | None = None,
) -> tuple[NeutralPoint, ...]:
    """Those along each axis where errors are a + g c: the c where they are zero, c a temperature,
    the place along another axis, or any other column but a direction; or that times a temperature
    or another column (`beside`), c the place along another axis.

    `covariance` (k, k) is that of the k parameters of all effects in their order, internal units.
    Beside an error that changes along its own axis (`fixed_points`) or with a second covariate
    there is none, nor farther from the values of the data than half of their range. An effect that
    is one of several which the data cannot tell apart gives one if it is that (`given`); two of
    them give none. `instead` is the place of an effect that stands for one found: what has no part
    of it is not told again.
    """
    found = []
    for axis in table.axes if table.component is None else ():
        for covariate, beside, chosen in _straight_in(effects, axis):
            unsure = [e for e in chosen if len(effects[e].candidates) > 1]
            given = next(((e, effects[e].name) for e in unsure), None)
            if len(unsure) > 1 or (instead is not None and instead not in unsure):
                continue
            values = _values(table, covariate, axis)
            if values is None or not (beside is None or beside in table.covariates):
                continue
            levers = _Levers(effects, chosen, axis, covariate, beside)
            point = _point(values, levers, covariance)
            if point is not None:
                found.append(replace(point, given=given))
    return tuple(found)


def _straight_in(
    effects: Sequence[FoundEffect], axis: str
) -> Iterator[tuple[str, str | None, tuple[int, ...]]]:
    """What errors along an axis may be a straight line in, what they are proportional to beside
    it, and the places of the effects that make them.
    """
    all_over = {e: _over(effect, axis) for e, effect in enumerate(effects)}
    over = {e: own for e, own in all_over.items() if own is not None}
    covariates = {name for own in over.values() for name in own}
    if len(covariates) == 1:
        yield next(iter(covariates)), None, tuple(over)
        return
    for beside in sorted(covariates - set(AXES)):
        chosen = {e: own - {beside} for e, own in over.items() if beside in own}
        places = {name for own in chosen.values() for name in own}
        if len(places) == 1 and places <= set(AXES) - {axis}:
            yield next(iter(places)), beside, tuple(chosen)


def _values(table: ResidualTable, name: str, axis: str) -> FloatArray | None:
    """The data's values of what the error along an axis changes with; None where it has none, or
    they are the places along the axis itself.
    """
    if name in AXES:
        values = table.places[..., AXES.index(name)]
        return values if name != axis and np.isfinite(values).any() else None
    return table.covariates.get(name)


def _over(effect: FoundEffect, axis: str) -> set[str] | None:
    """What the error along an axis depends on; None where it has none that stays."""
    text = effect.equations.get(f"E{axis}")
    if text is None:
        return None
    over = depended_on(text, effect.parameters)
    turns = any(name.startswith(DIRECTION) for name in over)
    return None if turns else over


@dataclass(frozen=True, slots=True)
class _Levers:
    """Effects `chosen` (by their places), straight lines along `axis` in a covariate, and what
    they are proportional to `beside` it.
    """

    effects: Sequence[FoundEffect]
    chosen: Sequence[int]
    axis: str
    covariate: str
    beside: str | None

    def over(self, middle: float, half: float) -> list[Lever]:
        """Of all their parameters; nan where it is no straight line in the covariate."""
        return [lever for e in self.chosen for lever in self._of(e, middle, half)]

    def _of(self, e: int, middle: float, half: float) -> Iterator[Lever]:
        own = [name for name, _, _, _ in self.effects[e].parameters]
        form = linear_form(parse(self.effects[e].equations[f"E{self.axis}"]), own)
        for name, node in form.coefficients.items():
            if self.beside is None:
                values = in_place(node, self.covariate, middle, half)
            else:
                _, values = in_covariate(node, self.beside, self.covariate, middle, half)
            shift, growth = middle_and_rise(values)
            yield Lever(e, own.index(name), shift, growth)


def _point(values: FloatArray, own: _Levers, covariance: FloatArray) -> NeutralPoint | None:
    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    levers = own.over(middle, half)
    drift = tuple(dict.fromkeys(lever.effect for lever in levers if lever.growth))
    offset = tuple(dict.fromkeys(x.effect for x in levers if x.shift and x.effect not in drift))
    if not drift or not offset or not all(np.isfinite(x.shift) for x in levers):
        return None
    point = crossing(own.effects, covariance, levers).over(middle, half)
    ends = point.interval
    # Wider than all that was seen it would tell nothing; far from it every line is zero somewhere.
    if ends is None or ends[1] - ends[0] > WIDEST * half:
        return None
    if min(abs(end - middle) for end in ends) > FARTHEST * half:
        return None
    return NeutralPoint(
        axis=own.axis,
        covariate=own.covariate,
        drift=drift,
        offset=offset,
        at=point.value,
        u=point.u,
        interval=ends,
        seen=(low, high),
        counted_from=counted_from(levers, middle, half),
        beside=own.beside,
    )
