from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import fdtrc, stdtrit

from mtu_cli.stats.coverage import (
    coverage_factor,
    hotelling_p,
    numerical_tolerance,
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


def test_hotelling_of_one_estimate_is_students_t() -> None:
    """And of three it is F of 3 and nu - 2 degrees of freedom."""
    t = float(stdtrit(7.0, 0.975))
    assert hotelling_p(t**2, 1, 7.0) == pytest.approx(0.05)
    assert hotelling_p(9.0, 3, 8.0) == pytest.approx(float(fdtrc(3, 6, 9.0 * 6 / 24)))
    assert hotelling_p(9.0, 3, 2.0) == 1.0
