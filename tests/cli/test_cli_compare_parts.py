"""`mtu compare` on virtual parts of the small machine: gates, repeats, and what cannot be known."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_runner import SMALL, done, mtu, prepared, report
from csv_examples import Rows, rows_of, write


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
