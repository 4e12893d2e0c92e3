"""Members that a table can tell from nothing at all, and from each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mtu_cli.close_loop_sealed.model.effect_candidate import FloatArray, Member
from mtu_cli.close_loop_sealed.model.effect_data import COPY, TableData
from mtu_cli.close_loop_sealed.model.effect_members import Batch
from mtu_cli.files.effects import Family

LEFT = 1.0 - COPY


def distinct(
    family: Family, batches: Sequence[Batch], data: TableData
) -> tuple[tuple[Member, ...], tuple[str, ...]]:
    """The members of a candidate that differ, in their order, and notes on those left out.

    Columns are compared beside an offset of each axis (and the polynomial that the readings
    themselves gave): a member of which nothing is left there, or whose columns depend on each
    other, is dropped, and one that spans the same space as an earlier one (R^2 above COPY): the
    earlier one is told what else it may be. Of a searched one the columns that do not depend on
    each other stay: a sine that is 0 at all places leaves its cosine.
    """
    members: list[Member] = []
    spans: dict[tuple[object, ...], list[tuple[int, FloatArray]]] = {}
    for batch in batches:
        key, X, sizes = _beside(family, batch, data)
        # A sine that is 0 at all places is so up to rounding, which is no size to judge it by.
        of_all = sizes.max(axis=0, keepdims=True) if batch.bound.is_periodic else sizes
        least = LEFT * np.broadcast_to(of_all, sizes.shape)
        Q, sound = _orthonormal(X, least)
        for g, member in enumerate(batch.members):
            if sound[g]:
                spans.setdefault(key, []).append((len(members), Q[g]))
                members.append(member)
            elif member.searched and (few := _independent(X[g], least[g])):
                own, _ = np.linalg.qr(X[g][:, few])
                spans.setdefault((len(few), *key[1:]), []).append((len(members), own))
                members.append(batch.bound.narrowed(member, few))
    if family.over is not None and len(members) > 2:
        return tuple(members), ()
    same = _same(spans, len(members))
    if family.over is not None and same == {1: 0}:
        # Of two alike, one is off by what the other is not: the one that errs more.
        far = [_error(member, data) for member in members]
        same = {0: 1} if far[1] > far[0] else same
    kept = tuple(
        replace(member, alike=_alike(members, same, i))
        for i, member in enumerate(members)
        if i not in same
    )
    return kept, _notes(members, same)


def _error(member: Member, data: TableData) -> float:
    """The size of the median error of what is chosen, along the axes of the columns."""
    table, square = data.table, 0.0
    for column in member.columns:
        for axis, lever in column.items():
            own = (np.broadcast_to(lever, table.there.shape) != 0) & table.there
            square += float(np.median(table.errors[..., axis][own])) ** 2 if own.any() else 0.0
    return float(np.sqrt(square))


def _alike(members: Sequence[Member], same: dict[int, int], first: int) -> tuple[float, ...]:
    """Searched values of the members that are the same as the first one."""
    return tuple(
        value for i, j in same.items() if j == first for value in members[i].searched.values()
    )


def _beside(
    family: Family, batch: Batch, data: TableData
) -> tuple[tuple[object, ...], FloatArray, FloatArray]:
    """Columns (G, N, k) beside the offset, and their squares (G, k) before."""
    P, H = len(data.table.parts), len(data.table.features)
    G, k = len(batch.members), len(batch.columns)
    degree = max(data.table.fitted_degree, -1 if family.kind == "offset" else 0)
    blocks, sizes, shapes = [], np.zeros((G, k)), []
    for axis in sorted({axis for column in batch.columns for axis in column}):
        own = [column.get(axis, np.zeros((1, 1, 1))) for column in batch.columns]
        p, h = np.broadcast_shapes(*[value.shape[1:] for value in own])
        weight = np.sqrt((P / p) * (H / h))
        block = np.stack([np.broadcast_to(value, (G, p, h)) for value in own], axis=-1) * weight
        sizes += np.einsum("gphk,gphk->gk", block, block)
        blocks.append(_less_polynomial(block, degree, data).reshape(G, p * h, k))
        shapes.append((axis, p, h))
    return (k, *shapes), np.concatenate(blocks, axis=1), sizes


def _less_polynomial(block: FloatArray, degree: int, data: TableData) -> FloatArray:
    """A block (G, p, h, k) less its polynomial in position over the columns."""
    if degree < 0:
        return block
    along = data.values.get(data.table.axes[0]) if data.table.component is not None else None
    if degree == 0 or along is None or along.shape != (1, block.shape[2]) or along.size == 1:
        centred: FloatArray = block - block.mean(axis=(1, 2), keepdims=True)
        return centred
    scaled = (along[0] - along.mean()) / max(float(np.ptp(along)), 1e-300)
    Q, _ = np.linalg.qr(np.vander(scaled, min(degree + 1, len(np.unique(scaled)))))
    left: FloatArray = block - (Q @ (Q.T @ block.mean(axis=1)))[:, None]
    return left


def _orthonormal(X: FloatArray, least: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Orthonormal columns (G, N, k), and which of the G members have their full rank (G,): of
    each column a square above `least` (G, k) is left beside those before it.
    """
    if X.shape[1] < X.shape[2]:
        return X, np.zeros(len(X), bool)
    Q, R = np.linalg.qr(X)
    left = np.diagonal(R, axis1=1, axis2=2) ** 2
    sound: NDArray[np.bool_] = np.all(left > least, axis=1)
    return Q, sound


def _independent(X: FloatArray, least: FloatArray) -> list[int]:
    """Columns of X (N, k), the largest first, of which a square above `least` (k,) is left beside
    those taken before.
    """
    shares = (X**2).sum(axis=0) / np.maximum(least, 1e-300)
    taken = np.zeros((len(X), 0))
    kept = []
    # Digits that rounding does not reach: of two alike the first one is taken everywhere.
    for k in np.argsort([-float(f"{share:.6g}") for share in shares], kind="stable").tolist():
        left = X[:, k] - taken @ (taken.T @ X[:, k])
        size = float(left @ left)
        if size > least[k]:
            kept.append(k)
            taken = np.column_stack([taken, left / np.sqrt(size)])
    return sorted(kept)


def _same(
    spans: dict[tuple[object, ...], list[tuple[int, FloatArray]]], count: int
) -> dict[int, int]:
    """For each member that spans what an earlier one does: that one."""
    same: dict[int, int] = {}
    for own in spans.values():
        if len(own) < 2:
            continue
        Q = np.stack([q for _, q in own])
        shared = sum(
            (Q[:, :, i] @ Q[:, :, j].T) ** 2 for i in range(Q.shape[2]) for j in range(Q.shape[2])
        )
        firsts = (np.asarray(shared) > COPY * Q.shape[2]).argmax(axis=1)
        same |= {own[i][0]: own[j][0] for i, j in enumerate(firsts.tolist()) if j < i}
    return same


def _notes(members: Sequence[Member], same: dict[int, int]) -> tuple[str, ...]:
    notes: dict[str, None] = {}
    searched = [i for i in same if members[i].searched]
    if searched:
        name = next(iter(members[searched[0]].searched))
        notes[
            f"{len(searched)} of {len(members)} values of {name} look like others in this data"
        ] = None
    for i, first in same.items():
        if not members[i].searched:
            notes[f"{_shown(members[i])} is the same as {_shown(members[first])} here"] = None
    return tuple(notes)


def _shown(member: Member) -> str:
    if member.chosen is not None:
        return member.chosen
    return "; ".join(f"{key} = {text}" for key, text in member.equations.items())
