"""Errors along three axes as maps: a column a level, arrows in the plane above those across it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.model.residual_layout import IntArray
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import (
    Plane,
    View,
    common_view,
    draw_arrows,
    draw_marks,
    frame,
    scale_arrow,
    spacing_of,
    write_names,
)
from mtu_cli.reports.labels import cut as cut_name
from mtu_cli.reports.levels import Cut, Level, cut
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

WIDTH = 12.0
"""Inches of a page of levels."""
NAME = 20
"""Characters of a group's name above a panel."""
ACROSS = 3
"""Levels beside one another."""
LOWEST, TALLEST, OF_TALL = 1.0, 4.6, 6.8
"""Heights of a panel, inches; the last of a tall part."""
TALL = 2.2
"""Height over width of a part that is tall; wide parts are as much wider than high."""
ABOVE = 0.75
"""Inches of title, scale and labels, a row."""
ALIKE = 4.0
"""Scales that differ by less are made one."""
MANY = 400
"""Of more features a level the nearest of all is taken for the one above."""
COLUMN = 0.2
"""Of features more upright than this slope the arrows of one reach to the next."""
BESIDE = 0.04
"""Between arrows across the plane that start at one place, inches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """Errors (n, 3) um, nan where not known; ellipses and bars by `covariance` (n, 3, 3) um^2."""

    name: str
    colour: str
    errors: FloatArray
    covariance: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Maps:
    """Features at `places` (n, 3) mm with sides that are drawn over one another, group by group.

    `axes` are those of the errors; k standard uncertainties are drawn.
    """

    ids: tuple[str, ...]
    places: FloatArray
    axes: tuple[str, ...]
    groups: tuple[tuple[str, tuple[Side, ...]], ...]
    k: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """How maps lie on paper `width` inches wide: a panel a group, level and direction, by rows.

    `views` are those in the plane and, where there are errors across it, across.
    """

    maps: Maps
    cut: Cut
    views: tuple[View, ...]
    columns: int
    panel: float
    width: float

    @property
    def rows(self) -> list[list[tuple[int, Level, int]]]:
        """Panels: number of the group, level, 0 in the plane and 1 across it."""
        kinds, levels = range(len(self.views)), self.cut.levels
        groups = range(len(self.maps.groups))
        if len(levels) * len(kinds) == 1:
            every = [(g, levels[0], 0) for g in groups]
            return [every[i : i + self.columns] for i in range(0, len(every), self.columns)]
        if len(levels) * len(kinds) == self.columns:
            return [[(g, one, kind) for kind in kinds for one in levels] for g in groups]
        bands = [levels[i : i + self.columns] for i in range(0, len(levels), self.columns)]
        return [
            [(g, one, kind) for one in band] for g in groups for band in bands for kind in kinds
        ]

    @property
    def height(self) -> float:
        """Inches on the page."""
        return len(self.rows) * (self.panel + ABOVE) + 0.9


def sheet(maps: Maps, width: float) -> Sheet:
    """The layout of maps; wide parts have fewer panels in a row."""
    found = cut(maps.places, maps.axes)
    planes = [list(_planes(maps, found, across=across)) for across in (False, True)]
    planes = planes if set(AXES) <= set(maps.axes) else planes[:1]
    extent = np.ptp(maps.places[:, found.plane], axis=0)
    columns = _columns(len(found.levels), len(planes), extent)
    if len(found.levels) * len(planes) == 1:
        columns = _columns(len(maps.groups), 1, extent)
    room = (width - 0.9) / columns
    most = TALLEST if extent[1] <= TALL * extent[0] else OF_TALL
    views = _views(planes, (room, most))
    height = min(max(room / views[0].aspect, LOWEST), most)
    return Sheet(maps=maps, cut=found, views=views, columns=columns, panel=height, width=width)


def _columns(levels: int, kinds: int, extent: FloatArray) -> int:
    """Panels in a row: all of them where they are few for the shape of the part."""
    wide, tall = extent[0] > TALL * extent[1], extent[1] > TALL * extent[0]
    most = 1 if extent[0] > 5 * extent[1] else 2 if wide else 2 * ACROSS if tall else ACROSS
    if levels * kinds <= most and (levels == 1 or tall):
        return levels * kinds
    return min(levels, most, ACROSS if levels != 4 or tall else 2)


def _planes(maps: Maps, found: Cut, *, across: bool) -> Iterator[Plane]:
    for _, sides in maps.groups:
        for side in sides:
            for level in found.levels:
                plane = _plane(maps, side, found, level.rows, across=across)
                if plane.ids:
                    yield plane


def _plane(maps: Maps, side: Side, found: Cut, rows: IntArray, *, across: bool) -> Plane:
    """The features of a level whose errors are known, arrows upwards where they are `across`."""
    chosen = [found.normal] if across else list(found.plane)
    rows = rows[np.isfinite(side.errors[rows][:, chosen]).all(axis=1)]
    errors = side.errors[rows][:, chosen]
    C = None if side.covariance is None else side.covariance[rows][:, chosen][:, :, chosen]
    if across:
        errors = np.column_stack([np.zeros(len(rows)), errors])
        C = None if C is None else np.pad(C, ((0, 0), (1, 0), (1, 0)))
    return Plane(
        ids=tuple(maps.ids[i] for i in rows),
        places=maps.places[rows][:, found.plane],
        errors=errors,
        covariance=C,
        k=maps.k,
    )


def _views(planes: Sequence[Sequence[Plane]], paper: tuple[float, float]) -> tuple[View, ...]:
    """A view for each direction with the same limits and, where it does for both, one scale."""
    every = [plane for own in planes for plane in own]
    spacings = [spacing_of(p.places) for p in every if len(np.unique(p.places, axis=0)) > 1]
    spacing = min(spacings, default=None)
    limits = [math.inf, min(map(_upright_limit, planes[-1]), default=math.inf)]
    views = [
        common_view(own, paper, spacing, limit)
        for own, limit in zip(planes, limits, strict=False)
        if own
    ]
    scales = [view.scale for view in views]
    if len(views) > 1 and max(scales) <= ALIKE * min(scales):
        views = [common_view(own, paper, spacing, min(scales)) for own in planes]
    low = np.min([view.low for view in views], axis=0)
    high = np.max([view.high for view in views], axis=0)
    inch = float(((high - low) / np.array(paper)).max())
    return tuple(replace(view, low=low, high=high, inch=inch) for view in views)


def _upright_limit(plane: Plane) -> float:
    """The scale at which the longest of arrows upwards ends below the next feature above."""
    U = 0.0 if plane.covariance is None else plane.k * np.sqrt(plane.covariance[:, 1, 1].clip(0))
    longest = float((np.abs(plane.errors[:, 1]) + U).max())
    if longest == 0:
        return math.inf
    if len(plane.ids) > MANY:
        return spacing_of(plane.places) / longest
    dx, dy = np.abs(plane.places[:, None] - plane.places[None]).transpose(2, 0, 1)
    above = (dx < COLUMN * dy) & (dy > 0)
    if not above.any():
        return math.inf
    return float(0.9 * dy[above].min() / longest)


def page_of(maps: Maps, title: str) -> Figure:
    """A page of nothing else."""
    drawn = sheet(maps, WIDTH)
    page = figures.blank(WIDTH, drawn.height)
    draw(page, drawn)
    legend(page, drawn)
    write_title(page, title, drawn)
    return page


def write_title(page: Figure | SubFigure, title: str, drawn: Sheet) -> None:
    """Above the panels, with how many levels are not drawn."""
    shown, total = len(drawn.cut.levels), drawn.cut.total
    some = f" ({shown} of {total} levels)" if 1 < shown < total else ""
    page.suptitle(f"{title}{some}", x=0.012, ha="left", fontsize=9.5, fontweight="bold")


def draw(page: Figure | SubFigure, drawn: Sheet) -> None:
    """The panels, a scale at the beginning of each row."""
    rows = drawn.rows
    panels = page.subplots(len(rows), drawn.columns, squeeze=False)
    for r, (row, own) in enumerate(zip(rows, panels, strict=True)):
        for c, panel in enumerate(own):
            if c >= len(row):
                panel.set_axis_off()
                continue
            _panel(panel, drawn, row[c])
            if c == 0:
                panel.set_ylabel(f"{AXES[drawn.cut.plane[1]]}, mm")
            if c == 0 or row[c][2] != row[c - 1][2]:
                scale_arrow(panel, drawn.views[row[c][2]], figures.INK, rise=11.0)
            if r + 1 >= len(rows) or c >= len(rows[r + 1]):
                panel.set_xlabel(f"{AXES[drawn.cut.plane[0]]}, mm")


def legend(page: Figure | SubFigure, drawn: Sheet) -> None:
    """The sides by name, above the panels."""
    from matplotlib.lines import Line2D

    sides = {side.name: side.colour for _, own in drawn.maps.groups for side in own if side.name}
    if not sides:
        return
    handles = [Line2D([], [], color=c, linewidth=2.2, label=name) for name, c in sides.items()]
    page.legend(handles=handles, loc="outside upper right", ncols=len(handles))


def _panel(panel: Axes, drawn: Sheet, what: tuple[int, Level, int]) -> None:
    number, level, kind = what
    maps, view, across = drawn.maps, drawn.views[kind], kind == 1
    title, sides = maps.groups[number]
    planes = [_plane(maps, side, drawn.cut, level.rows, across=across) for side in sides]
    for i, (side, plane) in enumerate(zip(sides, planes, strict=True)):
        # One below the other: the first is wider, to be seen where both are the same.
        thickness = 1.0 if len(sides) == 1 or i else 2.0
        if across:
            shift = (i - (len(sides) - 1) / 2) * 2 * BESIDE * view.inch
            _upright(panel, plane, view, side.colour, shift)
        else:
            draw_arrows(panel, plane, view, side.colour, thickness=thickness)
    frame(panel, view)
    draw_marks(panel, maps.places[level.rows][:, drawn.cut.plane], view)
    known = [plane for plane in planes if plane.ids]
    if view.named and known:
        write_names(panel, sorted(known, key=lambda plane: -len(plane.ids)), view)
    normal = AXES[drawn.cut.normal]
    axes = (
        f"E{normal} (up is +)" if across else " and ".join(f"E{AXES[a]}" for a in drawn.cut.plane)
    )
    panel.set_title(
        ", ".join(filter(None, (cut_name(title, NAME), axes, level.at))), pad=22, fontsize=9
    )


def _upright(panel: Axes, plane: Plane, view: View, colour: str, shift: float) -> None:
    """Arrows across the plane, drawn upwards, with bars of k standard uncertainties."""
    beside = np.array([shift, 0.0])
    draw_arrows(panel, replace(plane, places=plane.places + beside, covariance=None), view, colour)
    if plane.covariance is None:
        return
    x, y = (plane.places + view.scale * plane.errors).T + beside[:, None]
    x += (BESIDE if shift >= 0 else -BESIDE) * view.inch
    U = plane.k * np.sqrt(np.clip(plane.covariance[:, 1, 1], 0.0, None))
    panel.errorbar(
        x, y, yerr=view.scale * U, fmt="none", ecolor=colour, elinewidth=0.8,
        capsize=1.8, zorder=4,
    )  # fmt: skip
