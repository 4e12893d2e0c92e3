"""Graph files: values, signatures, the token rule, formulas, units, and the faults of a file."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from graph_examples import graph_of, shipped

from mtu_cli.files.contract import json_schema
from mtu_cli.files.graph_contract import TransitionKind
from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED
from mtu_cli.model.graph.net import load_graph
from mtu_cli.model.graph.propagation import GraphTrials
from mtu_cli.model.graph.transitions import TRANSITIONS, formula_unit


def faults(folder: Path, text: str) -> list[tuple[int | None, str | None, str]]:
    """Line, path and code of every fault."""
    with pytest.raises(InputError) as caught:
        graph_of(folder, text)
    return [(item.line, item.path, item.code) for item in caught.value.findings]


def test_faults_of_the_net(tmp_path: Path) -> None:
    """A place made twice, a cycle, parallel planes, a wrong kind: all at once, with their lines."""
    text = """
places:
  P: {kind: point, nominal_mm: [1, 2, 3], known: true}
  Q: {kind: point, nominal_mm: [4, 2, 3], known: true}
  R: {kind: point, nominal_mm: [4, 9, 3], known: true}
  x: {kind: coordinate, nominal_mm: 3}
  a: {kind: constant, u: 1}
  b: {kind: constant}
  n: {kind: plane}
  m: {kind: plane}
  L: {kind: line}
transitions:
  - {do: ratio, in: [b, b], out: a}
  - {do: ratio, in: [a, a], out: b}
  - {do: plane, in: [P, Q, R], out: n}
  - {do: plane, in: [R, Q, P], out: m}
  - {do: line, in: [n, m], out: L}
  - {do: plane, in: [P, R, Q], out: m}
  - {do: meas, out: x, along: x}
  - {do: compute, in: [x], out: x}
"""
    assert faults(tmp_path, text) == [
        (8, "places.x", "missing-key"),
        (9, "places.a.u", "incomplete"),
        (16, "transitions[1]", "graph-cycle"),
        (19, "transitions[4]", "no-finite-value"),
        (20, "transitions[5].out", "contradicts"),
        (21, "transitions[6].along", "misplaced"),
        (21, "transitions[6]", "graph-cycle"),
        (22, "transitions[7]", "missing-key"),
        (22, "transitions[7].out", "wrong-connection"),
        (22, "transitions[7].out", "contradicts"),
    ]


@pytest.mark.parametrize(
    ("formula", "code", "column"),
    [
        ("P.u + v.i*P_x", "unknown-name", 1),
        ("P + v.i*P_x", "unknown-name", 1),
        ("P.x + v.i*P_x.value", "unknown-name", 11),
        ("P.x*P_x*v.i*N.x", "unknown-name", 13),
        ("P.x*P_x", "unused-place", None),
    ],
)
def test_faults_of_names(formula: str, code: str, column: int | None, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        graph_of(tmp_path, FORMULA.replace("FORMULA", formula))
    (found,) = caught.value.findings
    assert (found.line, found.code, found.column) == (13, code, column)


def test_every_transition_is_in_the_contract_and_in_the_help() -> None:
    assert list(TRANSITIONS) == list(get_args(TransitionKind))
    assert json_schema("graph")["$defs"]["Transition"]["properties"]["do"]["enum"] == [*TRANSITIONS]
    text = (Path(__file__).parents[3] / "mtu_cli" / "help" / "graph.md").read_text("utf-8")
    assert [do for do in TRANSITIONS if f"`{do}`" not in text] == []


BAD = Path(__file__).parents[2] / "cli" / "invalid"


@pytest.mark.parametrize("folder", ["net", "places", "transitions", "degenerate", "formulas"])
def test_every_fault_of_a_bad_file_has_its_line(folder: str) -> None:
    with pytest.raises(InputError) as caught:
        load_graph(BAD / f"graph-{folder}" / "graph.yaml")
    assert all(item.line for item in caught.value.findings)


FORMULA = """
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


def test_coordinates_are_inputs(tmp_path: Path) -> None:
    text = "P.x*P_x + v.k - P.y"
    found = graph_of(tmp_path, FORMULA.replace("FORMULA", text))
    assert found.rounds[-1][0].formula == parse(text, BUDGET_FUNCTIONS, DOTTED)
    assert found.nominal["c"] == pytest.approx([4.0])


UNITS = {"x": "mm", "y": "mm", "a": "rad", "q": "mm^4", "k": "1", "c": None}


@pytest.mark.parametrize(
    ("formula", "unit"),
    [
        ("x + y", "mm"), ("x*y**3/12", "mm^4"), ("1/x**4", "mm^-4"), ("q/x", "mm^3"), ("x/y", "1"),
        ("2*a", "1"), ("atan2(x, y)", "rad"), ("x + c", "mm"), ("c", None), ("x*c", None),
        ("sqrt(x*y)", "mm"), ("exp(x/100)", "1"), ("cos(2*pi*x/25)", "1"), ("log(c)", "1"),
    ],
)  # fmt: skip
def test_unit_of_a_formula(formula: str, unit: str | None) -> None:
    assert formula_unit(parse(formula, BUDGET_FUNCTIONS), UNITS) == unit


# What is drawn has the covariance that the file states.


PROBED = """
uncertainty: {axis_um: 2, probe_um: 3, perpendicular_um: 6}
places:
  x: {kind: coordinate, axis: x, nominal_mm: 5}
  P: {kind: point, nominal_mm: [1, 2, 3]}
  Q: {kind: point, nominal_mm: [0, 0, 0]}
transitions:
  - {do: meas, out: x}
  - {do: meas, out: P, along: [3, 0, 4], repeats: 9}
  - {do: meas, out: Q, along: -y, uncertainty: {axis_um: 0}}
report: [x, P, Q]
"""


def test_probing(tmp_path: Path) -> None:
    """u_w^2 = u1^2 + u2^2/n + u3^2 along the probing, u1^2 across; um^2."""
    graph = graph_of(tmp_path, PROBED)
    found = GraphTrials(graph, graph.outputs())
    assert found.mean == pytest.approx([5, 1, 2, 3, 0, 0, 0])
    d = np.array([0.6, 0.0, 0.8])
    expected = np.diag([4.0 + 9 + 36, 4, 4, 4, 0, 9 + 36, 0])
    expected[1:4, 1:4] += (9 / 9 + 36) * np.outer(d, d)
    assert 1e6 * found.factor @ found.factor.T == pytest.approx(expected, abs=1e-12)
    m = 200_000
    X = 1e3 * (found.inputs(np.random.default_rng(1), m)[1] - found.mean[:, None])
    assert np.cov(X) == pytest.approx(expected, abs=5 * 49 * (2 / m) ** 0.5)


CONSTANTS = """
places:
  a: {kind: constant, value: 1, u: 1}
  b: {kind: constant, value: 2, u: 2}
  c: {kind: constant, value: 3, u: 3, distribution: rectangular}
  d: {kind: constant, value: 4, u: 4, distribution: triangular}
  s: {kind: constant}
transitions:
  - {do: compute, in: [a, b, c, d], out: s, formula: a + b + c + d}
"""


def test_constants(tmp_path: Path) -> None:
    """Var = 1 + 4 + 9 + 16 = 30; ends of the draws, of widths sqrt(3) u and sqrt(6) u."""
    graph = graph_of(tmp_path, CONSTANTS)
    found = GraphTrials(graph, graph.outputs())
    assert found.u[0] ** 2 == pytest.approx(30)
    shares = [float(values[0]) * 30 for values in found.shares().values()]
    assert shares == pytest.approx([1, 4, 9, 16])
    X = found.inputs(np.random.default_rng(1), 100_000)[1][2:] - [[3], [4]]
    assert np.abs(X).max(axis=1) == pytest.approx([3 * 3**0.5, 4 * 6**0.5], rel=0.02)


def test_ball_centre_by_hand() -> None:
    """u_x = u_w/sqrt(2), u_z^2 = u_w^2 + u_r^2."""
    graph = shipped("ball-centre")
    found = GraphTrials(graph, graph.outputs())
    assert 1e6 * found.u**2 == pytest.approx([1, 1, 2.04])
    assert found.shares()["r1"] == pytest.approx([0, 0, 0.04 / 2.04])
    assert found.shares()["u1_axis"] == pytest.approx([0.5, 0.5, 1 / 2.04])
    assert found.shares(by_place=True)["x1"] == pytest.approx([0.5, 0, 0])


def test_a_frame_turns_about_its_nominal_axes() -> None:
    """The front edge of 160 mm along x, probed along y, turns it about z: u = sqrt(2) u_w/160."""
    graph = shipped("work-coordinates")
    found = GraphTrials(graph, graph.outputs(["W.rx", "W.rz"]))
    assert found.nominal == pytest.approx([0, 0], abs=1e-15)
    u_w = 1e-3 * np.sqrt(1.5**2 + 0.8**2 + 0.3**2)
    assert found.u[1] == pytest.approx(2**0.5 * u_w / 160, rel=1e-9)
