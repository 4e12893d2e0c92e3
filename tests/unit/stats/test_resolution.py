"""The last digit that values were printed to, and what it hides."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.resolution import hidden, rounding_variance, step_of

EXACT = np.random.default_rng(1).uniform(-500, 500, 200)


@pytest.mark.parametrize("step", [5.0, 0.01, 5e-3, 2e-3, 1e-4, 1e-6])
def test_the_last_printed_place_is_found(step: float) -> None:
    printed = np.round(EXACT / step) * step
    assert step_of(printed) == pytest.approx(step)
    # In another unit it is what it is there.
    assert step_of(printed * 4.848e-6 / 4.848e-6) == pytest.approx(step)


@pytest.mark.parametrize(
    ("values", "step"),
    [
        ([97.012], 1e-3),
        ([0.0, 0.3, 0.1 + 0.2, np.nan], 0.1),
        ([12.004, 12.008, 12.004], 1e-3),
        ([10.0, 20.0, 30.0, 40.0], 1.0),
        ([10.0, 20.0, 30.0, 40.0, 60.0], 10.0),
        ([np.pi, 1.0], 1e-9),
        ([0.0, np.nan], 0.0),
        ([], 0.0),
    ],
)
def test_a_coarser_step_takes_five_values(values: list[float], step: float) -> None:
    assert step_of(np.array(values)) == pytest.approx(step)


@pytest.mark.parametrize("s", [0.0, 0.1, 0.3, 0.6, 2.0])
def test_what_is_added_holds_the_error_of_a_mean_of_any_number(s: float) -> None:
    """Means of 20 readings of one value, at all places between two steps: their rms error is no
    more than u, which rounding alone makes where they hardly scatter.
    """
    rng = np.random.default_rng(3)
    true = rng.uniform(0, 1, 4000)
    read = np.round(true[:, None] + s * rng.standard_normal((4000, 20)))
    error = np.sqrt(np.mean((read.mean(axis=1) - true) ** 2))
    s2 = read.var(axis=1, ddof=1)
    u2 = s2 / 20 + hidden(s2, rounding_variance(read.ravel()))
    assert error <= 1.05 * np.sqrt(np.mean(u2))
    assert s > 0 or error == pytest.approx(np.sqrt(np.mean(u2)), rel=0.15)
