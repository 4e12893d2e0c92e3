"""The picture of close-loop: errors before and after, over what each effect depends on, and the
evidence for the candidates.
"""

from __future__ import annotations

from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.close_loop.result import CloseLoopResult, FoundEffect, Judged, TableResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.figures import Maps, Side
from mtu_cli.reports.numbers import cut, p_value
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HIGH = 12.0, 4.1
"""Inches of the page, and of the row of panels."""
CANDIDATES, EFFECTS, NAME, TITLE = 12, 2, 24, 110
"""Candidates and effects that are drawn; letters of a name and of the title."""
LEAST = -6.0
"""The bars of the evidence end here: anything less likely looks the same."""
SIDES = (("before", figures.ORANGE), ("after", figures.BLUE))


def figure(result: CloseLoopResult, item: TableResult) -> Figure:
    """Mean errors before and after as arrows where points lie in a plane; errors over what each
    effect depends on (of none: part by part); and the ranking.
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
    panels = lower.subplots(1, len(effects) + 1, squeeze=False)[0]
    for panel, effect in zip(panels, effects, strict=False):
        _errors(panel, item, errors, effect)
    figures.legend(lower)
    best, panel = ranked(item)[:CANDIDATES], panels[-1]
    in_class = {name for effect in item.effects for name in effect.class_names}
    labels = [cut(x.candidate.name, NAME) + "*" * (x.candidate.name in in_class) for x in best]
    values = [max(x.log_bayes_factor or 0.0, LEAST) for x in best]
    figures.bars(panel, labels, values, [f"p {p_value(x.p_familywise)}" for x in best])
    alpha = result.alpha / len(result.tables)
    panel.set_xlabel(f"natural log of the Bayes factor (gate: p {alpha:.2g})")
    panel.set_title("candidates" + ("; *: found, or in its class" if in_class else ""))
    names = "; ".join(" or ".join(e.class_names) for e in item.effects)
    of = "" if item.table.component is None else f" of {item.table.component}"
    text = f"Undeclared effects{of}: {item.verdict}{f' ({names})' if names else ''}"
    figures.title(page, shorten(text, TITLE, placeholder=" ..."))
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
    return Maps(table.features, table.mean_places, table.axes, groups)


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


def ranked(item: TableResult) -> list[Judged]:
    """The candidates that could be tested, the likeliest first."""
    candidates = [x for x in item.candidates if x.log_bayes_factor is not None]
    return sorted(candidates, key=lambda x: -(x.log_bayes_factor or 0.0))
