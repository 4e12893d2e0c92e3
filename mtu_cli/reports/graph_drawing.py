"""A measurement graph as a picture: circles for places, bars for transitions."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.reports import figures
from mtu_cli.reports.graph_layout import (
    INSIDE,
    LEAST_SHARE,
    RADIUS,
    Layout,
    Net,
    Node,
    label_width,
    lay_out,
    share_percent,
)
from mtu_cli.reports.labels import cut
from mtu_cli.stats.least_squares import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {
    "coordinate": "#bcd7f0",
    "point": "#f6c28b",
    "vector": "#b9dfb4",
    "line": "#d6c3ea",
    "plane": "#a8dcd9",
    "frame": "#f3b4b4",
    "constant": "#e2e4e8",
}
MARGIN = 0.6
HEAD = 0.35
FOOT = 0.5
KEY = 0.95
"""Width of one entry below the picture."""
BAR = (0.07, 0.30)
SMALL = 6.2
BOLD = 1.15
"""Width of bold letters beside others."""
TITLE = 0.105
"""Width of a letter of the title, inches."""
LABEL = 6.8


@figures.styled
def drawing(net: Net) -> Figure:
    """The graph, left to right; with shares, thicker arcs and percents where variance comes in."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    layout = lay_out(net)
    width = max(layout.width + 2 * _margin(net, layout), KEY * (len(_kinds(net)) + 3))
    height = layout.height + HEAD + FOOT + 2 * MARGIN
    page = Figure(figsize=(width, height))
    FigureCanvasAgg(page)
    panel = page.add_axes((0.0, 0.0, 1.0, 1.0))
    left = (width - layout.width) / 2
    panel.set_xlim(-left, width - left)
    panel.set_ylim(layout.height + MARGIN + FOOT, -MARGIN - HEAD)
    panel.axis("off")
    for arc, route in zip(net.arcs, layout.routes, strict=True):
        _draw_arc(panel, net, arc, route)
    for number, node in enumerate(net.nodes):
        x, y = layout.places[number]
        _draw_node(panel, node, float(x), float(y))
        if net.shares.get(number, 0.0) >= LEAST_SHARE:
            text = f"{share_percent(net.shares[number])} %"
            left_of, above = x - RADIUS - 0.04, y - 0.025 - 0.02 * net.shares[number]
            label = panel.text(left_of, above, text, fontsize=SMALL, ha="right", va="bottom")
            label.set_color(figures.RED)
    _explain(page, net, width)
    return page


def _margin(net: Net, layout: Layout) -> float:
    """Room beside the net for the labels at both ends."""
    reach = [MARGIN]
    for node, (x, _) in zip(net.nodes, layout.places, strict=False):
        half = (BOLD if node.reported else 1.0) * label_width(node) / 2 + 0.1
        reach += [half - float(x), half + float(x) - layout.width]
    return max(reach)


def _kinds(net: Net) -> list[str]:
    present = {node.kind for node in net.nodes if node.place}
    return [kind for kind in COLOURS if kind in present]


def _draw_arc(panel: Axes, net: Net, arc: tuple[int, int], route: FloatArray) -> None:
    """A smooth curve, level at both ends; the head at the rim of its node."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    start, end = (net.nodes[number] for number in arc)
    points = route.copy()
    points[0, 0] += RADIUS if start.place else BAR[0] / 2
    points[-1, 0] -= RADIUS if end.place else BAR[0] / 2
    vertices = [points[0]]
    codes = [Path.MOVETO]
    slopes = _slopes(points)
    for (a, b), (first, last) in zip(
        itertools.pairwise(points), itertools.pairwise(slopes), strict=True
    ):
        third = (b[0] - a[0]) / (2 if first == last == 0 else 3)
        vertices += [a + third * np.array([1, first]), b - third * np.array([1, last]), b]
        codes += [Path.CURVE4] * 3
    share = max((net.shares.get(number, 0.0) for number in arc), default=0.0)
    panel.add_patch(
        FancyArrowPatch(
            path=Path(vertices, codes), arrowstyle="-|>,head_length=3.0,head_width=1.5",
            lw=0.8 + 3.0 * share, color="#4d5661", shrinkA=0.0, shrinkB=0.0, zorder=1,
        )
    )  # fmt: skip


def _slopes(points: FloatArray) -> FloatArray:
    """Slopes (n,) of a curve that turns only where its points do (Fritsch & Butland 1984)."""
    step = np.diff(points, axis=0)
    chord = step[:, 1] / step[:, 0]
    before, after = chord[:-1], chord[1:]
    same = before * after > 0
    mean = np.divide(2 * before * after, before + after, out=np.zeros(len(same)), where=same)
    return np.concatenate([[0.0], mean, [0.0]])


def _draw_node(panel: Axes, node: Node, x: float, y: float) -> None:
    """A circle with its name in it or below, a marker that stands from the start; or a bar."""
    from matplotlib.patches import Circle, Rectangle

    bold = "bold" if node.reported else "normal"
    if node.place:
        look = {"facecolor": COLOURS[node.kind], "edgecolor": figures.INK}
        panel.add_patch(Circle((x, y), RADIUS, lw=2.0 if node.reported else 0.9, zorder=3, **look))
        inside = len(node.label) <= INSIDE
        if node.marked:
            spot = y + 0.085 if inside else y
            panel.add_patch(Circle((x, spot), 0.03, color=figures.INK, zorder=4))
        at = (y - 0.03 * node.marked) if inside else y + RADIUS + 0.03
        under = "center" if inside else "top"
        form: dict[str, Any] = {"fontsize": LABEL, "fontweight": bold, "zorder": 5}
        panel.text(x, at, node.label, ha="center", va=under, **form)
        return
    wide, high = BAR[0], BAR[1] * (0.7 if node.measures else 1.0)
    corner = (x - wide / 2, y - high / 2)
    panel.add_patch(
        Rectangle(corner, wide, high, facecolor=figures.INK, edgecolor="none", zorder=3)
    )
    if node.measures:
        panel.text(x - wide, y, node.label, ha="right", va="center", fontsize=SMALL, zorder=5)
    else:
        top = y - high / 2 - 0.02
        panel.text(x, top, node.label, ha="center", va="bottom", fontsize=SMALL, zorder=5)


def _explain(page: Figure, net: Net, width: float) -> None:
    """Title above; below it what is drawn, each kind once."""
    from matplotlib.lines import Line2D

    of = "" if net.of is None else f": where the variance of {net.of} is from"
    title = cut(net.title + of, int(width / TITLE))
    top = 1.0 - 0.25 / page.get_figheight()
    page.text(0.3 / width, top, title, fontsize=10.5, fontweight="bold", va="center")
    signs = [("o", kind, COLOURS[kind], 0.8, 11.0) for kind in _kinds(net)]
    signs += [
        sign
        for sign, there in (
            (("|", "transition", figures.INK, 3.5, 13.0), not all(n.place for n in net.nodes)),
            (("o", "marker", figures.INK, 0.0, 4.0), any(node.marked for node in net.nodes)),
            (("o", "reported", "white", 2.0, 11.0), any(node.reported for node in net.nodes)),
        )
        if there
    ]
    handles = [
        Line2D(
            [], [], linestyle="none", marker=marker, label=name, markersize=size,
            markerfacecolor=colour, markeredgecolor=figures.INK, markeredgewidth=edge,
        )
        for marker, name, colour, edge, size in signs
    ]  # fmt: skip
    page.legend(
        handles=handles, loc="lower left", ncols=len(handles), fontsize=7.5, handletextpad=0.2,
        columnspacing=1.2,
    )  # fmt: skip
