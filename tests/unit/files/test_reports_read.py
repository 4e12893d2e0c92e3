"""Reports that are read back: told apart by their schema, at most one of each kind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mtu_cli.files.reports_read import (
    ComponentsReport,
    ModelReports,
    ThermalReport,
    read_report,
    read_reports,
)
from mtu_cli.findings import InputError

FITTED = {
    "of": None, "unit": "um", "degree": 0, "n_passes": 3, "coefficients": [1.0],
    "covariance": [[0.1]], "covariance_independent": [[0.1]], "s": 1, "s_repeat": 1,
    "pass_covariance": [[0]], "pass_covariance_moment": [[0]], "pass_center_mm": 0,
    "pass_dof": 2, "repeat_dof": None, "position_range_mm": None,
}  # fmt: skip
DRIFT = {
    "of": "y", "unit": "um", "model": "stepwise", "degree": 1, "positions_mm": [0, 75, 200],
    "sensors": ["T_01_degC", "T_02_degC"], "reference_temperature_degC": 20,
    "time_constants_min": [0, 40], "coefficients": [[1, 2], [3, 4]],
    "covariance": [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 3, 0], [0, 0, 0, 4]],
    "coefficient_dof": None, "leftover_covariance": [[0.1, 0], [0, 1e-6]], "leftover_dof": 12.5,
    "sensor_u_degC": [0.01, 0.02], "temperature_range_degC": [[19, 26], [20, 25]],
    "position_range_mm": [0, 200], "r2_fit": 0.99,
}  # fmt: skip

NEGATIVE = "a variance is negative"
UNKNOWN = "a number is missing"
INDEFINITE = "not positive semidefinite: a combination has a negative variance"


def written(tmp_path: Path, name: str, kind: str, component: dict[str, Any]) -> Path:
    path = tmp_path / name
    document = {"schema": f"mtu/{kind}/1", "results": {"components": {"a": component}}}
    path.write_text(json.dumps(document))
    return path


def told(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_report(path)
    return [str(problem) for problem in caught.value.findings]


@pytest.mark.parametrize(
    ("key", "value", "path", "limit"),
    [
        ("s_repeat", 1e200, "s_repeat", "1e+30"),
        ("coefficients", [-1e308], "coefficients[0]", "1e+30"),
        ("pass_covariance", [[1e31]], "pass_covariance[0][0]", "1e+30"),
    ],
)
def test_numbers_too_large_to_calculate_with(
    tmp_path: Path, key: str, value: Any, path: str, limit: str
) -> None:
    (found,) = told(written(tmp_path, "c.json", "fit-components", FITTED | {key: value}))
    assert f"results.components.a.{path}: out of range: " in found
    assert found.endswith(f"expected at most {limit} in size")
    # To many 1e99 is infinite: degrees of freedom may be.
    sound = FITTED | {"pass_dof": 1e99, "pass_covariance": [[1e30]]}
    assert read_report(written(tmp_path, "c.json", "fit-components", sound))


def test_names_do_not_exempt_and_faults_keep_their_order(tmp_path: Path) -> None:
    """A component of whatever name is limited; degrees of freedom are, where they stand."""
    huge = FITTED | {"coefficients": [1e300, -1e300], "pass_dof": 1e99, "s_repeat": 1e31}
    named = ("mydof", "found", "seed", "dof", "covariance")
    document = {
        "schema": "mtu/fit-components/1",
        "results": {"components": dict.fromkeys(named, huge)},
    }
    (tmp_path / "c.json").write_text(json.dumps(document))
    wanted = ("coefficients[0]", "coefficients[1]", "s_repeat")
    paths = [text.split(": ")[1] for text in told(tmp_path / "c.json")]
    assert paths == [f"results.components.{name}.{path}" for name in named for path in wanted]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("s_repeat", -1, "s_repeat: wrong value: '-1'; expected a number of at least 0"),
        ("degree", 1e99, "degree: wrong value: '1e+99'; expected a whole number"),
        ("degree", "a", "degree: wrong value: 'a'; expected a whole number"),
        ("unit", 3, "unit: wrong value: '3'; expected a text"),
    ],
)
def test_wrong_values_are_told_in_whole_sentences(
    tmp_path: Path, key: str, value: Any, words: str
) -> None:
    (found,) = told(written(tmp_path, "c.json", "fit-components", FITTED | {key: value}))
    assert f"results.components.a.{words}" in found


JOINT = {
    "components": ["a"], "widths": [1], "coefficient_covariance": [[0]],
    "pass_covariance": [[0]], "pass_dof": 0, "n_passes": 3,
}  # fmt: skip


@pytest.mark.parametrize(
    ("component", "group", "where"),
    [
        ({"pass_dof": 0, "pass_covariance": [[1]]}, {}, "components.a.pass_dof"),
        ({"repeat_dof": 0}, {}, "components.a.repeat_dof"),
        ({"repeat_dof": -0.0}, {}, "components.a.repeat_dof"),
        ({"pass_dof": 0, "repeat_dof": 0, "s_repeat": 0}, {}, "components.a.repeat_dof"),
        ({}, {"pass_covariance": [[1]]}, "joint_pass_covariance[0].pass_dof"),
        ({}, {"coefficient_covariance": [[1]]}, "joint_pass_covariance[0].pass_dof"),
        # One mean square behind all; and nothing estimated: no degrees of freedom are needed.
        ({"pass_dof": 0, "repeat_dof": 4}, {}, None),
        ({"repeat_dof": 0, "s_repeat": 0}, {}, None),
    ],
)
def test_what_was_estimated_has_degrees_of_freedom(
    tmp_path: Path, component: dict[str, Any], group: dict[str, Any], where: str | None
) -> None:
    results = {"components": {"a": FITTED | component}, "joint_pass_covariance": [JOINT | group]}
    path = tmp_path / "c.json"
    path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    if where is None:
        assert read_report(path)
        return
    (found,) = told(path)
    assert f"results.{where}: an estimate without degrees of freedom: '0'" in found


@pytest.mark.parametrize("key", ["coefficient_dof", "leftover_dof"])
def test_so_has_what_a_drift_was_estimated_with(tmp_path: Path, key: str) -> None:
    (found,) = told(written(tmp_path, "t.json", "thermal-fit", DRIFT | {key: 0}))
    assert f"results.components.a.{key}: an estimate" in found
    assert "without degrees of freedom: '0'; expected more than 0, or null" in found


def test_reports_are_told_apart(tmp_path: Path) -> None:
    fitted = written(tmp_path, "c.json", "fit-components", FITTED)
    drift = written(tmp_path, "t.json", "thermal-fit", DRIFT)
    assert isinstance(read_report(fitted), ComponentsReport)
    found = read_report(drift)
    assert isinstance(found, ThermalReport)
    item = found.components["a"]
    assert (item.of, item.unit, item.degree) == ("y", "um", 1)
    assert item.sensors == ["T_01_degC", "T_02_degC"]
    assert item.coefficients == [[1, 2], [3, 4]]
    assert (item.coefficient_dof, item.leftover_dof) == (None, 12.5)
    assert item.temperature_range_degC == [(19, 26), (20, 25)]
    assert item.position_range_mm == (0, 200)
    for order in ([fitted, drift], [drift, fitted]):
        both = read_reports(order)
        assert both.components is not None
        assert both.thermal is not None
        assert [(s.role, s.shown) for s in both.sources] == [
            ("components", "c.json"),
            ("thermal", "t.json"),
        ]
    assert read_reports([drift]).components is None
    assert read_reports([fitted]).thermal is None
    assert read_reports([]) == ModelReports()


def test_two_of_a_kind_and_neither_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fitted = [written(tmp_path, f"c{i}.json", "fit-components", FITTED) for i in (1, 2)]
    drifts = [written(tmp_path, f"t{i}.json", "thermal-fit", DRIFT) for i in (1, 2)]
    other = written(tmp_path, "l.json", "lengths", {})
    (tmp_path / "x.json").write_text("[1]")
    paths = [*fitted, *drifts, other, tmp_path / "x.json", Path("qqqqqq")]
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
        "qqqqqq: no such file",
    ]


def test_a_document_without_a_schema(tmp_path: Path) -> None:
    (tmp_path / "e.json").write_text("{}")
    with pytest.raises(InputError) as caught:
        read_reports([tmp_path / "e.json"])
    assert "e.json: not a components report; ex" in str(caught.value)


def test_doubts_of_a_thermal_report(tmp_path: Path) -> None:
    """One a code and text, with all components that it is told of; other warnings stay behind."""
    path = written(tmp_path, "t.json", "thermal-fit", DRIFT)
    document = json.loads(path.read_text())
    no_cycles = "no cycles are told apart: no cycle can be held out"
    warned = [
        ("not-held-out", f"a: {no_cycles}"),
        ("collinear", "a: the sensors move together"),
        ("not-held-out", f"b: {no_cycles}"),
        ("no-better", "b: on held-out cycles the temperatures make it worse"),
    ]
    document["warnings"] = [{"code": code, "message": text} for code, text in warned]
    path.write_text(json.dumps(document))
    found = read_report(path)
    assert isinstance(found, ThermalReport)
    assert [(item.code, item.message) for item in found.doubts] == [
        ("unconfirmed-drift", f"t.json: the thermal model of a, b is unconfirmed: {no_cycles}"),
        (
            "unconfirmed-drift",
            "t.json: the thermal model of b is unconfirmed: on held-out cycles the temperatures "
            "make it worse",
        ),
    ]
    document["warnings"] = [{"code": "no-better"}]
    path.write_text(json.dumps(document))
    assert "t.json: warnings[0]: the key 'message' is missing" in told(path)[0]


def test_a_drift_without_sensors(tmp_path: Path) -> None:
    empty = DRIFT | {
        "sensors": [], "coefficients": [[], []], "covariance": [], "time_constants_min": [],
        "sensor_u_degC": [], "temperature_range_degC": None,
    }  # fmt: skip
    found = read_report(written(tmp_path, "t.json", "thermal-fit", empty))
    assert isinstance(found, ThermalReport)
    assert found.components["a"].coefficients == [[], []]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"of": "w"}, "a.of: unknown value: 'w'; expected one of: x, y, z"),
        ({"of": None}, "a.degree: a degree without `of`: '1'; expected"),
        ({"unit": "inch"}, "a.unit: unknown unit: 'inch'; expected one of: um, mm"),
        ({"degree": -1}, "a.degree: wrong value: '-1'; expected a number of at least 0"),
        ({"coefficients": [[1, 2]]}, "a.coefficients: 1 entry; expected 2"),
        ({"coefficients": [[1, 2], [3]]}, "a.coefficients[1]: 1 entry; expected 2"),
        ({"coefficients": [[1, 2], [3, None]]}, "a.coefficients[1][1]: wrong value: 'null'"),
        ({"covariance": [[1]]}, "a.covariance: not 4 x 4"),
        ({"leftover_covariance": [[1]]}, "a.leftover_covariance: not 2 x 2"),
        ({"leftover_covariance": [[-1, 0], [0, 1]]}, "a.leftover_covariance: a variance is negati"),
        ({"leftover_covariance": [[1, 1e-3], [0, 1]]}, "a.leftover_covariance: not symmetric"),
        ({"leftover_covariance": [[1, 2], [2, 1]]}, "not positive semidefinite: a combination"),
        ({"leftover_covariance": [[0, 1], [1, 1]]}, "a covariance is far beyond its variances"),
        ({"leftover_covariance": [[None, 0], [0, 1]]}, "the readings do not determine it"),
        ({"leftover_dof": -1}, "a.leftover_dof: wrong value"),
        ({"time_constants_min": [0]}, "a.time_constants_min: 1 entry; expected 2"),
        ({"time_constants_min": [0, -1]}, "a.time_constants_min[1]: wrong value"),
        ({"sensor_u_degC": [0, 0, 0]}, "a.sensor_u_degC: 3 entries; expected 2"),
        ({"temperature_range_degC": [[1, 2]]}, "a.temperature_range_degC: 1 entry; expected 2"),
        ({"sensors": ["T_01_degC"] * 2}, "a.sensors[1]: the name appears twice: 'T_01_degC'"),
        ({"sensors": ["T_01_degC", "b"]}, "a.sensors[1]: not the name of a temperature: 'b'"),
        (
            {"reference_temperature_degC": None},
            "a.reference_temperature_degC: wrong value: 'null'; expected a number",
        ),
    ],
)
def test_faulty_thermal_reports(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    (found,) = told(written(tmp_path, "t.json", "thermal-fit", DRIFT | change))
    assert found.startswith("t.json: results.components.a.")
    assert words in found


def test_what_a_thermal_report_lacks(tmp_path: Path) -> None:
    found = told(written(tmp_path, "t.json", "thermal-fit", {"of": "y", "unit": "um"}))
    assert len(found) == 12
    assert all(text.endswith("is missing") for text in found)


@pytest.mark.parametrize(
    ("matrix", "what"),
    [
        ([[1, 0.5], [0.5, 1]], None),
        ([[1, 0.5], [0.5000001, 1]], None),
        ([[1, 0.5], [0.50001, 1]], "not symmetric"),
        ([[1, 0.5], [-0.5, 1]], "not symmetric"),
        ([[0, 0], [1e-9, 0]], "not symmetric"),
        ([[1, 2], [2, 1]], INDEFINITE),
        ([[-1, 0.5], [0.5, 1]], NEGATIVE),
        ([[1, 0.5]], "not 2 x 2"),
        ([[1, None], [0.5, 1]], "not symmetric"),
        ([[1, None], [None, 1]], UNKNOWN),
        ([[None, 0], [0, 1]], UNKNOWN),
    ],
)
@pytest.mark.parametrize("key", ["coefficient_covariance", "pass_covariance"])
def test_joint_covariances_are_covariances(
    tmp_path: Path, matrix: list[list[float | None]], what: str | None, key: str
) -> None:
    """That of the passes is a moment estimate, whose variances may be negative in any direction,
    and all of which is known.
    """
    joint = JOINT | {
        "components": ["a", "b"],
        "widths": [1, 1],
        "coefficient_covariance": [[0, 0], [0, 0]],
        "pass_covariance": [[0, 0], [0, 0]],
        "pass_dof": 4,
        key: matrix,
    }
    components = {"a": FITTED, "b": FITTED}
    results = {"components": components, "joint_pass_covariance": [joint]}
    path = tmp_path / "c.json"
    path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    if what is None or (key == "pass_covariance" and what in (NEGATIVE, INDEFINITE)):
        assert read_report(path)
        return
    (found,) = told(path)
    entry = "" if what != UNKNOWN else f"[0][{(matrix[0] or [0]).index(None)}]"
    assert found.endswith(f"results.joint_pass_covariance[0].{key}{entry}: {what}")


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"covariance": [[None, 0.0], [0.0, 0.1]]}, "covariance[0][0]"),
        ({"covariance": [[0.1, None], [None, 0.1]]}, "covariance[0][1]"),
        ({"s_repeat": None}, "s_repeat"),
        ({"covariance": [[None, None], [None, None]], "s_repeat": None}, None),
    ],
)
def test_a_fit_tells_all_of_its_uncertainty_or_none(
    tmp_path: Path, change: dict[str, Any], where: str | None
) -> None:
    """None where there are as many readings as coefficients."""
    two = {
        "degree": 1, "coefficients": [1.0, 2.0], "covariance": [[0.1, 0.0], [0.0, 0.1]],
        "pass_covariance": [[0, 0], [0, 0]], "pass_covariance_moment": [[0, 0], [0, 0]],
        "covariance_independent": None,
    }  # fmt: skip
    path = written(tmp_path, "f.json", "fit-components", FITTED | two | change)
    if where is None:
        assert read_report(path)
        return
    assert told(path) == [f"f.json: results.components.a.{where}: {UNKNOWN}"]


@pytest.mark.parametrize("key", ["coefficient_covariance", "pass_covariance"])
@pytest.mark.parametrize("matrix", [[[None, 0], [0, 1]], [[None, None], [None, 1]]])
def test_where_a_component_has_no_covariance_that_with_others_has_no_entries(
    tmp_path: Path, matrix: list[list[float | None]], key: str
) -> None:
    """Of as many readings as coefficients: what it has in common with others is not known."""
    joint = JOINT | {
        "components": ["a", "b"], "widths": [1, 1], "pass_dof": 4,
        "coefficient_covariance": [[0, 0], [0, 0]], "pass_covariance": [[0, 0], [0, 0]],
        key: matrix,
    }  # fmt: skip
    components = {"a": FITTED | {"covariance": [[None]]}, "b": FITTED}
    results = {"components": components, "joint_pass_covariance": [joint]}
    path = tmp_path / "c.json"
    path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    if key == "coefficient_covariance":
        assert read_report(path)
        results["components"] = {"a": FITTED, "b": FITTED | {"covariance": [[None]]}}
        path.write_text(json.dumps({"schema": "mtu/fit-components/1", "results": results}))
    (found,) = told(path)
    assert found.endswith(f"{key}[0][0]: {UNKNOWN}")


EARLIER = Path(__file__).parent / "earlier_reports"


def test_reports_of_version_0_1_are_read() -> None:
    """As commit 61d6796 wrote them; what they hold beyond the fields that are read is ignored."""
    both = read_reports([EARLIER / "fit-components-0.1.json", EARLIER / "thermal-fit-0.1.json"])
    assert both.components is not None
    assert both.thermal is not None
    assert list(both.components.components) == ["dx_x", "ez_x", "dy_y", "axy"]
    assert both.components.components["dx_x"].pass_dof is not None
    assert len(both.components.readings) == 1
    item = both.thermal.components["pos_y"]
    assert len(item.coefficients) == item.degree + 1
    assert len(both.thermal.readings) == 1
