"""Formulas of a graph with the coordinates of points and vectors; messages about names."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.graph_file import load_graph
from mtu_cli.files.graph_formulas import parse_dotted
from mtu_cli.files.graph_names import SHOWN, known_places
from mtu_cli.language import names, parse, to_text

TEXT = """schema: mtu/graph/1
name: example
places:
  N: {kind: point, nominal_mm: [0, 0, 0], known: true}
  P: {kind: point, nominal_mm: [1, 2, 3]}
  P_x: {kind: constant, value: 3}
  v: {kind: vector}
  c: {kind: constant}
transitions:
  - {do: meas, out: P, along: x}
  - {do: vector, in: [N, P], out: v}
  - {do: compute, in: [P, v, P_x], out: c, formula: FORMULA}
"""


def fault_of(folder: Path, formula: str) -> str:
    path = folder / "graph.yaml"
    path.write_text(TEXT.replace("FORMULA", formula), "utf-8")
    with pytest.raises(InputError) as caught:
        load_graph(path)
    (problem,) = caught.value.findings
    assert problem.line == 12
    return str(problem).partition("formula: ")[2]


def test_names_with_a_dot_keep_their_columns() -> None:
    tree = parse_dotted("H1.x - H1_x*(H1.y + 2.5)/v2.k")
    assert names(tree) == {"H1.x": 1, "H1_x": 8, "H1.y": 14, "v2.k": 26}
    assert to_text(tree) == "H1.x - H1_x*(H1.y + 2.5)/v2.k"


@pytest.mark.parametrize("text", ["2.5*x", "1.e3 + x", ".5 - 1.*x", "3.*x + 2.e-3", "x"])
def test_numbers_with_a_dot_stay_numbers(text: str) -> None:
    assert parse_dotted(text) == parse(text)


def test_coordinates_are_inputs(tmp_path: Path) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(TEXT.replace("FORMULA", "P.x*P_x + v.k - P.y"), "utf-8")
    steps = load_graph(path).steps
    assert steps[-1].formula == parse_dotted("P.x*P_x + v.k - P.y")


@pytest.mark.parametrize(
    ("formula", "told"),
    [
        ("P.u + v.i*P_x", "a point has no such coordinate: 'P.u' at column 1; expected one of: "
         "P.x, P.y, P.z"),
        ("v.x + P.x*P_x", "a vector has no such coordinate: 'v.x' at column 1; expected one of: "
         "v.i, v.j, v.k"),
        ("P + v.i*P_x", "'P' is a point: a formula takes its coordinates at column 1; expected "
         "one of: P.x, P.y, P.z"),
        ("P.x + v.i*P_x.value", "a constant has no such coordinate: 'P_x.value' at column 11; "
         "expected P_x"),
        ("P.x*P_x*v.i*N.x", "'N' is not an input of this transition at column 13; expected one "
         "of: P, v, P_x"),
    ],
)  # fmt: skip
def test_faults_of_names(formula: str, told: str, tmp_path: Path) -> None:
    assert fault_of(tmp_path, formula) == told


def test_an_input_without_use(tmp_path: Path) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(TEXT.replace("FORMULA", "P.x*P_x"), "utf-8")
    with pytest.raises(InputError, match="the formula does not use this input: 'v'"):
        load_graph(path)


def test_a_radius_that_nothing_uses_may_be_left_out(tmp_path: Path) -> None:
    text = """schema: mtu/graph/1
name: example
places:
  a: {kind: point, nominal_mm: [1, 0, 0]}
  b: {kind: point, nominal_mm: [0, 1, 0]}
  c: {kind: point, nominal_mm: [-1, 0, 0]}
  M: {kind: point}
  r: {kind: constant}
transitions:
  - {do: meas, out: a, along: x}
  - {do: meas, out: b, along: y}
  - {do: meas, out: c, along: x}
  - {do: circle, in: [a, b, c], out: [M, r]}
report: [M]
"""
    path = tmp_path / "graph.yaml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError) as caught:
        load_graph(path)
    (problem,) = caught.value.findings
    assert problem.expected == (
        "an input of a transition, or `report: [M, r]`; or without the radius: `out: M`"
    )
    path.write_text(text.replace("out: [M, r]", "out: M").replace("  r: {kind: constant}\n", ""))
    assert load_graph(path).reported == ("M",)


def test_known_places_come_closest_first() -> None:
    known = ["O", "tol", *(f"p{i}" for i in range(20)), "Rim", "R"]
    assert known_places("r1m", known) == "did you mean 'Rim'?"
    told = known_places("Q", known)
    assert told.startswith("one of: O, R, ")
    assert told.endswith(f" and {len(known) - SHOWN} more")
    # Half of what is asked for: too little for a guess, enough to come first.
    assert known_places("Rxyz", ["abcd", "efgh", "Rzq"]) == "one of: Rzq, abcd, efgh"
    assert known_places("x", []) == "no such name: none is known here"
