"""Degrees of freedom by hand, and variances where a moment estimate of D is negative."""

from __future__ import annotations

import numpy as np
import pytest
from model_examples import Segment, estimate, model_of, readings
from numpy.typing import NDArray

from mtu_cli.files.machine_contract import Component
from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.model.estimation import fit_component
from mtu_cli.model.prediction import predict, reportable
from mtu_cli.stats.coverage import coverage_factor

FloatArray = NDArray[np.float64]
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
    hits, widths, machines = np.zeros(3), [], 250
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
    own = S * (1 / 5 + 8 / 25)
    other = estimate("o", None, [0.0], D=np.array([[0.1]]), pass_dof=7)
    both = model_of([(fitted(errors, 0), {"x": "1"}), (other, {"x": "1"})], axes=("x",))
    found = predict(both, [str(i) for i in range(25)], points).variance(np.full((1, 25), 1 / 25))
    assert found.dof == pytest.approx([(own + 0.1) ** 2 / (own**2 / 4 + 0.1**2 / 7)])


def test_the_reported_covariance_is_one() -> None:
    points = np.column_stack([np.linspace(-400.0, 600.0, 30), np.zeros(30), np.zeros(30)])
    mended = 0
    for seed in range(20):
        model = model_of([(undrifted(seed), {"x": "1"})], axes=("x",))
        prediction = predict(model, [str(i) for i in range(30)], points)
        variance = prediction.variance(np.eye(30)).total
        found = reportable(prediction, variance)
        assert np.diag(found) == pytest.approx(variance, rel=1e-9)
        assert np.linalg.eigvalsh(found)[0] > -1e-9 * np.linalg.eigvalsh(found)[-1]
        mended += found is not prediction.covariance
    assert 0 < mended < 20
