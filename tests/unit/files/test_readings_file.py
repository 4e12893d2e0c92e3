"""Readings: units, directions, times, and what only the machine can tell."""

import json
from collections.abc import Sequence
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import written_effect

from mtu_cli.files.extend_machine import ExtendedMachine, extended_machine
from mtu_cli.files.machine import Component, LoadedMachine, load_machine, machine_from
from mtu_cli.files.part import Place
from mtu_cli.files.readings import Points, Readings, read_points, read_readings
from mtu_cli.files.reports_read import read_report, read_reports
from mtu_cli.files.source import Source
from mtu_cli.files.yaml_file import parse_yaml
from mtu_cli.findings import InputError

MACHINE = {
    "dx_x": Component.model_validate({"of": "x", "unit": "um"}),
    "ez_x": Component.model_validate({"of": "x", "unit": "arcsec"}),
    "axy": Component.model_validate({"unit": "arcsec"}),
}
HEADER = "component,position_mm,error,unit"


def files_of(folder: Path, contents: Sequence[str], *roles: str) -> list[tuple[Path, str]]:
    """A file of each content, r0.csv and so on."""
    files = [(folder / f"r{i}.csv", role) for i, role in enumerate(roles)]
    for (path, _), content in zip(files, contents, strict=False):
        path.write_text(content)
    return files[: len(contents)]


def read(tmp_path: Path, *contents: str) -> Readings:
    return read_readings(files_of(tmp_path, contents, "lbb", "laser"), MACHINE, for_fit=False)


def faults(tmp_path: Path, *contents: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(tmp_path, *contents)
    return [str(problem) for problem in caught.value.findings]


def test_readings_of_two_files(tmp_path: Path) -> None:
    first = (
        f"{HEADER},pass,direction,cycle,T_a_degC,setup\n"
        "axy,5,3600,arcsec,1,,w1,20,a\n"
        "dx_x,0,1.5,um,1,forward,w1,20.5,a\n"
        "dx_x,100,2,um,2,-,w2,,b\n"
    )
    second = "unit,error,component,position_mm,note\n# laser\nmrad,2,ez_x,10,7\n"
    found = read(tmp_path, first, second)
    assert found.components == ("dx_x", "ez_x", "axy")
    assert found.code.tolist() == [2, 0, 0, 1]
    np.testing.assert_array_equal(found.position_mm, [np.nan, 0, 100, 10])
    np.testing.assert_allclose(found.error, [pi / 180, 1.5e-3, 2e-3, 2e-3], rtol=1e-15)
    assert found.pass_number.tolist() == [1, 1, 2, -1]
    assert found.has_pass.tolist() == [True, True, True, False]
    assert found.direction.tolist() == [0, 1, -1, 0]
    assert found.direction.dtype == np.int8
    assert (found.cycles, found.cycle.tolist()) == (("w1", "w2"), [0, 0, 1, -1])
    assert np.isnan(found.time_min).all()
    np.testing.assert_array_equal(found.covariates["T_a_degC"], [20, 20.5, np.nan, np.nan])
    assert found.covariates["setup"].tolist() == ["a", "a", "b", ""]
    np.testing.assert_array_equal(found.covariates["note"], [np.nan] * 3 + [7])
    assert found.file_index.tolist() == [0, 0, 0, 1]
    assert found.row.tolist() == [2, 3, 4, 3]
    assert [source.role for source in found.sources] == ["lbb", "laser"]
    assert [source.rows for source in found.sources] == [3, 1]
    assert len(found) == 4


def test_every_way_to_write_a_direction(tmp_path: Path) -> None:
    ways = ["forward", "Reverse", "+", "-", "1", "-1", "+1", "1.0", "-1.0", "FORWARD", ""]
    rows = "".join(f"dx_x,{i},1,um,{way}\n" for i, way in enumerate(ways))
    found = read(tmp_path, f"{HEADER},direction\n{rows}")
    assert found.direction.tolist() == [1, -1, 1, -1, 1, -1, 1, 1, -1, 1, 0]


def test_equal_rows_are_one_reading_twice_where_passes_are_told_apart(tmp_path: Path) -> None:
    rows = "dx_x,0,1,um,1\ndx_x,5,1,um,1\n\ndx_x,0,1.0,um,1\ndx_x,0,1,um,2\n"
    assert faults(tmp_path, f"{HEADER},time_min\n{rows}") == [
        "r0.csv, row 5: the same as row 2; expected each row once"
    ]
    found = read(tmp_path, f"{HEADER},other\n{rows}")
    assert len(found) == 4
    with_covariate = "dx_x,0,1,um,1,20.1\ndx_x,0,1,um,1,20.2\n"
    assert len(read(tmp_path, f"{HEADER},pass,T_a_degC\n{with_covariate}")) == 2
    empty = "dx_x,0,1,um,1,\ndx_x,0,1,um,1,\n"
    assert len(faults(tmp_path, f"{HEADER},pass,T_a_degC\n{empty}")) == 1


# Measured points: nominal places, order of manufacture, approach directions.


PART: dict[str, Place] = {"h2": (10.0, 20.0, None), "h1": (0.0, 0.0, 5.0), "h10": (1.0, 1.0, None)}
HEAD = "part,feature,x_mm,y_mm"


def read_cmm(tmp_path: Path, *contents: str, features: dict[str, Place] | None = PART) -> Points:
    return read_points(files_of(tmp_path, contents, "cmm", "cmm"), features)


def test_points_of_two_files(tmp_path: Path) -> None:
    first = (
        f"{HEAD},z_mm,repeat,operation,dir_x,T_a_degC,shift\n"
        "007,h1,0.01,0.02,5.01,1,drilled,-1,20,day\n"
        "007,h2,10.01,20,5,1,milled,,20,day\n"
        "A,h1,0,0,5,2,drilled,1,21,\n"
    )
    second = f"{HEAD}\n7,h2,10,20\n007,h2,10,20.5\n"
    found = read_cmm(tmp_path, first, second)
    assert (found.parts, found.part.tolist()) == (("007", "A", "7"), [0, 0, 1, 2, 0])
    assert (found.features, found.feature.tolist()) == (("h2", "h1"), [1, 0, 1, 0, 0])
    assert (found.operations, found.operation.tolist()) == (
        ("drilled", "milled"),
        [0, 1, 0, -1, -1],
    )
    nan = np.nan
    np.testing.assert_array_equal(
        found.measured,
        [[0.01, 0.02, 5.01], [10.01, 20, 5], [0, 0, 5], [10, 20, nan], [10, 20.5, nan]],
    )
    np.testing.assert_array_equal(
        found.nominal, [[0, 0, 5], [10, 20, nan], [0, 0, 5], [10, 20, nan], [10, 20, nan]]
    )
    assert found.repeat.tolist() == [1, 1, 2, -1, -1]
    assert found.sequence.tolist() == [1, 1, 2, 3, 1]
    np.testing.assert_array_equal(found.direction[:, 0], [-1, nan, 1, nan, nan])
    assert np.isnan(found.direction[:, 1:]).all()
    assert np.isnan(found.time_min).all()
    assert found.covariates["shift"].tolist() == ["day", "day", "", "", ""]
    np.testing.assert_array_equal(found.covariates["T_a_degC"], [20, 20, 21, nan, nan])
    assert found.file_index.tolist() == [0, 0, 0, 1, 1]
    assert found.row.tolist() == [2, 3, 4, 2, 3]
    assert len(found) == 5


NOMINAL = f"{HEAD},nominal_x_mm,nominal_y_mm,nominal_z_mm"
LINE = "expected a text on one line that is not empty, without control characters"
FAULTS: dict[str, tuple[list[str], dict[str, Place] | None, list[str]]] = {
    "another nominal": (
        [f"{NOMINAL}\na,h1,1,2,0,0,5\na,h2,1,2,10.00001,20,7\n"],
        PART,
        ["r0.csv, row 3, column 'nominal_x_mm': contradicts the nominal place of 'h2': '10.00001'; "
         "expected 10, as in the part file"],
    ),
    "directions": (
        [f"{HEAD},dir_x\na,h1,0,0,+\na,h2,0,0,forwrd\n"],
        PART,
        ["r0.csv, row 3, column 'dir_x': not a direction: 'forwrd'; did you mean 'forward'?"],
    ),
    "equal rows": (
        [f"{HEAD},repeat\na,h1,0,0,1\na,h1,-0.0,0,1\na,h1,0,0,2\n"],
        PART,
        ["r0.csv, row 3: the same as row 2; expected each row once"],
    ),
    "repeat below 0, in all of a file": (
        [f"{HEAD},repeat\n7,h1,0,0,-1\n", f"{HEAD}\n8,h1,0,0\n"],
        PART,
        ["r0.csv, row 2, column 'repeat': out of range: '-1'; expected a whole number from 0 on"],
    ),
    "control characters": (
        [f'{HEAD}\n1\x1b[31m,h1,0,0\n2,"h\n1",0,0\n'],
        None,
        ["r0.csv, row 2, column 'part': not a name that a table can show: '1\\x1b[31m'; " + LINE,
         "r0.csv, row 3, column 'feature': not a name that a table can show: 'h\\n1'; " + LINE],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_faults_have_their_place(tmp_path: Path, case: str) -> None:
    contents, features, expected = FAULTS[case]
    with pytest.raises(InputError) as caught:
        read_cmm(tmp_path, *contents, features=features)
    assert [str(problem) for problem in caught.value.findings] == expected


def test_columns_that_stand_in_for_others(tmp_path: Path) -> None:
    """Nominal places without a part file, or within a nanometre of it; dates and a sequence;
    directions in words, signs or numbers, in a decimal comma, too.
    """
    alone = read_cmm(tmp_path, f"{NOMINAL}\na,f,1,2,1.5,2.5,3.5\n", features=None)
    assert alone.nominal.tolist() == [[1.5, 2.5, 3.5]]
    near = read_cmm(tmp_path, f"{NOMINAL}\na,h2,1,2,10.0000009,20,7\n")
    assert near.nominal.tolist() == [[10.0, 20.0, 7.0]]
    dated = f"{HEAD},time,sequence\na,h1,0,0,2024-05-03 10:30,7\nb,h2,0,0,2024-05-03 10:00,-4\n"
    found = read_cmm(tmp_path, dated)
    assert (found.time_min.tolist(), found.sequence.tolist()) == ([30.0, 0.0], [7, -4])
    first = f"{HEAD},dir_x,dir_y\na,h1,0,0,+,forward\na,h2,0,0,,Reverse\nb,h1,0,0,-,+1\n"
    found = read_cmm(tmp_path, first, f"{HEAD},dir_x\nc,h1,0,0,1.0\nc,h2,0,0,-1\n")
    np.testing.assert_array_equal(found.direction[:, 0], [1, np.nan, -1, 1, -1])
    np.testing.assert_array_equal(found.direction[:3, 1], [1, -1, 1])
    german = f"{HEAD};dir_x".replace(",", ";") + "\na;h1;0,5;0;1,0\na;h2;0;0;−\n"
    assert read_cmm(tmp_path, german).direction[:, 0].tolist() == [1, -1]


# Reports that are read back: told apart by their schema, at most one of each kind.


EARLIER = Path(__file__).parent / "earlier_reports"
FITTED, DRIFTS = (
    json.loads((EARLIER / f"{kind}-0.1.json").read_text("utf-8"))["results"]["components"]
    for kind in ("fit-components", "thermal-fit")
)
ROW, FITTED = FITTED["dx_x"], FITTED["axy"]
JOINT = {
    "components": ["a", "b"], "widths": [1, 1], "coefficient_covariance": [[0, 0], [0, 0]],
    "pass_covariance": [[0, 0], [0, 0]], "pass_dof": 4, "n_passes": 3,
}  # fmt: skip


def written(path: Path, kind: str, *components: dict[str, Any], **results: Any) -> Path:
    entries = dict(zip("abc", components, strict=False))
    document = {"schema": f"mtu/{kind}/1", "results": {"components": entries, **results}}
    path.write_text(json.dumps(document))
    return path


def report_faults(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_report(path)
    return [str(each).removeprefix(f"{path.name}: ") for each in caught.value.findings]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pass_covariance": [[1e31]]}, "pass_covariance[0][0]: out of range: '1e+31'"),
        ({"degree": 1e99}, "degree: wrong value: '1e+99'; expected a whole number"),
        ({"unit": 3}, "unit: unknown value: '3'; expected one of: um, mm"),
        (ROW | {"covariance": [[1, 0]]}, "covariance: another size; expected 2 x 2"),
        (ROW | {"covariance": [[1, 500], [0, 1]]}, "covariance: not symmetric"),
        ({"covariance": [[-1.0]]}, "covariance: a variance is negative"),
        ({"s_repeat": -1.0}, "s_repeat: "),
    ],
)
def test_faulty_components(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    (found,) = report_faults(written(tmp_path / "c.json", "fit-components", FITTED | change))
    assert found.startswith(f"results.components.a.{words}")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"coefficient_covariance": [[1, 0.5]]}, "another size; expected 2 x 2"),
        ({"components": ["a", "d"]}, "expected components of the report, whose widths are [1]"),
        ({"widths": [1, 2]}, "another size; expected 3 x 3"),
    ],
)
def test_components_fitted_together(
    tmp_path: Path, change: dict[str, Any], words: str | None
) -> None:
    joint = {"joint_pass_covariance": [JOINT | change]}
    path = written(tmp_path / "c.json", "fit-components", FITTED, FITTED, **joint)
    if words is None:
        assert read_report(path)
    else:
        assert words in report_faults(path)[0]
        assert report_faults(path)[0].startswith("results.joint_pass_covariance")


def test_faults_of_all_components_are_reported_at_once(tmp_path: Path) -> None:
    """A faulty figure of one hides no other's, and makes none of the groups that it is in."""
    unit, shape, sound = FITTED | {"unit": "bad"}, FITTED | {"covariance": [[1, 0]]}, FITTED
    joint = {"joint_pass_covariance": [JOINT | {"components": ["a", "c"]}, None]}
    path = written(tmp_path / "c.json", "fit-components", unit, shape, sound, **joint)
    found = report_faults(path)
    assert [each.partition(": ")[0] for each in found] == [
        "results.components.a.unit",
        "results.joint_pass_covariance[1]",
        "results.components.b.covariance",
    ]
    path.write_text('{"schema": "mtu/fit-components/1"}')
    assert report_faults(path) == ["the key 'results' is missing"]


def test_two_of_a_kind_and_neither_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fitted = [written(tmp_path / f"c{i}.json", "fit-components", FITTED) for i in (1, 2)]
    drifts = [written(tmp_path / f"t{i}.json", "thermal-fit", DRIFTS["pos_y"]) for i in (1, 2)]
    other = written(tmp_path / "l.json", "lengths", {})
    (tmp_path / "x.json").write_text("[1]")
    (tmp_path / "e.json").write_text("{}")
    paths = [*fitted, *drifts, other, tmp_path / "x.json", tmp_path / "e.json", Path("qqqqqq")]
    with pytest.raises(InputError) as caught:
        read_reports(paths)
    kinds = (
        "expected 'mtu/fit-components/1' or 'mtu/thermal-fit/1', as `mtu fit-components -o "
        "FILE.json` or `mtu thermal-fit -o FILE.json` writes it"
    )
    assert [str(problem) for problem in caught.value.findings] == [
        "c2.json: c1.json, c2.json are given together; expected one components report at most",
        "t2.json: t1.json, t2.json are given together; expected one thermal report at most",
        f"l.json: schema: not a components report: 'mtu/lengths/1'; {kinds}",
        f"x.json: not a components report; {kinds}",
        f"e.json: not a components report; {kinds}",
        "qqqqqq: no such file",
    ]


def test_reports_of_version_0_1_are_read() -> None:
    """As commit 61d6796 wrote them; what they hold beyond the fields that are read is ignored."""
    both = read_reports([EARLIER / "fit-components-0.1.json", EARLIER / "thermal-fit-0.1.json"])
    assert both.components is not None
    assert both.thermal is not None
    assert list(both.components.components) == ["dx_x", "ez_x", "dy_y", "axy"]
    assert both.components.components["dx_x"].pass_dof is not None
    item = both.thermal.components["pos_y"]
    assert len(item.coefficients) == item.degree + 1


# Effects added to machine files of every layout: nothing else changes, and all is read back.


SOURCE = Source(role="machine", path=Path("m.yaml"), shown="m.yaml", sha256="")
BACKLASH = written_effect(
    name="backlash-x",
    family="backlash",
    axis="x",
    covariate="dir_x",
    says="lost motion at reversal of x; half the reversal value",
    parameters={"lost_motion": (4.1, 1 / 3, "um")},
    covariance=[[1 / 9]],
    equations={"Ex": "lost_motion*dir_x"},
    found={"files": [{"path": "cmm.csv", "sha256": "ab" * 32}], "parts": 21, "p": 1e-6},
)
WEAR = written_effect(
    name="trend-y",
    parameters={"slope": (0.1 + 0.2, 1e-17, "um"), "shift": (-5e22, 0.0, "nm")},
    covariance=[[1e-34, 0.0], [0.0, 0.0]],
    equations={"Ey": "slope*(tool_parts - 12.5) + shift"},
)
TOP = "schema: mtu/machine/1  # the format\nname: m\ncomponents: {a: {of: x, unit: um}}\n"
TAIL = "equations: {Ex: a}   # mm\n"
OLD = "{name: e, parameters: {h: {value: 2, u: 0.1, unit: um}}, equations: {Ex: h}}"


def load(folder: Path, text: str | bytes) -> LoadedMachine:
    path = folder / "m.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_machine(path)


def checked(old: LoadedMachine, new: ExtendedMachine, effects: list[dict[str, Any]]) -> None:
    """What was written says what was meant, and of the rest what it said."""
    again = machine_from(parse_yaml(new.content.decode("utf-8-sig"), SOURCE))
    assert again.machine == new.machine.machine
    n = len(old.machine.effects)
    assert again.machine.effects[:n] == old.machine.effects
    for entry, effect in zip(again.machine.effects[n:], effects, strict=True):
        given = [(p.value, p.u, p.unit) for p in entry.parameters.values()]
        assert given == [(*p.values(),) for p in effect["parameters"].values()]
        assert entry.covariance == effect.get("covariance")
        assert entry.found == effect.get("found", {})
    rest = {"effects", "covariates"}
    assert again.machine.model_dump(exclude=rest) == old.machine.model_dump(exclude=rest)
    assert again.machine.covariates[: len(old.machine.covariates)] == old.machine.covariates


LAYOUTS = {
    "absent": ("", "", TAIL),
    "no last line end": ("", "", TAIL[:-1]),
    "empty, with a comment": ("", "effects: []\n", "# remark\n" + TAIL),
    "block list": ("", f"effects:\n  - {OLD}\n", "  # remark\n\n" + TAIL),
    "block list with a block text": (
        "covariates: [load]  # c\n",
        "effects:\n  - name: e\n    parameters: {}\n    equations: {Ex: a}\n"
        "    says: |+\n      two\n\n      lines\n\n",
        "# remark\n" + TAIL,
    ),
    "document marks": ("", "", TAIL + "...\n# after the end\n"),
    "beyond ASCII": ("says: µ \U0001f600 é\n", "effects: []\n", TAIL),
}
"""What stands before, within and after the effects of a file."""


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize(("end", "mark"), [("\n", b""), ("\r\n", b"\xef\xbb\xbf"), ("\r", b"")])
def test_all_else_stays(name: str, end: str, mark: bytes, tmp_path: Path) -> None:
    before, own, after = (text.replace("\n", end) for text in LAYOUTS[name])
    head = mark + TOP.replace("\n", end).encode()
    old = load(tmp_path, head + (before + own + after).encode())
    new = extended_machine(old, [BACKLASH])
    assert new.content.startswith(head + (before + after.partition("...")[0]).encode())
    assert new.content.decode().endswith(after.partition("...")[2])
    assert new.content.count(end.encode()) == new.content.decode().count(
        "\n" if "\n" in end else end
    )
    assert new.warnings == ()
    assert new.parameters == ("backlash-x.lost_motion",)
    checked(old, new, [BACKLASH])


@pytest.mark.parametrize(
    ("text", "lost"),
    [
        ("".join(f"  {line}\n" for line in (TOP + TAIL).splitlines()), False),
        (TOP + "covariates: &none []\neffects: *none\n" + TAIL, True),
        (TOP + f"effects:\n  - {OLD}  # old\n" + TAIL, True),
        (
            '{"schema": "mtu/machine/1", "name": "m", "equations": {"Ex": "a"},\n'
            '"components": {"a": {"of": "x", "unit": "um"}}, "effects": []\n}\n',
            True,
        ),
    ],
)
def test_comments_that_are_lost_are_warned_of(text: str, lost: bool, tmp_path: Path) -> None:
    old = load(tmp_path, text)
    new = extended_machine(old, [BACKLASH, WEAR])
    checked(old, new, [BACKLASH, WEAR])
    assert new.machine.machine.covariates == ["tool_parts"]
    assert [warning.code for warning in new.warnings] == ["machine-written-anew"] * lost


def test_names_get_numbers(tmp_path: Path) -> None:
    text = TOP + "constants: {lost_motion: 3}\n" + TAIL
    first = extended_machine(load(tmp_path, text), [BACKLASH, BACKLASH])
    assert [effect.name for effect in first.machine.machine.effects] == [
        "backlash-x",
        "backlash-x-2",
    ]
    second = extended_machine(first.machine, [BACKLASH])
    last = second.machine.machine.effects[-1]
    assert last.name == "backlash-x-3"
    assert last.equations == {"Ex": "lost_motion_2*dir_x"}
    assert second.parameters == ("backlash-x-3.lost_motion_2",)
    assert second.content.startswith(first.content)
    effect = written_effect(
        name="e",
        parameters={"a": (1, 0, "um"), "a_2": (2, 0, "um")},
        equations={"Ex": "a*dir_x + 2.0e1*a_2"},
    )
    new = extended_machine(load(tmp_path, TOP + TAIL), [effect]).machine.machine.effects[0]
    assert new.equations == {"Ex": "a_3*dir_x + 2.0e1*a_2"}
