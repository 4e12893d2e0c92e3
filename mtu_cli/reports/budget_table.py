"""The tables of a budget: contributions, the result, and the outputs' correlation."""

from __future__ import annotations

import math

import numpy as np

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.budget.first_order import OutputBudget
from mtu_cli.analyses.budget.quantities import InputQuantity
from mtu_cli.reports.budget import ends
from mtu_cli.reports.numbers import (
    MISSING,
    degrees_of_freedom,
    fixed,
    interval,
    significant,
    with_u,
)
from mtu_cli.reports.tables import Column, Sheet

VERDICT = {True: "yes", False: "no", None: "not told"}
SHORT = {"curvilinear-trapezoidal": "curv. trap.", "rectangular": "rect.", "triangular": "triang.",
         "trapezoidal": "trapez."}  # fmt: skip

OF_COVARIANCE = (
    "share, of correlated inputs: (c_i u_i)^2 + sum over the others of c_i c_j u(x_i, x_j), over "
    "u^2. Each of two has half of what their covariance adds to u^2. 100 % in all, below 0 where "
    "an input makes u smaller"
)
"""c is the sensitivity: GUM eq. (13), by rows."""
LEAST_SHARE = 5e-4
"""Of a share, that is seen in the table."""

TOLD = 3
"""Digits more, at most, that tell two intervals apart."""


def table(result: BudgetResult, digits: int) -> list[Sheet]:
    """For every output its contributions and its result; with several their correlation."""
    sheets = []
    for index, output in enumerate(result.outputs):
        sheets.append(_contributions(result, output, digits))
        sheets.append(_result(result, index, digits))
    if len(result.outputs) > 1:
        sheets.append(_correlation(result))
    return sheets


def _contributions(result: BudgetResult, output: OutputBudget, digits: int) -> Sheet:
    of = f" ({output.unit})" if output.unit else ""
    columns = [
        Column(title="input\n", text=True, folds=True),
        Column(title="value\n"),
        Column(title="u\n"),
        Column(title="\n", text=True, folds=True),
        Column(title="type\n", text=True),
        Column(title="distribution\n", text=True, folds=True),
        Column(title="dof\n"),
        Column(title="sensitivity\n"),
        Column(title=f"contribution\n{output.unit}"),
        Column(title="share\n%"),
    ]
    rows = [_row(output, which, item, digits) for which, item in enumerate(result.inputs)]
    return Sheet(
        title=f"{result.name}: contributions to {output.first.name}{of}",
        columns=columns,
        rows=rows,
        notes=[OF_COVARIANCE] if _correlated(output) else [],
    )


def _correlated(output: OutputBudget) -> bool:
    """Whether the shares are not the squares of the contributions over that of u."""
    first = output.first
    if not first.u > 0.0:
        return False
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        apart = np.abs(first.share - (first.contribution / first.u) ** 2)
    return bool(np.any(apart > LEAST_SHARE))


def _row(output: OutputBudget, which: int, item: InputQuantity, digits: int) -> list[str]:
    c = float(output.first.sensitivity[which])
    share = float(output.first.share[which])
    value, u = with_u(item.value, item.u, digits)
    exact = item.u == 0.0
    kinds = " + ".join(SHORT.get(kind, kind) for kind in item.kind.split(" + "))
    return [
        item.name,
        value,
        u,
        item.unit,
        item.type or MISSING,
        kinds,
        MISSING if exact else degrees_of_freedom(item.dof),
        MISSING if exact else significant(c, 4),
        MISSING if exact else significant(float(output.first.contribution[which]), digits),
        MISSING if exact or math.isnan(share) else fixed(100 * share, 1),
    ]


def _result(result: BudgetResult, index: int, digits: int) -> Sheet:
    output = result.outputs[index]
    name = output.first.name + (f" ({output.unit})" if output.unit else "")
    percent = f"{100 * result.probability:.4g} % interval"
    titles = ("value", "u", "dof", "k", "U", percent, "shortest")
    of_ends = _of_ends(result, index, digits)
    return Sheet(
        title=f"{result.name}: result for {name}",
        columns=[Column(title=name, text=True), *(Column(title=title) for title in titles)],
        rows=[*_orders(output, digits, of_ends), _monte_carlo(result, index, digits, of_ends)],
        notes=_notes(result, index),
    )


def _of_ends(result: BudgetResult, index: int, digits: int) -> int:
    """The digits of the intervals: as many as tell that of Monte Carlo from that of first order,
    where it is to be taken instead.
    """
    output = result.outputs[index]
    low, high = ends(result, index)
    for more in range(1 + TOLD if output.validation.passed is False else 0):
        first = _first_interval(output, digits + more)
        # To the same place: the same ends to other digits are the same ends.
        if first != _rounded(output, (low, high), digits + more):
            return digits + more
    return digits


def _first_interval(output: OutputBudget, digits: int) -> str:
    return _rounded(output, output.interval, digits)


def _rounded(output: OutputBudget, found: tuple[float, float], digits: int) -> str:
    """Ends rounded as those of first order are."""
    low, high = output.interval
    return interval(*found, _scale(output.first.u, high - low), digits)


def _ends_text(result: BudgetResult, index: int, digits: int, *, shortest: bool) -> str:
    low, high = ends(result, index, shortest=shortest)
    return interval(low, high, _scale(float(result.run.u[index]), high - low), digits)


def _orders(output: OutputBudget, digits: int, of_ends: int) -> list[list[str]]:
    first = output.first
    shown = _known(first.u)
    return [
        [
            "first order",
            with_u(first.value, shown, digits)[0],
            significant(first.u, digits),
            MISSING if math.isnan(first.dof) else degrees_of_freedom(first.dof),
            significant(output.k, 3),
            significant(output.expanded, digits),
            _first_interval(output, of_ends),
            MISSING,
        ],
        [
            "second order",
            with_u(first.second_value, _known(first.second_u) or first.u, digits)[0],
            significant(first.second_u, digits),
            *[MISSING] * 5,
        ],
    ]


def _monte_carlo(result: BudgetResult, index: int, digits: int, of_ends: int) -> list[str]:
    run = result.run
    u = float(run.u[index])
    exists = math.isfinite(u)
    return [
        "Monte Carlo",
        with_u(float(run.mean[index]), _known(u), digits)[0] if exists else MISSING,
        significant(u, digits),
        *[MISSING] * 3,
        *(_ends_text(result, index, of_ends, shortest=shortest) for shortest in (False, True)),
    ]


def _scale(u: float, width: float) -> float | None:
    """An uncertainty to round the ends of an interval to.

    A few trials far out give a u to which an interval of 95 % is nothing: then a quarter of the
    interval's width, which is about u for a normal distribution.
    """
    return _known(u if u <= width or width == 0.0 else 0.25 * width)


def _known(u: float) -> float | None:
    """An uncertainty to round a value to; a value beside u = 0 or none is given in full."""
    return u if math.isfinite(u) and u > 0.0 else None


def _notes(result: BudgetResult, index: int) -> list[str]:
    run, output = result.run, result.outputs[index]
    errors = [run.se_mean[index], run.se_u[index], run.se_low[index], run.se_high[index]]
    own = ", ".join(significant(float(value)) for value in errors)
    passed = output.validation.passed
    verdict = f"{VERDICT[passed]}{', take the Monte Carlo interval' if passed is False else ''}"
    notes = []
    if not math.isclose(output.k, output.k_probability) and output.k_probability > 0.0:
        dof = output.first.dof
        of = "the normal distribution"
        if math.isfinite(dof):
            of = f"Student's t with {degrees_of_freedom(dof)} degrees of freedom"
        notes.append(
            f"U = k u with k = {significant(output.k, 3)}, as asked for; the "
            f"{100 * result.probability:.4g} % interval of first order takes k = "
            f"{significant(output.k_probability, 3)}, of {of}"
        )
    return [
        *notes,
        f"first order valid (JCGM 101, clause 8): {verdict}; {run.trials} trials, whose own "
        f"standard errors of mean, u and ends are {own}",
    ]


def _correlation(result: BudgetResult) -> Sheet:
    names = [item.first.name for item in result.outputs]
    rows = [
        [name, *(fixed(r, 4) for r in line)]
        for name, line in zip(names, result.correlation, strict=True)
    ]
    columns = [Column(title="", text=True), *(Column(title=name) for name in names)]
    return Sheet(title="correlation of the outputs, first order", columns=columns, rows=rows)
