"""The design matrix against the papers' equations, written out by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from model_examples import stated

from mtu_cli.findings import InputError
from mtu_cli.model.machine_model import MachineModel, design
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray

Values = dict[str, FloatArray]
Equations = Callable[[Values, FloatArray], FloatArray]

ARCSEC = np.pi / 180 / 3600


CMM = {
    "pos_x": "x", "ry_x": "y", "rz_x": "z", "pos_y": "y", "rx_y": "x", "rz_y": "z",
    "pos_z": "z", "rx_z": "x", "ry_z": "y", "yaw_x": "x", "pitch_x": "x", "roll_x": "x",
    "yaw_y": "y", "pitch_y": "y", "roll_y": "y", "yaw_z": "z", "pitch_z": "z",
    "ort_xy": None, "ort_xz": None, "ort_yz": None,
}  # fmt: skip
ARMS = {"Y34": (410.0, 0.4), "X23": (-220.0, 0.3), "Z12": (310.0, 0.5), "Z45": (150.0, 0.2)}
CMM_EQUATIONS = """
  Ex: pos_x + ry_x + rz_x + (ort_xy + yaw_x)*Y34 + (ort_xz + pitch_x + yaw_z + roll_y)*(-z - Z45) + roll_y*Z12
  Ey: pos_y + rx_y + rz_y + (ort_xy + yaw_y)*(X23 + x) - pitch_y*Z12 - (ort_yz + roll_x + pitch_y + pitch_z)*(-z - Z45)
  Ez: pos_z + rx_z + ry_z - roll_y*(X23 + x) - (roll_x + pitch_y)*Y34
"""  # noqa: E501  # the paper's equations, a line each


def bridge(v: Values, place: FloatArray, arms: dict[str, float] | None = None) -> FloatArray:
    """Valdes, Di Giacomo & Paziani, eqs. (1)-(3)."""
    c = {name: value for name, (value, _) in ARMS.items()} | (arms or {})
    x, z = place[:, 0], place[:, 2]
    down = -z - c["Z45"]
    Ex = v["pos_x"] + v["ry_x"] + v["rz_x"] + (v["ort_xy"] + v["yaw_x"]) * c["Y34"]
    Ex = Ex + (v["ort_xz"] + v["pitch_x"] + v["yaw_z"] + v["roll_y"]) * down
    Ex = Ex + v["roll_y"] * c["Z12"]
    Ey = v["pos_y"] + v["rx_y"] + v["rz_y"] + (v["ort_xy"] + v["yaw_y"]) * (c["X23"] + x)
    Ey = Ey - v["pitch_y"] * c["Z12"]
    Ey = Ey - (v["ort_yz"] + v["roll_x"] + v["pitch_y"] + v["pitch_z"]) * down
    Ez = v["pos_z"] + v["rx_z"] + v["ry_z"] - v["roll_y"] * (c["X23"] + x)
    Ez = Ez - (v["roll_x"] + v["pitch_y"]) * c["Y34"]
    return np.column_stack([Ex, Ey, Ez]).ravel()


def is_angle(name: str) -> bool:
    return name[0] in "ea" or name.startswith(("yaw", "pitch", "roll", "ort"))


def text_of(components: dict[str, str | None], known: dict[str, list[float]]) -> str:
    lines = ["components:"]
    for name, of in components.items():
        unit = "arcsec" if is_angle(name) else "um"
        axis = "" if of is None else f"of: {of}, "
        lines.append(f"  {name}: {{{axis}unit: {unit}, coefficients: {known[name]!r}}}")
    return "\n".join(lines) + "\n"


def values_of(
    components: dict[str, str | None], known: dict[str, list[float]], place: FloatArray
) -> Values:
    """Every component at every place, in mm or rad, by Horner's rule."""
    found = {}
    for name, of in components.items():
        p = np.zeros(len(place)) if of is None else place[:, "xyz".index(of)]
        value = np.zeros(len(place))
        for coefficient in reversed(known[name]):
            value = value * p + coefficient
        found[name] = value * (ARCSEC if is_angle(name) else 1e-3)
    return found


def drawn(components: dict[str, str | None], rng: np.random.Generator) -> dict[str, list[float]]:
    """Coefficients of degree 0 to 3."""
    known = {}
    for i, (name, of) in enumerate(components.items()):
        count = 1 if of is None else (2, 1, 3, 4)[i % 4]
        known[name] = [float(rng.normal() / 50**power) for power in range(count)]
    return known


def check_against(
    model: MachineModel,
    components: dict[str, str | None],
    known: dict[str, list[float]],
    equations: Equations,
    place: FloatArray,
) -> None:
    found = design(model, place, {})
    by_hand = equations(values_of(components, known, place), place)
    assert found.mean == pytest.approx(by_hand, rel=1e-12, abs=1e-18)
    assert found.remainder == pytest.approx(np.zeros(len(by_hand)), abs=0)
    for t, term in enumerate(model.terms):
        name = term.estimate.name
        factor = ARCSEC if is_angle(name) else 1e-3
        for power in range(len(known[name])):
            one = {other: [0.0] for other in components} | {name: [0.0] * power + [1.0]}
            column = equations(values_of(components, one, place), place) / factor
            J = found.J[:, model.columns[t]][:, power]
            assert pytest.approx(column, rel=1e-12, abs=1e-12) == J, (name, power)
            if power == 0:
                assert found.levers[:, t] == pytest.approx(column, rel=1e-12, abs=1e-12)


def cmm(folder: Path, known: dict[str, list[float]]) -> MachineModel:
    arms = ", ".join(f"{name}: {{value: {v}, u: {u}}}" for name, (v, u) in ARMS.items())
    text = f"constants: {{{arms}}}\n" + text_of(CMM, known) + "equations:" + CMM_EQUATIONS
    return stated(folder, text)


def test_moving_bridge_cmm(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    known = drawn(CMM, rng)
    place = rng.uniform(-300, 400, (6, 3))
    model = cmm(tmp_path, known)
    assert model.axes == ("x", "y", "z")
    check_against(model, CMM, known, bridge, place)


def test_offsets_with_uncertainty_propagate(tmp_path: Path) -> None:
    """Abbe arms by differences of the equations by hand."""
    rng = np.random.default_rng(3)
    known = drawn(CMM, rng)
    place = rng.uniform(-300, 400, (4, 3))
    values = values_of(CMM, known, place)
    result = predict(cmm(tmp_path, known), list("abcd"), place)
    by_hand = np.zeros((12, 12))
    for name, (value, u) in ARMS.items():
        h = 1e-3
        high = bridge(values, place, {name: value + h})
        slope = (high - bridge(values, place, {name: value - h})) / (2 * h)
        by_hand += np.outer(slope, slope) * u**2
    assert result.covariance == pytest.approx(by_hand, rel=1e-7, abs=1e-18)
    assert np.diag(by_hand).min() >= 0
    assert np.diag(by_hand).max() > 0
    assert result.independent_variance == pytest.approx(np.diag(by_hand), rel=1e-7, abs=1e-18)
    assert np.isinf(result.variance(np.eye(12)).dof).all()


def test_a_constant_in_a_nonlinear_place(tmp_path: Path) -> None:
    model = stated(
        tmp_path,
        """
        constants: {P: {value: 25.0, u: 0.01}, phase: {value: 0.3, u: 0.02}}
        components: {a: {of: x, unit: um, coefficients: [3.0, 0.5]}}
        equations: {Ex: a*sin(2*pi*x/P + phase)}
        """,
    )
    x = np.array([7.0, 60.0])
    place = np.column_stack([x, x * 0, x * 0])
    a = (3.0 + 0.5 * x) * 1e-3
    angle = 2 * np.pi * x / 25.0 + 0.3
    of_P = a * np.cos(angle) * (-2 * np.pi * x / 25.0**2) * 0.01
    of_phase = a * np.cos(angle) * 0.02
    wanted = np.outer(of_P, of_P) + np.outer(of_phase, of_phase)
    found = predict(model, ["1", "2"], place).covariance
    # The slope is taken over -+u: off by u^2/6 of the third derivative, below 1e-3 here.
    assert found == pytest.approx(wanted, rel=1e-3)


# Covariates, fixed positions and degrees of the design matrix, and what it refuses.


COVARIATES = """
components:
  a: {of: x, unit: um, coefficients: [1.0, 0.1]}
  b: {of: y, unit: um, degree: 0, coefficients: [5.0]}
equations: {Ex: a*dir_x + b*(T_spindle_degC - 20) + 0.001*T_spindle_degC, Ey: b}
"""


def test_covariates_as_arrays_and_as_numbers(tmp_path: Path) -> None:
    model = stated(tmp_path, COVARIATES)
    assert model.covariates() == ("T_spindle_degC", "dir_x")
    place = np.array([[10.0, 1, 0], [20, 2, 0], [30, 3, 0]])
    direction, T = np.array([1.0, -1, 1]), np.array([20.0, 21.5, 26.0])
    Ex = (1 + 0.1 * place[:, 0]) * 1e-3 * direction + 5e-3 * (T - 20) + 1e-3 * T
    given = predict(model, list("abc"), place, {"dir_x": direction, "T_spindle_degC": T})
    assert given.mean[0::2] == pytest.approx(Ex, rel=1e-14)
    assert given.mean[1::2] == pytest.approx(np.full(3, 5e-3))
    one = predict(model, ["b"], place[1:2], {"dir_x": -1.0, "T_spindle_degC": 21.5, "spare": 3.0})
    assert one.mean[0] == pytest.approx(Ex[1], rel=1e-14)


def test_a_position_constant_fixes_the_coordinate(tmp_path: Path) -> None:
    text = """
    constants: {z: 127.0}
    components:
      e: {of: x, unit: arcsec, coefficients: [2.0, 0.1]}
      pz: {of: z, unit: um, coefficients: [1.0, 0.01]}
    equations: {Ex: z*e + pz}
    """
    model = stated(tmp_path, text)
    place = np.array([[10.0, 0, np.nan], [10.0, 0, 55.0]])
    wanted = 127.0 * (2 + 0.1 * 10) * ARCSEC + (1 + 1.27) * 1e-3
    assert predict(model, ["a", "b"], place).mean == pytest.approx([wanted, wanted], rel=1e-14)


def test_a_fixed_position_with_uncertainty_propagates(tmp_path: Path) -> None:
    model = stated(
        tmp_path,
        """
        constants: {z: {value: 127.0, u: 0.5}}
        components:
          e: {of: x, unit: mrad, coefficients: [2.0]}
          pz: {of: z, unit: um, coefficients: [1.0, 0.01]}
        equations: {Ex: z*e + pz}
        """,
    )
    found = predict(model, ["a"], np.array([[10.0, 0, np.nan]]))
    assert found.variance(np.eye(1)).total[0] == pytest.approx((0.5 * (2e-3 + 1e-5)) ** 2)


def test_an_infinite_equation_is_an_input_error(tmp_path: Path) -> None:
    text = """
    components: {a: {of: x, unit: um, coefficients: [1.0, 0.1]}}
    equations: {Ex: a*y/x}
    """
    with pytest.raises(InputError, match="no finite value at x=0, y=5") as error:
        predict(stated(tmp_path, text), ["a", "b"], np.array([[1.0, 5, 0], [0.0, 5, 0]]))
    assert "defined at every feature" in str(error.value)
