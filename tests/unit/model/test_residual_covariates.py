"""Covariates of residual tables, and temperatures whose history or noise counts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model_examples import stated
from numpy.typing import NDArray
from residual_examples import (
    GROWING,
    MACHINE,
    by_cell,
    check_against_loop,
    codes,
    measured,
    rows,
    warm,
)
from thermal_machines import SENSORS, line
from thermal_machines import machine as warm_machine

from mtu_cli.analyses.correct import correct
from mtu_cli.close_loop_sealed.model.residual_table import residual_table
from mtu_cli.files.points import Points
from mtu_cli.findings import InputError
from mtu_cli.model.settings import Settings

Floats = NDArray[np.float64]


def test_covariates_have_their_smallest_shape(tmp_path: Path) -> None:
    points = measured(4, 3, 2, keep=0.6)
    n = len(points)
    rng = np.random.default_rng(0)
    columns = {
        "T_room_degC": np.full(n, 21.5),
        "tool_parts": points.part % 2 + 0.1,
        "depth": points.feature * 0.3,
        "T_bed_degC": points.part + 0.1 * points.feature,
        "T_cmm_degC": rng.normal(20, 1, n),
        "gap": np.where(np.arange(n) == 3, np.nan, 1.0),
        "hole": np.where(np.arange(n) < 5, np.nan, 1.0),
        "who": np.array(["a"] * n, object),
        "worn": np.array(["", "3", "n/a", *["2"] * (n - 6), "-", "", "4"], object),
    }
    points = replace(points, covariates=columns)
    table, warned = residual_table(stated(tmp_path, MACHINE), points, {})
    shapes = {name: value.shape for name, value in table.covariates.items()}
    assert shapes == {
        "dir_x": (4, 1), "dir_y": (4, 1), "sequence": (4, 1), "time_min": (4, 3),
        "T_room_degC": (1, 1), "tool_parts": (4, 1), "depth": (1, 3), "T_bed_degC": (4, 3),
        "T_cmm_degC": (4, 3),
    }  # fmt: skip
    assert codes(warned) == ["not-tested", "missing-values"]
    assert "gap (1 of" in warned[1].message
    assert "hole (5 of" in warned[1].message
    shown = points.sources[0].shown
    first = f"the first 'n/a' in {shown}, row {points.row[2]}"
    told = f"texts in 2 of {n - 2} cells, {first}; where that means not known, leave it empty"
    mixed = f"'worn' ({told})"
    assert warned[0].facts["items"] == ["'who'", mixed]
    for p in range(4):
        for h in range(3):
            own = (points.part == p) & (points.feature == h)
            of_part = [
                columns["T_cmm_degC"][(points.part == p) & (points.feature == k)].mean()
                for k in range(3)
                if ((points.part == p) & (points.feature == k)).any()
            ]
            expected = columns["T_cmm_degC"][own].mean() if own.any() else np.mean(of_part)
            assert table.covariates["T_cmm_degC"][p, h] == pytest.approx(expected, rel=1e-14)
    # Two readings of one part that average to the same in every hole are one a part.
    wobble = replace(measured(3, 2, 2), covariates={})
    wobble = replace(wobble, covariates={"T_cmm_degC": wobble.part + 0.1 * wobble.repeat})
    assert residual_table(stated(tmp_path, MACHINE), wobble)[0].covariates[
        "T_cmm_degC"
    ].shape == (3, 1)  # fmt: skip


def test_untimed_points_have_no_time(tmp_path: Path) -> None:
    points = measured(3, 2, 1)
    bare = replace(points, time_min=np.full(len(points), np.nan))
    table, _ = residual_table(stated(tmp_path, MACHINE), bare, {})
    assert sorted(table.covariates) == ["dir_x", "dir_y", "sequence"]


def test_given_values_stand_in_for_columns(tmp_path: Path) -> None:
    model = stated(tmp_path, GROWING)
    points = measured(3, 2, 2)
    table, _ = residual_table(model, points, {"T_bed_degC": 24.0})
    check_against_loop(model, points, table, {"T_bed_degC": 24.0})
    assert "T_bed_degC" not in table.covariates
    own, warned = residual_table(model, warm(points), {"T_bed_degC": 24.0})
    assert codes(warned) == ["not-used"]
    assert not np.allclose(own.errors, table.errors)


def test_covariates_that_are_missing_or_not_numbers(tmp_path: Path) -> None:
    model = stated(tmp_path, GROWING)
    points = measured(3, 2, 2)
    near = replace(points, covariates={"T_bad_degC": np.zeros(len(points))})
    with pytest.raises(InputError, match="there is 'T_bad_degC'"):
        residual_table(model, near, {})
    both = near.covariates | {"T_bed": np.full(len(points), "20", object)}
    with pytest.raises(InputError, match="there is 'T_bed'"):
        residual_table(model, replace(points, covariates=both), {})
    texts = np.array(["20"] * len(points), object)
    texts[4], texts[5] = "warm", ""
    with pytest.raises(InputError) as found:
        residual_table(model, replace(points, covariates={"T_bed_degC": texts}), {})
    told = [(problem.text, problem.row) for problem in found.value.findings]
    wanted = [("not a number", points.row[4]), ("empty cell", points.row[5])]
    assert told == sorted(wanted, key=lambda one: one[1])
    # Numbers beside texts in other rows are numbers, where all the rows that count are.
    texts[4:6] = "20"
    assert codes(residual_table(model, replace(points, covariates={"T_bed_degC": texts}))[1]) == []


def thermal_points(parts: int, features: int, *, same_time: bool) -> Points:
    """Measured where they should be, while the machine warms up; a reading a minute."""
    points = measured(parts, features, 2, sigma=0.0)
    times = (points.part * 30.0 if same_time else points.time_min).astype(np.float64)
    T = {s: 20 + (k + 1) * (1 - np.exp(-times / 40)) for k, s in enumerate(SENSORS)}
    return replace(points, covariates=dict(T), time_min=times)


@pytest.mark.parametrize("same_time", [True, False])
def test_lags_have_the_history_that_correct_gives_them(tmp_path: Path, same_time: bool) -> None:
    model = warm_machine(tmp_path, line(time_constants=(25.0, 0.0)))
    points = thermal_points(5, 4, same_time=same_time)
    table, warned = residual_table(model, points, {})
    settled, _ = residual_table(warm_machine(tmp_path, line()), points, {})
    assert np.abs(table.errors - settled.errors).max() > 1e-4
    told = correct(model, None, points, Settings())
    assert not [w for w in warned if "lag" in w.code or "settled" in w.code]
    expected = by_cell(points, -told.error[:, :2])
    for (part, feature), own in expected.items():
        place = table.parts.index(part), table.features.index(feature)
        np.testing.assert_allclose(table.errors[place], sum(own) / len(own), rtol=0, atol=1e-12)


def test_all_measurements_of_a_moment_count_in_a_lag(tmp_path: Path) -> None:
    """Holes of one moment with temperatures of their own, some measured once and some twice."""
    model = warm_machine(tmp_path, line(time_constants=(25.0, 10.0)))
    points = thermal_points(5, 4, same_time=True)
    points = rows(points, np.flatnonzero((points.repeat == 1) | (points.feature == 1)))
    uneven = {name: T + 0.01 * points.feature for name, T in points.covariates.items()}
    points = replace(points, covariates=uneven)
    table, _ = residual_table(model, points, {})
    told = correct(model, None, points, Settings())
    for (part, feature), own in by_cell(points, -told.error[:, :2]).items():
        place = table.parts.index(part), table.features.index(feature)
        np.testing.assert_allclose(table.errors[place], sum(own) / len(own), rtol=0, atol=1e-12)


def test_a_lag_without_times_is_told(tmp_path: Path) -> None:
    model = warm_machine(tmp_path, line(time_constants=(25.0, 0.0)))
    points = thermal_points(3, 2, same_time=True)
    bare = replace(points, time_min=np.full(len(points), np.nan))
    table, warned = residual_table(model, bare, {})
    assert "settled-temperatures" in codes(warned)
    settled, _ = residual_table(warm_machine(tmp_path, line()), bare, {})
    np.testing.assert_allclose(table.errors, settled.errors, atol=1e-15)
    gap = replace(points, time_min=np.where(np.arange(len(points)) == 2, np.nan, points.time_min))
    with pytest.raises(InputError, match="'time'"):
        residual_table(model, gap, {})


def test_noise_of_temperatures_goes_where_it_is_shared(tmp_path: Path) -> None:
    """One reading for all parts, one a part, one a point; the line's gradients are known."""
    drift = line(sensor_u=(0.2, 0.0))
    model = warm_machine(tmp_path, drift)
    exact = warm_machine(tmp_path, line())
    points = thermal_points(4, 3, same_time=True)
    x = points.nominal[[int(np.argmax(points.feature == h)) for h in range(3)], 0]
    column = np.column_stack([1.5e-3 + 0.01e-3 * x, 0.5 * (1.5e-3 + 0.01e-3 * x)]) * 0.2

    def added(own: Points, name: str, at: dict[str, float] | None = None) -> Floats:
        with_it, without = (residual_table(m, own, at or {})[0] for m in (model, exact))
        F, E = (getattr(table, name)[-1] for table in (with_it, without))
        F, E = F.reshape(6, F.shape[-1]), E.reshape(6, E.shape[-1])
        return np.asarray(F @ F.T - E @ E.T)

    expected = np.outer(column.ravel(), column.ravel())
    np.testing.assert_allclose(added(points, "of_part"), expected, rtol=0, atol=1e-12)
    assert np.abs(added(points, "common")).max() < 1e-15
    given = replace(points, covariates={})
    at = {"T_a_degC": 21.0, "T_b_degC": 22.0}
    np.testing.assert_allclose(added(given, "common", at), expected, rtol=0, atol=1e-12)
    assert np.abs(added(given, "of_part", at)).max() < 1e-15
    each = thermal_points(4, 3, same_time=False)
    assert np.abs(added(each, "of_part")).max() < 1e-15
    assert np.abs(added(each, "common")).max() < 1e-15
