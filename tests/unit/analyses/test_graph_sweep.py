"""graph sweep: the formula, what has no effect, how far the trials of a grid go."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from graph_examples import graph_of, shipped

from mtu_cli.analyses.graph import (
    sweep_graph,
)
from mtu_cli.findings import InputError
from mtu_cli.model.settings import Settings


def test_repeats_average_the_probe_alone() -> None:
    """The ball's x: u^2 = (u1^2 + u2^2/n + u3^2)/2, here (1 + 1/n)/2 um^2."""
    swept = sweep_graph(
        shipped("ball-centre"), Settings(trials=20_000), "P1.x", {"repeats": [1, 2, 4, 10]}
    )
    u = np.array([item.u for item in swept.grid])
    assert 1e6 * u**2 == pytest.approx([(1 + 1 / n) / 2 for n in (1, 2, 4, 10)])
    assert swept.formula is not None
    assert swept.formula.form == "u_um = sqrt(a/repeats + b)"
    assert swept.formula.coefficients == pytest.approx({"a": 0.5, "b": 0.5})


def test_other_sources_are_a_constant_of_the_formula() -> None:
    """The ball's z: u^2 = u1^2 + u2^2 + u_r^2, u_r = 0.2 um."""
    grid = {"axis_um": [0.5, 1.0, 2.0], "probe_um": [0.5, 1.0], "repeats": [1.0, 4.0]}
    swept = sweep_graph(shipped("ball-centre"), Settings(trials=20_000), "P1.z", grid)
    assert swept.formula is not None
    assert swept.formula.form == "u_um = sqrt(a*probe_um^2/repeats + b*axis_um^2 + c)"
    assert swept.formula.coefficients == pytest.approx({"a": 1, "b": 1, "c": 0.04})
    assert len(swept.grid) == 12
    assert swept.grid[1].at == {"axis_um": 0.5, "probe_um": 0.5, "repeats": 4}


def test_one_coordinate_is_swept() -> None:
    with pytest.raises(InputError, match=r"one of: P1\.x, P1\.y, P1\.z"):
        sweep_graph(shipped("ball-centre"), Settings(), "P1", {"axis_um": [1.0, 2.0]})


OFF_NOMINAL = """
uncertainty: {axis_um: 1.0, probe_um: 0.5, perpendicular_um: 0.3}
places:
  x: {kind: coordinate, axis: x, nominal_mm: 5}
  y: {kind: coordinate, axis: y, nominal_mm: 7}
  e: {kind: constant, unit: mm}
transitions:
  - {do: meas, out: x}
  - {do: meas, out: y}
  - {do: compute, in: [x, y], out: e, formula: sqrt((x - 5)**2 + (y - 7)**2)}
"""


def test_a_formula_without_first_order_has_all_terms(tmp_path: Path) -> None:
    """A Rayleigh variable: u^2 = (2 - pi/2) (u1^2 + u2^2/n + u3^2)."""
    grid = {"repeats": [1.0, 2.0, 4.0], "axis_um": [0.5, 1.0]}
    graph = graph_of(tmp_path, OFF_NOMINAL)
    found = sweep_graph(graph, Settings(trials=200_000), "e", grid).formula
    assert found is not None
    assert found.form == "u_um = sqrt(a*axis_um^2 + b/repeats + c)"
    share = 2 - np.pi / 2
    # Weighted least squares of u^2, whose relative standard error is 2 se(u)/u =
    # sqrt((kurtosis - 1)/M); of a Rayleigh variable the kurtosis is
    # (32 - 3 pi^2)/(4 - pi)^2. Five standard errors of the coefficients, (X'WX)^-1.
    kurtosis = (32 - 3 * np.pi**2) / (4 - np.pi) ** 2
    relative = np.sqrt((kurtosis - 1) / 200_000)
    settings = [(n, u1) for n in (1, 2, 4) for u1 in (0.5, 1)]
    terms = np.array([[u1**2, 1 / n, 1] for n, u1 in settings])
    expected = share * np.array([1, 0.25, 0.09])
    weighted = terms / (relative * (terms @ expected))[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted)
    coefficients = np.array([found.coefficients[name] for name in "abc"])
    assert np.all(np.abs(coefficients - expected) <= 5 * np.sqrt(np.diag(covariance)))
