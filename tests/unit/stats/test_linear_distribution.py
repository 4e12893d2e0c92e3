"""The distribution of a sum of inputs against closed forms and plain simulation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr, ndtri, stdtrit

from mtu_cli.stats.distributions import Distribution, Kind
from mtu_cli.stats.linear_distribution import (
    LinearDistribution,
    Term,
    linear_distribution,
    rank_map,
)
from mtu_cli.stats.workspace import Workspace

P = [0.6, 0.9, 0.975, 0.995]


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
    """To 2e-4 of the standard deviation: a fifth of a fifth of the tolerance of two digits."""
    terms, exact = CLOSED[name]
    found = known(*terms)
    for p in P:
        assert found.quantile(p) == pytest.approx(float(exact(p)), abs=2e-4 * found.sigma)
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


def test_a_mixture_against_simulation() -> None:
    m = 1_000_000
    x, found = simulated(3, m), known(*MIXED)
    for p in P:
        inside = float(np.mean(x <= found.quantile(p)))
        assert inside == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / m))
    assert found.sigma == pytest.approx(math.sqrt(sum(c * c * d.drawn_variance for c, d in MIXED)))


@pytest.mark.parametrize("dof", [4.0, 9.0, 50.0, math.inf])
def test_mapped_draws_follow_t(dof: float) -> None:
    """Ranks stay, and the mapped draws have the t's quantiles and the stated variance."""
    m = 400_000
    mapped = rank_map(known(*MIXED), dof)
    x = simulated(5, m)
    z = mapped(x)
    assert z == pytest.approx(np.interp(x, mapped.at, mapped.to), abs=1e-9 * mapped.scale)
    assert np.all(np.diff(z[np.argsort(x)]) >= 0.0)
    assert mapped.dof == (dof if dof < 12 else math.inf)
    for p in P:
        q = mapped.scale * float(ndtri(p) if math.isinf(mapped.dof) else stdtrit(mapped.dof, p))
        assert float(np.mean(z <= q)) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / m))
    error = float((z**2).std()) / math.sqrt(m)
    assert float((z**2).mean()) == pytest.approx(mapped.variance, abs=4 * error)
    if math.isinf(mapped.dof):
        assert mapped.variance == pytest.approx(mapped.scale**2, rel=1e-4)


def test_where_it_is_not_known() -> None:
    assert linear_distribution([(1.0, Distribution(kind="t", u=1.0, dof=2.5))]) is None
    assert linear_distribution([(0.0, Distribution(kind="normal", u=1.0))]) is None
    assert linear_distribution([]) is None


def test_scores_rise_within_the_table() -> None:
    found = known(*MIXED)
    assert np.all(np.diff(found.at) > 0.0)
    assert np.all(np.diff(found.score) >= 0.0)
    assert ndtr(found.score[-1]) == pytest.approx(1.0, abs=1.1e-7)
