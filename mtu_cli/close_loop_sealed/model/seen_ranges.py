"""Where an effect was seen: the ranges of the positions and columns of a residual table."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.language import names, parse
from mtu_cli.model.machine_model import AXES

FINE = 1e-6
"""Share of a range by which its ends are rounded outward."""


def seen_ranges(
    table: ResidualTable, equations: Mapping[str, str], parameters: Collection[str] = ()
) -> dict[str, list[float]]:
    """The `column_ranges` of the positions and columns that the `equations` of an effect use; a
    column that has the name of one of its `parameters` is not among them.
    """
    used = [name for text in equations.values() for name in names(parse(text))]
    return column_ranges(table, [name for name in used if name not in parameters])


def column_ranges(table: ResidualTable, columns: Iterable[str]) -> dict[str, list[float]]:
    """Lowest and highest value over the measured cells of positions and `columns`, those that the
    table has, rounded outward to a millionth of the range.
    """
    found = {}
    for name in dict.fromkeys(columns):
        if name in AXES:
            values = table.places[..., AXES.index(name)]
        elif name in table.covariates:
            values = np.broadcast_to(table.covariates[name], table.there.shape)
        else:
            continue
        own = values[table.there]
        if len(own) and np.isfinite(own).all():
            found[name] = _outward(float(own.min()), float(own.max()))
    return found


def _outward(low: float, high: float) -> list[float]:
    """The ends of a range with few digits, and everything of it between them; as they are where
    the range, or a millionth of it, is no number.
    """
    fine = FINE * (high - low)
    if not 0.0 < fine < math.inf:
        return [low, high]
    decimals = -math.floor(math.log10(fine))
    step = 10.0**-decimals
    ends = [round(end, decimals) for end in (low, high)]
    if ends[0] > low:
        ends[0] = min(low, round(low - step, decimals))
    if ends[1] < high:
        ends[1] = max(high, round(high + step, decimals))
    return ends
