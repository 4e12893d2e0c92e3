"""The variance of linear measurands, composed of mean squares, against its plain definitions."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.stats.composed_variance import (
    CoefficientBlock,
    covariance_of,
    normal_block,
    variance_of,
)
from mtu_cli.stats.least_squares import FloatArray

POINTS, AXES, PASSES = 4, 2, 6
ROWS = POINTS * AXES


def wishart(rng: np.random.Generator, k: int, scale: float = 1.0) -> FloatArray:
    root = rng.normal(size=(k, k + 2))
    return scale * root @ root.T


def blocks(seed: int) -> list[CoefficientBlock]:
    """Two components read in the same passes, one of a machine file, and a reading of all points
    and of each.
    """
    rng = np.random.default_rng(seed)
    between = wishart(rng, 4)
    fitted = CoefficientBlock(
        names=("a", "b"),
        columns=(slice(0, 2), slice(2, 4)),
        G=rng.normal(size=(ROWS, 4)),
        C=between / PASSES,
        D=between - 1e-3 * np.eye(4),
        noise=rng.normal(size=(ROWS, 2)),
        pass_dof=PASSES - 1.0,
        repeat_dof=(40.0, 50.0),
        between=between,
        n_passes=PASSES,
    )
    stated = CoefficientBlock(
        names=("c",),
        G=rng.normal(size=(ROWS, 3)),
        C=wishart(rng, 3),
        D=wishart(rng, 3, 0.1),
        noise=rng.normal(size=(ROWS, 1)),
        pass_dof=7.0,
        repeat_dof=(30.0,),
    )
    shared = normal_block("T", rng.normal(size=(ROWS, 2)), of_part=True, dof=9.0)
    return [fitted, stated, shared, normal_block("u", rng.normal(size=ROWS))]


@pytest.mark.parametrize("seed", range(5))
def test_it_is_that_of_the_law_of_propagation(seed: int) -> None:
    given = blocks(seed)
    A = np.random.default_rng(seed).normal(size=(3, ROWS))
    whole, found = covariance_of(given, AXES), variance_of(given, A, AXES)
    assert found.total == pytest.approx(np.diag(A @ whole @ A.T))
    assert found.total == pytest.approx(found.by_block.sum(axis=0))
    assert found.coefficients + found.passes + found.repeatability == pytest.approx(found.total)
    of_mean = covariance_of(given, AXES) - covariance_of(given, AXES, coefficients=0.0)
    assert found.squares.of_mean.sum(axis=0) == pytest.approx(np.diag(A @ of_mean @ A.T))
    alone, by_identity = variance_of(given, None, AXES), variance_of(given, np.eye(ROWS), AXES)
    assert alone.total.tolist() == by_identity.total.tolist()
    assert alone.dof.tolist() == by_identity.dof.tolist()
    each = covariance_of(given, AXES, by_point=True)
    square = whole.reshape(POINTS, AXES, POINTS, AXES)
    assert each == pytest.approx(np.array([square[i, :, i] for i in range(POINTS)]))


def test_a_drawable_covariance_has_no_negative_part() -> None:
    (fitted, *rest) = blocks(1)
    D = np.diag([1.0, -0.5])
    uneven = CoefficientBlock(
        names=("d",), G=fitted.G[:, :2], C=np.eye(2), D=D, noise=0 * fitted.noise[:, :1]
    )
    drawn = covariance_of([uneven], AXES, drawable=True, coefficients=0.0)
    assert np.linalg.eigvalsh(drawn)[0] > -1e-12
    assert np.linalg.eigvalsh(covariance_of([uneven], AXES, coefficients=0.0))[0] < -1e-3
    assert covariance_of(rest, AXES, drawable=True) == pytest.approx(covariance_of(rest, AXES))


def test_degrees_of_freedom_are_those_of_welch_and_satterthwaite() -> None:
    first = normal_block("a", np.array([[2.0]]), of_part=True, dof=4.0)
    second = normal_block("b", np.array([[1.0]]), of_part=True, dof=10.0)
    known = normal_block("c", np.array([[3.0]]))
    found = variance_of([first, second, known], None, 1)
    assert found.total.tolist() == [14.0]
    assert found.dof == pytest.approx([14.0**2 / (4.0**2 / 4.0 + 1.0 / 10.0)])
    # One mean square behind all of it.
    only = CoefficientBlock(
        names=("d",), G=np.ones((1, 1)), C=np.ones((1, 1)), D=np.zeros((1, 1)),
        noise=np.ones((1, 1)), repeat_dof=(8.0,),
    )  # fmt: skip
    assert variance_of([only], None, 1).dof.tolist() == [8.0]


def test_passes_that_differ_by_less_than_repeatability() -> None:
    """Visits, fewer than those of a pass's line, with D < 0: what is left has the passes' degrees
    of freedom, and is no less than nothing.
    """
    S = np.array([[1.0]])
    block = CoefficientBlock(
        names=("a",), G=np.ones((1, 1)), C=S / 5, D=S - 3.0, noise=np.full((1, 1), 1.0),
        pass_dof=4.0, repeat_dof=(40.0,), between=S, n_passes=5,
    )  # fmt: skip
    found = variance_of([block], None, 1)
    # s^2 w = 1 of s^2 M = 3, bounded by S = 1.
    assert found.total == pytest.approx([1 / 5 + 1 / 3])
    assert found.dof == pytest.approx([4.0])
