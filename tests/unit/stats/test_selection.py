"""Regression at places with held-out cycles, against plain fits of raw rows; averages of models."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import f

from mtu_cli.stats.least_squares import FloatArray, compress, submodel_average
from mtu_cli.stats.selection import (
    MOST_BLOCKS,
    Fitted,
    Panel,
    Spec,
    held_out,
    held_out_products,
    levels_of_pieces,
)

X = np.array([-1.0, 0.2, 1.0])
SLOPES = np.array([[2.0, -1.0], [2.6, -1.0], [3.0, -1.0]])
"""2.5 + 0.5 x, and -1."""
LINE = Spec("ridge", 1, (0, 0))


Made = dict[tuple[int, int], FloatArray]


def rows(seed: int, cycles: int = 4, n: int = 12, level: float = 0.0) -> Made:
    """1, two regressors and a response by place and cycle; each cycle `level` above the last."""
    rng, made = np.random.default_rng(seed), Made()
    for place in range(len(X)):
        for cycle in range(cycles):
            u = rng.normal(size=(n, 2)).cumsum(axis=0)
            y = 5.0 * place + level * cycle + u @ SLOPES[place] + 0.1 * rng.normal(size=n)
            made[place, cycle] = np.column_stack([np.ones(n), u, y])
    return made


def panel_of(made: Made) -> Panel:
    return Panel({key: compress(Z) for key, Z in made.items()}, X, 2)


def plain(made: Made, by_cycle: bool) -> tuple[FloatArray, float]:
    """Coefficients (2, 2) of the line in x and the sum of squares, with indicators as levels."""
    keys = [key if by_cycle else key[:1] for key in made]
    levels = [[key == other for other in dict.fromkeys(keys)] for key in keys]
    columns = [
        np.hstack([np.tile(level, (len(Z), 1)), Z[:, 1:3], X[place] * Z[:, 1:3]])
        for level, ((place, _), Z) in zip(levels, made.items(), strict=True)
    ]
    y = np.concatenate([Z[:, -1] for Z in made.values()])
    b, rss, *_ = np.linalg.lstsq(np.vstack(columns), y, rcond=None)
    return b[-4:].reshape(2, 2), float(rss[0])


@pytest.mark.parametrize("freed", [False, True])
def test_a_fit_is_least_squares_with_a_level_at_each_place(freed: bool) -> None:
    """Or, of a panel that is freed of them, with one of every piece."""
    made = rows(1, level=3.0 * freed)
    panel = panel_of(made).freed() if freed else panel_of(made)
    fit = Fitted(panel, panel.cycles, LINE)
    b, rss = plain(made, by_cycle=freed)
    assert fit.coefficients == pytest.approx(b, rel=1e-9)
    assert fit.sum_of_squares(panel.cycles) == pytest.approx(rss, rel=1e-9)
    assert fit.parameters == pytest.approx(4 + (12 if freed else 3))
    assert fit.slopes == pytest.approx(SLOPES, abs=0.1)


def test_levels_of_pieces_are_seen_where_there_are_any() -> None:
    share, p = levels_of_pieces(panel_of(rows(2, level=3.0)), [[1, 2]])
    assert share > 0.9
    assert p < 1e-6
    shares, ps = zip(
        *(levels_of_pieces(panel_of(rows(s)), [[1, 2]]) for s in range(60)), strict=True
    )
    assert np.mean(np.array(ps) < 0.05) < 0.05 + 3.3 * np.sqrt(0.05 * 0.95 / 60)
    assert max(shares) < 0.5


def test_the_test_of_levels_is_the_plain_f() -> None:
    """Where residuals that follow each other do not go together, so that every row counts."""
    compared = 0
    for seed in range(8):
        made = rows(seed, level=0.02)
        rss, product = np.zeros(2), 0.0
        for place in range(len(X)):
            of_place = [Z for (at, _), Z in made.items() if at == place]
            whole = np.vstack(of_place)
            levels = np.repeat(np.eye(len(of_place)), len(of_place[0]), axis=0)
            for k, columns in enumerate((whole[:, :1], levels)):
                D = np.hstack([columns, whole[:, 1:3]])
                e = whole[:, 3] - D @ np.linalg.lstsq(D, whole[:, 3], rcond=None)[0]
                rss[k] += e @ e
            e = e.reshape(len(of_place), -1)
            product += float(np.sum(e[:, :-1] * e[:, 1:]))
        if product < 0:
            dof = sum(map(len, made.values())) - len(made) - 2 * len(X)
            F = (rss[0] - rss[1]) / (len(made) - len(X)) / (rss[1] / dof)
            plain_test = 1 - rss[1] / rss[0], f.sf(F, len(made) - len(X), dof)
            found = levels_of_pieces(panel_of(made), [[1, 2]])
            assert found == pytest.approx(plain_test, rel=1e-6)
            compared += 1
    assert compared


def test_many_cycles_are_held_out_in_blocks() -> None:
    panel = panel_of(rows(3, cycles=MOST_BLOCKS + 3))
    assert len(panel.blocks) == MOST_BLOCKS
    assert [cycle for block in panel.blocks for cycle in block] == [*panel.cycles]
    assert {len(block) for block in panel.blocks} == {1, 2}


def test_held_out_errors_and_products_are_those_of_noise() -> None:
    """0.1 beside the levels' own scatter; products of neighbours are 0 on average."""
    panel = panel_of(rows(4, cycles=6, n=60))
    found = held_out(panel, lambda blocks: LINE)
    products = held_out_products(panel, LINE)
    assert found is not None
    assert products is not None
    assert found.before > 1.0
    assert found.after == pytest.approx(0.1, rel=0.1)
    assert abs(products[0]) < 5 * 0.01 / np.sqrt(3 * 6 * 60)
    assert held_out(panel_of(rows(5, cycles=2)), lambda blocks: LINE) is None


@pytest.mark.parametrize("optional", [[], [1], [3, 1], [0, 1, 2, 3]])
def test_sizes_are_averaged_over_the_models_without_some(optional: list[int]) -> None:
    """Each model fitted by itself to rows of variance 1. What k optional columns explain beside
    the others counts n/(1 + n), and costs k/2 ln(1 + n).
    """
    n, rng = 30, np.random.default_rng(len(optional))
    X = rng.normal(size=(n, 4)) + rng.normal(size=(n, 1))
    y = X @ [2.0, 0.2, 0.5, 0.0] + rng.normal(size=n)
    logs, sizes = [], []
    for count in range(len(optional) + 1):
        for zero in combinations(optional, count):
            columns = [i for i in range(4) if i not in zero]
            b = np.zeros(4)
            b[columns] = np.linalg.lstsq(X[:, columns], y, rcond=None)[0]
            penalty = (len(optional) - count) * np.log1p(n)
            logs.append(-0.5 * (np.sum((y - X @ b) ** 2) * n / (1 + n) + penalty))
            sizes.append(b)
    weights = np.exp(np.array(logs) - max(logs))
    C = np.asarray(np.linalg.inv(X.T @ X), np.float64)
    mean = submodel_average(C @ X.T @ y, C, optional, n)
    assert mean == pytest.approx(weights @ np.array(sizes) / weights.sum(), rel=1e-9)


def test_sizes_that_depend_on_each_other_are_0_together() -> None:
    """Two that are one: whichever is 0, the other is; three of four models are without both."""
    n, t = 10, 1.0
    mean = submodel_average(np.array([t, t]), np.ones((2, 2)), [0, 1], n)
    zero = np.exp(-(t**2) * n / (1 + n) / 2)
    odds = (2 * np.sqrt(1 + n) + (1 + n)) * zero
    assert mean == pytest.approx(2 * [t / (1 + odds)], rel=1e-9)
