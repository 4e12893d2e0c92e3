"""Measured parts: `mtu anova`, `mtu compare`, `mtu correct`."""

import csv
import json
from collections.abc import Callable
from itertools import product
from math import fsum
from pathlib import Path
from typing import Any

import pytest
from cli_runner import SMALL, Result, done, mtu, prepared, report, shared
from support import CONFIGS, PAPER

Rows = list[dict[str, str]]


def rows_of(text: str) -> Rows:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def write(path: Path, rows: Rows) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


# `mtu anova` as a user runs it: virtual parts in, report, table, picture, gate and faults out.


PLATE = PAPER / "part.yaml"


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """21 virtual parts of the paper's machine; 5 repeats of four of them, 2 of the others."""
    path = tmp_path_factory.mktemp("parts") / "cmm.csv"
    done(mtu("simulate", PAPER, "--seed", 3, "--parts", 21, "--repeats", 2, "--first-repeats",
             "4:5", "--operation", "drilled", "--scatter", "Ex: 0.004", "--scatter", "Ey: 0.006",
             "--write-cmm", path))  # fmt: skip
    return path


def anova(points: Path, *words: object, code: int = 0) -> Result:
    return done(mtu("anova", "--cmm", points, "-p", PLATE, *words), code)


def results(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text())
    assert document["schema"] == "mtu/anova/1"
    found: dict[str, Any] = document["results"]
    return found


def test_a_clean_study(measured: Path, tmp_path: Path) -> None:
    out, table, plot = (tmp_path / name for name in ("a.json", "a.csv", "a.png"))
    outputs = ("-o", out, "--csv", table, "--plot", plot)
    found = anova(measured, "--fail-if", "unusual", *outputs)
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
    assert anova(measured, "-o", "-").stdout == out.read_text()


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
    found = anova(write(tmp_path / "cmm.csv", rows), "--fail-if", "unusual", code=3)
    assert "Outlying parts: 9." in found.stdout
    assert found.stderr.endswith("mtu: gate unusual: outliers among the parts: 9\n")


def test_a_datum_takes_the_set_up_out(measured: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.json"
    found = anova(measured, "--datum", "offset,rotation", "-o", out)
    assert found.stderr == ""
    assert "less offset and rotation" in found.stdout
    report = results(out)
    assert report["datum"] == "offset,rotation"
    assert [total["mean_error_um"] for total in report["totals"]] == pytest.approx([0, 0], abs=1e-9)


def test_the_gate_needs_four_parts(measured: Path, tmp_path: Path) -> None:
    rows = [row for row in rows_of(measured.read_text()) if row["part"] in ("1", "2", "3")]
    path = write(tmp_path / "cmm.csv", rows)
    assert "four or more" in anova(path, "--fail-if", "unusual", code=2).stderr
    wrong = anova(path, "--method", "rem", code=2).stderr
    assert "unknown method: 'rem'; did you mean" in wrong


# `mtu compare` on the shipped parts: report, table, picture, datum; gates on virtual parts.


STUDY = CONFIGS / "gilsinn-ling-parts"
Item = dict[str, Any]


@pytest.fixture(scope="module")
def document() -> Item:
    return shared("compare configs/gilsinn-ling-parts").report


def test_the_report_holds_what_the_contract_names(document: Item) -> None:
    assert document["schema"] == "mtu/compare/1"
    roles = [item["role"] for item in document["inputs"]]
    assert roles == ["study", "machine", "part", "cmm", "cmm"]
    results = document["results"]
    assert [len(results[key]) for key in ("features", "lengths")] == [96, 6]
    items = [*results["features"], *results["lengths"]]
    assert {item["verdict"] for item in items} <= {"consistent", "biased", *GATED, "over-predicted"}
    assert {item["operation"] for item in items} == {"drilled", "milled"}
    assert document["warnings"] == []


def test_the_prediction_is_that_of_the_other_commands(document: Item) -> None:
    """Lengths to first order here: errors below 20 um across 130 mm shorten it by 0.0015 um."""
    lengths = {x["id"]: x for x in report("lengths", STUDY)["results"]["lengths"]}
    holes = {x["id"]: x for x in report("predict-points", STUDY)["results"]["points"]}
    for item in [*document["results"]["features"], *document["results"]["lengths"]]:
        own, axis = lengths.get(item["id"]), item["axis"]
        mean, u = own["error_um"] if own else None, own["u_um"] if own else None
        if axis:
            mean, u = holes[item["id"]][f"E{axis}_um"], holes[item["id"]][f"u_{axis}_um"]
        assert item["predicted"]["mean_um"] == pytest.approx(mean, abs=1e-9 if axis else 0.0015)
        assert item["predicted"]["u_um"] == pytest.approx(u, rel=1e-9)


def test_a_datum_frees_the_parts_of_their_coordinate_system(document: Item) -> None:
    """On both sides no offset is left, and a length does not see where the part lies."""
    found = report("compare", STUDY, "--datum", "offset,rotation")["results"]
    assert (document["results"]["datum"], found["datum"]) == ("none", "offset,rotation")
    for operation, side, axis in product(("drilled", "milled"), ("predicted", "measured"), "xy"):
        own = [x for x in found["features"] if (x["operation"], x["axis"]) == (operation, axis)]
        assert fsum(x[side]["mean_um"] for x in own) == pytest.approx(0, abs=1e-6)
    for first, second in zip(document["results"]["lengths"], found["lengths"], strict=True):
        assert second["measured"]["mean_um"] == pytest.approx(first["measured"]["mean_um"])
        assert second["predicted"]["u_um"] == pytest.approx(first["predicted"]["u_um"])


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    """Eight virtual parts of the small machine, twice each: the prediction holds by design."""
    path = tmp_path_factory.mktemp("parts") / "cmm.csv"
    done(mtu("simulate", SMALL, "--seed", 1, "--parts", 8, "--repeats", 2, "--cmm-u-um", 0.5,
             "--write-cmm", path, "-q"))  # fmt: skip
    return rows_of(path.read_text())


@pytest.fixture(scope="module")
def well_known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small study with its machine read in seven runs: three tell little of scatter."""
    work = prepared(tmp_path_factory.mktemp("known"))
    done(mtu("simulate", SMALL, "--seed", 7, "--passes", 7, "--positions", "0:200:5",
             "--write-lbb", work / "more.csv", "-q"))  # fmt: skip
    (work / "more.csv").replace(work / "lbb.csv")
    return work


def moved(rows: Rows, shift_mm: Callable[[dict[str, str]], float]) -> Rows:
    return [row | {"x_mm": repr(float(row["x_mm"]) + shift_mm(row))} for row in rows]


GATED: dict[str, Callable[[dict[str, str]], float]] = {
    "biased": lambda _: 0.05,
    "under-predicted": lambda row: 0.05 * (-1) ** int(row["part"]),
}


@pytest.mark.parametrize("kind", GATED)
def test_a_gate_is_met_by_what_it_names_alone(
    parts: Rows, well_known: Path, kind: str, tmp_path: Path
) -> None:
    """50 um in x alone, the same for all parts or to and fro: y stays as it was foretold."""
    path = write(tmp_path / "cmm.csv", moved(parts, GATED[kind]))
    for gate in GATED:
        met = kind == gate
        call = ("compare", well_known, "--cmm", path, "--fail-if", gate, "-q", "-o")
        result = done(mtu(*call, tmp_path / f"{gate}.json"), 3 if met else 0)
        assert result.stderr.startswith(f"mtu: gate {gate}: A x, B x, ") == met
        assert met or result.stderr == ""
        features = json.loads((tmp_path / f"{gate}.json").read_text())["results"]["features"]
        assert {(x["axis"], x["verdict"]) for x in features} == {("x", kind), ("y", "consistent")}


def test_a_gate_that_nothing_can_be_tested_for_is_refused(parts: Rows, tmp_path: Path) -> None:
    one = write(tmp_path / "a.csv", [row for row in parts if row["feature"] == "A"])
    for gate in GATED:
        call = ("compare", SMALL, "--cmm", one, "--datum", "offset", "--fail-if", gate, "-q")
        assert "is undefined; expected two or more parts" in done(mtu(*call), 2).stderr
    found = report("compare", SMALL, "--cmm", one, "--datum", "offset")
    assert {item["verdict"] for item in found["results"]["features"]} == {None}
    assert "not-tested" in {item["code"] for item in found["warnings"]}
    said = done(mtu("compare", SMALL, "--cmm", one, "--datum", "offset")).stdout
    assert said.startswith("features: not tested.")


def test_ranges_are_judged_at_every_row(tmp_path: Path) -> None:
    """Of a load whose mean lies within the range that its effect was found on."""
    (tmp_path / "m.yaml").write_text(
        "schema: mtu/machine/1\nname: m\ncovariates: [load]\ncomponents:\n"
        "  a: {unit: um, coefficients: [1], u_future: 0.5}\nequations: {Ex: a}\neffects:\n"
        "  - name: by-load\n    parameters: {b: {value: 3.0, u: 0.2, unit: um}}\n"
        "    equations: {Ex: b*(load - 5)}\n    seen: {load: [4, 6]}\n"
    )
    (tmp_path / "p.yaml").write_text(
        "schema: mtu/part/1\nname: p\nfeatures: {f: {x_mm: 0, y_mm: 0}, g: {x_mm: 9, y_mm: 0}}\n"
    )

    def told(loads: tuple[float, ...]) -> str:
        rows = [f"{i},{f},{x + (load - 5) * 3e-3:.4f},0,{load}" for i, load in enumerate(loads)
                for f, x in (("f", 0), ("g", 9))]  # fmt: skip
        text = "\n".join(["part,feature,x_mm,y_mm,load", *rows])
        (tmp_path / "c.csv").write_text(text + "\n")
        call = ("compare", "-m", "m.yaml", "-p", "p.yaml", "--cmm", "c.csv", "-q")
        return done(mtu(*call, cwd=tmp_path)).stderr

    assert "[outside-effect-range]" not in told((4.0, 5.0, 6.0))
    assert "extrapolated to 8" in told((2.5, 5.0, 8.0))


# `mtu correct` where the machine and the ring have temperatures.


MACHINE = """\
schema: mtu/machine/1
name: warm machine
components:
  px: {of: x, unit: um, coefficients: [2, -0.06], covariance: [[0.04, 0], [0, 1.0e-6]],
       pass_covariance: [[0.2, 0], [0, 4.0e-6]], s_repeat: 0.4, dof: 8}
  py: {of: y, unit: um, coefficients: [1, -0.05], covariance: [[0.04, 0], [0, 1.0e-6]],
       pass_covariance: [[0.3, 0], [0, 4.0e-6]], s_repeat: 0.5, dof: 8}
  grow: {unit: um/m, coefficients: [-11], u_future: 0.5}
equations:
  Ex: px + grow*x*(T_scale_degC - 20)
  Ey: py + grow*y*(T_scale_degC - 20)
"""
PART = """\
schema: mtu/part/1
name: ring on a plate
z_mm: 0
features:
  A: {x_mm: 290, y_mm: 180}
  B: {x_mm: 245, y_mm: 257.942286}
  C: {x_mm: 155, y_mm: 257.942286}
  D: {x_mm: 110, y_mm: 180}
  E: {x_mm: 155, y_mm: 102.057714}
  F: {x_mm: 245, y_mm: 102.057714}
circles:
  - {id: ring, features: [A, B, C, D, E, F], calibrated_mm: {20: 180.0124, 26: 180.0137},
     U_um: 1.0, temperature: T_room_degC}
"""


def test_the_temperature_of_the_ring_may_be_given(tmp_path: Path) -> None:
    """--at that only the calibration needs is no covariate too many; the rows' own come first."""
    (tmp_path / "machine.yaml").write_text(MACHINE)
    (tmp_path / "part.yaml").write_text(PART)
    files = ("-m", "machine.yaml", "-p", "part.yaml")
    made = ("--parts", "3", "--repeats", "2", "--cmm-u-um", "0.2", "--seed", "3")
    warm = ("--covariate", "T_scale_degC: 20 + sequence", "--write-cmm", "cmm.csv")
    done(mtu("simulate", *files, *made, *warm, cwd=tmp_path))
    at = ("--at", "T_room_degC=29", "--at", "T_scale_degC=40", "--at", "load=2")
    found = report("correct", *files, "--cmm", "cmm.csv", *at, cwd=tmp_path)
    codes = [item["code"] for item in found["warnings"]]
    assert codes == ["option-not-used", "not-used", "outside-measured-range"]
    assert "load" in found["warnings"][0]["message"]
    assert found["results"]["circles"][0]["calibrated_mm"] == pytest.approx(180.01435)
