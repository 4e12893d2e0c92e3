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
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.scatter_tests import log_variance_u

FEWEST = 3
"""Parts that tell a scatter."""
TINY = 1e-9
"""Of the squares of columns: directions with less do not differ from the others."""
LEAST_SHARE = 0.05
"""Of the squares of a turn or growth, below which the places tell nothing of an axis."""


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
        if share < LEAST_SHARE:
            continue
        w = np.zeros_like(direction)
        w[a] = direction[a]
        t = along_direction(scan, left, w)
        by_model = float(w.ravel() @ scan.null.predicted_part @ w.ravel())
        excess = float(t @ t) / len(t) - variance[a] * share - by_model
        found.append((axis, float(np.sqrt(max(excess, 0.0))) / (share * size)))
    return tuple(found)


def _of_operation(prepared: Prepared, left: FloatArray) -> ScatterSize:
    """The operation that scatters most against all others, along any axis."""
    scan, table = prepared.scan, prepared.table
    variance = variance_by_operation(scan, left)
    code, alone, rest = _most(prepared, left, int(scan.operation[int(np.argmax(variance))]))
    own = scan.operation == code
    if alone is None:
        alone = np.full(1, float(np.mean(scan.null.interaction)) * float(variance[own].mean()))
    s = float(np.sqrt(np.mean(alone)))
    entries, there, share = interaction_entries(scan, left)
    u = s * log_variance_u(entries[there & own], share) / 2
    return ScatterSize(
        parameter=("s", table.unit, s, u),
        of=table.operations[code],
        others=None if rest is None else float(np.sqrt(np.mean(rest))),
        by_axis=_along(table.axes, alone),
        others_by_axis=() if rest is None else _along(table.axes, rest),
    )


def _along(axes: tuple[str, ...], variances: FloatArray) -> tuple[tuple[str, float], ...]:
    if not 1 < len(axes) == len(variances):
        return ()
    return tuple(zip(axes, np.sqrt(variances).tolist(), strict=True))


def _most(
    prepared: Prepared, left: FloatArray, likeliest: int
) -> tuple[int, FloatArray | None, FloatArray | None]:
    """The operation with the largest ratio of variances to all others, and both (A,), None of what
    too few columns tell. Where one of them tells none, it may be that one: the `likeliest` by what
    all columns have in common is taken.
    """
    told, ratio = {}, {}
    for code in np.unique(prepared.scan.operation).tolist():
        own = prepared.scan.operation == code
        alone, rest = told[code] = tuple(_of_columns(prepared, left, w) for w in (own, ~own))
        if alone is not None and rest is not None:
            ratio[code] = float(np.max(alone / np.maximum(rest, 1e-300)))
    most = max(ratio, key=lambda code: ratio[code]) if len(ratio) == len(told) else likeliest
    alone, rest = told[most]
    return most, alone, rest


def _of_columns(prepared: Prepared, left: FloatArray, which: np.ndarray) -> FloatArray | None:
    """Variances (A,) of the entries of some columns beside their own parts, lines and means, by the
    parts that have all of them: those of others, which may scatter by far more, are mixed in with
    what all columns have in common. None where too few are there.
    """
    strata = prepared.scan.frame.strata
    whole = prepared.scan.frame.completion.observed[:, which].all(axis=1)
    own = strata.tables(left)[whole][:, which]
    if len(own) < FEWEST:
        return None
    smooth = strata.columns[which, : 1 + strata.lines]
    # Holes in a row have fewer directions than the part.
    square, turn = np.linalg.eigh(smooth.T @ smooth)
    kept = square > TINY * square[-1]
    basis = smooth @ turn[:, kept] / np.sqrt(square[kept])
    own = own - own.mean(axis=0)
    own = own - np.einsum("hk,gk,pga->pha", basis, basis, own)
    dof = (len(own) - 1) * (int(which.sum()) - basis.shape[1])
    if dof <= 0:
        return None
    found: FloatArray = np.sum(own**2, axis=(0, 1)) / dof
    return found
