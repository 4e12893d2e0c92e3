"""Tables beside lines and columns, and the columns that scatter more than the others."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from mtu_cli.close_loop_sealed.stats.loose_columns import (
    Loose,
    beside_lines_and_columns,
    loose_columns,
)


def joint(values: np.ndarray, there: np.ndarray, smooth: np.ndarray) -> tuple[np.ndarray, int]:
    """The slow plain way: one design of all parts and columns."""
    P, H = there.shape
    rows = []
    for p in range(P):
        for h in range(H):
            row = np.zeros(P * smooth.shape[1] + H)
            row[p * smooth.shape[1] : (p + 1) * smooth.shape[1]] = smooth[h]
            row[P * smooth.shape[1] + h] = 1.0
            rows.append(row)
    X = np.array(rows)[there.ravel()]
    y = values.reshape(P * H, -1)[there.ravel()]
    beta, _, rank, _ = np.linalg.lstsq(X, y, rcond=1e-10)
    left = np.zeros((P * H, values.shape[2]))
    left[there.ravel()] = y - X @ beta
    return left.reshape(values.shape), len(X) - int(rank)


def lines(H: int, rng: np.random.Generator, *, row: bool = False) -> np.ndarray:
    places = rng.uniform(-1, 1, (H, 2))
    if row:
        places[:, 1] = 0.3 * places[:, 0]
    return np.column_stack([np.ones(H), places])


@pytest.mark.parametrize("missing", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("row", [False, True])
def test_against_one_large_least_squares(missing: float, row: bool) -> None:
    rng = np.random.default_rng(7)
    smooth, P, H = lines(7, rng, row=row), 9, 7
    there = rng.random((P, H)) >= missing
    values = rng.standard_normal((P, H, 2)) + 100 * rng.standard_normal((1, H, 1))
    values += np.einsum("hk,pka->pha", smooth, 50 * rng.standard_normal((P, 3, 2)))
    left, share, dof = beside_lines_and_columns(values, there, smooth)
    expected, expected_dof = joint(values, there, smooth)
    assert dof == expected_dof
    assert left == pytest.approx(expected, abs=1e-8)
    for own, kept, found in zip(smooth[None].repeat(P, axis=0), there, share, strict=True):
        X = own[kept]
        hat = X @ np.linalg.pinv(X) if kept.any() else np.zeros((0, 0))
        assert found[kept] == pytest.approx(1 - np.diag(hat), abs=1e-8)
        assert (found[~kept] == 0).all()


def test_cells_that_are_missing_do_not_count_whatever_stands_there() -> None:
    rng = np.random.default_rng(1)
    there = rng.random((6, 8)) > 0.2
    values = rng.standard_normal((6, 8, 1))
    other = np.where(there[:, :, None], values, 1e6)
    smooth = lines(8, rng)
    assert np.array_equal(
        beside_lines_and_columns(values, there, smooth)[0],
        beside_lines_and_columns(other, there, smooth)[0],
    )


def test_a_line_takes_all_of_few_cells() -> None:
    rng = np.random.default_rng(2)
    left, _, dof = beside_lines_and_columns(
        rng.standard_normal((5, 3, 2)), np.full((5, 3), True), lines(3, rng)
    )
    assert dof == 0
    assert left == pytest.approx(np.zeros((5, 3, 2)), abs=1e-12)


def places(H: int, rng: np.random.Generator) -> np.ndarray:
    return np.column_stack([np.ones(H), rng.uniform(-1, 1, (H, 2))])


def drawn(
    seed: int, shape: tuple[int, int, int] = (20, 6, 3), s: float = 5.0, missing: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parts that move, turn and grow; the second column scatters s times as much along y."""
    rng = np.random.default_rng(seed)
    smooth = places(shape[1], rng)
    values = rng.normal(size=shape) + 10 * rng.normal(size=(1, shape[1], shape[2]))
    values += np.einsum("hk,pka->pha", smooth, 5 * rng.normal(size=(shape[0], 3, shape[2])))
    values[:, 1, 1] += np.sqrt(s**2 - 1) * rng.normal(size=shape[0])
    return values, rng.random(shape[:2]) >= missing, smooth


@pytest.mark.parametrize(("shape", "missing"), [((20, 6, 3), 0.0), ((30, 24, 2), 0.15)])
def test_a_loose_column_is_told_with_its_size(shape: tuple[int, int, int], missing: float) -> None:
    found = [loose_columns(*drawn(seed, shape, missing=missing)) for seed in range(30)]
    told = [own for own in found if [(x.column, x.axis) for x in own] == [(1, 1)]]
    # Lines of three slopes leave six columns half of what there is.
    assert len(told) >= (18 if shape[1] == 6 else 27)
    squares = np.array([[own[0].s ** 2, own[0].others ** 2] for own in told])
    error = squares.std(axis=0) / np.sqrt(len(told))
    # Those that are told are the larger ones, by a little.
    assert (np.abs(squares.mean(axis=0) - [25.0, 1.0]) < 4 * error + [1.0, 0.02]).all()
    assert max(own[0].p for own in told) < 1e-3


@pytest.mark.parametrize("kind", ["normal", "tails"])
def test_columns_that_are_alike_are_not_told(kind: str) -> None:
    """1 in 1000, and fewer as twice is asked for."""
    alarms = 0
    for seed in range(300):
        values, there, smooth = drawn(seed, s=1.0)
        if kind == "tails":
            values = np.random.default_rng([seed, 1]).standard_t(4, size=values.shape)
        alarms += bool(loose_columns(values, there, smooth))
    assert alarms <= binom.ppf(0.999, 300, 1e-3)


def test_two_loose_columns_are_told_each_and_half_of_them_none() -> None:
    values, there, smooth = drawn(1, (30, 12, 2), s=8.0)
    values[:, 4] *= 6.0
    assert {own.column for own in loose_columns(values, there, smooth)} == {1, 4}
    half, there, smooth = drawn(1, (30, 12, 2), s=1.0)
    half[:, ::2] *= 6.0
    assert loose_columns(half, there, smooth) == []


def test_columns_that_are_as_loose_are_told_each() -> None:
    """They are no rivals of one another: without one of them the others are loose as before."""
    values, there, smooth = drawn(3, (21, 60, 2), s=1.0)
    values[:, [5, 17, 33, 48]] += 6 * np.random.default_rng(1).normal(size=(21, 4, 2))
    assert {own.column for own in loose_columns(values, there, smooth)} == {5, 17, 33, 48}


def test_one_of_two_that_nothing_tells_apart_is_not_told() -> None:
    """Of five places in two rows the two of one row are loose alike beside lines of turns."""
    rng = np.random.default_rng(5)
    x, y = np.array([-1.0, 0.0, 1.0, -1.0, 0.0]), np.array([-1.0, -1.0, -1.0, 1.0, 1.0])
    smooth = np.column_stack([np.ones(5), x, y])
    for _ in range(10):
        values = rng.normal(size=(20, 5, 2))
        values += np.einsum("hk,pka->pha", smooth, 8 * rng.normal(size=(20, 3, 2)))
        values[:, 4] += 12 * rng.normal(size=(20, 2))
        found = {own.column for own in loose_columns(values, np.full((20, 5), True), smooth)}
        assert found <= {4}


def test_what_cannot_be_told() -> None:
    values, there, smooth = drawn(2)
    assert loose_columns(values[:4], there[:4], smooth) == []
    assert loose_columns(values[:, :3], there[:, :3], smooth[:3]) == []
    assert loose_columns(np.zeros_like(values), there, smooth) == []
    # Of columns without scatter nothing is a multiple.
    lone = np.zeros_like(values)
    lone[:, 1] = values[:, 1]
    found: list[Loose] = loose_columns(lone, there, smooth)
    assert found == [] or {own.column for own in found} == {1}
