"""The report of budget: first and second order, Monte Carlo beside them, one row an input."""

from __future__ import annotations

import math
from functools import partial

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.budget.result import OutputBudget
from mtu_cli.findings import listed
from mtu_cli.reports import monte_carlo_figures
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, RowOf, declare, rows_of
from mtu_cli.reports.numbers import interval, plus_minus, significant, with_u

SHOWN = 4
"""Outputs of which the verdict states the value."""
INPUT = """
    - | first.name | name of the output | OUTPUT, text, csv=output
    name | inputs.name | name of the input | input, text
    unit | inputs.unit | unit of its value | unit, text
    value | inputs.value | estimate | value, u=inputs.u
    u | inputs.u | standard uncertainty | u
    type | inputs.type | A from readings, else B | type, text
    distribution | inputs.kind | kind of distribution, of each contribution | distribution, text
    dof | inputs.dof | degrees of freedom; null: infinite | -, json
    - | stated_dof() | degrees of freedom; inf: infinite | -, csv=dof
    - | finite_dof() | | dof, dof
    sensitivity | first.sensitivity | derivative of the output by the input, c
    - | sensitivity() | | sensitivity, sig4
    contribution | first.contribution | |c| u, in the unit of the output
    - | contribution() | | contribution / UNIT
    share | first.share | share of u^2, with half of every covariance that it has a part in; below \
        0 where the input makes u smaller
    - | share() | | share / %, percent1
    contributions[] | parts()
        says | | what it is, in words
        u | distribution.u | standard uncertainty
        type | type() | A from readings, else B
        distribution | distribution.kind | kind of distribution
        dof | distribution.dof | degrees of freedom; null: infinite
"""


def row(unit: str = "", *, several: bool = False) -> Fields:
    """The figures of one input of an output in `unit`; an exact input needs no sensitivity."""
    text = INPUT.replace("OUTPUT", "output" if several else "-").replace("UNIT", unit)
    return declare(
        text,
        stated_dof=lambda x: "inf" if math.isinf(x.inputs.dof) else x.inputs.dof,
        finite_dof=lambda x: x.inputs.dof if x.inputs.u else None,
        sensitivity=lambda x: x.first.sensitivity if x.inputs.u else None,
        contribution=lambda x: x.first.contribution if x.inputs.u else None,
        share=lambda x: x.first.share if x.inputs.u else None,
        parts=lambda x: x.inputs.parts if len(x.inputs.parts) > 1 else (),
        type=lambda part: "A" if part.type_a else "B",
    )


ROW = row()
OUTPUT = """
    unit | | unit of the output
    value | first.value | value at the estimates of the inputs
    u | first.u | standard uncertainty of first order (JCGM 100, 5.1.2)
    second_order.value | first.second_value | value to the second order
    second_order.u | first.second_u | standard uncertainty to the second order
    dof_effective | first.dof | effective degrees of freedom (Welch-Satterthwaite); null: infinite
    k | | coverage factor
    U | expanded | expanded uncertainty k u
    rows[] | lines() | *row
    monte_carlo. | .
        mean | | mean of the trials; null where it does not exist
        u | u() | their standard deviation; null where it does not exist
        interval | symmetric | interval with equal chances beyond either end
        shortest | | shortest interval
        probability | run.probability | coverage probability of the intervals
        trials | run.trials | number of trials
        converged | | whether they reached the digits asked for
        first_order_valid | validation.passed | whether the first-order interval agrees with that \
            of the trials (JCGM 101, clause 8); null: too few trials to decide
        validation.k | k_probability | coverage factor of the first-order interval
        validation.d_low | | difference of the lower ends
        validation.d_high | | difference of the upper ends
        validation.tolerance | | largest difference allowed
        se_mean | se_mean() | standard error of the mean
        se_u | se_u() | standard error of u
        se_low | se_low() | standard error of the lower end
        se_high | se_high() | standard error of the upper end
"""


def _lines(item: OutputBudget) -> list[RowOf]:
    """A row an input."""
    return rows_of(item, len(item.inputs))


OF_RUN = {
    name: partial(OutputBudget.of_run, name=name)
    for name in ("u", "se_mean", "se_u", "se_low", "se_high")
}
ONE = declare(
    OUTPUT,
    row=ROW,
    lines=_lines,
    **OF_RUN,
)
INPUTS = declare(
    """
    input_correlation.inputs | names() | names of the inputs
    input_correlation.matrix | input_correlation | their correlation coefficients
    """,
    names=lambda result: [item.name for item in result.inputs],
)
OUTPUTS = declare(
    """
    outputs{} | by_name() | *output
    covariance | | of the outputs, first order (JCGM 102, 6.2)
    correlation | | of the outputs, first order
    monte_carlo_covariance | run.covariance | of the outputs, by the trials
    """,
    output=ONE,
    by_name=lambda result: {x.first.name: x for x in result.outputs},
)
NAME = declare("""
    name | outputs.0.first.name | name of the output; of a single one its figures stand here, \
        without `outputs`
""")
RESULTS: Fields = (*NAME, *OUTPUTS, *INPUTS)
ESTIMATE = declare("""
    - | output | | output, text
    - | method | | method, text
    - | value | | value, u=u
    - | u | | u
    - | unit | | unit, text
    - | dof | | dof, dof
    - | k | | k, sig3
    - | U | | U, u=U
    - | interval | | interval, interval, u=ends_u
    - | shortest | | shortest, interval, u=ends_u, detail
""")


def document(result: BudgetResult, digits: int = 2) -> Document:
    """One row an input of each output, and each output by three methods."""
    outputs, single = result.outputs, result.single
    units = {item.unit for item in outputs}
    fields = row(units.pop() if len(units) == 1 else "", several=not single)
    lines = [line for item in outputs for line in _lines(item)]
    footer = "share of u^2: half of every covariance belongs to each of its two inputs"
    contributions = Table(f"{result.name}: contributions", fields, lines, footer)
    rows = [each for item in outputs for each in item.estimates]
    footer = f"intervals for {100 * result.probability:.4g} %; of first order: value ± k u with "
    footer += listed(map(_factor, outputs))
    estimates = Table(f"{result.name}: result", ESTIMATE, rows, footer)
    fields = declare("- | outputs.first.name | | output, text")
    for i, item in enumerate(outputs):
        fields.append(Field("", f"correlation.{i}", head=item.first.name, show="fix4"))
    items = rows_of(result, len(outputs)) if len(outputs) > 1 else []
    correlation = Table("Correlation of the outputs, first order", fields, items)
    return Document(
        result.name,
        (ONE, outputs[0]) if single else (OUTPUTS, result),
        [contributions, estimates, correlation],
        partial(monte_carlo_figures.budget, result),
        _verdict(result, digits),
        digits,
        [(INPUTS, result), *[(NAME, result)] * single],
    )


def _factor(item: OutputBudget) -> str:
    """The coverage factor of the first-order interval, whatever U has."""
    dof = item.first.dof
    if math.isnan(dof):
        return "k undefined"
    of = "normal" if math.isinf(dof) else f"t of {dof:.3g} dof"
    return f"k = {significant(item.k_probability, 3)} ({of})"


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
