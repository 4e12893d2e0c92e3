"""Jumps so far out that no trial need have met them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from graph_examples import SHIPPED, graph_of, shipped
from scipy.stats import norm

from mtu_cli.analyses.graph.rare_jumps import NEAR, RADII, UNSEEN, rare_jumps
from mtu_cli.analyses.graph.simulate import simulate_graph
from mtu_cli.model.graph.first_order import first_order
from mtu_cli.model.graph.measurement_graph import Evaluation, MeasurementGraph, evaluation
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

LINE = """
uncertainty: {{axis_um: 1}}
places:
  x: {{kind: coordinate, axis: x, nominal_mm: 0}}
  w: {{kind: coordinate, axis: y, nominal_mm: 0}}
  i: {{kind: constant, unit: mm, value: 0.001}}
  y: {{kind: constant, unit: '1'}}
transitions:
  - {{do: meas, out: x}}
  - {{do: meas, out: w}}
  - {{do: compute, in: [x, w, i], out: y, formula: {formula}}}
report: [y]
"""
"""x/i and w/i have u = 1."""
FIRST_LOOK = 40_960.0


def jumps_of(graph: MeasurementGraph, u: float | None, trials: float) -> list[tuple[float, ...]]:
    whole = evaluation(graph, graph.outputs(()))
    linear = first_order(whole)
    own = linear.u if u is None else np.full(len(linear.u), u)
    found = rare_jumps(whole, linear, own, np.full(len(own), trials), 2)
    return [(jump.radius, jump.chance, jump.change, jump.u) for jump in found]


@pytest.mark.parametrize(("at", "size"), [(4.0, 100.0), (5.0, 1000.0), (5.5, -5000.0)])
def test_a_jump_that_changes_u_is_seen(tmp_path: Path, at: float, size: float) -> None:
    """Var(z + J [z > r]) = 1 + J^2 Q (1 - Q) + 2 J phi(r); told is u without the last term."""
    formula = f"x/i + w/i*0 {size:+g}*step(x - {at / 1000:g})"
    graph = graph_of(tmp_path, LINE.format(formula=formula))
    ((radius, chance, change, u),) = jumps_of(graph, 1.0, FIRST_LOOK)
    Q, shared = norm.sf(at), 2.0 * abs(size) * norm.pdf(at)
    assert radius == at
    assert chance == pytest.approx(Q, rel=1e-9)
    # A jump back is held against the last value before it, which is off by less than r.
    assert change == pytest.approx(abs(size), rel=1e-9) if size > 0 else abs(size) - change < at
    exact = math.sqrt(1.0 + size**2 * Q * (1.0 - Q) + math.copysign(shared, size))
    assert u == pytest.approx(exact, abs=shared)
    # Trials enough to have met it: it is in their u.
    assert jumps_of(graph, 1.0, 1.01 * UNSEEN / Q) == []


def test_a_jump_along_several_inputs_is_seen_along_the_gradient(tmp_path: Path) -> None:
    formula = "x/i + w/i + 3000*step(x + w - 0.0075)"
    graph = graph_of(tmp_path, LINE.format(formula=formula))
    ((radius, _, change, _),) = jumps_of(graph, None, FIRST_LOOK)
    assert radius == 5.5
    assert change == pytest.approx(3000.0, rel=1e-9)


@pytest.mark.parametrize(
    ("formula", "u"),
    [
        ("x/i + 1000*step(x - 0.006)", 1.0),
        ("x/i + 1000*step(x - 0.0005)", 462.0),
        ("x/i + 100*step(x - 0.002)", 16.0),
        ("sqrt((x/i)**2)", 0.603),
        ("(x/i)**3", math.sqrt(15.0)),
        ("exp(x/(2*i))", 0.604),
        ("sin(3*x/i)", 0.707),
        ("sqrt((x/i + 3)/i)", 20.0),
    ],
)
def test_nothing_is_told_of_what_matters_not_or_is_seen(
    tmp_path: Path, formula: str, u: float
) -> None:
    """Too rare for the digits of u; a step, an edge or a bend that trials meet; undefined."""
    graph = graph_of(tmp_path, LINE.format(formula=f"{formula} + w/i*0"))
    assert jumps_of(graph, u, FIRST_LOOK) == []


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
@pytest.mark.parametrize("trials", [FIRST_LOOK, 2.5e6])
def test_shipped_graphs_have_none(path: Path, trials: float) -> None:
    assert jumps_of(shipped(path.stem), None, trials) == []


def test_nothing_is_evaluated_where_no_output_is_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph = graph_of(tmp_path, LINE.format(formula="x/i + w/i*0 + 1000*step(x - 0.005)"))
    whole = evaluation(graph, graph.outputs(()))
    linear = first_order(whole)
    monkeypatch.setattr(Evaluation, "run", None)
    assert rare_jumps(whole, linear, np.zeros(1), np.full(1, FIRST_LOOK), 2) == []


def test_directions_are_evaluated_some_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever their number, the same is found."""
    graph = graph_of(tmp_path, LINE.format(formula="x/i + w/i - 3000*step(-x - w - 0.0075)"))
    at_once = jumps_of(graph, None, FIRST_LOOK)
    assert len(at_once) == 1
    wide: list[int] = []
    run = Evaluation.run

    def counted(self: Evaluation, X: FloatArray) -> FloatArray:
        wide.append(X.shape[1])
        return run(self, X)

    monkeypatch.setattr(Evaluation, "run", counted)
    monkeypatch.setattr("mtu_cli.analyses.graph.rare_jumps.AT_ONCE", 4)
    assert jumps_of(graph, None, FIRST_LOOK) == at_once
    # x, w and the gradient, both ways, after the first order's differences.
    each = len(NEAR) + len(RADII)
    assert wide[1:] == [4 * each, 2 * each]


def test_inputs_of_little_weight_are_left_out_where_there_are_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jump = "1000*step({} - 0.005)"
    formulas = [f"x/i + 0.1*w/i + {jump.format(name)}" for name in ("x", "w")]
    graphs = [graph_of(tmp_path, LINE.format(formula=formula)) for formula in formulas]
    assert [len(jumps_of(graph, None, FIRST_LOOK)) for graph in graphs] == [1, 1]
    monkeypatch.setattr("mtu_cli.analyses.graph.rare_jumps.MOST", 1)
    assert [len(jumps_of(graph, None, FIRST_LOOK)) for graph in graphs] == [1, 0]


def test_the_simulation_warns(tmp_path: Path) -> None:
    formula = "x/i + w/i*0 + 1000*step(x - 0.005)"
    result = simulate_graph(graph_of(tmp_path, LINE.format(formula=formula)), Settings())
    assert result.converged
    (warning,) = result.warnings
    assert warning.code == "rare-jump"
    assert warning.message == (
        "y: 5 standard deviations out along x it is 1000 u off what it is nearer to the nominal. "
        "Of 40960 trials perhaps none went there, 1 in 3500000 does; u would be 1.13 times as large"
    )
