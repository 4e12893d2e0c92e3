"""Derivatives of the columns of an effect by what is searched."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_candidate import Column, FloatArray

STEP = 1e-5
"""Of the logarithm of a searched value, for its derivative: errors of order STEP^2."""
WIDE = 1e-4
"""The same for a second derivative, which rounding enters by WIDE^-2."""


def slopes(
    columns: Callable[[FloatArray], tuple[Column, ...]], searched: FloatArray, *, twice: bool
) -> tuple[Column, ...]:
    """The derivatives of the `columns` by the logarithm of the `searched` values (G,), then the
    second ones if asked for (`twice`): central differences.
    """
    near = [columns(searched * np.exp(step)) for step in (STEP, -STEP)]
    found = _combined(near, (0.5 / STEP, -0.5 / STEP))
    if not twice:
        return found
    wide = [columns(searched * np.exp(step)) for step in (WIDE, 0.0, -WIDE)]
    return found + _combined(wide, (WIDE**-2, -2.0 * WIDE**-2, WIDE**-2))


def _combined(near: Sequence[tuple[Column, ...]], weights: Sequence[float]) -> tuple[Column, ...]:
    """The sums of columns, each by its weight."""
    return tuple(
        {
            axis: np.sum([w * c[axis] for w, c in zip(weights, own, strict=True)], axis=0)
            for axis in own[0]
        }
        for own in zip(*near, strict=True)
    )
