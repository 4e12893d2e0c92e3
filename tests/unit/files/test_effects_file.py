"""Effects files: what is accepted, and every fault with its line, path and code."""

from __future__ import annotations

import time
from pathlib import Path

import jsonschema
import pytest
import yaml

from mtu_cli.files.contract import json_schema
from mtu_cli.files.effects import EffectLibrary, load_effects
from mtu_cli.findings import Finding, InputError
from mtu_cli.model.effect_library import BUILT_IN, effect_library

HEAD = "schema: mtu/effects/1\neffects:\n"


def load(tmp_path: Path, text: str) -> EffectLibrary:
    (tmp_path / "e.yaml").write_text(HEAD + text, encoding="utf-8")
    return load_effects(tmp_path / "e.yaml")


def faults(tmp_path: Path, text: str) -> tuple[Finding, ...]:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    return caught.value.findings


def family(
    equations: str = "{Ex: k*x}", parameters: str = "{k: um/m}", more: str = "", name: str = "f"
) -> str:
    """A family on lines 3 (name), 4 (says), 5 (parameters) and 6 (equations) of its file."""
    lines = [f"- family: {name}", "  says: s"]
    lines += [f"  parameters: {parameters}", f"  equations: {equations}"]
    return "\n".join([*lines, *(f"  {line}" for line in more.splitlines())]) + "\n"


def test_a_family_is_named_by_the_axes_of_its_equations(tmp_path: Path) -> None:
    (found,) = load(tmp_path, family('{"E{a}": "k*dir_{a}"}', "{k: um}", name="play")).families
    assert found.name == "play-{a}"
    (template,) = found.templates
    assert template.columns == ("dir_{a}",)
    assert template.units == {"k": "um"}


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
    assert {item.line for item in found} == {6}
    assert column in [item.column for item in found]


PERIOD = "{Ex: k*x*sin(p)}"


@pytest.mark.parametrize(
    ("text", "line", "path", "code"),
    [
        (family(parameters="{k: um/m, j: um}"), 5, "[0].parameters.j", "not-applicable"),
        (family("{Ex: x*x}", "{x: um}"), 5, "[0].parameters.x", "name-taken"),
        (family('{Ex: "2k*x"}', "{2k: um/m}"), 5, "[0].parameters.2k", "wrong-type"),
        (family(name="Ball screw"), 3, "[0].family", "wrong-value"),
        (family(more="kind: scatter"), 7, "[0].kind", "wrong-value"),
        (family(more="kind: outlier"), 3, "[0]", "missing-key"),
        (family(more="over: feature"), 6, "[0].equations", "not-applicable"),
        (family(more="search: {p: {from: 1, to: 2}}"), 7, "[0].search.p", "not-applicable"),
        (family(PERIOD, more="search: {p: {to: span}}"), 7, "[0].search.p", "missing-key"),
        (family(PERIOD, more="search: {p: {of: x, to: reach}}"), 7, "[0].search.p.to",
         "unknown-name"),
        (family(PERIOD, more="search: {p: {of: w, from: 1, to: 2}}"), 7, "[0].search.p.of",
         "unknown-name"),
        ("- family: f\n  says: s\n", 3, "[0]", "missing-key"),
        (family() + family(), 7, "[1]", "appears-twice"),
        (family('{Ex: "k*{b}"}'), 3, "[0]", "incomplete"),
        ("- 5\n", 3, "[0]", "wrong-value"),
    ],
)  # fmt: skip
def test_other_faults(tmp_path: Path, text: str, line: int, path: str, code: str) -> None:
    found = [(item.line, item.path, item.code) for item in faults(tmp_path, text)]
    assert (line, f"effects{path}", code) in found


def test_all_faults_of_a_file_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, family("{Ex: k*speed}") + family("{Ey: k**2}", name="g"))
    assert [item.line for item in found] == [6, 10]


def test_names_of_built_in_families_and_of_other_files_are_taken(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(HEAD + family(name="backlash"))
    (tmp_path / "b.yaml").write_text(HEAD + family())
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
