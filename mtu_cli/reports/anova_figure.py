"""Pictures of anova: mean errors by part with limits, the scatter by its source, or a map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova import AnovaResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, page_of
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import cut
from mtu_cli.reports.numbers import percent
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FEATURES, PANEL_ROWS = 3, 6
"""Features whose parts are drawn, an operation and in all."""
NAMED, MANY = 40, 300
"""More parts than these are drawn without their names, and without the CMM's scatter."""
BARS, MAPS = 16, 4
"""Operations by axes whose scatter is drawn, and operations whose errors are."""
LIMITS = "limits of an outlier (5 % over all parts and features)"
WIDTH, ROW = 8.0, 1.45
"""Of the page and of a row of panels, inches."""
TITLE, LETTERS, PART = 11.0, 19.0, 14
"""Characters in an inch of a panel's title, and of the names of parts; and of one name."""


@figures.styled
def figure(result: AnovaResult) -> Figure:
    """Mean errors by part (Gilsinn & Ling 2004, Fig. 5) above the scatter by its source; of a
    single part a map of its errors.
    """
    single = len(result.features.tables.parts) == 1
    return _maps(result) if single and result.maps else _by_part(result)


def _by_part(result: AnovaResult) -> Figure:
    rows = _rows(result)
    axes = sorted({axis for row in rows for axis in row})
    bars = sum(np.isfinite(item.repeat_share) for item in result.totals[:BARS])
    heights = [ROW] * len(rows) + [figures.rows_height(bars)] * bool(bars)
    page = figures.blank(WIDTH, sum(heights) + 1.2)
    grid = page.add_gridspec(len(heights), len(axes), height_ratios=heights)
    count = len(result.features.tables.parts)
    for r, row in enumerate(rows):
        for c, axis in enumerate(axes):
            panel = page.add_subplot(grid[r, c])
            if axis in row:
                _parts(panel, result, row[axis], (WIDTH - 0.6) / len(axes))
            else:
                panel.set_axis_off()
            if c == 0:
                panel.set_ylabel("actual minus\nnominal, um", fontsize=7.5)
            last = r == len(rows) - 1
            panel.tick_params(labelbottom=last)
            if last:
                panel.set_xlabel("part" if count <= NAMED else f"parts 1 to {count} in order")
    figures.legend(page, 2)
    if bars:
        _scatter(page.add_subplot(grid[len(rows), :]), result)
    total = len(result.shown)
    some = f": {len(rows)} of {total} features, outliers and the largest first"
    figures.title(page, f"Mean errors by part and feature{some if len(rows) < total else ''}")
    return page


def _rows(result: AnovaResult) -> list[dict[str, int]]:
    """The tables to draw, one row an operation and feature, by axis; the first in interest."""
    rows: dict[tuple[str, str], dict[str, int]] = {}
    for i, (operation, feature, axis) in enumerate(result.features.tables.labels):
        rows.setdefault((operation, feature), {})[axis] = i
    operations = list(dict.fromkeys(operation for operation, _ in rows))[:PANEL_ROWS]
    share = max(1, min(FEATURES, PANEL_ROWS // len(operations)))
    chosen = ([key for key in result.shown if key[0] == one][:share] for one in operations)
    return [rows[key] for keys in chosen for key in keys]


def _parts(panel: Axes, result: AnovaResult, i: int, width: float) -> None:
    found, parts = result.features, result.features.tables.parts
    k, (mean, u) = found.coverage_factor, (each / UM for each in found.part_means(i))
    count = len(parts)
    at = np.arange(count) + 1.0
    panel.axhline(
        found.one_way.mean[i] / UM, color=figures.BLUE, linewidth=1.0, label="mean of all readings"
    )
    for limit in result.limits(i) / UM:
        if np.isfinite(limit).any():
            panel.step(at, limit, where="mid", color=figures.RED, lw=1.0, ls="--", label=LIMITS)
    half = k * u
    bars = count <= MANY and np.nanmax(half) > 0
    size = 4.0 if count <= NAMED else 2.0 if count <= MANY else 0.7
    out = np.array([part in found.unusual[i] for part in parts], dtype=bool)
    label = f"mean of a part ± {k:g} s_repeat/√n" if bars else "mean of a part"
    for chosen, form, colour, name in (
        (~out, "o", figures.INK, label),
        (out, "D", figures.RED, "outlier among the parts"),
    ):
        if chosen.any():
            panel.errorbar(
                at[chosen], mean[chosen], yerr=half[chosen] if bars else None, fmt=form,
                color=colour, markersize=size + 1.5 * (form == "D"), markeredgewidth=0,
                elinewidth=1.0, label=name,
            )  # fmt: skip
    label = " ".join(word for word in found.tables.labels[i] if word)
    panel.set_title(cut(label, int(TITLE * width)))
    if count <= NAMED:
        _name_parts(panel, parts, width)
    panel.set_xlim(0.7 - 0.03 * count, 1.03 * count + 0.3)
    panel.grid(axis="x", visible=False)


def _name_parts(panel: Axes, parts: Sequence[str], width: float) -> None:
    """Upright where they have no room side by side; not all of too many."""
    names, count = [cut(name, PART) for name in parts], len(parts)
    upright = sum(map(len, names)) + count > LETTERS * (width - 0.5) or max(map(len, names)) > 2
    every = math.ceil(0.095 * count / (width - 0.5)) if upright else 1
    rotation = 90 if upright else 0
    panel.set_xticks(range(1, count + 1, every), names[::every], fontsize=6.5, rotation=rotation)


def _scatter(panel: Axes, result: AnovaResult) -> None:
    """Standard deviations of one measured point from part to part and from repeat to repeat, means
    over all features of an operation and axis.
    """
    known = [item for item in result.totals[:BARS] if np.isfinite(item.repeat_share)]
    shown = [
        Intervals(label="", colour=colour, value=np.sqrt([getattr(x, name) for x in known]) / UM)
        for name, colour in (("part", figures.BLUE), ("repeat", figures.ORANGE))
    ]
    names = [" ".join(filter(None, (x.operation, x.axis))) for x in known]
    figures.intervals(panel, names, shown, [f"{percent(x.repeat_share)} %" for x in known])
    panel.set_xlim(left=0.0)
    panel.set_xlabel("standard deviation of one point, um; right: share of repeats in the variance")
    some = f" (first {BARS} of {len(result.totals)})" if len(result.totals) > BARS else ""
    panel.set_title(f"Scatter{some}: s_part (blue), s_repeat (orange)")


def _maps(result: AnovaResult) -> Figure:
    """Arrows of the mean errors at the features, an operation a group, on one scale."""
    shown = result.maps[:MAPS]
    places = {name: at for item in shown for name, at in zip(item.ids, item.places, strict=True)}
    groups = []
    for item in shown:
        own = dict(zip(item.ids, item.errors / UM, strict=True))
        errors = np.array([own.get(name, np.full(3, np.nan)) for name in places])
        groups.append((item.operation, (Side(name="", colour=figures.BLUE, errors=errors),)))
    known = [np.isfinite(np.vstack([item.errors for item in shown])[:, i]).any() for i in range(3)]
    axes = tuple(axis for axis, there in zip(AXES, known, strict=True) if there)
    maps = Maps(
        ids=tuple(places), places=np.array(list(places.values())), axes=axes, groups=tuple(groups)
    )
    less = "" if result.datum == "none" else f", less {result.datum.replace(',', ' and ')}"
    part = result.features.tables.parts[0]
    return page_of(
        maps, f"Part {part}: errors of {len(places)} features, actual minus nominal{less}"
    )
