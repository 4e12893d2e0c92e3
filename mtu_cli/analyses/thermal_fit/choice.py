"""Which model, of what degree and with what penalty and lags: by cycles that took no part."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library, Rows
from mtu_cli.analyses.thermal_fit.models import (
    PENALTIES,
    Fitted,
    Spec,
    fit,
    path_losses,
    ridge_path,
    sum_of_squares,
)
from mtu_cli.stats.least_squares import FloatArray

KINDS = ("stepwise", "ridge", "lagged")
WORTH = 0.02
"""A further power of the position must lower the held-out sum of squares by this share ..."""
LAG_WORTH = 0.1
"""... and a lag of its own by this: the search tries many, and the best of many flatters itself."""
ROUNDING = 1e-20
"""Share of the readings' squares below which held-out sums are rounding, and all alike."""
SENSORS_SEARCHED = 8
"""Groups, largest share of the drift first, that get a time constant of their own."""
MOST_DEGREES = 2
"""Degrees in position at which time constants are searched for."""
MOST_SWEEPS = 1
"""Rounds of the search for them; more of them fit the cycles that choose, not the next ones."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A spec and its held-out sum of squares over the cycles that chose it (nan: one block)."""

    kind: str
    spec: Spec
    score: float


Blocks = Sequence[tuple[int, ...]]
"""Cycles by index, those together that are held out together."""


def other_blocks(blocks: Blocks, held: tuple[int, ...]) -> Blocks:
    """All blocks but the one that is held out."""
    return [block for block in blocks if block != held]


def cycles_of(blocks: Blocks) -> list[int]:
    """The cycles of some blocks."""
    return [cycle for block in blocks for cycle in block]


class Folds:
    """Every one of some blocks of cycles held out in turn from the others."""

    def __init__(self, lib: Library, blocks: Blocks) -> None:
        self.lib = lib
        self.blocks = tuple(blocks)
        self._rows = [
            (lib.rows(cycles_of(other_blocks(blocks, block))), lib.rows(block))
            for block in (blocks if len(blocks) > 1 else ())
        ]

    @cached_property
    def rounding(self) -> float:
        """What of a held-out sum of squares is rounding."""
        squares = [
            float(np.sum(item.factor[:, -1] ** 2))
            for _, held in self._rows
            for item in held.values()
        ]
        return ROUNDING * sum(squares)

    def scores(self, spec: Spec, penalties: FloatArray) -> FloatArray:
        """Held-out sums of squares, one a penalty; nan with a single block."""
        if not self._rows:
            return np.full(len(penalties), np.nan)
        total = np.zeros(len(penalties))
        for fitted_to, held in self._rows:
            if spec.kind == "stepwise":
                total += sum_of_squares(self.lib, held, spec, fit(self.lib, fitted_to, spec))
            else:
                path = ridge_path(self.lib, fitted_to, spec, penalties)
                total += path_losses(self.lib, fitted_to, held, spec, path)
        return total

    def fits(self, spec: Spec) -> Iterator[tuple[Rows, Fitted]]:
        """(held-out rows, the fit to the others) of every fold."""
        for fitted_to, held in self._rows:
            yield held, fit(self.lib, fitted_to, spec)


def choose(lib: Library, blocks: Blocks, method: str) -> tuple[Scored, tuple[Scored, ...]]:
    """The best spec of a method ("auto": of all kinds), and all that were compared.

    Without a second block nothing can be held out: the paper's stepwise selection is taken (or
    the kind asked for, as ordinary least squares), of the degree that the caller settles.
    """
    folds = Folds(lib, blocks)
    kinds = KINDS if method == "auto" else (method,)
    tried: list[Scored] = []
    for kind in kinds:
        if kind == "lagged" and len(lib.time_constants) < 2:
            continue
        tried += _lagged(lib, folds) if kind == "lagged" else _by_degree(lib, folds, kind)
    if not tried:
        tried = _by_degree(lib, folds, "ridge")
    if len(blocks) < 2:
        return tried[0], tuple(tried)
    best = min(tried, key=lambda item: item.score)
    return _simplest([item for item in tried if item.kind == best.kind], folds), tuple(tried)


def lags_sought(lib: Library) -> bool:
    """Whether there are lags to choose from, and cycles to choose them by."""
    return bool(lib.groups) and len(lib.time_constants) > 1 and len(lib.blocks) > 1


def ordinary(lib: Library) -> Spec:
    """Ordinary least squares on all sensors, at every position apart."""
    return Spec(kind="ridge", degree=lib.most_degree, lags=(0,) * len(lib.groups))


def _by_degree(lib: Library, folds: Folds, kind: str) -> list[Scored]:
    """The best penalty for every degree in position (a stepwise model has none)."""
    penalties = PENALTIES if kind == "ridge" else np.zeros(1)
    found = []
    for degree in range(lib.most_degree + 1):
        spec = Spec(kind=kind, degree=degree, lags=(0,) * len(lib.groups))
        found.append(_best(kind, spec, folds.scores(spec, penalties), penalties))
    return found


def _best(kind: str, spec: Spec, scores: FloatArray, penalties: FloatArray) -> Scored:
    if np.isnan(scores).all():
        return Scored(kind=kind, spec=spec, score=float("nan"))
    i = int(np.argmin(scores))
    return Scored(
        kind=kind, spec=replace(spec, penalty=float(penalties[i])), score=float(scores[i])
    )


def _lagged(lib: Library, folds: Folds) -> list[Scored]:
    """Time constants by coordinate search, from none at all and from one for all groups.

    Without its lags a model may prefer another degree in position: the search begins with that
    of ridge and, where the lags that it finds prefer another, does so once more with that.
    """
    if len(folds.blocks) < 2:
        return []
    degree = _simplest(_by_degree(lib, folds, "ridge"), folds).spec.degree
    found: dict[int, Scored] = {}
    while degree not in found:
        found[degree] = _searched_at(lib, folds, degree)
        lags = found[degree].spec.lags
        others = [
            found[degree] if other == degree else _scored(folds, other, lags)
            for other in range(lib.most_degree + 1)
        ]
        degree = _simplest(others, folds).spec.degree
        if len(found) == MOST_DEGREES:
            break
    return list(found.values())


def _simplest(tried: Sequence[Scored], folds: Folds) -> Scored:
    """The lowest degree that is as good as the best."""
    least = min(item.score for item in tried)
    most = max(least * (1 + WORTH), folds.rounding)
    kept = [item for item in tried if item.score <= most]
    return min(kept, key=lambda item: item.spec.degree)


def _scored(folds: Folds, degree: int, lags: tuple[int, ...]) -> Scored:
    """The best penalty for some lags."""
    spec = Spec(kind="ridge", degree=degree, lags=lags)
    return _best("lagged", spec, folds.scores(spec, PENALTIES), PENALTIES)


def _searched_at(lib: Library, folds: Folds, degree: int) -> Scored:
    """The best lags that are found at one degree in position."""
    g = len(lib.groups)

    @cache
    def scored(lags: tuple[int, ...]) -> Scored:
        return _scored(folds, degree, lags)

    common = [scored((c,) * g) for c in range(len(lib.time_constants))]
    # Sensors that warm together hide whose the lag is: single changes alone may get stuck.
    starts = dict.fromkeys((0, int(np.argmin([item.score for item in common]))))
    found = [_searched(lib, folds, common[c], scored) for c in starts]
    return min(found, key=lambda item: item.score)


def _searched(
    lib: Library, folds: Folds, start: Scored, scored: Callable[[tuple[int, ...]], Scored]
) -> Scored:
    """One group's time constant changed at a time, where that is worth it, until none is."""
    best = start
    for _ in range(MOST_SWEEPS):
        before = best
        for j in _by_share(lib, folds, best.spec):
            for c in range(len(lib.time_constants)):
                other = _changed(best, j, c, scored)
                if other.score < best.score * (1 - LAG_WORTH):
                    best = other
        if best is before:
            break
    # A lag that came with the start and gains nothing goes again.
    for j in range(len(best.spec.lags)):
        other = _changed(best, j, 0, scored)
        best = other if other.score <= best.score else best
    return best


def _changed(
    best: Scored, group: int, lag: int, scored: Callable[[tuple[int, ...]], Scored]
) -> Scored:
    """The same with another time constant of one group."""
    lags = best.spec.lags
    return scored((*lags[:group], lag, *lags[group + 1 :]))


def _by_share(lib: Library, folds: Folds, spec: Spec) -> list[int]:
    """Groups by their share of the modelled drift, largest first."""
    rows = lib.rows(cycles_of(folds.blocks))
    found = fit(lib, rows, spec)
    shares = group_shares(lib, rows, spec, found)
    order = np.argsort(-shares, kind="stable")
    return [int(j) for j in order[:SENSORS_SEARCHED]]


def group_shares(lib: Library, rows: Rows, spec: Spec, found: Fitted) -> FloatArray:
    """Mean square (g,) of each group's part of the modelled drift about its mean."""
    own = lib.columns(spec.lags)[1:-1]
    total = np.zeros(len(own))
    for position, item in rows.items():
        one = item.factor[:, :1]
        columns = item.factor[:, own]
        centred = columns - one @ (one.T @ columns) / float(one[:, 0] @ one[:, 0])
        gradient = lib.powers(spec.degree)[position] @ found.coefficients
        total += np.sum(centred**2, axis=0) * gradient**2
    mean: FloatArray = total / sum(item.n for item in rows.values())
    return mean
