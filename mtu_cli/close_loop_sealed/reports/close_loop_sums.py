"""What effects that act on one thing come to together."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import CloseLoopResult, FoundEffect, TableResult
from mtu_cli.close_loop_sealed.analyses.loop.shown import things
from mtu_cli.close_loop_sealed.reports.close_loop_effects import (
    CHANGES,
    first_after,
    lost_before,
    sentence_text,
)
from mtu_cli.close_loop_sealed.reports.close_loop_shown import class_of, parameters_of
from mtu_cli.reports.numbers import plus_minus
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import PARAMETER_UNITS


def sum_texts(item: TableResult, result: CloseLoopResult) -> list[str]:
    """Of squarenesses of one pair of axes, of lost motion before and after a part, and of what is
    the same in all parts and what changes with a temperature.
    """
    return [
        *_squarenesses(item, result),
        *_lost_motions(item, result),
        *_right_at(item, result),
    ]


def _squarenesses(item: TableResult, result: CloseLoopResult) -> list[str]:
    """What squarenesses of one pair of axes come to, found along each of them.

    Of E_x = -a y and E_y = -b x the angle of the axes is off by a + b, whichever of the two is a
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


def _right_at(item: TableResult, result: CloseLoopResult) -> list[str]:
    """The temperature T = T0 - c/g at which a squareness (or a scale) c and its change g with the
    temperature, counted from T0, cancel: they are one cause where the machine is right then.
    """
    texts = []
    for whole in item.effects:
        for change in item.effects:
            name = change.covariate or ""
            same = change.axis == whole.axis and change.equations.keys() == whole.equations.keys()
            sizes = len(change.sizes) == len(whole.sizes) == 1
            if CHANGES.get(whole.family) != change.family or not same or not sizes:
                continue
            if any(len(class_of(own)) > 1 for own in (whole, change)):
                continue
            known = item.table.covariates.get(name)
            counted = [
                re.search(rf"{re.escape(name)} - ([\d.]+)", e) for e in change.equations.values()
            ]
            if known is None or not all(counted):
                continue
            t0 = float(next(m[1] for m in counted if m))
            if (text := _cancel(whole, change, t0, known, result)) is not None:
                texts.append(text)
    return texts


def _cancel(
    whole: FoundEffect,
    change: FoundEffect,
    counted_from: float,
    known: FloatArray,
    result: CloseLoopResult,
) -> str | None:
    """u by the law of propagation; None farther from the data than they reach, or less sure."""
    places = _places((whole, change), result)
    (c, g), V = (own.parameters[0][2] for own in (whole, change)), result.covariance
    ratio, low, high = c / g, float(np.nanmin(known)), float(np.nanmax(known))
    gradient = np.array([1.0, -ratio]) / g
    u = float(np.sqrt(gradient @ V[np.ix_(places, places)] @ gradient))
    right, reach = counted_from - ratio, high - low
    if not low - reach <= right <= high + reach or u > reach / 2:
        return None
    axes = f"{whole.axis or ''}".upper()
    what = "angle of " + " and ".join(axes) if whole.family == "squareness" else f"scale of {axes}"
    beyond = "" if low <= right <= high else f" (beyond the data: {low:g} to {high:g})"
    at = f"{change.covariate} = {plus_minus(right, u)}{beyond}"
    return f"The {what} is right at {at}, where {whole.name} and {change.name} cancel."


def _places(own: Sequence[FoundEffect], result: CloseLoopResult) -> list[int]:
    """Where the first parameter of each stands among those of all effects."""
    place, at = 0, {}
    for effect in result.effects:
        at[id(effect)] = place
        place += len(effect.parameters)
    return [at[id(effect)] for effect in own]


def _summed(own: Sequence[FoundEffect], item: TableResult, result: CloseLoopResult) -> str:
    """The sentence of the first with the sum of the only parameter of each."""
    first, places = parameters_of(own[0])[0], _places(own, result)
    total = sum(parameters_of(effect)[0].value for effect in own)
    variance = result.covariance[np.ix_(places, places)].sum()
    u = math.sqrt(variance) / PARAMETER_UNITS[first.unit].to_internal
    return sentence_text(own[0], item, (replace(first, value=total, u=u),))
