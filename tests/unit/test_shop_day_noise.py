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
    named_by_noise,
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


def test_noisy_axis_and_operation() -> None:
    rest = mean_squares("noisy-axis")[..., 2]
    ratio = rest.max(axis=1) / rest.min(axis=1)
    # F of 460 and 460 degrees of freedom about 4: standard deviation 9 % each.
    assert abs(np.log(ratio).mean() - np.log(4)) < 4 * np.sqrt(4 / 460) / np.sqrt(DAYS)
    assert {int(i) for i in rest.argmax(axis=1)} == {0, 1}
    day, logs = ShopDay("A", 0), []
    for seed in range(DAYS):
        errors = measure(day, rng_of(seed), noise="noisy-operation")
        errors = errors - errors.mean(axis=1, keepdims=True)
        spread = [errors[:, day.operation == code].var() for code in (0, 1)]
        logs.append(np.log(spread[1] / spread[0]))
    size = np.abs(logs)
    assert min(logs) < 0 < max(logs)
    # log of uniform(2, 3) has the mean 0.910.
    assert abs(size.mean() - (3 * np.log(3) - 2 * np.log(2) - 1)) < 0.06
    assert named_by_noise("noisy-operation") == ("operation-scatter",)
    assert not any(named_by_noise(noise) for noise in NOISES if noise != "noisy-operation")


def test_heavy_tails_and_outliers() -> None:
    day = ShopDay("A", 0)

    def cells(noise: Noise) -> Floats:
        data = np.array([measure(day, rng_of(s), noise=noise) for s in range(20)])
        centred: Floats = data - data.mean(axis=2, keepdims=True)
        centred -= data.mean(axis=1, keepdims=True)
        return centred

    def beyond(noise: Noise, size: float) -> float:
        values = cells(noise)
        return float(np.mean(np.abs(values) > size * values.std()))

    # A normal value lies beyond 4 standard deviations once in 15800, of t4 once in 260.
    assert beyond("normal", 4) < 5e-4
    assert beyond("t4", 4) > 2e-3
    share = float(np.mean(np.abs(cells("outliers")) > 18))
    n = 20 * 21 * 24 * 2
    # One in a hundred, of 20 to 60 um on a scatter of 3.6 (5 with the means taken out).
    assert abs(share - 0.01) < 4 * np.sqrt(0.01 * 0.99 / n)


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
