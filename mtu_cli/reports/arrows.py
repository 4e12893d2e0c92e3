"""Errors at the features as arrows on maps: small multiples by operation and height.

Arrows in the plane (Gilsinn & Ling 2004, Fig. 6) above those across it, which are drawn upwards;
what is compared (predicted and measured, before and after) is drawn over one another, the first
thicker, with ellipses of k standard uncertainties about the tips where a covariance is known.
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
NAMED, SHORTEST, LONGEST = 80, 4, 40
"""More features than this are drawn without names; letters of a name, at least and at most."""
LINE, GAP = 0.15, 0.06
"""Height of a line of names, and the gap before them, inches."""
REACH, UPWARDS, RADIUS = 0.95, 0.8, 0.42
"""Of the longest arrow in the plane and across it, and of the largest ellipse, over the distance
of neighbours."""
ALIKE = 2.0
"""Scales in and across the plane that differ by less are made one."""
LOWEST, TALLEST, ALONE = 1.0, 4.6, 6.2
"""Heights of a panel, inches; the last of a panel that is alone in its row."""
ABOVE = 0.85
"""Inches of title, scale and labels of a row."""
CLOSER = 0.65
"""Features in rings and clusters are closer than those that are spread evenly."""
THIN = 0.035
"""Half the width of the ellipses of errors across the plane, inches."""


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
    """Of a side in a panel: places (m, 2) mm, errors (m, 2) um and k times the root of the
    covariances, as matrices (m, 2, 2) um^2, of the features whose errors are known.
    """

    side: Side
    places: FloatArray
    errors: FloatArray
    squares: FloatArray

    @property
    def radius(self) -> FloatArray:
        """The longest half axis (m,) of every ellipse, um."""
        half: FloatArray = np.sqrt(np.clip(np.linalg.eigvalsh(self.squares)[:, -1], 0.0, None))
        return half


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
    `inch` mm in an inch, `scales` mm of the figure a um in the plane and across it, `spacing` of
    neighbours in mm, and room for names of so many `letters`.
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
    inch: float
    scales: dict[bool, float]
    spacing: float
    letters: int

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
    kinds = [plane, [normal]] if both else [plane]
    strips = [
        [_panel(maps, group, plane, axes, rows) for rows in levels]
        for group in maps.groups
        for axes in kinds
    ]
    rows, columns = _rows(strips, flat, of_one_level=len(levels) == 1, both=both)
    room = width or (8.0 if columns == 1 else 12.0)
    tallest = ALONE if columns == 1 else TALLEST
    paper = np.array([(room - 0.9) / columns - 0.2, tallest])
    spacing, extent = _spacing(flat, levels), float(np.ptp(flat, axis=0).max())
    step = min(spacing, 0.3 * extent) if extent > 0 else spacing
    panels = [panel for row in rows for panel in row]
    scales = _scales(panels, step)
    corners = [flat]
    for panel in panels:
        for item in panel.arrows:
            beyond, scale = item.radius[:, None], scales[panel.across]
            corners += [item.places + scale * (item.errors + sign * beyond) for sign in (-1, 1)]
    ends = np.vstack(corners)
    low, high = ends.min(axis=0) - 0.25 * step, ends.max(axis=0) + 0.25 * step
    letters = _letters(maps.ids, flat / float(((high - low) / paper).max()), levels)
    beside = np.array([2 * GAP + LETTER * letters, 2 * GAP + LINE]) * bool(letters)
    # Names need room beside the features, not beside the tips.
    inch = float((np.ptp(flat, axis=0) / np.maximum(paper - 2 * beside, 0.4 * paper)).max())
    low = np.minimum(low, flat.min(axis=0) - beside * inch)
    high = np.maximum(high, flat.max(axis=0) + beside * inch)
    inch = float(((high - low) / paper).max())
    wide, tall = ((high - low) / inch).tolist()
    return Sheet(
        maps=maps, plane=plane, rows=rows, columns=columns, shown=len(levels), total=total,
        width=max(8.0, min(room, columns * (wide + 0.2) + 0.9)), low=low, high=high, inch=inch,
        panel=min(max(tall, LOWEST), tallest), scales=scales, spacing=spacing, letters=letters,
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
        arrows.append(Arrows(side, maps.places[known][:, plane], errors, squares))
    kind = " and ".join(f"E{AXES[axis]}" for axis in axes) + " (up is +)" * (len(axes) == 1)
    (normal,) = {0, 1, 2} - {*plane}
    heights, at = maps.places[rows, normal] + 0.0, ""
    if np.isfinite(heights).any():
        low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
        level = high - low <= 1e-3 * max(1.0, abs(high))
        at = f" = {np.nanmedian(heights):.6g} mm" if level else f" {low:.6g} to {high:.6g} mm"
        at = AXES[normal] + at
    return Panel(", ".join(filter(None, (cut(group[0], 20), kind, at))), rows, axes, arrows)


def _rows(
    strips: list[list[Panel]], flat: FloatArray, *, of_one_level: bool, both: bool
) -> tuple[list[list[Panel]], int]:
    """A row a group and direction, a column a level; of one level all in rows one after another."""
    if of_one_level:
        strips = [[panel for strip in strips for panel in strip]]
    width, height = np.ptp(flat, axis=0)
    most = 1 if width > 5 * height > 0 else 2 if width > 2.2 * height > 0 else 3
    most = min(most, 2) if of_one_level and both else most
    columns = figures.columns_of(len(strips[0]), most)
    rows = [strip[i : i + columns] for strip in strips for i in range(0, len(strip), columns)]
    return rows, columns


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


def _scales(panels: list[Panel], step: float) -> dict[bool, float]:
    """mm of the figure a um, in the plane and across it."""
    scales = dict.fromkeys([panel.across for panel in panels], math.inf)
    for panel in panels:
        for item in panel.arrows:
            longest = float(np.linalg.norm(item.errors, axis=1).max(initial=0.0))
            radius = float(item.radius.max(initial=0.0))
            reach = UPWARDS if panel.across else REACH
            for size, share in ((longest, reach), (radius, RADIUS)):
                if size > 0:
                    scales[panel.across] = min(scales[panel.across], share * step / size)
    if max(scales.values()) <= ALIKE * min(scales.values()):
        scales = dict.fromkeys(scales, min(scales.values()))
    return {across: value if math.isfinite(value) else 1.0 for across, value in scales.items()}


def _letters(ids: tuple[str, ...], inches: FloatArray, levels: list[IntArray]) -> int:
    """Letters of a name that have room between features at `inches` (n, 2) in one line; 0 for no
    names.
    """
    longest, room = max(map(len, ids)), float(LONGEST)
    if max(map(len, levels)) > NAMED:
        return 0
    for rows in levels:
        apart = np.abs(inches[rows][:, None] - inches[rows][None])
        dx, dy = apart[np.triu_indices(len(rows), 1)].T
        room = min(room, float(dx[dy < LINE].min(initial=np.inf)) / LETTER - 1.0)
    letters = min(longest, int(room))
    alike = len({cut(name, letters) for name in ids}) < len(ids)
    return 0 if alike or letters < min(longest, SHORTEST) else letters


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
            blank[c].set_ylabel(f"{up}, mm" if c == 0 else "")
            if c == 0 or what.across != row[c - 1].across:
                _scale_arrow(blank[c], drawn, drawn.scales[what.across])


def _draw_panel(panel: Axes, drawn: Sheet, what: Panel) -> None:
    """Lines and marks of features close together are finer."""
    scale, fine = drawn.scales[what.across], min(1.0, max(0.35, drawn.spacing / drawn.inch / 0.6))
    for i, item in enumerate(what.arrows):
        if item.side.covariance is not None:
            least = what.across * THIN * drawn.inch
            tips = item.places + scale * item.errors
            _ellipses(panel, tips, item.squares * scale**2, least)
        # The first is wider, to be seen where both are the same.
        thick = 2.0 if len(what.arrows) > 1 and i == 0 else 1.0
        panel.quiver(
            *item.places.T, *scale * item.errors.T, angles="xy", scale_units="xy", scale=1,
            color=item.side.colour, units="inches", width=0.022 * fine * thick,
            headwidth=4.5 / thick**0.5, headlength=5.5 / thick**0.5, headaxislength=5 / thick**0.5,
            minlength=0.1, zorder=4,
        )  # fmt: skip
    dots = drawn.maps.places[what.rows][:, drawn.plane]
    panel.plot(*dots.T, "o", color=figures.INK, markersize=2.6 * fine, zorder=5)
    panel.set_aspect("equal")
    panel.set_xlim(drawn.low[0], drawn.high[0])
    panel.set_ylim(drawn.low[1], drawn.high[1])
    if drawn.letters:
        _write_names(panel, drawn, what)
    panel.set_title(what.title, pad=20, fontsize=9)


def _ellipses(panel: Axes, tips: FloatArray, squares: FloatArray, least: float) -> None:
    """Ellipses e' S^-1 e = 1 about the tips (n, 2); S (n, 2, 2) in mm^2 of the figure; none is
    narrower than `least`, mm.
    """
    from matplotlib.collections import EllipseCollection

    values, vectors = np.linalg.eigh(squares)
    semi = np.maximum(np.sqrt(np.clip(values, 0.0, None)), least)
    # One by one, thousands would each be searched for their limits: the sheet has them all.
    found = EllipseCollection(
        2 * semi[:, 1], 2 * semi[:, 0],
        np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])), units="xy", offsets=tips,
        offset_transform=panel.transData, facecolors=figures.PALE, edgecolors=figures.BLUE,
        linewidths=0.8, alpha=0.55, zorder=2,
    )  # fmt: skip
    panel.add_collection(found, autolim=False)


def _write_names(panel: Axes, drawn: Sheet, what: Panel) -> None:
    """Names across their arrows: to the left of upright ones, above or below level ones."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.2, foreground="white")]
    total = np.nansum([item.side.errors for item in what.arrows], axis=0)
    for row in what.rows:
        across, up = (0.0, *total[row, what.axes])[-2:]
        upright, below = abs(up) >= abs(across), up >= 0.0
        panel.annotate(
            cut(drawn.maps.ids[row], drawn.letters),
            drawn.maps.places[row, drawn.plane].tolist(), textcoords="offset points",
            xytext=(-72 * GAP, 0) if upright else (0, 72 * GAP * (-1) ** below),
            ha="right" if upright else "center",
            va="center" if upright else ("top" if below else "bottom"),
            fontsize=7.5, zorder=6, path_effects=halo,
        )  # fmt: skip


def _scale_arrow(panel: Axes, drawn: Sheet, scale: float) -> None:
    """An arrow of a round number of um above the panel: 1, 2 or 5 times a power of ten."""
    from matplotlib.transforms import ScaledTranslation

    inches = panel.figure.dpi_scale_trans
    lifted = panel.transAxes + ScaledTranslation(0, 11 / 72, inches)
    width = float(drawn.high[0] - drawn.low[0])
    most = max(1.1 * min(drawn.spacing, 0.3 * width), 0.15 * width) / scale
    power = 10.0 ** math.floor(math.log10(most))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1 + 1e-9))
    share = length * scale / width
    style = {"arrowstyle": "-|>", "color": figures.INK, "linewidth": 1.6, "shrinkA": 0}
    panel.annotate(
        "", xy=(share, 1.0), xytext=(0.0, 1.0), xycoords=lifted, annotation_clip=False,
        arrowprops={**style, "shrinkB": 0},
    )  # fmt: skip
    beside = lifted + ScaledTranslation(5 / 72, 0, inches)
    panel.text(share, 1.0, f"{length:g} um", transform=beside, va="center", fontsize=8)
