"""The picture of predict-points: the errors of the features as arrows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Plane, common_view, draw_plane, scale_arrow
from mtu_cli.reports.labels import folded
from mtu_cli.reports.level_maps import Maps, Side, page_of
from mtu_cli.reports.levels import flat
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = 22
"""Characters of a line of a name."""
LINES = 40
"""More features than this have no line of their own."""


@figures.styled
def figure(result: PointsResult) -> Figure:
    """Arrows of (Ex, Ey) at the features, ellipses of k standard uncertainties about their tips.

    An axis that is not in the plane, or a machine without Ex and Ey, is drawn feature by
    feature beside it.
    """
    axes = result.prediction.axes
    in_plane = "x" in axes and "y" in axes
    if in_plane and not _readable(result):
        return _by_level(result)
    apart = [axis for axis in axes if not in_plane or axis not in ("x", "y")]
    widths = [2.1] * in_plane + [1.0] * len(apart)
    page = figures.blank(8.0 + 1.6 * (len(widths) - 1), 7.4)
    panels = page.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
    if in_plane:
        _predicted(panels[0], _plane(result))
    for panel, axis in zip(panels[int(in_plane) :], apart, strict=True):
        _draw_axis(panel, result, axis)
    return page


def _readable(result: PointsResult) -> bool:
    """Whether one map, beside it a line a feature of another axis, shows everything."""
    if "z" not in result.prediction.axes:
        return flat(result.points, result.prediction.axes)
    return flat(result.points, ("x", "y")) and len(result.prediction.ids) <= LINES


def _by_level(result: PointsResult) -> Figure:
    """Maps level by level."""
    axes = result.prediction.axes
    n, a = len(result.prediction.ids), len(axes)
    at = [AXES.index(axis) for axis in axes]
    errors, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    errors[:, at] = result.prediction.mean.reshape(n, a) / UM
    covariance[np.ix_(range(n), at, at)] = result.own_covariances / UM**2
    side = Side(name="", colour=figures.BLUE, errors=errors, covariance=covariance)
    maps = Maps(
        ids=result.prediction.ids, places=result.points, axes=axes, groups=(("", (side,)),),
        k=result.coverage_factor,
    )  # fmt: skip
    k = result.coverage_factor
    share = 100 * (1 - math.exp(-(k**2) / 2))
    bars = f", bars: {k:g} u" if "z" in axes else ""
    return page_of(
        maps,
        "Errors of the features: actual minus nominal (ellipses: "
        f"{k:g} standard uncertainties, {share:.0f} % where normal{bars})",
    )


def _plane(result: PointsResult) -> Plane:
    axes = result.prediction.axes
    n, a = len(result.prediction.ids), len(axes)
    chosen = [axes.index("x"), axes.index("y")]
    return Plane(
        ids=result.prediction.ids,
        places=result.points[:, :2],
        errors=result.prediction.mean.reshape(n, a)[:, chosen] / UM,
        covariance=result.own_covariances[:, chosen][:, :, chosen] / UM**2,
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
    panel.set_yticks(rows[::every], [folded(name, NAME) for name in result.prediction.ids[::every]])
    panel.invert_yaxis()
    panel.set_xlabel(f"E{axis}, um")
    panel.set_title(f"E{AXES[AXES.index(axis)]} ± {result.coverage_factor:g} u")
