"""The report of budget: first and second order, Monte Carlo beside it, one row an input.

`u`, `mean` and `se_*` of the Monte Carlo are null where they do not exist (a t distribution of
two degrees of freedom or fewer); `dof_effective` and `dof` null are infinite. A row's
`contribution` is |sensitivity| u; its `share` of u^2 counts half of every covariance it has a
part in, so that shares sum to 1 and may be below 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.budget.first_order import OutputBudget
from mtu_cli.analyses.budget.quantities import InputQuantity, Part
from mtu_cli.analyses.budget.warnings import has_shortest
from mtu_cli.reports.document import finite, matrix


def document(result: BudgetResult) -> dict[str, Any]:
    """`results` of the report: of the one output, or `outputs` by name."""
    found = [_output(result, index) for index in range(len(result.outputs))]
    shared: dict[str, Any] = {
        "input_correlation": {
            "inputs": [item.name for item in result.inputs],
            "matrix": matrix(result.input_correlation),
        }
    }
    if result.single:
        return {"name": result.outputs[0].first.name} | found[0] | shared
    names = [item.first.name for item in result.outputs]
    return {
        "outputs": dict(zip(names, found, strict=True)),
        "covariance": matrix(result.covariance),
        "correlation": matrix(result.correlation),
        "monte_carlo_covariance": matrix(result.run.covariance),
        **shared,
    }


def _output(result: BudgetResult, index: int) -> dict[str, Any]:
    item = result.outputs[index]
    first = item.first
    return {
        "unit": item.unit,
        "value": finite(first.value),
        "u": finite(first.u),
        "second_order": {"value": finite(first.second_value), "u": finite(first.second_u)},
        "dof_effective": finite(first.dof),
        "k": finite(item.k),
        "U": finite(item.expanded),
        "rows": [row(item, which, other) for which, other in enumerate(result.inputs)],
        "monte_carlo": _monte_carlo(result, item, index),
    }


def row(output: OutputBudget, which: int, item: InputQuantity) -> dict[str, Any]:
    """One input's line of an output's budget."""
    first = output.first
    c = float(first.sensitivity[which])
    return {
        "name": item.name,
        "unit": item.unit,
        "value": finite(item.value),
        "u": finite(item.u),
        "type": item.type,
        "distribution": item.kind,
        "dof": finite(item.dof),
        "sensitivity": finite(c),
        "contribution": finite(float(first.contribution[which])),
        "share": finite(float(first.share[which])),
        "contributions": [_part(part) for part in item.parts] if len(item.parts) > 1 else [],
    }


def _part(part: Part) -> dict[str, Any]:
    own = part.distribution
    return {
        "says": part.says,
        "u": finite(own.u),
        "type": "A" if part.type_a else "B",
        "distribution": own.kind,
        "dof": finite(own.dof),
    }


def _monte_carlo(result: BudgetResult, item: OutputBudget, index: int) -> dict[str, Any]:
    run, verdict = result.run, item.validation
    # Without a variance the sample mean does not settle either, or not to be relied on.
    exists = bool(np.isfinite(run.u[index]))
    return {
        "mean": finite(run.mean[index]) if exists else None,
        "u": finite(run.u[index]),
        "interval": [finite(end) for end in ends(result, index)],
        "shortest": [finite(end) for end in ends(result, index, shortest=True)],
        "probability": result.probability,
        "trials": run.trials,
        "converged": result.converged,
        "first_order_valid": verdict.passed,
        "validation": {
            "k": finite(item.k_probability),
            "d_low": finite(verdict.d_low),
            "d_high": finite(verdict.d_high),
            "tolerance": finite(verdict.tolerance),
        },
        "se_mean": finite(run.se_mean[index]),
        "se_u": finite(run.se_u[index]),
        "se_low": finite(run.se_low[index]),
        "se_high": finite(run.se_high[index]),
        "gain": {name: finite(values[index]) for name, values in run.gain._asdict().items()},
    }


def ends(result: BudgetResult, index: int, *, shortest: bool = False) -> tuple[float, float]:
    """The Monte Carlo interval of an output; a single value where nothing varies.

    nan for a shortest interval that is none.
    """
    run = result.run
    if run.u[index] == 0.0:
        # Weights of ordered values leave their rounding on equal ones.
        return float(run.mean[index]), float(run.mean[index])
    if shortest and not has_shortest(run, index):
        return math.nan, math.nan
    if shortest:
        return float(run.shortest_low[index]), float(run.shortest_high[index])
    return float(run.low[index]), float(run.high[index])


CSV_COLUMNS = [
    "output", "name", "unit", "value", "u", "type", "distribution", "dof", "sensitivity",
    "contribution", "share",
]  # fmt: skip


def csv_rows(result: BudgetResult) -> tuple[list[str], Iterable[list[object]]]:
    """One row an output and input, the fields of `rows`; infinite degrees of freedom as inf."""
    return CSV_COLUMNS, (
        _csv(output, which, item)
        for output in result.outputs
        for which, item in enumerate(result.inputs)
    )


def _csv(output: OutputBudget, which: int, item: InputQuantity) -> list[object]:
    found = row(output, which, item)
    cells: list[object] = [output.first.name, *(found[name] for name in CSV_COLUMNS[1:])]
    if math.isinf(item.dof):
        cells[CSV_COLUMNS.index("dof")] = "inf"
    return cells
