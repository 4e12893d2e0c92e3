"""Values too far from the others of their row: as rarely as stated, and not hidden by a second."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mtu_cli.stats.outliers import (
    deviation_p,
    display_step,
    display_u,
    outlying_p,
    spread,
)

ROWS = 20_000


@pytest.mark.parametrize("n", [5, 10, 21, 60])
def test_normal_rows_have_one_as_rarely_as_stated(n: int) -> None:
    """Bonferroni's bound over the values of a row holds, and for one in turn is nearly reached."""
    rows = np.random.default_rng(n).standard_normal((ROWS, n))
    alarms = int((outlying_p(rows).min(axis=1) * n <= 0.01).sum())
    assert alarms <= stats.binom(ROWS, 0.01).ppf(1 - 1e-4)
    if n < 20:
        assert alarms >= stats.binom(ROWS, 0.008).ppf(1e-4)


def test_the_p_of_a_single_value_is_grubbs() -> None:
    row = np.random.default_rng(1).standard_normal(12)
    row[4] = 5.0
    d = (row[4] - row.mean()) / row.std(ddof=1)
    found = outlying_p(row[None])[0]
    assert found[4] == pytest.approx(float(deviation_p(np.array([d]), np.array([12.0]))[0]))
    assert (np.delete(found, 4) == 1).all()


@pytest.mark.parametrize("signs", [(1, 1), (1, -1)])
def test_two_do_not_hide_each_other(signs: tuple[int, int]) -> None:
    for n in (21, 60):
        row = np.random.default_rng(2).standard_normal(n)
        row[[0, 7]] = 50.0 * np.array(signs)
        found = outlying_p(row[None])[0]
        assert (found[[0, 7]] < 1e-9).all()
        assert (np.delete(found, [0, 7]) > 1e-3).all()


def test_rows_that_do_not_scatter_or_are_short() -> None:
    rows = np.zeros((3, 25))
    rows[1, 0] = 1.0
    rows[2, 4:] = np.nan
    rows[2, 0] = 1e3
    found = outlying_p(rows, 5)
    assert (found[[0, 2]] == 1).all()
    assert found[1, 0] == 0
    assert (found[1, 1:] == 1).all()


def test_spread_is_that_of_what_is_not_gross() -> None:
    """Of many readings its own standard error is 1/sqrt(2 n); a fifth of gross ones adds 6 %."""
    left = 3.0 * np.random.default_rng(5).standard_normal(20_000)
    assert spread(left, 0) == pytest.approx(3.0, rel=0.03)
    left[::5] = 1e3
    # Their median is the 5/8 quantile of |z| of the clean: 0.887 for 0.674.
    assert spread(left, 0) == pytest.approx(3.0 * 0.887 / 0.6745, rel=0.03)
    assert spread(np.zeros(9), 1) == 0


def test_the_step_of_a_display() -> None:
    assert display_step(np.array([0.3, 0.1, 0.3, 0.7])) == pytest.approx(0.2)
    assert display_step(np.array([0.3, 0.1 + 0.2])) == 0.0
    assert display_step(np.array([1.0, 1.0 + 1e-6, 2.0]), 1e-5) == pytest.approx(1.0)
    assert display_step(np.array([0.001, 0.002, 0.003, 1e9])) == pytest.approx(0.001)
    assert display_step(np.full(3, 7.0)) == display_step(np.zeros(0)) == 0.0
    assert display_u(np.array([0.0, 0.6])) == pytest.approx(0.6 / np.sqrt(12))
