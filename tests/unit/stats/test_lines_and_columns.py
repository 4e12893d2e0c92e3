"""Residuals beside lines and columns: against one large least squares, and their scatter."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.lines_and_columns import beside_lines_and_columns


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
