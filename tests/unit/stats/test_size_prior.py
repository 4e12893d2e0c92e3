"""Evidence of effects of unknown size: by numerical integration over size, coefficient, scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from mtu_cli.close_loop_sealed.stats.profile_ratio import MemberRatios
from mtu_cli.close_loop_sealed.stats.size_prior import CERTAIN, SIZES, WEIGHTS, sized

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


@pytest.mark.parametrize(
    ("tau", "information", "g"),
    [
        # s = 1/4 has the smallest g: that of tau = 4 is given.
        (4.0, 0.25, 0.25),
        (4e150, 2.5e-301, 0.25),
        (4e-150, 2.5e299, 0.25),
        (1e150, 1e200, CERTAIN),
        (1e300, 1e300, CERTAIN),
        (1.0, np.inf, CERTAIN),
        (np.inf, 1e-300, CERTAIN),
        # Without information nothing is believed, however large it may be.
        (np.inf, 0.0, 0.0),
        (1e150, 0.0, 0.0),
        (0.0, np.inf, 0.0),
        (1e-170, 1e-170, 0.0),
    ],
)
def test_sizes_whose_squares_are_no_numbers(tau: float, information: float, g: float) -> None:
    """Warnings are errors here."""
    y = X + RNG.normal(size=N)
    extreme = replace(members(y), information=np.array([[information]]))
    found = sized(extreme, np.ones(1), np.array([tau]))
    ratio = float(extreme.ratio[0, 0])
    given = np.minimum((4 * SIZES) ** 2 * g, CERTAIN)
    factors = (N - 1) / 2 * np.log1p(given) - N / 2 * np.log1p(given * np.exp(-ratio / N))
    weights = WEIGHTS * np.exp(factors)
    assert found.log_bayes[0] == pytest.approx(np.log(weights.sum()), rel=1e-9, abs=1e-12)
    believed = weights @ (given / (1 + given)) / weights.sum()
    assert found.believed[0] == pytest.approx(believed, rel=1e-9)
