"""graph simulate against independent simulations and what is known exactly."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from graph_examples import SHIPPED, graph_of, shipped
from numpy.typing import NDArray
from scipy.special import ndtri

from mtu_cli.analyses.graph import GraphSimulation, simulate_graph, sweep_graph
from mtu_cli.findings import InputError
from mtu_cli.model.settings import Settings

Floats = NDArray[np.float64]
M = 200_000
RATIO = 5 * (2 * M) ** -0.5
"""Five standard errors of a sample standard deviation, relative."""


def found(result: GraphSimulation) -> dict[str, tuple[float, float, float]]:
    return {str(c.output): (c.mean, c.u, c.first_order_u) for c in result.coordinates}


def probed(rng: np.random.Generator, centre: Floats, u_w: float, r: Floats) -> Floats:
    """Ball centres (M, 3) as Stryczek, Figure 5, has them, written out."""
    x1 = centre[0] - 12.5 + u_w * rng.standard_normal(M)
    x2 = centre[0] + 12.5 + u_w * rng.standard_normal(M)
    y1 = centre[1] - 12.5 + u_w * rng.standard_normal(M)
    y2 = centre[1] + 12.5 + u_w * rng.standard_normal(M)
    z1 = centre[2] + 12.5 + u_w * rng.standard_normal(M)
    return np.column_stack([(x1 + x2) / 2, (y1 + y2) / 2, z1 - r])


def axis(centres: list[Floats], alpha: Floats) -> tuple[Floats, Floats]:
    """Stryczek, eqs. (8)-(27), with the index of (14) and the sign of (22) put right."""
    P1, P2, P3 = centres
    P4 = (P2 + P3) / 2
    R = np.linalg.norm(P3 - P4, axis=1) / np.sin(alpha)
    e = (P4 - P1) / np.linalg.norm(P4 - P1, axis=1)[:, None]
    normal = np.cross(P1 - P2, P3 - P2)
    return P1 + R[:, None] * e, normal / np.linalg.norm(normal, axis=1)[:, None]


def agree(result: GraphSimulation, place: str, sample: Floats, names: str = "xyz") -> None:
    """Means and u of an independent sample, within the error of the two."""
    values = found(result)
    for i, name in enumerate(names):
        mean, u, _ = values[f"{place}.{name}"]
        assert sample[:, i].mean() == pytest.approx(mean, abs=5 * u / M**0.5)
        assert sample[:, i].std(ddof=1) == pytest.approx(u, rel=RATIO)


def test_distance_of_axes_against_a_plain_simulation() -> None:
    rng = np.random.default_rng(3)
    u_w, r = math.hypot(1e-3, 1e-3), np.full(M, 12.5)
    tilted, turned = [], []
    for turn in (0, -math.pi / 6, math.pi / 6):
        c, s = math.cos(turn), math.sin(turn)
        tilted.append(probed(rng, np.array([0, 110 * c - 50 * s, 50 * c + 110 * s]), u_w, r))
    for turn in (0, -2 * math.pi / 3, 2 * math.pi / 3):
        spot = np.array([-110 * math.sin(turn), 110 * math.cos(turn), 50])
        turned.append(probed(rng, spot, u_w, r))
    PA, VA = axis(tilted, np.full(M, math.pi / 6))
    PC, VC = axis(turned, np.full(M, 2 * math.pi / 3))
    PT = PC - 100 * VC
    t = np.einsum("ij,ij->i", VA, PT - PA)
    PO = PA + t[:, None] * VA
    d = np.linalg.norm(PO - PT, axis=1)
    result = simulate_graph(shipped("axes-a-and-c"), Settings())
    agree(result, "PO", PO)
    mean, u, first = found(result)["d_AC"]
    assert d.mean() == pytest.approx(mean, abs=5 * u / M**0.5)
    assert d.std(ddof=1) == pytest.approx(u, rel=RATIO)
    assert first == pytest.approx(u, rel=1e-4)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_graphs(path: Path) -> None:
    graph = shipped(path.stem)
    assert sum(map(len, graph.rounds)) == len(graph.graph.transitions)
    result = simulate_graph(graph, Settings())
    assert result.converged
    assert {item.code for item in result.warnings} <= {"not-estimable"}
    for item in result.coordinates:
        if item.validation is not None:
            assert item.validation.passed
            assert item.first_order_u == pytest.approx(item.u, rel=1e-3)
            assert sum(item.shares.values()) == pytest.approx(1)


def test_threads_do_not_matter() -> None:
    graph = shipped("rotary-axis-c")
    one, three = (simulate_graph(graph, Settings(threads=n)) for n in (1, 3))
    for a, b in zip(one.coordinates, three.coordinates, strict=True):
        assert (a.mean, a.u, a.interval) == (b.mean, b.u, b.interval)
    fixed = [simulate_graph(graph, Settings(threads=n, trials=50_000)) for n in (1, 2)]
    assert found(fixed[0]) == found(fixed[1])
    other = simulate_graph(graph, Settings(seed=5))
    assert found(other) != found(one)


SQUARE = """
places:
  x: {kind: constant, value: 0, u: 3}
  y: {kind: constant}
transitions:
  - {do: compute, in: [x], out: y, formula: x**2}
"""


def test_a_square_at_zero(tmp_path: Path) -> None:
    """First order says 0; y = 9 chi^2 with one degree of freedom: mean 9, u 9 sqrt 2."""
    result = simulate_graph(graph_of(tmp_path, SQUARE), Settings())
    (item,) = result.coordinates
    assert item.first_order_u == 0
    assert [warning.code for warning in result.warnings] == ["not-estimable"]
    assert item.converged
    assert item.mean == pytest.approx(9, abs=5 * item.u / item.trials**0.5)
    assert item.u == pytest.approx(9 * 2**0.5, abs=5 * item.se_u)
    # chi^2 of 1 degree of freedom is the square of a normal variable; five standard errors
    # sqrt(p(1 - p)/M)/f of an empirical quantile.
    for end, probability in zip(item.interval, (0.025, 0.975), strict=True):
        q = float(ndtri((1 + probability) / 2)) ** 2
        density = math.exp(-q / 2) / math.sqrt(2 * math.pi * q) / 9
        error = math.sqrt(probability * (1 - probability) / item.trials) / density
        assert end == pytest.approx(9 * q, abs=5 * error)
    assert item.validation is None


def test_rectangular_inputs(tmp_path: Path) -> None:
    """Two equal ones sum to a triangle: half width w, 95 % within w (1 - sqrt 0.05)."""
    text = """
places:
  a: {kind: constant, value: 1, u: 1, distribution: rectangular}
  b: {kind: constant, value: 1, u: 1, distribution: rectangular}
  s: {kind: constant}
transitions:
  - {do: compute, in: [a, b], out: s, formula: a + b}
"""
    (item,) = simulate_graph(graph_of(tmp_path, text), Settings()).coordinates
    # A sum is its own control variate: its u has no random part.
    assert item.u == pytest.approx(2**0.5, rel=1e-9)
    width = 2 * 3**0.5
    end = width * (1 - 0.05**0.5)
    # Five standard errors of an empirical quantile; the density of the triangle there.
    density = (1 - end / width) / width
    error = 5 * math.sqrt(0.025 * 0.975 / item.trials) / density
    assert item.interval == pytest.approx((2 - end, 2 + end), abs=error)
    assert item.validation is not None
    assert item.validation.passed is False


# graph sweep: the formula, what has no effect, how far the trials of a grid go.


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
