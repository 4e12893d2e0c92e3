"""Which rows and columns have an angle that their slopes stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import part_of

from mtu_cli.findings import InputError
from mtu_cli.model.measurands import LARGEST_SLOPE, Line, angle_error, check_square

ROW = np.array([[14.0, 22.0], [106.0, 25.0], [200.0, 19.0], [310.0, 26.0]])
COLUMN = np.array([[14.0, 22.0], [21.0, 93.0], [14.0, 206.0], [6.0, 327.0]])
"""The holes of a housing: the column's line leans by 1.9 degrees."""


def line(places: np.ndarray, along: int) -> Line:
    u, v = places[:, [along]], places[:, [1 - along]]
    return u - u.mean(), v - v.mean()


def test_a_line_that_leans_is_told_with_its_path(tmp_path: Path) -> None:
    """Of its height by more than the limit, to -x; the line before it is square."""
    lean = 1.01 * LARGEST_SLOPE
    text = f"""
    features: {{a: {{x_mm: 0, y_mm: 0}}, b: {{x_mm: 200, y_mm: 0}}, c: {{x_mm: 0, y_mm: 300}},
      d: {{x_mm: {-300 * lean}, y_mm: 300}}}}
    orthogonality: [{{id: q, row: [a, b], column: [a, c]}}, {{id: r, row: [a, b], column: [a, d]}}]
    """
    with pytest.raises(InputError, match=r"orthogonality\[1\].column: .* -5.77 degrees off y"):
        check_square(part_of(tmp_path, text), [0, 1])
    check_square(part_of(tmp_path, text), [0])


def test_slopes_of_jittered_lines_stand_for_their_angle() -> None:
    """Against the angle between the lines themselves, for errors of a tilt, of a bend and of a set
    up: a slope's change is its angle's but for the square of the lean, and a turn is no angle.
    """
    nominal = line(ROW, 0), line(COLUMN, 1)
    bend = np.column_stack([4e-4 * (COLUMN[:, 1] / 300) ** 2, np.zeros(4)])
    turned = np.array([[0.0, 1e-4], [-1e-4, 0.0]])

    def angle(row: np.ndarray, column: np.ndarray) -> float:
        leans = np.polyfit(row[:, 0], row[:, 1], 1)[0], np.polyfit(column[:, 1], column[:, 0], 1)[0]
        return float(-np.arctan(leans).sum())

    square = angle(ROW, COLUMN)
    for error in (bend, np.column_stack([1e-4 * COLUMN[:, 1], np.zeros(4)])):
        placed = line(ROW, 0), line(COLUMN + error, 1)
        expected = angle(ROW, COLUMN + error) - square
        assert angle_error(placed, nominal)[0] == pytest.approx(expected, rel=2 * 0.034**2)
    placed = line(ROW + ROW @ turned, 0), line(COLUMN + COLUMN @ turned, 1)
    assert abs(angle_error(placed, nominal)[0]) < 0.005 * 1e-4
