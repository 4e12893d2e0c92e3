"""Which rows and columns have an angle that their slopes stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mtu_cli.files.part import LoadedPart, load_part
from mtu_cli.findings import InputError
from mtu_cli.model.measurands import LARGEST_SLOPE, Line, angle_error, check_square

ROW = np.array([[14.0, 22.0], [106.0, 25.0], [200.0, 19.0], [310.0, 26.0]])
COLUMN = np.array([[14.0, 22.0], [21.0, 93.0], [14.0, 206.0], [6.0, 327.0]])
"""The holes of a housing: the column's line leans by 1.9 degrees."""


def part(folder: Path, lean: float) -> LoadedPart:
    """A part whose column leans to -x by `lean` of its height, after one that is square."""
    text = "schema: mtu/part/1\nname: housing\nfeatures:\n"
    for name, (x, y) in {
        "a": (0, 0),
        "b": (200, 0),
        "c": (0, 300),
        "d": (-300 * lean, 300),
    }.items():
        text += f"  {name}: {{x_mm: {x}, y_mm: {y}}}\n"
    text += "orthogonality:\n"
    for name, end in (("square", "c"), ("leaning", "d")):
        text += f"- id: {name}\n  row: [a, b]\n  column: [a, {end}]\n"
    (folder / "part.yaml").write_text(text, "utf-8")
    return load_part(folder / "part.yaml")


def line(places: np.ndarray, along: int) -> Line:
    u, v = places[:, [along]], places[:, [1 - along]]
    return u - u.mean(), v - v.mean()


def test_a_line_that_leans_is_told_with_line_and_limit(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        check_square(part(tmp_path, 1.01 * LARGEST_SLOPE), [0, 1])
    assert str(caught.value).endswith(
        "part.yaml:14: orthogonality[1].column: contradicts the nominal places: 'leaning' runs "
        "-5.77 degrees off y; expected features in a line along y, seen in the plane of x and y, "
        "at most 5.7 degrees off"
    )
    check_square(part(tmp_path, 1.01 * LARGEST_SLOPE), [0])


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
