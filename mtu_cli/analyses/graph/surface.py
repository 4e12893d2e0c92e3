"""A formula for u over a grid of probing uncertainties, and whose fault its error is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.analyses.graph.simulate import LINEAR
from mtu_cli.stats.least_squares import FloatArray, least_squares
from mtu_cli.units import UM

EXACT = 1e-4
"""Relative error of a formula for the first-order u below which it needs no further term."""
LETTERS = "abcdef"


@dataclass(frozen=True, slots=True, kw_only=True)
class Formula:
    """u^2 as a sum of terms, fitted to g grid points.

    `form` in um where the output is a length, with the `terms` of u^2. `u` (g,) in the unit of
    the output, `error_percent` (g,) = 100 (formula/Monte Carlo - 1). `monte_carlo_percent`:
    relative standard error of a Monte Carlo u (root mean square); `expected_max_percent`: the
    largest of g errors that these alone would make (with the formula true). `p`: of the observed
    sum of squared errors if the formula is true.
    """

    form: str
    terms: tuple[str, ...]
    scale: float
    coefficients: dict[str, float]
    u: FloatArray
    error_percent: FloatArray
    max_error_percent: float
    monte_carlo_percent: float
    expected_max_percent: float
    p: float

    def u_at(self, at: Mapping[str, FloatArray], n: int) -> FloatArray:
        """u (n,) in the unit of the output, also between the grid points; `at` (n,) by name."""
        X = _columns(self.terms, at, n)
        found: FloatArray = np.sqrt(np.maximum(X @ list(self.coefficients.values()), 0.0))
        return found / self.scale


def fit_formula(
    at: Mapping[str, FloatArray], u: FloatArray, se_u: FloatArray, linear_u: FloatArray, unit: str
) -> Formula | str:
    """u = sqrt(a probe_um^2 + b axis_um^2 + ...), the form of Stryczek, eq. (31).

    Least squares of u^2 with weights 1/u^4, that is, of relative errors. With a varied number of
    probings the probe's term is divided by it. A constant is added, and 1/repeats, where the
    first-order u cannot do without: for sources that are not varied. Where the first-order u is
    nil it tells nothing, and all terms enter.

    A text where there is no formula: why.
    """
    scale = 1.0 / UM if unit == "mm" else 1.0
    varied = {name: values for name, values in at.items() if np.ptp(values) > 0}
    if not varied:
        return "nothing varies"
    if not np.all(u > 0):
        return "u is 0 somewhere"
    n = len(u)
    terms = _chosen(varied, linear_u * scale, bool(np.all(linear_u >= LINEAR * u)))
    if n < len(terms):
        return f"{n} grid points are too few for its {len(terms)} terms, {_form(terms, unit)}"
    X, relative = _columns(terms, varied, n), se_u / u
    found, error = _fit(X, u * scale)
    return Formula(
        form=_form(terms, unit),
        terms=terms,
        scale=scale,
        coefficients=dict(zip(LETTERS, map(float, found), strict=False)),
        u=u * (1 + error),
        error_percent=100 * error,
        max_error_percent=100 * float(np.max(np.abs(error))),
        monte_carlo_percent=100 * float(np.sqrt(np.mean(relative**2))),
        expected_max_percent=100 * _expected_largest(X, u * scale, relative),
        p=_p(error, relative, X.shape[1]),
    )


def _chosen(varied: Mapping[str, FloatArray], linear_u: FloatArray, known: bool) -> tuple[str, ...]:
    """The fewest terms of u^2 that the first-order u needs; all where that is not `known`."""
    candidates = _candidates(varied)
    if not known:
        return candidates[-1]
    for terms in candidates:
        # As many terms as points always fit, and would prove nothing of fewer.
        if len(terms) > len(linear_u):
            break
        if np.abs(_fit(_columns(terms, varied, len(linear_u)), linear_u)[1]).max() < EXACT:
            break
    return terms


def _candidates(varied: Mapping[str, FloatArray]) -> list[tuple[str, ...]]:
    """Terms of u^2, fewest first; "" is the constant."""
    repeated = "repeats" in varied
    terms = [
        f"{name}^2" + ("/repeats" if repeated and name == "probe_um" else "")
        for name in ("probe_um", "axis_um", "perpendicular_um")
        if name in varied
    ]
    if repeated and "probe_um" not in varied:
        terms.append("1/repeats")
    found = [tuple(terms), (*terms, "")]
    if repeated and "1/repeats" not in terms:
        found.append((*terms, "1/repeats", ""))
    return found


def _columns(terms: Sequence[str], at: Mapping[str, FloatArray], n: int) -> FloatArray:
    """The terms (n, p) at n settings."""
    found = np.ones((n, len(terms)))
    for column, term in zip(found.T, terms, strict=True):
        name, _, divisor = term.partition("/")
        if name.endswith("^2"):
            column *= at[name.removesuffix("^2")] ** 2
        if divisor:
            column /= at[divisor]
    return found


def _fit(X: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients (p,) of the terms, and the relative errors (n,) of their root."""
    weight = 1.0 / u**2
    found = least_squares(X * weight[:, None], np.ones(len(u))).coefficients
    return found, np.sqrt(np.maximum(X @ found, 0.0)) / u - 1.0


def _form(terms: Sequence[str], unit: str) -> str:
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
