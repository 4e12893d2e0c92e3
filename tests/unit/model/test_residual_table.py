"""Residual tables against predictions made point by point and means taken in a loop."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from model_examples import stated
from residual_examples import (
    GROWING,
    MACHINE,
    UNCERTAIN,
    by_cell,
    check_against_loop,
    check_factors,
    codes,
    measured,
    moved,
    residuals,
    rows,
    warm,
    with_operations,
)

from mtu_cli.files.readings import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import InputError
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.residuals import ResidualTable, residual_table
from mtu_cli.model.visits import projector, small_motions

ROTATION: Datum = "offset,rotation"
FREE: list[Datum] = ["offset", ROTATION]


@pytest.mark.parametrize("machine", [GROWING, UNCERTAIN, MACHINE])
@pytest.mark.parametrize("keep", [1.0, 0.4])
def test_errors_are_means_of_measured_less_predicted(
    tmp_path: Path, machine: str, keep: float
) -> None:
    """A temperature that differs between repeats, and uncertain constants."""
    model = stated(tmp_path, machine)
    points = warm(measured(4, 5, 3, keep=keep))
    table, warned = residual_table(model, points, {})
    assert warned == ()
    assert (table.axes, table.component, table.unit) == (("x", "y"), None, "um")
    assert table.parts == ("P0", "P1", "P2", "P3")
    assert (table.repeats.min() == 0) == (keep < 1)
    check_against_loop(model, points, table)
    check_factors(model, points, table)


def test_factors_are_the_covariances_of_predictions(tmp_path: Path) -> None:
    """Nothing in which parts differ moves a coefficient: one design for all."""
    for machine in (MACHINE, UNCERTAIN):
        plain = stated(tmp_path, machine.replace(" + 0.002*dir_x", ""))
        table, _ = residual_table(plain, measured(3, 4, 2, keep=0.5), {})
        assert len(table.common) == len(table.of_part) == 1
        check_factors(plain, measured(3, 4, 2, keep=0.5), table)


def test_operations_are_columns_of_their_own(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = with_operations(measured(3, 4, 2), ["drilled", "milled"])
    table, _ = residual_table(model, points, {})
    assert table.features == ("drilled h0", "drilled h2", "milled h1", "milled h3")
    assert table.operations == ("drilled", "milled")
    assert table.operation.tolist() == [0, 0, 1, 1]
    check_against_loop(model, points, table)
    # The same features in both operations, and rows of which no operation is known.
    both = replace(points, operation=points.repeat - 1)
    table, _ = residual_table(model, both, {})
    assert table.errors.shape == (3, 8, 2)
    check_against_loop(model, both, table)
    untold = replace(both, operation=np.where(both.operation == 1, -1, 0), operations=("drilled",))
    table, _ = residual_table(model, untold, {})
    assert table.features[3:6] == ("drilled h3", "h0", "h1")


def test_parts_stand_in_order_of_manufacture(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(4, 2, 1)
    made = replace(points, sequence=np.array([30, 10, 20, 10])[points.part])
    table, _ = residual_table(model, made, {})
    early = next(points.parts[p] for p in points.part if p in (1, 3))
    assert table.parts == (early, "P3" if early == "P1" else "P1", "P2", "P0")
    assert table.covariates["sequence"].ravel().tolist() == [10, 10, 20, 30]
    x = table.places[..., 0]
    ranges = {"x": [x.min(), x.max()], "sequence": [10.0, 30.0]}
    assert table.ranges(["x", "sequence", "unknown"]) == ranges
    np.testing.assert_allclose(table.mean_places[:, 0], x.mean(axis=0))
    check_against_loop(model, made, table)


def test_z_is_an_axis_with_an_equation_and_a_coordinate(tmp_path: Path) -> None:
    points = measured(4, 3, 2, z=True)
    table, warned = residual_table(stated(tmp_path, MACHINE), points, {})
    assert table.axes == ("x", "y")
    assert codes(warned) == ["axis-without-equation"]
    assert np.isfinite(table.places).all()
    high = MACHINE + "  Ez: py + z*sq\n"
    model = stated(tmp_path, high)
    table, warned = residual_table(model, points, {})
    assert table.axes == ("x", "y", "z")
    assert warned == ()
    check_against_loop(model, points, table)
    check_factors(model, points, table)
    lost = points.measured.copy()
    lost[3, 2] = np.nan
    table, warned = residual_table(model, replace(points, measured=lost), {})
    assert table.axes == ("x", "y")
    assert codes(warned) == ["axis-not-measured"]
    only = stated(tmp_path, high.replace("Ex: px + y*sq + 0.002*dir_x", "").replace("Ey: py", ""))
    with pytest.raises(InputError, match="the machine 'm' has equations for z"):
        residual_table(only, replace(points, measured=lost), {})


# What a datum frees.


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
    freed = before.without_datum(effect[..., None])[..., 0]
    difference = after.errors - before.errors
    there = np.isfinite(difference)
    assert there.all(axis=2).sum() == (before.repeats > 0).sum()
    np.testing.assert_allclose(difference[there], freed[there], rtol=0, atol=1e-13)
    # What is free already is not freed twice.
    np.testing.assert_allclose(before.without_datum(freed[..., None])[..., 0], freed, atol=1e-15)


def _name(points: Points, i: int, operations: int) -> str:
    name = points.features[points.feature[i]]
    return name if operations == 1 else f"{points.operations[points.operation[i]]} {name}"


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
    # What a direction shifts a part by is free.
    assert len(complete.common) == len(complete.of_part) == 1


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
    some = rows(points, np.flatnonzero((points.repeat == 1) | (points.feature > 1)))
    _, warned = residual_table(model, some, {}, "offset")
    assert codes(warned) == ["missing-values"]
    single = rows(points, np.flatnonzero(points.feature == 1))
    with pytest.raises(InputError, match="takes all errors"):
        residual_table(model, single, {}, "offset")


def test_a_ring_may_be_freed_of_centre_and_diameter(tmp_path: Path) -> None:
    """Twelve points of a ring in each part, unevenly about it: what is left is the form."""
    model, points = stated(tmp_path, MACHINE), measured(3, 12, 2)
    angle = 2 * np.pi * (points.feature / 12) ** 1.3
    place = points.nominal.copy()
    place[:, :2] = 100 + 40 * np.column_stack([np.cos(angle), np.sin(angle)])
    ring = replace(points, nominal=place, measured=place + points.measured - points.nominal)
    before, _ = residual_table(model, ring, {}, "offset,diameter")
    larger = 0.01 * (1 + ring.part[:, None]) * np.column_stack([np.cos(angle), np.sin(angle)])
    moved = ring.measured.copy()
    moved[:, :2] += larger + np.array([0.2, -0.1])
    after, _ = residual_table(model, replace(ring, measured=moved), {}, "offset,diameter")
    np.testing.assert_allclose(after.errors, before.errors, atol=1e-13)


# A part's coordinate system projected out: rigid motions in, nothing out.


@pytest.mark.parametrize("datum", get_args(Datum))
@pytest.mark.parametrize("axes", [(0,), (1, 2), (0, 1), (0, 1, 2)])
def test_the_projector_is_that_of_the_pseudoinverse(datum: Datum, axes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 200, (7, 3))
    F = small_motions(places, axes, datum)
    wanted = np.eye(len(F)) - F @ np.linalg.pinv(F)
    assert projector(places, axes, datum) == pytest.approx(wanted, abs=1e-12)
