"""Regression at several places, with slopes that are a polynomial of the place: ridge regression,
or stepwise selection at each place; and which columns, degree and penalty, by cycles that took no
part. Reported held-out errors are nested: no cycle judges a choice that it took part in.

    y = level_p + sum_j b_j(x_p) u_j + e,    b_j(x) = sum_k b_jk x^k,

at the places x_p, of regressors u_j that may each stand in several variants, such as lags. Rows of
one cycle follow each other; cycles are independent, and held out whole. All fits are to compressed
rows of any cycles (`stats.least_squares`), so that their number costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from mtu_cli.stats.least_squares import (
    Compressed,
    FloatArray,
    IntArray,
    LeastSquares,
    autocorrelation,
    effective_number,
    least_squares,
    mean_products,
    polynomial,
    ridge,
    stepwise,
    together,
)

MOST_BLOCKS = 12
"""Cycles up to which each is held out alone; more are held out in this many blocks, because each
block's model is chosen by holding out the others in turn: the square of their number of fits.
"""
ROUNDING = 1e-12
"""Share of a sum's terms, or of the response, that is rounding."""
PENALTIES = np.concatenate([[0.0], 10.0 ** np.arange(-8.0, 0.6, 0.5)])
"""Ridge penalties that are tried; 0 is ordinary least squares."""
WORTH = 0.02
"""A further power of the place must lower the held-out sum of squares by this share."""
NEGLIGIBLE = 1e-20
"""Share of the response's squares below which held-out sums are rounding, and all alike."""
FEWEST_NESTED = 3
"""Cycles from which on one can be held out of fit and choice, and the choice still hold one out."""

Pieces = dict[tuple[int, int], Compressed]
"""Compressed rows by (place, cycle)."""
Blocks = Sequence[tuple[int, ...]]
"""Cycles by index, those together that are held out together."""


class Panel:
    """The rows by place and cycle, by index: columns 1, g `regressors` in one variant after the
    other, response. `x` (places,) is the places' coordinate, best from -1 to 1. Rows and stepwise
    choices of some cycles are made once.
    """

    def __init__(self, pieces: Pieces, x: FloatArray, regressors: int) -> None:
        self.pieces, self.x, self.regressors = pieces, x, regressors
        self.cycles = range(1 + max(cycle for _, cycle in pieces))
        self._rows: dict[frozenset[int], dict[int, Compressed]] = {}
        self.selections: dict[tuple[frozenset[int], int], tuple[IntArray, LeastSquares]] = {}

    def freed(self) -> Panel:
        """With all columns counted from their means in each piece: these then have levels of their
        own (Frisch-Waugh), in fits and in held-out cycles alike.
        """
        pieces = {key: piece.about_mean() for key, piece in self.pieces.items()}
        return Panel(pieces, self.x, self.regressors)

    @property
    def most_degree(self) -> int:
        """The highest degree that the places determine."""
        return len(self.x) - 1

    @cached_property
    def blocks(self) -> tuple[tuple[int, ...], ...]:
        """Cycles that are held out together: each alone, or blocks of those that follow each
        other, as near to one size as can be.
        """
        many = min(len(self.cycles), MOST_BLOCKS)
        ends = [block * len(self.cycles) // many for block in range(many + 1)]
        return tuple(tuple(range(low, high)) for low, high in pairwise(ends))

    def rows(self, cycles: Iterable[int]) -> dict[int, Compressed]:
        """All rows of some cycles, by place."""
        key = frozenset(cycles)
        if key not in self._rows:
            pieces: dict[int, list[Compressed]] = {}
            for place, cycle in sorted(self.pieces):
                if cycle in key:
                    pieces.setdefault(place, []).append(self.pieces[place, cycle])
            self._rows[key] = {place: together(items) for place, items in pieces.items()}
        return self._rows[key]

    def columns(self, variants: Sequence[int]) -> list[int]:
        """Constant, every regressor in its one of the `variants` (g,), response."""
        g = self.regressors
        return [0, *(1 + variant * g + j for j, variant in enumerate(variants)), -1]


class Spec(NamedTuple):
    """A model to be fitted: `kind` stepwise, or any other, which are ridge regressions; `variants`
    of the regressors; `score` is its held-out sum of squares.
    """

    kind: str
    degree: int
    variants: tuple[int, ...]
    penalty: float = 0.0
    score: float = np.nan


class Fitted:
    """The fit of a spec to some cycles; a coefficient that is nothing but rounding is 0. With
    `penalties` a fit for each of these (stepwise: one), to predict by.

    `coefficients` (..., m, g) in powers of x; `weights` (..., places, 2 + g) such that Z w are the
    residuals at a place, Z the `columns` of its rows. `unit_covariance` (m*g, m*g) is that of the
    first fit for independent errors of variance 1, `parameters` its number of fitted quantities.
    """

    def __init__(
        self, panel: Panel, cycles: Iterable[int], spec: Spec, penalties: FloatArray | None = None
    ) -> None:
        self.panel, self.spec = panel, spec
        self.columns = columns = panel.columns(spec.variants)
        rows = panel.rows(cycles)
        powers = polynomial(panel.x, spec.degree)
        levels = sum(item.levels for item in rows.values())
        if spec.kind == "stepwise":
            b, self.unit_covariance, count = _stepwise(panel, cycles, powers)
        else:
            inner = [(powers[p], item.inner(columns[1:])) for p, item in rows.items()]
            X = np.vstack([np.kron(power, block[:, :-1]) for power, block in inner])
            y = np.concatenate([block[:, -1] for _, block in inner])
            n = sum(item.n for item in rows.values())
            path = ridge(X, y, n, np.array([spec.penalty]) if penalties is None else penalties)
            b, count = path.coefficients, float(path.effective[0])
            size = ROUNDING * np.linalg.norm(
                np.concatenate([x.factor[:, -1] for x in rows.values()])
            )
            b = np.where(np.abs(b) * np.linalg.norm(X, axis=0) > size, b, 0.0)
            b = b[0] if penalties is None else b
            self.unit_covariance = path.unit_covariance
        self.parameters = count + levels
        self.coefficients = b.reshape(*b.shape[:-1], spec.degree + 1, panel.regressors)
        G, places = _sums(powers, self.coefficients), [*rows]
        mean = np.array([item.mean(columns[1:]) for item in rows.values()])
        at_places = mean[:, -1] - np.sum(G[..., places, :] * mean[:, :-1], axis=-1)
        # A place that the fit has not seen takes the mean level of those that it has.
        level = np.repeat(at_places.mean(axis=-1, keepdims=True), len(powers), axis=-1)
        level[..., places] = at_places
        ones = np.ones((*level.shape, 1))
        self.weights = np.concatenate([-level[..., None], -G, ones], axis=-1)

    @property
    def used(self) -> IntArray:
        """Regressors that the model uses."""
        return np.flatnonzero((self.coefficients != 0).any(axis=0))

    @property
    def slopes(self) -> FloatArray:
        """Of every regressor at every place (..., places, g)."""
        return -self.weights[..., 1:-1]

    def sum_of_squares(self, cycles: Iterable[int]) -> FloatArray:
        """Of the residuals (...) of any cycles."""
        total = np.zeros(self.weights.shape[:-2])
        for place, item in self.panel.rows(cycles).items():
            residuals = item.factor[:, self.columns] @ self.weights[..., place, :].T
            total = total + np.sum(residuals**2, axis=0)
        return total

    def mean_products(self, cycles: Iterable[int]) -> tuple[float, float]:
        """Mean e_i^2 and mean e_i e_(i+1) of the residuals of any cycles."""
        rows = self.panel.rows(cycles).items()
        return mean_products((item.only(self.columns), self.weights[p]) for p, item in rows)

    def shares(self, cycles: Iterable[int]) -> FloatArray:
        """Mean square (g,) of each regressor's part of what is modelled about its mean."""
        rows, total = self.panel.rows(cycles), np.zeros(self.panel.regressors)
        for place, item in rows.items():
            inner = item.inner(self.columns[1:-1])
            total += np.sum(inner**2, axis=0) * self.slopes[place] ** 2
        return total / sum(item.n for item in rows.values())


def _sums(A: FloatArray, B: FloatArray) -> FloatArray:
    """A B (..., p, g), A (p, m), B (..., m, g); terms that cancel leave 0 and no rounding."""
    terms = A[:, :, None] * B[..., None, :, :]
    result = terms.sum(axis=-2)
    valid = np.abs(result) > ROUNDING * np.abs(terms).sum(axis=-2)
    return np.where(valid, result, 0.0)


def _stepwise(
    panel: Panel, cycles: Iterable[int], powers: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Coefficients (m*g,) of regressors, in their first variant, selected at each place, then a
    polynomial through the places; their unit covariance, and their number.
    """
    rows, g, m = panel.rows(cycles), panel.regressors, powers.shape[1]
    # W y are the m powers of the least-squares polynomial through values y at the places.
    W = np.asarray(np.linalg.pinv(powers[[*rows]]), float)
    slopes, unit, count = np.zeros((len(rows), g)), np.zeros((m, g, m, g)), 0.0
    for i, (place, item) in enumerate(rows.items()):
        key = frozenset(cycles), place
        if key not in panel.selections:
            plain = item.only(panel.columns((0,) * g))
            columns = [0, *stepwise(replace(plain, n=max(item.n - item.levels + 1, 1)))]
            fit = least_squares(plain.factor[:, columns], plain.factor[:, -1])
            panel.selections[key] = np.array(columns[1:], int) - 1, fit
        selection, fitted = panel.selections[key]
        slopes[i, selection] = fitted.coefficients[1:]
        covariance = np.zeros((g, g))
        covariance[np.ix_(selection, selection)] = fitted.unscaled_covariance[1:, 1:]
        unit += np.einsum("a,b,jk->ajbk", W[:, i], W[:, i], covariance)
        count += len(selection) * m / len(rows)
    return _sums(W, slopes).reshape(-1), unit.reshape(m * g, m * g), count


def folds(blocks: Blocks) -> Iterator[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Each block, and the cycles of all others."""
    for block in blocks:
        yield block, tuple(cycle for other in blocks if other != block for cycle in other)


def best_penalty(panel: Panel, blocks: Blocks, spec: Spec) -> Spec:
    """The spec with the penalty that predicts each block best from the others."""
    penalties = np.zeros(1) if spec.kind == "stepwise" else PENALTIES
    total, squares = np.zeros(len(penalties)), 0.0
    for block, training in folds(blocks):
        total = total + Fitted(panel, training, spec, penalties).sum_of_squares(block)
        items = panel.rows(block).values()
        squares += sum(float(item.factor[:, -1] @ item.factor[:, -1]) for item in items)
    total = np.where(total > NEGLIGIBLE * squares, total, 0.0)
    i = int(np.argmin(total))
    return spec._replace(penalty=float(penalties[i]), score=float(total[i]))


def by_degree(panel: Panel, blocks: Blocks, kind: str, variants: tuple[int, ...]) -> list[Spec]:
    """The best penalty for every degree, with the same variants."""
    degrees = range(panel.most_degree + 1)
    return [best_penalty(panel, blocks, Spec(kind, degree, variants)) for degree in degrees]


def simplest(candidates: Sequence[Spec]) -> Spec:
    """The lowest degree that is as good as the best."""
    most = min(item.score for item in candidates) * (1 + WORTH)
    return min((x for x in candidates if x.score <= most), key=lambda item: item.degree)


class HeldOut(NamedTuple):
    """Root mean squares over rows of cycles that took no part in fit or choice: `before` by the
    levels alone, `after` with the model.
    """

    before: float
    after: float

    @property
    def r2(self) -> float:
        """1 - after^2/before^2; nan where the response does not differ."""
        return 1.0 - (self.after / self.before) ** 2 if self.before > 0 else float("nan")

    @property
    def reduction(self) -> float:
        """1 - after/before; nan where the response does not differ."""
        return 1.0 - self.after / self.before if self.before > 0 else float("nan")


def held_out(panel: Panel, choose: Callable[[Blocks], Spec]) -> HeldOut | None:
    """Every block predicted by a model that is chosen (`choose`) and fitted on the others alone;
    None with fewer than FEWEST_NESTED, or without a regressor.
    """
    if len(panel.blocks) < FEWEST_NESTED or not panel.regressors:
        return None
    # An infinite penalty leaves only the levels.
    still, losses = Spec("ridge", 0, (0,) * panel.regressors, np.inf), np.zeros(2)
    for block, training in folds(panel.blocks):
        rest = [other for other in panel.blocks if other != block]
        for i, spec in enumerate((still, choose(rest))):
            losses[i] += Fitted(panel, training, spec).sum_of_squares(block)
    n = sum(item.n for item in panel.pieces.values())
    return HeldOut(*np.sqrt(losses / n).tolist())


def held_out_products(panel: Panel, spec: Spec) -> tuple[float, float] | None:
    """Of held-out residuals the mean e_i e_(i+1), and the mean x'C x: C the unit covariance of the
    fold's fit, x a held-out row about the mean of the rows that it was fitted to. None with a
    single block of cycles.
    """
    if len(panel.blocks) < 2:
        return None
    powers, total, n = polynomial(panel.x, spec.degree), np.zeros(2), 0
    for block, training in folds(panel.blocks):
        fold = Fitted(panel, training, spec)
        rows, test_rows, columns = panel.rows(training), panel.rows(block), fold.columns[1:-1]
        count = sum(item.n for item in test_rows.values())
        total[0] += fold.mean_products(block)[1] * count
        n += count
        for place in test_rows.keys() & rows.keys():
            factor = test_rows[place].factor
            inner = factor[:, columns] - factor[:, :1] * rows[place].mean(columns)
            x = np.kron(powers[place], inner)
            total[1] += float(np.einsum("ri,ij,rj->", x, fold.unit_covariance, x))
    lag, leverage = (total / n).tolist()
    return lag, leverage


def levels_of_pieces(panel: Panel, sets: Iterable[list[int]]) -> tuple[float, float]:
    """What levels of all pieces explain of the residuals of one level a place: their share, and p
    of F, with the effective number of rows as n. Of several `sets` of columns that the response is
    regressed on, at each place by itself, that with the least share; (0, 1) where there is nothing
    to test.
    """
    places = panel.rows(panel.cycles).values(), panel.freed().rows(panel.cycles).values()
    n, pieces, tests = sum(rows.n for rows in places[0]), len(panel.pieces), []
    for columns in sets:
        rss_common = rss_freed = 0.0
        df1, rank, fits = pieces - len(places[0]), pieces, []
        for both in zip(*places, strict=True):
            common, freed = (least_squares(x.inner(columns), x.inner([-1])[:, 0]) for x in both)
            weights = np.zeros(both[1].factor.shape[1])
            weights[columns], weights[-1] = -freed.coefficients, 1.0
            fits.append((both[1], weights))
            rss_common, rss_freed = rss_common + common.rss, rss_freed + freed.rss
            df1, rank = df1 + freed.rank - common.rank, rank + freed.rank
        dof = effective_number(n, autocorrelation(fits)) - rank
        if df1 > 0 and dof > 0 and rss_freed > 0:
            F = max(rss_common - rss_freed, 0.0) / df1 / (rss_freed / dof)
            tests.append((1 - rss_freed / rss_common, float(fdtrc(df1, dof, F))))
    return min(tests, default=(0.0, 1.0))
