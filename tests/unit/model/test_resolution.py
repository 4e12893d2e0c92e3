"""The step that measured coordinates were rounded to."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.model.resolution import FEWEST, FEWEST_FIVES, last_digit, resolution

EXACT = np.random.default_rng(1).uniform(-500, 500, 200)


@pytest.mark.parametrize("step", [1e-3, 5e-4, 1e-4, 1e-5])
def test_the_step_is_found(step: float) -> None:
    assert resolution(np.round(EXACT / step) * step) == step


def test_what_is_not_rounded_has_none_and_coarser_steps_count_as_1_um() -> None:
    assert resolution(EXACT) == 0.0
    assert resolution(np.round(EXACT, 2)) == 1e-3


@pytest.mark.parametrize("step", [5.0, 0.01, 5e-3, 2e-3, 1e-4])
def test_the_last_digit_is_found(step: float) -> None:
    assert last_digit(np.round(EXACT / step) * step) == pytest.approx(step)


def test_the_last_digit_of_a_few_values_is_what_their_decimals_tell() -> None:
    """A value is a whole number of itself, and two even ones are of two."""
    assert last_digit(np.array([97.012])) == pytest.approx(1e-3)
    assert last_digit(np.repeat([12.004, 12.008], 20)) == pytest.approx(1e-3)
    wrong = 0
    for seed in range(1000):
        whole = np.random.default_rng(seed).integers(-(10**6), 10**6, FEWEST)
        values = whole.astype(np.float64) * 1e-3
        wrong += last_digit(values) > 1.5e-3
    # 4.1 are due; more than 12 in one of 3000 such tests.
    assert wrong <= 12


@pytest.mark.parametrize(
    ("values", "digit"),
    [
        ([10.002, 0.004, 0.007], 0.001),
        ([1000.00001, 3.0, 2.5], 1e-5),
        ([0.0, 0.0], 1.0),
        ([np.pi, 1.0], 1e-7),
    ],
)
def test_the_last_digit_is_the_largest_step_of_all(values: list[float], digit: float) -> None:
    assert last_digit(np.array(values)) == pytest.approx(digit, rel=1e-9)


def test_four_values_that_share_a_five_are_in_steps_of_five() -> None:
    """Not of 15, which they share by chance."""
    assert last_digit(15e-3 * np.array([1.0, 2.0, 3.0, 5.0])) == pytest.approx(5e-3)
    assert last_digit(15e-3 * np.array([1.0, 2.0, 3.0])) == pytest.approx(1e-3)


def test_of_eight_values_the_common_divisor_is_their_step() -> None:
    values = 6e-3 * np.arange(1.0, 9.0)
    assert last_digit(values) == pytest.approx(6e-3)
    assert last_digit(values[:7]) == pytest.approx(1e-3)
    assert last_digit(np.repeat(values[:7], 3)) == pytest.approx(1e-3)


def test_of_four_values_fives_are_their_step() -> None:
    values = 5e-3 * np.array([3.0, 4.0, 7.0, 9.0])
    assert last_digit(values) == pytest.approx(5e-3)
    assert last_digit(np.repeat(values[:3], 3)) == pytest.approx(1e-3)
    wrong = 0
    for seed in range(2000):
        whole = np.random.default_rng(seed).integers(-(10**6), 10**6, FEWEST_FIVES)
        wrong += last_digit(whole.astype(np.float64) * 1e-3) > 1.5e-3
    # 3.2 are due; more than 10 in one of 1600 such tests.
    assert wrong <= 10
