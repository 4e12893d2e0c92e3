"""The errors of the features as arrows with uncertainty ellipses (Gilsinn & Ling 2004, Fig. 6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures, labels
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN_IDS = 80
"""More features than this are drawn without their names."""
CHARACTER = 0.066
"""Width of a character of a name, inches."""
GAP = 0.07
"""Between a feature and its name, inches."""


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
    `inch` the mm in an inch of paper. There is room for names where `named`.
    """

    scale: float
    spacing: float
    step: float
    inch: float
    named: bool
    low: FloatArray
    high: FloatArray

    @property
    def aspect(self) -> float:
        """Width over height."""
        width, height = self.high - self.low
        return float(width / height)


@figures.styled
def figure(result: PointsResult) -> Figure:
    """Arrows of (Ex, Ey) at the features, ellipses of k standard uncertainties about their tips.

    An axis that is not in the plane, or a machine without Ex and Ey, is drawn feature by
    feature beside it.
    """
    axes = result.prediction.axes
    in_plane = "x" in axes and "y" in axes
    apart = [axis for axis in axes if not in_plane or axis not in ("x", "y")]
    widths = [2.1] * in_plane + [1.0] * len(apart)
    page = figures.blank(8.0 + 1.6 * (len(widths) - 1), 7.4)
    panels = page.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
    if in_plane:
        _predicted(panels[0], _plane(result))
    for panel, axis in zip(panels[int(in_plane) :], apart, strict=True):
        _draw_axis(panel, result, axis)
    return page


def _plane(result: PointsResult) -> Plane:
    axes = result.prediction.axes
    n, a = len(result.prediction.ids), len(axes)
    chosen = [axes.index("x"), axes.index("y")]
    blocks = result.covariance.reshape(n, a, n, a)[np.arange(n), :, np.arange(n), :]
    return Plane(
        ids=result.prediction.ids,
        places=result.points[:, :2],
        errors=result.prediction.mean.reshape(n, a)[:, chosen] / UM,
        covariance=blocks[:, chosen][:, :, chosen] / UM**2,
        k=result.coverage_factor,
    )


def _predicted(panel: Axes, plane: Plane) -> None:
    view = common_view([plane], (6.4, 5.9))
    draw_plane(panel, plane, view)
    panel.set_xlabel("x, mm")
    panel.set_ylabel("y, mm")
    panel.set_title("Errors of the features: actual minus nominal", pad=34)
    k = plane.k
    share = 100 * (1 - math.exp(-(k**2) / 2))
    remark = f"      ellipse: {k:g} standard uncertainties ({share:.0f} % where normal)"
    scale_arrow(panel, view, figures.BLUE, rise=20.0, remark=remark)


def common_view(planes: Sequence[Plane], paper: tuple[float, float]) -> View:
    """The view in which all planes can be compared on `paper` (width, height) inches each.

    Neighbours' ellipses about touch at the largest u, and the longest arrow is about as long as
    features are apart (a little longer without ellipses), never as long as the part.
    """
    places = np.vstack([plane.places for plane in planes])
    spacing, extent = _spacing(places), float(np.ptp(places, axis=0).max())
    step = min(spacing, 0.3 * extent) if extent > 0 else spacing
    scale = min(_scale(plane, step) for plane in planes)
    scale = scale if math.isfinite(scale) else 1.0
    corners = [places]
    for plane in planes:
        tips, radii = _tips(plane, scale), _radii(plane, scale)[:, None]
        corners += [tips - radii, tips + radii]
    found = np.vstack(corners)
    low, high = found.min(axis=0) - 0.5 * step, found.max(axis=0) + 0.5 * step
    size = np.array(paper)
    longest = CHARACTER * max(len(name) for plane in planes for name in plane.ids)
    margins = np.array([GAP + longest, 2 * GAP + longest / 2])
    named = max(len(plane.ids) for plane in planes) <= SHOWN_IDS
    named &= longest <= 0.6 * spacing / float(((high - low) / size).max())
    if named and (margins < 0.3 * size).all():
        beside = margins * float((np.ptp(places, axis=0) / (size - 2 * margins)).max())
        low = np.minimum(low, places.min(axis=0) - beside)
        high = np.maximum(high, places.max(axis=0) + beside)
    return View(
        scale=scale,
        spacing=spacing,
        step=step,
        inch=float(((high - low) / size).max()),
        named=named,
        low=low,
        high=high,
    )


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


def _spacing(places: FloatArray) -> float:
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
    tips, radii = _tips(plane, view.scale), _radii(plane, view.scale)
    fine = min(1.0, max(0.35, view.spacing / view.inch / 0.6))
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
        width=0.022 * fine,
        headwidth=4.5,
        headlength=5.5,
        headaxislength=5,
        minlength=0.1,
        zorder=6,
    )
    panel.plot(*plane.places.T, "o", color=figures.INK, markersize=3.2 * fine, zorder=5)
    panel.set_aspect("equal")
    panel.set_xlim(view.low[0], view.high[0])
    panel.set_ylim(view.low[1], view.high[1])
    if view.named:
        longest = CHARACTER * max(map(len, plane.ids))
        reach = max(0.26 * view.step, view.inch * (GAP + longest / 2))
        placed = labels.around(plane.places, tips, radii, reach)
        for name, (x, y) in zip(plane.ids, placed, strict=True):
            panel.text(x, y, name, ha="center", va="center", fontsize=7.5, zorder=6)
        for text in panel.texts:
            text.set_path_effects(labels.halo())


def _ellipses(panel: Axes, tips: FloatArray, squares: FloatArray) -> None:
    """Ellipses e' S^-1 e = 1 about the tips (n, 2); S (n, 2, 2) in mm^2 of the figure."""
    from matplotlib.patches import Ellipse

    values, vectors = np.linalg.eigh(squares)
    semi = np.sqrt(np.clip(values, 0.0, None))
    for tip, size, turned in zip(tips, semi, vectors, strict=True):
        panel.add_patch(
            Ellipse(
                (float(tip[0]), float(tip[1])),
                2 * float(size[1]),
                2 * float(size[0]),
                angle=math.degrees(math.atan2(turned[1, 1], turned[0, 1])),
                facecolor=figures.PALE,
                edgecolor=figures.BLUE,
                linewidth=0.8,
                alpha=0.55,
                zorder=2,
            )
        )


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


def _draw_axis(panel: Axes, result: PointsResult, axis: str) -> None:
    """E -+ U of one axis, feature by feature."""
    step, start = len(result.prediction.axes), result.prediction.axes.index(axis)
    error = result.prediction.mean[start::step] / UM
    U = result.coverage_factor * np.sqrt(result.variance[start::step]) / UM
    rows = np.arange(len(error))
    panel.axvline(0.0, color=figures.GREY, linewidth=0.8)
    panel.errorbar(
        error,
        rows,
        xerr=U,
        fmt="o",
        color=figures.BLUE,
        ecolor=figures.BLUE,
        elinewidth=1.2,
        capsize=2.5,
        markersize=3.5,
    )
    every = max(1, math.ceil(len(rows) / 40))
    panel.set_yticks(rows[::every], list(result.prediction.ids[::every]))
    panel.invert_yaxis()
    panel.set_xlabel(f"E{axis}, um")
    panel.set_title(f"E{AXES[AXES.index(axis)]} ± {result.coverage_factor:g} u")
