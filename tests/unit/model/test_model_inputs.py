"""Covariates, fixed positions and degrees of the design matrix, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import stated

from mtu_cli.findings import InputError
from mtu_cli.model.prediction import predict

ARCSEC = np.pi / 180 / 3600

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
