"""Virtual machines: independent streams, the moments that were declared, effects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import FloatArray, estimate, model_of, part_of, stated
from numpy.typing import NDArray

from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.simulate import (
    PartsPlan,
    ReadingsPlan,
    SimulatedPoints,
    covariate_equations,
    errors_by_axis,
    growth,
    simulate_points,
    simulate_readings,
)

IDS = ["a", "b", "c", "d"]
POINTS = np.array([[0.0, 0, 0], [100, 0, 0], [100, 80, 0], [0, 80, 0]])
D = np.array([[4e-6, -1e-8], [-1e-8, 9e-10]])
PLAN = PartsPlan(
    parts=3, repeats=2, cmm_u=1e-3, part_offset=2e-3, reverse_every=0, minutes=0.5
)  # fmt: skip
READ = ReadingsPlan(passes=3, directions=(1, -1), positions={"x": np.linspace(0, 100, 5)})


def machine(s: float = 2e-3) -> MachineModel:
    a = estimate("a", "x", [1e-3, 2e-5], D=D, s=s)
    t = estimate("t", None, [1e-5], D=np.array([[4e-10]]))
    return model_of([(a, {"x": "1", "y": "0.5"}), (t, {"x": "-y", "y": "x"})])


def simulate(
    plan: PartsPlan = PLAN, seed: int = 1, model: MachineModel | None = None
) -> SimulatedPoints:
    return simulate_points(model or machine(), IDS, POINTS, plan, seed)


def shaped(found: SimulatedPoints, plan: PartsPlan) -> FloatArray:
    """Errors (parts, repeats, features, axes)."""
    errors = found.measured.reshape(plan.parts, plan.repeats, 4, 2) - POINTS[:, :2]
    return np.asarray(errors)


def test_more_passes_leave_the_earlier_ones_and_parts_do_not_move_readings() -> None:
    few = simulate_readings(machine(), READ, 1)
    many = simulate_readings(machine(), replace(READ, passes=8), 1)
    for name in "at":
        rows = [i for i, other in enumerate(few.component) if other == name]
        first = [i for i, other in enumerate(many.component) if other == name][: len(rows)]
        assert (many.error[first] == few.error[rows]).all()
    assert (simulate_readings(machine(), READ, 2).error != few.error).all()


def test_moments_of_readings() -> None:
    """The passes' lines have covariance D + s^2 (X'X)^-1, what is left s^2."""
    plan = ReadingsPlan(passes=4000, directions=(1,), positions=READ.positions)
    found = simulate_readings(machine(), plan, 3)
    rows = np.array([name == "a" for name in found.component])
    errors = found.error[rows].reshape(4000, 5)
    p = found.position[rows][:5]
    X = np.column_stack([np.ones(5), p])
    lines = errors @ X @ np.linalg.inv(X.T @ X)
    wanted = D + 4e-6 * np.linalg.inv(X.T @ X)
    se = np.sqrt((np.outer(np.diag(wanted), np.diag(wanted)) + wanted**2) / 4000)
    assert (np.abs(np.cov(lines.T) - wanted) < 4.5 * se).all()
    deviation = np.sqrt(np.diag(wanted) / 4000)
    assert (np.abs(lines.mean(axis=0) - [1e-3, 2e-5]) < 4.5 * deviation).all()
    rest = np.sum((errors - lines @ X.T) ** 2) / (4000 * 3)
    assert rest == pytest.approx(4e-6, rel=4.5 * np.sqrt(2 / 12000))
    angle = found.error[~rows]
    assert len(angle) == 4000
    assert angle.var(ddof=1) == pytest.approx(4e-10, rel=4.5 * np.sqrt(2 / 4000))


def test_readings_run_back_and_forth() -> None:
    found = simulate_readings(machine(), READ, 1)
    positions = found.position[:10]
    assert list(positions) == [0, 25, 50, 75, 100, 100, 75, 50, 25, 0]
    assert list(found.direction[:10]) == [1] * 5 + [-1] * 5
    assert list(found.pass_number[:30:10]) == [1, 2, 3]
    constant = np.array([name == "t" for name in found.component])
    assert list(found.direction[constant]) == [0, 0, 0]
    assert found.unit[0] == "mm"


def test_moments_of_parts() -> None:
    """Part state, visits, offset and CMM noise: covariance over 4000 parts by hand."""
    plan = replace(PLAN, parts=4000, repeats=2)
    errors = shaped(simulate(plan, seed=4), plan)
    x, y = POINTS[:, 0], POINTS[:, 1]
    rows = []
    for i in range(4):
        rows += [[1, x[i], -y[i]], [0.5, 0.5 * x[i], x[i]]]
    J = np.array(rows)
    state = np.zeros((3, 3))
    state[:2, :2], state[2, 2] = D, 4e-10
    lever = np.array([1, 0.5])
    wanted = J @ state @ J.T + np.kron(np.eye(4), 4e-6 * np.outer(lever, lever))
    wanted += np.kron(np.ones((4, 4)), 4e-6 * np.eye(2))  # the part's offset
    wanted += 1e-6 / 2 * np.eye(8)  # mean of two measurements
    means = errors.mean(axis=1).reshape(4000, 8)
    se = np.sqrt((np.outer(np.diag(wanted), np.diag(wanted)) + wanted**2) / 4000)
    assert (np.abs(np.cov(means.T) - wanted) < 4.5 * se).all()
    expected = J @ [1e-3, 2e-5, 1e-5]
    assert (np.abs(means.mean(axis=0) - expected) < 4.5 * np.sqrt(np.diag(wanted) / 4000)).all()
    within = np.diff(errors, axis=1).ravel()
    assert within.var() == pytest.approx(2e-6, rel=4.5 * np.sqrt(2 / len(within)))


QUIET = PartsPlan(parts=4, repeats=1, cmm_u=0.0, part_offset=0.0, reverse_every=2, minutes=0.5)


def quiet() -> MachineModel:
    return model_of([(estimate("a", None, [0.0]), {"x": "1", "y": "1"})])


def test_directions_sequence_and_time() -> None:
    found = simulate(QUIET, model=quiet()).covariates
    by_part = {name: values.reshape(4, 4) for name, values in found.items()}
    # a b c d: right, up, left; the second and fourth part are made d c b a.
    assert list(by_part["dir_x"][0]) == [1, 1, 1, -1]
    assert list(by_part["dir_y"][0]) == [1, 1, 1, 1]
    assert list(by_part["dir_x"][1]) == [-1, 1, 1, 1]
    assert list(by_part["dir_y"][1]) == [-1, -1, 1, 1]
    assert (by_part["dir_x"][2] == by_part["dir_x"][0]).all()
    assert list(by_part["sequence"][:, 0]) == [1, 2, 3, 4]
    assert list(by_part["time_min"][0]) == [0, 0.5, 1, 1.5]
    assert list(by_part["time_min"][1]) == [3.5, 3, 2.5, 2]
    assert "dir_z" not in by_part


def test_effects_and_covariates_are_evaluated() -> None:
    plan = replace(
        QUIET,
        effects=(("x", parse("0.004*dir_x + 1e-4*(T_spindle_degC - 20)")), ("y", parse("x*1e-5"))),
        covariates=(("T_spindle_degC", parse("20 + time_min/2")),),
    )
    found = simulate(plan, model=quiet())
    errors = found.measured - np.tile(POINTS[:, :2], (4, 1))
    c = found.covariates
    assert c["T_spindle_degC"] == pytest.approx(20 + c["time_min"] / 2)
    assert errors[:, 0] == pytest.approx(0.004 * c["dir_x"] + 1e-4 * c["time_min"] / 2, abs=1e-13)
    assert errors[:, 1] == pytest.approx(np.tile(POINTS[:, 0] * 1e-5, 4), abs=1e-13)
    assert found.part == tuple(str(p) for p in range(1, 5) for _ in range(4))
    assert found.feature == tuple(IDS * 4)


LARGE = "out of range: '1e+202'; expected at most 1e+06 mm in size"
VALUE = "the equation has no finite value at"


@pytest.mark.parametrize(
    ("what", "equation", "words"),
    [
        (
            "effects",
            "dir_q",
            "--effect Ex: unknown name at column 1: 'dir_q'; did you mean 'dir_x' or 'dir_y'?",
        ),
        ("effects", "1/(2-sequence)", f"{VALUE} sequence = 2 in part 2 at feature 'a'"),
        ("effects", "1e200*x", f"--effect Ex in part 1 at feature 'b': {LARGE}"),
        (
            "scatter",
            "-0.01",
            "--scatter Ex in part 1 at feature 'a': out of range: '-0.01'; expected",
        ),
        ("covariates", "1/y", f"--covariate x: {VALUE} y = 0 in part 1 at feature 'a'"),
    ],
)
def test_equations_without_a_value(what: str, equation: str, words: str) -> None:
    """The option, the part and the feature are told, and what the equation was given there."""
    given = (("x", parse(equation)),)
    plan = {
        "effects": replace(QUIET, effects=given),
        "scatter": replace(QUIET, scatter=given),
        "covariates": replace(QUIET, covariates=given),
    }[what]
    with pytest.raises(InputError) as error:
        simulate(plan, model=quiet())
    assert words in str(error.value)
    assert len(error.value.findings) == 1


DECLARED = """
components: {a: {of: x, unit: um, coefficients: [1.0, 0.1]}}
equations: {Ex: a*T_spindle_degC/20, Ey: 0}
effects:
  - {name: e, parameters: {h: {value: 4, u: 1, unit: um}}, equations: {Ex: h*dir_x}}
"""


def test_a_machine_with_effects_is_read_and_made(tmp_path: Path) -> None:
    """Its parameters are nothing an instrument reads; its covariates must be given."""
    model = stated(tmp_path, DECLARED)
    assert set(simulate_readings(model, READ, 1).component) == {"a"}
    with pytest.raises(InputError, match="a value of T_spindle_degC for the machine 'm'") as error:
        simulate(QUIET, model=model)
    assert "--covariate 'T_spindle_degC: EQUATION'" in str(error.value)
    plan = replace(QUIET, covariates=(("T_spindle_degC", parse("30")),))
    found = simulate(plan, model=model)
    Ex = found.measured[:, 0] - np.tile(POINTS[:, 0], 4)
    a = (1 + 0.1 * np.tile(POINTS[:, 0], 4)) * 1e-3
    assert Ex == pytest.approx(1.5 * a + 4e-3 * found.covariates["dir_x"], abs=1e-13)
    row = POINTS[[0, 0]] + [[0, 0, 0], [0, 5, 0]]
    with pytest.raises(InputError, match="a value of dir_x for the machine 'm'"):
        simulate_points(model, ["a", "b"], row, plan, 1)


# Equations of `simulate`, whose numbers may have units that are not written.


def test_names_are_those_of_errors_and_of_columns_that_are_free() -> None:
    ((axis, _),) = errors_by_axis("--effect", ["Ex: 0.004*dir_x"], "xy")
    assert axis == "x"
    assert [name for name, _ in covariate_equations("--covariate", ["load: 1", "wear: 2"])] == [
        "load",
        "wear",
    ]
    with pytest.raises(InputError, match="unknown equation: 'Ez'"):
        errors_by_axis("--effect", ["Ez: 0.004"], "xy")
    for texts in (["part: 1"], ["load: 1", "load: 2"], ["load 1"]):
        with pytest.raises(InputError, match=r"another name|NAME: EQUATION"):
            covariate_equations("--covariate", texts)


# Where features of a calibrated ring stand at the temperature of the part.


OF_RING = ("e", "n", "w", "s", "far")
ON_RING = np.array([[60.0, 20, 0], [10, 70, 0], [-40, 20, 0], [10, -30, 0], [200, 20, 0]])
"""Four on a circle of diameter 100 mm about (10, 20), and one that is not of it."""
RING = """\
features:
  e: {x_mm: 60, y_mm: 20}
  n: {x_mm: 10, y_mm: 70}
  w: {x_mm: -40, y_mm: 20}
  s: {x_mm: 10, y_mm: -30}
  far: {x_mm: 200, y_mm: 20}
circles:
  - {id: ring, features: [e, n, w, s],
     temperature: T_ring_degC, calibrated_mm: {20: 100.0, 30: 100.1}}
"""


def measured(temperatures: list[float] | None) -> SimulatedPoints:
    """All features, once at each temperature."""
    times = len(temperatures or [0.0])
    known = {} if temperatures is None else {"T_ring_degC": np.repeat(temperatures, len(OF_RING))}
    return SimulatedPoints(
        axes=("x", "y"),
        operation=None,
        part=("1",) * times * len(OF_RING),
        feature=OF_RING * times,
        repeat=np.ones(times * len(OF_RING), np.int64),
        measured=np.tile(ON_RING[:, :2], (times, 1)),
        covariates=known,
    )


def moved(folder: Path, points: SimulatedPoints, text: str = RING) -> NDArray[np.float64]:
    found = growth(points, OF_RING, ON_RING, part_of(folder, text).part.circles)
    return found.reshape(-1, len(OF_RING), 2)


def test_points_move_away_from_the_centre_as_the_diameter_grows(tmp_path: Path) -> None:
    """D is linear between calibrated temperatures and constant beyond: 0, 50 and 100 um more."""
    found = moved(tmp_path, measured([20.0, 25.0, 30.0, 40.0, 10.0]))
    outward = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1], [0, 0]])
    for um, shift in zip([0, 25, 50, 50, 0], found, strict=True):
        np.testing.assert_allclose(shift, 1e-3 * um * outward, rtol=0, atol=1e-12)


def test_a_circle_whose_temperature_is_not_known_stays_nominal(tmp_path: Path) -> None:
    assert not moved(tmp_path, measured(None)).any()
    plain = RING.replace("temperature: T_ring_degC, calibrated_mm: {20: 100.0, 30: 100.1}", "")
    assert not moved(tmp_path, measured([30.0]), plain).any()


def test_a_circle_that_its_points_do_not_determine(tmp_path: Path) -> None:
    circles = part_of(tmp_path, RING).part.circles
    line = measured([30.0])
    flat = ON_RING * [1.0, 0.0, 1.0]
    with pytest.raises(InputError, match="goes through the nominal points"):
        growth(line, OF_RING, flat, circles)
