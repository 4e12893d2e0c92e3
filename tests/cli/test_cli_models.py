"""Models of their own: budgets, graphs; what a model says beside its figures."""

import json
from pathlib import Path

import pytest
from cli_runner import done, mtu, prepared, report
from support import CONFIGS

from mtu_cli.cli.analyse import fit_components as fitting
from mtu_cli.cli.analyse import modelled
from mtu_cli.cli.emit import execute
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.one_file import variation
from mtu_cli.cli.options import Options
from mtu_cli.findings import InputError

BUDGETS = sorted((CONFIGS / "budgets").glob("*.yaml"))
H1 = CONFIGS / "budgets" / "gum-h1-end-gauge.yaml"


@pytest.mark.parametrize("path", BUDGETS, ids=lambda path: path.stem)
def test_shipped_budgets(path: Path, tmp_path: Path) -> None:
    outputs = ["-o", tmp_path / "out.json", "--csv", tmp_path / "out.csv"]
    result = done(mtu("budget", path, *outputs, "--plot", tmp_path / "out.svg"))
    assert max(map(len, result.stdout.splitlines())) <= 100
    document = json.loads((tmp_path / "out.json").read_text("utf-8"))
    assert document["schema"] == "mtu/budget/1"
    assert [item["role"] for item in document["inputs"]] == ["budget"]
    assert not any("file" in item for item in document["warnings"])
    results = document["results"]
    found = list(results.get("outputs", {"": results}).values())
    rows = sum(len(item["rows"]) for item in found)
    assert len((tmp_path / "out.csv").read_text("utf-8").splitlines()) == rows + 1
    for item in found:
        assert item["monte_carlo"]["converged"]
        # Decided, one way or the other, by a Monte Carlo that can tell.
        assert item["monte_carlo"]["first_order_valid"] in (True, False)


def test_options() -> None:
    """--k wins over the file, --trials is what is run, --seed moves the trials alone."""
    results = report("budget", H1, "--k", "2", "--trials", "20000", "--seed", "5")["results"]
    other = report("budget", H1, "--k", "2", "--trials", "20000", "--seed", "6")["results"]
    assert (results["k"], results["U"]) == (2.0, 2.0 * results["u"])
    assert results["monte_carlo"]["trials"] == 20000
    assert results["monte_carlo"]["probability"] == pytest.approx(0.9545, abs=5e-5)
    assert results["rows"] == other["rows"]
    assert results["monte_carlo"]["mean"] != other["monte_carlo"]["mean"]
    assert results["input_correlation"]["inputs"] == [row["name"] for row in results["rows"]]
    assert results["input_correlation"]["matrix"][0][0] == 1.0


# `mtu graph`: check, draw, simulate and sweep as a user calls them.


GRAPHS = CONFIGS / "graphs"
BALL = GRAPHS / "ball-centre.yaml"
AXES = GRAPHS / "axes-a-and-c.yaml"


def test_check_and_simulate() -> None:
    results = report("graph", "check", BALL)["results"]
    first, second = results["firing_order"]
    assert {step["do"] for step in first} == {"meas"}
    assert second == [{"do": "ball", "in": ["x1", "x2", "y1", "y2", "z1", "r1"], "out": ["P1"]}]
    assert results["places"] == {"coordinate": 5, "constant": 1, "point": 1}
    document = report("graph", "simulate", AXES)
    assert document["schema"] == "mtu/graph-simulate/1"
    results = document["results"]
    assert results["converged"] is True
    found = results["places"]["d_AC"]["value"]
    assert found["U"] == 2 * found["u"]
    assert found["interval95"][0] < found["mean"] < found["interval95"][1]
    of = {"u1_axis", "u2_probe", "u3_perpendicular"}
    assert set(results["budget"]["d_AC"]["value"]) == of
    assert not any("file" in item for item in document["warnings"])


def test_sweep() -> None:
    vary = ("--vary", "axis_um=0.5:2.5:3", "--vary", "probe_um=1,2")
    document = report("graph", "sweep", AXES, *vary, "--of", "d_AC", "--trials", "1000")
    long = report("graph", "sweep", BALL, "--vary", "axis_um=1,2", "--of", "P1.x")
    assert long["results"]["converged"] is True
    assert document["schema"] == "mtu/graph-sweep/1"
    results = document["results"]
    assert [(item["axis_um"], item["probe_um"]) for item in results["grid"]] == [
        (0.5, 1), (0.5, 2), (1.5, 1), (1.5, 2), (2.5, 1), (2.5, 2),
    ]  # fmt: skip
    formula = results["formula"]
    assert formula["form"] == "u_um = sqrt(a*probe_um^2 + b*axis_um^2)"
    assert set(formula["coefficients"]) == {"a", "b"}
    assert formula["max_error_percent"] < 15
    assert formula["monte_carlo"]["standard_error_percent"] == pytest.approx(2.2, abs=0.2)
    assert set(results["places"]["d_AC"]["value"]) >= {"unit", "nominal", "mean", "u"}
    with pytest.raises(InputError, match="appears twice"):
        variation("axis_um", "1,1")


@pytest.mark.parametrize(
    ("kind", "start"), [("svg", b"<?xml"), ("dot", b"digraph"), ("mmd", b"---"), ("pl", b"%")]
)
def test_draw(kind: str, start: bytes, tmp_path: Path) -> None:
    plain, shares = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    done(mtu("graph", "draw", BALL, "--to", plain))
    done(mtu("graph", "draw", BALL, "--to", shares, "--of", "P1.z"))
    assert plain.read_bytes().startswith(start)
    assert (plain.read_bytes() == shares.read_bytes()) == (kind == "pl")


# What a call's files are taken for, whatever is asked for first.


def edited(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def drifting(path: Path) -> None:
    """Six passes of dx_x there and back in place of its own, 10 um further each."""
    lines = [x for x in path.read_text().splitlines() if x[:4] not in ("dx_x", "# --", "# Sy")]
    for number in range(1, 7):
        for way, sign in (("forward", 1), ("reverse", -1)):
            for place in (0, 50, 100, 150, 200):
                error = 10 * number + 0.1 * sign * (place * number % 7)
                lines.append(f"dx_x,{place},{number},{way},{error},um")
    path.write_text("\n".join(lines) + "\n")


def told(code: str, **files: object) -> list[str]:
    """What lengths, or any prediction, says of a code."""
    inputs = Inputs(Options("lengths", {"machine": Path("machine.yaml"), **files}))
    return [item.message for item in modelled(inputs)[1] if item.code == code]


def test_what_limits_u_comes_with_predictions_too(small: Path) -> None:
    """From readings and from a report of their fit alike, of what the equations use."""
    readings, report = {"lbb": [Path("lbb.csv")]}, {"components": [Path("c.json")]}
    assert told("passes-drift", **readings) == []
    drifting(small / "lbb.csv")
    own = {"machine": Path("machine.yaml"), **readings, "out": Path("c.json"), "quiet": True}
    execute(Options("fit-components", own), fitting)
    (drift,) = told("passes-drift", **readings)
    assert drift.startswith("dx_x drifts by ")
    assert told("reported", **report) == [f"c.json: {drift}"]
    # A report that says it twice.
    document = json.loads((small / "c.json").read_text())
    (small / "c.json").write_text(
        json.dumps(document | {"warnings": 2 * document["warnings"] + [{"code": 1}]})
    )
    assert told("reported", **report) == [f"c.json: {drift}"]
    edited(small / "machine.yaml", "Ex: dx_x - y*axy", "Ex: -y*axy")
    assert told("passes-drift", **readings) == []


def test_coefficients_that_readings_beat_are_not_asked_for_their_uncertainty(small: Path) -> None:
    readings = {"lbb": [Path("lbb.csv")]}
    edited(small / "machine.yaml", "axy: {unit: urad,", "axy: {unit: urad, coefficients: [5],")
    assert told("no-uncertainty", **readings) == []
    lines = (small / "lbb.csv").read_text().splitlines()
    (small / "lbb.csv").write_text("\n".join(x for x in lines if not x.startswith("axy")) + "\n")
    (asked,) = told("no-uncertainty", **readings)
    assert "components.axy" in asked


# Messages of files outside the working folder say where they are; reports do not.


def test_faults_say_where_their_file_is(tmp_path: Path) -> None:
    study, elsewhere = prepared(tmp_path / "mill-2"), tmp_path / "elsewhere"
    elsewhere.mkdir()
    (study / "lbb.csv").write_text("component,position_mm,error,unit\ndx_x,1,zz,um\n", "utf-8")
    for cwd, shown in ((elsewhere, f"{study}/"), (study, ""), (tmp_path, "mill-2/")):
        said = done(mtu("fit-components", study, cwd=cwd), 2).stderr
        assert said.startswith(f"mtu: {shown}lbb.csv, row 2, column 'error': not a number")
    (study / "lbb.csv").unlink()
    gone = done(mtu("fit-components", study, cwd=elsewhere), 2).stderr
    assert gone.startswith(f"mtu: {study}/mtu.yaml:5: lbb[0]: no such file: 'lbb.csv'")
