"""`mtu close-loop` on points that lack columns, parts, scatter, or hold one column twice."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_runner import Result, done, mtu, report
from support import CONFIGS, DATA

from mtu_cli.cli.help import topic

UNDECLARED = CONFIGS / "undeclared"
MACHINE = UNDECLARED / "machine.yaml"
PART = UNDECLARED / "part.yaml"
READINGS = DATA / "undeclared" / "lbb.csv"
POINTS = READINGS.with_name("cmm.csv")


@pytest.fixture(scope="module")
def rows() -> list[dict[str, str]]:
    """The shipped points."""
    with POINTS.open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def once(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """The first measurement of eight parts."""
    return [dict(row) for row in rows if row["repeat"] == "1" and int(row["part"]) <= 8]


NO_WAVES = ("--exclude", "cyclic")
"""Hundreds of members, of the places alone: two fifths of a call's time."""


def few(folder: Path, points: Sequence[dict[str, Any]], *words: object) -> tuple[Any, Result]:
    """Report and result of a call on some points."""
    path, out = folder / "cmm.csv", folder / "out.json"
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(points[0]))
        table.writeheader()
        table.writerows(points)
    files = ("-m", MACHINE, "-p", PART, "--lbb", READINGS, "--cmm", path)
    result = mtu("close-loop", *files, "-o", out, *NO_WAVES, "--detail", *words)
    return json.loads(out.read_text("utf-8")) if out.exists() else None, result


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
    text = "schema: mtu/machine/1\nname: warm\nequations: {Ex: dx, Ey: dy}\n"
    text += "components: {dx: {unit: um, coefficients: [0]}, dy: {unit: um, coefficients: [0]}}\n"
    (tmp_path / "machine.yaml").write_text(text, "utf-8")
    found = report("close-loop", "-m", "machine.yaml", "--cmm", "cmm.csv", cwd=tmp_path)
    (effect,) = found["results"]["effects"]
    assert effect["name"] == "thermal-growth-x"
    assert effect["parameters"]["growth"]["value"] == pytest.approx(11.5, abs=0.5)
    (gap,) = [item["message"] for item in found["warnings"] if item["code"] == "missing-values"]
    said = "cells missing (T_scale_degC): 1 of 120 rows left out, the first cmm.csv, row 18"
    assert gap == said


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
    known = "{dx: {unit: um, coefficients: [0]}, dy: {unit: um, coefficients: [0]}}"
    text = f"schema: mtu/machine/1\nname: exact\ncomponents: {known}\n"
    text += "equations: {Ex: dx, Ey: dy}\n"
    (tmp_path / "machine.yaml").write_text(text, "utf-8")
    found = report("close-loop", "-m", "machine.yaml", "--cmm", "cmm.csv", cwd=tmp_path)
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
    text = "schema: mtu/machine/1\nname: dial\n"
    text += "components: {px: {of: x, unit: um}}\nequations: {Ex: px}\n"
    (tmp_path / "machine.yaml").write_text(text, "utf-8")
    found = report("close-loop", "-m", "machine.yaml", "--lbb", "dial.csv", cwd=tmp_path)
    (effect,) = found["results"]["effects"]
    lost_motion = effect["parameters"]["lost_motion"]
    assert effect["name"] == "backlash-x"
    assert lost_motion["value"] == pytest.approx(-5.0)
    # Half of the difference of means over 8 positions each, all known to 10/sqrt(12) um.
    assert lost_motion["u"] == pytest.approx(0.5 * math.sqrt(2 / 8 * 100 / 12), rel=0.2)


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
