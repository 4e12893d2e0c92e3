"""What a table's datum, and the polynomial of its own readings, leave free in it."""

from __future__ import annotations

import numpy as np

from mtu_cli.close_loop_sealed.model.effect_candidate import Column
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.crossed import Freeing
from mtu_cli.close_loop_sealed.stats.loop_frame import Frame
from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray

ALL = 1e-9
"""A direction of which no more than this share is left has no degrees of freedom."""


def freeing(table: ResidualTable) -> Freeing | None:
    """Takes the freedoms of the datum out of tables (..., P, H, A); None where it has none."""
    if table.datum == "none":
        return None

    def free(tables: FloatArray) -> FloatArray:
        flat = tables.reshape(-1, *tables.shape[-3:])
        freed = table.freed(np.moveaxis(flat, 0, -1))
        found: FloatArray = np.moveaxis(freed, -1, 0).reshape(tables.shape)
        return found

    return free


def places_of(table: ResidualTable) -> FloatArray:
    """Mean places (H, d) of the columns along the coordinates that are known."""
    places = table.places.mean(axis=0)
    found: FloatArray = places[:, np.isfinite(places).all(axis=0)]
    return found


def fitted_powers(table: ResidualTable) -> list[Column]:
    """Powers of the position that were fitted to the readings themselves."""
    places = places_of(table)
    if table.fitted_degree < 1 or not places.shape[1]:
        return []
    position = places[:, 0] - places[:, 0].mean()
    position = position / max(float(np.abs(position).max()), 1e-300)
    return [{0: position[None] ** n} for n in range(1, table.fitted_degree + 1)]


def degrees_of_freedom(table: ResidualTable, frame: Frame) -> FloatArray:
    """Degrees of freedom (S,): sizes, less what the datum takes; of the interaction of a table with
    missing entries, what noise of variance 1 adds up to there.

    A motion that each part is free to make takes one a part, from each stratum the share that
    it has of the motion: a rotation moves x along y and y along x, and takes half of either
    where places spread alike.
    """
    strata = frame.strata
    P = strata.shape[0]
    left = 1 - _shares(table, strata)
    found = []
    for stratum in strata.all:
        own = left[stratum.axis]
        if stratum.kind == "column":
            n = float(own[strata.even].sum())
        elif stratum.kind == "reversal":
            n = float(own[strata.odd].sum())
        elif stratum.kind == "interaction" and not frame.completion.complete:
            n = float(frame.squares.interaction[stratum.axis, stratum.axis])
        elif stratum.kind == "interaction":
            n = (P - 1) * float(own[strata.lines + 1 :].sum())
        else:
            n = (P - 1) * float(own[stratum.line])
        found.append(n if n > ALL * stratum.size else 0.0)
    return np.array(found)


def _shares(table: ResidualTable, strata: Strata) -> FloatArray:
    """Share (A, H) of each column vector of the strata, along each axis, that the datum's
    motions hold, averaged over the parts.
    """
    P, H, A = strata.shape
    found = np.zeros((A, H))
    for own in table.motions:
        motions = np.zeros((H, A, own.Q.shape[1]))
        motions[own.columns] = own.Q.reshape(len(own.columns), A, -1)
        turned = np.einsum("hj,hak->ajk", strata.columns, motions)
        found += len(own.rows) / P * (turned**2).sum(axis=2)
    return np.minimum(found, 1.0)
