"""Thermal models of one component and their fit: ridge regression with a polynomial in position,
or the paper's stepwise selection at each position (Valdes et al.).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mtu_cli.analyses.thermal_fit.design import Design
from mtu_cli.stats.compressed import mean_products, ridge, stepwise
from mtu_cli.stats.least_squares import FloatArray, least_squares

ROUNDING = 1e-12
"""Share of a sum's terms, or of the readings, that is rounding."""


class Spec(NamedTuple):
    """A model to be fitted: `kind` stepwise or ridge (lagged where `lags` are not all 0)."""

    kind: str
    degree: int
    lags: tuple[int, ...]
    penalty: float = 0.0


class Fitted:
    """The fit of a spec to some cycles; a coefficient that is nothing but rounding is 0. With
    `penalties` a fit for each of these (stepwise: one), to predict by.

    `coefficients` (..., m, g) in powers of the scaled position; `weights` (..., positions, 2 + g)
    such that Z w are the residuals at a position, Z the `columns` of the design. `unit_covariance`
    (m*g, m*g) is that of the first fit for independent errors of variance 1, `parameters` its
    number of fitted quantities.
    """

    def __init__(
        self,
        design: Design,
        cycles: Iterable[int],
        spec: Spec,
        penalties: FloatArray | None = None,
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
            X = np.vstack([np.kron(power, own[:, :-1]) for power, own in inner])
            y = np.concatenate([own[:, -1] for _, own in inner])
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
        G, seen = _sums(powers, self.coefficients), [*rows]
        mean = np.array([item.mean(columns[1:]) for item in rows.values()])
        of_seen = mean[:, -1] - np.sum(G[..., seen, :] * mean[:, :-1], axis=-1)
        # A position that the fit has not seen takes the mean level of those that it has.
        level = np.repeat(of_seen.mean(axis=-1, keepdims=True), len(powers), axis=-1)
        level[..., seen] = of_seen
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
            left = item.factor[:, self.columns] @ self.weights[..., position, :].T
            total = total + np.sum(left**2, axis=0)
        return total

    def mean_products(self, cycles: Iterable[int]) -> tuple[float, float]:
        """Mean e_i^2 and mean e_i e_(i+1) of the residuals of any cycles."""
        own = self.design.rows(cycles).items()
        return mean_products((item.only(self.columns), self.weights[p]) for p, item in own)

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
    known = np.abs(result) > ROUNDING * np.abs(terms).sum(axis=-2)
    return np.where(known, result, 0.0)


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
        if key not in design.selected:
            plain = item.only(design.columns((0,) * g))
            columns = [0, *stepwise(replace(plain, n=max(item.n - item.levels + 1, 1)))]
            found = least_squares(plain.factor[:, columns], plain.factor[:, -1])
            design.selected[key] = np.array(columns[1:], int) - 1, found
        chosen, fitted = design.selected[key]
        gradients[i, chosen] = fitted.coefficients[1:]
        covariance = np.zeros((g, g))
        covariance[np.ix_(chosen, chosen)] = fitted.unscaled_covariance[1:, 1:]
        unit += np.einsum("a,b,jk->ajbk", W[:, i], W[:, i], covariance)
        count += len(chosen) * m / len(rows)
    return _sums(W, gradients).reshape(-1), unit.reshape(m * g, m * g), count
