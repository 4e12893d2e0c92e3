"""Values too far from the others of their row: as rarely as stated, and not hidden by a second."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.outliers import deviation_p, outlying, spikes


def test_the_p_of_a_deviation_is_that_of_grubbs() -> None:
    """Grubbs, Technometrics 11 (1969) 1, Table I: 2.176 of 10 values is beyond 5 %."""
    p = deviation_p(np.array([2.176]), np.array([10.0]))
    assert 10 * p[0] / 2 == pytest.approx(0.05, abs=5e-4)


def test_a_last_digit_is_no_outlier() -> None:
    """All readings alike but one, by one digit: with the variance of the display it is none."""
    values = np.array([2.0] * 19 + [3.0])
    assert outlying(values)[0].sum() == 1
    assert not outlying(values, r=1 / 12)[0].any()
    assert outlying(np.where(values == 3, 30, values), r=1 / 12)[0].sum() == 1
    curve = np.where(np.arange(40) == 20, 1.0, 0.0)
    assert not spikes(curve, r=1 / 12)[0].any()
    assert spikes(30 * curve, r=1 / 12)[0].sum() == 1
