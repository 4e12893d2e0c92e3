"""A reading that pulls a comparison is named; those of clean studies are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from compare_trials import fitted, made, study
from measured_examples import PLACES, part_file, points
from measured_examples import study as three_holes

from mtu_cli.analyses.anova import analyse_variance
from mtu_cli.analyses.compare import compare
from mtu_cli.files.points import Points
from mtu_cli.findings import Finding
from mtu_cli.model.measured import feature_tables, length_tables
from mtu_cli.model.outlying_points import farthest_off, outlying
from mtu_cli.model.settings import Settings
from mtu_cli.model.visits import only_rows, visits_of
from mtu_cli.reports.compare import document, table
from mtu_cli.reports.compare_words import parts_that_stand_out, verdict_text
from mtu_cli.reports.tables import plain_text
from mtu_cli.stats.least_squares import FloatArray
from mtu_cli.stats.outliers import outlying_p

SLIP_MM = -0.15


def told(found: Points) -> list[Finding]:
    return outlying(feature_tables(found), found).warnings


def moved(found: Points, rows: list[int], by: float, axis: int = 0) -> Points:
    measured = found.measured.copy()
    measured[rows, axis] += by
    return replace(found, measured=measured)


def test_a_mistyped_reading_is_named_where_it_changes_a_verdict() -> None:
    """Parts that are 10 um off; one reading in a thousand makes them look consistent."""
    _, truth, part = study()
    model, off = fitted(9, 7), made(truth, part, 1, offset=0.01)
    before = compare(model, part, off, Settings())
    assert "reading-stands-out" not in {item.code for item in before.warnings}
    row = 9
    name = off.features[off.feature[row]]
    after = compare(model, part, moved(off, [row], SLIP_MM), Settings())
    (warning,) = [item for item in after.warnings if item.code == "reading-stands-out"]
    place = f"cmm.csv, row {off.row[row]}: part {off.parts[off.part[row]]!r}, feature {name!r}"
    assert warning.message.startswith(f"{place}, x_mm is {off.measured[row, 0] + SLIP_MM:.7g},")
    assert ", -1" in warning.message.split("x_mm is ")[1].split(" um off the other parts")[0]
    other = off.row[(off.part == off.part[row]) & (off.feature == off.feature[row])].tolist()
    other.remove(off.row[row])
    assert f"; the part's other reading (row {other[0]}) is " in warning.message
    assert "as far off" not in warning.message
    assert "it pulls the figures" in warning.message
    assert before.stands_out is None
    parts = parts_that_stand_out(after)
    assert parts == (off.parts[off.part[row]],)
    headline = verdict_text(after.feature_summaries[0], "features", stands_out=parts)
    told = f"readings of part {off.parts[off.part[row]]!r} stand out"
    assert f"inconsistent: {told} by more than U: beside them no fault shows (1 of " in headline
    where = before.features.labels.index(("", name, "x"))
    assert before.features.verdicts[where] == "biased"
    # Not "consistent", which would pass a gate: what the reading scatters by hides the 10 um.
    assert after.features.p_bias[where] > 0.05
    assert after.features.verdicts[where] == "inconsistent"
    assert [i for i, x in enumerate(after.features.pulled) if x] == [where]
    assert not any(before.features.pulled)
    # An analysis of variance has the same reading in all its figures.
    analysed = analyse_variance(moved(off, [row], SLIP_MM), part, "anova", Settings())
    assert warning in analysed.warnings
    clean = analyse_variance(off, part, "anova", Settings())
    assert "reading-stands-out" not in {item.code for item in clean.warnings}


def test_a_part_that_is_off_is_told_from_a_slip_and_from_the_verdict_of_the_others() -> None:
    """Both repeats of one hole 0.3 mm off: the verdict and the gate count them, the others are as
    without them. Of a slip the other repeat is where it belongs.
    """
    _, truth, part = study()
    model, clean = fitted(9, 7), made(truth, part, 1)
    both = np.flatnonzero((clean.part == 4) & (clean.feature == 9)).tolist()
    found = compare(model, part, moved(clean, both, 0.3), Settings())
    assert found.feature_summaries[0].under_predicted == 1
    odd = found.stands_out
    assert odd is not None
    assert (odd.parts, odd.rows) == ((clean.parts[4],), 2)
    named = {f"row {clean.row[i]}" for i in both}
    (text,) = odd.texts
    assert all(name in text for name in named)
    assert "as far off (" in text
    assert text.endswith("no single slip")
    # The others are judged as if the two readings had never been: to the last digit.
    rest = np.setdiff1d(np.arange(len(clean)), both)
    alone = compare(model, part, only_rows(clean, rest), Settings())
    assert odd.feature_summaries == alone.feature_summaries
    assert odd.length_summaries == alone.length_summaries
    assert odd.feature_summaries[0].verdicts["consistent"] == 48
    said = plain_text(table(found))
    assert said.index("under-predicted: the scatter") < said.index(f"Stands out: {text[:20]}")
    assert "Without these 2 readings (the verdicts above and the gate count all):" in said
    assert "close-loop" not in said
    report = document(found)["stands_out"]
    assert report["without"]["features"][0]["under_predicted"] == 0
    assert document(alone)["stands_out"] == {"parts": []}
    # Where the others are off as well, the cause is still to be found.
    shifted = replace(clean, measured=clean.measured + np.array([0.06, 0.0, 0.0]))
    said = plain_text(table(compare(model, part, moved(shifted, both, 0.3), Settings())))
    assert "close-loop" in said


def test_who_is_alone_and_off_leaves_nothing_to_compare() -> None:
    """One part, one feature, of which two repeats differ: nothing is told of others."""
    whole = three_holes(1, 2, 1)
    odd = outlying(feature_tables(whole), moved(whole, [5], 0.4))
    assert len(odd.rows) == len(odd.texts) == 0
    slipped = moved(whole, [5], 0.4)
    odd = outlying(feature_tables(slipped), slipped)
    assert odd.rows.tolist() == [4, 5]
    assert "and which of them is wrong is not known" in odd.texts[0]


def test_clean_studies_are_silent() -> None:
    """At most one study in a thousand, whatever the parts and the repeats."""
    for seed in range(300):
        assert told(three_holes(5 + seed % 20, 1 + seed % 3, seed)) == []


@pytest.mark.parametrize(("s_part", "s_repeat"), [(0.0, 0.003), (0.003, 0.0), (0.003, 0.003)])
def test_unequal_repeats_are_no_slips(s_part: float, s_repeat: float) -> None:
    """A part measured once scatters more than the mean of ten, or as much, as repeats do."""
    for seed in range(100):
        whole = three_holes(20, 10, seed, s_part, s_repeat)
        often = int(seed % 2)
        kept = (whole.repeat == 0) | ((whole.part == 3) != often)
        assert told(taken(whole, kept)) == []


def taken(whole: Points, kept: FloatArray) -> Points:
    arrays = {
        name: getattr(whole, name)[kept]
        for name in ("part", "feature", "operation", "measured", "nominal", "repeat", "time_min",
                     "sequence", "direction", "file_index", "row")
    }  # fmt: skip
    return replace(whole, **arrays)


def test_of_three_readings_two_of_which_are_off_the_third_is_told() -> None:
    """Only where all are as far off is it said that no single slip makes it."""
    whole = three_holes(12, 3, 1, 0.003, 0.0005)
    own = np.flatnonzero((whole.part == 4) & (whole.feature == 1)).tolist()
    (two,) = told(moved(whole, own[:2], 0.3))
    assert "; the part's other 2 readings are at most 30" in two.message
    assert "no single slip" not in two.message
    (three,) = told(moved(whole, own, 0.3))
    assert "; the part's other 2 readings are as far off (" in three.message
    assert "no single slip" in three.message


def test_a_rounding_step_is_no_slip_but_many_are() -> None:
    """Of twenty parts that are alike to the last digit one may be a digit off."""
    rows = [(f"P{p}", name, 0, 0.0, 0.0) for p in range(20) for name in PLACES]
    for step in (0.001, 0.01):
        even = moved(points(rows), [4, 11], step)
        assert told(even) == []
        assert "row 9:" in told(moved(even, [7], 20 * step))[0].message


@pytest.mark.parametrize("digits", [2, 3])
def test_coordinates_of_few_digits_and_nominal_places_of_more_are_no_slips(digits: int) -> None:
    """Parts that differ by less than the last digit: most agree to it, and some are one off."""
    between = 10.0**-digits * np.array([0.333, 0.667, 0.15])
    off = 0
    for seed in range(40):
        whole = three_holes(15, 1 + seed % 2, seed, 0.15 * 10.0**-digits, 0.0)
        nominal = whole.nominal + between[whole.feature][:, None]
        measured = np.round(nominal + whole.measured - whole.nominal, digits)
        rounded = replace(whole, nominal=nominal, measured=measured)
        assert told(rounded) == []
        off += int(outlying_p(feature_tables(rounded).cells.mean, 5).min() < 1e-6)
        (warning,) = told(moved(rounded, [0], 20 * 10.0**-digits))
        assert "row 2:" in warning.message
    assert off > 5


def test_few_parts_are_not_judged() -> None:
    """Not by their means; of one repeat that is off alone the others tell."""
    assert told(moved(three_holes(4, 2, 1), [2, 3], 100.0)) == []
    assert [x.code for x in told(moved(three_holes(4, 2, 1), [3], 100.0))] == ["repeats-scatter"]
    assert told(moved(three_holes(5, 1, 1, 0.001), [3], 0.3)) != []


def test_a_part_is_told_once_and_many_parts_in_short() -> None:
    whole = three_holes(90, 1, 4)
    own = np.flatnonzero(whole.part == 7).tolist()
    (warning,) = told(moved(whole, own, 5.0, 1))
    assert warning.message.count("row ") == 1
    assert "(and 2 more of part 'P7')" in warning.message
    assert "they pull" in warning.message
    # Of feature a four, b four: none hides another.
    slips = np.flatnonzero((whole.part < 8) & (whole.feature == whole.part % 2)).tolist()
    off = moved(whole, slips, 5.0)
    odd = outlying(feature_tables(off), off)
    assert (len(odd.texts), odd.told) == (6, 8)
    (warning,) = odd.warnings
    assert warning.message.count("row ") == 6
    assert "; and 2 more parts: they pull" in warning.message


def test_an_item_that_is_biased_beside_its_slip_has_a_fault() -> None:
    """Parts that are 50 um off along x, one of them by 200 um more: scatter does not hide that."""
    _, truth, part = study()
    model, off = fitted(9, 7), made(truth, part, 1, offset=0.05)
    summary = compare(model, part, moved(off, [9], -0.2), Settings()).feature_summaries[0]
    assert summary.pulled > summary.pulled_alone
    assert summary.biased > 0
    headline = verdict_text(summary, "features", stands_out=("5",))
    assert f"readings of part '5' stand out by more than U ({summary.pulled} of " in headline
    assert "no fault shows" not in headline


def test_operations_are_apart() -> None:
    rows = [(f"P{p}", name, 0, 0.001 * (p % 4), 0.0) for p in range(12) for name in PLACES]
    both = points(rows + rows, ["milled"] * 36 + ["drilled"] * 36)
    (warning,) = told(moved(both, [40], 0.3))
    assert "row 42: part 'P1', feature 'b' (drilled), x_mm" in warning.message
    assert ", 299 um off the other parts, which scatter by 1.2 um" in warning.message


@pytest.mark.parametrize("by", [0.3, -0.3])
def test_the_farthest_of_a_table_is_far_off_whatever_its_sign(by: float) -> None:
    whole = three_holes(20, 1, 3)
    rows = np.flatnonzero((whole.feature == 1) & np.isin(whole.part, (2, 7)))
    found = moved(moved(whole, rows[:1].tolist(), by, 1), rows[1:].tolist(), 0.5 * by, 1)
    tables = feature_tables(found)
    far = farthest_off(tables, found)
    assert [tables.labels[i] for i in np.flatnonzero(far)] == [("", "b", "y")]
    assert far.max() == pytest.approx(0.3, abs=0.04)


@pytest.mark.parametrize(("by", "told"), [(0.02, False), (-0.05, True)])
def test_lengths_are_rounded_as_their_coarsest_axis(tmp_path: Path, by: float, told: bool) -> None:
    """Along y the CMM shows hundredths, along x it shows all: two of them are no slip."""
    rng = np.random.default_rng(1)
    rows = [
        (f"P{p}", name, 0, 0.0, 0.01 * (p % 6 == 5 and name == "b"))
        for p in range(20)
        for name in PLACES
    ]
    found = moved(points(rows), [2], by, 1)
    found.measured[:, 0] += rng.normal(0.0, 1e-5, len(found))
    tables = length_tables(found, visits_of(found), part_file(tmp_path))
    assert tables is not None
    far = farthest_off(tables, found)
    assert bool(far.any()) is told
    if told:
        assert [tables.labels[i] for i in np.flatnonzero(far)] == [("", "c-a", "")]
