"""Figures of graph simulate and sweep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.graph.simulate import GraphSimulation, SimulatedCoordinate
from mtu_cli.analyses.graph.sweep import GridPoint, Sweep
from mtu_cli.findings import listed
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Spread
from mtu_cli.reports.graph_layout import shares_text, small_unit
from mtu_cli.reports.labels import cut, spread
from mtu_cli.reports.numbers import chance_text, significant, with_u
from mtu_cli.stats.coverage import coverage_factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME, LONG = 20, 60
"""Characters of a coordinate's name, and of a graph's."""
SHOWN, SEEN = 9, 1e-3
"""Coordinates drawn on one sheet, each with at least this part of the largest u of its unit."""
INSIDE, BESIDE = 6, 14
"""Lines named inside the panel, and beside it."""
CURVE = 200
"""Points of a formula's curve."""
HEADROOM = 1.08
"""The axis over the highest mark, so that none touches the edge."""


@figures.styled
def simulated(result: GraphSimulation) -> Figure:
    """Histogram of the trials of every coordinate about its nominal, interval, first order."""
    varying = [item for item in result.coordinates if not item.fixed]
    largest: dict[str, float] = {}
    for item in varying:
        unit = item.output.unit
        largest[unit] = max(largest.get(unit, 0.0), item.u)
    seen = [x for x in varying if x.chance or x.u >= SEEN * largest[x.output.unit]][:SHOWN]
    columns = figures.columns_of(len(seen))
    rows = max(1, math.ceil(len(seen) / columns))
    page = figures.blank(max(6.0, 3.6 * columns), 1.1 + 2.6 * rows)
    panels = figures.panels_of(page, max(1, len(seen)), columns)
    for panel, item in zip(panels, seen, strict=False):
        (_bars if item.chance else _histogram)(panel, item)
    figures.legend(page, 4 if columns > 1 else 2)
    rest = [str(item.output) for item in varying if item not in seen]
    without = f" (not drawn: {listed(rest, 4)})" if rest else ""
    figures.title(page, f"{cut(result.graph.graph.name, LONG)}: scatter of the results{without}")
    return page


def _bars(panel: Axes, item: SimulatedCoordinate) -> None:
    """How often a place is 0, and how often 1."""
    panel.bar([0, 1], [1 - item.mean, item.mean], width=0.6, color=figures.PALE)
    panel.set_xticks([0, 1])
    panel.set_ylim(0.0, 1.0)
    panel.set_xlabel("value of the place")
    chance = chance_text(item.mean, item.errors.mean, item.trials)
    panel.set_title(f"{cut(str(item.output), NAME)}: chance of 1 {chance}")


def _histogram(panel: Axes, item: SimulatedCoordinate) -> None:
    factor, unit = small_unit(item.output.unit)
    low, high = ((end - item.nominal) * factor for end in item.interval)
    u = item.first_order_u * factor
    half = coverage_factor(0.95) * u
    spread = Spread(
        samples=(item.samples - item.nominal) * factor, interval=(low, high),
        first=(0.0, u, math.inf), first_interval=(-half, half),
    )  # fmt: skip
    figures.histogram(panel, spread)
    shares = shares_text(item.shares)
    panel.set_xlabel(f"from nominal, {unit}" + ("" if shares == "-" else f"\n{shares} % of u²"))
    panel.set_title(f"{cut(str(item.output), NAME)}: u {significant(item.u * factor)} {unit}")


@figures.styled
def swept(result: Sweep) -> Figure:
    """u, or the chance, against the first of what is varied, a line for each value of the rest;
    dots are Monte Carlo with two standard errors, curves the formula.
    """
    from matplotlib import colormaps

    names = [name for name, values in result.varied.items() if len(values) > 1]
    first, *rest = names or list(result.varied)
    lines: dict[str, list[GridPoint]] = {}
    for item in result.grid:
        lines.setdefault(", ".join(f"{n} {item.at[n]:g}" for n in rest), []).append(item)
    page = figures.blank(6.4, 4.4)
    panel = page.subplots()
    for shade, (label, points) in zip(
        np.linspace(0.25, 0.95, len(lines)), lines.items(), strict=True
    ):
        colour = colormaps["Blues"](shade) if len(lines) > 1 else figures.BLUE
        _line(panel, result, points, first, colour, label)
    panel.set_xlabel(first)
    short = cut(str(result.output), NAME)
    what, label = f"Chance that {short} is 1", f"chance that {short} is 1"
    if not result.chance:
        factor, unit = small_unit(result.output.unit)
        what, label = f"Uncertainty of {short}", f"u of {short}, {unit}"
        # A jump that no trial saw has u 0 and no standard error.
        reached = [item.u + 2 * item.se_u for item in result.grid if math.isfinite(item.se_u)]
        panel.set_ylim(0.0, HEADROOM * factor * max(reached, default=0.0) or None)
    panel.set_ylabel(label)
    if result.formula is not None:
        pairs = result.formula.coefficients.items()
        numbers = ", ".join(f"{name} = {with_u(value, None)[0]}" for name, value in pairs)
        panel.set_title(f"{result.formula.form}\n{numbers}", fontweight="normal")
    figures.title(page, f"{what} over {first}")
    if rest:
        _legend(panel)
    return page


def _legend(panel: Axes) -> None:
    """Inside of a few lines; of many beside them, lightest and darkest and some between."""
    handles, names = panel.get_legend_handles_labels()
    kept = spread(len(handles), BESIDE)
    some = "" if len(kept) == len(handles) else f"{len(kept)} of {len(handles)} lines"
    chosen = [handles[i] for i in kept], [names[i] for i in kept]
    if len(handles) <= INSIDE:
        panel.legend(*chosen)
    else:
        panel.legend(*chosen, title=some, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _line(
    panel: Axes, result: Sweep, points: Sequence[GridPoint], first: str, colour: object, label: str
) -> None:
    """Points of the grid that differ in `first` alone, and what joins them."""
    factor = 1.0 if result.chance else small_unit(result.output.unit)[0]
    pairs = [(x.mean, x.se_mean) if result.chance else (x.u, x.se_u) for x in points]
    x, (y, se) = [item.at[first] for item in points], np.array(pairs).T * factor
    form: dict[str, Any] = {"color": colour, "label": label or None}
    panel.errorbar(x, y, 2 * se, fmt="o-" if result.chance else "o", ms=4, **form)
    if result.formula is not None:
        fine = np.linspace(min(x), max(x), CURVE)
        at = {name: np.full(CURVE, value) for name, value in points[0].at.items()}
        curve = result.formula.u_at({**at, first: fine}, CURVE)
        panel.plot(fine, curve * factor, color=form["color"])
