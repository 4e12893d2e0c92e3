"""`mtu anova` as a user runs it: virtual parts in, report, table, picture, gate and faults out."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from cli_runner import mtu
from support import PAPER

PART = PAPER / "part.yaml"
Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """21 virtual parts of the paper's machine; 5 repeats of four of them, 2 of the others."""
    path = tmp_path_factory.mktemp("parts") / "cmm.csv"
    found = mtu("simulate", PAPER, "--seed", 3, "--parts", 21, "--repeats", 2, "--first-repeats",
                "4:5", "--operation", "drilled", "--scatter", "Ex: 0.004", "--scatter",
                "Ey: 0.006", "--write-cmm", path)  # fmt: skip
    assert found.returncode == 0, found.stderr
    return path


def rows_of(path: Path) -> Rows:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def write(path: Path, rows: Rows) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
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
    # The machine's own squareness and scale look like a turned part.
    (warning,) = found.stderr.splitlines()
    assert warning.endswith("[set-up-dominates]")
    assert max(map(len, found.stdout.splitlines())) <= 100
    report = results(out)
    assert len(report["features"]) == 48
    assert len(report["lengths"]) == 3
    assert len(report["orthogonality"]) == 1
    assert {(x["parts"], x["n"]) for x in report["features"]} == {(21, 54)}
    assert {f"{x['F_critical_95']:.2f}" for x in report["features"]} == {"1.90"}
    kinds = [row["kind"] for row in rows_of(table)]
    assert kinds == ["feature"] * 48 + ["length"] * 3 + ["orthogonality"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    again = mtu("anova", "--cmm", measured, "-p", PART, "-o", "-")
    assert again.stdout == out.read_text()


def test_an_unusual_part_meets_the_gate(measured: Path, tmp_path: Path) -> None:
    rows = rows_of(measured)
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
    wrong = mtu("anova", "--cmm", measured, "-p", PART, "--datum", "offset,rotatoin")
    assert wrong.returncode == 2
    assert "--datum: out of range: 'offset,rotatoin'; expected 'none', 'offset' or" in wrong.stderr


def test_a_copied_file_is_noticed(measured: Path, tmp_path: Path) -> None:
    """The same values once with and once without `repeat`."""
    rows = [{k: v for k, v in row.items() if k != "repeat"} for row in rows_of(measured)]
    found = mtu("anova", "--cmm", measured, "--cmm", write(tmp_path / "copy.csv", rows), "-p", PART)
    assert found.returncode == 0, found.stderr
    assert "[copied-values]" in found.stderr
    assert "[copied-values]" not in mtu("anova", "--cmm", measured, "-p", PART).stderr


def test_a_study_names_its_files(measured: Path, tmp_path: Path) -> None:
    (tmp_path / "part.yaml").write_text(PART.read_text())
    (tmp_path / "cmm.csv").write_text(measured.read_text())
    (tmp_path / "mtu.yaml").write_text(
        "schema: mtu/study/1\npart: part.yaml\ncmm: cmm.csv\nsettings: {coverage_factor: 3}\n"
    )
    found = mtu("anova", "-o", "-", cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    report = json.loads(found.stdout)
    assert {item["role"] for item in report["inputs"]} == {"study", "part", "cmm"}
    first = report["results"]["features"][0]
    assert first["U_future_um"] == pytest.approx(3 * first["u_future_um"])


def test_without_a_part_file_the_nominals_come_from_the_csv(measured: Path, tmp_path: Path) -> None:
    one = mtu("anova", "--cmm", measured)
    assert one.returncode == 2
    assert "row 4, column 'feature': the nominal place is missing" in one.stderr
    assert "(and rows 5 to " in one.stderr
    plate = tmp_path / "plate.csv"
    plate.write_text(
        "part,feature,x_mm,y_mm,nominal_x_mm,nominal_y_mm,diameter_mm\n"
        "007,h1,10.004,20.001,10,20,2.17\n007,h2,110.002,19.999,110,20,2.16\n"
    )
    found = mtu("anova", "--cmm", plate, "-o", tmp_path / "o.json", "--plot", tmp_path / "o.svg")
    assert found.returncode == 0, found.stderr
    assert "[few-parts]" in found.stderr
    entry = results(tmp_path / "o.json")["features"][0]
    assert entry["mean_error_um"] == pytest.approx(4)
    assert entry["F"] is None


def faulty(rows: Rows, kind: str) -> Rows:
    changed = [dict(row) for row in rows]
    match kind:
        case "unknown feature":
            changed[3]["feature"] = "77"
        case "copied part":
            changed += [
                row | {"part": "twin", "sequence": "99"} for row in rows if row["part"] == "5"
            ]
        case "doubled repeat":
            changed[24]["repeat"] = "1"
        case "swapped":
            for row in changed:
                row["x_mm"], row["y_mm"] = row["y_mm"], row["x_mm"]
        case "mixed units":
            for row in changed[:48]:
                row["x_mm"], row["y_mm"] = (f"{float(row[k]) / 25.4:.7f}" for k in ("x_mm", "y_mm"))
        case "not a number":
            changed[5]["x_mm"] = "12,5"
        case "negative repeat":
            changed[7]["repeat"] = "-1"
        case "two sequences":
            changed[7]["sequence"] = "44"
        case "kilometres":
            changed[7]["x_mm"] = "1e12"
    return changed


@pytest.mark.parametrize(
    ("kind", "code", "words"),
    [
        ("unknown feature", 2, "row 5, column 'feature': unknown feature: '77'"),
        ("copied part", 0, "part 'twin' as part '5' (rows 1298 to 1345) [copied-values]"),
        (
            "doubled repeat",
            2,
            "row 26, column 'feature': the feature in one repeat of one part",
        ),
        ("not a number", 2, "row 7, column 'x_mm'"),
        ("negative repeat", 2, "column 'repeat': out of range: '-1'"),
        (
            "two sequences",
            2,
            "'sequence': out of range: '44'; expected 1, as before of part '1'",
        ),
        ("kilometres", 0, "(row 9): '1e+12' [far-from-nominal]"),
        ("swapped", 0, "x and y swapped (rows 2 to 1297) [far-from-nominal]"),
        ("mixed units", 0, "inches, not mm (rows 2 to 49) [far-from-nominal]"),
    ],
)
def test_bad_input(measured: Path, tmp_path: Path, kind: str, code: int, words: str) -> None:
    path = write(tmp_path / "cmm.csv", faulty(rows_of(measured), kind))
    out = tmp_path / "out.json"
    found = mtu("anova", "--cmm", path, "-p", PART, "-o", out)
    assert found.returncode == code, found.stderr
    assert words in found.stderr
    assert "Traceback" not in found.stderr
    assert out.exists() == (code == 0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "the cmm file is missing"),
        (("--cmm", "CMM", "-p", PART, "--method", "rem"), "unknown method: 'rem'; did you mean"),
        (("--cmm", "CMM", "-p", PART, "--fail-if", "biased"), "unknown gate: 'biased'"),
    ],
)
def test_bad_calls(measured: Path, options: tuple[object, ...], words: str) -> None:
    given = [measured if item == "CMM" else item for item in options]
    found = mtu("anova", *given, cwd=measured.parent)
    assert found.returncode == 2
    assert words in found.stderr


def test_the_gate_needs_four_parts(measured: Path, tmp_path: Path) -> None:
    rows = [row for row in rows_of(measured) if row["part"] in ("1", "2", "3")]
    path = write(tmp_path / "cmm.csv", rows)
    found = mtu("anova", "--cmm", path, "-p", PART, "--fail-if", "unusual")
    assert found.returncode == 2
    assert "four or more" in found.stderr
    assert mtu("anova", "--cmm", path, "-p", PART, "-q").stdout == ""
