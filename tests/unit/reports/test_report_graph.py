"""Reports and drawings of graphs: complete, and legible by measure."""

from __future__ import annotations

import itertools
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graph_examples import SHIPPED, graph_of, shipped

from mtu_cli.analyses.graph.simulate import simulate_graph
from mtu_cli.analyses.graph.sweep import Sweep, sweep_graph
from mtu_cli.cli.measurement import net_for
from mtu_cli.findings import InputError
from mtu_cli.model.graph.net import load_graph
from mtu_cli.model.settings import Settings
from mtu_cli.reports import graph as report
from mtu_cli.reports import graph_text, monte_carlo_figures
from mtu_cli.reports.document import Document
from mtu_cli.reports.figures import figure_bytes, house_style
from mtu_cli.reports.graph_drawing import RADIUS, Net, Node, drawing, lay_out, share_percent

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


@pytest.mark.parametrize(("name", "marked"), [("bore-to-bore", False), ("ball-centre", True)])
def test_only_what_is_drawn_is_explained_below(name: str, marked: bool) -> None:
    drawn = net(name, False)
    assert any(node.marked for node in drawn.nodes) == marked
    told = [text.get_text() for text in drawing(drawn).legends[0].get_texts()]
    assert ("marker" in told) == marked
    assert {"transition", "reported"} <= set(told)
    unread = replace(drawn, nodes=tuple(replace(node, reported=False) for node in drawn.nodes))
    assert "reported" not in [text.get_text() for text in drawing(unread).legends[0].get_texts()]


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


def test_shares_of_every_shipped_graph_come_to_one() -> None:
    assert {path.stem for path in SHIPPED} == set(OF)
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


def test_long_names_end_on_the_paper(tmp_path: Path) -> None:
    """Those at both ends of the net too, bold where they are reported."""
    first, last = "the_left_edge_of_the_housing", "the_width_of_the_housing_at_the_top"
    text = (
        f"places:\n  {first}: {{kind: constant, value: 1, unit: mm}}\n"
        f"  {last}: {{kind: constant}}\ntransitions:\n"
        f"  - {{do: compute, in: [{first}], out: {last}, formula: 2*{first}}}\n"
    )
    page = drawing(replace(net_for(graph_of(tmp_path, text)), title="long " * 40))
    with house_style():
        page.draw_without_rendering()
    texts = [item for item in page.axes[0].texts if item.get_text()]
    assert {first, last} <= {item.get_text() for item in texts}
    for item in texts:
        box = item.get_window_extent()
        assert page.bbox.x0 <= box.x0
        assert box.x1 <= page.bbox.x1


def test_report_of_a_check() -> None:
    result = shipped("bore-to-bore")
    made = report.check(result, lambda: None)
    results, (header, rows) = made.record(), made.rows()
    order = [step for fired in results["firing_order"] for step in fired]
    assert len(order) == results["transitions"] == len(list(rows))
    assert header == ["round", "do", "in", "out"]
    assert sum(results["places"].values()) == len(shipped("bore-to-bore").graph.places)
    sheet = made.tables[0].sheet(2, detail=False)
    assert [row[0] for row in sheet.rows] == [str(i + 1) for i in range(len(result.rounds))]
    assert made.verdict.startswith("The graph is sound: ")


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
    assert figure_bytes(made.figure(), "png").startswith(b"\x89PNG")


def swept(result: Sweep) -> Document:
    """The report of a sweep of the ball's centre."""
    base = simulate_graph(shipped("ball-centre"), Settings(trials=100), ["P1.x"])
    return report.sweep(base, result)


def errors(result: Sweep) -> list[str]:
    """The column of the formula's errors."""
    sheet = swept(result).tables[0].sheet(2, detail=False)
    return [row[-2] for row in sheet.rows]


def test_report_of_a_sweep() -> None:
    result = sweep_graph(
        shipped("ball-centre"),
        Settings(trials=1000),
        "P1.x",
        {"axis_um": [1.0, 2.0, 3.0], "probe_um": [1.0, 2.0]},
    )
    made = swept(result)
    results = made.record()
    assert [item["axis_um"] for item in results["grid"]] == [1, 1, 2, 2, 3, 3]
    assert set(results["formula"]) >= {"form", "coefficients", "max_error_percent"}
    assert results["formula"]["monte_carlo"]["standard_error_percent"] == pytest.approx(
        2.2, abs=0.2
    )
    assert set(results) >= {"places", "budget", "of", "converged"}
    header, rows = made.rows()
    assert all(len(row) == len(header) for row in rows)
    assert re.search("differ by [1-9] % at most", made.verdict)
    notes = " ".join(made.tables[0].notes)
    assert "standard error of each u: 2 %; by chance alone the largest of 6" in notes
    # Digits below what u is known to are noise; of an exact one rounding leaves no error, and an
    # error that is one is shown.
    near = tuple(replace(item, error_percent=-0.36) for item in result.grid)
    assert set(errors(replace(result, grid=near))) == {"0"}
    assert result.formula is not None
    exact = replace(result, formula=replace(result.formula, monte_carlo_percent=1e-13))
    assert "knows each u" not in " ".join(swept(exact).tables[0].notes)
    noisy = [replace(item, error_percent=5.9e-13) for item in result.grid[:1]]
    noisy += [replace(item, error_percent=5.9e-5) for item in result.grid[1:2]]
    assert errors(replace(exact, grid=(*noisy, *result.grid[2:])))[:2] == ["0", "5.9e-5"]
    figure = monte_carlo_figures.swept(result)
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
    known = panel.get_legend()
    assert known is not None
    assert known.get_title().get_text() == ""
    assert figure.get_suptitle() == "Uncertainty of P1.x over axis_um"
    chances = tuple(replace(item, chance=True) for item in result.grid)
    chance = replace(result, grid=chances, formula=None)
    assert monte_carlo_figures.swept(chance).get_suptitle() == "Chance that P1.x is 1 over axis_um"


def test_a_legend_of_many_lines_stands_beside_them() -> None:
    """It covers nothing, and names the first, the last and some between."""
    result = sweep_graph(shipped("ball-centre"), Settings(trials=100), "P1.x", {"axis_um": [1.0]})
    (one,) = result.grid
    many = [1.0 + 0.1 * i for i in range(25)]
    grid = tuple(replace(one, at={"axis_um": a, "probe_um": b}) for a in (1.0, 2.0) for b in many)
    varied = {"axis_um": (1.0, 2.0), "probe_um": tuple(many)}
    page = monte_carlo_figures.swept(replace(result, grid=grid, varied=varied, formula=None))
    with house_style():
        page.draw_without_rendering()
    (panel,) = page.axes
    legend = panel.get_legend()
    assert legend is not None
    names = [text.get_text() for text in legend.get_texts()]
    assert legend.get_title().get_text() == f"{len(names)} of 25 lines"
    assert (names[0], names[-1]) == ("probe_um 3.4", "probe_um 1")
    box = legend.get_window_extent()
    assert not box.overlaps(panel.get_window_extent())
    assert page.bbox.y0 <= box.y0 <= box.y1 <= page.bbox.y1
    assert box.x1 <= page.bbox.x1


@pytest.mark.parametrize("noise", [-1e-15, 0.0, 1e-15])
def test_shares_are_rounded_half_up_without_a_sign_of_nothing(noise: float) -> None:
    assert share_percent(0.0625 + noise) == "6.3"
    assert share_percent(0.125 + noise, 0) == "13"
    assert share_percent(0.0624) == "6.2"
    assert share_percent(-1e-5) == "0.0"
    assert share_percent(-1e-3) == "-0.1"
    assert share_percent(-1e-3, 0) == "0"


def test_dollar_signs_are_no_formula(tmp_path: Path) -> None:
    """Names and titles with two of them, and a backslash between, are drawn sign by sign."""
    path = tmp_path / "graph.yaml"
    path.write_text(DOLLARS, "utf-8")
    graph = load_graph(path)
    (y,) = (name for name in graph.graph.places if name.startswith("y"))
    figure = drawing(net_for(graph, y))
    assert figure_bytes(figure, "svg").startswith(b"<?xml")
    result = simulate_graph(graph, Settings(trials=1000))
    histogram = monte_carlo_figures.simulated(result)
    assert figure_bytes(histogram, "png").startswith(b"\x89PNG")
    for text in (*figure.axes[0].texts, histogram.axes[0].title, histogram.axes[0].xaxis.label):
        # What Matplotlib draws, and whether it takes it for a formula.
        said = text.get_text()
        assert text._preprocess_math(said) == (said, False)  # type: ignore[attr-defined]


DOLLARS = r"""
schema: mtu/graph/1
name: 'a $\frac{ b$'
places:
  'x$\q$': {kind: constant, value: 1, u: 0.1}
  'y$_{$': {kind: constant}
transitions:
  - {do: ratio, in: ['x$\q$', 'x$\q$'], out: 'y$_{$'}
"""


@pytest.mark.parametrize("of", [["P1"], ["VA.i", "VA.j"]])
def test_every_line_of_the_histograms_is_in_their_legend(of: list[str]) -> None:
    """Also where the first of them has no first order."""
    graph = shipped("ball-centre" if of == ["P1"] else "rotary-axis-a")
    result = simulate_graph(graph, Settings(trials=1000), of)
    (legend,) = monte_carlo_figures.simulated(result).legends
    named = [item.get_text() for item in legend.get_texts()]
    assert len(named) == len(set(named))
    assert set(named) == {
        "Monte Carlo trials",
        "first order",
        "95 %, first order",
        "95 %, Monte Carlo",
    }


@pytest.mark.parametrize("size", [1.0, 1e8])
def test_a_nominal_that_is_the_rounding_of_nothing_reads_0(size: float, tmp_path: Path) -> None:
    """x (0.1 + 0.2) - 0.3 x is 5.6e-17 x and no more."""
    text = f"""
places:
  x: {{kind: constant, value: {size}, u: 0.001}}
  y: {{kind: constant}}
  z: {{kind: constant}}
transitions:
  - {{do: compute, in: [x], out: y, formula: x*(0.1 + 0.2) - 0.3*x}}
  - {{do: compute, in: [x], out: z, formula: x - {size} + 1e-5}}
"""
    result = simulate_graph(graph_of(tmp_path, text), Settings(trials=1000))
    sheet = report.simulate(result).tables[0].sheet(2, detail=False)
    shown = {row[0]: row[1] for row in sheet.rows}
    assert shown["y"] == "0 mm"
    assert float(shown["z"].removesuffix(" mm")) == pytest.approx(1e-5, abs=size * 1.2e-16)


def test_variances_of_lengths_and_directions_are_not_added() -> None:
    graph = shipped("work-coordinates")
    (frame,) = (name for name, item in graph.graph.places.items() if item.kind == "frame")
    with pytest.raises(InputError, match=rf"one of: {frame}\.x, .*{frame}\.rz"):
        net_for(graph, frame)
    assert sum(net_for(graph, f"{frame}.rz").shares.values()) == pytest.approx(1)


def test_a_wide_net_is_laid_out_in_seconds() -> None:
    """A sum of 1500 probings: pairs of arcs are 1e6, and were counted one by one."""
    count = 1500
    places = [Node(label=f"x{i}", kind="coordinate") for i in range(count)]
    total = Node(label="s", kind="constant")
    bars = [Node(label="meas")] * count
    last = Node(label="compute")
    arcs = [(count + 1 + i, i) for i in range(count)]
    arcs += [(i, 2 * count + 1) for i in range(count)] + [(2 * count + 1, count)]
    wide = Net(title="wide", nodes=(*places, total, *bars, last), arcs=tuple(arcs))
    start = time.process_time()
    layout = lay_out(wide)
    assert len(layout.routes) == len(arcs)
    # It takes 1 s, and 11 s where every pair is counted by itself.
    assert time.process_time() - start < 8
