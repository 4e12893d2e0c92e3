"""Effects files: what is accepted, and every fault with its line and path."""

from __future__ import annotations

import time
from pathlib import Path
from textwrap import dedent

import jsonschema
import pytest
import yaml

from mtu_cli.close_loop_sealed.files.effects_file import LoadedEffects, load_effects
from mtu_cli.close_loop_sealed.model.effect_library import BUILT_IN, effect_library
from mtu_cli.errors import InputError
from mtu_cli.files.schemas import json_schema
from mtu_cli.units import PARAMETER_UNITS, UNITS

BACKLASH = """\
- family: play
  says: lost motion of {a}
  separates: reverse {a}
  parameters: {lost_motion: um}
  equations:
    E{a}: lost_motion*dir_{a}
"""


def load(tmp_path: Path, text: str) -> LoadedEffects:
    (tmp_path / "e.yaml").write_text(dedent(text), encoding="utf-8")
    return load_effects(tmp_path / "e.yaml")


def faults(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    return [str(problem) for problem in caught.value.findings]


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
        assert found.marks() == {"a"}
        (template,) = found.templates
        assert template.raw_names == ("dir_{a}",)
        assert template.units == {"lost_motion": "um"}
    assert (bare.families[0].line, full.families[0].line) == (1, 3)


def test_the_built_in_file_is_sound_and_fits_its_schema() -> None:
    assert len(load_effects(BUILT_IN).families) == len(effect_library().families)
    schema = json_schema("effects")
    assert schema["$id"] == "mtu/effects/1"
    jsonschema.validate(yaml.safe_load(BUILT_IN.read_text("utf-8")), schema)


@pytest.mark.parametrize(
    ("equations", "told"),
    [
        ("{Ex: k*speed}", "effects[0].equations.Ex: unknown name 'speed' at column 3; expected "),
        ('{Ex: "k*({a} - {q0})"}', "effects[0].equations.Ex: unknown name '{q0}' at column 10"),
        ("{Ex: k*x*k}", "product of the parameters 'k' and 'k' at column 4"),
        ("{Ex: k*x + 0.001}", "a term without a parameter at column 1"),
        ("{Ex: k*(x}", "the parenthesis opened at column 3 is not closed at column 5"),
        ("{Ex: k}", "this term is an angle or ratio (rad), its equation is a length (mm)"),
        ('{Ex: "k*({a} - {a0})**2"}', "this term is mm^2, its equation is a length (mm)"),
        (
            '{Ex: "k*{a}*dir_{b}*{b}"}',
            "this term is mm^2, its equation is a length (mm) at column 1",
        ),
        (
            '{Ex: "k*{b}*exp({a})"}',
            "exp of a length (mm) at column 11: '{a}'; expected a plain num",
        ),
        ("{Ex: k*x*log(T_a_degC)}", "log of a temperature (degC) at column 9"),
        ("{E1: k*x}", "effects[0].equations.E1: not an equation: 'E1'; expected Ex, Ey, Ez, E{a}"),
        ('{"E{each}": "k*{each}", Ex: k*x}', "stands beside other equations"),
        ('{Ex: "k*{each}"}', "'{each}' in Ex at column 3; expected {each} in E{each} only"),
        ("{Ex: k*x*chosen}", "unknown name 'chosen' at column 5"),
        ("{Ex: k*sin(x}", "the parenthesis opened at column 6 is not closed"),
        ("{Ex: k*foo(x)}", "unknown function 'foo' at column 3"),
        ("{}", "effects[0].equations: wrong value: '{}'; expected at least 1 of them"),
    ],
)
def test_faults_of_equations(tmp_path: Path, equations: str, told: str) -> None:
    found = faults(tmp_path, family(equations))
    assert any(told in fault for fault in found), found
    assert all(fault.startswith("e.yaml:4: ") for fault in found), found


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            family(parameters="{k: um/m, j: um}"),
            "e.yaml:3: effects[0].parameters.j: in no equation: 'j'",
        ),
        (
            family(parameters="{k: parsec}"),
            "e.yaml:3: effects[0].parameters.k: unknown unit: 'parsec'",
        ),
        (
            family("{Ex: x*x}", "{x: um}"),
            "e.yaml:3: effects[0].parameters.x: the name is taken: 'x'",
        ),
        (
            family('{Ex: "2k*x"}', "{2k: um/m}"),
            "e.yaml:3: effects[0].parameters.2k: not a name that equations can use: '2k'",
        ),
        (family(name="Ball screw"), "e.yaml:1: effects[0].family: wrong value: 'Ball screw'"),
        (
            family(more="kind: scatter"),
            "e.yaml:5: effects[0].kind: an unknown effect on the scatter",
        ),
        (
            family(more="kind: outlier"),
            "e.yaml:1: effects[0]: the key 'over' is missing",
        ),
        (
            family(more="over: feature"),
            "e.yaml:4: effects[0].equations: `chosen` is in no equation",
        ),
        (
            family(more="serach: {p: {from: 1, to: 2}}"),
            "e.yaml:5: effects[0].serach: unknown key: 'serach'; did you mean 'search'?",
        ),
        (
            family(more="search: {p: {from: 1, to: 2}}"),
            "e.yaml:5: effects[0].search.p: in no equation: 'p'",
        ),
        (
            family("{Ex: k*x*sin(p)}", more="search: {p: {from: 1, to: span}}"),
            "e.yaml:5: effects[0].search.p: the key 'of' is missing",
        ),
        (
            family("{Ex: k*x*sin(p)}", more="search: {p: {of: x, from: 1, to: reach}}"),
            "e.yaml:5: effects[0].search.p.to: unknown name: 'reach'",
        ),
        (
            family("{Ex: k*x*sin(p)}", more="search: {p: {from: 120, to: 5}}"),
            "e.yaml:5: effects[0].search.p.to: nothing lies between: '5'; expected more than 120",
        ),
        (
            family("{Ex: k*x*sin(p)}", more="search: {p: {grid: log, from: 0, to: 5}}"),
            "e.yaml:5: effects[0].search.p.from: a log grid has positive values alone: '0'",
        ),
        (
            family("{Ex: k*x*step(z - at_mm)}", more="search: {at_mm: {of: sequence}}"),
            "e.yaml:5: effects[0].search.at_mm.of: its name says mm, the column has none: "
            "'sequence'; expected another name than at_mm, or a column in that unit",
        ),
        (
            family("{Ex: k*x*y*exp(-time_min/t)}", more="search: {t: {from: 1, to: 2}}"),
            "e.yaml:4: effects[0].equations.Ex: this term is mm^2, its equation is a length (mm) "
            "at column 1: 'k*x*y*exp(-time_min/t)'; expected",
        ),
        (
            family("{'E{each}': 'k_{each}*({T} - {T0})'}", "{'k_{each}': um}"),
            "e.yaml:4: effects[0].equations.E{each}: this term has a temperature (degC) too many "
            "at column 1: 'k_{each}*({T} - {T0})'; expected k_{each} in um/K, or the temperature",
        ),
        (
            family("{Ex: k*dir_x*time_min}", "{k: um}"),
            "e.yaml:4: effects[0].equations.Ex: this term has a time (min) too many at column 1: "
            "'k*dir_x*time_min'; expected k in um/min or um/h, or the time divided by a number",
        ),
        (
            family('{Ex: "k*x*({a} - {a0})"}'),
            "e.yaml:4: effects[0].equations.Ex: this term is mm^2, its equation is a length (mm) "
            "at column 1: 'k*x*({a} - {a0})'; expected",
        ),
        (
            family("{Ex: k*x*sin(p)}", more="search: {p: {of: w, from: 1, to: 2}}"),
            "e.yaml:5: effects[0].search.p.of: unknown name: 'w'",
        ),
        (
            family(more="name: f-{T}"),
            "e.yaml:5: effects[0].name: {T} in the name of a candidate: 'f-{T}'",
        ),
        (
            family(more="separates: move {b}"),
            "e.yaml:5: effects[0].separates: {b} is not in the name 'f': 'move {b}'; expected "
            "plain words, or what it has",
        ),
        (
            family(more="members: [{parameters: {k: um/m}, equations: {Ex: k*x}}]"),
            "e.yaml:3: effects[0].parameters: stands beside `members`",
        ),
        ("- family: f\n  says: s\n", "e.yaml:1: effects[0]: the key 'parameters' is missing"),
        (
            family() + family(),
            "e.yaml:5: effects[1]: a second family whose candidates are called so (the first: "
            "line 1): 'f'",
        ),
        (family('{Ex: "k*{b}"}'), "e.yaml:1: effects[0]: {b} without {a}"),
        ("schema: mtu/machine/1\n", "e.yaml:1: schema: not an effects file"),
        ("effects: []\n", "e.yaml:1: the key 'schema' is missing"),
        ("[]\n", "e.yaml:1: effects: wrong value: '[]'; expected at least 1 of them"),
        ("- 5\n", "e.yaml:1: effects[0]: wrong value: '5'; expected keys with values"),
    ],
)
def test_other_faults(tmp_path: Path, text: str, told: str) -> None:
    found = faults(tmp_path, text)
    assert any(fault.startswith(told) for fault in found), found


@pytest.mark.parametrize(
    ("name", "of", "equation"),
    [
        ("T_min", "'{T}'", "k*({T} - T_min)*step({T} - T_min)"),
        ("seq_min", "sequence", "k*x*step(sequence - seq_min)"),
        ("t_min", "time_min", "k*x*exp(-time_min/t_min)"),
    ],
)
def test_a_name_that_ends_in_min_may_be_a_minimum(
    tmp_path: Path, name: str, of: str, equation: str
) -> None:
    parameters = "{k: um/K}" if "T" in name else "{k: um/m}"
    text = family(f"{{Ex: '{equation}'}}", parameters, f"search: {{{name}: {{of: {of}}}}}")
    assert len(load(tmp_path, text).families) == 1


def test_all_faults_of_a_file_at_once(tmp_path: Path) -> None:
    found = faults(tmp_path, family("{Ex: k*speed}") + family("{Ey: k**2}", name="g"))
    assert [fault.split(":")[1] for fault in found] == ["4", "8"]


@pytest.mark.parametrize(
    ("line", "example"),
    [("equations: {E{a}: k*x}", "{'E{a}': k*x}"), ("needs: [dir_{a}]", "['dir_{a}']")],
)
def test_braces_within_braces_are_explained(tmp_path: Path, line: str, example: str) -> None:
    (found,) = faults(tmp_path, f"- family: f\n  says: s\n  {line}\n")
    assert found.startswith("e.yaml:3: not readable as YAML")
    assert found.endswith(
        f"expected names with braces on lines of their own, or in quotes: {example}"
    )


def test_names_of_built_in_families_and_of_other_files_are_taken(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(family(name="backlash"))
    with pytest.raises(
        InputError, match=r"a\.yaml:1: effects\[0\]\.family: the name is taken: a bu"
    ):
        effect_library([tmp_path / "a.yaml"])
    (tmp_path / "b.yaml").write_text(family())
    with pytest.raises(InputError, match=r"the name is taken: a family of b\.yaml"):
        effect_library([tmp_path / "b.yaml", tmp_path / "b.yaml"])


@pytest.mark.parametrize("name", ["a" * 200_000, "{a}" * 50_000, "{" * 200_000, "a{b" * 50_000])
def test_a_very_long_name_costs_nothing(tmp_path: Path, name: str) -> None:
    """Names of parameters are searched for braces: in linear time, whatever they are."""
    start = time.process_time()
    faults(tmp_path, family(parameters=f"{{? '{name}' : um}}", equations=f"{{Ex: '{name}'}}"))
    assert time.process_time() - start < 5.0


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        effect_library([tmp_path / "none.yaml"])


@pytest.mark.parametrize(
    ("unit", "dimension", "internal"),
    [
        ("um/K", 1, 1e-3),
        ("um/m/K", 0, 1e-6),
        ("um/m^2", -1, 1e-9),
        ("um/m^3", -2, 1e-12),
        ("um/h", 1, 1e-3 / 60),
        ("um/m/min", 0, 1e-6),
        ("um/m/h", 0, 1e-6 / 60),
        ("arcsec/K", 0, 4.84813681109536e-6),
        ("arcsec/m", -1, 4.84813681109536e-9),
    ],
)
def test_units_of_parameters(unit: str, dimension: int, internal: float) -> None:
    assert PARAMETER_UNITS[unit].dimension == dimension
    assert PARAMETER_UNITS[unit].to_internal == pytest.approx(internal, rel=1e-12)
    # Readings and components stay in the units of the contract.
    assert unit not in UNITS
    assert UNITS.items() <= PARAMETER_UNITS.items()
