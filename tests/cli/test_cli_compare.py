"""`mtu compare` on the shipped parts: report, table, picture, datum; gates on virtual parts."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import product
from math import fsum, isfinite
from pathlib import Path
from typing import Any

import pytest
from cli_runner import SMALL, Listing, done, listing, mtu, prepared, report
from csv_examples import Rows, rows_of, write
from report_numbers import numbers
from support import CONFIGS

STUDY = CONFIGS / "gilsinn-ling-parts"
ITEM = {
    "id", "axis", "operation", "predicted", "measured", "bias_um", "E_n", "ratio_u", "ratio_range",
    "range_width_um", "verdict",
}  # fmt: skip
VERDICTS = {"consistent", "biased", "under-predicted", "over-predicted"}
OUTPUTS = ("-o", "out.json", "--csv", "out.csv", "--plot", "out.png")
Item = dict[str, Any]


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Listing:
    """All outputs of one call on the shipped parts, the table under ""."""
    folder = tmp_path_factory.mktemp("compare")
    result = done(mtu("compare", STUDY, "--threads", 1, *OUTPUTS, cwd=folder))
    assert result.stderr == ""
    return listing(folder) | {"": result.stdout.encode()}


@pytest.fixture(scope="module")
def document(shipped: Listing) -> Item:
    found: Item = json.loads(shipped["out.json"] or b"")
    return found


def test_the_report_holds_what_the_contract_names(document: Item) -> None:
    assert document["schema"] == "mtu/compare/1"
    roles = [item["role"] for item in document["inputs"]]
    assert roles == ["study", "machine", "part", "cmm", "cmm"]
    results = document["results"]
    items = [*results["features"], *results["lengths"]]
    assert [len(results[key]) for key in ("features", "lengths")] == [96, 6]
    for item in items:
        assert set(item) >= ITEM
        assert set(item["predicted"]) >= {"mean_um", "u_um", "U_um"}
        assert set(item["measured"]) >= {"mean_um", "u_um", "U_um", "parts"}
        assert set(item["range_width_um"]) == {"predicted", "measured"}
        assert item["verdict"] in VERDICTS
    found = numbers(items) + numbers(results["summary"])
    assert all(value is not None and isfinite(value) for name, value in found if "axis" not in name)
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


def test_the_same_bytes_again_and_with_two_threads(shipped: Listing, tmp_path: Path) -> None:
    result = done(mtu("compare", STUDY, "--threads", 2, *OUTPUTS, cwd=tmp_path))
    assert listing(tmp_path) | {"": result.stdout.encode()} == shipped
    alone = done(mtu("compare", STUDY, "-o", "-", cwd=tmp_path))
    assert alone.stdout.encode() == shipped["out.json"]


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
    assert found["results"]["summary"]["features"][0]["verdict_text"] == "features: not tested"


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
