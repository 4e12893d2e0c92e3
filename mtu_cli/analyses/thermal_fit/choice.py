"""Which model, of what degree and with what penalty and lags: by cycles that took no part.

The reported held-out errors are nested: no cycle judges a choice that it took part in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from mtu_cli.analyses.thermal_fit.models import (
    Library,
    Rows,
    Spec,
    fit,
    levelled,
)
from mtu_cli.analyses.thermal_fit.result import HeldOut, PositionTest
from mtu_cli.stats.compressed import effective_number
from mtu_cli.stats.least_squares import FloatArray

KINDS = ("stepwise", "ridge", "lagged")
PENALTIES = np.concatenate([[0.0], 10.0 ** np.arange(-8.0, 0.6, 0.5)])
"""Ridge penalties that are tried; 0 is ordinary least squares."""
WORTH = 0.02
"""A further power of the position must lower the held-out sum of squares by this share ..."""
LAG_WORTH = 0.1
"""... and a lag of its own by this: the search tries many, and the best of many flatters itself."""
ROUNDING = 1e-20
"""Share of the readings' squares below which held-out sums are rounding, and all alike."""
SENSORS_SEARCHED = 8
"""Groups, largest share of the drift first, that get a time constant of their own."""
ALIKE = 1e-9
"""Share of a sum of squares by which two of the same model may differ."""
FEWEST_NESTED = 3
"""Cycles from which on one can be held out of fit and choice, and the choice still hold one out."""

Blocks = Sequence[tuple[int, ...]]
"""Cycles by index, those together that are held out together."""


class Scored(NamedTuple):
    """A spec of a kind and its held-out sum of squares (nan: one block)."""

    kind: str
    spec: Spec
    score: float


def _folds(lib: Library, blocks: Blocks) -> list[tuple[Rows, Rows]]:
    """The rows of each block, and those of all others; none with a single block."""
    if len(blocks) < 2:
        return []
    every = frozenset(cycle for block in blocks for cycle in block)
    return [(lib.rows(every - {*block}), lib.rows(block)) for block in blocks]


def _best(lib: Library, blocks: Blocks, kind: str, spec: Spec) -> Scored:
    """The spec with the penalty that predicts each block best from the others."""
    penalties = np.zeros(1) if kind == "stepwise" else PENALTIES
    total, squares = np.zeros(len(penalties)), 0.0
    for rows, held in _folds(lib, blocks):
        total = total + fit(lib, rows, spec, penalties).sum_of_squares(held)
        squares += sum(float(x.factor[:, -1] @ x.factor[:, -1]) for x in held.by_position.values())
    if len(blocks) < 2:
        return Scored(kind, spec, float("nan"))
    total = np.where(total > ROUNDING * squares, total, 0.0)
    i = int(np.argmin(total))
    return Scored(kind, replace(spec, penalty=float(penalties[i])), float(total[i]))


def choose(lib: Library, blocks: Blocks, method: str) -> Spec:
    """The best spec of a method ("auto": of all kinds); without a second block to hold out the
    paper's stepwise selection, or the kind asked for, of the degree that the caller settles.
    """
    tried: list[Scored] = []
    for kind in KINDS if method == "auto" else (method,):
        if kind != "lagged":
            tried += _by_degree(lib, blocks, kind)
        elif len(lib.time_constants) > 1 and len(blocks) > 1:
            tried += _lagged(lib, blocks)
    tried = tried or _by_degree(lib, blocks, "ridge")
    if len(blocks) < 2:
        return tried[0].spec
    # Of models that are alike but for rounding the first.
    least = min(item.score for item in tried) * (1 + ALIKE)
    best = next(item for item in tried if item.score <= least)
    # The best with lags only where these are worth it.
    without = [item for item in tried if item.kind != "lagged"]
    simple = min(without, key=lambda item: item.score, default=best)
    if best.score >= (1 - LAG_WORTH) * simple.score:
        best = simple
    return _simplest([item for item in tried if item.kind == best.kind]).spec


def _by_degree(
    lib: Library, blocks: Blocks, kind: str, lags: tuple[int, ...] | None = None
) -> list[Scored]:
    """The best penalty for every degree in position, with the same lags."""
    lags = lags or (0,) * len(lib.groups)
    name = "stepwise" if kind == "stepwise" else "ridge"
    specs = [Spec(kind=name, degree=degree, lags=lags) for degree in range(lib.most_degree + 1)]
    return [_best(lib, blocks, kind, spec) for spec in specs]


def _simplest(tried: Sequence[Scored]) -> Scored:
    """The lowest degree that is as good as the best."""
    most = min(item.score for item in tried) * (1 + WORTH)
    return min((x for x in tried if x.score <= most), key=lambda item: item.spec.degree)


def _lagged(lib: Library, blocks: Blocks) -> list[Scored]:
    """The best lags at the degree of ridge and at that which a model with them prefers: without its
    lags a drift may hide how it depends on position.
    """
    degree = _simplest(_by_degree(lib, blocks, "ridge")).spec.degree
    first = _searched(lib, blocks, degree)
    others = _by_degree(lib, blocks, "lagged", first.spec.lags)
    others[degree] = first
    degree = _simplest(others).spec.degree
    return [first] if degree == first.spec.degree else [first, _searched(lib, blocks, degree)]


def _searched(lib: Library, blocks: Blocks, degree: int) -> Scored:
    """The best time constants at one degree: from none at all, and from one for all groups."""

    @cache
    def scored(lags: tuple[int, ...]) -> Scored:
        return _best(lib, blocks, "lagged", Spec(kind="ridge", degree=degree, lags=lags))

    common = [scored((c,) * len(lib.groups)) for c in range(len(lib.time_constants))]
    # Sensors that warm together hide whose the lag is: single changes alone may get stuck.
    starts = dict.fromkeys((0, int(np.argmin([item.score for item in common]))))
    result = [_improved(lib, blocks, common[c], scored) for c in starts]
    return min(result, key=lambda item: item.score)


def _improved(
    lib: Library, blocks: Blocks, best: Scored, scored: Callable[[tuple[int, ...]], Scored]
) -> Scored:
    """One group's time constant changed at a time, largest share of the drift first, where that is
    worth it. Once: more rounds fit the cycles that choose, not the next ones.
    """

    def changed(group: int, lag: int) -> Scored:
        return scored((*best.spec.lags[:group], lag, *best.spec.lags[group + 1 :]))

    rows = lib.rows(cycle for block in blocks for cycle in block)
    order = np.argsort(-fit(lib, rows, best.spec).group_shares(rows), kind="stable")
    for j in order[:SENSORS_SEARCHED].tolist():
        for lag in range(len(lib.time_constants)):
            other = changed(j, lag)
            best = other if other.score < best.score * (1 - LAG_WORTH) else best
    # A lag that came with the start and gains nothing goes again.
    for j in range(len(best.spec.lags)):
        other = changed(j, 0)
        best = other if other.score <= best.score else best
    return best


def held_out(lib: Library, method: str) -> HeldOut | None:
    """Every cycle predicted by a model chosen and fitted on the others alone.

    Where there are many, blocks of them (see `Library.blocks`). None with fewer than three
    cycles, or without a sensor.
    """
    if len(lib.blocks) < FEWEST_NESTED or not lib.groups:
        return None
    least, n = 0.0, lib.all_rows.n
    by_cycle: list[tuple[str, float, float]] = []
    totals = np.zeros(2)
    ordinary = Spec(kind="ridge", degree=lib.most_degree, lags=(0,) * len(lib.groups))
    for block, (rows, held) in zip(lib.blocks, _folds(lib, lib.blocks), strict=True):
        best = choose(lib, [other for other in lib.blocks if other != block], method)
        least += float(fit(lib, rows, ordinary).sum_of_squares(held))
        still = levelled(lib, rows, best, np.zeros((best.degree + 1) * len(lib.groups)))
        both = still, fit(lib, rows, best)
        for cycle in block:
            own = lib.rows([cycle])
            losses = np.array([float(fitted.sum_of_squares(own)) for fitted in both])
            before, after = np.sqrt(losses / own.n).tolist()
            by_cycle.append((lib.series.cycles[cycle], before, after))
            totals += losses
    before, after = np.sqrt(totals / n).tolist()
    return HeldOut(
        before=before,
        after=after,
        ordinary=float(np.sqrt(least / n)),
        r2=1 - float(totals[1] / totals[0]) if before > 0 else float("nan"),
        cycles=tuple(by_cycle),
        blocks=len(lib.blocks),
    )


def position_test(lib: Library, spec: Spec) -> PositionTest | None:
    """F of the drift's dependence on position: all powers against none, all groups of sensors.

    With the effective number of residuals, as they follow each other; None with one position
    or where they are too few.
    """
    if lib.most_degree == 0:
        return None
    rows = lib.all_rows
    flat, full = (
        fit(lib, rows, Spec(kind="ridge", degree=degree, lags=spec.lags))
        for degree in (0, lib.most_degree)
    )
    without, loss = float(flat.sum_of_squares(rows)), float(full.sum_of_squares(rows))
    number = effective_number(rows.n, full.autocorrelation(rows))
    more, dof = full.parameters - flat.parameters, number - full.parameters
    if dof <= 0 or more <= 0 or loss <= 0:
        return None
    F = (without - loss) / more / (loss / dof)
    return PositionTest(F=F, p=float(fdtrc(more, dof, max(F, 0.0))))


class Unseen(NamedTuple):
    """Of held-out residuals mean e_i^2, e_i e_(i+1), and x'C x: C the unit covariance of the fold's
    fit, x a held-out row about the mean of the rows that it was fitted to.
    """

    square: float
    product: float
    leverage: float


def unseen(lib: Library, spec: Spec) -> Unseen | None:
    """Of one spec; None with a single block of cycles."""
    total, count = np.zeros(3), 0
    for rows, held in _folds(lib, lib.blocks):
        fitted = fit(lib, rows, spec)
        square, product = fitted.mean_products(held)
        total += square * held.n, product * held.n, 0.0
        columns = fitted.columns[1:-1]
        for position in held.by_position.keys() & rows.by_position.keys():
            factor, own = rows.by_position[position].factor, held.by_position[position].factor
            mean = factor[:, 0] @ factor[:, columns] / float(factor[:, 0] @ factor[:, 0])
            inner: FloatArray = own[:, columns] - own[:, :1] * mean
            x = np.kron(lib.powers(spec.degree)[position], inner)
            total[2] += float(np.einsum("ri,ij,rj->", x, fitted.unit_covariance, x))
        count += held.n
    return Unseen(*(total / count).tolist()) if count else None
