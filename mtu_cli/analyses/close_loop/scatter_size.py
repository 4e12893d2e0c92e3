"""How large a scatter is that was found: of turns, of growths, of one operation.

t (P - 1) are the contrasts of the parts along the unit vector of a turn (or a growth) of features
at distances r from their middle: t't has the mean (P - 1) s^2 sum r^2 + n, n by what scatters
parts else (see `direction_noise`). Solved for s that is the estimate of moments, with the u of a
sum of squares of P - 1 degrees of freedom. Variances of operations are told apart by what is left
of entries beside parts and columns; u(ln s^2)^2 = (2 + excess kurtosis) / degrees of freedom (Box,
Biometrika 40 (1953) 318).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtu_cli.analyses.close_loop.evidence import (
    OPERATIONS,
    along_direction,
    interaction_entries,
    variance_by_operation,
)
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.result import ScatterSize
from mtu_cli.analyses.close_loop.scatter_rivals import ROTATION
from mtu_cli.analyses.close_loop.state import Step
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.scatter_tests import log_variance_u


def scatter_size(prepared: Prepared, members: Sequence[int], step: Step) -> ScatterSize | None:
    """Of a step that is a scatter, beside the effects found (`members`), internal units; None of
    others, and where it is no more than what scatters parts else.
    """
    scan = prepared.scan
    if step.index < scan.tested:
        return None
    pack = scan.pack(prepared.with_tangents(members))
    left = pack.without_found(prepared.y)
    if scan.names[step.index] == OPERATIONS:
        return _of_operation(prepared, left)
    return _of_direction(prepared, left, pack.dof, scan.names[step.index])


def _of_direction(
    prepared: Prepared, left: FloatArray, dof: FloatArray, name: str
) -> ScatterSize | None:
    scan, which = prepared.scan, 0 if name == ROTATION else 1
    noise = scan.frame.noise(left, dof, scan.dof, scan.null.predicted_part, scan.predicted_dof)
    t = along_direction(scan, left, scan.directions[which])
    expected = float(np.append(noise.variance, 1.0) @ scan.turns[which].mean)
    places = prepared.table.places.mean(axis=0)[:, :2]
    reach = float(np.sum((places - places.mean(axis=0)) ** 2))
    square = float(t @ t)
    if square <= expected or reach == 0:
        return None
    s = np.sqrt((square - expected) / len(t) / reach)
    u = np.sqrt(2 / len(t)) * square / len(t) / reach / (2 * s)
    unit = "arcsec" if name == ROTATION else "um/m"
    by_axis = _by_axis(prepared, left, noise.variance, scan.directions[which], np.sqrt(reach))
    return ScatterSize(parameter=("s", unit, float(s), float(u)), by_axis=by_axis)


def _by_axis(
    prepared: Prepared, left: FloatArray, variance: FloatArray, direction: FloatArray, size: float
) -> tuple[tuple[str, float], ...]:
    """The same of the errors along each axis alone: a turn or a growth moves both alike. `size`
    mm is the root of the sum of r^2.
    """
    scan, found = prepared.scan, []
    for a, axis in enumerate(prepared.table.axes):
        share = float(np.sum(direction[a] ** 2))
        if share == 0:
            continue
        w = np.zeros_like(direction)
        w[a] = direction[a]
        t = along_direction(scan, left, w)
        by_model = float(w.ravel() @ scan.null.predicted_part @ w.ravel())
        excess = float(t @ t) / len(t) - variance[a] * share - by_model
        found.append((axis, float(np.sqrt(max(excess, 0.0))) / (share * size)))
    return tuple(found)


def _of_operation(prepared: Prepared, left: FloatArray) -> ScatterSize:
    """The operation that scatters most against all others."""
    scan, table = prepared.scan, prepared.table
    variance = variance_by_operation(scan, left)
    code = int(scan.operation[int(np.argmax(variance))])
    own = scan.operation == code
    level = float(np.mean(scan.null.interaction))
    s = float(np.sqrt(level * variance[own].mean()))
    rest, alone = (_of_columns(prepared, left, which) for which in (~own, own))
    others = float(np.sqrt(level * variance[~own].mean() if rest is None else np.mean(rest)))
    axes = [] if alone is None else zip(table.axes, np.sqrt(alone).tolist(), strict=True)
    entries, there, share = interaction_entries(scan, left)
    u = s * log_variance_u(entries[there & own], share) / 2
    return ScatterSize(
        parameter=("s", table.unit, s, u),
        of=table.operations[code],
        others=others,
        by_axis=tuple(axes),
    )


def _of_columns(prepared: Prepared, left: FloatArray, which: np.ndarray) -> FloatArray | None:
    """Variances (A,) of the entries of some columns beside their own parts, lines and means: those
    of others, which may scatter by far more, are mixed in with what all columns have in common.
    None where too few are there.
    """
    strata = prepared.scan.frame.strata
    there = prepared.scan.frame.completion.observed[:, which]
    P, H, A = len(there), int(which.sum()), strata.shape[2]
    own = strata.tables(left)[:, which]
    smooth = strata.columns[which, : 1 + strata.lines]
    rows = (own - own.mean(axis=0)).transpose(0, 2, 1).reshape(-1, H)
    rest = np.array([least_squares(smooth, row).residuals for row in rows])
    own = rest.reshape(P, A, H).transpose(0, 2, 1)
    dof = (P - 1) * (H - smooth.shape[1]) - int((~there).sum())
    if dof <= 0 or smooth.shape[1] >= H:
        return None
    found: FloatArray = np.sum(own[there] ** 2, axis=0) / dof
    return found
