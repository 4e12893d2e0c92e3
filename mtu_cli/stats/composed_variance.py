"""The variance of linear measurands, composed of mean squares, with effective degrees of freedom.

A measurand is a linear function of errors that depend linearly on estimated coefficients. For rows
x_p, x_q of one block of coefficients, which were estimated jointly,

    Cov = x_p' (C + D) x_q + [p = q] s_repeat^2,

C the coefficients' covariance, which all parts share, D the pass-to-pass covariance, which all rows
of one part share, s_repeat the repeatability of one visit. C, D and s_repeat^2 come from a few mean
squares; each of these adds to the variance of a measurand with its own degrees of freedom, of which
Welch and Satterthwaite's formula makes the effective ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mtu_cli.stats.covariance import drawable_passes
from mtu_cli.stats.coverage import welch_satterthwaite
from mtu_cli.stats.least_squares import FloatArray, quotient


@dataclass(frozen=True, slots=True, kw_only=True)
class CoefficientBlock:
    """Coefficients that share a covariance, seen from the errors: `G` (rows, k) is what they are
    multiplied by; `C`, `D` (k, k); `noise` (rows, c) lever arms times s_repeat of its c components
    `names`, `columns` their coefficients among the k, `repeat_dof` the degrees of freedom of their
    s_repeat, `pass_dof` those of D. `between` (k, k) is the mean square S between `n_passes` passes
    that C and D come from; None, 0 where they do not come from one. `half_differences` (k, k) is
    S_h, the part of S that is of runs there and back (`mixed_model`); None where passes are
    independent.
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


def normal_block(
    name: str, F: FloatArray, *, of_part: bool = False, dof: float = np.inf
) -> CoefficientBlock:
    """Standard normal quantities times F (rows, K), known or, with `dof` degrees of freedom, drawn
    anew for every part; or one a point, times F (rows,).
    """
    each = F.ndim == 1
    G = np.zeros((len(F), 1)) if each else F
    identity = np.eye(G.shape[1])
    return CoefficientBlock(
        names=(name,),
        G=G,
        C=0 * identity if of_part else identity,
        D=identity if of_part else 0 * identity,
        noise=F[:, None] if each else np.zeros((len(F), 1)),
        pass_dof=dof if of_part else 0.0,
    )


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


def variance_of(blocks: Sequence[CoefficientBlock], A: FloatArray | None, axes: int) -> Variance:
    """Variance of the linear measurands A E, A (m, rows): law of propagation with covariance.
    Without A of the errors E themselves, (rows,). Rows are (point, axis), points first, `axes` of
    them a point, which is one visit. Effective degrees of freedom by Welch-Satterthwaite (JCGM 100,
    G.4.1) over the independent mean squares of the `blocks`, and never fewer than the least of
    them: where one is subtracted the formula alone would give almost none.
    """
    results = [_of_block(block, A, axes) for block in blocks]
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
        dof=np.maximum(welch_satterthwaite(both, behind.dof), least),
        by_block=by_block,
        coefficients=split[0],
        passes=split[1],
        repeatability=split[2],
        squares=behind,
    )


def _of_block(
    block: CoefficientBlock, A: FloatArray | None, axes: int
) -> tuple[FloatArray, list[Square]]:
    """(3, m) variance by nature of the measurands A E, and the mean squares behind it.

    Without A the measurands are the errors themselves, row by row: A = I, which for many rows is
    not to be multiplied out.
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
    if block.between is not None:
        return _of_passes(block, block.between, g, visits)
    of_C, of_D, noise = _quadratic(g, block.C), _quadratic(g, block.D), np.sum(visits, axis=0)
    # A pooled moment estimate of D may be negative where passes hardly differ; the sum of passes
    # and visits is not.
    of_D = np.maximum(of_D, -noise)
    split = np.array([of_C, of_D, noise])
    if block.pass_dof == 0:
        return split, [(of_C, of_D + noise, block.repeat_dof[0], None)]
    squares: list[Square] = [(of_C, of_D, block.pass_dof, PassSquare(g, block.D))]
    pairs = zip(visits, block.repeat_dof, strict=True)
    return split, squares + [(np.zeros_like(x), x, each, None) for x, each in pairs]


def _of_passes(
    block: CoefficientBlock, between: FloatArray, g: FloatArray, visits: Sequence[FloatArray]
) -> tuple[FloatArray, list[Square]]:
    """The same of measurands g (m, k) of coefficients with the mean square S = `between` of n
    passes, and `visits` (m,) of each component. With E S = D + s^2 M it is

        g'(C + D)g + s^2 w = (1 + 1/n) g'S g + s^2 (w - g'M g) + s^2 q,

    w the visits of the measurand, q the powers that the passes have in common; (1/n) g'S g
    and s^2 q are of the coefficients. Where w is less than g'M g the second term is negative;
    its s^2 is then bounded by S, D being no less than 0: g'S g (1/n + w/g'M g) with the degrees
    of freedom of the passes.

    Of runs there and back S is S_m + S_h, two mean squares of the same degrees of freedom, and the
    mean over n passes has the variance 2 S_m/n. S of uneven passes is composed of separate
    estimates: where S_h is more than S, C is all of the passes.
    """
    n, halves, dof = block.n_passes, block.half_differences, block.pass_dof
    of_C, of_D, noise = _quadratic(g, block.C), _quadratic(g, block.D), np.sum(visits, axis=0)
    S = _quadratic(g, between)
    capped = (of_D < 0) & (noise < S - of_D)
    room = np.divide(S, S - of_D, out=np.ones_like(S), where=capped)
    split = np.array([of_C, np.where(capped, 0.0, of_D), room * noise])
    passes = np.where(capped, room * noise, S)
    of_all, beyond_S = between, np.zeros(S.shape, bool)
    squares: list[Square] = [(S / n, passes, dof, PassSquare(g, between))]
    if halves is not None:
        of_all, of_halves = 2 * (between - halves), _quadratic(g, halves)
        share = quotient(of_halves, S, 1.0).clip(0.0, 1.0)
        beyond_S = of_halves > S
        of_mean = np.where(beyond_S, of_C, 2 * (1 - share) * S / n)
        squares = [(of_mean, (1 - share) * passes, dof, PassSquare(g, between - halves))]
        squares.append((np.zeros_like(S), share * passes, dof, PassSquare(g, halves)))
    for columns, visit, each in zip(block.columns, visits, block.repeat_dof, strict=True):
        inside = (columns, columns)
        common = _quadratic(g[:, columns], block.C[inside] - of_all[inside] / n)
        beyond = _quadratic(g[:, columns], block.D[inside] - between[inside]) + visit
        squares.append((np.where(beyond_S, 0.0, common), np.where(capped, 0.0, beyond), each, None))
    return split, squares


def _quadratic(g: FloatArray, matrix: FloatArray) -> FloatArray:
    """g'M g of every row of g (m, k)."""
    return ((g @ matrix) * g).sum(axis=1)


def covariance_of(
    blocks: Sequence[CoefficientBlock],
    axes: int,
    *,
    drawable: bool = False,
    coefficients: float = 1.0,
    by_point: bool = False,
) -> FloatArray:
    """sum G (C + D) G' of the blocks, and visits, which the axes of a point share: (rows, rows) or,
    `by_point`, that (points, axes, axes) of each point alone. It may have a negative part where D
    has one; `drawable` it has none. C counts `coefficients` times.
    """
    rows = len(blocks[0].G)
    n = rows // axes
    total = np.zeros((n, axes, axes) if by_point else (rows, rows))
    each = np.arange(n)
    for block in blocks:
        D = drawable_passes(block.D, block.C) if drawable else block.D
        M, noise = coefficients * block.C + D, block.noise.reshape(n, axes, -1)
        visits = np.einsum("pic,pjc->pij", noise, noise)
        if by_point:
            G = block.G.reshape(n, axes, -1)
            total += G @ M @ G.transpose(0, 2, 1) + visits
        else:
            total += block.G @ M @ block.G.T
            total.reshape(n, axes, n, axes)[each, :, each, :] += visits
    return total
