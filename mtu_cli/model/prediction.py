"""Errors of points with their full covariance: the propagation that every command uses.

For points p, q of one future part and a component with design rows x_p, x_q

    Cov = x_p' (C + D) x_q + [p = q] s_repeat^2,

C the coefficients' covariance, D the pass-to-pass covariance, s_repeat the repeatability of
one visit. Gilsinn & Ling 2004, eq. (18), is the case in which all of it counts as repeatability.
Coefficients that were estimated jointly are a block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mtu_cli.findings import InputError
from mtu_cli.model.estimates import JointPasses, between_passes, from_mean
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
from mtu_cli.stats.covariance import covariance_root, positive_part
from mtu_cli.stats.coverage import effective_dof
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

NEGLIGIBLE = 1e-9
"""A change of lever arms below this share of the arms is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Coefficients that share a covariance, seen from the points: G (rows, k) = J columns; `C`, `D`
    (k, k); `noise` (rows, c) lever arms times s_repeat of its c components `names`, `columns` their
    coefficients among the k, `repeat_dof` the degrees of freedom of their s_repeat. `between` (k,
    k) is the mean square S between `n_passes` passes that C and D come from; None, 0 where they do
    not come from one. `half_differences` (k, k) is S_h, the part of S that is of runs there and
    back (`stats.mixed_model`); None where passes are independent.
    """

    names: tuple[str, ...]
    columns: tuple[slice, ...] = (slice(None),)
    G: FloatArray
    C: FloatArray
    D: FloatArray
    noise: FloatArray
    pass_dof: float = 0.0
    repeat_dof: tuple[float, ...] = (np.inf,)
    between: FloatArray | None = None
    n_passes: int = 0
    half_differences: FloatArray | None = None


class PassSquare(NamedTuple):
    """A mean square of passes as a matrix: `S` (k, k), seen from measurands by `g` (m, k)."""

    g: FloatArray
    S: FloatArray

    def independent(self, weights: FloatArray) -> float:
        """How many times the degrees of freedom of one measurand the `weights` (m,) of all have.

        Of a Wishart matrix of nu degrees of freedom the weighted sum of g'S g has those of a
        chi-squared, nu tr(K S)^2/tr(K S K S), K = sum w g g' (Box, Ann. Math. Statist. 25 (1954)
        290, theorem 3.1).
        """
        KS = (self.g * weights[:, None]).T @ self.g @ self.S
        square = float((KS * KS.T).sum())
        return max(float(np.trace(KS)) ** 2 / square, 1.0) if square > 0 else 1.0


class MeanSquares(NamedTuple):
    """The K independent mean squares behind the variance of m linear measurands, mm^2: `of_mean`
    (K, m) is what each adds to the variance of the mean over all future parts, that of the
    coefficients; `of_part` (K, m) to the scatter of parts, of passes and visits; `dof` (K,),
    infinite where the machine file states it as known; `passes` those of passes.
    """

    of_mean: FloatArray
    of_part: FloatArray
    dof: FloatArray
    passes: list[PassSquare | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variance:
    """Variance (m,) of m linear measurands with effective degrees of freedom (m,), by block
    (blocks, m), by its nature (m,) and by the mean `squares` that it was estimated from.
    """

    total: FloatArray
    dof: FloatArray
    by_block: FloatArray
    coefficients: FloatArray
    passes: FloatArray
    repeatability: FloatArray
    squares: MeanSquares

    def shares(self, i: int) -> dict[str, float] | None:
        """The shares of the variance of measurand i by its nature, 1 in all; None where it has
        none. That of passes is below 0 where they differ by less than repeatability makes them.
        """
        total, natures = float(self.total[i]), ("coefficients", "passes", "repeatability")
        return {x: float(getattr(self, x)[i]) / total for x in natures} if total > 0 else None


Square = tuple[FloatArray, FloatArray, float, PassSquare | None]
"""A mean square as an entry of each of `MeanSquares`."""


def block_variance(
    block: Block, A: FloatArray | None, axes: int
) -> tuple[FloatArray, list[Square]]:
    """(3, m) variance by nature of the measurands A E, and the mean squares behind it.

    Without A the measurands are the errors themselves, row by row: A = I, which for many rows is
    not to be multiplied out. With the mean square S of n passes, E S = D + s^2 M, it is

        g'(C + D)g + s^2 w = (1 + 1/n) g'S g + s^2 (w - g'M g) + s^2 q,

    w the visits of the measurand, q the powers that the passes have in common; (1/n) g'S g
    and s^2 q are of the coefficients. Where w is less than g'M g the second term is negative;
    its s^2 is then bounded by S, D being no less than 0: g'S g (1/n + w/g'M g) with the degrees
    of freedom of the passes.

    Of runs there and back S is S_m + S_h, two mean squares of the same degrees of freedom, and the
    mean over n passes has the variance 2 S_m/n. S of uneven passes is composed of separate
    estimates: where S_h is more than S, C is all of the passes.
    """
    # A zero of G has no sign in a product with I.
    g = block.G + 0.0 if A is None else A @ block.G
    # Of visits of one component, which the axes of a point share.
    visits = [
        column**2
        if A is None
        else ((A * column).reshape(len(A), -1, axes).sum(axis=2) ** 2).sum(axis=1)
        for column in block.noise.T
    ]
    of_C, of_D, noise = _quadratic(g, block.C), _quadratic(g, block.D), np.sum(visits, axis=0)
    n, halves, dof, of_visits = (
        block.n_passes, block.half_differences, block.pass_dof, block.repeat_dof
    )  # fmt: skip
    if (between := block.between) is None:
        # A pooled moment estimate of D may be negative where passes hardly differ; the sum of
        # passes and visits is not.
        of_D = np.maximum(of_D, -noise)
        split = np.array([of_C, of_D, noise])
        if dof == 0:
            return split, [(of_C, of_D + noise, of_visits[0], None)]
        squares: list[Square] = [(of_C, of_D, dof, PassSquare(g, block.D))]
        pairs = zip(visits, of_visits, strict=True)
        return split, squares + [(np.zeros_like(x), x, each, None) for x, each in pairs]
    S = _quadratic(g, between)
    capped = (of_D < 0) & (noise < S - of_D)
    room = np.divide(S, S - of_D, out=np.ones_like(S), where=capped)
    split = np.array([of_C, np.where(capped, 0.0, of_D), room * noise])
    passes = np.where(capped, room * noise, S)
    of_all, beyond_S = between, np.zeros(S.shape, bool)
    squares = [(S / n, passes, dof, PassSquare(g, between))]
    if halves is not None:
        of_all, of_halves = 2 * (between - halves), _quadratic(g, halves)
        share = np.divide(of_halves, S, out=np.ones_like(S), where=S > 0).clip(0.0, 1.0)
        beyond_S = of_halves > S
        of_mean = np.where(beyond_S, of_C, 2 * (1 - share) * S / n)
        squares = [(of_mean, (1 - share) * passes, dof, PassSquare(g, between - halves))]
        squares.append((np.zeros_like(S), share * passes, dof, PassSquare(g, halves)))
    for columns, visit, each in zip(block.columns, visits, of_visits, strict=True):
        inside = (columns, columns)
        common = _quadratic(g[:, columns], block.C[inside] - of_all[inside] / n)
        beyond = _quadratic(g[:, columns], block.D[inside] - between[inside]) + visit
        squares.append((np.where(beyond_S, 0.0, common), np.where(capped, 0.0, beyond), each, None))
    return split, squares


def _quadratic(g: FloatArray, matrix: FloatArray) -> FloatArray:
    """g'M g of every row of g (m, k)."""
    return ((g @ matrix) * g).sum(axis=1)


def drawable_passes(D: FloatArray, C: FloatArray) -> FloatArray:
    """D (k, k) without its negative part, measured in the standard uncertainties of C.

    Level and slope differ in unit: without a measure the result would depend on them. One without
    uncertainty, or with an unknown one (nan), has the measure 1.
    """
    variances = np.where(np.diag(C) > 0, np.diag(C), 1.0)
    scale = np.sqrt(variances)
    if np.linalg.eigvalsh(D / np.outer(scale, scale))[0] >= 0:
        return D
    return positive_part(D, np.diag(variances))


def normal_block(name: str, F: FloatArray, *, of_part: bool = False, dof: float = np.inf) -> Block:
    """Standard normal quantities times F (rows, K), known or, with `dof` degrees of freedom, drawn
    anew for every part; or one a point, times F (rows,).
    """
    each = F.ndim == 1
    G = np.zeros((len(F), 1)) if each else F
    identity = np.eye(G.shape[1])
    return Block(
        names=(name,),
        G=G,
        C=0 * identity if of_part else identity,
        D=identity if of_part else 0 * identity,
        noise=F[:, None] if each else np.zeros((len(F), 1)),
        pass_dof=dof if of_part else 0.0,
    )


def component_blocks(model: MachineModel, J: FloatArray, levers: FloatArray) -> list[Block]:
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
        block = Block(
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
    blocks: tuple[Block, ...]
    independent_variance: FloatArray
    outside: Outside

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
        (`block_variance`), and never fewer than the least of them: where one is subtracted
        the formula alone would give almost none.
        """
        results = [block_variance(block, A, len(self.axes)) for block in self.blocks]
        parts = np.array([part for part, _ in results])
        squares = (each for _, of_block in results for each in of_block)
        of_mean, of_part, dofs, passes = zip(*squares, strict=True)
        behind = MeanSquares(np.array(of_mean), np.array(of_part), np.array(dofs), [*passes])
        by_block, split = parts.sum(axis=1), parts.sum(axis=0)
        total = by_block.sum(axis=0)
        both = behind.of_mean + behind.of_part
        least = np.where(both == 0, np.inf, behind.dof[:, None]).min(axis=0)
        return Variance(
            total=total,
            dof=np.maximum(effective_dof(total, both, behind.dof), least),
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
    place, result = places(model, points), Outside()
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


def table_blocks(model: MachineModel, points: FloatArray, levers: FloatArray) -> list[Block]:
    """The uncertainty of tables between and beyond their positions, common to all parts, and the
    bends of runs (`estimates.TableShape`); `levers` (rows, terms).
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


def noise_by_sensor(
    model: MachineModel, points: FloatArray, levers: FloatArray
) -> dict[str, dict[float, FloatArray]]:
    """u(T) dE/dT (rows,), mm, by sensor and lag in min, over all drifts: u(T) times lever times
    sum_m g[m, s] p^m. `points` (n, 3), `levers` (rows, terms) as `design` gives them.
    """
    place, n = places(model, points), len(points)
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


def ratio_of(target: FloatArray, drawn: FloatArray) -> FloatArray:
    """The factor that scales rows of the variances `drawn` to those of `target`; 0 where 0."""
    return np.sqrt(np.divide(target, drawn, out=np.zeros_like(drawn), where=drawn > 0))
