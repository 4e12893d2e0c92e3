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
from typing import NamedTuple

import numpy as np

from mtu_cli.model.estimates import ComponentEstimate, term_label
from mtu_cli.model.machine_model import (
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
    PassSquare,
    Variance,
    block_variance,
    component_blocks,
    drawable_passes,
    joined,
    noise_covariance,
    normal_block,
    of_rows,
    pass_squares,
)
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.coverage import effective_dof
from mtu_cli.stats.least_squares import FloatArray

NEGLIGIBLE = 1e-9
"""A change of lever arms below this share of the arms is rounding."""


class ConstantEffects(NamedTuple):
    """What the constants' uncertainties do to the errors: blocks, and a shift (rows,) of the mean,
    mm.
    """

    blocks: tuple[Block, ...]
    shift: FloatArray


def constant_effects(
    model: MachineModel,
    points: FloatArray,
    covariates: Mapping[str, FloatArray | float],
    centre: Design,
) -> ConstantEffects:
    """First and second order in every uncertain constant c (JCGM 100, 5.1.2, note).

    dE/dc and d2E/dc2 by central differences over one standard uncertainty. A constant is a
    lever arm of components that are uncertain themselves: their product adds
    u(c)^2 (dJ/dc) (C + D) (dJ/dc)', which is all there is where the components' mean is 0.
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
    return ConstantEffects(blocks=tuple(blocks), shift=shift)


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
        return self._assembled(drawable=False)

    @cached_property
    def drawable(self) -> FloatArray:
        """The same without the negative part of any D: a covariance, somewhat too large."""
        return self._assembled(drawable=True)

    def _assembled(self, *, drawable: bool) -> FloatArray:
        total = np.zeros((len(self.mean), len(self.mean)))
        for block in self.blocks:
            D = drawable_passes(block.D, block.C) if drawable else block.D
            total += block.G @ (block.C + D) @ block.G.T
            total += noise_covariance(block.noise, len(self.axes))
        return total

    def of_points(self, *, drawable: bool) -> FloatArray:
        """Covariances (n, a, a) of the errors of each point alone: blocks of `covariance`, or of
        `drawable`.
        """
        n, a = len(self.points), len(self.axes)
        total = np.zeros((n, a, a))
        for block in self.blocks:
            D = drawable_passes(block.D, block.C) if drawable else block.D
            G, noise = (rows.reshape(n, a, rows.shape[1]) for rows in (block.G, block.noise))
            total += G @ (block.C + D) @ G.transpose(0, 2, 1) + noise @ noise.transpose(0, 2, 1)
        return total

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
    noise += table_blocks(model, points, rows.levers)
    constants = constant_effects(model, points, given, rows)
    independent = np.zeros(len(rows.J))
    for t, term in enumerate(model.terms):
        C, s2 = independent_parts(term.estimate)
        G = rows.J[:, rows.columns[t]]
        independent += np.einsum("ri,ij,rj->r", G, C, G) + rows.levers[:, t] ** 2 * s2
    of_sensors, of_constants = np.zeros((2, len(rows.J)))
    for block in noise:
        of_sensors += (block.G**2).sum(axis=1) + (block.noise**2).sum(axis=1)
    for block in constants.blocks:
        C, visits = block.C + block.D, (block.noise**2).sum(axis=1)
        of_constants += np.einsum("ri,ij,rj->r", block.G, C, block.G) + visits
    outside = []
    place = places(model, points)
    for estimate in (term.estimate for term in model.terms):
        if estimate.of is None or estimate.position_range is None:
            continue
        (low, high), position = estimate.position_range, place[estimate.of]
        beyond = np.flatnonzero((position < low - 1e-9) | (position > high + 1e-9))
        name = term_label(estimate.name)
        outside += [(ids[int(i)], name, float(position[i]), low, high) for i in beyond]
    return Prediction(
        ids=tuple(ids),
        axes=model.axes,
        points=points,
        mean=rows.J @ theta(model) + rows.remainder + constants.shift,
        blocks=(*blocks, *noise, *constants.blocks),
        independent_variance=independent + of_sensors + of_constants,
        outside=tuple(outside),
    )


def table_blocks(model: MachineModel, points: FloatArray, levers: FloatArray) -> list[Block]:
    """What tables leave open between and beyond their positions, of all parts alike, and the bends
    of runs (`basis.TableShape`); `levers` (rows, terms).
    """
    blocks, place = [], places(model, points)
    for t, term in enumerate(model.terms):
        table = term.estimate.table
        if table is None or term.estimate.of is None:
            continue
        positions, at = np.unique(place[term.estimate.of], return_inverse=True)
        G = np.repeat(np.eye(len(positions))[at], len(model.axes), axis=0) * levers[:, t, None]
        for of_part, C, dof in (
            (False, table.left_open(positions), np.inf),
            (True, table.of_runs(positions), table.own_dof),
        ):
            if C.any():
                block = normal_block(term.estimate.name, G @ covariance_root(C), of_part=of_part)
                blocks.append(replace(block, pass_dof=dof) if of_part else block)
    return blocks


def independent_parts(estimate: ComponentEstimate) -> tuple[FloatArray, float]:
    """(k, k) and s^2 such that a future observation has variance x'Cx + s^2.

    Gilsinn & Ling 2004, eqs. (9)-(11); for a component of a machine file, whose readings
    are not at hand, the same total variance without its correlation.
    """
    if estimate.independent_covariance is not None and estimate.independent_s is not None:
        return estimate.independent_covariance, estimate.independent_s**2
    return estimate.covariance + estimate.pass_covariance, estimate.s_repeat**2


INDEFINITE = 1e-9
"""Of the largest eigenvalue: what is further below 0 is no rounding."""


def reportable(
    prediction: Prediction, variance: FloatArray, *, by_point: bool = False
) -> FloatArray:
    """The covariance (rows, rows), or those (n, a, a) of each point alone, with the variances
    (rows,), without negative eigenvalues, as reports and pictures show it.

    D that is estimated without bias may have a negative part, and then so may the covariance of
    errors: correlations are those without it, variances the estimated ones. The prediction's own
    where it has both already.
    """
    wanted = variance.reshape(-1, len(prediction.axes)) if by_point else variance
    own = prediction.of_points(drawable=False) if by_point else prediction.covariance
    if np.allclose(np.einsum("...ii->...i", own), wanted, rtol=1e-9, atol=0.0):
        # C + D of every block a covariance: then so is their sum, however many rows.
        sound = not any(_indefinite(block.C + block.D) for block in prediction.blocks)
        if sound or not (by_point or _indefinite(own)):
            return own
    own = prediction.of_points(drawable=True) if by_point else prediction.drawable
    drawn = np.einsum("...ii->...i", own)
    ratio = np.sqrt(np.divide(wanted, drawn, out=np.zeros_like(drawn), where=drawn > 0))
    scaled: FloatArray = own * ratio[..., :, None] * ratio[..., None, :]
    return scaled


def _indefinite(matrix: FloatArray) -> bool:
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    return bool(values[0] < -INDEFINITE * abs(values[-1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class VisitScatter:
    """`variance` (A,), mm^2, of one visit by axis, the mean over the features: what s_repeat of
    the components makes of it; `dof` are the fewest that any of these is known with.
    """

    variance: FloatArray
    dof: float


def visit_scatter(model: MachineModel, at: Prediction, own: Sequence[int]) -> VisitScatter:
    """Of the features of a prediction `at`, along `own` of the model's axes."""
    variance = at.variance().repeatability.reshape(-1, len(at.axes))[:, list(own)]
    dof = [t.estimate.repeat_dof for t in model.terms if t.estimate.s_repeat > 0]
    return VisitScatter(variance=np.mean(variance, axis=0), dof=float(min(dof, default=np.inf)))
