"""Lines in position against plain ones, and what is off all of them."""

from __future__ import annotations

import itertools
import statistics

import numpy as np
import pytest

from mtu_cli.files.reading_lines import _line, off_lines

PLACES = np.tile(np.linspace(100.0, 700.0, 7), 4)
PASSES = np.repeat([1.0, 2.0, 3.0, 4.0], 7)
WAVE = 3.0 * np.sin(PLACES / 60)


def test_a_line_is_that_of_theil_and_sen() -> None:
    """The median of all slopes, where no more places are than medians are taken of."""
    rng = np.random.default_rng(1)
    x, y = rng.permutation(np.arange(13.0)), rng.normal(size=13)
    slopes = [
        (y[j] - y[i]) / (x[j] - x[i])
        for i, j in itertools.combinations(range(13), 2)
        if x[i] != x[j]
    ]
    slope = statistics.median(slopes)
    level = statistics.median(y - slope * x)
    assert _line(x, y, 9.0) == pytest.approx((level, slope), rel=1e-12)
    assert _line(x, y - slope * x + 0.5 * x, 0.25)[1] == 0.25
    assert _line(np.full(5, 3.0), y[:5], 9.0) == (statistics.median(y[:5]), 0.0)


def test_a_few_wild_readings_do_not_move_a_line() -> None:
    x = np.linspace(0.0, 900.0, 1000)
    y = 2.0 + 0.004 * x
    y[::7] += 500.0
    assert _line(x, y, 0.01) == pytest.approx((2.0, 0.004), rel=1e-12)


@pytest.mark.parametrize(
    ("errors", "off"),
    [
        (0.008 * (PLACES - 300), 0),
        (0.008 * PLACES, 0),
        (0.008 * PLACES + 0.4 + WAVE / 9, 0),
        # Its zero would be at -275 mm; and 5 mm/m are left of 15, more than 1 mm from 300 mm on.
        (0.008 * PLACES + 2.2 + WAVE / 6, 28),
        (-0.008 * PLACES - 2.2 - WAVE / 6, 28),
        (0.015 * PLACES, 20),
        (0.008 * (PLACES - 300) * (PASSES - 2.5), 0),
        (WAVE, 20),
    ],
)
def test_what_is_off_all_lines(errors: np.ndarray, off: int) -> None:
    most = np.full(len(PLACES), 1.0)
    assert off_lines(PLACES, errors, PASSES, most, 0.01).sum() == off
    order = np.random.default_rng(2).permutation(len(PLACES))
    mixed = off_lines(PLACES[order], errors[order], PASSES[order], most, 0.01)
    assert mixed.sum() == off


def test_without_passes_all_have_one_line() -> None:
    errors = 0.008 * (PLACES - 300) * (PASSES - 2.5)
    most = np.full(len(PLACES), 1.0)
    assert off_lines(PLACES, errors, None, most, 0.01).sum() == (np.abs(errors) > 1).sum()
