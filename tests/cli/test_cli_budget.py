"""`mtu budget` as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_runner import done, mtu, report
from support import CONFIGS

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
