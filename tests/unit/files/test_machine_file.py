"""Machine and part files: what is accepted, and faults beside `tests/cli/invalid`."""

from pathlib import Path

import pytest

from mtu_cli.files.machine import LoadedMachine, Thermal, load_machine
from mtu_cli.files.part import LoadedPart, Tolerance, load_part
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
    assert loaded.place("components", "ez_x")["line"] == 8
    assert loaded.place("equations", "Ey")["line"] == 15
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
    ("text", "words"),
    [
        ("[1]", "m.yaml:1: not a machine file"),
        ("name: m", "the key 'schema' is missing"),
        ("schema: mtu/machine/2", "'mtu/machine/2'; expected mtu/machine/1"),
        (machine("{a: {of: x, unit: um, degree: 1.0}}"), "degree: wrong value: '1.0'; expected a"),
        (machine("{a: {unit: um, pass_covariance: [[1, 0], [0, 1]]}}"), "pass_covariance: not 1 x"),
        (machine(more="constants: {b: {value: 1, u: -1}}"), "constants.b.u: wrong value: '-1'"),
        (machine(more="constants: {dir_x: 1}"), "constants.dir_x: the name is taken: it is a cov"),
        (machine(more="covariates: [a]"), "components.a: the name is taken: it is a covariate"),
        (machine(more="constants: {h: 1e200}"), "constants.h: out of range: '1e+200'; expected at"),
    ],
)  # fmt: skip
def test_faults_of_a_machine(tmp_path: Path, text: str, words: str) -> None:
    (found,) = faults(tmp_path, text)
    assert words in found


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


# Known drifts in machine files: what is accepted, and every fault with its line and path.


HEAD = "schema: mtu/machine/1\nname: m\nequations: {Ex: a}\ncomponents:\n"


def load_thermal(tmp_path: Path, component: str) -> Thermal:
    found = load(tmp_path, f"{HEAD}  a: {component}\n").machine.components["a"].thermal
    assert found is not None
    return found


def test_drifts_through_positions_and_the_same_everywhere(tmp_path: Path) -> None:
    """A lower degree, and noise of all sensors or by name."""
    placed = "{of: x, unit: um, thermal: {positions_mm: [300, 0, 75], gradients: "
    placed += "{T_01_degC: [-3.5, 0, 4], T_b_degC: [1, 2, 3]}, "
    more = "time_constants_min: {T_b_degC: 40}, s_leftover: 0.3, sensor_u_degC: 0.015}}"
    found = load_thermal(tmp_path, placed + more)
    assert (found.positions_mm, found.degree) == ([300, 0, 75], 2)
    assert found.gradients["T_01_degC"] == [-3.5, 0, 4]
    assert (found.time_constants_min, found.s_leftover) == ({"T_b_degC": 40}, 0.3)
    assert found.sensor_u_degC == {"T_01_degC": 0.015, "T_b_degC": 0.015}
    found = load_thermal(tmp_path, placed + "degree: 1, sensor_u_degC: {T_b_degC: 0.1}}}")
    assert (found.degree, found.sensor_u_degC) == (1, {"T_b_degC": 0.1})
    for of in ("of: x, ", ""):
        found = load_thermal(tmp_path, f"{{{of}unit: um, thermal: {{gradients: {{T_a_degC: 2}}}}}}")
        assert (found.positions_mm, found.degree) == (None, 0)
        assert found.gradients == {"T_a_degC": [2]}
        assert (found.time_constants_min, found.s_leftover, found.sensor_u_degC) == ({}, 0, {})


PLACED = "of: x, unit: um, thermal: {positions_mm: [0, 75], gradients: {T_a_degC: [1, 2]}"
PLAIN = "unit: um, thermal: {gradients: {T_a_degC: 1}"
MANY = ", ".join(map(str, range(11)))
FAULTS = [
    (PLAIN + ", degree: 1}", "degree: too little data: 1 position: '1'; expected at most 0"),
    (PLACED + ", degree: 2}", "degree: too little data: 2 positions: '2'; expected at most 1"),
    (f"of: x, unit: um, thermal: {{positions_mm: [{MANY}], gradients: {{T_a_degC: [{MANY}]}}}}",
     "degree: wrong value: '10'; expected a number of at most 9"),
    ("unit: um, thermal: {positions_mm: [0], gradients: {T_a_degC: 1}}",
     "positions_mm: positions of a component without `of`"),
    ("of: x, unit: um, thermal: {positions_mm: [0.0, 5, -0.0], gradients: {T_a_degC: [1, 2, 3]}}",
     "positions_mm[2]: the position appears twice: '0'"),
    ("of: x, unit: um, thermal: {positions_mm: [0, 75], gradients: {T_a_degC: 1}}",
     "gradients.T_a_degC: 1 gradient at 2 positions: '1'; expected one a position"),
    ("unit: um, thermal: {gradients: {T_a_degC: [1, 2]}}",
     "gradients.T_a_degC: 2 gradients at 1 position; expected one a position"),
    ("unit: um, thermal: {gradients: {T_a-b_degC: 1}}",
     "gradients.T_a-b_degC: not the name of a temperature: 'T_a-b_degC'; expected T_<sensor>_degC"),
    (PLAIN + ", time_constants_min: {T_a_degc: 3}}",
     "time_constants_min.T_a_degc: unknown sensor: 'T_a_degc'; did you mean 'T_a_degC'?"),
    (PLAIN + ", sensor_u_degC: {T_b_degC: 1}}",
     "sensor_u_degC.T_b_degC: unknown sensor: 'T_b_degC'; did you mean"),
]  # fmt: skip


@pytest.mark.parametrize(("component", "words"), FAULTS)
def test_a_faulty_drift(tmp_path: Path, component: str, words: str) -> None:
    (found,) = faults(tmp_path, f"{HEAD}  a: {{{component}}}\n")
    assert found.startswith(f"m.yaml:5: components.a.thermal.{words}")


# Part files.


FEATURES = (
    "features: {3: {x_mm: 10, y_mm: 10}, '9': {x_mm: 10, y_mm: 140, z_mm: 5}, "
    "a: {x_mm: 140, y_mm: 140}, b: {x_mm: 10, y_mm: 10}}\n"
)


def part(tmp_path: Path, text: str) -> LoadedPart:
    (tmp_path / "p.yaml").write_text("schema: mtu/part/1\nname: p\nz_mm: 127\n" + text)
    return load_part(tmp_path / "p.yaml")


def part_faults(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        part(tmp_path, text)
    return [str(problem) for problem in caught.value.findings]


def test_a_part(tmp_path: Path) -> None:
    text = FEATURES + (
        "lengths: [{from: 3, to: '9', tolerance_um: 30}, {id: L, from: 9, to: a}]\n"
        "orthogonality: [{id: xy, row: [9, a], column: [3, 9]}]\n"
        "circles: [{id: ring, features: [3, 9, a], calibrated_mm: {20: 180.0124, 26: 180.0137}, "
        "U_um: 1.0, temperature: T_ring_degC}, {id: r, features: [3, 9, a], calibrated_mm: 5}]\n"
        "spheres: [{id: s, features: [3, 9, a, b]}]\n"
    )
    read = part(tmp_path, text).part
    assert read.places()["3"] == (10.0, 10.0, 127.0)
    assert read.places()["9"] == (10.0, 140.0, 5.0)
    assert [(item.id, item.from_, item.to) for item in read.lengths] == [
        ("3-9", "3", "9"),
        ("L", "9", "a"),
    ]
    assert read.orthogonality[0].row == ["9", "a"]
    assert read.circles[0].calibrated_mm == {20.0: 180.0124, 26.0: 180.0137}
    assert read.circles[1].calibrated_mm == {20.0: 5.0}


def test_tolerances(tmp_path: Path) -> None:
    text = FEATURES.replace("x_mm: 10, y_mm: 10}", "x_mm: 10, y_mm: 10, position_um: 50}", 1) + (
        "lengths: [{from: 3, to: 9, tolerance_um: 30}, {from: 9, to: a, tolerance_um: [-5, 25]}]\n"
        "orthogonality: [{id: xy, row: [9, a], column: [3, 9], tolerance_arcsec: [-8, 8]}]\n"
    )
    read = part(tmp_path, text).part
    assert [read.features[name].position_um for name in "39"] == [50.0, None]
    assert [each.tolerance for each in read.lengths] == [Tolerance(-30, 30), Tolerance(-5, 25)]
    assert [each.tolerance.stated for each in read.lengths if each.tolerance] == [30, (-5, 25)]
    assert read.orthogonality[0].tolerance == Tolerance(-8, 8)


NO_TOLERANCE = "expected a number above 0, or [low, high]"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lengths: [{from: 3, to: b}]", "'b'; expected a feature at another place than '3'"),
        *((f"lengths: [{{from: 3, to: 9, tolerance_um: {value}}}]", NO_TOLERANCE)
          for value in ("[3]", "[5, -5]", "[1, .inf]")),
        ("lengths: [{from: 2.5, to: 9}]", "lengths[0].from: wrong value: '2.5'; expected a text"),
        ("circles: [{id: c, features: [3, 9]}]", "features: wrong value: '[3, 9]'; expected at l"),
        ("circles: [{id: c, features: [3, 9, a], calibrated_mm: {20: 1, 26: 2}}]",
         "circles[0].calibrated_mm: diameters at several temperatures"),
        ("circles: [{id: c, features: [3, 9, a], calibrated_mm: {warm: 1}}]",
         "expected keys in degC"),
        ('lengths: [{from: 3, to: 9, id: "a\\nb"}]', r"not a name: 'a\nb'; expected a t"),
    ],
)  # fmt: skip
def test_faulty_parts(tmp_path: Path, text: str, words: str) -> None:
    (found,) = part_faults(tmp_path, FEATURES + text)
    assert found.startswith("p.yaml:5: ")
    assert words in found


def test_a_faulty_feature_is_not_called_unknown(tmp_path: Path) -> None:
    text = "features: {3: {x_mm: 1}, 4: {x_mm: 1, y_mm: 2}}\nlengths: [{from: 3, to: 5}]\n"
    missing, unknown = part_faults(tmp_path, text)
    assert missing == "p.yaml:4: features.3: the key 'y_mm' is missing"
    assert "lengths[0].to: unknown feature: '5'" in unknown
