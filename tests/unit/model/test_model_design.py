"""The design matrix against the papers' equations, written out by hand."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import loaded, stated
from thermal_machines import IDS, POINTS, SENSORS, angle, line, machine

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.files.reports_read import ThermalReport, read_report
from mtu_cli.findings import InputError
from mtu_cli.model.features import temperature_warnings
from mtu_cli.model.fit import thermal_from_machine_file, thermal_from_report
from mtu_cli.model.machine_model import MachineModel, design, drift_terms, temperatures
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

Values = dict[str, FloatArray]

ARCSEC = np.pi / 180 / 3600


CMM = {
    "pos_x": "x", "ry_x": "y", "rz_x": "z", "pos_y": "y", "rx_y": "x", "rz_y": "z",
    "pos_z": "z", "rx_z": "x", "ry_z": "y", "yaw_x": "x", "pitch_x": "x", "roll_x": "x",
    "yaw_y": "y", "pitch_y": "y", "roll_y": "y", "yaw_z": "z", "pitch_z": "z",
    "ort_xy": None, "ort_xz": None, "ort_yz": None,
}  # fmt: skip
ARMS = {"Y34": (410.0, 0.4), "X23": (-220.0, 0.3), "Z12": (310.0, 0.5), "Z45": (150.0, 0.2)}
# Valdes, Di Giacomo & Paziani, eqs. (1)-(3).
EQUATIONS = {
    "Ex": "pos_x + ry_x + rz_x + (ort_xy + yaw_x)*Y34"
    " + (ort_xz + pitch_x + yaw_z + roll_y)*(-z - Z45) + roll_y*Z12",
    "Ey": "pos_y + rx_y + rz_y + (ort_xy + yaw_y)*(X23 + x) - pitch_y*Z12"
    " - (ort_yz + roll_x + pitch_y + pitch_z)*(-z - Z45)",
    "Ez": "pos_z + rx_z + ry_z - roll_y*(X23 + x) - (roll_x + pitch_y)*Y34",
}


def bridge(v: Values, place: FloatArray) -> FloatArray:
    """What Python makes of the equations."""
    given = {name: value for name, (value, _) in ARMS.items()} | v
    given |= {"x": place[:, 0], "z": place[:, 2]}
    return np.column_stack([eval(text, {}, given) for text in EQUATIONS.values()]).ravel()


def is_angle(name: str) -> bool:
    return name[0] in "ea" or name.startswith(("yaw", "pitch", "roll", "ort"))


def values_of(known: dict[str, list[float]], place: FloatArray) -> Values:
    """Every component at every place, in mm or rad, by Horner's rule."""
    found = {}
    for name, of in CMM.items():
        p = np.zeros(len(place)) if of is None else place[:, "xyz".index(of)]
        value = np.zeros(len(place))
        for coefficient in reversed(known[name]):
            value = value * p + coefficient
        found[name] = value * (ARCSEC if is_angle(name) else 1e-3)
    return found


def drawn(rng: np.random.Generator) -> dict[str, list[float]]:
    """Coefficients of degree 0 to 3."""
    known = {}
    for i, (name, of) in enumerate(CMM.items()):
        count = 1 if of is None else (2, 1, 3, 4)[i % 4]
        known[name] = [float(rng.normal() / 50**power) for power in range(count)]
    return known


def cmm(folder: Path, known: dict[str, list[float]]) -> MachineModel:
    arms = ", ".join(f"{name}: {{value: {v}, u: {u}}}" for name, (v, u) in ARMS.items())
    lines = [f"constants: {{{arms}}}", "components:"]
    for name, of in CMM.items():
        unit = "arcsec" if is_angle(name) else "um"
        axis = "" if of is None else f"of: {of}, "
        lines.append(f"  {name}: {{{axis}unit: {unit}, coefficients: {known[name]!r}}}")
    lines += ["equations:", *(f"  {axis}: {text}" for axis, text in EQUATIONS.items())]
    return stated(folder, "\n".join(lines))


def test_moving_bridge_cmm(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    known = drawn(rng)
    place = rng.uniform(-300, 400, (6, 3))
    model = cmm(tmp_path, known)
    assert model.axes == ("x", "y", "z")
    found = design(model, place, {})
    by_hand = bridge(values_of(known, place), place)
    assert found.mean == pytest.approx(by_hand, rel=1e-12, abs=1e-18)
    assert found.remainder == pytest.approx(np.zeros(len(by_hand)), abs=0)
    for t, term in enumerate(model.terms):
        name = term.estimate.name
        factor = ARCSEC if is_angle(name) else 1e-3
        for power in range(len(known[name])):
            one = {other: [0.0] for other in CMM} | {name: [0.0] * power + [1.0]}
            column = bridge(values_of(one, place), place) / factor
            J = found.J[:, model.columns[t]][:, power]
            assert pytest.approx(column, rel=1e-12, abs=1e-12) == J, (name, power)
            if power == 0:
                assert found.levers[:, t] == pytest.approx(column, rel=1e-12, abs=1e-12)


def test_constants_with_uncertainty_propagate(tmp_path: Path) -> None:
    """Also in a nonlinear place, and in both axes at once."""
    model = stated(
        tmp_path,
        """
        constants: {P: {value: 25.0, u: 0.01}, phase: {value: 0.3, u: 0.02}}
        components: {a: {of: x, unit: um, coefficients: [3.0, 0.5]}}
        equations: {Ex: a*sin(2*pi*x/P + phase), Ey: 2*a*phase}
        """,
    )
    x = np.array([7.0, 60.0])
    place = np.column_stack([x, x * 0, x * 0])
    a = (3.0 + 0.5 * x) * 1e-3
    angle = 2 * np.pi * x / 25.0 + 0.3
    of_P = np.column_stack([a * np.cos(angle) * (-2 * np.pi * x / 25.0**2) * 0.01, 0 * x]).ravel()
    of_phase = np.column_stack([a * np.cos(angle) * 0.02, 2 * a * 0.02]).ravel()
    wanted = np.outer(of_P, of_P) + np.outer(of_phase, of_phase)
    found = predict(model, ["1", "2"], place)
    # The slope is taken over -+u: off by u^2/6 of the third derivative, below 1e-3 here.
    assert found.covariance == pytest.approx(wanted, rel=1e-3)
    assert found.independent_variance == pytest.approx(np.diag(wanted), rel=1e-3)
    assert np.isinf(found.variance(np.eye(4)).dof).all()


def test_an_uncertain_lever_arm_of_an_uncertain_angle(tmp_path: Path) -> None:
    """Var(c a) = u(c)^2 u(a)^2 where both are 0 but for their uncertainties (JCGM 100, 5.1.2)."""
    model = stated(
        tmp_path,
        """
        constants: {c: {value: 0, u: 20}}
        components: {a: {unit: mrad, coefficients: [0], covariance: [[0.09]]}}
        equations: {Ex: c*a}
        """,
    )
    found = predict(model, ["1", "2"], np.zeros((2, 3)))
    assert found.covariance == pytest.approx(np.full((2, 2), (20 * 0.3e-3) ** 2), rel=1e-9)


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


def test_a_position_constant_fixes_the_coordinate_and_propagates(tmp_path: Path) -> None:
    text = """
    constants: {z: {value: 127.0, u: 0.5}}
    components:
      e: {of: x, unit: arcsec, coefficients: [2.0, 0.1]}
      pz: {of: z, unit: um, coefficients: [1.0, 0.01]}
    equations: {Ex: z*e + pz}
    """
    place = np.array([[10.0, 0, np.nan], [10.0, 0, 55.0]])
    found, e = predict(stated(tmp_path, text), ["a", "b"], place), (2 + 0.1 * 10) * ARCSEC
    wanted = 127.0 * e + (1 + 1.27) * 1e-3
    assert found.mean == pytest.approx([wanted, wanted], rel=1e-14)
    assert found.variance().total == pytest.approx((0.5 * (e + 1e-5)) ** 2)


def test_an_infinite_equation_is_an_input_error(tmp_path: Path) -> None:
    text = """
    components: {a: {of: x, unit: um, coefficients: [1.0, 0.1]}}
    equations: {Ex: a*y/x}
    """
    with pytest.raises(InputError, match="no finite value at x=0, y=5") as error:
        predict(stated(tmp_path, text), ["a", "b"], np.array([[1.0, 5, 0], [0.0, 5, 0]]))
    assert "defined at every feature" in str(error.value)


# Thermal models of components: from files and reports, as terms of a machine, and warnings.


UM = 1e-3
AT = {"T_a_degC": 23.0, "T_b_degC": 19.0, "T_c_degC": 26.5}
EACH = {
    "T_a_degC": np.array([20.0, 21.0, 23.5, 26.0]),
    "T_b_degC": np.array([20.0, 19.0, 24.0, 22.0]),
    "T_c_degC": np.array([18.0, 20.0, 20.5, 25.0]),
}


def by_hand(at: dict[str, FloatArray]) -> FloatArray:
    """Ex, Ey of the machine, its components drifting, written out."""
    x, y = POINTS[:, 0], POINTS[:, 1]
    a, b, c = (at[name] - 20 for name in SENSORS)
    px = (1.0 + 0.02 * x + (1.5 + 0.01 * x) * a + (-0.8 + 0.004 * x) * b) * UM
    py = (-2.0 + 0.01 * y + 1e-5 * y**2) * UM
    yaw = (0.5 + 0.01 * y + 2.0 * b - 1.0 * c) * ARCSEC
    ort = 3.0 * ARCSEC
    return np.column_stack([px + y * yaw - y * ort, py - x * yaw + 0.5 * px]).ravel()


@pytest.mark.parametrize("at", [AT, EACH], ids=["one room", "a room a point"])
def test_predictions_are_the_equations_with_drifting_components(
    tmp_path: Path, at: dict[str, FloatArray | float]
) -> None:
    model = machine(tmp_path, line(), angle())
    expected = by_hand({name: np.broadcast_to(value, 4) for name, value in at.items()})
    found = predict(model, IDS, POINTS, at)
    assert found.mean == pytest.approx(expected, rel=1e-12)
    rows = design(model, POINTS, at)
    assert rows.mean == pytest.approx(expected, rel=1e-12)


def test_covariance_of_coefficients_and_leftover(tmp_path: Path) -> None:
    """G C G' of the drift's own rows, written out for px, with lever arms 1 and 0.5."""
    rng = np.random.default_rng(51)
    A, B = rng.normal(size=(4, 4)) * 1e-2, rng.normal(size=(2, 2)) * [[0.1], [1e-3]]
    own = line(covariance=A @ A.T, leftover=B @ B.T)
    at = {name: EACH[name] for name in SENSORS}
    more = predict(machine(tmp_path, own), IDS, POINTS, at).covariance
    without = predict(machine(tmp_path), IDS, POINTS).covariance
    x, u = POINTS[:, 0], np.column_stack([EACH[name] - 20 for name in SENSORS[:2]])
    g = np.column_stack([u, x[:, None] * u])
    powers = np.column_stack([np.ones(4), x])
    of_px = (g @ A @ A.T @ g.T + powers @ B @ B.T @ powers.T) * UM**2
    expected = np.kron(of_px, np.outer([1.0, 0.5], [1.0, 0.5]))
    assert more - without == pytest.approx(expected, rel=1e-9, abs=1e-18)


LAGGED = line(time_constants=(30.0, 0.0))


def test_lags_follow_the_times_of_the_rows() -> None:
    """In any order of the rows, with rows of one moment counted once."""
    rng = np.random.default_rng(52)
    time = np.sort(rng.uniform(0.0, 200.0, 25))
    a, b = 20 + rng.normal(size=(2, 25)).cumsum(axis=1)
    expected = first_order_lag(a[:, None], time, np.array([30.0]))[0, :, 0]
    order = rng.permutation(np.repeat(np.arange(25), 2))
    at = {"T_a_degC": a[order], "T_b_degC": b[order], "time_min": time[order]}
    found = temperatures(LAGGED, at, 50)
    assert found[:, 0] == pytest.approx(expected[order], rel=1e-12)
    assert (found[:, 1] == b[order]).all()
    place = {"x": np.linspace(0.0, 100.0, 50)}
    rows = drift_terms(LAGGED, {})[0].columns(place, at, 50)
    rise = np.column_stack([expected[order], b[order]]) - 20
    assert rows[:, :2] == pytest.approx(rise, rel=1e-10)
    assert rows[:, 2:] == pytest.approx(place["x"][:, None] * rise, rel=1e-10, abs=1e-12)


U = {"T_a_degC": 0.1, "T_b_degC": 0.2, "T_c_degC": 0.05}


@pytest.mark.parametrize("row", [[0, 1, 1, 3], [0, 1, 2, 3], [1, 1, 1, 1]])
@pytest.mark.parametrize("time", [
    None, [1000.0, 0.0, 1005.0, 5.0], [0.0, 2.0, 4.0, 6.0], [0.0, 500.0, 1000.0, 1500.0]
])  # fmt: skip
def test_rows_with_the_same_temperatures_share_the_noise_of_one_reading(
    tmp_path: Path, row: list[int], time: list[float] | None
) -> None:
    """The errors are linear in the temperatures: a step of u for each reading that is another, also
    through lags. T_b moves both px and yaw, which are wrong together where it is.
    """
    a, b = ((60.0, 15.0), (15.0, 0.0)) if time else ((0.0, 0.0), (0.0, 0.0))
    model = machine(tmp_path, line(time_constants=a, sensor_u=(0.1, 0.2)),
                    angle(time_constants=b, sensor_u=(0.2, 0.05)))  # fmt: skip
    quiet = machine(tmp_path, line(time_constants=a), angle(time_constants=b))
    at = {name: values[row] for name, values in EACH.items()}
    at |= {"time_min": np.array(time)} if time else {}
    base = predict(quiet, IDS, POINTS, dict(at))
    expected = np.zeros((8, 8))
    for name, u in U.items():
        for reading in set(row):
            moved = at[name] + u * (np.array(row) == reading)
            step = predict(quiet, IDS, POINTS, at | {name: moved}).mean - base.mean
            expected += np.outer(step, step)
    found = predict(model, IDS, POINTS, dict(at)).covariance
    assert found - base.covariance == pytest.approx(expected, rel=1e-6, abs=1e-15)
    if set(row) == {1}:
        room = {name: float(values[0]) for name, values in at.items() if name in U}
        assert predict(model, IDS, POINTS, dict(room)).covariance == pytest.approx(found, rel=1e-12)


# What is said of temperatures that a thermal model has not seen, or that cannot be right.


ROOM: dict[str, FloatArray | float] = {"T_a_degC": 23.0, "T_b_degC": 24.0, "T_c_degC": 22.0}
RANGE = np.array([[20.0, 26.0], [20.0, 25.0]])


def test_a_sensor_beyond_the_fit_is_warned_of_once(tmp_path: Path) -> None:
    model = machine(tmp_path, replace(line(), temperature_range=RANGE),
                    replace(angle(), temperature_range=RANGE))  # fmt: skip
    assert temperature_warnings(model, ROOM) == []
    (warned,) = temperature_warnings(model, ROOM | {"T_a_degC": 28.0})
    assert warned.code == "outside-measured-range"
    assert warned.facts["what"] == "T_a_degC at 28 degC"
    assert (warned.facts["low"], warned.facts["high"]) == (20, 26)
    found = temperature_warnings(model, ROOM | {"T_b_degC": 19.0})
    assert ["px" in w.message for w in found] == [True, False]
    both = machine(tmp_path, replace(line(), temperature_range=RANGE),
                   replace(angle(), temperature_range=RANGE[[1, 1]]))  # fmt: skip
    (one,) = temperature_warnings(both, ROOM | {"T_b_degC": 19.0})
    assert one.facts["names"] == ["the drift of px, yaw"]


# Drifts of components from the machine file and from a thermal-fit report.


POSITIONS = [0.0, 200.0, 75.0, 300.0]
STATED = """
    components:
      pos_y:
        of: y
        unit: um
        thermal:
          positions_mm: [0, 200, 75, 300]
          gradients: {T_01_degC: [-3.5, 0, 0.5, 4.02], T_02_degC: [19.6, 12.3, 11.7, 5.03]}
          time_constants_min: {T_02_degC: 40}
          s_leftover: 0.3
          sensor_u_degC: {T_01_degC: 0.015}
      yaw_y: {of: y, unit: arcsec, thermal: {gradients: {T_03_degC: 2}}}
      ort: {unit: arcsec, coefficients: [3]}
    equations: {Ex: pos_y + y*yaw_y - y*ort}
"""


def lagrange(positions: list[float], values: list[float], p: float) -> float:
    """The interpolating polynomial, without powers."""
    total = 0.0
    for i, value in enumerate(values):
        others = [x for j, x in enumerate(positions) if j != i]
        total += value * float(np.prod([(p - x) / (positions[i] - x) for x in others]))
    return total


def test_a_drift_of_the_machine_file_goes_through_its_positions(tmp_path: Path) -> None:
    found = thermal_from_machine_file(loaded(tmp_path, STATED))
    assert set(found) == {"pos_y", "yaw_y"}
    drift = found["pos_y"]
    assert (drift.component, drift.of, drift.unit.name, drift.degree) == ("pos_y", "y", "um", 3)
    assert drift.sensors == ("T_01_degC", "T_02_degC")
    assert (drift.reference, drift.position_range) == (20.0, (0.0, 300.0))
    # 1 um per degC and 1e-3 mm: the tolerance is that of double numbers at mm.
    for p in (0.0, 75.0, 120.0, 200.0, 300.0, 350.0):
        expected = 6 * lagrange(POSITIONS, [-3.5, 0, 0.5, 4.02], p)
        expected -= 2 * lagrange(POSITIONS, [19.6, 12.3, 11.7, 5.03], p)
        rises = {"T_01_degC": np.array([26.0]), "T_02_degC": np.array([18.0])}
        assert drift.drift(np.array([p]), rises) == pytest.approx([expected * 1e-3], abs=1e-12)
    assert not drift.covariance.any()
    assert drift.covariance.shape == (8, 8)
    assert (drift.coefficient_dof, drift.leftover_dof) == (np.inf, np.inf)
    wanted = np.zeros((4, 4))
    wanted[0, 0] = 0.3e-3**2
    np.testing.assert_allclose(drift.leftover, wanted, rtol=1e-14)
    assert drift.time_constants.tolist() == [0, 40]
    assert drift.sensor_u.tolist() == [0.015, 0]
    assert drift.temperature_range is None


DRIFT: dict[str, Any] = {
    "of": "y", "unit": "um", "degree": 1, "sensors": ["T_a_degC", "T_b_degC"],
    "reference_temperature_degC": 20, "time_constants_min": [0, 40],
    "coefficients": [[1.5, 2], [3, 4]],
    "covariance": [[1, 0.5, 0, 0], [0.5, 2, 0, 0], [0, 0, 3, 0], [0, 0, 0, 4]],
    "coefficient_dof": None, "leftover_covariance": [[0.25, 0], [0, 1e-6]], "leftover_dof": 12.5,
    "sensor_u_degC": [0.01, 0.02], "temperature_range_degC": [[19, 26], [20, 25]],
    "position_range_mm": [0, 200],
}  # fmt: skip


def report(tmp_path: Path, **components: dict[str, Any]) -> ThermalReport:
    path = tmp_path / "t.json"
    document = {"schema": "mtu/thermal-fit/1", "results": {"components": components}}
    path.write_text(json.dumps(document))
    found = read_report(path)
    assert isinstance(found, ThermalReport)
    return found


@pytest.fixture
def stated_machine(tmp_path: Path) -> LoadedMachine:
    return loaded(tmp_path, STATED)


def test_a_report_of_another_machine(tmp_path: Path, stated_machine: LoadedMachine) -> None:
    other = DRIFT | {"of": "x", "reference_temperature_degC": 20.5}
    with pytest.raises(InputError) as caught:
        thermal_from_report(stated_machine, report(tmp_path, pos_z=DRIFT, pos_y=other, yaw_y=DRIFT))
    assert [(item.path, item.code) for item in caught.value.findings] == [
        ("results.components.pos_z", "unknown-name"),
        ("results.components.pos_y.reference_temperature_degC", "contradicts"),
        ("results.components.pos_y", "contradicts"),
        ("results.components.yaw_y", "contradicts"),
    ]
    found = thermal_from_report(stated_machine, report(tmp_path, pos_y=DRIFT))
    assert set(found) == {"pos_y", "yaw_y"}
    np.testing.assert_allclose(found["pos_y"].coefficients, [[1.5e-3, 2e-3], [3e-3, 4e-3]])
    assert (found["pos_y"].leftover_dof, found["pos_y"].coefficient_dof) == (12.5, np.inf)
