"""Data that determine less than the model: no crash, no warning, no nan without reason."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from pass_designs import DRIFT, PLACES, balanced, drawn
from scipy.special import stdtrit

from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.mixed_model import PassFit, fit_passes
from mtu_cli.stats.pass_tests import pass_scatter, pass_trend, reversal


def noise(n: int) -> FloatArray:
    return np.random.default_rng(n).normal(size=n)


def assert_sound(fit: PassFit) -> None:
    """Finite throughout; D and C are covariances; the tests of the passes run."""
    for field in fields(fit):
        value = getattr(fit, field.name)
        if field.name != "plain" and value is not None:
            assert np.isfinite(np.asarray(value, dtype=np.float64)).all(), field.name
    for matrix in (fit.D, fit.covariance):
        size = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
        scaled = np.divide(matrix, size, out=np.zeros_like(matrix), where=size > 0)
        assert (np.diag(matrix) >= 0).all()
        assert np.linalg.eigvalsh(scaled).min() > -1e-8
    pass_scatter(fit)
    pass_trend(fit, np.arange(fit.n_passes, dtype=np.float64))
    reversal(fit, np.arange(float(fit.n_passes)))


def assert_not_separated(fit: PassFit, n: int, k: int) -> None:
    """All scatter counts as repeatability: D = 0 and s_repeat = s."""
    assert not fit.separated
    assert not fit.D.any()
    assert (fit.pass_dof, fit.within_dof) == (0, n - k)
    assert fit.s2 == fit.plain.s2
    np.testing.assert_array_equal(fit.covariance, fit.plain.s2 * fit.plain.unscaled_covariance)
    assert pass_scatter(fit) is None
    assert pass_trend(fit, np.arange(fit.n_passes, dtype=np.float64)) is None
    assert reversal(fit, np.arange(float(fit.n_passes))) is None


def test_one_reading_a_pass_without_an_axis() -> None:
    """Gilsinn & Ling 2004, Table 1: all scatter is pass-to-pass, u of a future one s sqrt 6/5."""
    y = np.array([1.0, 3.0, 2.0, 6.0, 3.0])
    fit = fit_passes(y, np.zeros(5), 0, np.arange(5))
    assert_sound(fit)
    assert (fit.s2, fit.within_dof, fit.pass_dof) == (0.0, 0, 4)
    assert fit.D[0, 0] == pytest.approx(3.5)
    assert fit.covariance[0, 0] == pytest.approx(3.5 / 5)
    assert pass_scatter(fit) is None


def test_one_reading_a_pass_along_an_axis_is_not_pass_to_pass_scatter() -> None:
    """The passes differ by the slope, which no pass shows by itself: it must not enter D."""
    y = 0.1 * PLACES + noise(8)
    fit = fit_passes(y, PLACES, 1, np.arange(8))
    assert_sound(fit)
    assert_not_separated(fit, 8, 2)
    assert fit.s2 < 5.0


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize(
    "y", [np.zeros(32), np.full(32, 0.1), 0.1 + 0.01 * np.tile(PLACES, 4)], ids=["0", "0.1", "line"]
)
def test_readings_without_scatter(y: FloatArray, degree: int) -> None:
    """Rounding must not be taken for scatter: no test may report a p value of it."""
    if degree == 0 and np.ptp(y) > 0:
        y = np.full(32, 1 / 3)
    design = balanced(4, both=True)
    fit = fit_passes(y, design.position, degree, design.group, design.direction)
    assert_sound(fit)
    assert fit.s2 == 0.0
    assert not fit.D.any()
    assert not fit.covariance.any()
    assert pass_scatter(fit) is None
    assert pass_trend(fit, np.arange(4.0)) is None
    assert reversal(fit, np.arange(float(fit.n_passes))) is None


@pytest.mark.parametrize("count", [5, 8, 13, 40])
@pytest.mark.parametrize("value", [0.0037, 0.1, 1 / 3, 1000.1])
def test_the_rounding_of_readings_that_repeat_exactly_is_no_reversal(
    value: float, count: int
) -> None:
    """Read there and back, the same numbers are summed in another order: what that leaves is as
    steady as a reversal and a trend of 1e-19 would be. A step of the last digit read is none.
    """
    runs = np.repeat(np.arange(6), 2 * count)
    group, sign = np.repeat(np.arange(12), count), np.tile([1.0, -1.0], 6)
    place = np.sqrt(np.arange(1.0, count + 1)) * 40
    position = np.tile(np.concatenate([place, place[::-1]]), 6)
    exact = np.round(value * (1 + 0.01 * position), 7)
    for y in (np.full(len(position), value), exact):
        fit = fit_passes(y, position, 1, group, np.repeat(sign, count), runs)
        assert reversal(fit, np.arange(12.0)) is None
        assert pass_trend(fit, np.arange(12.0)) is None
    digits = np.random.default_rng(1).integers(-1, 2, size=len(exact))
    step = 4 * (np.repeat(sign, count) > 0)
    fit = fit_passes(
        exact + 1e-7 * (digits + step), position, 1, group, np.repeat(sign, count), runs
    )
    found = reversal(fit, np.arange(12.0))
    assert found is not None
    assert abs(found.value - 4e-7) < 4 * found.u


@pytest.mark.parametrize("left", [1, 3])
def test_a_pass_that_broke_off_early_leaves_the_slope_covered(left: int) -> None:
    """It counts in the coefficients; how slopes scatter is learnt from the others."""
    design = balanced(6).without({(0, i) for i in range(left, 8)})
    t = stdtrit(4, 0.975)
    hits = 0
    for rng in np.random.default_rng(77).spawn(600):
        y = drawn(design, rng, DRIFT, b=(3.0, -0.02))
        fit = fit_passes(y, design.position, 1, design.group)
        miss = abs(fit.plain.coefficients[1] - -0.02)
        hits += miss < t * np.sqrt(fit.covariance[1, 1])
    # Few passes and an unbalanced design: exact only nearly, and never much too narrow.
    assert hits / 600 > 0.95 - 3.3 * np.sqrt(0.95 * 0.05 / 600)
