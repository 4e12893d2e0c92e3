"""Pictures of anova: mean errors by part with limits, and what the variance is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova import Analysed, AnovaResult
from mtu_cli.reports import figures
from mtu_cli.reports.numbers import percent, significant
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FEATURES = 3
"""Features whose parts are drawn, an operation."""
PANEL_ROWS = 6
NAMED_PARTS = 40
BARS = 16
LIMITS = "95 % limits for all parts and features"


@figures.styled
def figure(result: AnovaResult) -> Figure:
    """Mean errors by part (Gilsinn & Ling 2004, Fig. 5) above the shares of the variance."""
    rows = _rows(result)
    axes = sorted({axis for row in rows for axis in row})
    bars = result.totals[:BARS]
    height = 1.55 * len(rows) + 0.8 + 0.36 * len(bars) + 0.8
    page = figures.blank(8.0, height)
    grid = page.add_gridspec(
        len(rows) + 1, len(axes), height_ratios=[1.55] * len(rows) + [0.36 * len(bars) + 0.5]
    )
    limits = result.features.limits()
    for r, row in enumerate(rows):
        for c, axis in enumerate(axes):
            panel = page.add_subplot(grid[r, c])
            if axis in row:
                _parts(panel, result.features, row[axis], limits[row[axis]])
            else:
                panel.set_axis_off()
            if r < len(rows) - 1:
                panel.tick_params(labelbottom=False)
            else:
                panel.set_xlabel("part")
    _shares(page.add_subplot(grid[len(rows), :]), result)
    total = len({label[:2] for label in result.features.tables.labels})
    more = f": {len(rows)} of {total} features" if len(rows) < total else ""
    handles, labels = page.axes[0].get_legend_handles_labels()
    page.legend(
        handles, labels, loc="outside upper left", ncols=4, alignment="left",
        title=f"Mean errors by part{more}", title_fontproperties={"weight": "bold", "size": 9.5},
    )  # fmt: skip
    return page


def _rows(result: AnovaResult) -> list[dict[str, int]]:
    """The tables to draw, one row an operation and feature, by axis; the first in interest."""
    order = {name: rank for rank, name in enumerate(result.shown)}
    rows: dict[tuple[str, str], dict[str, int]] = {}
    for i, (operation, feature, axis) in enumerate(result.features.tables.labels):
        rows.setdefault((operation, feature), {})[axis] = i
    chosen: list[dict[str, int]] = []
    operations = dict.fromkeys(operation for operation, _ in rows)
    share = max(1, min(FEATURES, PANEL_ROWS // len(operations)))
    for operation in operations:
        own = [key for key in rows if key[0] == operation]
        own.sort(key=lambda key: order.get(key[1], len(order)))
        chosen += [rows[key] for key in own[:share]]
    return chosen[:PANEL_ROWS]


def _parts(panel: Axes, found: Analysed, i: int, limit: np.ndarray) -> None:
    cells, one = found.tables.cells, found.one_way
    there = np.flatnonzero(cells.present[i])
    mean = (cells.origin[i] + cells.mean[i, there]) / UM
    grand = one.mean[i] / UM
    at = there + 1.0
    half = limit[there] / UM
    bar = 2 * np.sqrt(np.nan_to_num(one.ms_within[i]) / cells.n[i, there]) / UM
    panel.axhline(grand, color=figures.BLUE, linewidth=1.0, label="mean of all")
    if np.isfinite(half).all():
        for sign in (-1, 1):
            panel.step(
                at, grand + sign * half, where="mid", color=figures.RED, linewidth=1.0,
                linestyle="--", label=LIMITS if sign > 0 else None,
            )  # fmt: skip
    out = np.array([found.tables.parts[j] in found.unusual[i] for j in there], dtype=bool)
    marker = 4.0 if len(there) <= NAMED_PARTS else 2.0
    panel.errorbar(
        at[~out], mean[~out], yerr=bar[~out], fmt="o", color=figures.INK, markersize=marker,
        elinewidth=1.0, label="mean of a part ± 2 s/√n of the CMM",
    )  # fmt: skip
    if out.any():
        panel.errorbar(
            at[out], mean[out], yerr=bar[out], fmt="D", color=figures.RED, markersize=marker + 1.5
        )
    operation, feature, axis = found.tables.labels[i]
    panel.set_title(" ".join(word for word in (operation, feature, axis) if word))
    panel.set_ylabel("um")
    count = len(found.tables.parts)
    if count <= NAMED_PARTS:
        panel.set_xticks(
            range(1, count + 1), found.tables.parts, fontsize=6.5, rotation=_turn(found)
        )
    panel.set_xlim(0.4, count + 0.6)
    panel.grid(axis="x", visible=False)


def _turn(found: Analysed) -> int:
    return 90 if max(map(len, found.tables.parts)) > 2 else 0


def _shares(panel: Axes, result: AnovaResult) -> None:
    """Stacked bars: the part's and the CMM's share of the variance of one measured point.

    Variances are means over all features of an operation and axis.
    """
    shown = result.totals[:BARS]
    names = [" ".join(word for word in (item.operation, item.axis) if word) for item in shown]
    for row, item in enumerate(shown):
        share = item.repeat_share
        if not np.isfinite(share):
            panel.text(1, row, "cannot be told apart", va="center", fontsize=8, color=figures.GREY)
            continue
        widths = (100 * (1 - share), 100 * share)
        colours = (figures.BLUE, figures.ORANGE)
        names_ = ("from part to part", "CMM repeat")
        left = 0.0
        for width, colour, name in zip(widths, colours, names_, strict=True):
            panel.barh(
                row, width, left=left, color=colour, height=0.62, label=name if row == 0 else None
            )
            left += width
        s_part, s_repeat = (np.sqrt(v) / UM for v in (item.part, item.repeat))
        panel.annotate(
            f"  part s {significant(s_part)} um, CMM s {significant(s_repeat)} um "
            f"({percent(share)} %)",
            (100, row), va="center", fontsize=7.5, color=figures.INK, annotation_clip=False,
        )  # fmt: skip
    panel.set_yticks(range(len(shown)), names)
    panel.set_ylim(len(shown) - 0.4, -0.6)
    panel.set_xlim(0, 150)
    ticks = range(0, 101, 20)
    panel.set_xticks(ticks, [f"{tick} %" for tick in ticks])
    panel.spines["bottom"].set_bounds(0, 100)
    more = f" (first {BARS} of {len(result.totals)})" if len(result.totals) > BARS else ""
    panel.set_title(f"Shares of the variance{more}")
    panel.grid(axis="y", visible=False)
    if panel.get_legend_handles_labels()[0]:
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=7.5)
