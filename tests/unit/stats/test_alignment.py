"""Best-fit alignment: rigid motions in, nothing out."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from mtu_cli.files.study import Datum
from mtu_cli.stats.alignment import motion_basis, partial_out, small_motions


@pytest.mark.parametrize("datum", get_args(Datum))
@pytest.mark.parametrize("axes", [(0,), (1, 2), (0, 1), (0, 1, 2)])
def test_the_projector_is_that_of_the_pseudoinverse(datum: Datum, axes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 200, (7, 3))
    F = small_motions(places, axes, datum)
    wanted = np.eye(len(F)) - F @ np.linalg.pinv(F)
    Q = motion_basis(places, axes, datum)
    assert partial_out(Q, np.eye(len(Q))) == pytest.approx(wanted, abs=1e-12)
