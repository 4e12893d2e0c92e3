"""Calls that work: every command on the shipped studies, its outputs, and what depends on what."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from cli_runner import SMALL, TRUTH, done, listing, mtu, prepared, report, shared
from support import CONFIGS, DATA, PAPER, SIMULATED

from mtu_cli.files.yaml_file import read_yaml

KEYS = {"schema", "tool", "inputs", "settings", "results", "warnings"}
MAIN = {
    "fit-components": "components",
    "predict-points": "points",
    "lengths": "lengths",
    "orthogonality": "orthogonality",
}
SHIPPED = (
    *("fit-components configs/gilsinn-ling-simulated", "lengths configs/gilsinn-ling-simulated"),
    *("predict-points configs/gilsinn-ling", "orthogonality configs/gilsinn-ling --trials 20000"),
)


@pytest.mark.parametrize("call", SHIPPED)
def test_shipped_studies(call: str) -> None:
    """Tables, report and main table come from one call and agree in what they list."""
    result, document, made, _ = shared(call)
    command = call.partition(" ")[0]
    assert set(document) == KEYS
    assert document["schema"] == f"mtu/{command}/1"
    assert {item["role"] for item in document["inputs"]} >= {"study", "machine"}
    assert all(re.fullmatch("[0-9a-f]{64}", item["sha256"]) for item in document["inputs"])
    told = [f"{x['severity']}: {x['message']} [{x['code']}]" for x in document["warnings"]]
    assert result.stderr.splitlines() == told
    main = document["results"][MAIN[command]]
    rows = made.splitlines()
    assert len(rows) == len(main) + 1
    ids = list(main) if isinstance(main, dict) else [item["id"] for item in main]
    assert [row.split(",")[0] for row in rows[1:]] == ids
    table = result.stdout.partition("\n")[2]
    shown = [line.split()[0] for line in table.splitlines() if line]
    assert [name for name in shown if name in ids] == ids


def test_standard_output_holds_the_report_alone(tmp_path: Path) -> None:
    result = done(mtu("lengths", SIMULATED, "-o", "-", "--plot", tmp_path / "out.svg"))
    assert set(json.loads(result.stdout)) == KEYS
    assert listing(tmp_path).keys() == {"out.svg"}
    table = done(mtu("lengths", SIMULATED, "--csv", "-", "-o", tmp_path / "out.json"))
    assert table.stdout.startswith("id,from,to,nominal_mm,")


def test_quiet(tmp_path: Path) -> None:
    assert done(mtu("lengths", PAPER, "-q")).stdout == ""
    assert done(mtu("simulate", SMALL, "--write-lbb", tmp_path / "x.csv", "-q")).stdout == ""


def test_covariance_is_in_the_report_where_it_is_asked_for() -> None:
    plain = report("predict-points", SMALL)
    full = report("predict-points", SMALL, "--covariance")
    matrix = full["results"].pop("covariance_um2")
    assert full["results"].pop("covariance_rows")[:2] == ["A.x", "A.y"]
    assert plain["results"] == full["results"]
    points = full["results"]["points"]
    assert len(matrix) == 2 * len(points)
    for i, point in enumerate(points):
        assert matrix[2 * i][2 * i] == pytest.approx(point["var_x_um2"], rel=1e-12)
        assert matrix[2 * i + 1][2 * i + 1] == pytest.approx(point["var_y_um2"], rel=1e-12)


def test_the_study_is_found_here_and_above(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    below = work / "reports" / "2024"
    below.mkdir(parents=True)
    here = done(mtu("lengths", cwd=work))
    assert "\nLengths\n" in here.stdout
    assert done(mtu("lengths", cwd=below)).stdout == here.stdout
    assert done(mtu("lengths", work / "mtu.yaml")).stdout == here.stdout


def test_options_win_over_the_study(tmp_path: Path) -> None:
    work = prepared(tmp_path / "work")
    text = (work / "part.yaml").read_text().replace("to: C, tolerance_um: 30", "to: B")
    (work / "other.yaml").write_text(text)
    own = report("lengths", cwd=work)
    found = report("lengths", "-p", "other.yaml", "--k", "3", "--seed", "5", cwd=work)
    assert [item["id"] for item in own["results"]["lengths"]] == ["A-C", "A-E"]
    assert [item["id"] for item in found["results"]["lengths"]] == ["A-B", "A-E"]
    assert own["settings"] | {"coverage_factor": 3.0, "seed": 5} == found["settings"]
    before, after = own["results"]["lengths"][1], found["results"]["lengths"][1]
    # Both are rounded once from millimetres.
    assert after["U_um"] == pytest.approx(3 * after["u_um"], rel=1e-15)
    assert (before["u_um"], before["error_um"]) == (after["u_um"], after["error_um"])


def test_a_components_report_stands_for_the_readings(tmp_path: Path) -> None:
    """To the last bit: the report holds all that predictions need."""
    fitted = tmp_path / "components.json"
    done(mtu("fit-components", SIMULATED, "-o", fitted, "-q"))
    for command in ("predict-points", "lengths", "orthogonality"):
        again = report(command, SIMULATED, "-c", fitted)
        assert again["results"] == report(command, SIMULATED)["results"]
        roles = [item["role"] for item in again["inputs"]]
        assert roles == ["study", "machine", "components", "part"]


def test_gates(tmp_path: Path) -> None:
    met = done(mtu("lengths", SIMULATED, "--fail-if", "nonconforming=1e-9"), 3)
    assert "mtu: gate nonconforming: probability of a nonconforming part above" in met.stderr
    assert met.stdout == done(mtu("lengths", SIMULATED, "--fail-if", "nonconforming=0.5")).stdout
    outputs = ["-o", tmp_path / "out.json", "--csv", tmp_path / "out.csv"]
    drift = done(mtu("fit-components", SIMULATED, "--fail-if", "drift", *outputs), 3)
    assert listing(tmp_path).keys() == {"out.json", "out.csv"}
    assert "mtu: gate drift: drift in dx_x (pass to pass)" in drift.stderr
    steady = DATA / "gilsinn-ling" / "axis_angle.csv"
    done(mtu("fit-components", PAPER, "--lbb", steady, "--fail-if", "drift"))


@pytest.mark.parametrize(
    ("kind", "files"),
    [
        ("machine", [*CONFIGS.glob("*/machine.yaml"), TRUTH]),
        ("part", list(CONFIGS.glob("*/part.yaml"))),
        ("study", list(CONFIGS.glob("*/mtu.yaml"))),
        ("budget", list(CONFIGS.glob("budgets/*.yaml"))),
    ],
)
def test_json_schemas(kind: str, files: list[Path]) -> None:
    """The shipped files pass, also what editors refuse: a misspelt key, another schema."""
    schema = json.loads(done(mtu("schema", kind)).stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    assert len(files) >= 2
    for path in files:
        data: dict[str, Any] = read_yaml(path, kind).data
        validator.validate(data)
        assert not validator.is_valid(data | {"mashine": "m"})
        assert not validator.is_valid(data | {"schema": f"mtu/{kind}/2"})
