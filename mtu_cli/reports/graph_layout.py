"""A measurement graph as nodes and arcs, and where these are drawn, in inches.

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

import numpy as np

from mtu_cli.files.graph_contract import Graph
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.units import UM

Arcs = Sequence[Sequence[int]]

RADIUS = 0.14
INSIDE = 3
"""Signs of a name that fit into a circle; longer ones stand below it."""
LETTER = 0.066
"""Width of a letter of a label."""
SWEEPS, PASSES = 9, 80
STRAIGHT = 8.0
"""How much more a long arc wants to run straight than a node to stand at its neighbours."""
NOISE = 1e-9
"""Percent by which rounding may move a share."""
SHOWN_SHARES = 3
"""Sources of variance that are named."""
LEAST_SHARE = 0.005
"""A smaller share of the variance is not named."""
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
        """Whether it is a measurement: a transition without inputs."""
        return not self.place and self.kind == "meas"


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
    places = [
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
    at = {node.name: i for i, node in enumerate(places)}
    bars = []
    arcs = []
    for number, item in enumerate(graph.transitions):
        own = len(places) + number
        bars.append(Node(name=f"t{number + 1}", label=item.do, kind=item.do, place=False))
        # A place that is an input twice has one arc.
        arcs += [(at[name], own) for name in dict.fromkeys(item.in_)]
        arcs += [(own, at[name]) for name in item.out]
    return Net(
        title=graph.name,
        nodes=(*places, *bars),
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
    layers = _ordered(rank, paths)
    x, y = _columns(net.nodes, layers), _rows(net.nodes, layers, paths)
    places = np.array([[x[i], y[i]] for i in range(len(net.nodes))])
    routes = [np.array([[x[node], y[node]] for node in path]) for path in paths]
    width, height = (max(values.values(), default=0.0) for values in (x, y))
    return Layout(width=width, height=height, places=places, routes=routes)


def label_width(node: Node) -> float:
    """Width of a node with its label."""
    if node.measures:
        # Its label stands to the left.
        return 2 * LETTER * len(node.label) + 0.15
    outside = not node.place or len(node.label) > INSIDE
    return max(2 * RADIUS if node.place else 0.1, LETTER * len(node.label) if outside else 0.0)


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


def _ordered(rank: list[int], paths: Arcs) -> list[list[int]]:
    """The nodes of every layer from top to bottom: at first as they are met on the way back from
    the ends, then by the mean position of their neighbours, to and fro; the last sweep is forward.
    """
    before, after = _adjacent(
        len(rank), [pair for path in paths for pair in itertools.pairwise(path)]
    )
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
        forward = sweep % 2 == 0
        near, pairs = (before, layers) if forward else (after, layers[::-1])
        for fixed, layer in itertools.pairwise(pairs):
            at = {node: i for i, node in enumerate(fixed)}
            scale = len(fixed) / len(layer)
            wanted = {
                node: sum(at[other] for other in near[node]) / len(near[node])
                if near[node]
                else scale * i
                for i, node in enumerate(layer)
            }
            layer.sort(key=wanted.__getitem__)
    return layers


def _columns(nodes: Sequence[Node], layers: list[list[int]]) -> dict[int, float]:
    x: dict[int, float] = {}
    at, half = 0.0, 0.0
    for number, layer in enumerate(layers):
        own = max((label_width(nodes[i]) for i in layer if i < len(nodes)), default=0.1) / 2
        at += (half + own + (0.42 if len(layer) > 12 else 0.3)) if number else 0.0
        half = own
        x.update(dict.fromkeys(layer, at))
    return x


def _rows(nodes: Sequence[Node], layers: list[list[int]], paths: Arcs) -> dict[int, float]:
    """Rows by turns: every layer at the mean rows of its neighbours, at least its gaps apart."""
    near: dict[int, list[tuple[int, float]]] = {}
    for a, b in (pair for path in paths for pair in itertools.pairwise(path)):
        weight = (1.0, 2.0, STRAIGHT)[(a >= len(nodes)) + (b >= len(nodes))]
        near.setdefault(a, []).append((b, weight))
        near.setdefault(b, []).append((a, weight))
    offsets = []
    for layer in layers:
        rooms = [_room(nodes[i]) if i < len(nodes) else (0.1, 0.1) for i in layer]
        gaps = [below + above for (_, below), (above, _) in itertools.pairwise(rooms)]
        offsets.append(np.concatenate([[0.0], np.cumsum(gaps)]))
    y: dict[int, float] = {}
    for layer, offset in zip(layers, offsets, strict=True):
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


def _room(node: Node) -> tuple[float, float]:
    """Room above the middle of a node and below it."""
    if node.measures or (node.place and len(node.label) <= INSIDE):
        return RADIUS + 0.05, RADIUS + 0.05
    return (RADIUS + 0.05, 0.34) if node.place else (0.32, 0.17)
