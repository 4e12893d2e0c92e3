"""The passes' own lines, and how much they differ from pass to pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.stats.least_squares import (
    RANK_TOLERANCE,
    FloatArray,
    LeastSquares,
    least_squares,
)

IntArray = NDArray[np.int64]

ROUNDING = 32 * float(np.finfo(np.float64).eps)
"""Scatter below this share of the largest reading is arithmetic, not measurement."""
FEWEST_ROUNDINGS = 32
"""Operations, each rounded, between a reading and what is told of it, if it is never summed."""


@dataclass(frozen=True, slots=True)
class OwnLines:
    """The passes' own lines over their columns Z_g, with m powers common to all passes.

    `coefficients` (G, q) are those of the readings less the common powers, `carried`
    (G, q, m) those of the common powers, `shared` the fit of the powers within passes.
    `precisions` and `inverses` (G, q, q) hold Z_g'Z_g and its inverse. `s2` = rss/dof is the
    repeatability variance, `rounding` the sum of squares that arithmetic alone may leave.
    """

    coefficients: FloatArray
    carried: FloatArray
    shared: LeastSquares
    inverses: FloatArray
    precisions: FloatArray
    s2: float
    rss: float
    dof: int
    rounding: float


def rounding_of(y: FloatArray) -> float:
    """What a mean of the readings (n,), or a line through them, may be off by arithmetic alone.

    A sum of n numbers is rounded n times, by half of the spacing of numbers of its size each;
    few numbers are scaled, centred and turned more often than they are summed.
    """
    steps = max(len(y), FEWEST_ROUNDINGS)
    return steps * float(np.spacing(np.abs(y).max(initial=0.0)))


def own_lines(
    y: FloatArray, Z: FloatArray, common: FloatArray, codes: IntArray, G: int
) -> OwnLines:
    """Each pass's own coefficients, with the higher powers common to all passes.

    The common columns and y are first freed from every pass's own line (Frisch-Waugh), so
    that nothing larger than the readings is ever formed.
    """
    free = np.column_stack([common, y])
    lines, residual = lines_by_pass(free, Z, codes, G)
    precisions = np.zeros((G, Z.shape[1], Z.shape[1]))
    for i in range(Z.shape[1]):
        for j in range(Z.shape[1]):
            precisions[:, i, j] = np.bincount(codes, Z[:, i] * Z[:, j], G)
    k = common.shape[1]
    # What the lines took out whole would come back as a column of rounding errors.
    absorbed = np.linalg.norm(residual[:, :k], axis=0) <= 1e-10 * np.linalg.norm(common, axis=0)
    residual[:, :k][:, absorbed] = 0.0
    shared = least_squares(residual[:, :k], residual[:, k])
    rounding = len(y) * float(ROUNDING * np.abs(y).max()) ** 2
    dof = len(y) - G * Z.shape[1] - shared.rank
    # One reading a pass: nothing repeats within it, all scatter is pass-to-pass.
    rss = shared.rss if dof > 0 and shared.rss > rounding else 0.0
    return OwnLines(
        coefficients=lines[:, :, k] - lines[:, :, :k] @ shared.coefficients,
        carried=lines[:, :, :k],
        shared=shared,
        inverses=np.asarray(np.linalg.inv(precisions), dtype=np.float64),
        precisions=precisions,
        s2=rss / max(dof, 1),
        rss=rss,
        dof=max(dof, 0),
        rounding=rounding,
    )


def lines_by_pass(
    columns: FloatArray, Z: FloatArray, codes: IntArray, G: int
) -> tuple[FloatArray, FloatArray]:
    """Least-squares lines (G, q, m) of the columns (n, m) in every pass, and what they leave.

    Z (n, q) is [1] or [1, z], `codes` (n,) are the passes 0 to G - 1, none of them empty. Level at
    the pass's own mean z and slope are apart: both come in closed form, for all passes at once. A
    pass of one z has slope 0.
    """
    order = np.argsort(codes, kind="stable")
    starts = np.searchsorted(codes[order], np.arange(G))

    def sums(values: FloatArray) -> FloatArray:
        found: FloatArray = np.add.reduceat(values[order], starts, axis=0)
        return found

    counts = np.bincount(codes, minlength=G)[:, None]
    level = sums(columns) / counts
    rest = columns - level[codes]
    if Z.shape[1] == 1:
        return level[:, None], rest
    z = Z[:, 1:]
    middle = sums(z) / counts
    t = z - middle[codes]
    square = sums(t * t)
    told = square > RANK_TOLERANCE**2 * sums(z * z)
    slope = sums(t * rest) * np.divide(1.0, square, out=np.zeros_like(square), where=told)
    rest -= t * slope[codes]
    return np.stack([level - middle * slope, slope], axis=1), rest


def between_passes(
    stage: OwnLines, fixed: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Mean square S (q, q) of the passes' coefficients about their mean by direction.

    With it M (q, q), where E S = D + s2 M, and the deviations (G, q). M holds the error of
    each pass's own line and what the error of the common powers carries into lines over
    different positions. None where the common powers are not determined within passes but
    needed to compare them.
    """
    dof = len(fixed) - fixed.shape[1]
    # What is left of passes beside `fixed`, without a matrix of all by all of them.
    by_fixed = np.linalg.solve(fixed.T @ fixed, fixed.T)
    apart = 1.0 - np.einsum("gf,fg->g", fixed, by_fixed)
    deviations = stage.coefficients - fixed @ (by_fixed @ stage.coefficients)
    of_fixed = np.einsum("fg,gia->fia", by_fixed, stage.carried)
    carried = stage.carried - np.einsum("gf,fia->gia", fixed, of_fixed)
    null = stage.shared.null_space
    if (np.abs(carried @ null) > 1e-9 * (np.abs(stage.carried).max(axis=0) @ np.abs(null))).any():
        return None
    of_lines = np.einsum("g,gij->ij", apart, stage.inverses)
    of_powers = np.einsum("gia,ab,gjb->ij", carried, stage.shared.unscaled_covariance, carried)
    size = np.einsum("gi,gij,gj->", deviations, stage.precisions, deviations)
    if size <= stage.rounding:
        deviations = np.zeros_like(deviations)
    return deviations.T @ deviations / dof, (of_lines + of_powers) / dof, deviations
