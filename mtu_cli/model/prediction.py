"""Errors of points with their full covariance: the propagation that every command uses.

For points p, q of one future part and a component with design rows x_p, x_q

    Cov = x_p' (C + D) x_q + [p = q] s_repeat^2,

C the coefficients' covariance, D the pass-to-pass covariance, s_repeat the repeatability of
one visit. Gilsinn & Ling 2004, eq. (18), is the case in which all of it counts as repeatability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mtu_cli.model.estimates import term_label
from mtu_cli.model.machine_model import (
    Covariates,
    Design,
    MachineModel,
    check_covariates,
    design,
    places,
    theta,
)
from mtu_cli.model.temperatures import temperature_blocks
from mtu_cli.model.variance import (
    Block,
    MeanSquares,
    PassSquare,
    Variance,
    block_variance,
    component_blocks,
    drawable_passes,
    normal_block,
    pass_squares,
)
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.coverage import effective_dof
from mtu_cli.stats.least_squares import FloatArray

NEGLIGIBLE = 1e-9
"""A change of lever arms below this share of the arms is rounding."""
INDEFINITE = 1e-9
"""Of the largest eigenvalue: what is further below 0 is no rounding."""


def constant_effects(
    model: MachineModel, points: FloatArray, covariates: Covariates, centre: Design
) -> tuple[list[Block], FloatArray]:
    """What the constants' uncertainties do: blocks, and a shift (rows,) of the mean, mm.

    First and second order in every uncertain constant c (JCGM 100, 5.1.2, note): dE/dc and
    d2E/dc2 by central differences over one standard uncertainty. A constant is a lever arm of
    components that are uncertain themselves: their product adds u(c)^2 (dJ/dc) (C + D) (dJ/dc)'.
    `centre` is the design at the constants' values.
    """
    mean = centre.J @ theta(model) + centre.remainder
    blocks: list[Block] = []
    shift = np.zeros(len(mean))
    for name, (value, u) in model.constants.items():
        if u == 0:
            continue
        up, down = (
            design(replace(model, constants=model.constants | {name: (end, u)}), points, covariates)
            for end in (value + u, value - u)
        )
        at_up, at_down = (side.J @ theta(model) + side.remainder for side in (up, down))
        curve = (at_up + at_down - 2 * mean) / 2
        # Rounding of a difference of errors is no curvature.
        curve = np.where(np.abs(curve) > NEGLIGIBLE * np.abs(at_up - mean), curve, 0.0)
        blocks.append(normal_block(name, ((at_up - at_down) / 2)[:, None]))
        if curve.any():
            blocks.append(normal_block(f"{name}^2", np.sqrt(2.0) * curve[:, None]))
        shift += curve
        change = (up.J - down.J) / 2
        if np.abs(change).max() > NEGLIGIBLE * np.abs(centre.J).max():
            levers = (up.levers - down.levers) / 2
            blocks += component_blocks(model, change, levers, centre.columns)
    return blocks, shift


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Errors at n points in a axes; rows are (point, axis), points first: `mean` (n*a,) in mm,
    `independent_variance` (n*a,) under the papers' independence; `outside` lists (point, component
    or its drift, position, low, high) beyond the measured range.
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
        result: dict[str, list[str]] = {}
        for point, component, *_ in self.outside:
            result.setdefault(point, []).append(component)
        return result

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (n*a, n*a) of the errors of one future part, mm^2.

        It may have a negative part where D has; `drawable` has none.
        """
        return self.assembled()

    @cached_property
    def drawable(self) -> FloatArray:
        """The same without the negative part of any D: a covariance, somewhat too large."""
        return self.assembled(drawable=True)

    @cached_property
    def scatter(self) -> FloatArray:
        """The part of the covariance that differs from one part to the next: passes and visits."""
        return self.assembled(coefficients=0.0)

    def assembled(
        self, *, drawable: bool = False, coefficients: float = 1.0, by_point: bool = False
    ) -> FloatArray:
        """sum G (C + D) G' of the blocks, and visits, which the axes of a point share: (n*a, n*a)
        or, `by_point`, that (n, a, a) of each point alone.
        """
        n, a = len(self.points), len(self.axes)
        total = np.zeros((n, a, a) if by_point else (n * a, n * a))
        each = np.arange(n)
        for block in self.blocks:
            D = drawable_passes(block.D, block.C) if drawable else block.D
            M, noise = coefficients * block.C + D, block.noise.reshape(n, a, -1)
            visits = np.einsum("pic,pjc->pij", noise, noise)
            if by_point:
                G = block.G.reshape(n, a, -1)
                total += G @ M @ G.transpose(0, 2, 1) + visits
            else:
                total += block.G @ M @ block.G.T
                total.reshape(n, a, n, a)[each, :, each, :] += visits
        return total

    def first(self, count: int) -> Prediction:
        """The same of the first `count` points alone."""
        rows = slice(count * len(self.axes))
        return replace(
            self,
            ids=self.ids[:count],
            points=self.points[:count],
            mean=self.mean[rows],
            blocks=tuple(replace(x, G=x.G[rows], noise=x.noise[rows]) for x in self.blocks),
            independent_variance=self.independent_variance[rows],
        )

    def row(self, point: str, axis: str) -> int:
        """Row of a point's error along an axis."""
        return self.ids.index(point) * len(self.axes) + self.axes.index(axis)

    def pass_squares(self, A: FloatArray) -> list[PassSquare | None]:
        """What of the mean squares of `variance`, in their order, is of passes."""
        return [result for block in self.blocks for result in pass_squares(block, A)]

    def variance(self, A: FloatArray | None = None) -> Variance:
        """Variance of the linear measurands A E, A (m, n*a): law of propagation with covariance.
        Without A of the errors themselves, (n*a,). Effective degrees of freedom by
        Welch-Satterthwaite (JCGM 100, G.4.1) over the independent mean squares behind it
        (`variance.block_variance`), and never fewer than the least of them: where one is subtracted
        the formula alone would give next to none.
        """
        found = [block_variance(block, A, len(self.axes)) for block in self.blocks]
        parts = np.array([part for part, _ in found])
        behind = MeanSquares(
            of_mean=np.concatenate([own.of_mean for _, own in found]),
            of_part=np.concatenate([own.of_part for _, own in found]),
            dof=np.concatenate([own.dof for _, own in found]),
        )
        by_block, split = parts.sum(axis=1), parts.sum(axis=0)
        total = by_block.sum(axis=0)
        squares = behind.of_mean + behind.of_part
        least = np.where(squares == 0, np.inf, behind.dof[:, None]).min(axis=0)
        return Variance(
            total=total,
            dof=np.maximum(effective_dof(total, squares, behind.dof), least),
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
    covariates: Covariates | None = None,
) -> Prediction:
    """The errors (actual minus nominal) that the machine makes at `points` (n, 3), mm.

    `covariates` gives each covariate of the equations a value, or one a point.

    Raises InputError for a missing covariate or coordinate.
    """
    given = covariates or {}
    check_covariates(model, given)
    rows = design(model, points, given)
    blocks = component_blocks(model, rows.J, rows.levers, rows.columns)
    of_constants, shift = constant_effects(model, points, given, rows)
    others = temperature_blocks(model, points, given, rows.levers)
    others += [*table_blocks(model, points, rows.levers), *of_constants]
    independent = np.zeros(len(rows.J))
    for t, term in enumerate(model.terms):
        # Gilsinn & Ling 2004, eqs. (9)-(11); for a component of a machine file, whose readings are
        # not at hand, the same total variance without its correlation.
        known, G = term.estimate, rows.J[:, rows.columns[t]]
        C, s2 = known.covariance + known.pass_covariance, known.s_repeat**2
        if known.independent_covariance is not None and known.independent_s is not None:
            C, s2 = known.independent_covariance, known.independent_s**2
        independent += np.einsum("ri,ij,rj->r", G, C, G) + rows.levers[:, t] ** 2 * s2
    for block in others:
        independent += np.einsum("ri,ij,rj->r", block.G, block.C + block.D, block.G)
        independent += (block.noise**2).sum(axis=1)
    outside = []
    place = places(model, points)
    for estimate in (term.estimate for term in model.terms):
        if estimate.of is None or estimate.position_range is None:
            continue
        (low, high), position = estimate.position_range, place[estimate.of]
        beyond = np.flatnonzero((position < low - 1e-9) | (position > high + 1e-9)).tolist()
        name = term_label(estimate.name)
        outside += [(ids[i], name, float(position[i]), low, high) for i in beyond]
    return Prediction(
        ids=tuple(ids),
        axes=model.axes,
        points=points,
        mean=rows.J @ theta(model) + rows.remainder + shift,
        blocks=(*blocks, *others),
        independent_variance=independent,
        outside=tuple(outside),
    )


def table_blocks(model: MachineModel, points: FloatArray, levers: FloatArray) -> list[Block]:
    """What tables leave open between and beyond their positions, of all parts alike, and the bends
    of runs (`basis.TableShape`); `levers` (rows, terms).
    """
    blocks, place = [], places(model, points)
    for t, term in enumerate(model.terms):
        table, axis = term.estimate.table, term.estimate.of
        if table is None or axis is None:
            continue
        positions, at = np.unique(place[axis], return_inverse=True)
        G = np.repeat(np.eye(len(positions))[at], len(model.axes), axis=0) * levers[:, t, None]
        for of_part, C in ((False, table.left_open(positions)), (True, table.of_runs(positions))):
            if C.any():
                block = normal_block(term.estimate.name, G @ covariance_root(C), of_part=of_part)
                blocks.append(replace(block, pass_dof=table.own_dof) if of_part else block)
    return blocks


def reportable(
    prediction: Prediction, variance: FloatArray, *, by_point: bool = False
) -> FloatArray:
    """The covariance (rows, rows), or those (n, a, a) of each point alone, with the variances
    (rows,), without negative eigenvalues, as reports and pictures show it: D that is estimated
    without bias may have a negative part; correlations are those without it. The prediction's own
    where it has both already.
    """
    wanted = variance.reshape(-1, len(prediction.axes)) if by_point else variance
    own = prediction.assembled(by_point=True) if by_point else prediction.covariance
    if np.allclose(np.einsum("...ii->...i", own), wanted, rtol=1e-9, atol=0.0):
        # C + D of every block a covariance: then so is their sum, however many rows.
        sound = not any(_indefinite(block.C + block.D) for block in prediction.blocks)
        if sound or not (by_point or _indefinite(own)):
            return own
    own = prediction.assembled(drawable=True, by_point=True) if by_point else prediction.drawable
    drawn = np.einsum("...ii->...i", own)
    ratio = np.sqrt(np.divide(wanted, drawn, out=np.zeros_like(drawn), where=drawn > 0))
    return own * ratio[..., :, None] * ratio[..., None, :]


def _indefinite(matrix: FloatArray) -> bool:
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    return bool(values[0] < -INDEFINITE * abs(values[-1]))
