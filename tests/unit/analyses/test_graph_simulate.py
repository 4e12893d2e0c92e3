"""graph simulate against independent simulations and what is known exactly."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from graph_examples import SHIPPED, graph_of, shipped

from mtu_cli.analyses.graph import simulate_graph, sweep_graph
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

M = 200_000
RATIO = 5 * (2 * M) ** -0.5
"""Five standard errors of a sample standard deviation, relative."""


def probed(rng: np.random.Generator, centre: FloatArray, u_w: float, r: FloatArray) -> FloatArray:
    """Ball centres (M, 3) as Stryczek, Figure 5, has them, written out."""
    x1 = centre[0] - 12.5 + u_w * rng.standard_normal(M)
    x2 = centre[0] + 12.5 + u_w * rng.standard_normal(M)
    y1 = centre[1] - 12.5 + u_w * rng.standard_normal(M)
    y2 = centre[1] + 12.5 + u_w * rng.standard_normal(M)
    z1 = centre[2] + 12.5 + u_w * rng.standard_normal(M)
    return np.column_stack([(x1 + x2) / 2, (y1 + y2) / 2, z1 - r])


def axis(centres: list[FloatArray], alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stryczek, eqs. (8)-(27), with the index of (14) and the sign of (22) put right."""
    P1, P2, P3 = centres
    P4 = (P2 + P3) / 2
    R = np.linalg.norm(P3 - P4, axis=1) / np.sin(alpha)
    e = (P4 - P1) / np.linalg.norm(P4 - P1, axis=1)[:, None]
    normal = np.cross(P1 - P2, P3 - P2)
    return P1 + R[:, None] * e, normal / np.linalg.norm(normal, axis=1)[:, None]


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
    known = {str(c.output): c for c in result.coordinates}
    for name, sample in zip(("PO.x", "PO.y", "PO.z", "d_AC"), (*PO.T, d), strict=True):
        item = known[name]
        assert sample.mean() == pytest.approx(item.mean, abs=5 * item.u / M**0.5)
        assert sample.std(ddof=1) == pytest.approx(item.u, rel=RATIO)
    assert known["d_AC"].first_order_u == pytest.approx(known["d_AC"].u, rel=1e-4)


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
    assert item.validation is None


# graph sweep: the formula, what has no effect, how far the trials of a grid go.


@pytest.mark.parametrize(
    ("of", "grid", "form", "coefficients"),
    [
        # u^2 = (u1^2 + u2^2/n + u3^2)/2, here (1 + 1/n)/2 um^2: repeats average the probe alone.
        ("P1.x", {"repeats": [1, 2, 4, 10]}, "a/repeats + b", (0.5, 0.5)),
        # u^2 = u1^2 + u2^2 + u_r^2, u_r = 0.2 um: other sources are a constant.
        ("P1.z", {"axis_um": [0.5, 1, 2], "probe_um": [0.5, 1], "repeats": [1, 4]},
         "a*probe_um^2/repeats + b*axis_um^2 + c", (1, 1, 0.04)),
    ],
)  # fmt: skip
def test_the_formula_of_a_ball(
    of: str, grid: dict[str, list[float]], form: str, coefficients: tuple[float, ...]
) -> None:
    swept = sweep_graph(shipped("ball-centre"), Settings(trials=20_000), of, grid)
    assert swept.formula is not None
    assert swept.formula.form == f"u_um = sqrt({form})"
    assert tuple(swept.formula.coefficients.values()) == pytest.approx(coefficients)
    assert len(swept.grid) == math.prod(map(len, grid.values()))
