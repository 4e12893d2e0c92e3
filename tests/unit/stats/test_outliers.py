"""Values too far from the others of their row: as rarely as stated, and not hidden by a second."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.outliers import (
    deviation_p,
    display_step,
    display_u,
)


def test_the_p_of_a_deviation_is_that_of_grubbs() -> None:
    """Grubbs, Technometrics 11 (1969) 1, Table I: 2.176 of 10 values is beyond 5 %."""
    p = deviation_p(np.array([2.176]), np.array([10.0]))
    assert 10 * p[0] / 2 == pytest.approx(0.05, abs=5e-4)


def test_the_step_of_a_display() -> None:
    assert display_step(np.array([0.3, 0.1, 0.3, 0.7])) == pytest.approx(0.2)
    assert display_step(np.array([0.3, 0.1 + 0.2])) == 0.0
    assert display_step(np.array([1.0, 1.0 + 1e-6, 2.0]), 1e-5) == pytest.approx(1.0)
    assert display_step(np.array([0.001, 0.002, 0.003, 1e9])) == pytest.approx(0.001)
    assert display_step(np.full(3, 7.0)) == display_step(np.zeros(0)) == 0.0
    assert display_u(np.array([0.0, 0.6])) == pytest.approx(0.6 / np.sqrt(12))
