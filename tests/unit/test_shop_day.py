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


@pytest.mark.parametrize("kind", KINDS)
def test_holes_stand_around_the_square(kind: Kind) -> None:
    day = ShopDay(kind, 2)
    x, y = day.places[:, 0], day.places[:, 1]
    on_side = (np.isclose(x, 10) | np.isclose(x, 140)) | (np.isclose(y, 10) | np.isclose(y, 140))
    assert on_side.all()
    assert day.places[:, :2].min() >= 10
    assert day.places[:, :2].max() <= 140
    assert len(np.unique(day.places[:, :2].round(6), axis=0)) == 24
    assert sorted(day.places[:, 2]) == [0.0] * 12 + [25.0] * 12
    # Neighbours are 520/24 mm apart along the way, in B by up to 14 mm more or less.
    step = np.abs(np.diff(day.places[:, :2], axis=0)).sum(axis=1)
    assert np.abs(step - 520 / 24).max() <= (1e-9 if kind == "A" else 14.0)
    assert (kind == "A") == (step.std() < 1e-9)


def test_directions_are_those_of_the_travel() -> None:
    fixed, turning = ShopDay("A", 1), ShopDay("B", 1)
    travel = np.diff(fixed.places[:, :2], axis=0)
    for axis, name in enumerate(("dir_x", "dir_y")):
        assert fixed.covariates[name].shape == (1, 24)
        moving = np.abs(travel[:, axis]) > 1e-9
        # The move away from a hole runs along the hole's side, in the direction of that side.
        np.testing.assert_array_equal(
            np.sign(travel[moving, axis]), fixed.covariates[name][0, :-1][moving]
        )
        alternating = turning.covariates[name]
        np.testing.assert_array_equal(alternating[1:], -alternating[:-1])
        assert set(np.unique(alternating)) == {-1.0, 1.0}


def test_schedule_breaks_and_tools() -> None:
    for kind, breaks in (("A", {4: 15, 9: 45, 15: 15}), ("B", {6: 150, 13: 90})):
        day = ShopDay("A" if kind == "A" else "B", 4)
        gaps = np.diff(day.full("time_min")[:, 0])
        rest = np.array([breaks.get(p, 0) for p in range(20)])
        assert np.all(np.abs(gaps - rest - 20) <= 3)
        assert gaps.std() > 0.5
        np.testing.assert_array_equal(day.full("sequence")[:, 0], np.arange(1, 22))
    np.testing.assert_array_equal(ShopDay("A", 0).full("tool_parts")[:, 0], np.arange(21))
    tools = [*range(8), *range(5), *range(8)]
    np.testing.assert_array_equal(ShopDay("B", 0).full("tool_parts")[:, 0], tools)


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


def test_squareness_takes_all_three_references() -> None:
    day = ShopDay("A", 1)
    found = {effect(day, "squareness", rng_of(seed), 1.0).axes for seed in range(20)}
    assert found == {(0,), (1,), (0, 1)}
    for seed in range(20):
        truth = effect(day, "squareness", rng_of(seed), 1.0)
        for axis in truth.axes:
            along = day.places[:, 1 - axis]
            r = np.corrcoef(truth.errors[0, :, axis], along)[0, 1]
            assert abs(r) == pytest.approx(1)


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


def test_smooth_field_has_its_length() -> None:
    """Correlation exp(-d^2/(2 40^2)): 0.864 for neighbours 21.7 mm apart on a side."""
    day = ShopDay("A", 0)
    fields = np.array(
        [outside_effect(day, "smooth-field", rng_of(s), 1.0).errors[0] for s in range(900)]
    )
    left, right = fields[:, 2], fields[:, 3]
    # Both lose the field's mean over all holes: compare with the field's own covariance, centred.
    apart = np.linalg.norm(day.places[:, None, :2] - day.places[None, :, :2], axis=-1)
    K = np.exp(-0.5 * (apart / 40) ** 2)
    M = np.eye(24) - 1 / 24
    C = M @ K @ M
    wanted = C[2, 3] / np.sqrt(C[2, 2] * C[3, 3])
    found = np.sum(left * right) / np.sqrt(np.sum(left**2) * np.sum(right**2))
    assert abs(found - wanted) < 4 * (1 - wanted**2) / np.sqrt(left.size)


@pytest.mark.parametrize("kind", KINDS)
def test_bends_hold_no_straight_line_of_their_own(kind: Kind) -> None:
    """The third order and a kink; the second is a parabola about the holes' mean."""
    day = ShopDay(kind, 4)
    for family, along in (("curvature-x", 0), ("straightness-x", 1)):
        truth = effect(day, family, rng_of(1), 1.0)
        place = day.places[:, along] - day.places[:, along].mean()
        second, third = truth.columns[:, 0, :, 0]
        assert abs(third @ place) < 1e-9
        np.testing.assert_allclose(np.polyfit(place, third, 3)[[1, 3]], 0, atol=1e-12)
        np.testing.assert_allclose(second, (place / 65) ** 2, atol=1e-12)
        kinked = misshapen_effect(day, family, rng_of(1), 1.0).errors[0, :, 0]
        assert abs(kinked @ place) < 1e-9
        assert np.abs(np.polyval(np.polyfit(place, kinked, 3), place) - kinked).max() > 0.1
