"""Thermal models of one component: ridge regression with a polynomial in position, or the paper's
stepwise selection at each position (Valdes et al.); and which model, of what degree and with what
penalty and lags, by cycles that took no part. The reported held-out errors are nested: no cycle
judges a choice that it took part in.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.thermal_fit.design import Design
from mtu_cli.stats.least_squares import FloatArray, least_squares, mean_products, ridge, stepwise

ROUNDING = 1e-12
"""Share of a sum's terms, or of the readings, that is rounding."""


class Spec(NamedTuple):
    """A model to be fitted: `kind` stepwise, ridge, or lagged, a ridge with `lags` that were
    searched; `score` is its held-out sum of squares.
    """

    kind: str
    degree: int
    lags: tuple[int, ...]
    penalty: float = 0.0
    score: float = np.nan


class Fitted:
    """The fit of a spec to some cycles; a coefficient that is nothing but rounding is 0. With
    `penalties` a fit for each of these (stepwise: one), to predict by.

    `coefficients` (..., m, g) in powers of the scaled position; `weights` (..., positions, 2 + g)
    such that Z w are the residuals at a position, Z the `columns` of the design. `unit_covariance`
    (m*g, m*g) is that of the first fit for independent errors of variance 1, `parameters` its
    number of fitted quantities.
    """

    def __init__(
        self, design: Design, cycles: Iterable[int], spec: Spec, penalties: FloatArray | None = None
    ) -> None:
        self.design, self.spec = design, spec
        self.columns = columns = design.columns(spec.lags)
        rows = design.rows(cycles)
        powers = design.powers(spec.degree)
        levels = sum(item.levels for item in rows.values())
        if spec.kind == "stepwise":
            b, self.unit_covariance, count = _stepwise(design, cycles, powers)
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
            self.unit_covariance = path.unit_covariance(0)
        self.parameters = count + levels
        self.coefficients = b.reshape(*b.shape[:-1], spec.degree + 1, len(design.groups))
        G, places = _sums(powers, self.coefficients), [*rows]
        mean = np.array([item.mean(columns[1:]) for item in rows.values()])
        at_places = mean[:, -1] - np.sum(G[..., places, :] * mean[:, :-1], axis=-1)
        # A position that the fit has not seen takes the mean level of those that it has.
        level = np.repeat(at_places.mean(axis=-1, keepdims=True), len(powers), axis=-1)
        level[..., places] = at_places
        ones = np.ones((*level.shape, 1))
        self.weights = np.concatenate([-level[..., None], -G, ones], axis=-1)

    @property
    def used(self) -> np.ndarray:
        """Groups of sensors that the model uses."""
        return np.flatnonzero((self.coefficients != 0).any(axis=0))

    @property
    def gradients(self) -> FloatArray:
        """Of every group at every position (..., positions, g)."""
        return -self.weights[..., 1:-1]

    def sum_of_squares(self, cycles: Iterable[int]) -> FloatArray:
        """Of the residuals (...) of any cycles."""
        total = np.zeros(self.weights.shape[:-2])
        for position, item in self.design.rows(cycles).items():
            residuals = item.factor[:, self.columns] @ self.weights[..., position, :].T
            total = total + np.sum(residuals**2, axis=0)
        return total

    def mean_products(self, cycles: Iterable[int]) -> tuple[float, float]:
        """Mean e_i^2 and mean e_i e_(i+1) of the residuals of any cycles."""
        rows = self.design.rows(cycles).items()
        return mean_products((item.only(self.columns), self.weights[p]) for p, item in rows)

    def group_shares(self, cycles: Iterable[int]) -> FloatArray:
        """Mean square (g,) of each group's part of the modelled drift about its mean."""
        rows, total = self.design.rows(cycles), np.zeros(len(self.design.groups))
        for position, item in rows.items():
            inner = item.inner(self.columns[1:-1])
            total += np.sum(inner**2, axis=0) * self.gradients[position] ** 2
        return total / sum(item.n for item in rows.values())


def _sums(A: FloatArray, B: FloatArray) -> FloatArray:
    """A B (..., p, g), A (p, m), B (..., m, g); terms that cancel leave 0 and no rounding."""
    terms = A[:, :, None] * B[..., None, :, :]
    result = terms.sum(axis=-2)
    valid = np.abs(result) > ROUNDING * np.abs(terms).sum(axis=-2)
    return np.where(valid, result, 0.0)


def _stepwise(
    design: Design, cycles: Iterable[int], powers: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Coefficients (m*g,) of sensors selected at each position, then a polynomial through the
    positions (Valdes et al., eqs. (5)-(8) and (13)), their unit covariance, and their number.
    """
    rows, g, m = design.rows(cycles), len(design.groups), powers.shape[1]
    # W y are the m powers of the least-squares polynomial through values y at the places.
    W = np.asarray(np.linalg.pinv(powers[[*rows]]), float)
    gradients, unit, count = np.zeros((len(rows), g)), np.zeros((m, g, m, g)), 0.0
    for i, (position, item) in enumerate(rows.items()):
        key = frozenset(cycles), position
        if key not in design.selections:
            plain = item.only(design.columns((0,) * g))
            columns = [0, *stepwise(replace(plain, n=max(item.n - item.levels + 1, 1)))]
            fit = least_squares(plain.factor[:, columns], plain.factor[:, -1])
            design.selections[key] = np.array(columns[1:], int) - 1, fit
        selection, fitted = design.selections[key]
        gradients[i, selection] = fitted.coefficients[1:]
        covariance = np.zeros((g, g))
        covariance[np.ix_(selection, selection)] = fitted.unscaled_covariance[1:, 1:]
        unit += np.einsum("a,b,jk->ajbk", W[:, i], W[:, i], covariance)
        count += len(selection) * m / len(rows)
    return _sums(W, gradients).reshape(-1), unit.reshape(m * g, m * g), count


KINDS = ("stepwise", "ridge", "lagged")
PENALTIES = np.concatenate([[0.0], 10.0 ** np.arange(-8.0, 0.6, 0.5)])
"""Ridge penalties that are tried; 0 is ordinary least squares."""
WORTH = 0.02
"""A further power of the position must lower the held-out sum of squares by this share ..."""
LAG_WORTH = 0.1
"""... and a group's lag by this: the search tries many, and the best of many flatters itself."""
NEGLIGIBLE = 1e-20
"""Share of the readings' squares below which held-out sums are rounding, and all alike."""
SENSORS_SEARCHED = 8
"""Groups, largest share of the drift first, whose time constants are searched one by one."""
ALIKE = 1e-9
"""Share of a sum of squares by which two of the same model may differ."""
FEWEST_NESTED = 3
"""Cycles from which on one can be held out of fit and choice, and the choice still hold one out."""

Blocks = Sequence[tuple[int, ...]]
"""Cycles by index, those together that are held out together."""


class HeldOut(NamedTuple):
    """Root mean squares over readings of cycles that took no part in fit or choice: `before`
    without temperature, `after` with the model.
    """

    before: float
    after: float

    @property
    def r2(self) -> float:
        """1 - after^2/before^2; nan where the readings do not differ."""
        return 1.0 - (self.after / self.before) ** 2 if self.before > 0 else float("nan")

    @property
    def reduction(self) -> float:
        """1 - after/before; nan where the readings do not differ."""
        return 1.0 - self.after / self.before if self.before > 0 else float("nan")


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
    candidates = [
        x for kind in kinds if kind != "lagged" for x in _by_degree(design, blocks, kind, none)
    ]
    if "lagged" in kinds and len(design.time_constants) > 1:
        candidates += _lagged(design, blocks)
    candidates = candidates or _by_degree(design, blocks, "ridge", none)
    # Of models that are alike but for rounding the first.
    least = min(item.score for item in candidates) * (1 + ALIKE)
    best = next(item for item in candidates if item.score <= least)
    # The best with lags only where these are worth it.
    unlagged = [item for item in candidates if item.kind != "lagged"]
    simple = min(unlagged, key=lambda item: item.score, default=best)
    if best.score >= (1 - LAG_WORTH) * simple.score:
        best = simple
    return _simplest([item for item in candidates if item.kind == best.kind])


def _best(design: Design, blocks: Blocks, spec: Spec) -> Spec:
    """The spec with the penalty that predicts each block best from the others."""
    penalties = np.zeros(1) if spec.kind == "stepwise" else PENALTIES
    total, squares = np.zeros(len(penalties)), 0.0
    for block, training in folds(blocks):
        total = total + Fitted(design, training, spec, penalties).sum_of_squares(block)
        items = design.rows(block).values()
        squares += sum(float(item.factor[:, -1] @ item.factor[:, -1]) for item in items)
    total = np.where(total > NEGLIGIBLE * squares, total, 0.0)
    i = int(np.argmin(total))
    return spec._replace(penalty=float(penalties[i]), score=float(total[i]))


def _by_degree(design: Design, blocks: Blocks, kind: str, lags: tuple[int, ...]) -> list[Spec]:
    """The best penalty for every degree in position, with the same lags."""
    degrees = range(design.most_degree + 1)
    return [_best(design, blocks, Spec(kind, degree, lags)) for degree in degrees]


def _simplest(candidates: Sequence[Spec]) -> Spec:
    """The lowest degree that is as good as the best."""
    most = min(item.score for item in candidates) * (1 + WORTH)
    return min((x for x in candidates if x.score <= most), key=lambda item: item.degree)


def _lagged(design: Design, blocks: Blocks) -> list[Spec]:
    """The best lags at the degree of ridge and at that which a model with them prefers: without its
    lags a drift may hide how it depends on position.
    """
    none = (0,) * len(design.groups)
    degree = _simplest(_by_degree(design, blocks, "ridge", none)).degree
    first = _searched(design, blocks, degree)
    scores = _by_degree(design, blocks, "lagged", first.lags)
    scores[degree] = first
    degree = _simplest(scores).degree
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
        return _best(design, blocks, Spec("lagged", degree, lags))

    def changed(best: Spec, group: int, lag: int) -> Spec:
        return scored((*best.lags[:group], lag, *best.lags[group + 1 :]))

    common = [scored((c,) * groups) for c in constants]
    result = []
    # Sensors that warm together hide whose the lag is: single changes alone may get stuck.
    for start in dict.fromkeys((0, int(np.argmin([item.score for item in common])))):
        best = common[start]
        shares = Fitted(design, every, best).group_shares(every)
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


def held_out(design: Design, method: str) -> HeldOut | None:
    """Every cycle predicted by a model chosen and fitted on the others alone.

    Where there are many, blocks of them (see `Design.blocks`). None with fewer than three
    cycles, or without a sensor.
    """
    if len(design.blocks) < FEWEST_NESTED or not design.groups:
        return None
    # An infinite penalty leaves only the levels.
    still, losses = Spec("ridge", 0, (0,) * len(design.groups), np.inf), np.zeros(2)
    for block, training in folds(design.blocks):
        rest = [other for other in design.blocks if other != block]
        for i, spec in enumerate((still, choose(design, rest, method))):
            losses[i] += Fitted(design, training, spec).sum_of_squares(block)
    return HeldOut(*np.sqrt(losses / len(design.y)).tolist())
