"""The simulator that close-loop is judged with, against plain and independent calculations.

That its draws are those of the stored records is a test of the loop's bench.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache

import numpy as np
import pytest
from shop_day import (
    FAMILIES,
    MISSHAPEN,
    NOISES,
    OUTSIDE,
    Noise,
    Rivals,
    ShopDay,
    Truth,
    effect,
    measure,
    misshapen_effect,
    oracle_gain,
    outside_effect,
)
from shop_day.day import Floats, Kind, spindle_rise
from shop_day.noise import REPEATS, SIG_CMM, SIG_HOLE, SIG_PART, SIG_PROCESS, SIGMA
from shop_day.rivals import rival_columns

KINDS: tuple[Kind, ...] = ("A", "B")
rng_of = np.random.default_rng
Maker = Callable[[ShopDay, str, np.random.Generator, float], Truth]
MAKERS: dict[Maker, Collection[str]] = {
    effect: FAMILIES, misshapen_effect: MISSHAPEN, outside_effect: OUTSIDE
}  # fmt: skip


def test_spindle_follows_the_differential_equation() -> None:
    """Against small Euler steps of dT/dt = (12 - T)/72 min running and -T/60 min at rest."""
    run, rest = np.array([20.0, 19.0, 22.0]), np.array([0.0, 150.0, 0.0])
    dt, now, found = 1e-3, 0.0, []
    for running, resting in zip(run, rest, strict=True):
        found.append(now)
        for _ in range(round(running / dt)):
            now += dt * (12.0 - now) / 72.0
        for _ in range(round(resting / dt)):
            now -= dt * now / 60.0
    np.testing.assert_allclose(spindle_rise(run, rest), found, atol=12 * dt / 60)
    assert np.argmin(np.diff(ShopDay("B", 3).spindle_rise)) == 6


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", MAKERS)
def test_size_and_columns_of_effects(kind: Kind, make: Maker) -> None:
    """The rms over the affected axes is as asked for; columns with coefficients are the effect."""
    day = ShopDay(kind, 7)
    for family in MAKERS[make]:
        truths = [make(day, family, rng_of(seed), 0.7) for seed in range(8)]
        if family == "operation-scatter":
            assert not any(truth.errors.any() for truth in truths)
            continue
        for truth in truths:
            rms = np.sqrt(np.mean(truth.errors[..., list(truth.axes)] ** 2))
            assert rms == pytest.approx(0.7 * 3.605551, rel=1e-6)
            np.testing.assert_allclose(truth.errors.mean(axis=(0, 1)), 0, atol=1e-12)
            whole = np.einsum("k,kpha->pha", truth.coefficients, truth.columns)
            np.testing.assert_allclose(whole - truth.level, truth.errors, atol=1e-9)
            assert (truth.name or "").startswith("" if make is outside_effect else family)
        assert {np.sign(truth.coefficients[0]) for truth in truths} == {-1, 1}
    if make is effect:
        assert effect(day, "backlash-y", rng_of(1), 1.0).axes == (1,)


def strata(errors: Floats) -> list[float]:
    """Mean squares (part, hole, interaction) of one axis (P, H), with loops."""
    P, H = errors.shape
    mean = errors.mean()
    rows, cols = errors.mean(axis=1), errors.mean(axis=0)
    part = sum(H * (row - mean) ** 2 for row in rows) / (P - 1)
    hole = sum(P * (col - mean) ** 2 for col in cols) / (H - 1)
    rest = sum((errors[p, h] - rows[p] - cols[h] + mean) ** 2 for p in range(P) for h in range(H))
    return [part, hole, rest / ((P - 1) * (H - 1))]


@pytest.mark.parametrize("noise", NOISES)
def test_variances_by_stratum(noise: Noise) -> None:
    """Expected mean squares within four of their own standard errors over independent days."""
    day, days = ShopDay("A", 0), 60
    data = [measure(day, rng_of(100 + s), noise=noise) for s in range(days)]
    each = np.array([np.mean([strata(e[..., a]) for a in (0, 1)], axis=0) for e in data])
    cell = SIG_PROCESS**2 + SIG_CMM**2 / REPEATS
    cell *= {"noisy-axis": 2.5, "noisy-operation": 1.75}.get(noise, 1.0)
    # An outlier's mean square is (20^2 + 20*60 + 60^2)/3, on one cell in a hundred.
    cell += 0.01 * (20**2 + 20 * 60 + 60**2) / 3 if noise == "outliers" else 0.0
    hole = 1.5 if noise == "hole-errors" else SIG_HOLE
    wanted = np.array([cell + 24 * SIG_PART**2, cell + 21 * hole**2, cell])
    error = each.std(axis=0, ddof=1) / np.sqrt(days)
    assert np.all(np.abs(each.mean(axis=0) - wanted) < 4 * error)
    # The test can tell: the standard errors are small beside what the kinds of noise differ by.
    assert np.all(error < [0.08 * wanted[0], 0.08 * wanted[1], 0.04 * wanted[2]])


# What an oracle knows, against dense matrices.


@cache
def dense_inverse(P: int, H: int) -> Floats:
    """Inverse covariance of one axis' cells, in the order of the raveled table."""
    V = SIGMA**2 * np.eye(P * H)
    V += SIG_PART**2 * np.kron(np.eye(P), np.ones((H, H)))
    V += SIG_HOLE**2 * np.kron(np.ones((P, P)), np.eye(H))
    return np.asarray(np.linalg.inv(V))


def dense_fit(columns: Floats, errors: Floats) -> tuple[Floats, Floats]:
    """Generalised least squares of (k, P, H, 2) on (P, H, 2), with an offset for each axis.

    Coefficients (k,), and their precision matrix with the offsets fitted beside them.
    """
    k, P, H, _ = columns.shape
    W = dense_inverse(P, H)
    X = np.zeros((2, P * H, k + 2))
    for a in (0, 1):
        X[a, :, :k] = columns[..., a].reshape(k, -1).T
        X[a, :, k + a] = 1
    normal = sum(X[a].T @ W @ X[a] for a in (0, 1))
    right = sum(X[a].T @ W @ errors[..., a].ravel() for a in (0, 1))
    precision = np.linalg.inv(np.linalg.inv(normal)[:k, :k])
    return np.linalg.solve(normal, right)[:k], precision


@pytest.mark.parametrize("family", ["backlash", "squareness", "part-outlier", "wear-approach-x"])
def test_signal_and_rivals_are_those_of_dense_least_squares(family: str) -> None:
    """R^2 of a rival: share of z^2 that the rival's columns take up."""
    day = ShopDay("B", 5)
    truth, rivals = effect(day, family, rng_of(1), 1.0), Rivals(day)
    b, precision = dense_fit(truth.columns, truth.errors)
    np.testing.assert_allclose(b, truth.coefficients, rtol=1e-8)
    signal = rivals.signal(truth)
    assert signal is not None
    assert signal.z == pytest.approx(float(np.sqrt(b @ precision @ b)), rel=1e-8)
    found = rivals.r2(truth.errors)
    assert found[truth.name or ""] == pytest.approx(1)
    for name in ("backlash-x", "straightness-y", "operation-x", "rotation-z"):
        fits = [dense_fit(m, truth.errors) for stack in rival_columns(day)[name] for m in stack]
        best = max(float(b @ precision @ b) for b, precision in fits) / signal.z**2
        assert found[name] == pytest.approx(best, abs=1e-8)
    assert signal.rival_r2 == max(r2 for name, r2 in found.items() if name != truth.name)
    assert signal.d == pytest.approx(signal.z * np.sqrt(1 - found[signal.rival]))


@pytest.mark.parametrize("family", ["cyclic-x", "squareness"])
def test_held_out_gain_is_that_of_dense_least_squares(family: str) -> None:
    """Level of the training parts and effect are taken out along the effect's axes alone."""
    day, rng = ShopDay("B", 2), rng_of(1)
    truth = effect(day, family, rng, 1.0)
    errors, after = measure(day, rng, [truth]), 0.0
    for first in (0, 7, 14):
        held = list(range(first, first + 7))
        train = [p for p in range(21) if p not in held]
        b, _ = dense_fit(truth.columns[:, train], errors[train])
        for a in (0, 1):
            rest = errors[held, :, a]
            if a in truth.axes:
                along = truth.columns[..., a]
                moved = along[:, held] - along[:, train].mean(axis=(1, 2))[:, None, None]
                rest = rest - errors[train, :, a].mean() - np.einsum("k,kph->ph", b, moved)
            after += float(np.sum(rest**2))
    expected = np.mean(errors**2), after / errors.size
    assert oracle_gain(errors, truth, 3) == pytest.approx(expected, rel=1e-9)
