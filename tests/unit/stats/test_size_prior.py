"""Evidence of effects of unknown size: by numerical integration over size, coefficient, scatter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from mtu_cli.stats.profile_ratio import MemberRatios
from mtu_cli.stats.size_prior import SIZES, WEIGHTS, sized

N = 9
RNG = np.random.default_rng(4)
X = RNG.normal(size=N)


def members(y: np.ndarray, ratio: float | None = None) -> MemberRatios:
    """One column X of data with zero mean and N degrees of freedom."""
    left = y @ y - (X @ y) ** 2 / (X @ X)
    found = N * np.log(y @ y / left) if ratio is None else ratio
    return MemberRatios(
        ratio=np.array([[found]]),
        log_bayes=np.zeros((1, 1)),
        dof=np.array([[float(N)]]),
        information=np.array([[X @ X * N / left]]),
    )


def tau_of(y: np.ndarray, t: float) -> np.ndarray:
    """t in units of the scatter that X leaves."""
    left = y @ y - (X @ y) ** 2 / (X @ X)
    return np.array([t * np.sqrt(left / N)])


@pytest.mark.parametrize("effect", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("t", [0.4, 3.0])
def test_factor_and_share_by_integration_over_coefficient_and_scatter(
    effect: float, t: float
) -> None:
    """beta ~ N(0, (s t sigma)^2), sigma with the density 1/sigma, s on its values."""
    y = effect * X + RNG.normal(size=N)
    b = float(X @ y / (X @ X))
    log_sigma = np.linspace(-3, 3, 301)[:, None]
    sigma = np.exp(log_sigma)
    # Wherever the likelihood is more than nothing, in steps finer than the narrowest prior.
    beta = b + sigma / np.sqrt(X @ X) * np.linspace(-12, 12, 2401)
    rest = (y @ y - 2 * beta * (X @ y) + beta**2 * (X @ X)) / sigma**2
    likelihood = np.exp(-N * log_sigma - 0.5 * rest) * (beta[:, 1] - beta[:, 0])[:, None]
    nothing = np.sum(np.exp(-N * log_sigma - 0.5 * (y @ y) / sigma**2))
    factor = mean = 0.0
    for s, weight in zip(SIZES, WEIGHTS, strict=True):
        wide = s * t * sigma
        joint = likelihood * np.exp(-0.5 * (beta / wide) ** 2) / (np.sqrt(2 * np.pi) * wide)
        factor += weight * joint.sum() / nothing
        mean += weight * (joint * beta).sum() / nothing
    found = sized(members(y), np.ones(1), tau_of(y, t))
    # The range of sigma cuts a thousandth off.
    assert np.exp(found.log_bayes[0]) == pytest.approx(factor, rel=1e-3)
    assert found.believed[0] * b == pytest.approx(mean / factor, rel=1e-3)


def test_values_of_s_make_students_t_of_three_degrees_of_freedom() -> None:
    """A factor of two apart: within a fifth of its density from the middle to the far tails."""
    for z in (0.3, 1.0, 3.0, 10.0, 100.0):
        mixture = WEIGHTS @ (np.exp(-0.5 * (z / SIZES) ** 2) / SIZES) / np.sqrt(2 * np.pi)
        assert mixture == pytest.approx(student.pdf(z, 3), rel=0.2)


def test_strong_effects_are_believed_and_hidden_ones_are_not() -> None:
    y = 20.0 * X + RNG.normal(size=N)
    strong = sized(members(y), np.ones(1), tau_of(y, 2.0))
    assert strong.believed[0] > 0.98
    assert strong.log_bayes[0] > 10
    # The same likelihood ratio of a column that would be huge elsewhere: tau is small.
    hidden = sized(members(y), np.ones(1), tau_of(y, 1e-3))
    assert hidden.believed[0] < 0.02
    assert hidden.log_bayes[0] < 0.2


def test_bounds() -> None:
    y = X + RNG.normal(size=N)
    none = sized(members(y, ratio=-1.0), np.ones(1), tau_of(y, 1.0))
    assert none.log_bayes[0] == -np.inf
    without_scatter = sized(members(y), np.ones(1), np.array([np.inf]))
    assert without_scatter.believed[0] == pytest.approx(1.0)
    assert np.isfinite(without_scatter.log_bayes[0])
