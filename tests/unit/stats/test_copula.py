"""The correlation behind a Gaussian copula: closed forms and samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtr

from mtu_cli.stats.distributions import (
    Distribution,
    Kind,
    bounded_quantile,
    largest_covariance,
    normal_correlation,
    shape_moments,
)


def item(kind: Kind, top: float = 0.0) -> Distribution:
    u = math.sqrt(shape_moments(kind, top)[0])
    return Distribution(kind=kind, u=u, half_width=1.0, top=top)


NORMAL = Distribution(kind="normal", u=2.0)
SHAPES = [item("rectangular"), item("triangular"), item("arcsine"), item("trapezoidal", 0.4)]


@pytest.mark.parametrize("r", [-0.95, -0.3, 0.5, 0.9])
def test_two_rectangles_in_closed_form(r: float) -> None:
    """Pearson's r = (6/pi) asin(rho/2) for uniform marginals (Pearson 1907)."""
    a = item("rectangular")
    assert normal_correlation(a, a, r / 3) == pytest.approx(2 * math.sin(math.pi * r / 6), abs=1e-6)


def test_a_rectangle_and_a_normal_in_closed_form() -> None:
    """r = rho sqrt(3/pi), so at most 0.977 can be had."""
    a, b = item("rectangular"), NORMAL
    u = 2.0 / math.sqrt(3.0)
    assert normal_correlation(a, b, 0.5 * u) == pytest.approx(
        0.5 * math.sqrt(math.pi / 3), abs=1e-6
    )
    assert normal_correlation(a, b, 0.99 * u) is None


@pytest.mark.parametrize("shape", SHAPES, ids=lambda x: x.kind)
def test_samples_have_the_stated_correlation(shape: Distribution) -> None:
    m, r = 400_000, 0.7
    rho = normal_correlation(shape, shape, r * shape.u**2)
    assert rho is not None
    z = np.random.default_rng(8).standard_normal((2, m))
    z[1] = rho * z[0] + math.sqrt(1 - rho**2) * z[1]
    x = bounded_quantile(shape, np.asarray(ndtr(z)))
    # The standard error of a correlation coefficient is below (1 + r^2)/sqrt(m).
    assert np.asarray(np.corrcoef(x))[0, 1] == pytest.approx(r, abs=4 * 1.5 / math.sqrt(m))


@pytest.mark.parametrize("shape", [*SHAPES, item("trapezoidal", 0.95)], ids=lambda x: x.kind)
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
