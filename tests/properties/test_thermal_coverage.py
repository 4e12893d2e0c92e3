"""The 95 % interval of an error under drift with temperature holds the true one 95 times in 100.

Every machine has drift tests of its own: four warm-ups and cool-downs, two components read at
three positions, thermocouples with noise, and a drift that no sensor follows. The part that is
made afterwards has temperatures, noise of its thermocouples and unfollowed drift of its own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from model_examples import loaded
from synthetic_drift import REFERENCE, UM, Plan, one, sensor_names

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.coverage import coverage_factor
from mtu_cli.stats.least_squares import FloatArray

MACHINES = 45
CYCLES, N, STEP_MIN = 4, 32, 6.0
PLACES = (0.0, 150.0, 300.0)
LEVEL = {"px": np.array([2.0, -1.0]), "py": np.array([-1.5, 3.0])}
SLOPE = {"px": np.array([0.010, 0.004]), "py": np.array([-0.006, 0.008])}
"""um/K and um/K/mm of two sensors."""
SENSOR_K, LEFTOVER_UM = 0.02, 0.5
POINTS = np.array([[40.0, 260.0, np.nan], [280.0, 90.0, np.nan]])
MACHINE = """
components:
  px: {of: x, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
  py: {of: y, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
equations: {Ex: px, Ey: py}
"""


def warmed(rng: np.random.Generator, warm: bool) -> FloatArray:
    """True temperatures (N, 2): the room steps by 6 K, each sensor has draughts."""
    t = STEP_MIN * np.arange(N)[:, None]
    step = 1 - np.exp(-t / np.array([25.0, 90.0]))
    draughts = np.cumsum(0.12 * rng.standard_normal((N, 2)), axis=0)
    return np.asarray(REFERENCE + 6 * (step if warm else 1 - step) + draughts)


def held(rng: np.random.Generator, known: LoadedMachine) -> tuple[bool, ...]:
    """Whether the intervals of Ex and Ey at the first point, and of x2 - x1, hold the true ones."""
    T = np.array([warmed(rng, cycle % 2 == 0) for cycle in range(CYCLES)])
    thermal = {}
    for axis, name in enumerate(LEVEL):
        gradients = np.array([LEVEL[name] + p * SLOPE[name] for p in PLACES])
        plan = Plan(gradients=gradients, positions=PLACES, cycles=CYCLES, n=N, step=STEP_MIN,
                    noise=0.3, slow=(LEFTOVER_UM,), memory=0.8, sensor_noise=SENSOR_K)  # fmt: skip
        estimate = one(plan.read(rng, T)).estimate
        thermal[name] = replace(estimate, component=name, of="xy"[axis])
    model = build_model(known, replace(estimates_from_fit(known, None), thermal=thermal))
    u = warmed(rng, warm=True)[rng.integers(N // 4, N)] - REFERENCE
    read = REFERENCE + u + SENSOR_K * rng.standard_normal(2)
    slow = LEFTOVER_UM * rng.standard_normal(2)
    true = np.array([
        u @ (LEVEL[name] + POINTS[i, axis] * SLOPE[name]) + slow[axis]
        for i in range(2) for axis, name in enumerate(LEVEL)
    ])  # fmt: skip
    at = dict(zip(sensor_names(2), read.tolist(), strict=True))
    found = predict(model, ("a", "b"), POINTS, dict(at))
    A = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [-1.0, 0, 1.0, 0]])
    variance = found.variance(A)
    k = np.array([coverage_factor(0.95, dof) for dof in variance.dof])
    off = np.abs(A @ (found.mean - UM * true))
    return tuple((off <= k * np.sqrt(variance.total)).tolist())


def test_intervals_of_errors_and_lengths_cover(tmp_path: Path) -> None:
    known = loaded(tmp_path, MACHINE)
    found = np.array([held(rng, known) for rng in np.random.default_rng(7).spawn(MACHINES)])
    # Errors along two axes have nothing in common.
    of_errors = found[:, :2]
    assert abs(of_errors.mean() - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / of_errors.size)
    # A length is held too often: the coefficients answer for all that held-out cycles show, and
    # what both of its ends share is no error of it.
    assert found[:, 2].mean() > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / MACHINES)
