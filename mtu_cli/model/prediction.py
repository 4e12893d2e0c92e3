"""Errors of points with their full covariance: the propagation that every command uses.

For points p, q of one future part and a component with design rows x_p, x_q

    Cov = x_p' (C + D) x_q + [p = q] s_repeat^2,

C the coefficients' covariance, D the pass-to-pass covariance, s_repeat the repeatability of
one visit. Gilsinn & Ling 2004, eq. (18), is the case in which all of it counts as repeatability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.model.blocks import component_blocks
from mtu_cli.model.constants import constant_effects
from mtu_cli.model.design import design, places, theta
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.machine_model import MachineModel, check_covariates
from mtu_cli.model.temperatures import temperature_blocks
from mtu_cli.model.thermal_terms import term_label
from mtu_cli.model.variance import (
    Block,
    PassSquare,
    Variance,
    block_variance,
    drawable_passes,
    joined,
    noise_covariance,
    of_rows,
    pass_squares,
)
from mtu_cli.stats.coverage import effective_dof
from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Errors at n points in a axes; rows are (point, axis), points first.

    `mean` (n*a,) in mm, `independent_variance` (n*a,) under the papers' independence.
    `outside` lists (point, component or its drift, position, low, high) beyond the measured range.
    """

    ids: tuple[str, ...]
    axes: tuple[str, ...]
    points: FloatArray
    mean: FloatArray
    blocks: tuple[Block, ...]
    independent_variance: FloatArray
    outside: tuple[tuple[str, str, float, float, float], ...]

    @cached_property
    def beyond(self) -> dict[str, list[str]]:
        """The components beyond their measured range, by the point that is outside it."""
        found: dict[str, list[str]] = {}
        for point, component, *_ in self.outside:
            found.setdefault(point, []).append(component)
        return found

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (n*a, n*a) of the errors of one future part, mm^2.

        It may have a negative part where D has; `drawable` has none.
        """
        return self._assembled([block.D for block in self.blocks])

    @cached_property
    def drawable(self) -> FloatArray:
        """The same without the negative part of any D: a covariance, somewhat too large."""
        return self._assembled([drawable_passes(block.D, block.C) for block in self.blocks])

    @cached_property
    def of_points(self) -> FloatArray:
        """Covariances (n, a, a) of the errors of each point alone: blocks of `covariance`."""
        return self._assembled_of_points([block.D for block in self.blocks])

    @cached_property
    def drawable_of_points(self) -> FloatArray:
        """The same of `drawable`."""
        return self._assembled_of_points([drawable_passes(b.D, b.C) for b in self.blocks])

    def covariance_of(self, A: FloatArray) -> FloatArray:
        """Covariance (m, m) of the linear measurands A E, A (m, n*a); as `covariance` has it."""
        total = self.scatter_of(A)
        for block in self.blocks:
            g = A @ block.G
            total += g @ block.C @ g.T
        return total

    def scatter_of(self, A: FloatArray) -> FloatArray:
        """The part of that which differs from one part to the next: of passes and visits."""
        total = np.zeros((len(A), len(A)))
        for block in self.blocks:
            g = A @ block.G
            total += g @ block.D @ g.T
            for column in block.noise.T:
                visits = (A * column).reshape(len(A), -1, len(self.axes)).sum(axis=2)
                total += visits @ visits.T
        return total

    def first(self, count: int) -> Prediction:
        """The same of the first `count` points alone."""
        rows = slice(count * len(self.axes))
        return replace(
            self,
            ids=self.ids[:count],
            points=self.points[:count],
            mean=self.mean[rows],
            blocks=tuple(of_rows(block, rows) for block in self.blocks),
            independent_variance=self.independent_variance[rows],
        )

    def pass_squares(self, A: FloatArray) -> list[PassSquare | None]:
        """What of the mean squares of `variance`, in their order, is of passes."""
        return [found for block in self.blocks for found in pass_squares(block, A)]

    def _assembled(self, passes: Sequence[FloatArray]) -> FloatArray:
        rows = len(self.mean)
        total = np.zeros((rows, rows))
        for block, D in zip(self.blocks, passes, strict=True):
            total += block.G @ (block.C + D) @ block.G.T
            total += noise_covariance(block.noise, len(self.axes))
        return total

    def _assembled_of_points(self, passes: Sequence[FloatArray]) -> FloatArray:
        n, a = len(self.points), len(self.axes)
        total = np.zeros((n, a, a))
        for block, D in zip(self.blocks, passes, strict=True):
            G, noise = (rows.reshape(n, a, rows.shape[1]) for rows in (block.G, block.noise))
            total += G @ (block.C + D) @ G.transpose(0, 2, 1) + noise @ noise.transpose(0, 2, 1)
        return total

    def row(self, point: str, axis: str) -> int:
        """Row of a point's error along an axis."""
        return self.ids.index(point) * len(self.axes) + self.axes.index(axis)

    def variance(self, A: FloatArray | None = None) -> Variance:
        """Variance of the linear measurands A E, A (m, n*a): law of propagation with covariance.
        Without A of the errors themselves, (n*a,).

        Effective degrees of freedom by Welch-Satterthwaite (JCGM 100, G.4.1) over the
        independent mean squares behind the variance (see `variance.block_variance`), and never
        fewer than the least of them: where one mean square is subtracted the formula alone
        would give next to none.
        """
        parts = [block_variance(block, A, len(self.axes)) for block in self.blocks]
        by_block = np.array([part.sum(axis=0) for part, _ in parts])
        total = by_block.sum(axis=0)
        behind = joined([found for _, found in parts])
        squares = behind.of_mean + behind.of_part
        least = np.where(squares == 0, np.inf, behind.dof[:, None]).min(axis=0)
        dof: FloatArray = np.maximum(effective_dof(total, squares, behind.dof), least)
        split = np.array([part for part, _ in parts]).sum(axis=0)
        return Variance(
            total=total,
            dof=dof,
            by_block=by_block,
            coefficients=split[0],
            passes=split[1],
            repeatability=split[2],
            squares=behind,
        )


def predict(
    model: MachineModel,
    ids: Sequence[str],
    points: FloatArray,
    covariates: Mapping[str, FloatArray | float] | None = None,
) -> Prediction:
    """The errors (actual minus nominal) that the machine makes at `points` (n, 3), mm.

    `covariates` gives each covariate of the equations a value, or one a point.

    Raises InputError for a missing covariate or coordinate.
    """
    given = covariates or {}
    check_covariates(model, given)
    rows = design(model, points, given)
    blocks = component_blocks(model, rows.J, rows.levers, rows.columns)
    noise = temperature_blocks(model, points, given, rows.levers)
    constants = constant_effects(model, points, given, rows)
    return Prediction(
        ids=tuple(ids),
        axes=model.axes,
        points=points,
        mean=rows.J @ theta(model) + rows.remainder + constants.shift,
        blocks=(*blocks, *noise, *constants.blocks),
        independent_variance=_independent(model, rows.J, rows.levers, rows.columns)
        + sum(
            ((block.G**2).sum(axis=1) + (block.noise**2).sum(axis=1) for block in noise),
            np.zeros(len(rows.J)),
        )
        + constants.variance,
        outside=_outside(model, ids, points),
    )


def independent_parts(estimate: ComponentEstimate) -> tuple[FloatArray, float]:
    """(k, k) and s^2 such that a future observation has variance x'Cx + s^2.

    Gilsinn & Ling 2004, eqs. (9)-(11); for a component of a machine file, whose readings
    are not at hand, the same total variance without its correlation.
    """
    if estimate.independent_covariance is not None and estimate.independent_s is not None:
        return estimate.independent_covariance, estimate.independent_s**2
    return estimate.covariance + estimate.pass_covariance, estimate.s_repeat**2


def _independent(
    model: MachineModel, J: FloatArray, levers: FloatArray, columns: Sequence[slice]
) -> FloatArray:
    total = np.zeros(len(J))
    for t, term in enumerate(model.terms):
        C, s2 = independent_parts(term.estimate)
        G = J[:, columns[t]]
        total += np.einsum("ri,ij,rj->r", G, C, G) + levers[:, t] ** 2 * s2
    return total


def _outside(
    model: MachineModel, ids: Sequence[str], points: FloatArray
) -> tuple[tuple[str, str, float, float, float], ...]:
    found = []
    place = places(model, points)
    for term in model.terms:
        estimate = term.estimate
        if estimate.of is None or estimate.position_range is None:
            continue
        low, high = estimate.position_range
        name = term_label(estimate.name)
        position = place[estimate.of]
        beyond = np.flatnonzero((position < low - 1e-9) | (position > high + 1e-9))
        found += [(ids[int(i)], name, float(position[i]), low, high) for i in beyond]
    return tuple(found)
