"""Which model, of what degree and with what penalty and lags: by cycles that took no part.

The reported held-out errors are nested: no cycle judges a choice that it took part in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from mtu_cli.analyses.thermal_fit.models import (
    PENALTIES,
    Fitted,
    Library,
    Rows,
    Spec,
    constant,
    fit,
    path_losses,
    ridge_path,
)
from mtu_cli.stats.compressed import effective_number
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
FEWEST_NESTED = 3
"""Cycles from which on one can be held out of fit and choice, and the choice still hold one out."""


class CycleRms(NamedTuple):
    """Root mean squares over the readings of a held-out cycle, without and with the model."""

    cycle: str
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Root mean squares over readings of cycles that took no part in fit or choice.

    `before` without temperature, `after` with the model, `ordinary` with ordinary least
    squares on all sensors; `r2` = 1 - after^2/before^2. The `cycles` were held out in so
    many `blocks`.
    """

    before: float
    after: float
    ordinary: float
    r2: float
    cycles: tuple[CycleRms, ...]
    blocks: int

    @property
    def reduction(self) -> float:
        """1 - after/before; nan where the readings do not differ."""
        return 1.0 - self.after / self.before if self.before > 0 else float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A model that was tried: its held-out root mean square, None where it is undefined."""

    model: str
    degree: int
    held_out: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionTest:
    """Whether the drift depends on position: F and its p."""

    F: float
    p: float


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
                total += fit(self.lib, fitted_to, spec).sum_of_squares(held)
            else:
                path = ridge_path(self.lib, fitted_to, spec, penalties)
                total += path_losses(self.lib, fitted_to, held, spec, path)
        return total

    def fits(self, spec: Spec) -> Iterator[tuple[Rows, Rows, Fitted]]:
        """(the other rows, the held-out rows, the fit to the others) of every fold."""
        for fitted_to, held in self._rows:
            yield fitted_to, held, fit(self.lib, fitted_to, spec)


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
    best = _likeliest(tried)
    return _simplest([item for item in tried if item.kind == best.kind], folds), tuple(tried)


def _likeliest(tried: Sequence[Scored]) -> Scored:
    """The best of all kinds; the best with lags only where these are worth it."""
    best = min(tried, key=lambda item: item.score)
    without = [item for item in tried if item.kind != "lagged"]
    if not without:
        return best
    simple = min(without, key=lambda item: item.score)
    return best if best.score < (1 - LAG_WORTH) * simple.score else simple


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
    shares = fit(lib, rows, spec).group_shares(rows)
    order = np.argsort(-shares, kind="stable")
    return [int(j) for j in order[:SENSORS_SEARCHED]]


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
            loss = fit(lib, rows, item.spec).sum_of_squares(held)
            tried.setdefault((item.kind, item.spec.degree), []).append(loss)
        least += fit(lib, rows, ordinary(lib)).sum_of_squares(held)
        fits = constant(lib, rows, best.spec), fit(lib, rows, best.spec)
        for cycle in block:
            piece = lib.rows([cycle])
            count = sum(item.n for item in piece.values())
            losses = [fitted.sum_of_squares(piece) for fitted in fits]
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
    flat, full = (
        fit(lib, rows, Spec(kind="ridge", degree=degree, lags=spec.lags))
        for degree in (0, lib.most_degree)
    )
    without, loss = flat.sum_of_squares(rows), full.sum_of_squares(rows)
    number = effective_number(sum(item.n for item in rows.values()), full.autocorrelation(rows))
    more, dof = full.parameters - flat.parameters, number - full.parameters
    if dof <= 0 or more <= 0 or loss <= 0:
        return None
    F = (without - loss) / more / (loss / dof)
    return PositionTest(F=F, p=float(fdtrc(more, dof, max(F, 0.0))))


Unseen = tuple[float, float, float]
"""Of held-out residuals: see `unseen_products`."""


def unseen_products(lib: Library, spec: Spec) -> Unseen | None:
    """Mean e_i^2 and e_i e_(i+1) of held-out residuals of one spec, and their mean x'C x.

    C is the unit covariance of the fold's fit, x a held-out row about the mean of the rows that
    it was fitted to. None with a single cycle.
    """
    square = product = leverage = 0.0
    count = 0
    for fitted_to, held, fitted in Folds(lib, lib.blocks).fits(spec):
        squares, products = fitted.mean_products(held)
        n = sum(item.n for item in held.values())
        square, product, count = square + squares * n, product + products * n, count + n
        leverage += _leverage(held, fitted_to, fitted)
    return (square / count, product / count, leverage / count) if count else None


def _leverage(held: Rows, fitted_to: Rows, fitted: Fitted) -> float:
    """Sum over rows u of (power x u)' C (power x u)."""
    lib, spec = fitted.lib, fitted.spec
    own = lib.columns(spec.lags)[1:-1]
    total = 0.0
    for position, item in held.items():
        if position not in fitted_to:
            continue
        factor = fitted_to[position].factor
        mean = factor[:, 0] @ factor[:, own] / float(factor[:, 0] @ factor[:, 0])
        columns = item.factor[:, own] - item.factor[:, :1] * mean
        power, g = lib.powers(spec.degree)[position], columns.shape[1]
        C = fitted.unit_covariance.reshape(len(power), g, len(power), g)
        inner = np.einsum("a,ajbk,b->jk", power, C, power)
        total += float(np.einsum("rj,jk,rk->", columns, inner, columns))
    return total
