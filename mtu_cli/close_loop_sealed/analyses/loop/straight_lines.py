"""Levers that are straight lines in the place along an axis, in a covariate, or in both."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.language import Node, evaluate, names, parse
from mtu_cli.model.machine_model import AXES
from mtu_cli.stats.least_squares import FloatArray

STRAIGHT = 1e-9
"""Share of its size by which a lever may bend and still be a straight line."""
NODES: FloatArray = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 65))
"""From -1 to 1 with 0 in the middle. They are uneven: no wave has the same phase at all of them."""
COVARIATE = 50.0
"""Half of the range of a covariate that a straight line is known by, about 0."""


def depended_on(text: str, parameters: Iterable[tuple[object, ...]]) -> set[str]:
    """What an equation depends on beside its parameters (name first)."""
    return set(names(parse(text))) - {str(name) for name, *_ in parameters}


def extent(table: ResidualTable, axis: str) -> tuple[float, float]:
    """The middle of the places along an axis and half of their extent, mm; nan without places."""
    at = table.places[..., AXES.index(axis)]
    known = at[np.isfinite(at)]
    if not known.size:
        return np.nan, np.nan
    low, high = float(known.min()), float(known.max())
    return 0.5 * (low + high), max(0.5 * (high - low), 1.0)


def middle_and_rise(values: FloatArray) -> tuple[float, float]:
    """Of a lever (n,) at the `NODES` the value in the middle, and half of what it rises from end
    to end, 0 where that is rounding; nan where it is no straight line.
    """
    if not _straight(values).all():
        return np.nan, np.nan
    middle, rise = float(values[len(NODES) // 2]), 0.5 * float(values[-1] - values[0])
    return middle, rise if abs(rise) > STRAIGHT * float(np.abs(values).max()) else 0.0


def in_place(node: Node, axis: str, middle: float, half: float) -> FloatArray:
    """A lever that depends on the place alone, at the places (n,) of the `NODES`."""
    x = middle + half * NODES
    return np.broadcast_to(np.asarray(evaluate(node, {axis: x}), float), x.shape)


def in_covariate(
    node: Node, covariate: str, axis: str, middle: float, half: float
) -> tuple[FloatArray, FloatArray]:
    """A lever at 0 of a covariate and its slope there, at the places (n,) of the `NODES`; nan at
    a place where it is no straight line in the covariate.
    """
    at = {axis: (middle + half * NODES)[:, np.newaxis], covariate: COVARIATE * NODES}
    values = np.broadcast_to(np.asarray(evaluate(node, at), float), (len(NODES), len(NODES)))
    straight = _straight(values)
    slope = 0.5 * (values[:, -1] - values[:, 0]) / COVARIATE
    zero = values[:, len(NODES) // 2]
    return np.where(straight, zero, np.nan), np.where(straight, slope, np.nan)


def _straight(values: FloatArray) -> NDArray[np.bool_]:
    """Whether levers (..., n) at the `NODES` are straight lines, by the size of all of them."""
    if not np.isfinite(values).all():
        return np.zeros(values.shape[:-1], bool)
    middle, rise = values[..., len(NODES) // 2], 0.5 * (values[..., -1] - values[..., 0])
    bend = np.abs(values - middle[..., np.newaxis] - rise[..., np.newaxis] * NODES)
    found: NDArray[np.bool_] = bend.max(axis=-1) <= STRAIGHT * np.abs(values).max()
    return found
