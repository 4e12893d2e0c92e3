"""Error and uncertainty over a machine's volume, drawn as maps: a row an axis, a column a level."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.findings import error
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.labels import spread
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LEVELS = 3
PANEL = (3.3, 2.7)
DARKEST = 0.6
"""Share of the colour map that is used."""


@figures.styled
def figure(result: PointsResult) -> Figure:
    """U of every axis as colour with its values, and the error as contour lines.

    The two axes with the most places span the panels; the third gives the levels.

    Raises InputError for a grid that is no plane.
    """
    across, up, level = _roles(result.points)
    places = np.unique(result.points[:, level])
    levels = [float(places[i]) for i in spread(len(places), MOST_LEVELS)]
    axes = result.prediction.axes
    page = figures.blank(PANEL[0] * len(levels) + 1.6, PANEL[1] * len(axes) + 0.4)
    panels: Any = page.subplots(len(axes), len(levels), squeeze=False, sharex=True, sharey=True)
    for row, axis in zip(panels, axes, strict=True):
        U = result.coverage_factor * np.sqrt(result.of_axis(result.variance, axis)) / UM
        E = result.of_axis(result.prediction.mean, axis) / UM
        limits = float(U.min()), max(float(U.max()), float(U.min()) + 1e-9)
        for panel, value in zip(row, levels, strict=True):
            inside = np.isclose(result.points[:, level], value, equal_nan=True)
            at = result.points[inside][:, [across, up]]
            colours = _panel(panel, at, U[inside], E[inside], limits)
            where = "" if np.isnan(value) else f" at {AXES[level]} = {value:g} mm"
            panel.set_title(f"E{axis}{where}")
        page.colorbar(colours, ax=list(row), label=f"U of E{axis}, um", shrink=0.9)
        row[0].set_ylabel(f"{AXES[up]}, mm")
    for panel in panels[-1]:
        panel.set_xlabel(f"{AXES[across]}, mm")
    lines = "Predicted error (lines, um)" + (", actual minus nominal," if len(levels) > 1 else "")
    figures.title(page, f"{lines} and U = {result.coverage_factor:g} u (colour)")
    return page


def _roles(points: FloatArray) -> tuple[int, int, int]:
    """(across, up, level): the two axes with the most places in their order, and the third."""
    counts = [len(np.unique(points[:, a][np.isfinite(points[:, a])])) for a in range(3)]
    if sorted(counts)[1] < 2:
        places = [f"{axis} {n}" for axis, n in zip(AXES, counts, strict=True) if n]
        raise error(
            "not-applicable",
            reason="no map can be drawn of this grid",
            value=", ".join(places) or "no axis in the equations",
            expected="two axes of the equations with two places or more",
        )
    level = 2 - int(np.argmin(counts[::-1]))
    across, up = (a for a in range(3) if a != level)
    return across, up, level


def _panel(
    panel: Any, places: FloatArray, U: FloatArray, E: FloatArray, limits: tuple[float, float]
) -> Any:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    x, y = np.unique(places[:, 0]), np.unique(places[:, 1])
    order = np.lexsort((places[:, 0], places[:, 1]))
    grid, error = U[order].reshape(len(y), len(x)), E[order].reshape(len(y), len(x))
    # Lines and numbers are lost on the darkest colours.
    light = ListedColormap(colormaps["YlGnBu"](np.linspace(0.0, DARKEST, 256)))
    drawn = panel.pcolormesh(
        x, y, grid, shading="gouraud", cmap=light, vmin=limits[0], vmax=limits[1]
    )
    if np.ptp(error) > 0:
        lines = panel.contour(x, y, error, levels=6, colors=figures.INK, linewidths=0.7)
        panel.clabel(lines, fontsize=7, fmt="%g")
    panel.set_xlim(x[0], x[-1])
    panel.set_ylim(y[0], y[-1])
    panel.grid(visible=False)
    return drawn
