"""Coefficients of found effects: dense least squares, restricted likelihood, coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crossed_tables import Floats, Mask, coordinate_matrix, half_measured, holes
from loop_tables import candidate, crossed, gls, prepared_with, residuals, whole_column
from scipy.optimize import minimize
from scipy.stats import binom, t

from mtu_cli.close_loop_sealed.analyses.loop.estimate import drawn_covariance, estimate, raw_design
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared
from mtu_cli.close_loop_sealed.model.effect_candidate import Column

SHAPE = (9, 8, 1)
RNG = np.random.default_rng(1)
COLUMNS: dict[str, Column] = {
    "trend": {0: np.arange(9.0)[:, None] - 4.0},
    "shape": {0: RNG.normal(size=(1, 8))},
    "cells": {0: RNG.normal(size=(9, 8))},
}
CANDIDATES = tuple(candidate(name, (column,)) for name, column in COLUMNS.items())


def prepared(seed: int, flat: bool = True, there: Mask | None = None) -> Prepared:
    errors = crossed(np.random.default_rng(seed), SHAPE)
    return prepared_with(residuals(errors, flat=flat, there=there), *CANDIDATES)


def dense_weights(own: Prepared, weights: Floats) -> Floats:
    """Covariance of the coordinates with these inverse variances of the strata."""
    strata = own.scan.frame.strata
    return np.diag(
        np.concatenate([np.full(s.size, 1 / w) for s, w in zip(strata.all, weights, strict=True)])
    )


def reml(own: Prepared, X: Floats) -> tuple[Floats, Floats]:
    """beta and its covariance at the strata's variances that maximise the restricted likelihood,
    log |V| + log |X' V^-1 X| + y' P y, by BFGS on dense matrices.
    """
    strata = own.scan.frame.strata
    place = np.concatenate([np.full(s.size, i) for i, s in enumerate(strata.all)])

    def minus(log_variance: Floats) -> float:
        V = np.diag(np.exp(log_variance)[place])
        beta, C = gls(X, own.y, V)
        left = own.y - X @ beta
        fit = np.sum(left**2 / np.diag(V))
        return float(np.log(np.diag(V)).sum() - np.linalg.slogdet(C)[1] + fit)

    start = [np.log(np.mean(own.y[s.slice] ** 2)) for s in strata.all]
    best = minimize(minus, start, options={"gtol": 1e-9})
    return gls(X, own.y, np.diag(np.exp(best.x)[place]))


@pytest.mark.parametrize("flat", [True, False])
def test_beta_is_dense_least_squares_at_the_fitted_variances(flat: bool) -> None:
    own = prepared(2, flat)
    fit = estimate(own.scan, own.y, own.flat())
    # From the entries themselves: the columns' tables, turned by the dense rotation, whitened.
    T = coordinate_matrix(own.scan.frame)
    X = T @ np.stack([whole_column(c, SHAPE).ravel() for c in COLUMNS.values()], axis=1)
    np.testing.assert_allclose(X, raw_design(own.scan, own.flat()), rtol=0, atol=1e-11)
    white = np.eye(own.scan.frame.strata.size)
    for stratum in own.scan.frame.strata.all:
        if stratum.lead:
            at = slice(stratum.start, stratum.start + len(stratum.lead))
            white[at, at] = own.scan.whitening[0][: len(stratum.lead), : len(stratum.lead)]
    y = T @ own.table.errors.ravel()
    beta, C = gls(white @ X, white @ y, dense_weights(own, fit.weights))
    np.testing.assert_allclose(fit.beta, beta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(fit.at_weights, C, rtol=1e-8, atol=1e-13)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_weights_are_those_of_restricted_maximum_likelihood(seed: int) -> None:
    own = prepared(seed)
    fit = estimate(own.scan, own.y, own.flat())
    beta, C = reml(own, raw_design(own.scan, own.flat()))
    u = np.sqrt(np.diag(C))
    # Iterations stop far below what the estimates are worth: a hundredth of u.
    assert (np.abs(fit.beta - beta) < 0.01 * u).all()
    np.testing.assert_allclose(np.sqrt(np.diag(fit.at_weights)), u, rtol=0.01)


def test_a_complete_crossed_table_is_that_of_statsmodels() -> None:
    pytest.importorskip("statsmodels")
    # statsmodels ships no types.
    from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec  # type: ignore[import-untyped]

    own = prepared(6)
    P, H, _ = SHAPE
    part, column = np.divmod(np.arange(P * H), H)
    exog = np.stack([whole_column(c, SHAPE).ravel() for c in COLUMNS.values()], axis=1)
    exog = np.column_stack([np.ones(P * H), exog])
    spec = VCSpec(
        ["part", "column"],
        [[[f"p{i}" for i in range(P)]], [[f"c{i}" for i in range(H)]]],
        [[np.eye(P)[part]], [np.eye(H)[column]]],
    )
    model = MixedLM(own.table.errors.ravel(), exog, groups=np.zeros(P * H), exog_vc=spec)
    found = model.fit(reml=True, method=["lbfgs"])
    assert (found.vcomp > 0.05).all()
    fit = estimate(own.scan, own.y, own.flat())
    u = found.bse_fe[1:]
    assert (np.abs(fit.beta - found.fe_params[1:]) < 0.01 * u).all()
    np.testing.assert_allclose(np.sqrt(np.diag(fit.at_weights)), u, rtol=0.01)


def test_degrees_of_freedom_are_those_of_the_stratum_that_tells() -> None:
    own = prepared(7)
    trend, shape, cells = estimate(own.scan, own.y, own.flat()).dof
    assert trend == pytest.approx(9 - 1 - 1, abs=0.05)
    # The shape lies in the columns, with a part of the cells' freedom spent there.
    assert 8 - 1 - 2 <= shape <= 8 - 1 - 1 + 0.05
    assert 8 * 7 - 1 < cells < 8 * 7 + 15


def test_intervals_cover() -> None:
    own, rng, count = prepared(9), np.random.default_rng(8), 800
    hits = np.zeros(len(COLUMNS))
    for _ in range(count):
        y, _ = own.scan.frame.coordinates(crossed(rng, SHAPE))
        fit = estimate(own.scan, y, own.flat())
        u = np.sqrt(np.diag(fit.covariance))
        hits += np.abs(fit.beta) <= t.ppf(0.975, np.maximum(fit.dof, 1)) * u
    for value in hits:
        # Between 93 and 97 %, but in one case of a thousand each.
        assert binom.ppf(1e-3, count, 0.93) <= value <= binom.ppf(1 - 1e-3, count, 0.97)


def simulated(own: Prepared, there: Mask, weights: Floats, C: Floats, count: int) -> Floats:
    """Covariance of beta with these weights, and of the grand mean, over tables drawn entry by
    entry.
    """
    rng = np.random.default_rng(10)
    X = raw_design(own.scan, own.flat())
    w = 1 / np.diag(dense_weights(own, weights))
    errors = np.array([crossed(rng, SHAPE) for _ in range(count)])
    y, grand = own.scan.frame.coordinates(np.where(there[:, :, None], errors, 0.0))
    beta = np.concatenate([(y * w) @ X @ C, grand], axis=1)
    return np.asarray(beta.T @ beta / count)


@pytest.mark.parametrize("name", ["holes", "half"])
def test_the_covariance_in_an_incomplete_table_is_that_of_simulated_ones(name: str) -> None:
    there = holes(9, 8, 0.25, 2) if name == "holes" else half_measured(9, 8)
    own = prepared(11, there=there)
    fit = estimate(own.scan, own.y, own.flat())
    null = replace(
        own.scan.null, interaction=np.ones(1), column=np.ones(1), part=np.array([[8 * 4.0]])
    )
    scan = replace(own.scan, null=null)
    found = drawn_covariance(scan, own.flat(), fit.weights, 1)
    expected = simulated(own, there, fit.weights, fit.at_weights, 4000)
    # 3000 drawn tables against 4000: a variance's relative standard error is sqrt(2 / n) each.
    error = np.sqrt(2 / 3000 + 2 / 4000)
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=5 * error)
    again = drawn_covariance(scan, own.flat(), fit.weights, 1)
    assert found.tobytes() == again.tobytes()


def test_the_polynomial_of_the_readings_themselves_is_beside_everything() -> None:
    own = prepared(12)
    base = (own.flat()[0],)
    scan = replace(own.scan, base=base)
    fit = estimate(scan, own.y, own.flat()[1:])
    moved = own.y + 100.0 * raw_design(own.scan, base)[:, 0]
    again = estimate(scan, moved, own.flat()[1:])
    np.testing.assert_allclose(again.beta, fit.beta, rtol=1e-9)


def test_a_column_that_the_others_hold_is_no_fault() -> None:
    own = prepared(13)
    twice = [*own.flat(), own.flat()[2]]
    fit = estimate(own.scan, own.y, twice)
    alone = estimate(own.scan, own.y, own.flat())
    assert np.isfinite(fit.beta).all()
    assert fit.beta[2] + fit.beta[3] == pytest.approx(alone.beta[2], rel=0.05)
