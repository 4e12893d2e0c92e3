"""Pictures of Monte Carlo trials and the first order: angles, budgets, graphs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.reports import figures
from mtu_cli.reports.graph_drawing import shares_text, small_unit
from mtu_cli.reports.numbers import cut, significant, spread, with_u
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from mtu_cli.analyses.budget import BudgetResult
    from mtu_cli.analyses.graph import GraphSimulation, GridPoint, Sweep

BINS, MARGIN = 50, 0.25
"""Of a histogram; beyond both intervals it shows this part of them."""
OUTPUTS, COORDINATES = 4, 9
"""Quantities drawn on one sheet."""
SHARES = 12
"""Inputs drawn, the largest shares first."""
SEEN = 1e-3
"""Coordinates drawn have at least this part of the largest u of their unit."""
NAME, TITLE = 24, 50
"""Characters of a name, and of one line of a title."""
LINES = 14
"""Lines of a sweep that are named."""


def histogram(
    panel: figures.Axes, title: str, label: str, samples: FloatArray, ends: Sequence[float],
    first: tuple[float, float, float], probability: float = PROBABILITY,
) -> None:  # fmt: skip
    """The density of the trials with the `ends` of their interval, and the curve of the `first`
    order by value, u and degrees of freedom (u 0: none).
    """
    (value, u, dof), percent = first, f"{100 * probability:.4g} %"
    half = coverage_factor(probability, dof) * u if u > 0.0 else 0.0
    first_ends = [value - half, value + half] if u > 0.0 else []
    low, high = min([*ends, *first_ends]), max([*ends, *first_ends])
    room = max(MARGIN * (high - low), 1e-6 * max(abs(low), abs(high)), 1e-300)
    limits = low - room, high + room
    panel.hist(
        samples, BINS, range=limits, density=True, histtype="stepfilled",
        color=figures.PALE, label="Monte Carlo trials",
    )  # fmt: skip
    if u > 0.0:
        from scipy.stats import t

        grid = np.linspace(*limits, 400)
        curve = t.pdf(grid, dof, loc=value, scale=u)
        panel.plot(grid, curve, color=figures.INK, label="first order")
        for end in first_ends:
            panel.axvline(end, color=figures.INK, lw=1, ls="--", label=f"{percent}, first order")
    panel.axvspan(ends[0], ends[1], ymax=0.03, color=figures.BLUE, label=f"{percent}, Monte Carlo")
    panel.set(xlim=limits, yticks=[], xlabel=label, title=title)
    panel.locator_params(axis="x", nbins=5)


def histograms(text: str, trials: Sequence[tuple[Any, ...]]) -> figures.Figure:
    """A page of histograms, each of its arguments."""
    count, columns = max(1, len(trials)), max(1, min(len(trials), 3))
    page = figures.blank(max(6.5, 3.7 * columns), 1.2 + 2.6 * math.ceil(count / columns))
    for panel, item in zip(figures.panels_of(page, count, columns), trials, strict=False):
        histogram(panel, *item)
    figures.legend(page, 2)
    figures.title(page, text)
    return page


@figures.styled
def budget(result: BudgetResult) -> figures.Figure:
    """For every output the shares of the inputs as bars, and the histogram of the trials."""
    outputs, run = result.outputs[:OUTPUTS], result.run
    height = max(2.4, 0.26 * (1 + min(SHARES, len(result.given.quantities))) + 1.2)
    page = figures.blank(10.0, 0.9 + len(outputs) * height)
    panels = page.subplots(len(outputs), 2, squeeze=False)
    for (chart, hist), item, samples in zip(panels, outputs, run.samples, strict=False):
        name, unit = cut(item.name, NAME), f" {item.unit}" if item.unit else ""
        # None where there is no first order.
        shares = np.nan_to_num(100.0 * item.share)
        order = np.argsort(-np.abs(shares), kind="stable")[:SHARES].tolist()
        names = [cut(result.given.quantities[i].name, NAME) for i in order]
        figures.bars(chart, names, shares[order], [f"{shares[i]:.1f}" for i in order])
        chart.set(xlabel="share of u², %", title=f"{name}: shares of the variance")
        text = f"{name} = {with_u(item.value, item.u or None)[0]}{unit}\nu = {significant(item.u)}"
        text += f", by Monte Carlo {significant(item.of_run('u'))}{unit}"
        ends, curve = (item.of_run("low"), item.of_run("high")), (item.value, item.u, item.dof)
        label = name + unit.replace(" ", ", ", 1)
        histogram(hist, text, label, samples, ends, curve, run.probability)
    figures.legend(page)
    return page


@figures.styled
def simulation(result: GraphSimulation) -> figures.Figure:
    """Histogram of the trials of every coordinate about its nominal, interval, first order."""
    variables = [item for item in result.coordinates if not item.fixed]
    maxima = [max(y.u for y in variables if y.output.unit == x.output.unit) for x in variables]
    selection = [x for x, u in zip(variables, maxima, strict=True) if x.u >= SEEN * u][:COORDINATES]
    trials = []
    for item in selection:
        factor, unit = small_unit(item.output.unit)
        ends, u = [end * factor for end in item.deviations], item.first_order_u * factor
        samples = (item.samples - item.nominal) * factor
        text = f"{cut(str(item.output), NAME)}: u {significant(item.u * factor)} {unit}"
        of = f"from nominal, {unit}\n{shares_text(item.shares)} % of u²"
        trials.append((text, of, samples, ends, (0.0, u, math.inf)))
    few = f" ({len(selection)} of {len(variables)})" if len(selection) < len(variables) else ""
    return histograms(f"{cut(result.graph.graph.name, TITLE)}: scatter of the results{few}", trials)


@figures.styled
def sweep_curves(result: Sweep) -> figures.Figure:
    """u by Monte Carlo with two standard errors over the first varied parameter, a line for each
    value of the others.
    """
    names = [name for name, values in result.varied.items() if len(values) > 1]
    first, *rest = names or list(result.varied)
    lines: dict[str, list[GridPoint]] = {}
    for item in result.grid:
        lines.setdefault(", ".join(f"{n} {item.at[n]:g}" for n in rest), []).append(item)
    page = figures.blank(6.4 + 1.6 * bool(rest), 4.4)
    panel, short = page.subplots(), cut(str(result.output), NAME)
    factor, unit = small_unit(result.output.unit)
    indices = spread(len(lines), LINES)
    for i, ((label, points), colour) in enumerate(
        zip(lines.items(), figures.shades(len(lines)), strict=True)
    ):
        y, se = np.nan_to_num([(point.u, point.se_u) for point in points]).T * factor
        panel.errorbar(
            [item.at[first] for item in points], y, 2 * se, fmt="o-", ms=4, color=colour,
            label=label if i in indices else None,
        )  # fmt: skip
    panel.set(xlabel=first, ylabel=f"u of {short}, {unit}", ylim=(0, None))
    if result.formula is not None:
        panel.set_title(result.formula.form, fontweight="normal")
    figures.title(page, f"Uncertainty of {short} over {first}")
    if rest:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), reverse=True)
    return page
