"""The effects that a search found, estimated together, and what they say of every cell."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mtu_cli.analyses.close_loop.estimate import (
    EffectFit,
    drawn_covariance,
    estimate,
    raw_design,
)
from mtu_cli.analyses.close_loop.prepare import Prepared
from mtu_cli.analyses.close_loop.search import Search
from mtu_cli.model.effect_library import Member
from mtu_cli.model.residual_table import ResidualTable
from mtu_cli.stats.least_squares import FloatArray

AGREES = 2.0
"""Standard uncertainties within which a mean error agrees with an effect's own mean."""
CENTRED = 1e-9


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
    them of the `levels` (None without either); `prepared` with the null of what is left.
    """

    members: tuple[int, ...]
    fit: EffectFit | None
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


def added(prepared: Prepared, found: Search, seed: int | None = None) -> Added:
    """Estimates the effects of a search; with a `seed`, their covariance as exactly as it can
    be had.
    """
    scan = prepared.scan
    columns = [prepared.flat()[m] for m in found.members]
    left, fit = prepared, _no_fit(prepared)
    if columns:
        fit = estimate(scan, prepared.y, columns)
        for _ in range(2):
            left = prepared.with_null_of(prepared.y - raw_design(scan, columns) @ fit.beta)
            fit = estimate(left.scan, prepared.y, columns)
        if seed is not None and not _plain(left):
            fit = replace(fit, covariance=drawn_covariance(left.scan, columns, fit, seed))
    first = len(scan.columns)
    offsets = [
        scan.offsets[step.index - first]
        for step in found.steps
        if first <= step.index < scan.tested
    ]
    fit, levels = _with_levels(left, found.members, fit, offsets)
    return Added(
        members=found.members,
        fit=fit if len(fit.beta) else None,
        levels=levels,
        prepared=left,
    )


def _no_fit(prepared: Prepared) -> EffectFit:
    none = np.zeros(0)
    weights = np.ones(len(prepared.scan.dof))
    return EffectFit(beta=none, covariance=np.zeros((0, 0)), dof=none, weights=weights)


def _plain(prepared: Prepared) -> bool:
    """Whether coordinates are uncorrelated: a complete table whose axes share nothing."""
    frame = prepared.scan.frame
    shared = prepared.scan.null.common.size > 0 and len(prepared.table.axes) > 1
    return frame.completion.complete and frame.freeing is None and not shared


def _with_levels(
    prepared: Prepared, members: tuple[int, ...], fit: EffectFit, offsets: list[int]
) -> tuple[EffectFit, tuple[Level, ...]]:
    """The mean errors: those found, and those that an effect's own mean disagrees with.

    Effects are found beside a free offset. An equation such as a step's has a mean of its own
    over the data: where the mean error agrees with it, the mean is an observation like others;
    where it does not, the equation needs a level.
    """
    sizes = [len(prepared.members[m].columns) for m in members]
    owners = np.repeat(np.arange(len(members)), sizes)
    means = np.concatenate(
        [np.zeros((0, len(prepared.grand)))] + [prepared.means[m] for m in members]
    )
    beta, C, dof = fit.beta, fit.covariance, fit.dof
    open_axes: list[tuple[int, int | None]] = [(axis, None) for axis in offsets]
    for axis in prepared.scan.offsets:
        m = means[:, axis]
        if axis in offsets or not (np.abs(m) > CENTRED * _sizes(prepared, members)).any():
            continue
        variance = mean_variance(prepared, axis)
        left = prepared.grand[axis] - m @ beta
        total = variance + m @ C @ m
        if left**2 > AGREES**2 * total:
            open_axes.append((axis, int(owners[int(np.argmax(np.abs(m * beta)))])))
            continue
        gain = C @ m / total
        beta, C = beta + gain * left, C - np.outer(gain, m @ C)
    return _opened(prepared, replace(fit, beta=beta, covariance=C, dof=dof), means, open_axes)


def _opened(
    prepared: Prepared,
    fit: EffectFit,
    means: FloatArray,
    open_axes: list[tuple[int, int | None]],
) -> tuple[EffectFit, tuple[Level, ...]]:
    """Levels g - m' beta behind the coefficients, with their covariance."""
    axes = [axis for axis, _ in open_axes]
    k = len(fit.beta)
    M = means[:, axes].T
    spread = np.array([mean_variance(prepared, axis) for axis in axes])
    cross = -M @ fit.covariance
    C = np.block([[fit.covariance, cross.T], [cross, np.diag(spread) - cross @ M.T]])
    parts = max(len(prepared.table.parts) - 1, 1)
    levels = tuple(
        Level(axis=axis, index=k + i, owner=owner) for i, (axis, owner) in enumerate(open_axes)
    )
    whole = replace(
        fit,
        beta=np.concatenate([fit.beta, prepared.grand[axes] - M @ fit.beta]),
        covariance=C,
        dof=np.concatenate([fit.dof, np.full(len(axes), float(parts))]),
    )
    return whole, levels


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
