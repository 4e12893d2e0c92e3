"""`mtu compare` on the shipped parts: report, table, picture, datum, gates."""

from __future__ import annotations

import json
from math import fsum, hypot, isfinite
from pathlib import Path
from typing import Any

import pytest
from cli_runner import Listing, done, listing, mtu, report
from csv_examples import rows_of
from report_numbers import numbers
from support import CONFIGS, DATA

STUDY = CONFIGS / "gilsinn-ling-parts"
FILES = sorted((DATA / "gilsinn-ling-parts").glob("*.csv"))
ITEM = {
    "id", "axis", "operation", "predicted", "measured", "bias_um", "E_n", "ratio_u", "ratio_range",
    "range_width_um", "verdict",
}  # fmt: skip
VERDICTS = {"consistent", "biased", "under-predicted", "over-predicted"}
FAULTS = {"biased": "biased", "under_predicted": "under-predicted"}
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


@pytest.fixture(scope="module")
def holes() -> dict[str, Item]:
    """The predicted holes of the shipped part, by name."""
    return {item["id"]: item for item in report("predict-points", STUDY)["results"]["points"]}


def test_the_report_holds_what_the_contract_names(document: Item) -> None:
    assert document["schema"] == "mtu/compare/1"
    assert [item["role"] for item in document["inputs"]] == [
        "study", "machine", "part", "cmm", "cmm",
    ]  # fmt: skip
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
    assert {item["axis"] for item in results["lengths"]} == {None}
    assert {item["operation"] for item in items} == {"drilled", "milled"}
    assert document["warnings"] == []


def test_the_figures_of_an_item_follow_from_each_other(document: Item) -> None:
    for item in (*document["results"]["features"], *document["results"]["lengths"]):
        predicted, measured = item["predicted"], item["measured"]
        widths = {
            side: 2 * (abs(item[side]["mean_um"]) + item[side]["U_um"])
            for side in ("predicted", "measured")
        }
        assert predicted["U_um"] == pytest.approx(2 * predicted["u_um"])
        assert measured["U_um"] == pytest.approx(2 * measured["u_um"])
        assert measured["parts"] == 21
        assert item["bias_um"] == pytest.approx(measured["mean_um"] - predicted["mean_um"])
        assert item["E_n"] == pytest.approx(item["bias_um"] / (2 * item["u_bias_um"]))
        assert item["ratio_u"] == pytest.approx(measured["u_um"] / predicted["u_um"])
        assert item["range_width_um"] == pytest.approx(widths)
        assert item["ratio_range"] == pytest.approx(widths["measured"] / widths["predicted"])


def test_the_summary_counts_the_verdicts(document: Item) -> None:
    results = document["results"]
    for kind in ("features", "lengths"):
        for entry in results["summary"][kind]:
            own = [item for item in results[kind] if item["operation"] == entry["operation"]]
            counts = {name: [x["verdict"] for x in own].count(name) for name in VERDICTS}
            assert entry["items"] == len(own) == sum(counts.values())
            assert entry["verdicts"] == counts
            for key in FAULTS:
                assert entry[key] == sum(item[key] for item in own)
            for name in ("ratio_u", "ratio_range"):
                values = [item[name] for item in own]
                assert entry[name] == [min(values), max(values)]


def test_the_prediction_is_that_of_the_other_commands(
    document: Item, holes: dict[str, Item]
) -> None:
    lengths = {x["id"]: x for x in report("lengths", STUDY)["results"]["lengths"]}
    for item in document["results"]["features"]:
        point, axis = holes[item["id"]], item["axis"]
        assert item["predicted"]["mean_um"] == pytest.approx(point[f"E{axis}_um"], rel=1e-12)
        assert item["predicted"]["u_um"] == pytest.approx(point[f"u_{axis}_um"], rel=1e-9)
    for item in document["results"]["lengths"]:
        length = lengths[item["id"]]
        # To first order here: errors below 20 um across 130 mm shorten it by 0.0015 um at most.
        assert item["predicted"]["mean_um"] == pytest.approx(length["error_um"], abs=0.0015)
        assert item["predicted"]["u_um"] == pytest.approx(length["u_um"], rel=1e-9)


def test_measured_means_are_those_of_the_file(document: Item, holes: dict[str, Item]) -> None:
    """Means over all rows of a hole, and of lengths over all repeats of all parts."""
    rows = [row for path in FILES for row in rows_of(path.read_text())]
    for item in document["results"]["features"]:
        column = f"{item['axis']}_mm"
        hole = (item["id"], item["operation"])
        own = [float(row[column]) for row in rows if (row["feature"], row["operation"]) == hole]
        mean = 1000 * (fsum(own) / len(own) - holes[item["id"]][column])
        assert (item["measured"]["n"], len(own)) == (54, 54)
        assert item["measured"]["mean_um"] == pytest.approx(mean, abs=1e-6)
    keys = ("operation", "part", "repeat", "feature")
    places = {tuple(row[key] for key in keys): row for row in rows}
    for item in document["results"]["lengths"]:
        start, end = item["id"].split("-")
        L0 = _distance(holes[start], holes[end])
        own = [
            _distance(row, places[(*visit, end)]) - L0
            for (*visit, feature), row in places.items()
            if feature == start and visit[0] == item["operation"]
        ]
        assert item["measured"]["mean_um"] == pytest.approx(1000 * fsum(own) / len(own), abs=1e-6)


def _distance(start: Item, end: Item) -> float:
    return hypot(*(float(end[name]) - float(start[name]) for name in ("x_mm", "y_mm")))


def test_a_sentence_for_each_operation_and_kind(shipped: Listing, document: Item) -> None:
    """At the top of the table, with counts and the range of factors over the faulty items."""
    text = " ".join((shipped[""] or b"").decode().split())
    results = document["results"]
    entries = [
        (kind, entry) for kind in ("features", "lengths") for entry in results["summary"][kind]
    ]
    assert text.startswith(" ".join(f"{entry['verdict_text']}." for _, entry in entries))
    for kind, entry in entries:
        own = [item for item in results[kind] if item["operation"] == entry["operation"]]
        factors = [item["ratio_scatter"] for item in own if item["under_predicted"]]
        assert entry["verdict_text"].startswith(
            f"{entry['operation']} {kind}: under-predicted ({len(factors)} of {len(own)}: "
        )
        assert f"{min(factors):.1f}" in entry["verdict_text"]


def test_table_and_picture(shipped: Listing, document: Item) -> None:
    table = (shipped[""] or b"").decode()
    assert max(map(len, table.splitlines())) <= 100
    for item in document["results"]["lengths"]:
        name = f"{item['operation']} {item['id']} "
        (line,) = [line for line in table.splitlines() if line.startswith(name)]
        shown = [word for key, word in FAULTS.items() if item[key]] or [item["verdict"]]
        assert line.removeprefix(name).strip().startswith(", ".join(shown) + " ")
    assert (shipped["out.png"] or b"").startswith(b"\x89PNG\r\n\x1a\n")
    assert len(shipped["out.png"] or b"") > 5000


def test_the_csv_holds_every_item(shipped: Listing, document: Item) -> None:
    rows = rows_of((shipped["out.csv"] or b"").decode())
    items = [*document["results"]["features"], *document["results"]["lengths"]]
    assert [row["kind"] for row in rows] == ["feature"] * 96 + ["length"] * 6
    for row, item in zip(rows, items, strict=True):
        assert [row[key] for key in ("id", "axis", "operation", "verdict")] == [
            item["id"], item["axis"] or "", item["operation"], item["verdict"],
        ]  # fmt: skip
        assert float(row["bias_um"]) == item["bias_um"]
        assert float(row["measured_u_um"]) == item["measured"]["u_um"]
        assert float(row["range_width_um_predicted"]) == item["range_width_um"]["predicted"]


def test_the_same_bytes_again_and_with_two_threads(shipped: Listing, tmp_path: Path) -> None:
    result = done(mtu("compare", STUDY, "--threads", 2, *OUTPUTS, cwd=tmp_path))
    assert listing(tmp_path) | {"": result.stdout.encode()} == shipped
    alone = done(mtu("compare", STUDY, "-o", "-", cwd=tmp_path))
    assert alone.stdout.encode() == shipped["out.json"]


@pytest.mark.parametrize("datum", ["offset", "offset,rotation"])
def test_a_datum_frees_the_parts_of_their_coordinate_system(
    document: Item, holes: dict[str, Item], datum: str
) -> None:
    """Both sides are free of the motion: their errors are orthogonal to it over all holes."""
    found = report("compare", STUDY, "--datum", datum)["results"]
    assert (document["results"]["datum"], found["datum"]) == ("none", datum)
    centre = {axis: fsum(p[f"{axis}_mm"] for p in holes.values()) / 24 for axis in "xy"}
    for operation in ("drilled", "milled"):
        own = [item for item in found["features"] if item["operation"] == operation]
        for side in ("predicted", "measured"):
            error = {(x["id"], x["axis"]): x[side]["mean_um"] for x in own}
            for axis in "xy":
                assert fsum(error[name, axis] for name in holes) == pytest.approx(0, abs=1e-6)
            turned = fsum(
                (p["x_mm"] - centre["x"]) * error[name, "y"]
                - (p["y_mm"] - centre["y"]) * error[name, "x"]
                for name, p in holes.items()
            )
            # In um mm, over holes 65 mm from the centre: without the datum it is hundreds.
            assert (abs(turned) < 1e-4) == (datum == "offset,rotation")
    # A length does not see where the part lies.
    for first, second in zip(document["results"]["lengths"], found["lengths"], strict=True):
        assert second["measured"]["mean_um"] == pytest.approx(first["measured"]["mean_um"])
        assert second["predicted"]["u_um"] == pytest.approx(first["predicted"]["u_um"])


def test_the_gates_on_the_shipped_parts() -> None:
    biased = done(mtu("compare", STUDY, "--fail-if", "biased", "-q"), 3)
    assert biased.stderr.startswith("mtu: gate biased: drilled 15 x, ")
    assert biased.stdout == ""
    scatter = done(mtu("compare", STUDY, "--fail-if", "under-predicted", "-q"), 3)
    assert scatter.stderr.startswith("mtu: gate under-predicted: drilled 1 x, ")
    assert " more\n" in scatter.stderr
    both = done(mtu("compare", STUDY, "--fail-if", "biased,under-predicted", "-q"), 3)
    assert both.stderr == biased.stderr + scatter.stderr
