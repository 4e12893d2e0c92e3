"""Hand-set part coordinate systems projected out of residual tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import stated
from numpy.typing import NDArray
from residual_examples import (
    MACHINE,
    by_cell,
    measured,
    moved,
    residuals,
    rows,
    with_operations,
)

from mtu_cli.close_loop_sealed.model.residual_table import ResidualTable, residual_table
from mtu_cli.files.points import Points
from mtu_cli.findings import InputError
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.visits import Datum

Floats = NDArray[np.float64]
ROTATION: Datum = "offset,rotation"
FREE: list[Datum] = ["offset", ROTATION]


def whole_parts(points: Points) -> Points:
    """Parts lack features here, but all repeats of a part have the same."""
    lacking = ((points.part == 1) & (points.feature == 2)) | (
        (points.part == 3) & (points.feature < 2)
    )
    return rows(points, np.flatnonzero(~lacking))


def check_against_motions(
    model: MachineModel, points: Points, table: ResidualTable, datum: Datum
) -> None:
    """Least-squares motions of each measurement, fitted one by one."""
    axes = ["xyz".index(axis) for axis in table.axes]
    plain = residuals(model, points, axes, {})
    left = moved(points, plain, axes, turning=datum == ROTATION)
    for (part, feature), own in by_cell(points, left).items():
        place = table.parts.index(part), table.features.index(feature)
        np.testing.assert_allclose(table.errors[place], sum(own) / len(own), rtol=0, atol=1e-12)


@pytest.mark.parametrize("datum", FREE)
@pytest.mark.parametrize("z", [False, True])
def test_errors_less_the_motion_of_each_measurement(tmp_path: Path, datum: Datum, z: bool) -> None:
    model = stated(tmp_path, MACHINE + ("  Ez: py + z*sq\n" if z else ""))
    points = whole_parts(measured(5, 6, 3, z=z))
    for found in (points, with_operations(points, ["drilled", "milled"])):
        table, warned = residual_table(model, found, {}, datum)
        assert warned == ()
        assert table.datum == datum
        check_against_motions(model, found, table, datum)


@pytest.mark.parametrize("datum", FREE)
def test_motions_of_parts_are_not_seen(tmp_path: Path, datum: Datum) -> None:
    """Another offset and rotation of every measurement changes nothing, repeats included."""
    model = stated(tmp_path, MACHINE)
    points = whole_parts(measured(5, 6, 3))
    rng = np.random.default_rng(5)
    shift = rng.normal(0, 0.05, (5, 4, 3))[points.part, points.repeat]
    turn = rng.normal(0, 1e-4, (5, 4))[points.part, points.repeat] * (datum == ROTATION)
    x, y = points.nominal[:, 0], points.nominal[:, 1]
    shift[:, :2] += turn[:, None] * np.column_stack([-y, x])
    before, _ = residual_table(model, points, {}, datum)
    after, _ = residual_table(model, replace(points, measured=points.measured + shift), {}, datum)
    np.testing.assert_allclose(after.errors, before.errors, atol=1e-14)
    np.testing.assert_allclose(after.repeat_variance, before.repeat_variance, rtol=1e-9)
    assert after.repeat_dof == before.repeat_dof


@pytest.mark.parametrize("datum", FREE)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("operations", [1, 2])
def test_candidates_are_projected_as_errors_are(
    tmp_path: Path, datum: Datum, turned: bool, operations: int
) -> None:
    """An effect added to the points adds its freed column: missing holes, operations and parts
    that lay turned on the table.
    """
    model = stated(tmp_path, MACHINE)
    points = with_operations(whole_parts(measured(5, 8, 2)), ["a", "b"][:operations])
    if turned:
        place = points.nominal.copy()
        of = points.part == 2
        place[of, :2] = np.column_stack([-place[of, 1], place[of, 0]]) + 300
        points = replace(points, nominal=place, measured=place + points.measured - points.nominal)
    plain, _ = residual_table(model, points, {}, "none")
    before, _ = residual_table(model, points, {}, datum)
    check_against_motions(model, points, before, datum)
    effect = np.stack(
        [1e-5 * plain.places[..., 0] ** 2 / 300, 2e-3 * np.sin(plain.places[..., 1] / 40)], axis=2
    )
    effect[2] *= 3
    index = {name: h for h, name in enumerate(plain.features)}
    own = np.array([index[_name(points, i, operations)] for i in range(len(points))])
    added = points.measured.copy()
    added[:, :2] += effect[points.part, own]
    after, _ = residual_table(model, replace(points, measured=added), {}, datum)
    freed = before.freed(effect[..., None])[..., 0]
    difference = after.errors - before.errors
    there = np.isfinite(difference)
    assert there.all(axis=2).sum() == (before.repeats > 0).sum()
    np.testing.assert_allclose(difference[there], freed[there], rtol=0, atol=1e-13)
    # What is free already is not freed twice.
    np.testing.assert_allclose(before.freed(freed[..., None])[..., 0], freed, atol=1e-15)


def _name(points: Points, i: int, operations: int) -> str:
    name = points.features[points.feature[i]]
    return name if operations == 1 else f"{points.operations[points.operation[i]]} {name}"


@pytest.mark.parametrize("datum", FREE)
@pytest.mark.parametrize("machine", [MACHINE, MACHINE.replace(" + 0.002*dir_x", " + sq*dir_x")])
def test_factors_are_projected(tmp_path: Path, datum: Datum, machine: str) -> None:
    model = stated(tmp_path, machine)
    points = whole_parts(measured(5, 6, 2))
    plain, _ = residual_table(model, points, {})
    free, _ = residual_table(model, points, {}, datum)
    P, _, A = plain.errors.shape
    for before, after in ((plain.common, free.common), (plain.of_part, free.of_part)):
        for p in range(P):
            h = np.flatnonzero(plain.repeats[p])
            axes = np.eye(A)
            columns = [np.tile(axes[k], len(h)) for k in range(A)]
            if datum == ROTATION:
                x, y = (plain.places[p, h, k] for k in (0, 1))
                columns.append(np.column_stack([-(y - y.mean()), x - x.mean()]).ravel())
            X = np.column_stack(columns)
            M = np.eye(len(X)) - X @ np.linalg.pinv(X)
            wide = (np.broadcast_to(f, (P, *f.shape[1:]))[p, h] for f in (before, after))
            F, E = (own.reshape(len(h) * A, own.shape[-1]) for own in wide)
            size = np.abs(F @ F.T).max()
            np.testing.assert_allclose(E @ E.T, M @ F @ F.T @ M, rtol=0, atol=1e-10 * size)
    complete, _ = residual_table(model, measured(5, 6, 2), {}, datum)
    assert len(complete.common) == len(complete.of_part) == (1 if machine == MACHINE else 5)


@pytest.mark.parametrize("datum", [*FREE, "none"])
def test_repeats_keep_their_variance(tmp_path: Path, datum: Datum) -> None:
    """Chi-squared of many repeats about sigma^2: the motions' degrees of freedom are gone."""
    model = stated(tmp_path, MACHINE)
    points = measured(60, 5, 4, sigma=0.004, seed=8)
    table, _ = residual_table(model, points, {}, datum)
    cells, visits = 60 * 5, 60 * 4
    full = 60 * 5 * 4 - cells
    motions = {"none": 0.0, "offset": 1.0, ROTATION: 1.5}[datum]
    assert table.repeat_dof <= full * (1 - motions * visits / (60 * 5 * 4)) + 1e-9
    error = np.sqrt(2 / table.repeat_dof)
    assert np.abs(table.repeat_variance / 0.004**2 - 1).max() < 3.5 * error
    # Without the motions' own, the figure would be far away.
    assert datum == "none" or full / table.repeat_dof - 1 > 3.5 * error


def test_measurements_of_other_features_are_told(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(4, 6, 2)
    some = rows(points, np.flatnonzero((points.repeat == 1) | (points.feature > 1)))
    table, warned = residual_table(model, some, {}, ROTATION)
    assert [item.code for item in warned] == ["missing-values"]
    assert np.isfinite(table.errors).all()
    # The table is free of motions as a whole, too.
    np.testing.assert_allclose(
        table.freed(table.errors[..., None])[..., 0], table.errors, atol=1e-14
    )


def test_measurements_that_the_motions_take_whole_are_left_out(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(4, 5, 2)
    one = rows(points, np.flatnonzero((points.part != 3) | (points.feature == 1)))
    table, warned = residual_table(model, one, {}, "offset")
    assert [item.code for item in warned] == ["not-measured"]
    assert warned[0].facts["count"] == 2
    assert table.parts == ("P0", "P1", "P2")
    assert (table.repeats == 2).all()
    assert table.covariates["sequence"].ravel().tolist() == [1, 2, 3]
    first = rows(points, np.flatnonzero((points.repeat == 1) | (points.feature == 0)))
    table, _ = residual_table(model, first, {}, "offset")
    assert (table.repeats == 1).all()
    single = rows(points, np.flatnonzero(points.feature == 1))
    with pytest.raises(InputError, match="takes all errors"):
        residual_table(model, single, {}, "offset")
