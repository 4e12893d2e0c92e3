"""Virtual machines: independent streams, the moments that were declared, effects."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_examples import estimate, model_of, part_of, stated
from thermal_machines import drift as of_sensors

from mtu_cli.findings import InputError
from mtu_cli.language import parse
from mtu_cli.model.estimates import ThermalEstimate
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.simulate import (
    WOBBLE_MEMORY_MIN,
    Columns,
    DriftPlan,
    PartsPlan,
    Sensors,
    followed,
    grown,
    sensors_for,
    simulate_drift,
    simulate_points,
    simulate_readings,
)
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.serial import first_order_lag

IDS = ["a", "b", "c", "d"]
POINTS = np.array([[0.0, 0, 0], [100, 0, 0], [100, 80, 0], [0, 80, 0]])
D = np.array([[4e-6, -1e-8], [-1e-8, 9e-10]])
PLAN = PartsPlan(parts=3, repeats=2, cmm_u_um=1.0, reverse_every=0, minutes=0.5)
AT = {"x": np.linspace(0, 100, 5)}
READ: dict[str, Any] = {"passes": 3, "positions": AT}


def machine(s: float = 2e-3) -> MachineModel:
    a = estimate("a", "x", [1e-3, 2e-5], D=D, s=s)
    t = estimate("t", None, [1e-5], D=np.array([[4e-10]]))
    return model_of([(a, {"x": "1", "y": "0.5"}), (t, {"x": "-y", "y": "x"})])


def simulate(plan: PartsPlan = PLAN, seed: int = 1, model: MachineModel | None = None) -> Columns:
    return simulate_points(model or machine(), IDS, POINTS, plan, seed)


def shaped(found: Columns, plan: PartsPlan) -> FloatArray:
    """Errors (parts, repeats, features, axes)."""
    measured = np.column_stack([found["x_mm"], found["y_mm"]])
    errors = measured.reshape(plan.parts, plan.repeats, 4, 2) - POINTS[:, :2]
    return np.asarray(errors)


def test_more_passes_leave_the_earlier_ones_and_parts_do_not_move_readings() -> None:
    few = simulate_readings(machine(), 1, **READ)
    many = simulate_readings(machine(), 1, **READ | {"passes": 8})
    for name in "at":
        rows = [i for i, other in enumerate(few["component"]) if other == name]
        first = [i for i, other in enumerate(many["component"]) if other == name][: len(rows)]
        assert (many["error"][first] == few["error"][rows]).all()
    assert (simulate_readings(machine(), 2, **READ)["error"] != few["error"]).all()


def test_moments_of_readings() -> None:
    """The passes' lines have covariance D + s^2 (X'X)^-1, what is left s^2."""
    found = simulate_readings(machine(), 3, passes=4000, positions=AT)
    rows = (found["component"] == "a") & (found["direction"] > 0)
    errors = found["error"][rows].reshape(4000, 5)
    p = found["position_mm"][rows][:5]
    X = np.column_stack([np.ones(5), p])
    lines = errors @ X @ np.linalg.inv(X.T @ X)
    wanted = D + 4e-6 * np.linalg.inv(X.T @ X)
    se = np.sqrt((np.outer(np.diag(wanted), np.diag(wanted)) + wanted**2) / 4000)
    assert (np.abs(np.cov(lines.T) - wanted) < 4.5 * se).all()
    deviation = np.sqrt(np.diag(wanted) / 4000)
    assert (np.abs(lines.mean(axis=0) - [1e-3, 2e-5]) < 4.5 * deviation).all()
    rest = np.sum((errors - lines @ X.T) ** 2) / (4000 * 3)
    assert rest == pytest.approx(4e-6, rel=4.5 * np.sqrt(2 / 12000))
    angle = found["error"][found["component"] == "t"]
    assert len(angle) == 4000
    assert angle.var(ddof=1) == pytest.approx(4e-10, rel=4.5 * np.sqrt(2 / 4000))


def test_readings_run_back_and_forth() -> None:
    found = simulate_readings(machine(), 1, **READ)
    positions = found["position_mm"][:10]
    assert list(positions) == [0, 25, 50, 75, 100, 100, 75, 50, 25, 0]
    assert list(found["direction"][:10]) == [1] * 5 + [-1] * 5
    assert list(found["pass"][:30:10]) == [1, 2, 3]
    constant = found["component"] == "t"
    assert list(found["direction"][constant]) == [0, 0, 0]
    assert found["unit"][0] == "mm"


def test_moments_of_parts() -> None:
    """Part state, visits and CMM noise: covariance over 4000 parts by hand."""
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
    wanted += 1e-6 / 2 * np.eye(8)  # mean of two measurements
    means = errors.mean(axis=1).reshape(4000, 8)
    se = np.sqrt((np.outer(np.diag(wanted), np.diag(wanted)) + wanted**2) / 4000)
    assert (np.abs(np.cov(means.T) - wanted) < 4.5 * se).all()
    expected = J @ [1e-3, 2e-5, 1e-5]
    assert (np.abs(means.mean(axis=0) - expected) < 4.5 * np.sqrt(np.diag(wanted) / 4000)).all()
    within = np.diff(errors, axis=1).ravel()
    assert within.var() == pytest.approx(2e-6, rel=4.5 * np.sqrt(2 / len(within)))


QUIET = PartsPlan(parts=4, repeats=1, cmm_u_um=0.0, reverse_every=2, minutes=0.5)


def quiet() -> MachineModel:
    return model_of([(estimate("a", None, [0.0]), {"x": "1", "y": "1"})])


def test_directions_sequence_and_time() -> None:
    found = simulate(QUIET, model=quiet())
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
        effects={"Ex": parse("0.004*dir_x + 1e-4*(T_spindle_degC - 20)"), "Ey": parse("x*1e-5")},
        covariates={"T_spindle_degC": parse("20 + time_min/2")},
    )
    c = simulate(plan, model=quiet())
    errors = shaped(c, plan).reshape(-1, 2)
    assert c["T_spindle_degC"] == pytest.approx(20 + c["time_min"] / 2)
    assert errors[:, 0] == pytest.approx(0.004 * c["dir_x"] + 1e-4 * c["time_min"] / 2, abs=1e-13)
    assert errors[:, 1] == pytest.approx(np.tile(POINTS[:, 0] * 1e-5, 4), abs=1e-13)
    assert list(c["part"]) == [str(p) for p in range(1, 5) for _ in range(4)]
    assert list(c["feature"]) == [*IDS] * 4


LARGE = "out of range: '1e+202'; expected at most 1e+06 mm in size"
VALUE = "the equation has no finite value at"


@pytest.mark.parametrize(
    ("what", "equation", "words"),
    [
        ("effects", "dir_q",
         "--effect Ex: unknown name at column 1: 'dir_q'; did you mean 'dir_y'?"),
        ("effects", "1/(2-sequence)", f"{VALUE} sequence = 2 in part 2 at feature 'a'"),
        ("effects", "1e200*x", f"--effect Ex in part 1 at feature 'b': {LARGE}"),
        ("scatter", "-0.01",
         "--scatter Ex in part 1 at feature 'a': out of range: '-0.01'; expected"),
        ("covariates", "1/y", f"--covariate Ex: {VALUE} y = 0 in part 1 at feature 'a'"),
    ],
)  # fmt: skip
def test_equations_without_a_value(what: str, equation: str, words: str) -> None:
    """The option, the part and the feature are told, and what the equation was given there."""
    given = {"Ex": parse(equation)}
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
    assert set(simulate_readings(model, 1, **READ)["component"]) == {"a"}
    with pytest.raises(InputError, match="a value of T_spindle_degC for the machine 'm'") as error:
        simulate(QUIET, model=model)
    assert "--covariate 'T_spindle_degC: EQUATION'" in str(error.value)
    plan = replace(QUIET, covariates={"T_spindle_degC": parse("30")})
    found = simulate(plan, model=model)
    Ex = found["x_mm"] - np.tile(POINTS[:, 0], 4)
    a = (1 + 0.1 * np.tile(POINTS[:, 0], 4)) * 1e-3
    assert Ex == pytest.approx(1.5 * a + 4e-3 * found["dir_x"], abs=1e-13)
    row = POINTS[[0, 0]] + [[0, 0, 0], [0, 5, 0]]
    with pytest.raises(InputError, match="a value of dir_x for the machine 'm'"):
        simulate_points(model, ["a", "b"], row, plan, 1)


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


def test_points_move_away_from_the_centre_as_the_diameter_grows(tmp_path: Path) -> None:
    """D is linear between calibrated temperatures and constant beyond: 0, 50 and 100 um more."""
    temperatures, n = [20.0, 25.0, 30.0, 40.0, 10.0], len(OF_RING)
    points = {
        "feature": np.array(OF_RING * 5),
        "x_mm": np.tile(ON_RING[:, 0], 5),
        "y_mm": np.tile(ON_RING[:, 1], 5),
        "T_ring_degC": np.repeat(temperatures, n),
    }
    circles = part_of(tmp_path, RING).part.circles
    outward = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1], [0, 0]])

    def moved(points: Columns) -> FloatArray:
        result = grown(points, OF_RING, ON_RING, circles)
        shifts = [result[name] - points[name] for name in ("x_mm", "y_mm")]
        return np.column_stack(shifts).reshape(-1, n, 2)

    for um, shift in zip([0, 25, 50, 50, 0], moved(points), strict=True):
        np.testing.assert_allclose(shift, 1e-3 * um * outward, rtol=0, atol=1e-12)
    # Without its temperature a circle stays as it is.
    del points["T_ring_degC"]
    assert not moved(points).any()
    points["T_ring_degC"] = np.repeat(temperatures, n)
    with pytest.raises(InputError, match="goes through the nominal points"):
        grown(points, OF_RING, ON_RING * [1.0, 0.0, 1.0], circles)


# Simulated drift tests, settled rooms.


STILL = DriftPlan(
    reference=20.0, low=20.0, high=26.0, room_lag=30.0, room_wobble=0.0, sensor_lag=(5.0, 25.0),
    sensor_spread=0.05, sensor_wobble=0.0, sensor_noise_degc=0.0, cycles=3, minutes=30.0,
    interval_min=2.0, soak=10.0, positions={"p": np.array([0.0, 200.0])}, reading_noise_um=0.0,
    reading_noise_arcsec=0.0, settled={},
)  # fmt: skip
NOISY = replace(STILL, room_wobble=0.5, sensor_wobble=0.8, sensor_noise_degc=0.015)
A, B = "T_a_degC", "T_b_degC"


def drift(tau: float = 0.0, leftover: float = 0.0) -> ThermalEstimate:
    """5 um/K of a and 0.01 um/mm/K of b, minus 2 um/K of b, along y."""
    gradients = np.array([[5.0, -2.0], [0.0, 0.01]])
    more = np.diag([(1e3 * leftover) ** 2, 0.0])
    return of_sensors("p", "y", (A, B), gradients, leftover=more, time_constants=(tau, 0.0))


def drift_test(drifts: list[ThermalEstimate], plan: DriftPlan, seed: int) -> Columns:
    return simulate_drift(drifts, plan, sensors_for(drifts, plan, seed), seed)


@pytest.mark.parametrize("tau", [0.0, 40.0])
def test_noise_free_readings_are_the_drift_of_the_temperatures_in_the_file(tau: float) -> None:
    """Of a sensor with a time constant, of the lagged temperature."""
    found = drift_test([drift(tau=tau)], replace(NOISY, sensor_noise_degc=0.0, cycles=1), 1)
    for position in (0.0, 200.0):
        rows = found["position_mm"] == position
        a, b = (found[name][rows] - 20 for name in (A, B))
        lagged = first_order_lag(a[:, None], found["time_min"][rows], np.array([tau]))[0, :, 0]
        expected = 5 * lagged + (-2 + 0.01 * position) * b
        assert found["error"][rows] == pytest.approx(expected, abs=1e-9)
        assert (np.abs(5 * (a - lagged)).max() > 1) == (tau > 0)
    assert found["error"][0] == 0.0
    assert np.abs(found["error"]).max() > 1


def test_cycles_are_apart_by_soaking_and_warm_and_cool_in_turn() -> None:
    found = drift_test([drift()], replace(STILL, minutes=300.0, soak=60.0), 1)
    share = sensors_for([drift()], replace(STILL, minutes=300.0, soak=60.0), 1).shares[0]
    for cycle, start, end in ((1, 0, 26.0), (2, 362, 20.0), (3, 724, 26.0)):
        rows = (found["cycle"] == cycle) & (found["position_mm"] == 0)
        assert found["time_min"][rows] == pytest.approx(start + 2.0 * np.arange(151))
        last = 20 + share * (end - 20)
        assert found[A][rows][-1] == pytest.approx(last, abs=0.01)


def test_moments_of_noise_and_leftover_and_twins() -> None:
    """Twins see the same, read apart, and change nothing else."""
    many = replace(NOISY, sensor_noise_degc=0.02, cycles=400, minutes=8.0, reading_noise_um=1.0,
                twins={"T_c_degC": A})  # fmt: skip
    exact = replace(many, sensor_noise_degc=0.0, twins={})
    clean = drift_test([drift()], replace(exact, reading_noise_um=0.0), 3)
    found = drift_test([drift(leftover=4e-3)], many, 3)
    assert list(found)[-3:] == [A, B, "T_c_degC"]
    n, first = len(found["error"]) // 2, found["position_mm"] == 0
    noise = [(found[x] - clean[A])[first] for x in (A, "T_c_degC")]
    for each in (*noise, (noise[0] - noise[1]) / np.sqrt(2)):
        assert each.std() == pytest.approx(0.02, rel=4.5 / np.sqrt(2 * n))
    rest = (found["error"] - clean["error"]).reshape(400, 2, 5)
    # The leftover is one draw for both positions of a cycle.
    state = rest.mean(axis=(1, 2))
    assert state.var(ddof=1) == pytest.approx(16 + 0.1, rel=4.5 * np.sqrt(2 / 399))
    spread = (rest - rest.mean(axis=2, keepdims=True)).reshape(800, 5)
    assert np.sum(spread**2) / 3200 == pytest.approx(1.0, rel=4.5 * np.sqrt(2 / 3200))


def test_draughts_have_the_declared_spread_and_memory() -> None:
    climate = replace(STILL, sensor_wobble=0.8, high=20.0, interval_min=5.0)
    sensors = Sensors(names=(A,), lags=np.zeros(1), shares=np.ones(1))
    air = followed(climate, sensors, np.full(60_001, 20.0), 4)[1000:, 0] - 20
    q = np.exp(-5 / WOBBLE_MEMORY_MIN)
    independent = len(air) * (1 - q**2) / (1 + q**2)
    assert air.var() == pytest.approx(0.64, rel=4.5 * np.sqrt(2 / independent))
    correlation = np.corrcoef(air[:-1], air[1:])[0, 1]
    assert correlation == pytest.approx(q, abs=4.5 * np.sqrt((1 - q**2) / len(air)))


def test_shares_move_as_little_as_the_settled_drifts_ask_for() -> None:
    drawn = sensors_for([drift()], NOISY, 1).shares
    assert np.abs(drawn - 1).max() <= 0.05
    asked = replace(NOISY, settled={"p": np.array([12e-3, 18e-3])})
    shares = sensors_for([drift()], asked, 1).shares
    # 6 K: 30 a - 12 b at 0 mm and 30 a at 200 mm.
    assert shares == pytest.approx([0.6, 0.5], abs=1e-9)
    # One place, two sensors: the change is along the gradients, which no smaller one can do.
    one = replace(NOISY, positions={"p": np.array([0.0])}, settled={"p": np.array([6e-3])})
    shares = sensors_for([drift()], one, 1).shares
    assert (shares - drawn)[0] * -2 == pytest.approx((shares - drawn)[1] * 5)
    assert 6 * (5 * shares[0] - 2 * shares[1]) == pytest.approx(6)


def test_drifts_that_the_sensors_cannot_give() -> None:
    impossible = replace(
        NOISY, positions={"p": np.array([0.0, 0.0])}, settled={"p": np.array([12e-3, 18e-3])}
    )
    with pytest.raises(InputError) as told:
        sensors_for([drift()], impossible, 1)
    # The nearest to both is halfway between.
    assert "about 15 15 um" in str(told.value)
