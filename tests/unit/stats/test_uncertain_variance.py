"""Tails of t, F and Behrens-Fisher: printed tables, plain integration, draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.uncertain_variance import (
    f_tails,
    mean_square_tails,
    t_tail,
    uncertain_variance,
)


def one(squares: list[float], dof: list[float], m: int = 1) -> tuple[FloatArray, FloatArray]:
    """The same mean squares for m items."""
    return np.repeat(np.array(squares)[:, None], m, axis=1), np.array(dof)


# Student's t exceeded on either side with 5 %, 1 %, 0.1 %: any printed table.
T_TABLE = {
    1: (12.706, 63.657, 636.619), 2: (4.303, 9.925, 31.599), 3: (3.182, 5.841, 12.924),
    8: (2.306, 3.355, 5.041), 20: (2.086, 2.845, 3.850), 60: (2.000, 2.660, 3.460),
    np.inf: (1.960, 2.576, 3.291),
}  # fmt: skip
# F exceeded with 5 % and 1 %, 20 and 10 degrees of freedom above.
F_TABLE = {
    (20, 2): (19.446, 99.449), (20, 4): (5.803, 14.020), (20, 8): (3.150, 5.359),
    (20, 60): (1.748, 2.198), (10, 20): (2.348, 3.368), (1, 4): (7.709, 21.198),
    (20, np.inf): (1.571, 1.878), (10, np.inf): (1.831, 2.321),
}  # fmt: skip
# Fisher & Yates, Statistical Tables, table VI: 5 % points of Sukhatme's d for
# theta = 0, 15, ..., 90 degrees, nu1 = 6.
SUKHATME = {
    6: (2.447, 2.440, 2.435, 2.435, 2.435, 2.440, 2.447),
    8: (2.447, 2.430, 2.398, 2.364, 2.331, 2.310, 2.306),
    12: (2.447, 2.423, 2.367, 2.301, 2.239, 2.193, 2.179),
}


@pytest.mark.parametrize("dof", T_TABLE)
def test_one_mean_square_is_students_t(dof: float) -> None:
    t = np.array(T_TABLE[dof])
    found = t_tail(t, uncertain_variance(*one([1.0], [dof], 3)))
    # Half a unit of the last digit of t is at most this share of its tail; where dof is 1,
    # summing over nodes costs 0.2 %.
    assert found == pytest.approx([0.05, 0.01, 0.001], rel=0.003)
    assert t_tail(-2 * t, uncertain_variance(*one([4.0], [dof], 3))) == pytest.approx(found)


@pytest.mark.parametrize("dof", F_TABLE)
def test_one_mean_square_is_fishers_f(dof: tuple[int, float]) -> None:
    F = np.array(F_TABLE[dof])
    variance = uncertain_variance(*one([3.0], [dof[1]], 2))
    high, low = f_tails(3.0 * F, np.full(2, dof[0]), variance)
    assert high == pytest.approx([0.05, 0.01], rel=0.005)
    assert low == pytest.approx(1 - high, abs=1e-9)


@pytest.mark.parametrize("dof", SUKHATME)
def test_two_mean_squares_are_behrens_and_fishers(dof: int) -> None:
    d = np.array(SUKHATME[dof])
    theta = np.radians(np.arange(0, 91, 15))
    squares = np.array([np.cos(theta) ** 2, np.sin(theta) ** 2])
    found = t_tail(d, uncertain_variance(squares, np.array([6.0, dof])))
    # The third decimal of d, half a unit, is 0.00004 of p; gathering nodes costs as much.
    assert found == pytest.approx(np.full(7, 0.05), abs=0.00012)


@pytest.mark.parametrize("truth", [(1.0, 1.0, 0.0), (1.0, 0.02, 0.0)])
def test_no_more_false_alarms_than_said(truth: tuple[float, float, float]) -> None:
    """Sums of mean squares of 2, 1 and 30 degrees of freedom: at 5 % and 0.5 %. Student's t
    with the effective degrees of freedom of JCGM 100, G.4.1, would alarm twice as often."""
    rng = np.random.default_rng(11)
    n, dof = 4_000, np.array([2.0, 1.0, 30.0])
    squares = np.array([c * rng.chisquare(nu, n) / nu for c, nu in zip(truth, dof, strict=True)])
    deviation = np.sqrt(sum(truth)) * rng.standard_normal(n)
    p = t_tail(deviation, uncertain_variance(squares, dof))
    for level in (0.05, 0.005):
        assert (p < level).mean() < level + 3.3 * np.sqrt(level / n)
    assert (p < 0.05).mean() > 0.005


@pytest.mark.parametrize("nu", [4.0, 12.0])
def test_a_mean_square_against_one_of_few_readings_is_fishers(nu: float) -> None:
    """A hundredth for the nodes of the variance."""
    variance = uncertain_variance(np.array([[2.5]]), np.array([nu]))
    high, low = mean_square_tails(6.0, np.full(6, 0.7), 5.0, variance)
    assert high == pytest.approx(stats.f.sf(6.0 / 2.5, 30, nu), rel=0.01)
    assert low == pytest.approx(stats.f.cdf(6.0 / 2.5, 30, nu), rel=0.01)
