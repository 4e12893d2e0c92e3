"""The simulator that close-loop is judged with, against plain and independent calculations."""

from __future__ import annotations

import numpy as np
import pytest
from shop_day import (
    FAMILIES,
    MISSHAPEN,
    ONE_AXIS,
    OUTSIDE,
    SIGMA,
    ShopDay,
    Truth,
    effect,
    measure,
    misshapen_effect,
    outside_effect,
)
from shop_day.day import Kind, spindle_rise

KINDS: tuple[Kind, ...] = ("A", "B")
MEAN_FAMILIES = [name for name in FAMILIES if name != "operation-scatter"]


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_makes_the_same_day_and_data(kind: Kind) -> None:
    one, same, other = ShopDay(kind, 5), ShopDay(kind, 5), ShopDay(kind, 6)
    assert list(one.covariates) == [
        "dir_x", "dir_y", "time_min", "sequence", "tool_parts", "T_spindle_degC", "T_part_degC",
        "T_cmm_degC",
    ]  # fmt: skip
    for name, values in one.covariates.items():
        np.testing.assert_array_equal(values, same.covariates[name])
        assert np.broadcast_shapes(values.shape, (one.P, one.H)) == (21, 24)
    assert np.any(one.full("T_part_degC") != other.full("T_part_degC"))
    found = [
        measure(day, rng_of(1), [effect(day, "cyclic", rng_of(2), 1.0)]) for day in (one, same)
    ]
    np.testing.assert_array_equal(found[0], found[1])
    assert np.any(found[0] != measure(one, rng_of(3)))


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
    day = ShopDay("B", 3)
    assert np.argmin(np.diff(day.spindle_rise)) == 6
    noise = [ShopDay("A", s).full("T_spindle_degC")[:, 0] - 20 for s in range(40)]
    sensor = np.array(noise) - [ShopDay("A", s).spindle_rise for s in range(40)]
    assert abs(sensor.std() - 0.2) < 4 * 0.2 / np.sqrt(2 * sensor.size)


def rms_over_affected_axes(truth: Truth) -> float:
    return float(np.sqrt(np.mean(truth.errors[..., list(truth.axes)] ** 2)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("family", MEAN_FAMILIES)
def test_amplitude_name_and_axis(kind: Kind, family: str) -> None:
    day, names, signs = ShopDay(kind, 7), set(), set()
    for seed in range(12):
        truth = effect(day, family, rng_of(seed), 0.7)
        names.add(truth.name)
        assert rms_over_affected_axes(truth) == pytest.approx(0.7 * 3.605551, rel=1e-6)
        np.testing.assert_allclose(truth.errors.mean(axis=(0, 1)), 0, atol=1e-12)
        # The columns with their coefficients are the whole effect.
        whole = np.einsum("k,kpha->pha", truth.coefficients, truth.columns)
        np.testing.assert_allclose(whole - truth.level, truth.errors, atol=1e-9)
        signs.add(float(np.sign(truth.coefficients[0])))
    assert signs == {-1.0, 1.0}
    if family in ONE_AXIS:
        assert names == {f"{family}-x", f"{family}-y"}
        for axis, name in enumerate("xy"):
            asked = effect(day, f"{family}-{name}", rng_of(1), 1.0)
            assert (asked.name, asked.axes) == (f"{family}-{name}", (axis,))
    else:
        assert names == {"squareness-xy" if family == "squareness" else family}


def test_what_some_effects_are_by_hand() -> None:
    day = ShopDay("B", 1)
    wear = effect(day, "wear-approach-y", rng_of(0), 1.0)
    by_hand = wear.coefficients[0] * day.full("tool_parts") * day.full("dir_y")
    np.testing.assert_allclose(wear.errors[..., 1] + wear.level[1], by_hand)
    step = effect(day, "step-x", rng_of(0), 1.0)
    jump = np.diff(step.errors[:, 0, 0])
    assert np.flatnonzero(np.abs(jump) > 1e-9).tolist() == [int(step.searched["at"] - 1.5)]
    assert jump.sum() == pytest.approx(step.coefficients[0])
    warm = effect(day, "warm-up-x", rng_of(3), 1.0)
    time, tau = day.full("time_min")[:, 0], warm.searched["tau_min"]
    lost = warm.coefficients[0] - (warm.errors[:, 0, 0] + warm.level[0])
    np.testing.assert_allclose(np.log(lost / lost[0]), -time / tau, atol=1e-6)
    cyclic = effect(day, "cyclic-x", rng_of(3), 1.0)
    x = day.places[:, 0]
    again = np.flatnonzero(np.isclose(x[:, None] - x[None, :], 0)[0])
    assert np.ptp(cyclic.errors[:, again, 0]) < 1e-9
    growth = effect(day, "thermal-growth", rng_of(5), 1.0)
    assert growth.covariate in ("T_part_degC", "T_cmm_degC")
    over = day.full(growth.covariate) - 20
    whole = growth.errors + growth.level
    for axis in (0, 1):
        by_hand = 1e-3 * growth.coefficients[0] * over * (day.places[:, axis] - 75)
        np.testing.assert_allclose(whole[..., axis], by_hand, atol=1e-9)
    part = effect(day, "part-outlier", rng_of(6), 1.0)
    apart = np.ptp(part.errors, axis=1).max() < 1e-9
    assert apart
    assert len(np.unique(part.errors[:, 0, 0].round(9))) == 2
    turned = effect(day, "rotation-scatter", rng_of(6), 1.0)
    moved = turned.errors + turned.level
    outward = np.einsum("pha,ha->ph", moved, day.places[:, :2] - 75)
    np.testing.assert_allclose(outward, 0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_effects_outside_and_of_another_shape(kind: Kind) -> None:
    day = ShopDay(kind, 9)
    for family in OUTSIDE:
        truth = outside_effect(day, family, rng_of(2), 1.5)
        assert truth.name is None
        assert not truth.exact
        assert rms_over_affected_axes(truth) == pytest.approx(1.5 * SIGMA)
    for family in MISSHAPEN:
        for seed in range(4):
            truth = misshapen_effect(day, family, rng_of(seed), 1.5)
            assert truth.name is not None
            assert truth.name.startswith(family)
            assert rms_over_affected_axes(truth) == pytest.approx(1.5 * SIGMA)
