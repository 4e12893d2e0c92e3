"""Propagation with covariance against whole machines and parts, drawn one by one.

A machine is drawn by drawing all its ball-bar readings and fitting them with plain
least squares; a part by drawing the machine's state and every visit. The scatter of true
minus predicted length over many of them is what `lengths` claims to know.
"""

from __future__ import annotations

import numpy as np
import pytest
from machine_trials import (
    AXY,
    AXY_PASSES,
    CENTRE,
    COMPONENTS,
    PAIRS,
    POINTS,
    POSITIONS,
    Drift,
    Z,
    length_errors,
    machine,
    make_parts,
    pass_states,
    unit_gradients,
)
from model_examples import estimate

from mtu_cli.model.estimates import Estimates, JointPasses
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray

MACHINES = 20_000
PASSES = 10
X = np.column_stack([np.ones_like(POSITIONS), POSITIONS])
M = np.linalg.inv(X.T @ X)
TO_ORIGIN = np.array([[1.0, -CENTRE], [0.0, 1.0]])


def fitted_coefficients(
    rng: np.random.Generator, drift: Drift
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Least-squares coefficients (machines, 2) of every drawn machine, and its axis angle."""
    states = pass_states(rng, drift, MACHINES * PASSES)
    found = {}
    for name, (_, b0, b1, repeat, _, _) in COMPONENTS.items():
        state = states[name].reshape(MACHINES, PASSES, 2)
        y = b0 + b1 * POSITIONS + state[..., :1] + state[..., 1:] * (POSITIONS - CENTRE)
        y += repeat * rng.standard_normal(y.shape)
        found[name] = y.mean(axis=1) @ X @ M
    angle = AXY[0] + AXY[1] * rng.standard_normal((MACHINES, AXY_PASSES)).mean(axis=1)
    return found, angle


def predicted_errors(found: dict[str, FloatArray], angle: FloatArray) -> FloatArray:
    """Errors (machines, points, 2) that each fitted machine predicts: the equations by hand."""
    x, y = POINTS[:, 0], POINTS[:, 1]
    v = {}
    for name, (axis, *_) in COMPONENTS.items():
        p = POINTS[:, "xy".index(axis)]
        v[name] = found[name][:, :1] + found[name][:, 1:] * p
    Ex = v["dx_x"] + v["dx_y"] + Z * v["ey_x"] + y * (v["ez_x"] + v["ez_y"] - angle[:, None])
    Ey = v["dy_x"] + v["dy_y"] - x * v["ez_x"] - Z * v["ex_y"]
    return np.stack([Ex, Ey], axis=2)


def known_estimates(drift: Drift) -> Estimates:
    """The true variances, as a fit without any error of its own would report them. With a common
    cause the passes' levels and slopes are correlated by 0.8 squared.
    """
    k = len(COMPONENTS)
    sd = np.array([item[4:6] for item in COMPONENTS.values()]) * drift.size
    s = np.array([item[3] for item in COMPONENTS.values()])
    L = np.vstack([TO_ORIGIN * own for own in sd])
    r = 0.64 * drift.common
    D = L @ L.T * np.kron(r + (1 - r) * np.eye(k), np.ones((2, 2)))
    C = (D + np.kron(np.diag(s**2), M)) / PASSES
    components = {
        name: estimate(name, axis, [b0, b1], C=C[at, at], D=D[at, at], s=repeat)
        for i, (name, (axis, b0, b1, repeat, *_)) in enumerate(COMPONENTS.items())
        for at in [slice(2 * i, 2 * i + 2)]
    }
    own = np.array([[AXY[1] ** 2]])
    components["axy"] = estimate("axy", None, [AXY[0]], C=own / AXY_PASSES, D=own)
    group = JointPasses(
        components=tuple(COMPONENTS),
        widths=(2,) * k,
        covariance=C,
        pass_covariance=D,
        pass_dof=np.inf,
        n_passes=None,
    )
    return Estimates(components=components, joint=(group,) if drift.common else ())


@pytest.mark.parametrize(
    "drift", [Drift(1.0), Drift(0.0), Drift(1.0, common=True)], ids=["drift", "none", "common"]
)
def test_variance_of_points_and_lengths(drift: Drift, tmp_path: object) -> None:
    rng = np.random.default_rng(20040126)
    expected = predicted_errors(*fitted_coefficients(rng, drift))
    actual = make_parts(rng, drift, MACHINES)
    points = (actual - expected).reshape(MACHINES, -1)
    lengths = length_errors(actual) - length_errors(expected)
    model = build_model(machine(tmp_path), known_estimates(drift))
    prediction = predict(model, ["a", "b", "c"], POINTS)
    A = np.vstack([np.eye(2 * len(POINTS)), unit_gradients()])
    claimed = prediction.variance(A).total
    seen = np.concatenate([points.var(axis=0, ddof=1), lengths.var(axis=0, ddof=1)])
    # The standard error of a variance of normal data is sqrt(2/(n-1)) of it.
    standard_error = np.sqrt(2 / (MACHINES - 1))
    assert seen / claimed == pytest.approx(np.ones(len(claimed)), abs=4 * standard_error)
    assert np.diag(A @ prediction.covariance @ A.T) == pytest.approx(claimed, rel=1e-12)


def test_independent_ends_would_be_wrong(tmp_path: object) -> None:
    drift = Drift(1.0)
    model = build_model(machine(tmp_path), known_estimates(drift))
    prediction = predict(model, ["a", "b", "c"], POINTS)
    shared = prediction.variance(unit_gradients()).total
    independent = unit_gradients() ** 2 @ prediction.independent_variance
    # Between a and b (a length along y) level drift cancels: independence overstates it.
    assert independent[PAIRS.index((0, 1))] > 1.3 * shared[PAIRS.index((0, 1))]
