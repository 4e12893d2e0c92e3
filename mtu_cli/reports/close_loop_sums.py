"""What effects that act on one thing come to together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect, TableResult
from mtu_cli.analyses.close_loop.shown import things
from mtu_cli.reports.close_loop_effects import first_after, lost_before, sentence_text
from mtu_cli.reports.close_loop_shown import class_of, parameters_of
from mtu_cli.units import PARAMETER_UNITS


def sum_texts(item: TableResult, result: CloseLoopResult) -> list[str]:
    """Of squarenesses of one pair of axes, and of lost motion before and after a part."""
    return [*_squarenesses(item, result), *_lost_motions(item, result)]


def _squarenesses(item: TableResult, result: CloseLoopResult) -> list[str]:
    """What squarenesses of one pair of axes come to, found along each of them.

    Of E_x = a y and E_y = b x the angle of the axes is off by a + b, whichever of the two is a
    squareness and which a turn.
    """
    found: dict[str, list[FoundEffect]] = {}
    for effect in item.effects:
        if effect.family == "squareness" and len(effect.parameters) == 1:
            found.setdefault(effect.name, []).append(effect)
    return [
        f"{own[0].name} was found along both axes: together {_summed(own, item, result)}, and all "
        "is turned."
        for own in found.values()
        if len(own) > 1
    ]


def _lost_motions(item: TableResult, result: CloseLoopResult) -> list[str]:
    """What an axis loses at reversal from the part on at which it begins to lose more, or less."""
    row, _ = things(item)
    texts = []
    for effect in item.effects:
        before = lost_before(effect, item)
        if before is None or any(len(class_of(own)) > 1 for own in (before, effect)):
            continue
        if len(before.parameters) == len(effect.parameters) == 1:
            whole = _summed((before, effect), item, result)
            texts.append(f"In all, from {row} {first_after(effect, item)} on: {whole}.")
    return texts


def _summed(own: Sequence[FoundEffect], item: TableResult, result: CloseLoopResult) -> str:
    """The sentence of the first with the sum of the only parameter of each."""
    place, at = 0, {}
    for effect in result.effects:
        at[id(effect)] = place
        place += len(effect.parameters)
    first, places = parameters_of(own[0])[0], [at[id(effect)] for effect in own]
    total = sum(parameters_of(effect)[0].value for effect in own)
    variance = result.covariance[np.ix_(places, places)].sum()
    u = math.sqrt(variance) / PARAMETER_UNITS[first.unit].to_internal
    return sentence_text(own[0], item, (replace(first, value=total, u=u),))
