"""Runs there and back: who is a run, and what the two passes of one share, to the prediction."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_examples import PLACES, part_file, points, study, with_measured
from model_examples import Segment, estimate, loaded, model_of, readings
from numpy.typing import NDArray
from reading_examples import only

from mtu_cli.analyses.fit_components import fit_result
from mtu_cli.files.part import LoadedPart
from mtu_cli.files.readings import Points, Readings
from mtu_cli.files.reports_read import report_from
from mtu_cli.files.source import Source
from mtu_cli.findings import InputError
from mtu_cli.model.estimates import ComponentEstimate, Estimates
from mtu_cli.model.estimation import agreement, combine
from mtu_cli.model.fit import (
    component_readings,
    estimates_from_fit,
    estimates_from_report,
    fit_machine,
)
from mtu_cli.model.machine_model import build_model
from mtu_cli.model.measured import angle_tables, feature_tables, length_tables, length_warnings
from mtu_cli.model.prediction import predict
from mtu_cli.model.residuals import reading_cells, reading_tables
from mtu_cli.model.simulate import PartsPlan, pass_root, simulate_points
from mtu_cli.model.visits import only_features, pairs_of_passes, visits_of
from mtu_cli.reports.fit_components import document
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.pass_tests import Shift

P = np.linspace(0.0, 90.0, 4)
RUNS = 5
NUMBER = np.repeat(np.arange(1, 2 * RUNS + 1), len(P))
WAY = np.tile(np.repeat([1, -1], len(P)), RUNS)
MACHINE = """
components: {a: {of: x, unit: mm}, b: {of: y, unit: mm}}
equations: {Ex: a, Ey: b}
"""
ONE_AXIS = """
components: {a: {of: x, unit: mm}}
equations: {Ex: a}
"""


def run_lines(
    name: str, runs: int, seed: int, *, role: str = "lbb", reversal: float = 0.0
) -> Segment:
    """A component's runs: level and slope of each run, of each pass, and noise."""
    rng = np.random.default_rng(seed)
    line = 3.0 * rng.normal(size=(runs, 1, 2)) + rng.normal(size=(runs, 2, 2))
    line[..., 1] *= 0.01
    error = line[..., :1] + line[..., 1:] * (P - P.mean())
    error = error + 0.5 * rng.standard_normal(error.shape) + [[reversal], [0.0]]
    return Segment(
        name=name,
        position=np.tile(P, 2 * runs),
        error=error.ravel(),
        passes=np.repeat(np.arange(runs) + 1, 2 * len(P)),
        direction=np.tile(np.repeat([1, -1], len(P)), runs),
        role=role,
    )


def told(text: str) -> list[str]:
    """Pairs that are found in a sequence such as 1+ 2-."""
    words = text.split()
    number = np.array([int(word[:-1]) for word in words])
    way = np.array([1 if word[-1] == "+" else -1 for word in words])
    return [f"{words[i]}{words[j]}" for i, j in pairs_of_passes(number, way)]


@pytest.mark.parametrize(
    ("passes", "pairs"),
    [
        ("1+ 2- 3+ 4- 5+", "1+2- 3+4-"),
        ("0+ 1- 2+ 3-", "0+1- 2+3-"),
        ("1- 2+ 3- 4+", "2+1- 4+3-"),
        ("1+ 2- 3+ 5+ 6-", "1+2- 5+6-"),
        # Two counts, up or down, or of any order.
        ("1+ 2+ 3+ 1- 2- 3-", "1+1- 2+2- 3+3-"),
        ("1+ 2+ 3+ 3- 2- 1-", "1+1- 2+2- 3+3-"),
        ("1+ 3+ 4+ 5+ 1- 2- 4- 5-", "1+1- 4+4- 5+5-"),
        ("2+ 3+ 4+ 5+ 1- 2- 3- 4-", "2+2- 3+3- 4+4-"),
        ("5+ 1- 6+ 2- 7+ 3-", "5+1- 6+2- 7+3-"),
        # Numbers that stand twice: files of several days.
        ("1+ 1+ 1- 2-", "1+1- 1+2-"),
        ("1+ 2+ 1+ 2+ 1- 2- 1- 2-", "1+1- 2+2- 1+1- 2+2-"),
        ("1+ 2+", ""),
    ],
)
def test_passes_that_each_run_one_way_are_paired(passes: str, pairs: str) -> None:
    assert told(passes) == pairs.split()


@pytest.mark.parametrize("one_way", [False, True], ids=["one number", "a number each"])
def test_a_prediction_by_hand(tmp_path: Path, one_way: bool) -> None:
    """g'((1 + 1/P) S_m + S_h)g + s^2 (1 - M), S_m and S_h from the passes' lines by numpy."""
    known = loaded(tmp_path, MACHINE)
    given = [run_lines(name, RUNS, seed, reversal=2.0) for seed, name in enumerate("ab")]
    if one_way:
        given = [replace(item, passes=NUMBER) for item in given]
    fit = fit_machine(known, readings(given))
    model = build_model(known, estimates_from_fit(known, fit))
    x, y = 30.0, 70.0
    m, h, visits = [], [], []
    for item, at in zip(given, (x, y), strict=True):
        by_pass = item.error.reshape(2 * RUNS, len(P))
        own = np.polyfit(P, by_pass.T, 1)[::-1]
        rest = by_pass - (own[0][:, None] + own[1][:, None] * P)
        s2 = np.sum(rest**2) / (2 * RUNS * (len(P) - 2))
        line = (own[0] + own[1] * at).reshape(RUNS, 2)
        m.append(line.mean(axis=1))
        h.append((line[:, 0] - line[:, 1]) / 2)
        M = 1 / len(P) + (at - P.mean()) ** 2 / np.sum((P - P.mean()) ** 2)
        visits.append(s2 * (1 - M))
    S_m, S_h = np.cov(m), np.cov(h)
    found = predict(model, ["p"], np.array([[x, y, 0.0]]))
    assert found.mean == pytest.approx([m[0].mean(), m[1].mean()])
    wanted = (1 + 1 / RUNS) * S_m + S_h + np.diag(visits)
    assert found.covariance == pytest.approx(wanted, rel=1e-9)
    variance = found.variance(np.eye(2))
    assert variance.total == pytest.approx(np.diag(wanted))
    nu = 2 * RUNS * (len(P) - 2)
    for i in range(2):
        of_runs, of_ways = (1 + 1 / RUNS) * S_m[i, i], S_h[i, i]
        spread = (of_runs**2 + of_ways**2) / (RUNS - 1) + visits[i] ** 2 / nu
        assert variance.dof[i] == pytest.approx(wanted[i, i] ** 2 / spread)
    assert variance.coefficients == pytest.approx(np.diag(S_m) / RUNS)
    # Of both components: the two mean squares are of the same runs, the visits of each its own.
    a = np.array([1.0, -2.0])
    both = found.variance(a[None])
    assert both.total == pytest.approx([a @ wanted @ a])
    spread = (((1 + 1 / RUNS) * a @ S_m @ a) ** 2 + (a @ S_h @ a) ** 2) / (RUNS - 1)
    spread += np.sum((a**2 * visits) ** 2) / nu
    assert both.dof == pytest.approx([(a @ wanted @ a) ** 2 / spread])
    # The mean over future parts is known by the runs alone.
    squares = variance.squares
    assert squares.of_mean[0] == pytest.approx(np.diag(S_m) / RUNS)
    assert np.abs(squares.of_mean[1:]).max() < 1e-12
    assert fit.joint[0].pass_dof == RUNS - 1


# The passes of readings: their sequence in time and who is a run, whatever files they stand in.


IntArray = NDArray[np.int64]


def one_way_passes() -> Readings:
    """Passes 1 there, 2 back, 3 there ... of one axis, which runs share their scatter."""
    found = run_lines("a", RUNS, 3)
    return readings([replace(found, passes=NUMBER, time=np.arange(len(NUMBER), dtype=np.float64))])


def in_files(given: Readings, file: IntArray, *, clock: bool = True) -> Readings:
    """The readings, each in the file that `file` (n,) numbers; without times less the clock."""
    order = np.argsort(file, kind="stable")
    count = int(file.max()) + 1
    sources = tuple(
        Source(role="lbb", path=Path(f"{i}.csv"), shown=f"{i}.csv", sha256="", rows=None)
        for i in range(count)
    )
    arrays = ("code", "position_mm", "error", "pass_number", "has_pass", "direction", "time_min")
    found = replace(
        given,
        **{name: getattr(given, name)[order] for name in arrays},
        file_index=file[order],
        sources=sources,
    )
    return found if clock else replace(found, time_min=np.full(len(order), np.nan))


FILES = {
    "one a direction": (WAY < 0).astype(np.int64),
    "one a pass": NUMBER - 1,
    "one a pass, there before back": np.where(WAY > 0, NUMBER // 2, RUNS + NUMBER // 2 - 1),
}


@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.parametrize("file", FILES.values(), ids=FILES)
def test_runs_are_the_same_whatever_files_their_passes_stand_in(
    tmp_path: Path, file: IntArray, clock: bool
) -> None:
    known, given = loaded(tmp_path, ONE_AXIS), one_way_passes()
    one = fit_machine(known, given).components["a"].estimate
    split = in_files(given, file, clock=clock)
    several = fit_machine(known, split).components["a"].estimate
    assert one.pass_dof == RUNS - 1
    assert several.pass_dof == one.pass_dof
    np.testing.assert_allclose(several.covariance, one.covariance, rtol=1e-9)
    seen = component_readings(known, split, "a", np.arange(len(WAY)))
    cells = reading_cells(split, seen, "a")
    assert cells.parts == tuple(f"{2 * i + 1}/{2 * i + 2}" for i in range(RUNS))


# What passes there and back of a run share, of a component that several instruments read.


SCHEMA = "mtu/fit-components/1"


def segment(role: str, runs: int, seed: int, *, one_way: bool = False) -> Segment:
    found = run_lines("a", runs, seed, role=role)
    if not one_way:
        return found
    there = np.asarray(found.direction) > 0
    names = ("position", "error", "passes", "direction")
    return replace(found, **{name: getattr(found, name)[there] for name in names})


def of_runs(item: Segment, runs: int) -> FloatArray:
    """K from the lines of the passes by numpy: covariance of there and back, made symmetric."""
    lines = np.polyfit(P, item.error.reshape(-1, len(P)).T, 1)[::-1]
    K = np.cov(lines[:, 0::2], lines[:, 1::2])[:2, 2:]
    assert lines.shape[1] == 2 * runs
    return np.asarray((K + K.T) / 2)


@pytest.mark.parametrize("one_way", [False, True], ids=["both ways", "one ran one way"])
def test_it_is_pooled_over_those_that_ran_both_ways(one_way: bool, tmp_path: Path) -> None:
    known = loaded(tmp_path, ONE_AXIS)
    both = [segment("lbb", 6, 1), segment("laser", 4, 2, one_way=one_way)]
    estimate = fit_machine(known, readings(both)).components["a"].estimate
    assert estimate.half_differences is None
    wanted = of_runs(both[0], 6)
    if not one_way:
        wanted = (5 * wanted + 3 * of_runs(both[1], 4)) / 8
    assert estimate.run_covariance is not None
    np.testing.assert_allclose(estimate.run_covariance, wanted, rtol=1e-9, atol=1e-12)


def test_further_readings_share_it_as_reported(tmp_path: Path) -> None:
    """Of the table's factor; also of the report read back. A damaged one is told."""
    known = loaded(tmp_path, ONE_AXIS)
    fit = fit_machine(known, readings([segment("lbb", 6, 1), segment("laser", 4, 2)]))
    own = estimates_from_fit(known, fit)
    results = document(fit_result("m", fit, own)).record()
    source = Source(role="components", path=tmp_path, shown="c.json", sha256="", rows=0)
    report = report_from(source, {"schema": SCHEMA, "results": results})
    K = own.components["a"].run_covariance
    assert K is not None
    assert np.linalg.eigvalsh(K)[0] > 0
    for estimates in (own, estimates_from_report(known, report)):
        one = Estimates(components={"a": estimates.components["a"]})
        table = only(reading_tables(known, one, readings([segment("laser", 5, 3)])))
        X = np.column_stack([np.ones(2 * len(P)), table.places[0, :, 0]])
        way, R = table.covariates["dir_x"][0], table.of_part[0, :, 0]
        found, same = R @ R.T, way[:, None] == way
        D = own.components["a"].pass_covariance
        np.testing.assert_allclose(found[same], (X @ D @ X.T)[same], rtol=1e-6)
        np.testing.assert_allclose(found[~same], (X @ K @ X.T)[~same], rtol=1e-6)
    for damaged, told in (([[None, 0], [0, 0]], "wrong value: 'null'"), ([[1.0]], "another size")):
        results["components"]["a"]["run_covariance"] = damaged
        with pytest.raises(InputError, match=told):
            report_from(source, {"schema": SCHEMA, "results": results})


@pytest.mark.parametrize("way", [1, -1])
def test_a_line_of_one_way_is_brought_to_the_mean_of_both(way: int, tmp_path: Path) -> None:
    """By half of the reversal that the other instrument tells, whose u counts; both agree then."""
    known, lost = loaded(tmp_path, ONE_AXIS), -40.0
    both = segment("lbb", 6, 1)
    both = replace(both, error=both.error + 0.5 * lost * np.asarray(both.direction))
    alone = segment("laser", 5, 2, one_way=True)
    alone = replace(
        alone, error=alone.error + 0.5 * lost * way, direction=np.full(len(alone.error), way)
    )
    fit = fit_machine(known, readings([both, alone])).components["a"]
    back = fit.instruments[0].tests["reversal"]
    assert isinstance(back, Shift)
    plain = [
        fit_machine(known, readings([item])).components["a"].estimate for item in (both, alone)
    ]
    moved = replace(
        plain[1],
        coefficients=plain[1].coefficients - np.array([0.5 * way * back.value, 0.0]),
        covariance=plain[1].covariance + np.diag([0.25 * back.u**2, 0.0]),
    )
    wanted = combine([plain[0], moved], [len(both.error), len(alone.error)])
    np.testing.assert_allclose(fit.estimate.coefficients, wanted.coefficients, rtol=1e-9)
    np.testing.assert_allclose(fit.estimate.covariance, wanted.covariance, rtol=1e-9)
    assert fit.agreement_p == pytest.approx(agreement(plain[0], moved))
    assert abs(fit.estimate.coefficients[0]) < 4 * np.sqrt(fit.estimate.covariance[0, 0])


# What passes of a virtual machine differ by: variances by many draws against those declared.


AT = np.array([[0.0, 0, 0], [250, 0, 0], [500, 0, 0]])
MANY = 4000


def covariance_drawn(item: ComponentEstimate) -> FloatArray:
    root = pass_root(model_of([(item, {"x": "1"})], axes=("x",)))
    return np.asarray(root @ root.T)


def test_of_readings_no_more_than_a_negative_part_is_taken_off() -> None:
    """Passes at 0 to 500 mm whose slopes differ by less than repeatability makes them: drawn in
    mm and rad at once, 500 mm is 500 times what 1 mm is, and the variance there was seven times
    too large.
    """
    centre = np.array([[1.0, -250.0], [0.0, 1.0]])
    moment = centre @ [[5.81e-7, 1.23e-9], [1.23e-9, -2.51e-13]] @ centre.T
    C = np.array([[3.79e-8, 9.38e-12], [9.38e-12, 2.64e-13]])
    one = estimate("a", "x", [0.0, 0.0], C=C, D=moment)
    drawn, X = covariance_drawn(one), np.column_stack([np.ones(3), AT[:, 0]])
    plan = PartsPlan(parts=MANY, repeats=1, cmm_u_um=0.0, reverse_every=0, minutes=1.0)
    model = model_of([(one, {"x": "1"})], axes=("x",))
    made = simulate_points(model, ["a", "b", "c"], AT, plan, 1)["x_mm"].reshape(MANY, 3)
    # To 4.5 standard errors.
    wanted = X @ drawn @ X.T
    se = np.sqrt((np.outer(np.diag(wanted), np.diag(wanted)) + wanted**2) / MANY)
    assert (np.abs(np.cov((made - AT[:, 0]).T) - wanted) <= 4.5 * se).all()
    assert np.linalg.eigvalsh(drawn / np.outer(*[np.sqrt(np.diag(drawn))] * 2))[0] >= -1e-9
    # What D lacks is less than the mean square of the ten passes, of which C is a tenth.
    added = np.diag(X @ (drawn - moment) @ X.T)
    assert (added >= 0).all()
    assert (added <= 10 * np.diag(X @ C @ X.T)).all()
    units = np.diag([1e3, 1e6])
    scaled = replace(one, covariance=units @ C @ units, pass_covariance=units @ moment @ units)
    other = covariance_drawn(scaled)
    np.testing.assert_allclose(other, units @ drawn @ units, rtol=1e-9)


# Measured points as tables of errors, lengths and angles, and what cannot be.


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
