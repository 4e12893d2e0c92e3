"""On what the figures of effects depend: notes below their table."""

from __future__ import annotations

import math

from mtu_cli.close_loop_sealed.analyses.loop.result import TableResult
from mtu_cli.close_loop_sealed.analyses.loop.zeros import zeros_of
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    DRIFTS,
    OF_TEMPERATURES,
    article,
    beside_which,
    in_shown_unit,
    unit_of,
)
from mtu_cli.files.part import REFERENCE_TEMPERATURE
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import interval, p_value, plus_minus, significant

FITS_BETTER = f"that fits better than {REFERENCE_TEMPERATURE:g} degC"


def one_cause_notes(item: TableResult) -> list[str]:
    """That a growth and a drift in two rows are one axis that grows from a fixed point: the growth
    is counted from a place of its own, and the drift is how far that goes. Likewise that a drift
    and an offset are one axis that is right at another temperature, or place.
    """
    notes = []
    for point in item.fixed_points:
        start = point.counted_from
        if math.isfinite(start) and point.told and point.given is None:
            growth = item.effects[point.growth[0]].name
            drifts = " and ".join(item.effects[e].name for e in point.drift)
            notes.append(
                f"{growth} is counted from {point.axis} = {significant(start, 4)} mm, and "
                f"{drifts} is how far that place goes: one cause"
            )
    for neutral in item.neutral_points:
        if math.isfinite(neutral.counted_from) and neutral.given is None:
            offsets = " and ".join(item.effects[e].name for e in neutral.offset)
            mm = " mm" if neutral.covariate in AXES else ""
            what = "the error there" if neutral.beside is None else "how far that place goes"
            notes.append(
                f"{item.effects[neutral.drift[0]].name} is counted from {neutral.covariate} = "
                f"{significant(neutral.counted_from, 4)}{mm}, and {offsets} is {what}: one cause"
            )
    return notes


def growth_alone_notes(item: TableResult) -> list[str]:
    """Of a growth that was found alone, where it is counted from, what its level is, and where the
    axis may be fixed: how far that place goes by itself was not found, and is not known to be 0.
    """
    notes = []
    for point in item.growths_alone:
        effect, axis, known = item.effects[point.growth[0]], point.axis, point.covariate
        place = f"{axis} = {significant(point.counted_from, 4)} mm"
        own = ["its level"] if effect.levels else []
        own += [e.name for e in item.effects if e.kind == "offset" and e.axis == axis]
        middle = f", and {own[0]} is the mean error there over these {known}" if own else ""
        text = (
            f"{effect.name} is counted from {place}{middle}; that this place goes with {known}, "
            "too, does not pass among all that is tested, so that the fixed point is not known "
            "from these data"
        )
        if point.told and point.interval is not None:
            ends = interval(*point.interval, point.u)
            where = f"{axis} = {plus_minus(point.at, point.u)} mm (95 %: {ends})"
            text += f": it may lie at {where}"
        notes.append(text)
    return notes


def _beside_notes(item: TableResult) -> list[str]:
    """Of effects whose figures hold beside one of a class alone."""
    pairs = [(effect.name, beside_which(item, effect)) for effect in item.effects]
    return [
        f"{name} has these figures beside {' and '.join(which)}, and others beside what that may "
        "be as well: see above"
        for name, which in pairs
        if which
    ]


def held_notes(item: TableResult) -> list[str]:
    """On what the figures of growths and the like depend."""
    return [
        *_beside_notes(item),
        *_mean_of_day_notes(item),
        *_otherwise_notes(item),
        *_left_notes(item),
    ]


def _left_notes(item: TableResult) -> list[str]:
    """Of a mean error beside the effects of an axis, which is not written."""
    scale = unit_of(item).to_internal
    return [
        f"beside these effects {own.axis.upper()} is off by "
        f"{plus_minus(own.value / scale, own.u / scale)} {item.table.unit} on the mean (p "
        f"{p_value(own.p)} by itself, no finding among all tests): that is not written, "
        "and `mtu compare` may call it biased"
        for own in item.left_means
    ]


def _mean_of_day_notes(item: TableResult) -> list[str]:
    """Of what a temperature makes that is 0 at the mean of the data and not at 20 degC (ISO 1)."""
    notes = []
    for effect in (e for e in item.effects if e.family in OF_TEMPERATURES):
        # A drift has no other form: beside it any constant is an offset or a level.
        why = "what is constant is an offset" if effect.family == DRIFTS else FITS_BETTER
        zeros = {*zeros_of(effect)} - {REFERENCE_TEMPERATURE}
        notes += [
            f"{effect.name} is counted from {effect.covariate} = {significant(zero, 4)}, the mean "
            f"of the data: {why}"
            for zero in sorted(zeros)
        ]
    return notes


def _otherwise_notes(item: TableResult) -> list[str]:
    """Of what was found, what it would be beside an effect of its kind that was not told."""
    notes = []
    for effect in item.effects:
        for own in effect.otherwise:
            (value, u, unit), (more, u_more, other) = map(
                in_shown_unit, (own.parameter, own.constant)
            )
            noun = article(own.constant[0])
            at = f" at {own.covariate} = {REFERENCE_TEMPERATURE:g}" if own.at_reference else ""
            notes.append(
                f"{effect.name}: that {own.parameter[0]} and its u hold if there is no {own.name}; "
                f"with one it is {plus_minus(value, u)} {unit}{at}, beside {noun} of "
                f"{plus_minus(more, u_more)} {other} (p {p_value(own.p)})"
            )
    return notes
