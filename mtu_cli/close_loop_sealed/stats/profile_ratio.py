"""Likelihood ratios of many candidate effects at once, each stratum's variance profiled out.

For coordinates y_s of stratum s with n_s degrees of freedom and variance lambda_s of its own,

    LR = sum_s n_s log(R_s(0) / R_s(beta)),  R_s(beta) = |y_s - X_s beta|^2,

beta the estimate that weights the strata by n_s / R_s. Where a column lies in one stratum
alone that is n_s log(1 / (1 - r^2)): no variance of another stratum enters. Where the columns of
the table scatter differently, what a member explains is over its own share f_s of the variance
(`uneven`): n_s log(1 + (R_s(0) - R_s(beta)) / (f_s R_s(beta))), and where another stratum makes
R_s(beta) the larger of the two, the same the other way round. Bayes factors are
Schwarz's approximation for a prior of unit information: Zellner's g-prior with g = n has the
same limit for weak effects, but stays finite however strong an effect is, and then tells no
rivals apart (the information paradox of Liang et al., J. Am. Stat. Assoc. 103 (2008) 410).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.column_groups import ManyStrata, OneStratum, Packed
from mtu_cli.stats.least_squares import FloatArray

REWEIGHTED = 3
TINY = 1e-200
"""In place of a sum of squares of 0: its inverse times any column is still a number."""
MOST_EXPLAINED = 1 - 1e-12
CACHED = 20_000
"""Entries of the arrays that are worked on at once."""
TIE = 1e-9
"""Share of a log Bayes factor by which equal ones differ."""
NEVER = -1e6
"""Logarithm of the Bayes factor of a member that cannot be tested."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MemberRatios:
    """Of B samples and M members, each (B, M): `ratio` the LR and `log_bayes` the logarithm of the
    Bayes factor, -1 and `NEVER` for those of which too little is left beside what was found;
    `dof` that the scatter of what they lie in has, and `information` x' V^-1 x, the mean over
    a member's columns x, V by what the member leaves.
    """

    ratio: FloatArray
    log_bayes: FloatArray
    dof: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratios:
    """Of B samples and F candidates: `ratio` (B, F) the largest LR of each candidate's members,
    `log_bayes` (B, F) the logarithm of its Bayes factor, the mean over its members, `best`
    (B, F) the member of the largest Bayes factor, -1 where none can be tested; of the `members`.
    """

    ratio: FloatArray
    log_bayes: FloatArray
    best: NDArray[np.int64]
    members: MemberRatios


def ratios(pack: Packed, y: FloatArray, candidates: int) -> Ratios:
    """Likelihood ratios and Bayes factors of `candidates` for coordinates `y` (B, N).

    `y` has the found columns projected out (`Packed.without_found`).
    """
    return _by_candidate(pack, member_ratios(pack, y), candidates)


def member_ratios(pack: Packed, y: FloatArray) -> MemberRatios:
    """Likelihood ratios and Bayes factors of all members for coordinates `y` (B, N)."""
    B, M = len(y), len(pack.family)
    squares = sums_of_squares(pack, y)
    found = MemberRatios(
        ratio=np.zeros((B, M)),
        log_bayes=np.zeros((B, M)),
        dof=np.zeros((B, M)),
        information=np.zeros((B, M)),
    )
    for one in pack.one:
        _add_one(pack, one, y, squares, found)
    for many in pack.many:
        _add_many(pack, many, y, squares, found)
    found.ratio[:, ~pack.usable] = -1.0
    found.log_bayes[:, ~pack.usable] = NEVER
    return found


def sums_of_squares(pack: Packed, y: FloatArray) -> FloatArray:
    """R_s(0) (B, S); never quite 0, nor below what `least` makes of it."""
    own = [y[:, stratum.slice] for stratum in pack.strata.all]
    found = np.stack([np.einsum("bn,bn->b", values, values) for values in own], axis=1)
    least: FloatArray = np.maximum(found, np.maximum(pack.least * pack.dof, TINY))
    return least


def _add_one(
    pack: Packed,
    one: OneStratum,
    y: FloatArray,
    squares: FloatArray,
    found: MemberRatios,
) -> None:
    own = y[:, pack.strata.all[one.index].slice]
    explained = ((own @ one.Q) ** 2).reshape(len(y), len(one.members), one.g).sum(axis=2)
    n = pack.dof[one.index]
    total = squares[:, one.index, None]
    most = np.minimum(1 - pack.least[one.index] * n / total, MOST_EXPLAINED)
    r2 = np.minimum(explained / total, most)
    ratio = n * np.log1p(r2 / (1 - r2) / one.spread)
    found.ratio[:, one.members] += ratio
    found.log_bayes[:, one.members] += unit_information(ratio, n, one.g)
    found.dof[:, one.members] += n
    variance = total * (1 - r2) * one.spread / n
    found.information[:, one.members] += one.g / pack.k[one.members] * one.size / variance


def unit_information(ratio: FloatArray, n: FloatArray | float, k: int) -> FloatArray:
    """log Bayes factor of k columns with this likelihood ratio on n degrees of freedom."""
    found: FloatArray = 0.5 * ratio * np.maximum(n - k, 0.0) / n - 0.5 * k * np.log1p(n)
    return found


def _add_many(
    pack: Packed,
    many: ManyStrata,
    y: FloatArray,
    squares: FloatArray,
    found: MemberRatios,
) -> None:
    b = cross_products(pack, many, y)
    # A few samples at a time stay in the processor's cache.
    several = max(1, CACHED // max(b[:1].size, 1))
    for first in range(0, len(y), several):
        rows = slice(first, first + several)
        _add_samples(pack, many, b[rows], squares[rows], rows, found)


def _add_samples(
    pack: Packed,
    many: ManyStrata,
    b: FloatArray,
    squares: FloatArray,
    rows: slice,
    found: MemberRatios,
) -> None:
    """Of the samples in `rows`: their cross products `b` (B, M, S, k) and `squares` (B, S)."""
    n, R0, k = pack.dof, squares[:, None, :], range(many.k)
    R = np.broadcast_to(R0, b.shape[:3])
    least = np.maximum((1 - MOST_EXPLAINED) * R0, pack.least * n)
    # One column, and one pair of them, at a time: k is 1 or 2 mostly, and each pass is over whole
    # arrays then.
    columns, G = [b[..., i] for i in k], [[many.G[..., i, j] for j in k] for i in k]
    for _ in range(REWEIGHTED):
        w = n / (R * many.spread)
        A = np.empty((*w.shape[:2], many.k, many.k))
        for i, j in product(k, k):
            A[..., i, j] = (w * G[i][j]).sum(axis=2) if i <= j else A[..., j, i]
        A += 1e-12 * np.trace(A, axis1=2, axis2=3)[..., None, None] * np.eye(many.k) + TINY
        beta = solved(A, np.stack([(w * x).sum(axis=2) for x in columns], axis=-1))[..., None]
        R = R0 - 2 * sum(beta[:, :, i] * columns[i] for i in k)
        R = R + sum(beta[:, :, i] * beta[:, :, j] * G[i][j] for i, j in product(k, k))
        np.maximum(R, least, out=R)
    gain, loss = np.maximum(R0 - R, 0.0), np.maximum(R - R0, 0.0)
    own = R * many.spread
    ratio = np.log1p(gain / own) - np.log1p(loss / (R0 * many.spread))
    ratio = (n * ratio).sum(axis=2)
    size = np.einsum("msii->ms", many.G)
    share = w * size
    share /= np.maximum(share.sum(axis=2, keepdims=True), TINY)
    effective = (share * n).sum(axis=2)
    found.ratio[rows, many.members] = ratio
    bayes = unit_information(np.maximum(ratio, 0.0), effective, many.k)
    found.log_bayes[rows, many.members] = bayes
    found.dof[rows, many.members] = effective
    held = (n / own * size).sum(axis=2)
    found.information[rows, many.members] = held / many.k


def solved(A: FloatArray, b: FloatArray) -> FloatArray:
    """A^-1 b of many systems, A (..., k, k) and b (..., k): most members have one column or two."""
    if b.shape[-1] == 1:
        return b / A[..., 0]
    if b.shape[-1] == 2:
        # Scaled to a diagonal of 1: products of the weights of a stratum without scatter, which are
        # as large as numbers get, would be none.
        size = np.sqrt(np.diagonal(A, axis1=-2, axis2=-1))
        c, own = A[..., 0, 1] / (size[..., 0] * size[..., 1]), b / size
        left = own - c[..., None] * own[..., ::-1]
        found: FloatArray = left / (((1 - c) * (1 + c))[..., None] * size)
        return found
    return np.asarray(np.linalg.solve(A, b[..., None])[..., 0], np.float64)


def cross_products(pack: Packed, many: ManyStrata, y: FloatArray) -> FloatArray:
    """X_s' y_s (B, M, S, k)."""
    b = np.zeros((len(y), len(many.members), len(pack.strata.all), many.k))
    for s, block in many.X.items():
        flat = y[:, pack.strata.all[s].slice] @ block.reshape(len(block), -1)
        b[:, :, s] = flat.reshape(len(y), len(many.members), many.k)
    return b


def _by_candidate(pack: Packed, members: MemberRatios, candidates: int) -> Ratios:
    LR, log_bayes = members.ratio, members.log_bayes
    B = len(LR)
    ratio = np.zeros((B, candidates))
    bayes = np.full((B, candidates), NEVER)
    best = np.full((B, candidates), -1)
    ends = np.searchsorted(pack.family, np.arange(candidates + 1))
    for f in range(candidates):
        own = slice(int(ends[f]), int(ends[f + 1]))
        if not pack.usable[own].any():
            continue
        ratio[:, f] = np.maximum(LR[:, own].max(axis=1), 0.0)
        # Of nested members the largest has the largest ratio whatever the data say.
        mine = log_bayes[:, own][:, pack.usable[own]]
        top = mine.max(axis=1)
        # Of equal ones the first, which rounding must not decide.
        enough = top - TIE * np.maximum(np.abs(top), 1.0)
        best[:, f] = (log_bayes[:, own] >= enough[:, None]).argmax(axis=1) + own.start
        bayes[:, f] = top + np.log(np.exp(mine - top[:, None]).mean(axis=1))
    return Ratios(ratio=ratio, log_bayes=bayes, best=best, members=members)
