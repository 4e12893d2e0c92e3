"""The report of budget: first and second order and Monte Carlo, one row an input."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from mtu_cli.analyses.budget import BudgetResult, OutputBudget
from mtu_cli.findings import listed
from mtu_cli.reports import figures, numbers
from mtu_cli.reports.document import Document, Table
from mtu_cli.reports.fields import Field, Fields, declare, rows_of
from mtu_cli.reports.numbers import cut, interval, plus_minus, significant, with_u

SHOWN = 4
"""Outputs of which the verdict states the value, and that are drawn."""
INPUTS_DRAWN, NAME_LENGTH = 12, 24
"""Inputs drawn, the largest shares first; characters of a name in a picture."""
INPUT = """
    - | name | name of the output | OUTPUT, text, csv=output
    name | inputs.name | name of the input | input, text
    unit | inputs.unit | unit of its value | unit, text
    value | inputs.value | estimate | value, u=inputs.u
    u | inputs.u | standard uncertainty | u
    type | inputs.type | A from readings, else B | type, text
    distribution | inputs.kind | kind of distribution, of each contribution | distribution, text
    dof | inputs.dof | degrees of freedom; null: infinite | -, json
    - | stated_dof() | degrees of freedom; inf: infinite | -, csv=dof
    sensitivity | | derivative of the output by the input, c
    contribution | | |c| u, in the unit of the output
    share | | share of u^2, with half of every covariance that it has a part in; below \
        0 where the input makes u smaller
    -. | uncertain()
        - | inputs.dof | | dof, dof
        - | sensitivity | | sensitivity, sig4
        - | contribution | | contribution / UNIT
        - | share | | share / %, percent1
    contributions[] | parts()
        says | | what it is, in words
        u | distribution.u | standard uncertainty
        type | type() | A from readings, else B
        distribution | distribution.kind | kind of distribution
        dof | distribution.dof | degrees of freedom; null: infinite
"""


def row(unit: str = "", *, several: bool = False) -> Fields:
    """The figures of one input of an output in `unit`; an exact input needs no sensitivity."""
    return declare(
        INPUT,
        OUTPUT="output" if several else "-",
        UNIT=unit,
        stated_dof=lambda x: "inf" if math.isinf(x.inputs.dof) else x.inputs.dof,
        uncertain=lambda x: x if x.inputs.u else None,
        parts=lambda x: x.inputs.parts if len(x.inputs.parts) > 1 else (),
        type=lambda part: "A" if part.type_a else "B",
    )


ROW = row()
ONE = declare(
    """
    name | | name of the output; where it is the only one its figures stand in `results` itself, \
        without `outputs`
    unit | | unit of the output
    equation | | its measurement model; numbers may be spelled otherwise than in the file
    value | | value at the estimates of the inputs
    u | | standard uncertainty of first order (JCGM 100, 5.1.2)
    second_order.value | second_value | value to the second order
    second_order.u | second_u | standard uncertainty to the second order
    dof_effective | dof | effective degrees of freedom (Welch-Satterthwaite); null: infinite
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
        converged | run.converged | whether they reached the digits asked for
        first_order_valid | validation.passed | whether the first-order interval agrees with that \
            of the trials (JCGM 101, clause 8); null: too few trials to decide
        validation.k | k_probability | coverage factor of the first-order interval
        validation.d_low | | difference of the lower ends
        validation.d_high | | difference of the upper ends
        validation.tolerance | | largest difference allowed
        se_mean | se_mean() | standard error of the mean
        se_u | se_u() | standard error of u
    """,
    row=ROW,
    lines=lambda item: rows_of(item, len(item.inputs)),
    **{x: partial(OutputBudget.of_run, name=x) for x in ("u", "se_mean", "se_u")},
)
INPUTS = declare(
    """
    input_correlation.inputs | names() | names of the inputs
    input_correlation.matrix | given.correlation | their correlation coefficients
    """,
    names=lambda result: [item.name for item in result.given.quantities],
)
OUTPUTS = declare(
    """
    outputs{} | by_name() | *output
    covariance | | of the outputs, first order (JCGM 102, 6.2)
    correlation | | of the outputs, first order
    """,
    output=ONE,
    by_name=lambda result: {x.name: x for x in result.outputs},
)
RESULTS: Fields = (*OUTPUTS, *INPUTS)
SINGLE: Fields = (*declare("-. | outputs.0 | *output", output=ONE), *INPUTS)
ESTIMATE = declare("""
    - | output.name | | output, text
    - | method | | method, text
    - | value | | value, u=u
    - | u | | u
    - | output.unit | | unit, text
    - | dof | | dof, dof
    - | k | | k, sig3
    - | U | | U, u=U
    - | interval | | interval, interval, u=ends_u
    - | shortest | | shortest, interval, u=ends_u, detail
""")
COLUMNS = "output", "method", "value", "u", "interval", "shortest", "ends_u", "dof", "k", "U"


def _estimates(item: OutputBudget) -> list[dict[str, Any]]:
    """By method; intervals are rounded to `ends_u`."""
    u, (low, high) = item.of_run("u"), item.symmetric
    # A few trials far out give a u to which an interval of 95 % is nothing.
    ends_u = u if u <= high - low or low == high else 0.25 * (high - low)
    first = None, item.u, None if math.isnan(item.dof) else item.dof, item.k, item.expanded
    rows: list[tuple[Any, ...]] = [
        (item, "first order", item.value, item.u, item.interval, *first),
        (item, "second order", item.second_value, item.second_u, *[None] * 6),
        (item, "Monte Carlo", item.mean, u, item.symmetric, item.shortest, ends_u, *[None] * 3),
    ]
    return [dict(zip(COLUMNS, each, strict=True)) for each in rows]


def document(result: BudgetResult, digits: int = 2) -> Document:
    """One row an input of each output, and each output by three methods."""
    outputs, single, percent = result.outputs, result.single, 100 * result.run.probability
    units = {item.unit for item in outputs}
    fields = row(units.pop() if len(units) == 1 else "", several=not single)
    lines = [line for item in outputs for line in rows_of(item, len(item.inputs))]
    models = [f"{item.name} = {item.equation}" for item in outputs]
    if any(math.isfinite(line.share) for line in lines if line.inputs.u):
        models.append("share of u^2: half of every covariance belongs to each of its two inputs")
    contributions = Table(f"{result.name}: contributions", fields, lines, "\n".join(models))
    rows = [each for item in outputs for each in _estimates(item)]
    footer = f"intervals for {percent:.4g} %; of first order: value ± k u with "
    footer += f"the k for {percent:.4g} %, " + listed(map(_factor, outputs))
    estimates = Table(f"{result.name}: result", ESTIMATE, rows, footer)
    fields = declare("- | outputs.name | | output, text")
    for i, item in enumerate(outputs):
        fields.append(Field("", f"correlation.{i}", head=item.name, show="fix4"))
    items = rows_of(result, len(outputs)) if len(outputs) > 1 else []
    correlation = Table("Correlation of the outputs, first order", fields, items)
    return Document(
        "Uncertainty budget",
        (SINGLE if single else RESULTS, result),
        [contributions, estimates, correlation],
        figure,
        _verdict(result, percent, digits),
        digits,
    )


def _factor(item: OutputBudget) -> str:
    """The coverage factor of the first-order interval, whatever U has."""
    if math.isnan(item.dof):
        return "k undefined"
    of = "normal" if math.isinf(item.dof) else f"t of {numbers.degrees_of_freedom(item.dof)} dof"
    return f"k = {significant(item.k_probability, 3)} ({of})"


def _verdict(result: BudgetResult, percent: float, digits: int) -> str:
    """Values with U, or the intervals of the Monte Carlo where first order is not valid."""
    texts = []
    for item in result.outputs[:SHOWN]:
        unit, u = f" {item.unit}" if item.unit else "", item.of_run("u")
        if item.validation.passed is False:
            mean, ends = with_u(item.mean, u, digits)[0], interval(*item.symmetric, u, digits)
            text = f"{mean}{unit}, {percent:.4g} % interval {ends} (Monte Carlo: first order is "
            text += "not valid by JCGM 101, clause 8)"
        else:
            value = plus_minus(item.value, item.expanded, digits)
            text = f"{value}{unit} (k = {significant(item.k, 3)})"
        texts.append(f"{item.name} = {text}")
    if (more := len(result.outputs) - SHOWN) > 0:
        texts.append(f"and {more} more")
    verdict = "; ".join(texts) + "."
    undecided = listed([x.name for x in result.outputs if x.validation.passed is None])
    if undecided:
        return f"{verdict} Too few trials to validate first order for {undecided}."
    if all(item.validation.passed for item in result.outputs):
        return f"{verdict} First order is valid (JCGM 101, clause 8)."
    return verdict


def figure(result: BudgetResult) -> figures.Figure:
    """For every output the shares of the inputs as bars, and the histogram of the trials."""
    outputs, run = result.outputs[:SHOWN], result.run
    height = max(2.4, 0.26 * (1 + min(INPUTS_DRAWN, len(result.given.quantities))) + 1.2)
    page = figures.blank(10.0, 0.9 + len(outputs) * height)
    panels = page.subplots(len(outputs), 2, squeeze=False)
    for (chart, hist), item, samples in zip(panels, outputs, run.samples, strict=False):
        name, unit = cut(item.name, NAME_LENGTH), f" {item.unit}" if item.unit else ""
        # None where there is no first order.
        shares = np.nan_to_num(100.0 * item.share)
        order = np.argsort(-np.abs(shares), kind="stable")[:INPUTS_DRAWN].tolist()
        names = [cut(result.given.quantities[i].name, NAME_LENGTH) for i in order]
        figures.bars(chart, names, shares[order], [f"{shares[i]:.1f}" for i in order])
        chart.set(xlabel="share of u², %", title=f"{name}: shares of the variance")
        text = f"{name} = {with_u(item.value, item.u or None)[0]}{unit}\nu = {significant(item.u)}"
        text += f", by Monte Carlo {significant(item.of_run('u'))}{unit}"
        ends, curve = (item.of_run("low"), item.of_run("high")), (item.value, item.u, item.dof)
        label = name + unit.replace(" ", ", ", 1)
        figures.histogram(hist, text, label, samples, ends, curve, run.probability)
    figures.legend(page)
    return page
