"""What passes of a virtual machine differ by: variances by many draws against those declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from model_examples import estimate, model_of

from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.simulate import (
    PartsPlan,
    pass_root,
    simulate_points,
)
from mtu_cli.stats.least_squares import FloatArray

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
