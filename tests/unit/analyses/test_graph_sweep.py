"""graph sweep: how far the trials of a grid go, and what an output does not depend on."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from graph_examples import graph_of, shipped

from mtu_cli.analyses.graph.simulate import simulate_graph
from mtu_cli.analyses.graph.sweep import sweep_graph
from mtu_cli.model.settings import Settings
from mtu_cli.reports.figures import figure_bytes
from mtu_cli.reports.graph_figure import swept as drawn

HOLE = """
uncertainty: {axis_um: 1, probe_um: 1}
places:
  x1: {kind: coordinate, axis: x, nominal_mm: -1}
  x2: {kind: coordinate, axis: x, nominal_mm: 1}
  y1: {kind: coordinate, axis: y, nominal_mm: -1}
  y2: {kind: coordinate, axis: y, nominal_mm: 1}
  N: {kind: point, nominal_mm: [0, 0, 0], known: true}
  C: {kind: point}
  d: {kind: constant}
transitions:
  - {do: meas, out: x1}
  - {do: meas, out: x2}
  - {do: meas, out: y1}
  - {do: meas, out: y2}
  - {do: hole, in: [x1, x2, y1, y2], out: C}
  - {do: distance, in: [C, N], out: d}
report: [C, d]
"""


def test_an_output_without_first_order_goes_as_far_as_in_simulate(tmp_path: Path) -> None:
    """A hole's distance from nominal, a Rayleigh variable of s^2 = (u1^2 + u2^2)/2: u^2 =
    (2 - pi/2) s^2. Both stop at the tolerance of JCGM 101, 7.9.4, not at a fifth of it.
    """
    graph = graph_of(tmp_path, HOLE)
    swept = sweep_graph(graph, Settings(), "d", {"axis_um": [1.0, 2.0]})
    (base,) = simulate_graph(graph, Settings(), ["d"]).coordinates
    assert swept.converged
    assert [item.code for item in swept.warnings] == ["not-estimable"]
    for item in swept.grid:
        s = 1e-3 * math.sqrt((item.at["axis_um"] ** 2 + 1) / 2)
        assert item.u == pytest.approx(s * math.sqrt(2 - math.pi / 2), abs=5 * item.se_u)
        # A fifth of the tolerance takes 25 times the trials; the count itself scatters by less.
        assert item.trials < 5 * base.trials


def test_grid_points_that_do_not_converge_are_told(tmp_path: Path) -> None:
    swept = sweep_graph(
        graph_of(tmp_path, HOLE), Settings(trials=1000), "d", {"axis_um": [1.0, 2.0]}
    )
    assert not swept.converged
    (told,) = (item for item in swept.warnings if item.code == "not-converged")
    assert told.message.startswith("1000 Monte Carlo trials: not converged")
    assert told.message.endswith("at 2 of 2 points of the grid")
    largest = max(item.se_u / item.u for item in swept.grid)
    assert swept.largest_error == largest > 0
    assert f"u is up to {100 * largest:.2g} %;" in told.message
    assert [item.deviation for item in swept.grid] == [
        item.mean - swept.nominal for item in swept.grid
    ]


def test_measurements_with_their_own_uncertainty_leave_nothing_to_vary(tmp_path: Path) -> None:
    text = HOLE
    for name in ("x1", "x2", "y1", "y2"):
        own = f"out: {name}, uncertainty: {{axis_um: 1, probe_um: 1}}"
        text = text.replace(f"out: {name}}}", f"{own}}}")
    graph = graph_of(tmp_path, text)
    varied = {"axis_um": [1.0, 2.0], "probe_um": [1.0, 3.0]}
    swept = sweep_graph(graph, Settings(trials=1000), "C.x", varied)
    assert swept.formula is None
    assert swept.no_formula == "C.x does not depend on axis_um, probe_um"
    assert swept.without == ("axis_um", "probe_um")
    # Probings are averaged all the same.
    repeated = sweep_graph(graph, Settings(trials=1000), "C.x", {"repeats": [1, 2]})
    assert repeated.without == ()


def test_a_constant_does_not_depend_on_probing() -> None:
    swept = sweep_graph(shipped("ball-centre"), Settings(trials=1000), "r1", {"axis_um": [1, 2]})
    assert swept.no_formula == "r1 does not depend on axis_um"


def test_a_formula_of_what_has_an_effect(tmp_path: Path) -> None:
    """C.x from x1 and x2 alone: u^2 = (u1^2 + u2^2)/2; u2 is their own, y's does not matter."""
    text = HOLE
    for name in ("x1", "x2"):
        text = text.replace(f"out: {name}}}", f"out: {name}, uncertainty: {{probe_um: 2}}}}")
    graph = graph_of(tmp_path, text)
    grid = {"axis_um": [0.0, 1.0, 2.0], "probe_um": [1.0, 3.0]}
    swept = sweep_graph(graph, Settings(trials=20_000), "C.x", grid)
    assert swept.without == ("probe_um",)
    assert swept.formula is not None
    assert swept.formula.form == "u_um = sqrt(a*axis_um^2 + b)"
    # The output is its own control variate: its u has no random part but rounding.
    assert swept.formula.coefficients == pytest.approx({"a": 0.5, "b": 2.0}, rel=1e-9)
    (told,) = (item for item in swept.warnings if item.code == "unrelated")
    assert told.message == "C.x does not depend on probe_um"
    assert figure_bytes(drawn(swept), "png").startswith(b"\x89PNG")


def test_one_probing_without_scatter_of_the_probe_is_as_good_as_ten(tmp_path: Path) -> None:
    graph = graph_of(tmp_path, HOLE.replace("probe_um: 1", "probe_um: 0"))
    swept = sweep_graph(graph, Settings(trials=1000), "C.x", {"repeats": [1, 10]})
    assert swept.no_formula == "C.x does not depend on repeats"
