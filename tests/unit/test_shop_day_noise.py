"""Scatter of the simulated shop day: its strata, its six kinds, its repeats."""

from __future__ import annotations

import numpy as np
import pytest
from shop_day import (
    NOISES,
    REPEATS,
    Noise,
    ShopDay,
    effect,
    measure,
    measure_repeats,
)
from shop_day.day import Floats
from shop_day.noise import SIG_CMM, SIG_HOLE, SIG_PART, SIG_PROCESS


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def strata(errors: Floats) -> tuple[float, float, float]:
    """Mean squares (part, hole, interaction) of one axis (P, H), with loops."""
    P, H = errors.shape
    mean = errors.mean()
    rows, cols = errors.mean(axis=1), errors.mean(axis=0)
    part = sum(H * (row - mean) ** 2 for row in rows) / (P - 1)
    hole = sum(P * (col - mean) ** 2 for col in cols) / (H - 1)
    rest = sum(
        (errors[p, h] - rows[p] - cols[h] + mean) ** 2 for p in range(P) for h in range(H)
    ) / ((P - 1) * (H - 1))
    return float(part), float(hole), float(rest)


DAYS = 60


def mean_squares(noise: Noise) -> Floats:
    """(DAYS, axis, stratum)."""
    day = ShopDay("A", 0)
    data = [measure(day, rng_of(100 + s), noise=noise) for s in range(DAYS)]
    return np.array([[strata(errors[..., a]) for a in (0, 1)] for errors in data])


CELL = SIG_PROCESS**2 + SIG_CMM**2 / REPEATS


@pytest.mark.parametrize("noise", NOISES)
def test_variances_by_stratum(noise: Noise) -> None:
    """Expected mean squares within four of their own standard errors over independent days."""
    found = mean_squares(noise)
    # An outlier's mean square is (20^2 + 20*60 + 60^2)/3, on one cell in a hundred.
    cell = CELL * {"noisy-axis": 2.5, "noisy-operation": 1.75}.get(noise, 1.0)
    cell += 0.01 * (20**2 + 20 * 60 + 60**2) / 3 if noise == "outliers" else 0.0
    hole = 1.5 if noise == "hole-errors" else SIG_HOLE
    wanted = np.array([cell + 24 * SIG_PART**2, cell + 21 * hole**2, cell])
    each = found.mean(axis=1)
    error = each.std(axis=0, ddof=1) / np.sqrt(DAYS)
    assert np.all(np.abs(each.mean(axis=0) - wanted) < 4 * error)
    # The test can tell: the standard errors are small beside what the kinds of noise differ by.
    assert np.all(error < [0.08 * wanted[0], 0.08 * wanted[1], 0.04 * wanted[2]])


def test_repeats_scatter_like_the_cmm() -> None:
    day = ShopDay("B", 0)
    repeats = measure_repeats(day, rng_of(8))
    assert repeats.shape == (21, 24, 2, 3)
    within = repeats.var(axis=-1, ddof=1)
    assert abs(within.mean() - SIG_CMM**2) < 4 * SIG_CMM**2 / np.sqrt(within.size)
    np.testing.assert_allclose(repeats.mean(axis=-1), measure(day, rng_of(8)))
    loud = effect(day, "operation-scatter", rng_of(0), 1.0)
    assert not loud.errors.any()
    spread = measure_repeats(day, rng_of(8), [loud]).var(axis=-1, ddof=1).mean(axis=(0, 2))
    ratio = spread[day.operation == 1].mean() / spread[day.operation == 0].mean()
    assert abs(ratio - 3) < 4 * 3 * np.sqrt(2 / (21 * 12 * 2))
