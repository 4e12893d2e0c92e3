"""Input distributions: moments in closed form, samples of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import betainc

from mtu_cli.stats.blocks import Workspace
from mtu_cli.stats.distributions import (
    Distribution,
    Kind,
    largest_covariance,
    normal_correlation,
    shape_moments,
)

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


# The correlation behind a Gaussian copula: closed forms and samples.


def item(kind: Kind, top: float = 0.0) -> Distribution:
    u = math.sqrt(shape_moments(kind, top)[0])
    return Distribution(kind=kind, u=u, half_width=1.0, top=top)


NORMAL = Distribution(kind="normal", u=2.0)
ALIKE = [item("rectangular"), item("triangular"), item("arcsine"), item("trapezoidal", 0.4)]


@pytest.mark.parametrize("r", [-0.95, -0.3, 0.5, 0.9])
def test_two_rectangles_in_closed_form(r: float) -> None:
    """Pearson's r = (6/pi) asin(rho/2) for uniform marginals (Pearson 1907)."""
    a = item("rectangular")
    assert normal_correlation(a, a, r / 3) == pytest.approx(2 * math.sin(math.pi * r / 6), abs=1e-6)


@pytest.mark.parametrize("shape", ALIKE, ids=lambda x: x.kind)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_full_correlation_of_one_shape_is_full(shape: Distribution, sign: float) -> None:
    """r = +-1 between inputs of one shape, whatever their widths: exactly one normal for both."""
    wide = Distribution(
        kind=shape.kind, u=3.0 * shape.u, half_width=3.0 * shape.half_width, top=3.0 * shape.top
    )
    assert normal_correlation(shape, wide, sign * shape.u * wide.u) == sign


# The most that can be had, E Q_1(U) Q_2(U)/(u_1 u_2), by hand: rectangle and normal sqrt(3/pi);
# rectangle and arcsine sqrt(6) times the integral of (2 p - 1) sin(pi (p - 1/2)) = 4/pi^2;
# rectangle and triangle 3 sqrt(2) times that of (2 p - 1) Q(p) = 7/30.
LARGEST = [
    (item("rectangular"), NORMAL, math.sqrt(3.0 / math.pi)),
    (item("rectangular"), item("arcsine"), math.sqrt(6.0) * 4.0 / math.pi**2),
    (item("rectangular"), item("triangular"), 3.0 * math.sqrt(2.0) * 7.0 / 30.0),
]


@pytest.mark.parametrize(("first", "second", "most"), LARGEST)
def test_no_coefficient_is_lowered(first: Distribution, second: Distribution, most: float) -> None:
    """The largest coefficient is had, as is one below it; one a millionth above is refused."""
    unit = first.u * second.u
    assert largest_covariance(first, second) / unit == pytest.approx(most, abs=1e-9)
    rho = normal_correlation(first, second, most * (1.0 - 1e-6) * unit)
    assert rho is not None
    assert 0.99 < rho < 1.0
    for sign in (-1.0, 1.0):
        assert normal_correlation(first, second, sign * most * (1.0 + 1e-6) * unit) is None
        found = normal_correlation(first, second, sign * most * unit)
        assert found == pytest.approx(sign, abs=1e-8)
