"""Figures of graph simulate and sweep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.graph.simulate import GraphSimulation, SimulatedCoordinate
from mtu_cli.analyses.graph.surface import Formula
from mtu_cli.analyses.graph.sweep import GridPoint, Sweep
from mtu_cli.reports import figures
from mtu_cli.reports.graph_convergence import chance_text
from mtu_cli.reports.graph_simulate import shares_text, small_unit
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import significant, with_u
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.distributions import log_density
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = 20
"""Characters of a coordinate's name."""
SHOWN = 9
"""Coordinates drawn on one sheet."""
INSIDE, BESIDE = 6, 14
"""Lines named inside the panel, and beside it."""
CURVE = 200
"""Points of a formula's curve."""
HEADROOM = 1.08
"""The axis over the highest mark, so that none touches the edge."""


@figures.styled
def simulated(result: GraphSimulation) -> Figure:
    """Histogram of the trials of every coordinate about its nominal, interval, first order."""
    shown = [item for item in result.coordinates if not item.fixed][:SHOWN]
    columns = min(3, max(1, len(shown)))
    rows = max(1, math.ceil(len(shown) / columns))
    page = figures.blank(max(5.0, 3.6 * columns), 0.8 + 2.7 * rows)
    panels = page.subplots(rows, columns, squeeze=False).ravel()
    for panel, item in zip(panels, shown, strict=False):
        (_bars if item.chance else _histogram)(panel, item)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    known: dict[str, Artist] = {}
    for panel in panels:
        for handle, name in zip(*panel.get_legend_handles_labels(), strict=True):
            known.setdefault(str(name), handle)
    page.legend(list(known.values()), list(known), loc="outside lower center", ncols=2)
    return page


def _bars(panel: Axes, item: SimulatedCoordinate) -> None:
    """How often a place is 0, and how often 1."""
    panel.bar([0, 1], [1 - item.mean, item.mean], width=0.6, color=figures.PALE)
    panel.set_xticks([0, 1])
    panel.set_ylim(0.0, 1.0)
    panel.set_xlabel("value of the place")
    name = str(item.output)
    chance = chance_text(item.mean, item.errors.mean, item.trials)
    panel.set_title(f"{cut(name, NAME)}: chance of 1 {chance}")


def _histogram(panel: Axes, item: SimulatedCoordinate) -> None:
    factor, unit = small_unit(item.output.unit)
    values = (item.samples - item.nominal) * factor
    left, right = np.quantile(values, [0.0005, 0.9995])
    if not right > left:
        # Nearly all trials have one value.
        left, right = values.min() - 1e-9, values.max() + 1e-9
    bins = np.linspace(left, right, 61)
    density = np.histogram(values, bins)[0] / (len(values) * np.diff(bins))
    panel.stairs(density, bins, fill=True, color=figures.PALE, label="Monte Carlo trials")
    u = item.first_order_u * factor
    if u > 0:
        grid = np.linspace(left, right, 300)
        curve = np.exp(log_density(grid / u, math.inf)) / u
        panel.plot(grid, curve, color=figures.INK, label="first order")
        for sign, label in ((-1, None), (1, "95 % interval, first order")):
            end = sign * coverage_factor(0.95) * u
            panel.axvline(end, color=figures.INK, lw=0.9, ls=(0, (4, 3)), label=label)
    low, high = ((end - item.nominal) * factor for end in item.interval)
    panel.axvspan(low, high, ymax=0.03, color=figures.BLUE, label="95 % interval, Monte Carlo")
    panel.set_xlim(left, right)
    panel.set_ylim(0.0, None)
    panel.set_yticks([])
    shares = shares_text(item.shares)
    known = "" if shares == "-" else f"\n{shares} % of u²"
    panel.set_xlabel(f"from nominal, {unit}{known}")
    name = str(item.output)
    panel.set_title(f"{cut(name, NAME)}: u {significant(item.u * factor)} {unit}")


@figures.styled
def swept(result: Sweep) -> Figure:
    """u, or the chance, against the first of what is varied, a line for each value of the rest;
    dots are Monte Carlo with two standard errors, curves the formula.
    """
    factor, unit = (1.0, "") if result.chance else small_unit(result.output.unit)
    names = [name for name, values in result.varied.items() if len(values) > 1]
    names = names or list(result.varied)
    first, rest = names[0], names[1:]
    page = figures.blank(6.4, 4.4)
    panel = page.subplots()
    groups: dict[tuple[float, ...], list[int]] = {}
    for i, item in enumerate(result.grid):
        groups.setdefault(tuple(item.at[name] for name in rest), []).append(i)
    shades = np.linspace(0.25, 0.95, len(groups))
    from matplotlib import colormaps

    for shade, (key, members) in zip(shades, groups.items(), strict=True):
        colour = colormaps["Blues"](shade) if len(groups) > 1 else figures.BLUE
        points = [result.grid[i] for i in members]
        label = ", ".join(f"{n} {v:g}" for n, v in zip(rest, key, strict=True)) or None
        _dots(panel, result, points, first, factor, colour, label)
    panel.set_xlabel(first)
    short = cut(str(result.output), NAME)
    panel.set_ylabel(f"chance that {short} is 1" if result.chance else f"u of {short}, {unit}")
    if not result.chance:
        # A jump that no trial saw has u 0 and no standard error.
        reached = [item.u + 2 * item.se_u for item in result.grid if math.isfinite(item.se_u)]
        top = max(reached, default=0.0) * factor
        panel.set_ylim(0.0, HEADROOM * top if top > 0 else None)
    if result.formula is not None:
        numbers = ", ".join(
            f"{name} = {with_u(value, None)[0]}"
            for name, value in result.formula.coefficients.items()
        )
        panel.set_title(f"{result.formula.form}\n{numbers}", fontweight="normal")
    what = f"Chance that {short} is 1" if result.chance else f"Uncertainty of {short}"
    page.suptitle(f"{what} over {first}", x=0.012, ha="left", fontsize=10.5, fontweight="bold")
    if rest:
        _legend(panel)
    return page


def _legend(panel: Axes) -> None:
    """Inside of a few lines; of many beside them, lightest and darkest and some between."""
    handles, names = panel.get_legend_handles_labels()
    if len(handles) <= INSIDE:
        panel.legend()
        return
    kept = spread(len(handles), BESIDE)
    some = "" if len(kept) == len(handles) else f"{len(kept)} of {len(handles)} lines"
    panel.legend(
        [handles[i] for i in kept], [names[i] for i in kept], title=some,
        loc="center left", bbox_to_anchor=(1.0, 0.5),
    )  # fmt: skip


def _dots(
    panel: Axes,
    result: Sweep,
    points: Sequence[GridPoint],
    first: str,
    factor: float,
    colour: object,
    label: str | None,
) -> None:
    """Points of the grid that differ in `first` alone, and what joins them."""
    x = [item.at[first] for item in points]
    y, se = np.array([_dot(item, result.chance) for item in points]).T * factor
    form: dict[str, Any] = {"color": colour, "label": label}
    panel.errorbar(x, y, 2 * se, fmt="o-" if result.chance else "o", ms=4, **form)
    if result.formula is not None:
        fine, curve = _curve(result.formula, points, first)
        panel.plot(fine, curve * factor, color=form["color"])


def _dot(item: GridPoint, chance: bool) -> tuple[float, float]:
    """What is drawn of a point of the grid, and its standard error."""
    return (item.mean, item.se_mean) if chance else (item.u, item.se_u)


def _curve(
    formula: Formula, points: Sequence[GridPoint], first: str
) -> tuple[FloatArray, FloatArray]:
    """The formula between grid points that differ in `first` alone."""
    x = [item.at[first] for item in points]
    fine = np.linspace(min(x), max(x), CURVE)
    at = {name: np.full(CURVE, value) for name, value in points[0].at.items()}
    return fine, formula.u_at({**at, first: fine}, CURVE)
