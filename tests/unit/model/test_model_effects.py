"""Effects: declared, of a report together, and beyond what they were found on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from effect_tables import table
from model_examples import FloatArray, loaded, part_of, stated
from support import read_components

from mtu_cli.analyses.lengths import predict_lengths
from mtu_cli.analyses.orthogonality import predict_orthogonality
from mtu_cli.analyses.predict_points import predict_points
from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.reports_read import Matrix
from mtu_cli.model.effect_parameters import all_together, effect_warnings, searched_warnings
from mtu_cli.model.effect_ranges import effect_warnings_at
from mtu_cli.model.estimates import Estimates
from mtu_cli.model.fit import estimates_from_fit, estimates_from_report
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import Prediction, predict
from mtu_cli.model.settings import Settings

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


def test_one_parameter_of_a_report(tmp_path: Path) -> None:
    """Of an effect that a report knows in part it says nothing; of a whole one it does."""
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    bare = predicted(loaded(tmp_path, MACHINE), estimates_from_fit(machine, None))
    estimates = reported(tmp_path, machine, together(["backlash-x.lost_motion", "turn.angle"]))
    found = predicted(machine, estimates)
    own = np.array([[0.1, 0, 0], [0, 0.25, 0.03], [0, 0.03, 0.04]]) * np.outer(F, F)
    more = jacobian() @ own @ jacobian().T
    assert found.covariance - bare.covariance == pytest.approx(more, rel=1e-9)


def test_values_of_a_report_win_and_are_told(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    own = predicted(machine, estimates_from_fit(machine, None))
    estimates = reported(tmp_path, machine, together(values=(0, 5, 1)))
    found = predicted(machine, estimates)
    assert (own.mean - found.mean)[0::2] == pytest.approx(2e-3 * DIRECTION, rel=1e-9)
    (warning,) = effect_warnings(machine, estimates.effects, "c.json")
    assert warning.code == "not-used"
    assert "values of machine.yaml not used (backlash-x.lost_motion): those of" in warning.message


def test_effects_that_the_machine_has_not(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE)
    estimates = reported(tmp_path, machine, together())
    bare = predicted(machine, estimates_from_fit(machine, None))
    found = predicted(machine, estimates)
    assert (found.mean == bare.mean).all()
    assert (found.covariance == bare.covariance).all()
    (warning,) = effect_warnings(machine, estimates.effects, "c.json")
    assert warning.code == "not-used"
    assert "backlash-x.lost_motion, turn.angle, turn.shift" in warning.message


def test_old_and_new_effects_in_one_covariance(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS)
    assert all_together(loaded(tmp_path, MACHINE), None) is None
    found = all_together(machine, None, ("backlash-x.lost_motion",), np.array([[7e-6]]))
    assert found is not None
    assert list(found.names) == NAMES
    own = np.array([[7, 0, 0], [0, 0.25, 0.03], [0, 0.03, 0.04]])
    assert found.covariance == pytest.approx(own * np.outer(F, F), rel=1e-12)
    assert found.values == pytest.approx(np.array([2, 5, 1]) * F, rel=1e-12)


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ("{class: [turn, scale-z]}", "scale-z"),
        ("{class: [a, b, turn, c, d, e, f]}", "a, b, c, d, e, f"),
        ("{class: [turn]}", None),
        # What stands there is free.
        ("{class: [turn, 3, {a: b}]}", None),
    ],
)
def test_one_of_a_class_is_told_of(found: str, told: str | None, tmp_path: Path) -> None:
    machine = loaded(tmp_path, MACHINE + EFFECTS + f"    found: {found}\n")
    known = [(item.code, ", ".join(item.facts["others"])) for item in searched_warnings(machine)]
    assert known == ([] if told is None else [("not-separable", told)])


# Declared effects beyond what they were found on.


ONE_EFFECT = """
constants: {z: 127}
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1], covariance: [[0.4, 0], [0, 1.0e-4]], s_repeat: 0.7}
equations: {Ex: a, Ey: 0.5*a}
effects:
"""
ONE = """
  - name: one
    parameters: {p: {value: 2.0, u: 0.3, unit: um}}
    equations: {Ex: p*exp(-time_min/30)}
    seen: {time_min: [0, 100]}
"""
NEAR = np.array([[10.0, 20, 0], [70.0, 12, 0], [40.0, 28, 0]])


def told_of(
    folder: Path, effects: str, covariates: Mapping[str, FloatArray | float], points: FloatArray
) -> list[str]:
    found = effect_warnings_at(stated(folder, ONE_EFFECT + effects), points, covariates)
    assert all(item.code == "outside-effect-range" for item in found)
    return [f"{item.file}: " + " ".join(map(str, item.facts.values())) for item in found]


@pytest.mark.parametrize(
    ("time", "at"),
    [
        (0.0, None),
        (110.0, None),
        (-10.0, None),
        (110.1, "110.1"),
        (-50.0, "-50"),
        (1e6, "1000000"),
        (np.array([50.0, 150.0, -70.0]), "-70"),
    ],
)
def test_a_tenth_of_the_range_is_no_matter(
    tmp_path: Path, time: FloatArray | float, at: str | None
) -> None:
    found = told_of(tmp_path, ONE, {"time_min": time}, NEAR)
    one = f"machine.yaml: effects[0] (one) time_min from 0 to 100 extrapolated to {at}"
    assert found == ([] if at is None else [one])


def test_every_prediction_warns(tmp_path: Path) -> None:
    model = stated(tmp_path, ONE_EFFECT + ONE)
    part = part_of(
        tmp_path,
        """
        features: {A: {x_mm: 0, y_mm: 0}, B: {x_mm: 90, y_mm: 0}, C: {x_mm: 90, y_mm: 90}}
        lengths: [{from: A, to: B}]
        orthogonality: [{id: xy, row: [A, B], column: [B, C]}]
        """,
    )
    settings, far = Settings(trials=1000), {"time_min": 500.0}
    for predicted in (predict_points, predict_lengths, predict_orthogonality):
        found = predicted(model, part, settings, far).warnings
        assert [w.code for w in found].count("outside-effect-range") == 1


def ranges_of(**covariates: FloatArray) -> dict[str, list[float]]:
    """The ranges of three parts with two features, one of which was not measured."""
    repeats = np.array([[1, 1], [1, 1], [1, 0]])
    places = np.array([[10.0, 5.0, np.nan], [1000 / 3, 5.0, np.nan]])
    own = table(3, 2, axes=("x",), places=places, covariates=covariates, repeats=repeats)
    return own.ranges(["x", "z", "load", "time_min"])


def test_ranges_are_those_of_the_measured_cells() -> None:
    """A column in its smallest shape, positions, and what the equations do not use."""
    time = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 99.0]])
    found = ranges_of(time_min=time, load=np.array([[7.0]]), sequence=np.arange(3.0)[:, None])
    assert found == {"x": [10.0, 333.3334], "load": [7.0, 7.0], "time_min": [0.0, 4.0]}


@pytest.mark.parametrize(
    "values",
    [
        [1234567.0, 1234571.0, 1234587.0],
        [1763770000.0, 1763771234.567, 1763773600.0],
        [19.8, 22.0, 26.1],
        [-1 / 3, 0.0, 2 / 3],
        [1e15, 1e15 + 1, 1e15 + 2],
        [1e-9 / 3, 0.0, 2e-9],
        [7.0, 7.0, 7.0],
        # A range, or a millionth of it, that is no number: its ends are as they are.
        [0.0, 5e-321, 1e-320],
        [-1e308, 0.0, 1e308],
    ],
)
def test_what_was_seen_lies_within_its_range(values: list[float]) -> None:
    """Rounded outward, and by the range: counters and seconds since 1970 have few digits of it."""
    low, high = ranges_of(load=np.array(values)[:, None])["load"]
    slack = 2e-6 * (max(values) - min(values))
    assert min(values) - slack <= low <= min(values)
    assert max(values) <= high <= max(values) + slack


# The effects block: what close-loop found, added to the equations.


DECLARED = """
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
PLACES = np.array([[10.0, 20, 0], [70.0, -5, 0], [40.0, 8, 0]])
NAMED = ["1", "2", "3"]


def test_parameters_with_covariance(tmp_path: Path) -> None:
    plain = predict(stated(tmp_path, DECLARED), NAMED, PLACES)
    found = predict(stated(tmp_path, DECLARED + EFFECT), NAMED, PLACES, {"dir_x": DIRECTION})
    J = np.zeros((6, 2))
    J[0::2, 0], J[0::2, 1], J[1::2, 0] = DIRECTION, PLACES[:, 0] - 30, 0.5
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


def test_two_effects_may_name_a_parameter_alike(tmp_path: Path) -> None:
    text = """
effects:
  - {name: e, parameters: {h: {value: 2, u: 0.1, unit: um}}, equations: {Ex: h}}
  - {name: f, parameters: {h: {value: 3, u: 0.2, unit: um}}, equations: {Ex: h*step(x - 20)}}
"""
    plain = predict(stated(tmp_path, DECLARED), NAMED, PLACES)
    found = predict(stated(tmp_path, DECLARED + text), NAMED, PLACES)
    more = found.mean - plain.mean
    assert more[0::2] == pytest.approx([2e-3, 5e-3, 5e-3])
    wider = np.diag(found.covariance - plain.covariance)[0::2]
    assert wider == pytest.approx([0.01e-6, 0.05e-6, 0.05e-6])


def test_a_component_of_an_effect_counts_as_one_of_the_machine(tmp_path: Path) -> None:
    table = """{of: x, unit: um, shape: table, at_mm: [0, 40, 80], coefficients: [0, 3, -1],
      covariance: [[0.1, 0, 0], [0, 0.2, 0.1], [0, 0.1, 0.3]], roughness_um2_per_mm3: 1.0e-4}"""
    effect = f"\neffects:\n  - name: e\n    equations: {{Ex: p}}\n    components: {{p: {table}}}\n"
    declared = predict(stated(tmp_path, DECLARED + effect), NAMED, PLACES)
    plain = DECLARED.replace("equations: {Ex: a", f"  p: {table}\nequations: {{Ex: p + a")
    own = predict(stated(tmp_path, plain), NAMED, PLACES)
    assert declared.mean == pytest.approx(own.mean, rel=1e-12)
    assert declared.covariance == pytest.approx(own.covariance, rel=1e-9)
