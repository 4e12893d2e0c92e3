"""Least squares against exact fractions, other methods and plain loops."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from mtu_cli.close_loop_sealed.stats.batched_squares import batched_squares_left
from mtu_cli.stats.least_squares import (
    FloatArray,
    batched_least_squares,
    beside,
    least_squares,
    triangle,
)


def solved(A: list[list[Fraction]], b: list[Fraction]) -> list[Fraction]:
    """A x = b by elimination, exactly."""
    rows = [[*row, value] for row, value in zip(A, b, strict=True)]
    for i in range(len(rows)):
        pivot = next(r for r in range(i, len(rows)) if rows[r][i] != 0)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for other in range(len(rows)):
            if other != i:
                factor = rows[other][i]
                rows[other] = [p - factor * q for p, q in zip(rows[other], rows[i], strict=True)]
    return [row[-1] for row in rows]


def exact_fit(
    X: list[list[int]], y: list[int]
) -> tuple[list[Fraction], Fraction, list[list[Fraction]]]:
    """b, rss and (X'X)^-1 by the normal equations in fractions."""
    k = len(X[0])
    normal = [[Fraction(sum(row[i] * row[j] for row in X)) for j in range(k)] for i in range(k)]
    b = solved(
        normal, [Fraction(sum(r[i] * v for r, v in zip(X, y, strict=True))) for i in range(k)]
    )
    fitted = [sum((r[i] * b[i] for i in range(k)), Fraction(0)) for r in X]
    rss = sum(((v - f) ** 2 for v, f in zip(y, fitted, strict=True)), Fraction(0))
    unit = [[Fraction(int(i == j)) for i in range(k)] for j in range(k)]
    return b, rss, [solved(normal, column) for column in unit]


INTEGER_SETS = {
    "line": ([[1, p] for p in (0, 1, 2, 5, 9)], [3, -1, 4, 1, -5]),
    "parabola far from zero": (
        [[1, p, p * p] for p in (1000, 1001, 1003, 1007, 1010)],
        [9, 2, 6, 5, 3],
    ),
    "constant": ([[1]] * 5, [2, 7, 1, 8, 2]),
    "three columns": (
        [[1, 0, 2], [0, 1, -1], [3, 1, 1], [2, -2, 5], [1, 1, 1], [0, 4, 1]],
        list(range(6)),
    ),
}


@pytest.mark.parametrize("name", INTEGER_SETS)
def test_against_the_normal_equations_in_fractions(name: str) -> None:
    rows, values = INTEGER_SETS[name]
    b, rss, inverse = exact_fit(rows, values)
    fit = least_squares(np.array(rows, float), np.array(values, float))
    np.testing.assert_allclose(fit.coefficients, [float(v) for v in b], rtol=1e-9)
    np.testing.assert_allclose(
        fit.unscaled_covariance, [[float(v) for v in row] for row in inverse], rtol=1e-8
    )
    assert fit.rss == pytest.approx(float(rss), rel=1e-12)
    assert fit.dof == len(rows) - len(rows[0])
    assert fit.s2 == pytest.approx(float(rss / fit.dof), rel=1e-12)


def test_against_lapack() -> None:
    rng = np.random.default_rng(4)
    X, y = rng.normal(size=(60, 5)), rng.normal(size=60)
    fit = least_squares(X, y)
    b, rss, rank, _ = np.linalg.lstsq(X, y, rcond=None)
    np.testing.assert_allclose(fit.coefficients, b, rtol=1e-11)
    np.testing.assert_allclose(fit.residuals, y - X @ b, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(fit.unscaled_covariance, np.linalg.inv(X.T @ X), rtol=1e-9)
    assert fit.rss == pytest.approx(float(rss[0]), rel=1e-12)
    assert fit.rank == rank == 5
    assert fit.null_space.shape == (5, 0)


def test_residuals_are_orthogonal_to_the_columns() -> None:
    rng = np.random.default_rng(5)
    X = np.vander(rng.uniform(0, 1000, 200), 4, increasing=True)
    fit = least_squares(X, 1e6 * rng.normal(size=200))
    cosines = X.T @ fit.residuals / np.linalg.norm(X, axis=0) / np.linalg.norm(fit.residuals)
    assert np.abs(cosines).max() < 1e-14


@pytest.mark.parametrize("power", [-9, -4, 4, 9])
def test_units_of_the_columns_do_not_matter(power: int) -> None:
    rng = np.random.default_rng(6)
    X, y = rng.normal(size=(40, 3)), rng.normal(size=40)
    unit = np.array([1.0, 10.0**power, 10.0**-power])
    plain, scaled = least_squares(X, y), least_squares(X * unit, y)
    np.testing.assert_allclose(scaled.coefficients * unit, plain.coefficients, rtol=1e-11)
    np.testing.assert_allclose(
        scaled.unscaled_covariance * np.outer(unit, unit), plain.unscaled_covariance, rtol=1e-10
    )
    assert scaled.rank == 3
    assert scaled.rss == pytest.approx(plain.rss, rel=1e-12)


def test_units_do_not_matter_for_the_rank_or_the_least_norm() -> None:
    rng = np.random.default_rng(7)
    X = rng.normal(size=(30, 3))
    X = np.column_stack([X, X[:, 0] - 2 * X[:, 1]])
    y = rng.normal(size=30)
    unit = np.array([1.0, 1e9, 1e-9, 1e3])
    plain, scaled = least_squares(X, y), least_squares(X * unit, y)
    assert plain.rank == scaled.rank == 3
    np.testing.assert_allclose(scaled.coefficients * unit, plain.coefficients, rtol=1e-8)


@pytest.mark.parametrize(
    ("X", "rank"),
    [
        (np.array([[1.0, 2, 3], [4, 5, 6], [7, 8, 9], [1, 1, 1]]), 2),
        (np.column_stack([np.ones(6), np.full(6, 250.0)]), 1),
        (np.column_stack([np.ones(5), np.zeros(5), np.arange(5.0)]), 2),
        (np.vander(np.repeat([0.0, 500.0], 4), 4, increasing=True), 2),
        (np.vander(np.arange(2) * 100.0, 4, increasing=True), 2),
        (np.ones((1, 2)), 1),
        (np.zeros((4, 2)), 0),
        (np.zeros((0, 2)), 0),
    ],
    ids=[
        "3 of rank 2",
        "one position",
        "zero column",
        "two positions",
        "n < k",
        "1 x 2",
        "0",
        "empty",
    ],
)
def test_rank_deficient_designs(X: FloatArray, rank: int) -> None:
    y = np.linspace(1.0, 2.0, len(X)) ** 2
    fit = least_squares(X, y)
    k = X.shape[1]
    assert (fit.rank, fit.dof) == (rank, len(X) - rank)
    assert fit.null_space.shape == (k, k - rank)
    assert np.linalg.matrix_rank(fit.null_space) == k - rank
    size = np.abs(X) @ np.abs(fit.null_space)
    assert (np.abs(X @ fit.null_space) <= 1e-13 * size).all()
    fitted = X @ np.linalg.lstsq(X, y, rcond=1e-12)[0]
    np.testing.assert_allclose(X @ fit.coefficients, fitted, atol=1e-10)
    np.testing.assert_allclose(X @ fit.unscaled_covariance @ X.T @ fitted, fitted, atol=1e-10)


def test_least_norm_in_the_scaled_columns() -> None:
    X = np.ones((5, 2)) * [1.0, 4.0]
    fit = least_squares(X, np.full(5, 6.0))
    np.testing.assert_allclose(fit.coefficients, [3.0, 0.75], rtol=1e-14)


def test_what_is_estimable_keeps_its_variance_in_a_deficient_design() -> None:
    """The mean of readings at one position, whatever the slope: variance s2/n."""
    X = np.column_stack([np.ones(8), np.full(8, 100.0)])
    fit = least_squares(X, np.arange(8.0))
    at = np.array([1.0, 100.0])
    assert at @ fit.coefficients == pytest.approx(3.5)
    assert at @ fit.unscaled_covariance @ at == pytest.approx(1 / 8)


def test_no_degrees_of_freedom_no_variance() -> None:
    fit = least_squares(np.vander(np.arange(3.0), 3), np.array([1.0, 5.0, -2.0]))
    assert fit.dof == 0
    assert math.isnan(fit.s2)
    assert fit.rss < 1e-28


def test_the_input_is_left_alone() -> None:
    X, y = np.array([[1.0, 0.0], [1.0, 2.0], [1.0, 3.0]]), np.arange(3.0)
    kept = X.copy(), y.copy()
    least_squares(X, y)
    np.testing.assert_array_equal(X, kept[0])
    np.testing.assert_array_equal(y, kept[1])


def problems(k: int, n: int, m: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(k)
    X = rng.normal(size=(k, n, m)) * 10.0 ** np.arange(-3, k - 3)[:, None, None]
    return X, rng.normal(size=(n, m))


@pytest.mark.parametrize(("k", "n"), [(1, 1), (2, 5), (3, 8), (4, 4)])
def test_a_batch_against_one_at_a_time(k: int, n: int) -> None:
    X, y = problems(k, n, 40)
    given = X.copy(), y.copy()
    b, explained = batched_least_squares(X, y)
    assert np.array_equal(X, given[0])
    assert np.array_equal(y, given[1])
    for i in range(40):
        alone = least_squares(X[:, :, i].T, y[:, i])
        # Digits are lost in proportion to the condition of the columns at length 1.
        columns = X[:, :, i] / np.linalg.norm(X[:, :, i], axis=1)[:, None]
        lost = 20 * np.linalg.cond(columns) * np.finfo(float).eps
        scale = np.linalg.norm(X[:, :, i], axis=1)
        away = np.abs(b[:, i] - alone.coefficients) * scale
        assert away.max() <= lost * np.linalg.norm(alone.coefficients * scale)
        assert explained[i] == pytest.approx(y[:, i] @ y[:, i] - alone.rss, rel=1e-9, abs=1e-12)


def test_a_batch_of_nearly_parallel_columns_keeps_its_digits() -> None:
    """Columns apart by e: the condition 1/e is lost, not its square, which would be all digits."""
    t = np.linspace(0, 1, 6)
    e = 1e-6
    X = np.array([np.ones(6), 1 + e * t])[:, :, None]
    b, _ = batched_least_squares(X, (X[0] + 2 * X[1]).copy())
    assert b[:, 0] == pytest.approx([1, 2], abs=100 * np.finfo(float).eps / e)


def test_a_batch_tells_what_is_not_determined() -> None:
    """One problem of three has two equal columns; the others are solved."""
    X, y = problems(2, 5, 3)
    X[1, :, 1] = 2 * X[0, :, 1]
    b, explained = batched_least_squares(X, y)
    assert np.isfinite(b).tolist() == [[True, False, True]] * 2
    assert np.isfinite(explained).tolist() == [True, False, True]


def columns_of(k: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(10 + k)
    return rng.normal(size=(k, 9, 7)), rng.normal(size=9)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_what_a_batch_leaves_is_that_of_one_fit_after_the_other(k: int) -> None:
    X, y = columns_of(k)
    given = X.copy(), y.copy()
    alone = [least_squares(X[:, :, i].T, y).rss for i in range(7)]
    np.testing.assert_allclose(batched_squares_left(X, y[:, None], 1e-6), alone, rtol=1e-12)
    np.testing.assert_allclose(
        batched_squares_left(X, np.tile(y[:, None], 7), 1e-6), alone, rtol=1e-12
    )
    _, explained = batched_least_squares(X, np.tile(y[:, None], 7))
    np.testing.assert_allclose(y @ y - explained, alone, rtol=1e-12)
    assert np.array_equal(X, given[0])
    assert np.array_equal(y, given[1])


@pytest.mark.parametrize(
    ("which", "scaled", "like"),
    [
        pytest.param(1, 0.0, None, id="nothing"),
        pytest.param(1, -2.0, 0, id="a copy between the others"),
        pytest.param(2, 1.0, 1, id="a copy at the end"),
        pytest.param(1, 1e-14, 1, id="rounding behind another"),
        pytest.param(0, 0.0, None, id="nothing in front"),
        pytest.param(0, 1e-14, 1, id="rounding in front, of one behind it"),
        pytest.param(0, 1e-14, 0, id="rounding in front"),
    ],
)
def test_columns_of_which_nothing_is_left_take_nothing_from_the_others(
    which: int, scaled: float, like: int | None
) -> None:
    X, y = columns_of(3)
    X[which] = 0.0 if like is None else scaled * X[like]
    kept = [j for j in range(3) if j != which]
    alone = [least_squares(X[kept][:, :, i].T, y).rss for i in range(7)]
    np.testing.assert_allclose(batched_squares_left(X, y[:, None], 1e-6), alone, rtol=1e-12)


def test_columns_beside_others_fit_as_all_together() -> None:
    rows = np.random.default_rng(1).normal(size=(20, 7))
    left = beside(rows, 3)
    assert left.shape == (4, 4)
    whole = least_squares(rows[:, :-1], rows[:, -1])
    apart = least_squares(left[:, :-1], left[:, -1])
    assert np.isclose(apart.rss, whole.rss, rtol=1e-12)
    np.testing.assert_allclose(apart.coefficients, whole.coefficients[3:], rtol=1e-10)
    # Of fewer rows than columns nothing is left that others could explain.
    assert beside(rows[:3], 3).shape == (0, 4)


EPS = np.finfo(float).eps
SHAPES = [(1, 1), (5, 1), (40, 3), (3, 3), (2, 5), (200, 40), (35, 70)]


def drawn(n: int, k: int) -> FloatArray:
    """Columns of very different sizes, one of them twice, in an order that LAPACK must copy."""
    rng = np.random.default_rng(n + 100 * k)
    Z = rng.normal(size=(n, k)) * 10.0 ** rng.uniform(-6, 6, k)
    if k > 2:
        Z[:, 2] = Z[:, 0]
    return Z


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(("n", "k"), SHAPES)
def test_a_triangle_has_the_squares_and_products_of_the_rows(n: int, k: int, order: str) -> None:
    Z = drawn(n, k)
    given = np.array(Z, order=order)  # type: ignore[call-overload]  # one of two letters
    R = triangle(given)
    size = np.linalg.norm(Z, axis=0)
    assert R.shape == (min(n, k), k)
    assert (np.tril(R, -1) == 0.0).all()
    # Backward stable: an error of n k eps of the columns' lengths (Higham 2002, theorem 19.4).
    assert (np.abs(R.T @ R - Z.T @ Z) <= 10 * n * k * EPS * np.outer(size, size)).all()
    np.testing.assert_array_equal(given, Z)


@pytest.mark.parametrize(("n", "k"), [(0, 0), (4, 0), (0, 4)])
def test_of_nothing_there_is_nothing_and_nothing_is_said(
    n: int, k: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert triangle(np.zeros((n, k))).shape == (0, k)
    assert capfd.readouterr() == ("", "")
