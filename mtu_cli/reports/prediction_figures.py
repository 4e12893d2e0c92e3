"""Pictures of predictions: lengths with tolerances, errors of features, maps of a volume."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, page_of
from mtu_cli.reports.figures import Intervals
from mtu_cli.reports.labels import spread
from mtu_cli.reports.numbers import with_u
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mtu_cli.analyses.lengths import LengthsResult
    from mtu_cli.analyses.predict_points import PointsResult

ROWS = 80
"""Features or lengths with a line of their own on one sheet."""
LEVELS, PANEL = 3, (3.3, 2.7)
"""Levels of a volume, and the size of their panels, inches."""
DARKEST = 0.6
"""Share of the colour map that is used: lines and numbers are lost on the darkest colours."""


@figures.styled
def lengths(result: LengthsResult, digits: int = 2) -> Figure:
    """A row a length, the numbers beside it to the places of the table."""
    k, rows = result.coverage_factor, spread(len(result.ids), ROWS)
    value = result.error[rows] / UM
    u, apart = (np.sqrt(v[rows]) / UM for v in (result.variance, result.independent_variance))
    shown = [
        Intervals("with shared covariance", figures.BLUE, value, k * u),
        Intervals(
            "independent ends and components", figures.ORANGE, value, k * apart, 0.28, width=1.0
        ),
    ]
    conformance = [result.conformance[i] for i in rows]
    tolerances = [None if each is None else each.tolerance for each in conformance]
    limits = np.array([(math.nan,) * 2 if x is None else (x.low, x.high) for x in tolerances])
    some = f" ({len(rows)} of {len(result.ids)})" if len(rows) < len(result.ids) else ""
    page = figures.listing(
        f"Predicted errors of the lengths ± {k:g} u{some}",
        [f"{result.ids[i]}, {result.nominal[i]:.2f} mm" for i in rows],
        shown,
        "actual minus nominal length, um",
        limits=list(limits.T),
        # "-3.5 ± 14.0 um": error and k u, to the last place of u.
        beside=[
            " ± ".join(with_u(x, one, digits)[0] for x in (v, k * one)) + " um"
            for v, one in zip(value, u, strict=True)
        ],
    )
    figures.legend(page)
    return page


@figures.styled
def points(result: PointsResult) -> Figure:
    """Arrows of the errors at the features, ellipses of k standard uncertainties about their tips;
    without Ex, Ey or their places intervals feature by feature.
    """
    axes, k, ids = result.prediction.axes, result.coverage_factor, result.prediction.ids
    n, a = len(ids), len(axes)
    if {"x", "y"} <= set(axes) and np.isfinite(result.points[:, :2]).all():
        at = [AXES.index(axis) for axis in axes]
        errors, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
        errors[:, at] = result.prediction.mean.reshape(n, a) / UM
        covariance[np.ix_(range(n), at, at)] = result.own_covariances / UM**2
        side = Side("", figures.BLUE, errors, covariance)
        maps = Maps(ids, result.points, axes, (("", (side,)),), k)
        inside = 100 * (1 - math.exp(-(k**2) / 2))
        title = f"Predicted errors of {n} features, actual minus nominal"
        return page_of(maps, f"{title}; ellipses: {k:g} u, {inside:.0f} % of parts")
    rows = spread(n, ROWS)
    page = figures.blank(3.2 + 4.0 * a, figures.rows_height(len(rows)) + 0.4)
    for panel, axis in zip(figures.panels_of(page, a, a), axes, strict=True):
        value = result.of_axis(result.prediction.mean, axis)[rows] / UM
        half = k * np.sqrt(result.of_axis(result.variance, axis)[rows]) / UM
        bars = Intervals("", figures.BLUE, value, half)
        figures.intervals(panel, [ids[i] for i in rows], [bars])
        panel.set_xlabel(f"E{axis}, um")
    some = f" ({len(rows)} of {n} features)" if len(rows) < n else ""
    figures.title(page, f"Predicted errors (actual minus nominal) ± {k:g} u{some}")
    return page


@figures.styled
def volume(result: PointsResult) -> Figure:
    """U of every axis over a grid as colour, and the error as contour lines: a row an axis, a
    column a level; of a grid that is no plane the features of `points`.

    The two axes with the most places span the panels; the third gives the levels.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    counts = [len(np.unique(column[np.isfinite(column)])) for column in result.points.T]
    if sorted(counts)[1] < 2:
        return points(result)
    level = 2 - int(np.argmin(counts[::-1]))
    across, up = (a for a in range(3) if a != level)
    light = ListedColormap(colormaps["YlGnBu"](np.linspace(0.0, DARKEST, 256)))
    places = np.unique(result.points[:, level])
    levels = [float(places[i]) for i in spread(len(places), LEVELS)]
    axes, k = result.prediction.axes, result.coverage_factor
    page = figures.blank(PANEL[0] * len(levels) + 1.6, PANEL[1] * len(axes) + 0.4)
    panels: Any = page.subplots(len(axes), len(levels), squeeze=False, sharex=True, sharey=True)
    for row, axis in zip(panels, axes, strict=True):
        U = k * np.sqrt(result.of_axis(result.variance, axis)) / UM
        E = result.of_axis(result.prediction.mean, axis) / UM
        low, high = float(U.min()), max(float(U.max()), float(U.min()) + 1e-9)
        for panel, value in zip(row, levels, strict=True):
            inside = np.flatnonzero(np.isclose(result.points[:, level], value, equal_nan=True))
            x, y = (np.unique(result.points[inside, a]) for a in (across, up))
            at = inside[np.lexsort(result.points[inside][:, [across, up]].T)]
            # As an image also in SVG and PDF: every cell would be dozens of triangles.
            colours = panel.pcolormesh(
                x, y, U[at].reshape(len(y), len(x)), shading="gouraud", cmap=light, vmin=low,
                vmax=high, rasterized=True,
            )  # fmt: skip
            if np.ptp(lines := E[at].reshape(len(y), len(x))) > 0:
                style: dict[str, Any] = {"linewidths": 0.7, "linestyles": "solid"}
                contours = panel.contour(x, y, lines, levels=6, colors=figures.INK, **style)
                panel.clabel(contours, fontsize=7, fmt="%g")
            panel.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
            panel.grid(visible=False)
            where = "" if np.isnan(value) else f" at {AXES[level]} = {value:g} mm"
            panel.set_title(f"E{axis}{where}")
        page.colorbar(colours, ax=list(row), label=f"U of E{axis}, um", shrink=0.9)
        row[0].set_ylabel(f"{AXES[up]}, mm")
    for panel in panels[-1]:
        panel.set_xlabel(f"{AXES[across]}, mm")
    figures.title(page, f"Predicted error (lines, um) and U = {k:g} u (colour)")
    return page
