"""Propagation against loops over pairs of points, and degrees of freedom by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model_examples import Segment, estimate, model_of, readings
from numpy.typing import NDArray

from mtu_cli.files.machine_contract import Component
from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.model.estimation import fit_component
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.prediction import predict
from mtu_cli.model.trials import factor_of, repaired
from mtu_cli.stats.coverage import coverage_factor

FloatArray = NDArray[np.float64]
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
    assert (variance.total >= 0).all()


@STEADY
@given(seeds, st.floats(0.01, 100.0))
def test_variance_scales_with_the_square_of_all_errors(seed: int, factor: float) -> None:
    from dataclasses import replace

    found = case(seed, 3, 3, joint=False)
    larger = [
        replace(
            term,
            estimate=replace(
                term.estimate,
                coefficients=factor * term.estimate.coefficients,
                covariance=factor**2 * term.estimate.covariance,
                pass_covariance=factor**2 * term.estimate.pass_covariance,
                s_repeat=factor * term.estimate.s_repeat,
            ),
        )
        for term in found.model.terms
    ]
    A = np.random.default_rng(seed).normal(size=(4, 6))
    one = predict(found.model, list("abc"), found.points)
    two = predict(replace(found.model, terms=tuple(larger)), list("abc"), found.points)
    assert two.mean == pytest.approx(factor * one.mean, rel=1e-12)
    assert two.variance(A).total == pytest.approx(factor**2 * one.variance(A).total, rel=1e-10)
    assert two.variance(A).dof == pytest.approx(one.variance(A).dof, rel=1e-9)


@STEADY
@given(seeds, st.permutations(range(4)))
def test_the_order_of_points_does_not_matter(seed: int, order: list[int]) -> None:
    found = case(seed, 3, 4, joint=False)
    ids = np.array(["a", "b", "c", "d"])
    one = predict(found.model, list(ids), found.points)
    two = predict(found.model, list(ids[order]), found.points[order])
    A = np.random.default_rng(seed).normal(size=(3, 8))
    moved = A.reshape(3, 4, 2)[:, order].reshape(3, 8)
    assert two.variance(moved).total == pytest.approx(one.variance(A).total, rel=1e-9)
    assert two.mean[two.row("c", "y")] == one.mean[one.row("c", "y")]


def test_a_feature_used_twice_is_one_visit() -> None:
    """The middle of three features in L1 - L2 moves with its whole error, not two draws."""
    part = estimate("c", "x", [0.0, 0.0], s=2.0)
    model = model_of([(part, {"x": "1"})], axes=("x",))
    result = predict(model, list("abc"), np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0]]))
    difference = np.array([[-1.0, 1 + 1, -1.0]])
    assert result.variance(difference).total == pytest.approx([4 * (1 + 4 + 1)])


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


# Degrees of freedom.

POSITIONS = np.linspace(20.0, 160.0, 8)


def read(
    rng: np.random.Generator, passes: int, level: float, slope: float, curve: float = 0.0
) -> FloatArray:
    """Readings (passes, 8) with repeatability 1."""
    p = POSITIONS - POSITIONS.mean()
    errors: FloatArray = (
        level * rng.standard_normal((passes, 1))
        + slope * rng.standard_normal((passes, 1)) * p
        + curve * p**2
        + rng.standard_normal((passes, len(p)))
    )
    return errors


def fitted(errors: FloatArray, degree: int = 1) -> ComponentEstimate:
    passes = len(errors)
    segment = Segment(
        name="c",
        position=np.tile(POSITIONS, passes),
        error=errors.ravel(),
        passes=np.repeat(np.arange(1, passes + 1), len(POSITIONS)),
    )
    component = Component(of="x", unit="mm", degree=degree)
    return fit_component(readings([segment]), "c", component).estimate


def at(item: ComponentEstimate, *x: float) -> tuple[FloatArray, FloatArray]:
    """Total variance and degrees of freedom of each point and of last minus first."""
    points = np.array([[value, 0.0, 0.0] for value in x])
    model = model_of([(item, {"x": "1"})], axes=("x",))
    A = np.vstack([np.eye(len(x)), np.eye(len(x))[-1] - np.eye(len(x))[0]])
    found = predict(model, [str(i) for i in range(len(x))], points).variance(A)
    return found.total, found.dof


def orthonormal(degree: int, x: FloatArray) -> FloatArray:
    """Rows phi_0(x) ... phi_degree(x), orthonormal over the positions of one pass."""
    centre, size = POSITIONS.mean(), np.ptp(POSITIONS)
    _Q, R = np.linalg.qr(np.vander((POSITIONS - centre) / size, degree + 1, increasing=True))
    values: FloatArray = np.linalg.solve(
        R.T, np.vander((x - centre) / size, degree + 1, increasing=True).T
    ).T
    return values


def by_hand(
    errors: FloatArray, degree: int, x: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Variance and effective degrees of freedom of sum weights * E(x), from mean squares.

    In polynomials orthonormal over a pass each pass's coefficients are independent with
    variance s^2; level and slope of a pass add D, the powers beyond are common.
    """
    n, m = errors.shape
    coefficients = errors @ orthonormal(degree, POSITIONS)
    q = min(2, degree + 1)
    centred = coefficients[:, :q] - coefficients[:, :q].mean(axis=0)
    S = centred.T @ centred / (n - 1)
    within = np.sum(errors**2) - np.sum(coefficients[:, :q] ** 2)
    within -= n * np.sum(coefficients[:, q:].mean(axis=0) ** 2)
    nu = n * (m - q) - (degree + 1 - q)
    s2 = within / nu
    g = weights @ orthonormal(degree, x)
    between = (1 + 1 / n) * g[:q] @ S @ g[:q]
    rest = s2 * (weights @ weights - g[:q] @ g[:q] + g[q:] @ g[q:] / n)
    total = between + rest
    return total, total**2 / (between**2 / (n - 1) + rest**2 / nu)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("drift", [0.0, 1.0])
def test_welch_satterthwaite_of_a_fitted_component(degree: int, drift: float) -> None:
    errors = read(np.random.default_rng(degree + 10), 6, drift, 0.02 * drift, 1e-3)
    x = np.array([25.0, 70.0, 150.0])
    total, dof = at(fitted(errors, degree), *x)
    for i, weights in enumerate([*np.eye(3), np.array([-1.0, 0, 1])]):
        wanted = by_hand(errors, degree, x, weights)
        assert total[i] == pytest.approx(wanted[0], rel=1e-9)
        assert dof[i] == pytest.approx(wanted[1], rel=1e-7)


def test_a_component_without_an_axis_has_the_papers_variance() -> None:
    """X = [1 ... 1]': s^2 (1 + 1/n), n - 1 degrees of freedom (Gilsinn & Ling 2004, eq. (14))."""
    error = np.array([3.0, 1.0, 4.0, 1.0, 5.0])
    segment = Segment(name="c", position=None, error=error, passes=np.arange(1, 6))
    item = fit_component(readings([segment]), "c", Component(unit="mm")).estimate
    model = model_of([(item, {"x": "2"})], axes=("x",))
    found = predict(model, ["p"], np.zeros((1, 3))).variance(np.eye(1))
    assert found.total == pytest.approx([4 * 6 / 5 * error.var(ddof=1)])
    assert found.dof == pytest.approx([4.0])


def test_welch_satterthwaite_over_components() -> None:
    """Blocks with known mean squares: 2, 3 and 5 mm^2 with 4, inf and 10 degrees of freedom."""
    items = [
        estimate("a", None, [0.0], D=np.array([[2.0]]), pass_dof=4),
        estimate("b", None, [0.0], C=np.array([[3.0]]), pass_dof=0),
        estimate("c", "x", [0.0], s=np.sqrt(5.0), pass_dof=0, repeat_dof=10),
    ]
    model = model_of([(item, {"x": "1"}) for item in items], axes=("x",))
    found = predict(model, ["p"], np.zeros((1, 3))).variance(np.eye(1))
    assert found.by_block[:, 0] == pytest.approx([2.0, 3.0, 5.0])
    assert found.dof == pytest.approx([10.0**2 / (2.0**2 / 4 + 5.0**2 / 10)])


def test_repeatabilities_of_a_group_keep_their_own_degrees_of_freedom() -> None:
    a = estimate("a", None, [0.0], s=3.0, repeat_dof=5)
    b = estimate("b", None, [0.0], s=1.0, repeat_dof=500)
    D = np.array([[1.0, 0.5], [0.5, 1.0]])
    group = JointPasses(
        components=("a", "b"),
        widths=(1, 1),
        covariance=np.zeros((2, 2)),
        pass_covariance=D,
        pass_dof=8,
        n_passes=None,
    )
    model = model_of([(a, {"x": "1"}), (b, {"x": "1"})], axes=("x",), joint=(group,))
    found = predict(model, ["p"], np.zeros((1, 3))).variance(np.eye(1))
    assert found.total == pytest.approx([3.0 + 9.0 + 1.0])
    assert found.dof == pytest.approx([13.0**2 / (3.0**2 / 8 + 9.0**2 / 5 + 1.0 / 500)])


@pytest.mark.parametrize(("degree", "drift"), [(3, 0.0), (3, 1.0), (1, 0.0)])
def test_intervals_cover_inside_and_outside_of_the_range(degree: int, drift: float) -> None:
    """Extrapolated by half the range, where the powers without passes outweigh all."""
    rng = np.random.default_rng(77)
    x = np.array([90.0, 160.0, 230.0])
    p = x - POSITIONS.mean()
    hits, widths, machines = np.zeros(3), [], 400
    for _ in range(machines):
        item = fitted(read(rng, 6, drift, 0.01 * drift), degree)
        total, dof = at(item, *x)
        half = [coverage_factor(0.95, nu) * np.sqrt(v) for v, nu in zip(total, dof, strict=True)][
            :3
        ]
        state = drift * rng.standard_normal() + 0.01 * drift * rng.standard_normal() * p
        future = state + rng.standard_normal(3)
        powers = np.vander(x, degree + 1, increasing=True)
        hits += np.abs(future - powers @ item.coefficients) <= half
        widths.append(half)
    assert hits / machines == pytest.approx(np.full(3, 0.95), abs=4 * np.sqrt(0.0475 / machines))
    # 1.96 standard deviations of the truth; t of five degrees of freedom is 2.57.
    g = orthonormal(degree, x)
    noise = 1 + (g**2).sum(axis=1) / 6
    ideal = 1.96 * np.sqrt(noise + drift**2 * (1 + (0.01 * p) ** 2) * (1 + 1 / 6))
    assert (np.median(widths, axis=0) < 1.5 * ideal).all()


# A negative moment estimate of D.

LINE = np.linspace(20.0, 160.0, 25)


def undrifted(seed: int) -> ComponentEstimate:
    return fitted(read(np.random.default_rng(seed), 5, 0.0, 0.0))


def test_variance_is_never_negative_and_never_next_to_nothing() -> None:
    """Means, slopes and far extrapolation of passes that hardly differ."""
    x = LINE - LINE.mean()
    A = np.vstack(
        [np.eye(25), x / (x @ x) * 140, np.full(25, 1 / 25), np.eye(25)[-1] - np.eye(25)[0]]
    )
    indefinite = 0
    for seed in range(60):
        item = undrifted(seed)
        indefinite += np.linalg.eigvalsh(item.pass_covariance)[0] < 0
        model = model_of([(item, {"x": "1"})], axes=("x",))
        for scale in (1.0, 5.0):
            points = np.column_stack([90 + scale * x, np.zeros(25), np.zeros(25)])
            found = predict(model, [str(i) for i in range(25)], points).variance(A)
            # Coefficients alone, and no fewer degrees of freedom than the passes have.
            assert (found.total >= found.coefficients * (1 - 1e-12)).all()
            assert (found.total > 0).all()
            assert (found.dof >= 4 * (1 - 1e-12)).all()
            parts = found.coefficients + found.passes + found.repeatability
            assert parts == pytest.approx(found.total, rel=1e-12)
    assert indefinite > 30


def test_variance_without_room_for_repeatability_by_hand() -> None:
    """A mean of 25 visits, of passes whose levels scatter less than repeatability makes them."""
    seed = next(s for s in range(99) if undrifted(s).pass_covariance[0, 0] < 0)
    errors = read(np.random.default_rng(seed), 5, 0.0, 0.0)
    model = model_of([(fitted(errors, 0), {"x": "1"})], axes=("x",))
    points = np.column_stack([LINE, np.zeros(25), np.zeros(25)])
    levels = errors.mean(axis=1)
    S = levels.var(ddof=1)
    s2 = np.sum((errors - levels[:, None]) ** 2) / (40 - 5)
    found = predict(model, [str(i) for i in range(25)], points).variance(np.full((1, 25), 1 / 25))
    assert s2 / 8 > S
    # S stands for s^2/8 as well: a pass's mean is of 8 visits, this one of 25.
    assert found.total == pytest.approx([S * (1 / 5 + 8 / 25)])
    assert found.dof == pytest.approx([4.0])


def test_factor_of_an_indefinite_matrix_keeps_the_variances() -> None:
    rng = np.random.default_rng(8)
    for _ in range(20):
        vectors = np.linalg.qr(rng.normal(size=(6, 6)))[0]
        S = vectors @ np.diag([4.0, 2, 1, 0.5, -0.2, -0.4]) @ vectors.T
        F = factor_of(S)
        kept = np.diag(S) >= 0
        assert np.diag(F @ F.T)[kept] == pytest.approx(np.diag(S)[kept], rel=1e-12)
        assert np.linalg.eigvalsh(F @ F.T)[0] > -1e-12


def test_factor_of_singular_and_zero_matrices() -> None:
    half = np.random.default_rng(9).normal(size=(7, 2))
    F = factor_of(half @ half.T)
    assert F.shape == (7, 2)
    assert pytest.approx(half @ half.T, rel=1e-12, abs=1e-13) == F @ F.T
    assert factor_of(np.zeros((3, 3))).shape == (3, 0)


def test_the_reported_covariance_is_one() -> None:
    points = np.column_stack([np.linspace(-400.0, 600.0, 30), np.zeros(30), np.zeros(30)])
    mended = 0
    for seed in range(20):
        model = model_of([(undrifted(seed), {"x": "1"})], axes=("x",))
        prediction = predict(model, [str(i) for i in range(30)], points)
        variance = prediction.variance(np.eye(30)).total
        found = repaired(prediction.covariance, variance)
        assert np.diag(found) == pytest.approx(variance, rel=1e-9)
        assert np.linalg.eigvalsh(found)[0] > -1e-9 * np.linalg.eigvalsh(found)[-1]
        mended += found is not prediction.covariance
    assert 0 < mended < 20
