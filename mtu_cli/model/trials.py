"""Monte Carlo trials of one future part: its errors, its measurands, and conformance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtu_cli.files.part import Tolerance
from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.model.variance import Variance
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.covariance import factor_of
from mtu_cli.stats.coverage import t_quantile
from mtu_cli.stats.distributions import NORMAL_DOF, t_scales
from mtu_cli.stats.least_squares import FloatArray, IntArray
from mtu_cli.stats.monte_carlo import monte_carlo
from mtu_cli.stats.workspace import Workspace
from mtu_cli.units import UM

MANY_ERRORS = 1.5
"""Times as many independent errors as combinations of them: as many normals as these are drawn."""
COUNTED_TRIALS = 200_000
"""Trials behind a probability that is counted; its standard error is stated."""

Happens = Callable[[np.random.Generator, int], NDArray[np.bool_]]
"""Random numbers and a count m -> whether each event happens (events, m)."""

Measure = Callable[[FloatArray], FloatArray]
"""Combined errors (combinations, m) in mm -> values (outputs, m) of the measurands."""


class PointTrials:
    """A Monte Carlo model: m future parts a block, each with errors at all points.

    `combine` (combinations, rows) says which linear combinations of the errors `measure` needs;
    only these are drawn, normal with the prediction's covariance or, without the `variance` of the
    outputs, with independent errors, as in Gilsinn & Ling 2004, eq. (23). `owner`
    (combinations,) is the output that a combination belongs to. Where the effective degrees of
    freedom of the `variance` are finite its combinations are scaled to Student's t (JCGM 101:2008,
    6.4.9), so that the trials and the first-order interval differ by what the measurand is not
    linear in, and by nothing else. The first-order form, `gradient` (outputs, rows), is drawn along
    and serves as control variate.
    """

    smooth = True

    def __init__(
        self,
        prediction: Prediction,
        names: tuple[str, ...],
        measure: Measure,
        combine: FloatArray,
        owner: IntArray,
        gradient: FloatArray,
        variance: Variance | None,
    ) -> None:
        self.names, self.measure, self.work = names, measure, Workspace()
        mean = combine @ prediction.mean
        self.linear_mean = measure(mean[:, None])[:, 0].copy()
        # The first-order form is drawn as further rows of the same product.
        self.offset = np.concatenate([mean, self.linear_mean])[:, None]
        self.k = len(combine)
        self.owner = np.concatenate([owner, np.arange(len(names))])
        stacked = np.vstack([combine, gradient])
        if variance is None:
            self.factor = stacked * np.sqrt(prediction.independent_variance)
            if MANY_ERRORS * len(mean) < len(prediction.mean):
                self.factor = factor_of(self.factor @ self.factor.T)
            self.dof = np.full(len(names), np.inf)
        else:
            self.factor = self._factor_of(stacked, prediction, variance.total)
            self.dof = variance.dof
        self.linear_u = np.sqrt(np.sum(self.factor[self.k :] ** 2, axis=1))[:, None]
        self.u_exists = self.dof > 2
        self.linear_dof = np.where(self.dof < NORMAL_DOF, self.dof, np.inf)
        self.finite = np.flatnonzero(np.isfinite(self.linear_dof))
        inflation = np.where(self.u_exists, 1.0, np.nan)
        live = self.u_exists & np.isfinite(self.linear_dof)
        inflation[live] = self.dof[live] / (self.dof[live] - 2)
        self.linear_variance = self.linear_u[:, 0] ** 2 * inflation

    def _factor_of(
        self, stacked: FloatArray, prediction: Prediction, target: FloatArray
    ) -> FloatArray:
        """F with F F' the covariance of the stacked rows; where an output's `target` variance is
        another (not lowered by a negative D, see `variance.block_variance`), without negative part
        and with all rows of the output scaled alike.
        """
        raw = stacked @ prediction.covariance @ stacked.T
        if np.allclose(np.diag(raw)[self.k :], target, rtol=1e-9, atol=0.0):
            return factor_of(raw)
        factor = factor_of(stacked @ prediction.drawable @ stacked.T)
        ratio = _ratio(target, np.sum(factor[self.k :] ** 2, axis=1))
        return factor * ratio[self.owner, None]

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m)."""
        rows, rank = self.factor.shape
        z = rng.standard_normal(out=self.work.array("z", (rank, m)))
        total = np.matmul(self.factor, z, out=self.work.array("total", (rows, m)))
        if len(self.finite):
            scale = self.work.array("scale", (len(self.names), m))
            scale[:] = 1.0
            for i in self.finite:
                t_scales(float(self.dof[i]), rng, scale[i])
            # Row by row: the scales of all rows at once would be an array as large as `total`.
            for row, i in zip(total, self.owner, strict=True):
                row *= scale[i]
        total += self.offset
        return Draws(values=self.measure(total[: self.k]), linear=total[self.k :])

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        """Those (outputs, n) of the first-order values less their mean."""
        return self.linear_u * [t_quantile(probability, dof) for dof in self.linear_dof.tolist()]


def _ratio(target: FloatArray, drawn: FloatArray) -> FloatArray:
    """The factor that scales rows of the variances `drawn` to those of `target`; 0 where 0."""
    return np.sqrt(np.divide(target, drawn, out=np.zeros_like(drawn), where=drawn > 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Conformance:
    """Probability that an error of a future part is within its `tolerance` (um or arcsec)."""

    tolerance: Tolerance
    probability: float


def conformance_of(
    tolerance: Tolerance | None, size: float, error: float, u: float, dof: float
) -> Conformance | None:
    """P(low <= error of a future part <= high) with t at the effective degrees of freedom.

    `size` is the tolerance's unit in that of `error` and `u`.
    """
    from scipy.special import ndtr, stdtr

    if tolerance is None:
        return None
    low, high = tolerance.low * size, tolerance.high * size
    if u == 0:
        return Conformance(tolerance=tolerance, probability=float(low <= error <= high))
    ends = np.array([high - error, low - error]) / u
    below = ndtr(ends) if np.isinf(dof) else stdtr(dof, ends)
    return Conformance(tolerance=tolerance, probability=float(below[0] - below[1]))


def _counted(
    names: tuple[str, ...], happens: Happens, settings: Settings
) -> tuple[FloatArray, FloatArray]:
    """Probabilities (events,) by Monte Carlo, and their standard errors."""
    model: Any = SimpleNamespace(names=names, u_exists=(True,) * len(names), linear_mean=None)
    model.draw = lambda rng, m: Draws(values=happens(rng, m).astype(np.float64))
    trials = settings.trials or COUNTED_TRIALS
    result = monte_carlo(model, seed=settings.seed, trials=trials, threads=settings.threads)
    n, p = result.trials, result.mean
    # One miss more and one hit more: 200 000 hits of 200 000 are not certainty.
    cautious = (p * n + 1) / (n + 2)
    return p, np.sqrt(cautious * (1 - cautious) / n)


class JointConformance(NamedTuple):
    """Probability that all `lengths` with a tolerance of one part conform; its standard error."""

    lengths: tuple[str, ...]
    probability: float
    se: float


def joint_conformance(
    model: PointTrials, items: Sequence[Conformance | None], settings: Settings
) -> JointConformance | None:
    """That one part conforms in all its toleranced lengths; None of fewer than two. Not the product
    of their probabilities, as the lengths of a part are correlated, nor more than the least.
    """
    conformances = {name: x for name, x in zip(model.names, items, strict=True) if x is not None}
    if len(conformances) < 2:
        return None
    low = np.array([[-np.inf if x is None else x.tolerance.low * UM] for x in items])
    high = np.array([[np.inf if x is None else x.tolerance.high * UM] for x in items])

    def all_within(rng: np.random.Generator, m: int) -> NDArray[np.bool_]:
        values = model.draw(rng, m).values
        return np.all((low <= values) & (values <= high), axis=0, keepdims=True)

    p, se = _counted(("all_within",), all_within, settings)
    least = min(float(p[0]), *(x.probability for x in conformances.values()))
    return JointConformance(tuple(conformances), least, float(se[0]))


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionConformance:
    """Probability that the centre of a feature of a future part lies in its zone of true position,
    of diameter `position_um`, and its standard error.
    """

    position_um: float
    probability: float
    se: float


def position_conformance(
    prediction: Prediction, position_um: Sequence[float | None], settings: Settings
) -> tuple[PositionConformance | None, ...]:
    """P(Ex^2 + Ey^2 <= (T/2)^2) of every feature with a T, by Monte Carlo. A mean square MS of nu
    degrees of freedom has the expectation MS nu/W, W a chi-squared of nu (JCGM 101:2008, 6.4.9):
    every trial draws one W a source, common to the errors along x and y. An axis without equation
    has no error.
    """
    result: list[PositionConformance | None] = [None] * len(position_um)
    zones = {i: zone for i, zone in enumerate(position_um) if zone is not None}
    axes = [prediction.axes.index(axis) for axis in "xy" if axis in prediction.axes]
    if not (zones and axes):
        return tuple(result)
    rows: IntArray = np.array([[i * len(prediction.axes) + axis for axis in axes] for i in zones])
    factor, dof = _plane_factor(prediction, rows, independent=settings.independent)
    mean, limit = prediction.mean[rows].reshape(-1, 1), np.array([*zones.values()]) * UM / 2

    def inside(rng: np.random.Generator, m: int) -> NDArray[np.bool_]:
        z = rng.standard_normal((len(dof), len(axes), m))
        for source in np.flatnonzero(dof < NORMAL_DOF):
            half = dof[source] / 2
            z[source] *= np.sqrt(half / rng.standard_gamma(half, m))
        errors = (mean + factor @ z.reshape(-1, m)).reshape(len(zones), len(axes), m)
        return np.hypot.reduce(errors, axis=1) <= limit[:, None]

    names = tuple(prediction.ids[i] for i in zones)
    for i, p, se in zip(zones, *_counted(names, inside, settings), strict=True):
        result[i] = PositionConformance(position_um=zones[i], probability=float(p), se=float(se))
    return tuple(result)


def _plane_factor(
    prediction: Prediction, rows: IntArray, *, independent: bool
) -> tuple[FloatArray, FloatArray]:
    """F (features*axes, K*axes) of K sources, and their degrees of freedom (K,).

    F_k F_k' is the covariance that mean square k gives the errors `rows` (features, axes) of one
    feature: by variances of Ex, Ey and Ex + Ey. Its negative part (a difference of mean squares) is
    left out, and the rows are scaled back to their variances.
    """
    n, a = rows.shape
    if independent:
        variances = prediction.independent_variance[rows]
        return np.vstack([np.diag(np.sqrt(each)) for each in variances]), np.full(1, np.inf)
    picked = np.zeros((n * a, len(prediction.mean)))
    picked[np.arange(n * a), rows.ravel()] = 1.0
    each = prediction.variance(picked)
    squares = (each.squares.of_mean + each.squares.of_part).reshape(-1, n, a)
    sources = squares[..., None] * np.eye(a)
    if a == 2:
        of_sum = prediction.variance(picked[::2] + picked[1::2]).squares
        covariance = (of_sum.of_mean + of_sum.of_part - squares.sum(axis=2)) / 2
        sources[..., 0, 1] = sources[..., 1, 0] = covariance
    values, vectors = np.linalg.eigh(sources)
    factors = vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :]
    target = np.clip(each.total.reshape(n, a), 0.0, None)
    ratio = _ratio(target, np.sum(factors**2, axis=(0, 3)))
    scaled = (factors * ratio[..., None]).transpose(1, 2, 0, 3).reshape(n * a, -1)
    return np.asarray(scaled), each.squares.dof
