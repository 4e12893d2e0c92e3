"""Errors along one axis that a machine file states, against what it predicts with and without."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import loaded
from model_examples import stated as with_estimates

from mtu_cli.findings import InputError
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.stated_errors import stated

MACHINE = """
axes: {x: {travel_mm: [0, 500]}}
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]]}
  b: {of: x, unit: um}
  s: {of: x, unit: um, coefficients: [2.0]}
  t: {unit: urad, coefficients: [4.0], covariance: [[0.2]]}
equations: {Ex: a + b*0, Ey: s + x*t}
"""
EFFECTS = """
effects:
  - name: backlash
    parameters: {h: {value: 2.0, u: 0.3, unit: um}, g: {value: 5.0, u: 0.5, unit: urad}}
    covariance: [[0.09, -0.06], [-0.06, 0.25]]
    equations: {Ex: h*dir_x + (x - 30)*g}
  - name: tilt
    parameters: {q: {value: 2.0, u: 0.3, unit: urad/m}}
    equations: {Ex: q*x*y}
"""
PLACES = np.array([-20.0, 0.0, 35.0, 480.0])


def along_x(folder: Path, effects: str) -> Prediction:
    """Both directions at all places."""
    text = MACHINE.replace("b*0", "0*x").replace("  b: {of: x, unit: um}\n", "") + effects
    points = np.column_stack([np.tile(PLACES, 2), np.zeros((8, 2))])
    way = {"dir_x": np.repeat([1.0, -1.0], 4)}
    return predict(with_estimates(folder, text), [str(i) for i in range(8)], points, way)


def test_an_effect_is_what_it_adds_to_the_prediction(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    effect = stated(machine, "backlash")
    found = effect.errors_at(machine, PLACES)
    only = EFFECTS[: EFFECTS.index("  - name: tilt")]
    more, plain = along_x(tmp_path, only), along_x(tmp_path, "")
    assert found.values.ravel() == pytest.approx((more.mean - plain.mean)[0::2], rel=1e-12)
    added = (more.covariance - plain.covariance)[0::2, 0::2]
    assert found.covariance == pytest.approx(added, rel=1e-9, abs=1e-18)
    assert (effect.axis, found.turns, effect.angle) == ("x", True, False)


def test_a_component_is_what_is_predicted_with_it_alone(tmp_path: Path) -> None:
    machine, plain = loaded(tmp_path, MACHINE), along_x(tmp_path, "")
    found = stated(machine, "a").errors_at(machine, PLACES)
    assert found.values.ravel() == pytest.approx(plain.mean[0::2])
    assert found.covariance == pytest.approx(plain.covariance[0::2, 0::2])
    assert (stated(machine, "a").output, stated(machine, "s").output) == ("x", "y")
    assert stated(machine, "a").default_positions(machine) == pytest.approx(np.arange(0, 501, 50))
    endless = loaded(tmp_path, MACHINE.replace("axes: {x: {travel_mm: [0, 500]}}", ""))
    with pytest.raises(InputError, match="the travel of x"):
        stated(endless, "a").default_positions(endless)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("t", "t is a constant"),
        ("tilt", "depends on x, y"),
        ("backlsh", "did you mean 'backlash'"),
        ("b", "an estimate of b"),
    ],
)
def test_what_makes_no_table_of_an_axis(tmp_path: Path, name: str, words: str) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    with pytest.raises(InputError, match=words):
        stated(machine, name).errors_at(machine, PLACES)
