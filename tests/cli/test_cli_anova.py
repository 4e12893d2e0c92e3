"""`mtu anova` as a user runs it: virtual parts in, report, table, picture, gate and faults out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cli_runner import mtu
from csv_examples import rows_of, write
from support import PAPER

PART = PAPER / "part.yaml"


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """21 virtual parts of the paper's machine; 5 repeats of four of them, 2 of the others."""
    path = tmp_path_factory.mktemp("parts") / "cmm.csv"
    found = mtu("simulate", PAPER, "--seed", 3, "--parts", 21, "--repeats", 2, "--first-repeats",
                "4:5", "--operation", "drilled", "--scatter", "Ex: 0.004", "--scatter",
                "Ey: 0.006", "--write-cmm", path)  # fmt: skip
    assert found.returncode == 0, found.stderr
    return path


def results(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text())
    assert document["schema"] == "mtu/anova/1"
    found: dict[str, Any] = document["results"]
    return found


def test_a_clean_study(measured: Path, tmp_path: Path) -> None:
    out, table, plot = (tmp_path / name for name in ("a.json", "a.csv", "a.png"))
    found = mtu("anova", "--cmm", measured, "-p", PART, "--fail-if", "unusual", "-o", out,
                "--csv", table, "--plot", plot)  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert found.stderr == ""
    assert max(map(len, found.stdout.splitlines())) <= 100
    report = results(out)
    assert len(report["features"]) == 48
    assert len(report["lengths"]) == 3
    assert len(report["orthogonality"]) == 1
    assert {(x["parts"], x["n"]) for x in report["features"]} == {(21, 54)}
    assert {f"{x['F_critical_95']:.2f}" for x in report["features"]} == {"1.90"}
    kinds = [row["kind"] for row in rows_of(table.read_text())]
    assert kinds == ["feature"] * 48 + ["length"] * 3 + ["orthogonality"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    again = mtu("anova", "--cmm", measured, "-p", PART, "-o", "-")
    assert again.stdout == out.read_text()


def test_lengths_in_space_without_a_measured_z(tmp_path: Path) -> None:
    part = "schema: mtu/part/1\nname: step\nfeatures:\n"
    part += "  a: {x_mm: 0, y_mm: 0, z_mm: 0}\n  b: {x_mm: 100, y_mm: 0, z_mm: 50}\n"
    (tmp_path / "part.yaml").write_text(part + "lengths: [{id: ab, from: a, to: b}]\n", "utf-8")
    lines = ["part,feature,repeat,x_mm,y_mm"]
    for i, repeat in ((i, repeat) for i in range(4) for repeat in (1, 2)):
        lines += [f"{i},a,{repeat},0.00{i},0.001", f"{i},b,{repeat},100.00{repeat},0.00{i}"]
    (tmp_path / "cmm.csv").write_text("\n".join(lines), "utf-8")
    said = mtu("anova", "--cmm", "cmm.csv", "-p", "part.yaml", cwd=tmp_path).stderr
    assert "ends of ab have no z_mm: the lengths are taken as free of error along z" in said


def test_an_unusual_part_meets_the_gate(measured: Path, tmp_path: Path) -> None:
    rows = rows_of(measured.read_text())
    for row in rows:
        if row["part"] == "9":
            row["y_mm"] = f"{float(row['y_mm']) + 0.03:.6f}"
    found = mtu("anova", "--cmm", write(tmp_path / "cmm.csv", rows), "-p", PART, "--fail-if",
                "unusual")  # fmt: skip
    assert found.returncode == 3
    assert "Outlying parts: 9." in found.stdout
    assert found.stderr.endswith("mtu: gate unusual: outliers among the parts: 9\n")


def test_a_datum_takes_the_set_up_out(measured: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.json"
    found = mtu("anova", "--cmm", measured, "-p", PART, "--datum", "offset,rotation", "-o", out)
    assert found.returncode == 0, found.stderr
    assert found.stderr == ""
    assert "less offset and rotation" in found.stdout
    report = results(out)
    assert report["datum"] == "offset,rotation"
    assert [total["mean_error_um"] for total in report["totals"]] == pytest.approx([0, 0], abs=1e-9)


def test_the_gate_needs_four_parts(measured: Path, tmp_path: Path) -> None:
    rows = [row for row in rows_of(measured.read_text()) if row["part"] in ("1", "2", "3")]
    path = write(tmp_path / "cmm.csv", rows)
    found = mtu("anova", "--cmm", path, "-p", PART, "--fail-if", "unusual")
    assert found.returncode == 2
    assert "four or more" in found.stderr
    wrong = mtu("anova", "--cmm", path, "-p", PART, "--method", "rem")
    assert wrong.returncode == 2
    assert "unknown method: 'rem'; did you mean" in wrong.stderr
