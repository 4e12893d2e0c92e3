"""What all figures share: the style, the bytes of a file, intervals, bars, histograms, legends; and
errors at the features as arrows on maps by operation and height (Gilsinn & Ling 2004, Fig. 6),
with ellipses of k standard uncertainties about the tips.
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.reports.numbers import cut, significant, spread
from mtu_cli.stats.coverage import PROBABILITY, coverage_factor
from mtu_cli.stats.least_squares import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes  # for modules that draw
    from matplotlib.figure import Figure as Figure
    from matplotlib.figure import SubFigure as SubFigure


INK = "#1b1f24"
GREY = "#8a929c"
BLUE = "#1f5fa8"
ORANGE = "#d9772b"
RED = "#b3261e"
PALE = "#c9dcf0"

LETTER = 0.066
"""Width of a letter of a name, inches."""

_STYLE: Any = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.formatter.offset_threshold": 5,
    "grid.color": "#e6e9ed",
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "text.color": INK,
    # Names and titles of a file are shown sign by sign, pairs of dollars too.
    "text.parse_math": False,
    "lines.linewidth": 1.4,
    "figure.dpi": 150,
    "figure.constrained_layout.w_pad": 0.08,
    "figure.constrained_layout.h_pad": 0.08,
    "savefig.dpi": 150,
    "svg.hashsalt": "mtu",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}


def house_style() -> AbstractContextManager[None]:
    """Matplotlib's defaults and this style on top, whatever the user's settings file."""
    from matplotlib import style

    return style.context(_STYLE, after_reset=True)


def blank(width: float, height: float) -> Figure:
    """An empty figure, inches; 8 inches are 1200 pixels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def figure_bytes(draw: Callable[[], Figure], suffix: str) -> bytes:
    """What is drawn, in the house style, as the bytes of a PNG, SVG or PDF file, without dates."""
    kind = suffix.lower().removeprefix(".")
    out = io.BytesIO()
    with house_style(), warnings.catch_warnings():
        figure = draw()
        # Names are the user's: a sign that the font lacks is drawn as a box, without a warning.
        warnings.filterwarnings("ignore", r"Glyph .* missing from", UserWarning)
        # Laid out once: with an engine savefig would do it again, and twice.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        dates = {"png": ["Software"], "svg": ["Date"], "pdf": ["CreationDate", "ModDate"]}[kind]
        figure.savefig(out, format=kind, metadata=dict.fromkeys(dates))
    return out.getvalue()


def listing(
    text: str,
    names: Sequence[str],
    intervals: Sequence[tuple[str, str, FloatArray, FloatArray | None, float]],
    label: str,
    *,
    limits: Sequence[FloatArray] = (),
    texts: Sequence[str] = (),
) -> Figure:
    """A page of intervals about values, a row each from top to bottom, of many some evenly apart:
    label, colour, values (n,), half widths (n,) or None, and how far below the middle of the row.
    `limits` (n,) in red, nan where there are none; `texts` beside the rows.
    """
    index = spread(len(names), 80)
    rows = np.arange(len(index))
    page = blank(8.0, (0.36 if len(index) <= 24 else 0.25) * len(index) + 1.7)
    title(page, text + f" ({len(index)} of {len(names)})" * (len(index) < len(names)))
    panel = page.subplots()
    panel.axvline(0.0, color=GREY, linewidth=0.9)
    for name, colour, value, half, shift in intervals:
        panel.errorbar(
            value[index], rows + shift, xerr=None if half is None else half[index], fmt="o",
            color=colour, elinewidth=2.0, capsize=2.0, markersize=4.0, label=name,
        )  # fmt: skip
    for limit in limits:
        if np.isfinite(limit[index]).any():
            panel.vlines(limit[index], rows - 0.3, rows + 0.4, color=RED, lw=2.0, label="tolerance")
    for row, i in enumerate(index if texts else ()):
        panel.annotate(
            texts[i], (1.01, row), xycoords=panel.get_yaxis_transform(), va="center",
            fontsize=7.5, annotation_clip=False,
        )  # fmt: skip
    panel.set_yticks(rows, [cut(names[i], 34) for i in index])
    panel.set(ylim=(len(index) - 0.4, -0.6), xlabel=label)
    panel.grid(axis="y", visible=False)
    legend(page)
    return page


def bars(
    panel: Axes, names: Sequence[str], values: Sequence[float] | FloatArray, texts: Sequence[str]
) -> None:
    """A bar a row from top to bottom, negative ones in another colour, its text at its end."""
    rows = range(len(values))
    colours = [BLUE if value >= 0 else ORANGE for value in values]
    patches = panel.barh(rows, values, color=colours, height=min(0.66, 0.17 * len(values)))
    panel.bar_label(patches, texts, padding=3, fontsize=7.5)
    panel.set_yticks(rows, names)
    panel.set_ylim(max(len(values), 1) - 0.4, -0.6)
    # Texts of negative bars would reach the names.
    panel.margins(x=0.16 if all(value >= 0 for value in values) else 0.32)
    panel.axvline(0.0, color=GREY, linewidth=0.8)
    panel.grid(axis="y", visible=False)


def shades(count: int) -> list[Any]:
    """Colours from dark to light: early and late passes, one end of an axis and the other."""
    from matplotlib import colormaps

    return [colormaps["viridis"](0.05 + 0.8 * i / max(count - 1, 1)) for i in range(count)]


def panels_of(page: Figure | SubFigure, count: int, columns: int) -> list[Axes]:
    """`count` panels row by row, and blank ones where the last row has more."""
    rows = math.ceil(count / columns)
    panels: list[Axes] = list(page.subplots(rows, columns, squeeze=False).ravel())
    for panel in panels[count:]:
        panel.set_axis_off()
    return panels


def legend(page: Figure | SubFigure, columns: int = 4) -> None:
    """The legend of all panels, below them."""
    key(page, page.axes, loc="outside lower center", ncols=columns)


def key(target: Figure | SubFigure | Axes, panels: Sequence[Axes], **place: Any) -> None:
    """A legend on the `target` of what is in `panels`, each label once."""
    handles: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(str(label), handle)
    if handles:
        target.legend(list(handles.values()), list(handles), **place)


def title(page: Figure | SubFigure, text: str) -> None:
    """The title of a page, above its panels at the left."""
    page.suptitle(text, x=0.012, ha="left", fontsize=10.5, fontweight="bold")


def histogram(
    panel: Axes, title: str, label: str, samples: FloatArray, ends: Sequence[float],
    first: tuple[float, float, float], probability: float = PROBABILITY,
) -> None:  # fmt: skip
    """The density of the trials with the `ends` of their interval, and the curve of the `first`
    order by value, u and degrees of freedom (u 0: none).
    """
    (value, u, dof), percent = first, f"{100 * probability:.4g} %"
    half = coverage_factor(probability, dof) * u if u > 0.0 else 0.0
    first_ends = [value - half, value + half] if u > 0.0 else []
    low, high = min([*ends, *first_ends]), max([*ends, *first_ends])
    # Beyond both intervals a quarter of them.
    room = max(0.25 * (high - low), 1e-6 * max(abs(low), abs(high)), 1e-300)
    limits = low - room, high + room
    panel.hist(
        samples, 50, range=limits, density=True, histtype="stepfilled",
        color=PALE, label="Monte Carlo trials",
    )  # fmt: skip
    if u > 0.0:
        from scipy.stats import t

        grid = np.linspace(*limits, 400)
        curve = t.pdf(grid, dof, loc=value, scale=u)
        panel.plot(grid, curve, color=INK, label="first order")
        for end in first_ends:
            panel.axvline(end, color=INK, lw=1, ls="--", label=f"{percent}, first order")
    panel.axvspan(ends[0], ends[1], ymax=0.03, color=BLUE, label=f"{percent}, Monte Carlo")
    panel.set(xlim=limits, yticks=[], xlabel=label, title=title)
    panel.locator_params(axis="x", nbins=5)


def histograms(text: str, trials: Sequence[tuple[Any, ...]]) -> Figure:
    """A page of histograms, each of its arguments."""
    count, columns = max(1, len(trials)), max(1, min(len(trials), 3))
    page = blank(max(6.5, 3.7 * columns), 1.2 + 2.6 * math.ceil(count / columns))
    for panel, item in zip(panels_of(page, count, columns), trials, strict=False):
        histogram(panel, *item)
    legend(page, 2)
    title(page, text)
    return page


@dataclass(frozen=True, slots=True)
class Side:
    """Errors (n, 3) um, nan where not known; ellipses by `covariance` (n, 3, 3) um^2."""

    name: str
    colour: str
    errors: FloatArray
    covariance: FloatArray | None = None


def _drawn(
    side: Side, rows: IntArray, axes: list[int], k: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Arrows and ellipses of k u along the axes of the plane, or upwards along the one across."""
    m, arrows, squares = len(axes), np.zeros((len(rows), 2)), np.zeros((len(rows), 2, 2))
    arrows[:, -m:] = side.errors[rows][:, axes]
    if side.covariance is not None:
        squares[:, -m:, -m:] = k**2 * side.covariance[rows][:, axes][:, :, axes]
    values, directions = np.linalg.eigh(squares)
    return arrows, np.sqrt(np.clip(values, 0.0, None)), directions


class Maps:
    """Features at `places` (n, 3) mm with the sides of each group drawn over one another, along the
    `axes` of the errors, on a page `width` inches wide and `height` high; of u with k.

    Level by level from above, or from the side where all features lie in such a plane. The longest
    arrow is about as long as features are apart, and the ellipses of neighbours about touch at the
    largest u; errors across the plane are of another size, and have a scale of their own: `scales`
    are mm of the figure a um, by the number of axes of a panel.
    """

    def __init__(
        self,
        ids: Sequence[str],
        places: FloatArray,
        axes: Sequence[str],
        groups: Sequence[tuple[str, Sequence[Side]]],
        k: float = 0.0,
    ) -> None:
        flat = [len(np.unique(np.round(column, 1))) == 1 for column in places.T]
        whole = len(axes) == len(AXES)
        normal = next((axis for axis in (2, 1, 0) if whole and flat[axis]), 2)
        self.ids, self.plane = ids, [axis for axis in range(3) if axis != normal]
        self.places = places[:, self.plane]
        heights = np.round(places[:, normal], 1) + 0.0
        values, code = np.unique(np.nan_to_num(heights, nan=np.inf), return_inverse=True)
        levels = [np.flatnonzero(code == i) for i in spread(len(values), 9)]
        # Each of many has three features on average, or they are drawn together.
        if len(values) > 4 and 3 * len(values) > len(heights):
            levels = [np.arange(len(heights))]
        # Title, features of one level, axes in the plane or across, and sides.
        self.k, self.panels = k, list[tuple[str, IntArray, list[int], Sequence[Side]]]()
        sizes = {2: [1e-12], 1: [1e-12]}
        for name, sides in groups:
            for along in [self.plane, [normal]] if whole else [self.plane]:
                kind = " and ".join(f"E{AXES[axis]}" for axis in along)
                kind += " (up is +)" * (len(along) == 1)
                for rows in levels:
                    ends = {f"{h:.6g}": None for h in (heights[rows].min(), heights[rows].max())}
                    at = f"{AXES[normal]} = {' to '.join(ends)} mm"
                    at = at if np.isfinite(heights[rows]).all() else ""
                    text = ", ".join(filter(None, (cut(name, 20), kind, at)))
                    self.panels.append((text, rows, along, sides))
                    for arrows, half, _ in (_drawn(side, rows, along, k) for side in sides):
                        longest = np.linalg.norm(np.nan_to_num(arrows), axis=1).max(initial=0.0)
                        sizes[len(along)] += [longest / 0.95, half.max(initial=0.0) / 0.42]
        spacing = min(_spacing(self.places[rows]) for rows in levels)
        self.scales = {count: spacing / float(max(each)) for count, each in sizes.items()}
        self.low = self.places.min(axis=0) - 1.3 * spacing
        self.high = self.places.max(axis=0) + 1.3 * spacing
        self.columns = min(len(self.panels), len(levels) if len(levels) > 1 else 2, 3)
        self.width = 8.0 if self.columns == 1 else 12.0
        inches = (self.width - 0.9) / self.columns - 0.2
        inch = max((self.high - self.low) / (inches, 6.0))
        tall = max(1.0, float(self.high[1] - self.low[1]) / inch)
        # Each row of panels with titles, scales and labels.
        self.height = -(-len(self.panels) // self.columns) * (tall + 0.85) + 0.45
        fits = spacing / inch > LETTER * max(map(len, ids)) + 0.1
        self.named = fits and max(map(len, levels)) <= 80

    def draw(self, page: Figure | SubFigure, text: str) -> None:
        """The panels, each with its scale; title and sides above."""
        from matplotlib.lines import Line2D

        title(page, text)
        colours = {side.name: side.colour for *_, sides in self.panels for side in sides}
        handles = [Line2D([], [], color=c, lw=2.2, label=x) for x, c in colours.items() if x]
        if handles:
            page.legend(handles=handles, loc="outside upper right", ncols=len(handles))
        across, up = (AXES[axis] for axis in self.plane)
        panels = panels_of(page, len(self.panels), self.columns)
        for panel, (heading, rows, along, sides) in zip(panels, self.panels, strict=False):
            self._draw_panel(panel, rows, along, sides)
            panel.set(
                xlabel=f"{across}, mm", ylabel=f"{up}, mm", aspect="equal",
                xlim=(self.low[0], self.high[0]), ylim=(self.low[1], self.high[1]),
            )  # fmt: skip
            panel.set_title(heading, pad=20, fontsize=9)

    def _draw_panel(
        self, panel: Axes, rows: IntArray, along: list[int], sides: Sequence[Side]
    ) -> None:
        """Arrows over ellipses; names stand opposite to the arrows."""
        from matplotlib.collections import EllipseCollection
        from matplotlib.patheffects import withStroke

        places, scale = self.places[rows], self.scales[len(along)]
        total = np.zeros((len(rows), 2))
        for i, side in enumerate(sides):
            errors, half, directions = _drawn(side, rows, along, self.k)
            total += np.nan_to_num(errors)
            if side.covariance is not None:
                angles = np.degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1]))
                ellipses = EllipseCollection(
                    2 * scale * half[:, 1], 2 * scale * half[:, 0], angles, units="xy",
                    offsets=places + scale * errors, offset_transform=panel.transData,
                    facecolors=PALE, edgecolors=BLUE, linewidths=0.8, alpha=0.55,
                    zorder=2,
                )  # fmt: skip
                panel.add_collection(ellipses, autolim=False)
            # The first is wider, to be seen where both are the same.
            width = 0.04 if len(sides) > 1 and i == 0 else 0.02
            arrows = panel.quiver(
                *places.T, *errors.T, angles="xy", scale_units="xy", scale=1 / scale,
                color=side.colour, units="inches", width=width, headwidth=4, zorder=4,
            )  # fmt: skip
            if i == 0:
                length = 0.12 * float(self.high[0] - self.low[0]) / scale
                words = significant(length, 1)
                panel.quiverkey(
                    arrows, 0.12 * float(words) / length, 1.02, float(words), f"{words} um",
                    labelpos="E", color=INK,
                )  # fmt: skip
        panel.plot(*places.T, "o", color=INK, markersize=2.6, zorder=5)
        for i, row in enumerate(rows if self.named else ()):
            name, size = self.ids[row], float(np.linalg.norm(total[i]))
            unit = -total[i] / size if size > 0 else np.array([0.0, -1.0])
            panel.annotate(
                name, places[i].tolist(), textcoords="offset points", ha="center", va="center",
                xytext=(unit * (4 + 36 * LETTER * len(name), 8)).tolist(), fontsize=7.5, zorder=6,
                path_effects=[withStroke(linewidth=2.2, foreground="white")],
            )  # fmt: skip


def _spacing(places: FloatArray) -> float:
    """The distance of neighbours, mm."""
    from scipy.spatial import KDTree

    spots = np.unique(np.round(places, 3), axis=0)
    if len(spots) < 2:
        return 10.0
    nearest: Any = KDTree(spots).query(spots, 2)[0]
    return max(float(np.median(nearest[:, 1])), 0.05 * float(np.ptp(spots, axis=0).max()))
