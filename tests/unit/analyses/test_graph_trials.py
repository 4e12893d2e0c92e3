"""Trials of a graph: inputs that an output needs only in part, values that are not finite."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import pytest
from graph_examples import graph_of

from mtu_cli.analyses.graph.simulate import simulate_graph
from mtu_cli.findings import InputError
from mtu_cli.model.settings import Settings

CORRELATED = """
places:
  a: {kind: constant, value: 1, u: 0.2}
  b: {kind: constant, value: 2, u: 0.1}
  s: {kind: constant}
  t: {kind: constant}
  q: {kind: constant}
transitions:
  - {do: compute, in: [a], out: s, formula: 2*a}
  - {do: compute, in: [a, b], out: t, formula: a + b}
  - {do: compute, in: [b], out: q, formula: (b - 2)**2}
correlations: [[a, b, 0.5]]
"""
M = 100_000


def test_an_output_of_one_of_two_correlated_constants(tmp_path: Path) -> None:
    """Its marginal: u(2a) = 0.4. Beside it a + b, u^2 = 0.04 + 0.01 + 2 (0.5) 0.02."""
    graph = graph_of(tmp_path, CORRELATED)
    for of, u in ((["s"], 0.4), (["t"], math.sqrt(0.07))):
        (item,) = simulate_graph(graph, Settings(trials=M), of).coordinates
        assert item.first_order_u == pytest.approx(u, rel=1e-12)
        # The output is its own control variate: its u has no random part.
        assert item.u == pytest.approx(u, rel=1e-9)


def test_a_bent_output_of_one_of_two_correlated_constants(tmp_path: Path) -> None:
    """(b - 2)^2 is run apart: 0.01 chi^2 of one degree of freedom, mean 0.01, u 0.01 sqrt 2."""
    items = simulate_graph(graph_of(tmp_path, CORRELATED), Settings()).coordinates
    bent = next(item for item in items if str(item.output) == "q")
    assert bent.u == pytest.approx(0.01 * math.sqrt(2), abs=5 * bent.se_u)
    assert bent.mean == pytest.approx(0.01, abs=5 * bent.u / math.sqrt(bent.trials))


def text_of(formulas: dict[str, str]) -> str:
    """A chain a -> y1 -> y2 ... from an uncertain constant of value 1 and u 1."""
    places, steps, before = "  a: {kind: constant, value: 1, u: 1}\n", "", "a"
    for name, formula in formulas.items():
        places += f"  {name}: {{kind: constant}}\n"
        steps += f"  - {{do: compute, in: [{before}], out: {name}, formula: '{formula}'}}\n"
        before = name
    return f"places:\n{places}transitions:\n{steps}"


def test_the_first_step_without_a_value_is_named_with_its_line(tmp_path: Path) -> None:
    """Places from line 3 on, transitions from line 9: s = sqrt(p) is the second of three."""
    text = text_of({"p": "2*a", "s": "sqrt(p)", "t": "s + 1"})
    graph = graph_of(tmp_path, text)
    with pytest.raises(InputError) as error:
        simulate_graph(graph, Settings())
    (problem,) = error.value.findings
    assert problem.file is not None
    assert problem.file.endswith("graph.yaml")
    assert (problem.line, problem.path) == (10, "transitions[1]")
    assert "no finite sqrt() at -" in problem.text
    # P(N(1, 1) < 0) = 0.1587 of 4096 trials, five standard deviations of the binomial.
    count = int(problem.text.split(" in ")[1].split()[0])
    assert count == pytest.approx(0.1587 * 4096, abs=5 * math.sqrt(4096 * 0.1587 * 0.8413))


def test_bounded_inputs_stay_where_the_formula_has_a_value(tmp_path: Path) -> None:
    """The square root of a rectangle from 0 to 2."""
    text = text_of({"s": "sqrt(a)"}).replace("u: 1}", f"u: {1 / math.sqrt(3)}, DIST}}")
    graph = graph_of(tmp_path, text.replace("DIST", "distribution: rectangular"))
    (item,) = simulate_graph(graph, Settings(trials=M)).coordinates
    # E sqrt = (2/3) sqrt 2, E a = 1.
    assert item.mean == pytest.approx(2 * math.sqrt(2) / 3, abs=5 * item.u / math.sqrt(M))
    assert item.u == pytest.approx(math.sqrt(1 - 8 / 9), abs=5 * item.se_u)


@pytest.mark.parametrize("formula", ["exp(a*1e9)", "exp(300*a)"])
def test_no_warning_of_numpy(formula: str, tmp_path: Path) -> None:
    """What overflows, or its square does, is refused in words."""
    graph = graph_of(tmp_path, text_of({"t": formula}).replace("value: 1", "value: 0"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=r"transitions\[0\]: compute of t has no finite value"):
            simulate_graph(graph, Settings())
