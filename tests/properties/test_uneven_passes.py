"""Passes that broke off, few runs, coarse displays: what is estimated of them stays a covariance,
and the mean squares behind a variance add up to it.
"""

from __future__ import annotations

import numpy as np
import pytest
from model_examples import Segment, model_of, readings

from mtu_cli.files.machine import Component
from mtu_cli.model.estimates import ComponentEstimate
from mtu_cli.model.estimation import fit_component
from mtu_cli.model.prediction import predict

PLACES = np.linspace(0.0, 350.0, 8)
DESIGNS = 40
POINTS = np.array([[0.0, 0, 0], [100.0, 0, 0], [350.0, 0, 0]])
MEASURANDS = np.vstack([np.eye(3), [-1.0, 0, 1.0]])


def uneven(rng: np.random.Generator, runs: int, degree: int) -> ComponentEstimate:
    """Runs there and back of which one pass lost up to six of its eight readings; or they agree
    to the last digit of a coarse display, or do not scatter.
    """
    lines = rng.choice([0.0, 2.0]) * rng.normal(size=(runs, 1, 2))
    lines = (lines + rng.choice([0.0, 2.0]) * rng.normal(size=(runs, 2, 2))) * [1, 0.01]
    error = lines[..., :1] + lines[..., 1:] * (PLACES - PLACES.mean())
    error = error + rng.normal(size=error.shape)
    error = np.round(error) if rng.random() < 0.3 else error
    kept = np.ones(error.shape, bool)
    kept[0, 0, len(PLACES) - int(rng.integers(0, 7)) :] = False
    found = Segment(
        name="c",
        position=np.tile(PLACES, 2 * runs)[kept.ravel()],
        error=error[kept],
        passes=np.repeat(np.arange(runs) + 1, 2 * len(PLACES))[kept.ravel()],
        direction=np.tile(np.repeat([1, -1], len(PLACES)), runs)[kept.ravel()],
    )
    component = Component(of="x", unit="mm", degree=degree)
    return fit_component(readings([found]), "c", component).estimate


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("runs", [1, 2, 3, 5])
def test_what_few_and_broken_passes_give_is_a_covariance(runs: int, degree: int) -> None:
    rng = np.random.default_rng([runs, degree])
    for _ in range(DESIGNS):
        estimate = uneven(rng, runs, degree)
        C = estimate.covariance
        scale = np.sqrt(np.where(np.diag(C) > 0, np.diag(C), 1.0))
        assert np.linalg.eigvalsh(C / np.outer(scale, scale)).min() > -1e-9
        model = model_of([(estimate, {"x": "1"})], axes=("x",))
        found = predict(model, ["a", "b", "c"], POINTS).variance(MEASURANDS)
        assert (found.total >= 0).all()
        assert (found.dof > 0).all()
        squares = found.squares
        of_mean, of_part = squares.of_mean.sum(axis=0), squares.of_part.sum(axis=0)
        np.testing.assert_allclose(of_mean, found.coefficients, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(of_mean + of_part, found.total, rtol=1e-6)
