"""Degrees of freedom by hand, and variances where a moment estimate of D is negative."""

from __future__ import annotations

import numpy as np
import pytest
from model_examples import Segment, model_of, readings

from mtu_cli.files.machine import Component
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import fit_component
from mtu_cli.model.prediction import predict, reportable
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

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
