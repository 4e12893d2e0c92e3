"""A formula for u over a grid of probing uncertainties, and whose fault its error is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.units import UM

EXACT = 1e-4
"""Relative error of a formula for the first-order u below which it needs no further term."""
LETTERS = "abcdef"


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """u^2 as a sum of terms, fitted to g grid points.

    `form` in um where the output is a length. `u` (g,) in the unit of the output,
    `error_percent` (g,) = 100 (formula/Monte Carlo - 1). `monte_carlo_percent`: relative
    standard error of a Monte Carlo u (root mean square); `expected_max_percent`: the largest of
    g errors that these alone would make (with the formula true); `own_max_percent`: the largest
    error of the same formula for the first-order u, which has no random part, nan where that is 0.
    `p`: of the observed sum of squared errors if the formula is true.
    """

    form: str
    coefficients: dict[str, float]
    u: FloatArray
    error_percent: FloatArray
    max_error_percent: float
    monte_carlo_percent: float
    expected_max_percent: float
    own_max_percent: float
    p: float


def fit_formula(
    at: Mapping[str, FloatArray], u: FloatArray, se_u: FloatArray, linear_u: FloatArray, unit: str
) -> Formula | None:
    """u = sqrt(a probe_um^2 + b axis_um^2 + ...), the form of Stryczek, eq. (31).

    Least squares of u^2 with weights 1/u^4, that is, of relative errors. With a varied number of
    probings the probe's term is divided by it. A constant is added, and 1/repeats, where the
    first-order u cannot do without: for sources that are not varied.

    None where nothing is varied, u is 0 somewhere, or the grid is too small.
    """
    scale = 1.0 / UM if unit == "mm" else 1.0
    varied = {name: values for name, values in at.items() if np.ptp(values) > 0}
    if not varied or not np.all(u > 0):
        return None
    known = bool(np.all(linear_u > 0))
    for terms in _candidates(varied, len(u)):
        X = np.column_stack(list(terms.values()))
        own = _errors(X, _fit(X, linear_u * scale), linear_u * scale) if known else None
        if own is None or np.max(np.abs(own)) < EXACT:
            break
    if len(u) < X.shape[1]:
        return None
    found = _fit(X, u * scale)
    error = _errors(X, found, u * scale)
    relative = se_u / u
    own_max = math.nan if own is None else 100 * float(np.max(np.abs(own)))
    return Formula(
        form=_form(list(terms), unit),
        coefficients=dict(zip(LETTERS, map(float, found), strict=False)),
        u=u * (1 + error),
        error_percent=100 * error,
        max_error_percent=100 * float(np.max(np.abs(error))),
        monte_carlo_percent=100 * float(np.sqrt(np.mean(relative**2))),
        expected_max_percent=100 * _expected_largest(X, u * scale, relative),
        own_max_percent=own_max,
        p=_p(error, relative, X.shape[1]),
    )


def _candidates(varied: Mapping[str, FloatArray], n: int) -> list[dict[str, FloatArray]]:
    n_repeats = varied.get("repeats")
    repeats = np.ones(n) if n_repeats is None else n_repeats
    terms: dict[str, FloatArray] = {}
    for name in ("probe_um", "axis_um", "perpendicular_um"):
        if name in varied:
            shared = name == "probe_um" and n_repeats is not None
            label = f"{name}^2" + ("/repeats" if shared else "")
            terms[label] = varied[name] ** 2 / (repeats if shared else 1.0)
    if n_repeats is not None and "probe_um" not in varied:
        terms["1/repeats"] = 1.0 / repeats
    found = [terms, {**terms, "": np.ones(n)}]
    if n_repeats is not None and "1/repeats" not in terms:
        found.append({**terms, "1/repeats": 1.0 / repeats, "": np.ones(n)})
    return found


def _fit(X: FloatArray, u: FloatArray) -> FloatArray:
    weight = 1.0 / u**2
    return least_squares(X * weight[:, None], np.ones(len(u))).coefficients


def _errors(X: FloatArray, coefficients: FloatArray, u: FloatArray) -> FloatArray:
    found: FloatArray = np.sqrt(np.maximum(X @ coefficients, 0.0)) / u - 1.0
    return found


def _form(terms: list[str], unit: str) -> str:
    left = {"mm": "u_um", "rad": "u_rad"}.get(unit, "u")
    parts = []
    for letter, term in zip(LETTERS, terms, strict=False):
        joint = "" if not term else term.removeprefix("1") if term.startswith("1/") else f"*{term}"
        parts.append(letter + joint)
    return f"{left} = sqrt({' + '.join(parts)})"


def _expected_largest(X: FloatArray, u: FloatArray, relative: FloatArray) -> float:
    """The median of the largest of n normal errors, each as large as the fit leaves it: the
    quantile at which all n lie within with probability 1/2.
    """
    from scipy.special import ndtri

    weighted = X / u[:, None] ** 2
    hat = np.einsum(
        "ij,jk,ik->i", weighted, least_squares(weighted, u).unscaled_covariance, weighted
    )
    left = relative * np.sqrt(np.clip(1.0 - hat, 0.0, 1.0))
    each = 0.5 ** (1.0 / len(u))
    return float(ndtri(0.5 + each / 2.0) * np.sqrt(np.mean(left**2)))


def _p(error: FloatArray, relative: FloatArray, terms: int) -> float:
    """P(chi^2 > sum (error/se)^2) with n - terms degrees of freedom."""
    from scipy.special import chdtrc

    dof = len(error) - terms
    if dof < 1 or not np.all(relative > 0):
        return math.nan
    return float(chdtrc(dof, np.sum((error / relative) ** 2)))
