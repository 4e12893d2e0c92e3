"""Errors of points with their full covariance: the propagation that every command uses.

Errors are linear in the coefficients of components, of which those that were estimated jointly are
a block (`stats.composed_variance`). Gilsinn & Ling 2004, eq. (18), is the case in which all scatter
counts as repeatability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from mtu_cli.findings import InputError
from mtu_cli.model.estimates import JointPasses, between_passes, from_mean
from mtu_cli.model.machine_model import (
    Covariates,
    Design,
    MachineModel,
    design,
    missing_covariates,
    places_of,
    row_times,
    sensors_of,
)
from mtu_cli.stats.composed_variance import (
    CoefficientBlock,
    Variance,
    covariance_of,
    normal_block,
    variance_of,
)
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

NEGLIGIBLE = 1e-9
"""A change of lever arms below this share of the arms is rounding."""


def component_blocks(
    model: MachineModel, J: FloatArray, levers: FloatArray
) -> list[CoefficientBlock]:
    """One block a group of components that share passes, one for every other component.

    `J` (rows, K) and `levers` (rows, c) as `design` gives them.
    """
    at, columns = {term.estimate.name: t for t, term in enumerate(model.terms)}, model.columns
    present = [[name for name in group.components if name in at] for group in model.joint]
    groups: list[tuple[list[str], JointPasses | None]] = [
        pair for pair in zip(present, model.joint, strict=True) if len(pair[0]) >= 2
    ]
    joint = {name for names, _ in groups for name in names}
    groups += [([name], None) for name in at if name not in joint]
    blocks = []
    for names, shared in groups:
        terms = [at[name] for name in names]
        estimates = [model.terms[t].estimate for t in terms]
        ends = np.cumsum([0, *(len(x.coefficients) for x in estimates)]).tolist()
        inside = tuple(slice(*pair) for pair in pairwise(ends))
        squares = [between_passes(x) for x in estimates]
        of = shared or estimates[0]
        C, D, halves, between = of.covariance, of.pass_covariance, of.half_differences, None
        if shared is not None:
            owners = np.repeat(np.array(shared.components, object), shared.widths)
            rows = np.ix_(*[np.flatnonzero(np.isin(owners, names))] * 2)
            C, D, halves = C[rows], D[rows], None if halves is None else halves[rows]
        if of.n_passes is not None and all(S is not None for S in squares):
            # Between components C is of their level and slope alone, whatever their degree.
            between = from_mean(C, of.n_passes, halves)
            for part, S in zip(inside, squares, strict=True):
                between[part, part] = S
        sides = [J[:, columns[t]] for t in terms]
        visits = [levers[:, t] * x.s_repeat for t, x in zip(terms, estimates, strict=True)]
        block = CoefficientBlock(
            names=tuple(names),
            columns=inside,
            G=sides[0] if shared is None else np.column_stack(sides),
            C=C,
            D=D,
            noise=np.column_stack(visits),
            pass_dof=of.pass_dof,
            repeat_dof=tuple(x.repeat_dof for x in estimates),
            between=between,
            n_passes=of.n_passes or 0,
            half_differences=halves,
        )
        blocks.append(block)
    return blocks


def constant_effects(
    model: MachineModel, points: FloatArray, covariates: Covariates, centre: Design
) -> tuple[list[CoefficientBlock], FloatArray]:
    """The constants' uncertainties: blocks, and a shift (rows,) of the mean, mm.

    First and second order in every uncertain constant c (JCGM 100, 5.1.2, note): dE/dc and
    d2E/dc2 by central differences over one standard uncertainty. A constant is a lever arm of
    components that are uncertain themselves: their product adds u(c)^2 (dJ/dc) (C + D) (dJ/dc)'.
    `centre` is the design at the constants' values.
    """
    blocks: list[CoefficientBlock] = []
    shift = np.zeros(len(centre.mean))
    for name, (value, u) in model.constants.items():
        if u == 0:
            continue
        up, down = (
            design(replace(model, constants=model.constants | {name: (end, u)}), points, covariates)
            for end in (value + u, value - u)
        )
        curve = (up.mean + down.mean - 2 * centre.mean) / 2
        # Rounding of a difference of errors is no curvature.
        curve = np.where(np.abs(curve) > NEGLIGIBLE * np.abs(up.mean - centre.mean), curve, 0.0)
        blocks.append(normal_block(name, ((up.mean - down.mean) / 2)[:, None]))
        if curve.any():
            blocks.append(normal_block(f"{name}^2", np.sqrt(2.0) * curve[:, None]))
        shift += curve
        change = (up.J - down.J) / 2
        if np.abs(change).max() > NEGLIGIBLE * np.abs(centre.J).max():
            levers = (up.levers - down.levers) / 2
            blocks += component_blocks(model, change, levers)
    return blocks, shift


Outside = dict[tuple[str, float, float], dict[str, float]]
"""By component (or its drift) with its measured range, the points that leave it and where, mm."""


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Errors at n points in a axes; rows are (point, axis), points first: `mean` (n*a,) in mm,
    `independent_variance` (n*a,) under the papers' independence; `outside` the measured ranges.
    """

    ids: tuple[str, ...]
    axes: tuple[str, ...]
    points: FloatArray
    mean: FloatArray
    blocks: tuple[CoefficientBlock, ...]
    independent_variance: FloatArray
    outside: Outside

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (n*a, n*a) of the errors of one future part, mm^2.

        It may have a negative part where D has; `drawable` has none.
        """
        return covariance_of(self.blocks, len(self.axes))

    @cached_property
    def drawable(self) -> FloatArray:
        """The same without the negative part of any D: a covariance, somewhat too large."""
        return covariance_of(self.blocks, len(self.axes), drawable=True)

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

    def variance(self, A: FloatArray | None = None) -> Variance:
        """Variance of the linear measurands A E, A (m, n*a); without A of the errors, (n*a,)."""
        return variance_of(self.blocks, A, len(self.axes))


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
    values = covariates or {}
    if missing := missing_covariates(model, values):
        raise InputError(missing)
    rows = design(model, points, values)
    blocks = component_blocks(model, rows.J, rows.levers)
    of_constants, shift = constant_effects(model, points, values, rows)
    rest = temperature_blocks(model, points, values, rows.levers)
    rest += [*table_blocks(model, points, rows.levers), *of_constants]
    independent = np.zeros(len(rows.J))
    for term, columns, lever in zip(model.terms, model.columns, rows.levers.T, strict=True):
        # Gilsinn & Ling 2004, eqs. (9)-(11); for a component of a machine file, without readings,
        # the same total variance without its correlation.
        estimate, G = term.estimate, rows.J[:, columns]
        C, s2 = estimate.covariance + estimate.pass_covariance, estimate.s_repeat**2
        if estimate.independent_covariance is not None and estimate.independent_s is not None:
            C, s2 = estimate.independent_covariance, estimate.independent_s**2
        independent += np.einsum("ri,ij,rj->r", G, C, G) + lever**2 * s2
    for block in rest:
        independent += np.einsum("ri,ij,rj->r", block.G, block.C + block.D, block.G)
        independent += (block.noise**2).sum(axis=1)
    return Prediction(
        ids=tuple(ids),
        axes=model.axes,
        points=points,
        mean=rows.mean + shift,
        blocks=(*blocks, *rest),
        independent_variance=independent,
        outside=outside_ranges(model, ids, points),
    )


def outside_ranges(model: MachineModel, ids: Sequence[str], points: FloatArray) -> Outside:
    """Which of the `points` (n, 3), mm, are beyond the measured range of which component; of
    several of one name the farthest out.
    """
    place, result = places_of(model, points), Outside()
    for term in model.terms:
        estimate, drift = term.estimate, term.drift
        if estimate.of is None or estimate.position_range is None:
            continue
        (low, high), position = estimate.position_range, place[estimate.of]
        name = estimate.name if drift is None else f"the drift of {drift.component}"
        far = np.maximum(low - position, position - high)
        farthest: dict[str, int] = {}
        for i in np.flatnonzero(far > 1e-9).tolist():
            farthest[ids[i]] = max(i, farthest.get(ids[i], i), key=far.__getitem__)
        if farthest:
            result[name, low, high] = {x: float(position[i]) for x, i in farthest.items()}
    return result


def table_blocks(
    model: MachineModel, points: FloatArray, levers: FloatArray
) -> list[CoefficientBlock]:
    """The uncertainty of tables between and beyond their positions, common to all parts, and the
    bends of runs (`TableShape`); `levers` (rows, terms).
    """
    blocks, place = [], places_of(model, points)
    for t, term in enumerate(model.terms):
        table, axis = term.estimate.table, term.estimate.of
        if table is None or axis is None:
            continue
        positions, at = np.unique(place[axis], return_inverse=True)
        G = np.repeat(np.eye(len(positions))[at], len(model.axes), axis=0) * levers[:, t, None]
        for of_part, covariance in ((False, table.interpolation_covariance), (True, table.of_runs)):
            if (C := covariance(positions)).any():
                F = G @ covariance_root(C)
                name = term.estimate.name
                blocks.append(normal_block(name, F, of_part=of_part, dof=table.own_dof))
    return blocks


def noise_by_sensor(
    model: MachineModel, points: FloatArray, levers: FloatArray
) -> dict[str, dict[float, FloatArray]]:
    """u(T) dE/dT (rows,), mm, by sensor and lag in min, over all drifts: u(T) times lever times
    sum_m g[m, s] p^m. `points` (n, 3), `levers` (rows, terms) as `design` gives them.
    """
    place, n = places_of(model, points), len(points)
    result: dict[str, dict[float, FloatArray]] = {}
    for lever, drift in zip(levers.T, (term.drift for term in model.terms), strict=True):
        if drift is None:
            continue
        gradients = drift.gradients(np.zeros(n) if drift.of is None else place[drift.of])
        for sensor, tau, each in zip(
            drift.sensors,
            drift.time_constants.tolist(),
            gradients * drift.sensor_u[:, None],
            strict=True,
        ):
            column = lever * np.repeat(each, len(levers) // max(n, 1))
            by_lag = result.setdefault(sensor, {})
            by_lag[tau] = by_lag.get(tau, 0.0) + column
    return result


def temperature_blocks(
    model: MachineModel, points: FloatArray, covariates: Covariates, levers: FloatArray
) -> list[CoefficientBlock]:
    """The errors at `points` (n, 3) by the noise of the temperature readings.

    Rows with the same temperatures share one reading, and its error; other readings are
    independent. A lag is linear in the readings, u = L T: with times, the noise of earlier
    readings lags as they do, and rows near in time have correlated errors. With R (n, K) the
    readings of the rows, sensor s of noise u_s adds F F', F = diag(dE/dT_s) u_s L R.
    """
    n, times = len(points), row_times(covariates)
    each = [np.asarray(covariates[sensor], float) for sensor in sensors_of(model)]
    each = [column for column in each if column.ndim]
    which, result = np.zeros(n, np.int64), list[CoefficientBlock]()
    if each:
        which = np.unique(np.column_stack(each), axis=0, return_inverse=True)[1].reshape(-1)
    for sensor, by_lag in noise_by_sensor(model, points, levers).items():
        live = {tau: column for tau, column in by_lag.items() if column.any()}
        readings = int(which.max()) + 1 if np.ndim(covariates[sensor]) else 1
        lagged = times is not None and readings > 1 and any(live)
        if not live:
            continue
        if readings == n > 1 and not lagged:
            # One reading a row.
            F = np.sum([*live.values()], axis=0)
        else:
            R = np.eye(readings)[which if readings > 1 else np.zeros(n, np.int64)]
            through = np.broadcast_to(R, (len(live), n, readings))
            if times is not None and lagged:
                order = np.argsort(times, kind="stable")
                through = np.empty((len(live), n, readings))
                through[:, order] = first_order_lag(R[order], times[order], np.array([*live]))
            F = np.zeros((len(levers), readings))
            for column, LR in zip(live.values(), through, strict=True):
                F += column[:, None] * np.repeat(LR, len(levers) // n, axis=0)
        result.append(normal_block(sensor, F, of_part=True))
    return result
