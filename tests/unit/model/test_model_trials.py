"""Drawn parts against the covariance they are drawn from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from model_examples import estimate, model_of
from scipy import stats

from mtu_cli.model.measurands import PointTrials
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.stats.least_squares import FloatArray

TRIALS = 200_000
POINTS = np.array([[0.0, 0, 0], [30, 10, 0], [60, -20, 0]])


def prediction(s: float = 0.8) -> Prediction:
    a = estimate(
        "a",
        "x",
        [5.0, -0.1],
        C=np.array([[0.3, -0.002], [-0.002, 1e-4]]),
        D=np.array([[1.0, -0.01], [-0.01, 4e-4]]),
        s=s,
    )
    b = estimate("b", "y", [1.0], D=np.array([[0.5]]), s=0.3)
    model = model_of([(a, {"x": "1", "y": "0.4"}), (b, {"x": "-2", "y": "1 + y/50"})])
    return predict(model, list("abc"), POINTS)


def trials(given: Prediction, combine: FloatArray, dof: FloatArray) -> PointTrials:
    """Trials of linear combinations of the errors: the measure hands them through."""
    k = len(combine)
    return PointTrials(
        given,
        tuple(str(i) for i in range(k)),
        lambda combined: combined,
        combine,
        np.arange(k),
        combine,
        replace(given.variance(combine), dof=dof),
    )


def drawn(model: PointTrials, seed: int = 1) -> FloatArray:
    return model.draw(np.random.default_rng(seed), TRIALS).values.copy()


def check_covariance(values: FloatArray, mean: FloatArray, wanted: FloatArray) -> None:
    m = values.shape[1]
    seen = np.cov(values)
    # Of normal data: se^2 of a covariance is (c_ii c_jj + c_ij^2)/m.
    variances = np.diag(wanted)
    error = np.sqrt((np.outer(variances, variances) + wanted**2) / m)
    assert (np.abs(seen - wanted) < 4.5 * error).all()
    assert (np.abs(values.mean(axis=1) - mean) < 4.5 * np.sqrt(variances / m)).all()


def test_mean_and_covariance_of_the_draws() -> None:
    given = prediction()
    combine = np.vstack([np.eye(6), np.eye(6)[2] - np.eye(6)[0], np.full(6, 1 / 6)])
    values = drawn(trials(given, combine, np.full(8, np.inf)))
    check_covariance(values, combine @ given.mean, combine @ given.covariance @ combine.T)


def test_finite_degrees_of_freedom_give_a_scaled_t() -> None:
    given = prediction()
    dof = np.array([5.0, 7.5, 20.0, np.inf, 5.0, 40.0])
    model = trials(given, np.eye(6), dof)
    values = drawn(model, 3)
    u = np.sqrt(np.diag(given.covariance))
    standard = (values - given.mean[:, None]) / u[:, None]
    for i, nu in enumerate(dof):
        law = stats.norm() if np.isinf(nu) else stats.t(nu)
        assert stats.kstest(standard[i], law.cdf).pvalue > 1e-4
        for probability in (0.025, 0.5, 0.975):
            q = law.ppf(probability)
            error = np.sqrt(probability * (1 - probability) / TRIALS) / law.pdf(q)
            assert abs(np.quantile(standard[i], probability) - q) < 4.5 * error
        assert model.linear_variance[i] == pytest.approx(u[i] ** 2 * law.var())
    # Heavy tails: the variance's own standard error needs kurtosis; 7.5 has one, 5 too.
    for i in (1, 2, 3, 5):
        kurtosis = 3.0 if np.isinf(dof[i]) else 3 + 6 / (dof[i] - 4)
        error = np.sqrt((kurtosis - 1) / TRIALS) * model.linear_variance[i]
        assert abs(values[i].var() - model.linear_variance[i]) < 4.5 * error


def test_outputs_have_the_first_order_variance_where_D_is_negative() -> None:
    """A mean of many points: what is drawn and what is stated may not part."""
    n = 25
    s2 = 1.0
    low = estimate(
        "a",
        "x",
        [0.0],
        C=np.array([[0.05 / 5]]),
        D=np.array([[0.05 - s2 / 8]]),
        s=np.sqrt(s2),
        pass_dof=4,
        repeat_dof=35,
        n_passes=5,
    )
    model = model_of([(low, {"x": "1"})], axes=("x",))
    points = np.column_stack([np.linspace(0, 100, n), np.zeros(n), np.zeros(n)])
    given = predict(model, [str(i) for i in range(n)], points)
    mean = np.full((1, n), 1 / n)
    wanted = given.variance(mean).total
    assert float((mean @ given.covariance @ mean.T)[0, 0]) < 0
    values = drawn(trials(given, mean, np.array([np.inf])))
    assert values.var() == pytest.approx(wanted[0], rel=4.5 * np.sqrt(2 / TRIALS))


# What a study draws where the number of trials adapts.
