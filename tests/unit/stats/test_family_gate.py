"""The gate: uniform p, the tail beyond what was drawn, the family-wise rate of correlated tests."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats
from scipy.stats import binom, chi2, ks_1samp

from mtu_cli.close_loop_sealed.stats.family_gate import Gate, gate_of


def gate(null: Floats, independent: int = 0) -> Gate:
    return gate_of(null, np.random.default_rng(1), independent)


def correlated(count: int, F: int, rho: float, seed: int) -> Floats:
    """Likelihood ratios of F tests that share `rho` of their variance."""
    rng = np.random.default_rng(seed)
    z = np.sqrt(rho) * rng.normal(size=(count, 1)) + np.sqrt(1 - rho) * rng.normal(size=(count, F))
    return np.asarray(z**2)


def test_single_p_are_uniform_under_the_null() -> None:
    own = gate(correlated(20_000, 1, 0.0, 2))
    p = np.exp(-own.minus_log_p(correlated(2000, 1, 0.0, 3)))[:, 0]
    assert ks_1samp(p, lambda v: v).pvalue > 1e-3


def test_single_p_are_the_ranks_where_there_are_many() -> None:
    null = correlated(999, 2, 0.5, 4)
    own = gate(null)
    for j in range(2):
        x = np.quantile(null[:, j], [0.1, 0.5, 0.8])
        rank = np.array([(null[:, j] >= v).sum() for v in x])
        found = own.minus_log_p(np.column_stack([x, x]))[:, j]
        np.testing.assert_allclose(np.exp(-found), (rank + 0.5) / 1000, rtol=1e-12)


def test_the_tail_of_an_exponential_is_exact() -> None:
    # chi^2 of two degrees of freedom has -log p = T / 2 everywhere; the slope's standard error
    # of 300 values beyond the quantile is 1 / sqrt(300) of it.
    null = np.random.default_rng(5).chisquare(2, size=(2000, 1))
    own = gate(null)
    assert own.slope[0] == pytest.approx(0.5, rel=5 / np.sqrt(300))
    T = np.array([[30.0], [60.0]])
    np.testing.assert_allclose(own.minus_log_p(T), T / 2, rtol=5 / np.sqrt(300))


def test_the_tail_of_one_degree_of_freedom_is_close_a_decade_beyond() -> None:
    # 2000 tables tell p to 1/2000; at 1e-4 the straight line is within a factor of two, which
    # bounds what the line bends and its standard error (7 % of 9.2) together.
    own = gate(correlated(2000, 1, 0.0, 6))
    T = chi2.isf(1e-4, 1)
    assert own.minus_log_p(np.array([T]))[0] == pytest.approx(-np.log(1e-4), abs=np.log(2.0))


@pytest.mark.parametrize("minus_log_p", [2.5, 5.0, 20.0])
def test_the_statistic_of_a_p_has_that_p(minus_log_p: float) -> None:
    own = gate(correlated(2000, 3, 0.3, 7))
    for j in range(3):
        T = np.zeros(3)
        T[j] = own.statistic_of(minus_log_p, j)
        assert own.minus_log_p(T)[j] == pytest.approx(minus_log_p, rel=1e-9)


def test_family_p_of_independent_tests_is_sidak() -> None:
    B, F = 4000, 8
    own = gate(correlated(B, F, 0.0, 8))
    for p in (0.3, 0.02, 0.004):
        sidak = 1 - (1 - p) ** F
        se = np.sqrt(sidak * (1 - sidak) / B)
        # The p of each are ranks among B tables themselves: the same error again for each.
        assert own.family_p(np.array([-np.log(p)]))[0] == pytest.approx(sidak, abs=5 * 1.5 * se)


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.99])
def test_the_family_wise_rate_is_that_of_the_gate(rho: float) -> None:
    F, count, alpha = 12, 4000, 0.05
    own = gate(correlated(4000, F, rho, 9))
    p = own.family_p(own.minus_log_p(correlated(count, F, rho, 10)))
    hits = int((p.min(axis=1) < alpha).sum())
    # Twice the binomial variance: the gate is drawn from as many tables as are judged.
    se = np.sqrt(2 * count * alpha * (1 - alpha))
    assert abs(hits - alpha * count) < 4 * se
    if rho == 0.99:
        # Bonferroni would all but never fire on tests that are one.
        bonferroni = int((chi2.sf(correlated(count, F, rho, 10), 1).min(axis=1) < alpha / F).sum())
        assert hits > binom.ppf(1 - 1e-3, count, 0.03) > bonferroni


def test_tests_with_a_p_of_their_own_share_the_rate() -> None:
    F, S, count, alpha = 5, 3, 4000, 0.05
    own = gate(correlated(4000, F, 0.3, 11), independent=S)
    rng = np.random.default_rng(12)
    drawn = own.family_p(own.minus_log_p(correlated(count, F, 0.3, 13))).min(axis=1)
    closed = own.family_p(rng.exponential(size=(count, S))).min(axis=1)
    hits = int((np.minimum(drawn, closed) < alpha).sum())
    assert abs(hits - alpha * count) < 4 * np.sqrt(2 * count * alpha * (1 - alpha))


def test_family_p_falls_with_the_statistic_and_is_never_zero() -> None:
    own = gate(correlated(500, 3, 0.3, 14))
    T = np.column_stack([np.linspace(0, 60, 200)] * 3)
    single = own.minus_log_p(T)
    p = own.family_p(single)
    assert (np.diff(p, axis=0) <= 0).all()
    assert p.min() >= 1e-6
    assert p.max() <= 1.0


def test_a_check_that_cannot_be_had_never_fires() -> None:
    null = correlated(500, 2, 0.0, 15)
    null[:, 1] = 0.0
    own = gate(null)
    assert own.family_p(own.minus_log_p(np.array([0.0, 0.0])))[1] == pytest.approx(1.0)
    # It must not change what the others are judged by.
    alone = gate(null[:, :1])
    T = np.array([6.0, 0.0])
    one = own.family_p(own.minus_log_p(T))[0]
    assert one == alone.family_p(alone.minus_log_p(T[:1]))[0]


def test_family_p_beyond_the_drawn_ones_follows_their_tail() -> None:
    """Of K independent exponential scores p = 1 - (1 - exp(-s))^K, far beyond what was drawn."""
    rng = np.random.default_rng(3)
    K, B = 20, 2000
    gate = gate_of(rng.exponential(size=(B, K)), rng)
    for score in (8.0, 10.0, 12.0):
        exact = 1 - (1 - np.exp(-score)) ** K
        # Twenty drawn values set the level: 1/sqrt(20) is one standard error.
        assert gate.family_p(np.array([score]))[0] == pytest.approx(exact, rel=4 / np.sqrt(20))
