"""The figure of a budget: shares of the variance, and the Monte Carlo beside the first order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.budget.first_order import OutputBudget
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Spread
from mtu_cli.reports.labels import cut, folded
from mtu_cli.reports.numbers import significant, with_u

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 4
"""Outputs drawn on one sheet."""
BARS, LEAST = 12, 0.05
"""Inputs drawn, the largest shares first, each at least so many percent; one bar for the others."""
TITLE, NAME = 50, 24
"""Characters of one line of a title, and of a name."""


@figures.styled
def figure(result: BudgetResult) -> Figure:
    """For every output a bar an input, and beside it the histogram of the trials."""
    shown = result.outputs[:SHOWN]
    bars = min(BARS + 1, len(result.inputs))
    page = figures.blank(10.0, 0.9 + len(shown) * max(2.6, 0.26 * bars + 1.2))
    panels = page.subplots(len(shown), 2, squeeze=False)
    for index, output in enumerate(shown):
        _shares(panels[index][0], result, output)
        run, first = result.run, output.first
        left, right = output.interval
        spread = Spread(
            samples=run.samples[index],
            interval=(float(run.low[index]), float(run.high[index])),
            first=(first.value, first.u, first.dof),
            first_interval=(float(left), float(right)),
            percent=f"{100 * result.probability:.4g} %",
        )
        figures.histogram(panels[index][1], spread)
        unit = f", {output.unit}" if output.unit else ""
        panels[index][1].set_xlabel(f"{cut(first.name, NAME)}{unit}")
        panels[index][1].set_title(_headline(result, output, index))
    figures.legend(page)
    return page


def _shares(panel: Axes, result: BudgetResult, output: OutputBudget) -> None:
    shares = 100.0 * output.first.share
    panel.set_title(f"{cut(output.first.name, NAME)}: shares of the variance")
    if not np.all(np.isfinite(shares)):
        panel.set_axis_off()
        panel.text(0.5, 0.5, "no first-order variance", ha="center", transform=panel.transAxes)
        return
    order = [int(i) for i in np.argsort(-np.abs(shares), kind="stable") if result.inputs[i].u > 0]
    drawn = [i for i in order[:BARS] if abs(shares[i]) >= LEAST]
    rest = order[len(drawn) :]
    names = [folded(result.inputs[i].name, NAME) for i in drawn]
    values = [float(shares[i]) for i in drawn]
    if rest:
        names.append("1 other" if len(rest) == 1 else f"{len(rest)} others")
        values.append(float(sum(shares[i] for i in rest)))
    texts = [f"{value:.1f}" if abs(value) >= LEAST else "0" for value in values]
    figures.bars(panel, names, values, texts)
    panel.set_xlabel("share of u², %")


def _headline(result: BudgetResult, output: OutputBudget, index: int) -> str:
    first, u = output.first, float(result.run.u[index])
    value, _ = with_u(first.value, first.u if first.u > 0.0 else None)
    unit = f" {output.unit}" if output.unit else ""
    text = f"{cut(first.name, NAME)} = {value}{unit}"
    if math.isfinite(first.u):
        text += f", u = {significant(first.u)}{unit}"
    text += (
        f", by Monte Carlo {significant(u)}{unit}" if math.isfinite(u) else ", none by Monte Carlo"
    )
    return text if len(text) <= TITLE else text.replace(", ", "\n", 1)
