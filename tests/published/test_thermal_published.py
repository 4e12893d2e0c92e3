"""Printed figures for the statistics behind thermal models.

- Hald's cement data: Draper & Smith, Applied Regression Analysis, 3rd ed. 1998, ch. 15 and
  app. 15A. Stepwise selection at 0.15 and 0.15 ends with x1 and x2. At 0.05 to enter, x2 stays
  outside: its partial F is 5.03 with 1 and 9 degrees of freedom, p = 0.052.
- Ridge regression of Longley's data as printed by the example of MASS (Venables & Ripley,
  lm.ridge): the constants of Hoerl, Kennard & Baldwin and of Lawless & Wang, and the least
  generalised cross-validation on a grid of 0.0001.
- Longley's data: variance inflation factors and the condition number 43275 of its unit columns
  (Belsley, Kuh & Welsch 1980), certified coefficients (NIST StRD).
- D'Agostino, Belanger & D'Agostino 1990, The American Statistician 44, 316-321: cholesterol of
  62 patients, sqrt(b1) = 1.02 and b2 = 4.58, K^2 = 14.75, p = 0.0006.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve
from scipy.special import ndtri
from scipy.stats import kurtosis, skew
from test_strd_linear import LONGLEY, REFERENCES, agreeing_digits

from mtu_cli.stats.least_squares import (
    FloatArray,
    autocorrelation,
    compress,
    least_squares,
    ridge,
    stepwise,
    together,
)
from mtu_cli.stats.serial import (
    condition_number,
    normality_p,
    variance_inflation,
)

HALD = np.array(
    [
        [7, 26, 6, 60, 78.5], [1, 29, 15, 52, 74.3], [11, 56, 8, 20, 104.3],
        [11, 31, 8, 47, 87.6], [7, 52, 6, 33, 95.9], [11, 55, 9, 22, 109.2],
        [3, 71, 17, 6, 102.7], [1, 31, 22, 44, 72.5], [2, 54, 18, 22, 93.1],
        [21, 47, 4, 26, 115.9], [1, 40, 23, 34, 83.8], [11, 66, 9, 12, 113.3],
        [10, 68, 8, 12, 109.4],
    ]
)  # fmt: skip
HALD_ROWS = compress(np.column_stack([np.ones(13), HALD]))
HALD_ROWS = replace(HALD_ROWS, lag=np.zeros_like(HALD_ROWS.lag))


def hald_rss(*chosen: int) -> float:
    return least_squares(np.column_stack([np.ones(13), HALD[:, [j - 1 for j in chosen]]]),
                         HALD[:, 4]).rss  # fmt: skip


@pytest.mark.parametrize(
    ("chosen", "printed"),
    [((4,), 883.87), ((1, 4), 74.76), ((1, 2, 4), 47.97), ((1, 2), 57.90), ((1, 2, 3, 4), 47.86)],
)
def test_hald_residual_sums_of_squares(chosen: tuple[int, ...], printed: float) -> None:
    assert hald_rss(*chosen) == pytest.approx(printed, abs=0.0051)


@pytest.mark.parametrize(
    ("enter", "remove", "chosen"),
    [
        # The book's choice.
        (0.15, 0.15, (1, 2)),
        (0.05, 0.10, (1, 4)),
        # Around the printed F: 22.80 of x4 (p = 0.0006), 108.22 of x1, 5.03 of x2 (p = 0.052)
        # and 1.86 of x4 beside x1 and x2 (p = 0.206).
        (0.0005, 0.10, ()),
        (0.0007, 0.10, (1, 4)),
        (0.0510, 0.10, (1, 4)),
        (0.0525, 0.10, (1, 2)),
        (0.0525, 0.20, (1, 2)),
        (0.0525, 0.21, (1, 2, 4)),
    ],
)
def test_hald_stepwise(enter: float, remove: float, chosen: tuple[int, ...]) -> None:
    assert stepwise(HALD_ROWS, enter, remove) == chosen


def test_hald_variance_inflation() -> None:
    centred = HALD[:, :4] - HALD[:, :4].mean(axis=0)
    printed = [38.50, 254.42, 46.87, 282.51]
    assert variance_inflation(centred) == pytest.approx(printed, abs=0.0051)


def test_longley_variance_inflation_and_condition_number() -> None:
    X = LONGLEY[:, 1:] - LONGLEY[:, 1:].mean(axis=0)
    printed = [135.53, 1788.51, 33.62, 3.59, 399.15, 758.98]
    assert variance_inflation(X) == pytest.approx(printed, abs=0.0051)
    assert condition_number(LONGLEY) == pytest.approx(43275, abs=0.51)


def longley_of_mass() -> tuple[FloatArray, FloatArray]:
    """R's data frame: the deflator on the other columns, employment last."""
    y = LONGLEY[:, 1]
    return np.column_stack([LONGLEY[:, 2:], REFERENCES["Longley"].y]), y


def test_longley_ridge_constants() -> None:
    """HKB = (p - 2) s^2/|b|^2 and LW = (p - 2) s^2 n/|X b|^2 of the standardised columns."""
    X, y = longley_of_mass()
    path = ridge(X - X.mean(axis=0), y - y.mean(), 16, np.zeros(1))
    fitted = y.mean() + (X - X.mean(axis=0)) @ path.coefficients[0]
    s2 = np.sum((y - fitted) ** 2) / (16 - 7)
    b = path.coefficients[0] * X.std(axis=0)
    assert 4 * s2 / (b @ b) == pytest.approx(0.006836982, abs=5.1e-10)
    explained = np.sum((fitted - y.mean()) ** 2)
    assert 4 * s2 * 16 / explained == pytest.approx(0.05267247, abs=5.1e-9)


def test_longley_least_cross_validation() -> None:
    """RSS/(n - tr H)^2 is least at 0.0057 of the grid 0, 0.0001, ..., 0.1."""
    X, y = longley_of_mass()
    grid = np.arange(0, 0.1001, 0.0001)
    path = ridge(X - X.mean(axis=0), y - y.mean(), 16, grid / 16)
    fitted = y.mean() + (X - X.mean(axis=0)) @ path.coefficients.T
    gcv = np.sum((y[:, None] - fitted) ** 2, axis=0) / (16 - path.effective) ** 2
    assert grid[np.argmin(gcv)] == pytest.approx(0.0057, abs=1e-9)


# Rotations are as exact as the arithmetic: a factor costs half a digit or so, not half of them.
@pytest.mark.parametrize("name", ["Longley", "Filip", "Pontius", "Norris", "Wampler3"])
@pytest.mark.parametrize("pieces", [1, 3])
def test_certified_coefficients_from_compressed_rows(name: str, pieces: int) -> None:
    item = REFERENCES[name]
    Z = np.column_stack([item.X, item.y])
    factor = together([compress(Z[k::pieces]) for k in range(pieces)]).factor
    fit = least_squares(factor[:, :-1], factor[:, -1])
    assert agreeing_digits(fit.coefficients, item.certified) >= min(item.digits, 9.0) - 1.5
    s2 = fit.rss / (len(Z) - fit.rank)
    deviations = np.sqrt(s2 * np.diag(fit.unscaled_covariance))
    assert agreeing_digits(deviations, item.deviations) >= min(item.sd_digits, 9.0) - 1.5


def test_hald_residuals_do_not_follow_each_other() -> None:
    """Their lag-1 autocorrelation is negative: all 13 mixes count as independent."""
    rows = compress(np.column_stack([np.ones(13), HALD]))
    fit = least_squares(np.column_stack([np.ones(13), HALD[:, :4]]), HALD[:, 4])
    assert fit.coefficients == pytest.approx([62.41, 1.551, 0.510, 0.102, -0.144], abs=0.0051)
    assert autocorrelation([(rows, np.append(-fit.coefficients, 1.0))]) < 0
    assert stepwise(rows, 0.15, 0.15) == (1, 2)


def test_cholesterol() -> None:
    """62 values of the printed moments: a cubic of normal scores."""
    z = ndtri((np.arange(62) + 0.5) / 62)

    def values(bends: FloatArray) -> FloatArray:
        return z + bends[0] * z**2 + bends[1] * z**3

    def misfit(bends: FloatArray) -> FloatArray:
        return np.array([skew(values(bends)) - 1.02, kurtosis(values(bends), fisher=False) - 4.58])

    sample = values(fsolve(misfit, [0.1, 0.01]))
    assert skew(sample) == pytest.approx(1.02)
    assert kurtosis(sample, fisher=False) == pytest.approx(4.58)
    assert normality_p(sample) == pytest.approx(0.0006, abs=5.1e-5)
