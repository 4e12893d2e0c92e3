"""A panel of residuals over what an effect depends on: cells, their means, the effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.close_loop_sealed.reports.close_loop_curves import Curve, Series
from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS = 24
"""Means that residuals are drawn as where they lie at more places."""
SERIES = (figures.BLUE, figures.RED, figures.GREEN)
FEW = 4
"""Of so few distinct places cells are spread out beside one another."""
NAME, NAMED = 26, 44
"""Characters of a name beside a panel, and above one."""
CHARACTERS = 40
"""Of names that fit beside one another below a panel."""
HANDLE = 6
"""Characters that a sign of a legend is as wide as."""
ROW = 0.065
"""Height of a legend's row over that of a panel."""


def draw_curve(panel: Axes, curve: Curve) -> None:
    """Cells as pale dots, their means as dots, the effect as a line."""
    from matplotlib.ticker import MaxNLocator

    panel.axhline(0.0, color=figures.GREY, linewidth=0.9)
    several = len(curve.series) > 1
    # Of several series each has a line of its own colour.
    lines = [(curve.line, figures.INK if several else figures.ORANGE)] if curve.line else []
    for series, colour in zip(curve.series, SERIES, strict=False):
        _draw_series(panel, series, colour, labelled=several, example=curve.example)
    if curve.ticks:
        panel.set_xticks(curve.ticks)
    if curve.names:
        panel.set_xticks(
            range(len(curve.names)),
            [cut(name, NAME) for name in curve.names],
            rotation=90 * _crowded(curve.names),
            fontsize=7.5,
        )
    if curve.xlabel.endswith("in order"):
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    panel.set_title(cut(curve.title, NAMED))
    panel.set_xlabel(curve.xlabel)
    panel.set_ylabel(curve.ylabel)
    if several or lines:
        _legend_above(panel, lines)


def _crowded(names: tuple[str, ...]) -> bool:
    return sum(map(len, names)) + len(names) > CHARACTERS


def _legend_above(panel: Axes, lines: Sequence[tuple[str, str]]) -> None:
    """The series by name, and what their lines are, in rows of their own above the data."""
    from matplotlib.lines import Line2D

    handles, names = panel.get_legend_handles_labels()
    handles += [Line2D([], [], color=colour, linewidth=1.8) for _, colour in lines]
    names += [name for name, _ in lines]
    beside = sum(len(name) + HANDLE for name in names) <= CHARACTERS
    rows = 1 if beside else len(names)
    low, high = panel.get_ylim()
    panel.set_ylim(low, high + (ROW * rows + ROW / 2) * (high - low))
    columns = len(names) if beside else 1
    # Its width must not push the panels apart.
    drawn = panel.legend(handles, names, loc="upper left", ncols=columns, borderaxespad=0.2)
    drawn.set_in_layout(False)


def _draw_series(
    panel: Axes, series: Series, colour: str, *, labelled: bool, example: bool
) -> None:
    panel.plot(
        _spread(series.x), series.y, ".", color=colour, alpha=0.18, markersize=4, markeredgewidth=0
    )
    x, y, fitted = _binned(series)
    panel.plot(x, y, "o", color=colour, markersize=4.5, label=series.name if labelled else None)
    if series.fine is not None:
        line = {"linewidth": 0.9, "linestyle": "--"} if example else {"linewidth": 1.8}
        panel.plot(*series.fine, color=figures.ORANGE, zorder=4, **line)
    elif fitted is not None:
        panel.plot(x, fitted, color=colour if labelled else figures.ORANGE, linewidth=1.8, zorder=4)


def _spread(x: FloatArray) -> FloatArray:
    """Cells of a few places side by side in their order, which says nothing else."""
    places = np.unique(x)
    if not 1 < len(places) <= FEW:
        return x
    beside = np.linspace(-0.5, 0.5, len(x)) * 0.25 * float(np.diff(places).min())
    found: FloatArray = x + beside
    return found


def _binned(series: Series) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Means of x, of residuals and of the effect at each x, or in bins of many."""
    places, group = np.unique(np.round(series.x, 9), return_inverse=True)
    if len(places) > BINS:
        edges = np.quantile(series.x, np.linspace(0, 1, BINS + 1)[1:-1])
        group = np.searchsorted(edges, series.x, side="right")
    count = np.bincount(group)
    there = count > 0

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = np.bincount(group, values)[there] / count[there]
        return found

    fitted = None if series.fitted is None else mean(series.fitted)
    return mean(series.x), mean(series.y), fitted
