"""Groups that shift from part to part: of the right size, and seldom by chance."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from mtu_cli.close_loop_sealed.stats import group_shifts
from mtu_cli.close_loop_sealed.stats.group_shifts import GroupShift, group_shift

Floats = NDArray[np.float64]
Drawn = tuple[Floats, NDArray[np.bool_], Floats]
SHAPE = (15, 18, 2)
GROUPS = np.arange(18) % 3


def drawn(seed: int, s: float = 0.0, missing: float = 0.0, scales: Floats | None = None) -> Drawn:
    """Parts that move, turn and grow, columns with means of their own, and a second group that
    shifts along the first axis.
    """
    rng = np.random.default_rng(seed)
    P, H, A = SHAPE
    smooth = np.column_stack([np.ones(H), rng.uniform(-1, 1, (H, 2))])
    values = rng.normal(size=SHAPE) * (1.0 if scales is None else scales[:, None])
    values += 10 * rng.normal(size=(1, H, A))
    values += np.einsum("hk,pka->pha", smooth, 5 * rng.normal(size=(P, 3, A)))
    values[:, GROUPS == 1, 0] += s * rng.normal(size=(P, 1))
    there = rng.random((P, H)) >= missing
    return np.where(there[:, :, None], values, 0.0), there, smooth


@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_the_size_of_a_shift_is_right_in_the_mean_and_so_is_its_u(missing: float) -> None:
    found = [group_shift(*drawn(seed, 4.0, missing), GROUPS) for seed in range(200)]
    told = [own for own in found if own is not None]
    assert len(told) >= binom.ppf(1e-3, 200, 0.98)
    assert {own.group for own in told} == {1}
    assert sum(bool(own.s[1]) for own in told) <= binom.ppf(1 - 1e-3, 200, 0.01)
    squares = np.array([own.s[0] ** 2 for own in told])
    assert abs(squares.mean() - 16.0) < 4 * squares.std() / np.sqrt(len(told))
    # u of s^2 is 2 s u: its mean square is the variance, which 200 draws of 14 degrees of freedom
    # tell to sqrt((2 + 12/14)/200), 12 %.
    stated = np.mean([(2 * own.s[0] * own.u[0]) ** 2 for own in told])
    assert stated == pytest.approx(squares.var(), rel=0.5)


@pytest.mark.parametrize("kind", ["alike", "missing", "one loose", "one group", "tails"])
def test_groups_that_do_not_shift_are_not_told(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a column of one is loose, or all scatter three times as much: at 5 % no more than
    5 % are.
    """
    monkeypatch.setattr(group_shifts, "RATE", 0.05)
    monkeypatch.setattr(group_shifts, "NOTABLE", 0.0)
    monkeypatch.setattr(group_shifts, "SINGLE", 1.0)
    scales, told, count = np.ones(18), 0, 300
    if kind == "one loose":
        scales[1] = 6.0
    if kind == "one group":
        scales[GROUPS == 1] = 3.0
    for seed in range(count):
        missing = 0.25 if kind == "missing" else 0.0
        values, there, smooth = drawn(seed, missing=missing, scales=scales)
        if kind == "tails":
            values = np.random.default_rng([seed, 1]).standard_t(4, size=SHAPE)
        told += group_shift(values, there, smooth, GROUPS) is not None
    assert told <= binom.ppf(1 - 1e-3, count, 0.05)


def test_shifts_are_those_of_a_least_squares_fit_of_every_part() -> None:
    """Of a complete table, whose columns all have one variance by draws."""
    values, there, smooth = drawn(7, 3.0)
    found = group_shift(values, there, smooth, GROUPS)
    assert found is not None
    design = np.column_stack([smooth, GROUPS == 1])
    centred = values[..., 0] - values[..., 0].mean(axis=0)
    fits = np.array([np.linalg.lstsq(design, own, rcond=None)[0][-1] for own in centred])
    of_entry = np.linalg.inv(design.T @ design)[-1, -1]
    # Entries have a variance of 1; columns' own ones, of 12 degrees of freedom, err by 40 % each.
    square = fits.var(ddof=1) - of_entry
    assert found.s[0] ** 2 == pytest.approx(square, abs=of_entry)


def test_of_two_groups_one_is_told_and_of_small_ones_none() -> None:
    values, there, smooth = drawn(3, 4.0)
    two = (GROUPS == 1).astype(np.int64)
    found = group_shift(values, there, smooth, two)
    assert isinstance(found, GroupShift)
    assert found.group == 0
    single = (np.arange(18) == 1).astype(np.int64)
    assert group_shift(values, there, smooth, single) is None
    assert group_shift(values[:7], there[:7], smooth, GROUPS) is None
    assert group_shift(values, there, smooth, np.zeros(18, np.int64)) is None


@pytest.mark.parametrize("sizes", [(2, 10), (2, 2, 14), (4, 4, 10)])
def test_small_groups_that_scatter_more_are_not_told(sizes: tuple[int, ...]) -> None:
    """What is left of two columns beside lines of all is the others' scatter as much as theirs."""
    groups, told, count = np.repeat(np.arange(len(sizes)), sizes), 0, 300
    for seed in range(count):
        rng = np.random.default_rng([seed, 2])
        H = len(groups)
        smooth = np.column_stack([np.ones(H), rng.uniform(-1, 1, (H, 2))])
        values = rng.normal(size=(12, H, 2)) * np.where(groups == 0, 3.0, 1.0)[:, None]
        told += group_shift(values, np.ones((12, H), bool), smooth, groups) is not None
    assert told <= binom.ppf(1 - 1e-3, count, 2e-3)


def test_a_group_that_a_line_holds_is_not_told() -> None:
    """All on one side, at one place: a turn of the part moves it as a shift would."""
    values, there, smooth = drawn(5, 4.0)
    smooth = np.column_stack([np.ones(18), GROUPS == 1, smooth[:, 2]])
    found = group_shift(values, there, smooth, (GROUPS == 1).astype(np.int64))
    assert found is None


def test_what_does_not_scatter_shifts_not() -> None:
    values, there, smooth = np.zeros(SHAPE), np.ones(SHAPE[:2], bool), drawn(1)[2]
    assert group_shift(values, there, smooth, GROUPS) is None
    values = drawn(1, 4.0)[0]
    values[..., 1] = 0.5
    found = group_shift(values, there, smooth, GROUPS)
    assert found is not None
    assert found.s[0] > 0
    assert found.s[1] == 0
