"""Input distributions: moments in closed form, samples of them."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.special import betainc, fdtrc, ndtr, stdtr, stdtrit

from mtu_cli.stats.blocks import Workspace
from mtu_cli.stats.coverage import (
    coverage_factor,
    numerical_tolerance,
    welch_satterthwaite,
    yao_p,
)
from mtu_cli.stats.distributions import (
    Distribution,
    Kind,
    Quantile,
    Term,
    largest_covariance,
    normal_correlation,
    shape_moments,
    sum_quantile,
)

M = 400_000


def drawn(item: Distribution, seed: int = 1) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    out = np.empty(M)
    item.draw(np.random.default_rng(seed), out, Workspace())
    return out


def shape(kind: Kind, half: float = 1.0, top: float = 0.0, inexact: float = 0.0) -> Distribution:
    """A bounded one, whose u is that of what is drawn."""
    second = shape_moments(kind, top / half)[0] * (1.0 + inexact**2 / 3.0)
    u = half * math.sqrt(second)
    return Distribution(kind=kind, u=u, half_width=half, top=top, inexact=inexact)


SHAPES = [
    shape("rectangular", 2.0),
    shape("triangular", 2.0),
    shape("arcsine", 2.0),
    shape("trapezoidal", 2.0, top=0.5),
    shape("curvilinear-trapezoidal", 2.0, inexact=0.3),
    shape("triangular", 2.0, inexact=0.2),
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
        (shape("rectangular", 2.0), 4 / 3),
        (shape("triangular", 2.0), 4 / 6),
        (shape("arcsine", 2.0), 4 / 2),
        (shape("trapezoidal", 2.0, top=1.0), 4 * 1.25 / 6),
        (shape("curvilinear-trapezoidal", 2.0, inexact=0.25), 4.0**2 / 12 + 0.5**2 / 9),
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


NORMAL = Distribution(kind="normal", u=2.0)


@pytest.mark.parametrize("r", [-0.95, -0.3, 0.5, 0.9])
def test_two_rectangles_in_closed_form(r: float) -> None:
    """Pearson's r = (6/pi) asin(rho/2) for uniform marginals (Pearson 1907)."""
    a = shape("rectangular")
    assert normal_correlation(a, a, r / 3) == pytest.approx(2 * math.sin(math.pi * r / 6), abs=1e-6)


# The most that can be had, E Q_1(U) Q_2(U)/(u_1 u_2), by hand: rectangle and normal sqrt(3/pi);
# rectangle and arcsine sqrt(6) times the integral of (2 p - 1) sin(pi (p - 1/2)) = 4/pi^2;
# rectangle and triangle 3 sqrt(2) times that of (2 p - 1) Q(p) = 7/30.
LARGEST = [
    (shape("rectangular"), NORMAL, math.sqrt(3.0 / math.pi)),
    (shape("rectangular"), shape("arcsine"), math.sqrt(6.0) * 4.0 / math.pi**2),
    (shape("rectangular"), shape("triangular"), 3.0 * math.sqrt(2.0) * 7.0 / 30.0),
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


def test_infinite_degrees_of_freedom() -> None:
    v = np.array([1.0, 3.0])
    assert welch_satterthwaite(v, np.array([math.inf, math.inf])) == math.inf
    assert welch_satterthwaite(v, np.array([5.0, math.inf])) == pytest.approx(5.0 * 16.0)
    assert welch_satterthwaite(np.zeros(2), np.array([5.0, 5.0])) == math.inf
    several = welch_satterthwaite(np.array([[1.0, 0.0], [3.0, 2.0]]), np.array([5.0, math.inf]))
    assert several.tolist() == pytest.approx([5.0 * 16.0, math.inf])


@pytest.mark.parametrize(
    ("probability", "dof", "printed"),
    [
        (0.95, 1, 12.71),
        (0.95, 4, 2.78),
        (0.95, 16, 2.12),
        (0.99, 16, 2.92),
        (0.9545, 10, 2.28),
        (0.9973, 50, 3.16),
        (0.95, math.inf, 1.960),
        (0.99, math.inf, 2.576),
    ],
)
def test_coverage_factor_of_gum_table_g2(probability: float, dof: float, printed: float) -> None:
    digits = 0.0005 if math.isinf(dof) else 0.005
    assert coverage_factor(probability, dof) == pytest.approx(printed, abs=digits)


@pytest.mark.parametrize(
    ("u", "digits", "tolerance"),
    [
        (0.00035, 2, 0.000005),  # JCGM 101:2008, 7.9.2, example 1: 0.35 mg as 35 x 10^-5 g
        (2.0, 1, 0.5),  # example 2: 2 K
        (2.0, 2, 0.05),
        (10.1, 2, 0.5),
        (0.0996, 2, 0.005),  # rounds to 0.10, so 10 x 10^-2
        (9.94, 2, 0.05),
        (0.0, 2, 0.0),
    ],
)
def test_numerical_tolerance(u: float, digits: int, tolerance: float) -> None:
    assert numerical_tolerance(u, digits) == pytest.approx(tolerance, rel=1e-12)


def test_hotelling_of_one_estimate_is_students_t() -> None:
    """And of three it is F of 3 and nu - 2 degrees of freedom."""
    t = float(stdtrit(7.0, 0.975))
    assert yao_p(np.array([t]), np.eye(1), [(np.eye(1), 7.0)]) == pytest.approx(0.05)
    d, V = np.array([2.0, -2.0, 1.0]), np.eye(3)
    assert yao_p(d, V, [(V, 8.0)]) == pytest.approx(float(fdtrc(3, 6, 9.0 * 6 / 24)))
    assert yao_p(d, V, [(V, 2.0)]) == 1.0


# The distribution of a sum of inputs against closed forms and plain simulation.


def known(*terms: Term) -> Quantile:
    found = sum_quantile(terms)
    assert found is not None
    return found


MIXED: list[Term] = [
    (1.0, Distribution(kind="normal", u=0.4, dof=5.0)),
    (-2.0, Distribution(kind="curvilinear-trapezoidal", u=0.5, half_width=0.9, inexact=0.2)),
    (0.5, Distribution(kind="trapezoidal", u=0.7, half_width=1.5, top=0.8)),
    (1.0, Distribution(kind="normal", u=0.3)),
]


def gauss(x: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Any:
    """Integral of Phi up to x."""
    return x * ndtr(x) + np.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)


def with_normal(s: float) -> Callable[[Any], Any]:
    """P(X <= x) of a rectangle of half-width 1 plus a normal of standard deviation s."""
    return lambda x: 0.5 * s * (gauss((x + 1.0) / s) - gauss((x - 1.0) / s))


def trapezoid(a: float, b: float) -> Callable[[Any], Any]:
    """Of two rectangles of half-widths a > b, by parts of the support."""
    return lambda x: (
        1.0
        - np.where(x < a - b, 0.5 - x / (2.0 * a), np.maximum(a + b - x, 0.0) ** 2 / (8.0 * a * b))
    )


def inexact(d: float) -> Callable[[Any], Any]:
    """Of a rectangle whose half-width is rectangular in 1 -+ d: the mean of (1 - x/w)/2 over w."""

    def below(x: Any) -> Any:
        m = np.clip(x, 1.0 - d, 1.0 + d)
        return 1.0 - ((1.0 + d - m) - x * np.log((1.0 + d) / m)) / (4.0 * d)

    return below


SUMS: dict[str, tuple[list[Term], Callable[[Any], Any]]] = {
    "rectangle and normal": (
        [(1.0, shape("rectangular")), (-1.0, Distribution(kind="normal", u=0.05))],
        with_normal(0.05),
    ),
    "two rectangles": (
        [(1.0, shape("rectangular")), (0.2, shape("rectangular"))],
        trapezoid(1.0, 0.2),
    ),
    "inexact by a half": ([(1.0, shape("curvilinear-trapezoidal", inexact=0.5))], inexact(0.5)),
    "inexact by nearly all": ([(1.0, shape("rectangular", inexact=0.9))], inexact(0.9)),
    "triangle": ([(1.0, shape("triangular"))], lambda x: 1 - 0.5 * (1 - x) ** 2),
    "arcsine": ([(1.0, shape("arcsine"))], lambda x: 0.5 + np.arcsin(x) / math.pi),
    "normal": ([(-2.0, Distribution(kind="normal", u=1.5))], lambda x: ndtr(x / 3)),
    "t3": ([(1.0, Distribution(kind="t", u=1.0, dof=3.0))], lambda x: stdtr(3.0, x)),
}


@pytest.mark.parametrize("name", SUMS)
def test_distribution_functions_of_sums(name: str) -> None:
    """Everywhere, by closed forms: right to 1e-6, as the docstring says."""
    terms, below = SUMS[name]
    found = known(*terms)
    p = np.linspace(0.5, 1.0 - 2e-6, 20_001)[1:]
    assert np.max(np.abs(below(found(p)) - p)) <= 1e-6
    assert found(1 - p) == pytest.approx(-found(p), abs=1e-9)


def test_a_mixture_against_simulation() -> None:
    m, found, rng, work = 1_000_000, known(*MIXED), np.random.default_rng(3), Workspace()
    total, out = np.zeros(m), np.empty(m)
    for c, item in MIXED:
        item.draw(rng, out, work)
        total += c * out
    p = np.array([0.6, 0.9, 0.975, 0.995, 0.9995])
    inside = np.mean(total <= found(p)[:, None], axis=1)
    assert np.all(np.abs(inside - p) < 4 * np.sqrt(p * (1 - p) / m))


def test_where_it_is_not_known() -> None:
    heavy = (1.0, Distribution(kind="t", u=1.0, dof=2.5))
    assert sum_quantile([heavy, (1.0, shape("rectangular"))]) is None
    assert sum_quantile([(0.0, Distribution(kind="normal", u=1.0))]) is None
    assert sum_quantile([]) is None
    # An arcsine with little beside it has an end that the series would round off.
    arcsine = (1.0, shape("arcsine"))
    assert sum_quantile([arcsine, (1e-4, shape("rectangular"))]) is None
    assert sum_quantile([arcsine, (1.0, Distribution(kind="normal", u=0.02))]) is not None
