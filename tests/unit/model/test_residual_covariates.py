"""Covariates of residual tables: shapes, gaps, texts, errors again; lags and noise of sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compare_trials import made, study
from model_examples import stated
from residual_examples import MACHINE, by_cell, codes, measured
from thermal_machines import SENSORS, line
from thermal_machines import machine as warm_machine

from mtu_cli.analyses.correct import correct
from mtu_cli.files.readings import Points
from mtu_cli.findings import InputError
from mtu_cli.model.covariates import FEW_ROWS, without_gaps, without_repeated
from mtu_cli.model.residuals import residual_table
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import only_rows
from mtu_cli.stats.least_squares import FloatArray


def test_covariates_have_their_smallest_shape(tmp_path: Path) -> None:
    points = measured(4, 3, 2, keep=0.6)
    n = len(points)
    columns = {
        "T_room_degC": np.full(n, 21.5),
        "tool_parts": points.part % 2 + 0.1,
        "depth": points.feature * 0.3,
        "T_bed_degC": points.part + 0.1 * points.feature,
        "T_cmm_degC": np.random.default_rng(0).normal(20, 1, n),
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
    mixed = f"'worn' (2 of {n - 2} cells, such as 'n/a')"
    assert warned[0].facts["items"] == ["'who'", mixed]
    # Cells without a reading hold the mean of their part's cells.
    means = np.full((4, 3), np.nan)
    for p, h in {*zip(points.part.tolist(), points.feature.tolist(), strict=True)}:
        own = (points.part == p) & (points.feature == h)
        means[p, h] = columns["T_cmm_degC"][own].mean()
    means = np.where(np.isnan(means), np.nanmean(means, axis=1, keepdims=True), means)
    assert table.covariates["T_cmm_degC"] == pytest.approx(means, rel=1e-14)


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


def test_noise_of_temperatures_goes_where_it_is_shared(tmp_path: Path) -> None:
    """One reading for all parts, one a part, one a point; the line's gradients are known."""
    drift = line(sensor_u=(0.2, 0.0))
    model = warm_machine(tmp_path, drift)
    exact = warm_machine(tmp_path, line())
    points = thermal_points(4, 3, same_time=True)
    x = points.nominal[[int(np.argmax(points.feature == h)) for h in range(3)], 0]
    column = np.column_stack([1.5e-3 + 0.01e-3 * x, 0.5 * (1.5e-3 + 0.01e-3 * x)]) * 0.2

    def added(own: Points, name: str, at: dict[str, float] | None = None) -> FloatArray:
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


def with_gaps(**rows: list[int]) -> Points:
    """Points with covariates of which some rows are empty."""
    points = measured(5, 8, 2)
    columns = {name: np.arange(len(points), dtype=float) for name in rows}
    for name, empty in rows.items():
        columns[name][empty] = np.nan
    return replace(points, covariates=columns)


def test_few_gaps_cost_their_rows(tmp_path: Path) -> None:
    """The table is that of the other rows; a covariate of the model must be whole."""
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
    assert warned[0].facts["names"] == ["T_room_degC", "tool_parts"]
    first = f"2 of 80 rows left out, the first {points.sources[0].shown}, row {points.row[17]}"
    assert warned[0].facts["consequence"] == first
    needing = stated(tmp_path, MACHINE.replace("Ex: ", "Ex: 1e-9*T_room_degC*x + ", 1))
    with pytest.raises(InputError, match="empty cell"):
        residual_table(needing, with_gaps(T_room_degC=[17]))


def test_many_gaps_cost_the_covariate(tmp_path: Path) -> None:
    """Of two columns whose gaps are too many together, the one that has fewer stays."""
    points = with_gaps(rare=[3], often=[4, 5, 6, 7], most=list(range(30)))
    assert 4 <= FEW_ROWS * len(points) < 5
    table, told = residual_table(stated(tmp_path, MACHINE), points)
    assert {"rare"} <= set(table.covariates)
    assert not {"often", "most"} & set(table.covariates)
    names = [[name.partition(",")[0] for name in item.facts["names"]] for item in told]
    assert names == [["rare"], ["often (4 of 79 rows", "most (29 of 79 rows"]]


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
    assert np.isnan(column).sum() <= FEW_ROWS * len(points)
    assert without_gaps(points, ()) == (points, [])


def written(seed: int = 1, digits: int = 4) -> Points:
    """As a CMM writes it: 0.1 um unless said, errors of some 5 um."""
    _, truth, part = study()
    found = made(truth, part, seed, parts=6)
    return replace(found, measured=np.round(found.measured, digits))


def repeats(found: Points, column: FloatArray, needed: tuple[str, ...] = ()) -> str | None:
    """The message on a column, which is taken out where there is one."""
    load = np.mod(np.arange(len(found), dtype=np.float64), 7.0)
    given = replace(found, covariates={"own": column, "load": load})
    left, warned = without_repeated(given, needed)
    assert ("own" in left.covariates) == (not warned)
    assert "load" in left.covariates
    return warned[0].message if warned else None


WRITTEN: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "the error along x": lambda e, m: e[:, 0],
    "the error along y": lambda e, m: -np.round(1e3 * e[:, 1], 1),
    "the coordinate x": lambda e, m: m[:, 0],
    "the length of the error": lambda e, m: np.round(2e3 * np.hypot(e[:, 0], e[:, 1]), 2),
}


def test_what_repeats_the_error_is_taken_out_and_what_goes_with_it_stays() -> None:
    """In mm or um, with the other sign, as the diameter of the position. Not a cause of nearly all
    of it, the error less a part's own, one entry that is another; nor what repeats errors that are
    hardly more than the digits they are given to.
    """
    found, coarse = written(), written(digits=2)
    errors = found.measured - found.nominal
    for words, make in WRITTEN.items():
        column = make(errors, found.measured)
        assert f"'own' ({words})): they repeat what was measured" in str(repeats(found, column))
        assert repeats(found, column, needed=("own",)) is None
    own = errors[:, 0]
    noise = np.random.default_rng(3).normal(scale=0.1 * own.std(), size=len(own))
    other = own.copy()
    other[5] += 0.5 * own.std()
    for column in (own + noise, other, own - own.mean(), np.sign(own)):
        assert repeats(found, column) is None
    assert repeats(coarse, (coarse.measured - coarse.nominal)[:, 0]) is None
