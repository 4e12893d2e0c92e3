"""A part's coordinate system projected out: rigid motions in, nothing out."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from mtu_cli.files.study import Datum
from mtu_cli.model.visits import freedoms, projector


def test_the_freedoms_are_small_rigid_motions() -> None:
    """Against the motion itself: turned about the centre by a small angle and shifted."""
    places = np.array([[10.0, 20.0, 5.0], [110.0, 25.0, 5.0], [15.0, 220.0, 5.0]])
    F = freedoms(places, (0, 1, 2), "offset,rotation")
    assert F.shape == (9, 4)
    angle, shift = 1e-7, np.array([0.1, -0.2, 0.3])
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    centre = places.mean(axis=0)
    moved = centre + (places - centre) @ R.T + shift - places
    assert F @ [*shift, angle] == pytest.approx(moved.ravel(), abs=1e-11)


@pytest.mark.parametrize("datum", get_args(Datum))
@pytest.mark.parametrize("axes", [(0,), (1, 2), (0, 1), (0, 1, 2)])
def test_the_projector_is_that_of_the_pseudoinverse(datum: Datum, axes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 200, (7, 3))
    F = freedoms(places, axes, datum)
    wanted = np.eye(len(F)) - F @ np.linalg.pinv(F)
    assert projector(places, axes, datum) == pytest.approx(wanted, abs=1e-12)
