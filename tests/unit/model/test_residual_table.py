"""Residual tables against predictions made point by point and means taken in a loop."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compare_trials import fitted
from model_examples import stated
from numpy.typing import NDArray
from residual_examples import (
    GROWING,
    MACHINE,
    UNCERTAIN,
    check_against_loop,
    check_factors,
    codes,
    measured,
    residuals,
    rows,
    warm,
    with_operations,
)

from mtu_cli.close_loop_sealed.model import residual_factors
from mtu_cli.close_loop_sealed.model.residual_layout import filled
from mtu_cli.close_loop_sealed.model.residual_table import residual_table
from mtu_cli.findings import InputError

Floats = NDArray[np.float64]


@pytest.mark.parametrize("keep", [1.0, 0.4])
def test_errors_are_means_of_measured_less_predicted(tmp_path: Path, keep: float) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(5, 4, 3, keep=keep)
    table, warned = residual_table(model, points, {})
    assert warned == ()
    assert table.axes == ("x", "y")
    assert table.component is None
    assert table.unit == "um"
    assert table.parts == ("P0", "P1", "P2", "P3", "P4")
    assert table.features == ("h0", "h1", "h2", "h3")
    assert table.fitted_degree == -1
    assert table.datum == "none"
    assert table.repeats.max() == 3
    assert (table.repeats.min() == 0) == (keep < 1)
    check_against_loop(model, points, table)


@pytest.mark.parametrize("piece", [1, 7, 8192])
@pytest.mark.parametrize("machine", [GROWING, UNCERTAIN, MACHINE])
def test_covariates_of_points_and_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece: int, machine: str
) -> None:
    """A temperature that differs between repeats, and constants of which some pieces see
    nothing.
    """
    monkeypatch.setattr(residual_factors, "PIECE", piece)
    model = stated(tmp_path, machine)
    points = warm(measured(4, 5, 2, keep=0.7))
    table, _ = residual_table(model, points, {})
    check_against_loop(model, points, table)
    check_factors(model, points, table)


def test_factors_are_the_covariances_of_predictions(tmp_path: Path) -> None:
    for machine in (MACHINE, UNCERTAIN):
        model = stated(tmp_path, machine)
        table, _ = residual_table(model, measured(3, 4, 2), {})
        check_factors(model, measured(3, 4, 2), table)
        # Nothing in which parts differ moves a coefficient: one design for all.
        plain = stated(tmp_path, machine.replace(" + 0.002*dir_x", ""))
        table, _ = residual_table(plain, measured(3, 4, 2, keep=0.5), {})
        assert len(table.common) == len(table.of_part) == 1
        check_factors(plain, measured(3, 4, 2, keep=0.5), table)


def test_coefficients_without_uncertainty_have_factors_of_no_width(tmp_path: Path) -> None:
    model = stated(
        tmp_path, "components: {px: {of: x, unit: um, coefficients: [1, 2]}}\nequations: {Ex: px}\n"
    )
    table, warned = residual_table(model, measured(3, 4, 1), {})
    assert table.common.shape == (1, 4, 1, 0) == table.of_part.shape
    assert codes(warned) == ["axis-without-equation"]
    assert table.axes == ("x",)


def test_factors_at_cells_that_were_not_measured_are_finite(tmp_path: Path) -> None:
    model = stated(tmp_path, GROWING)
    table, _ = residual_table(model, warm(measured(6, 5, 1, keep=0.3)), {})
    assert (table.repeats == 0).any()
    for values in (table.common, table.of_part, table.places[..., :2]):
        assert np.isfinite(values).all()
    missing = np.argwhere(table.repeats == 0)[0]
    there = table.repeats[:, missing[1]] > 0
    np.testing.assert_allclose(
        table.common[tuple(missing)], table.common[there, missing[1]].mean(axis=0), atol=1e-15
    )


def test_missing_cells_have_the_digits_of_their_equals() -> None:
    """The sum of three 0.1 is not 0.3; a column without any has the mean of its part."""
    table = np.full((4, 3, 1), np.nan)
    table[:3, 0], table[:3, 1] = 0.1, [[1.0], [2.0], [6.0]]
    table[3, 1] = 3.0
    found = filled(table, np.isfinite(table[..., 0]))
    assert found[:, 0].tolist() == [[0.1]] * 4
    assert found[:3, 1].tolist() == [[1.0], [2.0], [6.0]]
    np.testing.assert_allclose(found[:, 2, 0], [0.55, 1.05, 3.05, 3.0], rtol=1e-15)


def test_operations_are_columns_of_their_own(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = with_operations(measured(3, 4, 2), ["drilled", "milled"])
    table, _ = residual_table(model, points, {})
    assert table.features == ("drilled h0", "drilled h2", "milled h1", "milled h3")
    assert table.operations == ("drilled", "milled")
    assert table.operation.tolist() == [0, 0, 1, 1]
    check_against_loop(model, points, table)
    # The same features in both operations, and one row of an operation that nobody told.
    both = replace(points, operation=points.repeat - 1)
    table, _ = residual_table(model, both, {})
    assert table.errors.shape == (3, 8, 2)
    assert (table.repeats == 1).all()
    check_against_loop(model, both, table)
    untold = replace(both, operation=np.where(both.operation == 1, -1, 0), operations=("drilled",))
    table, _ = residual_table(model, untold, {})
    assert table.features[3:6] == ("drilled h3", "h0", "h1")
    alone = replace(points, operations=("drilled",), operation=np.zeros(len(points), np.int64))
    assert residual_table(model, alone, {})[0].features == ("h0", "h1", "h2", "h3")


def test_parts_stand_in_order_of_manufacture(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(4, 2, 1)
    made = replace(points, sequence=np.array([30, 10, 20, 10])[points.part])
    table, _ = residual_table(model, made, {})
    early = next(points.parts[p] for p in points.part if p in (1, 3))
    assert table.parts == (early, "P3" if early == "P1" else "P1", "P2", "P0")
    assert table.covariates["sequence"].ravel().tolist() == [10, 10, 20, 30]
    check_against_loop(model, made, table)
    some = replace(points, features=("unused", *points.features), feature=points.feature + 1,
                   parts=("none", *points.parts), part=points.part + 1)  # fmt: skip
    table, _ = residual_table(model, some, {})
    assert table.parts == points.parts
    assert table.features == points.features


@pytest.mark.parametrize("shape", [(1, 6, 3), (6, 1, 3), (1, 1, 2), (5, 3, 1)])
def test_few_parts_and_few_features(tmp_path: Path, shape: tuple[int, int, int]) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(*shape)
    table, warned = residual_table(model, points, {})
    assert warned == ()
    assert table.errors.shape == (*shape[:2], 2)
    check_against_loop(model, points, table)
    check_factors(model, points, table)


def test_one_feature_a_part_and_parts_measured_half(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(5, 5, 2)
    single = rows(points, np.flatnonzero(points.part == points.feature))
    table, _ = residual_table(model, single, {})
    assert (table.repeats == 2 * np.eye(5, dtype=int)).all()
    check_against_loop(model, single, table)
    assert np.isfinite(table.common).all()
    assert np.isfinite(table.places[..., :2]).all()
    half = rows(points, np.flatnonzero((points.part > 1) | (points.feature < 2)))
    table, _ = residual_table(model, half, {})
    assert table.repeats[:2].tolist() == [[2, 2, 0, 0, 0]] * 2
    check_against_loop(model, half, table)
    check_factors(model, half, table)


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


def test_a_coordinate_that_the_machine_fixes_is_the_machines(tmp_path: Path) -> None:
    fixed = "constants: {z: 127.0}\n" + MACHINE.strip() + "\n"
    table, _ = residual_table(stated(tmp_path, fixed), measured(3, 2, 1), {})
    assert (table.places[..., 2] == 127.0).all()


def test_places_that_differ_between_parts_are_used(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    points = measured(4, 3, 2)
    shift = np.where(points.part[:, None] == 2, [50.0, -20.0, 0.0], 0.0)
    turned = replace(points, nominal=points.nominal + shift, measured=points.measured + shift)
    table, _ = residual_table(model, turned, {})
    check_against_loop(model, turned, table)
    check_factors(model, turned, table)
    assert len(table.common) == 4


def test_places_and_temperatures_beyond_the_fit_are_told(tmp_path: Path) -> None:
    model = stated(tmp_path, MACHINE)
    terms = tuple(
        replace(term, estimate=replace(term.estimate, position_range=(0.0, 10.0)))
        if term.estimate.of
        else term
        for term in model.terms
    )
    _, warned = residual_table(replace(model, terms=terms), measured(3, 2, 1), {})
    assert set(codes(warned)) == {"outside-measured-range"}


def test_a_table_takes_a_fraction_of_the_loop(tmp_path: Path) -> None:
    model = stated(tmp_path, GROWING)
    points = warm(measured(8, 10, 3))

    def seconds(run: object) -> float:
        start = time.process_time()
        run()  # type: ignore[operator]  # a callable
        return time.process_time() - start

    loop = seconds(lambda: residuals(model, points, (0, 1), {}))
    table = min(seconds(lambda: residual_table(model, points, {})) for _ in range(3))
    assert table < loop / 4


def test_an_axis_was_read_as_far_as_any_of_its_components() -> None:
    """One along x goes farther at one end, another at the other; what has no axis tells nothing."""
    model = fitted(9, 7)
    ends = {0: (-20.0, 130.0), 1: (15.0, 900.0), 2: None}
    terms = [
        replace(
            term,
            estimate=replace(
                term.estimate, position_range=ends.get(i, term.estimate.position_range)
            ),
        )
        for i, term in enumerate(model.terms)
    ]
    found = residual_factors.read_ranges(replace(model, terms=tuple(terms)))
    assert found == {"x": (-20.0, 900.0), "y": (10.0, 140.0)}
