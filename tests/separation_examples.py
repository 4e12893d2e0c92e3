"""Classes of effects on shop days, and how far apart they are by dense least squares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from loop_bench.days import shop_table
from shop_day import ShopDay, Truth, effect, measure
from shop_day.day import Floats, Kind

from mtu_cli.close_loop_sealed.analyses.loop.added import Added, added
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared, prepare
from mtu_cli.close_loop_sealed.analyses.loop.search import Search
from mtu_cli.close_loop_sealed.analyses.loop.state import Step
from mtu_cli.close_loop_sealed.model.effect_library import candidates, effect_library
from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable
from mtu_cli.close_loop_sealed.stats.profile_ratio import ratios

LIBRARY = effect_library()


def prepared_of(table: ResidualTable) -> Prepared:
    return prepare(table, candidates(table, LIBRARY), table.pass_dof)


@cache
def prepared_day(kind: Kind, seed: int, parts: int = 21) -> Prepared:
    """A day of noise alone."""
    day = ShopDay(kind, seed, parts)
    return prepared_of(shop_table(day, measure(day, np.random.default_rng(seed))))


def index(prepared: Prepared, name: str) -> int:
    return [c.name for c in prepared.candidates].index(name)


def members_of(prepared: Prepared, name: str) -> list[int]:
    sizes = [len(members) for members in prepared.scan.columns]
    start = sum(sizes[: index(prepared, name)])
    return list(range(start, start + sizes[index(prepared, name)]))


def with_effect(kind: Kind, seed: int, family: str, amplitude: float) -> tuple[Prepared, Truth]:
    """A day with an effect, its columns prepared before."""
    day, rng = ShopDay(kind, seed), np.random.default_rng([seed, 1])
    truth = effect(day, family, rng, amplitude)
    errors = measure(day, rng, [truth])
    whole = prepared_day(kind, seed)
    return whole.with_table(replace(whole.table, errors=errors * 1e-3)), truth


def found_as(prepared: Prepared, names: Sequence[str]) -> tuple[Added, Search]:
    """What a search gives that finds the first of `names` and cannot tell it from the others."""
    pack = prepared.scan.pack()
    best = ratios(pack, pack.without_found(prepared.y)[None], len(prepared.scan.columns)).best[0]
    own = [index(prepared, name) for name in names]
    step = Step(
        index=own[0],
        member=int(best[own[0]]),
        p=0.01,
        log_bayes=0.0,
        posterior=1 / len(names),
        credible=tuple(own),
    )
    nothing = np.zeros(len(prepared.candidates))
    found = Search(
        steps=(step,),
        p=nothing,
        log_bayes=nothing,
        posterior=nothing,
        checks=(),
    )
    return added(prepared, found), found


def with_variances(
    prepared: Prepared, interaction: Floats, column: Floats, part: Floats
) -> Prepared:
    """With a null of uncorrelated coordinates: variances (A,), (A,) and (A, 1 + k), mm^2."""
    null = replace(
        prepared.scan.null,
        interaction=interaction,
        column=column,
        part=np.diag(part.ravel()),
    )
    return replace(prepared, scan=replace(prepared.scan, null=null))


def dense_d2(
    truth: Mapping[int, Floats],
    rivals: Sequence[Sequence[Mapping[int, Floats]]],
    basis: Floats,
    variances: tuple[Floats, Floats, Floats],
) -> float:
    """What the best of `rivals` (members of columns (P, H) by axis) leaves of a truth, by the
    inverse covariance of all cells of an axis; the mean of each axis is free.
    """
    interaction, column, part = variances
    P, H = next(iter(truth.values())).shape
    W = {}
    for a in range(len(interaction)):
        V = interaction[a] * np.eye(P * H) + column[a] * np.kron(np.ones((P, P)), np.eye(H))
        V += np.kron(np.eye(P), basis @ np.diag(part[a]) @ basis.T)
        W[a] = np.linalg.inv(V)
    least = float(np.inf)
    for member in rivals:
        normal = np.zeros((len(member) + len(W),) * 2)
        right, total = np.zeros(len(normal)), np.zeros(())
        for a, inverse in W.items():
            X = np.zeros((P * H, len(normal)))
            for j, levers in enumerate(member):
                X[:, j] = levers.get(a, np.zeros((P, H))).ravel()
            X[:, len(member) + a] = 1.0
            y = truth.get(a, np.zeros((P, H))).ravel()
            normal += X.T @ inverse @ X
            right += X.T @ inverse @ y
            total = total + y @ inverse @ y
        scale = np.sqrt(np.diag(normal))
        beta = np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True) @ (right / scale)
        least = min(least, float(total - beta @ (right / scale)))
    return least


def parts_basis(places: Floats) -> Floats:
    """(H, 1 + k) orthonormal: the constant, then x, y, z."""
    columns = np.column_stack([np.ones(len(places)), places - places.mean(axis=0)])
    return np.linalg.qr(columns)[0]
