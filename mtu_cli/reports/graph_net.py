"""A measurement graph as nodes and arcs, for all that draws or writes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from mtu_cli.files.graph_contract import Graph
from mtu_cli.units import UM

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
