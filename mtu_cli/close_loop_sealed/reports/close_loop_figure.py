"""The picture of close-loop: errors before and after, each effect over what it depends on, and
the candidates' ranking.
"""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.close_loop_sealed.analyses.loop.result import (
    CloseLoopResult,
    FoundEffect,
    Judged,
    TableResult,
)
from mtu_cli.close_loop_sealed.analyses.loop.shown import own_verdict, things
from mtu_cli.close_loop_sealed.reports.close_loop_curves import MOST, Curve, by_column, curves
from mtu_cli.close_loop_sealed.reports.close_loop_levels import (
    SIDES,
    counted,
    maps_of,
    mean_errors,
)
from mtu_cli.close_loop_sealed.reports.close_loop_panels import NAME, draw_curve
from mtu_cli.close_loop_sealed.reports.close_loop_shown import (
    class_of,
    either,
    first_table,
    ranked,
    titled,
    unit_of,
)
from mtu_cli.model.machine_model import AXES
from mtu_cli.model.visits import IntArray
from mtu_cli.reports import figures
from mtu_cli.reports.arrows import draw, sheet
from mtu_cli.reports.labels import cut
from mtu_cli.reports.numbers import p_value
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

WIDTH = 12.0
CANDIDATES = 12
"""Candidates in the ranking."""
LEAST = -6.0
"""The ranking starts here: what is less likely is all the same."""
TITLE = 115
"""Characters of the title."""
LEGEND = 3
"""Rows of the ranking that its legend is as high as."""
BESIDE_LEGEND = 0.2
"""Share of the ranking's width that its legend leaves free."""
TICKS = 30
"""More columns than this are drawn without their names."""
APART = 0.006
"""Share of the width by which readings before and after stand apart."""


@figures.styled
def figure(result: CloseLoopResult) -> Figure:
    """Mean errors before and after as arrows (or column by column where they are not in a
    plane), residuals over the covariate of each effect with the effect (of none: part by part
    and feature by feature), and the ranking.

    Of several components the one that gave the verdict is drawn.
    """
    item = first_table(result)
    shown = curves(item) if item.effects else [*curves(item), by_column(item)]
    maps = maps_of(item)
    drawn = None if maps is None else sheet(maps, WIDTH)
    if drawn is not None and not item.effects and drawn.columns == len(drawn.rows) == 1:
        drawn = sheet(drawn.maps, WIDTH / 2)
    above = 3.4 if drawn is None else drawn.height
    page = figures.blank(WIDTH, above + 4.3)
    grid = page.add_gridspec(2, 1, height_ratios=[above, 4.1])
    top, bottom = page.add_subfigure(grid[0]), page.add_subfigure(grid[1])
    if drawn is None:
        _columns(top, item)
    elif drawn.room < WIDTH:
        # One map alone leaves room for what is to be seen beside it.
        left, right = top.subfigures(1, 2, squeeze=False)[0]
        draw(left, drawn, f"Mean errors of {counted(len(drawn.maps.ids))}")
        draw_curve(right.subplots(), shown.pop(0))
    else:
        draw(top, drawn, f"Mean errors of {counted(len(drawn.maps.ids))}")
    _lower(bottom, item, shown, result.alpha / len(result.tables))
    figures.title(page, _title(result, item))
    return page


def _title(result: CloseLoopResult, item: TableResult) -> str:
    names = "; ".join(map(_name, item.effects))
    component = item.table.component
    of = "" if component is None else f" of {component}"
    if len(result.tables) > 1:
        of += f" (one of {len(result.tables)} components)"
    text = {
        "none": "none found",
        "named": names,
        "class": names,
        "unexplained": _unexplained(item),
    }[item.verdict]
    drawn = f" ({MOST} of {len(item.effects)} drawn)" if len(item.effects) > MOST else ""
    return shorten(f"Undeclared effects{of}: {text}", TITLE, placeholder=" ...") + drawn


def _name(effect: FoundEffect) -> str:
    names = class_of(effect)
    return titled(effect) if len(names) == 1 else either(names)


def _unexplained(item: TableResult) -> str:
    """What stands beside what has no name, then the hints."""
    sure = [e for e in item.effects if own_verdict(e, item) == "named"]
    hints = "; ".join(_name(e) for e in item.effects if own_verdict(e, item) != "named")
    rest = f"unexplained{'; as a hint: ' if hints else ''}{hints}"
    return "; ".join([*map(_name, sure), rest])


def _columns(page: SubFigure, item: TableResult) -> None:
    """Mean errors column by column, a panel an axis; of readings over the position, with each of
    them behind: what differs from pass to pass alone leaves the means as they are.
    """
    axes, unit = item.table.axes, item.table.unit
    panels = page.subplots(1, len(axes), squeeze=False)[0]
    sides = SIDES if item.effects else (("", figures.ORANGE),)
    column = things(item)[1]
    x, runs = _runs(item)
    each = bool(runs.keys() - {""})
    for a, panel in enumerate(panels):
        panel.axhline(0.0, color=figures.GREY, linewidth=0.9)
        if each:
            _each(panel, x, item, a, [colour for _, colour in sides])
        for (side, colour), mean in zip(sides, mean_errors(item), strict=False):
            for (direction, own), style in zip(runs.items(), ("-", "--"), strict=False):
                panel.plot(
                    x[own], mean[own, a], f"o{style}", color=colour, markersize=3.5,
                    linewidth=0.9, label=", ".join(filter(None, (side, direction))),
                )  # fmt: skip
        if not each:
            every = max(1, -(-len(x) // TICKS))
            panel.set_xticks(
                x[::every],
                [cut(f, NAME) for f in item.table.features[::every]],
                rotation=90,
                fontsize=7,
            )
        else:
            panel.set_xlabel(f"{axes[a]}, mm")
        what = f"mean errors of the {column}s" + (f", {axes[a]}" if len(axes) > 1 else "")
        panel.set_title(what + (", and each reading" if each else ""))
        panel.set_ylabel(f"measured minus predicted, {unit}")
    if len(sides) * len(runs) > 1:
        # Nothing is known of where in a panel no data are.
        handles, names = panels[0].get_legend_handles_labels()
        page.legend(handles, names, loc="outside upper right", ncols=len(names))


def _each(panel: Axes, x: FloatArray, item: TableResult, a: int, colours: Sequence[str]) -> None:
    """All readings, those before left of those after."""
    table = item.table
    shift = APART * float(np.ptp(x)) * (np.arange(len(colours)) - 0.5 * (len(colours) - 1))
    unit = unit_of(item).to_internal
    both = (table.errors, table.errors - item.explained)
    for colour, own, apart in zip(colours, both, shift.tolist(), strict=False):
        for errors in own[:, :, a] / unit:
            panel.plot(x + apart, errors, ".", color=colour, markersize=2.5, alpha=0.35)


def _runs(item: TableResult) -> tuple[FloatArray, dict[str, IntArray]]:
    """Where columns stand, and those of each direction of readings, in order of position."""
    table, axis = item.table, item.table.axes[0]
    H = len(table.features)
    direction = table.covariates.get(f"dir_{axis}")
    if table.component is None or direction is None or direction.shape != (1, H):
        return np.arange(float(H)), {"": np.arange(H)}
    x = table.places[:, :, AXES.index(axis)].mean(axis=0)
    order = np.argsort(x, kind="stable")
    ways = (("forward", 1.0), ("reverse", -1.0))
    return x, {name: order[direction[0, order] == way] for name, way in ways}


def _lower(page: SubFigure, item: TableResult, shown: list[Curve], alpha: float) -> None:
    widths = [1.0] * len(shown) + [0.85]
    panels = page.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
    for panel, curve in zip(panels, shown, strict=False):
        draw_curve(panel, curve)
    _ranking(panels[-1], item, alpha)


def _room(best: Sequence[Judged]) -> float:
    """Rows below the bars for a legend that would hide some of them."""
    factors = [judged.log_bayes_factor or 0.0 for judged in best]
    high, low = max([0.0, *factors]), max(min([0.0, *factors]), LEAST)
    last = factors[-LEGEND:]
    end = low + BESIDE_LEGEND * (high - low)
    free = all(low <= factor < end for factor in last) and high > -low
    return 0.0 if free or not last else float(LEGEND)


def _ranking(panel: Axes, item: TableResult, alpha: float) -> None:
    """Log Bayes factors, solid beyond the gate; the class in orange."""
    from matplotlib.patches import Patch

    best = ranked(item)[:CANDIDATES]
    marked = {name for effect in item.effects for name in class_of(effect)}
    for row, judged in enumerate(best):
        factor = judged.log_bayes_factor or 0.0
        passed = judged.p_familywise is not None and judged.p_familywise < alpha
        colour = figures.ORANGE if judged.name in marked else figures.GREY
        panel.barh(
            row,
            max(factor, LEAST),
            color=colour if passed else "none",
            edgecolor=colour,
            height=0.66,
        )
        panel.text(
            1.01, row, f"p {p_value(judged.p_familywise)}",
            transform=panel.get_yaxis_transform(), va="center", fontsize=7.5,
        )  # fmt: skip
    panel.axvline(0.0, color=figures.INK, linewidth=0.9)
    panel.set_yticks(range(len(best)), [cut(judged.name, NAME) for judged in best])
    panel.set_ylim(max(len(best), 1) - 0.4 + _room(best), -0.6)
    panel.set_xlabel("natural log of the Bayes factor")
    panel.set_title("candidates at the first look")
    panel.grid(axis="y", visible=False)
    handles = [
        Patch(
            facecolor=figures.GREY,
            edgecolor=figures.GREY,
            label=f"past the gate, {100 * alpha:.2g} %",
        ),
        Patch(facecolor="none", edgecolor=figures.GREY, label="not"),
    ]
    if marked:
        handles.insert(0, Patch(facecolor=figures.ORANGE, label="found, or its class"))
    panel.legend(handles=handles, loc="lower right", fontsize=7.5).set_in_layout(False)
