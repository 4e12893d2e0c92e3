"""A measurement graph as text: Graphviz, Mermaid, and the assertions of the paper."""

from __future__ import annotations

import re

import numpy as np

from mtu_cli.files.graph_contract import Graph
from mtu_cli.model.graph.transitions import Values
from mtu_cli.reports.graph_drawing import COLOURS, Net, lay_out, share_percent

PIXELS = 96
"""A dot in an inch of the layout, for the paper's coordinates."""


BAR = "shape=box, style=filled, fillcolor=black, width=0.08, height=0.5, fixedsize=true"


def dot(net: Net) -> str:
    """Graphviz."""
    lines, keys = (
        [f"digraph {_quote(net.title)} {{", "  rankdir=LR;", "  node [fontsize=10];"],
        _keys(net),
    )
    for number, (key, node) in enumerate(zip(keys, net.nodes, strict=True)):
        if node.kind:
            share = net.shares.get(number)
            label = node.label + ("" if share is None else f"\\n{share_percent(share)} %")
            style = f'shape=circle, style=filled, fillcolor="{COLOURS[node.kind]}"'
            style += ", penwidth=2" if node.reported else ""
            lines.append(f"  {key} [label={_quote(label)}, {style}];")
        else:
            lines.append(f'  {key} [label="", xlabel={_quote(node.label)}, {BAR}];')
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


def assertions(net: Net, graph: Graph, nominal: Values) -> str:
    """The model data base of Stryczek, Table 1: p(n, x, y, kind, X, Y, Z), t(n, x, y, type),
    pt(p, t), tp(t, p), m(p).

    n counts places and transitions apart; x, y in pixels; the values are those at nominal (for a
    coordinate and a constant the first; of lines and planes the direction, of frames the origin).
    """
    spots = np.rint((lay_out(net).places + 0.5) * PIXELS).astype(int)
    lines, count = [f"% {_plain(net.title)}"], len(graph.places)
    for number, (node, (x, y)) in enumerate(zip(net.nodes, spots, strict=True), 1):
        if not node.kind:
            lines.append(f"t({number - count}, {x}, {y}, {node.label}).")
            continue
        kind = (
            graph.places[node.label].axis or "x" if node.kind == "coordinate" else _KIND[node.kind]
        )
        value = nominal[node.label][..., 0]
        row = value if value.ndim < 2 else value[0] if node.kind == "frame" else value[1]
        values = ", ".join(f"{item + 0.0:.9g}" for item in [*np.atleast_1d(row), 0.0, 0.0][:3])
        lines.append(f'p({number}, {x}, {y}, "{kind}", {values}). % {_plain(node.label)}')
    for a, b in net.arcs:
        arc = f"pt({a + 1}, {b - count + 1})" if a < count else f"tp({a - count + 1}, {b + 1})"
        lines.append(f"{arc}.")
    lines += [f"m({number})." for number, node in enumerate(net.nodes, 1) if node.marked]
    return "\n".join(lines) + "\n"
