"""Blocks of jointly estimated coefficients and the variance that they give a measurand."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mtu_cli.model.estimates import JointPasses, between_passes, from_mean
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.stats.covariance import positive_part
from mtu_cli.stats.least_squares import FloatArray


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
    columns: tuple[slice, ...]
    G: FloatArray
    C: FloatArray
    D: FloatArray
    noise: FloatArray
    pass_dof: float
    repeat_dof: tuple[float, ...]
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


@dataclass(frozen=True, slots=True)
class Shares:
    """The shares of a variance by its nature, 1 in all.

    `passes` is below 0 where passes differ by less than repeatability makes them.
    """

    coefficients: float
    passes: float
    repeatability: float


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

    def shares(self, i: int) -> Shares | None:
        """The shares of measurand i; None where it has no variance."""
        total, parts = float(self.total[i]), (self.coefficients, self.passes, self.repeatability)
        return Shares(*(float(part[i]) / total for part in parts)) if total > 0 else None


def block_variance(block: Block, A: FloatArray | None, axes: int) -> tuple[FloatArray, MeanSquares]:
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
        return _of_mean_squares(block, block.between, g, visits)
    of_C, of_D = _quadratic(g, block.C), _quadratic(g, block.D)
    dof = np.array([block.pass_dof, *block.repeat_dof])
    noise: FloatArray = np.sum(visits, axis=0)
    # A pooled moment estimate of D may be negative where passes hardly differ; the sum of passes
    # and visits is not.
    of_D = np.maximum(of_D, -noise)
    split = np.array([of_C, of_D, noise])
    if block.pass_dof == 0:
        return split, MeanSquares(of_C[None], (of_D + noise)[None], dof[1:2], [None])
    of_mean = np.array([of_C, *np.zeros_like(visits)])
    passes = [PassSquare(g, block.D), *[None] * len(visits)]
    return split, MeanSquares(of_mean, np.array([of_D, *visits]), dof, passes)


def _of_mean_squares(
    block: Block, between: FloatArray, g: FloatArray, visits: list[FloatArray]
) -> tuple[FloatArray, MeanSquares]:
    """With the mean square S of n passes, E S = D + s^2 M, the variance is

        g'(C + D)g + s^2 w = (1 + 1/n) g'S g + s^2 (w - g'M g) + s^2 q,

    w the visits of the measurand, q the powers that the passes have in common; (1/n) g'S g
    and s^2 q are of the coefficients. Where w is less than g'M g the second term is negative;
    its s^2 is then bounded by S, D being no less than 0: g'S g (1/n + w/g'M g) with the degrees
    of freedom of the passes.

    Of runs there and back S is S_m + S_h, two mean squares of the same degrees of freedom, and the
    mean over n passes has the variance 2 S_m/n. S of uneven passes is composed of separate
    estimates: where S_h is more than S, C is all of the passes.
    """
    n, halves = block.n_passes, block.half_differences
    of_C, of_D, S = (_quadratic(g, matrix) for matrix in (block.C, block.D, between))
    noise: FloatArray = np.sum(visits, axis=0)
    capped = (of_D < 0) & (noise < S - of_D)
    room = np.divide(S, S - of_D, out=np.ones_like(S), where=capped)
    split = np.array([of_C, np.where(capped, 0.0, of_D), room * noise])
    passes = np.where(capped, room * noise, S)
    of_all, of_mean, of_part = between, [S / n], [passes]
    beyond_S, matrices = np.zeros(S.shape, bool), [between]
    if halves is not None:
        of_all, of_halves = 2 * (between - halves), _quadratic(g, halves)
        matrices = [between - halves, halves]
        share = np.divide(of_halves, S, out=np.ones_like(S), where=S > 0).clip(0.0, 1.0)
        beyond_S = of_halves > S
        of_mean = [np.where(beyond_S, of_C, 2 * (1 - share) * S / n), np.zeros_like(S)]
        of_part = [(1 - share) * passes, share * passes]
    dof = np.array([*[block.pass_dof] * len(of_mean), *block.repeat_dof])
    for columns, visit in zip(block.columns, visits, strict=True):
        inside = (columns, columns)
        common = _quadratic(g[:, columns], block.C[inside] - of_all[inside] / n)
        of_mean.append(np.where(beyond_S, 0.0, common))
        beyond = _quadratic(g[:, columns], block.D[inside] - between[inside]) + visit
        of_part.append(np.where(capped, 0.0, beyond))
    squares = [*(PassSquare(g, each) for each in matrices), *[None] * len(visits)]
    return split, MeanSquares(np.array(of_mean), np.array(of_part), dof, squares)


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
        columns=(slice(0, len(identity)),),
        G=G,
        C=0 * identity if of_part else identity,
        D=identity if of_part else 0 * identity,
        noise=F[:, None] if each else np.zeros((len(F), 1)),
        pass_dof=dof if of_part else 0.0,
        repeat_dof=(np.inf,),
    )


def component_blocks(model: MachineModel, J: FloatArray, levers: FloatArray) -> list[Block]:
    """One block a group of components that share passes, one for every other component.

    `J` (rows, K) and `levers` (rows, c) as `design` gives them.
    """
    at, columns = {term.estimate.name: t for t, term in enumerate(model.terms)}, model.columns
    groups: list[tuple[list[str], JointPasses | None]] = []
    for group in model.joint:
        members = [name for name in group.components if name in at]
        if len(members) >= 2:
            groups.append((members, group))
    joint = {name for members, _ in groups for name in members}
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
