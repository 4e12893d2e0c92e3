"""Covariances of thermal models against many simulated drift tests with the same temperatures."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_drift import UM, Plan, one

from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.stats.least_squares import FloatArray

STRONG = np.array([[3.0, 2.0, 4.0], [5.0, 1.5, 2.0]])
PLACES = (50.0, 250.0)


def drawn(plan: Plan, draws: int, method: str = "ridge") -> list[ThermalEstimate]:
    """Fits of data sets that differ in their noise alone."""
    T = plan.temperatures(np.random.default_rng(41))
    return [
        one(plan.read(np.random.default_rng(1000 + k), T), method).estimate for k in range(draws)
    ]


def moments(found: list[ThermalEstimate]) -> tuple[FloatArray, FloatArray]:
    """Covariance of the coefficients as seen, and the mean of the reported ones; um^2."""
    b = np.array([item.coefficients.ravel() for item in found]) / UM
    C = np.array([item.covariance for item in found]) / UM**2
    return np.cov(b.T), C.mean(axis=0)


@pytest.mark.parametrize("method", ["stepwise", "ridge"])
def test_coefficients_scatter_as_their_covariance_says(method: str) -> None:
    """Independent noise, one cycle (no penalty), all sensors far beyond doubt."""
    draws = 120
    plan = Plan(gradients=STRONG, positions=PLACES, cycles=1, n=60, noise=0.3)
    found = drawn(plan, draws, method)
    assert {item.degree for item in found} == {1}
    seen, reported = moments(found)
    # Each element of a sample covariance has the variance (C_ij^2 + C_ii C_jj)/draws.
    error = np.sqrt((reported**2 + np.outer(np.diag(reported), np.diag(reported))) / draws)
    # The residuals' own autocorrelation, -used/n on average, is taken as 0 where negative only:
    # their scale is too large by E max(r, 0), which is 0.4/sqrt(n).
    assert (np.abs(seen - reported) < 4.5 * error + 0.8 / np.sqrt(120) * np.abs(reported)).all()
    planted = np.array([STRONG[0] - 0.25 * (STRONG[1] - STRONG[0]), (STRONG[1] - STRONG[0]) / 200])
    b = np.array([item.coefficients.ravel() for item in found]) / UM
    assert (np.abs(b.mean(axis=0) - planted.ravel()) < 4.5 * np.sqrt(np.diag(seen) / draws)).all()


def test_intervals_of_a_drift_cover_it() -> None:
    """The drift in the middle of the axis, of readings that follow each other."""
    plan = Plan(gradients=STRONG, positions=PLACES, cycles=1, n=100, noise=0.3, noise_memory=0.5)
    inside = []
    x = np.kron([1.0, 150.0], [3.0, 2.0, 2.5])
    truth = STRONG.mean(axis=0) @ [3.0, 2.0, 2.5]
    for item in drawn(plan, 100):
        u = np.sqrt(x @ item.covariance @ x) / UM
        inside.append(abs(x @ item.coefficients.ravel() / UM - truth) < 1.96 * u)
    assert np.mean(inside) > 0.95 - 4 * np.sqrt(0.05 * 0.95 / 100)


def test_a_slow_misfit_is_the_leftover() -> None:
    """A level and a slope that each follow themselves: leftover is their covariance at one step.

    Of the effective number of residuals the fit takes the share used/number with it.
    """
    draws, memory = 60, 0.8
    slow = (0.5, 0.004)
    plan = Plan(gradients=STRONG, positions=PLACES, cycles=1, n=1500, slow=slow, memory=memory)
    found = [item.leftover / UM**2 for item in drawn(plan, draws)]
    planted = np.diag(np.square(slow)) * memory
    taken = 2 * 5 / (1500 * (1 - memory) / (1 + memory))
    mean, error = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(draws)
    assert (np.abs(mean - planted) < 4 * error + taken * planted).all()
