"""What is drawn has the covariance that the file states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from graph_examples import graph_of, shipped
from numpy.typing import NDArray

from mtu_cli.findings import InputError
from mtu_cli.model.graph.propagation import GraphTrials, Inputs
from mtu_cli.stats.workspace import Workspace

M = 400_000
PROBED = """
uncertainty: {axis_um: 2, probe_um: 3, perpendicular_um: 6}
places:
  x: {kind: coordinate, axis: x, nominal_mm: 5}
  P: {kind: point, nominal_mm: [1, 2, 3]}
  Q: {kind: point, nominal_mm: [0, 0, 0]}
  d: {kind: constant}
  e: {kind: constant}
transitions:
  - {do: meas, out: x}
  - {do: meas, out: P, along: [3, 0, 4], repeats: 9}
  - {do: meas, out: Q, along: -y, uncertainty: {axis_um: 0}}
  - {do: distance, in: [P, Q], out: d}
  - {do: compute, in: [x, d], out: e, formula: x + d}
"""


def drawn(inputs: Inputs) -> NDArray[np.float64]:
    z = inputs.draw(np.random.default_rng(1), M, Workspace())
    return np.asarray(inputs.factor @ z + inputs.mean[:, None])


def test_probing(tmp_path: Path) -> None:
    """u_w^2 = u1^2 + u2^2/n + u3^2 along the probing, u1^2 across; um^2."""
    graph = graph_of(tmp_path, PROBED)
    inputs = Inputs(graph.graph, ["x", "P", "Q"])
    X = drawn(inputs)
    places = inputs.values(X)
    assert places["x"].mean() == pytest.approx(5, abs=5 * 0.007 / M**0.5)
    assert 1e6 * places["x"].var() == pytest.approx(4 + 9 + 36, rel=5 * (2 / M) ** 0.5)
    d = np.array([0.6, 0.0, 0.8])
    expected = 4 * np.eye(3) + (9 / 9 + 36) * np.outer(d, d)
    assert 1e6 * np.cov(places["P"]) == pytest.approx(expected, abs=5 * 41 * (2 / M) ** 0.5)
    assert inputs.factor @ inputs.factor.T == pytest.approx(
        1e-6 * np.diag([49, *[0] * 6]) + _block(1e-6 * expected, 1) + _block(_q(), 4), abs=1e-18
    )
    assert np.ptp(places["Q"][[0, 2]]) == 0


def _q() -> np.ndarray:
    return np.diag([0.0, 45e-6, 0.0])


def _block(matrix: np.ndarray, at: int) -> np.ndarray:
    found = np.zeros((7, 7))
    found[at : at + 3, at : at + 3] = matrix
    return found


CONSTANTS = """
places:
  a: {kind: constant, value: 1, u: 1}
  b: {kind: constant, value: 2, u: 2}
  c: {kind: constant, value: 3, u: 3, distribution: rectangular}
  d: {kind: constant, value: 4, u: 4, distribution: triangular}
  s: {kind: constant}
transitions:
  - {do: compute, in: [a, b, c, d], out: s, formula: a + b + c + d}
"""


def test_constants(tmp_path: Path) -> None:
    graph = graph_of(tmp_path, CONSTANTS)
    inputs = Inputs(graph.graph, "abcd")
    assert not inputs.normal
    X = drawn(inputs)
    places = inputs.values(X)
    X = np.array([places[name] for name in "abcd"])
    error = 5 / M**0.5
    assert X.mean(axis=1) == pytest.approx([1, 2, 3, 4], abs=4 * error)
    assert X.std(axis=1) == pytest.approx([1, 2, 3, 4], rel=error)
    assert np.corrcoef(X) == pytest.approx(np.eye(4), abs=error)
    assert X[2].min() >= 3 - 3 * 3**0.5
    assert X[2].max() <= 3 + 3 * 3**0.5
    assert X[3].min() >= 4 - 4 * 6**0.5
    # Fourth moments tell the shapes: 9/5 rectangular, 12/5 triangular.
    kurtosis = ((X - X.mean(axis=1)[:, None]) ** 4).mean(axis=1) / X.var(axis=1) ** 2
    assert kurtosis[2:] == pytest.approx([1.8, 2.4], abs=0.02)


def test_shares_of_constants(tmp_path: Path) -> None:
    """Var = 1 + 4 + 9 + 16 = 30."""
    graph = graph_of(tmp_path, CONSTANTS)
    found = GraphTrials(graph, graph.outputs())
    assert found.u[0] ** 2 == pytest.approx(30)
    shares = {name: float(values[0]) for name, values in found.shares().items()}
    assert shares == pytest.approx({"a": 1 / 30, "b": 4 / 30, "c": 9 / 30, "d": 16 / 30})


def test_ball_centre_by_hand() -> None:
    """u_x = u_w/sqrt(2), u_z^2 = u_w^2 + u_r^2."""
    graph = shipped("ball-centre")
    found = GraphTrials(graph, graph.outputs())
    assert 1e6 * found.u**2 == pytest.approx([1, 1, 2.04])
    assert found.shares()["r1"] == pytest.approx([0, 0, 0.04 / 2.04])
    assert found.shares()["u1_axis"] == pytest.approx([0.5, 0.5, 1 / 2.04])
    assert found.shares(by_place=True)["x1"] == pytest.approx([0.5, 0, 0])


def test_outputs_by_name() -> None:
    graph = shipped("work-coordinates")
    assert [str(item) for item in graph.outputs(["Q", "W.rz", "Q.x"])] == [
        "Q.x", "Q.y", "Q.z", "W.rz",
    ]  # fmt: skip
    assert {item.unit for item in graph.outputs(["W"])} == {"mm", "rad"}
    assert {item.unit for item in graph.outputs(["edge"])} == {"mm", "1"}


def test_a_frame_turns_about_its_nominal_axes() -> None:
    """The front edge of 160 mm along x, probed along y, turns it about z: u = sqrt(2) u_w/160."""
    graph = shipped("work-coordinates")
    found = GraphTrials(graph, graph.outputs(["W.rx", "W.rz"]))
    assert found.nominal == pytest.approx([0, 0], abs=1e-15)
    u_w = 1e-3 * np.sqrt(1.5**2 + 0.8**2 + 0.3**2)
    assert found.u[1] == pytest.approx(2**0.5 * u_w / 160, rel=1e-9)


def test_a_transition_without_a_value_is_named(tmp_path: Path) -> None:
    """sqrt(a) of a normal with mean 1 and u 1: the first of the two steps, with its line."""
    text = """
places:
  a: {kind: constant, value: 1, u: 1}
  s: {kind: constant}
  t: {kind: constant}
transitions:
  - {do: compute, in: [a], out: s, formula: sqrt(a)}
  - {do: compute, in: [s], out: t, formula: s + 1}
"""
    graph = graph_of(tmp_path, text)
    with pytest.raises(InputError, match=r"yaml:9: transitions\[0\].*no finite sqrt\(\) at -"):
        GraphTrials(graph, graph.outputs()).draw(np.random.default_rng(1), 100)
