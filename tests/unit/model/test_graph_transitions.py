"""Every transition against a value worked out by hand; nominals that determine none; chances."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mtu_cli.model.geometry import GeometryError
from mtu_cli.model.graph.transitions import TRANSITIONS, Step, matches

S2, S3 = math.sqrt(2), math.sqrt(3)
N3 = [1 / S3] * 3
# Simple enough for a head; planes and lines as a point and a unit vector.
PLACES: dict[str, tuple[str, Any]] = {
    "xa": ("a coordinate x", 1), "xb": ("a coordinate x", 5), "ya": ("a coordinate y", 2),
    "yb": ("a coordinate y", 4), "za": ("a coordinate z", 10), "c": ("a constant", 1.5),
    "r": ("a constant", 3 * S3), "O": ("a point", [0, 0, 0]), "P": ("a point", [3, 4, 0]),
    "Q": ("a point", [3, 4, 12]), "A": ("a point", [6, 0, 0]), "B": ("a point", [0, 6, 0]),
    "D": ("a point", [0, 0, 6]), "E": ("a point", [6, 6, 0]), "F": ("a point", [6, 6, 6]),
    "OP": ("a vector", [3, 4, 0]), "Oz": ("a vector", [0, 0, 6]),
    "xy": ("a plane", [[0, 0, 0], [0, 0, 1]]), "yz": ("a plane", [[0, 0, 0], [1, 0, 0]]),
    "zx": ("a plane", [[0, 0, 0], [0, 1, 0]]), "tilted": ("a plane", [[6, 0, 0], N3]),
    "OA": ("a line", [[0, 0, 0], [1, 0, 0]]), "BF": ("a line", [[0, 6, 0], [1 / S2, 0, 1 / S2]]),
    # The frame of yz, BF and P: z along yz's normal x, x along BF's projection z, y = -y.
    "W": ("a frame", [[3, 4, 0], [0, 0, 1], [0, -1, 0], [1, 0, 0]]),
}  # fmt: skip
CASES: list[tuple[Any, ...]] = [
    ("displace", "xa c", 2.5),
    ("displace", "P Oz", [3, 4, 6]),
    ("middle", "A F", [6, 3, 3]),
    ("vector", "P F", [3, 2, 6]),
    ("unit_v", "OP", [0.6, 0.8, 0]),
    ("unit_v", "P F", [3 / 7, 2 / 7, 6 / 7]),
    ("ratio", "OP c", [4.5, 6, 0]),
    ("ratio", "c c", 2.25),
    ("length", "OP", 5),
    ("length", "O Q", 13),
    ("ball", "xa xb ya yb za c", [3, 3, 8.5]),
    ("hole", "xa xb ya yb", [3, 3, 0]),
    ("hole", "xa xb ya yb c", [3, 3, 1.5]),
    # A, B, D: equilateral, side 6 sqrt 2; O, A, E, B: a square of side 6.
    ("circle", "A B D", [2, 2, 2], 2 * math.sqrt(6)),
    ("circle", "O A E B", [3, 3, 0], 3 * S2),
    ("sphere", "O A B D", [3, 3, 3], 3 * S3),
    ("sphere", "O A B D E F", [3, 3, 3], 3 * S3),
    ("sphere", "O A B D r", [3, 3, 3]),
    ("line", "A F", [[6, 0, 0], [0, 1 / S2, 1 / S2]]),
    ("line", "xy zx", [[0, 0, 0], [-1, 0, 0]]),
    ("aline", "A OP", [[6, 0, 0], [0.6, 0.8, 0]]),
    ("plane", "D A B", [[0, 0, 6], N3]),
    ("plane", "O B E A", [[3, 3, 0], [0, 0, -1]]),
    ("plane", "A OP", [[6, 0, 0], [0.6, 0.8, 0]]),
    ("point", "BF xy", [0, 6, 0]),
    ("point", "OA tilted", [6, 0, 0]),
    ("point", "xy yz zx", [0, 0, 0]),
    ("point", "xy yz tilted", [0, 6, 0]),
    ("normal", "tilted", N3),
    ("direction", "BF", [1 / S2, 0, 1 / S2]),
    # O along (3, 4, 0) onto x + y + z = 6: t = 6/7.
    ("project", "O OP tilted", [18 / 7, 24 / 7, 0]),
    ("per_proj", "F tilted", [2, 2, 2]),
    ("per_proj", "Q OA", [3, 0, 0]),
    ("distance", "P Q", 12),
    ("distance", "Q OA", math.hypot(4, 12)),
    ("distance", "F tilted", 12 / S3),
    ("distance", "OA BF", 6),
    ("angle", "OP Oz", math.pi / 2),
    ("frame", "xy BF D", [[0, 0, 6], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ("transform", "W F", [6, -2, 3]),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]} {case[1]}")
def test_transition(case: tuple[Any, ...]) -> None:
    do, names, expected, *radius = case
    inputs, outputs = tuple(names.split()), ("result", "second")[: 1 + len(radius)]
    use = next(x for x in TRANSITIONS[do] if matches(x.takes, [PLACES[n][0] for n in inputs]))
    found = {name: np.array(PLACES[name][1], float)[..., None] for name in inputs}
    Step(index=0, do=do, use=use, inputs=inputs, outputs=outputs).ready(found)
    assert found["result"][..., 0] == pytest.approx(np.array(expected, float), abs=1e-14)
    if radius:
        assert found["second"][0] == pytest.approx(radius[0], rel=1e-14)


def test_every_transition_is_tried() -> None:
    assert {do for do, *_ in CASES} | {"meas", "compute"} == set(TRANSITIONS)


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
DEGENERATE = [
    ("unit_v", 0, [O], [1e-9 * X], "a vector has no length"),
    ("unit_v", 1, [X, X], [X, 2 * X], "the two points coincide"),
    ("line", 0, [9 * X, 9 * X], [9 * X, 9.1 * X], "the two points coincide"),
    ("line", 1, [along(O, Z), along(X, -Z)], [along(O, Z), along(O, TILTED)],
     "the planes are parallel"),
    ("aline", 0, [X, O], [O, X], "a vector has no length"),
    ("plane", 1, [X, O], [O, X], "a vector has no length"),
    ("plane", 0, [O, X, 3 * X], [O, X, 3 * X + TILT * Y], "the points lie on a line"),
    ("plane", 0, [O, X, O], [O, X, Y], "the points lie on a line"),
    ("plane", 0, [O, X, 2 * X, 3 * X], [O, X, 2 * X, Y], "line"),
    ("circle", 0, [X, 2 * X, 4 * X], [X, Y, -X], "the points lie on a line"),
    ("circle", 0, [X, 2 * X, 4 * X, 5 * X], [X, Y, -X, -Y], "line"),
    ("sphere", 0, [X, Y, -X, -Y], CORNERS, "plane or a circle"),
    ("sphere", 1, [X, Y, -X, -Y, np.ones(())], [*CORNERS, np.ones(())],
     "plane or a circle"),
    ("point", 0, [along(O, X), along(X, Z)], [along(O, X + TILT * Z), along(X, Z)],
     "the line is parallel to the plane"),
    ("point", 1, [along(O, X), along(O, Y), along(X, X + Y)],
     [along(O, X), along(O, Y), along(O, X + TILT * Z)], "the three planes meet in no single"),
    ("project", 0, [O, 5 * X, along(O, Z)], [O, X + TILT * Z, along(O, Z)],
     "the vector is parallel to the plane"),
    ("distance", 3, [along(O, Z), along(X, Z)], [along(O, Z), along(X, TILTED)],
     "the lines are parallel"),
    ("angle", 0, [X, O], [X, X], "a vector has no length"),
    ("frame", 0, [along(O, Z), along(O, Z), O], [along(O, Z), along(O, TILTED), O],
     "the line is perpendicular to the plane"),
]  # fmt: skip


@pytest.mark.parametrize(("do", "use", "bad", "good", "words"), DEGENERATE)
def test_degenerate_nominals_and_their_neighbours(
    do: str, use: int, bad: list[Floats], good: list[Floats], words: str
) -> None:
    names = tuple(map(str, range(len(bad))))
    step = Step(index=0, do=do, use=TRANSITIONS[do][use], inputs=names, outputs=("out",))

    def ready(places: list[Floats]) -> None:
        step.ready({name: place[..., None] for name, place in zip(names, places, strict=True)})

    with pytest.raises(GeometryError, match=words):
        ready(bad)
    ready(good)
