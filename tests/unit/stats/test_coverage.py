from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtri, stdtrit

from mtu_cli.stats.coverage import (
    coverage_factor,
    effective_dof,
    few_blocks_factor,
    numerical_tolerance,
    t_quantiles,
    welch_satterthwaite,
)


def test_welch_satterthwaite_of_gum_h1() -> None:
    """GUM H.1.6: u_c = 32 nm with nu_eff = 16.7 (printed 16) from 25, 9.7, 2.9, 16.6 nm."""
    u = np.array([25.0, 9.7, 2.9, 16.6])
    assert welch_satterthwaite(u**2, np.array([18.0, 25.6, 50.0, 2.0])) == pytest.approx(16.7, 0.01)


def test_infinite_degrees_of_freedom() -> None:
    v = np.array([1.0, 3.0])
    assert welch_satterthwaite(v, np.array([math.inf, math.inf])) == math.inf
    assert welch_satterthwaite(v, np.array([5.0, math.inf])) == pytest.approx(5.0 * 16.0)
    assert welch_satterthwaite(np.zeros(2), np.array([5.0, 5.0])) == math.inf


def test_very_small_variances_do_not_underflow() -> None:
    assert welch_satterthwaite(np.full(2, 1e-200), np.full(2, 3.0)) == pytest.approx(6.0)


def test_many_variances_at_once() -> None:
    """Columns as one by one; GUM H.1.6 is the first, the last has no finite mean square."""
    u = np.array([[25.0, 9.7, 2.9, 16.6], [3.0, 1.0, 2.0, 5.0], [0.0, 0.0, 4.0, 0.0]])
    dof = np.array([18.0, 25.6, math.inf, 2.0])
    found = effective_dof((u**2).sum(axis=1), (u**2).T, dof)
    assert found == pytest.approx([welch_satterthwaite(own**2, dof) for own in u], rel=1e-12)
    assert found[2] == math.inf


def test_subtracted_mean_squares() -> None:
    """(MS_1 - MS_2) with 3 - 1: 2^2/(9/6 + 1/4), by columns and by shares of 2."""
    squares, dof = np.array([3.0, -1.0]), np.array([6.0, 4.0])
    assert effective_dof(np.array([2.0]), squares[:, None], dof) == pytest.approx([4 / 1.75])
    assert welch_satterthwaite(squares / 2, dof) == pytest.approx(4 / 1.75)
    assert welch_satterthwaite(squares / 2, np.full(2, math.inf)) == math.inf


@pytest.mark.parametrize(
    ("probability", "dof", "printed"),
    [
        (0.95, 1, 12.71),
        (0.95, 4, 2.78),
        (0.95, 16, 2.12),
        (0.99, 16, 2.92),
        (0.9545, 10, 2.28),
        (0.9973, 50, 3.16),
        (0.95, math.inf, 1.960),
        (0.99, math.inf, 2.576),
    ],
)
def test_coverage_factor_of_gum_table_g2(probability: float, dof: float, printed: float) -> None:
    digits = 0.0005 if math.isinf(dof) else 0.005
    assert coverage_factor(probability, dof) == pytest.approx(printed, abs=digits)


@pytest.mark.parametrize(("probability", "dof"), [(0.0, 5.0), (1.0, 5.0), (0.95, 0.0)])
def test_coverage_factor_refuses(probability: float, dof: float) -> None:
    with pytest.raises(ValueError, match=r"probability|degrees"):
        coverage_factor(probability, dof)


@pytest.mark.parametrize(
    ("u", "digits", "tolerance"),
    [
        (0.00035, 2, 0.000005),  # JCGM 101:2008, 7.9.2, example 1: 0.35 mg as 35 x 10^-5 g
        (2.0, 1, 0.5),  # example 2: 2 K
        (2.0, 2, 0.05),
        (10.1, 2, 0.5),
        (0.0996, 2, 0.005),  # rounds to 0.10, so 10 x 10^-2
        (9.94, 2, 0.05),
        (0.0, 2, 0.0),
    ],
)
def test_numerical_tolerance(u: float, digits: int, tolerance: float) -> None:
    assert numerical_tolerance(u, digits) == pytest.approx(tolerance, rel=1e-12)


def test_factor_of_few_blocks() -> None:
    assert few_blocks_factor(1) == 1.0
    for blocks in (10, 20, 80, 5000):
        wanted = stdtrit(blocks - 1, 0.975) / ndtri(0.975)
        assert few_blocks_factor(blocks) == pytest.approx(wanted, rel=1e-14)


def test_quantiles_of_several_degrees_of_freedom() -> None:
    p, dof = np.array([0.01, 0.6]), np.array([4.0, math.inf, 4.0])
    found = t_quantiles(p, dof)
    assert found[:2] == pytest.approx(np.array([stdtrit(4.0, p), ndtri(p)]), rel=1e-14)
    assert np.array_equal(found[2], found[0])


def test_numerical_tolerance_of_what_does_not_exist() -> None:
    assert math.isnan(numerical_tolerance(math.nan))
    with pytest.raises(ValueError, match="negative"):
        numerical_tolerance(-1.0)
    with pytest.raises(ValueError, match="digits"):
        numerical_tolerance(1.0, 0)
