"""Incomplete tables completed by rows plus columns: lstsq, lines, and what must not matter."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, Mask, grid, half_measured, holes
from scipy.sparse.csgraph import connected_components

from mtu_cli.close_loop_sealed.stats.crossed import completion

MASKS: dict[str, Mask] = {
    "holes": holes(6, 5, 0.3, 1),
    "sparse": holes(7, 9, 0.7, 2),
    "half": half_measured(6, 8),
    "apart": np.kron(np.eye(2, dtype=bool), np.ones((3, 2), bool)),
    "one-row": np.ones((1, 4), bool),
    "complete": np.ones((3, 4), bool),
}


def by_lstsq(there: Mask, table: Floats) -> Floats:
    """Row plus column effects of minimum norm, one equation an entry."""
    P, H = there.shape
    design = np.concatenate(
        [np.kron(np.eye(P), np.ones((H, 1))), np.kron(np.ones((P, 1)), np.eye(H))], axis=1
    )
    own = there.ravel()
    found = table.reshape(P * H, -1).copy()
    beta = np.linalg.lstsq(design[own], found[own], rcond=None)[0]
    found[~own] = (design @ beta)[~own]
    return np.asarray(found.reshape(table.shape))


@pytest.mark.parametrize("name", MASKS)
def test_what_is_missing_is_the_least_squares_row_plus_column(name: str) -> None:
    there = MASKS[name]
    table = np.random.default_rng(3).normal(size=(*there.shape, 2))
    filled = completion(there).fill(table)
    np.testing.assert_allclose(filled, by_lstsq(there, table), rtol=0, atol=1e-12)
    assert np.array_equal(filled[there], table[there])


def lines(H: int) -> Floats:
    """Two directions along the columns, of no special length or angle."""
    return np.random.default_rng(H).normal(size=(H, 2))


def told(there: Mask, directions: Floats) -> list[bool]:
    """By row, whether each missing entry is known no worse from the row's own lines than read."""
    found = []
    for row in there:
        X = np.column_stack([np.ones(len(row)), directions])
        enough = row.sum() > X.shape[1] and np.linalg.matrix_rank(X[row]) == X.shape[1]
        lever = np.diag(X @ np.linalg.pinv(X[row].T @ X[row]) @ X.T)
        found.append(bool(enough and (lever[~row] <= 1.0).all()))
    return found


@pytest.mark.parametrize("name", ["holes", "half", "sparse", "apart"])
def test_lines_of_rows_are_fitted_with_them(name: str) -> None:
    """One dense equation an entry; lines of rows that are told have columns of their own."""
    there = MASKS[name]
    P, H = there.shape
    directions = lines(H)
    rows = [np.kron(np.eye(P), np.ones((H, 1))), np.kron(np.ones((P, 1)), np.eye(H))]
    known = np.flatnonzero(told(there, directions))
    # Lines have the mean 0 over the rows that tell them: a basis of such differences.
    apart = np.eye(P)[:, known] @ np.linalg.svd(np.eye(len(known)) - 1 / max(len(known), 1))[0]
    rows.append(np.kron(apart[:, : len(known) - 1], directions))
    X, own = np.concatenate(rows, axis=1), there.ravel()
    table = np.random.default_rng(3).normal(size=(5, P, H, 2))
    filled = completion(there, directions).fill(table)
    for one, found in zip(table, filled, strict=True):
        expected = one.reshape(P * H, 2).copy()
        expected[~own] = X[~own] @ np.linalg.lstsq(X[own], expected[own], rcond=None)[0]
        np.testing.assert_allclose(found.reshape(P * H, 2), expected, rtol=0, atol=1e-9)


def test_rows_that_are_told_are_some_and_not_all() -> None:
    """Of the masks with lines: what the test above is about does occur."""
    every = [
        t
        for name in ("holes", "sparse", "half")
        for t in told(MASKS[name], lines(MASKS[name].shape[1]))
    ]
    assert 0 < sum(every) < len(every)


def test_parts_that_turn_are_completed_exactly() -> None:
    there = holes(8, 24, 0.05, 3)
    directions, rng = grid(24), np.random.default_rng(4)
    assert all(told(there, directions))
    table = rng.normal(size=(1, 24, 1)) + rng.normal(size=(8, 1, 1))
    table = table + (directions @ rng.normal(size=(2, 8))).T[:, :, None]
    given = np.where(there[:, :, None], table, 1e6)
    np.testing.assert_allclose(completion(there, directions).fill(given), table, atol=1e-9)


@pytest.mark.parametrize("name", ["holes", "half", "sparse"])
def test_rows_plus_columns_are_completed_exactly(name: str) -> None:
    there = MASKS[name]
    rng = np.random.default_rng(4)
    table = rng.normal(size=(there.shape[0], 1, 1)) + rng.normal(size=(1, there.shape[1], 1))
    given = np.where(there[:, :, None], table, 1e6)
    np.testing.assert_allclose(completion(there).fill(given), table, rtol=0, atol=1e-10)


@pytest.mark.parametrize("lines", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_a_table_is_connected_where_its_entries_tell_rows_from_columns(
    seed: int, lines: bool
) -> None:
    # Of a graph of rows and columns with an edge for each entry, scipy counts the pieces.
    there = holes(7, 8, 0.7 + 0.02 * seed, seed)
    if seed % 3 == 0:
        # Rows that tell their lines: two pieces of four columns each, or with one row in both.
        there = np.kron(np.eye(2), np.ones((4, 4)))[:7] > 0
        there[0] |= seed % 2 == 1
    own = completion(there, grid(8) if lines else None)
    P, H = there.shape
    graph = np.zeros((P + H, P + H))
    graph[:P, P:] = there
    pieces = connected_components(graph, directed=False)[0]
    table = np.random.default_rng(4).normal(size=(P, 1)) + np.arange(8.0) ** 2
    back = own.fill(np.where(there, table, 0.0)[..., None])[..., 0]
    assert own.connected == (pieces == 1) == np.allclose(back, table, rtol=0, atol=1e-8)


def test_what_stands_in_missing_entries_does_not_matter() -> None:
    there = MASKS["holes"]
    table = np.random.default_rng(5).normal(size=(4, *there.shape, 3))
    other = np.where(there[:, :, None], table, 7.0)
    own = completion(there)
    assert np.array_equal(own.fill(table), own.fill(other))
    assert np.array_equal(own.fill(own.fill(table)), own.fill(table))


def test_one_missing_entry_is_yates() -> None:
    # Yates (1933): x = (P R + H C - G) / ((P - 1) (H - 1)) of the sums of what is there.
    table = np.arange(12.0).reshape(3, 4) ** 1.5
    there = np.ones((3, 4), bool)
    there[1, 2] = False
    known = np.where(there, table, 0.0)
    yates = (3 * known[1].sum() + 4 * known[:, 2].sum() - known.sum()) / 6
    assert completion(there).fill(table[..., None])[1, 2, 0] == pytest.approx(yates, rel=1e-12)


def test_complete_tables_are_left_alone() -> None:
    table = np.random.default_rng(6).normal(size=(3, 4, 2))
    own = completion(np.ones((3, 4), bool))
    assert own.complete
    assert not completion(MASKS["holes"]).complete
    assert own.fill(table) is table
