"""A measurement graph as a picture, left to right: circles for places, bars for transitions; and as
text: Graphviz, Mermaid, and the assertions of the paper.

Layered drawing (Sugiyama, Tagawa & Toda, IEEE Trans. SMC 11 (1981) 109).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from graphlib import TopologicalSorter
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mtu_cli.model.graph.net import MeasurementGraph
from mtu_cli.reports import figures
from mtu_cli.reports.numbers import cut
from mtu_cli.stats.least_squares import FloatArray

COLOURS = {
    "coordinate": "#bcd7f0",
    "point": "#f6c28b",
    "vector": "#b9dfb4",
    "line": "#d6c3ea",
    "plane": "#a8dcd9",
    "frame": "#f3b4b4",
    "constant": "#e2e4e8",
}
RADIUS, BAR = 0.14, (0.07, 0.28)
"""Of a circle, and width and height of a bar, inches."""
ROOM, BEND, GAP = 0.23, 0.08, 0.35
"""Half the height of a node with its label and of an arc that passes, and between columns."""
MARGIN, FOOT = 0.8, 0.2
"""Room about the picture and for its key, inches."""
LEAST_SHARE = 0.005
"""Of sources of variance that are named."""


class Node(NamedTuple):
    """A place (circle) of a `kind` by its name, or a transition (bar, no kind) by what it does.

    `marked`: holds a marker from the start (a constant, a known point).
    """

    label: str
    kind: str = ""
    marked: bool = False
    reported: bool = False

    @property
    def width(self) -> float:
        """Width of the node with its label."""
        return max(2 * RADIUS, figures.LETTER * len(self.label))


class Net(NamedTuple):
    """Nodes and arcs (from, to) as numbers of nodes: places first, then transitions.

    `shares` of the variance of `of` that comes in at a place, from 0 to 1.
    """

    title: str
    nodes: list[Node]
    arcs: list[tuple[int, int]]
    of: str | None
    shares: Mapping[int, float]


def share_percent(share: float, decimals: int = 1) -> str:
    """A share in percent, halves up: equal shares differ by rounding noise, and read the same."""
    return f"{100 * share + 1e-9:z.{decimals}f}"


def net_of(
    measurement: MeasurementGraph, of: str | None = None, shares: Mapping[str, float] | None = None
) -> Net:
    """The net of a graph; `shares` by place are those of the variance of `of`."""
    graph, reported = measurement.graph, measurement.reported
    at = {name: i for i, name in enumerate(graph.places)}
    nodes = [Node(n, x.kind, x.marked, n in reported) for n, x in graph.places.items()]
    arcs: list[tuple[int, int]] = []
    for item in graph.transitions:
        # A place that is an input twice has one arc.
        arcs += [(at[name], len(nodes)) for name in dict.fromkeys(item.in_)]
        arcs += [(len(nodes), at[name]) for name in item.out]
        nodes.append(Node(item.do))
    node_shares = {at[name]: share for name, share in (shares or {}).items()}
    return Net(graph.name, nodes, arcs, of, node_shares)


def lay_out(net: Net) -> tuple[FloatArray, list[FloatArray]]:
    """The places (nodes, 2) of a net without cycles, x to the right, y downwards, and points (n, 2)
    of every arc: layers by longest path, nodes ordered in them by the mean position of their
    neighbours. An arc that passes a layer has a point of its own there.
    """
    count = len(net.nodes)
    rank = _ranks(count, net.arcs)
    paths = []
    for a, b in net.arcs:
        bends = range(rank[a] + 1, rank[b])
        paths.append([a, *range(len(rank), len(rank) + len(bends)), b])
        rank += bends
    layers: list[list[int]] = [[] for _ in range(max(rank, default=0) + 1)]
    for node, number in enumerate(rank):
        layers[number].append(node)
    before, after = _adjacent([pair for path in paths for pair in pairwise(path)])
    for sweep in range(9):  # to and fro; at last forward
        near, pairs = (after, layers[::-1]) if sweep % 2 else (before, layers)
        for fixed, layer in pairwise(pairs):
            at = {node: i for i, node in enumerate(fixed)}
            targets = {node: i * len(fixed) / len(layer) for i, node in enumerate(layer)}
            for node in filter(near.__getitem__, layer):
                targets[node] = sum(at[other] for other in near[node]) / len(near[node])
            layer.sort(key=targets.__getitem__)
    wide = [max((net.nodes[i].width for i in x if i < count), default=0) for x in layers]
    middles = np.cumsum(wide) - np.array(wide) / 2 + GAP * np.arange(len(wide))
    near_rows = [before[i] + after[i] or [i] for i in range(len(rank))]
    spots = np.column_stack([middles[rank], _rows(count, layers, near_rows)])
    return spots[:count], [spots[path] for path in paths]


def _adjacent(arcs: Sequence[tuple[int, int]]) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
    """The nodes before and after each node."""
    before, after = defaultdict(list), defaultdict(list)
    for a, b in arcs:
        before[b].append(a)
        after[a].append(b)
    return before, after


def _ranks(count: int, arcs: Sequence[tuple[int, int]]) -> list[int]:
    """Layers by longest path; then every node moves to where its arcs are shortest."""
    before, after = _adjacent(arcs)
    order = list(TopologicalSorter({i: before[i] for i in range(count)}).static_order())
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


def _rows(nodes: int, layers: list[list[int]], near: list[list[int]]) -> FloatArray:
    """Rows at the means of their neighbours, gaps kept, by least squares."""
    from scipy.optimize import isotonic_regression

    y: FloatArray = np.zeros(len(near))
    offsets = []
    for layer in layers:
        rooms = np.where(np.array(layer) < nodes, ROOM, BEND)
        offsets.append(np.cumsum(rooms) + np.cumsum(np.append(0.0, rooms[:-1])))
        y[layer] = offsets[-1] - offsets[-1].mean()
    for turn in range(80):
        for index in range(len(layers)) if turn % 2 else reversed(range(len(layers))):
            layer, offset = layers[index], offsets[index]
            targets = np.array([y[near[i]].mean() for i in layer])
            y[layer] = offset + isotonic_regression(targets - offset).x
    return y - y.min(initial=np.inf)


def drawing(net: Net) -> figures.Figure:
    """The graph, left to right; with shares, thicker arcs and percents where variance comes in."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path
    from scipy.interpolate import PchipInterpolator

    places, routes = lay_out(net)
    right, bottom = places.max(axis=0, initial=0.0)
    kinds = {node.kind for node in net.nodes}
    sides = MARGIN + max((node.width for node in net.nodes), default=0.0) / 2
    width = max(right + 2 * sides, 0.95 * (len(kinds) + 3))
    page = figures.blank(width, bottom + 2 * MARGIN + FOOT)
    page.set_layout_engine("none")
    panel = page.add_axes((0.0, 0.0, 1.0, 1.0))
    margin = (width - right) / 2
    panel.set(xlim=(-margin, width - margin), ylim=(bottom + MARGIN + FOOT, -MARGIN))
    panel.axis("off")
    for (a, b), route in zip(net.arcs, routes, strict=True):
        # Level at both ends, turning only where the points do (Fritsch & Butland 1984).
        before, after = (RADIUS if net.nodes[x].kind else BAR[0] / 2 for x in (a, b))
        share = max(net.shares.get(a, 0.0), net.shares.get(b, 0.0))
        (x0, y0), *bends, (x1, y1) = route.tolist()
        x0, x1 = x0 + before, x1 - after
        points = np.array([(x0, y0), (x0 + 0.02, y0), *bends, (x1 - 0.02, y1), (x1, y1)])
        along = np.linspace(x0, x1, 100)
        curve = Path(np.column_stack([along, PchipInterpolator(*points.T)(along)]))
        arrow = FancyArrowPatch(
            path=curve, arrowstyle="-|>,head_length=3.0,head_width=1.5", lw=0.8 + 3.0 * share,
            color="#4d5661", shrinkA=0.0, shrinkB=0.0, zorder=1,
        )  # fmt: skip
        panel.add_patch(arrow)
    ring: dict[str, Any] = {"ls": "", "marker": "o", "ms": 144 * RADIUS, "mec": figures.INK}
    bar: dict[str, Any] = {"ms": 72 * BAR[1], "mew": 72 * BAR[0], "color": figures.INK}
    for number, (node, (x, y)) in enumerate(zip(net.nodes, places.tolist(), strict=True)):
        if node.kind:
            panel.plot(x, y, **ring, mfc=COLOURS[node.kind], mew=0.9, zorder=3, label=node.kind)
        else:
            panel.plot(x, y, "|", **bar, zorder=3, label="transition")
        if node.reported:
            panel.plot(x, y, **ring, mfc="none", mew=2.0, zorder=3, label="reported")
        if node.marked:
            panel.plot(x, y, "o", ms=4.3, mew=0, color=figures.INK, zorder=4, label="marker")
        panel.text(x, y + RADIUS + 0.02, node.label, fontsize=7.0, ha="center", va="top", zorder=5)
        if (share := net.shares.get(number, 0.0)) >= LEAST_SHARE:
            panel.text(
                x - RADIUS - 0.04, y - 0.025 - 0.02 * share, f"{share_percent(share)} %",
                fontsize=7.0, color=figures.RED, ha="right", va="bottom",
            )  # fmt: skip
    of = "" if net.of is None else f": where the variance of {net.of} is from"
    figures.title(page, cut(net.title + of, int(width / 0.105)))
    figures.key(page, [panel], loc="lower left", ncols=len(kinds) + 3, markerscale=0.55)
    return page


DOT_BAR = "shape=box, style=filled, fillcolor=black, width=0.08, height=0.5, fixedsize=true"


def dot(net: Net) -> str:
    """Graphviz."""
    lines = [f"digraph {_quote(net.title)} {{", "  rankdir=LR;", "  node [fontsize=10];"]
    keys = _keys(net)
    for number, (key, node) in enumerate(zip(keys, net.nodes, strict=True)):
        if node.kind:
            share = net.shares.get(number)
            label = node.label + ("" if share is None else f"\\n{share_percent(share)} %")
            style = f'shape=circle, style=filled, fillcolor="{COLOURS[node.kind]}"'
            style += ", penwidth=2" if node.reported else ""
            lines.append(f"  {key} [label={_quote(label)}, {style}];")
        else:
            lines.append(f'  {key} [label="", xlabel={_quote(node.label)}, {DOT_BAR}];')
    lines += [f"  {keys[a]} -> {keys[b]};" for a, b in net.arcs]
    return "\n".join([*lines, "}"]) + "\n"


def mermaid(net: Net) -> str:
    """Mermaid."""
    lines, keys = ["---", f"title: {_plain(net.title)}", "---", "flowchart LR"], _keys(net)
    for number, (key, node) in enumerate(zip(keys, net.nodes, strict=True)):
        share = net.shares.get(number)
        text = _plain(node.label) + ("" if share is None else f"<br>{share_percent(share)} %")
        lines.append(
            f'  {key}(("{text}")):::{node.kind}' if node.kind else f'  {key}["{text}"]:::bar'
        )
    lines += [f"  {keys[a]} --> {keys[b]}" for a, b in net.arcs]
    kinds = {node.kind for node in net.nodes}
    lines += [
        f"  classDef {kind} fill:{colour},stroke:#1b1f24,color:#1b1f24"
        for kind, colour in COLOURS.items()
        if kind in kinds
    ]
    return "\n".join([*lines, "  classDef bar fill:#1b1f24,stroke:#1b1f24,color:#ffffff"]) + "\n"


def _keys(net: Net) -> list[str]:
    """p1, p2, ... of places, t1, t2, ... of transitions."""
    places = sum(bool(node.kind) for node in net.nodes)
    numbers = range(len(net.nodes))
    return [f"p{i + 1}" if i < places else f"t{i - places + 1}" for i in numbers]


def _quote(text: str) -> str:
    return '"' + text.replace('"', '\\"') + '"'


def _plain(text: str) -> str:
    """Text without signs that have a meaning in the format."""
    return re.sub(r'["#;:<>{}\[\]|`]', "_", text)


_KIND = {"point": "p", "vector": "v", "constant": "r", "line": "l", "plane": "n", "frame": "f"}


def assertions(net: Net, measurement: MeasurementGraph) -> str:
    """The model data base of Stryczek, Table 1: p(n, x, y, kind, X, Y, Z), t(n, x, y, type),
    pt(p, t), tp(t, p), m(p).

    n counts places and transitions apart; x, y in pixels, 96 to the inch; the values are those at
    nominal (for a coordinate and a constant the first; of lines and planes the direction, of frames
    the origin).
    """
    spots = np.rint((lay_out(net)[0] + 0.5) * 96).astype(int)
    graph, lines = measurement.graph, [f"% {_plain(net.title)}"]
    count = len(graph.places)
    for number, (node, (x, y)) in enumerate(zip(net.nodes, spots, strict=True), 1):
        if not node.kind:
            lines.append(f"t({number - count}, {x}, {y}, {node.label}).")
            continue
        kind = (
            graph.places[node.label].axis or "x" if node.kind == "coordinate" else _KIND[node.kind]
        )
        value = measurement.nominal[node.label][..., 0]
        row = value if value.ndim < 2 else value[0] if node.kind == "frame" else value[1]
        values = ", ".join(f"{item + 0.0:.9g}" for item in [*np.atleast_1d(row), 0.0, 0.0][:3])
        lines.append(f'p({number}, {x}, {y}, "{kind}", {values}). % {_plain(node.label)}')
    for a, b in net.arcs:
        arc = f"pt({a + 1}, {b - count + 1})" if a < count else f"tp({a - count + 1}, {b + 1})"
        lines.append(f"{arc}.")
    lines += [f"m({number})." for number, node in enumerate(net.nodes, 1) if node.marked]
    return "\n".join(lines) + "\n"
