"""How far apart effects are predicted to be, against dense least squares and an oracle."""

from __future__ import annotations

import numpy as np
import pytest
from separation_examples import (
    dense_d2,
    index,
    members_of,
    parts_basis,
    prepared_day,
    with_variances,
)
from shop_day import Rivals, ShopDay
from shop_day.day import Floats
from shop_day.noise import SIG_HOLE, SIG_PART, SIGMA
from shop_day.oracle import whitened

from mtu_cli.close_loop_sealed.analyses.loop.experiment import Choice, choice
from mtu_cli.close_loop_sealed.analyses.loop.prepare import Prepared

VARIANCES = (
    np.array([11e-6, 17e-6]),
    np.array([0.5e-6, 2e-6]),
    np.array([[90e-6, 5e-6, 0.0, 3e-6], [150e-6, 1e-6, 2e-6, 8e-6]]),
)
"""Of entries, columns and parts (offset, along x, y, z), mm^2."""
P, K = 5, 6


def small() -> tuple[Prepared, ShopDay]:
    return with_variances(prepared_day("A", 4, P), *VARIANCES), ShopDay("A", 4, P)


def weighed(
    prepared: Prepared, pair: tuple[str, str], best: list[int], beta: list[float]
) -> Choice:
    own = [index(prepared, name) for name in pair]
    return choice(
        prepared,
        {i: np.array([b]) for i, b in zip(own, beta, strict=True)},
        dict(zip(own, (0.7, 0.3), strict=True)),
        dict(zip(own, best, strict=True)),
    )


def dense_d(basis: Floats, truths: list[Floats], rivals: list[list[Floats]], axis: int) -> float:
    """The posterior is 0.7 and 0.3; rivals[i] are the members of what truths[i] is."""
    squares = [
        dense_d2({axis: truth}, [[{axis: m}] for m in rivals[1 - i]], basis, VARIANCES)
        for i, truth in enumerate(truths)
    ]
    # Of an alias nothing is left but the rounding of either sign.
    return float(np.sqrt(max(0.7 * squares[0] + 0.3 * squares[1], 0.0)))


@pytest.mark.parametrize("plan", ["now", "more", "reverse", "height"])
def test_of_columns_d_is_that_of_dense_least_squares(plan: str) -> None:
    prepared, day = small()
    best = [members_of(prepared, name)[0] for name in ("backlash-y", "abbe-y")]
    lost, tilt = 3e-3, 2.5e-4
    found = weighed(prepared, ("backlash-y", "abbe-y"), best, [lost, tilt])
    assert found.experiment is not None
    rows = P if plan == "now" else P + K
    direction = np.broadcast_to(day.covariates["dir_y"], (rows, day.H)).copy()
    z = np.broadcast_to(day.places[:, 2], (rows, day.H)).copy()
    if plan == "reverse":
        direction[P:] *= -1
    if plan == "height":
        z[P:] = 25.0 - z[P:]
    basis = parts_basis(day.places)
    wanted = dense_d(basis, [lost * direction, tilt * z], [[direction], [z]], 1)
    got = found.experiment.now_d if plan == "now" else dict(found.separations)[plan]
    # d^2 is a small difference of large numbers where one is the alias of the other.
    assert got**2 == pytest.approx(wanted**2, rel=1e-8, abs=1e-6)


@pytest.mark.parametrize("plan", ["more", "cold", "new-tool"])
def test_of_parts_d_is_that_of_dense_least_squares(plan: str) -> None:
    prepared, day = small()
    warm, trend = members_of(prepared, "warm-up-x"), members_of(prepared, "trend-x")
    taus = [prepared.members[m].searched["tau_min"] for m in warm]
    rise, slope = 30e-3, 6e-3
    found = weighed(prepared, ("warm-up-x", "trend-x"), [warm[7], trend[0]], [rise, slope])
    began = day.covariates["time_min"][:, 0]
    step = np.median(np.diff(began))
    goes_on = began[-1] + step * np.arange(1, K + 1)
    time = np.concatenate([began, np.resize(began, K) if plan == "cold" else goes_on])
    count = np.arange(1.0, P + K + 1)
    of_tool = np.where(count > P, count - P, count) if plan == "new-tool" else count

    def over(values: Floats) -> Floats:
        return values[:, None] * np.ones(day.H)

    truths = [rise * over(1 - np.exp(-time / taus[7])), slope * over(of_tool)]
    taus += np.geomspace(np.ptp(time) / 50, 2 * np.ptp(time), 12).tolist()
    rivals = [[over(1 - np.exp(-time / tau)) for tau in taus], [over(count), over(of_tool)]]
    wanted = dense_d(parts_basis(day.places), truths, rivals, 0)
    assert dict(found.separations)[plan] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("plan", ["more", "shift-x", "stagger-x"])
def test_short_waves_that_the_old_places_hid_are_rivals_of_a_shift(plan: str) -> None:
    """On a regular pitch of holes a wave looks like shorter ones; shifted it need not."""
    prepared, day = with_variances(prepared_day("A", 4), *VARIANCES), ShopDay("A", 4)
    (grows,), waves = members_of(prepared, "scale-x"), members_of(prepared, "cyclic-x")
    pitch = 22.0
    wave = min(waves, key=lambda m: abs(prepared.members[m].searched["pitch_mm"] - pitch))
    pitch = prepared.members[wave].searched["pitch_mm"]
    own, other = index(prepared, "scale-x"), index(prepared, "cyclic-x")
    beta = {own: np.array([2e-4]), other: np.zeros(2)}
    best = {own: grows, other: wave}
    found = choice(prepared, beta, {own: 1.0, other: 0.0}, best)
    x = np.broadcast_to(day.places[:, 0], (27, day.H)).copy()
    spacing = np.median(np.diff(np.unique(x)))
    golden = (np.sqrt(5) - 1) / 2
    by = {"shift-x": np.full(6, pitch / 4), "stagger-x": spacing * (golden * np.arange(1, 7) % 1)}
    x[21:] += by.get(plan, np.zeros(6))[:, None]
    low, high = max(2.0, np.median(np.diff(np.unique(x))) / 2), np.ptp(x) / 2
    count = min(500, int(np.ceil((1 / low - 1 / high) * 4 * np.ptp(x))) + 1)
    turns = [2 * np.pi * f * x for f in np.linspace(1 / high, 1 / low, count)]
    rivals = [[{0: np.sin(turn)}, {0: np.cos(turn)}] for turn in turns]
    wanted = dense_d2({0: 2e-4 * x}, rivals, parts_basis(day.places), VARIANCES)
    assert dict(found.separations)[plan] == pytest.approx(np.sqrt(wanted), rel=1e-4)


def test_d_is_that_of_the_shop_days_oracle() -> None:
    """Of six more parts in the reverse direction, with its own columns and covariance."""
    day = ShopDay("A", 2, 27)
    day.covariates["dir_y"] = np.repeat([[1.0], [-1.0]], [21, 6], axis=0) * day.covariates["dir_y"]
    field = np.zeros((27, day.H, 2))
    field[..., 1] = 4.0 * day.covariates["dir_y"]
    rivals = Rivals(day)
    share = rivals.r2(field - field.mean(axis=(0, 1)))["abbe-y"]
    z2 = float(np.sum(whitened(field) ** 2))
    one = np.full(2, 1e-6)
    part = np.zeros((2, 4))
    part[:, 0] = day.H * SIG_PART**2 * 1e-6
    prepared = with_variances(prepared_day("A", 2), SIGMA**2 * one, SIG_HOLE**2 * one, part)
    own, other = index(prepared, "backlash-y"), index(prepared, "abbe-y")
    found = choice(
        prepared,
        {own: np.array([4e-3]), other: np.array([1e-4])},
        {own: 1.0, other: 0.0},
        {own: members_of(prepared, "backlash-y")[0], other: members_of(prepared, "abbe-y")[0]},
    )
    got = dict(found.separations)["reverse"]
    assert got == pytest.approx(np.sqrt(z2 * (1 - share)), rel=1e-8)
