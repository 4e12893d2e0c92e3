"""Cycles of the net of a graph file."""

from __future__ import annotations

Arcs = list[tuple[int, list[str], list[str]]]
"""Index, inputs and outputs of every transition."""


def cycles(arcs: Arcs) -> list[list[str]]:
    """Cycles from place to place, one for every knot of them, each from its first place back."""
    after: dict[str, list[str]] = {}
    for _, inputs, outputs in arcs:
        for name in inputs:
            after.setdefault(name, []).extend(outputs)
    found: list[list[str]] = []
    done: set[str] = set()
    for start in after:
        trail: list[str] = []
        waiting = [(start, False)]
        while waiting:
            name, leaving = waiting.pop()
            if leaving:
                trail.pop()
                done.add(name)
            elif name in trail:
                cycle = trail[trail.index(name) :]
                if not any(set(cycle) & set(known) for known in found):
                    found.append([*cycle, name])
            elif name not in done:
                trail.append(name)
                waiting.append((name, True))
                waiting.extend((item, False) for item in reversed(after.get(name, [])))
    return found
