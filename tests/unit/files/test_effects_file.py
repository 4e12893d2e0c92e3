"""Effects files: what is accepted, and every fault with its line, path and code."""

from __future__ import annotations

import time
from pathlib import Path
from textwrap import dedent

import jsonschema
import pytest
import yaml

from mtu_cli.files.contract import json_schema
from mtu_cli.files.effects import EffectLibrary, load_effects
from mtu_cli.findings import Finding, InputError
from mtu_cli.model.effect_library import BUILT_IN, effect_library

BACKLASH = """\
- family: play
  says: lost motion of {a}
  separates: reverse {a}
  parameters: {lost_motion: um}
  equations:
    E{a}: lost_motion*dir_{a}
"""


def load(tmp_path: Path, text: str) -> EffectLibrary:
    (tmp_path / "e.yaml").write_text(dedent(text), encoding="utf-8")
    return load_effects(tmp_path / "e.yaml")


def faults(tmp_path: Path, text: str) -> tuple[Finding, ...]:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    return caught.value.findings


def family(
    equations: str = "{Ex: k*x}", parameters: str = "{k: um/m}", more: str = "", name: str = "f"
) -> str:
    """A family on lines 1 (name), 2 (says), 3 (parameters) and 4 (equations)."""
    lines = [f"- family: {name}", "  says: s"]
    lines += [f"  parameters: {parameters}", f"  equations: {equations}"]
    return "\n".join([*lines, *(f"  {line}" for line in more.splitlines())]) + "\n"


def test_a_list_of_families_or_a_file_with_its_schema(tmp_path: Path) -> None:
    bare = load(tmp_path, BACKLASH)
    inner = "".join(f"  {line}\n" for line in BACKLASH.splitlines())
    full = load(tmp_path, f"schema: mtu/effects/1\neffects:\n{inner}")
    for loaded in (bare, full):
        (found,) = loaded.families
        assert found.name == "play-{a}"
        (template,) = found.templates
        assert template.columns == ("dir_{a}",)
        assert template.units == {"lost_motion": "um"}


def test_the_built_in_file_is_sound_and_fits_its_schema() -> None:
    assert len(load_effects(BUILT_IN).families) == len(effect_library().families)
    schema = json_schema("effects")
    assert schema["$id"] == "mtu/effects/1"
    jsonschema.validate(yaml.safe_load(BUILT_IN.read_text("utf-8")), schema)


@pytest.mark.parametrize(
    ("equations", "column"),
    [
        ("{Ex: k*speed}", 3),
        ('{Ex: "k*({a} - {q0})"}', 10),
        ("{Ex: k*x*k}", 4),
        ("{Ex: k*x + 0.001}", 1),
        ("{Ex: k*(x}", 5),
        ("{Ex: k}", 1),
        ('{Ex: "k*({a} - {a0})**2"}', 1),
        ('{Ex: "k*{a}*dir_{b}*{b}"}', 1),
        ('{Ex: "k*{b}*exp({a})"}', 11),
        ("{Ex: k*x*log(T_a_degC)}", 9),
        ('{Ex: "k*{each}"}', 3),
        ("{Ex: k*x*chosen}", 5),
        ("{Ex: k*foo(x)}", 3),
        ("{E1: k*x}", None),
        ('{"E{each}": "k*{each}", Ex: k*x}', None),
        ("{}", None),
    ],
)
def test_faults_of_equations(tmp_path: Path, equations: str, column: int | None) -> None:
    found = faults(tmp_path, family(equations))
    assert {item.line for item in found} == {4}
    assert column in [item.column for item in found]


PERIOD = "{Ex: k*x*sin(p)}"


@pytest.mark.parametrize(
    ("text", "line", "path", "code"),
    [
        (family(parameters="{k: um/m, j: um}"), 3, "[0].parameters.j", "not-applicable"),
        (family("{Ex: x*x}", "{x: um}"), 3, "[0].parameters.x", "name-taken"),
        (family('{Ex: "2k*x"}', "{2k: um/m}"), 3, "[0].parameters.2k", "wrong-type"),
        (family(name="Ball screw"), 1, "[0].family", "wrong-value"),
        (family(more="kind: scatter"), 5, "[0].kind", "wrong-value"),
        (family(more="kind: scatter"), 3, "[0].parameters", "misplaced"),
        (family(more="kind: outlier"), 1, "[0]", "missing-key"),
        (family(more="over: feature"), 4, "[0].equations", "not-applicable"),
        (family(more="search: {p: {from: 1, to: 2}}"), 5, "[0].search.p", "not-applicable"),
        (family(PERIOD, more="search: {p: {to: span}}"), 5, "[0].search.p", "missing-key"),
        (family(PERIOD, more="search: {p: {of: x, to: reach}}"), 5, "[0].search.p.to",
         "unknown-name"),
        (family(PERIOD, more="search: {p: {from: 120, to: 5}}"), 5, "[0].search.p.to",
         "wrong-value"),
        (family(PERIOD, more="search: {p: {grid: log, from: 0, to: 5}}"), 5, "[0].search.p.from",
         "wrong-value"),
        (family(PERIOD, more="search: {p: {of: w, from: 1, to: 2}}"), 5, "[0].search.p.of",
         "unknown-name"),
        (family(more="name: f-{T}"), 5, "[0].name", "misplaced"),
        (family(more="members: [{parameters: {k: um/m}, equations: {Ex: k*x}}]"), 3,
         "[0].parameters", "misplaced"),
        ("- family: f\n  says: s\n", 1, "[0]", "missing-key"),
        (family() + family(), 5, "[1]", "appears-twice"),
        (family('{Ex: "k*{b}"}'), 1, "[0]", "incomplete"),
        ("[]\n", 1, "", "wrong-value"),
        ("- 5\n", 1, "[0]", "wrong-value"),
    ],
)  # fmt: skip
def test_other_faults(tmp_path: Path, text: str, line: int, path: str, code: str) -> None:
    found = [(item.line, item.path, item.code) for item in faults(tmp_path, text)]
    assert (line, f"effects{path}", code) in found


def test_all_faults_of_a_file_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, family("{Ex: k*speed}") + family("{Ey: k**2}", name="g"))
    assert [item.line for item in found] == [4, 8]


def test_names_of_built_in_families_and_of_other_files_are_taken(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(family(name="backlash"))
    (tmp_path / "b.yaml").write_text(family())
    for names_of in ([tmp_path / "a.yaml"], [tmp_path / "b.yaml"] * 2):
        with pytest.raises(InputError) as caught:
            effect_library(names_of)
        assert [item.code for item in caught.value.findings] == ["name-taken"]
    with pytest.raises(InputError, match="no such file"):
        effect_library([tmp_path / "none.yaml"])


@pytest.mark.parametrize("name", ["{" * 200_000, "a{b" * 50_000])
def test_a_very_long_name_costs_nothing(tmp_path: Path, name: str) -> None:
    """Names of parameters are searched for braces: in linear time, whatever they are."""
    start = time.process_time()
    faults(tmp_path, family(parameters=f"{{? '{name}' : um}}", equations=f"{{Ex: '{name}'}}"))
    assert time.process_time() - start < 5.0
