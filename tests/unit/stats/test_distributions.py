"""Input distributions: moments in closed form, samples of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import betainc

from mtu_cli.stats.distributions import (
    Distribution,
    Kind,
    shape_moments,
)
from mtu_cli.stats.workspace import Workspace

M = 400_000


def drawn(item: Distribution, seed: int = 1) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    out = np.empty(M)
    item.draw(np.random.default_rng(seed), out, Workspace())
    return out


def shape(kind: Kind, top: float = 0.0, inexact: float = 0.0) -> Distribution:
    second = shape_moments(kind, top / 2.0)[0]
    return Distribution(
        kind=kind, u=2.0 * math.sqrt(second), half_width=2.0, top=top, inexact=inexact
    )


SHAPES = [
    shape("rectangular"),
    shape("triangular"),
    shape("arcsine"),
    shape("trapezoidal", top=0.5),
    shape("curvilinear-trapezoidal", inexact=0.3),
    shape("triangular", inexact=0.2),
]


@pytest.mark.parametrize("item", SHAPES, ids=lambda x: f"{x.kind}-{x.top}-{x.inexact}")
def test_moments_of_samples(item: Distribution) -> None:
    """Second and fourth moment within four standard errors of their own."""
    x = drawn(item)
    for power, expected in (
        (1, 0.0),
        (2, item.drawn_variance),
        (4, (item.excess + 3.0) * item.drawn_variance**2),
    ):
        error = float((x**power).std()) / math.sqrt(M)
        assert float((x**power).mean()) == pytest.approx(expected, abs=4 * error)
    assert np.abs(x).max() <= 2.0 * (1.0 + item.inexact)


def test_variances_of_jcgm_101() -> None:
    """6.4.2: a^2/3; 6.4.5: a^2/6; 6.4.6: a^2/2; 6.4.4: a^2 (1 + beta^2)/6, with a = 2; 6.4.3:
    (b - a)^2/12 + d^2/9, ends at a -+ d.
    """
    for item, variance in (
        (shape("rectangular"), 4 / 3),
        (shape("triangular"), 4 / 6),
        (shape("arcsine"), 4 / 2),
        (shape("trapezoidal", top=1.0), 4 * 1.25 / 6),
        (shape("curvilinear-trapezoidal", inexact=0.25), 4.0**2 / 12 + 0.5**2 / 9),
    ):
        assert item.drawn_variance == pytest.approx(variance)


@pytest.mark.parametrize("dof", [3.0, 30.0])
def test_scaled_t(dof: float) -> None:
    """6.4.9: the distribution function of the draws is that of u t_nu (Kolmogorov's bound)."""
    item = Distribution(kind="normal", u=0.5, dof=dof)
    t = np.sort(drawn(item)) / 0.5
    tail = 0.5 * betainc(0.5 * dof, 0.5, dof / (dof + t * t))
    F = np.where(t > 0, 1.0 - tail, tail)
    distance = np.abs(F - (np.arange(M) + 0.5) / M).max()
    # Exceeded with probability 2 exp(-2 * 1.95^2) = 0.001.
    assert distance < 1.95 / math.sqrt(M)
    assert item.drawn_variance == pytest.approx(0.25 * dof / (dof - 2))
    assert math.isnan(Distribution(kind="t", u=1.0, dof=2.0).drawn_variance)
