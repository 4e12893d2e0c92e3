"""The picture of predictions: errors of the features with their uncertainty."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, page_of
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import spread
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEATURES = 80
"""Features with a line of their own on one sheet."""


@figures.styled
def figure(result: PointsResult) -> Figure:
    """Arrows of the errors at the features, ellipses of k standard uncertainties about their tips;
    without Ex or Ey intervals feature by feature.
    """
    axes, k = result.prediction.axes, result.coverage_factor
    n, a = len(result.prediction.ids), len(axes)
    if not {"x", "y"} <= set(axes):
        return _by_feature(result)
    at = [AXES.index(axis) for axis in axes]
    errors, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    errors[:, at] = result.prediction.mean.reshape(n, a) / UM
    covariance[np.ix_(range(n), at, at)] = result.own_covariances / UM**2
    side = Side(name="", colour=figures.BLUE, errors=errors, covariance=covariance)
    maps = Maps(
        ids=result.prediction.ids, places=result.points, axes=axes, groups=(("", (side,)),), k=k
    )
    inside = 100 * (1 - math.exp(-(k**2) / 2))
    title = f"Predicted errors of {n} features, actual minus nominal"
    return page_of(maps, f"{title}; ellipses: {k:g} u, {inside:.0f} % of parts")


def _by_feature(result: PointsResult) -> Figure:
    """E ± U of every axis, feature by feature."""
    axes, ids, k = result.prediction.axes, result.prediction.ids, result.coverage_factor
    rows = spread(len(ids), FEATURES)
    page = figures.blank(3.2 + 4.0 * len(axes), figures.rows_height(len(rows)) + 0.4)
    for panel, axis in zip(figures.panels_of(page, len(axes), len(axes)), axes, strict=True):
        value = result.of_axis(result.prediction.mean, axis)[rows] / UM
        half = k * np.sqrt(result.of_axis(result.variance, axis)[rows]) / UM
        bars = Intervals(label="", colour=figures.BLUE, value=value, half=half)
        figures.intervals(panel, [ids[i] for i in rows], [bars])
        panel.set_xlabel(f"E{axis}, um")
    some = f" ({len(rows)} of {len(ids)} features)" if len(rows) < len(ids) else ""
    figures.title(page, f"Predicted errors (actual minus nominal) ± {k:g} u{some}")
    return page
