"""Propagation with covariance against loops over pairs of points."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
import pytest
from compare_trials import fitted
from hypothesis import given, settings
from hypothesis import strategies as st
from model_examples import estimate, model_of

from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray

STEADY = settings(derandomize=True, deadline=None, database=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


@dataclass(frozen=True)
class Case:
    """A random machine: lever arms c0 + cx x + cy y by component and axis, and its group."""

    model: MachineModel
    estimates: list[ComponentEstimate]
    levers: list[dict[str, tuple[float, float, float]]]
    group: JointPasses | None
    points: FloatArray


def spread(rng: np.random.Generator, k: int) -> FloatArray:
    """A random covariance, singular at times."""
    half = rng.normal(size=(k, rng.integers(1, k + 1)))
    whole: FloatArray = half @ half.T
    return whole


def case(seed: int, components: int, points: int, joint: bool) -> Case:
    rng = np.random.default_rng(seed)
    estimates, levers = [], []
    for c in range(components):
        of = (None, "x", "y")[int(rng.integers(3))]
        k = 1 if of is None else int(rng.integers(1, 5))
        scale = 20.0 ** -np.arange(k)
        estimates.append(
            estimate(
                f"c{c}",
                of,
                rng.normal(size=k) * scale,
                C=spread(rng, k) * np.outer(scale, scale),
                D=spread(rng, k) * np.outer(scale, scale),
                s=float(rng.uniform(0, 2)),
                pass_dof=float(rng.integers(3, 12)),
                repeat_dof=float(rng.integers(20, 80)),
            )
        )
        axes = [("x",), ("y",), ("x", "y")][int(rng.integers(3))]
        levers.append({axis: tuple(np.round(rng.normal(size=3), 3)) for axis in axes})
    group = None
    if joint:
        sizes = [len(item.coefficients) for item in estimates]
        scale = np.concatenate([20.0 ** -np.arange(k) for k in sizes])
        K = sum(sizes)
        group = JointPasses(
            components=tuple(item.name for item in estimates),
            widths=tuple(sizes),
            covariance=spread(rng, K) * np.outer(scale, scale),
            pass_covariance=spread(rng, K) * np.outer(scale, scale),
            pass_dof=7.0,
            n_passes=None,
        )
    model = model_of(
        [
            (item, {axis: f"{a} + ({b})*x + ({d})*y" for axis, (a, b, d) in arms.items()})
            for item, arms in zip(estimates, levers, strict=True)
        ],
        joint=() if group is None else (group,),
    )
    places = np.column_stack([rng.uniform(-30, 30, (points, 2)), np.zeros(points)])
    return Case(model, estimates, levers, group, places)


def slow_covariance(found: Case) -> FloatArray:
    """x_p'(C + D)x_q + [p = q] s^2 over all pairs of rows and components, one at a time."""
    n = len(found.points)
    total = np.zeros((2 * n, 2 * n))
    for p in range(n):
        for q in range(n):
            for i, one in enumerate("xy"):
                for j, other in enumerate("xy"):
                    total[2 * p + i, 2 * q + j] = _pair(found, p, q, one, other)
    return total


def _pair(found: Case, p: int, q: int, one: str, other: str) -> float:
    total = 0.0
    start = np.cumsum([0] + [len(item.coefficients) for item in found.estimates])
    for c, first in enumerate(found.estimates):
        for d, second in enumerate(found.estimates):
            if one not in found.levers[c] or other not in found.levers[d]:
                continue
            if found.group is not None:
                rows, columns = slice(start[c], start[c + 1]), slice(start[d], start[d + 1])
                S = (found.group.covariance + found.group.pass_covariance)[rows, columns]
            elif c == d:
                S = first.covariance + first.pass_covariance
            else:
                continue
            u = _arm(found, c, one, p) * _powers(first, found.points[p])
            v = _arm(found, d, other, q) * _powers(second, found.points[q])
            total += float(u @ S @ v)
            if c == d and p == q:
                total += _arm(found, c, one, p) * _arm(found, c, other, p) * first.s_repeat**2
    return total


def _arm(found: Case, c: int, axis: str, p: int) -> float:
    a, b, d = found.levers[c][axis]
    x, y, _ = found.points[p]
    return float(a + b * x + d * y)


def _powers(item: ComponentEstimate, place: FloatArray) -> FloatArray:
    position = 0.0 if item.of is None else place["xyz".index(item.of)]
    return np.array([position**k for k in range(len(item.coefficients))])


@STEADY
@given(seeds, st.integers(1, 4), st.integers(1, 4), st.booleans())
def test_against_the_slow_sum(seed: int, components: int, points: int, joint: bool) -> None:
    found = case(seed, components, points, joint and components > 1)
    result = predict(found.model, [str(i) for i in range(points)], found.points)
    wanted = slow_covariance(found)
    size = max(np.abs(wanted).max(), 1e-300)
    assert result.covariance == pytest.approx(wanted, rel=1e-9, abs=1e-10 * size)
    A = np.random.default_rng(seed).normal(size=(5, 2 * points))
    variance = result.variance(A)
    assert variance.total == pytest.approx(np.diag(A @ wanted @ A.T), rel=1e-8, abs=1e-9 * size)
    assert variance.by_block.sum(axis=0) == pytest.approx(variance.total, rel=1e-12)
    parts = variance.coefficients + variance.passes + variance.repeatability
    assert parts == pytest.approx(variance.total, rel=1e-12)
    for i, total in enumerate(variance.total):
        shares = variance.shares(i)
        assert (shares is None) == (total == 0)
        if shares is not None:
            assert shares.passes == variance.passes[i] / total
            assert sum(astuple(shares)) == pytest.approx(1, rel=1e-12)
    assert (variance.total >= 0).all()
    own, multiplied = result.variance(), result.variance(np.eye(2 * points))
    for name in ("total", "dof", "by_block", "coefficients", "passes", "repeatability"):
        np.testing.assert_array_equal(getattr(own, name), getattr(multiplied, name))


def test_a_group_of_which_the_equations_use_some() -> None:
    rng = np.random.default_rng(4)
    S, T = spread(rng, 5), spread(rng, 5)
    own = [estimate("a", "x", [1.0, 2.0]), estimate("b", None, [1.0]), estimate("c", "y", [1, 2])]
    group = JointPasses(
        components=("a", "b", "c"),
        widths=(2, 1, 2),
        covariance=S,
        pass_covariance=T,
        pass_dof=5,
        n_passes=None,
    )
    model = model_of([(own[2], {"x": "1"}), (own[0], {"x": "3"})], axes=("x",), joint=(group,))
    x, y = 4.0, -7.0
    g = np.array([3.0, 3 * x, 0.0, 1.0, y])
    found = predict(model, ["p"], np.array([[x, y, 0.0]])).variance(np.eye(1))
    assert found.total == pytest.approx([g @ (S + T) @ g])
    assert found.by_block.shape == (1, 1)


@STEADY
@given(seeds, st.booleans())
def test_mean_squares_add_up_to_what_they_stand_behind(seed: int, joint: bool) -> None:
    found = case(seed, 3, 3, joint)
    A = np.random.default_rng(seed).normal(size=(4, 6))
    variance = predict(found.model, list("abc"), found.points).variance(A)
    squares = variance.squares
    size = variance.total.max()
    assert squares.of_mean.sum(axis=0) == pytest.approx(variance.coefficients, abs=1e-9 * size)
    of_part = variance.passes + variance.repeatability
    assert squares.of_part.sum(axis=0) == pytest.approx(of_part, abs=1e-9 * size)
    assert len(squares.dof) == len(squares.of_mean)
    whole = squares.of_mean + squares.of_part
    spread = (whole**2 / squares.dof[:, None]).sum(axis=0)
    least = np.where(whole == 0, np.inf, squares.dof[:, None]).min(axis=0)
    assert variance.dof == pytest.approx(np.maximum(variance.total**2 / spread, least))


def test_what_passes_tell_has_their_degrees_of_freedom() -> None:
    """Two runs there and back, fitted: the coefficients have one degree of freedom (so has the axis
    angle, read once a pass), whatever size the moment estimate of D came out at.
    """
    prediction = predict(fitted(2, 3), ["a"], np.array([[75.0, 75.0, 127.0]]))
    squares = prediction.variance(np.eye(2)).squares
    behind_mean = squares.dof[(squares.of_mean > 1e-6 * squares.of_mean.sum(axis=0)).any(axis=1)]
    assert set(behind_mean) == {1.0}
    few = squares.dof <= 1
    assert (squares.of_part[few].sum(axis=0) > 0).all()
    # Repeatability alone is left for the others.
    assert squares.dof[~few].min() > 30
    # Of both axes together they count no less often than of one.
    behind = [x for x in squares.passes if x is not None]
    assert behind
    assert all(1 <= x.independent(np.ones(2)) <= 2 for x in behind)
