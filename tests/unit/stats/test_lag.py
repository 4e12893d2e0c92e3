"""First-order lags against closed forms, an integrator of differential equations and a filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mtu_cli.stats.lag import first_order_lag, lag_of_moments
from mtu_cli.stats.least_squares import FloatArray


def uneven(n: int = 40, seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """A rough signal of two columns at uneven times, in min."""
    rng = np.random.default_rng(seed)
    return 20 + rng.normal(size=(n, 2)).cumsum(axis=0), np.cumsum(rng.uniform(0.2, 9.0, n))


def test_against_an_integrator() -> None:
    """tau du/dt = T - u, interval by interval, so that no step of the integrator has a kink."""
    signal, time = uneven()
    tau = 12.0
    T = signal[:, 0]
    found = first_order_lag(signal, time, np.array([tau]))[0, :, 0]
    u = T[0]
    for i in range(1, len(time)):

        def slope(t: float, state: FloatArray) -> FloatArray:
            return np.asarray((np.interp(t, time, T) - state) / tau, float)

        span = (float(time[i - 1]), float(time[i]))
        u = solve_ivp(slope, span, np.array([u]), rtol=1e-10, atol=1e-12).y[0, -1]
        assert found[i] == pytest.approx(u, rel=1e-8)


def test_constants_in_any_order_and_columns_apart() -> None:
    signal, time = uneven()
    together = first_order_lag(signal, time, np.array([5.0, 0.0, 80.0]))
    assert together.shape == (3, 40, 2)
    assert (together[1] == signal).all()
    for k, tau in ((0, 5.0), (2, 80.0)):
        for j in range(2):
            alone = first_order_lag(signal[:, j : j + 1], time, np.array([tau]))[0, :, 0]
            assert together[k, :, j] == pytest.approx(alone, rel=1e-14)


@pytest.mark.parametrize("second", [0.0, 40.0], ids=["earlier", "the same moment"])
def test_a_time_that_does_not_advance_starts_a_new_run(second: float) -> None:
    signal, _ = uneven(30)
    first = np.linspace(0.0, 40.0, 15)
    time = np.concatenate([first, second + np.linspace(0.0, 40.0, 15)])
    tau = np.array([9.0])
    found = first_order_lag(signal, time, tau)
    for run in (slice(0, 15), slice(15, 30)):
        alone = first_order_lag(signal[run], time[run], tau)
        assert found[:, run] == pytest.approx(alone, rel=1e-14)
    assert found[0, 15] == pytest.approx(signal[15], rel=1e-15)


def test_settled_signals_and_infinite_steps() -> None:
    constant = np.full((5, 1), 21.5)
    assert first_order_lag(constant, np.arange(5.0), np.array([3.0]))[0] == pytest.approx(constant)
    far = first_order_lag(np.array([[20.0], [26.0]]), np.array([0.0, np.inf]), np.array([3.0]))
    assert far[0, :, 0] == pytest.approx([20.0, 26.0])
    assert first_order_lag(constant[:1], np.zeros(1), np.array([3.0])).shape == (1, 1, 1)


def test_rows_of_one_moment_are_one_sample() -> None:
    """Their mean, as if it had been read once; without lag every row keeps its own."""
    rng = np.random.default_rng(9)
    time = np.sort(rng.uniform(0, 100, 12))
    signal, tau = rng.normal(size=(12, 2)), np.array([0.0, 7.0])
    count = rng.integers(1, 4, 12)
    off = [0.1 * (np.arange(k) - (k - 1) / 2) for k in count]
    rows = np.concatenate([signal[i] + own[:, None] for i, own in enumerate(off)])
    found = lag_of_moments(rows, np.repeat(time, count), tau)
    assert (found[0] == rows).all()
    once = np.repeat(first_order_lag(signal, time, tau)[1], count, axis=0)
    assert found[1] == pytest.approx(once, rel=1e-12, abs=1e-12)
    equal = lag_of_moments(np.repeat(signal, count, axis=0), np.repeat(time, count), tau)
    assert (equal[1] == once).all()
