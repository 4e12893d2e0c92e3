"""A cell without its covariate costs its row, not the covariate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import Segment, readings, stated
from numpy.typing import NDArray
from reading_examples import in_table_order, machine, run
from residual_examples import MACHINE, codes, measured

from mtu_cli.close_loop_sealed.model.covariate_tables import FEW, without_gaps
from mtu_cli.close_loop_sealed.model.reading_tables import reading_tables
from mtu_cli.close_loop_sealed.model.residual_table import residual_table
from mtu_cli.files.points import Points
from mtu_cli.findings import InputError
from mtu_cli.model.visits import only_rows


def with_gaps(**rows: list[int]) -> Points:
    """Points with covariates of which some rows are empty."""
    points = measured(5, 8, 2)
    columns = {}
    for name, empty in rows.items():
        columns[name] = np.arange(len(points), dtype=float)
        columns[name][empty] = np.nan
    return replace(points, covariates=columns)


def test_the_table_is_that_of_the_other_rows(tmp_path: Path) -> None:
    model, points = stated(tmp_path, MACHINE), with_gaps(T_room_degC=[17], tool_parts=[17, 40])
    kept = np.ones(len(points), bool)
    kept[[17, 40]] = False
    table, warned = residual_table(model, points)
    other, _ = residual_table(model, only_rows(points, kept))
    np.testing.assert_array_equal(table.errors, other.errors)
    np.testing.assert_array_equal(table.repeats, other.repeats)
    for name in ("T_room_degC", "tool_parts"):
        np.testing.assert_array_equal(table.covariates[name], other.covariates[name])
    assert codes(warned) == ["missing-values"]
    file = points.sources[0].shown
    assert warned[0].facts["names"] == ["T_room_degC", "tool_parts"]
    first = f"2 of 80 rows left out, the first {file}, row {points.row[17]}"
    assert warned[0].facts["consequence"] == first


def test_many_gaps_cost_the_covariate(tmp_path: Path) -> None:
    """Of two columns whose gaps are too many together, the one that has fewer stays."""
    points = with_gaps(rare=[3], often=[4, 5, 6, 7], most=list(range(30)))
    assert 4 <= FEW * len(points) < 5
    kept, warned = without_gaps(points, ())
    assert len(kept) == len(points) - 1
    assert warned[0].facts["names"] == ["rare"]
    table, told = residual_table(stated(tmp_path, MACHINE), points)
    assert {"rare"} <= set(table.covariates)
    assert not {"often", "most"} & set(table.covariates)
    assert [item.facts["names"] for item in told] == [
        ["rare"],
        ["often (4 of 79 rows)", "most (29 of 79 rows)"],
    ]


def test_a_column_that_a_whole_file_lacks_is_told_with_the_file(tmp_path: Path) -> None:
    points = with_gaps(T_room_degC=list(range(60, 80)), load=[0, 1, 2, 3, 79])
    second = replace(points.sources[0], shown="b.csv")
    index = (np.arange(len(points)) >= 60).astype(np.int64)
    points = replace(points, file_index=index, sources=(*points.sources, second))
    _, (told,) = residual_table(stated(tmp_path, MACHINE), points)
    rows = ["T_room_degC (20 of 80 rows, all of b.csv)", "load (5 of 80 rows)"]
    assert told.facts["names"] == rows


def test_a_column_without_any_value_is_told(tmp_path: Path) -> None:
    points = with_gaps(T_room_degC=list(range(80)))
    table, (told,) = residual_table(stated(tmp_path, MACHINE), points)
    assert told.message.startswith("cells missing (T_room_degC (80 of 80 rows, all of ")
    assert "T_room_degC" not in table.covariates


def test_a_covariate_of_the_model_must_be_whole(tmp_path: Path) -> None:
    machine = MACHINE.replace("Ex: ", "Ex: 1e-9*T_room_degC*x + ", 1)
    assert machine != MACHINE
    model, points = stated(tmp_path, machine), with_gaps(T_room_degC=[17])
    with pytest.raises(InputError, match="empty cell"):
        residual_table(model, points)
    assert without_gaps(points, model.covariates()) == (points, [])


@pytest.mark.parametrize("whole", ["part", "feature", "same"])
def test_no_part_or_feature_goes_for_a_covariate(whole: str) -> None:
    """Nor a row for one that is the same everywhere, of which there is nothing to test."""
    points = measured(30, 30, 1)
    column = np.arange(len(points), dtype=float)
    if whole == "same":
        column[:] = 7.0
        column[3] = np.nan
    else:
        column[getattr(points, whole) == 4] = np.nan
    points = replace(points, covariates={"batch": column, "empty": column * np.nan})
    assert np.isnan(column).sum() <= FEW * len(points)
    assert without_gaps(points, ()) == (points, [])


def test_gaps_are_told_where_the_datum_takes_points_too(tmp_path: Path) -> None:
    points = with_gaps(tool_parts=[17])
    alone = (points.part != 0) | (points.feature == 0)
    kept = only_rows(points, alone)
    _, warned = residual_table(stated(tmp_path, MACHINE), kept, None, "offset")
    assert {"missing-values", "not-measured"} <= set(codes(warned))


def test_a_reading_without_a_covariate_goes_and_the_covariate_stays(tmp_path: Path) -> None:
    """As for rows of points, component by component: 2 of 40 readings, none of them the only one
    of its pass or target; the table is that of the others.
    """
    found = readings([run(5)])
    load = np.linspace(0.0, 9.0, 40)
    whole = replace(found, covariates={"load": load})
    load = load.copy()
    load[[3, 17]] = np.nan
    gaps = replace(found, covariates={"load": load})
    (table,), warned = reading_tables(machine(tmp_path), None, gaps)
    (told,) = warned
    file = whole.sources[0].shown
    assert told.code == "missing-values"
    first = f"2 of 40 rows of px left out, the first {file}, row {found.row[3]}"
    assert (told.facts["names"], told.facts["consequence"]) == (["load"], first)
    assert "load" in table.covariates
    assert (table.repeats == 0).sum() == 2
    (before,), _ = reading_tables(machine(tmp_path), None, whole)
    assert before.parts == table.parts
    X = np.column_stack([np.ones(40), found.position_mm])
    kept = np.isfinite(load)
    line = np.linalg.lstsq(X[kept], found.error[kept], rcond=None)[0]
    expected = (found.error - X @ line)[in_table_order(found)].reshape(before.errors.shape)
    there = table.repeats > 0
    np.testing.assert_allclose(table.errors[there], expected[there], atol=1e-14)


@pytest.mark.parametrize("gone", [[3, 11, 17], [40]])
def test_many_readings_or_the_only_one_of_a_target_stay(tmp_path: Path, gone: list[int]) -> None:
    """Then the covariate goes: 3 of 41, or the one that was read at 60 mm."""
    one = replace(run(1), position=np.array([60.0]), error=np.zeros(1), passes=np.array([5]),
                  direction=np.array([1]), time=np.array([99.0]))  # fmt: skip
    found = readings([run(5), one])
    load = np.linspace(0.0, 9.0, len(found))
    load[gone] = np.nan
    (table,), (told,) = reading_tables(
        machine(tmp_path), None, replace(found, covariates={"load": load})
    )
    assert "load" not in table.covariates
    assert told.code == "missing-values"
    assert table.repeats.sum() == len(found)


@pytest.mark.parametrize("passes", [None, np.repeat(np.arange(20) + 1, 3)])
def test_passes_without_an_axis_keep_their_count(
    tmp_path: Path, passes: NDArray[np.int64] | None
) -> None:
    """A reading that is a whole pass stays, and one of three goes: 60 or 20 passes are left."""
    error = 1e-6 * np.arange(60.0) ** 2
    found = readings([Segment(name="ort", position=None, error=error, passes=passes)])
    load = np.linspace(0.0, 9.0, 60)
    load[3] = np.nan
    (table,), (told,) = reading_tables(
        machine(tmp_path), None, replace(found, covariates={"load": load})
    )
    assert told.code == "missing-values"
    assert ("load" in table.covariates) == (passes is not None)
    assert table.parts == tuple(str(i + 1) for i in range(60 if passes is None else 20))
    assert table.repeats.sum() == (60 if passes is None else 59)


def test_a_reading_without_a_direction_stays(tmp_path: Path) -> None:
    found = readings([run(5)])
    direction = found.direction.copy()
    direction[3] = 0
    (table,), _ = reading_tables(machine(tmp_path), None, replace(found, direction=direction))
    assert table.repeats.sum() == 40
