"""Features of a part, and grids of places over a machine's volume."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import loaded, part_of

from mtu_cli.files.machine import LoadedMachine
from mtu_cli.findings import InputError
from mtu_cli.model.features import feature_points, grid_of, outside_warnings
from mtu_cli.model.fit import estimates_from_fit
from mtu_cli.model.machine_model import MachineModel, build_model
from mtu_cli.model.prediction import predict
from mtu_cli.stats.least_squares import FloatArray

SPACE = """\
axes: {x: {travel_mm: [0, 100]}, y: {travel_mm: [20, 60]}}
components:
  px: {of: x, unit: um, coefficients: [0, 0], covariance: [[0, 0], [0, 0]], s_repeat: 0}
  sq: {unit: urad, coefficients: [50], u_future: 1}
equations: {Ex: px + y*sq}
"""


def grid(folder: Path, text: str, machine: str = SPACE) -> tuple[tuple[str, ...], FloatArray]:
    known = loaded(folder, machine)
    return grid_of(known, build(known), text)


def build(known: LoadedMachine) -> MachineModel:
    return build_model(known, estimates_from_fit(known, None))


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


def test_features_have_the_coordinates_that_the_equations_need(tmp_path: Path) -> None:
    """One that the machine fixes is the machine's, which is warned of; so are places beyond the
    measured range.
    """
    part = part_of(tmp_path, "features: {a: {x_mm: 1, y_mm: 2, z_mm: 5}, b: {x_mm: 140, y_mm: 2}}")
    fixed = "constants: {z: 127}\n" + SPACE.replace("px + y*sq", "px + z*sq")
    model = build(loaded(tmp_path, fixed))
    ids, points, (warned,) = feature_points(part, model)
    assert (ids, warned.code) == (("a", "b"), "not-used")
    px = replace(model.terms[0].estimate, position_range=(0.0, 100.0))
    seen = replace(model, terms=(replace(model.terms[0], estimate=px), *model.terms[1:]))
    (outside,) = outside_warnings(predict(seen, ids, points))
    assert "feature 'b' at 140 mm" in outside.message
    needing = build(loaded(tmp_path, SPACE.replace("px + y*sq", "px + z*sq")))
    with pytest.raises(InputError, match="without a z, of feature 'b'"):
        feature_points(part, needing)
