"""The picture of close-loop: errors before and after, over what each effect depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.close_loop.result import FoundEffect, TableResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Maps, Side
from mtu_cli.reports.numbers import cut
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, ALONE, HIGH = 12.0, 5.4, 4.1
"""Inches of the page, of one map that is alone, and of the row of panels."""
EFFECTS, NAME, TITLE = 2, 24, 110
"""Effects that are drawn; letters of a name and of the title."""
SIDES = (("before", figures.ORANGE), ("after", figures.BLUE))


def figure(item: TableResult) -> Figure:
    """Mean errors before and after as arrows where points lie in a plane; errors over what each
    effect depends on (of none: part by part).
    """
    scale = UNITS[item.table.unit].to_internal
    stages = [item.table.errors / scale, (item.table.errors - item.explained) / scale]
    errors = stages[: 1 + bool(item.effects)]
    maps = _maps(item, errors)
    ratios = [HIGH] if maps is None else [maps.height, HIGH]
    page = figures.blank(WIDTH, sum(ratios) + 0.4)
    grid = page.add_gridspec(len(ratios), 1, height_ratios=ratios)
    *upper, lower = (page.add_subfigure(grid[i]) for i in range(len(ratios)))
    if maps is not None:
        maps.draw(upper[0], f"Mean errors of the {item.table.plurals[1]}")
    effects = item.effects[:EFFECTS] or (None,)
    panels = lower.subplots(1, len(effects), squeeze=False)[0]
    for panel, effect in zip(panels, effects, strict=True):
        _errors(panel, item, errors, effect)
    figures.legend(lower)
    of = "" if item.table.component is None else f" of {item.table.component}"
    figures.title(page, cut(f"Undeclared effects{of}: {item.verdict}", TITLE))
    return page


def _maps(item: TableResult, errors: list[FloatArray]) -> Maps | None:
    """Mean errors before and after, of each operation; None where there is no plane."""
    table = item.table
    if table.component is not None or not {"x", "y"} <= set(table.axes):
        return None
    at = [AXES.index(axis) for axis in table.axes]
    means = []
    for values in errors:
        mean = np.full((len(table.features), len(AXES)), np.nan)
        mean[:, at] = values.mean(axis=0, where=table.there[..., None])
        means.append(mean)
    groups = []
    for code, operation in enumerate(table.operations):
        mask = (table.operation != code)[:, None]
        sides = [
            Side(name if item.effects else "", colour, np.where(mask, np.nan, mean))
            for (name, colour), mean in zip(SIDES, means, strict=False)
        ]
        groups.append((operation, sides))
    width = WIDTH if len(groups) > 1 else ALONE
    return Maps(table.features, table.mean_places, table.axes, groups, width=width)


def _errors(
    panel: Axes, item: TableResult, errors: list[FloatArray], effect: FoundEffect | None
) -> None:
    """The errors before and after, over the column or place that an effect depends on, or part by
    part.
    """
    table = item.table
    P, H = table.there.shape
    label, x, a = f"{item.table.nouns[0]}, in order", np.arange(1.0, P + 1)[:, None], 0
    if effect is not None:
        axis, names = effect.candidate.axis, {p.name for p in effect.parameters}
        a = table.axes.index(axis) if axis in table.axes else 0
        columns = effect.used if effect.table is None else [effect.table.along]
        for name in sorted((n for n in columns if n not in names), key=lambda n: n not in AXES):
            if name in AXES:
                label, x = f"{name}, mm", table.places[..., AXES.index(name)]
            elif name in table.covariates:
                label, x = name, table.covariates[name]
                break
    x = np.broadcast_to(x, (P, H))
    there = table.there & np.isfinite(x)
    for (side, colour), values in zip(SIDES, errors, strict=False):
        panel.plot(
            x[there], values[..., a][there], ".", color=colour, markersize=3.0, alpha=0.45,
            label=f"error {side}" if item.effects else None,
        )  # fmt: skip
    panel.axhline(0.0, color=figures.GREY, linewidth=0.9)
    panel.set_xlabel(label)
    axis = "" if table.component is not None else f" of {table.axes[a]}"
    panel.set_ylabel(f"measured minus predicted{axis}, {table.unit}")
    panel.set_title("residuals" if effect is None else cut(effect.name, NAME))
