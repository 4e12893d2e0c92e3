"""Monte Carlo trials of one future part: the errors of its points, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mtu_cli.model.prediction import Prediction
from mtu_cli.model.variance import noise_covariance
from mtu_cli.stats.blocks import Draws
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.workspace import Workspace

NEARLY_NORMAL = 30.0
"""Sources with at least this many degrees of freedom are drawn together, as one scaled t."""

Measure = Callable[[FloatArray, Workspace], FloatArray]
"""Combined errors (combinations, m) in mm -> values (outputs, m) of the measurands."""


class PointTrials:
    """A Monte Carlo model: m future parts a block, each with errors at all points.

    The errors are a sum of independent sources (the passes behind each block of components,
    the visits), each normal with a covariance that is a mean square with nu degrees of
    freedom, so that it is drawn as a scaled and shifted multivariate t (JCGM 101:2008,
    6.4.9). With `independent` every error is drawn on its own and normal, as Gilsinn & Ling
    2004, eq. (23), have it.

    `combine` (combinations, rows) says which linear combinations of the errors `measure`
    needs (differences of two points, errors less their line's mean); only these are drawn.
    `first_order` (outputs,) and `gradient` (outputs, rows) are the first-order form of the
    measurands, which serves as control variate.
    """

    def __init__(
        self,
        prediction: Prediction,
        names: tuple[str, ...],
        measure: Measure,
        combine: FloatArray,
        first_order: FloatArray,
        gradient: FloatArray,
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
        sources = error_sources(prediction, independent)
        self.sources = [(factor_of(stacked @ S @ stacked.T), dof) for S, dof in sources]
        k = len(combine)
        self.linear_squares = [np.sum(F[k:] ** 2, axis=1)[:, None] for F, _ in self.sources]
        dofs = [dof for _, dof in sources]
        self.u_exists = np.full(len(names), min(dofs, default=np.inf) > 2)
        self.linear_variance = sum(
            (
                squares[:, 0] * (1.0 if np.isinf(dof) else dof / (dof - 2) if dof > 2 else np.nan)
                for squares, dof in zip(self.linear_squares, dofs, strict=True)
            ),
            start=np.zeros(len(names)),
        )

    def draw(self, rng: np.random.Generator, m: int) -> Draws:
        """Values, first-order values and their conditional standard deviation, (outputs, m)."""
        k = len(self.offset) - len(self.names)
        total = self.work.array("total", (len(self.offset), m))
        part = self.work.array("part", total.shape)
        variance: FloatArray | float = 0.0
        for i, ((factor, dof), squares) in enumerate(
            zip(self.sources, self.linear_squares, strict=True)
        ):
            z = self.work.array(f"z{i}", (factor.shape[1], m))
            rng.standard_normal(out=z)
            if np.isinf(dof):
                variance = variance + squares
            else:
                scale = (dof / 2) / rng.standard_gamma(dof / 2, size=m)
                variance = variance + squares * scale
                z *= np.sqrt(scale)
            np.matmul(factor, z, out=part if i else total)
            if i:
                total += part
        if not self.sources:
            total[:] = 0.0
        total += self.offset
        return Draws(
            values=self.measure(total[:k], self.work),
            linear=total[k:],
            linear_u=np.sqrt(np.broadcast_to(variance, (len(self.names), np.shape(variance)[-1]))),
        )


def error_sources(
    prediction: Prediction, independent: bool = False
) -> list[tuple[FloatArray, float]]:
    """Independent sources of the errors: covariances (rows, rows) that add up to the whole.

    Each comes with the degrees of freedom of its mean square, as `block_variance` has them;
    sources with many are put together as one, whose degrees of freedom are those of their
    total variance. A source may have a negative part (see `factor_of`).
    """
    if independent:
        return [(np.diag(prediction.independent_variance), np.inf)]
    axes = len(prediction.axes)
    pieces: list[tuple[FloatArray, float]] = []
    for block in prediction.blocks:
        shared = block.G @ (block.C + block.D) @ block.G.T
        noise = noise_covariance(block.noise, axes)
        if block.pass_dof == 0:
            pieces.append((shared + noise, block.repeat_dof))
        elif block.n_passes is None:
            pieces += [(shared, block.pass_dof), (noise, block.repeat_dof)]
        else:
            between = (block.n_passes + 1) * block.G @ block.C @ block.G.T
            pieces += [(between, block.pass_dof), (shared + noise - between, block.repeat_dof)]
    live = [(S, dof) for S, dof in pieces if np.any(S)]
    sources = [(S, dof) for S, dof in live if dof < NEARLY_NORMAL]
    many = [(S, dof) for S, dof in live if dof >= NEARLY_NORMAL]
    if many:
        total: FloatArray = np.sum([S for S, _ in many], axis=0)
        spread = sum(float(np.trace(S)) ** 2 / dof for S, dof in many if not np.isinf(dof))
        dof = float(np.trace(total)) ** 2 / spread if spread > 0 else np.inf
        sources.append((total, dof))
    return sources


def factor_of(covariance: FloatArray) -> FloatArray:
    """F (rows, rank) with F F' = covariance, by eigenvalues: it may be singular.

    A difference of mean squares need not be a covariance over many points at once. Its
    negative part is then left out and every row scaled back to its own variance.
    """
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    kept = values > 1e-14 * max(values[-1], 0.0)
    factor: FloatArray = np.ascontiguousarray(vectors[:, kept] * np.sqrt(values[kept]))
    if values[0] < -1e-9 * abs(values[-1]):
        wanted = np.clip(np.diag(covariance), 0.0, None)
        drawn = np.sum(factor**2, axis=1)
        ratio = np.divide(wanted, drawn, out=np.zeros_like(drawn), where=drawn > 0)
        factor *= np.sqrt(ratio)[:, None]
    return factor
