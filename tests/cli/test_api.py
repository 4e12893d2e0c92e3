"""The Python API says what the command line says, of files and of what was read from them."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from cli_runner import done, mtu
from support import CONFIGS, DATA

import mtu_cli
from mtu_cli import api
from mtu_cli.findings import InputError

UNDECLARED = CONFIGS / "undeclared"
LBB, CMM = DATA / "undeclared" / "lbb.csv", DATA / "undeclared" / "cmm.csv"


@pytest.mark.parametrize("name", ["fit-components", "lengths", "orthogonality", "anova", "compare"])
def test_a_function_returns_what_the_command_writes(name: str, tmp_path: Path) -> None:
    done(mtu(name, UNDECLARED, "-q", "-o", tmp_path / "r.json", "--csv", tmp_path / "r.csv"))
    result = getattr(mtu_cli, name.replace("-", "_"))(UNDECLARED)
    report = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert json.loads(json.dumps(result.to_dict())) == report["results"]
    assert [each.to_dict()["message"] for each in result.warnings if each] == [
        each["message"] for each in report["warnings"]
    ]
    table = pd.read_csv(tmp_path / "r.csv")
    assert list(result.to_frame().columns) == list(table.columns)
    assert len(result.to_frame()) == len(table)


def test_what_was_read_takes_the_place_of_its_file() -> None:
    machine = mtu_cli.read_machine(UNDECLARED / "machine.yaml")
    part = mtu_cli.read_part(UNDECLARED / "part.yaml")
    fit = mtu_cli.fit_components(machine, mtu_cli.read_readings([LBB], machine))
    found = mtu_cli.lengths(machine, part, fit, at={})
    assert found.to_dict() == mtu_cli.lengths(UNDECLARED).to_dict()
    assert {item["role"] for item in found.report()["inputs"]} == {"machine", "part", "components"}
    points = mtu_cli.read_points([CMM], part)
    parts = mtu_cli.anova(part, points, datum="offset").to_dict()
    assert parts == mtu_cli.anova(UNDECLARED, datum="offset").to_dict()


def test_names_of_files_are_texts_or_paths() -> None:
    names = {key: UNDECLARED / f"{key}.yaml" for key in ("machine", "part")}
    texts = {key: str(path) for key, path in names.items()}
    of_texts = mtu_cli.anova(**texts, cmm=str(CMM))
    assert of_texts.to_dict() == mtu_cli.anova(**names, cmm=CMM).to_dict()


def test_check_warns_of_what_looks_wrong(tmp_path: Path) -> None:
    assert mtu_cli.check(UNDECLARED) == []
    table = pd.read_csv(CMM, comment="#")
    table["x_mm"] += 20.0 * (table.index == 7)
    table.to_csv(tmp_path / "cmm.csv", index=False)
    points = mtu_cli.read_points(
        [tmp_path / "cmm.csv"], mtu_cli.read_part(UNDECLARED / "part.yaml")
    )
    machine, part = mtu_cli.read_machine(UNDECLARED / "machine.yaml"), UNDECLARED / "part.yaml"
    (found,) = mtu_cli.check(machine, mtu_cli.read_part(part), points)
    assert (found.code, found.row) == ("far-from-nominal", 9)


def test_faults_are_raised() -> None:
    with pytest.raises(InputError, match="no such file"):
        mtu_cli.read_machine("nowhere.yaml")
    with pytest.raises(TypeError, match="lengths has no option sead"):
        mtu_cli.lengths(UNDECLARED, sead=1)
    for name in ("out", "csv", "plot", "report", "detail", "quiet"):
        with pytest.raises(TypeError, match=f"lengths has no option {name}"):
            mtu_cli.lengths(UNDECLARED, **{name: "x"})
    with pytest.raises(TypeError, match="lengths takes no int"):
        mtu_cli.lengths(5)
    with pytest.raises(AttributeError):
        _ = mtu_cli.no_such_command
    assert [name for name in api.FUNCTIONS if not api.function_of(name).__doc__] == []
