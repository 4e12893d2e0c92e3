"""Effects: declared, of a report together, and beyond what they were found on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import loaded, part_of, stated
from support import read_components

from mtu_cli.analyses.lengths import predict_lengths
from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.analyses.predict_points import predict_points
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.reports_read import Matrix
from mtu_cli.model.effect_parameters import effect_warnings, joint_effects, searched_warnings
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.features import guess_warnings
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

MACHINE = """
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
equations: {Ex: a, Ey: 0.5*a}
"""
EFFECTS = """
effects:
  - name: backlash-x
    parameters: {lost_motion: {value: 2.0, u: 0.3, unit: um}}
    equations: {Ex: lost_motion*dir_x}
  - name: turn
    parameters: {angle: {value: 5.0, u: 0.5, unit: arcsec}, shift: {value: 1.0, u: 0.2, unit: um}}
    covariance: [[0.25, 0.03], [0.03, 0.04]]
    equations: {Ex: -angle*(y - 3), Ey: angle*x + shift}
"""
NAMES = ["backlash-x.lost_motion", "turn.angle", "turn.shift"]
C = [[0.1, 0.05, -0.01], [0.05, 0.3, 0.02], [-0.01, 0.02, 0.05]]
UNITS = ["um", "arcsec", "um"]
F = np.array([1e-3, np.pi / 648000, 1e-3])
POINTS = np.array([[10.0, 20, 0], [70.0, -5, 0], [40.0, 8, 0]])
DIRECTION = np.array([1.0, -1, 1])


def jacobian() -> FloatArray:
    J = np.zeros((6, 3))
    J[0::2, 0], J[0::2, 1] = DIRECTION, -(POINTS[:, 1] - 3)
    J[1::2, 1], J[1::2, 2] = POINTS[:, 0], 1
    return J


def reported(folder: Path, machine: LoadedMachine, effects: dict[str, Any]) -> Estimates:
    path = folder / "c.json"
    document = {
        "schema": "mtu/fit-components/1",
        "results": {"components": {}, "effects": effects},
    }
    path.write_text(json.dumps(document))
    return estimates_from_report(machine, read_components(path))


def together(
    names: list[str] = NAMES, covariance: Matrix = C, values: tuple[float, ...] = (2, 5, 1)
) -> dict[str, Any]:
    rows = [NAMES.index(name) for name in names if name in NAMES]
    return {
        "parameters": names,
        "units": [UNITS[row] for row in rows],
        "values": [values[row] for row in rows],
        "covariance": [[covariance[i][j] for j in rows] for i in rows],
    }


def predicted(machine: LoadedMachine, estimates: Estimates) -> Prediction:
    ids = ["1", "2", "3"]
    return predict(build_model(machine, estimates), ids, POINTS, {"dir_x": DIRECTION})


def test_the_joint_covariance_of_a_report_counts(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    bare = predicted(loaded(tmp_path, MACHINE), estimates_from_fit(machine, None))
    estimates = reported(tmp_path, machine, together())
    found = predicted(machine, estimates)
    J = jacobian()
    assert found.mean - bare.mean == pytest.approx(J @ (np.array([2.0, 5, 1]) * F), rel=1e-9)
    more = J @ (np.array(C) * np.outer(F, F)) @ J.T
    assert found.covariance - bare.covariance == pytest.approx(more, rel=1e-9)
    A = np.random.default_rng(0).normal(size=(4, 6))
    variance = found.variance(A)
    assert variance.total == pytest.approx(
        bare.variance(A).total + np.diag(A @ more @ A.T), rel=1e-9
    )
    assert variance.passes == pytest.approx(bare.variance(A).passes)
    assert effect_warnings(machine, estimates.effects, "c.json") == []


def test_values_of_a_report_win_and_are_told(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    own = predicted(machine, estimates_from_fit(machine, None))
    estimates = reported(tmp_path, machine, together(values=(0, 5, 1)))
    found = predicted(machine, estimates)
    assert (own.mean - found.mean)[0::2] == pytest.approx(2e-3 * DIRECTION, rel=1e-9)
    (warning,) = effect_warnings(machine, estimates.effects, "c.json")
    assert warning.code == "not-used"
    assert "values of machine.yaml not used (backlash-x.lost_motion): those of" in warning.message


def test_old_and_new_effects_in_one_covariance(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    assert joint_effects(loaded(tmp_path, MACHINE), None, (), np.zeros((0, 0))) is None
    found = joint_effects(machine, None, ("backlash-x.lost_motion",), np.array([[7e-6]]))
    assert found is not None
    assert list(found.names) == NAMES
    own = np.array([[7, 0, 0], [0, 0.25, 0.03], [0, 0.03, 0.04]])
    assert found.covariance == pytest.approx(own * np.outer(F, F), rel=1e-12)
    assert found.values == pytest.approx(np.array([2, 5, 1]) * F, rel=1e-12)


def test_one_of_a_class_is_told_of(tmp_path: Path) -> None:
    for found, others in (("[turn, scale-z]", ["scale-z"]), ("[turn]", None), ("3", None)):
        machine = loaded(tmp_path, MACHINE + EFFECTS + f"    found: {{class: {found}}}\n")
        known = [item.facts["others"] for item in searched_warnings(machine)]
        assert known == ([] if others is None else [others])


# Declared effects beyond what they were found on.


ONE_EFFECT = (
    MACHINE
    + """
effects:
  - name: one
    parameters: {p: {value: 2.0, u: 0.3, unit: um}}
    equations: {Ex: p*exp(-time_min/30)}
    seen: {time_min: [0, 100]}
"""
)


@pytest.mark.parametrize(
    ("time", "at"),
    [
        (110.0, None),
        (-10.0, None),
        (110.1, "110.1"),
        (-50.0, "-50"),
        (np.array([50.0, 150.0, -70.0]), "-70"),
    ],
)
def test_a_tenth_of_the_range_is_no_matter(
    tmp_path: Path, time: FloatArray | float, at: str | None
) -> None:
    found = guess_warnings(stated(tmp_path, ONE_EFFECT), POINTS, {"time_min": time})
    said = "the data of one have time_min from 0 to 100: extrapolated to "
    assert [said in item.message and item.message.endswith(str(at)) for item in found] == (
        [] if at is None else [True]
    )


def test_every_prediction_warns(tmp_path: Path) -> None:
    model = stated(tmp_path, ONE_EFFECT)
    part = part_of(
        tmp_path,
        """
        features: {A: {x_mm: 0, y_mm: 0}, B: {x_mm: 90, y_mm: 0}, C: {x_mm: 90, y_mm: 90}}
        lengths: [{from: A, to: B}]
        orthogonality: [{id: xy, row: [A, B], column: [B, C]}]
        """,
    )
    settings, far = Settings(trials=1000), {"time_min": 500.0}
    for command in (predict_points, predict_lengths, predict_orthogonality):
        found = command(model, part, settings, far).warnings
        assert [w.code for w in found].count("outside-effect-range") == 1


# The effects block: what close-loop found, added to the equations.


DECLARED = """
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
  t: {unit: urad, coefficients: [4.0], covariance: [[0.2]]}
equations: {Ex: a - y*t, Ey: x*t}
"""
PLACES = np.array([[10.0, 20, 0], [70.0, -5, 0], [40.0, 8, 0]])
NAMED = ["1", "2", "3"]


def test_an_effect_in_a_component_adds_to_its_lever_arm(tmp_path: Path) -> None:
    """A thermal stretch of a component: Ex gains 0.5 a, whose uncertainty is a's own."""
    text = """
effects:
  - name: stretch
    parameters: {k: {value: 1.0, u: 0.1, unit: um}}
    equations: {Ex: 0.5*a + k, Ey: -2*a}
"""
    plain = predict(stated(tmp_path, DECLARED), NAMED, PLACES)
    found = predict(stated(tmp_path, DECLARED + text), NAMED, PLACES)
    a = (1 + 0.1 * PLACES[:, 0]) * 1e-3
    assert found.mean[0::2] - plain.mean[0::2] == pytest.approx(0.5 * a + 1e-3, rel=1e-9)
    assert found.mean[1::2] - plain.mean[1::2] == pytest.approx(-2 * a, rel=1e-9)
    x, y = PLACES[:, 0], PLACES[:, 1]
    of_a = (0.4 + 1e-4 * x**2 + 0.49) * 1e-6
    t = 0.2e-12
    diagonal = np.diag(found.covariance)
    assert diagonal[0::2] == pytest.approx(1.5**2 * of_a + y**2 * t + 0.01e-6, rel=1e-12)
    assert diagonal[1::2] == pytest.approx(4 * of_a + x**2 * t, rel=1e-12)
    cross = np.array([found.covariance[2 * i, 2 * i + 1] for i in range(3)])
    assert cross == pytest.approx(-3 * of_a - x * y * t, rel=1e-12)


def test_a_component_of_an_effect_counts_as_one_of_the_machine(tmp_path: Path) -> None:
    table = """{of: x, unit: um, shape: table, at_mm: [0, 40, 80], coefficients: [0, 3, -1],
      covariance: [[0.1, 0, 0], [0, 0.2, 0.1], [0, 0.1, 0.3]], roughness_um2_per_mm3: 1.0e-4}"""
    effect = f"\neffects:\n  - name: e\n    equations: {{Ex: p}}\n    components: {{p: {table}}}\n"
    declared = predict(stated(tmp_path, DECLARED + effect), NAMED, PLACES)
    plain = DECLARED.replace("equations: {Ex: a", f"  p: {table}\nequations: {{Ex: p + a")
    own = predict(stated(tmp_path, plain), NAMED, PLACES)
    assert declared.mean == pytest.approx(own.mean, rel=1e-12)
    assert declared.covariance == pytest.approx(own.covariance, rel=1e-9)
