"""The picture of compare: errors as arrows (Gilsinn & Ling 2004, Fig. 6) above their intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.analyses.compare import Compared, CompareResult, Side, Verdict
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import Plane, View, common_view, draw_plane, scale_arrow
from mtu_cli.reports.compare_levels import maps_of
from mtu_cli.reports.compare_words import verdict
from mtu_cli.reports.labels import folded
from mtu_cli.reports.level_maps import WIDTH, Maps, draw, legend, sheet, write_title
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

ITEMS = 24
"""Items drawn with their intervals, of both kinds together."""
VERDICT_COLOURS: dict[Verdict | None, str] = {
    "consistent": figures.GREY,
    "biased": figures.RED,
    "under-predicted": figures.RED,
    "inconsistent": figures.RED,
    "over-predicted": figures.BLUE,
}
OPERATIONS = 5
"""Operations drawn as arrows."""
Errors = dict[str, dict[str, float]]
"""Errors in mm by feature and axis."""
SAME = 1e-9
"""Predictions that differ less, in mm, are one."""
LOWEST, TALLEST = 0.8, 5.5
"""Heights of a panel of arrows, inches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """Panels of arrows on the page: the height of one and the page's width, inches."""

    rows: int
    columns: int
    panel: float
    width: float

    @property
    def height(self) -> float:
        return self.rows * (self.panel + 0.75) + 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class _Listed:
    """Items of one kind that are drawn with their intervals."""

    kind: str
    found: Compared
    items: list[int]
    chosen: str
    """Which of many were chosen; empty where all are drawn."""

    @property
    def height(self) -> float:
        """Inches on the page."""
        return 0.32 * len(self.items) + 0.9


@figures.styled
def figure(result: CompareResult) -> Figure:
    """Mean errors as arrows, predicted and by operation, above means with U item by item, the
    verdict beside each.

    The items are the lengths and features, of many those with a fault and those that differ most
    for their uncertainty. Without errors in x and y there is nothing to draw as arrows.
    """
    kinds = _kinds(result)
    below = sum(kind.height for kind in kinds) + 0.4
    levels = maps_of(result, OPERATIONS)
    if levels is not None:
        return _with_levels(result, kinds, below, levels)
    planes = _planes(result)
    if not planes:
        page = figures.blank(8.0, below)
        _intervals(page, result, kinds)
        return page
    view, layout = _layout([plane for _, plane in planes])
    page = figures.blank(layout.width, layout.height + below)
    grid = page.add_gridspec(2, 1, height_ratios=[layout.height, below])
    above, under = page.add_subfigure(grid[0]), page.add_subfigure(grid[1])
    _arrows(above, planes, view, layout)
    above.suptitle(_title(result), x=0.012, ha="left", fontsize=9.5, fontweight="bold")
    _intervals(under, result, kinds)
    return page


def _with_levels(result: CompareResult, kinds: list[_Listed], below: float, levels: Maps) -> Figure:
    """Maps level by level in place of the arrows of one plane."""
    drawn = sheet(levels, WIDTH)
    page = figures.blank(WIDTH, drawn.height + below)
    grid = page.add_gridspec(2, 1, height_ratios=[drawn.height, below])
    above, under = page.add_subfigure(grid[0]), page.add_subfigure(grid[1])
    draw(above, drawn)
    legend(above, drawn)
    write_title(above, _title(result), drawn)
    _intervals(under, result, kinds)
    return page


def _title(result: CompareResult) -> str:
    operations = len(dict.fromkeys(label[0] for label in result.features.labels))
    more = f" (first {OPERATIONS} of {operations} operations)" if operations > OPERATIONS else ""
    return f"Mean errors of the features: actual minus nominal{more}"


def _kinds(result: CompareResult) -> list[_Listed]:
    """Lengths first; beside them there is room for fewer features."""
    if result.lengths is None:
        return [_listed("Features", result.features, ITEMS)]
    return [
        _listed("Lengths", result.lengths, ITEMS // 2),
        _listed("Features", result.features, ITEMS // 2),
    ]


def _listed(kind: str, found: Compared, most: int) -> _Listed:
    """All items, or of many those with a fault, the clearest first, then those that differ most
    for their uncertainty; drawn in their own order.

    Parts that scatter too much may lie where they should in the mean: |E_n| alone leaves them out.
    """
    total = len(found.labels)
    faulty = np.array([verdict not in (None, "consistent") for verdict in found.verdicts], bool)
    p = np.where(faulty, np.nan_to_num(np.fmin(found.p_bias, found.p_scatter), nan=1.0), 2.0)
    size = np.abs(np.nan_to_num(found.E_n))
    chosen: list[int] = np.lexsort((-size, p))[:most].tolist()
    count, faults = len(chosen), int(faulty.sum())
    if count == total:
        told = ""
    elif faults > count:
        told = f" (the {count} clearest of {faults} with a fault, of {total})"
    elif faults:
        told = f" ({faults} with a fault, {count - faults} with the largest |E_n|, of {total})"
    else:
        told = f" (the {count} with the largest |E_n| of {total})"
    return _Listed(kind=kind, found=found, items=sorted(chosen), chosen=told)


def _planes(result: CompareResult) -> list[tuple[str, Plane]]:
    """Titles and planes: the prediction, or those of the operations where they differ, then
    every operation; empty without x and y.
    """
    found = result.features
    predicted: dict[str, Errors] = {}
    measured: dict[str, Errors] = {}
    for i, (operation, name, axis) in enumerate(found.labels):
        for side, mean in ((predicted, found.predicted.mean), (measured, found.measured.mean)):
            side.setdefault(operation, {}).setdefault(name, {})[axis] = mean[i]
    operations = list(measured)[:OPERATIONS]
    one = _in_common(predicted)
    sides: dict[str, Errors] = {} if one is None else {"predicted": one}
    for operation in operations:
        prefix = f"{operation}, " if operation else ""
        if one is None:
            sides[f"{prefix}predicted"] = predicted[operation]
        sides[f"{prefix}measured"] = measured[operation]
    planes = []
    for title, errors in sides.items():
        plane = _plane(result, errors)
        if plane is None:
            continue
        left_out = len(errors) - len(plane.ids)
        planes.append((title + (f" (without {left_out} of one axis)" if left_out else ""), plane))
    return planes if len(planes) > 1 else []


def _in_common(predicted: dict[str, Errors]) -> Errors | None:
    """The prediction that all operations share; None where they differ, as with temperature."""
    one: Errors = {}
    for errors in predicted.values():
        for name, by_axis in errors.items():
            known = one.setdefault(name, {})
            for axis, error in by_axis.items():
                if abs(known.setdefault(axis, error) - error) > SAME:
                    return None
    return one


def _plane(result: CompareResult, errors: Errors) -> Plane | None:
    """The features with an error in x and in y, in um."""
    rows = [i for i, name in enumerate(result.ids) if {"x", "y"} <= set(errors.get(name, ()))]
    if not rows:
        return None
    ids = tuple(result.ids[i] for i in rows)
    values: FloatArray = np.array([[errors[name]["x"], errors[name]["y"]] for name in ids])
    return Plane(ids=ids, places=result.places[rows, :2], errors=values / UM)


def _layout(planes: list[Plane]) -> tuple[View, _Layout]:
    """Wide parts one above another, others side by side, three in a row at most."""
    count = len(planes)
    across, along = np.ptp(planes[0].places, axis=0)
    columns = 1 if across > 2 * along else {4: 2}.get(count, min(count, 3))
    width = 10.0 if columns == 3 else 8.0
    room = (width - 0.9) / columns
    view = common_view(planes, (room, TALLEST))
    height = min(max(room / view.aspect, LOWEST), TALLEST)
    return view, _Layout(rows=-(-count // columns), columns=columns, panel=height, width=width)


def _arrows(page: SubFigure, planes: list[tuple[str, Plane]], view: View, layout: _Layout) -> None:
    panels = page.subplots(layout.rows, layout.columns, squeeze=False).ravel()
    for i, panel in enumerate(panels):
        if i >= len(planes):
            panel.set_axis_off()
            continue
        title, plane = planes[i]
        colour = figures.BLUE if "predicted" in title else figures.ORANGE
        draw_plane(panel, plane, view, colour)
        panel.set_title(title, pad=22, fontsize=9)
        scale_arrow(panel, view, colour, rise=11.0)
        if i % layout.columns:
            panel.tick_params(labelleft=False)
        else:
            panel.set_ylabel("y, mm")
        if i + layout.columns < len(planes):
            panel.tick_params(labelbottom=False)
        else:
            panel.set_xlabel("x, mm")


def _intervals(page: Figure | SubFigure, result: CompareResult, kinds: list[_Listed]) -> None:
    """Predicted and measured means with U, one line an item, kind below kind."""
    heights = [kind.height for kind in kinds]
    panels = page.subplots(len(kinds), 1, height_ratios=heights, squeeze=False)[:, 0]
    for panel, kind in zip(panels, kinds, strict=True):
        _draw(panel, kind, result.coverage_factor)
        panel.set_xlabel("actual minus nominal, um")
    handles, names = panels[0].get_legend_handles_labels()
    page.legend(handles, names, loc="outside lower center", ncols=2)


def _draw(panel: Axes, kind: _Listed, k: float) -> None:
    found, items = kind.found, kind.items
    panel.axvline(0.0, color=figures.GREY, linewidth=0.9)
    _bars(panel, found.predicted, items, k, -0.14, figures.BLUE, "predicted")
    _bars(panel, found.measured, items, k, 0.14, figures.ORANGE, "measured")
    names = [folded(" ".join(word for word in found.labels[i] if word)) for i in items]
    panel.set_yticks(range(len(items)), names)
    panel.set_ylim(len(items) - 0.4, -0.6)
    beside = panel.get_yaxis_transform()
    for row, i in enumerate(items):
        words = verdict(found, i)
        colour = VERDICT_COLOURS.get(found.verdicts[i], figures.GREY)
        panel.text(1.01, row, words, transform=beside, va="center", fontsize=8, color=colour)
    panel.set_title(f"{kind.kind}: mean ± {k:g} u of one part{kind.chosen}")
    panel.grid(axis="y", visible=False)


def _bars(
    panel: Axes, side: Side, items: list[int], k: float, offset: float, colour: str, label: str
) -> None:
    panel.errorbar(
        side.mean[items] / UM,
        np.arange(len(items)) + offset,
        xerr=k * np.nan_to_num(side.u[items]) / UM,
        fmt="o",
        color=colour,
        elinewidth=2.0,
        capsize=3.0,
        markersize=4.5,
        label=label,
    )
