"""Strata: orthonormal, uncorrelated, with the expected mean squares of the analysis of variance."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import (
    Floats,
    coordinate_matrix,
    dense_covariance,
    grid,
    null,
    pairs,
    whole_frame,
    within,
)

from mtu_cli.close_loop_sealed.stats.loop_null import draw
from mtu_cli.close_loop_sealed.stats.strata import Strata, strata_of

DESIGNS: dict[str, Strata] = {
    "lines": strata_of(5, grid(8), 2),
    "none": strata_of(4, np.zeros((6, 0)), 1),
    "reversals": strata_of(5, np.repeat(np.arange(5.0), 2)[:, None] - 2.0, 1, pairs(10)),
    "one-part": strata_of(1, grid(9), 2),
    "one-column": strata_of(6, np.zeros((1, 2)), 1),
    "few-columns": strata_of(4, grid(3), 1),
    "dependent": strata_of(4, np.c_[np.ones(7), grid(7), grid(7) @ [[1.0], [2.0]]], 1),
}


@pytest.mark.parametrize("name", DESIGNS)
def test_coordinates_are_a_rotation_of_all_but_the_grand_means(name: str) -> None:
    strata = DESIGNS[name]
    P, H, A = strata.shape
    T = coordinate_matrix(whole_frame(strata))
    np.testing.assert_allclose(T @ T.T, np.eye(P * H * A - A), rtol=0, atol=1e-12)
    # What is left out of P H A dimensions are the A grand means, and no stratum has any.
    ones = np.tile(np.eye(A), (P * H, 1))
    np.testing.assert_allclose(T @ ones, 0, rtol=0, atol=1e-12)
    starts = [s.start for s in strata.all]
    ends = [s.start + s.size for s in strata.all]
    assert [*starts, strata.size] == [0, *ends]
    assert all(s.size > 0 for s in strata.all)


@pytest.mark.parametrize("name", DESIGNS)
def test_tables_come_back(name: str) -> None:
    strata = DESIGNS[name]
    table = np.random.default_rng(2).normal(size=(3, *strata.shape))
    y, grand = strata.coordinates(table)
    np.testing.assert_allclose(grand, table.mean(axis=(1, 2)), rtol=0, atol=1e-13)
    back = strata.tables(y) + grand[:, None, None, :]
    np.testing.assert_allclose(back, table, rtol=0, atol=1e-12)


def test_sums_of_squares_are_those_of_the_two_way_table() -> None:
    strata = strata_of(5, np.zeros((7, 0)), 1)
    table = np.random.default_rng(3).normal(size=(5, 7, 1))
    y, _ = strata.coordinates(table)
    X = table[:, :, 0]
    row, column = X.mean(axis=1), X.mean(axis=0)
    rest = X - row[:, None] - column + X.mean()
    expected = {
        "part": 7 * np.sum((row - X.mean()) ** 2),
        "column": 5 * np.sum((column - X.mean()) ** 2),
        "interaction": np.sum(rest**2),
    }
    found = {s.kind: float(np.sum(y[s.slice] ** 2)) for s in strata.all}
    assert found == pytest.approx(expected, rel=1e-12)
    assert {s.kind: s.size for s in strata.all} == {"part": 4, "column": 6, "interaction": 24}


def test_a_line_is_the_slope_of_each_part_and_nothing_else() -> None:
    strata = DESIGNS["lines"]
    P, H, _ = strata.shape
    slope = np.random.default_rng(4).normal(size=P)
    table = np.zeros(strata.shape)
    table[:, :, 1] = slope[:, None] * grid(H)[:, 0]
    y, _ = strata.coordinates(table)
    line = strata.find("line", 1, 1)
    mean = strata.find("column", 1)
    assert line is not None
    assert mean is not None
    size = np.sum(grid(H)[:, 0] ** 2)
    assert np.sum(y[line.slice] ** 2) == pytest.approx(size * np.sum((slope - slope.mean()) ** 2))
    lead = y[mean.slice][: len(mean.lead)]
    assert np.sum(lead**2) == pytest.approx(P * size * slope.mean() ** 2)
    assert y @ y == pytest.approx(np.sum(y[line.slice] ** 2) + np.sum(lead**2), rel=1e-12)
    assert strata.find("line", 1, 3) is None


def test_directions_that_say_nothing_new_are_left_out() -> None:
    assert DESIGNS["dependent"].lines == 2
    assert DESIGNS["few-columns"].lines == 0
    assert DESIGNS["one-column"].lines == 0
    assert strata_of(4, grid(4), 1).lines == 1


def test_even_is_common_to_both_directions_and_odd_is_how_they_differ() -> None:
    strata = DESIGNS["reversals"]
    place = np.repeat(np.arange(5.0), 2)
    way = np.tile([1.0, -1.0], 5)
    rng = np.random.default_rng(5)
    curve = np.repeat(rng.normal(size=5), 2)
    lost = way * np.repeat(rng.normal(size=5), 2)
    for values, kind in ((curve, "column"), (lost, "reversal")):
        found = strata.of_columns(values - values.mean(), 0)
        squares = {str(strata.all[i].kind): float(v @ v) for i, v in found.items()}
        other = "reversal" if kind == "column" else "column"
        size = strata.shape[0] * np.sum((values - values.mean()) ** 2)
        assert squares[kind] == pytest.approx(size, rel=1e-12)
        assert squares[other] < 1e-24 * size
    # Lost motion, and its growth along the travel, lead the reversals: parts differ in them.
    reversal = strata.find("reversal", 0)
    assert reversal is not None
    assert len(reversal.lead) == 2
    y = strata.of_columns(way * (2.0 + 0.3 * place), 0)[strata.all.index(reversal)]
    assert np.sum(y[2:] ** 2) < 1e-24 * np.sum(y**2)


def test_of_columns_is_what_the_table_gives() -> None:
    for name in ("lines", "reversals"):
        strata = DESIGNS[name]
        values = np.random.default_rng(6).normal(size=strata.shape[1])
        table = np.zeros(strata.shape)
        table[:, :, 0] = values
        y, _ = strata.coordinates(table)
        found = np.zeros(strata.size)
        for index, own in strata.of_columns(values, 0).items():
            found[strata.all[index].slice] = own
        np.testing.assert_allclose(found, y, rtol=0, atol=1e-12)


def expected_squares(strata: Strata, interaction: float, column: float, part: float) -> Floats:
    """Expected mean squares: Searle, Casella & McCulloch (1992), one entry a cell."""
    P, H, _ = strata.shape
    known = {
        "part": interaction + H * part,
        "column": interaction + P * column,
        "interaction": interaction,
    }
    return np.array([known[s.kind] for s in strata.all])


def test_expected_mean_squares_by_simulation_and_by_the_dense_covariance() -> None:
    strata = strata_of(6, np.zeros((5, 0)), 1)
    P, H, _ = strata.shape
    expected = expected_squares(strata, 1.0, 0.4, 0.7)
    model = null(
        strata,
        interaction=np.array([1.0]),
        column=np.array([0.4]),
        part=np.array([[H * 0.7]]),
    )
    T = coordinate_matrix(whole_frame(strata))
    V = T @ dense_covariance(strata, model) @ T.T
    exact = np.concatenate([np.full(s.size, e) for s, e in zip(strata.all, expected, strict=True)])
    np.testing.assert_allclose(V, np.diag(exact), rtol=0, atol=1e-12)
    rng = np.random.default_rng(7)
    n = 4000
    tables = rng.normal(size=(n, P, H, 1)) + np.sqrt(0.7) * rng.normal(size=(n, P, 1, 1))
    tables += np.sqrt(0.4) * rng.normal(size=(n, 1, H, 1))
    y, _ = strata.coordinates(tables)
    squares = np.stack([np.mean(y[:, s.slice] ** 2, axis=1) for s in strata.all], axis=1)
    assert within(squares.mean(axis=0), expected, squares.std(axis=0) / np.sqrt(n))


def test_reversals_have_a_variance_of_their_own() -> None:
    strata = DESIGNS["reversals"]
    k = strata.lines
    model = null(
        strata,
        interaction=np.array([1.0]),
        column=np.array([2.0]),
        reversal=np.array([0.1]),
        part=np.diag(np.arange(1.0, 2 + k)),
    )
    T = coordinate_matrix(whole_frame(strata))
    V = T @ dense_covariance(strata, model) @ T.T
    for stratum in strata.all:
        own = np.diag(V)[stratum.slice]
        if stratum.kind in ("column", "reversal"):
            beyond = own[len(stratum.lead) :]
            wanted = 1 + 5 * (2.0 if stratum.kind == "column" else 0.1)
            np.testing.assert_allclose(beyond, wanted, rtol=1e-12)
            lead = [wanted + model.part[i, i] for i in stratum.lead]
            np.testing.assert_allclose(own[: len(lead)], lead, rtol=1e-12)
    y, _ = draw(whole_frame(strata), model, 20_000, np.random.default_rng(8))
    found = np.mean(y**2, axis=0)
    assert within(found, np.diag(V), np.sqrt(2 / 20_000) * np.diag(V))
