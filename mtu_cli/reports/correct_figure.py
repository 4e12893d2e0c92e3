"""The picture of correct: errors of diameters or lengths, or of the points, before and after."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, isnan
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.correct.quantity import Size
from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.analyses.correct.summary import FeatureErrors
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Plane, common_view, draw_plane, scale_arrow
from mtu_cli.reports.labels import folded
from mtu_cli.reports.level_maps import Maps, Side, page_of
from mtu_cli.reports.levels import flat
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 40
"""Sizes or features drawn on one sheet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """One line of the picture, um: errors before and after, the interval, U of the reference."""

    name: str
    before: float
    after: float
    interval: tuple[float, float]
    U: float = float("nan")


@figures.styled
def figure(result: CorrectResult) -> Figure:
    """Errors of diameters (or lengths) before and after with 95 % intervals; without either
    the mean errors of the features as arrows, or line by line where they are not in a plane.
    """
    rounds = [*result.of_kind("circle"), *result.of_kind("sphere")]
    for title, items in (
        ("Diameters", rounds),
        ("Lengths", list(result.of_kind("length"))),
    ):
        known = [item for item in items if not isnan(item.reference)]
        if known:
            label = (
                f"{'measured minus calibrated' if items is rounds else 'measured minus nominal'}"
            )
            return _lines(f"Errors of the {title.lower()}", [_of_size(i) for i in known], label)
    found = result.by_feature()
    before, after = found.before / UM, found.after / UM
    if {"x", "y"} <= set(result.axes) and np.isfinite(before[:, :2]).all():
        seen = tuple(axis for axis in result.axes if np.isfinite(after[:, AXES.index(axis)]).any())
        if not flat(found.places, seen):
            return _by_level(found, seen)
        return _arrows(found.features, found.places, before[:, :2], after[:, :2])
    lines = [
        _Line(
            name=f"{name} {axis}",
            before=before[i, AXES.index(axis)],
            after=after[i, AXES.index(axis)],
            interval=(float("nan"), float("nan")),
        )
        for i, name in enumerate(found.features)
        for axis in result.axes
    ]
    return _lines("Mean errors of the features", lines, "measured minus nominal")


def _by_level(found: FeatureErrors, axes: tuple[str, ...]) -> Figure:
    sides = (
        Side(name="before", colour=figures.ORANGE, errors=found.before / UM),
        Side(name="after", colour=figures.BLUE, errors=found.after / UM),
    )
    maps = Maps(ids=found.features, places=found.places, axes=axes, groups=(("", sides),))
    return page_of(maps, "Mean errors of the features: measured minus nominal")


def _of_size(item: Size) -> _Line:
    low, high = item.error_interval95
    made = " ".join(word for word in (item.operation, f"part {item.part}") if word)
    warm = f"{item.temperature:.1f} °C" if isfinite(item.temperature) else ""
    return _Line(
        name=", ".join(word for word in (item.id, made, warm) if word),
        before=item.error[0] / UM,
        after=item.error[1] / UM,
        interval=(low / UM, high / UM),
        U=item.U_reference / UM,
    )


def _lines(title: str, lines: list[_Line], label: str) -> Figure:
    shown = lines[:SHOWN]
    page = figures.blank(8.0, max(2.4, 1.5 + 0.34 * len(shown)))
    panel = page.subplots()
    panel.axvline(0.0, color=figures.GREY, linewidth=0.9)
    for row, line in enumerate(shown):
        _draw(panel, row, line)
    with_interval = any(isfinite(line.interval[0]) for line in shown)
    title += " before and after" + (" (with 95 % interval)" if with_interval else "")
    more = f" (first {SHOWN} of {len(lines)})" if len(lines) > SHOWN else ""
    panel.set_title(f"{title}{more}")
    panel.set_yticks(range(len(shown)), [folded(line.name) for line in shown])
    panel.set_ylim(len(shown) - 0.4, -0.6)
    panel.set_xlabel(f"{label}, um")
    panel.grid(axis="y", visible=False)
    panel.margins(x=0.05)
    page.legend(loc="outside lower center", ncols=3)
    return page


def _draw(panel: Axes, row: int, line: _Line) -> None:
    first = row == 0
    if isfinite(line.U):
        panel.fill_betweenx(
            [row - 0.32, row + 0.32], -line.U, line.U,
            color=figures.PALE, linewidth=0, zorder=0,
            label="± U of the calibration" if first else None,
        )  # fmt: skip
    panel.plot([line.before, line.after], [row, row], color=figures.GREY, linewidth=0.8, zorder=2)
    panel.plot(
        line.before, row, "o", color=figures.ORANGE, markersize=5, zorder=3,
        label="before" if first else None,
    )  # fmt: skip
    low, high = line.interval
    if isfinite(low):
        panel.errorbar(
            line.after, row, xerr=[[line.after - low], [high - line.after]], fmt="o",
            color=figures.BLUE, elinewidth=2.0, capsize=3.5, markersize=5, zorder=4,
            label="after" if first else None,
        )  # fmt: skip
    else:
        panel.plot(
            line.after, row, "o", color=figures.BLUE, markersize=5, zorder=4,
            label="after" if first else None,
        )  # fmt: skip


def _arrows(
    ids: tuple[str, ...], places: FloatArray, before: FloatArray, after: FloatArray
) -> Figure:
    planes = [Plane(ids=ids, places=places[:, :2], errors=errors) for errors in (before, after)]
    across, along = np.ptp(places[:, :2], axis=0)
    beside = across <= 2 * along
    view = common_view(planes, (4.3, 6.0) if beside else (7.6, 4.0))
    height = float(view.high[1] - view.low[1]) / view.inch
    page = figures.blank(10.0 if beside else 8.4, (1 if beside else 2) * (height + 0.9) + 0.4)
    panels = page.subplots(*((1, 2) if beside else (2, 1)))
    sides = (("before", figures.ORANGE), ("after", figures.BLUE))
    for panel, plane, (title, colour) in zip(panels, planes, sides, strict=True):
        draw_plane(panel, plane, view, colour)
        panel.set_title(f"{title}: mean errors of the features", pad=22)
        scale_arrow(panel, view, colour, rise=11.0)
        panel.set_xlabel("x, mm")
        panel.set_ylabel("y, mm")
    return page
