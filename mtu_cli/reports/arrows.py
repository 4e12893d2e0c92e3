"""Errors as arrows with uncertainty ellipses in a plane (Gilsinn & Ling 2004, Fig. 6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.reports import figures, labels
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN_IDS = 80
"""More features than this are drawn without their names."""
HIGH, BETWEEN = 0.15, 3.0
"""Height of a name with what is between two lines, inches; characters between two names in one,
the sign for what is left out among them, which is wide.
"""
GAP = 0.07
"""Between a feature and its name, inches."""
FARTHEST = 0.3
"""From a feature to the middle of a short name, inches, however much room there is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """Features in the xy plane: places (n, 2) mm, errors (n, 2) um.

    Ellipses are those of k standard uncertainties by `covariance` (n, 2, 2) um^2, none without.
    """

    ids: tuple[str, ...]
    places: FloatArray
    errors: FloatArray
    covariance: FloatArray | None = None
    k: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What planes drawn beside one another share.

    `scale` mm of the figure a um of error, `spacing` of neighbouring features in mm, `step` the
    same or, of features far apart, a part of the whole; limits `low` and `high` (2,) in mm,
    `inch` the mm in an inch of paper. There is room for names of so many `letters`; of 0 for none.
    """

    scale: float
    spacing: float
    step: float
    inch: float
    letters: int
    low: FloatArray
    high: FloatArray

    @property
    def named(self) -> bool:
        """Whether there is room for names."""
        return self.letters > 0

    @property
    def aspect(self) -> float:
        """Width over height."""
        width, height = self.high - self.low
        return float(width / height)


def common_view(
    planes: Sequence[Plane],
    paper: tuple[float, float],
    spacing: float | None = None,
    limit: float = math.inf,
) -> View:
    """The view in which all planes can be compared on `paper` (width, height) inches each.

    `spacing` of neighbouring features, mm, where they are not neighbours in all planes together;
    `limit` is the largest scale.

    Neighbours' ellipses about touch at the largest u, and the longest arrow is about as long as
    features are apart (a little longer without ellipses), never as long as the part.
    """
    places = np.vstack([plane.places for plane in planes])
    spacing = spacing_of(places) if spacing is None else spacing
    extent = float(np.ptp(places, axis=0).max())
    step = min(spacing, 0.3 * extent) if extent > 0 else spacing
    scale = min(limit, *(_scale(plane, step) for plane in planes))
    scale = scale if math.isfinite(scale) else 1.0
    corners = [corner for plane in planes for corner in _corners(plane, scale)]
    found = np.vstack([places, *corners])
    low, high = found.min(axis=0) - 0.5 * step, found.max(axis=0) + 0.5 * step
    size = np.array(paper)
    letters = _letters(planes, spacing, float(((high - low) / size).max()))
    longest = labels.CHARACTER * letters
    margins = np.array([GAP + longest, 2 * GAP + longest / 2])
    if letters and (margins < 0.3 * size).all():
        beside = margins * float((np.ptp(places, axis=0) / (size - 2 * margins)).max())
        low = np.minimum(low, places.min(axis=0) - beside)
        high = np.maximum(high, places.max(axis=0) + beside)
    return View(
        scale=scale,
        spacing=spacing,
        step=step,
        inch=float(((high - low) / size).max()),
        letters=letters,
        low=low,
        high=high,
    )


def _corners(plane: Plane, scale: float) -> tuple[FloatArray, FloatArray]:
    """Beyond the ends of all arrows and ellipses, (n, 2) each."""
    tips, radii = _tips(plane, scale), _radii(plane, scale)[:, None]
    return tips - radii, tips + radii


def _letters(planes: Sequence[Plane], spacing: float, inch: float) -> int:
    """Characters of a name that there is room for, `inch` mm to an inch of paper."""
    if max(len(plane.ids) for plane in planes) > SHOWN_IDS:
        return 0
    names = {name for plane in planes for name in plane.ids}
    return labels.room(names, [plane.places / inch for plane in planes], spacing / inch)


def _tips(plane: Plane, scale: float) -> FloatArray:
    tips: FloatArray = plane.places + scale * plane.errors
    return tips


def _radii(plane: Plane, scale: float) -> FloatArray:
    """The larger semi-axes (n,) of the ellipses, mm of the figure."""
    if plane.covariance is None:
        return np.zeros(len(plane.ids))
    largest = np.clip(np.linalg.eigvalsh(plane.covariance)[:, -1], 0.0, None)
    radii: FloatArray = plane.k * scale * np.sqrt(largest)
    return radii


def spacing_of(places: FloatArray) -> float:
    """The typical distance of a feature to its nearest neighbour."""
    from scipy.spatial import KDTree

    apart = np.unique(np.round(places, 6), axis=0)
    if len(apart) < 2:
        return 10.0
    nearest, _ = KDTree(apart).query(apart, k=[2])
    return float(np.median(np.asarray(nearest)))


def _scale(plane: Plane, step: float) -> float:
    """mm of the figure a um of error; infinite where there is nothing to draw."""
    largest_u = float(_radii(plane, 1.0).max())
    longest = float(np.linalg.norm(plane.errors, axis=1).max())
    limits = [0.42 * step / largest_u] if largest_u > 0 else []
    reach = (1.1 if largest_u > 0 else 1.35) * step
    limits += [reach / longest] if longest > 0 else []
    return min(limits, default=math.inf)


def draw_plane(panel: Axes, plane: Plane, view: View, colour: str = figures.BLUE) -> None:
    """Arrows, ellipses, marks and, where there is room, names."""
    draw_arrows(panel, plane, view, colour)
    frame(panel, view)
    draw_marks(panel, plane.places, view)
    if view.named:
        write_names(panel, [plane], view)


def draw_arrows(
    panel: Axes, plane: Plane, view: View, colour: str, *, thickness: float = 1.0
) -> None:
    """The arrows, and the ellipses about their tips; heads of thicker ones grow less."""
    tips = _tips(plane, view.scale)
    if plane.covariance is not None:
        _ellipses(panel, tips, plane.covariance * (plane.k * view.scale) ** 2)
    panel.quiver(
        *plane.places.T,
        *(tips - plane.places).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        color=colour,
        units="inches",
        width=0.022 * _fine(view) * thickness,
        headwidth=4.5 / thickness**0.5,
        headlength=5.5 / thickness**0.5,
        headaxislength=5 / thickness**0.5,
        minlength=0.1,
        zorder=6,
    )


def draw_marks(panel: Axes, places: FloatArray, view: View) -> None:
    """A dot a feature."""
    panel.plot(*places.T, "o", color=figures.INK, markersize=3.2 * _fine(view), zorder=5)


def frame(panel: Axes, view: View) -> None:
    """The limits of the view, a mm of x as long as one of y."""
    panel.set_aspect("equal")
    panel.set_xlim(view.low[0], view.high[0])
    panel.set_ylim(view.low[1], view.high[1])


def _fine(view: View) -> float:
    """Lines and marks of features close together are finer."""
    return min(1.0, max(0.35, view.spacing / view.inch / 0.6))


def write_names(panel: Axes, planes: Sequence[Plane], view: View) -> None:
    """Names of the features of the first plane, clear of the arrows of all."""
    first, others = planes[0], planes[1:]
    names = [labels.clipped(name, view.letters) for name in first.ids]
    longest = labels.CHARACTER * max(map(len, names))
    near = min(0.26 * view.step, FARTHEST * view.inch)
    reach = max(near, view.inch * (GAP + longest / 2))
    placed = labels.around(
        first.places, _tips(first, view.scale), _radii(first, view.scale), reach,
        also=[(plane.places, _tips(plane, view.scale)) for plane in others],
        boxes=(
            view.inch * labels.CHARACTER * np.array([len(name) + BETWEEN for name in names]),
            view.inch * HIGH,
        ),
    )  # fmt: skip
    for name, (x, y) in zip(names, placed, strict=True):
        panel.text(x, y, name, ha="center", va="center", fontsize=7.5, zorder=6)
    for text in panel.texts:
        text.set_path_effects(labels.halo())


def _ellipses(panel: Axes, tips: FloatArray, squares: FloatArray) -> None:
    """Ellipses e' S^-1 e = 1 about the tips (n, 2); S (n, 2, 2) in mm^2 of the figure."""
    from matplotlib.collections import EllipseCollection

    values, vectors = np.linalg.eigh(squares)
    semi = np.sqrt(np.clip(values, 0.0, None))
    # One by one, thousands would each be searched for their limits: the view has them all.
    found = EllipseCollection(
        2 * semi[:, 1],
        2 * semi[:, 0],
        np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])),
        units="xy",
        offsets=tips,
        offset_transform=panel.transData,
        facecolors=figures.PALE,
        edgecolors=figures.BLUE,
        linewidths=0.8,
        alpha=0.55,
        zorder=2,
    )
    panel.add_collection(found, autolim=False)


def scale_arrow(
    panel: Axes, view: View, colour: str, rise: float, remark: str = "", length: float | None = None
) -> None:
    """An arrow of `length`, or a round number, of um, `rise` points above the panel."""
    from matplotlib.transforms import ScaledTranslation

    lifted = panel.transAxes + ScaledTranslation(0, rise / 72, panel.figure.dpi_scale_trans)
    width = float(view.high[0] - view.low[0])
    if length is None:
        length = nice(max(1.1 * view.step, 0.15 * width) / view.scale)
    share = length * view.scale / width
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    panel.annotate(
        "",
        xy=(share, 1.0),
        xytext=(0.0, 1.0),
        xycoords=lifted,
        annotation_clip=False,
        arrowprops=style,
    )
    beside = lifted + ScaledTranslation(5 / 72, 0, panel.figure.dpi_scale_trans)
    panel.text(share, 1.0, f"{length:g} um{remark}", transform=beside, va="center", fontsize=8)


def nice(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most `value`."""
    power = 10.0 ** math.floor(math.log10(value)) if value > 0 else 1.0
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * (1 + 1e-9))
