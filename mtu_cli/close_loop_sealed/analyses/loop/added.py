"""The effects that a search found, estimated together, and what they say of every cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.estimate import (
    drawn_covariance,
    raw_design,
    searched_spread,
)
from mtu_cli.close_loop_sealed.analyses.loop.jointly import jointly
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.analyses.loop.scan import Scan
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.model.effect_library import Member
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.column_groups import MemberColumns
from mtu_cli.close_loop_sealed.stats.loop_frame import grouped
from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit
from mtu_cli.stats.least_squares import FloatArray

AGREES = 2.0
"""Standard uncertainties within which a mean error agrees with an effect's own mean."""
ROUNDING = 1e-9
"""Share of a column's size that its mean is by rounding alone."""
NO_OWNERS: Mapping[int, int] = MappingProxyType({})
NO_VALUES: Mapping[int, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """A mean error along `axis`: coefficient `index` of beta. `owner` is the place of the
    effect whose equation it completes, None where `offset` itself was found.
    """

    axis: int
    index: int
    owner: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """`members` of the effects with columns; the joint `fit` of their coefficients, and behind
    them of the `levels` (None without either); `prepared` with the null of what is left. Their
    covariance were the searched shapes known is `of_shapes`.
    """

    members: tuple[int, ...]
    fit: StratifiedFit | None
    of_shapes: FloatArray
    levels: tuple[Level, ...]
    prepared: Prepared

    def coefficients(self, place: int) -> list[int]:
        """Indices in beta of the parameters of the effect at `place`, its levels last."""
        sizes = [len(self.prepared.members[m].columns) for m in self.members]
        start = sum(sizes[:place])
        own = list(range(start, start + sizes[place]))
        return own + [level.index for level in self.levels if level.owner == place]

    def offset(self, axis: int) -> int:
        """Index in beta of an offset that was found by itself."""
        (index,) = (x.index for x in self.levels if x.owner is None and x.axis == axis)
        return index


def added(
    prepared: Prepared,
    found: Search,
    seed: int | None = None,
    *,
    rough: bool = False,
    owners: Mapping[int, int] = NO_OWNERS,
    values: Mapping[int, float] = NO_VALUES,
) -> Added:
    """Estimates the effects of a search; with a `seed`, their covariance as exactly as it can
    be had; `rough`: by the weights alone, where only the coefficients count. By axis, `owners`
    are the places of effects that get the mean error, whether it agrees with their own or not.
    Of the members `values` what was searched is an estimate, too, by no more than this share of it.
    """
    scan = prepared.scan
    columns = prepared.whole(found.members)
    left, fit = prepared, _no_fit(prepared)
    if columns:
        left, fit = jointly(prepared, columns, rough=rough)
    joint = _joint_covariance(left, columns, fit, seed, rough)
    fit, levels = _with_levels(left, found.members, fit, _offsets(scan, found), joint, owners)
    of_shapes = fit.covariance
    if values:
        spread = _of_searched(left, found.members, fit, levels, values)
        fit = replace(fit, covariance=fit.covariance + spread @ spread.T)
    return Added(
        members=found.members,
        fit=fit if len(fit.beta) else None,
        of_shapes=of_shapes,
        levels=levels,
        prepared=left,
    )


def _offsets(scan: Scan, found: Search) -> list[int]:
    """The axes along which a mean error was found."""
    first = len(scan.columns)
    return [
        scan.offsets[step.index - first]
        for step in found.steps
        if first <= step.index < scan.tested
    ]


def _of_searched(
    prepared: Prepared,
    members: Sequence[int],
    fit: StratifiedFit,
    levels: Sequence[Level],
    values: Mapping[int, float],
) -> FloatArray:
    """S (k, m) of the coefficients and levels; S S' is what the searched values of the members
    `values` add to their covariance. A level makes up for the mean of what the
    effects say, which they move.
    """
    slopes, moved = zip(*(_slope(prepared, members, fit.beta, m) for m in values), strict=True)
    columns, most = prepared.whole(members), np.array([*values.values()])
    spread = searched_spread(prepared.scan, columns, fit.weights, np.stack(slopes, axis=1), most)
    own = len(spread) - len(most)
    means = np.concatenate([*(prepared.means[m] for m in members), np.stack(moved)])
    return np.concatenate([spread[:own], -means[:, [x.axis for x in levels]].T @ spread])


def _slope(
    prepared: Prepared, members: Sequence[int], beta: FloatArray, one: int
) -> tuple[FloatArray, FloatArray]:
    """The derivative by the logarithm of what was searched of what `one` of them says (N,), and
    of the mean of this (A,).
    """
    first = sum(len(prepared.members[m].columns) for m in members[: members.index(one)])
    own = prepared.members[one]
    count = len(own.columns)
    frame, size = prepared.scan.frame, beta[first : first + count]
    (slopes,) = grouped(frame.whole_columns, [own.tangent[:count]])
    means = np.array([frame.means(column) for column in own.tangent[:count]])
    return raw_design(prepared.scan, [slopes]) @ size, size @ means


def _no_fit(prepared: Prepared) -> StratifiedFit:
    none, square = np.zeros(0), np.zeros((0, 0))
    weights = np.ones(len(prepared.scan.dof))
    return StratifiedFit(beta=none, covariance=square, dof=none, weights=weights, at_weights=square)


def _plain(prepared: Prepared) -> bool:
    """Whether coordinates are uncorrelated: a complete table whose axes share nothing."""
    frame = prepared.scan.frame
    shared = prepared.scan.null.common.size > 0 and len(prepared.table.axes) > 1
    return frame.completion.complete and frame.freeing is None and not shared


def _joint_covariance(
    prepared: Prepared,
    columns: Sequence[MemberColumns],
    fit: StratifiedFit,
    seed: int | None,
    rough: bool,
) -> FloatArray:
    """(k + A) x2: of the coefficients and, behind them, of the mean errors."""
    k, A = len(fit.beta), len(prepared.grand)
    found = np.zeros((k + A, k + A))
    found[:k, :k] = fit.covariance
    if rough or _plain(prepared):
        found[k:, k:] = np.diag([mean_variance(prepared, axis) for axis in range(A)])
        return found
    found[:k, :k] -= fit.at_weights
    return found + drawn_covariance(prepared.scan, columns, fit.weights, seed)


def _with_levels(
    prepared: Prepared,
    members: tuple[int, ...],
    fit: StratifiedFit,
    offsets: list[int],
    joint: FloatArray,
    owners: Mapping[int, int],
) -> tuple[StratifiedFit, tuple[Level, ...]]:
    """The mean errors: those found, and those that an effect's own mean disagrees with.

    Effects are found beside a free offset, and so are they estimated: the mean error says
    nothing of their coefficients. An equation such as a step's has a mean of its own over the
    data: where the mean error disagrees with it, the equation needs a level. (To take a mean
    that agrees for an observation of the coefficient drew it towards whatever level there is.)
    `joint` is the covariance of coefficients and mean errors.
    """
    means = np.concatenate(
        [np.zeros((0, len(prepared.grand)))] + [prepared.means[m] for m in members]
    )
    k = len(fit.beta)
    contrasts = np.concatenate([-means.T, np.eye(len(prepared.grand))], axis=1)
    left = prepared.grand - fit.beta @ means
    spread = np.einsum("ai,ij,aj->a", contrasts, joint, contrasts)
    disagrees = left**2 > AGREES**2 * spread
    opened: list[tuple[int, int | None]] = [(axis, None) for axis in offsets]
    for a in (a for a in prepared.scan.offsets if a not in offsets):
        owner = _owner(prepared, members, a, means[:, a], fit.beta) if disagrees[a] else None
        if owners.get(a, owner) is not None:
            opened.append((a, owners.get(a, owner)))
    axes = [axis for axis, _ in opened]
    turn = np.concatenate([np.eye(k, len(joint)), contrasts[axes]])
    dof = [_level_dof(prepared, fit, means[:, axis], axis) for axis in axes]
    levels = tuple(Level(axis=a, index=k + i, owner=owner) for i, (a, owner) in enumerate(opened))
    whole = replace(
        fit,
        beta=np.concatenate([fit.beta, left[axes]]),
        covariance=turn @ joint @ turn.T,
        dof=np.concatenate([fit.dof, dof]),
    )
    return whole, levels


def _owner(
    prepared: Prepared,
    members: tuple[int, ...],
    axis: int,
    means: FloatArray,
    beta: FloatArray,
) -> int | None:
    """The place of the effect whose mean over the data is the largest, None if none has one; of
    those with an equation that it could complete.
    """
    sizes = [len(prepared.members[m].columns) for m in members]
    known = [prepared.members[m] for m in members]
    # A mean that it has for the cells that are missing alone is none of its own.
    said = np.array([bool(own.equations) and axis not in own.centred for own in known], bool)
    written = np.repeat(said, sizes)
    if not (written & (np.abs(means) > ROUNDING * _sizes(prepared, members))).any():
        return None
    owners = np.repeat(np.arange(len(members)), sizes)
    return int(owners[int(np.argmax(written * np.abs(means * beta)))])


def _level_dof(prepared: Prepared, fit: StratifiedFit, m: FloatArray, axis: int) -> float:
    """Of the mean error less the effects' means, by Welch-Satterthwaite (GUM, G.4.1)."""
    scan, null = prepared.scan, prepared.scan.null
    strata = scan.frame.strata
    at = axis * (1 + strata.lines)
    interaction, common = float(null.interaction[axis]), float(null.common[at] @ null.common[at])
    squares = {
        "part": interaction + float(null.part[at, at]),
        "column": interaction + strata.shape[0] * float(null.column[axis]),
        "interaction": -interaction,
    }
    size = strata.shape[0] * strata.shape[1]
    terms = [(common / size, null.model_dof)]
    terms += zip((m**2 * np.diag(fit.covariance)).tolist(), fit.dof.tolist(), strict=True)
    for stratum, n in zip(strata.all, scan.dof, strict=True):
        if stratum.axis == axis and stratum.kind in squares and n > 0:
            terms.append((squares[stratum.kind] / size, float(n)))
    total = sum(variance for variance, _ in terms)
    # What has no degrees of freedom says nothing of its own scatter: one in all is the least.
    doubt = sum(v**2 / max(nu, 1e-12) for v, nu in terms)
    return float(max(total**2 / max(doubt, 1e-300), 1.0))


def _sizes(prepared: Prepared, members: tuple[int, ...]) -> FloatArray:
    """Root mean square of every column, to tell a mean from rounding."""
    columns = [column for m in members for column in prepared.members[m].columns]
    return np.array([max(float(np.sqrt(np.mean(v**2))) for v in c.values()) for c in columns])


def mean_variance(prepared: Prepared, axis: int) -> float:
    """Variance of the mean error along an axis: of parts, columns, entries and the model."""
    scan, null = prepared.scan, prepared.scan.null
    P, H, _ = scan.frame.strata.shape
    at = axis * (1 + scan.frame.strata.lines)
    common = float(null.common[at] @ null.common[at])
    part = float(null.part[at, at])
    total = float(null.interaction[axis]) + P * float(null.column[axis]) + part + common
    return total / (P * H)


def contribution(effects: Added, table: ResidualTable, members: tuple[Member, ...]) -> FloatArray:
    """What the effects say (P, H, A) of the cells of a table that `members` are columns of."""
    total = np.zeros(table.errors.shape)
    if effects.fit is None:
        return total
    index = 0
    for member in members:
        for column in member.columns:
            for axis, lever in column.items():
                total[:, :, axis] += effects.fit.beta[index] * lever
            index += 1
    for level in effects.levels:
        total[:, :, level.axis] += effects.fit.beta[level.index]
    if table.datum == "none":
        return total
    freed: FloatArray = table.freed(total[..., None])[..., 0]
    return freed
