"""Monte Carlo trials of one future part: its errors, what is made of them, and conformance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.model.prediction import Prediction
from mtu_cli.model.settings import Settings
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.coverage import t_quantiles
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed import IntArray
from mtu_cli.stats.monte_carlo import monte_carlo
from mtu_cli.stats.workspace import Workspace

NORMAL_DOF = 1e6
"""From here on Student's t is drawn as normal: its quantiles differ by about a millionth."""

Measure = Callable[[FloatArray, Workspace], FloatArray]
"""Combined errors (combinations, m) in mm -> values (outputs, m) of the measurands."""


class PointTrials:
    """A Monte Carlo model: m future parts a block, each with errors at all points.

    `combine` (combinations, rows) says which linear combinations of the errors `measure`
    needs (differences of two points, errors less their line's mean); only these are drawn.
    They are normal with the prediction's covariance or, with `independent`, with every error
    on its own, as Gilsinn & Ling 2004, eq. (23), have it. `owner` (combinations,) is the output
    that a combination belongs to. `dof` (outputs,) are the effective degrees of freedom of
    each output: where they are finite its combinations are scaled to Student's t (JCGM
    101:2008, 6.4.9), so that the trials and the first-order interval differ by what the
    measurand is not linear in, and by nothing else.

    `first_order` (outputs,) and `gradient` (outputs, rows) are the first-order form of the
    measurands. It is drawn along and serves as control variate.
    """

    smooth = True

    def __init__(
        self,
        prediction: Prediction,
        names: tuple[str, ...],
        measure: Measure,
        combine: FloatArray,
        owner: IntArray,
        first_order: FloatArray,
        gradient: FloatArray,
        dof: FloatArray,
        *,
        independent: bool = False,
    ) -> None:
        self.names = names
        self.linear_mean = first_order
        self.measure = measure
        self.work = Workspace()
        # The first-order form is drawn as further rows of the same product.
        stacked = np.vstack([combine, gradient])
        self.offset = np.concatenate([combine @ prediction.mean, first_order])[:, None]
        self.k = len(combine)
        self.owner = np.concatenate([owner, np.arange(len(names))])
        self.factor = self._factor(stacked, prediction, independent)
        self.shifted = np.hstack([self.factor, self.offset])
        self.linear_u = np.sqrt(np.sum(self.factor[self.k :] ** 2, axis=1))[:, None]
        self.dof = dof
        self.u_exists = dof > 2
        dof = np.where(dof < NORMAL_DOF, dof, np.inf)
        self.linear_dof = dof
        self.finite = np.flatnonzero(np.isfinite(dof))
        with np.errstate(divide="ignore", invalid="ignore"):
            inflation = np.where(np.isinf(dof), 1.0, np.where(dof > 2, dof / (dof - 2), np.nan))
        self.linear_variance = self.linear_u[:, 0] ** 2 * inflation

    def _factor(self, stacked: FloatArray, prediction: Prediction, independent: bool) -> FloatArray:
        """F with F F' the covariance of the stacked rows, every output at its own variance.

        Where that is not the covariance's (a negative D was kept from making it too small,
        `variance.block_variance`), the covariance is drawn without negative part and all rows
        of the output are scaled alike.
        """
        gradient = stacked[self.k :]
        if independent:
            return factor_of(stacked * prediction.independent_variance @ stacked.T)
        raw = stacked @ prediction.covariance @ stacked.T
        wanted = prediction.variance(gradient).total
        if np.allclose(np.diag(raw)[self.k :], wanted, rtol=1e-9, atol=0.0):
            return factor_of(raw)
        factor = factor_of(stacked @ prediction.drawable @ stacked.T)
        drawn = np.sum(factor[self.k :] ** 2, axis=1)
        ratio = np.divide(wanted, drawn, out=np.zeros_like(drawn), where=drawn > 0)
        scaled: FloatArray = factor * np.sqrt(ratio)[self.owner, None]
        return scaled

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values and first-order values (outputs, m)."""
        total = self._combined(rng, m, len(self.offset))
        return Draws(values=self.measure(total[: self.k], self.work), linear=total[self.k :])

    def linear_quantiles(self, probability: FloatArray) -> FloatArray:
        """Those (outputs, n) of the first-order values less their mean."""
        return np.asarray(self.linear_u * t_quantiles(probability, self.linear_dof))

    def values(self, rng: np.random.Generator, m: int) -> FloatArray:
        """The values (outputs, m) of `draw` alone: of the product only the rows they need."""
        return self.measure(self._combined(rng, m, self.k), self.work)

    def _combined(self, rng: np.random.Generator, m: int, rows: int) -> FloatArray:
        """The first `rows` of combinations and first-order forms (rows, m)."""
        rank = self.factor.shape[1]
        z = self.work.array("z", (rank + 1, m))
        rng.standard_normal(out=z[:rank])
        total = self.work.array("total", (rows, m))
        if not len(self.finite):
            # The offset rides along in the product: a pass over the array is saved.
            z[rank] = 1.0
            np.matmul(self.shifted[:rows], z, out=total)
            return total
        np.matmul(self.factor[:rows], z[:rank], out=total)
        scale = self.work.array("scale", (len(self.names), m))
        scale[:] = 1.0
        for i in self.finite:
            rng.standard_gamma(self.dof[i] / 2, out=scale[i])
            np.divide(self.dof[i] / 2, scale[i], out=scale[i])
            np.sqrt(scale[i], out=scale[i])
        # Row by row: the scales of all rows at once would be an array as large as `total`.
        for row, i in zip(total, self.owner, strict=False):
            row *= scale[i]
        total += self.offset[:rows]
        return total


def factor_of(covariance: FloatArray) -> FloatArray:
    """F (rows, rank) with F F' = covariance, by eigenvalues: it may be singular.

    With a moment estimate of pass-to-pass covariance the errors of very many points together
    need not have a covariance. The negative part is then left out and every row scaled back to
    its own variance. A row without variance is zero, not a residue of rounding.
    """
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    kept = values > 1e-14 * max(values[-1], 0.0)
    factor: FloatArray = np.ascontiguousarray(vectors[:, kept] * np.sqrt(values[kept]))
    wanted = np.clip(np.diag(covariance), 0.0, None)
    factor[wanted == 0] = 0.0
    if values[0] < -1e-9 * abs(values[-1]):
        drawn = np.sum(factor**2, axis=1)
        ratio = np.divide(wanted, drawn, out=np.zeros_like(drawn), where=drawn > 0)
        factor *= np.sqrt(ratio)[:, None]
    return factor


JOINT_TRIALS = 200_000
"""Trials behind the joint probability of conformance; its standard error is stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conformance:
    """Probability that the error of a future part is within -+ `tolerance` (mm)."""

    tolerance: float
    probability: float


def conformance_of(
    tolerance_um: float | None, error: float, u: float, dof: float
) -> Conformance | None:
    """P(|error of a future part| <= tolerance) with t at the effective degrees of freedom."""
    from scipy.special import ndtr, stdtr

    if tolerance_um is None:
        return None
    tolerance = tolerance_um * 1e-3
    if u == 0:
        return Conformance(tolerance=tolerance, probability=float(abs(error) <= tolerance))

    def below(t: float) -> float:
        return float(ndtr(t) if np.isinf(dof) else stdtr(dof, t))

    inside = below((tolerance - error) / u) - below((-tolerance - error) / u)
    return Conformance(tolerance=tolerance, probability=inside)


class _AllWithin:
    """1 where every toleranced length of a trial's part is within its tolerance, else 0."""

    def __init__(self, model: PointTrials, limits: FloatArray) -> None:
        self.names = ("all_within",)
        self.linear_mean = None
        self.u_exists = (True,)
        self.model = model
        self.limits = limits[:, None]

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        values = self.model.values(rng, m)
        within = np.all(np.abs(values) <= self.limits, axis=0, keepdims=True)
        return Draws(values=within.astype(np.float64))


def joint_conformance(
    model: PointTrials, items: Sequence[Conformance | None], settings: Settings
) -> tuple[float, float] | None:
    """Probability that one part conforms in all its toleranced lengths, and its standard error.

    The lengths of a part are correlated, so this is not the product of their probabilities; nor is
    it more than the least of them, which the trials may scatter beyond.
    """
    limits = np.array([np.inf if item is None else item.tolerance for item in items])
    if np.isfinite(limits).sum() < 2:
        return None
    result = monte_carlo(
        _AllWithin(model, limits),
        seed=settings.seed,
        trials=settings.trials or JOINT_TRIALS,
        threads=settings.threads,
    )
    n = result.trials
    p = float(result.mean[0])
    # One miss more and one hit more: 200 000 hits of 200 000 are not certainty.
    cautious = (p * n + 1) / (n + 2)
    least = min(item.probability for item in items if item is not None)
    return min(p, least), float(np.sqrt(cautious * (1 - cautious) / n))
