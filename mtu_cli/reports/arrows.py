"""Errors at the features as arrows on maps: small multiples by operation, direction and height
(Gilsinn & Ling 2004, Fig. 6), with ellipses of k standard uncertainties about the tips.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.model.visits import IntArray
from mtu_cli.reports import figures
from mtu_cli.reports.figures import LETTER
from mtu_cli.reports.labels import cut, spread
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

MOST, FEW = 9, 4
"""Levels on one sheet; of more than the second a level needs three features on average."""
APART = 1e-3
"""Heights that differ by more of the part's extent are at two levels."""
NAMED = 80
"""Of more features at a level the names are not drawn."""
LINE, GAP = 0.15, 0.06
"""Height of a line of names, and the gap before them, inches."""
REACH, RADIUS = 0.95, 0.42
"""Of the longest arrow and of the largest ellipse, over the distance of neighbours."""
LOWEST, TALLEST, ALONE = 1.0, 4.6, 6.2
"""Heights of a panel, inches; the last of a panel that is alone in its row."""
ABOVE = 0.85
"""Inches of title, scale and labels of a row."""
CLOSER = 0.65
"""Features in rings and clusters are closer than those that are spread evenly."""


@dataclass(frozen=True, slots=True)
class Side:
    """Errors (n, 3) um, nan where not known; ellipses by `covariance` (n, 3, 3) um^2."""

    name: str
    colour: str
    errors: FloatArray
    covariance: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Maps:
    """Features at `places` (n, 3) mm with sides that are drawn over one another, group by group.

    `axes` are those of the errors; k standard uncertainties are drawn.
    """

    ids: tuple[str, ...]
    places: FloatArray
    axes: tuple[str, ...]
    groups: tuple[tuple[str, tuple[Side, ...]], ...]
    k: float = 0.0


class Arrows(NamedTuple):
    """Of a side in a panel: places (m, 2) mm, errors (m, 2) um, and the half axes (m, 2) um and
    their directions (m, 2, 2) of the ellipses, of the features whose errors are known.
    """

    side: Side
    places: FloatArray
    errors: FloatArray
    half: FloatArray
    directions: FloatArray


class Panel(NamedTuple):
    """The arrows of a group at the features `rows`, of errors along these `axes`: those of the
    plane, or the one across it.
    """

    title: str
    rows: IntArray
    axes: list[int]
    arrows: list[Arrows]

    @property
    def across(self) -> bool:
        """Whether errors across the plane are drawn, upwards."""
        return len(self.axes) == 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """How maps lie on paper: the panels row by row, in a `plane` of two axes, of so many levels in
    `total`; `width` and `height` of the page and `panel` height in inches, limits (2,) in mm,
    `scales` in the plane and across it, mm of the figure a um, `spacing` of neighbours in mm and in
    `inches`, and whether the features are `named`.
    """

    maps: Maps
    plane: list[int]
    rows: list[list[Panel]]
    columns: int
    shown: int
    total: int
    width: float
    panel: float
    low: FloatArray
    high: FloatArray
    scales: dict[bool, float]
    spacing: float
    inches: float
    named: bool

    @property
    def height(self) -> float:
        """Inches on the page."""
        return len(self.rows) * (self.panel + ABOVE) + 0.45


def sheet(maps: Maps, width: float | None = None) -> Sheet:
    """The layout of maps on a page, 12 inches wide, or 8 where one panel is all.

    From above, level by level, unless all features lie in a plane that is seen from the side: a
    feature without a height, or errors without one along z, can be seen from above alone. The
    longest arrow is about as long as features are apart, and the ellipses of neighbours about touch
    at the largest u.
    """
    sideways = set(AXES) <= set(maps.axes) and not np.isnan(maps.places[:, 2]).any()
    cuts = [(normal, *_levels(maps.places, normal)) for normal in ((2, 1, 0) if sideways else (2,))]
    normal, levels, total = next((each for each in cuts if each[2] == 1), cuts[0])
    plane = [axis for axis in range(3) if axis != normal]
    flat = maps.places[:, plane]
    # Exact zeros along an axis are of a machine without an error there.
    both = set(AXES) <= set(maps.axes) and any(
        side.covariance is not None or np.nansum(np.abs(side.errors[:, normal]))
        for _, sides in maps.groups
        for side in sides
    )
    strips = [
        [_panel(maps, group, plane, axes, rows) for rows in levels]
        for group in maps.groups
        for axes in ([plane, [normal]] if both else [plane])
    ]
    most = 3
    if len(levels) == 1:
        # In rows one after another, the plane beside what is across it.
        strips, most = [[panel for strip in strips for panel in strip]], 3 - both
    most = 1 if np.ptp(flat[:, 0]) > 2.5 * np.ptp(flat[:, 1]) > 0 else most
    columns = figures.columns_of(len(strips[0]), most)
    rows = [strip[i : i + columns] for strip in strips for i in range(0, len(strip), columns)]
    spacing, extent = _spacing(flat, levels), float(np.ptp(flat, axis=0).max())
    step = min(spacing, 0.3 * extent) if extent > 0 else spacing
    # Errors across the plane are of another size, and have a scale of their own.
    scales, ends = {}, [flat]
    for across in range(1 + both):
        arrows = [
            item
            for panel in (panel for strip in strips for panel in strip)
            if panel.across == across
            for item in panel.arrows
        ]
        sizes = (
            (REACH, max(np.linalg.norm(item.errors, axis=1).max(initial=0.0) for item in arrows)),
            (RADIUS, max(item.half.max(initial=0.0) for item in arrows)),
        )
        scale = min((share * step / size for share, size in sizes if size > 0), default=1.0)
        scales[bool(across)] = scale
        for item in arrows:
            radius = item.half.max(axis=1, initial=0.0)[:, None]
            ends += [item.places + scale * (item.errors + sign * radius) for sign in (-1, 1)]
    corners = np.vstack(ends)
    low, high = corners.min(axis=0) - 0.25 * step, corners.max(axis=0) + 0.25 * step
    room = width or (8.0 if columns == 1 else 12.0)
    tallest = ALONE if columns == 1 else TALLEST
    paper = np.array([(room - 0.9) / columns - 0.2, tallest])
    # Names stand beside the features, in the room between them.
    beside = np.array([2 * GAP + LETTER * max(map(len, maps.ids)), 2 * GAP + LINE])
    inch = float(((high - low) / (paper - beside)).max())
    named = max(map(len, levels)) <= NAMED and spacing / inch > beside[0]
    if named:
        low, high = low - 0.5 * beside * inch, high + 0.5 * beside * inch
    inch = float(((high - low) / paper).max())
    wide, tall = ((high - low) / inch).tolist()
    return Sheet(
        maps=maps, plane=plane, rows=rows, columns=columns, shown=len(levels), total=total,
        width=max(8.0, min(room, columns * (wide + 0.2) + 0.9)), low=low, high=high,
        panel=min(max(tall, LOWEST), tallest), scales=scales, spacing=spacing,
        inches=spacing / inch, named=named,
    )  # fmt: skip


def _levels(places: FloatArray, normal: int) -> tuple[list[IntArray], int]:
    """The features of each level that is drawn, and how many levels there are."""
    heights, n = places[:, normal], len(places)
    extent = max(float(np.ptp(c[np.isfinite(c)])) for c in places.T if np.isfinite(c).any())
    order = np.argsort(heights, kind="stable")
    # Unknown heights come last and are one level.
    steps = ~(np.diff(heights[order]) <= APART * extent) & ~np.isnan(heights[order][:-1])
    levels = np.split(order, np.flatnonzero(steps) + 1)
    total = len(levels)
    if total > FEW and 3 * total > n:
        levels = [order]
    return [np.sort(levels[i]) for i in spread(len(levels), MOST)], total


def _panel(
    maps: Maps, group: tuple[str, tuple[Side, ...]], plane: list[int], axes: list[int],
    rows: IntArray,
) -> Panel:  # fmt: skip
    """Errors in the plane; those across it upwards."""
    arrows = []
    for side in group[1]:
        known = rows[np.isfinite(side.errors[rows][:, axes]).all(axis=1)]
        errors, squares = np.zeros((len(known), 2)), np.zeros((len(known), 2, 2))
        errors[:, -len(axes) :] = side.errors[known][:, axes]
        if side.covariance is not None:
            C = side.covariance[known][:, axes][:, :, axes]
            squares[:, -len(axes) :, -len(axes) :] = maps.k**2 * C
        values, directions = np.linalg.eigh(squares)
        half = np.sqrt(np.clip(values, 0.0, None))
        arrows.append(Arrows(side, maps.places[known][:, plane], errors, half, directions))
    kind = " and ".join(f"E{AXES[axis]}" for axis in axes) + " (up is +)" * (len(axes) == 1)
    (normal,) = {0, 1, 2} - {*plane}
    heights, at = maps.places[rows, normal] + 0.0, ""
    if np.isfinite(heights).any():
        low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
        level = high - low <= 1e-3 * max(1.0, abs(high))
        at = f" = {np.nanmedian(heights):.6g} mm" if level else f" {low:.6g} to {high:.6g} mm"
        at = AXES[normal] + at
    return Panel(", ".join(filter(None, (cut(group[0], 20), kind, at))), rows, axes, arrows)


def _spacing(flat: FloatArray, levels: list[IntArray]) -> float:
    """About the distance of neighbours at a level, as if features were spread evenly."""
    apart = []
    for rows in levels:
        spots = np.unique(np.round(flat[rows], 6), axis=0)
        if len(spots) > 1:
            width, height = np.ptp(spots, axis=0)
            even = math.sqrt(width * height) / max(math.sqrt(len(spots)) - 1, 1)
            apart.append(CLOSER * max(even, max(width, height) / (len(spots) - 1)))
    return min(apart, default=10.0)


def page_of(maps: Maps, title: str) -> Figure:
    """A page of nothing else."""
    drawn = sheet(maps)
    page = figures.blank(drawn.width, drawn.height)
    draw(page, drawn, title)
    return page


def draw(page: Figure | SubFigure, drawn: Sheet, title: str) -> None:
    """The panels, a scale at the beginning of each row and direction; title and sides above."""
    from matplotlib.lines import Line2D

    some = f" ({drawn.shown} of {drawn.total} levels)"
    figures.title(page, title + some * (1 < drawn.shown < drawn.total))
    sides = {side.name: side.colour for _, group in drawn.maps.groups for side in group}
    handles = [Line2D([], [], color=c, lw=2.2, label=name) for name, c in sides.items() if name]
    if handles:
        page.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    across, up = (AXES[axis] for axis in drawn.plane)
    panels = page.subplots(len(drawn.rows), drawn.columns, squeeze=False)
    for row, blank in zip(drawn.rows, panels, strict=True):
        for panel in blank[len(row) :]:
            panel.set_axis_off()
        for c, what in enumerate(row):
            _draw_panel(blank[c], drawn, what)
            blank[c].set_xlabel(f"{across}, mm")
            if c == 0 or what.across != row[c - 1].across:
                _scale_arrow(blank[c], drawn, drawn.scales[what.across])
        blank[0].set_ylabel(f"{up}, mm")


def _draw_panel(panel: Axes, drawn: Sheet, what: Panel) -> None:
    """Lines and marks of features close together are finer; names stand across their arrows."""
    from matplotlib.collections import EllipseCollection
    from matplotlib.patheffects import withStroke

    fine, scale = min(1.0, max(0.35, drawn.inches / 0.6)), drawn.scales[what.across]
    for i, item in enumerate(what.arrows):
        if item.side.covariance is not None:
            # One by one, thousands would each be searched for their limits: the sheet has them all.
            turned = np.degrees(np.arctan2(item.directions[:, 1, 1], item.directions[:, 0, 1]))
            ellipses = EllipseCollection(
                2 * scale * item.half[:, 1], 2 * scale * item.half[:, 0], turned, units="xy",
                offsets=item.places + scale * item.errors, offset_transform=panel.transData,
                facecolors=figures.PALE, edgecolors=figures.BLUE, linewidths=0.8, alpha=0.55,
                zorder=2,
            )  # fmt: skip
            panel.add_collection(ellipses, autolim=False)
        # The first is wider, to be seen where both are the same.
        thick = 2.0 if len(what.arrows) > 1 and i == 0 else 1.0
        panel.quiver(
            *item.places.T, *scale * item.errors.T, angles="xy", scale_units="xy", scale=1,
            color=item.side.colour, units="inches", width=0.022 * fine * thick,
            headwidth=4.5 / thick**0.5, headlength=5.5 / thick**0.5, headaxislength=5 / thick**0.5,
            minlength=0.1, zorder=4,
        )  # fmt: skip
    places = drawn.maps.places[:, drawn.plane]
    panel.plot(*places[what.rows].T, "o", color=figures.INK, markersize=2.6 * fine, zorder=5)
    halo, total = [withStroke(linewidth=2.2, foreground="white")], np.zeros(places.shape)
    for item in what.arrows:
        total[:, -len(what.axes) :] += np.nan_to_num(item.side.errors[:, what.axes])
    for row in what.rows if drawn.named else ():
        across, up = total[row]
        upright, below = abs(up) >= abs(across), up >= 0.0
        panel.annotate(
            drawn.maps.ids[row], places[row].tolist(), textcoords="offset points",
            xytext=(-72 * GAP, 0) if upright else (0, 72 * GAP * (-1) ** below),
            ha="right" if upright else "center",
            va="center" if upright else ("top" if below else "bottom"),
            fontsize=7.5, zorder=6, path_effects=halo,
        )  # fmt: skip
    panel.set_aspect("equal")
    panel.set_xlim(drawn.low[0], drawn.high[0])
    panel.set_ylim(drawn.low[1], drawn.high[1])
    panel.set_title(what.title, pad=20, fontsize=9)


def _scale_arrow(panel: Axes, drawn: Sheet, scale: float) -> None:
    """An arrow of a round number of um above the panel: 1, 2 or 5 times a power of ten."""
    width = float(drawn.high[0] - drawn.low[0])
    most = max(1.1 * min(drawn.spacing, 0.3 * width), 0.15 * width) / scale
    power = 10.0 ** math.floor(math.log10(most))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1 + 1e-9))
    share, above = length * scale / width, 1.0 + 0.15 / drawn.panel
    style = {"arrowstyle": "-|>", "color": figures.INK, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    panel.annotate(
        "", xy=(share, above), xytext=(0.0, above), xycoords="axes fraction",
        annotation_clip=False, arrowprops=style,
    )  # fmt: skip
    panel.text(
        share + 0.01, above, f"{length:g} um", transform=panel.transAxes, va="center", fontsize=8
    )
