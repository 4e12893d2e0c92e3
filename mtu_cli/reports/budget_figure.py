"""The figure of a budget: shares of the variance, and the Monte Carlo beside the first order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.budget.first_order import OutputBudget
from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut, folded
from mtu_cli.reports.numbers import significant, with_u
from mtu_cli.stats.distributions import log_density
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 4
"""Outputs drawn on one sheet."""
BARS = 12
"""Inputs drawn, the largest shares first; the others are one bar."""
FAR = 1e5
"""Of values that differ by less than this part only what differs is written at the ticks."""
TITLE = 50
"""Characters of one line of a title."""
NAME = 24
"""Characters of a name."""
DASHES = (0, (4, 3))
NARROWEST = 1e-12
"""Relative width of a histogram that is more than rounding."""


@figures.styled
def figure(result: BudgetResult) -> Figure:
    """For every output a bar an input, and beside it the histogram of the trials."""
    shown = result.outputs[:SHOWN]
    bars = min(BARS + 1, len(result.inputs))
    page = figures.blank(10.0, 0.9 + len(shown) * max(2.6, 0.26 * bars + 1.2))
    panels = page.subplots(len(shown), 2, squeeze=False)
    for index, output in enumerate(shown):
        _shares(panels[index][0], result, output)
        _histogram(panels[index][1], result, output, index)
    handles, names = panels[0][1].get_legend_handles_labels()
    page.legend(handles, names, loc="outside lower center", ncols=4)
    return page


def _shares(panel: Axes, result: BudgetResult, output: OutputBudget) -> None:
    shares = 100.0 * output.first.share
    panel.set_title(f"{cut(output.first.name, NAME)}: shares of the variance")
    panel.grid(visible=False, axis="y")
    if not np.all(np.isfinite(shares)):
        panel.set_yticks([])
        panel.set_xticks([])
        panel.text(0.5, 0.5, "no first-order variance", ha="center", transform=panel.transAxes)
        return
    order = [int(i) for i in np.argsort(-np.abs(shares), kind="stable") if result.inputs[i].u > 0]
    names = [result.inputs[i].name for i in order[:BARS]]
    values = [float(shares[i]) for i in order[:BARS]]
    if len(order) > BARS:
        names.append(f"{len(order) - BARS} others")
        values.append(float(sum(shares[i] for i in order[BARS:])))
    places = np.arange(len(values))
    colours = [figures.BLUE if value >= 0 else figures.ORANGE for value in values]
    panel.barh(places, values, color=colours, height=0.7)
    panel.set_yticks(places, [folded(name, NAME) for name in names])
    panel.invert_yaxis()
    panel.set_xlabel("share of u², %")
    panel.axvline(0.0, color=figures.GREY, linewidth=0.8)
    reach = max(map(abs, values), default=1.0) or 1.0
    for place, value in zip(places, values, strict=True):
        text = f" {value:.1f} " if abs(value) >= 0.05 else " 0 "
        side = "left" if value >= 0 else "right"
        panel.text(value, float(place), text, va="center", ha=side, fontsize=8)
    low = min(0.0, *values) if values else 0.0
    panel.set_xlim(low - (0.14 * reach if low < 0 else 0.0), max(0.0, *values) + 0.14 * reach)


def _histogram(panel: Axes, result: BudgetResult, output: OutputBudget, index: int) -> None:
    run, first = result.run, output.first
    values = run.samples[index]
    low, high = float(run.low[index]), float(run.high[index])
    percent = f"{100 * result.probability:.4g} %"
    left, right = _frame(values, low, high, output)
    bins = np.linspace(left, right, 81)
    if right - left > NARROWEST * max(abs(left), abs(right)):
        density = np.histogram(values, bins)[0] / (len(values) * np.diff(bins))
        panel.stairs(density, bins, fill=True, color=figures.PALE, label="Monte Carlo trials")
        panel.set_xlim(left, right)
        panel.set_ylim(0.0, 1.08 * float(density.max()) or 1.0)
    if first.u > 0.0:
        grid = np.linspace(left, right, 400)
        curve = np.exp(log_density((grid - first.value) / first.u, first.dof)) / first.u
        panel.plot(grid, curve, color=figures.INK, label="first order")
        panel.set_ylim(0.0, max(panel.get_ylim()[1], 1.08 * float(curve.max())))
        for end in output.interval:
            panel.axvline(end, color=figures.INK, linewidth=1.0, linestyle=DASHES)
        panel.plot(
            [], [], color=figures.INK, linewidth=1.0, linestyle=DASHES,
            label=f"{percent}, first order",
        )  # fmt: skip
    panel.axvspan(low, high, ymax=0.03, color=figures.BLUE, label=f"{percent}, Monte Carlo")
    panel.set_yticks([])
    panel.locator_params(axis="x", nbins=5)
    offset = max(abs(left), abs(right)) > FAR * (right - left)
    panel.ticklabel_format(axis="x", useOffset=offset, scilimits=(-4, 9))
    unit = f", {output.unit}" if output.unit else ""
    panel.set_xlabel(f"{cut(first.name, NAME)}{unit}")
    panel.set_title(_headline(result, output, index))


def _frame(
    values: FloatArray, low: float, high: float, output: OutputBudget
) -> tuple[float, float]:
    """Wide enough for all but the far tails and both intervals, and no wider than that."""
    left, right = (float(end) for end in np.quantile(values, [0.001, 0.999]))
    width = high - low
    left, right = max(left, low - width), min(right, high + width)
    if output.first.u > 0.0:
        reach = 1.1 * output.k_probability * output.first.u
        left, right = min(left, output.first.value - reach), max(right, output.first.value + reach)
    return left, right


def _headline(result: BudgetResult, output: OutputBudget, index: int) -> str:
    first = output.first
    value, _ = with_u(first.value, first.u if first.u > 0.0 else None)
    own = float(result.run.u[index])
    unit = f" {output.unit}" if output.unit else ""
    found = f"{cut(first.name, NAME)} = {value}{unit}"
    if math.isfinite(first.u):
        found += f", u = {significant(first.u)}{unit}"
    if math.isfinite(own):
        found += f", by Monte Carlo {significant(own)}{unit}"
    else:
        found += ", none by Monte Carlo"
    return found if len(found) <= TITLE else found.replace(", ", "\n", 1)
