"""The least mean square that can be had: the posterior by dense densities, and its limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loop_bench.best import after, meant
from scipy.stats import multivariate_normal
from shop_day import ShopDay, Truth, blocks, effect, measure
from shop_day.noise import SIG_PART, SIGMA

DAY = ShopDay("B", seed=3, parts=12)
KNOWN = meant(DAY, (1.0, 2.0))


def farthest(truth: Truth) -> float:
    """From the nearest of what may be meant, of either sign."""
    signs = np.array([1.0, -1.0])[:, None, None, None]
    off = np.abs(KNOWN.errors[:, None] - signs * truth.errors)
    return float(off.max(axis=(2, 3, 4)).min())


def test_every_effect_of_whole_parts_may_be_meant() -> None:
    assert KNOWN.prior.sum() == pytest.approx(1.0)
    for family in ("step", "trend", "thermal-drift"):
        assert farthest(effect(DAY, family, np.random.default_rng(5), 2.0)) < 1e-9
    truth = effect(DAY, "warm-up", np.random.default_rng(6), 2.0)
    # Between two time constants, 5 % apart.
    assert farthest(truth) < 0.03 * np.abs(truth.errors).max()


def test_the_posterior_mean_by_dense_densities() -> None:
    """Contrasts of the training parts' means: normal with the variance of a part's mean."""
    rng = np.random.default_rng(7)
    errors = measure(DAY, rng, (effect(DAY, "step", rng, 1.0),))
    train, held = next(iter(blocks(DAY.P, 4)))
    few = KNOWN.errors[::17]
    prior = KNOWN.prior[::17] / KNOWN.prior[::17].sum()
    own = replace(KNOWN, errors=few, prior=prior)
    P = len(train)
    contrast = np.linalg.svd(np.ones((1, P)))[2][1:]
    cov = np.eye(P - 1) * (SIG_PART**2 + SIGMA**2 / DAY.H)
    density = np.zeros((2, len(few)))
    for i, sign in enumerate((1.0, -1.0)):
        for j, field in enumerate(few):
            for axis in range(2):
                y = contrast @ (errors[train, :, axis] - sign * field[train, :, axis]).mean(axis=1)
                density[i, j] += multivariate_normal.logpdf(y, np.zeros(P - 1), cov)
    weight = np.exp(density - density.max()) * prior
    weight /= weight.sum()
    mean = np.tensordot(weight[0] - weight[1], few, axes=1)
    rest = errors - mean
    rest = rest[held] - rest[train].mean(axis=(0, 1))
    found = after(errors, own, [(train, held)])
    assert found == pytest.approx(float(np.sum(rest**2)) / errors.size, rel=1e-9)


def test_what_is_certain_is_taken_out() -> None:
    rng = np.random.default_rng(8)
    truth = effect(DAY, "trend", rng, 20.0)
    errors = measure(DAY, rng, (truth,))
    nothing = replace(KNOWN, errors=0 * KNOWN.errors[:1], prior=np.ones(1))
    left = after(errors - truth.errors, nothing, blocks(DAY.P))
    assert after(errors, meant(DAY, (20.0,)), blocks(DAY.P)) == pytest.approx(left, rel=1e-6)
