"""Reports of predictions, graphs, budgets, drift and the loop."""

import itertools
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from budget_examples import evaluated
from graph_examples import SHIPPED, graph_of, shipped
from loop_examples import (
    BACKLASH,
    CLASS,
    CYCLIC,
    SCATTER,
    SMOOTH,
    effect,
    on_table,
    parameter,
    result,
)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from report_examples import Example, example
from support import CONFIGS

from mtu_cli.analyses.budget import BudgetResult
from mtu_cli.analyses.close_loop.result import Crossing, FoundEffect
from mtu_cli.analyses.graph import shares_by_place, simulate_graph
from mtu_cli.analyses.thermal_fit import ThermalFit
from mtu_cli.cli.analyse import fitted_drift
from mtu_cli.cli.load import Inputs
from mtu_cli.cli.options import Options
from mtu_cli.files.machine import load_machine
from mtu_cli.files.part import Tolerance
from mtu_cli.files.reports_read import ThermalReport, read_report
from mtu_cli.files.source import report_bytes
from mtu_cli.findings import InputError
from mtu_cli.model.fit import thermal_from_report
from mtu_cli.model.measurands import Conformance
from mtu_cli.model.settings import Settings
from mtu_cli.reports import graph as report
from mtu_cli.reports import graph_drawing, predictions
from mtu_cli.reports.budget import document, figure
from mtu_cli.reports.close_loop import document as loop_document
from mtu_cli.reports.close_loop import effect_text, verdict_text
from mtu_cli.reports.document import Document, plain_text
from mtu_cli.reports.fields import csv_text
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.graph_drawing import Net, drawing, net_of
from mtu_cli.reports.thermal_fit import document as drift_document
from mtu_cli.reports.thermal_fit import figure as drift_figure

pytestmark = pytest.mark.usefixtures("styled")


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Example:
    return example(tmp_path_factory.mktemp("paper"))


@pytest.fixture(scope="module")
def spatial(tmp_path_factory: pytest.TempPathFactory) -> Example:
    """With an equation for z and a component from the machine file."""
    return example(
        tmp_path_factory.mktemp("spatial"),
        passes=3,
        stated="  ez0: {of: y, unit: um, coefficients: [3.0, -0.05], u_future: 1.9}",
        equation="  Ez: ez0 + x*ex_y\n",
    )


def documents(given: Example) -> list[Document]:
    return [
        predictions.points(given.points()),
        predictions.lengths(given.lengths()),
        predictions.orthogonality(given.angles()),
    ]


def test_points_hold_the_contract_fields(paper: Example) -> None:
    result = paper.points()
    found = predictions.points(result).record()
    assert "covariance_um2" not in found
    assert len(found["points"]) == 24
    for i, point in enumerate(found["points"]):
        assert point["Ex_um"] == pytest.approx(result.prediction.mean[2 * i] * 1e3, rel=1e-12)
        assert point["var_y_um2"] == pytest.approx(result.variance[2 * i + 1] * 1e6, rel=1e-12)
        assert point["U_x_um"] == pytest.approx(2 * point["u_x_um"], rel=1e-12)
        assert point["u_x_um"] ** 2 == pytest.approx(point["var_x_um2"], rel=1e-12)
        low, high = point["interval95_x_um"]
        assert (low + high) / 2 == pytest.approx(point["Ex_um"], abs=1e-9)
        assert sum(point["shares"]["x"].values()) == pytest.approx(1, rel=1e-9)
        apart = point["independent"]
        assert apart["u_y_um"] == pytest.approx(np.sqrt(apart["var_y_um2"]), rel=1e-12)
        assert point["z_mm"] == 127.0


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("detail", [True, False])
def test_tables_fit_and_round_to_the_uncertainty(
    paper: Example, spatial: Example, planar: bool, detail: bool
) -> None:
    given = paper if planar else spatial
    points = given.points()
    ids = tuple("hole_number_" * 4 + str(i) for i in range(24))
    long = replace(points, prediction=replace(points.prediction, ids=ids))
    made = [*documents(given), predictions.points(long)]
    texts = [plain_text(each.blocks(detail=detail)) for each in made]
    for text in texts:
        assert max(map(len, text.splitlines())) <= 100
    row = next(x for x in texts[1].splitlines() if x.startswith("3-15"))
    error, u = row.split()[2:4]
    known = given.lengths()
    assert float(u) == pytest.approx(np.sqrt(known.variance[2]) * 1e3, rel=0.05)
    assert float(error) == pytest.approx(known.error[2] * 1e3, abs=0.05)
    assert len(error.partition(".")[2]) == len(u.partition(".")[2])


def test_the_verdict_states_the_least_conformance(paper: Example) -> None:
    points, angles = paper.points(), paper.angles()
    zone = Tolerance(low=0, high=50)
    sure, less = (Conformance(tolerance=zone, probability=p, se=0.002) for p in (0.99, 0.9))
    none: list[Conformance | None] = [None] * 24
    stated = replace(points, conformance=(*none[3:], sure, less, less))
    last = ", ".join(points.prediction.ids[-2:])
    text = f"The least probability of conformance is 90.0 ± 0.2 %, of {last}."
    assert predictions.points(stated).verdict.endswith(text)
    assert "conformance" not in predictions.points(points).verdict
    allowed = Conformance(tolerance=Tolerance(low=-9, high=9), probability=0.9)
    angle = replace(angles.angles[0], conformance=allowed)
    verdict = predictions.orthogonality(replace(angles, angles=(angle,))).verdict
    assert verdict.endswith(f"is 90.0 %, of {angle.id}.")


# Reports and drawings of graphs: complete, and legible by measure.


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
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    (panel,) = figure.axes
    renderer = canvas.get_renderer()
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
    assert figure_bytes(lambda: drawing(drawn), "svg").startswith(b"<?xml")


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
    assert figure_bytes(made.figure, "png").startswith(b"\x89PNG")


def test_variances_of_lengths_and_directions_are_not_added() -> None:
    graph = shipped("work-coordinates")
    (frame,) = (name for name, item in graph.graph.places.items() if item.kind == "frame")
    with pytest.raises(InputError, match=rf"one of: {frame}\.x, .*{frame}\.rz"):
        shares_by_place(graph, frame)
    assert sum(shares_by_place(graph, f"{frame}.rz").values()) == pytest.approx(1)


# The report, table, CSV and figure of a budget say what the result holds.


CSV_COLUMNS = "output,name,unit,value,u,type,distribution,dof,sensitivity,contribution,share"


def shown(result: BudgetResult, *, detail: bool = False) -> str:
    return plain_text(document(result).blocks(detail=detail))


ONE = """
    quantity: {name: l, unit: mm}
    equation: a*b + c
    inputs:
      a: {value: 2, u: 0.1, dof: 8, unit: mm}
      b: {value: 3, half_width: 0.2, distribution: rectangular}
      c: {readings: [1.0, 1.2, 1.1, 1.3], u: 0.05, unit: mm}
      d: 7
"""
TWO = ONE.replace("quantity: {name: l, unit: mm}", "units: {s: mm}").replace(
    "equation: a*b + c", "equations: {s: a*b + c, p: a/b}"
)


@pytest.fixture(scope="module")
def one() -> BudgetResult:
    return evaluated(ONE)


@pytest.fixture(scope="module")
def two() -> BudgetResult:
    return evaluated(TWO)


def test_figures_of_a_budget(one: BudgetResult) -> None:
    found = json.loads(report_bytes(document(one).record()))
    assert found["value"] == pytest.approx(7.15)
    assert found["U"] == pytest.approx(found["k"] * found["u"])
    rows = {row["name"]: row for row in found["rows"]}
    assert rows["a"]["contribution"] == pytest.approx(0.3)
    assert rows["b"]["dof"] is None
    assert rows["c"]["type"] == "A+B"
    assert [part["type"] for part in rows["c"]["contributions"]] == ["A", "B"]
    assert rows["d"]["u"] == rows["d"]["contribution"] == 0.0
    assert sum(row["share"] for row in found["rows"]) == pytest.approx(1.0)
    squares = sum(row["contribution"] ** 2 for row in found["rows"])
    assert math.sqrt(squares) == pytest.approx(found["u"])


def test_several_outputs(two: BudgetResult) -> None:
    found = json.loads(report_bytes(document(two).record()))
    assert set(found["outputs"]) == {"s", "p"}
    assert found["outputs"]["s"]["unit"] == "mm"
    lines = csv_text(*document(two).rows()).splitlines()
    assert lines[0] == CSV_COLUMNS
    assert len(lines) == 1 + 2 * 4
    assert lines[1].startswith("s,a,mm,2.0,0.1,B,normal,8.0,")
    assert ",inf," in lines[2]
    V = np.array(found["covariance"])
    assert V[0, 0] == pytest.approx(found["outputs"]["s"]["u"] ** 2)
    r = np.array(found["correlation"])
    assert r[0, 1] == pytest.approx(V[0, 1] / math.sqrt(V[0, 0] * V[1, 1]))
    # By hand: u^2(a) - (a/b)^2 u^2(b), to first order.
    assert V[0, 1] == pytest.approx(0.01 - 4 / 9 * 0.04 / 3)


@pytest.mark.parametrize(
    "text",
    [
        ONE,
        TWO,
        "equation: abs(x)\ninputs: {x: {value: 0, u: 1}}\n",
        "equation: x\ninputs: {x: {value: 1, u: 1, dof: 1}}\n",
        "equation: " + "+".join(f"x{i}" for i in range(20)) + "\ninputs:\n"
        + "".join(f"  x{i}: {{value: 0, u: {i + 1}}}\n" for i in range(20)),
    ],
)  # fmt: skip
def test_figures_are_drawn(text: str) -> None:
    """Also without first order, with heavy tails, nothing uncertain or many inputs."""
    result = evaluated(text)
    page = figure(result)
    assert len(page.axes) == 2 * len(result.outputs)
    assert figure_bytes(lambda: page, ".png").startswith(b"\x89PNG")


def test_the_factor_of_the_interval_stands_beside_a_stated_one() -> None:
    """U is k u with the 2 asked for, the 95.45 % interval takes t of 4 degrees of freedom, 2.87.

    JCGM 100:2008, table G.2: 2.87 for 4 degrees of freedom and 95.45 %.
    """
    text = "equation: x\ninputs: {x: {value: 0, u: 1, dof: 4}}\ncoverage: {k: 2}\n"
    lines = " ".join(shown(evaluated(text)).split())
    assert "y = 0.0 ± 2.0 (k = 2.00)" in lines
    assert (
        "95.45 %; of first order: value ± k u with the k for 95.45 %, k = 2.87 (t of 4 dof)"
        in lines
    )
    normal = evaluated(text.replace(", dof: 4", ""))
    assert "95.45 %, k = 2.00 (normal)" in " ".join(shown(normal).split())


def test_correlations_of_inputs_are_reported_and_a_footer_explains_no_missing_column() -> None:
    text = "equation: a*b\ninputs: {a: {value: 2, u: 1}, b: {value: 3, u: 1}, c: 7}\n"
    found = document(evaluated(text + "correlations: [[a, b, 0.5]]\n"))
    assert found.record()["input_correlation"]["inputs"] == ["a", "b", "c"]
    matrix = np.array(found.record()["input_correlation"]["matrix"])
    np.testing.assert_allclose(matrix[:2, :2], [[1.0, 0.5], [0.5, 1.0]])
    assert "share" in plain_text(found.blocks())
    assert "share" not in shown(evaluated(text.replace("u: 1", "u: 0")))


# The report and picture of thermal-fit: names and units, nulls, the whole model, legibility.


STUDY = CONFIGS / "valdes-ring"


@pytest.fixture(scope="module")
def fit() -> ThermalFit:
    """Of the shipped drift test: a length by degree 3 through four positions, two of degree 0."""
    inputs = Inputs(Options("thermal-fit", {"study": STUDY}))
    return fitted_drift(inputs, "ridge")


def written(fit: ThermalFit) -> dict[str, Any]:
    """The components of the report as a reader of the file finds them."""
    found: dict[str, Any] = json.loads(json.dumps(drift_document(fit).record(), allow_nan=False))
    return dict(found["components"])


def test_names_and_units(fit: ThermalFit) -> None:
    found = written(fit)
    for name, unit, other, size in (
        ("pos_y", "um", "arcsec", 1e-3),
        ("yaw_y", "arcsec", "um", np.pi / 648000),
    ):
        entry, known = found[name], fit.components[name]
        assert f"_{other}" not in json.dumps(entry)
        held, expected, at = entry["held_out"], known.held_out, known.gradients[0]
        assert expected is not None
        assert (held["by"], entry["gradients"][0]["sensors"]) == ("cycle", list(at.sensors))
        pairs = {
            entry[f"rms_after_{unit}"]: known.rms_after,
            held[f"rms_before_{unit}"]: expected.before,
            held[f"rms_after_{unit}"]: expected.after,
            entry["gradients"][0][f"gradient_{unit}_per_degC"]: at.value,
        }
        assert list(pairs) == pytest.approx([value / size for value in pairs.values()])


def test_report_holds_the_whole_model(fit: ThermalFit, tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    path.write_text(
        json.dumps({"schema": "mtu/thermal-fit/1", "results": drift_document(fit).record()})
    )
    report = read_report(path)
    assert isinstance(report, ThermalReport)
    back = thermal_from_report(load_machine(STUDY / "machine.yaml"), report)
    place = np.array([0.0, 40.0, 310.0])
    for name, item in fit.components.items():
        again, known = back[name], item.estimate
        T = {
            each: 20 + np.array([1.0, -2.0, 6.0]) * (s + 1) for s, each in enumerate(known.sensors)
        }
        np.testing.assert_allclose(again.drift(place, T), known.drift(place, T), rtol=1e-9)
        for key in ("covariance", "leftover", "time_constants", "sensor_u", "temperature_range"):
            np.testing.assert_allclose(getattr(again, key), getattr(known, key), rtol=1e-12)
        for key in ("coefficient_dof", "leftover_dof", "of", "reference"):
            assert getattr(again, key) == getattr(known, key)


def test_curves_lie_side_by_side_and_show_the_readings(fit: ThermalFit) -> None:
    found = fit.components["pos_y"]
    panel = drift_figure(replace(fit, components={"pos_y": found})).axes[0]
    lines = [line for line in panel.lines if len(np.asarray(line.get_xdata())) > 2]
    curves = sorted(found.curves, key=lambda curve: found.cycles.index(curve.cycle))
    for curve, measured, modelled in zip(curves, lines[::2], lines[1::2], strict=True):
        np.testing.assert_allclose(np.asarray(measured.get_ydata()), curve.measured * 1e3)
        np.testing.assert_allclose(np.asarray(modelled.get_ydata()), curve.modelled * 1e3)
        assert measured.get_color() == modelled.get_color()
    starts = [np.asarray(line.get_xdata())[0] for line in lines]
    assert starts == sorted(starts)
    assert (len(lines), len({*starts})) == (32, 4)
    assert lines[0].get_color() != lines[2].get_color()


def test_details_have_the_gradient_of_every_sensor_at_every_position(fit: ThermalFit) -> None:
    (table,) = (each for each in drift_document(fit).tables if "Gradients" in each.title)
    known = [each for item in fit.components.values() for each in item.gradients]
    sheet = table.sheet(2, detail=True)
    assert len(sheet.rows) == len(known) > 100
    heads = [column.title for column in sheet.columns]
    values = [row[heads.index("gradient\nper degC")] for row in sheet.rows]
    assert all("±" in value for value in values)
    assert "Gradients" not in plain_text(drift_document(fit).blocks())


# The report of close-loop: its sentence, its fields, its tables and its picture.


EXAMPLES = {
    "named": result(on_table(BACKLASH, CYCLIC)),
    "class": result(on_table(CLASS, verdict="class")),
    "smooth": result(on_table(SMOOTH)),
    "unexplained": result(on_table(SCATTER, verdict="unexplained")),
    "none": result(on_table(verdict="none")),
    "several": result(on_table(BACKLASH, component="dx_x"), on_table(SMOOTH, component="ez_x")),
}


HEADER = ["component", "candidate", "family", "p_familywise", "log_bayes_factor", "posterior",
          "minimum_detectable_um", "found", "in_class", "unavailable", "notes"]  # fmt: skip


@pytest.mark.parametrize(
    ("found", "component", "said"),
    [
        (CYCLIC, None, "Y has a periodic error of 5.00 ± 0.20 um amplitude, pitch 12.50 mm"),
        (BACKLASH, "dx_x", "dx_x loses 8.20 ± 0.30 um at reversal"),
        (SMOOTH, None, "a smooth error of x along x: rms 2.50 ± 0.30 um"),
        (SCATTER, None, "one operation scatters more (milled): 2.5 times the rest"),
        (effect("squareness-xy", parameter("angle", "arcsec", 11.4, 1.8)),
         None,
         "X and Y are out of square by 11.4 ± 1.8 arcsec, more than 90 degrees"),
        (effect("mine-x", parameter("a", "um", 1, 0.1), parameter("b", "um/m", 2, 0.1)),
         None,
         "what mine does: a 1.00 ± 0.10 um, b 2.00 ± 0.10 um/m"),
    ],
)  # fmt: skip
def test_an_effect_in_words(found: FoundEffect, component: str | None, said: str) -> None:
    item = on_table(found, component=component)
    assert effect_text(item.effects[0], item) == said


def test_what_is_left_what_separates_and_what_cancels_is_said() -> None:
    left = verdict_text(on_table(SCATTER, verdict="unexplained"), 0.05)
    assert "parts follow one another too smoothly to be scatter (walk, p 0.002)" in left
    assert "no equation corrects that" in left
    assert "turn the part (then 6.3 standard deviations apart)" in verdict_text(
        on_table(CLASS, verdict="class"), 0.05
    )
    zero = Crossing(axis="x", covariate="T_a_degC", value=22.2, u=0.8, interval95=(20.6, 23.8))
    assert "X is right at T_a_degC = 22.20 ± 0.80 degC." in verdict_text(
        on_table(BACKLASH, crossings=(zero,)), 0.05
    )


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_report_is_json_fits_100_columns_and_has_a_picture(name: str) -> None:
    found = loop_document(EXAMPLES[name])
    record = found.record()
    assert json.loads(report_bytes(record)) == record
    text = plain_text(found.blocks(detail=True))
    assert max(map(len, text.splitlines())) <= 100
    assert found.figure is not None
    # Laid out and drawn; the bytes of a file are made of one.
    found.figure().draw_without_rendering()
    assert name != "several" or figure_bytes(found.figure, ".png").startswith(b"\x89PNG")
    header, rows = found.rows()
    assert header[:6] == HEADER[:6]
    assert header[-4:] == HEADER[-4:]
    lines = [dict(zip(header, row, strict=True)) for row in rows]
    assert [line["candidate"] for line in lines[:3]] == ["scale-x", "backlash-x", "covariate-x"]
    effects = [x.name for item in EXAMPLES[name].tables for x in item.effects]
    assert lines[1]["found"] is ("backlash-x" in effects)


def test_numbers_are_in_the_units_of_their_names() -> None:
    record = loop_document(EXAMPLES["named"]).record()
    assert record["before"]["rms_um"] == pytest.approx(3.6)
    assert record["before"]["rms_x_um"] == pytest.approx(3.6)
    assert record["floor_um"] == pytest.approx(1.8)
    assert record["improvement_percent"] == pytest.approx(100 * (1 - 2 / 3.6))
    assert record["after_averaged"]["rms_um"] == pytest.approx(2.0)
    first, second = record["effects"]
    lost = first["parameters"]["lost_motion"]
    assert (lost["value"], lost["u"]) == (pytest.approx(-4.1), pytest.approx(0.15))
    assert second["searched"]["pitch_mm"] == {
        "value": 12.5, "interval95": [12.3, 12.7], "intervals": [[12.3, 12.7]],
    }  # fmt: skip


def test_the_name_of_a_component_is_no_unit() -> None:
    item = on_table(verdict="none", component="UNITY")
    scores = {
        name: replace(getattr(item, name), by_axis={"UNITY": 1e-3})
        for name in ("before", "after", "after_averaged")
    }
    item = replace(item, table=replace(item.table, axes=("UNITY",)), **scores)
    record = loop_document(result(item)).record()
    assert record["before"]["rms_UNITY_um"] == pytest.approx(1.0)
