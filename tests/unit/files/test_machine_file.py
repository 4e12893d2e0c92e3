"""Machine files: what is accepted, and every fault with its line and path."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtu_cli.files.machine import LoadedMachine, load_machine
from mtu_cli.findings import InputError

VALID = """\
schema: mtu/machine/1
name: three-axis vertical machining centre
axes: {x: {travel_mm: [0, 1020]}, y: {travel_mm: [0, 762]}}
constants: {z: 127.0, Z12: {value: 310.0, u: 0.05}}
covariates: [load]
components:
  dx_x: {of: x, unit: um, degree: 1, says: X positioning}
  ez_x: {of: x, unit: arcsec}
  dy_y: {of: y, unit: um, coefficients: [1, 2.5e-3, 1e-6], s_repeat: 1.2,
         covariance: [[1, 0, 0], [0, 1e-6, 0], [0, 0, 1e-12]],
         pass_covariance: [[1, 0], [0, 1e-6]], pass_center_mm: 300, dof: 78}
  axy: {unit: arcsec, coefficients: [3], u_future: 1.9}
equations:
  Ex: dx_x + y*ez_x - y*axy + 0.001*load*(T_spindle_degC - 20)
  Ey: dy_y - x*ez_x - Z12*ez_x
effects:
  - name: backlash-x
    family: backlash
    axis: x
    covariate: dir_x
    parameters: {lost_motion: {value: 4.1, u: 0.3, unit: um}}
    covariance: [[0.09]]
    equations: {Ex: lost_motion*dir_x}
    found: {parts: 21, by: {alpha: 0.05}}
"""


def load(tmp_path: Path, text: str) -> LoadedMachine:
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    return load_machine(tmp_path / "m.yaml")


def faults(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    return [str(problem) for problem in caught.value.findings]


def machine(
    components: str = "{a: {of: x, unit: um}}", equations: str = "{Ex: a}", more: str = ""
) -> str:
    return (
        f"schema: mtu/machine/1\nname: m\ncomponents: {components}\nequations: {equations}\n{more}"
    )


def test_a_machine_is_read_with_its_linear_forms(tmp_path: Path) -> None:
    loaded = load(tmp_path, VALID)
    assert set(loaded.forms["Ex"].coefficients) == {"dx_x", "ez_x", "axy"}
    assert loaded.forms["Ex"].remainder is not None
    assert loaded.forms["Ey"].remainder is None
    assert set(loaded.effect_forms[0]["Ex"].coefficients) == {"lost_motion"}
    assert loaded.warnings == ()
    assert loaded.line_of("components", "ez_x") == 8
    assert loaded.line_of("equations", "Ey") == 15
    read = loaded.machine
    assert read.reference_temperature_degC == 20.0
    assert (read.constants["z"].value, read.constants["z"].u) == (127.0, 0.0)
    assert (read.constants["Z12"].value, read.constants["Z12"].u) == (310.0, 0.05)
    assert read.effects[0].found == {"parts": 21, "by": {"alpha": 0.05}}


def test_notices(tmp_path: Path) -> None:
    text = machine("{a: {of: x, unit: um}, b: {unit: um, s_repeat: 1}}")
    notices = load(tmp_path, text).warnings
    assert [notice.code for notice in notices] == ["unused", "not-used"]
    assert "components.b: the component 'b' is in no equation" in notices[0].message
    assert "figures not used (s_repeat): there are no coefficients" in notices[1].message


@pytest.mark.parametrize(
    ("component", "words"),
    [
        ("{of: x, unit: um, s_pass: 1}", "unknown key: 's_pass'; expected one of: of, unit"),
        ("{of: x, unit: um, degree: 1.0}", "degree: wrong value: '1.0'; expected a whole number"),
        (
            "{of: x, unit: um, degree: 2, coefficients: [1]}",
            "coefficients: 1 coefficient of a component of degree 2; expected 3",
        ),
        ("{of: x, unit: um, coefficients: [1, .inf]}", "coefficients[1]: wrong value: 'Infinity'"),
        ("{unit: um, pass_covariance: [[1, 0], [0, 1]]}", "pass_covariance: not 1 x 1"),
    ],
)
def test_faulty_components(tmp_path: Path, component: str, words: str) -> None:
    found = faults(tmp_path, machine(f"{{a: {component}}}"))
    assert len(found) == 1
    assert found[0].startswith("m.yaml:3: components.a")
    assert words in found[0]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("constants: {b: {value: 1, u: -1}}", "constants.b.u: wrong value: '-1'"),
        ("constants: {sin: 1}", "constants.sin: the name is taken: it is part of the equation"),
        ("constants: {dir_x: 1}", "constants.dir_x: the name is taken: it is a covariate"),
        ("covariates: [a]", "components.a: the name is taken: it is a covariate"),
        (
            "constants: {h: 1e200}",
            "constants.h: out of range: '1e+200'; expected at most 1e+30 in size",
        ),
        ("fish: 1", "fish: unknown key: 'fish'; expected one of: schema, name, says"),
    ],
)
def test_faults_elsewhere(tmp_path: Path, more: str, words: str) -> None:
    found = faults(tmp_path, machine(more=more))
    assert len(found) == 1
    assert words in found[0]


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        ("parameters: {p: {value: 1, unit: rad}}, equations: {Ex: p*3}", "this term is an angle"),
        (
            "parameters: {p: {value: 1, unit: um}}, equations: {Ey: p*dir_y*x}",
            "equations.Ey: this term is mm^2, not a length (mm) at column 1: "
            "'p*dir_y*x'; expected p in um/m",
        ),
        (
            "parameters: {p: {value: 1, unit: um}, q: {value: 8, unit: mm}}, "
            "equations: {Ex: p*step(sequence - q)}",
            "'q': inside step() at column 19",
        ),
        (
            "parameters: {p: {value: 1, unit: um}}, equations: {Ex: p*dir_x}, "
            "seen: {dir_x: [1, 0]}",
            "effects[0].seen.dir_x: wrong value: '[1, 0]'; expected the lower end first",
        ),
        ("parameters: {a: {value: 1, unit: um}}, equations: {Ex: a}", "the name is taken: it is"),
    ],
)
def test_faulty_effects(tmp_path: Path, effect: str, words: str) -> None:
    found = faults(tmp_path, machine(more=f"effects: [{{name: e, {effect}}}]"))
    assert len(found) == 1
    assert found[0].startswith("m.yaml:5: effects[0].")
    assert words in found[0]


def test_all_problems_come_at_once_in_the_order_of_lines(tmp_path: Path) -> None:
    text = VALID.replace("name: three", "nmae: three").replace("of: y, unit: um", "of: y, unit: m")
    text = text.replace("y*ez_x - y", "y*ez_q - y").replace("value: 4.1", "value: x")
    text = text.replace("travel_mm: [0, 762]", "travel_mm: [762, 0]")
    found = faults(tmp_path, text)
    assert [line.split(": ")[0] for line in found] == [
        "m.yaml:1",
        "m.yaml:2",
        "m.yaml:3",
        "m.yaml:9",
        "m.yaml:14",
        "m.yaml:21",
    ]
    # The faulty component is known by name: no equation complains of it.
    assert not any("dy_y" in line for line in found[4:])
