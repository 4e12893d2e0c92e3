"""Tails of blocks against a full sort; moments of ordered values against integrals and sums."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, stats

from mtu_cli.stats.block_plan import BlockPlan
from mtu_cli.stats.ordered_moments import ordered_moments
from mtu_cli.stats.ordered_tails import WORTH_IT, OrderedTails

FloatArray = NDArray[np.float64]


def blocks(kind: str, m: int, count: int) -> list[FloatArray]:
    rng = np.random.default_rng(1)
    drawn = [rng.standard_normal((3, m)) for _ in range(count)]
    if kind == "wandering":
        # Each block elsewhere: the cuts of the one before are of no use, or of too much.
        return [x * 10.0 ** (i % 3 - 1) + 50.0 * (-1) ** i for i, x in enumerate(drawn)]
    if kind == "endless":
        # The cut beyond a tail that is all infinite is no number.
        for x in drawn[::2]:
            x[:, : m // 3] = -np.inf
        return drawn
    if kind == "few values":
        return [np.round(x) for x in drawn]
    if kind == "constant":
        return [np.full_like(x, 2.5) for x in drawn]
    return [np.exp(x) for x in drawn] if kind == "skew" else drawn


@pytest.mark.parametrize(
    "kind", ["normal", "skew", "wandering", "few values", "constant", "endless"]
)
@pytest.mark.parametrize("m", [200, WORTH_IT, 8192])
def test_tails_are_those_of_a_full_sort(kind: str, m: int) -> None:
    tails = OrderedTails()
    for block in blocks(kind, m, 6):
        before = block.copy()
        tail = int(0.075 * m)
        with np.errstate(invalid="ignore"):
            lower, upper = tails.of(block, tail)
        ordered = np.sort(block, axis=1)
        assert np.array_equal(lower, ordered[:, :tail])
        assert np.array_equal(upper, ordered[:, ::-1][:, :tail])
        assert np.array_equal(block, before)


def test_other_counts_and_outputs_in_turn() -> None:
    tails = OrderedTails()
    rng = np.random.default_rng(2)
    for outputs, m, tail in ((1, 4000, 300), (1, 4001, 301), (2, 4000, 300), (1, 1500, 1500)):
        block = rng.standard_normal((outputs, m))
        lower, upper = tails.of(block, tail)
        assert np.array_equal(lower, np.sort(block, axis=1)[:, :tail])
        assert np.array_equal(upper, -np.sort(-block, axis=1)[:, :tail])


@pytest.mark.parametrize("dof", [2.5, 4.0, math.inf])
def test_moments_of_ordered_values_by_another_quadrature(dof: float) -> None:
    law = stats.norm() if math.isinf(dof) else stats.t(dof)
    size = 40
    found = ordered_moments(size, 6, dof)
    j = np.arange(2, 7)
    p_of_ordered = stats.beta(j, size - j + 1)

    def integrand(y: float) -> FloatArray:
        density = p_of_ordered.pdf(law.cdf(y)) * law.pdf(y)
        return np.array([y * density, y**2 * density])

    wanted = sum(
        integrate.quad_vec(integrand, *ends, epsrel=1e-8, limit=200)[0]
        for ends in ((-np.inf, 0.0), (0.0, np.inf))
    )
    np.testing.assert_allclose(found[:, 1:], wanted, rtol=1e-6)


def test_the_lowest_of_three_normals() -> None:
    """E y_(1) = -3/(2 sqrt(pi)) and E y_(1)^2 = 1 + sqrt(3)/(2 pi) (David & Nagaraja 2003, 3.2)."""
    mean, square = ordered_moments(3, 1, math.inf)[:, 0]
    # Of three the whole range matters; the table is made for a tail, and ends at p = 0.9975.
    assert mean == pytest.approx(-1.5 / math.sqrt(math.pi), rel=1e-3)
    assert square == pytest.approx(1.0 + math.sqrt(3.0) / (2.0 * math.pi), rel=1e-3)


@pytest.mark.parametrize("dof", [3.0, 8.0, math.inf])
@pytest.mark.parametrize("m", [200, 400])
def test_ends_of_short_blocks_are_unbiased_for_parabolas(m: int, dof: float) -> None:
    """a + b y + c y^2 over 40 000 blocks: the plan's own weights are off by far more."""
    plan = BlockPlan(0.95, m, 10, is_short=True)
    # Blocks of both lengths are made: ten of 200 trials, twenty of 400.
    made = BlockPlan.short({200: 2000, 400: 8000}[m], 0.95)
    assert (made.size, made.is_short) == (plan.size, True)
    (weights,) = plan.unbiased_end_weights(None if math.isinf(dof) else np.array([dof]))
    law = stats.norm() if math.isinf(dof) else stats.t(dof)
    rng = np.random.default_rng(3)
    # The lowest of m rectangular ones: sums of exponentials over their total, of which those
    # beyond the tail count by their sum alone, a gamma variate.
    steps = rng.standard_exponential((40_000, plan.tail))
    beyond = rng.standard_gamma(m + 1 - plan.tail, (40_000, 1))
    p = np.cumsum(steps, axis=1)
    p /= p[:, -1:] + beyond
    y = law.ppf(p)
    q = law.ppf(0.025)
    for c in (0.0, 0.05):
        ends = (y + c * y**2) @ weights
        error = ends.std() / np.sqrt(len(ends))
        assert abs(ends.mean() - (q + c * q**2)) < 4.5 * error
    plain = (y @ plan.end_weights).mean() - q
    if math.isinf(dof) and m == 200:
        assert abs(plain) > 5 * error
