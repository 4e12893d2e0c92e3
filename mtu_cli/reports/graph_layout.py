"""Where the nodes and arcs of a measurement graph are drawn, in inches."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtu_cli.reports.graph_layers import Layers, layered
from mtu_cli.reports.graph_net import Net, Node
from mtu_cli.stats.least_squares import FloatArray

RADIUS = 0.14
INSIDE = 3
"""Signs of a name that fit into a circle; longer ones stand below it."""
LETTER = 0.066
"""Width of a letter of a label."""
PASSES = 80
STRAIGHT = 8.0
"""How much more a long arc wants to run straight than a node to stand at its neighbours."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """`places` (nodes, 2) x to the right, y downwards; `routes`: points (n, 2) of every arc."""

    width: float
    height: float
    places: FloatArray
    routes: list[FloatArray]


def lay_out(net: Net) -> Layout:
    """Layers from left to right, rows that follow their neighbours without touching."""
    layers = layered(len(net.nodes), net.arcs)
    x = _columns(net.nodes, layers)
    y = _rows(net.nodes, layers)
    height = max((value for value in y.values()), default=0.0)
    places = np.array([[x[i], y[i]] for i in range(len(net.nodes))])
    routes = [np.array([[x[node], y[node]] for node in path]) for path in layers.paths]
    return Layout(width=max(x.values()), height=height, places=places, routes=routes)


def label_width(node: Node) -> float:
    """Width of a node with its label."""
    if node.measures:
        # Its label stands to the left.
        return 2 * LETTER * len(node.label) + 0.15
    outside = not node.place or len(node.label) > INSIDE
    return max(2 * RADIUS if node.place else 0.1, LETTER * len(node.label) if outside else 0.0)


def _columns(nodes: Sequence[Node], layers: Layers) -> dict[int, float]:
    x: dict[int, float] = {}
    at, half = 0.0, 0.0
    for number, layer in enumerate(layers.order):
        own = max((label_width(nodes[i]) for i in layer if i < layers.first_bend), default=0.1) / 2
        busy = len(layer) > 12
        at += (half + own + (0.42 if busy else 0.3)) if number else 0.0
        half = own
        x.update(dict.fromkeys(layer, at))
    return x


def _rows(nodes: Sequence[Node], layers: Layers) -> dict[int, float]:
    """Rows by turns: every layer at the mean rows of its neighbours, kept apart."""
    neighbours: dict[int, list[tuple[int, float]]] = {}
    for path in layers.paths:
        for a, b in itertools.pairwise(path):
            long = (a >= layers.first_bend) + (b >= layers.first_bend)
            weight = (1.0, 2.0, STRAIGHT)[long]
            neighbours.setdefault(a, []).append((b, weight))
            neighbours.setdefault(b, []).append((a, weight))
    gaps = [_gaps(nodes, layer, layers.first_bend) for layer in layers.order]
    y: dict[int, float] = {}
    for layer, gap in zip(layers.order, gaps, strict=True):
        start = np.concatenate([[0.0], np.cumsum(gap)]) if layer else np.zeros(0)
        y.update(zip(layer, start - start.mean() if layer else start, strict=True))
    number = range(len(layers.order))
    for turn in range(PASSES):
        for index in number if turn % 2 else reversed(number):
            layer = layers.order[index]
            wanted: list[float] = []
            pull: list[float] = []
            for node in layer:
                near = neighbours.get(node, [])
                total = sum(w for _, w in near)
                wanted.append(sum(w * y[other] for other, w in near) / total if total else y[node])
                pull.append(max(total, 0.1))
            y.update(zip(layer, _apart(np.array(wanted), np.array(pull), gaps[index]), strict=True))
    top = min(y.values(), default=0.0)
    return {node: float(value - top) for node, value in y.items()}


def _gaps(nodes: Sequence[Node], layer: Sequence[int], first_bend: int) -> FloatArray:
    """Least distances (n - 1,) of neighbours in a layer."""
    return np.array(
        [
            _below(nodes, a, first_bend) + _above(nodes, b, first_bend)
            for a, b in itertools.pairwise(layer)
        ]
    )


def _below(nodes: Sequence[Node], node: int, first_bend: int) -> float:
    if node >= first_bend:
        return 0.1
    item = nodes[node]
    if item.measures or (item.place and len(item.label) <= INSIDE):
        return RADIUS + 0.05
    return 0.34 if item.place else 0.17


def _above(nodes: Sequence[Node], node: int, first_bend: int) -> float:
    if node >= first_bend:
        return 0.1
    return RADIUS + 0.05 if nodes[node].place or nodes[node].measures else 0.32


def _apart(wanted: FloatArray, weight: FloatArray, gaps: FloatArray) -> FloatArray:
    """Rows nearest to the wanted ones, weighted least squares, at least `gaps` apart.

    Less the gaps this is monotone regression: pool adjacent violators.
    """
    if len(wanted) < 2:
        return wanted
    offset = np.concatenate([[0.0], np.cumsum(gaps)])
    pools: list[list[float]] = []
    for value, w in zip(wanted - offset, weight, strict=True):
        pools.append([float(value), float(w), 1.0])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (v2, w2, n2), (v1, w1, n1) = pools.pop(), pools.pop()
            pools.append([(v1 * w1 + v2 * w2) / (w1 + w2), w1 + w2, n1 + n2])
    level = np.concatenate([np.full(int(n), value) for value, _, n in pools])
    found: FloatArray = level + offset
    return found
