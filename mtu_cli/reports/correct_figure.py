"""The picture of correct: errors of diameters or lengths, or of the points, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.correct.result import CorrectResult
from mtu_cli.analyses.correct.sizes import Size
from mtu_cli.model.machine_model import AXES
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Maps, Side, page_of
from mtu_cli.reports.figures import Intervals
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = 40
"""Rows drawn on one sheet."""
APART = 24
"""Of more sizes all parts of one circle or length share a row."""
SIDES = (("before", figures.ORANGE), ("after", figures.BLUE))
SHIFT = 0.12
"""Of many parts what is before stands above the middle of a row, what is after below it."""


@figures.styled
def figure(result: CorrectResult) -> Figure:
    """Errors of diameters (or lengths) before and after with 95 % intervals; without either
    the mean errors of the features as arrows, or row by row where they are not in a plane.
    """
    rounds = [*result.of_kind("circle"), *result.of_kind("sphere")]
    lengths = result.of_kind("length")
    for kind, items, label in (
        ("diameters", rounds, "measured minus calibrated diameter, um"),
        ("lengths", lengths, "measured minus nominal length, um"),
    ):
        known = [item for item in items if not np.isnan(item.reference)]
        if known:
            return _sizes(kind, known, label)
    found = result.by_feature()
    before, after = found.before / UM, found.after / UM
    title = "Mean errors of the features, measured minus nominal"
    if {"x", "y"} <= set(result.axes) and np.isfinite(before[:, :2]).all():
        axes = tuple(axis for axis in result.axes if np.isfinite(after[:, AXES.index(axis)]).any())
        sides = tuple(
            Side(name=name, colour=colour, errors=errors)
            for (name, colour), errors in zip(SIDES, (before, after), strict=True)
        )
        maps = Maps(ids=found.features, places=found.places, axes=axes, groups=(("", sides),))
        return page_of(maps, title)
    at = [AXES.index(axis) for axis in result.axes]
    names = [f"{name} {axis}" for name in found.features for axis in result.axes][:SHOWN]
    page, panel = _page(title, len(names), len(found.features) * len(at))
    bars = [
        Intervals(label=side, colour=colour, value=errors[:, at].ravel()[:SHOWN])
        for (side, colour), errors in zip(SIDES, (before, after), strict=True)
    ]  # fmt: skip
    figures.intervals(panel, names, bars)
    panel.set_xlabel("measured minus nominal, um")
    figures.legend(page)
    return page


def _page(title: str, shown: int, total: int) -> tuple[Figure, Axes]:
    page = figures.blank(8.0, figures.rows_height(shown) + 0.8)
    figures.title(page, title + (f" (first {shown} of {total})" if shown < total else ""))
    return page, page.subplots()


def _sizes(kind: str, items: Sequence[Size], label: str) -> Figure:
    """A row a size; of many a row for all parts of a circle or length, each part a dot beside the
    mean, whose interval is that of one part. Many lengths stand over the nominal length.
    """
    together = len(items) > APART
    rows: dict[str, list[Size]] = {}
    for item in items:
        rows.setdefault(_name(item, together), []).append(item)
    title = f"Errors of the {kind} before and after the correction"
    if kind == "lengths" and len(rows) > APART:
        page = figures.blank(8.0, 5.0)
        nominal = np.array([own[0].reference for own in rows.values()])
        bars = _before_after(list(rows.values()), ", mean of the parts", 0.0)
        figures.over_length(page.subplots(), bars, nominal, label)
        figures.title(page, title)
        figures.legend(page)
        return page
    shown = list(rows.values())[:SHOWN]
    page, panel = _page(title, len(shown), len(rows))
    bars = _before_after(shown, ", mean of the parts (dots: each)" * together, SHIFT * together)
    if not together:
        panel.hlines(range(len(shown)), bars[0].value, bars[1].value, color=figures.GREY, lw=0.8)
    for row, own in enumerate(shown):
        for i, bar in enumerate(bars if together else ()):
            every = [x.error[i] / UM for x in own]
            place = [row + 2.4 * bar.shift] * len(every)
            panel.plot(every, place, ".", color=bar.colour, alpha=0.5, ms=5, mew=0)
        U = own[0].U_reference / UM
        if np.isfinite(U):
            panel.fill_betweenx(
                [row - 0.32, row + 0.32], -U, U, color=figures.PALE, linewidth=0, zorder=0,
                label="± U of the calibration",
            )  # fmt: skip
    figures.intervals(panel, list(rows)[:SHOWN], bars)
    panel.set_xlabel(label)
    figures.legend(page)
    return page


def _before_after(shown: Sequence[list[Size]], of: str, shift: float) -> list[Intervals]:
    """Means of each row before and after, with the interval of one part after."""
    half = np.array([np.ptp(own[0].error_interval95) for own in shown]) / (2 * UM)
    return [
        Intervals(
            label=side + of + (" ± 95 %" if i else ""),
            colour=colour,
            value=np.array([np.mean([x.error[i] for x in own]) for own in shown]) / UM,
            half=half if i else None,
            shift=(2 * i - 1) * shift,
        )
        for i, (side, colour) in enumerate(SIDES)
    ]


def _name(item: Size, together: bool) -> str:
    if together:
        return ", ".join(filter(None, (item.id, item.operation)))
    made = " ".join(filter(None, (item.operation, f"part {item.part}")))
    warm = f"{item.temperature:.1f} °C" if np.isfinite(item.temperature) else ""
    return ", ".join(filter(None, (item.id, made, warm)))
