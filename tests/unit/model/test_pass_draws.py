"""What passes of a virtual machine differ by: variances by many draws against those declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from model_examples import FloatArray, estimate, model_of

from mtu_cli.model.estimates import ComponentEstimate, JointPasses
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.simulate import (
    PartsPlan,
    ReadingsPlan,
    pass_root,
    simulate_points,
    simulate_readings,
)

AT = np.array([[0.0, 0, 0], [250, 0, 0], [500, 0, 0]])
MANY = 4000


def of_parts(model: MachineModel) -> FloatArray:
    """Errors (MANY, points) along x of as many parts at `AT`."""
    plan = PartsPlan(
        parts=MANY, repeats=1, cmm_u=0.0, part_offset=0.0, reverse_every=0, minutes=1.0
    )
    found = simulate_points(model, ["a", "b", "c"], AT, plan, 1)
    return np.asarray(found.measured[:, 0].reshape(MANY, 3) - AT[:, 0])


def agree(found: FloatArray, wanted: FloatArray) -> bool:
    """Covariances of MANY draws, to 4.5 standard errors."""
    se = np.sqrt((np.outer(np.diag(wanted), np.diag(wanted)) + wanted**2) / MANY)
    return bool((np.abs(np.cov(found.T) - wanted) <= 4.5 * se).all())


def scaled(item: ComponentEstimate, by: FloatArray) -> ComponentEstimate:
    """The estimate with its coefficients in other units."""
    C, D = (by @ own @ by for own in (item.covariance, item.pass_covariance))
    return replace(item, covariance=C, pass_covariance=D)


def covariance_drawn(item: ComponentEstimate) -> FloatArray:
    root = pass_root(model_of([(item, {"x": "1"})], axes=("x",)))
    return np.asarray(root @ root.T)


def test_of_readings_no_more_than_a_negative_part_is_taken_off() -> None:
    """Passes at 0 to 500 mm whose slopes differ by less than repeatability makes them: drawn in
    mm and rad at once, 500 mm is 500 times what 1 mm is, and the variance there was seven times
    too large.
    """
    centre = np.array([[1.0, -250.0], [0.0, 1.0]])
    moment = centre @ [[5.81e-7, 1.23e-9], [1.23e-9, -2.51e-13]] @ centre.T
    C = np.array([[3.79e-8, 9.38e-12], [9.38e-12, 2.64e-13]])
    one = estimate("a", "x", [0.0, 0.0], C=C, D=moment)
    drawn, X = covariance_drawn(one), np.column_stack([np.ones(3), AT[:, 0]])
    assert agree(of_parts(model_of([(one, {"x": "1"})], axes=("x",))), X @ drawn @ X.T)
    assert np.linalg.eigvalsh(drawn / np.outer(*[np.sqrt(np.diag(drawn))] * 2))[0] >= -1e-9
    # What D lacks is less than the mean square of the ten passes, of which C is a tenth.
    added = np.diag(X @ (drawn - moment) @ X.T)
    assert (added >= 0).all()
    assert (added <= 10 * np.diag(X @ C @ X.T)).all()
    units = np.diag([1e3, 1e6])
    other = covariance_drawn(scaled(one, units))
    np.testing.assert_allclose(other, units @ drawn @ units, rtol=1e-9)


def together() -> tuple[MachineModel, FloatArray]:
    """Two components read in the same passes, and the covariance of their three coefficients."""
    K = 3
    root = np.random.default_rng(5).normal(size=(K, K)) * [[1e-3], [2e-6], [3e-3]]
    D = root @ root.T
    a = estimate("a", "x", [0.0, 0.0], D=D[:2, :2])
    b = estimate("b", None, [0.0], D=D[2:, 2:])
    group = JointPasses(
        components=("b", "a"),
        widths=(1, 2),
        covariance=np.zeros((K, K)),
        pass_covariance=D[np.ix_([2, 0, 1], [2, 0, 1])],
        pass_dof=4.0,
        n_passes=None,
    )
    return model_of([(a, {"x": "1"}), (b, {"y": "1"})], joint=(group,)), D


def test_passes_of_components_read_together_vary_together() -> None:
    model, D = together()
    at = np.array([0.0, 500.0])
    found = simulate_readings(
        model, ReadingsPlan(passes=MANY, directions=(1, -1), positions={"x": at}), 3
    )
    names = np.array(found.component)
    forward = found.error[(names == "a") & (found.direction == 1)].reshape(MANY, 2)
    back = found.error[(names == "a") & (found.direction == -1)].reshape(MANY, 2)[:, ::-1]
    X = np.array([[1.0, 0, 0], [1.0, 500, 0], [0, 0, 1.0]])
    alone = found.error[names == "b"]
    assert agree(np.column_stack([forward, alone]), X @ D @ X.T)
    # A component that is read once a pass is read on the way there.
    wanted = X @ D @ X.T
    wanted[:2, 2] = wanted[2, :2] = 0.0
    assert agree(np.column_stack([back, alone]), wanted)
