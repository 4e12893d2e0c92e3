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
FEW = 16
"""Where places are no nearer than this part of all cells are dashes, which show where many lie."""
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
    few = float(np.ptp(series.x)) <= FEW * float(np.diff(np.unique(series.x)).min(initial=np.inf))
    mark, size = ("_", 14) if few else (".", 4)
    panel.plot(series.x, series.y, mark, color=colour, alpha=0.2, markersize=size)
    x, y, fitted = _binned(series)
    name = series.name if labelled else None
    panel.plot(x, y, "o", color=colour, markersize=5.5, mec="white", zorder=5, label=name)
    panel.margins(x=0.1 if few else 0.05)
    if example and fitted is not None:
        # Between the places one such wave is as good as another.
        panel.plot(x, fitted, "o", color=figures.ORANGE, ms=7, mfc="none", zorder=4)
    elif series.fine is not None:
        panel.plot(*series.fine, color=figures.ORANGE, linewidth=1.8, zorder=4)
    elif fitted is not None:
        panel.plot(x, fitted, color=colour if labelled else figures.ORANGE, linewidth=1.8, zorder=4)


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
