"""Held-out errors of a thermal model, nested so that no cycle judges a choice it took part in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc

from mtu_cli.analyses.thermal_fit.choice import Folds, choose, cycles_of, ordinary, other_blocks
from mtu_cli.analyses.thermal_fit.columns import Library, Rows
from mtu_cli.analyses.thermal_fit.models import (
    Fitted,
    Spec,
    fit,
    sum_of_squares,
    weights,
)
from mtu_cli.analyses.thermal_fit.result import Candidate, CycleRms, HeldOut, PositionTest
from mtu_cli.stats import autocorrelation as following
from mtu_cli.stats.autocorrelation import effective_number
from mtu_cli.stats.compressed import Compressed
from mtu_cli.stats.least_squares import FloatArray

FEWEST_NESTED = 3
"""Cycles from which on one can be held out of fit and choice, and the choice still hold one out."""


def constant(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """No temperature: the mean reading at every position."""
    g, m = len(lib.groups), spec.degree + 1
    means = {}
    for position, item in rows.items():
        one = item.factor[:, 0]
        means[position] = float(one @ item.factor[:, -1]) / float(one @ one)
    return Fitted(
        coefficients=np.zeros((m, g)),
        unit_covariance=np.zeros((m * g, m * g)),
        intercepts=means,
        used=float(len(means)),
    )


def held_out(lib: Library, method: str) -> tuple[HeldOut | None, tuple[Candidate, ...]]:
    """Every cycle predicted by a model chosen and fitted on the others alone.

    Where there are many, blocks of them (see `Library.blocks`). None with fewer than three
    cycles, or without a sensor. The candidates' figures are of the best of their kind and degree
    on each fold's other cycles, so that they are held out as well; None for what was not tried in
    every fold, because other cycles are another measure.
    """
    if len(lib.blocks) < FEWEST_NESTED or not lib.groups:
        return None, ()
    before, after, least = 0.0, 0.0, 0.0
    by_cycle: list[CycleRms] = []
    tried: dict[tuple[str, int], list[float]] = {}
    n = 0
    for block in lib.blocks:
        others = other_blocks(lib.blocks, block)
        held, rows = lib.rows(block), lib.rows(cycles_of(others))
        best, candidates = choose(lib, others, method)
        for item in candidates:
            loss = sum_of_squares(lib, held, item.spec, fit(lib, rows, item.spec))
            tried.setdefault((item.kind, item.spec.degree), []).append(loss)
        full = ordinary(lib)
        least += sum_of_squares(lib, held, full, fit(lib, rows, full))
        without, own = constant(lib, rows, best.spec), fit(lib, rows, best.spec)
        for cycle in block:
            piece = lib.rows([cycle])
            count = sum(item.n for item in piece.values())
            losses = [sum_of_squares(lib, piece, best.spec, found) for found in (without, own)]
            by_cycle.append(CycleRms(lib.cycles[cycle], *(_root(x, count) for x in losses)))
            before, after, n = before + losses[0], after + losses[1], n + count
    found = HeldOut(
        before=_root(before, n),
        after=_root(after, n),
        ordinary=_root(least, n),
        r2=1 - after / before if before > 0 else float("nan"),
        cycles=tuple(by_cycle),
        blocks=len(lib.blocks),
    )
    return found, _candidates(tried, n, len(lib.blocks))


def _candidates(
    tried: dict[tuple[str, int], list[float]], n: int, folds: int
) -> tuple[Candidate, ...]:
    """What was tried, with its figure where every fold tried it."""
    return tuple(
        Candidate(
            model=kind,
            degree=degree,
            held_out=_root(sum(losses), n) if len(losses) == folds else None,
        )
        for (kind, degree), losses in tried.items()
    )


def _root(total: float, n: int) -> float:
    return float(np.sqrt(total / n))


def position_test(lib: Library, spec: Spec, rows: Rows) -> PositionTest | None:
    """F of the drift's dependence on position: all powers against none, all groups of sensors.

    With the effective number of residuals, as they follow each other; None with one position
    or where they are too few.
    """
    if lib.most_degree == 0:
        return None
    full = Spec(kind="ridge", degree=lib.most_degree, lags=spec.lags)
    flat = Spec(kind="ridge", degree=0, lags=spec.lags)
    fits = [fit(lib, rows, item) for item in (flat, full)]
    losses = [
        sum_of_squares(lib, rows, item, found)
        for item, found in zip((flat, full), fits, strict=True)
    ]
    n = sum(item.n for item in rows.values())
    number = effective_number(n, autocorrelation(lib, rows, full, fits[1]))
    more, dof = fits[1].used - fits[0].used, number - fits[1].used
    if dof <= 0 or more <= 0 or losses[1] <= 0:
        return None
    F = (losses[0] - losses[1]) / more / (losses[1] / dof)
    return PositionTest(F=F, p=float(fdtrc(more, dof, max(F, 0.0))))


def autocorrelation(lib: Library, rows: Rows, spec: Spec, found: Fitted) -> float:
    """Lag-1 autocorrelation of the residuals, pooled over positions."""
    return following.autocorrelation(_residuals(lib, rows, spec, found))


def mean_products(lib: Library, rows: Rows, spec: Spec, found: Fitted) -> tuple[float, float]:
    """Mean e_i^2 and mean e_i e_(i+1) of the residuals of any cycles."""
    return following.mean_products(_residuals(lib, rows, spec, found))


def _residuals(
    lib: Library, rows: Rows, spec: Spec, found: Fitted
) -> Iterator[tuple[Compressed, FloatArray]]:
    """Rows and weights by position, whose products are the residuals."""
    for position, item in rows.items():
        yield item, weights(lib, spec, found, position)


def unseen_products(lib: Library, spec: Spec) -> tuple[float, float, float] | None:
    """Mean e_i^2 and e_i e_(i+1) of held-out residuals of one spec, and their mean x'C x.

    C is the unit covariance of the fold's fit, x a held-out row about the mean of the rows that
    it was fitted to. None with a single cycle.
    """
    square = product = leverage = 0.0
    count = 0
    for (held, found), fitted_to in zip(
        Folds(lib, lib.blocks).fits(spec), _others(lib), strict=False
    ):
        own, following = mean_products(lib, held, spec, found)
        n = sum(item.n for item in held.values())
        square, product, count = square + own * n, product + following * n, count + n
        leverage += _leverage(lib, held, fitted_to, spec, found)
    return (square / count, product / count, leverage / count) if count else None


def _others(lib: Library) -> list[Rows]:
    return [lib.rows(cycles_of(other_blocks(lib.blocks, block))) for block in lib.blocks]


def _leverage(lib: Library, held: Rows, fitted_to: Rows, spec: Spec, found: Fitted) -> float:
    own = lib.columns(spec.lags)[1:-1]
    total = 0.0
    for position, item in held.items():
        if position not in fitted_to:
            continue
        factor = fitted_to[position].factor
        mean = factor[:, 0] @ factor[:, own] / float(factor[:, 0] @ factor[:, 0])
        columns = item.factor[:, own] - item.factor[:, :1] * mean
        total += quadratic(columns, lib.powers(spec.degree)[position], found.unit_covariance)
    return total


def quadratic(columns: FloatArray, power: FloatArray, covariance: FloatArray) -> float:
    """Sum over rows u of (power x u)' covariance (power x u)."""
    g = columns.shape[1]
    C = covariance.reshape(len(power), g, len(power), g)
    inner = np.einsum("a,ajbk,b->jk", power, C, power)
    return float(np.einsum("rj,jk,rk->", columns, inner, columns))
