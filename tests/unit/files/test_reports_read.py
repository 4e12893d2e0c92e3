"""Reports that are read back: told apart by their schema, at most one of each kind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mtu_cli.files.reports_read import (
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
LINE = FITTED | {
    "degree": 1, "coefficients": [1.0, 2.0], "covariance": [[0.1, 0.0], [0.0, 0.1]],
    "pass_covariance": [[0, 0], [0, 0]], "pass_covariance_moment": [[0, 0], [0, 0]],
    "covariance_independent": None,
}  # fmt: skip
JOINT = {
    "components": ["a", "b"], "widths": [1, 1], "coefficient_covariance": [[0, 0], [0, 0]],
    "pass_covariance": [[0, 0], [0, 0]], "pass_dof": 4, "n_passes": 3,
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


def written(path: Path, kind: str, *components: dict[str, Any], **results: Any) -> Path:
    entries = dict(zip("abc", components, strict=False))
    document = {"schema": f"mtu/{kind}/1", "results": {"components": entries, **results}}
    path.write_text(json.dumps(document))
    return path


def faults(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_report(path)
    return [str(each).removeprefix(f"{path.name}: ") for each in caught.value.findings]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"s_repeat": 1e200}, "s_repeat: out of range: '1e+200'; expected at most 1e+30 in size"),
        ({"pass_covariance": [[1e31]]}, "pass_covariance[0][0]: out of range: '1e+31'"),
        ({"degree": 1e99}, "degree: wrong value: '1e+99'; expected a whole number"),
        ({"unit": 3}, "unit: wrong value: '3'; expected a text"),
        (LINE | {"covariance": [[1, 0]]}, "covariance: another size; expected 2 x 2"),
        (LINE | {"covariance": [[1, 500], [0, 1]]}, "covariance: not symmetric"),
        ({"covariance": [[-1.0]]}, "covariance: a variance is negative"),
        ({"s_repeat": -1.0}, "s_repeat: "),
    ],
)
def test_faulty_components(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    (found,) = faults(written(tmp_path / "c.json", "fit-components", FITTED | change))
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
        assert words in faults(path)[0]
        assert faults(path)[0].startswith("results.joint_pass_covariance")


def test_two_of_a_kind_and_neither_kind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    fitted = [written(tmp_path / f"c{i}.json", "fit-components", FITTED) for i in (1, 2)]
    drifts = [written(tmp_path / f"t{i}.json", "thermal-fit", DRIFT) for i in (1, 2)]
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


EARLIER = Path(__file__).parent / "earlier_reports"


def test_reports_of_version_0_1_are_read() -> None:
    """As commit 61d6796 wrote them; what they hold beyond the fields that are read is ignored."""
    both = read_reports([EARLIER / "fit-components-0.1.json", EARLIER / "thermal-fit-0.1.json"])
    assert both.components is not None
    assert both.thermal is not None
    assert list(both.components.components) == ["dx_x", "ez_x", "dy_y", "axy"]
    assert both.components.components["dx_x"].pass_dof is not None
    item = both.thermal.components["pos_y"]
    assert len(item.coefficients) == item.degree + 1
