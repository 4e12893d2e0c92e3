"""Signal to noise, rivals and held-out gain of the shop day's oracle, against dense matrices."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from shop_day import (
    FAMILIES,
    MISSHAPEN,
    OUTSIDE,
    Rivals,
    ShopDay,
    Truth,
    effect,
    measure,
    misshapen_effect,
    oracle_held_out,
    outside_effect,
)
from shop_day.day import Floats, Kind
from shop_day.noise import SIG_HOLE, SIG_PART, SIGMA
from shop_day.rivals import rival_columns

KINDS: tuple[Kind, ...] = ("A", "B")


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("family", ["backlash", "squareness", "trend", "part-outlier", "radial"])
def test_signal_to_noise_is_that_of_dense_least_squares(kind: Kind, family: str) -> None:
    day = ShopDay(kind, 3)
    truth = effect(day, family, rng_of(4), 1.3)
    b, precision = dense_fit(truth.columns, truth.errors)
    np.testing.assert_allclose(b, truth.coefficients, rtol=1e-8)
    signal = Rivals(day).signal(truth)
    assert signal is not None
    assert signal.z == pytest.approx(float(np.sqrt(b @ precision @ b)), rel=1e-8)
    assert signal.own_r2 == pytest.approx(1)


def test_best_rival_is_that_of_dense_least_squares() -> None:
    """R^2 of a rival: share of z^2 that the rival's columns take up."""
    day = ShopDay("B", 5)
    truth = effect(day, "wear-approach-x", rng_of(1), 1.0)
    rivals = Rivals(day)
    signal = rivals.signal(truth)
    assert signal is not None
    best = {}
    for name, stacks in rival_columns(day).items():
        if name.startswith(("backlash", "straightness", "abbe", "operation", "rotation")):
            shares = []
            for columns in (member for stack in stacks for member in stack):
                b, precision = dense_fit(columns, truth.errors)
                shares.append(float(b @ precision @ b) / signal.z**2)
            best[name] = max(shares)
    found = rivals.r2(truth.errors)
    for name, share in best.items():
        assert found[name] == pytest.approx(share, abs=1e-8)
    # Most of the wear begins at one part: more of it than is in all parts alike.
    assert best["backlash-step-x"] > best["backlash-x"]
    assert signal.rival == "backlash-step-x"
    assert signal.rival_r2 == pytest.approx(best["backlash-step-x"])
    assert signal.d == pytest.approx(signal.z * np.sqrt(1 - best["backlash-step-x"]))


def of_the_nearest_wave(truth: Truth) -> float:
    """Least R^2: a wave half a step of 1/1040 mm off is out of phase by up to psi = 65 mm *
    2 pi/2080 at the ends, and differs by up to 2 sin(psi/2) of its height.
    """
    height = np.linalg.norm(truth.coefficients)
    lost = (2 * np.sin(65 * np.pi / 2080) * height) ** 2
    return float(1 - lost / np.mean(truth.errors[..., truth.axes[0]] ** 2))


@pytest.mark.parametrize("kind", KINDS)
def test_the_librarys_own_columns_hold_its_effects_and_no_others(kind: Kind) -> None:
    """Own columns explain all, but where a grid or a sensor's noise stands between."""
    day = ShopDay(kind, 6)
    rivals = Rivals(day)
    near = {"warm-up": 0.99, "thermal-drift": 0.97, "cyclic": 0.5}
    for family in FAMILIES:
        for seed in range(3):
            truth = effect(day, family, rng_of(seed), 1.0)
            signal = rivals.signal(truth)
            if family in ("rotation-scatter", "operation-scatter"):
                assert signal is None or signal.own_r2 is None
                continue
            assert signal is not None
            assert signal.own_r2 is not None
            assert signal.own_r2 > near.get(family, 1 - 1e-9)
            assert signal.own_r2 < 1 + 1e-9
            if family == "cyclic":
                assert signal.own_r2 >= of_the_nearest_wave(truth)
    for family in OUTSIDE:
        signal = rivals.signal(outside_effect(day, family, rng_of(1), 1.0))
        assert signal is not None
        assert signal.own_r2 is None
        assert signal.rival_r2 < 0.9
    for family in MISSHAPEN:
        signal = rivals.signal(misshapen_effect(day, family, rng_of(1), 1.0))
        assert signal is not None
        assert signal.own_r2 is not None
        assert 0.4 < signal.own_r2 < 0.999


def slow_held_out(errors: Floats, truths: list[Truth]) -> tuple[float, float]:
    """Mean squares before and after, by dense least squares in each block."""
    columns = np.concatenate([truth.columns for truth in truths])
    before, after = 0.0, 0.0
    for first in (0, 7, 14):
        held = list(range(first, first + 7))
        train = [p for p in range(21) if p not in held]
        b, _ = dense_fit(columns[:, train], errors[train])
        for a in (0, 1):
            rest = errors[held, :, a] - errors[train, :, a].mean()
            along = columns[..., a]
            moved = along[:, held] - along[:, train].mean(axis=(1, 2))[:, None, None]
            before += float(np.sum(rest**2))
            after += float(np.sum((rest - np.einsum("k,kph->ph", b, moved)) ** 2))
    return before / errors.size, after / errors.size


@pytest.mark.parametrize("families", [("cyclic-x",), ("backlash-y", "scale-x")])
def test_held_out_gain_is_that_of_dense_least_squares(families: tuple[str, ...]) -> None:
    day, rng = ShopDay("B", 2), rng_of(1)
    truths = [effect(day, family, rng, 1.0) for family in families]
    errors = measure(day, rng, truths)
    found = oracle_held_out(errors, truths)
    before, after = slow_held_out(errors, truths)
    always = oracle_held_out(errors, truths, always=True)
    assert always.after == pytest.approx(after, rel=1e-9)
    assert found.before == pytest.approx(before, rel=1e-9)
    assert found.after == pytest.approx(after, rel=1e-9)
    assert found.gain == pytest.approx(before - after, rel=1e-6)


def test_an_effect_that_the_training_parts_do_not_show_is_left_out() -> None:
    """A step before the training parts; a warm-up that is over when they begin."""
    day, rng = ShopDay("A", 0), rng_of(3)
    steps = (effect(day, "step-x", rng_of(seed), 1.0) for seed in range(99))
    step = next(found for found in steps if found.searched["at"] == 6.5)
    # Six parts stand off by the jump against the training parts' mean, in the first block.
    wanted = 6 * step.coefficients[0] ** 2 / 21 / 2
    assert oracle_held_out(step.errors, [step]).after == pytest.approx(wanted)
    costs, always = [], []
    for seed in range(40):
        warm = effect(day, "warm-up", rng_of(seed), 1.0)
        errors = measure(day, rng_of(seed), [warm])
        costs.append(oracle_held_out(errors, [warm]).gain)
        always.append(oracle_held_out(errors, [warm], always=True).gain)
    assert min(costs) > -(SIGMA**2) > min(always)
    assert np.mean(costs) > 0
    nothing = oracle_held_out(measure(day, rng), [])
    assert nothing.before == nothing.after == nothing.truth
    loud = effect(day, "operation-scatter", rng, 1.0)
    assert oracle_held_out(measure(day, rng, [loud]), [loud]).gain == 0
