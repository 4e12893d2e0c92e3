"""`mtu close-loop` on the shipped study whose machine has an effect that its file does not know."""

import csv
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from cli_runner import (
    NO_WAVES,
    TWO_FOLDS,
    Listing,
    Result,
    done,
    listing,
    machine_file,
    mtu,
    report,
)
from loop_examples import (
    BACKLASH,
    CLASS,
    CYCLIC,
    SCATTER,
    SMOOTH,
    effect,
    parameter,
    searched,
    uncorrelated,
)
from support import CONFIGS, DATA

from mtu_cli.analyses import close_loop
from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect
from mtu_cli.help import topic

UNDECLARED = CONFIGS / "undeclared"
MACHINE = UNDECLARED / "machine.yaml"
READINGS = DATA / "undeclared" / "lbb.csv"
TRUE_UM = -4.0
"""What truth.yaml says; no command here reads it."""

FILES = {
    "-o": "out.json", "--csv": "out.csv", "--plot": "out.png",
    "--write-machine": "new.yaml", "--write-components": "new.json",
}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A call in a folder of its own, and what it left there."""

    folder: Path
    result: Result
    files: Listing

    @property
    def results(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.files["out.json"] or b"")["results"]
        return found

    @property
    def machine(self) -> Path:
        return self.folder / "new.yaml"


def closed(folder: Path, gate: str, code: int, env: dict[str, str] | None = None) -> Run:
    options = [word for pair in FILES.items() for word in pair]
    call = ("close-loop", UNDECLARED, *options, "--fail-if", gate)
    result = done(mtu(*call, cwd=folder, env=env), code)
    return Run(folder, result, listing(folder))


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return closed(tmp_path_factory.mktemp("first"), "found", 3)


def test_the_effect_is_named_alone(first: Run) -> None:
    results = first.results
    assert results["verdict"] == "named"
    assert results["undeclared_effect_found"] is True
    (effect,) = results["effects"]
    assert (effect["name"], effect["class"]) == ("backlash-x", ["backlash-x"])
    assert effect["equations"] == {"Ex": "lost_motion*dir_x + level_x"}
    assert effect["p_familywise"] < 0.05
    parameter = effect["parameters"]["lost_motion"]
    assert parameter["unit"] == "um"
    assert abs(parameter["value"] - TRUE_UM) < 3 * parameter["u"]
    assert parameter["u"] < 0.3
    # Where it was found: the parts were machined in both directions.
    (written,) = yaml.safe_load(first.machine.read_text())["effects"]
    assert written["seen"] == {"dir_x": [-1.0, 1.0]}
    assert not results["unexplained"]["found"]
    assert max(map(len, first.result.stdout.splitlines())) <= 100
    assert "mtu: gate found: verdict named: backlash-x\n" in first.result.stderr


def test_the_gain_is_held_out_and_near_the_floor(first: Run) -> None:
    """The truth leaves rms^2 less sum of effect^2 over both axes: 4^2/2."""
    results = first.results
    assert results["held_out"]["by"] == "parts"
    before, after = results["before"]["rms_um"], results["after"]["rms_um"]
    assert before**2 - after**2 == pytest.approx(TRUE_UM**2 / 2, rel=0.15)
    assert after < 1.2 * results["floor_um"]
    gain = 100 * (1 - after / before)
    assert results["improvement_percent"] == pytest.approx(gain)
    # Nothing is wrong in y; a fold in twenty may claim something small there.
    assert results["after"]["rms_y_um"] == pytest.approx(results["before"]["rms_y_um"], rel=0.02)


def test_the_same_bytes_again(first: Run, tmp_path: Path) -> None:
    """Elsewhere, in another language, with another hash seed and number of threads."""
    strange = {"PYTHONHASHSEED": "7", "LC_ALL": "de_DE.UTF-8", "OMP_NUM_THREADS": "1"}
    again = closed(tmp_path, "unexplained", 0, strange)
    assert set(first.files) == set(FILES.values())
    assert (first.files["out.png"] or b"").startswith(b"\x89PNG")
    for name in first.files:
        assert again.files[name] == first.files[name], name
    assert again.result.stdout == first.result.stdout


@TWO_FOLDS
def test_the_extended_machine_has_nothing_left(first: Run, tmp_path: Path) -> None:
    new = tmp_path / "again.yaml"
    call = ("close-loop", UNDECLARED, "-m", first.machine, "--fail-if", "found")
    result = done(mtu(*call, "-o", "-", "--write-machine", new, "--plot", tmp_path / "p.svg"))
    results = json.loads(result.stdout)["results"]
    assert (results["verdict"], results["effects"]) == ("none", [])
    in_sample = results["in_sample"]
    assert in_sample["after"] == in_sample["before"]
    assert in_sample["before"]["rms_um"] == pytest.approx(
        first.results["in_sample"]["after"]["rms_um"], rel=1e-3
    )
    assert new.read_bytes() == first.machine.read_bytes()
    assert (tmp_path / "p.svg").read_text("utf-8").startswith("<?xml")


@TWO_FOLDS
def test_readings_alone_are_judged_by_component(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    done(mtu("close-loop", "-m", MACHINE, "--lbb", READINGS, "-q", "-o", out))
    results = json.loads(out.read_text("utf-8"))["results"]
    components = [item["component"] for item in results["tables"]]
    assert components == ["dx_x", "dy_x", "dy_y", "dx_y", "ex_x", "ey_x", "ez_x", "ex_y", "ey_y",
                          "ez_y", "axy"]  # fmt: skip
    assert results["verdict"] == "none"
    assert "floor_arcsec" in next(i for i in results["tables"] if i["component"] == "ez_x")


@TWO_FOLDS
def test_the_drift_of_a_component_without_an_axis_is_written_and_read_again(tmp_path: Path) -> None:
    machine_file(tmp_path, "{axy: {unit: arcsec}}", "{Ex: -y*axy}")
    rows = [f"axy,{k},{0.8 * k + 0.1 * (k * k % 3 + j)},arcsec" for k in range(12) for j in (0, 1)]
    (tmp_path / "l.csv").write_text("\n".join(["component,pass,error,unit", *rows]) + "\n")
    lbb = ("--lbb", "l.csv")
    done(mtu("close-loop", "-m", "m.yaml", *lbb, "--write-machine", "new.yaml", cwd=tmp_path))
    (written,) = yaml.safe_load((tmp_path / "new.yaml").read_text("utf-8"))["effects"]
    assert (written["name"], written["axis"]) == ("trend-axy", "axy")
    done(mtu("fit-components", "-m", "new.yaml", *lbb, cwd=tmp_path))


# What close-loop writes, warns of and which gates it meets, of results that are known.


OFFSET = effect("offset-x", parameter("shift", "um", 0.2, 0.3))
OPEN = replace(CYCLIC, searched=searched("pitch_mm", 12.5, (9.0, 9.1), (12.3, 12.7)))


JOINT = np.array([[0.09, 0.02, 0.001], [0.02, 0.25, 0.03], [0.001, 0.03, 0.04]])
"""Of the parameters of what was found, in their units."""
FACTORS = np.array([1e-3, np.pi / 648000, 1e-6])
LOST = effect(
    "backlash-x",
    parameter("lost_motion", "um", 2.0, 0.3),
    equations={"Ex": "lost_motion*dir_x"},
)
TURN = effect(
    "turn",
    parameter("angle", "arcsec", 3.0, 0.5),
    parameter("scale", "um/m", 7.0, 0.2),
    equations={"Ex": "-angle*(y - 40) + scale*(x - 50)", "Ey": "angle*(x - 50)"},
)
WRITE = ("--write-machine", "new.yaml", "--write-components", "new.json")
PLACES = np.array([[50.0, 20.0], [120.0, 130.0]])

KNOWN: list[CloseLoopResult] = []
"""The result of the study, found once."""


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """A call whose analysis finds given effects, which writes new.yaml and new.json."""
    real = close_loop.close_loop

    def call(*effects: FoundEffect, verdict: Any = "named", more: Sequence[str] = ()) -> Result:
        def found(*args: Any, **options: Any) -> Any:
            KNOWN[:] = KNOWN or [real(*args, **options)]
            numbered, covariance = uncorrelated(*effects)
            if effects == (LOST, TURN):
                covariance = JOINT * np.outer(FACTORS, FACTORS)
            known = KNOWN[0].tables[0]
            table = replace(known, effects=numbered, verdict=verdict, covariance=covariance)
            return replace(KNOWN[0], verdict=verdict, tables=(table,))

        monkeypatch.setattr(close_loop, "close_loop", found)
        options = [*(more or WRITE), *NO_WAVES, "--fail-if", "found,unexplained"]
        with TWO_FOLDS:
            return mtu("close-loop", UNDECLARED, "-q", *options, cwd=tmp_path)

    return call


def predicted(folder: Path, *call: object) -> Any:
    features = "".join(f"  p{x:g}: {{x_mm: {x}, y_mm: {y}, z_mm: 127}}\n" for x, y in PLACES)
    (folder / "part.yaml").write_text(f"schema: mtu/part/1\nname: p\nfeatures:\n{features}")
    call = ("predict-points", "-p", "part.yaml", *call, "--covariance")
    return report(*call, cwd=folder)["results"]


def test_a_smooth_effect_is_a_table_that_predictions_take(given: Any, tmp_path: Path) -> None:
    done(given(SMOOTH), 3)
    (written,) = yaml.safe_load((tmp_path / "new.yaml").read_text())["effects"]
    assert written["equations"] == {"Ex": "profile_x"}
    assert written["components"]["profile_x"]["at_mm"] == [0, 50, 100, 150]
    old, new = (
        predicted(tmp_path, "-m", path, "--lbb", READINGS)["points"][0]
        for path in (UNDECLARED / "machine.yaml", "new.yaml")
    )
    assert new["Ex_um"] - old["Ex_um"] == pytest.approx(3.0)
    assert new["var_x_um2"] - old["var_x_um2"] == pytest.approx(0.2)


def test_the_files_hold_the_joint_covariance_and_a_second_round_keeps_it(
    given: Any, tmp_path: Path
) -> None:
    done(given(LOST, TURN), 3)
    old = predicted(tmp_path, "-m", UNDECLARED / "machine.yaml", "--lbb", READINGS)
    x, y = PLACES.T
    J = np.zeros((4, 3))
    J[0::2, 0], J[0::2, 1], J[0::2, 2] = 1, -(y - 40) * np.pi / 648, (x - 50) * 1e-3
    J[1::2, 1] = (x - 50) * np.pi / 648
    # The machine file alone knows no covariance between effects.
    apart = np.block([[JOINT[:1, :1], np.zeros((1, 2))], [np.zeros((2, 1)), JOINT[1:, 1:]]])
    for files, C in ((("-c", "new.json"), JOINT), (("--lbb", READINGS), apart)):
        new = predicted(tmp_path, "-m", "new.yaml", *files, "--at", "dir_x=1")
        more = np.array(new["covariance_um2"]) - old["covariance_um2"]
        assert more == pytest.approx(J @ C @ J.T, rel=1e-6, abs=1e-9)
    again = ("-m", "new.yaml", "-c", "new.json", "--write-machine", "third.yaml")
    done(given(LOST, more=(*again, "--write-components", "third.json")), 3)
    first = (tmp_path / "new.yaml").read_bytes()
    assert (tmp_path / "third.yaml").read_bytes().startswith(first)
    effects = json.loads((tmp_path / "third.json").read_text())["results"]["effects"]
    assert effects["parameters"][-2:] == ["turn.scale", "backlash-x-2.lost_motion"]
    assert np.array(effects["covariance"])[:3, :3] == pytest.approx(JOINT)
    assert np.array(effects["covariance"])[3] == pytest.approx([0, 0, 0, 0.09])


@pytest.mark.parametrize(
    ("effects", "verdict", "codes", "names"),
    [
        ((BACKLASH,), "named", [], ["backlash-x"]),
        ((CLASS,), "class", ["written-class"], ["backlash-x"]),
        ((BACKLASH,), "unexplained", [], ["backlash-x"]),
        ((BACKLASH, OPEN), "named", ["effect-not-written"], ["backlash-x"]),
        ((BACKLASH, OFFSET), "named", [], ["backlash-x", "offset-x"]),
        ((OFFSET,), "named", [], ["offset-x"]),
        ((SCATTER,), "named", ["effect-not-written"], []),
        ((), "unexplained", [], []),
        ((), "none", [], []),
    ],
)
def test_what_is_not_written_or_doubtful_is_warned_of_and_gates_are_met(
    given: Any,
    tmp_path: Path,
    effects: tuple[FoundEffect, ...],
    verdict: str,
    codes: list[str],
    names: list[str],
) -> None:
    met = {"none": [], "unexplained": ["found", "unexplained"]}.get(verdict, ["found"])
    said = done(given(*effects, verdict=verdict), 3 if met else 0).stderr
    gates = [line for line in said.splitlines() if line.startswith("mtu: gate ")]
    assert [line.split()[2].rstrip(":") for line in gates] == met
    told = [line for line in said.splitlines() if line not in gates]
    assert [line.rpartition("[")[2].rstrip("]") for line in told] == codes
    written = yaml.safe_load((tmp_path / "new.yaml").read_text()).get("effects", [])
    assert [item["name"] for item in written] == names


# `mtu close-loop` on points that lack columns, parts, scatter, or hold one column twice.


PART = UNDECLARED / "part.yaml"
POINTS = READINGS.with_name("cmm.csv")


@pytest.fixture(scope="module")
def rows() -> list[dict[str, str]]:
    with POINTS.open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def once(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [dict(row) for row in rows if row["repeat"] == "1" and int(row["part"]) <= 8]


EXACT = "{dx: {unit: um, coefficients: [0]}, dy: {unit: um, coefficients: [0]}}"


def few(folder: Path, points: Sequence[dict[str, Any]], *words: object) -> tuple[Any, Result]:
    path, out = folder / "cmm.csv", folder / "out.json"
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(points[0]))
        table.writeheader()
        table.writerows(points)
    files = ("-m", MACHINE, "-p", PART, "--lbb", READINGS, "--cmm", path)
    result = mtu("close-loop", *files, "-o", out, *NO_WAVES, "--detail", *words)
    return json.loads(out.read_text("utf-8")) if out.exists() else None, result


@TWO_FOLDS
def test_columns_that_cannot_be_used_are_told(rows: list[dict[str, str]], tmp_path: Path) -> None:
    """dir_x missing, dir_y constant, one temperature a copy, the other with a gap."""
    points = []
    for row in once(rows):
        own: dict[str, Any] = {k: v for k, v in row.items() if k not in ("dir_x", "dir_y")}
        own |= {"dir_y": 1, "T_copy_degC": 2 * float(row["T_spindle_degC"]) + 1}
        points.append(own | ({"T_part_degC": ""} if row["part"] == "4" else {}))
    picture = tmp_path / "out.pdf"
    found, result = few(tmp_path, points, "--plot", picture)
    done(result)
    why = {item["name"]: item["unavailable"] for item in found["results"]["candidates"]}
    assert why["backlash-x"] == "no column dir_x"
    assert why["backlash-y"] == "dir_y does not change"
    said = " ".join(result.stdout.split())
    assert "not tested: backlash-x, wear-approach-x, backlash-step-x: no column dir_x" in said
    assert "dir_y does not change" in said
    assert "cells missing (T_part_degC (24 of 192 rows, the first cmm.csv, row 74)" in result.stderr
    assert "backlash-x" not in [effect["name"] for effect in found["results"]["effects"]]
    assert picture.read_bytes().startswith(b"%PDF")


@TWO_FOLDS
def test_an_empty_cell_of_a_temperature_costs_its_row(tmp_path: Path) -> None:
    """And no more: without the temperature the growth of the scale looks like something else."""
    rng = np.random.default_rng(1)
    lines = ["part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,T_scale_degC"]
    for part in range(1, 13):
        warm = 20 + 4 * rng.random()
        for x in range(0, 500, 50):
            error, y = 11.5e-6 * x * (warm - 20), 40 * (x % 3)
            place = f"{x + error + 3e-4 * rng.normal():.5f},{y + 3e-4 * rng.normal():.5f},{x},{y}"
            lines.append(f"{part},h{x},{place},{warm:.2f}")
    lines[17] = lines[17].rpartition(",")[0] + ","
    (tmp_path / "cmm.csv").write_text("\n".join(lines), "utf-8")
    machine_file(tmp_path, EXACT)
    found = report("close-loop", "-m", "m.yaml", "--cmm", "cmm.csv", cwd=tmp_path)
    (effect,) = found["results"]["effects"]
    assert effect["name"] == "thermal-growth-x"
    assert effect["parameters"]["growth"]["value"] == pytest.approx(11.5, abs=0.5)
    (gap,) = [item["message"] for item in found["warnings"] if item["code"] == "missing-values"]
    assert gap.startswith(
        "cells missing (T_scale_degC (1 of 120 rows, the first cmm.csv, row 18)): "
    )


@TWO_FOLDS
def test_a_copy_of_the_direction_makes_a_class(rows: list[dict[str, str]], tmp_path: Path) -> None:
    """What is written is then one of two, and a warning says so."""
    points = [row | {"clamp": row["dir_x"]} for row in once(rows)]
    found, result = few(tmp_path, points, "--write-machine", tmp_path / "new.yaml")
    done(result)
    results = found["results"]
    assert results["verdict"] == "class"
    assert set(results["effects"][0]["class"]) >= {"backlash-x", "covariate-x"}
    assert "(backlash-x, or covariate-x)" in result.stdout
    assert "written-class" in [warning["code"] for warning in found["warnings"]]
    assert (tmp_path / "new.yaml").exists()


@pytest.mark.parametrize("shift", [0.0, 0.01])
def test_errors_without_any_scatter(shift: float, tmp_path: Path) -> None:
    places = {"A": (0, 0), "B": (100, 0), "C": (200, 0), "D": (0, 80), "E": (0, 160)}
    lines = ["part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm"]
    for part in range(6):
        for name, (x, y) in places.items():
            lines.append(f"{part},{name},{x + shift},{y + shift},{x},{y}")
    (tmp_path / "cmm.csv").write_text("\n".join(lines), "utf-8")
    machine_file(tmp_path, EXACT)
    found = report("close-loop", "-m", "m.yaml", "--cmm", "cmm.csv", cwd=tmp_path)
    names = {effect["name"] for effect in found["results"]["effects"]}
    assert names <= ({"offset-x", "offset-y"} if shift else set())
    assert found["results"]["verdict"] in ("none", *(["named"] if shift else []))
    assert found["results"]["before"]["rms_um"] == pytest.approx(1e3 * shift)


def test_a_reversal_of_one_step_of_a_dial(tmp_path: Path) -> None:
    """Readings that do not scatter are known to their last digit, no better."""
    lines = ["component,position_mm,pass,direction,error,unit"]
    for number in range(1, 6):
        for x in range(0, 400, 50):
            lines += [f"px,{x},{number},forward,0.00,mm", f"px,{x},{number},reverse,0.01,mm"]
    (tmp_path / "dial.csv").write_text("\n".join(lines), "utf-8")
    machine_file(tmp_path, "{px: {of: x, unit: um}}", "{Ex: px}")
    found = report("close-loop", "-m", "m.yaml", "--lbb", "dial.csv", cwd=tmp_path)
    (effect,) = found["results"]["effects"]
    lost_motion = effect["parameters"]["lost_motion"]
    assert effect["name"] == "backlash-x"
    assert lost_motion["value"] == pytest.approx(-5.0)
    # Half of the difference of means over 8 positions each, all known to 10/sqrt(12) um.
    assert lost_motion["u"] == pytest.approx(0.5 * math.sqrt(2 / 8 * 100 / 12), rel=0.2)


@TWO_FOLDS
def test_own_effects_of_the_help_and_one_with_a_constant(
    rows: list[dict[str, str]], tmp_path: Path
) -> None:
    (text,) = re.findall(r"```yaml\n(schema: mtu/effects/1\n.*?)```", topic("effects"), re.S)
    (tmp_path / "mine.yaml").write_text(text, "utf-8")
    ramp = tmp_path / "ramp.yaml"
    ramp.write_text(
        "schema: mtu/effects/1\neffects:\n  - family: ramp\n    says: it rises\n"
        "    parameters: {level_y: um, own_level: um}\n"
        "    equations:\n      E{a}: level_y*(sequence/8)**2 + own_level\n",
        "utf-8",
    )
    points = once(rows)
    found, result = few(tmp_path, points, "--effects", tmp_path / "mine.yaml", "--effects", ramp)
    done(result)
    tested = {item["name"]: item["unavailable"] for item in found["results"]["candidates"]}
    assert tested["screw-heat-x"] is tested["screw-heat-y"] is None
    assert tested["ramp-x"] == (
        "a parameter of it is a constant, which is estimated with every effect: leave it out"
    )
    assert found["results"]["effects"][0]["name"] == "backlash-x"
    assert [item["role"] for item in found["inputs"]].count("effects") == 2
