"""Least squares over strata: Meier's and Kenward & Roger's variance, simulation, dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats
from scipy.stats import binom, t

from mtu_cli.close_loop_sealed.stats.stratified import StratifiedFit, stratified_fit
from mtu_cli.stats.least_squares import shortened

SIZES = (9, 14, 30)
PLACES = [slice(0, 9), slice(9, 23), slice(23, 53)]
DOF = np.array(SIZES, float)
SD = np.array([1.0, 2.0, 3.0])
NOISE = np.repeat(SD, SIZES)
X = np.random.default_rng(1).normal(size=(53, 2))


def fitted(seed: int, columns: Floats = X) -> tuple[StratifiedFit, Floats]:
    y = columns @ np.ones(columns.shape[1]) + NOISE * np.random.default_rng(seed).normal(size=53)
    return stratified_fit(columns, y, PLACES, DOF), y


def test_beta_is_dense_weighted_least_squares() -> None:
    fit, y = fitted(2)
    W = np.diag(np.repeat(fit.weights, SIZES))
    C = np.linalg.inv(X.T @ W @ X)
    np.testing.assert_allclose(fit.at_weights, C, rtol=1e-9)
    np.testing.assert_allclose(fit.beta, C @ X.T @ W @ y, rtol=1e-9)
    left = y - X @ fit.beta
    for s, w, n in zip(PLACES, fit.weights, SIZES, strict=True):
        spent = w * np.trace(X[s].T @ X[s] @ C)
        # Six rounds of weighing: what the next one would change is far below u.
        assert 1 / w == pytest.approx(left[s] @ left[s] / (n - spent), rel=0.01)


def test_of_one_column_the_variance_is_meiers() -> None:
    """Meier, Biometrics 9 (1953) 59: V (1 + 4 sum c_i (1 - c_i) / n_i), c_i the weights."""
    fit, _ = fitted(3, X[:, :1])
    squares = np.array([X[s, 0] @ X[s, 0] for s in PLACES])
    share = fit.weights * squares / (fit.weights @ squares)
    nu = DOF - share
    expected = fit.at_weights[0, 0] * (1 + 4 * np.sum(share * (1 - share) / nu))
    assert fit.covariance[0, 0] == pytest.approx(expected, rel=1e-9)
    # Welch-Satterthwaite, GUM G.4.1.
    assert fit.dof[0] == pytest.approx(1 / np.sum(share**2 / nu), rel=1e-9)


def test_of_several_columns_the_variance_is_kenwards_and_rogers() -> None:
    """Their eq. (5), 2 Phi [sum W_ij (Q_ij - P_i Phi P_j)] Phi more, by dense matrices."""
    fit, _ = fitted(4)
    variances = 1 / fit.weights
    inverse = np.diag(1 / np.repeat(variances, SIZES))
    Phi = np.linalg.inv(X.T @ inverse @ X)
    masks = [np.diag(np.repeat(np.eye(3)[i], SIZES)) for i in range(3)]
    total = np.zeros((2, 2))
    for mask, variance, n in zip(masks, variances, SIZES, strict=True):
        P = -X.T @ inverse @ mask @ inverse @ X
        Q = X.T @ inverse @ mask @ inverse @ mask @ inverse @ X
        spent = np.trace(-P * variance @ Phi)
        total += 2 * variance**2 / (n - spent) * (Q - P @ Phi @ P)
    expected = Phi + 2 * Phi @ total @ Phi
    np.testing.assert_allclose(fit.covariance, expected, rtol=1e-9)


def test_the_covariance_is_that_of_simulated_fits_and_intervals_cover() -> None:
    count = 3000
    rng, found, told, known, dof = np.random.default_rng(5), [], [], [], []
    for _ in range(count):
        fit = stratified_fit(X, NOISE * rng.normal(size=53), PLACES, DOF)
        found.append(fit.beta)
        told.append(np.diag(fit.covariance))
        known.append(np.diag(fit.at_weights))
        dof.append(fit.dof)
    hits = (np.abs(found) <= t.ppf(0.975, dof) * np.sqrt(told)).sum(axis=0)
    variance = np.var(found, axis=0)
    error = np.sqrt(2 / count)
    np.testing.assert_allclose(np.mean(told, axis=0), variance, rtol=4 * error)
    # As if the weights were known it is too small by more than that.
    assert (np.mean(known, axis=0) < variance * (1 - error)).all()
    for value in hits:
        assert binom.ppf(1e-3, count, 0.94) <= value <= binom.ppf(1 - 1e-3, count, 0.96)


def test_what_stands_behind_is_fitted_beside() -> None:
    fit, _ = fitted(6)
    first = fit.only(1)
    assert first.beta.tolist() == fit.beta[:1].tolist()
    assert first.covariance[0, 0] == fit.covariance[0, 0]
    assert first.dof.tolist() == fit.dof[:1].tolist()


def test_a_stratum_without_freedom_or_squares_tells_nothing() -> None:
    y = NOISE * np.random.default_rng(7).normal(size=53)
    without = stratified_fit(X, y, PLACES, DOF * [0, 1, 1])
    assert without.weights[0] == 0
    alone = stratified_fit(X[9:], y[9:], [slice(0, 14), slice(14, 44)], DOF[1:])
    np.testing.assert_allclose(without.beta, alone.beta, rtol=1e-9)
    y[:9] = 0.0
    np.testing.assert_array_equal(stratified_fit(X, y, PLACES, DOF).beta, without.beta)


@pytest.mark.parametrize("short", [1, 2, 4, 5])
def test_a_stratum_that_the_columns_fit_is_judged_by_what_lies_within(short: int) -> None:
    """Few parts: what is left of their lines is next to nothing, and is no sign of certainty."""
    count, n = 150, 14
    rng = np.random.default_rng(8)
    x = rng.normal(size=(short + n, 1))
    x[:short] *= 0.5
    places, dof = [slice(0, short), slice(short, short + n)], np.array([short, n], float)
    known = 1 / np.sqrt(float((x**2).sum()))
    found, hits = [], 0
    for i in range(count):
        y = 3.0 * x[:, 0] + rng.normal(size=short + n) * np.repeat([1.0 + i % 2, 1.0], [short, n])
        fit = stratified_fit(x, y, places, dof, np.array([1, 1]))
        assert 0 < fit.weights[0] <= fit.weights[1]
        if short == 1:
            # Fitted exactly whatever its variance: that of its own square, nothing taken out.
            assert fit.weights[0] <= 1 / y[0] ** 2 * (1 + 1e-12)
        u = float(np.sqrt(fit.covariance[0, 0]))
        found.append(u)
        hits += abs(fit.beta[0] - 3) <= t.ppf(0.975, fit.dof[0]) * u
    # As good as if all variances were known: four standard deviations of that of 14 entries.
    assert min(found) > known * (1 - 4 / np.sqrt(2 * n))
    assert hits >= binom.ppf(1e-3, count, 0.94)


def test_a_stratum_with_freedom_enough_is_judged_by_itself() -> None:
    y = fitted(9)[1]
    within = stratified_fit(X, y, PLACES, DOF, np.array([2, 2, 2]))
    assert within.weights.tolist() == stratified_fit(X, y, PLACES, DOF).weights.tolist()


def test_a_triangle_keeps_all_products() -> None:
    for rows in (X, X[:1]):
        short = shortened(rows)
        assert len(short) <= 2
        np.testing.assert_allclose(short.T @ short, rows.T @ rows, rtol=1e-12)
