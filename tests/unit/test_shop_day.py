"""The simulator that close-loop is judged with: its noise. That its effects and draws are those of
the stored records is a test of the loop's bench.
"""

from __future__ import annotations

import numpy as np
import pytest
from shop_day import NOISES, Noise, ShopDay, measure
from shop_day.day import Floats
from shop_day.noise import REPEATS, SIG_CMM, SIG_HOLE, SIG_PART, SIG_PROCESS


def strata(errors: Floats) -> list[float]:
    """Mean squares (part, hole, interaction) of one axis (P, H), with loops."""
    P, H = errors.shape
    mean = errors.mean()
    rows, cols = errors.mean(axis=1), errors.mean(axis=0)
    part = sum(H * (row - mean) ** 2 for row in rows) / (P - 1)
    hole = sum(P * (col - mean) ** 2 for col in cols) / (H - 1)
    rest = sum((errors[p, h] - rows[p] - cols[h] + mean) ** 2 for p in range(P) for h in range(H))
    return [part, hole, rest / ((P - 1) * (H - 1))]


@pytest.mark.parametrize("noise", NOISES)
def test_variances_by_stratum(noise: Noise) -> None:
    """Expected mean squares within four of their own standard errors over independent days."""
    day, days = ShopDay("A", 0), 60
    data = [measure(day, np.random.default_rng(100 + s), noise=noise) for s in range(days)]
    each = np.array([np.mean([strata(e[..., a]) for a in (0, 1)], axis=0) for e in data])
    cell = SIG_PROCESS**2 + SIG_CMM**2 / REPEATS
    cell *= {"noisy-axis": 2.5, "noisy-operation": 1.75}.get(noise, 1.0)
    # An outlier's mean square is (20^2 + 20*60 + 60^2)/3, on one cell in a hundred.
    cell += 0.01 * (20**2 + 20 * 60 + 60**2) / 3 if noise == "outliers" else 0.0
    hole = 1.5 if noise == "hole-errors" else SIG_HOLE
    wanted = np.array([cell + 24 * SIG_PART**2, cell + 21 * hole**2, cell])
    error = each.std(axis=0, ddof=1) / np.sqrt(days)
    assert np.all(np.abs(each.mean(axis=0) - wanted) < 4 * error)
    # The test can tell: the standard errors are small beside what the kinds of noise differ by.
    assert np.all(error < [0.08 * wanted[0], 0.08 * wanted[1], 0.04 * wanted[2]])
