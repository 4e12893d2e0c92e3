"""ISO 230-2 and VDI/DGQ 3441 of three public data sets, and mistakes of open evaluators."""

from __future__ import annotations

import numpy as np
import pytest
from positioning_examples import AT_TARGETS, EXPECTED, VDI, published

from mtu_cli.analyses.iso230 import figures_of, reversal_and_repeatability, statistics

# Set 1 was evaluated from more digits than it is printed with; of set 2 four are printed.
WITHIN = {1: 0.002, 2: 6e-5, 3: 1e-4}


@pytest.mark.parametrize("number", EXPECTED)
def test_figures_of_public_data(number: int) -> None:
    """Open evaluators exchanged the directions (B_mean of set 1 is -7.18), took the larger of R
    forward and R reverse for R (of set 2 0.0629), and E over one direction (65.14 of set 1).
    """
    _, mean, s = statistics(published(number)[1])
    found, expected = figures_of(mean, s), EXPECTED[number] | VDI[number]
    assert {name: float(found[name]) for name in expected} == pytest.approx(
        expected, abs=WITHIN[number]
    )
    R = reversal_and_repeatability(mean, s)[2]
    assert pytest.approx(AT_TARGETS[number], abs=WITHIN[number]) == R


def test_three_deviations_as_in_1988() -> None:
    """With 3 s for 2 s, as the edition of 1988 had it."""
    _, mean, s = statistics(published(3)[1])
    found, expected = (
        figures_of(mean, 1.5 * s),
        {"R_forward": 11.9106, "R_reverse": 21.5035, "A": 27.2924},
    )
    assert {name: float(found[name]) for name in expected} == pytest.approx(expected, abs=1e-4)


def test_a_missing_run_is_no_obstacle_and_costs_no_pair() -> None:
    """Means are divided by runs, not by targets; an evaluator needed as many of both."""
    _, readings = published(3)
    readings[0, 1, 4] = readings[1, 2, 0] = readings[1, 2, 1] = np.nan
    count, mean, s = statistics(readings)
    assert count.tolist() == [[5, 4, 5, 5, 5], [5, 5, 3, 5, 5]]
    runs = [[x[np.isfinite(x)] for x in way] for way in readings]
    B = [a.mean() - b.mean() for a, b in zip(*runs, strict=True)]
    R = [max(2 * a.std(ddof=1) + 2 * b.std(ddof=1) + abs(x), 4 * a.std(ddof=1), 4 * b.std(ddof=1))
         for a, b, x in zip(*runs, B, strict=True)]  # fmt: skip
    found = figures_of(mean, s)
    assert found["B_mean"] == pytest.approx(np.mean(B))
    assert found["R"] == pytest.approx(max(R))
