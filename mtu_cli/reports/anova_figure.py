"""Pictures of anova: mean errors by part with limits, what the variance is made of, or a map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.anova import AnovaResult
from mtu_cli.analyses.anova.features import FeatureMap
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Plane, common_view, draw_plane, scale_arrow
from mtu_cli.reports.labels import cut, folded
from mtu_cli.reports.level_maps import Maps, Side, page_of
from mtu_cli.reports.levels import flat
from mtu_cli.reports.numbers import percent, significant
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FEATURES = 3
"""Features whose parts are drawn, an operation."""
PANEL_ROWS = 6
NAMED_PARTS = 40
MANY_PARTS = 300
"""More parts than this are drawn without the CMM's scatter."""
BARS = 16
MAPS = 4
ERROR = "actual minus\nnominal, um"
LIMITS = "a part beyond stands out (5 % over all parts, features, lengths, angles)"
WIDTH = 8.0
TITLE, LETTERS = 11.0, 19.0
"""Characters in an inch of a panel's title, and of the names of the parts."""
PART, OPERATION = 14, 24
"""Characters of a part's name, and of a line of an operation's."""
UPRIGHT = 0.095
"""Inches between upright names."""
ROW = 1.55
BAR = 0.36


@figures.styled
def figure(result: AnovaResult) -> Figure:
    """Mean errors by part (Gilsinn & Ling 2004, Fig. 5) above the shares of the variance; of a
    single part a map of its errors.
    """
    single = len(result.features.tables.parts) == 1
    return _maps(result) if single and result.maps else _by_part(result)


def _by_part(result: AnovaResult) -> Figure:
    rows = _rows(result)
    axes = sorted({axis for row in rows for axis in row})
    bars = sum(np.isfinite(item.repeat_share) for item in result.totals[:BARS])
    shares = [BAR * bars + 0.5] * bool(bars)
    page = figures.blank(WIDTH, ROW * len(rows) + 0.8 + sum(shares) + 0.4)
    grid = page.add_gridspec(
        len(rows) + len(shares), len(axes), height_ratios=[ROW] * len(rows) + shares
    )
    for r, row in enumerate(rows):
        for c, axis in enumerate(axes):
            panel = page.add_subplot(grid[r, c])
            if axis in row:
                _parts(panel, result, row[axis], (WIDTH - 0.6) / len(axes))
            else:
                panel.set_axis_off()
            if c == 0:
                panel.set_ylabel(ERROR, fontsize=7.5)
            panel.tick_params(labelbottom=r == len(rows) - 1)
            if r == len(rows) - 1:
                panel.set_xlabel(_parts_axis(result))
    if shares:
        _shares(page.add_subplot(grid[len(rows), :]), result)
    _legend(page, result, len(rows))
    return page


def _legend(page: Figure, result: AnovaResult, drawn: int) -> None:
    total = len(result.shown)
    some = ""
    if drawn != total:
        some = f": {drawn} of {total} features, those that stand out and the largest first"
    found = {
        label: handle
        for panel in page.axes
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    page.legend(
        list(found.values()), list(found), loc="outside upper left", ncols=2, alignment="left",
        title=f"Mean errors by part and feature{some}",
        title_fontproperties={"weight": "bold", "size": 9.5},
    )  # fmt: skip


def _rows(result: AnovaResult) -> list[dict[str, int]]:
    """The tables to draw, one row an operation and feature, by axis; the first in interest."""
    rows: dict[tuple[str, str], dict[str, int]] = {}
    for i, (operation, feature, axis) in enumerate(result.features.tables.labels):
        rows.setdefault((operation, feature), {})[axis] = i
    operations = list(dict.fromkeys(operation for operation, _ in rows))
    share = max(1, min(FEATURES, PANEL_ROWS // len(operations)))
    chosen: list[dict[str, int]] = []
    for operation in operations[:PANEL_ROWS]:
        own = [key for key in result.shown if key[0] == operation]
        chosen += [rows[key] for key in own[:share]]
    return chosen


def _parts_axis(result: AnovaResult) -> str:
    count = len(result.features.tables.parts)
    return "part" if count <= NAMED_PARTS else f"parts 1 to {count}, as they first appear"


def _parts(panel: Axes, result: AnovaResult, i: int, width: float) -> None:
    found, k = result.features, result.coverage_factor
    mean, grand = found.part_means(i) / UM, found.one_way.mean[i] / UM
    count = len(mean)
    at = np.arange(count) + 1.0
    panel.axhline(grand, color=figures.BLUE, linewidth=1.0, label="mean of all readings")
    limits = result.limits(i) / UM
    if np.isfinite(limits).any():
        for side in limits:
            panel.step(
                at, side, where="mid", color=figures.RED, linewidth=1.0, linestyle="--",
                label=LIMITS,
            )  # fmt: skip
    out = np.array([part in found.unusual[i] for part in found.tables.parts], dtype=bool)
    half = k * found.u_repeat(i) / UM
    bars = count <= MANY_PARTS and np.nanmax(half) > 0
    size = 4.0 if count <= NAMED_PARTS else 2.0 if count <= MANY_PARTS else 0.7
    label = f"mean of a part ± {k:g} s/√n of the CMM" if bars else "mean of a part"
    for chosen, style, colour, extra in ((~out, "o", figures.INK, 0), (out, "D", figures.RED, 1.5)):
        if chosen.any():
            panel.errorbar(
                at[chosen], mean[chosen], yerr=half[chosen] if bars else None, fmt=style,
                color=colour, markersize=size + extra, markeredgewidth=0, elinewidth=1.0,
                label=label if style == "o" else "part that stands out here by itself",
            )  # fmt: skip
    panel.set_title(
        cut(" ".join(word for word in found.tables.labels[i] if word), int(TITLE * width))
    )
    if count <= NAMED_PARTS:
        _name_parts(panel, found.tables.parts, width)
    panel.set_xlim(1 - 0.03 * count - 0.3, count + 0.03 * count + 0.3)
    panel.grid(axis="x", visible=False)


def _name_parts(panel: Axes, parts: Sequence[str], width: float) -> None:
    """The parts' names upright where they have no room beside one another; not all of too many."""
    names, count = [cut(name, PART) for name in parts], len(parts)
    upright = max(map(len, names)) > 2 or sum(map(len, names)) + count > LETTERS * (width - 0.5)
    every = math.ceil(count * UPRIGHT / (width - 0.5)) if upright else 1
    panel.set_xticks(
        range(1, count + 1, every), names[::every], fontsize=6.5, rotation=90 if upright else 0
    )


def _shares(panel: Axes, result: AnovaResult) -> None:
    """Stacked bars: the part's and the CMM's share of the variance of one measured point.

    Variances are means over all features of an operation and axis.
    """
    known = [item for item in result.totals[:BARS] if np.isfinite(item.repeat_share)]
    names = [
        folded(" ".join(word for word in (item.operation, item.axis) if word), OPERATION)
        for item in known
    ]
    for row, item in enumerate(known):
        share = 100 * item.repeat_share
        panel.barh(row, 100 - share, color=figures.BLUE, height=0.62)
        panel.barh(row, share, left=100 - share, color=figures.ORANGE, height=0.62)
        s_part, s_repeat = (np.sqrt(v) / UM for v in (item.part, item.repeat))
        panel.annotate(
            f"  part s {significant(s_part)} um, CMM s {significant(s_repeat)} um "
            f"({percent(item.repeat_share)} %)",
            (100, row), va="center", fontsize=7.5, color=figures.INK, annotation_clip=False,
        )  # fmt: skip
    panel.set_yticks(range(len(known)), names)
    panel.set_ylim(len(known) - 0.4, -0.6)
    panel.set_xlim(0, 150)
    ticks = range(0, 101, 20)
    panel.set_xticks(ticks, [f"{tick} %" for tick in ticks])
    panel.spines["bottom"].set_bounds(0, 100)
    more = f" (first {BARS} of {len(result.totals)})" if len(result.totals) > BARS else ""
    panel.set_title(f"Shares of the variance{more}: part to part (blue), CMM (orange)")
    panel.grid(axis="y", visible=False)


def _maps(result: AnovaResult) -> Figure:
    """Arrows of the mean errors at the features, one panel an operation, one scale."""
    shown = result.maps[:MAPS]
    known = tuple(axis for i, axis in enumerate(AXES) if _known(shown, i))
    if not all(flat(item.places, known) for item in shown):
        return _by_level(result, known)
    planes = [_plane(item) for item in shown]
    columns = min(len(planes), 2)
    rows = -(-len(planes) // columns)
    side = 7.0 if columns == 1 else 5.2
    view = common_view(planes, (side - 0.6, side - 0.6))
    page = figures.blank(side * columns, side * rows / max(view.aspect, 0.5) + 0.3)
    panels = page.subplots(rows, columns, squeeze=False).ravel()
    for panel in panels[len(planes) :]:
        panel.set_axis_off()
    part, datum = result.features.tables.parts[0], _less(result)
    for panel, item, plane in zip(panels, shown, planes, strict=False):
        draw_plane(panel, plane, view)
        panel.set_xlabel("x, mm")
        panel.set_ylabel("y, mm")
        of = f"{item.operation}, " if item.operation else ""
        title = f"Part {part}: errors of {of}{len(item.ids)} features, actual minus nominal{datum}"
        panel.set_title(title, pad=24)
        scale_arrow(panel, view, figures.BLUE, rise=12.0)
    return page


def _known(shown: Sequence[FeatureMap], axis: int) -> bool:
    return any(np.isfinite(item.errors[:, axis]).any() for item in shown)


def _less(result: AnovaResult) -> str:
    return "" if result.datum == "none" else f", less {result.datum.replace(',', ' and ')}"


def _by_level(result: AnovaResult, axes: tuple[str, ...]) -> Figure:
    """Maps level by level, an operation a group, of the features of all operations."""
    shown = result.maps[:MAPS]
    places = {
        name: place for item in shown for name, place in zip(item.ids, item.places, strict=True)
    }
    groups = []
    for item in shown:
        own = dict(zip(item.ids, item.errors / UM, strict=True))
        errors = np.array([own.get(name, np.full(3, np.nan)) for name in places])
        groups.append((item.operation, (Side(name="", colour=figures.BLUE, errors=errors),)))
    maps = Maps(
        ids=tuple(places), places=np.array(list(places.values())), axes=axes, groups=tuple(groups)
    )
    part = result.features.tables.parts[0]
    title = f"Part {part}: errors of {len(places)} features, actual minus nominal{_less(result)}"
    return page_of(maps, title)


def _plane(item: FeatureMap) -> Plane:
    return Plane(ids=item.ids, places=item.places[:, :2], errors=item.errors[:, :2] / UM)
