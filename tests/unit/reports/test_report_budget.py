"""The report, table, CSV and figure of a budget say what the result holds."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from budget_examples import evaluated

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.files.source import report_bytes
from mtu_cli.reports.budget import document, figure
from mtu_cli.reports.fields import csv_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.tables import plain_text

CONTRACT = {"value", "u", "second_order", "dof_effective", "k", "U", "rows", "monte_carlo"}
ROW = {"name", "value", "u", "distribution", "dof", "sensitivity", "contribution", "share"}
MONTE_CARLO = {
    "mean", "u", "interval", "shortest", "probability", "trials", "first_order_valid",
}  # fmt: skip

CSV_COLUMNS = "output,name,unit,value,u,type,distribution,dof,sensitivity,contribution,share"


def shown(result: BudgetResult, *, detail: bool = False) -> str:
    return plain_text(document(result).blocks(detail=detail))


ONE = """
    quantity: {name: l, unit: mm}
    equation: a*b + c
    inputs:
      a: {value: 2, u: 0.1, dof: 8, unit: mm}
      b: {value: 3, half_width: 0.2, distribution: rectangular}
      c: {readings: [1.0, 1.2, 1.1, 1.3], u: 0.05, unit: mm}
      d: 7
"""
TWO = ONE.replace("quantity: {name: l, unit: mm}", "units: {s: mm}").replace(
    "equation: a*b + c", "equations: {s: a*b + c, p: a/b}"
)


@pytest.fixture(scope="module")
def one() -> BudgetResult:
    return evaluated(ONE)


@pytest.fixture(scope="module")
def two() -> BudgetResult:
    return evaluated(TWO)


def test_the_report_is_that_of_the_contract(one: BudgetResult) -> None:
    found = json.loads(report_bytes(document(one).record()))
    assert set(found) >= CONTRACT
    assert set(found["monte_carlo"]) >= MONTE_CARLO
    assert [set(row) >= ROW for row in found["rows"]] == [True] * 4
    assert found["value"] == pytest.approx(7.15)
    assert found["U"] == pytest.approx(found["k"] * found["u"])
    rows = {row["name"]: row for row in found["rows"]}
    assert rows["a"]["contribution"] == pytest.approx(0.3)
    assert rows["b"]["dof"] is None
    assert rows["c"]["type"] == "A+B"
    assert [part["type"] for part in rows["c"]["contributions"]] == ["A", "B"]
    assert rows["d"]["u"] == rows["d"]["contribution"] == 0.0
    assert sum(row["share"] for row in found["rows"]) == pytest.approx(1.0)
    squares = sum(row["contribution"] ** 2 for row in found["rows"])
    assert math.sqrt(squares) == pytest.approx(found["u"])


def test_several_outputs(two: BudgetResult) -> None:
    found = json.loads(report_bytes(document(two).record()))
    assert set(found["outputs"]) == {"s", "p"}
    assert all(set(item) >= CONTRACT for item in found["outputs"].values())
    assert found["outputs"]["s"]["unit"] == "mm"
    lines = csv_text(*document(two).rows()).splitlines()
    assert lines[0] == CSV_COLUMNS
    assert len(lines) == 1 + 2 * 4
    assert lines[1].startswith("s,a,mm,2.0,0.1,B,normal,8.0,")
    assert ",inf," in lines[2]
    V = np.array(found["covariance"])
    assert V[0, 0] == pytest.approx(found["outputs"]["s"]["u"] ** 2)
    r = np.array(found["correlation"])
    assert r[0, 1] == pytest.approx(V[0, 1] / math.sqrt(V[0, 0] * V[1, 1]))
    # By hand: u^2(a) - (a/b)^2 u^2(b), to first order.
    assert V[0, 1] == pytest.approx(0.01 - 4 / 9 * 0.04 / 3)


@pytest.mark.parametrize(
    "text",
    [
        ONE,
        TWO,
        "equation: abs(x)\ninputs: {x: {value: 0, u: 1}}\n",
        "equation: x\ninputs: {x: {value: 1, u: 1, dof: 1}}\n",
        "equation: " + "+".join(f"x{i}" for i in range(20)) + "\ninputs:\n"
        + "".join(f"  x{i}: {{value: 0, u: {i + 1}}}\n" for i in range(20)),
    ],
)  # fmt: skip
def test_figures_are_drawn(text: str) -> None:
    """Also without first order, with heavy tails, nothing uncertain or many inputs."""
    result = evaluated(text)
    page = figure(result)
    assert len(page.axes) == 2 * len(result.outputs)
    assert figure_bytes(page, ".png").startswith(b"\x89PNG")


def test_the_factor_of_the_interval_stands_beside_a_stated_one() -> None:
    """U is k u with the 2 asked for, the 95.45 % interval takes t of 4 degrees of freedom, 2.87.

    JCGM 100:2008, table G.2: 2.87 for 4 degrees of freedom and 95.45 %.
    """
    text = "equation: x\ninputs: {x: {value: 0, u: 1, dof: 4}}\ncoverage: {k: 2}\n"
    lines = " ".join(shown(evaluated(text)).split())
    assert "y = 0.0 ± 2.0 (k = 2.00)" in lines
    assert "95.45 %; of first order: value ± k u with k = 2.87 (t of 4 dof)" in lines
    normal = evaluated(text.replace(", dof: 4", ""))
    assert "with k = 2.00 (normal)" in " ".join(shown(normal).split())


def test_correlations_of_inputs_are_reported_and_a_footer_explains_no_missing_column() -> None:
    text = "equation: a*b\ninputs: {a: {value: 2, u: 1}, b: {value: 3, u: 1}, c: 7}\n"
    found = document(evaluated(text + "correlations: [[a, b, 0.5]]\n"))
    assert found.record()["input_correlation"]["inputs"] == ["a", "b", "c"]
    matrix = np.array(found.record()["input_correlation"]["matrix"])
    np.testing.assert_allclose(matrix[:2, :2], [[1.0, 0.5], [0.5, 1.0]])
    assert "share" in plain_text(found.blocks())
    assert "share" not in shown(evaluated(text.replace("u: 1", "u: 0")))
