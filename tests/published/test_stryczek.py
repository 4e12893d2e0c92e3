"""Stryczek, A Bipartite Graph for Estimating Measurement Uncertainty: its printed figures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from graph_examples import graph_of, shipped
from scipy.special import chdtrc

from mtu_cli.analyses.graph import Formula, Sweep, fit_formula, simulate_graph, sweep_graph
from mtu_cli.model.settings import Settings

FIVE = (0.5, 1.0, 1.5, 2.0, 2.5)
PAIRS = {"axis_um": FIVE, "probe_um": FIVE}


def test_sum_of_two_normals(tmp_path: Path) -> None:
    """Figure 4: N(0, 1) + N(0.5, 0.5): mean 0.5, s 1.118; printed from 3000 samples: mean 0.502,
    s 1.117, 95 % of them in [-1.658, 2.663].
    """
    text = """
places:
  X1: {kind: constant, value: 0, u: 1}
  X2: {kind: constant, value: 0.5, u: 0.5}
  Y: {kind: constant}
transitions:
  - {do: compute, in: [X1, X2], out: Y, formula: X1 + X2}
"""
    (item,) = simulate_graph(graph_of(tmp_path, text), Settings()).coordinates
    assert item.mean == pytest.approx(0.5, abs=1e-9)
    assert item.u == pytest.approx(1.118, abs=5e-4)
    assert item.u == pytest.approx(math.sqrt(1.25), rel=1e-9)
    # The paper's sample, by its own standard errors.
    assert item.mean == pytest.approx(0.502, abs=2 * item.u / math.sqrt(3000))
    assert item.u == pytest.approx(1.117, abs=2 * item.u / math.sqrt(6000))
    end = 3 * item.u * math.sqrt(0.025 * 0.975 / 3000) / 0.0584
    assert item.interval == pytest.approx((-1.658, 2.663), abs=end)


@pytest.fixture(scope="module")
def precise() -> Sweep:
    return sweep_graph(shipped("axes-a-and-c"), Settings(trials=20_000), "d_AC", PAIRS)


def without_scatter(found: Sweep) -> float:
    """The largest error, in percent, of the same formula for the first-order u."""
    u = np.array([item.first_order_u for item in found.grid])
    at = {name: np.array([item.at[name] for item in found.grid]) for name in found.varied}
    formula = fit_formula(at, u, 1e-9 * u, u, "mm")
    assert isinstance(formula, Formula)
    return formula.max_error_percent


def test_form_of_the_distance_of_axes(precise: Sweep) -> None:
    """Eq. (31): u = sqrt(a s_p^2 + b s_m^2) within 5 % over 25 pairs. The printed constants need
    the paper's unstated dimensions; a and b are as good as equal there (868/845), as here.
    """
    formula = precise.formula
    assert formula is not None
    assert len(precise.grid) == 25
    assert formula.form == "u_um = sqrt(a*probe_um^2 + b*axis_um^2)"
    assert formula.max_error_percent < 5
    assert without_scatter(precise) < 0.01
    a, b = formula.coefficients["a"], formula.coefficients["b"]
    assert a / b == pytest.approx(868 / 845, abs=0.06)
    assert a == pytest.approx(b, rel=1e-4)


def test_a_thousand_cycles_have_an_error_of_their_own() -> None:
    """1/sqrt(2 (1000 - 1)) = 2.2 %: the paper's 5 % is what the largest of 25 such errors is."""
    graph = shipped("axes-a-and-c")
    errors, chi2, dof = [], 0.0, 0
    for seed in range(8):
        found = sweep_graph(graph, Settings(trials=1000, seed=seed), "d_AC", PAIRS)
        formula = found.formula
        assert formula is not None
        assert formula.monte_carlo_percent == pytest.approx(2.24, abs=0.05)
        assert without_scatter(found) < 0.01
        errors.append(formula.max_error_percent)
        chi2 += float(np.sum((formula.error_percent / 2.236) ** 2))
        dof += 25 - 2
    assert np.median(errors) == pytest.approx(4.7, abs=1.2)
    assert 1e-4 < chdtrc(dof, chi2) < 1 - 1e-4
