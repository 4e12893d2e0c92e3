"""The Python API says what the command line says, of files and of what was read from them."""

import json
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from cli_runner import SMALL, UNDRAWN, done, mtu, shared
from support import CONFIGS, DATA, PAPER

import mtu_cli
from mtu_cli import api
from mtu_cli.files.source import SYNTHETIC
from mtu_cli.findings import InputError

UNDECLARED = CONFIGS / "undeclared"
LBB, CMM = DATA / "undeclared" / "lbb.csv", DATA / "undeclared" / "cmm.csv"


@pytest.mark.parametrize("name", ["lengths", "compare"])
def test_a_function_returns_what_the_command_writes(name: str) -> None:
    made = shared(f"{name} configs/undeclared")
    result = getattr(mtu_cli, name.replace("-", "_"))(UNDECLARED)
    assert json.loads(json.dumps(result.to_dict())) == made.report["results"]
    assert [each.to_dict()["message"] for each in result.warnings] == [
        each["message"] for each in made.report["warnings"]
    ]
    table = pd.read_csv(StringIO(made.table))
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


def test_the_functions_are_found_and_say_what_they_do() -> None:
    assert {"lengths", "graph_sweep", "read_part"} <= {*dir(mtu_cli)}
    assert mtu_cli.lengths.__name__ == "lengths"
    assert "probability of conformance" in mtu_cli.lengths.__doc__
    assert b"<svg" in mtu_cli.lengths(UNDECLARED).page(".html")
    # One file stands for a list of one.
    part = mtu_cli.read_part(UNDECLARED / "part.yaml")
    one, several = (mtu_cli.read_points(x, part) for x in (str(CMM), [CMM]))
    assert one.measured.tobytes() == several.measured.tobytes()


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


@pytest.mark.parametrize(
    ("make", "options"),
    [("cmm", {"parts": 2, "cmm_room": 21.0}), ("lbb", {"passes": 2}), ("drift", {"cycles": 1})],
)
def test_a_virtual_machine_makes_what_the_command_writes(
    make: str, options: dict[str, Any], tmp_path: Path
) -> None:
    study = CONFIGS / "valdes-ring"
    machine, part, target = study / "truth.yaml", study / "part.yaml", tmp_path / "made.csv"
    words = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    done(mtu("simulate", "-m", machine, "-p", part, *words, f"--write-{make}", target, "-q"))
    result = mtu_cli.simulate(machine=machine, part=part, make=make, **options)
    pd.testing.assert_frame_equal(result.to_frame(), pd.read_csv(target, comment="#"))
    assert list(result.to_dict()[make]) == list(result.to_frame().columns)


def test_files_of_their_own_are_evaluated(tmp_path: Path) -> None:
    graph = CONFIGS / "graphs" / "axes-a-and-c.yaml"
    call = ("graph", "simulate", graph, "--trials", 1000, "-q", "-o", tmp_path / "r.json")
    done(mtu(*call))
    written = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert mtu_cli.graph_simulate(graph, trials=1000).report() == written
    swept = mtu_cli.graph_sweep(graph, of="d_AC", vary=["axis_um=1,2"], trials=1000)
    assert len(swept.to_dict()["grid"]) == 2
    assert mtu_cli.graph_check(graph).to_dict()
    budget = mtu_cli.budget(CONFIGS / "budgets" / "gum-h1-end-gauge.yaml", trials=1000)
    assert round(budget.to_dict()["u"], 1) == 31.7


@UNDRAWN
def test_reports_say_which_data_are_synthetic(tmp_path: Path) -> None:
    """Those of `mtu simulate`, as its first line says."""
    study, made = SMALL, tmp_path / "made.csv"
    done(mtu("simulate", study, "-q", "--parts", "4", "--write-cmm", made))
    assert made.read_text("utf-8").startswith(SYNTHETIC)
    measured = tmp_path / "measured.csv"
    measured.write_text("# CMM 4\n" + made.read_text("utf-8").partition("\n")[2], "utf-8")
    for path in (made, measured):
        page, report = tmp_path / "r.html", tmp_path / "r.json"
        call = ("anova", "-p", study / "part.yaml", "--cmm", path, "-q", "-o", report)
        done(mtu(*call, "--report", page))
        inputs = json.loads(report.read_text("utf-8"))["inputs"]
        cmm = next(item for item in inputs if item["role"] == "cmm")
        assert cmm.get("synthetic", False) == (path == made)
        assert page.read_text("utf-8").count("synthetic data") == (path == made)


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: mtu_cli.read_machine("nowhere.yaml"), InputError, "no such file"),
        (lambda: mtu_cli.lengths(PAPER, k="two"), InputError, "out of range: .*a number"),
        (lambda: mtu_cli.lengths(PAPER, trials=3.5), InputError, "out of range: .*a whole"),
        (lambda: mtu_cli.simulate(PAPER, passes=0), InputError, "--passes: out of range: '0'"),
        (lambda: mtu_cli.lengths(PAPER, sead=1), TypeError, "lengths has no option sead"),
        (lambda: mtu_cli.lengths(PAPER, csv="x"), TypeError, "lengths has no option csv"),
        (lambda: mtu_cli.lengths(5), TypeError, "lengths takes no int"),
        (lambda: mtu_cli.simulate(PAPER, out="x"), TypeError, "simulate has no option out"),
        (lambda: mtu_cli.simulate(PAPER, make="parts"), ValueError, "make: 'parts' is none of"),
        (lambda: mtu_cli.no_such_command, AttributeError, "no_such_command"),
    ],
)
def test_faults_are_raised(call: Callable[[], Any], kind: type[Exception], words: str) -> None:
    with pytest.raises(kind, match=words):
        call()
    assert [name for name in api.FUNCTIONS if not api.function_of(name).__doc__] == []
