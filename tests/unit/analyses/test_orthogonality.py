"""Angles of rows and columns: gradient, draws of shared features, Monte Carlo figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import FloatArray, estimate, model_of, part_of

from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.settings import Settings

FAST = Settings(trials=100_000, threads=1)
# A row and a column of four, off the axes, the corner in both.
ROW = np.array([[20.0, 10], [50, 12], [80, 9], [120, 10]])
COLUMN = np.array([[20.0, 10], [19, 40], [21, 80], [20, 130]])
PLACES = np.vstack([ROW, COLUMN[1:]])
IDS = list("abcdefg")
PART = (
    "features: {"
    + ", ".join(f"{i}: {{x_mm: {x}, y_mm: {y}}}" for i, (x, y) in zip(IDS, PLACES, strict=True))
    + "}\northogonality: [{id: xy, row: [a, b, c, d], column: [a, e, f, g]}]\n"
)
ROW_AT, COLUMN_AT = np.array([0, 1, 2, 3]), np.array([0, 4, 5, 6])


def machine(size: float = 1.0) -> MachineModel:
    sx = estimate("sx", "x", [2e-3, 1e-5], D=np.diag([4e-6, 9e-10]) * size**2, s=2e-3 * size)
    ez = estimate("ez", "x", [1e-5, 1e-8], C=np.diag([4e-10, 1e-14]) * size**2, s=1e-5 * size)
    return model_of([(sx, {"x": "1", "y": "-0.5"}), (ez, {"x": "y", "y": "-x"})])


def angle_of(moved: FloatArray) -> float:
    """Eqs. (24)-(26) by numpy's own straight-line fit, less the angle by design; (7, 2)."""
    return between_lines(moved) - between_lines(PLACES)


def between_lines(moved: FloatArray) -> float:
    row, column = moved[ROW_AT], moved[COLUMN_AT]
    of_row = np.polyfit(row[:, 0], row[:, 1], 1)[0]
    of_column = np.polyfit(column[:, 1], column[:, 0], 1)[0]
    return float(-of_column - of_row)


def test_against_parts_drawn_one_by_one(tmp_path: Path) -> None:
    """The corner is one hole: it is drawn once and stands in both lines."""
    found = predict_orthogonality(machine(), part_of(tmp_path, PART), FAST).angles[0]
    rng = np.random.default_rng(2)
    angles = []
    x, y = PLACES.T
    for _ in range(4000):
        b = rng.normal([2e-3, 1e-5], [2e-3, 3e-5])
        sx = b[0] + b[1] * x + 2e-3 * rng.standard_normal(7)
        c = rng.normal([1e-5, 1e-8], [2e-5, 1e-7])
        ez = c[0] + c[1] * x + 1e-5 * rng.standard_normal(7)
        angles.append(angle_of(PLACES + np.column_stack([sx + y * ez, -0.5 * sx - x * ez])))
    mean, u = np.mean(angles), np.std(angles, ddof=1)
    assert found.run.mean[0] == pytest.approx(mean, abs=4 * u / np.sqrt(4000))
    assert found.run.u[0] == pytest.approx(u, rel=4 * np.sqrt(0.5 / 4000))
    assert found.first_order.u == pytest.approx(u, rel=4 * np.sqrt(0.5 / 4000))
    assert found.prediction.ids == tuple("abcdefg")
    assert found.validation.passed is not False


def test_the_papers_independence(tmp_path: Path) -> None:
    found = predict_orthogonality(machine(), part_of(tmp_path, PART), FAST).angles[0]
    rng = np.random.default_rng(3)
    u = np.sqrt(found.prediction.independent_variance).reshape(7, 2)
    mean = found.prediction.mean.reshape(7, 2)
    angles = [angle_of(PLACES + mean + u * rng.standard_normal((7, 2))) for _ in range(4000)]
    assert found.independent.u[0] == pytest.approx(
        np.std(angles, ddof=1), rel=4 * np.sqrt(0.5 / 4e3)
    )
    assert found.independent_u == pytest.approx(found.independent.u[0], rel=0.02)
    assert found.independent.u[0] != pytest.approx(found.run.u[0], rel=0.05)
