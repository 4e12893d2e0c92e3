"""How large a scatter is that was found: of turns, of growths, of one operation.

t (P - 1) are the contrasts of the parts along the unit vector of a turn (or a growth) of features
at distances r from their middle: t't has the mean (P - 1) k s^2 sum r^2 + n, n by what scatters
parts else (see `direction_noise`), k what is left of turns where missing cells are filled in.
Solved for s that is the estimate of moments, with the u of a sum of squares of P - 1 degrees of
freedom. Variances of operations are told apart by what is left of their entries beside their own
lines and columns (`lines_and_columns`), u(ln s^2)^2 = (2 + excess kurtosis) / degrees of freedom
(Box, Biometrika 40 (1953) 318).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.evidence import (
    OPERATIONS,
    along_direction,
    interaction_entries,
    variance_by_operation,
)
from mtu_cli.close_loop_sealed.analyses.loop.found_scatter import ScatterSize
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.scatter_rivals import ROTATION
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.stats.alike_lines import apart_from_whole, p_alike
from mtu_cli.close_loop_sealed.stats.loose_columns import beside_lines_and_columns, log_variance_u
from mtu_cli.close_loop_sealed.stats.mean_squares import EntryNoise
from mtu_cli.stats.least_squares import FloatArray

FEWEST = 4
"""Degrees of freedom that tell a scatter: its u is a third of it then."""
AT_ONCE = 32
"""Parts whose turns are looked at together."""
ROUNDING = 1e-12
"""Of the variance of all entries."""
LEAST_LEFT = 1e-3
"""Of an entry's variance beside its part's line, below which nothing is told of its tails."""
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
    axes = _axes(scan.directions[which])
    kept, *kept_by_axis = _kept(prepared, scan.directions[which], [*axes.values()])
    reach = kept * float(np.sum((places - places.mean(axis=0)) ** 2))
    square = float(t @ t)
    if square <= expected or reach == 0:
        return None
    s = np.sqrt((square - expected) / len(t) / reach)
    u = np.sqrt(2 / len(t)) * square / len(t) / reach / (2 * s)
    unit = "arcsec" if name == ROTATION else "um/m"
    size = np.sqrt(reach / kept)
    alone = _along_axes(prepared, left, noise, axes, kept_by_axis)
    return ScatterSize(
        parameter=("s", unit, float(s), float(u)),
        by_axis=tuple((prepared.table.axes[own.axis], own.root / size) for own in alone),
        u_by_axis=tuple(own.u / size for own in alone),
        p_alike=_p_alike(prepared, left, noise, scan.directions[which], alone),
    )


def _axes(direction: FloatArray) -> dict[int, FloatArray]:
    """By axis the part of a `direction` (A, 1 + k) along it, where the places tell of it."""
    found = {}
    for a in range(len(direction)):
        if float(np.sum(direction[a] ** 2)) >= LEAST_SHARE:
            found[a] = np.zeros_like(direction)
            found[a][a] = direction[a]
    return found


def _kept(prepared: Prepared, direction: FloatArray, parts: Sequence[FloatArray]) -> list[float]:
    """Of the squares that parts have along a `direction` (A, 1 + k), which one of them has by
    itself, the share that is seen along it, and along the `parts` of it: less than 1, and than the
    square of a part's own share, where cells are missing, as what is filled in has none of it.
    """
    frame, alongs = prepared.scan.frame, [direction, *parts]
    if frame.completion.complete:
        return [float(np.sum(direction * along)) ** 2 for along in alongs]
    P, H, A = frame.strata.shape
    one = np.einsum("hk,ak->ha", frame.strata.columns[:, : direction.shape[1]], direction)
    total = np.zeros(len(alongs))
    for first in range(0, P, AT_ONCE):
        own = np.arange(first, min(first + AT_ONCE, P))
        tables = np.zeros((len(own), P, H, A))
        tables[np.arange(len(own)), own] = one
        for y in frame.coordinates(tables)[0]:
            for i, along in enumerate(alongs):
                t = along_direction(prepared.scan, y, along)
                total[i] += float(t @ t)
    return [float(found) for found in total / (P - 1)]


class _Along(NamedTuple):
    """What is seen of turns or growths along one axis alone: the parts' contrasts `t` (P - 1,),
    which have `share` of them and their squares `kept`, and scatter else by `variance`.
    """

    axis: int
    t: FloatArray
    share: float
    kept: float
    variance: float

    @property
    def root(self) -> float:
        """The standard deviation of the whole turns' contrasts by this axis."""
        excess = float(self.t @ self.t) / len(self.t) - self.variance
        return float(np.sqrt(max(excess, 0.0) / self.kept)) / self.share

    @property
    def u(self) -> float:
        """Of that: u(s) = u(s^2) / 2 s, and sqrt(u(s^2)) where s^2 is hardly told from 0, about
        which a root is no straight line.
        """
        square = float(self.t @ self.t) / len(self.t) / self.kept / self.share**2
        of_square = float(np.sqrt(2 / len(self.t))) * square
        return float(of_square / max(2 * self.root, np.sqrt(of_square), 1e-300))


def _along_axes(
    prepared: Prepared,
    left: FloatArray,
    noise: EntryNoise,
    axes: Mapping[int, FloatArray],
    kept: Sequence[float],
) -> list[_Along]:
    """By the `axes`' parts of a direction, of whose squares are `kept`."""
    scan, found = prepared.scan, []
    for (a, w), own in zip(axes.items(), kept, strict=True):
        share = float(np.sum(w**2))
        by_model = float(w.ravel() @ scan.null.predicted_part @ w.ravel())
        t, variance = along_direction(scan, left, w), float(noise.variance[a]) * share + by_model
        found.append(_Along(a, t, share, own / share**2, variance))
    return found


def _p_alike(
    prepared: Prepared,
    left: FloatArray,
    noise: EntryNoise,
    direction: FloatArray,
    alone: Sequence[_Along],
) -> float | None:
    """That two axes have the same turns but for what scatters else."""
    if len(alone) != 2:
        return None
    scan, axes = prepared.scan, [own.axis for own in alone]
    apart = apart_from_whole(direction[axes], [whole[axes] for whole in scan.directions])
    if apart is None:
        return None
    by_entries = float(noise.variance[axes] @ np.sum(apart**2, axis=1))
    # What the model says of the difference, which a yaw or a growth of both axes has none of.
    by_all = np.zeros_like(direction)
    by_all[axes] = apart
    by_model = float(by_all.ravel() @ scan.null.predicted_part @ by_all.ravel())
    strata = scan.frame.strata
    return p_alike(
        strata.tables(left)[:, :, axes],
        scan.frame.completion.observed,
        strata.columns[:, : direction.shape[1]],
        apart,
        np.sqrt(noise.variance[axes]),
        1.0 + by_model / by_entries if by_entries > 0 else 1.0,
    )


def _of_operation(prepared: Prepared, left: FloatArray) -> ScatterSize:
    """The operation that scatters most against all others, along any axis.

    Where its own columns are too few to tell (no more than a line of a part takes), its size is
    what `variance_by_operation` has of all columns, of all axes together.
    """
    scan, table = prepared.scan, prepared.table
    variance = variance_by_operation(scan, left)
    code, alone, rest = _most(prepared, left, int(scan.operation[int(np.argmax(variance))]))
    own = scan.operation == code
    if alone is None:
        s = float(np.sqrt(np.mean(scan.null.interaction) * variance[own].mean()))
        entries, there, share = interaction_entries(scan, left)
        u = s * log_variance_u(entries[there & own], share) / 2
    else:
        s, u = alone.root, alone.u
    by_axis = () if alone is None else _along(table.axes, alone.variance)
    return ScatterSize(
        parameter=("s", table.unit, s, u),
        of=table.operations[code],
        others=None if rest is None else rest.root,
        by_axis=by_axis,
        u_by_axis=() if alone is None else tuple(alone.u_by_axis.tolist())[: len(by_axis)],
        others_by_axis=() if rest is None else _along(table.axes, rest.variance),
    )


def _along(axes: tuple[str, ...], variances: FloatArray) -> tuple[tuple[str, float], ...]:
    if not 1 < len(axes) == len(variances):
        return ()
    return tuple(zip(axes, np.sqrt(variances).tolist(), strict=True))


class _Spread(NamedTuple):
    """Variances (A,) of the entries of some columns, and u of their logarithms."""

    variance: FloatArray
    u_of_log: FloatArray

    @property
    def u_by_axis(self) -> FloatArray:
        """Standard uncertainties (A,) of the standard deviations along each axis."""
        return np.asarray(np.sqrt(self.variance) * self.u_of_log / 2)

    @property
    def root(self) -> float:
        """The standard deviation of all axes together."""
        return float(np.sqrt(np.mean(self.variance)))

    @property
    def u(self) -> float:
        """The standard uncertainty of that."""
        u_of_mean = np.sqrt(np.sum((self.variance * self.u_of_log) ** 2)) / len(self.variance)
        return float(u_of_mean / (2 * self.root)) if self.root > 0 else np.inf


def _most(
    prepared: Prepared, left: FloatArray, likeliest: int
) -> tuple[int, _Spread | None, _Spread | None]:
    """The operation that stands out most among all others, along any axis, by the logarithm of the
    variances' ratio in its u; and both, None of what too few columns tell. Where one of the
    operations tells none, it may be that one: the `likeliest` by what all columns have in common
    is taken.
    """
    told, clear = {}, {}
    for code in np.unique(prepared.scan.operation).tolist():
        own = prepared.scan.operation == code
        alone, rest = told[code] = tuple(_of_columns(prepared, left, w) for w in (own, ~own))
        if alone is not None and rest is not None:
            clear[code] = _clearness(alone, rest)
    known = len(clear) == len(told) and max(clear.values()) > -np.inf
    most = max(clear, key=lambda code: clear[code]) if known else likeliest
    alone, rest = told[most]
    return most, alone, rest


def _clearness(alone: _Spread, rest: _Spread) -> float:
    """The largest log ratio of two variances over the axes, in its standard uncertainty; an axis
    along which nothing scatters tells none.
    """
    told = (alone.variance > 0) & (rest.variance > 0)
    if not told.any():
        return -np.inf
    u = np.hypot(alone.u_of_log[told], rest.u_of_log[told])
    return float(np.max(np.log(alone.variance[told] / rest.variance[told]) / u))


def _of_columns(prepared: Prepared, left: FloatArray, which: np.ndarray) -> _Spread | None:
    """The entries of some columns beside their own parts, lines and means: those of others, which
    may scatter by far more, are mixed in with what all columns have in common. None where too few
    are there.
    """
    strata = prepared.scan.frame.strata
    there = prepared.scan.frame.completion.observed[:, which]
    smooth = strata.columns[which, : 1 + strata.lines]
    entries, share, dof = beside_lines_and_columns(strata.tables(left)[:, which], there, smooth)
    if dof < FEWEST:
        return None
    variance = np.sum(entries**2, axis=(0, 1)) / dof
    # What rounding leaves of an axis along which nothing differs is no scatter.
    variance = np.where(variance > ROUNDING * prepared.scan.null.interaction, variance, 0.0)
    # Entries of which a line leaves less would look like ones of heavy tails beside the others.
    seen = share > LEAST_LEFT
    alike = entries[seen] / np.sqrt(share[seen])[:, None]
    known = [log_variance_u(column, dof / len(alike)) for column in alike.T]
    return _Spread(variance, np.array(known))
