"""A wave whose sine and cosine are one column at the places measured."""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.model.effect_data import POSITIONS
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.language import evaluate, linear_form, parse

NEAR = 0.01
"""Share of what two values differ by within which a third is one of them."""


def least_amplitude(effect: FoundEffect, table: ResidualTable) -> tuple[float, float] | None:
    """The least amplitude of a wave that is at the places what the effect is there, and its u;
    internal units. None unless the effect has one parameter beside its level, and two values.

    Sine and cosine are one column where a wave of any phase has two values, as at steps of half a
    pitch. The smallest wave that has them has its crests at the places: half of what they differ
    by. The parameter is that of the one phase that was written, which may be far from the crests.
    """
    if len(effect.sizes) != 1:
        return None
    ((name, _, value, u),) = effect.sizes
    known = {name: 0.0 for name, *_ in effect.parameters}
    places = {axis: table.places[..., i] for i, axis in enumerate(POSITIONS)}
    found = None
    for text in effect.equations.values():
        lever = linear_form(parse(text), known).coefficients.get(name)
        if lever is not None:
            at = np.broadcast_to(evaluate(lever, places), table.there.shape)[table.there]
            low, high = float(at.min()), float(at.max())
            if (np.minimum(at - low, high - at) > NEAR * (high - low)).any():
                return None
            half = 0.5 * (high - low)
            found = abs(value) * half, u * half
    return found
