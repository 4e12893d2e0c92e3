"""Thermal models of one component, fitted to the compressed rows of some cycles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.thermal_fit.columns import Library, Rows, Selection
from mtu_cli.stats.compressed import Compressed
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.stats.ridge import RidgePath, ridge
from mtu_cli.stats.stepwise import stepwise

PENALTIES = np.concatenate([[0.0], 10.0 ** np.arange(-8.0, 0.6, 0.5)])
"""Ridge penalties that are tried; 0 is ordinary least squares."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """A model to be fitted: `kind` stepwise or ridge (lagged where `lags` are not all 0)."""

    kind: str
    degree: int
    lags: tuple[int, ...]
    penalty: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """Coefficients (m, g) in powers of the scaled position, and their unit covariance (m*g, m*g),
    that of errors of variance 1 which are independent. `intercepts` by position index;
    `used` number of fitted quantities.
    """

    coefficients: FloatArray
    unit_covariance: FloatArray
    intercepts: dict[int, float]
    used: float


def fit(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """The fit of a spec to some rows."""
    if spec.kind == "stepwise":
        return _fit_stepwise(lib, rows, spec)
    path = ridge_path(lib, rows, spec, np.array([spec.penalty]))
    return Fitted(
        coefficients=path.coefficients[0].reshape(spec.degree + 1, -1),
        unit_covariance=path.unit_covariance(0),
        intercepts=dict(zip(rows, path.intercepts[0].tolist(), strict=True)),
        used=float(path.effective[0]) + len(rows),
    )


def ridge_path(lib: Library, rows: Rows, spec: Spec, penalties: FloatArray) -> RidgePath:
    """Ridge fits with an intercept a position, for every penalty."""
    chosen = lib.columns(spec.lags)
    P = lib.powers(spec.degree)
    free, X, y, places = [], [], [], list(rows)
    for i, position in enumerate(places):
        factor = rows[position].factor[:, chosen]
        ones = np.zeros((len(factor), len(places)))
        ones[:, i] = factor[:, 0]
        free.append(ones)
        X.append((P[position][None, :, None] * factor[:, None, 1:-1]).reshape(len(factor), -1))
        y.append(factor[:, -1])
    n = sum(item.n for item in rows.values())
    return ridge(np.vstack(free), np.vstack(X), np.concatenate(y), n, penalties)


def path_losses(
    lib: Library, fitted_to: Rows, held: Rows, spec: Spec, path: RidgePath
) -> FloatArray:
    """Residual sums of squares (l,) over held-out rows, for every penalty of a path."""
    chosen = lib.columns(spec.lags)
    places = list(fitted_to)
    B = path.coefficients.reshape(len(path.coefficients), spec.degree + 1, -1)
    total = np.zeros(len(B))
    for position, item in held.items():
        factor = item.factor[:, chosen]
        a = path.intercepts.mean(axis=1)
        if position in fitted_to:
            a = path.intercepts[:, places.index(position)]
        gradient = np.einsum("m,lmg->gl", lib.powers(spec.degree)[position], B)
        left = factor[:, -1:] - factor[:, :1] * a - factor[:, 1:-1] @ gradient
        total += np.einsum("rl,rl->l", left, left)
    return total


def _fit_stepwise(lib: Library, rows: Rows, spec: Spec) -> Fitted:
    """The paper's way: sensors selected at each position, then a polynomial through positions.

    Valdes et al., eqs. (5)-(8) and (13). The intercepts follow from the final coefficients, so
    that a polynomial of fewer powers than positions is not charged with the means.
    """
    chosen = lib.columns(spec.lags)
    g, m = len(lib.groups), spec.degree + 1
    places = list(rows)
    V = lib.powers(spec.degree)[places]
    W = through_places(V)
    gradients = np.zeros((len(places), g))
    unit = np.zeros((m, g, m, g))
    used = float(len(places))
    for i, position in enumerate(places):
        selected, found = _selected(lib, rows, position, chosen)
        gradients[i, selected] = found.coefficients[1:]
        covariance = np.zeros((g, g))
        covariance[np.ix_(selected, selected)] = found.unscaled_covariance[1:, 1:]
        unit += np.einsum("a,b,jk->ajbk", W[:, i], W[:, i], covariance)
        used += len(selected) * m / len(places)
    coefficients = W @ gradients
    return Fitted(
        coefficients=coefficients,
        unit_covariance=unit.reshape(m * g, m * g),
        intercepts={
            position: _intercept(rows[position].factor[:, chosen], V[i] @ coefficients)
            for i, position in enumerate(places)
        },
        used=used,
    )


def through_places(V: FloatArray) -> FloatArray:
    """W (m, p) such that W y are the m powers of the least-squares polynomial through values y
    at p places, V (p, m) their powers.
    """
    return np.column_stack([least_squares(V, unit).coefficients for unit in np.eye(len(V))])


def _selected(lib: Library, rows: Rows, position: int, chosen: list[int]) -> Selection:
    """Groups of sensors that stepwise selection takes at one position, and their fit."""
    key = (position, rows.cycles, tuple(chosen))
    if key not in lib.selections:
        lib.selections[key] = _selection(rows[position], chosen)
    return lib.selections[key]


def _selection(rows: Compressed, chosen: list[int]) -> Selection:
    own = Compressed(
        factor=rows.factor[:, chosen],
        n=rows.n,
        lag=rows.lag[np.ix_(chosen, chosen)],
        pairs=rows.pairs,
    )
    columns = [0, *stepwise(own)]
    found = least_squares(own.factor[:, columns], own.factor[:, -1])
    return [column - 1 for column in columns[1:]], found


def _intercept(factor: FloatArray, gradient: FloatArray) -> float:
    """The mean reading less what the sensors explain of it."""
    left = factor[:, -1] - factor[:, 1:-1] @ gradient
    one = factor[:, 0]
    return float(one @ left) / float(one @ one)


def weights(lib: Library, spec: Spec, found: Fitted, position: int) -> FloatArray:
    """w (k,) such that Z w are the residuals at a position, Z the library's columns.

    A position that the fit has not seen takes the mean intercept of those that it has.
    """
    chosen = lib.columns(spec.lags)
    w = np.zeros(chosen[-1] + 1)
    own = found.intercepts.get(position)
    w[0] = -(float(np.mean(list(found.intercepts.values()))) if own is None else own)
    w[chosen[1:-1]] = -(lib.powers(spec.degree)[position] @ found.coefficients)
    w[-1] = 1.0
    return w


def sum_of_squares(lib: Library, rows: Rows, spec: Spec, found: Fitted) -> float:
    """Residual sum of squares over rows of any cycles."""
    total = 0.0
    for position, item in rows.items():
        total += float(np.sum((item.factor @ weights(lib, spec, found, position)) ** 2))
    return total
