"""A measurement graph as a picture, left to right: circles for places, bars for transitions.

Layered drawing (Sugiyama, Tagawa & Toda, IEEE Trans. SMC 11 (1981) 109): arcs lead from left to
right, an arc over several layers is cut by bends, layers are ordered by the mean position of their
neighbours, and rows follow their neighbours as near as they may without touching.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING, Any

import numpy as np

from mtu_cli.files.graph_contract import Graph
from mtu_cli.reports import figures
from mtu_cli.reports.labels import cut
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Arcs = Sequence[Sequence[int]]

COLOURS = {
    "coordinate": "#bcd7f0",
    "point": "#f6c28b",
    "vector": "#b9dfb4",
    "line": "#d6c3ea",
    "plane": "#a8dcd9",
    "frame": "#f3b4b4",
    "constant": "#e2e4e8",
}
RADIUS, BAR = 0.14, (0.07, 0.30)
"""Of a circle, and width and height of a bar, inches."""
INSIDE = 3
"""Signs of a name that fit into a circle; longer ones stand below it."""
FONT, LETTER, BOLD = 7.0, 0.066, 1.15
"""Points of a label, width of its letters in inches, and of bold ones beside others."""
MARGIN, HEAD, FOOT, KEY, TITLE = 0.6, 0.35, 0.5, 0.95, 0.105
"""Room about the picture, for its title and its key; widths of an entry of the key and of a letter
of the title, inches."""
SWEEPS, PASSES = 9, 80
WEIGHTS = (1.0, 2.0, 8.0)
"""Of arcs between nodes, between a node and a bend, between bends: long arcs run straight."""
NOISE = 1e-9
"""Percent by which rounding may move a share."""
SHOWN_SHARES, LEAST_SHARE = 3, 0.005
"""Sources of variance that are named, each with at least this share."""
SOURCES = {"u1_axis": "axis", "u2_probe": "probe", "u3_perpendicular": "perpendicularity"}
"""Sources for people; others are places."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A place (circle) or a transition (bar). `kind`: of the place, or what the transition does.

    `marked`: holds a marker from the start (a constant, a known point).
    """

    name: str
    label: str
    kind: str
    place: bool
    marked: bool = False
    reported: bool = False

    @property
    def measures(self) -> bool:
        """Whether it is a transition without inputs, a measurement: its label is to the left."""
        return not self.place and self.kind == "meas"

    @property
    def inside(self) -> bool:
        """Whether it is a place with its name in the circle."""
        return self.place and len(self.label) <= INSIDE

    @property
    def width(self) -> float:
        """Width of the node with its label."""
        letters = LETTER * len(self.label)
        if self.measures:
            return 2 * letters + 0.15
        return max(2 * RADIUS if self.place else 0.1, 0.0 if self.inside else letters)

    @property
    def room(self) -> tuple[float, float]:
        """Room above the middle and below it."""
        if self.measures or self.inside:
            return RADIUS + 0.05, RADIUS + 0.05
        return (RADIUS + 0.05, 0.34) if self.place else (0.32, 0.17)


@dataclass(frozen=True, slots=True, kw_only=True)
class Net:
    """Nodes and arcs (from, to) as numbers of nodes: places first, then transitions.

    `shares` of the variance of `of` that comes in at a place, from 0 to 1.
    """

    title: str
    nodes: tuple[Node, ...]
    arcs: tuple[tuple[int, int], ...]
    of: str | None = None
    shares: Mapping[int, float] = field(default_factory=dict)


def share_percent(share: float, decimals: int = 1) -> str:
    """A share in percent, halves up: equal shares differ by rounding noise, and read the same."""
    text = f"{100 * share + NOISE:.{decimals}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def small_unit(unit: str) -> tuple[float, str]:
    """The unit in which deviations of an output are shown, and how many of it make one."""
    return {"mm": (1.0 / UM, "um"), "rad": (1e6, "urad"), "1": (1e6, "1e-6")}.get(unit, (1.0, unit))


def shares_text(shares: Mapping[str, float]) -> str:
    """ "probe 50, axis 49": percents of the sources of variance, the largest first."""
    known = [(name, share) for name, share in shares.items() if abs(share) >= LEAST_SHARE]
    known.sort(key=lambda pair: -abs(pair[1]))
    shown = [
        f"{SOURCES.get(name, name)} {share_percent(share, 0)}"
        for name, share in known[:SHOWN_SHARES]
        if math.isfinite(share)
    ]
    return ", ".join(shown) or "-"


def net_of(
    graph: Graph,
    reported: tuple[str, ...],
    of: str | None = None,
    shares: Mapping[str, float] | None = None,
) -> Net:
    """The net of a graph; `shares` by place are those of the variance of `of`."""
    nodes = [
        Node(
            name=name,
            label=name,
            kind=item.kind,
            place=True,
            marked=item.marked,
            reported=name in reported,
        )
        for name, item in graph.places.items()
    ]
    at = {node.name: i for i, node in enumerate(nodes)}
    arcs = []
    for number, item in enumerate(graph.transitions):
        # A place that is an input twice has one arc.
        arcs += [(at[name], len(nodes)) for name in dict.fromkeys(item.in_)]
        arcs += [(len(nodes), at[name]) for name in item.out]
        nodes.append(Node(name=f"t{number + 1}", label=item.do, kind=item.do, place=False))
    return Net(
        title=graph.name,
        nodes=tuple(nodes),
        arcs=tuple(arcs),
        of=of,
        shares={at[name]: share for name, share in (shares or {}).items()},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """`places` (nodes, 2) x to the right, y downwards; `routes`: points (n, 2) of every arc."""

    width: float
    height: float
    places: FloatArray
    routes: list[FloatArray]


def lay_out(net: Net) -> Layout:
    """The layout of a net without cycles."""
    rank = _ranks(len(net.nodes), net.arcs)
    paths = []
    for a, b in net.arcs:
        crossed = range(rank[a] + 1, rank[b])
        paths.append([a, *range(len(rank), len(rank) + len(crossed)), b])
        rank += crossed
    layers = _ordered(rank, [pair for path in paths for pair in itertools.pairwise(path)])
    x, y = _columns(net.nodes, layers), _rows(net.nodes, layers, paths)
    places = np.array([[x[i], y[i]] for i in range(len(net.nodes))])
    routes = [np.array([[x[node], y[node]] for node in path]) for path in paths]
    width, height = (max(values.values(), default=0.0) for values in (x, y))
    return Layout(width=width, height=height, places=places, routes=routes)


def _adjacent(count: int, arcs: Arcs) -> tuple[list[list[int]], list[list[int]]]:
    """The nodes before and after each node."""
    before: list[list[int]] = [[] for _ in range(count)]
    after: list[list[int]] = [[] for _ in range(count)]
    for a, b in arcs:
        before[b].append(a)
        after[a].append(b)
    return before, after


def _ranks(count: int, arcs: Arcs) -> list[int]:
    """Layers by longest path; then every node moves to where its arcs are shortest."""
    before, after = _adjacent(count, arcs)
    order = list(TopologicalSorter(dict(enumerate(before))).static_order())
    rank = [0] * count
    for node in order:
        rank[node] = max((rank[other] + 1 for other in before[node]), default=0)
    for node in reversed(order):
        # A measured place goes to where it is used, and its measurement with it.
        measured = len(before[node]) == 1 and not before[before[node][0]]
        if after[node] and (len(after[node]) > len(before[node]) or measured):
            rank[node] = min(rank[other] for other in after[node]) - 1
    least = min(rank, default=0)
    return [value - least for value in rank]


def _ordered(rank: list[int], arcs: Arcs) -> list[list[int]]:
    """The nodes of every layer from top to bottom: at first as they are met on the way back from
    the ends, then by the mean position of their neighbours, to and fro; the last sweep is forward.
    """
    before, after = _adjacent(len(rank), arcs)
    layers: list[list[int]] = [[] for _ in range(max(rank, default=0) + 1)]
    waiting = [node for node in reversed(range(len(rank))) if not after[node]]
    seen = set()
    while waiting:
        node = waiting.pop()
        if node not in seen:
            seen.add(node)
            layers[rank[node]].append(node)
            waiting.extend(reversed(before[node]))
    for sweep in range(SWEEPS):
        near, pairs = (after, layers[::-1]) if sweep % 2 else (before, layers)
        for fixed, layer in itertools.pairwise(pairs):
            at = {node: i for i, node in enumerate(fixed)}
            wanted = {node: i * len(fixed) / len(layer) for i, node in enumerate(layer)}
            for node in layer:
                if near[node]:
                    wanted[node] = sum(at[other] for other in near[node]) / len(near[node])
            layer.sort(key=wanted.__getitem__)
    return layers


def _columns(nodes: Sequence[Node], layers: list[list[int]]) -> dict[int, float]:
    """Layers beside one another, as wide as their widest label."""
    x: dict[int, float] = {}
    at, half = 0.0, 0.0
    for number, layer in enumerate(layers):
        own = max((nodes[i].width for i in layer if i < len(nodes)), default=0.1) / 2
        at += (half + own + (0.42 if len(layer) > 12 else 0.3)) if number else 0.0
        half = own
        x.update(dict.fromkeys(layer, at))
    return x


def _rows(nodes: Sequence[Node], layers: list[list[int]], paths: Arcs) -> dict[int, float]:
    """Rows by turns: every layer at the mean rows of its neighbours, at least its gaps apart."""
    near: dict[int, list[tuple[int, float]]] = {}
    for a, b in (pair for path in paths for pair in itertools.pairwise(path)):
        weight = WEIGHTS[(a >= len(nodes)) + (b >= len(nodes))]
        near.setdefault(a, []).append((b, weight))
        near.setdefault(b, []).append((a, weight))
    y: dict[int, float] = {}
    offsets = []
    for layer in layers:
        rooms = [nodes[i].room if i < len(nodes) else (0.1, 0.1) for i in layer]
        gaps = [below + above for (_, below), (above, _) in itertools.pairwise(rooms)]
        offset = np.concatenate([[0.0], np.cumsum(gaps)])
        offsets.append(offset)
        y.update(zip(layer, (offset - offset.mean()).tolist(), strict=True))
    for turn in range(PASSES):
        for index in range(len(layers)) if turn % 2 else reversed(range(len(layers))):
            wanted, pull = [], []
            for node in layers[index]:
                total = sum(weight for _, weight in near.get(node, []))
                mean = sum(weight * y[other] for other, weight in near.get(node, []))
                wanted.append(mean / total if total else y[node])
                pull.append(max(total, 0.1))
            rows = offsets[index] + _monotone(np.array(wanted) - offsets[index], pull)
            y.update(zip(layers[index], rows.tolist(), strict=True))
    top = min(y.values(), default=0.0)
    return {node: value - top for node, value in y.items()}


def _monotone(values: FloatArray, weights: Sequence[float]) -> FloatArray:
    """The nearest values that do not fall, weighted least squares: pool adjacent violators."""
    pools: list[tuple[float, float, int]] = []
    for value, weight in zip(values.tolist(), weights, strict=True):
        pools.append((value, weight, 1))
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (v2, w2, n2), (v1, w1, n1) = pools.pop(), pools.pop()
            pools.append(((v1 * w1 + v2 * w2) / (w1 + w2), w1 + w2, n1 + n2))
    return np.repeat([value for value, _, _ in pools], [n for _, _, n in pools])


@figures.styled
def drawing(net: Net) -> Figure:
    """The graph, left to right; with shares, thicker arcs and percents where variance comes in."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    layout = lay_out(net)
    reach = [MARGIN]
    for node, (x, _) in zip(net.nodes, layout.places, strict=False):
        half = (BOLD if node.reported else 1.0) * node.width / 2 + 0.1
        reach += [half - float(x), half + float(x) - layout.width]
    kinds = [kind for kind in COLOURS if any(n.place and n.kind == kind for n in net.nodes)]
    width = max(layout.width + 2 * max(reach), KEY * (len(kinds) + 3))
    page = Figure(figsize=(width, layout.height + HEAD + FOOT + 2 * MARGIN))
    FigureCanvasAgg(page)
    panel = page.add_axes((0.0, 0.0, 1.0, 1.0))
    left = (width - layout.width) / 2
    panel.set_xlim(-left, width - left)
    panel.set_ylim(layout.height + MARGIN + FOOT, -MARGIN - HEAD)
    panel.axis("off")
    for arc, route in zip(net.arcs, layout.routes, strict=True):
        _draw_arc(panel, net, arc, route)
    for number, node in enumerate(net.nodes):
        x, y = layout.places[number].tolist()
        (_draw_place if node.place else _draw_bar)(panel, node, x, y)
        share = net.shares.get(number, 0.0)
        if share >= LEAST_SHARE:
            panel.text(
                x - RADIUS - 0.04, y - 0.025 - 0.02 * share, f"{share_percent(share)} %",
                fontsize=FONT, color=figures.RED, ha="right", va="bottom",
            )  # fmt: skip
    _explain(page, net, kinds, width)
    return page


def _draw_arc(panel: Axes, net: Net, arc: tuple[int, int], route: FloatArray) -> None:
    """A smooth curve, level at both ends, that turns only where its points do (Fritsch & Butland
    1984); the head at the rim of its node.
    """
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    start, end = (net.nodes[number] for number in arc)
    points = route.copy()
    points[0, 0] += RADIUS if start.place else BAR[0] / 2
    points[-1, 0] -= RADIUS if end.place else BAR[0] / 2
    chord = np.diff(points[:, 1]) / np.diff(points[:, 0])
    before, after = chord[:-1], chord[1:]
    same = before * after > 0
    mean = np.divide(2 * before * after, before + after, out=np.zeros(len(same)), where=same)
    slopes = itertools.pairwise([0.0, *mean.tolist(), 0.0])
    vertices, codes = [points[0]], [Path.MOVETO]
    for (a, b), (first, last) in zip(itertools.pairwise(points), slopes, strict=True):
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


def _draw_place(panel: Axes, node: Node, x: float, y: float) -> None:
    """A circle with its name in it or below, and a marker that stands from the start."""
    from matplotlib.patches import Circle

    look: dict[str, Any] = {"facecolor": COLOURS[node.kind], "edgecolor": figures.INK}
    panel.add_patch(Circle((x, y), RADIUS, lw=2.0 if node.reported else 0.9, zorder=3, **look))
    if node.marked:
        spot = y + 0.085 if node.inside else y
        panel.add_patch(Circle((x, spot), 0.03, color=figures.INK, zorder=4))
    at = (y - 0.03 * node.marked) if node.inside else y + RADIUS + 0.03
    panel.text(
        x, at, node.label, ha="center", va="center" if node.inside else "top", fontsize=FONT,
        fontweight="bold" if node.reported else "normal", zorder=5,
    )  # fmt: skip


def _draw_bar(panel: Axes, node: Node, x: float, y: float) -> None:
    """A bar with what it does above it, or to the left of a measurement."""
    from matplotlib.patches import Rectangle

    wide, high = BAR[0], BAR[1] * (0.7 if node.measures else 1.0)
    corner = (x - wide / 2, y - high / 2)
    panel.add_patch(Rectangle(corner, wide, high, facecolor=figures.INK, lw=0, zorder=3))
    if node.measures:
        panel.text(x - wide, y, node.label, ha="right", va="center", fontsize=FONT, zorder=5)
    else:
        above = y - high / 2 - 0.02
        panel.text(x, above, node.label, ha="center", va="bottom", fontsize=FONT, zorder=5)


def _explain(page: Figure, net: Net, kinds: list[str], width: float) -> None:
    """Title above; below it what is drawn, each kind once."""
    from matplotlib.lines import Line2D

    of = "" if net.of is None else f": where the variance of {net.of} is from"
    title = cut(net.title + of, int(width / TITLE))
    top = 1.0 - 0.25 / page.get_figheight()
    page.text(0.3 / width, top, title, fontsize=10.5, fontweight="bold", va="center")
    signs = [("o", kind, COLOURS[kind], 0.8, 11.0) for kind in kinds]
    if any(not node.place for node in net.nodes):
        signs.append(("|", "transition", figures.INK, 3.5, 13.0))
    if any(node.marked for node in net.nodes):
        signs.append(("o", "marker", figures.INK, 0.0, 4.0))
    if any(node.reported for node in net.nodes):
        signs.append(("o", "reported", "white", 2.0, 11.0))
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
