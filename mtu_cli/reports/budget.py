"""The report of budget: first and second order, Monte Carlo beside them, one row an input.

Values are in the unit of each output or input, as the budget file has them.
"""

from __future__ import annotations

import math
from typing import Any

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.budget.result import Line, OutputBudget
from mtu_cli.findings import listed
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, Group, rows_of
from mtu_cli.reports.numbers import fixed, interval, plus_minus, significant, with_u

SHOWN = 4
"""Outputs of which the verdict states the value."""


def _uncertain(name: str) -> Any:
    """A quantity that an exact input has no need of."""
    return lambda line: None if line.input.u == 0.0 else getattr(line, name)


def _stated_dof(line: Line) -> float | str:
    return "inf" if math.isinf(line.input.dof) else line.input.dof


CONTRIBUTION: Fields = (
    Field("says", meaning="what it is, in words"),
    Field("u", "distribution.u", "standard uncertainty"),
    Field("type", lambda part: "A" if part.type_a else "B", "A from readings, else B"),
    Field("distribution", "distribution.kind", "kind of distribution"),
    Field("dof", "distribution.dof", "degrees of freedom; null: infinite"),
)


def row(unit: str = "", *, several: bool = False) -> Fields:
    """The figures of one input of an output in `unit`."""
    return (
        Field(
            "",
            "output",
            "name of the output",
            csv="output",
            head="output" if several else "",
            show="text",
        ),
        Field("name", "input.name", "name of the input", head="input", show="text"),
        Field("unit", "input.unit", "unit of its value", head="unit", show="text"),
        Field("value", "input.value", "estimate", head="value", u="input.u"),
        Field("u", "input.u", "standard uncertainty", head="u"),
        Field("type", "input.type", "A from readings, else B", head="type", show="text"),
        Field(
            "distribution",
            "input.kind",
            "kind of distribution, of each contribution",
            head="distribution",
            show="text",
        ),
        Field("dof", "input.dof", "degrees of freedom; null: infinite", csv=""),
        Field("", _stated_dof, "degrees of freedom; inf: infinite", csv="dof"),
        Field(
            "",
            lambda line: None if line.input.u == 0.0 else line.input.dof,
            head="dof",
            show="dof",
        ),
        Field("sensitivity", meaning="derivative of the output by the input, c"),
        Field(
            "",
            _uncertain("sensitivity"),
            head="sensitivity",
            show=lambda value, u, digits: significant(value, 4),
        ),
        Field("contribution", meaning="|c| u, in the unit of the output"),
        Field("", _uncertain("contribution"), head=f"contribution\n{unit}"),
        Field(
            "share",
            meaning="share of u^2, with half of every covariance that it has a part in; below 0 "
            "where the input makes u smaller",
        ),
        Field("", _uncertain("share"), head="share\n%", show=lambda x, u, d: fixed(100 * x, 1)),
        Group(
            "contributions",
            CONTRIBUTION,
            lambda line: line.input.parts if len(line.input.parts) > 1 else (),
            many=True,
        ),
    )


def _of_run(name: str) -> Any:
    return lambda item: item.of_run(name)


MONTE_CARLO: Fields = (
    Field("mean", meaning="mean of the trials; null where it does not exist"),
    Field("u", _of_run("u"), "their standard deviation; null where it does not exist"),
    Field("interval", "symmetric", "interval with equal chances beyond either end"),
    Field("shortest", meaning="shortest interval"),
    Field("probability", "run.probability", "coverage probability of the intervals"),
    Field("trials", "run.trials", "number of trials"),
    Field("converged", meaning="whether they reached the digits asked for"),
    Field(
        "first_order_valid",
        "validation.passed",
        "whether the first-order interval agrees with that of the trials (JCGM 101, clause 8); "
        "null: too few trials to decide",
    ),
    Field("validation.k", "k_probability", "coverage factor of the first-order interval"),
    Field("validation.d_low", meaning="difference of the lower ends"),
    Field("validation.d_high", meaning="difference of the upper ends"),
    Field("validation.tolerance", meaning="largest difference allowed"),
    *(
        Field(f"se_{name}", _of_run(f"se_{name}"), f"standard error of {what}")
        for name, what in (
            ("mean", "the mean"),
            ("u", "u"),
            ("low", "the lower end"),
            ("high", "the upper end"),
        )
    ),
    Field(
        "gain",
        lambda item: {name: x[item.index] for name, x in item.run.gain._asdict().items()},
        "how many times fewer trials the control variate needs, by statistic",
    ),
)
OUTPUT: Fields = (
    Field("unit", meaning="unit of the output"),
    Field("value", "first.value", "value at the estimates of the inputs"),
    Field("u", "first.u", "standard uncertainty of first order (JCGM 100, 5.1.2)"),
    Field("second_order.value", "first.second_value", "value to the second order"),
    Field("second_order.u", "first.second_u", "standard uncertainty to the second order"),
    Field(
        "dof_effective",
        "first.dof",
        "effective degrees of freedom (Welch-Satterthwaite); null: infinite",
    ),
    Field("k", meaning="coverage factor"),
    Field("U", "expanded", "expanded uncertainty k u"),
    Group("rows", row(), "lines", many=True),
    Group("monte_carlo", MONTE_CARLO, ""),
)
INPUTS: Fields = (
    Field(
        "input_correlation.inputs",
        lambda result: [item.name for item in result.inputs],
        "names of the inputs",
    ),
    Field("input_correlation.matrix", "input_correlation", "their correlation coefficients"),
)
OUTPUTS: Fields = (
    Group(
        "outputs",
        OUTPUT,
        lambda result: {x.first.name: x for x in result.outputs},
        many=True,
        named=True,
    ),
    Field("covariance", meaning="of the outputs, first order (JCGM 102, 6.2)"),
    Field("correlation", meaning="of the outputs, first order"),
    Field("monte_carlo_covariance", "run.covariance", "of the outputs, by the trials"),
)
ESTIMATE: Fields = (
    Field("", "output", head="output", show="text"),
    Field("", "method", head="method", show="text"),
    Field("", "value", head="value", u="u"),
    Field("", "u", head="u"),
    Field("", "unit", head="unit", show="text"),
    Field("", "dof", head="dof", show="dof"),
    Field("", "k", head="k", show=lambda value, u, digits: significant(value, 3)),
    Field("", "U", head="U", u="U"),
    Field("", "interval", head="interval", show="interval", u="ends_u"),
    Field("", "shortest", head="shortest", show="interval", u="ends_u", detail=True),
)
ROW = row()
RESULTS: Fields = (
    Field(
        "name",
        "outputs.0.first.name",
        "name of the output; of a single one its figures stand here, without `outputs`",
    ),
    *OUTPUTS,
    *INPUTS,
)


def document(result: BudgetResult, digits: int = 2) -> Document:
    """One row an input of each output, and each output by three methods."""
    from mtu_cli.reports import monte_carlo_figures

    units = {item.unit for item in result.outputs}
    contributions = Table(
        title=f"{result.name}: contributions",
        fields=row(units.pop() if len(units) == 1 else "", several=not result.single),
        items=[line for item in result.outputs for line in item.lines],
        footer="share of u^2: half of every covariance belongs to each of its two inputs",
    )
    estimates = Table(
        title=f"{result.name}: result",
        fields=ESTIMATE,
        items=[each for item in result.outputs for each in item.estimates],
        footer=f"intervals for {100 * result.probability:.4g} %; of first order: value ± k u with "
        f"{listed(map(_factor, result.outputs))}",
        notes=[f"{result.run.trials} trials; {_errors(item)}" for item in result.outputs],
    )
    names = [item.first.name for item in result.outputs]
    correlation = Table(
        title="Correlation of the outputs, first order",
        fields=(
            Field("", "outputs.first.name", head="output", show="text"),
            *(
                Field("", f"correlation.{i}", head=name, show=lambda r, u, d: fixed(r, 4))
                for i, name in enumerate(names)
            ),
        ),
        items=rows_of(result, len(names)) if len(names) > 1 else [],
    )
    named = (RESULTS[:1], result)
    return Document(
        title=result.name,
        results=(OUTPUT, result.outputs[0]) if result.single else (OUTPUTS, result),
        also=[(INPUTS, result), *([named] if result.single else [])],
        tables=[contributions, estimates, correlation],
        figure=lambda: monte_carlo_figures.budget(result),
        verdict=_verdict(result, digits),
        digits=digits,
    )


def _factor(item: OutputBudget) -> str:
    """The coverage factor of the first-order interval, whatever U has."""
    dof = item.first.dof
    if math.isnan(dof):
        return "k undefined"
    of = "normal" if math.isinf(dof) else f"t of {dof:.3g} dof"
    return f"k = {significant(item.k_probability, 3)} ({of})"


def _errors(item: OutputBudget) -> str:
    errors = [significant(item.of_run(f"se_{name}")) for name in ("mean", "u", "low", "high")]
    return f"standard errors of mean, u and ends of {item.first.name}: {', '.join(errors)}"


def _verdict(result: BudgetResult, digits: int) -> str:
    values = [_stated(item, result.probability, digits) for item in result.outputs[:SHOWN]]
    more = len(result.outputs) - SHOWN
    stated = "; ".join([*values, *([f"and {more} more"] if more > 0 else [])])
    undecided = listed([x.first.name for x in result.outputs if x.validation.passed is None])
    if undecided:
        return f"{stated}. Too few trials to validate first order for {undecided}."
    if all(item.validation.passed for item in result.outputs):
        return f"{stated}. First order is valid (JCGM 101, clause 8)."
    return f"{stated}."


def _stated(item: OutputBudget, probability: float, digits: int) -> str:
    """The value with U, or the interval of the Monte Carlo where first order is not valid."""
    unit = f" {item.unit}" if item.unit else ""
    if item.validation.passed is False:
        u = item.of_run("u")
        mean, ends = with_u(item.mean, u, digits)[0], interval(*item.symmetric, u, digits)
        return (
            f"{item.first.name} = {mean}{unit}, {100 * probability:.4g} % interval {ends} "
            "(Monte Carlo: first order is not valid by JCGM 101, clause 8)"
        )
    value = plus_minus(item.first.value, item.expanded, digits)
    return f"{item.first.name} = {value}{unit} (k = {significant(item.k, 3)})"
