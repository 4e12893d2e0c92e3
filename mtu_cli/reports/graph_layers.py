"""Which node stands in which layer, and in which order: few and short arcs, few crossings.

Layered drawing (Sugiyama, Tagawa & Toda, IEEE Trans. SMC 11 (1981) 109): arcs lead from left to
right; an arc over several layers is cut by bends; layers are ordered by the mean position of
neighbours, then by exchanges of neighbours.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left, bisect_right, insort
from collections.abc import Sequence
from dataclasses import dataclass

Arcs = Sequence[tuple[int, int]]
Neighbours = dict[int, list[int]]

SWEEPS = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class Layers:
    """`order`: the nodes of every layer from top to bottom, bends included (numbers from
    `first_bend` on). `paths`: for every arc its nodes from layer to layer.
    """

    order: list[list[int]]
    paths: list[list[int]]
    first_bend: int


def layered(count: int, arcs: Arcs) -> Layers:
    """Layers of `count` nodes; the arcs must have no cycle."""
    rank = _ranks(count, arcs)
    paths, bends = _cut(count, arcs, rank)
    segments = [pair for path in paths for pair in itertools.pairwise(path)]
    before: dict[int, list[int]] = {}
    after: dict[int, list[int]] = {}
    for a, b in segments:
        after.setdefault(a, []).append(b)
        before.setdefault(b, []).append(a)
    start = _first_order(count, arcs, rank, bends)
    bent = [sorted(layer, key=lambda node: node < count) for layer in start]
    found = [
        _improved(order, before, after)
        for first in (start, bent)
        for order in (first, [layer[::-1] for layer in first])
    ]
    best = min(found, key=lambda pair: pair[0])[1]
    return Layers(order=best, paths=paths, first_bend=count)


def _improved(
    start: list[list[int]], before: Neighbours, after: Neighbours
) -> tuple[int, list[list[int]]]:
    """The fewest crossings that sweeps to and fro come to from `start`, and the order."""
    order = [list(layer) for layer in start]
    best, fewest = start, _crossings(order, after)
    for sweep in range(SWEEPS):
        if not fewest:
            break
        forward = sweep % 2 == 0
        _sort_by_neighbours(order, before if forward else after, forward)
        _exchange(order, before, after)
        found = _crossings(order, after)
        if found < fewest:
            best, fewest = [list(layer) for layer in order], found
    return fewest, best


def _ranks(count: int, arcs: Arcs) -> list[int]:
    """Layers by longest path; then every node moves to where its arcs are shortest."""
    before: list[list[int]] = [[] for _ in range(count)]
    after: list[list[int]] = [[] for _ in range(count)]
    for a, b in arcs:
        after[a].append(b)
        before[b].append(a)
    rank = [0] * count
    waiting = [node for node in range(count) if not before[node]]
    missing = [len(items) for items in before]
    sorted_nodes = []
    while waiting:
        node = waiting.pop()
        sorted_nodes.append(node)
        for other in after[node]:
            rank[other] = max(rank[other], rank[node] + 1)
            missing[other] -= 1
            if not missing[other]:
                waiting.append(other)
    for _ in range(4):
        for node in reversed(sorted_nodes):
            if len(after[node]) > len(before[node]) or (after[node] and not before[node]):
                rank[node] = min(rank[other] for other in after[node]) - 1
            elif len(before[node]) == len(after[node]) == 1 and not before[before[node][0]]:
                # A measured place goes to where it is used, and its measurement with it.
                rank[node] = rank[after[node][0]] - 1
    least = min(rank, default=0)
    return [value - least for value in rank]


def _cut(count: int, arcs: Arcs, rank: list[int]) -> tuple[list[list[int]], dict[int, int]]:
    paths = []
    bends: dict[int, int] = {}
    for a, b in arcs:
        path = [a]
        for layer in range(rank[a] + 1, rank[b]):
            bends[count + len(bends)] = layer
            path.append(count + len(bends) - 1)
        paths.append([*path, b])
    return paths, bends


def _first_order(count: int, arcs: Arcs, rank: list[int], bends: dict[int, int]) -> list[list[int]]:
    """Nodes as they are met on the way back from the ends: what belongs together stands so."""
    before: list[list[int]] = [[] for _ in range(count)]
    ends = set(range(count))
    for a, b in arcs:
        before[b].append(a)
        ends.discard(a)
    order: list[list[int]] = [[] for _ in range(max(rank, default=0) + 1)]
    seen: set[int] = set()
    waiting = sorted(ends, reverse=True)
    while waiting:
        node = waiting.pop()
        if node not in seen:
            seen.add(node)
            order[rank[node]].append(node)
            waiting.extend(reversed(before[node]))
    for bend, layer in bends.items():
        order[layer].append(bend)
    return order


def _sort_by_neighbours(order: list[list[int]], neighbours: Neighbours, forward: bool) -> None:
    layers = range(1, len(order)) if forward else range(len(order) - 2, -1, -1)
    for layer in layers:
        near = order[layer - 1] if forward else order[layer + 1]
        at = {node: i for i, node in enumerate(near)}
        own = {node: i for i, node in enumerate(order[layer])}
        scale = max(len(near), 1) / max(len(own), 1)

        def wanted(
            node: int, at: dict[int, int] = at, own: dict[int, int] = own, scale: float = scale
        ) -> float:
            known = [at[other] for other in neighbours.get(node, []) if other in at]
            return sum(known) / len(known) if known else own[node] * scale

        order[layer].sort(key=wanted)


def _exchange(order: list[list[int]], before: Neighbours, after: Neighbours) -> None:
    """Neighbours change places while that takes crossings away."""
    for layer, nodes in enumerate(order):
        sides = [
            _places(nodes, neighbours, order[near])
            for neighbours, near in ((before, layer - 1), (after, layer + 1))
            if 0 <= near < len(order)
        ]
        better = True
        while better:
            better = False
            for i in range(len(nodes) - 1):
                a, b = nodes[i], nodes[i + 1]
                gain = sum(_pair(side[a], side[b]) - _pair(side[b], side[a]) for side in sides)
                if gain > 0:
                    nodes[i], nodes[i + 1] = b, a
                    better = True


def _places(nodes: list[int], neighbours: Neighbours, near: list[int]) -> Neighbours:
    """Where the neighbours of each node stand in the layer `near`, from top to bottom."""
    at = {node: i for i, node in enumerate(near)}
    return {node: sorted(at[other] for other in neighbours.get(node, [])) for node in nodes}


def _pair(above: list[int], below: list[int]) -> int:
    """Crossings between the arcs of a node and those of one below it, whose ends are sorted."""
    if len(above) <= len(below):
        return sum(bisect_left(below, end) for end in above)
    return sum(len(above) - bisect_right(above, end) for end in below)


def _crossings(order: list[list[int]], after: Neighbours) -> int:
    total = 0
    for layer in range(len(order) - 1):
        at = {node: i for i, node in enumerate(order[layer + 1])}
        ends = [sorted(at[other] for other in after.get(node, [])) for node in order[layer]]
        above: list[int] = []
        for end in (end for group in ends for end in group):
            total += len(above) - bisect_right(above, end)
            insort(above, end)
    return total
