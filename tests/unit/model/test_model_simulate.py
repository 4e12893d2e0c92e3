"""Virtual machines: independent streams, the moments that were declared, effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from model_examples import FloatArray, estimate, model_of

from mtu_cli.language import parse
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.simulate import (
    PartsPlan,
    ReadingsPlan,
    SimulatedPoints,
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


# Equations of `simulate`, whose numbers may have units that are not written.


# Where features of a calibrated ring stand at the temperature of the part.


OF_RING = ("e", "n", "w", "s", "far")
ON_RING = np.array([[60.0, 20, 0], [10, 70, 0], [-40, 20, 0], [10, -30, 0], [200, 20, 0]])
"""Four on a circle of diameter 100 mm about (10, 20), and one that is not of it."""


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
