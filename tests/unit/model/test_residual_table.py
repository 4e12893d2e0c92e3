"""Residual tables against predictions made point by point and means taken in a loop."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compare_trials import made, study
from model_examples import stated
from residual_examples import (
    GROWING,
    MACHINE,
    UNCERTAIN,
    by_cell,
    check_against_loop,
    check_factors,
    codes,
    column_of,
    measured,
    moved,
    residuals,
    rows,
    warm,
    with_operations,
)
from thermal_machines import SENSORS, line
from thermal_machines import machine as warm_machine

from mtu_cli.analyses.correct import correct
from mtu_cli.files.readings import Points
from mtu_cli.files.study import Datum
from mtu_cli.findings import InputError
from mtu_cli.model.covariates import without_repeated
from mtu_cli.model.machine_model import MachineModel
from mtu_cli.model.residuals import ResidualTable, residual_table
from mtu_cli.model.settings import Settings
from mtu_cli.stats.least_squares import FloatArray

ROTATION: Datum = "offset,rotation"
FREE: list[Datum] = ["offset", ROTATION]


STILL = [text.replace(" + 0.002*dir_x", "") for text in (MACHINE, UNCERTAIN)]


@pytest.mark.parametrize("machine", [GROWING, UNCERTAIN, MACHINE, *STILL])
@pytest.mark.parametrize("keep", [1.0, 0.4])
def test_errors_are_means_of_measured_less_predicted(
    tmp_path: Path, machine: str, keep: float
) -> None:
    """A temperature that differs between repeats, and uncertain constants. Where nothing in which
    parts differ moves a coefficient, one design is that of all.
    """
    model = stated(tmp_path, machine)
    points = warm(measured(4, 5, 3, keep=keep))
    table, warned = residual_table(model, points, {})
    assert warned == ()
    assert (table.axes, table.component, table.unit) == (("x", "y"), None, "um")
    assert table.parts == ("P0", "P1", "P2", "P3")
    assert (table.repeats.min() == 0) == (keep < 1)
    check_against_loop(model, points, table)
    check_factors(model, points, table)
    assert machine not in STILL or len(table.common) == len(table.of_part) == 1


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
    own = np.array([index[column_of(points, i)] for i in range(len(points))])
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


@pytest.mark.parametrize("datum", FREE)
def test_errors_less_the_motion_of_each_measurement(tmp_path: Path, datum: Datum) -> None:
    model = stated(tmp_path, MACHINE + "  Ez: py + z*sq\n")
    points = with_operations(whole_parts(measured(5, 6, 3, z=True)), ["drilled", "milled"])
    table, warned = residual_table(model, points, {}, datum)
    assert warned == ()
    assert table.datum == datum
    check_against_motions(model, points, table, datum)


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


# Covariates of residual tables: shapes, gaps, texts, errors again; lags and noise of sensors.


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
        "hole": np.where(points.part == 2, np.nan, 1.0),
        "who": np.array(["a"] * n, object),
        "worn": np.array(["", "3", "n/a", *["2"] * (n - 6), "-", "", "4"], object),
    }
    points = replace(points, covariates=columns)
    table, warned = residual_table(stated(tmp_path, MACHINE), points, {})
    shapes = {name: value.shape for name, value in table.covariates.items()}
    assert shapes == {
        "dir_x": (4, 1), "dir_y": (4, 1), "sequence": (4, 1), "time_min": (4, 3),
        "T_room_degC": (1, 1), "tool_parts": (4, 1), "depth": (1, 3), "T_bed_degC": (4, 3),
        "T_cmm_degC": (4, 3), "gap": (1, 1),
    }  # fmt: skip
    assert codes(warned) == ["not-tested", "missing-values", "missing-values"]
    assert "gap (1 of" in warned[1].message
    assert f"hole ({np.count_nonzero(points.part == 2)} of" in warned[2].message
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


def test_a_gap_is_the_other_repeats_or_the_mean_of_the_part(tmp_path: Path) -> None:
    """A covariate of the model must be whole."""
    model, points = stated(tmp_path, MACHINE), with_gaps(T_room_degC=[17], tool_parts=[17, 40])
    table, warned = residual_table(model, points)
    whole, _ = residual_table(model, with_gaps(T_room_degC=[], tool_parts=[]))
    np.testing.assert_array_equal(table.errors, whole.errors)
    assert codes(warned) == ["missing-values"]
    first = f"T_room_degC (1 of 80 rows, the first {points.sources[0].shown}, row {points.row[17]})"
    assert warned[0].facts["names"][0] == first
    part, feature = points.part[17], points.feature[17]
    h = table.features.index(points.features[feature])
    same = (points.part == part) & (points.feature == feature)
    (other,) = np.setdiff1d(np.flatnonzero(same), [17])
    changed = whole.covariates["T_room_degC"].copy()
    changed[part, h] = other
    np.testing.assert_array_equal(table.covariates["T_room_degC"], changed)
    # Both repeats are gaps.
    table, _ = residual_table(model, with_gaps(T_room_degC=[17, int(other)]))
    changed[part, h] = np.delete(changed[part], h).mean()
    np.testing.assert_allclose(table.covariates["T_room_degC"], changed, rtol=1e-12)
    # What changes within parts and is unknown in more cells than a few is no covariate.
    empty = [int(i) for i in np.flatnonzero((points.feature % 3 == 0) & (points.part == 2))]
    empty += [int(i) for i in np.flatnonzero((points.feature % 4 == 1) & (points.part == 3))]
    table, warned = residual_table(model, with_gaps(T_room_degC=empty, tool_parts=[]))
    assert "T_room_degC" not in table.covariates
    assert "can be tested" in warned[-1].message
    # There is no direction between both, but another repeat may state it.
    for empty, stated_too in (([17], True), ([17, int(other)], False)):
        table, warned = residual_table(model, with_gaps(dir_y=empty))
        assert ("dir_y" in table.covariates) == stated_too
        assert ("can be tested" in warned[-1].message) != stated_too
    needing = stated(tmp_path, MACHINE.replace("Ex: ", "Ex: 1e-9*T_room_degC*x + ", 1))
    with pytest.raises(InputError, match="empty cell"):
        residual_table(needing, with_gaps(T_room_degC=[17]))


def test_a_covariate_that_some_part_has_nothing_of_is_left_out(tmp_path: Path) -> None:
    """One that stands once a part is that of the part."""
    points = measured(5, 8, 2)
    once, none = (np.asarray(points.part + 0.1, np.float64) for _ in range(2))
    once[np.setdiff1d(np.arange(80), np.unique(points.part, return_index=True)[1])] = np.nan
    none[points.part == 4] = np.nan
    given = replace(points, covariates={"once": once, "none": none})
    table, warned = residual_table(stated(tmp_path, MACHINE), given)
    assert table.covariates["once"].ravel().tolist() == [0.1, 1.1, 2.1, 3.1, 4.1]
    assert "none" not in table.covariates
    assert [each.facts["names"][0].partition(" (")[0] for each in warned] == ["once", "none"]


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
