"""Mean squares of a table's coordinates by stratum: what components of variance are told by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.close_loop_sealed.stats.strata import Strata, Stratum
from mtu_cli.stats.least_squares import FloatArray

LEAST = 0.1
"""Share of the interaction's mean square that is noise of entries at least, whatever else leaks
into it.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanSquares:
    """By axis: `interaction`; `rest` and `turned` (A,) of the columns and of their reversals
    beyond the directions of whole parts; `part` the sample covariance of the part's
    coordinates. nan where there are no degrees of freedom.
    """

    interaction: FloatArray
    rest: FloatArray
    turned: FloatArray
    part: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class EntryNoise:
    """The noise of single entries along each axis: `variance` and `dof` (A,), and the mean
    `squares` that it gives by itself.
    """

    variance: FloatArray
    dof: FloatArray
    squares: MeanSquares


def mean_squares(strata: Strata, y: FloatArray, dof: FloatArray) -> MeanSquares:
    """Mean squares of coordinates `y` (B, N), averaged over the B tables; `dof` (S,)."""
    P, _, A = strata.shape
    interaction, rest, turned = (np.full(A, np.nan) for _ in range(3))
    for s, stratum in enumerate(strata.all):
        own = beyond_parts(stratum, y)
        if stratum.kind == "interaction" and dof[s] > 0:
            interaction[stratum.axis] = np.sum(own**2) / (dof[s] * len(y))
        elif stratum.kind in ("column", "reversal") and own.size:
            found = rest if stratum.kind == "column" else turned
            found[stratum.axis] = np.mean(own**2)
    flat = of_parts(strata, y).reshape(len(y) * (P - 1), A * (1 + strata.lines))
    part = flat.T @ flat / len(flat) if P > 1 else np.full((flat.shape[1],) * 2, np.nan)
    return MeanSquares(interaction=interaction, rest=rest, turned=turned, part=part)


def beyond_parts(stratum: Stratum, y: FloatArray) -> FloatArray:
    """The coordinates (..., n) of a stratum without those that whole parts move."""
    return y[..., stratum.start + len(stratum.lead) : stratum.start + stratum.size]


def of_parts(strata: Strata, y: FloatArray) -> FloatArray:
    """The coordinates (..., P - 1, A (1 + k)) of whole parts: offset first, then the k smooth
    directions, axis by axis.
    """
    P, _, A = strata.shape
    found = np.zeros((*y.shape[:-1], P - 1, A, 1 + strata.lines))
    for stratum in strata.all:
        if stratum.kind in ("part", "line"):
            found[..., stratum.axis, stratum.line] = y[..., stratum.slice]
    return found.reshape(*y.shape[:-1], P - 1, A * (1 + strata.lines))
