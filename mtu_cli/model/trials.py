"""Monte Carlo trials of one future part: the errors of its points, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mtu_cli.model.prediction import Prediction, noise_covariance
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace

NEARLY_NORMAL = 30.0
"""Sources with at least this many degrees of freedom are drawn together, as one scaled t."""

Measure = Callable[[FloatArray, Workspace], FloatArray]
"""Errors (rows, m) of the points in mm -> values (outputs, m) of the measurands."""


class PointTrials:
    """A Monte Carlo model: m future parts a block, each with errors at all points.

    The errors are a sum of independent sources (the passes behind each block of components,
    the visits), each normal with a covariance that is a mean square with nu degrees of
    freedom, so that it is drawn as a scaled and shifted multivariate t (JCGM 101:2008,
    6.4.9). `measure` makes values of them; `first_order` (outputs,) and `gradient`
    (outputs, rows) are its first-order form, which serves as control variate. With
    `independent` every error is drawn on its own and normal, as Gilsinn & Ling 2004,
    eq. (23), have it.
    """

    def __init__(
        self,
        prediction: Prediction,
        names: tuple[str, ...],
        measure: Measure,
        first_order: FloatArray,
        gradient: FloatArray,
        *,
        independent: bool = False,
    ) -> None:
        self.names = names
        self.linear_mean = first_order
        self.measure = measure
        self.mean = prediction.mean[:, None]
        self.work = Workspace()
        if independent:
            sources = [(np.diag(np.sqrt(prediction.independent_variance)), np.inf)]
        else:
            sources = error_sources(prediction)
        self.factors = [factor for factor, _ in sources]
        self.dofs = [dof for _, dof in sources]
        self.linear_factors = [gradient @ factor for factor in self.factors]
        self.linear_squares = [np.sum(L**2, axis=1) for L in self.linear_factors]
        finite = min(self.dofs, default=np.inf)
        self.u_exists = tuple(bool(finite > 2) for _ in names)

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values, first-order values and their conditional standard deviation, (outputs, m)."""
        outputs, rows = len(self.names), len(self.mean)
        errors = self.work.array("errors", (rows, m))
        linear = self.work.array("linear", (outputs, m))
        variance = self.work.array("variance", (outputs, m))
        errors[:] = self.mean
        linear[:] = self.linear_mean[:, None]
        variance[:] = 0.0
        for i, (factor, dof) in enumerate(zip(self.factors, self.dofs, strict=True)):
            z = self.work.array(f"z{i}", (factor.shape[1], m))
            rng.standard_normal(out=z)
            if np.isinf(dof):
                variance += self.linear_squares[i][:, None]
            else:
                scale = dof / 2 / rng.standard_gamma(dof / 2, size=m)
                variance += self.linear_squares[i][:, None] * scale
                z *= np.sqrt(scale)
            linear += self.linear_factors[i] @ z
            part = self.work.array("part", (rows, m))
            np.matmul(factor, z, out=part)
            errors += part
        return Draws(
            values=self.measure(errors, self.work),
            linear=linear,
            linear_u=np.sqrt(variance, out=variance),
        )


def error_sources(prediction: Prediction) -> list[tuple[FloatArray, float]]:
    """Independent sources of the errors: factors F (rows, r) with F F' their covariance.

    Each comes with the degrees of freedom of its mean square; sources with many are put
    together. The sum of all F F' is the prediction's covariance.
    """
    axes = len(prediction.axes)
    pieces: list[tuple[FloatArray, float]] = []
    for block in prediction.blocks:
        shared = block.G @ (block.C + block.D) @ block.G.T
        noise = noise_covariance(block.noise, axes)
        if block.pass_dof == 0:
            pieces.append((shared + noise, block.repeat_dof))
        else:
            pieces += [(shared, block.pass_dof), (noise, block.repeat_dof)]
    few: list[tuple[FloatArray, float]] = []
    many: list[tuple[FloatArray, float]] = []
    for covariance, dof in pieces:
        if np.trace(covariance) > 0:
            (many if dof >= NEARLY_NORMAL else few).append((covariance, dof))
    sources = [(_factor(covariance), dof) for covariance, dof in few]
    if many:
        total = np.sum([covariance for covariance, _ in many], axis=0)
        spread = sum(float(np.trace(c)) ** 2 / dof for c, dof in many if not np.isinf(dof))
        dof = float(np.trace(total)) ** 2 / spread if spread > 0 else np.inf
        sources.append((_factor(total), dof))
    return sources


def _factor(covariance: FloatArray) -> FloatArray:
    """F (rows, rank) with F F' = covariance, by eigenvalues: it may be singular."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    kept = values > 1e-14 * values[-1]
    factor: FloatArray = np.ascontiguousarray(vectors[:, kept] * np.sqrt(values[kept]))
    return factor
