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
from itertools import chain

import numpy as np

from mtu_cli.findings import Finding, InputError, finding, listed
from mtu_cli.model.machine_model import (
    Covariates,
    Design,
    MachineModel,
    design,
    missing_covariates,
    places,
    row_times,
    sensors_of,
)
from mtu_cli.model.variance import (
    Block,
    MeanSquares,
    Variance,
    block_variance,
    component_blocks,
    drawable_passes,
    normal_block,
)
from mtu_cli.stats.covariance import covariance_root
from mtu_cli.stats.coverage import effective_dof
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

NEGLIGIBLE = 1e-9
"""A change of lever arms below this share of the arms is rounding."""
INDEFINITE = 1e-9
"""Of the largest eigenvalue: what is further below 0 is no rounding."""


def constant_effects(
    model: MachineModel, points: FloatArray, covariates: Covariates, centre: Design
) -> tuple[list[Block], FloatArray]:
    """The constants' uncertainties: blocks, and a shift (rows,) of the mean, mm.

    First and second order in every uncertain constant c (JCGM 100, 5.1.2, note): dE/dc and
    d2E/dc2 by central differences over one standard uncertainty. A constant is a lever arm of
    components that are uncertain themselves: their product adds u(c)^2 (dJ/dc) (C + D) (dJ/dc)'.
    `centre` is the design at the constants' values.
    """
    blocks: list[Block] = []
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

    def variance(self, A: FloatArray | None = None) -> Variance:
        """Variance of the linear measurands A E, A (m, n*a): law of propagation with covariance.
        Without A of the errors themselves, (n*a,). Effective degrees of freedom by
        Welch-Satterthwaite (JCGM 100, G.4.1) over the independent mean squares behind it
        (`variance.block_variance`), and never fewer than the least of them: where one is subtracted
        the formula alone would give almost none.
        """
        results = [block_variance(block, A, len(self.axes)) for block in self.blocks]
        parts = np.array([part for part, _ in results])
        of_mean, of_part, dof, passes = zip(*(x for _, x in results), strict=True)
        behind = MeanSquares(
            of_mean=np.concatenate(of_mean),
            of_part=np.concatenate(of_part),
            dof=np.concatenate(dof),
            passes=[*chain(*passes)],
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
    outside = []
    place = places(model, points)
    for term in model.terms:
        estimate, drift = term.estimate, term.drift
        if estimate.of is None or estimate.position_range is None:
            continue
        (low, high), position = estimate.position_range, place[estimate.of]
        beyond = np.flatnonzero((position < low - 1e-9) | (position > high + 1e-9)).tolist()
        name = estimate.name if drift is None else f"the drift of {drift.component}"
        outside += [(ids[i], name, float(position[i]), low, high) for i in beyond]
    return Prediction(
        ids=tuple(ids),
        axes=model.axes,
        points=points,
        mean=rows.mean + shift,
        blocks=(*blocks, *rest),
        independent_variance=independent,
        outside=tuple(outside),
    )


def table_blocks(model: MachineModel, points: FloatArray, levers: FloatArray) -> list[Block]:
    """The uncertainty of tables between and beyond their positions, common to all parts, and the
    bends of runs (`basis.TableShape`); `levers` (rows, terms).
    """
    blocks, place = [], places(model, points)
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


# Temperatures: the noise of the sensors, and what to warn of.

SLACK = 0.05
"""Share of the fitted range of temperatures that may be exceeded without a warning."""


def _by_sensor(
    model: MachineModel, points: FloatArray, levers: FloatArray, *, noise: bool
) -> dict[str, dict[float, FloatArray]]:
    """dE/dT (rows,) by sensor and lag in min, over all drifts; with `noise` times u(T)."""
    place, n = places(model, points), len(points)
    result: dict[str, dict[float, FloatArray]] = {}
    for lever, drift in zip(levers.T, (term.drift for term in model.terms), strict=True):
        if drift is None:
            continue
        gradients = drift.gradients(np.zeros(n) if drift.of is None else place[drift.of])
        gradients = gradients * (drift.sensor_u[:, None] if noise else 1.0)
        for sensor, tau, each in zip(
            drift.sensors, drift.time_constants.tolist(), gradients, strict=True
        ):
            column = lever * np.repeat(each, len(levers) // max(n, 1))
            by_lag = result.setdefault(sensor, {})
            by_lag[tau] = by_lag.get(tau, 0.0) + column
    return result


def temperature_gradients(
    model: MachineModel, points: FloatArray, levers: FloatArray, *, noise: bool = False
) -> dict[str, FloatArray]:
    """dE/dT_s (rows,) in mm per degC of every sensor: lever sum_m g[m, s] p^m over all drifts.

    `points` (n, 3), `levers` (rows, terms) as `design` gives them. With `noise` times u(T_s), in
    mm: what one standard uncertainty of a reading does to the errors once they have settled.
    """
    by_sensor = _by_sensor(model, points, levers, noise=noise)
    return {sensor: np.sum([*by_lag.values()], axis=0) for sensor, by_lag in by_sensor.items()}


def temperature_blocks(
    model: MachineModel, points: FloatArray, covariates: Covariates, levers: FloatArray
) -> list[Block]:
    """The errors at `points` (n, 3) by the noise of the temperature readings.

    Rows with the same temperatures share one reading, and its error; other readings are
    independent. A lag is linear in the readings, u = L T: with times, the noise of earlier
    readings lags as they do, and rows near in time have correlated errors. With R (n, K) the
    readings of the rows, sensor s of noise u_s adds F F', F = diag(dE/dT_s) u_s L R.
    """
    n, times = len(points), row_times(covariates)
    each = [np.asarray(covariates[sensor], float) for sensor in sensors_of(model)]
    each = [column for column in each if column.ndim]
    which, result = np.zeros(n, np.int64), list[Block]()
    if each:
        which = np.unique(np.column_stack(each), axis=0, return_inverse=True)[1].reshape(-1)
    for sensor, by_lag in _by_sensor(model, points, levers, noise=True).items():
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


def temperature_warnings(
    model: MachineModel, points: FloatArray, covariates: Covariates
) -> list[Finding]:
    """Temperatures beyond those of the fit, one warning a sensor and range for all drifts that were
    read in it, and lags without a history.

    `points` (n, 3) in mm, `covariates` one value for all or one a point.
    """
    beyond: dict[tuple[str, float, float], list[str]] = {}
    for drift in model.drifts():
        ranges = [] if drift.temperature_range is None else drift.temperature_range.tolist()
        for sensor, (low, high) in zip(drift.sensors, ranges, strict=False):
            values = np.asarray(covariates[sensor], float)
            if max(low - values.min(), values.max() - high) > max(SLACK * (high - low), 1e-9):
                beyond.setdefault((sensor, low, high), []).append(drift.component)
    warnings, gradients = [], {}
    if beyond:
        levers = design(model, points, covariates).levers
        gradients = temperature_gradients(model, points, levers)
    for (sensor, low, high), names in beyond.items():
        values = np.atleast_1d(np.asarray(covariates[sensor], float))
        away = np.maximum(low - values, values - high)
        worst = int(np.argmax(away))
        wrong = 1e3 * float(np.abs(gradients[sensor]).max()) * float(away[worst])
        what = f"{sensor} at {values[worst]:.4g} degC (up to {wrong:.2g} um)"
        facts = {"sensor": sensor, "low": low, "high": high, "unit": "degC"}
        of = [f"the drift of {listed(names)}"]
        warnings.append(finding("outside-measured-range", what=what, names=of, **facts))
    times = row_times(covariates)
    lagged = [drift for drift in model.drifts() if drift.time_constants.any()]
    if lagged and (times is None or np.ptp(times) == 0):
        slowest = max(float(drift.time_constants.max()) for drift in lagged)
        names = [drift.component for drift in lagged]
        warnings.append(finding("settled-temperatures", components=names, minutes=slowest))
    return warnings


# As reports show it.


def reportable(prediction: Prediction, variance: FloatArray) -> FloatArray:
    """The covariance (rows, rows) with the variances (rows,), without negative eigenvalues, as
    reports show it: D that is estimated without bias may have a negative part; correlations are
    those without it. The prediction's covariance where it has both already.
    """
    covariance = prediction.covariance
    if np.allclose(np.diag(covariance), variance, rtol=1e-9, atol=0.0):
        values = np.linalg.eigvalsh(covariance)
        if values[0] >= -INDEFINITE * abs(values[-1]):
            return covariance
    return rescaled(prediction.drawable, variance)


def rescaled(covariance: FloatArray, variance: FloatArray) -> FloatArray:
    """The correlations of a covariance (..., rows, rows) with other variances (..., rows)."""
    ratio = ratio_of(variance, np.einsum("...ii->...i", covariance))
    return covariance * ratio[..., :, None] * ratio[..., None, :]


def ratio_of(target: FloatArray, drawn: FloatArray) -> FloatArray:
    """The factor that scales rows of the variances `drawn` to those of `target`; 0 where 0."""
    return np.sqrt(np.divide(target, drawn, out=np.zeros_like(drawn), where=drawn > 0))
