"""Effects of parts that were all made at one temperature, which is not that of ISO 1.

Where a temperature does not change none of its effects can be tested: a growth is a scale then, a
drift an offset, a change of an angle a squareness, and how large these are at 20 degC nobody knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.describe import Described
from mtu_cli.close_loop_sealed.analyses.loop.result import FoundEffect
from mtu_cli.close_loop_sealed.model.effect_candidate import Candidate
from mtu_cli.close_loop_sealed.model.effect_data import is_steady
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.files.covariates import is_temperature
from mtu_cli.files.part import REFERENCE_TEMPERATURE
from mtu_cli.model.effect_ranges import NEAR_K

LOOKS_LIKE = {
    "scale": "thermal-growth",
    "squareness": "thermal-squareness",
    "offset": "thermal-drift",
}
"""The family of a temperature that is the same as another where the temperature does not change."""


def with_temperature(
    told: Described, effects: Sequence[FoundEffect], candidates: Sequence[Candidate]
) -> tuple[FoundEffect, ...]:
    """The effects, each with the temperatures `found_at` that it may be an effect of by one of the
    `candidates`, and that did not change.
    """
    known = {(own.family, own.axis) for own in candidates}
    at = tuple(_constant(told.prepared.table))
    found = []
    for effect in effects:
        families = {(LOOKS_LIKE.get(effect.family, ""), effect.axis)}
        families |= {(LOOKS_LIKE["offset"], axis) for axis in effect.levels}
        shared = effect.component is None and not known.isdisjoint(families)
        found.append(replace(effect, found_at=at) if shared else effect)
    return tuple(found)


def _constant(table: ResidualTable) -> list[tuple[str, float]]:
    """The temperatures that did not change and are far from 20 degC."""
    found = []
    for name, column in table.covariates.items():
        values = np.broadcast_to(column, table.there.shape)[table.there]
        if is_temperature(name) and len(values) and np.isfinite(values).all():
            low, high = float(values.min()), float(values.max())
            T = (low + high) / 2
            if is_steady(name, high - low) and abs(T - REFERENCE_TEMPERATURE) > NEAR_K:
                found.append((name, T))
    return found
