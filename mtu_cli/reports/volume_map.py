"""Error and uncertainty over a machine's volume, drawn as maps: a row an axis, a column a level."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.analyses.predict_points import PointsResult
from mtu_cli.findings import error
from mtu_cli.reports.figures import INK, blank, styled
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LEVELS = 3
PANEL = (3.3, 2.7)
DARKEST = 0.6
"""Share of the colour map that is used: lines and numbers are lost on what is darker."""


@styled
def figure(result: PointsResult) -> Figure:
    """U of every axis as colour with its values, and the error as contour lines.

    The two axes with the most places span the panels; the third gives the levels.

    Raises InputError for a grid that is no plane.
    """
    across, up, level = _roles(result.points)
    levels = _levels(result.points[:, level])
    axes = result.prediction.axes
    page = blank(PANEL[0] * len(levels) + 0.9, PANEL[1] * len(axes) + 0.3)
    panels: Any = page.subplots(len(axes), len(levels), squeeze=False, sharex=True, sharey=True)
    for j, axis in enumerate(axes):
        U = result.of_axis(result.U, axis) / UM
        E = result.of_axis(result.prediction.mean, axis) / UM
        low, high = float(U.min()), float(U.max())
        high = high if high > low else low + 1e-9
        for c, value in enumerate(levels):
            inside = np.isclose(result.points[:, level], value, equal_nan=True)
            drawn = _panel(
                panels[j][c], result.points[inside][:, [across, up]], U[inside], E[inside],
                (low, high),
            )  # fmt: skip
            title = "" if np.isnan(value) else f" at {'xyz'[level]} = {value:g} mm"
            panels[j][c].set_title(f"E{axis}{title}")
        page.colorbar(drawn, ax=list(panels[j]), label=f"U of E{axis}, um", shrink=0.9)
        panels[j][0].set_ylabel(f"{'xyz'[up]}, mm")
    for panel in panels[-1]:
        panel.set_xlabel(f"{'xyz'[across]}, mm")
    page.suptitle(
        f"Colour: U = {result.coverage_factor:g} u; lines: error (actual minus nominal), um",
        fontsize=9,
        color=INK,
    )
    return page


def _roles(points: FloatArray) -> tuple[int, int, int]:
    """(across, up, level): the two axes with the most places in their order, and the third."""
    counts = [len(np.unique(points[:, a][np.isfinite(points[:, a])])) for a in range(3)]
    if sorted(counts)[1] < 2:
        used = [axis for axis, count in zip("xyz", counts, strict=True) if count]
        places = [f"{axis} {counts['xyz'.index(axis)]}" for axis in used]
        raise error(
            "grid-without-map",
            value=", ".join(places) or "no axis in the equations",
            expected="two axes of the equations with two places or more",
        )
    level = int(np.argmin(counts[::-1]))
    level = 2 - level
    across, up = (a for a in range(3) if a != level)
    return across, up, level


def _levels(column: FloatArray) -> list[float]:
    """Lowest, middle and highest of the levels."""
    values = np.unique(column)
    if len(values) > MOST_LEVELS:
        values = values[[0, len(values) // 2, -1]]
    return [float(value) for value in values]


def _panel(
    panel: Any, places: FloatArray, U: FloatArray, E: FloatArray, limits: tuple[float, float]
) -> Any:
    x, y = np.unique(places[:, 0]), np.unique(places[:, 1])
    order = np.lexsort((places[:, 0], places[:, 1]))
    grid, error = U[order].reshape(len(y), len(x)), E[order].reshape(len(y), len(x))
    drawn = panel.pcolormesh(
        x, y, grid, shading="gouraud", cmap=_colours(), vmin=limits[0], vmax=limits[1]
    )
    if np.ptp(error) > 0:
        lines = panel.contour(x, y, error, levels=6, colors=INK, linewidths=0.7)
        panel.clabel(lines, fontsize=7, fmt="%g")
    panel.set_xlim(x[0], x[-1])
    panel.set_ylim(y[0], y[-1])
    panel.grid(visible=False)
    return drawn


def _colours() -> Any:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["YlGnBu"](np.linspace(0.0, DARKEST, 256)))
