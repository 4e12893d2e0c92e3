"""Pictures of Monte Carlo trials beside the first order: orthogonality, budget, graphs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.graph_drawing import shares_text, small_unit
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import significant, with_u
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mtu_cli.analyses.budget import BudgetResult
    from mtu_cli.analyses.graph import GraphSimulation, GridPoint, Sweep
    from mtu_cli.analyses.orthogonality import OrthogonalityResult

BINS, MARGIN = 50, 0.25
"""Of a histogram; beyond both intervals it shows this part of them."""
CLOSE = 1e5
"""Values that differ by less than this part of them have ticks that show only what differs."""
ANGLES, OUTPUTS, COORDINATES = 6, 4, 9
"""Quantities drawn on one sheet."""
SHARES, LEAST = 12, 0.05
"""Inputs drawn, the largest shares first, each at least so many percent; one bar for the others."""
SEEN = 1e-3
"""Coordinates drawn have at least this part of the largest u of their unit."""
NAME, TITLE = 24, 50
"""Characters of a name, and of one line of a title."""
LINES, CURVE, HEADROOM = 14, 200, 1.08
"""Lines of a sweep that are named, points of a formula's curve, room above the highest mark."""


def histogram(
    panel: Axes,
    samples: FloatArray,
    ends: Sequence[float],
    first: tuple[float, float, float],
    first_ends: Sequence[float],
    percent: str = "95 %",
) -> None:
    """The density of the trials with the `ends` of their interval, and the curve of first order
    (value, u, dof) with its ends; u 0: none.
    """
    value, u, dof = first
    known = [*ends, *first_ends] if u > 0.0 else [*ends]
    room = max(MARGIN * (max(known) - min(known)), 1e-6 * max(map(abs, known)), 1e-300)
    left, right = min(known) - room, max(known) + room
    bins = np.linspace(left, right, BINS + 1)
    density = np.histogram(samples, bins)[0] / (len(samples) * np.diff(bins))
    panel.stairs(density, bins, fill=True, color=figures.PALE, label="Monte Carlo trials")
    if u > 0.0:
        from scipy.stats import t

        grid = np.linspace(left, right, 400)
        curve = t.pdf(grid, dof, loc=value, scale=u)
        panel.plot(grid, curve, color=figures.INK, label="first order")
        style: dict[str, Any] = {"color": figures.INK, "lw": 1.0, "linestyle": (0, (4, 3))}
        for end in first_ends:
            panel.axvline(end, label=f"{percent}, first order", **style)
    panel.axvspan(ends[0], ends[1], ymax=0.03, color=figures.BLUE, label=f"{percent}, Monte Carlo")
    panel.set_xlim(left, right)
    panel.set_ylim(0.0, None)
    panel.set_yticks([])
    panel.spines["left"].set_visible(False)
    panel.locator_params(axis="x", nbins=5)
    offset = max(abs(left), abs(right)) > CLOSE * (right - left)
    panel.ticklabel_format(axis="x", useOffset=offset, scilimits=(-4, 9))


@figures.styled
def orthogonality(result: OrthogonalityResult) -> Figure:
    """Histogram of the trials of every angle, its interval, and the first-order curve."""
    shown = result.angles[:ANGLES]
    columns = figures.columns_of(len(shown), 2)
    page = figures.blank((6.5, 11.0)[columns - 1], 1.0 + 3.0 * math.ceil(len(shown) / columns))
    for panel, item in zip(figures.panels_of(page, len(shown), columns), shown, strict=False):
        run, first, scale = item.run, item.first_order, item.scale / ARCSEC
        ends = float(run.low[0] / ARCSEC), float(run.high[0] / ARCSEC)
        curve = first.mean / ARCSEC, first.u / ARCSEC, first.dof
        first_ends = [x / ARCSEC for x in first.interval95]
        histogram(panel, run.samples[0] / ARCSEC, ends, curve, first_ends)
        mean, u = with_u(run.mean[0] / ARCSEC, scale)[0], significant(run.u[0] / ARCSEC)
        panel.set_title(f"{cut(item.id, NAME)}: mean {mean}, u {u} arcsec")
        panel.set_xlabel("angle minus 90 degrees, arcsec")
    figures.legend(page)
    return page


@figures.styled
def budget(result: BudgetResult) -> Figure:
    """For every output a bar an input, and beside it the histogram of the trials."""
    shown, percent, run = result.outputs[:OUTPUTS], f"{100 * result.probability:.4g} %", result.run
    height = max(2.4, 0.26 * (1 + min(SHARES, len(result.inputs))) + 1.2)
    page = figures.blank(10.0, 0.9 + len(shown) * height)
    panels = page.subplots(len(shown), 2, squeeze=False)
    for (left, right), output in zip(panels, shown, strict=True):
        first, i, unit = output.first, output.index, f" {output.unit}" if output.unit else ""
        name = cut(first.name, NAME)
        _shares(left, result, 100.0 * first.share)
        left.set_title(f"{name}: shares of the variance")
        ends, curve = (float(run.low[i]), float(run.high[i])), (first.value, first.u, first.dof)
        histogram(right, run.samples[i], ends, curve, [float(x) for x in output.interval], percent)
        right.set_xlabel(name + unit.replace(" ", ", ", 1))
        text = f"{name} = {with_u(first.value, first.u or None)[0]}{unit}"
        u, by_trials = significant(first.u), significant(float(run.u[i]))
        right.set_title(f"{text}\nu = {u}, by Monte Carlo {by_trials}{unit}")
    figures.legend(page)
    return page


def _shares(panel: Axes, result: BudgetResult, shares: FloatArray) -> None:
    """The largest shares of the variance; the others in one bar where that is more than nothing."""
    if not np.all(np.isfinite(shares)):
        panel.set_axis_off()
        panel.text(0.5, 0.5, "no first-order variance", ha="center", transform=panel.transAxes)
        return
    order = [int(i) for i in np.argsort(-np.abs(shares), kind="stable") if result.inputs[i].u > 0]
    drawn = [i for i in order[:SHARES] if abs(shares[i]) >= LEAST]
    bars = {cut(result.inputs[i].name, NAME): float(shares[i]) for i in drawn}
    rest = order[len(drawn) :]
    if abs(others := float(shares[rest].sum())) >= LEAST:
        bars["1 other" if len(rest) == 1 else f"{len(rest)} others"] = others
    figures.bars(panel, list(bars), list(bars.values()), [f"{x:.1f}" for x in bars.values()])
    panel.set_xlabel("share of u², %")


@figures.styled
def simulated(result: GraphSimulation) -> Figure:
    """Histogram of the trials of every coordinate about its nominal, interval, first order."""
    varying = [item for item in result.coordinates if not item.fixed]
    largest: dict[str, float] = {}
    for item in varying:
        largest[item.output.unit] = max(largest.get(item.output.unit, 0.0), item.u)
    seen = [x for x in varying if x.u >= SEEN * largest[x.output.unit]][:COORDINATES]
    columns, count = figures.columns_of(len(seen)), max(1, len(seen))
    page = figures.blank(max(6.0, 3.6 * columns), 1.1 + 2.6 * math.ceil(count / columns))
    for panel, item in zip(figures.panels_of(page, count, columns), seen, strict=False):
        factor, unit = small_unit(item.output.unit)
        ends, u = [end * factor for end in item.deviations], item.first_order_u * factor
        half = coverage_factor(0.95) * u
        samples = (item.samples - item.nominal) * factor
        histogram(panel, samples, ends, (0.0, u, math.inf), (-half, half))
        of = shares_text(item.shares)
        panel.set_xlabel(f"from nominal, {unit}" + ("" if of == "-" else f"\n{of} % of u²"))
        name = cut(str(item.output), NAME)
        panel.set_title(f"{name}: u {significant(item.u * factor)} {unit}")
    figures.legend(page, 4 if columns > 1 else 2)
    rest = [str(item.output) for item in varying if item not in seen]
    without = f" (not drawn: {listed(rest, 4)})" if rest else ""
    figures.title(page, f"{cut(result.graph.graph.name, TITLE)}: scatter of the results{without}")
    return page


@figures.styled
def swept(result: Sweep) -> Figure:
    """u against the first of what is varied, a line for each value of the rest;
    dots are Monte Carlo with two standard errors, curves the formula.
    """
    from matplotlib import colormaps

    names = [name for name, values in result.varied.items() if len(values) > 1]
    first, *rest = names or list(result.varied)
    lines: dict[str, list[GridPoint]] = {}
    for item in result.grid:
        lines.setdefault(", ".join(f"{n} {item.at[n]:g}" for n in rest), []).append(item)
    page = figures.blank(6.4 + 1.6 * bool(rest), 4.4)
    panel, formula, short = page.subplots(), result.formula, cut(str(result.output), NAME)
    factor, unit = small_unit(result.output.unit)
    named = set(spread(len(lines), LINES))
    for i, (label, points) in enumerate(lines.items()):
        shade = 0.35 + 0.6 * i / max(len(lines) - 1, 1)
        colour = colormaps["Blues"](shade) if len(lines) > 1 else figures.BLUE
        x = [item.at[first] for item in points]
        y, se = np.array([(point.u, point.se_u) for point in points]).T * factor
        panel.errorbar(
            x, y, 2 * se, fmt="o", ms=4, color=colour, label=label if i in named else None
        )
        if formula is not None:
            at = {name: np.full(CURVE, value) for name, value in points[0].at.items()}
            at[first] = np.linspace(min(x), max(x), CURVE)
            panel.plot(at[first], formula.u_at(at, CURVE) * factor, color=colour)
    panel.set_xlabel(first)
    panel.set_ylabel(f"u of {short}, {unit}")
    reached = [item.u + 2 * item.se_u for item in result.grid]
    panel.set_ylim(0.0, HEADROOM * factor * max(reached) or None)
    if formula is not None:
        panel.set_title(formula.form, fontweight="normal")
    figures.title(page, f"Uncertainty of {short} over {first}")
    if rest:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), reverse=True)
    return page
