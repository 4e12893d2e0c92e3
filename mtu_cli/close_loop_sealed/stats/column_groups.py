"""Columns of candidate effects, packed by stratum so that many are tested at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.stats.strata import Strata
from mtu_cli.stats.least_squares import FloatArray

LEFT = 1e-3
"""A member of which less than this share is left beside what was found cannot be tested."""
FEWEST_LEFT = 2
"""Degrees of freedom that a stratum needs beside a member to judge it by its own scatter."""
NOTHING = 1e-22
"""Coordinates whose share of a column is below this are rounding."""

Column = Mapping[int, FloatArray]
"""The coordinates of one column, by the number of the stratum that they lie in."""
MemberColumns = Sequence[Column]
"""The k columns of one member of a candidate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OneStratum:
    """Members whose columns lie in one stratum each: `Q` (n_s, M * g) for each of the M
    `members` g orthonormal columns, its coordinates those of stratum `index`; `spread` (M,) the
    variance of what they hold over that of the stratum; `size` (M,) the mean square norm of the
    columns beside what was found, before they were made orthonormal.
    """

    index: int
    g: int
    members: NDArray[np.int64]
    Q: FloatArray
    spread: FloatArray
    size: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class ManyStrata:
    """Members of k columns that lie in several strata, the same for all: `X` (n_s, M, k) by
    stratum, `G` (M, S, k, k) their cross products in each, 0 in the others, `spread` (M, S) as in
    `OneStratum`.
    """

    k: int
    members: NDArray[np.int64]
    X: Mapping[int, FloatArray]
    G: FloatArray
    spread: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Packed:
    """All members of all candidates beside what was found already.

    `family` (M,) is each member's candidate, `k` (M,) its number of columns, `usable` (M,)
    whether enough of it is left; `dof` (S,) the degrees of freedom of the strata, `found` by
    stratum the orthonormal columns that are projected out.

    `whitening` (A, k, k) makes the first k coordinates of the column stratum of each axis, the
    means over the parts along the smooth directions, as uncertain as the rest of it: those
    directions scatter from part to part and the model's own coefficients are uncertain along
    them. `least` (S,) is a variance that no coordinate's can be below, such as that of rounding.
    """

    strata: Strata
    whitening: FloatArray
    dof: FloatArray
    family: NDArray[np.int64]
    k: NDArray[np.int64]
    usable: NDArray[np.bool_]
    one: tuple[OneStratum, ...]
    many: tuple[ManyStrata, ...]
    found: Mapping[int, FloatArray]
    least: FloatArray

    def without_found(self, y: FloatArray) -> FloatArray:
        """Coordinates (..., N), whitened, with the found columns projected out."""
        left = np.moveaxis(whitened(self.strata, self.whitening, np.moveaxis(y, -1, 0)), 0, -1)
        for index, Q in self.found.items():
            own = self.strata.all[index].slice
            if Q.shape[1] == len(Q):
                left[..., own] = 0.0
            else:
                left[..., own] -= (left[..., own] @ Q) @ Q.T
        return left


def packed(
    strata: Strata,
    dof: FloatArray,
    whitening: FloatArray,
    candidates: Sequence[Sequence[MemberColumns]],
    found: Sequence[MemberColumns] = (),
    least: FloatArray | None = None,
) -> Packed:
    """Packs the members of `candidates` for data of `strata` with `dof` (S,).

    The columns of what was `found` are projected out of each stratum by themselves, with a
    coefficient of their own there: robust against wrong weights between the strata, at the
    cost of a degree of freedom in each.
    """
    nuisance = _nuisance(strata, whitening, found)
    ranks = np.array([nuisance[i].shape[1] if i in nuisance else 0 for i in range(len(dof))])
    flat = [(f, member) for f, members in enumerate(candidates) for member in members]
    family = np.array([f for f, _ in flat], np.int64)
    k = np.array([len(member) for _, member in flat], np.int64)
    usable = np.ones(len(flat), bool)
    simple = np.array([all(len(column) == 1 for column in m) for _, m in flat], bool)
    one = _one_stratum(
        strata, whitening, [(int(i), flat[i][1]) for i in np.flatnonzero(simple)], nuisance, usable
    )
    many = _many_strata(
        strata, whitening, [(int(i), flat[i][1]) for i in np.flatnonzero(~simple)], nuisance, usable
    )
    return Packed(
        strata=strata,
        whitening=whitening,
        dof=np.maximum(dof - ranks, 1.0),
        family=family,
        k=k,
        usable=usable,
        one=tuple(one),
        many=tuple(many),
        found=nuisance,
        least=np.zeros(len(dof)) if least is None else least,
    )


def whiten(strata: Strata, whitening: FloatArray, index: int, values: FloatArray) -> None:
    """Whitens, in place, coordinates (n, ...) of a stratum along its smooth directions."""
    stratum = strata.all[index]
    if stratum.lead:
        own = np.array(stratum.lead) - 1
        W = whitening[stratum.axis][np.ix_(own, own)]
        values[: len(own)] = np.tensordot(W, values[: len(own)], axes=1)


def whitened(strata: Strata, whitening: FloatArray, values: FloatArray) -> FloatArray:
    """Coordinates (N, ...) with the smooth directions of the column strata whitened."""
    found = values.copy()
    for index, stratum in enumerate(strata.all):
        whiten(strata, whitening, index, found[stratum.slice])
    return found


def _nuisance(
    strata: Strata, whitening: FloatArray, found: Sequence[MemberColumns]
) -> dict[int, FloatArray]:
    by_stratum: dict[int, list[FloatArray]] = {}
    for member in found:
        for column in member:
            for index, values in column.items():
                by_stratum.setdefault(index, []).append(values)
    nuisance = {}
    for index, columns in by_stratum.items():
        X = np.column_stack([c / np.linalg.norm(c) for c in columns])
        whiten(strata, whitening, index, X)
        U, size, _ = np.linalg.svd(X, full_matrices=False)
        kept = U[:, size > 1e-6 * size[0]]
        # A polynomial through all places leaves nothing: then no rounding must stay either.
        nuisance[index] = np.eye(len(X)) if kept.shape[1] == len(X) else kept
    return nuisance


def _one_stratum(
    strata: Strata,
    whitening: FloatArray,
    members: Sequence[tuple[int, MemberColumns]],
    nuisance: Mapping[int, FloatArray],
    usable: NDArray[np.bool_],
) -> list[OneStratum]:
    groups: dict[tuple[int, int], list[tuple[int, list[FloatArray]]]] = {}
    for i, member in members:
        by_stratum: dict[int, list[FloatArray]] = {}
        for column in member:
            ((index, values),) = column.items()
            by_stratum.setdefault(index, []).append(values)
        for index, columns in by_stratum.items():
            groups.setdefault((index, len(columns)), []).append((i, columns))
    found = []
    for (index, g), own in sorted(groups.items()):
        # In one go: to stack the columns of every member by itself takes as long as the rest.
        X = np.ascontiguousarray(np.moveaxis(np.array([columns for _, columns in own]), 1, 2))
        whiten(strata, whitening, index, np.moveaxis(X, 1, 0))
        Q, left, size = _orthonormal(X, nuisance.get(index))
        ids = np.array([i for i, _ in own], np.int64)
        n = strata.all[index].size
        taken = nuisance[index].shape[1] if index in nuisance else 0
        if n - taken - g < FEWEST_LEFT:
            left = np.zeros(len(own), bool)
        usable[ids[~left]] = False
        Q = np.where(left[:, None, None], Q, 0.0)
        found.append(
            OneStratum(
                index=index,
                g=g,
                members=ids,
                Q=np.moveaxis(Q, 0, 1).reshape(n, len(ids) * g),
                spread=np.ones(len(ids)),
                size=size,
            )
        )
    return found


def _orthonormal(
    X: FloatArray, nuisance: FloatArray | None
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Columns of each member (M, n, g) made orthonormal, whether enough of each is left, and
    the mean square norm of what is left (M,).
    """
    size = np.linalg.norm(X, axis=1, keepdims=True)
    Q = X / np.maximum(size, 1e-300)
    if nuisance is not None:
        for _ in range(2):
            Q = Q - nuisance @ (nuisance.T @ Q)
    square = ((Q * size) ** 2).sum(axis=1).mean(axis=1)
    left = np.ones(len(X), bool)
    done: list[FloatArray] = []
    for j in range(X.shape[2]):
        column = Q[:, :, j]
        for _ in range(2):
            for other in done:
                column = column - other * (other * column).sum(axis=1, keepdims=True)
        norm = np.linalg.norm(column, axis=1, keepdims=True)
        left &= norm[:, 0] ** 2 > LEFT
        done.append(column / np.maximum(norm, 1e-300))
    return np.stack(done, axis=2), left, square


def _many_strata(
    strata: Strata,
    whitening: FloatArray,
    members: Sequence[tuple[int, MemberColumns]],
    nuisance: Mapping[int, FloatArray],
    usable: NDArray[np.bool_],
) -> list[ManyStrata]:
    groups: dict[tuple[int, ...], list[tuple[int, MemberColumns]]] = {}
    for i, member in members:
        places = sorted({index for column in member for index in column})
        groups.setdefault((len(member), *places), []).append((i, member))
    found = []
    for (k, *places), own in sorted(groups.items()):
        X = {index: np.zeros((strata.all[index].size, len(own), k)) for index in places}
        for m, (_, member) in enumerate(own):
            for j, column in enumerate(member):
                for index, values in column.items():
                    X[index][:, m, j] = values
        before = np.zeros((len(own), k))
        G = np.zeros((len(own), len(strata.all), k, k))
        for index in places:
            whiten(strata, whitening, index, X[index])
            before += (X[index] ** 2).sum(axis=0)
            if index in nuisance:
                Q, flat = nuisance[index], X[index].reshape(len(X[index]), -1)
                X[index] = (flat - Q @ (Q.T @ flat)).reshape(X[index].shape)
            G[:, index] = np.einsum("nmi,nmj->mij", X[index], X[index])
        after = np.linalg.eigvalsh(G.sum(axis=1))[:, 0]
        ids = np.array([i for i, _ in own], np.int64)
        usable[ids[after <= LEFT * before.min(axis=1)]] = False
        found.append(ManyStrata(k=k, members=ids, X=X, G=G, spread=np.ones(G.shape[:2])))
    return found
