"""Graph files: values, signatures, the token rule, formulas, units, and the faults of a file."""

import math
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from graph_examples import graph_of, shipped

from mtu_cli.analyses.graph import GraphTrials
from mtu_cli.files.contract import json_schema
from mtu_cli.files.graph_contract import TransitionKind
from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED
from mtu_cli.model.graph.net import load_graph
from mtu_cli.model.graph.transitions import TRANSITIONS, formula_unit


def test_places_that_are_made_of_themselves(tmp_path: Path) -> None:
    """All cycles at once, with their lines; one is a step without a formula."""
    text = """
places: {x: {kind: constant}, a: {kind: constant}, b: {kind: constant}}
transitions:
  - {do: ratio, in: [b, b], out: a}
  - {do: ratio, in: [a, a], out: b}
  - {do: compute, in: [x], out: x}
"""
    with pytest.raises(InputError) as caught:
        graph_of(tmp_path, text)
    assert [(item.line, item.path, item.code) for item in caught.value.findings] == [
        (7, "transitions[1]", "graph-cycle"),
        (8, "transitions[2]", "missing-key"),
        (8, "transitions[2]", "graph-cycle"),
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


# Every transition against a value worked out by hand; nominals that determine none; chances.


# P1..P4 and the planes, lines and frames that follow from them are simple enough for a head.
PLACES = """
uncertainty: {axis_um: 1}
places:
  xa: {kind: coordinate, axis: x, nominal_mm: 1}
  xb: {kind: coordinate, axis: x, nominal_mm: 5}
  ya: {kind: coordinate, axis: y, nominal_mm: 2}
  yb: {kind: coordinate, axis: y, nominal_mm: 4}
  za: {kind: coordinate, axis: z, nominal_mm: 10}
  c: {kind: constant, value: 1.5}
  r: {kind: constant, value: 3*sqrt(3)}
  O: {kind: point, nominal_mm: [0, 0, 0]}
  P: {kind: point, nominal_mm: [3, 4, 0]}
  Q: {kind: point, nominal_mm: [3, 4, 12]}
  A: {kind: point, nominal_mm: [6, 0, 0]}
  B: {kind: point, nominal_mm: [0, 6, 0]}
  D: {kind: point, nominal_mm: [0, 0, 6]}
  E: {kind: point, nominal_mm: [6, 6, 0]}
  F: {kind: point, nominal_mm: [6, 6, 6]}
  OP: {kind: vector}
  Oz: {kind: vector}
  xy: {kind: plane}
  yz: {kind: plane}
  zx: {kind: plane}
  tilted: {kind: plane}
  OA: {kind: line}
  BF: {kind: line}
  W: {kind: frame}
  result: {kind: KIND, AXIS}
  second: {kind: constant}
transitions:
  - {do: meas, out: xa}
  - {do: meas, out: xb}
  - {do: meas, out: ya}
  - {do: meas, out: yb}
  - {do: meas, out: za}
  - {do: meas, out: O, along: x}
  - {do: meas, out: P, along: x}
  - {do: meas, out: Q, along: x}
  - {do: meas, out: A, along: x}
  - {do: meas, out: B, along: x}
  - {do: meas, out: D, along: x}
  - {do: meas, out: E, along: x}
  - {do: meas, out: F, along: x}
  - {do: vector, in: [O, P], out: OP}
  - {do: vector, in: [O, D], out: Oz}
  - {do: plane, in: [O, A, B], out: xy}
  - {do: plane, in: [O, B, D], out: yz}
  - {do: plane, in: [O, D, A], out: zx}
  - {do: plane, in: [A, B, D], out: tilted}
  - {do: line, in: [O, A], out: OA}
  - {do: line, in: [B, F], out: BF}
  - {do: frame, in: [yz, BF, P], out: W}
  - {STEP}
report: [xa, xb, ya, yb, za, c, r, OP, Oz, Q, E, xy, yz, zx, tilted, OA, BF, W, REPORT]
"""
S2, S3 = math.sqrt(2), math.sqrt(3)
N3 = [1 / S3] * 3
CASES: list[tuple[Any, ...]] = [
    ("meas, out: result", "coordinate", 7.0),
    ("displace, in: [xa, c]", "coordinate", 2.5),
    ("displace, in: [P, Oz]", "point", [3, 4, 6]),
    ("middle, in: [A, F]", "point", [6, 3, 3]),
    ("vector, in: [P, F]", "vector", [3, 2, 6]),
    ("unit_v, in: [OP]", "vector", [0.6, 0.8, 0]),
    ("unit_v, in: [P, F]", "vector", [3 / 7, 2 / 7, 6 / 7]),
    ("ratio, in: [OP, c]", "vector", [4.5, 6, 0]),
    ("ratio, in: [c, c]", "constant", 2.25),
    ("length, in: [OP]", "constant", 5),
    ("length, in: [O, Q]", "constant", 13),
    ("ball, in: [xa, xb, ya, yb, za, c]", "point", [3, 3, 8.5]),
    ("hole, in: [xa, xb, ya, yb]", "point", [3, 3, 0]),
    ("hole, in: [xa, xb, ya, yb, c]", "point", [3, 3, 1.5]),
    # A, B, D: equilateral, side 6 sqrt 2; O, A, E, B: a square of side 6.
    ("circle, in: [A, B, D], out: [result, second]", "point", [2, 2, 2], 2 * math.sqrt(6)),
    ("circle, in: [O, A, E, B], out: [result, second]", "point", [3, 3, 0], 3 * S2),
    ("sphere, in: [O, A, B, D], out: [result, second]", "point", [3, 3, 3], 3 * S3),
    ("sphere, in: [O, A, B, D, E, F], out: [result, second]", "point", [3, 3, 3], 3 * S3),
    ("sphere, in: [O, A, B, D, r]", "point", [3, 3, 3]),
    ("line, in: [A, F]", "line", [[6, 0, 0], [0, 1 / S2, 1 / S2]]),
    ("line, in: [xy, zx]", "line", [[0, 0, 0], [-1, 0, 0]]),
    ("aline, in: [A, OP]", "line", [[6, 0, 0], [0.6, 0.8, 0]]),
    ("plane, in: [D, A, B]", "plane", [[0, 0, 6], N3]),
    ("plane, in: [O, B, E, A]", "plane", [[3, 3, 0], [0, 0, -1]]),
    ("plane, in: [A, OP]", "plane", [[6, 0, 0], [0.6, 0.8, 0]]),
    ("point, in: [BF, xy]", "point", [0, 6, 0]),
    ("point, in: [OA, tilted]", "point", [6, 0, 0]),
    ("point, in: [xy, yz, zx]", "point", [0, 0, 0]),
    ("point, in: [xy, yz, tilted]", "point", [0, 6, 0]),
    ("normal, in: [tilted]", "vector", N3),
    ("direction, in: [BF]", "vector", [1 / S2, 0, 1 / S2]),
    # O along (3, 4, 0) onto x + y + z = 6: t = 6/7.
    ("project, in: [O, OP, tilted]", "point", [18 / 7, 24 / 7, 0]),
    ("per_proj, in: [F, tilted]", "point", [2, 2, 2]),
    ("per_proj, in: [Q, OA]", "point", [3, 0, 0]),
    ("distance, in: [P, Q]", "constant", 12),
    ("distance, in: [Q, OA]", "constant", math.hypot(4, 12)),
    ("distance, in: [F, tilted]", "constant", 12 / S3),
    ("distance, in: [OA, BF]", "constant", 6),
    ("angle, in: [OP, Oz]", "constant", math.pi / 2),
    # In W: z along yz's normal x, x along BF's projection z, y = z x x = -y of the machine.
    ("frame, in: [xy, BF, D]", "frame", [[0, 0, 6], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ("transform, in: [W, F]", "point", [6, -2, 3]),
    ("compute, in: [xa, c], formula: xa**2 + 2*c", "constant", 4),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case[0]))
def test_transition(case: tuple[Any, ...], tmp_path: Path) -> None:
    step, kind, expected, *radius = case
    step = f"do: {step}" + ("" if "out:" in step else ", out: result")
    axis = {"coordinate": "axis: x", "constant": "unit: '1'"}.get(kind, "says: it")
    if step.startswith("do: meas"):
        axis += ", nominal_mm: 7"
    text = PLACES.replace("STEP", step).replace("KIND", kind).replace("AXIS", axis)
    report = "result, second" if radius else "result"
    text = text.replace("REPORT", report)
    if not radius:
        text = text.replace("  second: {kind: constant}\n", "")
    found = graph_of(tmp_path, text).nominal
    assert found["result"][..., 0] == pytest.approx(np.array(expected, float), abs=1e-14)
    if radius:
        assert found["second"][0] == pytest.approx(radius[0], rel=1e-14)


def test_every_transition_is_tried() -> None:
    assert {step.split(",")[0] for step, *_ in CASES} == set(TRANSITIONS)
