"""A measurement graph as a picture: circles for places, bars for transitions."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from mtu_cli.reports import figures
from mtu_cli.reports.graph_layout import INSIDE, RADIUS, Layout, label_width, lay_out
from mtu_cli.reports.graph_net import Net, Node, share_percent
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
LEAST_SHARE = 0.005
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
        (_draw_place if node.place else _draw_bar)(panel, node, float(x), float(y))
        if net.shares.get(number, 0.0) >= LEAST_SHARE:
            text = f"{share_percent(net.shares[number])} %"
            panel.text(
                x - RADIUS - 0.04,
                y - 0.025 - 0.02 * net.shares[number],
                text,
                fontsize=SMALL,
                ha="right",
                va="bottom",
                color=figures.RED,
            )
    _write_frame(panel, net, layout, left)
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
            path=Path(vertices, codes),
            arrowstyle="-|>,head_length=3.0,head_width=1.5",
            lw=0.8 + 3.0 * share,
            color="#4d5661",
            shrinkA=0.0,
            shrinkB=0.0,
            zorder=1,
        )
    )


def _slopes(points: FloatArray) -> FloatArray:
    """Slopes (n,) of a curve that turns only where its points do (Fritsch & Butland 1984)."""
    step = np.diff(points, axis=0)
    chord = step[:, 1] / step[:, 0]
    before, after = chord[:-1], chord[1:]
    same = before * after > 0
    mean = np.divide(2 * before * after, before + after, out=np.zeros(len(same)), where=same)
    return np.concatenate([[0.0], mean, [0.0]])


def _draw_place(panel: Axes, node: Node, x: float, y: float) -> None:
    from matplotlib.patches import Circle

    panel.add_patch(
        Circle(
            (x, y),
            RADIUS,
            facecolor=COLOURS[node.kind],
            edgecolor=figures.INK,
            lw=2.0 if node.reported else 0.9,
            zorder=3,
        )
    )
    inside = len(node.label) <= INSIDE
    if node.marked:
        # The marker that stands from the start.
        spot = y + 0.085 if inside else y
        panel.add_patch(Circle((x, spot), 0.03, color=figures.INK, zorder=4))
    panel.text(
        x,
        (y - (0.03 if node.marked else 0.0)) if inside else y + RADIUS + 0.03,
        node.label,
        fontsize=LABEL,
        fontweight="bold" if node.reported else "normal",
        ha="center",
        va="center" if inside else "top",
        zorder=5,
    )


def _draw_bar(panel: Axes, node: Node, x: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    wide, high = BAR
    if node.measures:
        high *= 0.7
    corner = (x - wide / 2, y - high / 2)
    panel.add_patch(
        Rectangle(corner, wide, high, facecolor=figures.INK, edgecolor="none", zorder=3)
    )
    spot = (x - wide, y) if node.measures else (x, y - high / 2 - 0.02)
    panel.text(
        *spot,
        node.label,
        fontsize=SMALL,
        ha="right" if node.measures else "center",
        va="center" if node.measures else "bottom",
        zorder=5,
    )


def _write_frame(panel: Axes, net: Net, layout: Layout, left: float) -> None:
    """Title above; below it what is drawn, each kind once."""
    from matplotlib.patches import Circle, Rectangle

    of = "" if net.of is None else f": where the variance of {net.of} is from"
    top = -MARGIN - HEAD + 0.25
    title = cut(net.title + of, int((layout.width + 2 * left) / TITLE))
    panel.text(-left + 0.3, top, title, fontsize=10.5, fontweight="bold", va="center")
    y = layout.height + MARGIN + FOOT - 0.28
    x = -left + 0.3
    for kind in _kinds(net):
        panel.add_patch(
            Circle((x + 0.08, y), 0.08, facecolor=COLOURS[kind], ec=figures.INK, lw=0.8)
        )
        panel.text(x + 0.22, y, kind, fontsize=7.5, va="center")
        x += KEY
    if not all(node.place for node in net.nodes):
        panel.add_patch(Rectangle((x + 0.05, y - 0.1), 0.05, 0.2, color=figures.INK))
        panel.text(x + 0.17, y, "transition", fontsize=7.5, va="center")
        x += KEY
    if any(node.marked for node in net.nodes):
        panel.add_patch(Circle((x + 0.08, y), 0.03, color=figures.INK))
        panel.text(x + 0.17, y, "marker", fontsize=7.5, va="center")
        x += 0.8 * KEY
    if any(node.reported for node in net.nodes):
        panel.add_patch(Circle((x + 0.08, y), 0.08, facecolor="white", ec=figures.INK, lw=2.0))
        panel.text(x + 0.22, y, "reported", fontsize=7.5, va="center")
