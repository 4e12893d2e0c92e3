"""Which model, of what degree and with what penalty and lags: by cycles that took no part.

The reported held-out errors are nested: no cycle judges a choice that it took part in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.thermal_fit.design import Design
from mtu_cli.analyses.thermal_fit.models import Fitted, Spec
from mtu_cli.analyses.thermal_fit.result import HeldOut

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
    """A spec of a kind and its held-out sum of squares."""

    kind: str
    spec: Spec
    score: float


def folds(blocks: Blocks) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Each block, and the cycles of all others."""
    for block in blocks:
        yield block, tuple(cycle for other in blocks if other != block for cycle in other)


def choose(design: Design, blocks: Blocks, method: str) -> Spec:
    """The best spec of a method ("auto": of all kinds). Without a second block to hold out, all
    powers that the positions determine: of the paper's stepwise selection, or the kind asked for.
    """
    none = (0,) * len(design.groups)
    if len(blocks) < 2:
        return Spec(
            "stepwise" if method in ("auto", "stepwise") else "ridge", design.most_degree, none
        )
    kinds = KINDS if method == "auto" else (method,)
    tried = [
        x for kind in kinds if kind != "lagged" for x in _by_degree(design, blocks, kind, none)
    ]
    if "lagged" in kinds and len(design.time_constants) > 1:
        tried += _lagged(design, blocks)
    tried = tried or _by_degree(design, blocks, "ridge", none)
    # Of models that are alike but for rounding the first.
    least = min(item.score for item in tried) * (1 + ALIKE)
    best = next(item for item in tried if item.score <= least)
    # The best with lags only where these are worth it.
    without = [item for item in tried if item.kind != "lagged"]
    simple = min(without, key=lambda item: item.score, default=best)
    if best.score >= (1 - LAG_WORTH) * simple.score:
        best = simple
    return _simplest([item for item in tried if item.kind == best.kind]).spec


def _best(design: Design, blocks: Blocks, kind: str, spec: Spec) -> Scored:
    """The spec with the penalty that predicts each block best from the others."""
    penalties = np.zeros(1) if kind == "stepwise" else PENALTIES
    total, squares = np.zeros(len(penalties)), 0.0
    for block, others in folds(blocks):
        total = total + Fitted(design, others, spec, penalties).sum_of_squares(block)
        own = design.rows(block).values()
        squares += sum(float(item.factor[:, -1] @ item.factor[:, -1]) for item in own)
    total = np.where(total > ROUNDING * squares, total, 0.0)
    i = int(np.argmin(total))
    return Scored(kind, spec._replace(penalty=float(penalties[i])), float(total[i]))


def _by_degree(design: Design, blocks: Blocks, kind: str, lags: tuple[int, ...]) -> list[Scored]:
    """The best penalty for every degree in position, with the same lags."""
    name = "stepwise" if kind == "stepwise" else "ridge"
    specs = [Spec(name, degree, lags) for degree in range(design.most_degree + 1)]
    return [_best(design, blocks, kind, spec) for spec in specs]


def _simplest(tried: Sequence[Scored]) -> Scored:
    """The lowest degree that is as good as the best."""
    most = min(item.score for item in tried) * (1 + WORTH)
    return min((x for x in tried if x.score <= most), key=lambda item: item.spec.degree)


def _lagged(design: Design, blocks: Blocks) -> list[Scored]:
    """The best lags at the degree of ridge and at that which a model with them prefers: without its
    lags a drift may hide how it depends on position.
    """
    none = (0,) * len(design.groups)
    degree = _simplest(_by_degree(design, blocks, "ridge", none)).spec.degree
    first = _searched(design, blocks, degree)
    others = _by_degree(design, blocks, "lagged", first.spec.lags)
    others[degree] = first
    degree = _simplest(others).spec.degree
    return [first] if degree == first.spec.degree else [first, _searched(design, blocks, degree)]


def _searched(design: Design, blocks: Blocks, degree: int) -> Scored:
    """The best time constants at one degree: from none at all, and from one for all groups, one
    group's changed at a time, largest share of the drift first, where that is worth it. Once: more
    rounds fit the cycles that choose, not the next ones.
    """
    groups, constants = len(design.groups), range(len(design.time_constants))
    every = [cycle for block in blocks for cycle in block]

    @cache
    def scored(lags: tuple[int, ...]) -> Scored:
        return _best(design, blocks, "lagged", Spec("ridge", degree, lags))

    def changed(best: Scored, group: int, lag: int) -> Scored:
        return scored((*best.spec.lags[:group], lag, *best.spec.lags[group + 1 :]))

    common = [scored((c,) * groups) for c in constants]
    result = []
    # Sensors that warm together hide whose the lag is: single changes alone may get stuck.
    for start in dict.fromkeys((0, int(np.argmin([item.score for item in common])))):
        best = common[start]
        shares = Fitted(design, every, best.spec).group_shares(every)
        for j in np.argsort(-shares, kind="stable")[:SENSORS_SEARCHED].tolist():
            for lag in constants:
                other = changed(best, j, lag)
                best = other if other.score < best.score * (1 - LAG_WORTH) else best
        # A lag that came with the start and gains nothing goes again.
        for j in range(groups):
            other = changed(best, j, 0)
            best = other if other.score <= best.score else best
        result.append(best)
    return min(result, key=lambda item: item.score)


def held_out(design: Design, method: str) -> HeldOut | None:
    """Every cycle predicted by a model chosen and fitted on the others alone.

    Where there are many, blocks of them (see `Design.blocks`). None with fewer than three
    cycles, or without a sensor.
    """
    if len(design.blocks) < FEWEST_NESTED or not design.groups:
        return None
    none, losses = (0,) * len(design.groups), np.zeros(3)
    for block, others in folds(design.blocks):
        rest = [other for other in design.blocks if other != block]
        # A penalty without end leaves the levels alone.
        still, ordinary = Spec("ridge", 0, none, np.inf), Spec("ridge", design.most_degree, none)
        for i, spec in enumerate((still, choose(design, rest, method), ordinary)):
            losses[i] += Fitted(design, others, spec).sum_of_squares(block)
    return HeldOut(*np.sqrt(losses / len(design.y)).tolist())
