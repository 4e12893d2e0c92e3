"""The distribution of a sum of inputs against closed forms and plain simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr, stdtr

from mtu_cli.stats.blocks import Workspace
from mtu_cli.stats.distributions import Distribution, Kind, Quantile, Term, sum_quantile


def known(*terms: Term) -> Quantile:
    found = sum_quantile(terms)
    assert found is not None
    return found


def bounded(kind: Kind, share: float, **more: float) -> Distribution:
    return Distribution(kind=kind, u=math.sqrt(share), half_width=1.0, **more)


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
    "inexact by nearly all": ([(1.0, curved("rectangular", 1 / 3, 0.9))], inexact(0.9)),
    "triangle": ([(1.0, bounded("triangular", 1 / 6))], lambda x: 1 - 0.5 * (1 - x) ** 2),
    "arcsine": ([(1.0, bounded("arcsine", 1 / 2))], lambda x: 0.5 + np.arcsin(x) / math.pi),
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
    assert sum_quantile([heavy, (1.0, bounded("rectangular", 1 / 3))]) is None
    assert sum_quantile([(0.0, Distribution(kind="normal", u=1.0))]) is None
    assert sum_quantile([]) is None
    # An arcsine with little beside it has an end that the series would round off.
    arcsine = (1.0, bounded("arcsine", 1 / 2))
    assert sum_quantile([arcsine, (1e-4, bounded("rectangular", 1 / 3))]) is None
    assert sum_quantile([arcsine, (1.0, Distribution(kind="normal", u=0.02))]) is not None
