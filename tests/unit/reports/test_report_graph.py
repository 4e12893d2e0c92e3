"""Reports and drawings of graphs: complete, and legible by measure."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from graph_examples import SHIPPED, graph_of, shipped

from mtu_cli.analyses.graph import shares_by_place, simulate_graph
from mtu_cli.findings import InputError
from mtu_cli.model.settings import Settings
from mtu_cli.reports import graph as report
from mtu_cli.reports import graph_drawing
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.graph_drawing import Net, drawing, net_of

OF = {
    "ball-centre": "P1.z",
    "rotary-axis-a": "PA.z",
    "rotary-axis-c": "PO.x",
    "axes-a-and-c": "d_AC",
    "bore-to-bore": "d",
    "work-coordinates": "Q.y",
}
NETS = [(path.stem, shares) for path in SHIPPED for shares in (False, True)]


def net(name: str, shares: bool) -> Net:
    graph, of = shipped(name), OF[name]
    return net_of(graph, of, shares_by_place(graph, of)) if shares else net_of(graph)


@pytest.mark.parametrize(("name", "shares"), NETS)
def test_labels_cross_neither_each_other_nor_an_arc(name: str, shares: bool) -> None:
    drawn = net(name, shares)
    figure = drawing(drawn)
    figure.canvas.draw()
    (panel,) = figure.axes
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]  # Agg has one
    boxes = [text.get_window_extent(renderer) for text in panel.texts if text.get_text()]
    page = figure.bbox
    for box in boxes:
        assert page.x0 <= box.x0 < box.x1 <= page.x1
        assert page.y0 <= box.y0 < box.y1 <= page.y1
    for a, b in itertools.combinations(boxes, 2):
        assert not a.overlaps(b)
    arcs = [item for item in panel.patches if type(item).__name__ == "FancyArrowPatch"]
    assert len(arcs) == len(drawn.arcs)
    for arc in arcs:
        path = panel.transData.transform_path(arc._path_original)  # type: ignore[attr-defined]  # in data units
        points = np.asarray(path.interpolated(1).to_polygons(closed_only=False)[0])
        x, y = points[2:-2].T
        for box, text in zip(boxes, panel.texts, strict=True):
            # The rim of a box is the room of the letters' ascents, not ink.
            inner = box.shrunk(0.98, 0.7)
            inside = (inner.x0 <= x) & (x <= inner.x1) & (inner.y0 <= y) & (y <= inner.y1)
            assert not inside.any(), text.get_text()


@pytest.mark.parametrize("name", list(OF))
def test_texts_hold_every_node_and_arc(name: str) -> None:
    graph = shipped(name)
    drawn, places = net_of(graph), graph.graph.places
    dot, mermaid = graph_drawing.dot(drawn), graph_drawing.mermaid(drawn)
    facts = graph_drawing.assertions(drawn, graph)
    assert dot.count(" -> ") == mermaid.count(" --> ") == len(drawn.arcs)
    for pattern, count in {
        r"(pt|tp)\(\d+, \d+\)\.$": len(drawn.arcs),
        r'p\(\d+, \d+, \d+, "[pvrlnfxyz]"(, -?[\d.e+-]+){3}\)\.': len(places),
        r"t\(\d+, \d+, \d+, [a-z_]+\)\.$": len(drawn.nodes) - len(places),
        r"m\(\d+\)\.$": sum(item.marked for item in places.values()),
    }.items():
        assert len(re.findall(f"^{pattern}", facts, re.M)) == count


def test_names_that_mean_something_to_other_programs(tmp_path: Path) -> None:
    text = """
places:
  'a"b': {kind: constant, value: 1, u: 1}
  's->t': {kind: constant}
transitions:
  - {do: ratio, in: ['a"b', 'a"b'], out: 's->t'}
"""
    graph = graph_of(tmp_path, text)
    drawn = net_of(graph)
    assert 'label="a\\"b' in graph_drawing.dot(drawn)
    assert 'p1(("a_b"))' in graph_drawing.mermaid(drawn)
    assert len(drawn.arcs) == 2
    assert figure_bytes(drawing(drawn), "svg").startswith(b"<?xml")


def test_report_of_a_simulation() -> None:
    result = simulate_graph(shipped("rotary-axis-a"), Settings(trials=20_000))
    made = report.simulate(result)
    results = made.record()
    assert set(results) == {"places", "trials", "converged", "budget"}
    assert list(results["places"]) == ["PA", "VA", "RA"]
    assert list(results["places"]["VA"]) == ["i", "j", "k"]
    one = results["places"]["RA"]["value"]
    assert one["unit"] == "mm"
    assert one["interval95"][0] < one["mean"] < one["interval95"][1]
    assert one["U"] == 2 * one["u"]
    assert results["places"]["VA"]["j"]["unit"] == "1"
    assert results["budget"]["VA"]["i"]["u1_axis"] is None
    header, rows = made.rows()
    assert all(len(row) == len(header) for row in rows)
    places = made.tables[0].sheet(2, detail=True)
    assert [row[0] for row in places.rows][:2] == ["PA.x", "PA.y"]
    unjudged = [item.validation is None for item in result.coordinates]
    assert [row[-1] == "-" for row in places.rows] == unjudged
    assert made.figure is not None
    assert figure_bytes(made.figure(), "png").startswith(b"\x89PNG")


def test_variances_of_lengths_and_directions_are_not_added() -> None:
    graph = shipped("work-coordinates")
    (frame,) = (name for name, item in graph.graph.places.items() if item.kind == "frame")
    with pytest.raises(InputError, match=rf"one of: {frame}\.x, .*{frame}\.rz"):
        shares_by_place(graph, frame)
    assert sum(shares_by_place(graph, f"{frame}.rz").values()) == pytest.approx(1)
