"""The distribution of a sum of inputs against closed forms and plain simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from mtu_cli.stats.copula import bounded_quantile, bounded_rank
from mtu_cli.stats.distributions import Distribution, Kind
from mtu_cli.stats.linear_distribution import LinearDistribution, Term, linear_distribution
from mtu_cli.stats.rank_map import rank_map
from mtu_cli.stats.workspace import Workspace

P = [0.6, 0.9, 0.975, 0.995, 0.9995]


def known(*terms: Term) -> LinearDistribution:
    found = linear_distribution(terms)
    assert found is not None
    return found


def bounded(kind: Kind, share: float, **more: float) -> Distribution:
    return Distribution(kind=kind, u=math.sqrt(share), half_width=1.0, **more)


CLOSED: dict[str, tuple[list[Term], Callable[[float], float]]] = {
    "normal": ([(-2.0, Distribution(kind="normal", u=1.5))], lambda p: 3.0 * float(ndtri(p))),
    "t3": ([(1.0, Distribution(kind="t", u=2.0, dof=3.0))], lambda p: 2.0 * float(stdtrit(3, p))),
    "t17": (
        [(1.0, Distribution(kind="t", u=2.0, dof=17.0))],
        lambda p: 2.0 * float(stdtrit(17, p)),
    ),
    "rectangle": ([(1.0, bounded("rectangular", 1 / 3))], lambda p: 2 * p - 1),
    "triangle": ([(1.0, bounded("triangular", 1 / 6))], lambda p: 1 - math.sqrt(2 * (1 - p))),
    "arcsine": ([(1.0, bounded("arcsine", 1 / 2))], lambda p: math.sin(math.pi * (p - 0.5))),
    "two rectangles": (
        [(1.0, bounded("rectangular", 1 / 3)), (1.0, bounded("rectangular", 1 / 3))],
        lambda p: 2 - math.sqrt(8 * (1 - p)),
    ),
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_forms(name: str) -> None:
    """To 1e-6 in probability: the slope of the quantile at p turns it into that of x."""
    terms, exact = CLOSED[name]
    found = known(*terms)
    for p in P:
        slope = (float(exact(p + 1e-5)) - float(exact(p - 1e-5))) / 2e-5
        assert found.quantile(p) == pytest.approx(float(exact(p)), abs=1e-6 * slope)
        assert found.quantile(1 - p) == pytest.approx(-found.quantile(p), abs=1e-9)


MIXED: list[Term] = [
    (1.0, Distribution(kind="normal", u=0.4, dof=5.0)),
    (-2.0, Distribution(kind="curvilinear-trapezoidal", u=0.5, half_width=0.9, inexact=0.2)),
    (0.5, Distribution(kind="trapezoidal", u=0.7, half_width=1.5, top=0.8)),
    (1.0, Distribution(kind="normal", u=0.3)),
]


def simulated(seed: int, m: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    rng, work = np.random.default_rng(seed), Workspace()
    total, out = np.zeros(m), np.empty(m)
    for c, item in MIXED:
        item.draw(rng, out, work)
        total += c * out
    return total


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


def curved(kind: Kind, share: float, d: float) -> Distribution:
    u = math.sqrt(share * (1.0 + d * d / 3.0))
    return Distribution(kind=kind, u=u, half_width=1.0, inexact=d)


SUMS: dict[str, tuple[list[Term], Callable[[Any], Any]]] = {
    "rectangle and normal": (
        [(1.0, bounded("rectangular", 1 / 3)), (-1.0, Distribution(kind="normal", u=0.05))],
        with_normal(0.05),
    ),
    "two rectangles": (
        [(1.0, bounded("rectangular", 1 / 3)), (0.2, bounded("rectangular", 1 / 3))],
        trapezoid(1.0, 0.2),
    ),
    "inexact by a half": ([(1.0, curved("curvilinear-trapezoidal", 1 / 3, 0.5))], inexact(0.5)),
    "inexact by a tenth": ([(1.0, curved("curvilinear-trapezoidal", 1 / 3, 0.1))], inexact(0.1)),
    "inexact by nearly all": ([(1.0, curved("rectangular", 1 / 3, 0.9))], inexact(0.9)),
    "t3": ([(1.0, Distribution(kind="t", u=1.0, dof=3.0))], lambda x: stdtr(3.0, x)),
    "t5": ([(1.0, Distribution(kind="t", u=1.0, dof=5.0))], lambda x: stdtr(5.0, x)),
}


@pytest.mark.parametrize("name", SUMS)
def test_distribution_functions_of_sums(name: str) -> None:
    """Everywhere, by closed forms: right to 1e-6, as the docstring says."""
    terms, below = SUMS[name]
    found = known(*terms)
    x = np.linspace(0.0, 0.999 * found.at[-1], 20_001)[1:]
    table = ndtr(np.interp(x, found.at, found.score))
    assert np.max(np.abs(table - below(x))) <= 1e-6


def test_a_heavy_tail_beside_a_rectangle() -> None:
    """Out to 30 standard deviations, by the mean of t over the rectangle (midpoint rule)."""
    t, a = Distribution(kind="t", u=1.0, dof=3.0), math.sqrt(3.0)
    found = known((1.0, t), (a, bounded("rectangular", 1 / 3)))
    x = np.array([0.5, 2.0, 5.0, 10.0, 30.0, 60.0])
    beside = a * ((np.arange(20_000) + 0.5) / 10_000 - 1.0)
    exact = np.array([float(np.mean(stdtr(3.0, value - beside))) for value in x])
    assert ndtr(np.interp(x, found.at, found.score)) == pytest.approx(exact, abs=1e-6)
    # Seen from its end: 7e-6 of the probability is beyond 54, not nothing.
    far = found.at[-1]
    assert ndtr(-found.score[-1]) == pytest.approx(
        float(np.mean(stdtr(3.0, beside - far))), rel=0.02
    )


@pytest.mark.parametrize("kind", ["triangular", "trapezoidal"])
def test_inexact_limits_of_other_shapes(kind: Kind) -> None:
    """Against the mean over half-widths of the shape's own ranks, by a fine midpoint rule."""
    top = 0.6 if kind == "trapezoidal" else 0.0
    share = (1.0 + top**2) / 6.0
    shape = bounded(kind, share, top=top)
    own = Distribution(kind=kind, u=shape.u, half_width=1.0, top=top, inexact=0.4)
    found = known((1.0, own))
    x = np.linspace(0.0, 1.395, 101)
    widths = 0.6 + 0.8 * (np.arange(20_000) + 0.5) / 20_000
    exact = [float(np.mean(bounded_rank(shape, value / widths))) for value in x]
    assert ndtr(np.interp(x, found.at, found.score)) == pytest.approx(np.array(exact), abs=1e-6)


SINGLE: dict[str, Distribution] = {
    "rectangular": bounded("rectangular", 1 / 3),
    "triangular": bounded("triangular", 1 / 6),
    "trapezoidal": bounded("trapezoidal", 1.25 / 6, top=0.5),
    "arcsine": bounded("arcsine", 1 / 2),
}


@pytest.mark.parametrize("name", SINGLE)
@pytest.mark.parametrize("dof", [5.0, math.inf])
def test_the_ends_of_a_mapped_shape(name: str, dof: float) -> None:
    shape = SINGLE[name]
    found = rank_map(known((-3.0, shape)), dof)
    q = 3.0 * bounded_quantile(shape, np.array([0.025, 0.975]))
    end = found.scale * (stdtrit(dof, 0.975) if dof < 12 else ndtri(0.975))
    assert found(q) == pytest.approx([-end, end], rel=1e-6)
    assert end == pytest.approx(q[1], rel=1e-6)


@pytest.mark.parametrize("beside", [1e-9, 1e-4, 1e-3])
def test_corners_that_no_series_follows_are_not_known(beside: float) -> None:
    """An arcsine with little beside it has an end that the series would round off."""
    arcsine = (1.0, bounded("arcsine", 1 / 2))
    assert linear_distribution([(1.0, curved("arcsine", 1 / 2, beside))]) is None
    assert linear_distribution([arcsine, (beside, bounded("rectangular", 1 / 3))]) is None
    assert linear_distribution([arcsine, (1.0, Distribution(kind="normal", u=0.02))]) is not None


def test_a_mixture_against_simulation() -> None:
    m = 1_000_000
    x, found = simulated(3, m), known(*MIXED)
    for p in P:
        inside = float(np.mean(x <= found.quantile(p)))
        assert inside == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / m))
    assert found.sigma == pytest.approx(math.sqrt(sum(c * c * d.drawn_variance for c, d in MIXED)))


@pytest.mark.parametrize("dof", [4.0, 9.0, 50.0, math.inf])
def test_mapped_draws_follow_t(dof: float) -> None:
    """Ranks stay, and the mapped draws have the quantiles of the t, and a normal one's variance."""
    m = 400_000
    mapped = rank_map(known(*MIXED), dof)
    x = simulated(5, m)
    z = mapped(x)
    assert np.max(np.abs(z - np.interp(x, mapped.at, mapped.to))) <= 1e-9 * mapped.scale
    assert np.all(np.diff(z[np.argsort(x)]) >= 0.0)
    assert mapped.dof == (dof if dof < 12 else math.inf)
    for p in P:
        q = mapped.scale * float(ndtri(p) if math.isinf(mapped.dof) else stdtrit(mapped.dof, p))
        assert float(np.mean(z <= q)) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / m))
    if math.isinf(mapped.dof):
        error = float((z**2).std()) / math.sqrt(m)
        assert float((z**2).mean()) == pytest.approx(mapped.scale**2, abs=4 * error)


def test_where_it_is_not_known() -> None:
    assert linear_distribution([(1.0, Distribution(kind="t", u=1.0, dof=2.5))]) is None
    assert linear_distribution([(0.0, Distribution(kind="normal", u=1.0))]) is None
    assert linear_distribution([]) is None


def test_scores_rise_within_the_table() -> None:
    found = known(*MIXED)
    assert np.all(np.diff(found.at) > 0.0)
    assert np.all(np.diff(found.score) >= 0.0)
    assert ndtr(found.score[-1]) == pytest.approx(1.0, abs=1.1e-7)
