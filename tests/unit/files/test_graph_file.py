"""Graph files: values, signatures, the token rule, formulas, and the faults of a file."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from mtu_cli.files.graph import LoadedGraph, Step, cycles, firing_order, load_graph
from mtu_cli.files.graph_contract import Graph, number_or_formula
from mtu_cli.files.graph_kinds import KINDS, TRANSITIONS, TransitionKind
from mtu_cli.files.schemas import json_schema
from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.language.functions import BUDGET_FUNCTIONS
from mtu_cli.language.parser import DOTTED

HEAD = "schema: mtu/graph/1\nname: example\n"
NET = """
places:
  P: {kind: point, nominal_mm: [1, 2, 3]}
  Q: {kind: point, nominal_mm: [1, 2, 9]}
  v: {kind: vector}
  L: {kind: constant}
transitions:
  - {do: meas, out: P, along: x}
  - {do: meas, out: Q, along: x}
  - {do: vector, in: [P, Q], out: v}
  - {do: length, in: [v], out: L}
"""


def load(folder: Path, text: str) -> LoadedGraph:
    path = folder / "graph.yaml"
    path.write_text(HEAD + text, "utf-8")
    return load_graph(path)


def faults(folder: Path, text: str) -> list[tuple[int | None, str | None, str]]:
    """Line, path and code of every fault."""
    with pytest.raises(InputError) as caught:
        load(folder, text)
    return [(item.line, item.path, item.code) for item in caught.value.findings]


def step(index: int, inputs: str, outputs: str) -> Step:
    return Step(index=index, do="middle", variant="", inputs=tuple(inputs), outputs=tuple(outputs))


def test_token_rule() -> None:
    """Each fires once all its inputs are marked; what waits for a cycle never does."""
    steps = [step(0, "cd", "e"), step(1, "a", "c"), step(2, "", "d"), step(3, "ab", "f")]
    steps += [step(4, "gx", "h"), step(5, "h", "g"), step(6, "h", "i"), step(7, "aa", "j")]
    rounds = firing_order(steps, "abx")
    assert [[item.index for item in fired] for fired in rounds] == [[1, 2, 3, 7], [0]]


def test_two_knots_are_two_cycles() -> None:
    arcs = {"b": ["a", "c"], "a": ["b"], "c": ["b"], "e": ["d"], "d": ["e"], "f": ["e"]}
    assert [len(cycle) for cycle in cycles(arcs)] == [3, 3]
    for cycle in cycles(arcs):
        assert cycle[0] == cycle[-1]
        assert all(a in arcs[b] for a, b in itertools.pairwise(cycle))


def test_every_transition_is_in_the_contract() -> None:
    assert set(TRANSITIONS) == set(TransitionKind.__args__)  # type: ignore[attr-defined]  # a Literal has them
    for variants in TRANSITIONS.values():
        for variant in variants:
            slots = (*variant.inputs, *variant.outputs)
            assert all(set(slot.kinds) <= set(KINDS) for slot in slots)
        assert len({item.name for item in variants}) == len(variants)
    schema = json_schema("graph")
    known = {info.alias or name for name, info in Graph.model_fields.items()}
    assert set(schema["properties"]) == known
    assert schema["$defs"]["Transition"]["properties"]["do"]["enum"] == list(TRANSITIONS)


@pytest.mark.parametrize(
    ("given", "value"),
    [(3, 3.0), (2.5, 2.5), ("30*pi/180", 0.5235987755982988), ("-2**2", -4.0), ("1e-6", 1e-6)],
)
def test_numbers_and_formulas(given: object, value: float) -> None:
    assert number_or_formula(given) == pytest.approx(value, rel=1e-15)


def test_directions_and_what_is_reported(tmp_path: Path) -> None:
    text = """
places:
  P: {kind: point, nominal_mm: [1, 2, 3]}
  Q: {kind: point, nominal_mm: [4, 2*3, 3]}
  M: {kind: point}
transitions:
  - {do: meas, out: P, along: -z}
  - {do: meas, out: Q, along: [3, 0, 4]}
  - {do: middle, in: [P, Q], out: M}
"""
    found = load(tmp_path, text)
    assert [item.along for item in found.graph.transitions[:2]] == [(0, 0, -1), (0.6, 0, 0.8)]
    assert found.graph.places["Q"].nominal_mm == (4, 6, 3)
    assert found.reported == ("M",)
    assert [len(fired) for fired in found.rounds] == [2, 1]


def test_known_points(tmp_path: Path) -> None:
    text = """
places:
  P: {kind: point, nominal_mm: [1, 2, 3], known: true}
  Q: {kind: point, known: true}
  R: {kind: point, nominal_mm: [1, 2, 3]}
  S: {kind: point, nominal_mm: [1, 2, 3], known: true}
  c: {kind: constant, value: 1, known: true}
  M: {kind: point}
transitions:
  - {do: circle, in: [P, Q, R, S], out: M}
  - {do: meas, out: S, along: x}
"""
    assert faults(tmp_path, text) == [
        (6, "places.Q", "missing-key"),
        (7, "places.R", "unused-place"),
        (8, "places.S.known", "contradicts"),
        (9, "places.c.known", "misplaced"),
        (9, "places.c", "unused-place"),
    ]


@pytest.mark.parametrize(
    ("right", "wrong", "line", "path"),
    [
        ("out: v", "out: w", 12, "transitions[2].out"),
        ("out: v", "output: v", 12, "transitions[2].output"),
        ("in: [P, Q]", "input: [P, Q]", 12, "transitions[2].input"),
        ("in: [P, Q]", "in: [P, R]", 12, "transitions[2].in[1]"),
        ("in: [P, Q]", "in: [P, [Q]]", 12, "transitions[2].in[1]"),
        ("in: [P, Q]", "in: [[P, Q]]", 12, "transitions[2].in[0]"),
        ("out: v", "out: {a: v}", 12, "transitions[2].out[0]"),
        ("do: vector, in: [P, Q]", "do: vec, in: [P, R]", 12, "transitions[2].do"),
        ("P: {kind: point, nom", "P: {kind: pont, nom", 5, "places.P.kind"),
        ("P: {kind: point, nominal_mm", "P: {kind: point, nominal", 5, "places.P.nominal"),
        ("[1, 2, 9]", "[1, 2]", 6, "places.Q.nominal_mm"),
        ("transitions:", "report: [[L]]\ntransitions:", 9, "report[0]"),
        ("transitions:", "report: [M]\ntransitions:", 9, "report[0]"),
        ("transitions:", "transitoins:", 9, "transitoins"),
    ],
)
def test_one_slip_is_one_fault(
    tmp_path: Path, right: str, wrong: str, line: int, path: str
) -> None:
    """What follows from it, a place that nothing makes or that leads nowhere, is none."""
    assert right in NET
    ((found_line, found_path, _),) = faults(tmp_path, NET.replace(right, wrong, 1))
    assert (found_line, found_path) == (line, path)


def test_an_unknown_key_hides_no_missing_one(tmp_path: Path) -> None:
    text = NET.replace("Q: {kind: point", "Q: {kind: coordinate, colour: 2", 1)
    found = [(path, code) for _, path, code in faults(tmp_path, text)]
    assert ("places.Q.colour", "unknown-name") in found
    assert ("places.Q", "missing-key") in found


def test_more_places_than_a_slip_explains_are_reported(tmp_path: Path) -> None:
    text = NET.replace("out: v", "out: w").replace("  L:", "  u: {kind: vector}\n  L:")
    assert [code for _, _, code in faults(tmp_path, text)].count("unused-place") == 2


def test_a_single_measured_point_is_to_be_reported(tmp_path: Path) -> None:
    text = """
places:
  p0: {kind: point, nominal_mm: [1, 2, 3]}
transitions:
  - {do: meas, out: p0, along: x}
"""
    assert faults(tmp_path, text) == [(5, "places.p0", "unused-place")]
    assert load(tmp_path, text + "report: [p0]\n").reported == ("p0",)


def test_faulty_correlations(tmp_path: Path) -> None:
    text = """
places:
  first: {kind: constant, value: 1, u: 1}
  second: {kind: constant, value: 1, u: 1}
  s: {kind: constant}
transitions:
  - {do: compute, in: [first, second], out: s, formula: first + second}
correlations: [[first, secnd, 2], [first], 3, [first, second, much]]
"""
    found = [path for line, path, _ in faults(tmp_path, text) if line == 10]
    assert sorted(map(str, found)) == [
        "correlations[0][1]",
        "correlations[0][2]",
        "correlations[1]",
        "correlations[2]",
        "correlations[3][2]",
    ]


def test_a_name_with_a_dot_is_refused(tmp_path: Path) -> None:
    """P.x would be a place and the coordinate x of the place P."""
    text = NET.replace("  L:", "  P.x:").replace("out: L", "out: P.x")
    assert faults(tmp_path, text) == [(8, "places.P.x", "wrong-type")]


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
    steps = load(tmp_path, FORMULA.replace("FORMULA", text)).steps
    assert steps[-1].formula == parse(text, BUDGET_FUNCTIONS, DOTTED)


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
        load(tmp_path, FORMULA.replace("FORMULA", formula))
    (found,) = caught.value.findings
    assert (found.line, found.code, found.column) == (13, code, column)
