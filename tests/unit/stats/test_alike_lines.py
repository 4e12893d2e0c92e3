"""One turn of both axes against one of each: the F test, against plain least squares."""

from __future__ import annotations

import numpy as np
import pytest
from crossed_tables import Floats
from numpy.typing import NDArray
from scipy.stats import f as f_distribution
from scipy.stats import kstest, uniform

from mtu_cli.close_loop_sealed.stats.alike_lines import MOST_COLUMNS, apart_from_whole, p_alike

PARTS, FEATURES = 9, 8
SD = np.array([1.0, 3.0])


def places(seed: int) -> Floats:
    """Of features that lie obliquely: a growth of them has something of a turn in it."""
    found: Floats = np.random.default_rng([1, seed]).uniform(-1.0, 1.0, (FEATURES, 2))
    found[:, 1] += found[:, 0]
    return found


TURN = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
GROWTH = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def lines(at: Floats) -> tuple[Floats, Floats]:
    """Orthonormal columns of 1, x, y; and how axes differ in a turn (-y along x, x along y)."""
    X = np.column_stack([np.ones(len(at)), at - at.mean(axis=0)])
    q, r = np.linalg.qr(X)
    turn, growth = (own @ r.T for own in (TURN, GROWTH))
    apart = apart_from_whole(turn, [turn, growth])
    assert apart is not None
    return q, apart


def drawn(seed: int, apart: float = 0.0) -> tuple[Floats, Floats]:
    """Places and errors (P, H, 2) of parts that turn, axes `apart` in it, beside levels, growths
    and columns of their own.
    """
    rng, at = np.random.default_rng([2, seed]), places(seed)
    turn = 5.0 * rng.normal(size=(PARTS, 1)) + apart * rng.normal(size=(PARTS, 1)) * [[1.0, -1.0]]
    errors = SD * rng.normal(size=(PARTS, FEATURES, 2))
    errors += 7.0 * rng.normal(size=(PARTS, 1, 2)) + 7.0 * rng.normal(size=(1, FEATURES, 2))
    errors += 4.0 * rng.normal(size=(PARTS, 1, 1)) * at
    errors[..., 0] -= turn[:, :1] * at[:, 1]
    errors[..., 1] += turn[:, -1:] * at[:, 0]
    return at, errors


def apart_plainly(at: Floats) -> Floats:
    """(4,): of x and y along x, then along y, what a turn that one axis alone has shows beside turn
    and growth of the whole, as functions of the places.
    """
    x, y = (at - at.mean(axis=0)).T
    none = np.zeros(FEATURES)
    alone = np.concatenate([-y / (y @ y), -x / (x @ x)])
    whole = np.stack([np.concatenate(own) for own in ((-y, x), (x, y))], axis=1)
    alone = alone - whole @ np.linalg.lstsq(whole, alone, rcond=None)[0]
    each = np.stack([np.concatenate(own) for own in ((x, none), (y, none), (none, x), (none, y))])
    found: Floats = each @ alone
    return found


def plainly(errors: Floats, there: NDArray[np.bool_], at: Floats) -> float:
    """The same with one column of the design for every part, line and feature."""
    apart = apart_plainly(at)
    other = np.linalg.svd(apart[None])[2][1:]

    def rss(slopes: Floats) -> tuple[float, int]:
        rows, y = [], []
        for p, h in zip(*np.nonzero(there), strict=True):
            for axis in range(2):
                own = np.zeros((PARTS, 2 + len(slopes)))
                own[p, axis] = 1.0
                own[p, 2:] = slopes[:, 2 * axis : 2 * axis + 2] @ at[h]
                column = np.zeros((FEATURES, 2))
                column[h, axis] = 1.0
                rows.append(np.concatenate([own.ravel(), column.ravel()]) / SD[axis])
                y.append(errors[p, h, axis] / SD[axis])
        X = np.array(rows)
        left = np.array(y) - X @ np.linalg.lstsq(X, np.array(y), rcond=None)[0]
        return float(left @ left), len(y) - int(np.linalg.matrix_rank(X))

    (one, of_one), (two, of_two) = rss(other), rss(np.eye(4))
    more = of_one - of_two
    return float(f_distribution.sf((one - two) / more / (two / of_two), more, of_two))


@pytest.mark.parametrize("missing", [0.0, 0.3])
@pytest.mark.parametrize("apart", [0.0, 1.5])
def test_it_is_the_f_test_of_plain_least_squares(missing: float, apart: float) -> None:
    for seed in range(4):
        at, errors = drawn(seed, apart)
        there = np.random.default_rng(seed).random((PARTS, FEATURES)) >= missing
        found = p_alike(errors, there, *lines(at), SD)
        assert found == pytest.approx(plainly(errors, there, at), rel=1e-6, abs=1e-12)


def test_p_is_uniform_where_axes_turn_alike() -> None:
    found = []
    for seed in range(400):
        at, errors = drawn(seed)
        there = np.random.default_rng(seed).random((PARTS, FEATURES)) >= 0.2
        found.append(p_alike(errors, there, *lines(at), SD))
    assert kstest(np.array(found), uniform.cdf).pvalue > 1e-3


def test_where_nothing_is_left_nothing_is_told() -> None:
    at, errors = drawn(1)
    there = np.zeros((PARTS, FEATURES), bool)
    there[:, :3] = True
    assert p_alike(errors, there, *lines(at), SD) is None


def test_without_scatter_axes_differ_by_what_they_are() -> None:
    at, there = places(1), np.ones((PARTS, FEATURES), bool)
    turn = np.random.default_rng(1).normal(size=(PARTS, 1))
    errors = np.stack([-turn * at[:, 1], turn * at[:, 0]], axis=2)
    assert p_alike(np.zeros_like(errors), there, *lines(at), SD) == 1.0
    assert p_alike(errors, there, *lines(at), SD) == 1.0
    errors[..., 0] *= 1.01
    assert p_alike(errors, there, *lines(at), SD) == pytest.approx(0.0, abs=1e-12)


def test_what_is_known_to_move_axes_apart_is_counted() -> None:
    at, errors = drawn(2, apart=1.5)
    there = np.ones((PARTS, FEATURES), bool)
    sure, less = (p_alike(errors, there, *lines(at), SD, further) for further in (1.0, 4.0))
    assert sure is not None
    assert less is not None
    assert less > sure


def test_an_axis_without_scatter_is_held_against_nothing() -> None:
    at, errors = drawn(3)
    there = np.ones((PARTS, FEATURES), bool)
    for sd in ([1.0, 0.0], [1e-5, 1.0]):
        assert p_alike(errors, there, *lines(at), np.array(sd)) is None


@pytest.mark.parametrize("sd", [[0.1, 1.0], [1.0, 0.01]])
def test_an_axis_that_scatters_little_is_held_against_the_other(sd: list[float]) -> None:
    at, errors = drawn(3, apart=40.0)
    there = np.ones((PARTS, FEATURES), bool)
    p = p_alike(errors * np.array(sd) / SD, there, *lines(at), np.array(sd))
    assert p is not None
    assert p < 0.05


def test_axes_that_differ_by_little_differ_where_nothing_scatters() -> None:
    """By a share of 1e-7: its square is far less than what parts turn by, and no rounding."""
    at, there = places(1), np.ones((PARTS, FEATURES), bool)
    turn = np.random.default_rng(1).normal(size=(PARTS, 1))
    errors = np.stack([-turn * at[:, 1] * (1 + 1e-7), turn * at[:, 0]], axis=2)
    assert p_alike(errors, there, *lines(at), SD) == pytest.approx(0.0, abs=1e-12)


def test_as_many_columns_as_can_be_are_tested() -> None:
    rng = np.random.default_rng(4)
    found = {}
    for count in (2 * FEATURES, MOST_COLUMNS, MOST_COLUMNS + 1):
        at = rng.uniform(-1.0, 1.0, (count, 2))
        errors = SD * rng.normal(size=(3, count, 2))
        found[count] = p_alike(errors, np.ones((3, count), bool), *lines(at), SD) is not None
    assert [*found.values()] == [True, True, False]
    assert MOST_COLUMNS == 300


def test_of_features_on_an_oblique_line_nothing_tells_axes_apart() -> None:
    """Turns and growths of the whole are all that parts can do there, but for rounding."""
    for slope in (1.0, 0.5, 0.3):
        turn, growth = np.array([[0.0, -slope], [0.0, 1.0]]), np.array([[0.0, 1.0], [0.0, slope]])
        assert apart_from_whole(turn, [turn, growth]) is None
        assert apart_from_whole(turn, [turn]) is not None


def test_what_tells_axes_apart_is_free_of_the_whole() -> None:
    X = np.column_stack([np.ones(FEATURES), places(1) - places(1).mean(axis=0)])
    r = np.linalg.qr(X)[1]
    whole = [own @ r.T for own in (TURN, GROWTH)]
    apart = apart_from_whole(whole[0], whole)
    assert apart is not None
    for own in whole:
        assert np.sum(apart * own) == pytest.approx(0.0, abs=1e-12)
