"""Reports and drawings of graphs: complete, and legible by measure."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from graph_examples import SHIPPED, graph_of, shipped

from mtu_cli.analyses.graph.simulate import simulate_graph
from mtu_cli.analyses.graph.sweep import sweep_graph
from mtu_cli.cli.graph_draw import net_for
from mtu_cli.model.settings import Settings
from mtu_cli.reports import graph_figure, graph_simulate, graph_sweep, graph_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.graph_drawing import drawing
from mtu_cli.reports.graph_layout import RADIUS, lay_out
from mtu_cli.reports.graph_net import Net, share_percent

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
    return net_for(shipped(name), OF[name] if shares else None)


def test_six_graphs_are_shipped() -> None:
    assert {path.stem for path in SHIPPED} == set(OF)


@pytest.mark.parametrize(("name", "shares"), NETS)
def test_labels_cross_neither_each_other_nor_an_arc(name: str, shares: bool) -> None:
    figure = drawing(net(name, shares))
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
    assert len(arcs) == len(net(name, shares).arcs)
    for arc in arcs:
        path = panel.transData.transform_path(arc._path_original)  # type: ignore[attr-defined]  # in data units
        points = np.asarray(path.interpolated(1).to_polygons(closed_only=False)[0])
        for box, text in zip(boxes, panel.texts, strict=True):
            # The rim of a box is the room of the letters' ascents, not ink.
            inner = box.shrunk(0.98, 0.7)
            assert not [p for p in points[2:-2] if inner.contains(*p)], text.get_text()


@pytest.mark.parametrize("name", list(OF))
def test_layout(name: str) -> None:
    """Arcs lead to the right, past all nodes; circles keep apart."""
    drawn = net(name, False)
    layout = lay_out(drawn)
    places = layout.places
    for (start, end), route in zip(drawn.arcs, layout.routes, strict=True):
        assert np.all(np.diff(route[:, 0]) > 0)
        assert route[0] == pytest.approx(places[start])
        assert route[-1] == pytest.approx(places[end])
        for bend in route[1:-1]:
            assert np.linalg.norm(places - bend, axis=1).min() > RADIUS + 0.02
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    assert apart[np.triu_indices(len(places), 1)].min() > 2 * RADIUS


def test_shares_come_to_one() -> None:
    for name in OF:
        assert sum(net(name, True).shares.values()) == pytest.approx(1)


@pytest.mark.parametrize("name", list(OF))
def test_texts_hold_every_node_and_arc(name: str) -> None:
    graph = shipped(name)
    drawn = net_for(graph)
    dot, mermaid = graph_text.dot(drawn), graph_text.mermaid(drawn)
    facts = graph_text.assertions(drawn, graph.graph, graph.nominal)
    assert dot.count(" -> ") == mermaid.count(" --> ") == len(drawn.arcs)
    assert len(re.findall(r"^(pt|tp)\(\d+, \d+\)\.$", facts, re.M)) == len(drawn.arcs)
    places = len(graph.graph.places)
    assert (
        len(re.findall(r'^p\(\d+, \d+, \d+, "[pvrlnfxyz]"(, -?[\d.e+-]+){3}\)\.', facts, re.M))
        == places
    )
    assert (
        len(re.findall(r"^t\(\d+, \d+, \d+, [a-z_]+\)\.$", facts, re.M))
        == len(drawn.nodes) - places
    )
    marked = [item for item in graph.graph.places.values() if item.marked]
    assert len(re.findall(r"^m\(\d+\)\.$", facts, re.M)) == len(marked)


def test_names_that_mean_something_to_other_programs(tmp_path: Path) -> None:
    text = """
places:
  'a"b': {kind: constant, value: 1, u: 1}
  's->t': {kind: constant}
transitions:
  - {do: ratio, in: ['a"b', 'a"b'], out: 's->t'}
"""
    graph = graph_of(tmp_path, text)
    drawn = net_for(graph)
    assert 'label="a\\"b' in graph_text.dot(drawn)
    assert 'p1(("a_b"))' in graph_text.mermaid(drawn)
    assert len(drawn.arcs) == 2
    assert figure_bytes(drawing(drawn), "svg").startswith(b"<?xml")


def test_report_of_a_simulation() -> None:
    result = simulate_graph(shipped("rotary-axis-a"), Settings(trials=20_000))
    results = graph_simulate.document(result, 2.0)
    assert set(results) == {"places", "trials", "converged", "budget"}
    assert list(results["places"]) == ["PA", "VA", "RA"]
    assert list(results["places"]["VA"]) == ["i", "j", "k"]
    one = results["places"]["RA"]["value"]
    assert one["unit"] == "mm"
    assert one["interval95"][0] < one["mean"] < one["interval95"][1]
    assert one["U"] == 2 * one["u"]
    assert results["places"]["VA"]["j"]["unit"] == "1"
    assert results["budget"]["VA"]["i"]["u1_axis"] is None
    header, rows = graph_simulate.csv_rows(result, 2.0)
    assert all(len(row) == len(header) for row in rows)
    (sheet,) = graph_simulate.table(result)
    assert [row[0] for row in sheet.rows][:2] == ["PA.x", "PA.y"]
    for verdict in {row[-1] for row in sheet.rows}:
        assert f" {verdict}: {graph_simulate.VERDICTS[verdict]}" in sheet.notes[1]
    assert figure_bytes(graph_figure.simulated(result), "png").startswith(b"\x89PNG")


def test_report_of_a_sweep() -> None:
    result = sweep_graph(
        shipped("ball-centre"),
        Settings(trials=1000),
        "P1.x",
        {"axis_um": [1.0, 2.0, 3.0], "probe_um": [1.0, 2.0]},
    )
    results = graph_sweep.document(result)
    assert [item["axis_um"] for item in results["grid"]] == [1, 1, 2, 2, 3, 3]
    assert set(results["formula"]) >= {"form", "coefficients", "max_error_percent"}
    assert results["formula"]["monte_carlo"]["standard_error_percent"] == pytest.approx(
        2.2, abs=0.2
    )
    header, rows = graph_sweep.csv_rows(result)
    assert all(len(row) == len(header) for row in rows)
    notes = graph_sweep.table(result)[0].notes
    assert "Monte Carlo's standard error is 2.2 %" in " ".join(notes)
    figure = graph_figure.swept(result)
    assert figure_bytes(figure, "svg").startswith(b"<?xml")
    (panel,) = figure.axes
    assert panel.get_ylim()[1] > 1.05e3 * max(item.u + 2 * item.se_u for item in result.grid)
    drawn = [np.asarray(item.get_ydata()) for item in panel.lines]
    curves = [item for item in drawn if len(item) > 100]
    assert len(curves) == 2
    ends = [[float(item[0]), float(item[-1])] for item in curves]
    assert ends == [
        pytest.approx([1e3 * result.grid[i].formula_u for i in (at, at + 4)]) for at in (0, 1)
    ]


@pytest.mark.parametrize("noise", [-1e-15, 0.0, 1e-15])
def test_halves_are_rounded_up_whatever_the_noise(noise: float) -> None:
    assert share_percent(0.0625 + noise) == "6.3"
    assert share_percent(0.125 + noise, 0) == "13"
    assert share_percent(0.0624) == "6.2"
