"""The effects block: what close-loop found, added to the equations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import stated

from mtu_cli.model.prediction import predict

MACHINE = """
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
  t: {unit: urad, coefficients: [4.0], covariance: [[0.2]]}
equations: {Ex: a - y*t, Ey: x*t}
"""
EFFECT = """
effects:
  - name: backlash
    parameters: {h: {value: 2.0, u: 0.3, unit: um}, g: {value: 5.0, u: 0.5, unit: urad}}
    covariance: [[0.09, -0.06], [-0.06, 0.25]]
    equations: {Ex: h*dir_x + (x - 30)*g, Ey: 0.5*h}
"""
POINTS = np.array([[10.0, 20, 0], [70.0, -5, 0], [40.0, 8, 0]])
DIRECTION = np.array([1.0, -1, 1])
IDS = ["1", "2", "3"]


def test_parameters_with_covariance(tmp_path: Path) -> None:
    plain = predict(stated(tmp_path, MACHINE), IDS, POINTS)
    found = predict(stated(tmp_path, MACHINE + EFFECT), IDS, POINTS, {"dir_x": DIRECTION})
    J = np.zeros((6, 2))
    J[0::2, 0], J[0::2, 1], J[1::2, 0] = DIRECTION, POINTS[:, 0] - 30, 0.5
    C = np.array([[0.09, -0.06], [-0.06, 0.25]]) * 1e-6 * np.array([[1, 1e-3], [1e-3, 1e-6]])
    assert found.mean - plain.mean == pytest.approx(J @ [2e-3, 5e-6], rel=1e-12)
    assert found.covariance - plain.covariance == pytest.approx(J @ C @ J.T, rel=1e-9)
    A = np.random.default_rng(0).normal(size=(3, 6))
    more = found.variance(A)
    assert more.total - plain.variance(A).total == pytest.approx(np.diag(A @ J @ C @ J.T @ A.T))
    # Known numbers of the machine, not visits: nothing of it is passes or repeatability.
    assert more.repeatability == pytest.approx(plain.variance(A).repeatability)


def test_an_effect_in_a_component_adds_to_its_lever_arm(tmp_path: Path) -> None:
    """A thermal stretch of a component: Ex gains 0.5 a, whose uncertainty is a's own."""
    text = """
effects:
  - name: stretch
    parameters: {k: {value: 1.0, u: 0.1, unit: um}}
    equations: {Ex: 0.5*a + k, Ey: -2*a}
"""
    plain = predict(stated(tmp_path, MACHINE), IDS, POINTS)
    found = predict(stated(tmp_path, MACHINE + text), IDS, POINTS)
    a = (1 + 0.1 * POINTS[:, 0]) * 1e-3
    assert found.mean[0::2] - plain.mean[0::2] == pytest.approx(0.5 * a + 1e-3, rel=1e-9)
    assert found.mean[1::2] - plain.mean[1::2] == pytest.approx(-2 * a, rel=1e-9)
    x, y = POINTS[:, 0], POINTS[:, 1]
    of_a = (0.4 + 1e-4 * x**2 + 0.49) * 1e-6
    t = 0.2e-12
    diagonal = np.diag(found.covariance)
    assert diagonal[0::2] == pytest.approx(1.5**2 * of_a + y**2 * t + 0.01e-6, rel=1e-12)
    assert diagonal[1::2] == pytest.approx(4 * of_a + x**2 * t, rel=1e-12)
    cross = np.array([found.covariance[2 * i, 2 * i + 1] for i in range(3)])
    assert cross == pytest.approx(-3 * of_a - x * y * t, rel=1e-12)


def test_two_effects_may_name_a_parameter_alike(tmp_path: Path) -> None:
    text = """
effects:
  - {name: e, parameters: {h: {value: 2, u: 0.1, unit: um}}, equations: {Ex: h}}
  - {name: f, parameters: {h: {value: 3, u: 0.2, unit: um}}, equations: {Ex: h*step(x - 20)}}
"""
    plain = predict(stated(tmp_path, MACHINE), IDS, POINTS)
    found = predict(stated(tmp_path, MACHINE + text), IDS, POINTS)
    more = found.mean - plain.mean
    assert more[0::2] == pytest.approx([2e-3, 5e-3, 5e-3])
    wider = np.diag(found.covariance - plain.covariance)[0::2]
    assert wider == pytest.approx([0.01e-6, 0.05e-6, 0.05e-6])


def test_a_component_of_an_effect_counts_as_one_of_the_machine(tmp_path: Path) -> None:
    table = """{of: x, unit: um, shape: table, at_mm: [0, 40, 80], coefficients: [0, 3, -1],
      covariance: [[0.1, 0, 0], [0, 0.2, 0.1], [0, 0.1, 0.3]], roughness_um2_per_mm3: 1.0e-4}"""
    effect = f"\neffects:\n  - name: e\n    equations: {{Ex: p}}\n    components: {{p: {table}}}\n"
    declared = predict(stated(tmp_path, MACHINE + effect), IDS, POINTS)
    plain = MACHINE.replace("equations: {Ex: a", f"  p: {table}\nequations: {{Ex: p + a")
    own = predict(stated(tmp_path, plain), IDS, POINTS)
    assert declared.mean == pytest.approx(own.mean, rel=1e-12)
    assert declared.covariance == pytest.approx(own.covariance, rel=1e-9)
