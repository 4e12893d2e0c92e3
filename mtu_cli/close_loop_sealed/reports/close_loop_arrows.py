"""Mean errors of the features before and after as arrows, on one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Plane, View, common_view, draw_plane, nice, scale_arrow
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLUSTERED = 0.6
"""Features nearer to one another than this share of their mean spacing stand in clusters, such as
two heights at each place: arrows may then reach across a cluster.
"""
LONGEST = 1.35
"""Length of the longest arrow in spacings."""
OFTEN = 0.95
"""Quantile of the errors that the arrow above a panel is about as long as."""
SIDES = (("before", figures.ORANGE), ("after", figures.BLUE))
RISE = 11.0
"""Of the scale's arrow above its panel, points."""


def draw_arrows(panels: Sequence[Axes], planes: Sequence[Plane], view: View) -> None:
    """A plane a panel, of one alone without a before and after."""
    length = round_near(float(np.quantile(np.linalg.norm(planes[0].errors, axis=1), OFTEN)))
    for panel, plane, (title, colour) in zip(panels, planes, SIDES, strict=False):
        draw_plane(panel, plane, view, colour)
        name = title if len(panels) > 1 else "mean errors"
        panel.set_title(f"{name} ({counted(len(plane.ids))})", pad=22)
        scale_arrow(panel, view, colour, rise=RISE, length=length)
        panel.set_xlabel("x, mm")
        panel.set_ylabel("y, mm")


def counted(features: int) -> str:
    """How many features, in words."""
    return "1 feature" if features == 1 else f"{features} features"


def view_of(planes: Sequence[Plane], paper: tuple[float, float]) -> View:
    """As `common_view`, but of features in clusters with arrows as long as clusters are apart."""
    view = common_view(planes, paper)
    places = np.vstack([plane.places for plane in planes])
    spacing = _mean_spacing(planes[0].places)
    longest = max(float(np.linalg.norm(plane.errors, axis=1).max()) for plane in planes)
    if view.spacing >= CLUSTERED * spacing or longest == 0:
        return view
    step = min(spacing, 0.3 * float(np.ptp(places, axis=0).max()))
    scale = LONGEST * step / longest
    tips = np.vstack([plane.places + scale * plane.errors for plane in planes])
    ends = np.vstack([places, tips])
    low = np.minimum(view.low, ends.min(axis=0) - 0.3 * step)
    high = np.maximum(view.high, ends.max(axis=0) + 0.3 * step)
    inch = float(((high - low) / np.array(paper)).max())
    return replace(view, scale=scale, spacing=spacing, step=step, inch=inch, low=low, high=high)


def _mean_spacing(places: FloatArray) -> float:
    """mm between neighbours of n places spread evenly over the same rectangle, or line."""
    n = len(places)
    width, height = np.ptp(places, axis=0)
    return float(max(np.sqrt(width * height / n), max(width, height) / n))


def round_near(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten, by ratio; 1 of nothing."""
    if not value > 0:
        return 1.0
    # The round numbers below and above: one is at most 2.5 times another.
    rounds = [nice(reach * value) for reach in (1.0, 2.0, 2.5)]
    return min(rounds, key=lambda round_one: abs(math.log(round_one / value)))
