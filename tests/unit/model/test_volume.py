"""Grids of places over a machine's volume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from model_examples import loaded
from numpy.typing import NDArray

from mtu_cli.findings import InputError
from mtu_cli.model.features import grid_of
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.machine_model import build_model

SPACE = """\
axes: {x: {travel_mm: [0, 100]}, y: {travel_mm: [20, 60]}}
components:
  px: {of: x, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
  sq: {unit: urad, coefficients: [50], u_future: 1}
equations: {Ex: px + y*sq}
"""


def grid(
    folder: Path, text: str, machine: str = SPACE
) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    known = loaded(folder, machine)
    return grid_of(known, build_model(known, estimates_from_fit(known, None)), text)


def test_every_axis_has_its_count_from_end_to_end(tmp_path: Path) -> None:
    """y is needed by a lever arm alone, z by nothing."""
    ids, points = grid(tmp_path, "3,2")
    assert ids == ("0,20", "0,60", "50,20", "50,60", "100,20", "100,60")
    expected = [[x, y] for x in (0.0, 50.0, 100.0) for y in (20.0, 60.0)]
    assert points[:, :2].tolist() == expected
    assert np.isnan(points[:, 2]).all()
    assert len(grid(tmp_path, "4")[0]) == 16


def test_more_places_than_a_covariance_holds(tmp_path: Path) -> None:
    assert len(grid(tmp_path, "60,50")[0]) == 3000
    with pytest.raises(InputError, match="at most 3000 places, not 3050"):
        grid(tmp_path, "61,50")
    # Before so many are made.
    with pytest.raises(InputError, match="at most 3000 places, not 10000000000"):
        grid(tmp_path, "100000,100000,100000")
