"""Incomplete tables completed by rows plus columns: lstsq, adjoint, and what must not matter."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats, Mask, half_measured, holes

from mtu_cli.stats.crossed import completion

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


@pytest.mark.parametrize("name", MASKS)
def test_the_adjoint_is_the_transpose(name: str) -> None:
    there = MASKS[name]
    n = there.size * 2
    units = np.eye(n).reshape(n, *there.shape, 2)
    own = completion(there)
    fill, adjoint = own.fill(units).reshape(n, n), own.adjoint(units).reshape(n, n)
    np.testing.assert_allclose(adjoint, fill.T, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["holes", "half", "sparse"])
def test_rows_plus_columns_are_completed_exactly(name: str) -> None:
    there = MASKS[name]
    rng = np.random.default_rng(4)
    table = rng.normal(size=(there.shape[0], 1, 1)) + rng.normal(size=(1, there.shape[1], 1))
    given = np.where(there[:, :, None], table, 1e6)
    np.testing.assert_allclose(completion(there).fill(given), table, rtol=0, atol=1e-10)


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
    assert own.adjoint(table) is table
