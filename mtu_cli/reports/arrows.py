"""The errors of the features as arrows with uncertainty ellipses (Gilsinn & Ling 2004, Fig. 6)."""

from __future__ import annotations

import math
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    """Features in the xy plane: places (n, 2) mm, errors (n, 2) um, covariance (n, 2, 2) um^2."""

    ids: tuple[str, ...]
    places: FloatArray
    errors: FloatArray
    covariance: FloatArray
    k: float


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
        _draw_plane(panels[0], _plan(result))
    for panel, axis in zip(panels[int(in_plane) :], apart, strict=True):
        _draw_axis(panel, result, axis)
    return page


def _plan(result: PointsResult) -> _Plan:
    axes = result.prediction.axes
    n, a = len(result.prediction.ids), len(axes)
    chosen = [axes.index("x"), axes.index("y")]
    blocks = result.covariance.reshape(n, a, n, a)[np.arange(n), :, np.arange(n), :]
    return _Plan(
        ids=result.prediction.ids,
        places=result.points[:, :2],
        errors=result.prediction.mean.reshape(n, a)[:, chosen] / UM,
        covariance=blocks[:, chosen][:, :, chosen] / UM**2,
        k=result.coverage_factor,
    )


def _draw_plane(panel: Axes, plan: _Plan) -> None:
    spacing = _spacing(plan.places)
    scale = _scale(plan, spacing)
    tips = plan.places + scale * plan.errors
    radii = np.array([_ellipse(panel, plan, i, tips[i], scale) for i in range(len(tips))])
    panel.quiver(
        *plan.places.T,
        *(tips - plan.places).T,
        angles="xy",
        scale_units="xy",
        scale=1,
        color=figures.BLUE,
        width=0.0035,
        headwidth=4.5,
        headlength=5.5,
        headaxislength=5,
        zorder=4,
    )
    panel.plot(*plan.places.T, "o", color=figures.INK, markersize=3.2, zorder=5)
    _frame(panel, plan, tips, radii, spacing, scale)
    if len(plan.ids) <= SHOWN_IDS:
        placed = labels.around(plan.places, tips, radii, 0.26 * spacing)
        for name, (x, y) in zip(plan.ids, placed, strict=True):
            panel.text(
                x, y, name, ha="center", va="center", fontsize=7.5, zorder=6, clip_on=True
            ).set_path_effects(labels.halo())


def _ellipse(panel: Axes, plan: _Plan, i: int, tip: FloatArray, scale: float) -> float:
    """Draws the ellipse of k sigma; its larger semi-axis in mm of the figure."""
    from matplotlib.patches import Ellipse

    values, vectors = np.linalg.eigh(plan.covariance[i])
    semi = plan.k * scale * np.sqrt(np.clip(values, 0.0, None))
    panel.add_patch(
        Ellipse(
            (float(tip[0]), float(tip[1])),
            2 * float(semi[1]),
            2 * float(semi[0]),
            angle=math.degrees(math.atan2(vectors[1, 1], vectors[0, 1])),
            facecolor=figures.PALE,
            edgecolor=figures.BLUE,
            linewidth=0.8,
            alpha=0.55,
            zorder=2,
        )
    )
    return float(semi[1])


def _spacing(places: FloatArray) -> float:
    """The typical distance of a feature to its nearest neighbour."""
    if len(places) < 2:
        return 10.0
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    apart[apart < 1e-9] = np.inf
    nearest = apart.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return float(np.median(nearest)) if len(nearest) else 10.0


def _scale(plan: _Plan, spacing: float) -> float:
    """mm of the figure a um of error: neighbours' ellipses about touch at the largest u."""
    largest_u = plan.k * float(np.sqrt(np.linalg.eigvalsh(plan.covariance)[:, -1].max()))
    longest = float(np.linalg.norm(plan.errors, axis=1).max())
    limits = [0.42 * spacing / largest_u] if largest_u > 0 else []
    limits += [1.1 * spacing / longest] if longest > 0 else []
    return min(limits, default=1.0)


def _frame(
    panel: Axes, plan: _Plan, tips: FloatArray, radii: FloatArray, spacing: float, scale: float
) -> None:
    low = np.minimum(plan.places, tips - radii[:, None]).min(axis=0) - 0.5 * spacing
    high = np.maximum(plan.places, tips + radii[:, None]).max(axis=0) + 0.5 * spacing
    panel.set_aspect("equal")
    panel.set_xlim(low[0], high[0])
    panel.set_ylim(low[1], high[1])
    panel.set_xlabel("x, mm")
    panel.set_ylabel("y, mm")
    panel.set_title("Errors of the features: actual minus nominal", pad=34)
    length = nice(1.1 * spacing / scale)
    share = length * scale / float(high[0] - low[0])
    panel.annotate(
        "",
        xy=(share, 1.045),
        xytext=(0.0, 1.045),
        xycoords="axes fraction",
        annotation_clip=False,
        arrowprops={
            "arrowstyle": "-|>",
            "color": figures.BLUE,
            "linewidth": 1.6,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
    panel.text(
        share + 0.015,
        1.045,
        f"{length:g} um      ellipse: {plan.k:g} standard uncertainties"
        f" ({100 * (1 - math.exp(-(plan.k**2) / 2)):.0f} % where normal)",
        transform=panel.transAxes,
        va="center",
        fontsize=8,
    )


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
