"""A measurement graph as text: Graphviz, Mermaid, and the assertions of the paper."""

from __future__ import annotations

import re

import numpy as np

from mtu_cli.files.graph_contract import Graph
from mtu_cli.model.graph.transitions import Values
from mtu_cli.reports.graph_drawing import COLOURS, Net, Node, lay_out, share_percent

PIXELS = 96
"""A dot in an inch of the layout, for the paper's coordinates."""


def dot(net: Net) -> str:
    """Graphviz."""
    lines = [f"digraph {_quoted(net.title)} {{", "  rankdir=LR;", "  node [fontsize=10];"]
    for number, node in enumerate(net.nodes):
        if node.place:
            share = net.shares.get(number)
            label = node.label + ("" if share is None else f"\\n{share_percent(share)} %")
            style = f'shape=circle, style=filled, fillcolor="{COLOURS[node.kind]}"'
            style += ", penwidth=2" if node.reported else ""
            lines.append(f"  {_key(number, net)} [label={_quoted(label)}, {style}];")
        else:
            look = (
                "shape=box, style=filled, fillcolor=black, width=0.08, height=0.5, fixedsize=true"
            )
            lines.append(f'  {_key(number, net)} [label="", xlabel={_quoted(node.label)}, {look}];')
    lines += [f"  {_key(a, net)} -> {_key(b, net)};" for a, b in net.arcs]
    return "\n".join([*lines, "}"]) + "\n"


def mermaid(net: Net) -> str:
    """Mermaid."""
    lines = ["---", f"title: {_plain(net.title)}", "---", "flowchart LR"]
    for number, node in enumerate(net.nodes):
        key, share = _key(number, net), net.shares.get(number)
        text = _plain(node.label) + ("" if share is None else f"<br>{share_percent(share)} %")
        shape = f'(("{text}")):::{node.kind}' if node.place else f'["{text}"]:::bar'
        lines.append(f"  {key}{shape}")
    lines += [f"  {_key(a, net)} --> {_key(b, net)}" for a, b in net.arcs]
    lines += [
        f"  classDef {kind} fill:{colour},stroke:#1b1f24,color:#1b1f24"
        for kind, colour in COLOURS.items()
        if any(node.kind == kind for node in net.nodes)
    ]
    return "\n".join([*lines, "  classDef bar fill:#1b1f24,stroke:#1b1f24,color:#ffffff"]) + "\n"


def _key(number: int, net: Net) -> str:
    places = sum(node.place for node in net.nodes)
    return f"p{number + 1}" if number < places else f"t{number - places + 1}"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '\\"') + '"'


def _plain(text: str) -> str:
    """Text in which nothing has a meaning of its own."""
    return re.sub(r'["#;:<>{}\[\]|`]', "_", text)


_KIND = {"point": "p", "vector": "v", "constant": "r", "line": "l", "plane": "n", "frame": "f"}


def assertions(net: Net, graph: Graph, nominal: Values) -> str:
    """The model data base of Stryczek, Table 1: p(n, x, y, kind, X, Y, Z), t(n, x, y, type),
    pt(p, t), tp(t, p), m(p).

    n counts places and transitions apart; x, y in pixels; the values are those at nominal (for a
    coordinate and a constant the first; of lines and planes the direction, of frames the origin).
    """
    layout = lay_out(net)
    spots = np.rint((layout.places + 0.5) * PIXELS).astype(int)
    count = len(graph.places)
    lines = [f"% {_plain(net.title)}"]
    for number, (node, (x, y)) in enumerate(zip(net.nodes, spots, strict=True)):
        if node.place:
            place = graph.places[node.label]
            kind = place.axis or "x" if place.kind == "coordinate" else _KIND[place.kind]
            values = ", ".join(f"{value:.9g}" for value in _triple(node, nominal))
            lines.append(f'p({number + 1}, {x}, {y}, "{kind}", {values}). % {_plain(node.label)}')
        else:
            lines.append(f"t({number - count + 1}, {x}, {y}, {node.label}).")
    for a, b in net.arcs:
        if a < count:
            lines.append(f"pt({a + 1}, {b - count + 1}).")
        else:
            lines.append(f"tp({a - count + 1}, {b + 1}).")
    lines += [f"m({number + 1})." for number, node in enumerate(net.nodes) if node.marked]
    return "\n".join(lines) + "\n"


def _triple(node: Node, nominal: Values) -> list[float]:
    value = nominal[node.label][..., 0]
    if value.ndim == 0:
        return [float(value), 0.0, 0.0]
    row = value if value.ndim == 1 else value[0] if node.kind == "frame" else value[1]
    return [float(item) + 0.0 for item in row]
