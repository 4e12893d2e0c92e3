"""Blocks of jointly estimated coefficients and the variance that they give a measurand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Coefficients that share a covariance, seen from the points: G (rows, k) = J columns.

    `C`, `D` (k, k); `noise` (rows, c) holds lever arms times s_repeat of its components.
    """

    names: tuple[str, ...]
    G: FloatArray
    C: FloatArray
    D: FloatArray
    noise: FloatArray
    pass_dof: float
    repeat_dof: float
    n_passes: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Variance:
    """Variance (m,) of m linear measurands with effective degrees of freedom (m,).

    `by_block` (blocks, m) are the shares of the blocks; `coefficients`, `passes` and
    `repeatability` (m,) split the variance by its nature.
    """

    total: FloatArray
    dof: FloatArray
    by_block: FloatArray
    coefficients: FloatArray
    passes: FloatArray
    repeatability: FloatArray


def block_variance(
    block: Block, A: FloatArray, axes: int
) -> tuple[FloatArray, list[FloatArray], list[float]]:
    """(3, m) variance by nature; the mean squares and their degrees of freedom."""
    g = A @ block.G
    of_C = np.einsum("mi,ij,mj->m", g, block.C, g)
    of_D = np.einsum("mi,ij,mj->m", g, block.D, g)
    noise = np.zeros(len(A))
    for column in block.noise.T:
        at_point = (A * column).reshape(len(A), -1, axes).sum(axis=2)
        noise += (at_point**2).sum(axis=1)
    # The moment estimate of D may be negative where passes hardly differ; what passes and
    # visits add together is not.
    of_D = np.maximum(of_D, -noise)
    split = np.array([of_C, of_D, noise])
    if block.pass_dof == 0:
        return split, [of_C + of_D + noise], [block.repeat_dof]
    if block.n_passes is None:
        return split, [of_C + of_D, noise], [block.pass_dof, block.repeat_dof]
    between = (block.n_passes + 1) * of_C
    return split, [between, of_C + of_D + noise - between], [block.pass_dof, block.repeat_dof]


def noise_covariance(noise: FloatArray, axes: int) -> FloatArray:
    """(rows, rows): axes of one point share a visit's error, points do not."""
    rows = len(noise)
    per_point = noise.reshape(rows // axes, axes, -1)
    blocks = np.einsum("pic,pjc->pij", per_point, per_point)
    total = np.zeros((rows, rows))
    for p, block in enumerate(blocks):
        total[p * axes : (p + 1) * axes, p * axes : (p + 1) * axes] = block
    return total
