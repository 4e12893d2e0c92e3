"""Constructions that their nominal places do not determine, and the nearest that they do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mtu_cli.model.graph.degenerate import degenerate

Floats = NDArray[np.float64]

X, Y, Z = np.eye(3)
O = np.zeros(3)  # noqa: E741  # the origin
TILT = 1e-4
"""rad: a hundred times what counts as parallel."""


def along(point: Floats, direction: Floats) -> Floats:
    """A line, or a plane with that normal: (2, 3)."""
    return np.array([point, direction / np.linalg.norm(direction)])


TILTED = Z + TILT * X
CORNERS = [X, Y, Z, -X]
CASES = [
    ("unit_v", "vector", [O], [1e-9 * X], "the vector has no length"),
    ("unit_v", "points", [X, X], [X, 2 * X], "the two points coincide"),
    ("line", "points", [9 * X, 9 * X], [9 * X, 9.1 * X], "the two points coincide"),
    ("line", "planes", [along(O, Z), along(X, -Z)], [along(O, Z), along(O, TILTED)],
     "the planes are parallel"),
    ("aline", "", [X, O], [O, X], "the vector has no length"),
    ("plane", "vector", [X, O], [O, X], "the vector has no length"),
    ("plane", "points", [O, X, 3 * X], [O, X, 3 * X + TILT * Y], "the points lie on a line"),
    ("plane", "points", [O, X, O], [O, X, Y], "the points lie on a line"),
    ("plane", "points", [O, X, 2 * X, 3 * X], [O, X, 2 * X, Y], "line"),
    ("circle", "", [X, 2 * X, 4 * X], [X, Y, -X], "the points lie on a line"),
    ("circle", "", [X, 2 * X, 4 * X, 5 * X], [X, Y, -X, -Y], "line"),
    ("sphere", "free", [X, Y, -X, -Y], CORNERS, "plane or a circle"),
    ("sphere", "radius", [X, Y, -X, -Y, np.ones(())], [*CORNERS, np.ones(())],
     "plane or a circle"),
    ("point", "line", [along(O, X), along(X, Z)], [along(O, X + TILT * Z), along(X, Z)],
     "the line is parallel to the plane"),
    ("point", "planes", [along(O, X), along(O, Y), along(X, X + Y)],
     [along(O, X), along(O, Y), along(O, X + TILT * Z)], "the three planes meet in no single"),
    ("project", "", [O, 5 * X, along(O, Z)], [O, X + TILT * Z, along(O, Z)],
     "the vector is parallel to the plane"),
    ("distance", "lines", [along(O, Z), along(X, Z)], [along(O, Z), along(X, TILTED)],
     "the lines are parallel"),
    ("angle", "", [X, O], [X, X], "a vector has no length"),
    ("frame", "", [along(O, Z), along(O, Z), O], [along(O, Z), along(O, TILTED), O],
     "the line is perpendicular to the plane"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("do", "variant", "bad", "good", "words"), CASES, ids=lambda x: x if isinstance(x, str) else ""
)
def test_what_is_degenerate_is_told_and_its_neighbour_is_sound(
    do: str, variant: str, bad: list[Floats], good: list[Floats], words: str
) -> None:
    found = degenerate(do, variant, [place[..., None] for place in bad])
    assert found is not None
    assert words in found
    assert degenerate(do, variant, [place[..., None] for place in good]) is None


def test_what_cannot_be_degenerate_is_sound() -> None:
    assert degenerate("meas", "", []) is None
