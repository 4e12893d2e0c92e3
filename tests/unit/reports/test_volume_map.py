"""The map of a volume: which grids are a plane at all."""

from __future__ import annotations

import numpy as np
import pytest

from mtu_cli.findings import InputError
from mtu_cli.reports.volume_map import _roles

NONE = np.nan


@pytest.mark.parametrize(
    ("points", "why"),
    [
        ([[NONE, NONE, 0], [NONE, NONE, 50]], "z 2"),
        ([[NONE, NONE, NONE]], "no axis in the equations"),
        ([[0, 5, NONE], [9, 5, NONE]], "x 2, y 1"),
    ],
)
def test_a_grid_that_is_no_plane_says_why(points: list[list[float]], why: str) -> None:
    with pytest.raises(InputError) as raised:
        _roles(np.array(points, np.float64))
    (told,) = raised.value.findings
    assert (told.code, told.value) == ("not-applicable", why)


def test_the_axes_with_the_most_places_span_the_map() -> None:
    points = np.array([[x, y, 7.0] for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0)])
    assert _roles(points) == (0, 1, 2)
