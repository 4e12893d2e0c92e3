"""Faults of every contract in words of ours: none of pydantic's, and one message a fault."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mtu_cli.close_loop_sealed.files.effects_contract import Effects
from mtu_cli.errors import InputError
from mtu_cli.files.budget import load_budget
from mtu_cli.files.budget_contract import Budget
from mtu_cli.files.contracts import Contract, Findings, check_contract
from mtu_cli.files.graph_contract import Graph
from mtu_cli.files.graph_file import load_graph
from mtu_cli.files.machine import load_machine
from mtu_cli.files.machine_contract import Machine
from mtu_cli.files.part import Part, load_part
from mtu_cli.files.source import Source
from mtu_cli.files.study import Study
from mtu_cli.files.yaml_file import parse_yaml

PYDANTIC = ("should", "input", "value error", "assertion", "pydantic", "validat", "regex")
WRONG: tuple[Any, ...] = (
    None, True, -1, 1e99, 2.5, "Wrong_1", "", [], [[3]], [None], {"a": None}, [1, 2, 3, 4, 5],
)  # fmt: skip
MANY, SECONDS = 6000, 5.0
MATRIX = [[1, 0], [0, 1]]
THERMAL = {
    "positions_mm": [0, 400], "degree": 1, "gradients": {"T_a_degC": [1, 2]}, "s_leftover": 1,
    "time_constants_min": {"T_a_degC": 3}, "sensor_u_degC": {"T_a_degC": 0.1},
}  # fmt: skip
COMPONENT = {
    "of": "x", "unit": "um", "degree": 1, "says": "s", "coefficients": [1, 2], "dof": 3,
    "covariance": MATRIX, "s_repeat": 1, "pass_covariance": MATRIX, "pass_center_mm": 3,
    "pass_dof": 4, "repeat_dof": 5, "u_future": 1, "thermal": THERMAL,
}  # fmt: skip
EFFECT = {
    "name": "e", "family": "f", "axis": "x", "covariate": "c", "covariance": [[1]],
    "parameters": {"p": {"value": 1, "u": 1, "unit": "um"}}, "equations": {"Ex": "p*dir_x"},
    "alike": {"pitch_mm": [1]}, "seen": {"dir_x": [-1, 1]}, "found": {},
}  # fmt: skip
ROUND = {"id": "c", "features": ["A", "B", "C", "D"], "calibrated_mm": {"20": 30}, "U_um": 1}
SEARCH = {"of": "x", "grid": "log", "from": [1], "to": "high", "count": 5, "margin": 2}
FAMILY = {
    "family": "f", "name": "f", "says": "s", "separates": "s", "kind": "mean", "over": "part",
    "axes": ["x"], "least_axes": 1, "needs": ["c"], "parameters": {"p": "um"},
    "equations": {"Ex": "p"}, "search": {"at": SEARCH},
    "members": [{"parameters": {"p": "um"}, "equations": {"Ex": "p"}, "readings": False}],
}  # fmt: skip
PLACE = {
    "kind": "point", "axis": "x", "nominal_mm": [0, 0, 0], "value": 3, "u": 1, "unit": "mm",
    "distribution": "normal", "known": True,
}  # fmt: skip
STEP = {
    "do": "meas", "in": ["P"], "out": "P", "repeats": 2, "along": "x", "formula": "P.x",
    "uncertainty": {"axis_um": 1, "probe_um": 1, "perpendicular_um": 1},
}  # fmt: skip
INPUT = {
    "value": 1, "unit": "mm", "readings": [1, 2], "u": 1, "half_width": 1, "low": 1, "high": 2,
    "U": 1, "k": 2, "distribution": "normal", "dof": 3, "top": 1, "inexact": 1,
    "contributions": [{"u": 1}],
}  # fmt: skip
SETTINGS = {
    "coverage_factor": 2, "seed": 1, "correlation": "shared", "trials": 2000, "digits": 2,
    "probability": 0.9, "alpha": 0.1, "datum": "offset", "max_effects": 2, "threads": 2,
}  # fmt: skip
DOCUMENTS: dict[type[Contract], dict[str, Any]] = {
    Machine: {
        "name": "m", "reference_temperature_degC": 20, "axes": {"x": {"travel_mm": [0, 400]}},
        "constants": {"arm": {"value": 1, "u": 1}, "z": 3}, "covariates": ["c"],
        "components": {"a": COMPONENT}, "equations": {"Ex": "a"}, "effects": [EFFECT],
    },
    Part: {
        "name": "p", "z_mm": 1, "features": {"A": {"x_mm": 1, "y_mm": 2, "z_mm": 3}},
        "lengths": [{"id": "l", "from": "A", "to": "B", "tolerance_um": 3}],
        "orthogonality": [{"id": "o", "row": ["A", "B"], "column": ["A", "C"]}],
        "circles": [ROUND], "spheres": [ROUND],
    },
    Study: {
        "name": "s", "machine": "m.yaml", "part": "p.yaml", "components": "c.json",
        "lbb": ["l.csv"], "laser": [], "cmm": [], "drift": [], "settings": SETTINGS,
    },
    Graph: {
        "name": "g", "uncertainty": {"axis_um": 1}, "repeats": 2, "places": {"P": PLACE},
        "transitions": [STEP], "report": ["P"], "correlations": [["P", "Q", 0.5]],
    },
    Budget: {
        "name": "b", "quantity": {"name": "l", "unit": "mm"}, "units": {"l": "mm"},
        "equation": "a", "equations": {"l": "a"}, "inputs": {"a": INPUT},
        "correlations": [["a", "b", 0.5]], "simultaneous": [["a", "b"]],
        "coverage": {"probability": 0.9, "k": 2},
    },
    Effects: {"effects": [FAMILY]},
}  # fmt: skip


def nothing(_: Any, __: Findings) -> None:
    """The shape of the values alone is in question."""


def problems(text: str, model: type[Contract]) -> list[str]:
    """The messages of a document, none where it is sound."""
    kind = model.__name__.lower()
    source = Source(role=kind, path=Path("f.yaml"), shown="f.yaml", sha256="")
    try:
        check_contract(parse_yaml(f"schema: mtu/{kind}/1\n{text}", source), model, kind, nothing)
    except InputError as error:
        return [str(problem) for problem in error.findings]
    return []


def changed(data: Any, value: Any) -> Iterator[Any]:
    """The document with `value` in every place of it in turn, and with an unknown key in each
    mapping.
    """
    yield value
    if isinstance(data, dict):
        yield data | {"wrong": value}
        for key, item in data.items():
            yield {other: own for other, own in data.items() if other != key}
            yield from (data | {key: new} for new in changed(item, value))
    if isinstance(data, list):
        for index, item in enumerate(data):
            yield from ([*data[:index], new, *data[index + 1 :]] for new in changed(item, value))


@pytest.mark.parametrize("model", DOCUMENTS, ids=lambda model: str(model.__name__))
def test_no_words_of_the_library_reach_the_user(model: type[Contract]) -> None:
    document = DOCUMENTS[model]
    text = "\n".join(f"{key}: {json.dumps(item)}" for key, item in document.items())
    assert problems(text, model) == []
    told = set()
    for value in WRONG:
        for new in changed(document, value):
            if isinstance(new, dict):
                lines = (f"{json.dumps(key)}: {json.dumps(item)}" for key, item in new.items())
                told.update(problems("\n".join(lines), model))
    assert len(told) > 100
    own = {line.partition(": ")[2] for line in told}
    # What stands in quotes is the user's, and `inputs` is a key of budgets.
    plain = {line.lower().replace("inputs", "").replace("an input", "") for line in own}
    foreign = [line for line in plain if any(word in line for word in PYDANTIC)]
    assert not foreign
    assert not [line for line in plain if "another value" in line or "{" in line[:3]]


MACHINE = "name: m\ncomponents:\n  a: {unit: um}\nequations:\n"
SOUND = MACHINE + "  Ex: a\n"
PART = "name: p\nfeatures: {A: {x_mm: 1, y_mm: 2}}\n"
GRAPH = "name: g\nplaces: {P: {kind: point}}\ntransitions:\n"
BUDGET = "name: b\nequation: a\ninputs:\n"


@pytest.mark.parametrize(
    ("model", "text", "words"),
    [
        (Budget, BUDGET + "  a: {readings: f.csv}", "[1.2, 1.5]: no file is read here"),
        (Budget, BUDGET + "  a: {readings: 1.1, 1.2}", "a list in brackets, [1.1, 1.2], or quotes"),
        (Budget, BUDGET + "  a: [10, 0.1]", "a number, or keys with values: {value: 10, u: 0.1}"),
        (Budget, BUDGET + "  a: {value: 1, u: inf}", "wrong value: 'inf'; expected a finite num"),
        (Budget, BUDGET + "  a: {value: 1e400, u: 1}", "a.value: wrong value: '1e400'; expected a"),
        (Machine, SOUND + "constants: {c: -.inf}", "c.value: wrong value: '-.inf'; expected a fin"),
        (Budget, BUDGET + "  a: {value: 1, std: 1}", "unknown key: 'std'; expected 'u'"),
        (Budget, BUDGET + "  a: 1\ncorrelations: [a, b, 0.2]", "correlations: not a list of lists"),
        (Budget, BUDGET + "  a: 1\nequations:\n  - R: a", "without the dashes before them"),
        (Part, PART + "lengths: {from: A, to: B}", "a list: a dash before the entry, '- {from: .."),
        (Part, PART + "lengths: {l: {from: A, to: B}}", "a list: '- {id: l, ...}' instead of 'l: "),
        (Part, PART + "lengths: [A-B]", "expected keys with values: {from: ..., to: ...}"),
        (Part, "name: p\nfeatures: {A: {x_in: 1, y_mm: 2}}", "expected 'x_mm': in mm, not in"),
        (Part, "name: p\nfeatures: {A: [1, 2]}", "keys with values: {x_mm: ..., y_mm: ...}"),
        (Part, PART.replace("p\n", "2024\n"), "wrong value: '2024'; expected a text: '2024' in qu"),
        (Part, PART + "units: inch", "unknown key: 'units'; expected one of: schema, name"),
        (Machine, MACHINE + "  Ex = 2*a\n", "Ex = 2*a'; expected keys with values, such as 'Ex: 2"),
        (Machine, SOUND.replace("unit: um", "unit:um"), "expected 'unit: um', with a colon and a"),
        (Machine, SOUND.replace("unit: um", "unit = um"), "expected 'unit: um', with a colon and"),
        (Graph, GRAPH + "  - {do: meas, out: P, in: Q, R}", "a comma ends a value: 'Q, R'; expe"),
        (Study, "settings: {trials: 1e6}", "expected a whole number, written 1000000"),
        (Study, "settings: {datum: offset, rotation}", "quotes around a text that holds a comma"),
        (Effects, "effects: [{family: Lost_motion, says: s}]", "small letters, digits and -, such"),
        (Effects, "effects: [{family: f, says: s, axes: x}]", "expected a list such as [x, y]"),
        (Effects, "effects: [{family: f, says: s, search: {p: {log: yes}}}]", "true or false, or"),
    ],
)  # fmt: skip
def test_one_fault_is_one_message(model: type[Contract], text: str, words: str) -> None:
    wanted = [line for line in problems(text, model) if "'equations' is missing" not in line]
    assert len(wanted) == 1, wanted
    assert words in wanted[0]


POINT = "expected a decimal point before "
ENDS = ": a comma ends a value"


@pytest.mark.parametrize(
    ("model", "text", "places"),
    [
        (Part, "A: {x_mm: 1,5e2, y_mm: 20}", {"features.A.5e2": f"{POINT}5e2{ENDS}"}),
        (Part, "A: {x_mm: 1,5 mm, y_mm: 2}", {"features.A.5 mm": f"{POINT}5, without a unit"}),
        (Part, "A: {x_mm: 1,5, y_mm: 2,5}", {"key '5' appears twice in line 3": f"{POINT}5{ENDS}"}),
        (Part, "A: {x_mm: 10, hole, y_mm: 20}", {"features.A.hole": "one of: x_mm, y_mm, z_mm"}),
        (
            Part,
            "A: {z: 5, b, x_mm: 1, y_mm: 2}",
            {"features.A.z": "expected 'z_mm'", "features.A.b": "one of: x_mm, y_mm, z_mm"},
        ),
        (
            Budget,
            "a: {value: 1,2e-3, u: 0,1}",
            {"inputs.a.2e-3": f"{POINT}2e-3{ENDS}", "inputs.a.1": f"{POINT}1{ENDS}"},
        ),
        (Budget, "a: {value: 1, u: 0.1, normal}", {"inputs.a.normal": "one of: says, u, half"}),
        (Budget, "a: 3, g: 9,81", {"inputs.81": f"has no value; {POINT}81{ENDS}"}),
        (Machine, "arm: 3,10", {"constants.10": f"has no value; {POINT}10{ENDS}"}),
    ],
)  # fmt: skip
def test_a_number_with_a_comma_is_told_alike_everywhere(
    model: type[Contract], text: str, places: dict[str, str]
) -> None:
    """Brackets and quotes are of no use where a number belongs."""
    start = {Part: "name: p\nfeatures", Budget: "name: b\nequation: a\ninputs"}
    found = problems(f"{start.get(model, SOUND + 'constants')}: {{{text}}}", model)
    assert len(found) == len(places), found
    for line, (place, words) in zip(found, places.items(), strict=True):
        assert f": {place}" in line
        assert words in line


def test_a_key_that_follows_no_number_on_its_line_is_no_decimal() -> None:
    (told,) = problems(PART + "2nd:\n", Part)
    assert "unknown key: '2nd'; expected one of" in told
    (told,) = problems(PART + "z_mm: 1\n2nd:\n", Part)
    assert "unknown key: '2nd'; expected one of" in told


@pytest.mark.parametrize(
    "text",
    [
        "features:\n" + "".join(f"  {i}:\n" for i in range(MANY)),
        "features:\n"
        + "".join(f"  a{i}: {{x_mm: 1, y_mm: 2}}\n" for i in range(MANY))
        + "lengths:\n"
        + "".join(f"- {{from: b{i}, to: a0}}\n" for i in range(MANY)),
    ],
    ids=["no values", "unknown names"],
)
def test_thousands_of_faults_take_no_longer_each(text: str, tmp_path: Path) -> None:
    path = tmp_path / "part.yaml"
    path.write_text(f"schema: mtu/part/1\nname: p\n{text}", "utf-8")
    start = time.process_time()
    with pytest.raises(InputError) as caught:
        load_part(path)
    assert time.process_time() - start < SECONDS
    assert len(caught.value.findings) >= MANY


GRAPH_OF_TWO = """
name: g
place: {P: {kind: point, nominal_mm: [1, 2, 3]}, Q: {kind: point}}
transitions: [{do: meas, out: P, along: x}, {do: middle, in: [P, P], out: Q}]
report: [Q]
correlations: [[P, Q, 0.1]]
"""
JOINT = "correlations: [[a, b, 0.1]]\nsimultaneous: [[a, c]]"
LENGTHS = "lengths: [{from: A, to: B}]\ncircles: [{id: c, features: [A, B, C]}]"


@pytest.mark.parametrize(
    ("load", "text", "told"),
    [
        (load_part, f"{PART.replace('features', 'feature')}{LENGTHS}", "mean 'features'?"),
        (load_part, f"name: p\n{LENGTHS}", "the key 'features' is missing"),
        (load_part, f"name: p\nfeatures: [A]\n{LENGTHS}", "features: wrong value"),
        (load_budget, f"name: b\nequation: a\ninput: {{a: 1}}\n{JOINT}", "did you mean 'inputs'?"),
        (load_graph, GRAPH_OF_TWO, "did you mean 'places'?"),
        (load_machine, SOUND.replace(" a\n", " 2*a*c\nconstant: {c: 3}\n"), "mean 'constants'?"),
        (load_machine, SOUND.replace(" a\n", " a*c\ncovariate: [c]\n"), "mean 'covariates'?"),
    ],
)  # fmt: skip
def test_a_misspelt_list_of_names_is_the_only_fault(
    tmp_path: Path, load: Callable[[Path], object], text: str, told: str
) -> None:
    """None of the names that refer to it is told to be unknown."""
    kind = load.__name__.removeprefix("load_")
    (tmp_path / "f.yaml").write_text(f"schema: mtu/{kind}/1\n{text}")
    with pytest.raises(InputError) as caught:
        load(tmp_path / "f.yaml")
    (found,) = caught.value.findings
    assert told in str(found)


def test_a_text_is_told_where_it_stands() -> None:
    (told,) = problems(MACHINE + "  Ex = 2*a\n", Machine)
    assert told.startswith("f.yaml:6: equations: ")
