"""Which thermal model of one component: ridge regression with a polynomial in position, or the
paper's stepwise selection at each position (Valdes et al.); of what degree, with what penalty and
lags, by cycles that took no part (`stats.selection`).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from mtu_cli.analyses.thermal_fit.design import Design
from mtu_cli.stats.selection import Blocks, Fitted, Spec, best_penalty, by_degree, simplest

KINDS = ("stepwise", "ridge", "lagged")
"""The last is a ridge whose lags were searched, the `variants` of its spec."""
LAG_WORTH = 0.1
"""A group's lag must lower the held-out sum of squares by this share: the search tries many, and
the best of many flatters itself."""
SENSORS_SEARCHED = 8
"""Groups, largest share of the drift first, whose time constants are searched one by one."""
ALIKE = 1e-9
"""Share of a sum of squares by which two of the same model may differ."""


def choose(design: Design, blocks: Blocks, method: str) -> Spec:
    """The best spec of a method ("auto": of all kinds). Without a second block to hold out, all
    powers that the positions determine: of the paper's stepwise selection, or the kind asked for.
    """
    panel, none = design.panel, (0,) * len(design.groups)
    if len(blocks) < 2:
        kind = "stepwise" if method in ("auto", "stepwise") else "ridge"
        return Spec(kind, panel.most_degree, none)
    kinds = KINDS if method == "auto" else (method,)
    candidates = [
        x for kind in kinds if kind != "lagged" for x in by_degree(panel, blocks, kind, none)
    ]
    if "lagged" in kinds and len(design.time_constants) > 1:
        candidates += _lagged(design, blocks)
    candidates = candidates or by_degree(panel, blocks, "ridge", none)
    # Of models that are alike but for rounding the first.
    least = min(item.score for item in candidates) * (1 + ALIKE)
    best = next(item for item in candidates if item.score <= least)
    # The best with lags only where these are worth it.
    unlagged = [item for item in candidates if item.kind != "lagged"]
    simple = min(unlagged, key=lambda item: item.score, default=best)
    if best.score >= (1 - LAG_WORTH) * simple.score:
        best = simple
    return simplest([item for item in candidates if item.kind == best.kind])


def _lagged(design: Design, blocks: Blocks) -> list[Spec]:
    """The best lags at the degree of ridge and at that which a model with them prefers: without its
    lags a drift may hide how it depends on position.
    """
    none = (0,) * len(design.groups)
    degree = simplest(by_degree(design.panel, blocks, "ridge", none)).degree
    first = _searched(design, blocks, degree)
    scores = by_degree(design.panel, blocks, "lagged", first.variants)
    scores[degree] = first
    degree = simplest(scores).degree
    return [first] if degree == first.degree else [first, _searched(design, blocks, degree)]


def _searched(design: Design, blocks: Blocks, degree: int) -> Spec:
    """The best time constants at one degree: from none at all, and from one for all groups, one
    group's changed at a time, largest share of the drift first, where that is worth it. Once: more
    rounds fit the cycles that choose, not the next ones.
    """
    groups, constants = len(design.groups), range(len(design.time_constants))
    every = [cycle for block in blocks for cycle in block]

    @cache
    def scored(lags: tuple[int, ...]) -> Spec:
        return best_penalty(design.panel, blocks, Spec("lagged", degree, lags))

    def changed(best: Spec, group: int, lag: int) -> Spec:
        return scored((*best.variants[:group], lag, *best.variants[group + 1 :]))

    common = [scored((c,) * groups) for c in constants]
    result = []
    # Sensors that warm together hide whose the lag is: single changes alone may get stuck.
    for start in dict.fromkeys((0, int(np.argmin([item.score for item in common])))):
        best = common[start]
        shares = Fitted(design.panel, every, best).shares(every)
        for j in np.argsort(-shares, kind="stable")[:SENSORS_SEARCHED].tolist():
            for lag in constants:
                other = changed(best, j, lag)
                best = other if other.score < best.score * (1 - LAG_WORTH) else best
        # A lag of the start that gains nothing is removed.
        for j in range(groups):
            other = changed(best, j, 0)
            best = other if other.score <= best.score else best
        result.append(best)
    return min(result, key=lambda item: item.score)
