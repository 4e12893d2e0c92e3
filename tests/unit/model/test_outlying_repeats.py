"""A repeat that swells the scatter within parts is named; features measured worse are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from compare_trials import fitted, made, study
from measured_examples import PLACES, points
from measured_examples import study as three_holes

from mtu_cli.analyses.anova import analyse_variance
from mtu_cli.analyses.compare import compare
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.measured import feature_tables
from mtu_cli.model.outlying_points import farthest_off, outlying
from mtu_cli.model.outlying_repeats import lone_repeats
from mtu_cli.model.settings import Settings
from mtu_cli.reports.compare_words import parts_that_stand_out, verdict_text

ROW = 5


def told(found: Points) -> list[Finding]:
    return outlying(feature_tables(found), found).warnings


def slipped(found: Points, by: float, row: int = ROW) -> Points:
    measured = found.measured.copy()
    measured[row, 0] += by
    return replace(found, measured=measured)


@pytest.mark.parametrize("parts", [2, 3, 4])
def test_one_repeat_of_few_parts_is_named(parts: int) -> None:
    found = slipped(three_holes(parts, 2, 1), 0.4)
    odd = outlying(feature_tables(found), found)
    assert odd.parts == ("P0",)
    (warning,) = odd.warnings
    assert warning.code == "repeats-scatter"
    where = f"cmm.csv, row {ROW + 2}: part 'P0', feature 'c', x_mm is {found.measured[ROW, 0]:.7g}"
    assert warning.message.startswith(f"{where}, 40")
    assert " um off the part's other reading (row 6); repeats scatter there by " in warning.message
    assert warning.message.endswith("look whether a reading is mistyped")
    assert analyse_variance(found, None, "reml", Settings()).warnings[0] == warning


def test_of_two_readings_on_either_side_of_the_others_nobody_knows_which_is_wrong() -> None:
    """0.4 mm apart: 0.25 and 0.15 off the other parts; of 0.35 and 0.05 the former is."""
    whole = three_holes(4, 2, 1, 0.002, 0.001)
    for by, known in ((0.25, False), (0.35, True)):
        (warning,) = told(slipped(slipped(whole, by), by - 0.4, ROW - 1))
        assert f"row {ROW + 2}: part 'P0', feature 'c'" in warning.message
        assert ("and which of them is wrong is not known" in warning.message) is not known


@pytest.mark.parametrize(("parts", "repeats"), [(3, 2), (4, 2), (4, 3), (8, 2)])
def test_one_of_the_parts_is_held_against_all_others(parts: int, repeats: int) -> None:
    """A slip of 16 standard deviations, which the feature's scatter over all parts hides."""
    runs, told_ = 60, 0
    for seed in range(runs):
        found = slipped(three_holes(parts, repeats, seed, 0.003, 0.001), 0.016, 1)
        tables = feature_tables(found)
        told_ += bool(lone_repeats(tables)[tables.labels.index(("", "a", "x"))])
    assert told_ / runs > 0.5


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("by", [0.01, 20.0, 1e5])
def test_a_slip_where_all_other_repeats_are_equal(by: float) -> None:
    """The ratio to what does not scatter at all is infinite, without a division by nothing."""
    found = three_holes(6, 2, 1, 0.003, 0.001)
    c = found.features.index("c")
    second = (found.feature == c) & (found.repeat == found.repeat.max())
    first = (found.feature == c) & (found.repeat == found.repeat.min())
    measured = found.measured.copy()
    measured[second] = measured[first]
    tables = feature_tables(slipped(replace(found, measured=measured), by))
    assert lone_repeats(tables).tolist() == [label[1:] == ("c", "x") for label in tables.labels]


def test_a_feature_that_is_worse_on_every_part_has_no_slip_on_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Four times as bad as eleven others, measured twice: one study in fifty at most, by
    OWN_RATE; by the other features alone one in four.
    """
    for i in range(9):
        monkeypatch.setitem(PLACES, f"h{i}", (10.0 * i, 50.0))
    runs, alarms = 300, 0
    for seed in range(runs):
        found = three_holes(8, 2, seed, 0.003, 0.001)
        rough = np.random.default_rng(seed).normal(0.0, 0.0039, (len(found), 3))
        own = (found.feature == 1)[:, None]
        worse = replace(found, measured=found.measured + np.where(own, rough, 0.0))
        alarms += bool(lone_repeats(feature_tables(worse)).any())
    assert alarms / runs <= 0.02 + 3 * np.sqrt(0.02 * 0.98 / runs)


def test_a_part_that_was_clamped_anew_has_no_slip() -> None:
    """All its features move: the set-up did."""
    found = three_holes(4, 2, 1, 0.003, 0.001)
    moved = found.measured + 0.05 * ((found.part == 1) & (found.repeat == 1))[:, None]
    anew = replace(found, measured=moved)
    assert not lone_repeats(feature_tables(anew)).any()
    assert told(anew) == []
    only = replace(found, measured=np.where(found.feature[:, None] == 0, moved, found.measured))
    tables = feature_tables(only)
    named = {label for label, x in zip(tables.labels, lone_repeats(tables), strict=True) if x}
    assert named == {("", "a", "x"), ("", "a", "y")}


def test_where_a_mean_stands_out_it_alone_is_told() -> None:
    (warning,) = told(slipped(three_holes(12, 2, 1), 0.4))
    assert warning.code == "reading-stands-out"


def test_two_slips_do_not_hide_each_other() -> None:
    (warning,) = told(slipped(slipped(three_holes(4, 2, 1), 0.4), -9.0, 14))
    assert warning.message.count("row ") == 4  # each with its fellow
    assert warning.message.startswith("cmm.csv, row 16: ")


def test_a_feature_that_is_measured_worse_is_no_slip() -> None:
    """A rough bore three times as bad as the others; nor is one step of rounding."""
    for seed in range(100):
        found = three_holes(4, 3, seed, 0.002, 0.001)
        rough = np.random.default_rng(seed).normal(0.0, 0.0028, (len(found), 3))
        own = (found.feature == 1)[:, None]
        assert told(replace(found, measured=found.measured + np.where(own, rough, 0.0))) == []
    even = points(
        [(f"P{p}", name, r, 0.0, 0.0) for p in range(4) for name in "abc" for r in (1, 2)]
    )
    assert told(slipped(even, 0.001)) == []


def rough(found: Points, axis: int, s: float, seed: int) -> Points:
    """The second feature's repeats scatter by `s`, mm, along an axis in every part."""
    measured = found.measured.copy()
    own = found.feature == 1
    measured[own, axis] += np.random.default_rng(seed).normal(0.0, s, own.sum())
    return replace(found, measured=measured)


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_a_feature_that_is_measured_far_worse_has_no_single_reading(repeats: int) -> None:
    """Thirty times as bad in every part: no reading of one part is to be looked for."""
    for seed in range(20):
        found = rough(three_holes(8, repeats, seed, 0.002, 0.001), 0, 0.03, seed)
        odd = outlying(feature_tables(found), found)
        assert odd.parts == ()
        (warning,) = odd.warnings
        assert warning.code == "feature-scatters"
        assert warning.message.startswith("feature 'b', x_mm: repeats scatter there by ")
        assert "row" not in warning.message
        tables = feature_tables(found)
        assert not farthest_off(tables, found).any()


def test_a_slip_beside_a_rough_feature_is_told_apart_from_it() -> None:
    found = slipped(rough(three_holes(4, 3, 1, 0.002, 0.001), 1, 0.05, 1), 0.4)
    assert [warning.code for warning in told(found)] == ["repeats-scatter", "feature-scatters"]
    tables = feature_tables(found)
    (place,) = np.flatnonzero(farthest_off(tables, found))
    assert tables.labels[place] == ("", found.features[found.feature[ROW]], "x")


def test_the_squares_of_the_parts_are_those_of_their_table() -> None:
    found = three_holes(5, 4, 2)
    tables = feature_tables(found)
    for i, (_, feature, axis) in enumerate(tables.labels):
        k, own = "xyz".index(axis), found.feature == found.features.index(feature)
        errors = (found.measured - found.nominal)[:, k]
        for part in range(5):
            values = errors[own & (found.part == part)]
            expected = ((values - values.mean()) ** 2).sum()
            assert tables.cells.within_part[i, part] == pytest.approx(expected, rel=1e-9)
    assert tables.only([2]).cells.within_part == pytest.approx(tables.cells.within_part[[2]])


def test_clean_studies_are_silent() -> None:
    for seed in range(300):
        assert told(three_holes(2 + seed % 4, 2 + seed % 3, seed)) == []


def test_few_parts_are_not_consistent_for_a_repeat_that_swells_their_scatter() -> None:
    """Three parts, 40 um off: found; with one reading 0.5 mm off no test finds it any more."""
    _, truth, part = study()
    model, off = fitted(9, 7), made(truth, part, 1, offset=0.04, parts=3)
    before = compare(model, part, off, Settings())
    where = before.features.labels.index(("", off.features[off.feature[ROW]], "x"))
    assert before.features.verdicts[where] == "inconsistent"
    assert not any(before.features.pulled)
    after = compare(model, part, slipped(off, 0.5), Settings())
    assert after.features.p_bias[where] > 0.05
    assert (after.features.verdicts[where], after.features.pulled[where]) == ("inconsistent", True)
    text = verdict_text(
        after.feature_summaries[0], "features", stands_out=parts_that_stand_out(after)
    )
    assert text.endswith("stand out by more than U: beside them no fault shows (1 of 48)")


def of_two(*given: Points) -> Points:
    """The same parts in two operations."""
    rows, operations = [], []
    for found, operation in zip(given, ("drilled", "milled"), strict=True):
        errors = (found.measured - found.nominal).tolist()
        for i, (x, y, _) in enumerate(errors):
            part, feature = found.parts[found.part[i]], found.features[found.feature[i]]
            rows.append((part, feature, int(found.repeat[i]), x, y))
            operations.append(operation)
    return points(rows, operations)


def test_repeats_are_judged_by_their_operation_and_axis() -> None:
    """Milled ones scatter twenty times as much as drilled ones, those along y as those along x."""
    fine, coarse = three_holes(4, 3, 1, 0.002, 0.001), three_holes(4, 3, 2, 0.002, 0.02)
    assert told(of_two(fine, coarse)) == []
    along_y = fine.measured.copy()
    along_y[:, 1] = coarse.measured[:, 1]
    assert told(replace(fine, measured=along_y)) == []
    (warning,) = told(of_two(slipped(fine, 0.1), coarse))
    assert f"feature '{fine.features[fine.feature[ROW]]}' (drilled), x_mm" in warning.message
    assert told(of_two(fine, slipped(coarse, 0.1))) == []


@pytest.mark.parametrize(("ratio", "expected"), [(5000.0, []), (7000.0, ["repeats-scatter"])])
def test_what_chance_may_do_with_few_repeats_is_no_slip(ratio: float, expected: list[str]) -> None:
    """Of 1 and 2 degrees of freedom P(F > f) = 1 - sqrt(f/(f + 2)): 2.0e-4, or 1.4e-4, in each of
    six tables.
    """
    off = {"a": 1e-3 * np.sqrt(ratio), "b": 1e-3, "c": 1e-3}
    rows = [("P0", name, r, r * by, r * 1e-3) for name, by in off.items() for r in (0, 1)]
    rows += [("P1", name, 0, 0.0, 0.0) for name in off]
    assert [warning.code for warning in told(points(rows))] == expected


def test_of_one_part_the_feature_of_the_slip_is_none_of_the_others() -> None:
    """Nor are the lengths that end there; what is left is judged as if it had not been measured."""
    _, truth, part = study()
    model, one = fitted(9, 7), made(truth, part, 1, parts=1)
    name = one.features[one.feature[ROW]]
    lost = [x.id for x in part.part.lengths if name in (x.from_, x.to)]
    at = next(i for i, x in enumerate(one.feature) if one.features[x] == part.part.lengths[0].to)
    for row, fewer in ((ROW, len(lost)), (at, 2)):
        odd = compare(model, part, slipped(one, 0.5, row), Settings()).stands_out
        assert odd is not None
        assert odd.feature_summaries[0].items == 2 * (len(one.features) - 1)
        assert odd.length_summaries[0].items == len(part.part.lengths) - fewer
