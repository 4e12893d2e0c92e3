"""Measured points as tables of errors, lengths and angles, and what cannot be."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_examples import PLACES, part_file, points, study, with_measured

from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points
from mtu_cli.findings import InputError
from mtu_cli.model.measured import angle_tables, feature_tables, length_tables, length_warnings
from mtu_cli.model.visits import only_features, visits_of


def test_feature_tables_are_errors_by_part() -> None:
    found = feature_tables(
        points([("p", "a", 1, 0.01, -0.02), ("q", "a", 1, 0.03, 0.0), ("p", "a", 2, 0.03, -0.04)])
    )
    assert found.labels == (("", "a", "x"), ("", "a", "y"))
    assert found.cells.n.tolist() == [[2, 1], [2, 1]]
    mean = found.cells.origin[:, None] + found.cells.mean
    np.testing.assert_allclose(mean, [[0.02, 0.03], [-0.03, 0.0]], atol=1e-13)
    np.testing.assert_allclose(found.cells.within, [0.0002, 0.0002], rtol=1e-9)


def test_operations_are_apart_and_an_untold_one_too() -> None:
    rows = [("p", "a", 1, 0.01, 0.0), ("p", "a", 1, 0.05, 0.0), ("q", "a", 1, 0.09, 0.0)]
    found = points(rows, ["drilled", "milled", "milled"])
    tables = feature_tables(found)
    assert [label[0] for label in tables.labels] == ["drilled", "milled"] * 2
    assert tables.cells.n[:2].tolist() == [[1, 0], [1, 1]]
    untold = feature_tables(replace(found, operation=np.array([0, 1, -1])))
    assert [label[0] for label in untold.labels[:3]] == ["drilled", "milled", ""]


def test_a_repeat_that_stands_twice() -> None:
    rows = [("p", "a", 1, 0.0, 0.0), ("p", "b", 1, 0.0, 0.0), ("p", "a", 1, 0.1, 0.0)]
    with pytest.raises(InputError, match="row 4, column 'feature': the feature in one repeat"):
        feature_tables(points(rows))
    with pytest.raises(InputError, match="row 4"):
        visits_of(points(rows))
    # Without numbers, rows of a cell are its repeats.
    unnumbered = [(part, name, -1, x, y) for part, name, _, x, y in rows]
    assert feature_tables(points(unnumbered)).cells.n.max() == 2
    assert len(visits_of(points(unnumbered)).part) == 2


def test_lengths_are_distances(tmp_path: Path) -> None:
    found = study(4, 2, 1)
    visits = visits_of(found)
    tables = length_tables(found, visits, part_file(tmp_path))
    assert tables is not None
    assert [label[1] for label in tables.labels] == ["a-b", "c-a"]
    at = {name: found.measured[found.feature == i, :2] for i, name in enumerate(found.features)}
    for i, (start, end) in enumerate((("a", "b"), ("c", "a"))):
        lengths = np.linalg.norm(at[end] - at[start], axis=1)
        errors = lengths - math.dist(PLACES[start], PLACES[end])
        mean = tables.cells.origin[i] + tables.cells.mean[i]
        np.testing.assert_allclose(mean, errors.reshape(4, 2).mean(axis=1), atol=1e-12)


def test_angle_is_that_of_equations_24_to_26(tmp_path: Path) -> None:
    found = study(3, 1, 5)
    angles = angle_tables(found, visits_of(found), part_file(tmp_path))
    assert angles is not None
    a, b, c = (found.measured[found.feature == i, :2].T for i in range(3))
    row, column = (b - a)[1] / (b - a)[0], (c - a)[0] / (c - a)[1]
    # By design the row rises by 1 in 100 and the column leans by 2 in 200.
    value = angles.cells.origin[0] + angles.cells.mean[0]
    np.testing.assert_allclose(value, -column - row + 0.02, rtol=1e-9)


def in_space(found: Points, part: LoadedPart, z: float) -> tuple[Points, LoadedPart]:
    """The same study with hole b `z` higher by design, measured `z` + 0.003 higher."""
    raised = part.part.features["b"].model_copy(update={"z_mm": z})
    features = {**part.part.features, "b": raised}
    features |= {n: part.part.features[n].model_copy(update={"z_mm": 0.0}) for n in "ac"}
    nominal, measured = found.nominal.copy(), found.measured.copy()
    high = found.feature == found.features.index("b")
    nominal[:, 2] = np.where(high, z, 0.0)
    measured[:, 2] = np.where(high, z + 0.003, 0.0)
    changed = replace(part, part=part.part.model_copy(update={"features": features}))
    return replace(found, nominal=nominal, measured=measured), changed


def test_lengths_use_the_axes_that_were_measured_at_every_end(tmp_path: Path) -> None:
    found, part = in_space(study(2, 1, 1, 0.0, 0.0), part_file(tmp_path), 50.0)
    tables = length_tables(found, visits_of(found), part)
    assert tables is not None
    long = math.hypot(100, 1, 50.003) - math.hypot(100, 1, 50)
    np.testing.assert_allclose(tables.cells.origin, [long, 0], atol=1e-12)
    assert length_warnings(found, part) == []
    measured = found.measured.copy()
    measured[0, 2] = np.nan
    partly = with_measured(found, measured)
    flat = length_tables(partly, visits_of(partly), part)
    assert flat is not None
    # Not one part in space and the other in the plane.
    np.testing.assert_allclose(flat.cells.origin[:, None] + flat.cells.mean, 0, atol=1e-12)
    (warning,) = length_warnings(partly, part)
    assert warning.code == "axis-not-measured"


def test_what_was_not_measured_is_left_out(tmp_path: Path) -> None:
    part = part_file(tmp_path)
    found = points([("p", "a", 1, 0.0, 0.0), ("p", "b", 1, 0.0, 0.0), ("q", "a", 1, 0.0, 0.0)])
    lengths = length_tables(found, visits_of(found), part)
    assert lengths is not None
    assert lengths.labels == (("", "a-b", ""),)
    assert lengths.cells.n.tolist() == [[1, 0]]
    assert angle_tables(found, visits_of(found), part) is None
    alone = only_features(found, ["c"])
    assert len(alone) == 0
    few = only_features(found, ["b", "nobody"])
    assert (few.features, few.row.tolist()) == (("b",), [3])
