"""Graph files: values, signatures, the token rule, and faults that hide no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.errors import InputError
from mtu_cli.files.graph_contract import Graph, number_or_formula
from mtu_cli.files.graph_file import LoadedGraph, load_graph
from mtu_cli.files.graph_kinds import KINDS, TRANSITIONS, TransitionKind
from mtu_cli.files.graph_steps import Step
from mtu_cli.files.graph_structure import firing_order
from mtu_cli.files.schemas import json_schema

HEAD = "schema: mtu/graph/1\nname: example\n"


def load(folder: Path, text: str) -> LoadedGraph:
    path = folder / "graph.yaml"
    path.write_text(HEAD + text, "utf-8")
    return load_graph(path)


def faults(folder: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load(folder, text)
    return [str(problem).removeprefix("graph.yaml:") for problem in caught.value.findings]


def step(index: int, inputs: str, outputs: str) -> Step:
    return Step(index=index, do="middle", variant="", inputs=tuple(inputs), outputs=tuple(outputs))


def test_token_rule() -> None:
    """Each fires once all its inputs are marked; what waits for a cycle never does."""
    steps = [step(0, "cd", "e"), step(1, "a", "c"), step(2, "", "d"), step(3, "ab", "f")]
    steps += [step(4, "gx", "h"), step(5, "h", "g"), step(6, "h", "i"), step(7, "aa", "j")]
    rounds = firing_order(steps, "abx")
    assert [[item.index for item in fired] for fired in rounds] == [[1, 2, 3, 7], [0]]


def test_every_transition_is_in_the_contract() -> None:
    assert set(TRANSITIONS) == set(TransitionKind.__args__)  # type: ignore[attr-defined]  # a Literal has them
    for variants in TRANSITIONS.values():
        for variant in variants:
            assert set(variant.outputs) <= set(KINDS)
            assert all(set(slot.kinds) <= set(KINDS) for slot in variant.inputs)
        assert len({item.name for item in variants}) == len(variants)


@pytest.mark.parametrize(
    ("given", "value"),
    [(3, 3.0), (2.5, 2.5), ("30*pi/180", 0.5235987755982988), ("-2**2", -4.0), ("1e-6", 1e-6)],
)
def test_numbers_and_formulas(given: object, value: float) -> None:
    assert number_or_formula(given) == pytest.approx(value, rel=1e-15)


def test_directions(tmp_path: Path) -> None:
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
        "6: places.Q: known, but where?; expected `nominal_mm:`",
        "7: places.R: no transition makes this point; expected a transition with `out: R`",
        "8: places.S.known: is known, and the transition in line 13 makes it; "
        "expected one of the two",
        "9: places.c.known: a constant is not known; expected a point",
        "9: places.c: leads nowhere; expected an input of a transition, or `report: [M, c]`",
    ]


def test_two_knots_are_two_cycles(tmp_path: Path) -> None:
    names = "abcdef"
    text = "places:\n" + "".join(f"  {name}: {{kind: constant}}\n" for name in names)
    text += "transitions:\n"
    for a, b in ("ab", "ba", "bc", "cb", "de", "ed", "ef"):
        text += f"  - {{do: ratio, in: [{a}, {a}], out: {b}}}\n"
    told = [item for item in faults(tmp_path, text) if "cycle" in item]
    assert [item.partition("a cycle: ")[2] for item in told] == ["a -> b -> a", "d -> e -> d"]


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


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("out: v", "out: w", "12: transitions[2].out: unknown place: 'w'; expected one of: P"),
        ("out: v", "output: v", "12: transitions[2].output: unknown key: 'output'; did you mean"),
        ("in: [P, Q]", "input: [P, Q]", "12: transitions[2].input: unknown key: 'input'"),
        ("in: [P, Q]", "in: [P, R]", "12: transitions[2].in[1]: unknown place: 'R'"),
        ("in: [P, Q]", "in: [P, [Q]]", "12: transitions[2].in[1]: wrong value: '[\"Q\"]'"),
        ("in: [P, Q]", "in: [[P, Q]]", "12: transitions[2].in[0]: wrong value"),
        ("out: v", "out: {a: v}", "12: transitions[2].out: wrong value"),
        ("out: v", "out: [[v]]", "12: transitions[2].out[0]: wrong value"),
        ("in: [P, Q]", "in: P, Q", "12: transitions[2].in: a comma ends a value: 'P, Q'"),
        ("do: vector, in: [P, Q]", "do: vec, in: [P, R]", "12: transitions[2].do: unknown value"),
        ("P: {kind: point, nom", "P: {kind: pont, nom", "5: places.P.kind: unknown value: 'pont'"),
        ("P: {kind: point, nominal_mm", "P: {kind: point, nominal", "5: places.P.nominal: unkno"),
        ("[1, 2, 9]", "[1, 2]", "6: places.Q.nominal_mm: wrong value: '[1, 2]'"),
        ("transitions:", "report: [[L]]\ntransitions:", "9: report[0]: wrong value"),
        ("transitions:", "report: [M]\ntransitions:", "9: report[0]: unknown place: 'M'"),
    ],
)
def test_one_slip_is_one_message(tmp_path: Path, right: str, wrong: str, told: str) -> None:
    """What follows from it, a place that nothing makes or that leads nowhere, is not told too."""
    assert right in NET
    (found,) = faults(tmp_path, NET.replace(right, wrong, 1))
    assert found.startswith(told)


def test_more_places_than_a_slip_explains_are_told(tmp_path: Path) -> None:
    text = NET.replace("out: v", "out: w").replace("  L:", "  u: {kind: vector}\n  L:")
    assert sum("no transition makes this vector" in line for line in faults(tmp_path, text)) == 2


def test_a_place_that_leads_nowhere_comes_after_what_was_to_use_it(tmp_path: Path) -> None:
    """However many do: the unknown input stands below them, and is what is to be mended."""
    spare = NET.replace("  L:", "  u: {kind: vector}\n  w: {kind: constant, value: 1}\n  L:")
    assert "places.w: leads nowhere" in str(faults(tmp_path, spare))
    (found,) = [line for line in faults(tmp_path, spare.replace("in: [P, Q]", "in: [P, K]"))
                if "no transition makes" not in line]  # fmt: skip
    assert "unknown place: 'K'" in found


def test_a_faulty_transition_is_not_a_missing_one(tmp_path: Path) -> None:
    text = """
places:
  P: {kind: point, nominal_mm: [1, 2, 3]}
  Q: {kind: point}
transitions:
  - {do: meas, out: P, alonk: z}
  - {do: midle, in: [P, P], out: Q}
report: [Q]
"""
    assert faults(tmp_path, text) == [
        "8: transitions[0].alonk: unknown key: 'alonk'; did you mean 'along'?",
        "9: transitions[1].do: unknown value: 'midle'; did you mean 'middle'?",
    ]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("uniform", "did you mean 'rectangular'?"),
        ("gaussian", "did you mean 'normal'?"),
        ("student", "expected one of: normal, rectangular, triangular"),
    ],
)
def test_a_distribution_by_another_name(name: str, hint: str, tmp_path: Path) -> None:
    text = f"""
places:
  P: {{kind: constant, value: 1, u: 0.1, distribution: {name}}}
  Q: {{kind: constant}}
transitions:
  - {{do: ratio, in: [P, P], out: Q}}
"""
    told = [item for item in faults(tmp_path, text) if "distribution" in item]
    assert told == [f"5: places.P.distribution: unknown value: {name!r}; {hint}"]


def test_schema_for_editors() -> None:
    schema = json_schema("graph")
    assert set(schema["properties"]) == {
        info.alias or name for name, info in Graph.model_fields.items()
    }
    assert schema["$defs"]["Transition"]["properties"]["do"]["enum"] == list(TRANSITIONS)


def test_a_single_measured_point_is_to_be_reported(tmp_path: Path) -> None:
    text = """
places:
  p0: {kind: point, nominal_mm: [1, 2, 3]}
transitions:
  - {do: meas, out: p0, along: x}
"""
    assert faults(tmp_path, text) == [
        "5: places.p0: leads nowhere; expected an input of a transition, or `report: [p0]`"
    ]
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
    assert faults(tmp_path, text) == [
        "10: correlations[1]: not a correlation: '[\"first\"]'; expected [first, second, r]",
        "10: correlations[2]: not a correlation: '3'; expected [first, second, r]",
        "10: correlations[3][2]: wrong value: 'much'; expected a number",
        "10: correlations[0][1]: unknown place: 'secnd'; did you mean 'second'?",
        "10: correlations[0][2]: a correlation beyond 1: '2'; expected -1 to 1",
    ]


def test_a_name_with_a_dot_is_refused(tmp_path: Path) -> None:
    """P.x would be a place and the coordinate x of the place P."""
    text = """
places:
  P: {kind: point, nominal_mm: [0, 0, 0]}
  Q: {kind: point, nominal_mm: [1, 0, 0]}
  P.x: {kind: constant}
transitions:
  - {do: meas, out: P, along: x}
  - {do: meas, out: Q, along: x}
  - {do: distance, in: [P, Q], out: P.x}
"""
    (found,) = faults(tmp_path, text)
    assert found.startswith("7: places.P.x: a name with a dot")
    assert found.endswith("expected P_x")
